"""Logs of animals and sondes that other people published: the same water or air passed twice, as read and corrected.

    pip download --no-deps --no-binary :all: cpforager==1.3.1 scikit-diveMove==1.0.0 pydropsonde==0.4.1
    python benchmarks/real_passes.py --logs FOLDER

`FOLDER` holds the three source packages, unpacked (each .tar.gz by `tar xf`), and as `basestation3` a checkout of
github iop-apl-uw/basestation3 @1fc0ee7. They state their licences as AGPL-3.0, AGPL-3.0-or-later, MIT and one like
BSD; nothing of them is kept here. No truth is known of such logs, but a cormorant and a seal pass the same water
downwards and upwards, a sonde out of a warm cabin falls into air that goes on as it was, and a glider's optode, which
lags, is beside a CTD that hardly does. How each
sensor responds is estimated from other dives and sondes than are judged (`real_pass_sets.py`). Beside the correction:
first order, whose time constant and window are the best in hindsight, and the very response that `shockrig.correct` is
given, inverted by hand, with the window that is the best in hindsight.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from real_pass_sets import FOUND_BY, Log, RealSet, Response, cormorants, dropsondes, fur_seal, glider
from scipy.signal import savgol_filter


def by_hand(log: Log, lags_s: np.ndarray, window: int, step_s: float) -> np.ndarray:
    """One or two lags undone: derivatives of a running parabola or cubic, or from row to row."""
    time, reading = log.frame.time_s.to_numpy(), log.frame.temperature_c.to_numpy()
    if not step_s:
        keep = np.exp(-np.diff(time, prepend=time[0] - 0.5) / lags_s[0])
        return (reading - keep * np.r_[reading[0], reading[:-1]]) / (1.0 - keep)
    grid = np.arange(time[0], time[-1] + step_s / 2.0, step_s)
    y = np.interp(grid, time, reading)
    order = 1 + len(lags_s)
    samples = max(window, order + 2 - order % 2)
    factors = (1.0, sum(lags_s), np.prod(lags_s))[:order]
    undone = sum(f * savgol_filter(y, samples, order, deriv=k, delta=step_s) for k, f in enumerate(factors))
    return np.interp(time, grid, undone)


def hindsight(real: RealSet, responses: Iterable[np.ndarray]) -> tuple[list[np.ndarray], str]:
    """The errors of the best response and window, and which those are."""
    tried = [(lags, window) for lags in responses for window in real.windows]
    errors = [[log.error(by_hand(log, lags, window, real.step_s)) for log in real.logs] for lags, window in tried]
    best = int(np.argmin([real.figure(one) for one in errors]))
    lags, window = tried[best]
    how = f"a window of {window * real.step_s:.3g} s" if window else "row by row"
    return errors[best], f"{' and '.join(f'{lag:.3g} s' for lag in lags)}, {how}"


def corrected(real: RealSet) -> tuple[list[np.ndarray], float]:
    """Errors by `shockrig.correct`, and the share of them within twice their stated uncertainty."""
    import shockrig

    size_m, (*caps, slow) = 4e-4, zip(real.response.lags_s, real.response.scatter_s, strict=True)
    stated = [{"time_constant_s": {"value": lag, "standard_uncertainty": u}} for lag, u in caps]
    alpha = size_m**2 / slow[0]
    profile = {
        "format": "sensor-profile/1",
        "sensors": {"imet": {"kind": "stated", "body": "lumped"}},
        "temperature": {
            "bead_radius_m": size_m,
            "thermal_diffusivity_m2_s": {"value": alpha, "standard_uncertainty": alpha * slow[1] / slow[0]},
            "noise_k": real.noise_k,
            "effects": [{"effect": "series_lag", "parameters": p} for p in stated],
        },
    }
    errors, within = [], []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "profile.json"
        path.write_text(json.dumps(profile), encoding="utf-8")
        for log in real.logs:
            done = shockrig.correct(log.frame, path).to_frame()
            errors.append(log.error(done.temperature_corrected_c.to_numpy()))
            within.append(np.abs(errors[-1]) <= 2.0 * log.uncertainty(done.temperature_uncertainty_k.to_numpy()))
    return errors, float(np.mean(np.concatenate(within)))


def line(name: str, figures: Iterable[float | None], covered: float | None, what: str) -> str:
    cells = "".join(f"{'-' if f is None else format(f, '.3f'):>10}" for f in figures)
    return f"{name:<26}{cells}{'-' if covered is None else format(covered, '.0%'):>9}  {what}"


def rows(real: RealSet) -> list[str]:
    """A set's line in the table, and those below it that say what the cormorants' figures hang on."""
    read = [log.error(log.frame.temperature_c.to_numpy()) for log in real.logs]
    ours, covered = corrected(real)
    first, best_first = hindsight(real, [np.array([lag]) for lag in real.lags_tried_s])
    same, best_same = hindsight(real, [real.response.lags_s])
    four = (read, ours, first, same)
    found = [line(real.name, map(real.figure, four), covered, real.what)]
    if real.name.startswith("cormorants"):
        means = [float(np.mean(np.concatenate(errors))) for errors in four]
        found.append(line("  their mean", means, None, "the same differences, signed"))
        for window in (11, 21):
            errors, _ = hindsight(replace(real, windows=(window,)), [real.response.lags_s])
            name = f"  window of {window // 10} s"
            found.append(line(name, [None, None, None, real.figure(errors)], None, "not chosen in hindsight"))
        one = Response(np.array([20.0]), np.array([5.0]))
        for name, other, what in (
            ("  one lag of 20 s stated", replace(real, response=one), "the form of the response is wrong"),
            ("  noise stated 0.005 K", replace(real, noise_k=0.005), "a third of the log's step of 1/64 K"),
            ("  noise stated 0.002 K", replace(real, noise_k=0.002), "an eighth of it"),
        ):
            ours, covered = corrected(other)
            found.append(line(name, [None, real.figure(ours), None, None], covered, what))
    lags = [f"{a:.3g} ± {u:.2g} s" for a, u in zip(real.response.lags_s, real.response.scatter_s, strict=True)]
    stated = f"response {' and '.join(lags)}, noise {real.noise_k:g} K"
    return [*found, f"  {stated}; best in hindsight: first order {best_first}; by hand {best_same}"]


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--logs", type=Path, required=True, help="folder with the three packages and the checkout")
    folder = parser.parse_args(argv).logs
    for pattern in FOUND_BY:
        if next(folder.glob(pattern), None) is None:
            package = pattern.split("/")[0]
            print(f"real_passes: {folder} holds no {package} (looked for {pattern})", file=sys.stderr)
            return 2
    print("error, K; first order and by hand: the best in hindsight; covered: within twice the stated uncertainty")
    print(f"{'':<26}{'as read':>10}{'shockrig':>10}{'1st order':>10}{'by hand':>10}{'covered':>9}  what it is")
    for make in (cormorants, dropsondes, fur_seal, glider):
        print(f"real_passes: {make.__name__}", file=sys.stderr, flush=True)
        print("\n".join(rows(make(folder))), flush=True)
    print("\nThree of the four are water, one is air; no humidity is among them. No truth is known: water that moves")
    print("between two passes counts as error, the sondes' air, carried back over 7 s, is good to some 0.5 K, and the")
    print("glider's CTD to what a second sensor a hand's breadth away meets.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
