"""Missions whose air, sensors and clock are known: what `shockrig learn` says of them, counted.

    python benchmarks/learn_worlds.py --missions 12 [--first-seed 1] [--out results/learn_worlds.txt]
    python benchmarks/learn_worlds.py --beside 8 [--first-seed 1] [--out FILE]
    python benchmarks/learn_worlds.py --speed 100

Each mission is two to eight ascents with their descents through air of its own equations: inversions (tanh),
turbulence (random phases under k^(-5/3)), layers that rise and an air that warms between the ways. What is hidden is a
lag in each channel, and beside it nothing, a clock, a wash that cools both sensors, a slow second path of the
thermometer, or a warmth of it that falls with airspeed; or nothing at all. The film has a temperature of its own, which
follows the air's 0.3 to 1.7 times as late as the bead does, and reads the air's vapour at it. Nothing of it shares code
with the analysis.

One more flight of each mission is kept back and corrected with what `learn` found: how far it is from its air as read
and corrected, off the ground, how much of it lies within two standard uncertainties, and whether its passes are nearer
by as much as the 90 % interval says that `learn` states for them.

`--beside` learns from so many missions of two flights of two sensors side by side, and counts what is said of each
alone and beside the other: lags within 1.96 uncertainties, how large those are, channels named, wrong causes named.

`--speed` learns from so many flights of 10,000 rows of one sensor with lags, and says how long that took.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from shockrig.analysis.flight.correct import correct
from shockrig.analysis.learn.bins import binned
from shockrig.analysis.learn.density import prepared
from shockrig.analysis.learn.learn import FLIGHT_BINS, NAMED_FROM, ChannelLearned, FlightsLearned, learn
from shockrig.analysis.learn.learned_profile import learned_profile
from shockrig.analysis.learn.pair import learn_pair
from shockrig.analysis.learn.passes import disagreement
from shockrig.files.flight import Corrected, Flight
from shockrig.protocols.learning import named_flights

STEP_S = 0.2
ROWS = 10_000  # of a flight that is timed
SLOW_PATH_S = 60.0
BESIDE_K, BESIDE_PERCENT = 0.3, -1.5  # by which a second sensor's calibration differs
TOP_M, OFF_GROUND_M = 1200.0, 20.0


@dataclass(frozen=True)
class Truth:
    """What is hidden: lags [s], by how much the position's clock is late [s], how warm wash makes both sensors [K], the
    share of a path of 60 s beside the thermometer's lag, and its warmth at 5 m/s [K]."""

    temperature_lag_s: float = 5.0
    humidity_lag_s: float = 10.0
    clock_s: float = 0.0
    wash_k: float = 0.0
    slow_share: float = 0.0
    warmth_k: float = 0.0

    def laws(self, channel: str) -> set[str]:
        """Keys of the laws that are hidden in a channel."""
        if channel == "humidity":
            return {"lag"} if self.humidity_lag_s else set()
        here = {"second_path" if self.slow_share else "lag"} if self.temperature_lag_s else set()
        both = (self.wash_k, "offset_in_descent"), (self.warmth_k, "ventilated_warmth")
        return here | {key for size, key in both if size}


KINDS = {
    "lags": Truth(),
    "nothing": Truth(0.0, 0.0),
    "clock of 18 s": Truth(clock_s=18.0),
    "wash of -1 K": Truth(wash_k=-1.0),
    "slow path": Truth(slow_share=0.25),
    "warmth": Truth(warmth_k=0.8),
}


def lagged(air: np.ndarray, lag_s: float) -> np.ndarray:
    """First order, by its recursion; the air itself where there is no lag."""
    if lag_s <= 0:
        return air
    kept = np.exp(-STEP_S / lag_s)
    out = np.empty_like(air)
    state = air[0]
    for i, value in enumerate(air):
        state = kept * state + (1.0 - kept) * value if i else value
        out[i] = state
    return out


