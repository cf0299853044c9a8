"""Blind trials that once went wrong, or that are dear: each has to come out as it says. Too slow for the test suite.

    python benchmarks/fixed_trials.py

records the standard campaign without the run that closes it (with one run more all noise is drawn anew), prints a line
a trial and ends with status 1 where one is not as expected. Beside whole trials there are effects whose
entry is taken away from the catalogue, in one channel. `tests/diagnose/test_diagnosis_trials.py` has the cheap ones.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from diagnosis_trials import line, trial

Result = dict[str, Any]
FLOOR = 1.3  # times the noise: what an extended model leaves on unseen runs at most
WON = 0.5  # of the plain model's error: what it leaves at most


def exact(result: Result) -> bool:
    """What is hidden is named in every channel, and nothing else."""
    return bool(result["score"].exact)


def nothing(result: Result) -> bool:
    """Every channel is adequate, and nothing is named."""
    return all(c["verdict"] == "adequate" and not c["causes"] for c in result["diagnosis"]["channels"].values())


def exact_to_the_noise(result: Result) -> bool:
    """Exact, and what is named predicts unseen runs about as well as their noise lets one."""
    gains = [channel["gain"] for channel in result["diagnosis"]["channels"].values()]
    predicts = all(
        gain["held_out_rmse_after"] < FLOOR * gain["noise_floor"] < WON * gain["held_out_rmse_before"] for gain in gains
    )
    return exact(result) and predicts


def rate_that_moves_with_the_ambient(result: Result) -> bool:
    """Described as that, with nothing named, and every channel's verdict is right."""
    found = result["diagnosis"]["channels"]["temperature"]
    behaviours = [(one["behaves_as"], [on["factor"] for on in one["depends_on"]]) for one in found["discovered"]]
    described = (found["verdict"], found["causes"], behaviours) == ("described", [], [("rate_change", ["ambient"])])
    return described and all(c.verdict_right and not c.wrong for c in result["score"].channels.values())


@dataclass(frozen=True)
class Fixed:
    """A trial of `diagnosis_trials.trial`, tier rough, and what its result has to be; `without` a sensor."""

    kind: str
    strength: str
    seed: int
    expected: Callable[[Result], bool]
    without: str | None = None


FIXED = (
    Fixed("one", "comfortable", 7000, exact),
    Fixed("one", "comfortable", 7001, exact),
    Fixed("one", "comfortable", 7002, exact),
    Fixed("none", "comfortable", 7011, nothing),
    # A lag does not stand in the place of a slow transfer: the fit without the lag ends at five times the film's Biot
    # number, and no transfer leads back from there.
    Fixed("ordinary", "comfortable", 47706, exact_to_the_noise),
    Fixed("outside", "comfortable", 7034, rate_that_moves_with_the_ambient),
    # Two or three runs in each ambient and direction say little of how much runs differ in their rate.
    Fixed("one", "limit", 47107, exact),
    # Rounded to 0.6 %RH beside 0.07 %RH of noise: a plateau's error is one code's, not white noise.
    Fixed("quantization", "comfortable", 7051, exact, without="imet"),
    # A mean over eleven readings leaves less noise than the logger's step: only the response can tell it from a ramp.
    Fixed("moving_average", "comfortable", 7063, exact, without="hyt"),
)


@dataclass(frozen=True)
class Taken:
    """A comfortable effect of the temperature sensor that is described where the catalogue has no entry for it; where
    it has one (`listed`), it is named alone.

    `found` is the number that the description is to give of the parameter, `share` how near it is to come.
    """

    effect: str
    seed: int
    behaves_as: str
    parameter: str
    found: Callable[[Any], float]
    share: float
    listed: bool = False


TAKEN = (
    # Beside the plain model, whose runs have all moved their starts, no delay scores: a clock that runs fast does.
    Taken("dead_time", 900, "delay", "delay_s", lambda one: one.size.value, 0.1),
    # Beside a constant delay its signature points the other way, and its fit has far to go.
    Taken("clock_drift", 907, "delay", "ppm", lambda one: one.size.value, 0.03),
    # The logger's mean of ten readings, 0.1 s apart, in noise that hangs together over seconds and hides it.
    Taken("moving_average", 905, "lag_in_series", "samples", lambda one: 10.0 * one.time_constant_s.value, 1e-6),
    # No ramp of the air with a lag and a delay beside it, which together do nearly as well.
    Taken("moving_average", 905, "", "samples", lambda cause: cause.parameters["samples"].value, 1e-6, listed=True),
)


def told(taken: Taken) -> tuple[bool, str]:
    """Whether it is described or named rightly, and nothing else; and what was found."""
    from shockrig.analysis.diagnose.diagnose import diagnose_channel
    from shockrig.analysis.diagnose.remainder import Tolerance
    from shockrig.analysis.effects import CATALOGUE
    from shockrig.analysis.estimate.gather import build_channel
    from shockrig.files.campaign import read_campaign
    from shockrig.rig.virtual.batch import simulate_campaign
    from shockrig.rig.virtual.hide import draw_effect
    from shockrig.rig.virtual.plans import standard_plan
    from shockrig.rig.virtual.truth import draw_truth

    rng = np.random.default_rng(taken.seed)
    truth = draw_truth(rng, "rough", [draw_effect(rng, taken.effect, "comfortable", "temperature")])
    with tempfile.TemporaryDirectory() as folder:
        campaign = read_campaign(simulate_campaign(truth, standard_plan()[:-1], rng, Path(folder) / "campaign"))
        channel = build_channel(campaign, "temperature")
    kept = dict(CATALOGUE)
    if not taken.listed:
        del CATALOGUE[taken.effect]
    found = diagnose_channel(channel, tolerance=Tolerance(0.0, 0.0))
    CATALOGUE.clear()
    CATALOGUE.update(kept)  # effects act in the catalogue's order
    names = [cause.effect for cause in found.causes], [one.behaves_as for one in found.discovered]
    said = f"{found.verdict}: {names[0]} {names[1]}"
    right = ("explained", [taken.effect], []) if taken.listed else ("described", [], [taken.behaves_as])
    if (found.verdict, *names) != right:
        return False, said
    true = truth.effects[0].parameters[taken.parameter]
    value = taken.found(found.causes[0] if taken.listed else found.discovered[0])
    return abs(value - true) <= taken.share * abs(true), f"{said} {value:.6g}"


