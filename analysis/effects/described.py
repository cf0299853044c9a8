"""Effects that nobody listed, as entries that model, fit and flight take like those of the catalogue.

Everything of such an entry follows from its form, and its id is the form's key: profiles and diagnoses carry it as
data (`discovered`), never as code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.effects.behaviours import (
    MEAN,
    SCATTER,
    SPREAD,
    USUAL_C,
    Form,
    acting,
    differs_in,
    form_of,
    is_step,
    late_by,
    laws_of,
    run_of_strength,
    times_s,
    when_it_jumps_s,
)
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import SLOWEST_S, Effect, InFlight, Link, Parameter, Start, Values, Words
from shockrig.analysis.physics.air_exchange import REFERENCE_AIRFLOW_M_S
from shockrig.files.causes import StatedEffect, Uncertain
from shockrig.files.diagnosis_data import Dependence, Discovered, EffectSize

Array = NDArray[np.float64]

# What a described effect means in a flight: what can be undone is, what cannot is left and said to be.
#
# A flight knows its airspeed, and the temperature at which the sensor is; a direction, a step or a run it has not.

KNOWN = {("airflow", "power"), ("ambient", "exponential")}


def along(form: Form, p: Values, airspeed: Array, temperature_c: Array) -> Array:
    """By what a strength is multiplied along a flight (n,)."""
    out = np.ones(airspeed.shape)
    for factor, how in form.depends_on:
        if (factor, how) == ("airflow", "power"):
            out = out * (np.maximum(airspeed, 0.05) / REFERENCE_AIRFLOW_M_S) ** p[factor]
        elif (factor, how) == ("ambient", "exponential"):
            out = out * np.exp(p[factor] * (temperature_c - USUAL_C))
    return out


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


def flown(form: Form) -> InFlight:
    """How a correction treats a form that belongs to the sensor."""
    if form.depends_on == (("ambient", "zero_at"),) and form.behaves_as == "gain":
        return InFlight(undo=lambda p, y, stream, length: (y + p["size"] * p["ambient"]) / (1 + p["size"]))
    if form.depends_on == (("ambient", "linear"),) and form.behaves_as == "gain":
        return InFlight(undo=lambda p, y, stream, length: y / (1.0 + p["size"] * (stream.temperature_c - USUAL_C)))
    if form == MEAN:
        return InFlight(delay_s=lambda p, period_s: 0.5 * max(p["time_constant_s"] - period_s, 0.0))
    if set(form.depends_on) <= {SPREAD} and form.behaves_as == "parallel_lag":
        return InFlight(lag=lambda p: (p["size"], *times_s(form, p).tolist()))
    if any(pair not in KNOWN for pair in form.depends_on):
        return InFlight(left=True)
    scale: Callable[[Values, Array, Array], Array] = partial(along, form)
    only_airflow = set(form.depends_on) <= {("airflow", "power")}
    still = np.full(1, USUAL_C)
    if form.behaves_as == "lag_in_series" and form.driver == "airflow":
        if not only_airflow:
            return InFlight(left=True)
        return InFlight(biot=lambda p, stream, length: 1.0 / (p["size"] * scale(p, stream.airflow_m_s, still)))
    if form.behaves_as == "lag_in_series":
        return InFlight(
            series_s=lambda p: p["time_constant_s"],
            series_along=scale if form.depends_on else None,
        )
    if form.behaves_as == "rate_change":
        return InFlight(rate=scale)
    if form.driver == "none" and not form.depends_on and form.behaves_as == "delay":
        return InFlight(delay_s=lambda p, period_s: max(p["size"], 0.0))
    if form.driver == "die_temperature" and form.behaves_as == "gain" and not form.depends_on:
        return InFlight(at_die=True, die_share=lambda p: -p["size"])
    if form.driver == "own_response" and form.behaves_as == "gain" and only_airflow:
        return InFlight(undo=lambda p, y, stream, length: y / (1.0 + p["size"] * scale(p, stream.airflow_m_s, still)))
    if form.behaves_as == "offset" and only_airflow:
        return InFlight(undo=lambda p, y, stream, length: y - p["size"] * scale(p, stream.airflow_m_s, still))
    return InFlight(left=True)


LINKS: dict[str, Link] = {
    "lag_in_series": "exchange",
    "parallel_lag": "body",
    "added_response": "readout",
    "added_rate": "readout",
    "gain": "readout",
    "offset": "readout",
    "rate_change": "body",
    "delay": "logger",
    "periodic": "air",
}
LATER_S = (-0.02, -0.01, 0.01, 0.02)  # by which a transfer is later where fits begin beside the one found
ORDER_AFTER_CATALOGUE = 1000  # in the order of the chain: after all of the catalogue
TIMES_S = (0.3, 1.0, 3.0, 10.0, 30.0)
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
    form = form_of(key)
    late = form.behaves_as == "delay" and form.driver == "none" and jumps
    return Effect(
        id=key,
        link=_link(form),
        channels=("humidity",) if jumps else ("temperature",),
        equation=equation(form),
        source="the campaign's own runs",
        parameters=tuple(_parameters(form, jumps)),
        apply=acting(form),
        words=Words(
            "",
            "Record the runs that are proposed, and look on the bench for what behaves so.",
        ),
        start=Start(from_data=partial(_from_the_jumps, form), nudges=partial(_nudges, form)) if late else Start(),
        in_flight=flown(form) if of_sensor(form) else None,
        order=ORDER_AFTER_CATALOGUE,
        scatters=SCATTER in form.depends_on,
        differs_in=differs_in(form),
    )


def _link(form: Form) -> Link:
    if form.behaves_as == "delay" and form.driver != "none":
        return "exchange"
    return "logger" if form == MEAN else LINKS.get(form.behaves_as, "readout")


def _from_the_jumps(form: Form, channel: Channel) -> dict[str, float]:
    """Where the fit of a delay begins in a channel that jumps."""
    late = when_it_jumps_s(channel, late_by(form, channel.conditions))
    return {} if late is None else {"size": late}


def _nudges(form: Form, channel: Channel) -> list[dict[str, float]]:
    """By how much more the size of a delay is where transfers are a little later."""
    usual = float(np.nanmean(late_by(form, channel.conditions)))
    return [{"size": late_s / usual} for late_s in LATER_S] if usual > 0 else []


def of_sensor(form: Form) -> bool:
    """Whether it can belong to the sensor; what grows from run to run, or swings with the air, is the bench's."""
    room = form.behaves_as == "added_response" and ("ambient", "zero_at") in form.depends_on
    dew = ("humidity", "dew_margin") in form.depends_on
    pulse = form.behaves_as == "added_rate" and form.driver == "none" and not dew
    clock = form.behaves_as == "delay" and "history" in form.factors
    drifts = {"run_order", "time_of_campaign"} & {of for of, how in form.depends_on if (of, how) != SCATTER}
    return not (room or pulse or form.behaves_as == "periodic" or clock or drifts)


