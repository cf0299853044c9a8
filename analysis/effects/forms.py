"""Forms: effects that nobody listed, made from data and not from code; and which are the law of a catalogued one.

A form is a behaviour, a driver, and what its strength (or its time constant, or the body's rate) depends on; the words
are those of `discovered` in shock-diagnosis/1. What each behaviour does is in `behaviours.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shockrig.analysis.estimate.effect import DIFFERS_BY, TINY_STRENGTH, Arrays
from shockrig.analysis.physics.air_exchange import REFERENCE_AIRFLOW_M_S, Conditions, dew_margin_k
from shockrig.analysis.physics.chain import Chain, Recorded
from shockrig.analysis.physics.distinct import for_different

Array = NDArray[np.float64]
Factor = tuple[str, str]  # what a strength depends on, and how

USUAL_C = 20.0
USUAL_PERCENT = 50.0
USUAL_HPA = 1013.25
USUAL_STEP = {True: 40.0, False: 20.0}  # of a channel that jumps with the air (%RH), and of one that does not (K)
USUAL_MARGIN_K = 10.0  # of dew
MIDDLE_RUN = 17  # of a usual campaign, counted from 0
LEAST_STEP = 0.1  # share of a usual step
SCALES = frozenset({"power", "exponential", "ratio", "trend"})  # ways in which a condition scales a strength
SPREAD: Factor = ("history", "spread")  # not one time constant, but several, evenly spread in their logarithm
SPREAD_OVER = np.linspace(-1.0, 1.0, 7)  # times the factor's number: logarithms of the time constants over their middle
SCATTER: Factor = (DIFFERS_BY, "scatter")  # stronger in one run than in another, by chance
STEP = "from_run_"  # a dependence on run order: from that run on, counted from 0, another value
ONLY_FROM, ONLY_BEFORE = f"only_{STEP}", "only_before_run_"  # likewise: what is there in a group of runs alone


@dataclass(frozen=True)
class Form:
    """A behaviour with its driver and what it depends on: (factor, how) pairs, at most two."""

    behaves_as: str
    driver: str
    depends_on: tuple[Factor, ...] = ()

    @property
    def key(self) -> str:
        """The form as one word, from which `form_of` makes it again."""
        return "|".join([self.behaves_as, self.driver, *(f"{factor}:{how}" for factor, how in self.depends_on)])

    @property
    def factors(self) -> tuple[str, ...]:
        """What it depends on."""
        return tuple(factor for factor, _ in self.depends_on)

    @property
    def more(self) -> tuple[Factor, ...]:
        """What it depends on beyond its behaviour: conditions that scale its strength, chance, several time
        constants."""
        return tuple(on for on in self.depends_on if on[1] in SCALES or on in (SPREAD, SCATTER))

    def with_factor(self, factor: str, how: str) -> Form:
        """The same, depending on one factor more; the order in which factors come does not make another form."""
        return replace(self, depends_on=tuple(sorted((*self.depends_on, (factor, how)))))


# A mean of the last readings, as the noise shows it: a whole number of them, which no fit moves.
MEAN = Form("lag_in_series", "own_response", (("history", "linear"),))


def form_of(key: str) -> Form:
    """The form that a key stands for.

    Raises
    ------
    ValueError
        The key is that of no form.
    """
    parts = key.split("|")
    if len(parts) < 2:
        raise ValueError(f"{key!r} is no form of behaviour")
    pairs = [tuple(part.split(":")) for part in parts[2:]]
    if any(len(pair) != 2 for pair in pairs):
        raise ValueError(f"{key!r} is no form of behaviour")
    return Form(parts[0], parts[1], tuple((factor, how) for factor, how in pairs))


# Which forms are the law of a catalogued effect: the same closed form by another door.

# (behaviour, driver, what it depends on) -> effects with that law, each with its parameters by the form's. Either
# quantity of the air is "air" as a driver. A parameter that the form has not is at its value for nothing.
Law = tuple[str, Mapping[str, str]]
LAWS: dict[tuple[str, str, tuple[Factor, ...]], tuple[Law, ...]] = {
    ("delay", "none", ()): (("dead_time", {"delay_s": "size"}),),
    ("delay", "none", (("history", "linear"),)): (("clock_drift", {"ppm": "size"}),),
    ("lag_in_series", "air", ()): (("series_lag", {"time_constant_s": "time_constant_s"}),),
    ("lag_in_series", "air", (("history", "linear"),)): (("finite_transfer", {"duration_s": "time_constant_s"}),),
    ("parallel_lag", "air", ()): tuple(
        (effect, {"fraction": "size", "time_constant_s": "time_constant_s"})
        for effect in ("parallel_lag", "stem_conduction", "slow_relaxation")
    ),
    ("gain", "own_response", ()): (("calibration_error", {"gain": "size"}),),
    ("offset", "none", ()): (("calibration_error", {"offset": "size"}),),
    ("rate_change", "own_response", (("humidity", "linear"),)): (
        ("concentration_dependent_diffusivity", {"slope_per_unit_activity": "humidity"}),
    ),
    ("added_response", "die_temperature", ()): (("calibration_temperature", {"percent_per_k": "size"}),),
}


def laws_of(form: Form) -> tuple[Law, ...]:
    """The effects whose law a form is, whether the catalogue at hand holds them or not."""
    driver = "air" if form.driver in ("air_temperature", "air_humidity") else form.driver
    return LAWS.get((form.behaves_as, driver, form.depends_on), ())


def forms_of(effect: str, driver: str) -> tuple[tuple[Form, Mapping[str, str]], ...]:
    """The forms that are a catalogued effect's law, of an air of this kind, and the effect's parameters by the form's;
    of several effects with one law, each has it."""
    found = []
    for (behaviour, of, on), laws in LAWS.items():
        names = next((names for name, names in laws if name == effect), None)
        if names is not None:
            found.append((Form(behaviour, driver if of == "air" else of, on), names))
    return tuple(found)


def is_step(how: str) -> bool:
    """Whether a dependence on run order is a change at one run."""
    return how.startswith(STEP)


def is_group(how: str) -> bool:
    """Whether a dependence on run order is being there in a group of runs alone."""
    return how.startswith((ONLY_FROM, ONLY_BEFORE))


def _in_group(how: str, order: Array) -> NDArray[np.bool_]:
    """Which runs (R,) belong to the group in which something is there alone."""
    late = np.asarray(order >= int(how.rpartition("_")[2]))
    return late if how.startswith(ONLY_FROM) else ~late


def differs_in(form: Form) -> str:
    """The parameter that a condition scales: a strength, or a time constant; empty for the body's own rate."""
    if form.behaves_as == "lag_in_series" and form.driver != "airflow":
        return "time_constant_s"
    return "" if form.behaves_as == "rate_change" and ("history", "linear") not in form.depends_on else "size"


