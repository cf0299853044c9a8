"""Effects that nobody listed, as entries that model, fit and flight take like those of the catalogue.

Everything of such an entry follows from its form, and its id is the form's key: profiles and diagnoses carry it as
data (`discovered`), never as code.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache, partial

from shockrig.analysis.effects.behaviours import BEHAVIOURS, of_a_room
from shockrig.analysis.effects.forms import (
    MEAN,
    SCATTER,
    Form,
    differs_in,
    form_of,
    is_step,
    laws_of,
    run_of_strength,
)
from shockrig.analysis.estimate.effect import Effect, Link, Parameter, Words
from shockrig.files.causes import StatedEffect, Uncertain
from shockrig.files.diagnosis_data import Dependence, Discovered, EffectSize


def as_listed(one: Discovered) -> StatedEffect | None:
    """The catalogued effect with the same closed form as a described one, for who has equations of those alone."""
    if one.depends_on or one.driver in ("airflow", "die_temperature"):
        return None
    size = None if one.size is None else Uncertain(one.size.value, one.size.standard_uncertainty)
    numbers = {"size": size, "time_constant_s": one.time_constant_s}
    for effect, named in laws_of(Form(one.behaves_as, one.driver)):
        known = {name: value for name, of in named.items() if (value := numbers[of]) is not None}
        if len(known) < len(named):
            continue
        nothing = (
            {"gain": Uncertain(0.0, 0.0), "offset": Uncertain(0.0, 0.0)} if set(named) <= {"gain", "offset"} else {}
        )
        return StatedEffect(effect, {**nothing, **known})
    return None


ORDER_AFTER_CATALOGUE = 1000  # in the order of the chain: after all of the catalogue
NUMBERS: dict[tuple[str, str], tuple[float, float, tuple[float, ...], str, bool]] = {
    # (factor, how): lowest, highest, starts, unit, in its logarithm
    ("airflow", "power"): (-3.0, 3.0, (-0.4, 0.3), "1", False),
    ("step", "power"): (-3.0, 3.0, (-0.5, 0.5), "1", False),
    ("pressure", "power"): (-5.0, 5.0, (-0.5, 0.5), "1", False),
    ("ambient", "exponential"): (-0.2, 0.2, (-0.004, 0.004), "1/K", False),
    ("humidity", "exponential"): (-6.0, 6.0, (-0.5, 0.5), "1", False),
    ("humidity", "linear"): (-1.6, 1.9, (-0.3, 0.3), "1", False),
    ("humidity", "above"): (20.0, 130.0, (92.0, 85.0, 75.0, 60.0), "%RH", False),
    ("run_order", "trend"): (-1.0, 1.0, (-0.04, 0.04), "1", False),
    ("direction", "ratio"): (0.05, 20.0, (0.8, 1.25), "1", True),
    ("ambient", "zero_at"): (-60.0, 100.0, (22.0,), "degC", False),
    ("humidity", "zero_at"): (-50.0, 150.0, (45.0,), "%RH", False),
    ("history", "spread"): (0.0, 4.0, (1.5,), "1", False),
}
# What is known of a room's air before any data, as of those that come in with the probes in the catalogue.
USUAL_ROOM = {"ambient": (21.0, 8.0), "humidity": (45.0, 20.0)}


def is_described(id_: str) -> bool:
    """Whether an effect's id is the key of a form."""
    return "|" in id_


@cache
def described(key: str, jumps: bool) -> Effect:
    """The entry for a form; `jumps` is True in a channel whose reading jumps with the air's temperature (RH).

    Raises
    ------
    ValueError
        The key is that of no form, or of one that cannot be computed.
    """
    form, unit = form_of(key), "%RH" if jumps else "K"
    if form.behaves_as not in BEHAVIOURS:
        raise ValueError(f"{form.behaves_as!r} is no behaviour that can be computed")
    behaviour = BEHAVIOURS[form.behaves_as]
    depends = "".join(f" {_in_words(form, factor, how)}" for factor, how in form.depends_on)
    return Effect(
        id=key,
        link=_link(form),
        channels=("humidity",) if jumps else ("temperature",),
        equation=behaviour.equation(form, depends),
        source="the campaign's own runs",
        parameters=(*behaviour.parameters(form, unit), *_numbers_of_factors(form, unit)),
        apply=partial(behaviour.acts, form),
        words=Words(
            "",
            "Record the runs that are proposed, and look on the bench for what behaves so.",
        ),
        start=behaviour.start(form, unit),
        in_flight=None if drifts(form) else behaviour.flown(form),
        order=ORDER_AFTER_CATALOGUE,
        scatters=SCATTER in form.depends_on,
        differs_in=differs_in(form),
    )


def _link(form: Form) -> Link:
    if form.behaves_as == "delay" and form.driver != "none":
        return "exchange"
    return "logger" if form == MEAN else BEHAVIOURS[form.behaves_as].link


def drifts(form: Form) -> bool:
    """Whether it grows from run to run, or with the hours of a campaign: then it is the bench's, not the sensor's."""
    return any(on[0] in ("run_order", "time_of_campaign") for on in form.depends_on if on != SCATTER)


