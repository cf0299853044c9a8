"""The ways in which a form may behave, each with all that is particular to it: what it does to the chain, its numbers,
its equation, and what a correction of flights makes of it.

A new behaviour is an entry of `BEHAVIOURS`, and a key in the tables of `diagnose/grammar.py`, which say what a campaign
needs for it to be looked for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.effects.forms import (
    MEAN,
    SPREAD,
    USUAL_C,
    USUAL_PERCENT,
    Factor,
    Form,
    driver_step,
    grown,
    relaxed,
    scale_of,
    times_s,
)
from shockrig.analysis.effects.jumps import when_it_jumps_s
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import SLOWEST_S, Arrays, InFlight, Link, Parameter, Start, Values
from shockrig.analysis.physics.air_exchange import REFERENCE_AIRFLOW_M_S, Conditions
from shockrig.analysis.physics.chain import Chain, RoomAir
from shockrig.analysis.physics.distinct import for_different
from shockrig.analysis.physics.humidity import saturation_pressure_hpa

Array = NDArray[np.float64]
Parameters = tuple[Parameter, ...]

TIMES_S = (0.3, 1.0, 3.0, 10.0, 30.0)
A_MINUTE_S = 60.0
SHORTEST_LAG_S, LEAST_RESISTANCE = 1e-4, 1e-4  # a lag in series, and a resistance before the body, that is none
MOST_SHARE = 0.95  # of a reading that may follow late
MOST_LET_IN = 0.95  # share of a room's air
SLOWEST_SHARE_LOST = 0.95  # of its rate, that a body may lose
PPM = 1e-6  # of the time that a run has lasted, by which a delay grows
LATER_S = (-0.02, -0.01, 0.01, 0.02)  # by which a transfer is later where fits begin beside the one found
GROWS: Factor = ("history", "linear")  # with the time that a run has lasted


@dataclass(frozen=True)
class Behaviour:
    """One way to behave.

    Attributes
    ----------
    link : str
        Of the chain, that it changes.
    acts : (form, chain, {name: ndarray (B, 1)}) -> chain
    parameters : (form, the channel's unit) -> tuple of Parameter
        Its own, without those of what its strength depends on.
    equation : (form, words for what its strength depends on) -> str
    flown : form -> InFlight or None
        None for what is the bench's.
    start : (form, the channel's unit) -> Start
    """

    link: Link
    acts: Callable[[Form, Chain, Arrays], Chain]
    parameters: Callable[[Form, str], Parameters]
    equation: Callable[[Form, str], str]
    flown: Callable[[Form], InFlight | None]
    start: Callable[[Form, str], Start] = lambda form, unit: Start()


def _time_constant(begins: tuple[float, ...] = TIMES_S) -> Parameter:
    return Parameter("time_constant_s", "s", 0.01, SLOWEST_S, begins, log=True, none=None)


def _within(most: float, unit: str, begin: float | None = None) -> Parameter:
    """A size of either sign."""
    return Parameter("size", unit, -most, most, (2e-3 * most if begin is None else begin,))


def _per_driver(form: Form, unit: str) -> str:
    """Unit of what a driver is multiplied by to be added to a channel of this unit."""
    of = {"air_temperature": "K", "die_temperature": "K", "air_humidity": "%RH", "own_response": unit}.get(form.driver)
    return unit if of is None else "1" if of == unit else f"{unit}/{of}"


def _driver_in_words(form: Form) -> str:
    x = {"air_temperature": "T_air", "air_humidity": "H_air", "die_temperature": "T_die", "own_response": "reading"}
    return x.get(form.driver, "1")


def _per_hour(form: Form) -> str:
    return "/h" if "time_of_campaign" in form.factors else ""


def _readout(chain: Chain, added: Callable[[Array, Array], Array]) -> Chain:
    return chain.with_readout(lambda reading, time, die_c: reading + added(reading, time))


# In a flight what can be undone is, what cannot is left and said to be. A flight knows its airspeed, and the
# temperature at which the sensor is; a direction, a step or a run it has not.

LEFT = InFlight(left=True)
BY_AIRFLOW, BY_AMBIENT = ("airflow", "power"), ("ambient", "exponential")


def _knows(form: Form, *factors: Factor) -> bool:
    return set(form.depends_on) <= set(factors)


def _along(form: Form, p: Values, airspeed: Array, temperature_c: Array) -> Array:
    """By what a strength is multiplied along a flight (n,)."""
    out = np.ones(airspeed.shape)
    for factor in form.depends_on:
        if factor == BY_AIRFLOW:
            out = out * (np.maximum(airspeed, 0.05) / REFERENCE_AIRFLOW_M_S) ** p["airflow"]
        elif factor == BY_AMBIENT:
            out = out * np.exp(p["ambient"] * (temperature_c - USUAL_C))
    return out


def _sized(form: Form, p: Values, airspeed: Array) -> Array:
    """A size (n,) along a flight that depends on nothing but the airspeed."""
    return p["size"] * _along(form, p, airspeed, np.full(1, USUAL_C))


# A lag before the body, or a resistance to the exchange with the air; evenly, a slow transfer or a mean of readings.


def _lag_in_series(form: Form, chain: Chain, p: Arrays) -> Chain:
    if form.driver == "airflow":  # the exchange with the air holds it back: size is its resistance over the body's own
        return replace(chain, biot=1.0 / np.maximum(p["size"] * scale_of(form, chain, p), LEAST_RESISTANCE))
    if form == MEAN:
        over_s = float(p["time_constant_s"].flat[0])  # the same for every candidate
        return replace(chain, averaged=max(round(over_s / chain.channel.reading_period_s), 1))
    if GROWS in form.depends_on:  # evenly, and over after that time
        return replace(chain, ramp_s=chain.channel.conditions.ramps_s(p["time_constant_s"]))
    lag_s = np.maximum(p["time_constant_s"] * scale_of(form, chain, p), SHORTEST_LAG_S)
    return replace(chain, series=(*chain.series, lag_s))


def _lag_in_series_parameters(form: Form, unit: str) -> Parameters:
    if form.driver == "airflow":
        return (Parameter("size", "1", 0.01, 200.0, (0.05, 0.3, 3.0), log=True, none=None),)
    return (_time_constant((0.03, 0.1, *TIMES_S)),)


def _lag_in_series_equation(form: Form, depends: str) -> str:
    if form.driver == "airflow":
        return f"flux into the body = (air - surface) / (size{depends}), size in units of the body's own resistance"
    if form == MEAN:
        return "reading = mean of the readings over the last time_constant"
    if GROWS in form.depends_on:
        return "air(t) = source + (destination - source) min(t / time_constant, 1)"
    return f"time_constant{depends} dx/dt = air - x, and the body follows x"


def _lag_in_series_flown(form: Form) -> InFlight:
    if form == MEAN:
        return InFlight(delay_s=lambda p, period_s: 0.5 * max(p["time_constant_s"] - period_s, 0.0))
    if form.driver == "airflow" and _knows(form, BY_AIRFLOW):
        return InFlight(biot=lambda p, stream, length: 1.0 / _sized(form, p, stream.airflow_m_s))
    if form.driver == "airflow" or not _knows(form, BY_AIRFLOW, BY_AMBIENT):
        return LEFT
    along = partial(_along, form) if form.depends_on else None
    return InFlight(series_s=lambda p: p["time_constant_s"], series_along=along)


# A share of the response that follows late beside the body.


def _parallel_lag(form: Form, chain: Chain, p: Arrays) -> Chain:
    scale = scale_of(form, chain, p)
    share = np.clip(p["size"] * scale, -MOST_SHARE, MOST_SHARE)
    each_s = times_s(form, p)
    return replace(chain, lags=(*chain.lags, (share, np.broadcast_to(each_s, (*share.shape, each_s.shape[-1])))))


# A body whose rate changes.


def _rate_change(form: Form, chain: Chain, p: Arrays) -> Chain:
    if ("humidity", "linear") in form.depends_on:  # moves with what the body itself holds, all along a run
        chain = replace(chain, activity_slope=p["humidity"])
    if GROWS in form.depends_on:  # faster, or slower, the longer the run has lasted
        more = (p["size"] * scale_of(form, chain, p))[..., None] / A_MINUTE_S
        since = np.maximum(chain.time_s, 0.0)
        moving = np.minimum(since, SLOWEST_SHARE_LOST / np.maximum(-more, 1e-12))  # it never comes to a stand
        lasted = moving + 0.5 * more * moving**2 + (1.0 + more * moving) * (since - moving)
        return replace(chain, time_s=np.where(chain.time_s > 0, lasted, chain.time_s))
    return replace(chain, rate=chain.rate * np.maximum(scale_of(form, chain, p), 1.0 - SLOWEST_SHARE_LOST))


# A reading, or the vapour alone, that comes late.


def late_by(form: Form, conditions: Conditions) -> Array:
    """By what the size of a delay is multiplied at the transfer of each run (R,)."""
    return PPM * conditions.start_s if GROWS in form.depends_on else grown(form, conditions)


def _delay(form: Form, chain: Chain, p: Arrays) -> Chain:
    if GROWS in form.depends_on:  # counted from a run's first reading
        since_s = np.maximum(chain.time_s + chain.channel.conditions.start_s[:, None], 0.0)
        return replace(chain, time_s=chain.time_s - PPM * p["size"][..., None] * since_s)
    late_s = p["size"] * late_by(form, chain.channel.conditions) * scale_of(form, chain, p)
    if form.driver == "air_humidity":  # the vapour alone: the film is read at its own temperature meanwhile
        return replace(chain, vapour_late_s=late_s)
    return replace(chain, time_s=chain.time_s - late_s[..., None])


def _delay_parameters(form: Form, unit: str) -> Parameters:
    if "history" in form.factors:
        return (Parameter("size", "1e-6", -200000.0, 200000.0, (3000.0, 12000.0, -6000.0), weakest=500.0),)
    if "linear" in dict(form.depends_on).values():
        return (Parameter("size", f"s{_per_hour(form)}", -10.0, 10.0, (0.003, 0.01, -0.005), weakest=0.001),)
    starts = (0.05, 0.3) if form.driver == "none" else (0.05, 0.3, 0.6, 1.0, 1.6, 3.0)
    return (Parameter("size", "s", -0.5, 10.0, starts, weakest=0.01),)


def _delay_equation(form: Form, depends: str) -> str:
    if form.driver == "air_humidity":
        return f"vapour at the film(t) = vapour in the air(t - size{depends})"
    return f"reading(t) = true(t - size{depends})"


def _delay_flown(form: Form) -> InFlight | None:
    if "history" in form.factors:
        return None  # a clock's
    constant = form.driver == "none" and not form.depends_on
    return InFlight(delay_s=lambda p, period_s: max(p["size"], 0.0)) if constant else LEFT


def _delay_start(form: Form, unit: str) -> Start:
    if form.driver != "none" or unit != "%RH":
        return Start()

    def from_the_jumps(channel: Channel) -> dict[str, float]:
        late = when_it_jumps_s(channel, late_by(form, channel.conditions))
        return {} if late is None else {"size": late}

    def nudges(channel: Channel) -> list[dict[str, float]]:
        usual = float(np.nanmean(late_by(form, channel.conditions)))
        return [{"size": late_s / usual} for late_s in LATER_S] if usual > 0 else []

    return Start(from_data=from_the_jumps, nudges=nudges)


# Something leaks in, proportional to a driver, with its own time constant.


def _added_response(form: Form, chain: Chain, p: Arrays) -> Chain:
    if of_a_room(form):
        humid = p.get("humidity", np.full_like(p["ambient"], USUAL_PERCENT))
        share = np.clip(p["size"] * scale_of(form, chain, p), 0.0, MOST_LET_IN)
        each = np.moveaxis(times_s(form, p), -1, 0)
        rooms = (RoomAir(share / len(each), one_s, p["ambient"], humid) for one_s in each)
        return replace(chain, rooms=(*chain.rooms, *rooms))
    size = (p["size"] * scale_of(form, chain, p))[..., None]
    if form.driver == "die_temperature":

        def with_die(reading: Array, time: Array, die_c: Array) -> Array:
            return np.asarray(reading + size * np.where(np.isfinite(die_c), die_c - USUAL_C, 0.0))

        return chain.with_readout(with_die)
    kinetics = dict(form.depends_on).get("history", "")
    creeps = kinetics in ("logarithmic", "linear")
    each_s = times_s(form, p) if "time_constant_s" in p else np.full((1, 1, 1), A_MINUTE_S)

    def come_in(time: Array) -> Array:
        if creeps:
            since = np.maximum(time, 0.0) / each_s
            return np.log1p(since) if kinetics == "logarithmic" else since
        return np.where(time > 0, 1.0 - relaxed(time, each_s), 0.0)

    if form.driver == "own_response":  # what the reading shows creeps
        return _readout(chain, lambda reading, time: size * reading * come_in(time))
    before, after = (x[:, None] for x in driver_step(form, chain.channel))
    lasting = 0.0 if creeps else before  # what creeps all along has no level that it began from
    return _readout(chain, lambda reading, time: size * (lasting + (after - before) * come_in(time)))


def of_a_room(form: Form) -> bool:
    """Whether it is air of another state that comes in with the probes and goes."""
    return form.behaves_as == "added_response" and ("ambient", "zero_at") in form.depends_on


def _added_response_parameters(form: Form, unit: str) -> Parameters:
    most = {"air_temperature": 5.0, "die_temperature": 5.0, "air_humidity": 1.0, "own_response": 0.5}
    size = _within(most.get(form.driver, 30.0), _per_driver(form, unit))
    if of_a_room(form):
        size = Parameter("size", "1", 0.001, 0.6, (0.03,), percent=True)
    return (size,) if form.driver == "die_temperature" or GROWS in form.depends_on else (size, _time_constant())


# Proportional to a driver's rate of change.


def _added_rate(form: Form, chain: Chain, p: Arrays) -> Chain:
    """Proportional to a driver's rate of change, which is seen through a lag: (driver - lagged driver) / time constant.

    Without a driver it is what the transfer itself does, and dies away.
    """
    size, each_s = p["size"] * scale_of(form, chain, p), times_s(form, p)
    if form.driver == "own_response":
        echoed_s = np.broadcast_to(each_s, (*size.shape, each_s.shape[-1]))
        # What is added is at most about the whole of a response: more is learnt only where hardly anything moves.
        most = p["time_constant_s"] + 1.0 / chain.rate
        return replace(chain, echoes=(*chain.echoes, (-np.clip(size, -most, most) / p["time_constant_s"], echoed_s)))
    before, after = driver_step(form, chain.channel)
    step = size * (after - before) / (1.0 if form.driver == "none" else p["time_constant_s"])
    return _readout(chain, lambda reading, time: step[..., None] * relaxed(time, each_s))


def _added_rate_parameters(form: Form, unit: str) -> Parameters:
    most = {"own_response": 60.0, "none": 60.0}.get(form.driver, 200.0)
    share = _per_driver(form, unit)
    per_rate = unit if form.driver == "none" else "s" if share == "1" else share.replace("/", " s/")
    begins = (0.2, 1.0, 5.0) if form.driver == "own_response" else TIMES_S
    return _within(most, per_rate), _time_constant(begins)


def _added_rate_flown(form: Form) -> InFlight | None:
    pulse = form.driver == "none" and ("humidity", "dew_margin") not in form.depends_on
    return None if pulse else LEFT


# A calibration line: its gain, which may move with a temperature or with what is read, and its offset.


def _air_and_own_c(chain: Chain, time: Array, die_c: Array) -> tuple[Array, Array]:
    """Temperatures (B, R, n) of the air, and of the sensor itself where it is known."""
    air = np.where(time > 0, chain.destination_c[..., None], chain.source_c[..., None])
    return air, np.where(np.isfinite(die_c), die_c, air)


def _gain(form: Form, chain: Chain, p: Arrays) -> Chain:
    if form.driver == "die_temperature":  # as the saturation pressure moves from the air's temperature to the die's
        size = (p["size"] * scale_of(form, chain, p))[..., None]

        def of_die(reading: Array, time: Array, die_c: Array) -> Array:
            air, own = _air_and_own_c(chain, time, die_c)
            return np.asarray(reading * (saturation_pressure_hpa(own) / saturation_pressure_hpa(air)) ** size)

        return chain.with_readout(of_die)
    read, middle = ("humidity", USUAL_PERCENT) if chain.channel.jumps_with_air else ("ambient", USUAL_C)
    if form == Form("gain", "own_response", ((read, "linear"),)):  # one that moves with what is read: a bent line
        slope = p["size"][..., None]
        return _readout(chain, lambda reading, time: slope * reading * (reading - middle))
    if ("ambient", "linear") in form.depends_on:  # a gain that moves with the sensor's own temperature
        slope = p["size"][..., None]

        def with_temperature(reading: Array, time: Array, die_c: Array) -> Array:
            return np.asarray(reading * (1.0 + slope * (_air_and_own_c(chain, time, die_c)[1] - USUAL_C)))

        return chain.with_readout(with_temperature)
    if ("humidity", "above") in form.depends_on:  # from a level on: minus one is a ceiling, hard, and less a soft one
        share, above = p["size"][..., None], p["humidity"][..., None]
        return _readout(chain, lambda reading, time: share * np.maximum(reading - above, 0.0))
    zero = p["ambient"][..., None] if ("ambient", "zero_at") in form.depends_on else 0.0
    size = (p["size"] * grown(form, chain.channel.conditions) * scale_of(form, chain, p))[..., None]
    return _readout(chain, lambda reading, time: size * (reading - zero))


def _gain_parameters(form: Form, unit: str) -> Parameters:
    if ("humidity", "above") in form.depends_on:  # of minus one is a ceiling
        return (_within(1.5, "1", begin=-0.5),)
    for factor, of in (("ambient", "K"), ("humidity", "%RH")):
        if (factor, "linear") in form.depends_on:
            return (_within(0.02, f"1/{of}", begin=0.0005),)
    most = 3.0 if form.driver == "die_temperature" else 0.3
    return (_within(most, f"1{_per_hour(form)}", begin=0.02 * most),)


def _gain_equation(form: Form, depends: str) -> str:
    if ("humidity", "above") in form.depends_on:
        return "reading + size max(reading - humidity, 0)"
    if ("ambient", "linear") in form.depends_on:
        return "reading (1 + size (T - 20 degC))"
    if ("humidity", "linear") in form.depends_on:
        return "reading (1 + size (reading - 50 %RH))"
    return f"reading (1 + size{depends})"


def _gain_flown(form: Form) -> InFlight:
    if form.depends_on == (("ambient", "zero_at"),):
        return InFlight(undo=lambda p, y, stream, length: (y + p["size"] * p["ambient"]) / (1 + p["size"]))
    if form.depends_on == (("ambient", "linear"),):
        return InFlight(undo=lambda p, y, stream, length: y / (1.0 + p["size"] * (stream.temperature_c - USUAL_C)))
    if form.driver == "die_temperature" and not form.depends_on:
        return InFlight(at_die=True, die_share=lambda p: -p["size"])
    if form.driver == "own_response" and _knows(form, BY_AIRFLOW):
        return InFlight(undo=lambda p, y, stream, length: y / (1.0 + _sized(form, p, stream.airflow_m_s)))
    return LEFT


def _offset(form: Form, chain: Chain, p: Arrays) -> Chain:
    size = (p["size"] * grown(form, chain.channel.conditions) * scale_of(form, chain, p))[..., None]
    if ("direction", "sign") not in form.depends_on:
        return _readout(chain, lambda reading, time: np.broadcast_to(size, np.broadcast_shapes(size.shape, time.shape)))
    first = (chain.source_percent if chain.channel.jumps_with_air else chain.source_c)[..., None]
    width = p["step"][..., None]
    return _readout(chain, lambda reading, time: size * np.tanh((reading - first) / width))


def _offset_parameters(form: Form, unit: str) -> Parameters:
    return (_within(30.0, f"{unit}{_per_hour(form)}", begin=0.3 if unit == "%RH" else 0.05),)


def _offset_flown(form: Form) -> InFlight:
    if not _knows(form, BY_AIRFLOW):
        return LEFT
    return InFlight(undo=lambda p, y, stream, length: y - _sized(form, p, stream.airflow_m_s))


# A swing that begins with the transfer; driven by the step of the air it dies away.


def _periodic(form: Form, chain: Chain, p: Arrays) -> Chain:
    before, after = driver_step(form, chain.channel)
    size = (p["size"] * (after - before) * scale_of(form, chain, p))[..., None]
    turn, phase = 2.0 * np.pi / p["period_s"][..., None], p["phase_rad"][..., None]
    decays = (p["time_constant_s"][..., None],) if "time_constant_s" in p else ()

    def swing(time: Array, size: Array, turn: Array, phase: Array, *decay: Array) -> Array:
        alive = relaxed(time, *decay) if decay else time > 0
        return np.asarray(size * alive * np.sin(turn * np.maximum(time, 0.0) + phase))

    return _readout(chain, lambda reading, time: for_different(swing, time, size, turn, phase, *decays))


def _periodic_parameters(form: Form, unit: str) -> Parameters:
    driven = form.driver != "none"
    swing = (
        _within(1.0 if driven else 20.0, _per_driver(form, unit)),
        Parameter("period_s", "s", 0.5, 300.0, (10.0,), log=True, none=None),
        Parameter("phase_rad", "1", -10.0, 10.0, (0.0, 1.5708), none=None),
    )
    dies_away = Parameter("time_constant_s", "s", 0.5, 300.0, (5.0,), log=True, none=None)
    return (*swing, dies_away) if driven else swing


BEHAVIOURS = {
    "lag_in_series": Behaviour(
        "exchange", _lag_in_series, _lag_in_series_parameters, _lag_in_series_equation, _lag_in_series_flown
    ),
    "parallel_lag": Behaviour(
        "body",
        _parallel_lag,
        parameters=lambda form, unit: (Parameter("size", "1", -0.9, 0.9, (0.03,), percent=True), _time_constant()),
        equation=lambda form, depends: (
            f"reading = (1 - size{depends}) body + size{depends} (1 - exp(-t / time_constant))"
        ),
        flown=lambda form: (
            InFlight(lag=lambda p: (p["size"], *times_s(form, p).tolist())) if _knows(form, SPREAD) else LEFT
        ),
    ),
    "rate_change": Behaviour(
        "body",
        _rate_change,
        parameters=lambda form, unit: (
            (Parameter("size", "1/min", -3.0, 10.0, (0.1, -0.1)),) if GROWS in form.depends_on else ()
        ),
        equation=lambda form, depends: f"rate (1 + size{depends} t)" if "history" in form.factors else f"rate{depends}",
        flown=lambda form: InFlight(rate=partial(_along, form)) if _knows(form, BY_AIRFLOW, BY_AMBIENT) else LEFT,
    ),
    "delay": Behaviour("logger", _delay, _delay_parameters, _delay_equation, _delay_flown, _delay_start),
    "added_response": Behaviour(
        "readout",
        _added_response,
        _added_response_parameters,
        equation=lambda form, depends: (
            f"reading + size{depends} {_driver_in_words(form)} behind a lag of time_constant"
        ),
        flown=lambda form: None if of_a_room(form) else LEFT,
    ),
    "added_rate": Behaviour(
        "readout",
        _added_rate,
        _added_rate_parameters,
        equation=lambda form, depends: (
            f"reading + size{depends} d{_driver_in_words(form)}/dt behind a lag of time_constant"
        ),
        flown=_added_rate_flown,
    ),
    "gain": Behaviour("readout", _gain, _gain_parameters, _gain_equation, _gain_flown),
    "offset": Behaviour(
        "readout",
        _offset,
        _offset_parameters,
        equation=lambda form, depends: f"reading + size{depends}",
        flown=_offset_flown,
    ),
    "periodic": Behaviour(
        "air",
        _periodic,
        _periodic_parameters,
        equation=lambda form, depends: f"reading + size{depends} sin(2 pi t / period + phase)",
        flown=lambda form: None,
    ),
}
