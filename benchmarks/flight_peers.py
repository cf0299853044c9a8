"""This project's three corrections beside what people use today, on the same flights.

Peers: first-order lag with a running mean (Miloshevich et al. 2004), PyDynamic's regularised deconvolution FIR (if
installed), Tikhonov with an L-curve (Hansen 1992).

    python benchmarks/flight_peers.py [--flights N] [--first-seed N]

prints rms errors in each scene. Every peer is given its best: the exact response, vapour pressure for humidity, and,
where it has a knob, the setting that suits that scene and channel best, chosen with the truth; ours are not so tuned.
"""

from __future__ import annotations

import argparse
import sys
import warnings

import numpy as np

from shockrig.analysis.flight.correct import METHODS
from shockrig.analysis.flight.inverse import low_pass, mean_response, response_time_s, suggest_cutoff_hz
from shockrig.analysis.flight.response import LagResponse, bead_response, film_response
from shockrig.analysis.flight.simulated.scenes import try_scene
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import SCENES
from shockrig.analysis.physics.air_exchange import Stream
from shockrig.analysis.physics.humidity import humidity_from_ppmv, ppmv_from_humidity

PERIOD_S = 0.1
WIDTHS = (1, 3, 5, 9, 15, 25, 41, 71, 121)  # samples of the running mean
CUTOFFS_HZ = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.2, 2.0, 3.0)
ORDERS = (60, 300)  # taps of the deconvolution filter
STRENGTHS = np.geomspace(1e-4, 1e6, 21)


def running_mean(values: np.ndarray, width: int) -> np.ndarray:
    """Centred running mean, ends reflected."""
    padded = np.pad(values, width // 2, mode="reflect", reflect_type="odd")
    return np.convolve(padded, np.full(width, 1 / width), mode="valid")


def first_order(reading: np.ndarray, response: LagResponse, width: int) -> np.ndarray:
    """x = (y_k - y_{k-1} e^(-dt/tau)) / (1 - e^(-dt/tau)), tau = t63, at the step's middle; then a mean."""
    decay = np.exp(-PERIOD_S / response_time_s(response))
    air = np.empty_like(reading)
    air[:-1] = (reading[1:] - reading[:-1] * decay) / (1 - decay)
    air[-1] = air[-2]
    time = np.arange(reading.size)
    return running_mean(np.interp(time, time + 0.5, air), width)


def impulse(response: LagResponse, count: int) -> np.ndarray:
    """Reading after each sample of a unit triangle of air, straight between samples (shape (count,))."""
    from shockrig.analysis.flight.response import hold

    old, new, decay = hold(response.rate[0], np.array(PERIOD_S))
    state, out = np.zeros(decay.size), np.zeros(count)
    for k in range(count):
        state = decay * state + (new if k == 0 else old if k == 1 else 0.0)
        out[k] = response.weight[0] @ state
    return out


class Tikhonov:
    """min |H x - y|^2 + s |second differences of x|^2, solved banded; s by the L-curve's corner or given."""

    def __init__(self, reading: np.ndarray, response: LagResponse) -> None:
        from scipy.sparse import csc_matrix, diags_array, eye_array

        n = reading.size
        self.n, self.start = n, reading[0]
        self.y = reading - self.start
        # each lag as an unknown of its own keeps the matrix sparse: q_k - decay q_{k-1} - new x_k - old x_{k-1} = 0
        from shockrig.analysis.flight.response import hold

        old, new, decay = hold(response.rate[0], np.array(PERIOD_S))
        length = min(n, int(6 / (response.rate[0].min() * PERIOD_S)))
        h = impulse(response, length)
        self.h = diags_array(
            [np.full(n - k, h[k]) for k in range(length)], offsets=-np.arange(length), shape=(n, n)
        ).tocsc()
        d = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(n - 2, n))
        self.roughness, self.normal = csc_matrix(d.T @ d), csc_matrix(self.h.T @ self.h)
        self.right = self.h.T @ self.y
        self.d = d
        self.eye = eye_array(n, format="csc")

    def solve(self, strength: float) -> np.ndarray:
        from scipy.sparse.linalg import splu

        return splu((self.normal + strength * self.roughness + 1e-12 * self.eye).tocsc()).solve(self.right) + self.start

    def corner(self, strengths: np.ndarray) -> float:
        """Strength of the sharpest bend of log |residual| against log |roughness| (Hansen 1992)."""
        points = []
        for s in strengths:
            x = self.solve(s) - self.start
            points.append((np.log(np.linalg.norm(self.h @ x - self.y)), np.log(np.linalg.norm(self.d @ x))))
        a, b = np.array(points).T
        t = np.log(strengths)
        da, db = np.gradient(a, t), np.gradient(b, t)
        bend = (da * np.gradient(db, t) - np.gradient(da, t) * db) / (da**2 + db**2) ** 1.5
        return float(strengths[2:-2][np.argmax(np.abs(bend[2:-2]))])


