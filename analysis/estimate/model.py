"""A model of one channel: the plain chain with effects, some of their parameters held; and a point in its space.

`theta` holds ln rates of the ambients, then the effects' free parameters on the scale that is fitted, then what may be
off in all runs alike (`Shared`); a run's random effects stand beside it, with columns as in `RunEffect`.

A common late trigger, or an air that its reference always gives too high, moves every run's random effect by the same
amount c. With c in theta, under its prior N(0, u^2), no effect can gain by explaining what such an error explains, and
its share of every uncertainty is counted. An airflow, a pressure or a clock that is always off is not to be seen: its
share is the estimate's shift, -H^-1 d2/dtheta dq, with the input perturbed and the prediction looked at again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import Effect, Parameter
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.analysis.physics.bodies import BODIES
from shockrig.analysis.physics.chain import Chain, MeasuredAir, evaluate
from shockrig.files.common_uncertainty import CommonUncertainty

# A trigger is good to 10 ms from run to run; this much of it may be the same in every run, whatever is stated: it is
# no more than the sensors' own lines and buses are late, and no fit can see it.
LEAST_TRIGGER_OFFSET_S = 0.004
TRIGGER = "trigger_offset_s"
OWN_AIR = {"temperature": "air_temperature_k", "humidity": "air_humidity_percent"}
# Standard uncertainties that a common error may be fitted from none. What is off by more is no error of the bench: it
# is left to the effects, which unseen runs could else not bear out.
MOST_SIGMAS = 3.0


@dataclass(frozen=True)
class Shared:
    """A common error that is fitted along: its key in campaign.json, its standard uncertainty, which random effects it
    moves, and of each of them 1 for runs (R,) in which it does and 0 for others."""

    name: str
    standard_uncertainty: float
    moves: Mapping[RunEffect, NDArray[np.bool_]]


def shared(channel: Channel) -> tuple[Shared, ...]:
    """The common errors that a model of the channel has in theta: those that the campaign states, and without a
    statement what the reference beside the probes is known to, which is one instrument in all runs.

    A trigger is not late in runs that nobody triggered, nor an air off that nobody recorded.
    """
    stated, air, measured = channel.common, channel.conditions, channel.measured
    known = air.airs_known & ~measured & (stated is not None)
    found = [
        Shared(
            OWN_AIR[channel.name],
            air_known_to(channel),
            {RunEffect.SOURCE: known | measured, RunEffect.DESTINATION: known},
        )
    ]
    if stated is not None and stated.trigger_offset_s > LEAST_TRIGGER_OFFSET_S:
        found.insert(0, Shared(TRIGGER, stated.trigger_offset_s, {RunEffect.START: air.start_known & ~measured}))
    return tuple(one for one in found if one.standard_uncertainty > 0)


def air_known_to(channel: Channel) -> float:
    """What all of a campaign's airs may be off by alike, a standard uncertainty in the channel's unit; 0 where nothing
    is stated of it."""
    if channel.common is None:
        return channel.reference_known_to
    return float(getattr(channel.common, OWN_AIR[channel.name]))


def common_beside(channel: Channel) -> CommonUncertainty:
    """The common errors of a channel's models as a campaign states them: runs to come are made beside the same bench
    and reference."""
    known = air_known_to(channel)
    return channel.common or CommonUncertainty(known, known, 0.0, 0.0, 0.0, 0.0)


def _warmer(channel: Channel, by_k: float) -> Channel:
    air = channel.conditions
    moved = replace(air, source_c=air.source_c + by_k, destination_c=air.destination_c + by_k)
    traces = tuple(None if a is None else replace(a, temperature_c=a.temperature_c + by_k) for a in channel.air)
    return replace(channel, conditions=moved, air=traces)


def _moister(channel: Channel, by_percent: float) -> Channel:
    air = channel.conditions
    source, destination = air.source_percent + by_percent, air.destination_percent + by_percent
    moved = replace(air, source_percent=source, destination_percent=destination)
    traces = tuple(
        None if a is None else replace(a, humidity_percent=a.humidity_percent + by_percent) for a in channel.air
    )
    return replace(channel, conditions=moved, air=traces)


def _windier(channel: Channel, by_percent: float) -> Channel:
    air = channel.conditions
    factor = np.where(air.airflow_known, 1.0 + by_percent / 100.0, 1.0)
    return replace(channel, conditions=replace(air, airflow_m_s=air.airflow_m_s * factor))


def _denser(channel: Channel, by_hpa: float) -> Channel:
    air = channel.conditions
    return replace(channel, conditions=replace(air, pressure_hpa=air.pressure_hpa + by_hpa))


def _later(channel: Channel, by_s: float) -> Channel:
    triggered = channel.conditions.start_known & ~channel.measured
    return replace(channel, time_s=channel.time_s - by_s * triggered[:, None])


def _slower(channel: Channel, by_ppm: float) -> Channel:
    """True times where the clock's own are too many by so many millionths."""
    keep = 1.0 - 1e-6 * by_ppm

    def trace(air: MeasuredAir | None) -> MeasuredAir | None:
        return None if air is None else replace(air, time_s=air.time_s * keep)

    return replace(channel, time_s=channel.time_s * keep, air=tuple(trace(a) for a in channel.air))