def _turbulence(rng: np.random.Generator, height: np.ndarray, size: float) -> np.ndarray:
    k = np.fft.rfftfreq(height.size, height[1] - height[0])
    parts = np.zeros(k.size, complex)
    parts[1:] = k[1:] ** (-5 / 6) * np.exp(2j * np.pi * rng.uniform(size=k.size - 1)) * (k[1:] > 1e-3)
    found = np.fft.irfft(parts, height.size)
    return size * found / found.std()


@dataclass(frozen=True)
class Flown:
    """A flight, and the air of its rows: temperature [degC] and humidity [%RH]."""

    flight: Flight
    temperature_c: np.ndarray
    humidity_percent: np.ndarray


def _flight(rng: np.random.Generator, film_share: float, *truths: Truth) -> list[Flown]:
    """A flight of sensors side by side, each with what it reads; sensors behind the first are off by an offset."""
    up, down, hover = rng.uniform(3.0, 5.0), rng.uniform(4.0, 8.0), 20.0
    turn, descends = TOP_M / up, TOP_M / up + hover
    end = descends + TOP_M / down
    t = np.arange(-60.0, end + 30.0, STEP_S)
    z = np.interp(t, [0, turn, descends, end], [0, TOP_M, TOP_M, 0])
    height = np.arange(-10.0, TOP_M + 10.0, 2.0)
    temperature = 15.0 - 0.0065 * height
    for _ in range(rng.integers(1, 4)):
        at = rng.uniform(0.1, 0.9) * TOP_M
        temperature += rng.uniform(0.5, 4.0) * 0.5 * (1 + np.tanh((height - at) / rng.uniform(5, 30)))
    humidity = 60.0 - 5.0 * (temperature - temperature.mean()) + _turbulence(rng, height, 3.0)
    done = np.clip(t / end, 0.0, 1.0)
    moved = z - rng.normal(0.0, 10.0) * done
    back = np.clip((t - turn) / hover, 0.0, 1.0)

    def air(profile: np.ndarray, drift: float, eddies: float) -> np.ndarray:
        ways = [np.interp(z, height, _turbulence(rng, height, eddies)) for _ in range(2)]
        return np.interp(moved, height, profile) + drift * done + (1 - back) * ways[0] + back * ways[1]

    warm, moist = air(temperature, rng.normal(0.0, 0.2), 0.1), air(humidity, rng.normal(0.0, 1.0), 0.8)
    speed = np.select([t < 0, t < turn, t < descends, t < end], [0.5, up, 0.5, down], 0.5)
    found = [_read(rng, film_share, truth, t, z, warm, moist, speed, t > descends) for truth in truths]
    for i, one in enumerate(found[1:], 1):
        temperature, humidity = one.flight.temperature_c + BESIDE_K, one.flight.humidity_percent + BESIDE_PERCENT
        track = found[0].flight.altitude_m
        beside = replace(one.flight, temperature_c=temperature, humidity_percent=humidity, altitude_m=track)
        found[i] = replace(one, flight=beside)
    return found


def _read(
    rng: np.random.Generator,
    film_share: float,
    truth: Truth,
    t: np.ndarray,
    z: np.ndarray,
    warm: np.ndarray,
    moist: np.ndarray,
    speed: np.ndarray,
    sinks: np.ndarray,
) -> Flown:
    """What a sensor reads of air along a flight."""
    met = warm + truth.wash_k * sinks + truth.warmth_k * np.sqrt(5.0 / np.maximum(speed, 0.5))
    slow = truth.slow_share * (lagged(met, SLOW_PATH_S) - lagged(met, truth.temperature_lag_s))
    bead = lagged(met, truth.temperature_lag_s) + slow
    film_c = lagged(met, film_share * truth.temperature_lag_s)
    film = moist * np.exp(17.62 * warm / (243.12 + warm) - 17.62 * film_c / (243.12 + film_c))
    seen = bead, lagged(film, truth.humidity_lag_s)
    rows = slice(None, None, round(1.0 / STEP_S))
    at = t[rows]
    none = np.full(at.size, np.nan)
    logged = np.interp(at - truth.clock_s, t, z) + rng.normal(0.0, 0.3, at.size)
    noisy = [s[rows] + rng.normal(0.0, sigma, at.size) for s, sigma in zip(seen, (0.03, 0.1), strict=True)]
    return Flown(Flight(at, noisy[0], noisy[1], none, none, none, logged), warm[rows], moist[rows])


