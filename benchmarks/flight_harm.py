"""Where may a correction do harm? Sixty-six kinds of flights from a solver of their own, beside what others use.

    python benchmarks/flight_harm.py [--kinds NAME ...] [--seeds N] [--first-seed N] [--no-peers] [--fresh] [--out FILE]

One line a kind and channel: rms error of the reading, of the best peer (tuned in hindsight, flight by flight), of the
smoother; its largest share of the reading's in one flight; what its 95 % interval covers, with the standard error that
flights' scatter leaves it (errors of one flight go together: its sensor's D is off throughout); the stated uncertainty,
rms over all samples, over the rms error; and its error over that of a Wiener filter that knows the sensor and the power
spectrum of that flight's air. With --out flights are JSON lines of that file, and those that it holds already are not
flown again; --table prints what a file holds.
"""

from __future__ import annotations

import argparse
import sys
import warnings
import zlib
from pathlib import Path

import numpy as np
from flight_fresh import FRESH
from flight_kinds import KINDS
from flight_worlds import BEAD_RATE, FILM_RATE, Flown, World, fly, saturation_hpa
from resumed import kept, scored
from scipy.ndimage import median_filter
from scipy.stats import norm

from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.files.flight import Flight
from shockrig.files.profile import DiffusivityRow, HumidityProfile, Profile, ResponseTime

Array = np.ndarray
CHANNELS = ("temperature_c", "humidity_percent")
SIGMAS = {"temperature_c": "temperature_uncertainty_k", "humidity_percent": "humidity_uncertainty_percent"}
ABSURD = (6526.9, -99.0, 0.0, 95.0)
WIDTHS = (1, 3, 5, 9, 15, 25, 41, 71, 121)
STRENGTHS = np.geomspace(1e-8, 1e8, 33)
CUTOFFS = np.array([0.004, 0.008, 0.015, 0.03, 0.06, 0.1, 0.2, 0.3])  # cycles a sample
TAPS = 60


def profile_of(world: World) -> Profile:
    """What the lab states of the pair that flies."""
    plain = typical_profile()
    old = plain.humidity
    rows = []
    for ambient in world.ambients_c:
        t98 = float(world.film_t98_s(np.array(ambient))) / world.stated
        d = FILM_RATE * old.film_thickness_m**2 / t98
        times = ResponseTime(t98 * 0.32025 / FILM_RATE, t98 * 0.84809 / FILM_RATE, t98)
        rows.append(DiffusivityRow(ambient, d, world.stated_relative * d, None, times))
    film = HumidityProfile(tuple(rows), noise_percent=old.noise_percent, sampling_period_s=world.period_s)
    return Profile(plain.temperature, film)


def held(kind: str, s: Array) -> Array:
    """Transfer function of the core of a sphere or the mean of a film, of unit rate."""
    q = np.sqrt(s + 1e-12)
    q = np.where(q.real > 300, 300 + 1j * q.imag, q)
    return q / np.sinh(q) if kind == "sphere" else np.tanh(q) / q


