"""How an effect that nobody listed may behave: closed forms made from data and not from code, and which of them is
the law of a catalogued effect.

A form is a behaviour, a driver, and what its strength (or its time constant, or the body's rate) depends on; the words
are those of `discovered` in shock-diagnosis/1. Sizes and numbers of the factors are the parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import DIFFERS_BY, TINY_STRENGTH
from shockrig.analysis.physics.air_exchange import REFERENCE_AIRFLOW_M_S, Conditions, dew_margin_k
from shockrig.analysis.physics.chain import Chain, Recorded, RoomAir
from shockrig.analysis.physics.humidity import saturation_pressure_hpa

Array = NDArray[np.float64]

# When the reading of RH jumps with the air's temperature: where a delay's fit begins, and what it is nudged by.
#
# A delay moves that jump, and no fit finds its way over a jump.

SPREAD_S = 0.06  # of the jumps' times from run to run, sampling and trigger together
NUDGES_S = tuple(0.002 * k for k in range(-15, 16) if k)  # the objective has steps where a sample crosses the jump
LEAST_CHANGE_K = 3.0  # of the air, for its jump to stand out in the RH read at its temperature
LEAST_JUMPS = 3


def when_it_jumps_s(channel: Channel, share_of_s: NDArray[np.float64] | None = None) -> float | None:
    """Median time of the steepest rise or fall near the transfer; None where no jump shows, or the runs disagree.

    With `share_of_s`, a time (R,) that each run's delay is proportional to, the share instead.
    """
    if not channel.jumps_with_air:
        return None
    of = np.ones(channel.runs) if share_of_s is None else share_of_s
    air, period = channel.conditions, channel.sampling_period_s
    steepest_s, among = [], []
    for run in np.flatnonzero((np.abs(air.destination_c - air.source_c) > LEAST_CHANGE_K) & air.start_known):
        time, value = channel.samples[run]
        near = np.flatnonzero((time[1:] > -3 * period) & (time[:-1] < 2.0) & (np.diff(time) < 1.5 * period))
        if near.size > 3:
            steps = np.abs(np.diff(value))[near]
            steepest_s.append(0.5 * (time[near] + time[near + 1])[np.argmax(steps)])
            among.append(of[run])
    if len(steepest_s) < LEAST_JUMPS:
        return None
    late_s, per = np.array(steepest_s), np.maximum(among, 1e-9)
    middle = float(np.median(late_s / per))
    return middle if np.median(np.abs(late_s - middle * per)) < SPREAD_S else None


# Which forms of the grammar are the law of a catalogued effect: the same closed form by another door.

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


Arrays = Mapping[str, Array]
Factor = tuple[str, str]  # what it depends on, and how

USUAL_C = 20.0
USUAL_PERCENT = 50.0
USUAL_HPA = 1013.25
USUAL_STEP = {True: 40.0, False: 20.0}  # of a channel that jumps with the air (%RH), and of one that does not (K)
MOST_LET_IN = 0.95  # share of a room's air
MIDDLE_RUN = 17  # of a usual campaign, counted from 0
A_MINUTE_S = 60.0
SLOWEST_SHARE_LOST = 0.95  # of its rate, that a body may lose
USUAL_MARGIN_K = 10.0  # of dew
SCALES = frozenset({"power", "exponential", "ratio", "trend"})  # ways in which a condition scales a strength
SPREAD: Factor = ("history", "spread")  # not one time constant, but several, evenly spread in their logarithm
SPREAD_OVER = np.linspace(-1.0, 1.0, 7)  # times the factor's number: logarithms of the time constants over their middle
SCATTER: Factor = (DIFFERS_BY, "scatter")  # stronger in one run than in another, by chance
LEAST_STEP = 0.1  # share of a usual step
PPM = 1e-6  # of the time that a run has lasted, by which a delay grows


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


STEP = "from_run_"  # a dependence on run order: from that run on, counted from 0, another value


ONLY_FROM, ONLY_BEFORE = f"only_{STEP}", "only_before_run_"  # likewise: what is there in a group of runs alone
SHORTEST_LAG_S, LEAST_RESISTANCE = 1e-4, 1e-4  # a lag in series, and a resistance before the body, that is none


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
            "step": np.maximum(np.abs(own_step(c, jumps)) / USUAL_STEP[jumps], LEAST_STEP),
            "pressure": c.pressure_hpa / USUAL_HPA,
        }[factor]
        return np.asarray(of**value)
    if how == "exponential":
        exponent = {
            "ambient": c.destination_c - USUAL_C,
            "humidity": 0.5 * (c.source_percent + c.destination_percent) / 100.0 - 0.5,
        }[factor]
        return np.asarray(np.exp(value * exponent))
    if is_step(how):
        return np.asarray(np.where(c.order >= int(how.removeprefix(STEP)), value, 1.0))
    if how == "ratio":  # falling to rising
        return np.asarray(np.where(own_step(c, jumps) < 0, value, 1.0))
    raise ValueError(f"a strength that depends on {factor} as {how!r} is no form of behaviour")


def run_of_strength(form: Form) -> int:
    """The run, counted from 0, that the strength of a form is stated for where it moves from run to run: of a rate, and
    so of alpha or D, the first, and else one in the middle, as what grows from nothing has no share to grow by."""
    return 0 if form.behaves_as == "rate_change" else MIDDLE_RUN


def own_step(conditions: Conditions, jumps: bool) -> Array:
    """Signed change of the air's own quantity in each run (R,)."""
    c = conditions
    return c.destination_percent - c.source_percent if jumps else c.destination_c - c.source_c