def pydynamic(reading: np.ndarray, response: LagResponse, cutoff_hz: float, order: int = 60) -> np.ndarray:
    """PyDynamic's least-squares inverse FIR of the sensor's frequency response, behind a zero-phase low-pass."""
    from PyDynamic.model_estimation.fit_filter import LSFIR
    from scipy.signal import lfilter

    delay = order // 2
    frequency = np.linspace(0.0, min(3 * cutoff_hz, 0.45 / PERIOD_S), 3 * order)
    gain = response.clean(frequency)
    parts = np.concatenate([gain.real, gain.imag])
    taps, _ = LSFIR(parts, order, frequency, 1 / PERIOD_S, delay, verbose=False, inv=True)
    taps = taps / taps.sum()  # a flight's mean must stay where it is
    padded = np.pad(low_pass(reading, PERIOD_S, cutoff_hz), order, mode="reflect", reflect_type="odd")
    return lfilter(taps, 1.0, padded)[order + delay :][: reading.size]


def peers(reading: np.ndarray, response: LagResponse, noise: float) -> dict[str, list[np.ndarray]]:
    """Each peer's corrections, one for each setting of its knob."""
    found = {"first order, running mean": [first_order(reading, response, w) for w in WIDTHS]}
    problem = Tikhonov(reading, response)
    found["Tikhonov, L-curve"] = [problem.solve(problem.corner(STRENGTHS))]
    found["Tikhonov, best strength"] = [problem.solve(s) for s in STRENGTHS]
    try:
        import PyDynamic  # noqa: F401
    except ImportError:
        print("PyDynamic is not installed, its rows are left out: pip install PyDynamic", file=sys.stderr)
        return found
    cutoff = suggest_cutoff_hz(reading, PERIOD_S, noise)
    found["PyDynamic, suggested cut-off"] = [pydynamic(reading, response, cutoff, order) for order in ORDERS]
    found["PyDynamic, best cut-off"] = [pydynamic(reading, response, c, order) for c in CUTOFFS_HZ for order in ORDERS]
    return found


def rms(error: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(error**2)))


def score_flight(scene: str, seed: int, table: dict) -> None:
    """Add one flight's errors to table[scene, channel][method] (one list of settings for each flight)."""
    profile = typical_profile()
    trial = try_scene(scene, profile, [seed])[0]
    truth, log = trial.flown.truth, trial.flown.log
    air_c = trial.corrected["smoother"].temperature_c
    speed = log["airspeed_m_s"].to_numpy()
    for channel, column in (("temperature", "temperature_c"), ("humidity", "humidity_percent")):
        right, raw = truth[column].to_numpy(), log[column].to_numpy()
        row = table.setdefault((scene, channel), {})
        row.setdefault("reading", []).append([rms(raw - right)])
        if channel == "temperature":
            response, reading, noise = bead_response(profile.temperature, Stream(speed)), raw, 0.02
            back = np.asarray
        else:
            response = film_response(profile.humidity, air_c, Stream(speed))
            reading, noise = ppmv_from_humidity(raw, air_c) / ppmv_from_humidity(1.0, 20.0), 0.06

            def back(vapour: np.ndarray) -> np.ndarray:
                return humidity_from_ppmv(vapour * ppmv_from_humidity(1.0, 20.0), air_c)

        for name, settings in peers(reading, mean_response(response), noise).items():
            row.setdefault(name, []).append([rms(back(air) - right) for air in settings])
        for method in METHODS:
            if method in trial.corrected:
                value = getattr(trial.corrected[method], column)
                row.setdefault(f"shockrig {method}", []).append([rms(value - right)])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=9000)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    table: dict = {}
    for scene in SCENES:
        for seed in range(args.first_seed, args.first_seed + args.flights):
            print(f"{scene} {seed}", file=sys.stderr)
            score_flight(scene, seed, table)
    print(f"rms error against the truth, {args.flights} flights a scene, seeds from {args.first_seed}; K and %RH")
    keys = list(table)
    methods = list(dict.fromkeys(name for key in keys for name in table[key]))
    print(f"{'':<32}" + "".join(f"{scene[:10] + ' ' + channel[:4]:>17}" for scene, channel in keys))
    for method in methods:
        # one setting for all flights of a scene and channel: the best one, for those that have a knob
        cells = [float(np.mean(table[key][method], axis=0).min()) if method in table[key] else np.nan for key in keys]
        print(f"{method:<32}" + "".join(f"{value:>17.4f}" for value in cells))
    return 0


if __name__ == "__main__":
    sys.exit(main())