def spectral(reading: Array, gain: Array, wanted: Array) -> Array:
    """conj(H) Y / (|H|^2 + wanted), ends reflected oddly; `gain` and `wanted` on the padded length's frequencies."""
    n = reading.size
    padded = np.pad(reading, n // 2, mode="reflect", reflect_type="odd")
    line = np.linspace(padded[0], padded[-1], padded.size)
    inverse = np.conj(gain) / (np.abs(gain) ** 2 + wanted)
    slope = (line[1] - line[0]) if n > 1 else 0.0
    phase = np.angle(inverse[1]) / (2 * np.pi / padded.size)  # samples that a slow signal is put ahead
    return (np.fft.irfft(np.fft.rfft(padded - line) * inverse, padded.size) + line + slope * phase)[n // 2 :][:n]


def peers(kind: str, reading: Array, rate: Array, period: float) -> dict[str, list[Array]]:
    """Each peer's corrections of an evenly sampled reading, one for each setting of its knob."""
    found: dict[str, list[Array]] = {}
    decay = np.exp(-period * rate / (0.17091 if kind == "sphere" else 0.32025))
    air = np.empty_like(reading)
    air[:-1] = (reading[1:] - reading[:-1] * decay[:-1]) / (1 - decay[:-1])
    air[-1] = air[-2]
    rows = np.arange(reading.size)
    air = np.interp(rows, rows + 0.5, air)
    found["first order"] = []
    for width in WIDTHS:
        padded = np.pad(air, width // 2, mode="reflect", reflect_type="odd")
        found["first order"].append(np.convolve(padded, np.full(width, 1 / width), mode="valid"))
    mean = float(np.exp(np.mean(np.log(rate))))
    size = reading.size + 2 * (reading.size // 2)
    frequency = np.fft.rfftfreq(size)
    gain = held(kind, 2j * np.pi * frequency / (period * mean))
    for name, power in (("Wiener", 5 / 3), ("Tikhonov", 4.0)):
        found[name] = [spectral(reading, gain, s * frequency**power) for s in STRENGTHS]
    found["PyDynamic"] = [_pydynamic(kind, reading, period, mean, c) for c in CUTOFFS]
    return found


def _pydynamic(kind: str, reading: Array, period: float, rate: float, cutoff: float) -> Array:
    from PyDynamic.model_estimation.fit_filter import LSFIR
    from scipy.signal import firwin, lfilter

    frequency = np.linspace(0.0, min(3 * cutoff, 0.45), 3 * TAPS)
    gain = held(kind, 2j * np.pi * frequency / (period * rate))
    taps, _ = LSFIR(
        np.concatenate([gain.real, gain.imag]), TAPS, frequency / period, 1 / period, TAPS // 2, verbose=False, inv=True
    )
    taps = taps / taps.sum()
    count = 2 * min(int(2 / cutoff), reading.size // 4) + 1
    low = firwin(count, 2 * cutoff)
    padded = np.pad(reading, TAPS + count, mode="reflect", reflect_type="odd")
    out = lfilter(taps, 1.0, lfilter(low, 1.0, padded))
    return out[TAPS + count + TAPS // 2 + count // 2 :][: reading.size]


def informed(kind: str, reading: Array, truth: Array, rate: Array, period: float, noise: float) -> Array:
    """A Wiener filter that knows the sensor (on the clock of its own rate) and the spectrum of this flight's air."""
    own = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))]) * period
    even = np.linspace(0.0, own[-1], own.size)
    reading, air = np.interp(even, own, reading), np.interp(even, own, truth)
    n = air.size
    size = n + 2 * (n // 2)
    padded = np.pad(air, n // 2, mode="reflect", reflect_type="odd")
    power = np.abs(np.fft.rfft(padded - np.linspace(padded[0], padded[-1], size))) ** 2 / size
    index = np.arange(1, power.size)
    bins = np.floor(4 * np.log2(index)).astype(int)
    _, place = np.unique(bins, return_inverse=True)
    smooth = np.bincount(place, power[1:]) / np.bincount(place)
    power[1:] = smooth[place]
    power[0] = power[1]
    gain = held(kind, 2j * np.pi * np.fft.rfftfreq(size, even[1] - even[0]))
    return np.interp(own, even, spectral(reading, gain, noise**2 / np.maximum(power, 1e-12)))


def even(reading: Array) -> Array:
    """Gaps bridged, single absurd values taken out by a median, as one does before filtering."""
    rows = np.arange(reading.size)
    known = np.isfinite(reading)
    values = np.interp(rows, rows[known], reading[known])
    calm = median_filter(values, 5, mode="nearest")
    return np.where(np.abs(values - calm) > 20, calm, values)


def score(name: str, seed: int, with_peers: bool) -> list[dict]:
    """Both channels of one flight."""
    world = (KINDS | FRESH)[name](np.random.default_rng([seed, zlib.crc32(name.encode())]))
    flown = fly(world, seed + zlib.crc32(name.encode()))  # other sensors in each kind
    log = flown.log
    unknown = np.full(log["time_s"].size, np.nan)
    readings = (log["time_s"], log["temperature_c"], log["humidity_percent"])
    flight = Flight(*readings, unknown, unknown, unknown, altitude_m=log["altitude_m"])
    done = correct(flight, profile_of(world))
    results = []
    cases = _peer_cases(world, flown) if with_peers else {}
    for channel in CHANNELS:
        truth, reading = flown.truth[channel], log[channel]
        ours, sigma = getattr(done, channel), getattr(done, SIGMAS[channel])
        right = np.isfinite(reading) & ~np.isin(reading, ABSURD)
        rows = right & np.isfinite(ours)
        line = {"kind": name, "seed": seed, "channel": channel, "given": float(rows.sum() / right.sum())}
        line["reading"], line["ours"] = (rms(v[rows] - truth[rows]) for v in (reading, ours))
        line["worst"] = float(np.abs(ours[rows] - truth[rows]).max())
        known = rows & np.isfinite(sigma)
        off = np.abs(ours[known] - truth[known])
        line["covered"] = float(np.mean(off <= 1.96 * sigma[known])) if known.any() else float("nan")
        line["stated"] = rms(sigma[known])
        for peer, settings in cases.get(channel, {}).items():
            line[peer] = min(rms(value[rows] - truth[rows]) for value in settings)
        results.append(line)
    return results


def _peer_cases(world: World, flown: Flown) -> dict[str, dict[str, list[Array]]]:
    log, period = flown.log, world.period_s
    bead = even(log["temperature_c"])
    truth = flown.truth["temperature_c"]
    cases = {"temperature_c": peers("sphere", bead, np.full(bead.size, BEAD_RATE), period)}
    best = min((v for settings in cases["temperature_c"].values() for v in settings), key=lambda v: rms(v - truth))
    noise = np.hypot(0.02 * world.noise, world.step_k / np.sqrt(12))
    know = informed("sphere", bead, truth, np.full(bead.size, flown.bead_rate), period, float(noise))
    cases["temperature_c"]["informed"] = [know]
    humidity = even(log["humidity_percent"])
    rate = FILM_RATE / world.film_t98_s(bead) * world.stated
    found: dict[str, list[Array]] = {}
    # vapour at the bead's reading or at its best correction, or relative humidity as if it were what diffuses
    for scale in (saturation_hpa(bead), saturation_hpa(best), np.ones(bead.size)):
        for peer, settings in peers("film", humidity * scale, rate, period).items():
            found.setdefault(peer, []).extend(v / scale for v in settings)
    scale = saturation_hpa(know)
    noise = float(np.hypot(0.06 * world.noise, world.step_percent / np.sqrt(12)) * scale.mean())
    vapour = flown.truth["humidity_percent"] * saturation_hpa(truth)
    found["informed"] = [informed("film", humidity * scale, vapour, flown.film_rate, period, noise) / scale]
    cases["humidity_percent"] = found
    return cases


def rms(error: Array) -> float:
    return float(np.sqrt(np.mean(error**2))) if error.size else float("nan")


PEERS = ("first order", "Wiener", "Tikhonov", "PyDynamic")


def table(lines: list[dict]) -> None:
    """A row for each kind and channel, and how many meet what is asked of them."""
    print(
        f"{'kind':<22}{'channel':<10}{'reading':>9}{'best peer':>10} {'':<12}{'smoother':>9}{'x peer':>7}"
        f"{'x read.':>8}{'worst':>8}{'covered':>8}{'+-':>7}{'u/error':>8}{'x informed':>11}"
    )
    met, low, by_chance = np.zeros(3, dtype=int), 0, 0.0
    groups: dict[tuple[str, str], list[dict]] = {}
    for line in lines:
        groups.setdefault((line["kind"], line["channel"]), []).append(line)
    for (kind, channel), flights in groups.items():
        size = {key: rms(np.array([f[key] for f in flights])) for key in ("reading", "ours")}
        tuned = {p: rms(np.array([f[p] for f in flights])) for p in PEERS if all(p in f for f in flights)}
        best = min(tuned, key=lambda p: tuned[p]) if tuned else "-"
        beside = min(tuned.get(best, np.nan), size["reading"])
        of_reading = max(f["ours"] / f["reading"] for f in flights)
        stated = np.array([f["covered"] for f in flights])
        stated = stated[np.isfinite(stated)]  # where a channel is given as it came, nothing is stated
        covered = float(stated.mean()) if stated.size else float("nan")
        scatter = float(stated.std(ddof=1) / np.sqrt(stated.size)) if stated.size > 1 else float("nan")
        told = rms(np.array([f["stated"] for f in flights if np.isfinite(f["stated"])]))
        know = rms(np.array([f.get("informed", np.nan) for f in flights]))
        low += covered < 0.9
        if scatter > 0:
            by_chance += float(norm.cdf((0.9 - 0.95) / scatter) + norm.sf((0.98 - 0.95) / scatter))
        met += [size["ours"] <= 1.05 * beside, of_reading <= 1.02, 0.9 <= covered <= 0.98]
        given = min(f["given"] for f in flights)
        print(
            f"{kind:<22}{channel.split('_')[0][:8]:<10}{size['reading']:>9.4f}{tuned.get(best, np.nan):>10.4f} "
            f"{best:<12}{size['ours']:>9.4f}{size['ours'] / beside:>7.2f}{of_reading:>8.2f}"
            f"{max(f['worst'] for f in flights):>8.2f}{covered:>8.3f}{scatter:>7.3f}{told / size['ours']:>8.2f}"
            f"{size['ours'] / know:>11.2f}"
            f"{'' if given > 0.99 else f'  given for {given:.0%} of the rows'}"
        )
    print(
        f"of {len(groups)} kinds and channels: {met[0]} best or within 5 % of the best, {met[1]} without a flight more "
        f"than 2 % worse than its reading, {met[2]} covered by 90 to 98 %, {low} by less"
    )
    seeds = len({line["seed"] for line in lines})
    print(f"{seeds} flights a kind: with 95 % in truth, chance would put {by_chance:.1f} of them outside 90 to 98 %")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="+", default=list(KINDS))
    parser.add_argument("--fresh", action="store_true", help="kinds of flight_fresh.py, which nothing was tuned to")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--no-peers", action="store_true")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--table", type=Path, help="print what this file holds, and fly nothing")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    if args.fresh:
        args.kinds = list(FRESH)
    if args.table:
        table(kept(args.table))
        return 0
    jobs = [(name, seed) for name in args.kinds for seed in range(args.first_seed, args.first_seed + args.seeds)]
    table(scored(args.out, jobs, ("kind", "seed"), lambda name, seed: score(name, seed, not args.no_peers)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
