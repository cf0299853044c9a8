"""The sensor as a correction sees it: first-order lags behind the air, changing along a flight, stepped exactly.

reading = sum_k w_k q_k, dq_k/dt = rate_k (u - q_k), sum_k w_k = 1: the closed forms of `analysis.physics.bodies` with
w_k = -a_k, cut to the slowest few. u is the air, or the inside of a cap or a sheath that the body does not load, itself
a mix of lags behind the air; a sheath that the body loads is in the body's own modes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.effect import Values
from shockrig.analysis.flight.undo_readout import Acting, Stated, acting, propagated
from shockrig.analysis.physics.air_exchange import REFERENCE_AIRFLOW_M_S, Stream
from shockrig.analysis.physics.bodies import BODIES, Body
from shockrig.analysis.physics.modes import Modes, first_order, in_series, slowest
from shockrig.files.profile import HumidityProfile, TemperatureProfile

Array = NDArray[np.float64]

# A sensor's lags stepped exactly from sample to sample: q' = decay q + fed cap + old air + new air'.
#
# The air is straight (or held) over a step. Lags follow the air, or the inside of a cap: a mix v of lags x_j behind
# the air. Behind those a lag of rate lambda gains v_j E_j x_j in a step h, with E_j = lambda (exp(-mu_j h) -
# exp(-lambda h)) / (lambda - mu_j), which has no pole where the rates are equal.


@dataclass(frozen=True)
class LagStep:
    """Coefficients of one step of K lags, of which the first J are a cap's and the next M follow its inside.

    Attributes
    ----------
    old, new, decay : ndarray (..., K)
        What the air before and after the step, and the lag itself, add to the lag.
    fed : ndarray (..., M, J)
        What each of the cap's lags adds to each lag inside.
    """

    old: Array
    new: Array
    decay: Array
    fed: Array


def hold(rate: Array, step_s: Array) -> tuple[Array, Array, Array]:
    """(old, new, decay) of lags behind air that is straight over the step; shapes broadcast."""
    x = np.maximum(rate * step_s, 1e-12)
    decay = np.expm1(-x)
    gone = -decay
    new = 1.0 - gone / x
    small = x < 1e-4  # the difference loses its digits there
    if small.any():
        new = np.where(small, x / 2 - x**2 / 6, new)
    decay += 1.0
    gone -= new
    return gone, new, decay


def stepped(rate: Array, step_s: Array, cap: tuple[float, ...] = (), inside: int = 0) -> LagStep:
    """One step of lags `rate` (..., K) over `step_s` (...), air straight; `cap` is the mix v of the first lags."""
    h = np.asarray(step_s, dtype=float)[..., None]
    old, new, decay = hold(rate, h)
    count = len(cap)
    if not count:
        return LagStep(old, new, decay, np.zeros((*old.shape[:-1], 0, 0)))
    within = slice(count, count + inside)
    fed = np.asarray(cap) * handed_on(rate[..., within], rate[..., :count], h)
    # Inside, the drive is v_j (x_j's straight line, 1/mu_j late, and its decaying rest): x_j's own share is `fed`.
    shares = np.asarray(cap)[None, :] * -np.expm1(-rate[..., within, None] * h[..., None])
    late = ((fed - shares) / np.maximum(rate[..., None, :count] * h[..., None], 1e-12)).sum(axis=-1)
    old[..., within] -= fed.sum(axis=-1) + late
    new[..., within] += late
    return LagStep(old, new, decay, fed)


def handed_on(inner: Array, outer: Array, step_s: Array) -> Array:
    """E (..., M, J): what a lag of rate `outer` (..., J) hands on in a step to one of rate `inner` (..., M) behind it.

    `step_s` is (..., 1).
    """
    first, second, h = inner[..., :, None], outer[..., None, :], step_s[..., None]
    apart = np.maximum(np.abs(first - second) * h, 1e-12)
    return first * h * np.exp(-np.minimum(first, second) * h) * -np.expm1(-apart) / apart


def held_matrix(rate: Array, period_s: float, cap: tuple[float, ...] = (), inside: int = 0) -> Array:
    """Transition (K, K) of one instant's lags `rate` (K,) over a period; air that is held adds 1 - its row sums."""
    step = stepped(rate, np.array(period_s), cap, inside)
    matrix = np.diag(step.decay)
    count = len(cap)
    matrix[count : count + inside, :count] = step.fed
    return matrix


Rows = NDArray[np.int64] | slice | tuple[None, slice]
CORE_MODES = 4  # of a body read at its core, whose faster modes have hardly begun to matter
MEAN_MODES = 6
BIOT_STEP = 0.01  # airspeed and density are followed in steps of 1 % of the Biot number
LEAST_BIOT = 1e-6