def scaling(factor: str, how: str, conditions: Conditions, jumps: bool, value: Array) -> Array:
    """By what a strength is multiplied in each run (B, R) for values (B, 1) of a factor's number."""
    c = conditions
    if how == "power":
        of = {
            "airflow": np.maximum(c.airflow_m_s, 0.05) / REFERENCE_AIRFLOW_M_S,
            "step": np.maximum(np.abs(_own_step(c, jumps)) / USUAL_STEP[jumps], LEAST_STEP),
            "pressure": c.pressure_hpa / USUAL_HPA,
        }[factor]
        return np.asarray(of**value)
    if how == "exponential":
        # Of the air that the sensor is in: what it came from it still holds, and that is a matter of its own.
        exponent = {"ambient": c.destination_c - USUAL_C, "humidity": c.destination_percent / 100.0 - 0.5}[factor]
        return np.asarray(np.exp(value * exponent))
    if is_step(how):
        return np.asarray(np.where(c.order >= int(how.removeprefix(STEP)), value, 1.0))
    if how == "ratio":  # falling to rising
        return np.asarray(np.where(_own_step(c, jumps) < 0, value, 1.0))
    raise ValueError(f"a strength that depends on {factor} as {how!r} is no form of behaviour")


def run_of_strength(form: Form) -> int:
    """The run, counted from 0, that the strength of a form is stated for where it moves from run to run: of a rate, and
    so of alpha or D, the first, and else one in the middle, as what grows from nothing has no share to grow by."""
    return 0 if form.behaves_as == "rate_change" else MIDDLE_RUN


