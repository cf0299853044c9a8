"""Logs of weather sensors carried between a room and a cold box, from log to verdict through the import.

    python benchmarks/weather_logs.py --seeds 20 --first-seed 500

One sensor with a boxed thermometer (two lags) and a film on the same chip, one log, six transfers, no trigger and no
airs: the cold box cycles, its door is opened, dew forms on the way back; in half of them a fan makes the sensor faster
in the cold box than in the room. Per log: transfers found and steps used that
are none, errors of the starts, t63 of the thermometer against the truth, what is named that is not there, and each
channel's error on another log of the same sensor, plain and extended.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

# A box around the thermometer; a film that lags the air's temperature, and the dew on it.
TRUE_NAMES = {"temperature": {"series_lag", "sheath"}, "humidity": {"uptake_by_activity", "condensation"}}
FAN = "direction_dependent_exchange"
UNIT = {"temperature": "K", "humidity": "%RH"}
SUBSTEPS = 4
TRANSFERS = 6
GROWTH = 1.02


@dataclass(frozen=True)
class Sensor:
    """Time constants of the box, of the thermometer in it and of the film [s]; what the logger does; how much faster
    the box follows in the cold."""

    box_s: float
    own_s: float
    film_s: float
    period_s: float
    rounding: float
    fan: float

    @property
    def t63_s(self) -> float:
        a, b = self.box_s, self.own_s
        return float(
            brentq(lambda t: (a * np.exp(-t / a) - b * np.exp(-t / b)) / (a - b) - np.exp(-1.0), 1e-3, 10.0 * (a + b))
        )


def draw_sensor(random: np.random.Generator) -> Sensor:
    return Sensor(
        box_s=random.uniform(40.0, 200.0),
        own_s=random.uniform(5.0, 30.0),
        film_s=random.uniform(8.0, 40.0),
        period_s=float(random.choice([1.0, 2.0, 5.0])),
        rounding=float(random.choice([0.01, 0.1])),
        fan=float(random.choice([1.0, random.uniform(1.2, 2.5)])),
    )


def saturation_hpa(temperature_c: float) -> float:
    """Over water, Magnus (Sonntag 1990)."""
    return float(6.112 * np.exp(17.62 * temperature_c / (243.12 + temperature_c)))


def write_log(path: Path, sensor: Sensor, random: np.random.Generator) -> list[float]:
    """Integrate and write one log; the times of its transfers [s]."""
    room_c, room_percent = random.uniform(18.0, 24.0), random.uniform(25.0, 55.0)
    cold_c, cold_percent = random.uniform(3.0, 8.0), random.uniform(45.0, 75.0)
    cycle_s, swing_k = random.uniform(600.0, 1800.0), random.uniform(0.0, 1.5)
    phase = random.uniform(0.0, 1.0)
    stays_s = [random.uniform(8.0, 18.0) * sensor.box_s for _ in range(TRANSFERS + 1)]
    carried_s = list(np.cumsum(stays_s)[:-1])
    opened_s = [a + random.uniform(0.4, 0.8) * s for a, s in zip(carried_s[::2], stays_s[1::2], strict=True)]
    opened_s = [at for at in opened_s if random.random() < 0.5]
    own_c, box_c, film, dew = room_c, room_c, room_percent, 0.0
    step_s = sensor.period_s / SUBSTEPS
    decay = {tau: -np.expm1(-step_s / tau) for tau in (sensor.own_s, sensor.film_s)}
    of_box = {cold: -np.expm1(-step_s * (sensor.fan if cold else 1.0) / sensor.box_s) for cold in (False, True)}
    lines, at_s = ["seconds,temp_c,humidity"], 0.0
    for _ in range(int(sum(stays_s) / sensor.period_s)):
        for _ in range(SUBSTEPS):
            at_s += step_s
            cold = bool(np.searchsorted(carried_s, at_s) % 2)
            turn = (at_s / cycle_s + phase) % 1.0
            swing = swing_k * (1.0 - 4.0 * abs(turn - 0.5))
            air_c, percent = (cold_c + swing, cold_percent) if cold else (room_c, room_percent)
            if cold and any(0.0 <= at_s - at < 20.0 for at in opened_s):
                air_c, percent = air_c + 4.0, percent + 20.0
            box_c += (air_c - box_c) * of_box[cold]
            own_c += (box_c - own_c) * decay[sensor.own_s]
            local = percent * saturation_hpa(air_c) / saturation_hpa(own_c)
            # What is above saturation wets the film, which stays at 100 % until that is gone.
            dew = max(dew + step_s * (local - 100.0), 0.0) if local > 100.0 or dew > 0.0 else 0.0
            film += ((100.0 if dew > 0.0 else local) - film) * decay[sensor.film_s]
        readings = own_c + random.normal(0.0, 0.02), film + random.normal(0.0, 0.08)
        shown = [round(round(value / sensor.rounding) * sensor.rounding, 4) for value in readings]
        lines.append(f"{at_s:.1f},{shown[0]:g},{shown[1]:g}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return carried_s


def imported(log: Path, folder: Path) -> Path:
    """The log as a campaign, by the two commands that a user gives."""
    from shockrig.protocols.cli import main as shockrig

    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        shockrig(["import", str(log), "--look", "--out", str(folder / "look")])
        map_file = folder / "look" / f"{log.stem}.toml"
        shockrig(["import", str(log), "--map", str(map_file), "--out", str(folder / "campaign")])
    return folder / "campaign"


def trial(seed: int) -> dict[str, object]:
    """One sensor, two logs: everything the table says of it."""
    from ours import fresh_errors, judge, t63

    random = np.random.default_rng(seed)
    sensor = draw_sensor(random)
    with tempfile.TemporaryDirectory() as scratch:
        campaigns, starts = [], []
        for name in ("first", "second"):
            home = Path(scratch) / name
            home.mkdir()
            starts.append(write_log(home / "log.csv", sensor, random))
            campaigns.append(imported(home / "log.csv", home))
        heads = [json.loads(file.read_text()) for file in sorted(campaigns[0].glob("runs/*/run.json"))]
        seen = [float(head["imported"]["at"]) for head in heads]
        near = [min(abs(at - true) for true in starts[0]) for at in seen]
        outcome = judge(campaigns[0], 0, characterized=False)
        fresh = {channel: fresh_errors(outcome, campaigns[1], channel) for channel in TRUE_NAMES}
        told = {channel: outcome.tells(channel) for channel in TRUE_NAMES}
        measured = t63(outcome.extended, "temperature")
    named = {
        channel: {c["effect"]: c["probability"] for c in (said or {"causes": ()})["causes"]}
        for channel, said in told.items()
    }
    true = TRUE_NAMES | ({"temperature": TRUE_NAMES["temperature"] | {FAN}} if sensor.fan > 1.0 else {})
    wrong = [
        name for channel, those in named.items() for name, p in those.items() if p > 0.5 and name not in true[channel]
    ]
    found = [min(abs(at - true) for at in seen) < 0.2 * sensor.t63_s for true in starts[0]] if seen else []
    return {
        "found": sum(found),
        "others": sum(error > 0.2 * sensor.t63_s for error in near),
        "start_error_s": max((error for error in near if error <= 0.2 * sensor.t63_s), default=float("nan")),
        "t63_s": sensor.t63_s,
        "fan": sensor.fan,
        "t63": measured,
        "verdicts": {channel: said["verdict"] for channel, said in told.items() if said is not None},
        "named": named,
        "wrong": wrong,
        "fresh": fresh,
        "failed": outcome.refused | outcome.crashed,
    }


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=500)
    args = parser.parse_args(argv)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    found = others = stated = within = false = right = film = fans = blown = worse = 0
    for seed in range(args.first_seed, args.first_seed + args.seeds):
        one = trial(seed)
        found += one["found"]
        others += one["others"]
        off = "-"
        if one["t63"] is not None and one["t63"][1]:
            stated += 1
            sigmas = (one["t63"][0] - one["t63_s"]) / one["t63"][1]
            within += abs(sigmas) < 2.0
            off = f"{100.0 * (one['t63'][0] / one['t63_s'] - 1.0):+.1f} % ({sigmas:+.1f} sigma)"
        false += bool(one["wrong"])
        right += bool(set(one["named"]["temperature"]) & TRUE_NAMES["temperature"])
        blown += one["fan"] > 1.0
        fans += one["fan"] > 1.0 and FAN in one["named"]["temperature"]
        film += "uptake_by_activity" in one["named"]["humidity"]
        fresh = {channel: pair for channel, pair in one["fresh"].items() if pair is not None}
        worse += sum(after > GROWTH * before for before, after in fresh.values())
        errors = ", ".join(f"{before:.3g} > {after:.3g} {UNIT[c]}" for c, (before, after) in fresh.items()) or "-"
        said = "; ".join(
            f"{channel} {verdict}: {', '.join(f'{n} {p:.2f}' for n, p in one['named'][channel].items()) or 'nothing'}"
            for channel, verdict in one["verdicts"].items()
        )
        print(
            f"{seed}: {one['found']} of {TRANSFERS} transfers, {one['others']} other runs, starts within "
            f"{one['start_error_s']:.1f} s; t63 {one['t63_s']:.0f} s, off {off}; fan {one['fan']:.2f}; {said}; "
            f"another log {errors}" + "".join(f"; {k}: {v.splitlines()[-1][:80]}" for k, v in one["failed"].items()),
            flush=True,
        )
    total = TRANSFERS * args.seeds
    print(
        f"\n{args.seeds} logs: {found} of {total} transfers found, {others} runs that are none; t63 stated in {stated},"
        f" within two sigma in {within}; the box named in {right}, the fan in {fans} of {blown}, how the film takes up "
        f"in {film}, anything else with more than even odds in {false}; extensions worse on another log by more than "
        f"2 %: {worse}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