@dataclass(frozen=True)
class LagResponse:
    """Lags at n instants.

    Attributes
    ----------
    weight, rate : ndarray (n, K)
        Weights in the reading [1] and rates [1/s]: the cap's lags (weight 0), those inside it, those beside it.
    relative_uncertainty : ndarray (n,)
        Standard uncertainty of the time scale, relative.
    slow_uncertainty : ndarray (P,)
        Of the shares of the reading that the last P lags carry.
    cap : tuple of float
        Mix v of the first lags that makes the air inside a cap; its rates are the same at all instants.
    inside : int
        How many of the next lags follow that air.
    body : str
        Shape that the lags come from, a key of `BODIES`; empty where they come from none.
    """

    weight: Array
    rate: Array
    relative_uncertainty: Array
    slow_uncertainty: Array = field(default_factory=lambda: np.zeros(0))
    cap: tuple[float, ...] = ()
    inside: int = 0
    body: str = ""

    def at(self, rows: Rows) -> LagResponse:
        """The response at some of the instants; `rows` may have any shape."""
        return replace(
            self,
            weight=self.weight[rows],
            rate=self.rate[rows],
            relative_uncertainty=self.relative_uncertainty[rows],
        )

    def slower(self, by: float, uncertainty: float) -> LagResponse:
        """The same with a time scale longer by the share `by`, which a flight itself told within `uncertainty`; slow
        shares beside it stay."""
        rate, own = self.rate.copy(), self.rate.shape[-1] - self.slow_uncertainty.size
        rate[..., :own] /= 1.0 + by
        return replace(self, rate=rate, relative_uncertainty=np.hypot(self.relative_uncertainty, uncertainty))

    @property
    def within(self) -> slice:
        """Columns of the lags that follow the inside of the cap."""
        return slice(len(self.cap), len(self.cap) + self.inside)

    @cached_property
    def slow_s(self) -> Array:
        """Time constant (n,) at each instant of the slowest lag that at least 20 % of the reading passes."""
        passing = self.weight.copy()
        through = np.abs(self.weight[..., self.within].sum(axis=-1, keepdims=True) * np.asarray(self.cap))
        passing[..., : len(self.cap)] = through
        return np.asarray(np.max(np.where(passing > 0.2, 1.0 / self.rate, 0.0), axis=-1))

    @cached_property
    def slowest_s(self) -> float:
        """The largest of these time constants: the sensor at its slowest."""
        return float(np.max(self.slow_s))

    @cached_property
    def t63_s(self) -> float:
        """Time [s] to 63 % of a step at the first instant."""
        modes = self.modes()
        since = np.geomspace(1e-3, 1e2, 2000) * float(-np.sum(modes.amplitude / modes.rate))
        shown = 1.0 + np.exp(-np.outer(since, modes.rate)) @ modes.amplitude
        return float(since[np.argmax(shown >= 1.0 - np.exp(-1.0))])

    def clean(self, frequency_hz: Array, row: int = 0) -> NDArray[np.complex128]:
        """Transfer function from the air to the reading at one instant, continuous in time."""
        s = 2j * np.pi * np.asarray(frequency_hz)[..., None]
        lags = self.rate[row] / (self.rate[row] + s)
        if self.cap:
            lags[..., self.within] *= lags[..., : len(self.cap)] @ np.asarray(self.cap)[:, None]
        return np.asarray(np.sum(self.weight[row] * lags, axis=-1))

    def modes(self, row: int = 0) -> Modes:
        """Response to a step of the air at one instant as modes (K,), rates ascending."""
        weight, rate, count = self.weight[row], self.rate[row], len(self.cap)
        parts = [Modes(-weight[self.within.stop :], rate[self.within.stop :])]
        if self.inside:
            share = float(weight[self.within].sum())
            body = Modes(-weight[self.within] / share, rate[self.within])
            for mix, outer in zip(self.cap, rate[:count], strict=True):
                behind = in_series(body, 1.0 / outer)
                parts.append(Modes(share * mix * behind.amplitude, behind.rate))
        amplitude = np.concatenate([p.amplitude for p in parts])
        rates = np.concatenate([p.rate for p in parts])
        order = np.argsort(rates)
        return Modes(amplitude[order], rates[order])


def reference_stream(temperature_c: float) -> Stream:
    """One instant at the airflow that rates are stated for."""
    return Stream(np.array([REFERENCE_AIRFLOW_M_S]), temperature_c=np.array([temperature_c]))


