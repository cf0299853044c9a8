"""Sentences on effects that nobody listed: 'behaves as', never 'is'."""

from __future__ import annotations

from collections.abc import Sequence

from shockrig.analysis.effects.behaviours import STEP, is_step
from shockrig.analysis.effects.described import entry_of, of_readings, rounded
from shockrig.analysis.report.numbers import measured, plain
from shockrig.files.causes import Uncertain
from shockrig.files.diagnosis_data import Dependence, Discovered

DRIVERS = {
    "air_temperature": "the air's temperature",
    "air_humidity": "the air's humidity",
    "own_response": "the reading itself",
    "die_temperature": "the die's temperature",
    "other_sensor": "the other sensor",
    "airflow": "the airflow",
    "none": "the transfer",
}
BEHAVIOURS = {
    "lag_in_series": "a lag before the sensing body",
    "parallel_lag": "a share of the response that follows slowly",
    "added_response": "something that leaks in with {driver}",
    "added_rate": "something that goes with the rate of change of {driver}",
    "gain": "a gain on the reading",
    "offset": "an offset of the reading",
    "rate_change": "a diffusivity that moves",
    "delay": "a delay",
    "periodic": "a swing",
    "bursts": "bursts",
}
EACH = {"ambient": "per K", "run_order": "per run", "humidity": "from dry to saturated"}
FACTORS = {"run_order": "the order of the runs", "time_of_campaign": "time", "history": "how long the run has lasted"}


def behaves(one: Discovered) -> str:
    """How an effect behaves, in a few words."""
    if one.behaves_as == "lag_in_series" and one.driver == "airflow":
        return "a resistance between the air and the sensing body"
    if one.behaves_as == "gain" and one.driver == "die_temperature":
        return "a gain that goes with the die's temperature"
    text = BEHAVIOURS[one.behaves_as].format(driver=DRIVERS[one.driver])
    if one.behaves_as == "added_rate" and one.driver == "none":
        return "a pulse that the transfer itself brings, and that dies away"
    if one.behaves_as == "lag_in_series" and any(on.factor == "history" for on in one.depends_on):
        if one.driver == "own_response":
            return "a mean of the last readings over a time"
        return "air that comes in evenly over a time"
    if rounded(one):
        return "a rounding of the readings"
    if one.behaves_as == "periodic" and of_readings(one):
        return "a hum that goes on all along"
    return text


def sentence(one: Discovered, unit: str) -> str:
    """What was described, with its numbers, what it depends on and what not, and what else could be said."""
    text = f"It behaves as {behaves(one)}{_numbers(one, unit)}"
    if one.depends_on:
        text += "; it depends on " + _listed([_depends(on) for on in one.depends_on])
    if one.does_not_depend_on:
        text += "; it does not depend on " + _listed([_factor(f) for f in one.does_not_depend_on], "or")
    text += "."
    if one.alternatives:
        others = [_short(other) for other in one.alternatives]
        text += f" These runs fit as well: {_listed(others, 'or')}."
    if one.nearest_catalogued is not None:
        near = one.nearest_catalogued
        text += (
            f" Of the catalogue, {near.effect.replace('_', ' ')} is most alike ({100 * near.likeness:.0f} %), and is "
            f"not it: {near.why_not}."
        )
    return text


def flies(one: Discovered, channel: str) -> str:
    """What a correction does with it."""
    effect = entry_of(one, channel)
    if of_readings(one):
        return "of single readings: no part in a flight"
    if effect is None or effect.in_flight is None:
        return "taken for the bench's: no part in a flight"
    if effect.in_flight.left:
        return "left in the reading of a flight, and said to be"
    return "undone in a flight, within the conditions seen"


def seen(one: Discovered) -> str:
    """Over which conditions it was seen."""
    words = {"airflow_m_s": "m/s", "ambient_temperature_c": "°C", "pressure_hpa": "hPa"}
    ends = one.seen_over.items()
    return ", ".join(f"{plain(low, 3)} to {plain(high, 3)} {words.get(name, name)}" for name, (low, high) in ends)


def _short(one: Discovered) -> str:
    factors = [_factor(on.factor) for on in one.depends_on]
    return behaves(one) + (f" that depends on {_listed(factors)}" if factors else "")


def _numbers(one: Discovered, unit: str) -> str:
    said = []
    if one.size is not None:
        of = {"1": "", "1e-6": " parts per million"}.get(one.size.unit, f" {one.size.unit}")
        said.append(f"size {_value(Uncertain(one.size.value, one.size.standard_uncertainty))}{of}")
    if one.time_constant_s is not None:
        said.append(f"time constant {_value(one.time_constant_s)} s")
    if one.period_s is not None:
        said.append(f"period {_value(one.period_s)} s")
    return f" ({', '.join(said)})" if said else ""


def _value(value: Uncertain) -> str:
    return measured(value.value, value.standard_uncertainty)


def _factor(name: str) -> str:
    return FACTORS.get(name, f"the {name}")


def _depends(on: Dependence) -> str:
    factor = _factor(on.factor)
    if on.form == "dew_margin":
        return "how far the dew point lies above the air that a run comes from"
    if on.value is None:
        return f"{factor} ({on.form.replace('_', ' ')})" if on.form not in ("sign", "linear") else factor
    value = measured(on.value, on.standard_uncertainty or 0.0)
    if is_step(on.form):
        return f"{factor} ({value} times as much from the {nth_run(on.form)} run on)"
    how = {
        "power": f"as its power {value}",
        "exponential": f"a factor exp({value} {EACH[on.factor]})",
        "ratio": f"{value} times as much downwards",
        "zero_at": f"none at {value}",
        "linear": f"slope {value}",
        "sets_in_over": f"setting in over {value}",
    }.get(on.form, f"{on.form.replace('_', ' ')} {value}")
    return f"{factor} ({how})"


def nth_run(step: str) -> str:
    """At which run a step in their order begins, as an ordinal number."""
    number = int(step.removeprefix(STEP)) + 1
    ending = "th" if 10 <= number % 100 <= 20 else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"


def _listed(words: Sequence[str], last: str = "and") -> str:
    return " ".join([", ".join(words[:-1]), last, words[-1]]) if len(words) > 1 else "".join(words)
