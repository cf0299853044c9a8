"""Missions whose air, sensors and clock are known: what `shockrig learn` says of them, counted.

    python benchmarks/learn_worlds.py --missions 10 [--first-seed 1] [--out results/learn_worlds.txt]

Each mission is two to four ascents with their descents through air of its own equations: inversions (tanh), turbulence
(random phases under k^(-5/3)), layers that rise and an air that warms between the ways. What is hidden is a lag in each
channel, none at all, a clock, or a wash that cools both sensors. The film has a temperature of its own, which follows
the air's 0.3 to 1.7 times as late as the bead does, and reads the air's vapour at it. Nothing of it shares code with
the analysis.

One more flight of each mission is kept back and corrected with what `learn` found: how far it is from its air as read
and corrected, off the ground, and how much of it lies within two standard uncertainties.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from shockrig.analysis.flight.correct import correct
from shockrig.analysis.learn.learn import learn
from shockrig.analysis.learn.profile import learned_profile
from shockrig.files.flight import Corrected, Flight

STEP_S = 0.2
TOP_M, OFF_GROUND_M = 1200.0, 20.0


@dataclass(frozen=True)
class Truth:
    """What is hidden: lags [s], by how much the position's clock is late [s], how warm wash makes both sensors [K]."""

    temperature_lag_s: float = 5.0
    humidity_lag_s: float = 10.0
    clock_s: float = 0.0
    wash_k: float = 0.0


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


def _flight(rng: np.random.Generator, truth: Truth) -> Flown:
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
    bead = lagged(warm + truth.wash_k * (t > descends), truth.temperature_lag_s)
    film_c = lagged(warm + truth.wash_k * (t > descends), rng.uniform(0.3, 1.7) * truth.temperature_lag_s)
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
    count = int(rng.integers(2, 5)) if flights is None else flights
    return [_flight(rng, truth) for _ in range(count + more)]


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


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--missions", type=int, default=10, help="of each kind")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args(argv)
    commit = subprocess.run(["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=False)
    lines = [f"commit {commit.stdout.strip()}, seeds from {args.first_seed}, {args.missions} missions of each kind"]
    kinds = {
        "lags": Truth(),
        "nothing": Truth(0.0, 0.0),
        "clock of 18 s": Truth(clock_s=18.0),
        "wash of -1 K": Truth(wash_k=-1.0),
    }
    for kind, truth in kinds.items():
        within, in_set, called, clocks, spent, total, without = 0, 0, 0, 0, 0.0, 0, 0
        off: list[np.ndarray] = []
        for seed in range(args.first_seed, args.first_seed + args.missions):
            began = time.process_time()
            *used, unseen = flown(seed, truth, more=1)
            found = learn({str(i): one.flight for i, one in enumerate(used)})
            spent += time.process_time() - began
            profile = learned_profile(found, {})
            if profile is None:
                without += 1
            else:
                off.append(errors(unseen, correct(unseen.flight, profile)))
            clocks += found.position_named
            for channel, hidden in (("temperature", truth.temperature_lag_s), ("humidity", truth.humidity_lag_s)):
                one = found.channels[channel]
                total += 1
                sigma = float(np.sqrt(one.lag.covariance[0, 0]))
                within += hidden > 0 and abs(one.lag.theta[0] - np.log(hidden)) < 1.96 * sigma
                in_set += any(cause.law.key == "lag" for cause in one.causes)
                called += any(cause.probability >= 0.95 for cause in one.causes)
            print(f"learn_worlds: {kind}, seed {seed}", file=sys.stderr, flush=True)
        lines.append(
            f"{kind:<15} u(tau) covers {within:>3} of {total}   lag in the set {in_set:>3}   "
            f"something called {called:>3}   clock called {clocks:>3} of {args.missions}   "
            f"{spent / args.missions:.0f} s a mission"
        )
        if off:
            table = np.nanmean(off, axis=0)
            for name, unit, (read, after, inside) in zip(("temperature", "humidity"), ("K", "%RH"), table, strict=True):
                lines.append(
                    f"{'':<15} a flight kept back, {name}: {read:.2f} {unit} as read, {after:.2f} corrected, "
                    f"{100 * inside:.0f} % within two uncertainties"
                )
        if without:
            lines.append(f"{'':<15} no profile in {without} of {args.missions}")
    text = "\n".join(lines) + "\n"
    print(text, end="")
    if args.out is not None:
        args.out.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