def flown(seed: int, truth: Truth, flights: int | None = None, more: int = 0) -> list[Flown]:
    """Flights of one sensor and their air; how many the seed decides, where it is not said, and `more` behind them."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 9)) if flights is None else flights
    film_share = rng.uniform(0.3, 1.7)  # of a sensor, once
    return [_flight(rng, film_share, truth)[0] for _ in range(count + more)]


def side_by_side(seed: int, first: Truth, second: Truth, flights: int) -> list[tuple[Flown, Flown]]:
    """Flights of two sensors in the same air, on one clock and one track."""
    rng = np.random.default_rng(seed)
    film_share = rng.uniform(0.3, 1.7)
    pairs = [_flight(rng, film_share, first, second) for _ in range(flights)]
    return [(one, other) for one, other in pairs]


def mission(seed: int, truth: Truth, flights: int | None = None) -> list[Flight]:
    """The flights alone."""
    return [one.flight for one in flown(seed, truth, flights)]


def errors(flown: Flown, found: Corrected) -> np.ndarray:
    """Of both channels: rms from the air as read and corrected, share within two standard uncertainties (2, 3)."""
    assert flown.flight.altitude_m is not None
    off_ground = flown.flight.altitude_m > OFF_GROUND_M
    rows = []
    sigmas = found.temperature_uncertainty_k, found.humidity_uncertainty_percent
    for name, sigma in zip(("temperature_c", "humidity_percent"), sigmas, strict=True):
        air = getattr(flown, name)
        read, after = ((getattr(one, name) - air)[off_ground] for one in (flown.flight, found))
        within = np.abs(after) < 2.0 * sigma[off_ground]
        rms = [float(np.sqrt(np.nanmean(x**2))) for x in (read, after)]
        known = np.isfinite(sigma[off_ground])
        rows.append([*rms, float(within[known].mean()) if known.any() else np.nan])
    return np.array(rows)


def write(flight: Flight, path: Path) -> Path:
    """A flight as the CSV that a user has."""
    columns = ("time_s", "temperature_c", "humidity_percent", "altitude_m")
    table = np.column_stack([getattr(flight, name) for name in columns])
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.4f")
    return path


@dataclass
class Count:
    """What was counted of missions of a kind."""

    missions: int = 0
    flights: int = 0
    seconds: float = 0.0
    no_profile: int = 0
    stated_lags: int = 0
    covered: int = 0
    hidden: int = 0
    in_set: int = 0
    channels: int = 0
    wrong: int = 0
    clocks: int = 0
    gains: int = 0
    gains_right: int = 0
    off: list[np.ndarray] = field(default_factory=list)

    def add(self, truth: Truth, flights: int, found: FlightsLearned, unseen: Flown) -> None:
        """Count a mission."""
        self.missions += 1
        self.flights += flights
        self.clocks += found.position_named
        for name, one in found.channels.items():
            hidden = truth.laws(name)
            self.channels += 1
            self.hidden += len(hidden)
            self.in_set += len(hidden & {cause.law.key for cause in one.causes})
            right = hidden | ({"late_die"} if hidden and name == "humidity" else set())  # its film is never as the bead
            self.wrong += any(c.probability >= NAMED_FROM and c.law.key not in right for c in one.causes)
            lag = truth.temperature_lag_s if name == "temperature" else truth.humidity_lag_s
            for cause in one.causes:
                if cause.law.key == "lag" and "lag" in hidden:
                    tau = cause.parameters[0]
                    self.stated_lags += 1
                    self.covered += abs(np.log(tau.value / lag)) < 1.96 * tau.standard_uncertainty / tau.value
            if one.gain is not None and one.verdict != "adequate":
                self.gains += 1
                self.gains_right += one.gain.low <= nearer(unseen.flight, one) <= one.gain.high
        profile = learned_profile(found, {})
        if profile is None:
            self.no_profile += 1
        else:
            self.off.append(errors(unseen, correct(unseen.flight, profile)))

    def lines(self, kind: str) -> list[str]:
        """Of the table."""
        found = [
            f"{kind:<14} {self.missions} missions of {self.flights / self.missions:.1f} flights, "
            f"{self.seconds / self.missions:.1f} s of a core each",
            f"    u(tau) covers {self.covered} of {self.stated_lags} stated lags; hidden causes in the set "
            f"{self.in_set} of {self.hidden}",
            f"    channels with a wrong cause named {self.wrong} of {self.channels}; clock named {self.clocks}; "
            f"gain's interval right {self.gains_right} of {self.gains}; no profile in {self.no_profile}",
        ]
        if self.off:
            table = np.nanmean(self.off, axis=0)
            for name, unit, (read, after, inside) in zip(("temperature", "humidity"), ("K", "%RH"), table, strict=True):
                found.append(
                    f"    a flight kept back, {name}: {read:.2f} {unit} as read, {after:.2f} corrected, "
                    f"{100 * inside:.0f} % within two uncertainties"
                )
        return found


def nearer(flight: Flight, one: ChannelLearned) -> float:
    """How far apart passes of a flight are under a model that was learned without it, over how far as read."""
    unit = prepared(binned(flight, "kept back", FLIGHT_BINS), one.channel)
    place = [i for i, channel in enumerate(one.fit.channels) if channel == one.channel]
    usual = np.median([one.fit.sizes[i] for i in place], axis=0)
    alone = replace(one.fit, sizes=(usual,), channels=(one.channel,))
    return disagreement([unit], alone, one.channel).rms / disagreement([unit], None, one.channel).rms


PAIRS = {  # first and second sensor
    "lags": (Truth(), Truth(2.0, 25.0)),
    "alike": (Truth(), Truth()),
    "clock of 18 s": (Truth(clock_s=18.0), Truth(2.0, 25.0, clock_s=18.0)),
    "slow path in one": (Truth(slow_share=0.25), Truth()),
}


def beside(seeds: range) -> Iterator[list[str]]:
    """What is said of sensors side by side, alone and together: the table after each mission."""
    counts = {way: Beside() for way in ("alone", "together")}
    for i, seed in enumerate(seeds):
        kind = list(PAIRS)[i % len(PAIRS)]
        flights = side_by_side(seed, *PAIRS[kind], flights=2)
        first, second = ({str(k): pair[which].flight for k, pair in enumerate(flights)} for which in (0, 1))
        found = learn_pair(first, second, ("temperature", "humidity"))
        for way, sensors in (("alone", found.alone), ("together", found.together)):
            for truth, one in zip(PAIRS[kind], sensors, strict=True):
                counts[way].add(truth, one)
        print(f"learn_worlds: seed {seed}, {kind}, side by side", file=sys.stderr, flush=True)
        yield [f"    {way:<9} {one.line()}" for way, one in counts.items()]


@dataclass
class Beside:
    """What was counted of sensors side by side."""

    channels: int = 0
    named: int = 0
    wrong: int = 0
    off: list[tuple[float, float]] = field(default_factory=list)

    def add(self, truth: Truth, found: FlightsLearned) -> None:
        """Count a sensor."""
        for name, one in found.channels.items():
            hidden = truth.laws(name) | ({"late_die"} if name == "humidity" else set())
            self.channels += 1
            self.named += one.verdict == "named"
            self.wrong += any(c.probability >= NAMED_FROM and c.law.key not in hidden for c in one.causes)
            lag = truth.temperature_lag_s if name == "temperature" else truth.humidity_lag_s
            for tau in (c.parameters[0] for c in one.causes if c.law.key == "lag" and "lag" in hidden):
                self.off.append((np.log(tau.value / lag), tau.standard_uncertainty / tau.value))

    def line(self) -> str:
        """Of the table."""
        off, sigma = np.array(self.off).reshape(-1, 2).T
        return (
            f"u(tau) covers {int(np.sum(np.abs(off) < 1.96 * sigma))} of {off.size} stated lags, median u "
            f"{100 * np.median(sigma):.0f} %, median error {100 * np.median(np.abs(off)):.0f} %; named {self.named} of "
            f"{self.channels} channels, a wrong cause in {self.wrong}"
        )


def alone(seeds: range) -> Iterator[list[str]]:
    """What is said of one sensor of each kind: the table after each mission."""
    counts = {kind: Count() for kind in KINDS}
    for i, seed in enumerate(seeds):
        kind = list(KINDS)[i % len(KINDS)]
        *used, unseen = flown(seed, KINDS[kind], more=1)
        began = time.process_time()
        found = learn({str(k): one.flight for k, one in enumerate(used)})
        counts[kind].seconds += time.process_time() - began
        counts[kind].add(KINDS[kind], len(used), found, unseen)
        print(f"learn_worlds: seed {seed}, {kind}", file=sys.stderr, flush=True)
        yield [line for name, count in counts.items() if count.missions for line in count.lines(name)]


def speed(seed: int, flights: int) -> str:
    """How long many flights of many rows take, read from CSV."""
    with tempfile.TemporaryDirectory() as folder:
        paths = []
        for i, one in enumerate(mission(seed, Truth(), flights)):
            at = np.linspace(one.time_s[0], one.time_s[-1], ROWS)
            names = ("temperature_c", "humidity_percent", "altitude_m")
            columns = {name: np.interp(at, one.time_s, getattr(one, name)) for name in names}
            none = np.full(ROWS, np.nan)
            full = replace(one, time_s=at, airspeed_m_s=none, die_temperature_c=none, pressure_hpa=none, **columns)
            paths.append(write(full, Path(folder) / f"{i:04d}.csv"))
        began = time.process_time()
        read = named_flights(paths)[0]
        then = time.process_time()
        found = learn(read)
        spent = time.process_time() - then
    lags = ", ".join(f"{name} {np.exp(one.lag.theta[0]):.2f} s" for name, one in found.channels.items())
    return (
        f"{flights} flights of {ROWS} rows, seed {seed}: read in {then - began:.1f} s, learned from in {spent:.1f} s "
        f"of a core; {lags}"
    )


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--missions", type=int, default=12, help="in all; kinds take turns")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--beside", type=int, metavar="MISSIONS", help="of two sensors side by side, in place of them")
    parser.add_argument("--speed", type=int, metavar="FLIGHTS", help="of 10,000 rows: how long they take")
    parser.add_argument("--out", type=Path, help="is written anew after each mission")
    args = parser.parse_args(argv)
    if args.speed:
        print(speed(args.first_seed, args.speed))
        return 0
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=False)
    seeds = range(args.first_seed, args.first_seed + (args.beside or args.missions))
    what = "missions of two flights of two sensors" if args.beside else "missions"
    text = ""
    for done, lines in enumerate((beside if args.beside else alone)(seeds), 1):
        head = f"commit {commit.stdout.strip()}, {done} {what}, seeds {seeds[0]} to {seeds[done - 1]}"
        text = "\n".join([head, *lines]) + "\n"
        if args.out is not None:
            args.out.write_text(text, encoding="utf-8")
    print(text, end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
