"""The grammar of behaviours: every form that a channel's runs could show."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.design.recorded_so_far import OTHER_PRESSURE, VARIED_RATIO
from shockrig.analysis.design.targets import FEWEST_RUNS
from shockrig.analysis.effects.forms import SCALES, SCATTER, SPREAD, STEP, Factor, Form, form_of
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import Effect
from shockrig.analysis.physics.air_exchange import DEW_FALLS_K, Conditions, dew_margin_k

Array = NDArray[np.float64]

LEAST_RUNS = 8  # fewer say nothing of conditions that were held out
MOST_RUNS = 250  # more take too much memory at once
AMBIENTS_K, LEVELS_PERCENT = 3.0, 10.0  # from which on a factor has varied
ALL_BUT_ORDER = 0.98  # correlation of runs' times with their order from which on one stands for both
PERIODS_TRIED = 28  # that are tried, from a second to the length of a run

SCALING: tuple[Factor, ...] = (
    ("airflow", "power"),
    ("ambient", "exponential"),
    ("direction", "ratio"),
    ("step", "power"),
    ("humidity", "exponential"),
    ("pressure", "power"),
    ("run_order", "trend"),
)


# Forms by what a channel must have for them: conditions that its runs vary; starts, airs and the sensor's own
# temperature that are known; a film or a bead. "own" is the sensor's quantity of the air, "other" the other one. Those
# of the first table may depend on further conditions and spread their time constants, those of the second stand as they
# are.
BASES = {
    "": "lag_in_series|own parallel_lag|own rate_change|none rate_change|none|history:linear added_rate|own_response",
    "airflow": "lag_in_series|airflow",
    "film humidity": "rate_change|own_response|humidity:linear",
    "start": "delay|none delay|none|history:linear lag_in_series|own|history:linear",
    "start film": "delay|own",
    "start run_order": "delay|none|run_order:linear",
    "start time_of_campaign": "delay|none|time_of_campaign:linear",
    "airs": "gain|own_response offset|none periodic|none periodic|own added_rate|own added_rate|other added_rate|none "
    "added_response|own added_response|other added_response|own_response "
    # creeping on, ever slower or all the time alike
    "added_response|own|history:logarithmic added_response|own|history:linear "
    "added_response|own_response|history:logarithmic added_response|own_response|history:linear "
    "added_response|none|history:logarithmic added_response|none|history:linear",
    "airs die": "gain|die_temperature added_response|die_temperature",
}
ALONE = {
    "airs run_order": "gain|own_response|run_order:linear offset|none|run_order:linear",
    "airs time_of_campaign": "gain|own_response|time_of_campaign:linear offset|none|time_of_campaign:linear",
    "airs ambient": "gain|own_response|ambient:linear",
    "airs ambient bead": "added_response|own|ambient:zero_at gain|own_response|ambient:zero_at",
    "airs ambient airflow bead": "gain|own_response|airflow:power|ambient:zero_at",
    "airs ambient film": "added_response|own|ambient:zero_at|humidity:zero_at",
    "airs direction": "offset|none|direction:sign|step:sets_in_over",
    "airs film": "gain|own_response|humidity:above",
    "airs humidity film": "gain|own_response|humidity:linear",
    "airs dew": "added_rate|none|humidity:dew_margin",  # what dew brings, and takes away as it dries
}


def varied(channel: Channel) -> set[str]:
    """Factors that the channel's runs vary, and that are known of all of them."""
    c = channel.conditions
    step = channel.quantity.air_step(c)
    real = np.abs(step) >= channel.quantity.least_step
    sizes = np.abs(step[real]) if real.any() else np.ones(1)
    level = 0.5 * (c.source_percent + c.destination_percent)
    tests = {
        "airflow": c.airflow_known.all() and c.airflow_m_s.max() > VARIED_RATIO * max(c.airflow_m_s.min(), 1e-9),
        "ambient": np.ptp(c.destination_c) > AMBIENTS_K,
        "direction": (step[real] > 0).any() and (step[real] < 0).any(),
        "step": sizes.max() > VARIED_RATIO * sizes.min(),
        "humidity": np.ptp(level) > LEVELS_PERCENT,
        "pressure": np.ptp(c.pressure_hpa) > OTHER_PRESSURE * c.pressure_hpa.mean(),
        "dew": FEWEST_RUNS <= (dew_margin_k(c) > DEW_FALLS_K).sum() < channel.runs,
        "run_order": channel.runs >= LEAST_RUNS,
        "time_of_campaign": channel.runs >= LEAST_RUNS and _uneven(c),
    }
    return {name for name, holds in tests.items() if holds}


def _uneven(conditions: Conditions) -> bool:
    """Whether runs began at known times that are not their order over again."""
    hours, order = conditions.hours, conditions.order
    if not np.isfinite(hours).all() or np.ptp(hours) == 0:
        return False
    return bool(np.corrcoef(hours, order)[0, 1] < ALL_BUT_ORDER)


def scaling_factors(form: Form, channel: Channel) -> list[Factor]:
    """Factors that a form's strength (or time constant, or the rate) may depend on in a channel, besides its own."""
    there = varied(channel)
    if form.behaves_as == "rate_change" and not channel.quantity.pooled:
        there -= {"ambient"}  # each ambient has its own rate
    hows = set(dict(form.depends_on).values())
    if form.behaves_as == "added_response" and "zero_at" in hows:  # how much of a room's air, whatever that air is
        there -= {"ambient", "humidity", "step"}
    elif form.behaves_as == "periodic" or {"zero_at", "above"} & hows:
        return []
    if form.behaves_as == "gain" and {("ambient", "linear"), ("humidity", "linear")} & set(form.depends_on):
        return []
    if form.behaves_as in ("lag_in_series", "delay") and "linear" in hows:
        return []
    if {"run_order", "time_of_campaign"} & set(form.factors) or form.driver == "die_temperature":
        there -= {"run_order"}
    if form.behaves_as in ("added_response", "added_rate", "gain", "periodic") and form.driver != "none":
        there -= {"step"}  # it is in the driver
    if form.behaves_as == "lag_in_series" and form.driver == "airflow":
        there &= {"airflow", "ambient", "pressure", "direction"}
    return [pair for pair in SCALING if pair[0] in there - set(form.factors)]