def _parameters(form: Form, jumps: bool) -> Iterable[Parameter]:
    """The numbers of a form, each with its range and where a fit begins."""
    unit = "%RH" if jumps else "K"
    kind = form.behaves_as
    room = kind == "added_response" and ("ambient", "zero_at") in form.depends_on
    each = "/h" if "time_of_campaign" in form.factors else ""
    if kind == "delay" and "history" in form.factors:
        yield Parameter("size", "1e-6", -200000.0, 200000.0, (3000.0, 12000.0, -6000.0), weakest=500.0)
    elif kind == "delay" and "linear" in dict(form.depends_on).values():
        yield Parameter("size", f"s{each}", -10.0, 10.0, (0.003, 0.01, -0.005), weakest=0.001)
    elif kind == "delay":
        starts = (0.05, 0.3) if form.driver == "none" else (0.05, 0.3, 0.6, 1.0, 1.6, 3.0)
        yield Parameter("size", "s", -0.5, 10.0, starts, weakest=0.01)
    elif kind == "parallel_lag":
        yield Parameter("size", "1", -0.9, 0.9, (0.03,), percent=True)
    elif kind == "rate_change" and ("history", "linear") in form.depends_on:
        yield Parameter("size", "1/min", -3.0, 10.0, (0.1, -0.1))
    elif kind == "lag_in_series" and form.driver == "airflow":
        yield Parameter("size", "1", 0.01, 200.0, (0.05, 0.3, 3.0), log=True, none=None)
    elif kind == "gain":
        if ("humidity", "above") in form.depends_on:  # of minus one is a ceiling
            yield Parameter("size", "1", -1.5, 1.5, (-0.5,))
        elif ("ambient", "linear") in form.depends_on:
            yield Parameter("size", "1/K", -0.02, 0.02, (0.0005,))
        elif ("humidity", "linear") in form.depends_on:
            yield Parameter("size", "1/%RH", -0.02, 0.02, (0.0005,))
        else:
            most = 3.0 if form.driver == "die_temperature" else 0.3
            yield Parameter("size", f"1{each}", -most, most, (0.02 * most,))
    elif kind == "added_response":
        limits = {"air_temperature": 5.0, "die_temperature": 5.0, "air_humidity": 1.0, "own_response": 0.5}
        if room:
            yield Parameter("size", "1", 0.001, 0.6, (0.03,), percent=True)
        else:
            most = limits.get(form.driver, 30.0)
            yield Parameter("size", size_unit(form, unit), -most, most, (2e-3 * most,))
    elif kind == "added_rate":
        most = {"own_response": 60.0, "none": 60.0}.get(form.driver, 200.0)
        yield Parameter("size", size_unit(form, unit), -most, most, (2e-3 * most,))
    elif kind == "offset":
        yield Parameter("size", f"{unit}{each}", -30.0, 30.0, (0.05,) if not jumps else (0.3,))
    elif kind == "periodic":
        most = 1.0 if form.driver != "none" else 20.0
        yield Parameter("size", size_unit(form, unit), -most, most, (2e-3 * most,))
        yield Parameter("period_s", "s", 0.5, 300.0, (10.0,), log=True, none=None)
        yield Parameter("phase_rad", "1", -10.0, 10.0, (0.0, 1.5708), none=None)
        if form.driver != "none":
            yield Parameter("time_constant_s", "s", 0.5, 300.0, (5.0,), log=True, none=None)
    if has_time_constant(form) and kind != "periodic":
        begins: tuple[float, ...] = TIMES_S
        if kind == "lag_in_series":
            begins = (0.03, 0.1, *TIMES_S)
        elif kind == "added_rate" and form.driver == "own_response":
            begins = (0.2, 1.0, 5.0)
        yield Parameter("time_constant_s", "s", 0.01, SLOWEST_S, begins, log=True, none=None)
    for factor, how in form.depends_on:
        if (factor, how) in NUMBERS:
            low, high, begin, of, log = NUMBERS[factor, how]
            if how == "trend" and kind == "rate_change":  # bodies age by less than what fades out
                begin = (-0.004, 0.004)
            prior = USUAL_ROOM.get(factor) if room else None
            none = None if how in ("above", "spread") else 1.0 if log else 0.0
            yield Parameter(factor, of, low, high, begin, log=log, none=none, prior=prior, ends_say=how == "ratio")
        elif is_step(how):  # the value from that run on, beside that before it
            yield Parameter(factor, "1", 0.2, 5.0, (1.1,), log=True, none=1.0)
        elif (factor, how) == ("step", "sets_in_over"):
            start = 3.0 if jumps else 1.0
            yield Parameter(factor, unit, 0.02 * start, 20.0 * start, (start,), log=True, none=None)