def bead_response(part: TemperatureProfile, stream: Stream, body: str = "sphere") -> LagResponse:
    """Response of the thermometer in each air that flows past it (n,); `body` is the shape of the plain model."""
    alpha = part.thermal_diffusivity_m2_s
    still = np.ones(stream.airflow_m_s.size)
    rate, relative = alpha.value / part.bead_radius_m**2, alpha.standard_uncertainty / alpha.value
    effects = acting(part.effects, "temperature", part.discovered)
    usual = np.broadcast_to(stream.temperature_c, still.shape)
    return _response(effects, body, part.bead_radius_m, rate * still, relative * still, stream, usual)


def film_response(part: HumidityProfile, temperature_c: Array, stream: Stream, body: str = "film") -> LagResponse:
    """Response of the hygrometer at each air temperature and stream (n,).

    Beyond the table the outer row's D is held; `body` is the shape of the plain model.
    """
    diffusivity, uncertainty = part.diffusivity_m2_s(temperature_c, outside="hold")
    rate, relative = diffusivity / part.film_thickness_m**2, uncertainty / diffusivity
    effects = acting(part.effects, "humidity", part.discovered)
    return _response(effects, body, part.film_thickness_m, rate, relative, stream, temperature_c)


def unsure_of_airspeed(response: Callable[[Stream], LagResponse], stream: Stream, unsure: float) -> float:
    """Relative standard uncertainty of the mean lag that an airspeed leaves whose ln is unsure by `unsure`."""
    if unsure == 0.0:
        return 0.0

    def mean_lag_s(factor: float) -> float:
        speed = np.full(1, factor * float(np.median(stream.airflow_m_s)))
        here = Stream(
            speed, np.median(stream.pressure_hpa, keepdims=True), np.median(stream.temperature_c, keepdims=True)
        )
        modes = response(here).modes()
        return float(-np.sum(modes.amplitude / modes.rate))

    return 0.5 * abs(float(np.log(mean_lag_s(np.exp(unsure)) / mean_lag_s(np.exp(-unsure)))))


def _few(body: Body) -> int:
    """How many modes a flight takes of a body: a core's alternate in sign and fall off fast in time."""
    return CORE_MODES if np.any(body.held().amplitude > 0) else MEAN_MODES


def _response(
    effects: tuple[Acting, ...],
    name: str,
    length_m: float,
    rate: Array,
    relative: Array,
    stream: Stream,
    temperature_c: Array,
) -> LagResponse:
    for e in effects:
        if (moves := e.meaning.rate) is not None:
            rate = rate * moves(e.values, stream.airflow_m_s, temperature_c)
            relative = np.hypot(relative, _moved(e, moves, stream.airflow_m_s, temperature_c))
    body = BODIES[next((e.meaning.body for e in reversed(effects) if e.meaning.body), name)]
    layers, outside, lags = [], [], []
    sheaths = [e.meaning.loaded(e.values) for e in effects if e.meaning.loaded is not None]
    for e in effects:
        if e.meaning.biot is not None or e.meaning.exchange is not None:
            layers.append(e)
        if e.meaning.series_s is not None:
            outside.append((e, e.meaning.series_s(e.values)))
        if e.meaning.lag is not None:
            share, *each_s = e.meaning.lag(e.values)
            lags.append((e, share, np.array(each_s)))

    modes, rows, few = body.held(), np.zeros(rate.size, dtype=np.int64), _few(body)
    filmed = any(e.meaning.biot is not None for e in layers)
    biot = np.maximum(_biot(layers, stream, length_m), LEAST_BIOT) if filmed else None
    if sheaths:
        time_constant_s, capacity = sheaths[-1]
        ladder, rows = _steps(body.sheath_time(time_constant_s * rate, capacity, biot))
        modes, few = body.sheathed(ladder, capacity), few + 1
    elif biot is not None:
        ladder, rows = _steps(biot)
        modes = body.behind(ladder)
    modes = slowest(modes, few)
    amplitude = np.broadcast_to(modes.amplitude, modes.rate.shape).reshape(-1, modes.rate.shape[-1])
    weight, rates = -amplitude[rows], modes.rate.reshape(amplitude.shape)[rows] * rate[:, None]

    relative = _time_scale(effects, body, length_m, rate, relative, stream)
    mix, inside = _sheath([time_constant_s for _, time_constant_s in outside]), 0
    if mix.rate.size:
        inside = weight.shape[1]
        weight = np.concatenate([np.zeros((rate.size, mix.rate.size)), weight], axis=1)
        own = np.broadcast_to(mix.rate, (rate.size, mix.rate.size))
        if len(outside) == 1 and (along := outside[0][0].meaning.series_along) is not None:
            own = own / along(outside[0][0].values, stream.airflow_m_s, temperature_c)[:, None]
        rates = np.concatenate([own, rates], axis=1)
    for _, share, times_s in lags:
        beside = np.full((rate.size, times_s.size), 1.0)
        weight = np.concatenate([(1 - share) * weight, share / times_s.size * beside], axis=1)
        rates = np.concatenate([rates, beside / times_s], axis=1)
    # Lags that share a share are taken to be off each by itself; a mean of them is then never too sure.
    slow = np.concatenate([[], *(np.full(t.size, _share_uncertainty(e) / np.sqrt(t.size)) for e, _, t in lags)])
    return LagResponse(weight, rates, relative, slow, tuple(float(-a) for a in mix.amplitude), inside, body.name)