def forms(channel: Channel) -> Iterator[Form]:
    """All forms that the channel's runs could show; none where a record is driven all along, or runs are too many."""
    if channel.measured.any() or not LEAST_RUNS <= channel.runs <= MOST_RUNS:
        return
    there = _facts(channel)
    for base in _listed(BASES, channel, there):
        if base.behaves_as != "rate_change" or base.depends_on:
            yield base
        if _may_spread(base):
            yield base.with_factor(*SPREAD)
        yield from _scaled(base, channel)
    if {"airs", "run_order"} <= there:
        yield from (Form("rate_change", "none", (("run_order", f"{STEP}{first}"),)) for first in splits(channel))
    for form in _listed(ALONE, channel, there):
        yield form
        if form.behaves_as == "added_response":
            yield from _scaled(form, channel)


def _facts(channel: Channel) -> set[str]:
    """What the forms of the tables may need, as far as a channel has it."""
    c = channel.conditions
    facts = {
        "start": c.start_known.any(),
        "airs": c.airs_known.all(),
        "film": channel.jumps_with_air,
        "bead": not channel.jumps_with_air,
        "die": np.isfinite(channel.die_c).any(),
    }
    return varied(channel) | {name for name, holds in facts.items() if holds}


def _listed(table: Mapping[str, str], channel: Channel, there: set[str]) -> Iterator[Form]:
    """The forms of a table whose needs a channel has."""
    airs = ("air_humidity", "air_temperature") if channel.jumps_with_air else ("air_temperature", "air_humidity")
    drivers = dict(zip(("own", "other"), airs, strict=True))
    for needs, keys in table.items():
        for form in map(form_of, keys.split() if set(needs.split()) <= there else ()):
            yield replace(form, driver=drivers.get(form.driver, form.driver))


def _scaled(form: Form, channel: Channel) -> Iterator[Form]:
    """A form with each condition that may scale its strength."""
    yield from (form.with_factor(*factor) for factor in scaling_factors(form, channel))


def splits(channel: Channel) -> range:
    """Runs, in their order from 0, at which a group of runs may begin that leaves some on either side."""
    return range(FEWEST_RUNS, channel.runs - FEWEST_RUNS + 1)


def kin(form: Form, channel: Channel) -> Iterator[Form]:
    """Forms that differ from one by a condition that scales its strength, or by how its time constants are spread."""
    for one in form.depends_on:
        if one[1] in SCALES or one == SPREAD:
            yield replace(form, depends_on=tuple(other for other in form.depends_on if other != one))
    yield from _scaled(form, channel)
    if _may_spread(form):
        yield form.with_factor(*SPREAD)
    yield from by_chance(form, channel)


def by_chance(form: Form, channel: Channel) -> Iterator[Form]:
    """A form that differs from run to run by chance, as it is and with that in place of the conditions that scale it;
    none where its strength cannot."""
    if channel.runs < LEAST_RUNS or not scaling_factors(replace(form, depends_on=_kinetics(form)), channel):
        return
    for on in dict.fromkeys((form.depends_on, _kinetics(form))):
        if "run_order" not in dict(on):
            yield replace(form, depends_on=on).with_factor(*SCATTER)


def _kinetics(form: Form) -> tuple[Factor, ...]:
    """What a form depends on besides conditions that scale its strength."""
    return tuple(on for on in form.depends_on if on[1] not in SCALES and on != SCATTER)


def _may_spread(form: Form) -> bool:
    """Whether a form dies away, or sets in, with a time constant that may be several."""
    relaxes = form.behaves_as in ("parallel_lag", "added_response", "added_rate")
    return relaxes and form.driver != "die_temperature" and "history" not in form.factors


def periods_s(channel: Channel) -> Array:
    """Periods that a swing is looked for at."""
    longest = float(np.median([time[-1] for time, _ in channel.samples]))
    shortest = max(6.0 * channel.sampling_period_s, 1.0)
    # Equally far apart in frequency: a run tells frequencies apart by the inverse of its length.
    frequency = np.linspace(1.0 / longest, 1.0 / shortest, 4 * PERIODS_TRIED)
    return np.asarray(1.0 / frequency)


def starts_of(effect: Effect, form: Form, channel: Channel) -> list[dict[str, float]]:
    """Values that a form's score is taken at."""
    found = effect.starts(channel)
    if form.behaves_as == "periodic":
        found = [start | {"period_s": float(period)} for start in found for period in periods_s(channel)]
    return found


def seen_over(channel: Channel) -> dict[str, tuple[float, float]]:
    """Lowest and highest of the conditions under which the runs were made."""
    c = channel.conditions
    over = {"ambient_temperature_c": (float(c.destination_c.min()), float(c.destination_c.max()))}
    if c.airflow_known.all():
        over["airflow_m_s"] = (float(c.airflow_m_s.min()), float(c.airflow_m_s.max()))
    if "pressure" in varied(channel):
        over["pressure_hpa"] = (float(c.pressure_hpa.min()), float(c.pressure_hpa.max()))
    return over