# Key in campaign.json: (the channel as it is where the input is truly that much higher, step of the finite difference).
PERTURBED_INPUTS: dict[str, tuple[Callable[[Channel, float], Channel], float]] = {
    "air_temperature_k": (_warmer, 0.01),
    "air_humidity_percent": (_moister, 0.1),
    "airflow_percent": (_windier, 0.1),
    "pressure_hpa": (_denser, 1.0),
    TRIGGER: (_later, 1e-4),
    "clock_ppm": (_slower, 100.0),
}


Array = NDArray[np.float64]

LOG_RATE_BOUNDS = (-18.0, 8.0)


@dataclass(frozen=True)
class Held:
    """A parameter of an effect that is not fitted."""

    effect: str
    parameter: str
    value: float


@dataclass(frozen=True)
class Point:
    """Where in a model's space a prediction is made.

    Attributes
    ----------
    theta : ndarray (P,) or (B, P)
        B candidates at once.
    deviations : ndarray (R, U) or (B, R, U)
        The runs' random effects.
    """

    theta: Array
    deviations: Array


@dataclass(frozen=True)
class Structure:
    """What a model adds to the plain chain: effects in the order of the chain, and what is held."""

    effects: tuple[Effect, ...] = ()
    held: tuple[Held, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "effects", tuple(sorted(self.effects, key=lambda e: e.order)))

    @cached_property
    def ids(self) -> tuple[str, ...]:
        """Of its effects."""
        return tuple(effect.id for effect in self.effects)

    @cached_property
    def scattering(self) -> Effect | None:
        """The effect whose strength differs from run to run; None where none does."""
        return next((effect for effect in self.effects if effect.scatters), None)

    @cached_property
    def parameters(self) -> tuple[tuple[Effect, Parameter], ...]:
        """Those that are fitted, in the order of theta behind the rates."""
        held = {(h.effect, h.parameter) for h in self.held}
        return tuple((e, p) for e in self.effects for p in e.parameters if (e.id, p.name) not in held)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """`effect.parameter` of each."""
        return tuple(f"{effect.id}.{parameter.name}" for effect, parameter in self.parameters)

    def adding(self, effect: Effect, *held: Held) -> Structure:
        """With one more effect."""
        return Structure((*self.effects, effect), (*self.held, *held))

    def keeping(self, ids: set[str] | frozenset[str]) -> Structure:
        """With only the effects `ids`."""
        return Structure(tuple(e for e in self.effects if e.id in ids), tuple(h for h in self.held if h.effect in ids))

    def dropping(self, id_: str) -> Structure:
        """Without one of its effects."""
        return self.keeping(set(self.ids) - {id_})

    def of_sensor(self) -> Structure:
        """What flies with the sensor, without the bench's."""
        return self.keeping({e.id for e in self.effects if e.of_sensor})

    def held_values(self, id_: str) -> dict[str, float]:
        """Values of an effect's held parameters."""
        return {h.parameter: h.value for h in self.held if h.effect == id_}