def _scale(form: Form, chain: Chain, p: Arrays) -> Array:
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


def _driver_step(form: Form, channel: Recorded) -> tuple[Array, Array]:
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


def _relaxed(time: Array, each_s: Array) -> Array:
    """Mean over time constants (B, R, J) of exp(-t / time constant) after the transfer, 0 before it."""
    since = np.maximum(time, 0.0)
    each = [np.exp(-since / each_s[..., j, None]) for j in range(each_s.shape[-1])]
    return np.where(time > 0, sum(each) / len(each), 0.0)


def _readout(chain: Chain, added: Callable[[Array, Array], Array]) -> Chain:
    return chain.with_readout(lambda reading, time, die_c: reading + added(reading, time))


def _lag_in_series(form: Form, chain: Chain, p: Arrays) -> Chain:
    if form.driver == "airflow":  # the exchange with the air holds it back: size is its resistance over the body's own
        return replace(chain, biot=1.0 / np.maximum(p["size"] * _scale(form, chain, p), LEAST_RESISTANCE))
    if form == MEAN:
        over_s = float(p["time_constant_s"].flat[0])  # the same for every candidate
        return replace(chain, averaged=max(round(over_s / chain.channel.reading_period_s), 1))
    if ("history", "linear") in form.depends_on:  # evenly, and over after that time
        air = chain.channel.conditions
        ramp_s = np.where(np.isfinite(air.ramp_own_s), air.ramp_own_s, p["time_constant_s"] * air.ramp_ratio)
        return replace(chain, ramp_s=ramp_s)
    lag_s = np.maximum(p["time_constant_s"] * _scale(form, chain, p), SHORTEST_LAG_S)
    return replace(chain, series=(*chain.series, lag_s))


def _parallel_lag(form: Form, chain: Chain, p: Arrays) -> Chain:
    scale = _scale(form, chain, p)
    share = np.clip(p["size"] * scale, -0.95, 0.95)
    each_s = times_s(form, p)
    return replace(chain, lags=(*chain.lags, (share, np.broadcast_to(each_s, (*share.shape, each_s.shape[-1])))))