def _moved(one: Acting, moves: Callable[[Values, Array, Array], Array], airspeed: Array, temperature_c: Array) -> Array:
    """Relative standard uncertainty (n,) of what an effect makes of the rate along a flight."""
    return propagated(one, lambda values: np.log(moves(values, airspeed, temperature_c)))


def _sheath(time_constants_s: list[float]) -> Modes:
    """Lags in series between the air and the body, as modes (J,); none where there are none."""
    if not time_constants_s:
        return Modes(np.zeros(0), np.zeros(0))
    first, *rest = time_constants_s
    modes = first_order(first)
    for time_constant_s in rest:
        modes = in_series(modes, time_constant_s)
    return modes


def _biot(layers: Iterable[Acting], stream: Stream, length_m: float) -> Array:
    """Biot number (n,) of all layers together: their resistances add."""
    layers = list(layers)
    numbers = [e.meaning.biot(e.values, stream, length_m) for e in layers if e.meaning.biot is not None]
    factors = [e.meaning.exchange(e.values, stream, length_m) for e in layers if e.meaning.exchange is not None]
    whole = 1.0 / np.sum([1.0 / np.maximum(number, LEAST_BIOT) for number in numbers], axis=0)
    return np.asarray(np.prod([whole, *factors], axis=0))


def _time_scale(
    effects: tuple[Acting, ...], body: Body, length_m: float, rate: Array, relative: Array, stream: Stream
) -> Array:
    """Relative standard uncertainty (n,) of the mean lag behind the air, body and what stands before it together.

    Behind a Biot number the mean lag of a body is that of the held one + 1 / (surface_to_volume Bi), exactly; a lag in
    series adds its time constant. A sheath that the body loads adds (1 + 1 / capacity) of its own, and what passes a
    film outside of it is 1 + capacity as much. Each parameter moves the lag by its own part.
    """
    held = body.held()
    own = float(-np.sum(held.amplitude / held.rate))
    shaping = [e for e in effects if e.meaning.biot or e.meaning.exchange or e.meaning.series_s or e.meaning.loaded]

    def mean_lag_s(effects: Iterable[Acting]) -> tuple[Array, Array]:
        """Of the body with its exchange, and of all together."""
        effects = list(effects)
        lag, filled = np.full(rate.shape, own), 1.0
        outside = sum(e.meaning.series_s(e.values) for e in effects if e.meaning.series_s is not None)
        for time_constant_s, capacity in (e.meaning.loaded(e.values) for e in effects if e.meaning.loaded):
            outside, filled = outside + time_constant_s * (1.0 + 1.0 / capacity), 1.0 + capacity
        if any(e.meaning.biot is not None for e in effects):
            biot = np.maximum(_biot(effects, stream, length_m), LEAST_BIOT)
            lag = lag + filled / (body.surface_to_volume * biot)
        return lag / rate, lag / rate + outside

    of_body, whole = mean_lag_s(shaping)
    variance = (relative * of_body / whole) ** 2
    for i, one in enumerate(shaping):

        def logarithm(values: Stated, i: int = i, one: Acting = one) -> Array:
            changed = [*shaping[:i], replace(one, values=values), *shaping[i + 1 :]]
            return np.log(mean_lag_s(changed)[1])

        variance = variance + propagated(one, logarithm) ** 2
    return np.sqrt(variance)


def _share_uncertainty(effect: Acting) -> float:
    """Of a slow lag's share; a time constant wrong by some percent counts like a share wrong by as many."""
    lag = effect.meaning.lag
    assert lag is not None
    of_share = propagated(effect, lambda values: lag(values)[0])
    of_time = propagated(effect, lambda values: np.log(lag(values)[1:]).mean())
    return float(np.hypot(of_share, lag(effect.values)[0] * of_time))


def _steps(values: Array) -> tuple[Array, NDArray[np.int64]]:
    """Biot numbers (or their like) on a ladder of 1 % steps, and the rung of each; a single value is kept as it is."""
    values = np.maximum(values, LEAST_BIOT)
    if np.all(values == values[0]):
        return values[:1], np.zeros(values.size, dtype=np.int64)
    rung = np.round(np.log(values) / BIOT_STEP).astype(int)
    unique, rows = np.unique(rung, return_inverse=True)
    return np.exp(unique * BIOT_STEP), rows
