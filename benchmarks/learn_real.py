"""Real flights of one sensor, up and down: what `shockrig learn` says of them, and how far their passes then disagree.

    python benchmarks/learn_real.py CACHE [--clock 18] [--out results/learn_real.txt]
    python benchmarks/learn_real.py CACHE --ahead --only "One Tree" --out results/learn_ahead.txt

CACHE holds folders of logs that were fetched from public repositories; nothing of them is in this repository. In
`dives` is what `real_passes.py` takes. Of a mission that judges, no log is read here: of Lake Michigan the first one
alone is.
Each flight's passes are corrected by a fit without the flight. Mean and spread are of the later pass less the earlier.
With `--clock`, the altitudes are made late by so many seconds, and what is called a clock then is told alone.
Where there are four flights or more, `correct` takes the profile learned from every other one to those between.

`--ahead` asks what a shift of the position's clock is in logs that agree best with one: by how much the thermometer is
ahead of the altitude on each way, from what both do within half a minute (a clock is the same on both ways); how far
the altitude is ahead of the pressure of the same record; and how well a clock, a warmth that airflow carries off and a
cold that there is on the way up alone predict the flights, each beside one lag. `--clock` makes altitudes late before.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from real_pass_sets import CORMORANTS, SEAL, SONDE_FOLDERS, SONDES, bouts, fur_seal, sonde
from scipy.ndimage import gaussian_filter1d

from shockrig.analysis.flight.correct import correct
from shockrig.analysis.learn.bins import CHANNELS, FlightBins, binned, why_nothing
from shockrig.analysis.learn.density import prepared
from shockrig.analysis.learn.flights_fit import fitted
from shockrig.analysis.learn.laws import LAWS, Law, LawParameter
from shockrig.analysis.learn.learn import FLIGHT_BINS, learn
from shockrig.analysis.learn.learned_profile import learned_profile
from shockrig.analysis.learn.passes import disagreement
from shockrig.analysis.physics.standard_atmosphere import pressure_altitude_m
from shockrig.files.errors import InputError
from shockrig.files.flight import Flight
from shockrig.protocols.flight_clock import on_clock
from shockrig.protocols.learning import named_flights, sentence

FEWEST = 4  # flights, of which a half is learned from and a half corrected
WITHIN_S = 30.0  # what lasts longer is not looked at where readings are held beside altitudes
FARTHEST_S = 40.0  # by which readings are moved
OFF_GROUND_M = 40.0
CLIMB_M_S = 3.0  # of a cold on the way up as it is stated

SETS: dict[str, Callable[[Path, Path], list[Path]]] = {
    "Lake Michigan, first mission (evans36/lakemichigan @11f5ecb, Windsond S1)": lambda cache, _: sorted(
        cache.glob("lakemichigan/01-06012023/*.csv")
    ),
    "One Tree Island (christian-eckert/meteorology-one_tree_island, iMet-XQ2)": lambda cache, _: sorted(
        cache.glob("one_tree/*.csv")
    ),
    "A balloon to 31 km and down (KNMI/Hackathon-RDWD-MeteoDrone @be3fcba, 20170608.txt)": lambda cache, made: balloon(
        cache / "knmi/20170608.txt", made
    ),
    "A fur seal's dives (scikit-diveMove 1.0.0, its tests' data)": lambda cache, made: dives(cache / "dives", made),
    "Cormorants' bouts of dives (cpforager 1.3.1, its data)": lambda cache, made: birds(cache / "dives", made),
    "Dropsondes (pydropsonde 0.4.1, its example data)": lambda cache, made: sondes(cache / "dives", made),
}


def birds(folder: Path, made: Path) -> list[Path]:
    """Bouts of one bird."""
    paths = []
    for log in sorted(folder.glob(CORMORANTS.format(55)))[:1]:
        for i, frame in enumerate(bouts(log)):
            paths.append(made / f"bout{i}.csv")
            frame.to_csv(paths[-1], index=False)
    return paths


def sondes(folder: Path, made: Path) -> list[Path]:
    """Sondes out of an aircraft: one way down."""
    paths = []
    for i, log in enumerate(sorted((folder / SONDES).glob(SONDE_FOLDERS[0]))[:5]):
        paths.append(made / f"sonde{i}.csv")
        sonde(log).drop(columns="flies").to_csv(paths[-1], index=False)
    return paths


def balloon(log: Path, made: Path) -> list[Path]:
    """The log with the header that it lacks."""
    if not log.exists():
        return []
    rows = np.loadtxt(log, usecols=(0, 1, 2, 3))
    names = "time_s,pressure_hpa,temperature_c,humidity_percent"
    np.savetxt(made / "balloon.csv", rows, delimiter=",", header=names, comments="", fmt="%.2f")
    return [made / "balloon.csv"]


def dives(folder: Path, made: Path) -> list[Path]:
    """Dives of the second half of the record, each with two minutes before and one behind it."""
    if not (folder / SEAL).exists():
        return []
    paths = []
    for i, log in enumerate(fur_seal(folder).logs):
        paths.append(made / f"dive{i:02d}.csv")
        log.frame.to_csv(paths[-1], index=False)
    return paths


def _late(flight: Flight, clock_s: float) -> Flight:
    """A flight whose altitude is logged late."""
    assert flight.altitude_m is not None
    known = np.isfinite(flight.time_s) & np.isfinite(flight.altitude_m)
    late = np.interp(flight.time_s - clock_s, flight.time_s[known], flight.altitude_m[known])
    return replace(flight, altitude_m=late)


def table(cache: Path, made: Path, clock_s: float, only: str, shifted: bool = False) -> list[str]:
    """Lines for each set that is in the cache."""
    lines = []
    for name, logs in SETS.items():
        if not name.startswith(only):
            continue
        paths = logs(cache, made)
        if not paths:
            lines += [f"{name}: not in the cache", ""]
            continue
        if shifted:
            lines += [name, *ahead_table(paths, clock_s), ""]
            continue
        began = time.process_time()
        flights = named_flights(paths)[0]
        if clock_s:
            flights = {key: _late(one, clock_s) for key, one in flights.items()}
        try:
            found = learn(flights, progress=lambda said: print(said, file=sys.stderr, flush=True))
        except InputError as error:
            lines += [f"{name}: refused: {error}"[:400], ""]
            continue
        spent = time.process_time() - began
        lines += [f"{name}: {len(found.bins)} of {len(paths)} flights, {spent:.0f} s of a core"]
        profile = learned_profile(found, {})
        for one in () if clock_s else found.channels.values():
            lines.append(f"  {sentence(one)}")
            for said, off in (("as read", one.read), ("best single lag", one.single), ("likeliest model", one.model)):
                lines.append(f"    {said:<16} mean {off.mean:+6.2f}   about it {off.spread:5.2f}   rms {off.rms:5.2f}")
            kept = profile is None or getattr(profile, one.channel) is None
            lines.append(f"    refuted by structure: {', '.join(one.refuted) or 'nothing'}")
            lines.append(f"    profile of all flights: {'leaves it as it is read' if kept else 'corrects it'}")
        for cause in found.position:
            (shift,) = cause.parameters
            lines.append(
                f"  position: shift {shift.value:.2f} ± {shift.standard_uncertainty:.2f} s "
                f"(probability {cause.probability:.2f})"
            )
        lines += [f"  {weight:.3f}  {said}" for said, weight in found.weights[:5]]
        if clock_s:
            continue
        lines += [*corrected(named_flights([p for p in paths if p.name not in found.left_out])[0]), ""]
    return lines


def corrected(flights: dict[str, Flight]) -> list[str]:
    """How far passes of every second flight disagree, as read and corrected with the profile of the others."""
    if len(flights) < FEWEST:
        return []
    names = list(flights)
    learned = learn({name: flights[name] for name in names[::2]})
    profile = learned_profile(learned, {})
    if profile is None:
        return ["  every other flight: no profile"]
    lines = []
    for channel in CHANNELS:
        part = getattr(profile, channel)
        rms = []
        for name in names[1::2]:
            log = flights[name]
            if learned.position_named:  # of this one logger, as a user would
                log = on_clock(log, learned.position[0].parameters[0].value)
            found = correct(log, profile)
            air = replace(log, temperature_c=found.temperature_c, humidity_percent=found.humidity_percent)
            both = [binned(one, name, FLIGHT_BINS) for one in (flights[name], air)]
            if all(one.has(channel) for one in both):
                rms.append([disagreement([prepared(one, channel)], None, channel).rms for one in both])
        if not rms:
            continue
        effects = "" if part is None else "".join(f", {one.effect}" for one in part.effects)
        said = "not in the profile" if part is None else f"profile with a lag{effects}"
        read, after = np.sqrt(np.mean(np.square(rms), axis=0))
        better = sum(b < a for a, b in rms)
        lines.append(
            f"  every other flight, {channel}: {said}; {len(rms)} flights between them, rms {read:.2f} as read, "
            f"{after:.2f} corrected, nearer in {better}"
        )
    return lines


def ahead(flight: Flight) -> tuple[float, float, float]:
    """By how much the thermometer is ahead of the altitude on the way up and on the way down, and the altitude of the
    pressure [s]: where what both do within half a minute agrees best. NaN for a way of less than three minutes, or
    without a pressure."""
    assert flight.altitude_m is not None
    at = np.arange(np.nanmin(flight.time_s) + 1.0, np.nanmax(flight.time_s))

    def column(values: np.ndarray) -> np.ndarray:
        good = np.isfinite(values) & np.isfinite(flight.time_s)
        if not good.any():
            return np.full(at.size, np.nan)
        order = np.argsort(flight.time_s[good], kind="stable")
        return np.interp(at, flight.time_s[good][order], values[good][order])

    def within(values: np.ndarray) -> np.ndarray:
        return gaussian_filter1d(values, 1.5) - gaussian_filter1d(values, WITHIN_S)

    altitude, warm = column(flight.altitude_m), within(column(flight.temperature_c))
    barometer = within(column(pressure_altitude_m(flight.pressure_hpa)))
    flies, top = np.flatnonzero(altitude > np.nanmin(altitude) + OFF_GROUND_M), int(np.argmax(altitude))
    shifts, edge = np.arange(-FARTHEST_S, FARTHEST_S + 1.0), int(2.0 * WITHIN_S)

    def best(values: np.ndarray, first: int, last: int, sign: float) -> float:
        if last - first < edge:
            return np.nan
        moved = (within(np.interp(at + shift, at, altitude))[first:last] for shift in shifts)
        return float(shifts[np.nanargmax([sign * np.corrcoef(values[first:last], one)[0, 1] for one in moved])])

    whole = flies[0] + edge, flies[-1] - edge
    pressure = -best(barometer, *whole, 1.0) if np.isfinite(barometer).all() else np.nan
    return best(warm, whole[0], top - edge, -1.0), best(warm, top + edge, whole[1], -1.0), pressure


def _cold_on_the_way_up() -> Law:
    """What no law of the catalogue is: a thermometer that reads less the faster it climbs, and nothing else when it
    sinks."""

    def offset(values: Mapping[str, float], bins: FlightBins) -> np.ndarray:
        return -values["cold_k"] * np.maximum(bins.climb_m_s, 0.0) / CLIMB_M_S

    cold = LawParameter("cold_k", "K", 0.0, 0.5, -10.0, 10.0, (0.3,), "colder at 3 m/s of climb")
    return Law("cold_on_the_way_up", ("unknown",), "temperature", (cold,), "", "", "", offset=offset)


def ahead_table(paths: list[Path], clock_s: float) -> list[str]:
    """Lines of what a shift of the position's clock is in a set's logs, whose altitudes are made late beforehand."""
    flights = {key: _late(one, clock_s) for key, one in named_flights(paths)[0].items() if not why_nothing(one)}
    lines = ["    thermometer ahead of the altitude, up and down; altitude ahead of the pressure [s]"]
    for name, flight in flights.items():
        up, down, pressure = ahead(flight)
        lines.append(f"    {name:<28} {up:+5.0f} {down:+5.0f} {pressure:+5.0f}")
    units = [prepared(binned(flight, name, FLIGHT_BINS), "temperature") for name, flight in flights.items()]
    lag, start = LAWS["temperature.lag"], np.log(2.0)
    beside = LAWS["position.clock_offset"], LAWS["temperature.ventilated_warmth"], _cold_on_the_way_up()
    plain = fitted((lag,), units, np.array([start]))
    lines.append("    nats by which temperature is predicted better than by one lag, beside it; its size; the lag [s]")
    for law in beside:
        fits = [fitted((lag, law), units, np.array([start, at])) for at in law.parameters[0].starts]
        one = max(fits, key=lambda fit: float(fit.predicted().sum()))
        gain, size = one.predicted().sum() - plain.predicted().sum(), np.sqrt(one.covariance[1, 1])
        lines.append(
            f"    {law.key:<20} {gain:+6.1f}   {one.theta[1]:6.2f} ± {size:.2f} {law.parameters[0].unit:<3}"
            f" {np.exp(one.theta[0]):5.2f}"
        )
    return lines


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cache", type=Path)
    parser.add_argument("--clock", type=float, default=0.0, metavar="S", help="by which altitudes are made late")
    parser.add_argument("--ahead", action="store_true", help="what a shift of the clock is in logs as they are")
    parser.add_argument("--only", default="", metavar="NAME", help="sets whose name begins so")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args(argv)
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=False)
    with tempfile.TemporaryDirectory() as made:
        lines = table(args.cache, Path(made), args.clock, args.only, args.ahead)
    text = "\n".join([f"commit {commit.stdout.strip()}", "", *lines])
    print(text)
    if args.out is not None:
        args.out.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