def _own_step(conditions: Conditions, jumps: bool) -> Array:
    """Signed change of the air's own quantity in each run (R,)."""
    c = conditions
    return c.destination_percent - c.source_percent if jumps else c.thermal_step_k


def scale_of(form: Form, chain: Chain, p: Arrays) -> Array:
    """Product of all factors that scale (B, R), and by what share of the usual strength each run differs by chance.

    That share is added and not multiplied: what conditions do is then no surer or weaker in a run for its own chance.
    """
    out, by_chance = np.ones((1, chain.channel.conditions.airflow_m_s.size)), np.zeros((1, 1))
    for factor, how in form.depends_on:
        if how == "trend":
            out = out * (1.0 + p[factor] * (chain.channel.conditions.order - run_of_strength(form)))
        elif how in SCALES or is_step(how):
            out = out * scaling(factor, how, chain.channel.conditions, chain.channel.jumps_with_air, p[factor])
        elif is_group(how):
            out = out * _in_group(how, chain.channel.conditions.order)
        elif (factor, how) == SCATTER:
            usual = p[differs_in(form)] if differs_in(form) else np.ones((1, 1))
            by_chance = chain.by_chance / np.where(np.abs(usual) > TINY_STRENGTH, usual, TINY_STRENGTH)
        elif how == "dew_margin":
            out = out * dew_margin_k(chain.channel.conditions) / USUAL_MARGIN_K
    return np.asarray(out + by_chance)


def driver_step(form: Form, channel: Recorded) -> tuple[Array, Array]:
    """What a driver is before and after the transfer (R,), from its usual value."""
    c = channel.conditions
    if form.driver == "air_temperature":
        return c.source_c - USUAL_C, c.destination_c - USUAL_C
    if form.driver == "air_humidity":
        return c.source_percent - USUAL_PERCENT, c.destination_percent - USUAL_PERCENT
    return np.zeros(c.source_c.shape), np.ones(c.source_c.shape)


def times_s(form: Form, p: Mapping[str, ArrayLike]) -> Array:
    """Time constants of a form (..., J) [s], of equal shares, for parameters (...)."""
    spread = np.multiply.outer(p[SPREAD[0]], SPREAD_OVER) if SPREAD in form.depends_on else np.zeros(1)
    return np.asarray(np.asarray(p["time_constant_s"])[..., None] * np.exp(spread))


def relaxed(time: Array, each_s: Array) -> Array:
    """Mean over time constants (B, R, J) [s] of exp(-t / time constant) after the transfer, 0 before it."""
    return for_different(_relaxed, time, each_s)


def _relaxed(time: Array, each_s: Array) -> Array:
    since = np.maximum(time, 0.0)
    each = [np.exp(-since / each_s[..., j, None]) for j in range(each_s.shape[-1])]
    return np.where(time > 0, sum(each) / len(each), 0.0)


def grown(form: Form, conditions: Conditions) -> Array:
    """By what a size is multiplied in each run (R,): it may grow from run to run, or with the hours of a campaign."""
    if ("time_of_campaign", "linear") in form.depends_on:
        return np.nan_to_num(conditions.hours)
    return conditions.order if ("run_order", "linear") in form.depends_on else np.ones(conditions.order.shape)