@dataclass(frozen=True)
class Named:
    """An effect of stated strength, to be named with those `beside` it alone, each number within three uncertainties
    (and `slack`) of the true one. `half_at_hpa`: the pressure of every second run."""

    effect: str
    channel: str
    parameters: dict[str, float]
    seed: int
    alike: tuple[str, ...] = ()  # what may be said to be indistinguishable from it
    slack: float = 0.0
    half_at_hpa: float = 1013.25
    beside: tuple[str, ...] = ()
    tier: str = "rough"
    plan: str = "standard"


NAMED = (
    # Half of the runs at 700 hPa: one film, with its Biot number at 1013 hPa.
    Named("convective_film", "temperature", {"biot_at_5_m_s": 0.12}, 21, ("*",), half_at_hpa=700.0),
    # Told where rates do not scatter.
    Named(
        "convective_film", "temperature", {"biot_at_5_m_s": 0.12}, 25, beside=("exchange_temperature",), tier="smooth"
    ),
    # By airflows in warm and cold air, from a calibration.
    Named("wall_radiation", "temperature", {"rise_k_at_10_k": 0.15, "wall_temperature_c": 23.0}, 31, plan="extended"),
    Named("vapour_boundary_layer", "humidity", {"biot_at_5_m_s": 5.0}, 21, ("*",), half_at_hpa=700.0),
    Named("calibration_temperature", "humidity", {"percent_per_k": -0.05}, 33, ("*",), slack=1e-3),
    Named("series_lag", "humidity", {"time_constant_s": 3.0}, 35, slack=0.01),
    Named("clock_drift", "humidity", {"ppm": 9000.0}, 11, ("dead_time",)),
)


def named_alone(named: Named) -> tuple[bool, str]:
    """Whether it is named as it is, and nothing that is not there; and what was found."""
    from shockrig.analysis.diagnose.diagnose import diagnose_channel
    from shockrig.analysis.diagnose.remainder import Tolerance
    from shockrig.analysis.estimate.gather import build_channel
    from shockrig.files.campaign import read_campaign
    from shockrig.rig.virtual import plans
    from shockrig.rig.virtual.batch import simulate_campaign
    from shockrig.rig.virtual.truth import Hidden, draw_truth

    rng = np.random.default_rng(named.seed)
    hidden = Hidden(named.effect, named.parameters, (named.channel,))
    truth = draw_truth(rng, named.tier, [hidden, *(Hidden(effect) for effect in named.beside)])
    plan = [
        replace(run, pressure_hpa=named.half_at_hpa) if number % 2 else run
        for number, run in enumerate(getattr(plans, f"{named.plan}_plan")()[:-1])
    ]
    with tempfile.TemporaryDirectory() as folder:
        channel = build_channel(read_campaign(simulate_campaign(truth, plan, rng, Path(folder) / "c")), named.channel)
    found = diagnose_channel(channel, tolerance=Tolerance(0.0, 0.0))
    said = f"{found.verdict}: {[(one.effect, one.parameters) for one in found.causes]}"
    causes = {one.effect: one for one in found.causes}
    if causes.keys() != {named.effect, *named.beside} or found.verdict != "explained":
        return False, said
    cause = causes[named.effect]
    near = all(
        abs(cause.parameters[name].value - true) < 3.0 * cause.parameters[name].standard_uncertainty + named.slack
        for name, true in named.parameters.items()
    )
    return near and ("*" in named.alike or set(cause.indistinguishable_from) <= set(named.alike)), said


def main() -> int:
    from shockrig.rig.virtual import plans

    wrong = 0
    for named in NAMED:
        right, said = named_alone(named)
        wrong += not right
        print(f"{'right' if right else 'WRONG'} {named.effect}, {named.channel}, seed {named.seed}: {said}", flush=True)
    for taken in TAKEN:
        right, said = told(taken)
        wrong += not right
        away = "" if taken.listed else " taken away"
        print(f"{'right' if right else 'WRONG'} {taken.effect}{away}, seed {taken.seed}: {said}", flush=True)
    whole = plans.standard_plan
    plans.standard_plan = lambda: whole()[:-1]
    for fixed in FIXED:
        result = trial(fixed.kind, "rough", fixed.strength, fixed.seed, without=fixed.without)
        right = fixed.expected(result)
        wrong += not right
        print(f"{'right' if right else 'WRONG'} {fixed.kind} {fixed.strength} {line(fixed.seed, result)}", flush=True)
    count = len(FIXED) + len(TAKEN) + len(NAMED)
    print(f"{count - wrong} of {count} as expected")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