def has_time_constant(form: Form) -> bool:
    """Whether a form has a time constant of its own."""
    if form.behaves_as == "added_response":
        return form.driver != "die_temperature" and ("history", "linear") not in form.depends_on
    if form.behaves_as == "lag_in_series":
        return form.driver != "airflow"
    return form.behaves_as in ("parallel_lag", "added_rate") or (
        form.behaves_as == "periodic" and form.driver != "none"
    )


def size_unit(form: Form, unit: str) -> str:
    """Unit of a form's size in a channel of this unit."""
    of = {"air_temperature": "K", "die_temperature": "K", "air_humidity": "%RH", "own_response": unit}.get(form.driver)
    if of is None:
        return unit
    share = "1" if of == unit else f"{unit}/{of}"
    if form.behaves_as == "added_rate":
        return "s" if of == unit else f"{unit} s/{of}"
    return share


def equation(form: Form) -> str:
    """The equation that a form adds."""
    depends = "".join(f" {_in_words(form, factor, how)}" for factor, how in form.depends_on)
    if form.behaves_as == "lag_in_series" and form.driver == "airflow":
        return f"flux into the body = (air - surface) / (size{depends}), size in units of the body's own resistance"
    if form == MEAN:
        return "reading = mean of the readings over the last time_constant"
    if form.behaves_as == "lag_in_series" and ("history", "linear") in form.depends_on:
        return "air(t) = source + (destination - source) min(t / time_constant, 1)"
    if ("humidity", "above") in form.depends_on:
        return "reading + size max(reading - humidity, 0)"
    if form.behaves_as == "gain" and ("ambient", "linear") in form.depends_on:
        return "reading (1 + size (T - 20 degC))"
    if form.behaves_as == "gain" and ("humidity", "linear") in form.depends_on:
        return "reading (1 + size (reading - 50 %RH))"
    if form.behaves_as == "delay" and form.driver == "air_humidity":
        return f"vapour at the film(t) = vapour in the air(t - size{depends})"
    x = {"air_temperature": "T_air", "air_humidity": "H_air", "die_temperature": "T_die", "own_response": "reading"}
    driver = x.get(form.driver, "1")
    return {
        "lag_in_series": f"time_constant{depends} dx/dt = air - x, and the body follows x",
        "parallel_lag": f"reading = (1 - size{depends}) body + size{depends} (1 - exp(-t / time_constant))",
        "added_response": f"reading + size{depends} {driver} behind a lag of time_constant",
        "added_rate": f"reading + size{depends} d{driver}/dt behind a lag of time_constant",
        "gain": f"reading (1 + size{depends})",
        "offset": f"reading + size{depends}",
        "rate_change": f"rate{depends}" if "history" not in form.factors else f"rate (1 + size{depends} t)",
        "delay": f"reading(t) = true(t - size{depends})",
        "periodic": f"reading + size{depends} sin(2 pi t / period + phase)",
    }.get(form.behaves_as, "")


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