def _rate_change(form: Form, chain: Chain, p: Arrays) -> Chain:
    if ("humidity", "linear") in form.depends_on:  # moves with what the body itself holds, all along a run
        chain = replace(chain, activity_slope=p["humidity"])
    if ("history", "linear") in form.depends_on:  # faster, or slower, the longer the run has lasted
        more = (p["size"] * _scale(form, chain, p))[..., None] / A_MINUTE_S
        since = np.maximum(chain.time_s, 0.0)
        moving = np.minimum(since, SLOWEST_SHARE_LOST / np.maximum(-more, 1e-12))  # it never comes to a stand
        lasted = moving + 0.5 * more * moving**2 + (1.0 + more * moving) * (since - moving)
        return replace(chain, time_s=np.where(chain.time_s > 0, lasted, chain.time_s))
    return replace(chain, rate=chain.rate * np.maximum(_scale(form, chain, p), 1.0 - SLOWEST_SHARE_LOST))


def late_by(form: Form, conditions: Conditions) -> Array:
    """By what the size of a delay is multiplied at the transfer of each run (R,)."""
    return PPM * conditions.start_s if ("history", "linear") in form.depends_on else _grown(form, conditions)


def _grown(form: Form, conditions: Conditions) -> Array:
    """By what a size is multiplied in each run (R,): it may grow from run to run, or with the hours of a campaign."""
    if ("time_of_campaign", "linear") in form.depends_on:
        return np.nan_to_num(conditions.hours)
    return conditions.order if ("run_order", "linear") in form.depends_on else np.ones(conditions.order.shape)


def _delay(form: Form, chain: Chain, p: Arrays) -> Chain:
    if ("history", "linear") in form.depends_on:  # counted from a run's first reading
        since_s = np.maximum(chain.time_s + chain.channel.conditions.start_s[:, None], 0.0)
        return replace(chain, time_s=chain.time_s - PPM * p["size"][..., None] * since_s)
    late_s = p["size"] * late_by(form, chain.channel.conditions) * _scale(form, chain, p)
    if form.driver == "air_humidity":  # the vapour alone: the film is read at its own temperature meanwhile
        return replace(chain, vapour_late_s=late_s)
    return replace(chain, time_s=chain.time_s - late_s[..., None])


def _added_response(form: Form, chain: Chain, p: Arrays) -> Chain:
    """Something leaks in, proportional to a driver, with its own time constant."""
    if ("ambient", "zero_at") in form.depends_on:  # air of another state comes in with the probes and goes
        humid = p.get("humidity", np.full_like(p["ambient"], USUAL_PERCENT))
        share = np.clip(p["size"] * _scale(form, chain, p), 0.0, MOST_LET_IN)
        each = np.moveaxis(times_s(form, p), -1, 0)
        rooms = (RoomAir(share / len(each), one_s, p["ambient"], humid) for one_s in each)
        return replace(chain, rooms=(*chain.rooms, *rooms))
    size = (p["size"] * _scale(form, chain, p))[..., None]
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
        return np.where(time > 0, 1.0 - _relaxed(time, each_s), 0.0)

    if form.driver == "own_response":  # what the reading shows creeps
        return _readout(chain, lambda reading, time: size * reading * come_in(time))
    before, after = (x[:, None] for x in _driver_step(form, chain.channel))
    lasting = 0.0 if creeps else before  # what creeps all along has no level that it began from
    return _readout(chain, lambda reading, time: size * (lasting + (after - before) * come_in(time)))


def _added_rate(form: Form, chain: Chain, p: Arrays) -> Chain:
    """Proportional to a driver's rate of change, which is seen through a lag: (driver - lagged driver) / time constant.

    Without a driver it is what the transfer itself does, and dies away.
    """
    size, each_s = p["size"] * _scale(form, chain, p), times_s(form, p)
    if form.driver == "own_response":
        echoed_s = np.broadcast_to(each_s, (*size.shape, each_s.shape[-1]))
        # What is added is at most about the whole of a response: more is learnt only where hardly anything moves.
        most = p["time_constant_s"] + 1.0 / chain.rate
        return replace(chain, echoes=(*chain.echoes, (-np.clip(size, -most, most) / p["time_constant_s"], echoed_s)))
    before, after = _driver_step(form, chain.channel)
    step = size * (after - before) / (1.0 if form.driver == "none" else p["time_constant_s"])
    return _readout(chain, lambda reading, time: step[..., None] * _relaxed(time, each_s))