def _numbers_of_factors(form: Form, unit: str) -> Iterator[Parameter]:
    """The numbers by which a form's strength depends on conditions, each with its range and where a fit begins."""
    for factor, how in form.depends_on:
        if (factor, how) in NUMBERS:
            low, high, begin, of, log = NUMBERS[factor, how]
            if how == "trend" and form.behaves_as == "rate_change":  # bodies age by less than what fades out
                begin = (-0.004, 0.004)
            prior = USUAL_ROOM.get(factor) if of_a_room(form) else None
            none = None if how in ("above", "spread") else 1.0 if log else 0.0
            yield Parameter(factor, of, low, high, begin, log=log, none=none, prior=prior, ends_say=how == "ratio")
        elif is_step(how):  # the value from that run on, beside that before it
            yield Parameter(factor, "1", 0.2, 5.0, (1.1,), log=True, none=1.0)
        elif (factor, how) == ("step", "sets_in_over"):
            start = 3.0 if unit == "%RH" else 1.0
            yield Parameter(factor, unit, 0.02 * start, 20.0 * start, (start,), log=True, none=None)


def _in_words(form: Form, factor: str, how: str) -> str:
    return {
        "power": f"{factor}^n",
        "exponential": f"exp(n {factor})",
        "trend": f"(1 + n {f'(run - {at})' if (at := run_of_strength(form)) else 'run'})",
        "logarithmic": "ln(1 + t / time_constant)",
        "scatter": "(1 + n z), z normal in each run,",
        "spread": "(mean over time constants from exp(-n) to exp(n) times time_constant)",
        "ratio": f"(falling: times n, {factor})",
    }.get(how, f"({how.replace('_', ' ')}, {factor})")


def form_of_discovered(stated: Discovered) -> Form:
    """The form of a described effect as a file states it."""
    return Form(stated.behaves_as, stated.driver, tuple((on.factor, on.form) for on in stated.depends_on))


def of_readings(stated: Discovered) -> bool:
    """Whether it is what single readings do all along, a hum, bursts or a rounding: no part of the response, nor of a
    flight."""
    hum = stated.behaves_as == "periodic" and stated.phase_rad is None
    return stated.behaves_as == "bursts" or hum or rounded(stated)


def rounded(stated: Discovered) -> bool:
    """Whether it is a rounding of the readings: an offset that the reading itself makes, within a step of its size."""
    return (stated.behaves_as, stated.driver) == ("offset", "own_response")


def entry_of(stated: Discovered, channel: str) -> Effect | None:
    """The entry for a described effect of a file; None where this version cannot compute it."""
    form = form_of_discovered(stated)
    if of_readings(stated):
        return None
    try:
        return described(form.key, channel == "humidity")
    except (ValueError, KeyError):
        return None


def stated_values(stated: Discovered) -> dict[str, Uncertain]:
    """Values of a described effect's parameters by name, as `described` names them."""
    found: dict[str, Uncertain] = {}
    if stated.size is not None:
        found["size"] = Uncertain(stated.size.value, stated.size.standard_uncertainty)
    for name in ("time_constant_s", "period_s", "phase_rad"):
        if (value := getattr(stated, name)) is not None:
            found[name] = value
    for on in stated.depends_on:
        if on.value is not None:
            found[on.factor] = Uncertain(on.value, on.standard_uncertainty or 0.0)
    return found


def with_values(stated: Discovered, effect: Effect, values: Mapping[str, tuple[float, float]]) -> Discovered:
    """A described effect of a file with other numbers."""
    anew = discovered_of(effect, values)
    return replace(
        stated,
        time_constant_s=anew.time_constant_s,
        period_s=anew.period_s,
        phase_rad=anew.phase_rad,
        size=anew.size,
        depends_on=anew.depends_on,
    )


def _in_phase(values: Mapping[str, tuple[float, float]]) -> Mapping[str, tuple[float, float]]:
    """A swing's values with a positive size and a phase within half a turn; others as they are."""
    if "phase_rad" not in values or "size" not in values:
        return values
    (size, of_size), (phase, of_phase) = values["size"], values["phase_rad"]
    phase = phase + (math.pi if size < 0 else 0.0)
    return {**values, "size": (abs(size), of_size), "phase_rad": (math.remainder(phase, 2.0 * math.pi), of_phase)}


def discovered_of(effect: Effect, values: Mapping[str, tuple[float, float]]) -> Discovered:
    """A described effect with its values (value, standard uncertainty) as a file states it."""
    form, values = form_of(effect.id), _in_phase(values)

    def uncertain(name: str) -> Uncertain | None:
        if name not in values:
            return None
        value, spread = values[name]
        return Uncertain(value, spread if math.isfinite(spread) else abs(value) * 1e3)

    size = uncertain("size")
    unit = next((p.unit for p in effect.parameters if p.name == "size"), "1")
    depends_on = tuple(
        Dependence(factor, how, *((u.value, u.standard_uncertainty) if (u := uncertain(factor)) else (None, None)))
        for factor, how in form.depends_on
    )
    return Discovered(
        behaves_as=form.behaves_as,
        driver=form.driver,
        time_constant_s=uncertain("time_constant_s"),
        period_s=uncertain("period_s"),
        phase_rad=uncertain("phase_rad"),
        size=None if size is None else EffectSize(size.value, size.standard_uncertainty, unit),
        depends_on=depends_on,
    )