PLAIN = Structure()


def _slowed_s(channel: Channel) -> Array | None:
    """How long each run's air takes to change (1, R) [s], where some were slowed on purpose; others take no time."""
    own = channel.conditions.ramp_own_s
    return np.nan_to_num(own)[None] if np.isfinite(own).any() else None


@dataclass(frozen=True)
class Model:
    """A structure on a channel: encoding, bounds, and prediction at a point."""

    channel: Channel
    structure: Structure = field(default=PLAIN)

    @cached_property
    def shared(self) -> tuple[Shared, ...]:
        """What may be off in all runs alike and is fitted along, in the order of theta behind the parameters."""
        return shared(self.channel)

    @cached_property
    def size(self) -> int:
        """Length of theta, P."""
        return self.channel.rates + len(self.structure.parameters) + len(self.shared)

    @property
    def rates(self) -> slice:
        """Where the ln rates stand in theta."""
        return slice(0, self.channel.rates)

    @property
    def names(self) -> tuple[str, ...]:
        """Of theta: `ln rate` at each ambient, then `effect.parameter`, then keys of what all runs share."""
        common = (one.name for one in self.shared)
        return (*("ln rate" for _ in range(self.channel.rates)), *self.structure.names, *common)

    def place(self, name: str) -> int:
        """Where a parameter `effect.parameter` stands in theta."""
        return self.channel.rates + self.structure.names.index(name)

    @property
    def behind(self) -> slice:
        """Where what all runs share stands in theta."""
        return slice(self.size - len(self.shared), self.size)

    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper ends of theta."""
        own = [(p.encoded(p.low), p.encoded(p.high)) for _, p in self.structure.parameters]
        own += [
            (-MOST_SIGMAS * one.standard_uncertainty, MOST_SIGMAS * one.standard_uncertainty) for one in self.shared
        ]
        low, high = zip(*[LOG_RATE_BOUNDS] * self.channel.rates, *own, strict=True)
        return np.array(low), np.array(high)

    def reach(self) -> Array:
        """How far one step of a fit may go in each coordinate of theta."""
        own = [1.5 if p.log else 0.3 * (p.high - p.low) for _, p in self.structure.parameters]
        own += [MOST_SIGMAS * one.standard_uncertainty for one in self.shared]
        return np.array([1.0] * self.channel.rates + own)

    def steps(self) -> Array:
        """Finite differences of theta."""
        own = [1e-4 if p.log else 1e-5 * (p.high - p.low) for _, p in self.structure.parameters]
        own += [1e-3 * one.standard_uncertainty for one in self.shared]
        return np.array([1e-4] * self.channel.rates + own)

    def priors(self) -> tuple[Array, Array]:
        """What is known of theta before any data: means, and weights 1 / variance that are 0 where nothing is."""
        mean, weight = np.zeros(self.size), np.zeros(self.size)
        for i, (_, parameter) in enumerate(self.structure.parameters, start=self.channel.rates):
            if parameter.prior is not None:
                mean[i], weight[i] = parameter.prior[0], 1.0 / parameter.prior[1] ** 2
        weight[self.behind] = [1.0 / one.standard_uncertainty**2 for one in self.shared]
        return mean, weight

    def start(self, log_rates: ArrayLike, choice: Mapping[str, float] | None = None) -> Array:
        """theta from ln rates (G,) and each parameter's first start, or `choice` by "effect.parameter"."""
        own = [p.encoded((choice or {}).get(f"{e.id}.{p.name}", p.starts[0])) for e, p in self.structure.parameters]
        return np.concatenate([np.asarray(log_rates, dtype=float), own, np.zeros(len(self.shared))])

    def choice(self, theta: Array) -> dict[str, float]:
        """{"effect.parameter": value} at one theta (P,)."""
        values = theta[self.channel.rates : self.behind.start]
        return {
            name: float(np.exp(x) if p.log else x)
            for name, (_, p), x in zip(self.structure.names, self.structure.parameters, values, strict=True)
        }

    def values(self, theta: Array, covariance: Array) -> dict[str, dict[str, tuple[float, float]]]:
        """{effect: {parameter: (value, standard uncertainty)}} in the parameters' own units."""
        found: dict[str, dict[str, tuple[float, float]]] = {effect.id: {} for effect in self.structure.effects}
        for i, (effect, parameter) in enumerate(self.structure.parameters, start=self.channel.rates):
            spread = float(np.sqrt(max(covariance[i, i], 0.0)))
            value = float(np.exp(theta[i]) if parameter.log else theta[i])
            found[effect.id][parameter.name] = (value, value * spread if parameter.log else spread)
        for held in self.structure.held:
            if held.effect in found:
                found[held.effect][held.parameter] = (held.value, 0.0)
        return found

    def chain(self, point: Point) -> Chain:
        """The chain at a point of B candidates."""
        channel, theta = self.channel, point.theta
        deviations = self._with_shared(theta, point.deviations)
        rate = np.exp(theta[:, self.rates] @ channel.interpolation.T + deviations[..., RunEffect.RATE])
        before = None
        if channel.measured.any():  # where the air was measured, what it was before takes the destination's place
            before = np.where(channel.measured, point.deviations[..., RunEffect.DESTINATION], 0.0)
            deviations = np.array(deviations)
            deviations[..., channel.measured, RunEffect.DESTINATION] = 0.0
        airs = channel.quantity.airs(channel.conditions, deviations)
        drift = None
        if channel.may_drift.any():
            drift = np.where(channel.may_drift, deviations[..., RunEffect.DRIFT] * self._step, 0.0)
        chain = Chain(
            channel=channel,
            time_s=channel.time_s - deviations[..., RunEffect.START][..., None],
            source_c=airs.source_c,
            destination_c=airs.destination_c,
            source_percent=airs.source_percent,
            destination_percent=airs.destination_percent,
            rate=rate,
            body=BODIES[channel.body],
            air_offset=deviations[..., RunEffect.SOURCE],
            die_c=channel.die_c,
            before=before,
            drift=drift,
            by_chance=deviations[..., RunEffect.STRENGTH],
            ramp_s=_slowed_s(channel),
        )
        values: dict[str, dict[str, Array]] = {effect.id: {} for effect in self.structure.effects}
        for i, (effect, parameter) in enumerate(self.structure.parameters, start=channel.rates):
            column = theta[:, i : i + 1]
            values[effect.id][parameter.name] = np.exp(column) if parameter.log else column
        for held in self.structure.held:
            if held.effect in values:
                values[held.effect][held.parameter] = np.full((theta.shape[0], 1), held.value)
        for effect in self.structure.effects:
            chain = effect.apply(chain, values[effect.id])
        return chain

    @cached_property
    def _step(self) -> Array:
        """How large each run's step of the air is (R,), as it was recorded or as its plateaus say."""
        quantity = self.channel.quantity
        return np.maximum(np.abs(quantity.step(self.channel.conditions)), quantity.least_step)

    def _with_shared(self, theta: Array, deviations: Array) -> Array:
        """The runs' random effects (B, R, U) with what all of them share."""
        if not self.shared:
            return deviations
        moved = np.broadcast_to(deviations, (max(theta.shape[0], deviations.shape[0]), *deviations.shape[1:])).copy()
        for one, off in zip(self.shared, theta.T[self.behind], strict=True):
            for effect, where in one.moves.items():
                moved[..., effect] += off[:, None] * where
        return np.asarray(moved)

    def predict(self, point: Point) -> Array:
        """Predicted readings (B, R, n) at a point."""
        theta, deviations = np.atleast_2d(point.theta), np.asarray(point.deviations)
        deviations = deviations[None] if deviations.ndim == 2 else deviations
        shape = (max(theta.shape[0], deviations.shape[0]), *self.channel.time_s.shape)
        chain = self.chain(Point(theta, deviations))
        return np.broadcast_to(evaluate(chain, self.channel.quantity.reading), shape)

    def on(self, channel: Channel) -> Model:
        """The same structure on another channel (other runs, other times)."""
        return replace(self, channel=channel)