def _gain(form: Form, chain: Chain, p: Arrays) -> Chain:
    if form.driver == "die_temperature":  # as the saturation pressure moves from the air's temperature to the die's
        size = (p["size"] * _scale(form, chain, p))[..., None]

        def of_die(reading: Array, time: Array, die_c: Array) -> Array:
            air = np.where(time > 0, chain.destination_c[..., None], chain.source_c[..., None])
            die = np.where(np.isfinite(die_c), die_c, air)
            return np.asarray(reading * (saturation_pressure_hpa(die) / saturation_pressure_hpa(air)) ** size)

        return chain.with_readout(of_die)
    own, middle = ("humidity", USUAL_PERCENT) if chain.channel.jumps_with_air else ("ambient", USUAL_C)
    if form == Form("gain", "own_response", ((own, "linear"),)):  # one that moves with what is read: a bent line
        slope = p["size"][..., None]
        return _readout(chain, lambda reading, time: slope * reading * (reading - middle))
    if ("ambient", "linear") in form.depends_on:  # a gain that moves with the sensor's own temperature
        slope = p["size"][..., None]

        def with_temperature(reading: Array, time: Array, die_c: Array) -> Array:
            air = np.where(time > 0, chain.destination_c[..., None], chain.source_c[..., None])
            return np.asarray(reading * (1.0 + slope * (np.where(np.isfinite(die_c), die_c, air) - USUAL_C)))

        return chain.with_readout(with_temperature)
    if ("humidity", "above") in form.depends_on:  # from a level on: minus one is a ceiling, hard, and less a soft one
        share, above = p["size"][..., None], p["humidity"][..., None]
        return _readout(chain, lambda reading, time: share * np.maximum(reading - above, 0.0))
    zero = p["ambient"][..., None] if ("ambient", "zero_at") in form.depends_on else 0.0
    size = (p["size"] * _grown(form, chain.channel.conditions) * _scale(form, chain, p))[..., None]
    return _readout(chain, lambda reading, time: size * (reading - zero))


def _offset(form: Form, chain: Chain, p: Arrays) -> Chain:
    size = (p["size"] * _grown(form, chain.channel.conditions) * _scale(form, chain, p))[..., None]
    if ("direction", "sign") not in form.depends_on:
        return _readout(chain, lambda reading, time: np.broadcast_to(size, np.broadcast_shapes(size.shape, time.shape)))
    first = (chain.source_percent if chain.channel.jumps_with_air else chain.source_c)[..., None]
    width = p["step"][..., None]
    return _readout(chain, lambda reading, time: size * np.tanh((reading - first) / width))


def _periodic(form: Form, chain: Chain, p: Arrays) -> Chain:
    """A swing that begins with the transfer; driven by the step of the air it dies away."""
    before, after = _driver_step(form, chain.channel)
    size = (p["size"] * (after - before) * _scale(form, chain, p))[..., None]
    turn, phase = 2.0 * np.pi / p["period_s"][..., None], p["phase_rad"][..., None]
    decay = p.get("time_constant_s")

    def swing(reading: Array, time: Array) -> Array:
        alive = (time > 0) if decay is None else _relaxed(time, decay[..., None])
        return np.asarray(size * alive * np.sin(turn * np.maximum(time, 0.0) + phase))

    return _readout(chain, swing)


_BEHAVIOURS: dict[str, Callable[[Form, Chain, Arrays], Chain]] = {
    "lag_in_series": _lag_in_series,
    "parallel_lag": _parallel_lag,
    "added_response": _added_response,
    "added_rate": _added_rate,
    "gain": _gain,
    "offset": _offset,
    "rate_change": _rate_change,
    "delay": _delay,
    "periodic": _periodic,
}


def acting(form: Form) -> Callable[[Chain, Arrays], Chain]:
    """What a form does to a chain.

    Raises
    ------
    ValueError
        Nothing behaves so.
    """
    if form.behaves_as not in _BEHAVIOURS:
        raise ValueError(f"{form.behaves_as!r} is no behaviour that can be computed")
    return partial(_BEHAVIOURS[form.behaves_as], form)
