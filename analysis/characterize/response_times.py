"""Response times t63, t90, t98 of a fitted chain to a step of the air, at one airflow, temperature and pressure.

The plain chain has them in closed form; with effects the chain is evaluated on a rising step and crossings are read.
What belongs to the bench (slow transfers, room air) is left off; what belongs to the sensor stays.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.fit import Fit
from shockrig.analysis.estimate.model import Held, Model, Point, Structure
from shockrig.analysis.physics.bodies import BODIES
from shockrig.files.profile import ResponseTime

Array = NDArray[np.float64]

SHARES_OF_STEP = (1.0 - np.exp(-1.0), 0.90, 0.98)
USUAL_AIR = {"temperature_c": 20.0, "humidity_percent": 50.0}  # of the quantity that does not step
TIME_STEPS = 3000
SETTLED_SHARE = 1e-5  # of a step, in the second half of the time that is looked at
LONGER_FACTOR = 8  # times at most that it is looked at for longer


@dataclass(frozen=True)
class ResponseAir:
    """The air that a response time is stated for; None is the campaign's: its median airflow and pressure, and of
    temperature what the step goes through (a film: the ambient)."""

    airflow_m_s: float | None = None
    temperature_c: float | None = None
    pressure_hpa: float | None = None


def response_time(channel: Channel, found: Fit, ambient: int) -> ResponseTime:
    """Times [s] to 1 - 1/e, 90 and 98 % of a rising step at one ambient (its index), including the sensor's effects.

    Their standard uncertainties come from the covariance of all parameters that move them.
    """
    times, slopes = response_slopes(channel, found, ambient)
    variance = np.einsum("ki,ij,kj->k", slopes, found.covariance, slopes)
    first, second, third = np.minimum(np.sqrt(np.maximum(variance, 0.0)), 1e3 * times)
    t63, t90, t98 = times.tolist()
    return ResponseTime(t63, t90, t98, (float(first), float(second), float(third)))


def response_slopes(channel: Channel, found: Fit, ambient: int, air: ResponseAir | None = None) -> tuple[Array, Array]:
    """The times [s] (3,) in an air, and by how much theta moves them (3, P)."""
    air = air or ResponseAir()
    times = np.array(_times(channel, found.structure, found.theta, ambient, air))
    of_sensor = set(found.structure.of_sensor().names)
    moving = [found.model.place(name) for name in found.structure.names if name in of_sensor]
    spread = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    low, high = found.model.bounds()
    slopes = np.zeros((times.size, found.theta.size))
    if not moving:
        slopes[:, ambient] = -times  # every time of the plain chain is inverse to the rate
    for i in [ambient, *moving] if moving else []:
        step = max(min(0.2 * float(spread[i]), 0.05), 1e-5)
        ends = np.clip(found.theta[i] + np.array([step, -step]), low[i], high[i])
        moved = []
        for end in ends:
            theta = found.theta.copy()
            theta[i] = end
            moved.append(np.array(_times(channel, found.structure, theta, ambient, air)))
        slopes[:, i] = (moved[0] - moved[1]) / (ends[0] - ends[1]) if ends[0] > ends[1] else 0.0
    return times, slopes


def _times(
    channel: Channel, structure: Structure, theta: Array, ambient: int, air: ResponseAir
) -> tuple[float, float, float]:
    rate = float(np.exp(theta[ambient]))
    kept = structure.of_sensor()
    if not kept.effects:
        t63, t90, t98 = BODIES[channel.body].landmarks
        return t63 / rate, t90 / rate, t98 / rate
    whole = Model(channel, structure)
    values = whole.values(theta, np.zeros((theta.size, theta.size)))
    held = tuple(Held(e.id, name, value) for e in kept.effects for name, (value, _) in values[e.id].items())
    lags = [value for e in kept.effects for name, (value, _) in values[e.id].items() if name == "time_constant_s"]
    slowest = 1.0 / rate + sum(lags)
    for _ in range(LONGER_FACTOR):
        time = np.concatenate([[-100.0 * slowest], np.geomspace(1e-3 / rate, 60.0 * slowest, TIME_STEPS)])
        step = _one_step(channel, ambient, time, air)
        model = Model(step, Structure(kept.effects, held))
        reading = model.predict(Point(theta[model.rates], step.at_rest()))[0, 0]
        since = int(np.searchsorted(time, 0.5 * time[-1]))
        if abs(reading[-1] - reading[since]) < SETTLED_SHARE * abs(reading[-1] - reading[0]):
            break
        slowest *= 4.0  # an exchange far slower than the body: its time is in no parameter
    share = (reading - reading[0]) / (reading[-1] - reading[0])
    # The last crossing counts: a reading that overshoots has not settled yet.
    times = []
    for wanted in SHARES_OF_STEP:
        last = min(int(np.flatnonzero(share < wanted)[-1]), share.size - 2)
        times.append(float(np.interp(wanted, share[last : last + 2], time[last : last + 2])))
    return times[0], times[1], times[2]


def _one_step(channel: Channel, ambient: int, time: Array, air: ResponseAir) -> Channel:
    """A channel of one ideal run: a rising step at one ambient, in the air that is asked for."""
    one = channel.select(np.array([int(np.flatnonzero(channel.ambient == ambient)[0])]))
    usual_c = float(channel.ambients_c[ambient])
    here = np.array([usual_c if air.temperature_c is None else air.temperature_c])
    conditions = channel.conditions
    airflow = float(np.median(conditions.airflow_m_s)) if air.airflow_m_s is None else air.airflow_m_s
    pressure = float(np.median(conditions.pressure_hpa)) if air.pressure_hpa is None else air.pressure_hpa
    changed = {
        "airflow_m_s": np.array([airflow]),
        "pressure_hpa": np.array([pressure]),
        "irradiance_w_m2": np.zeros(1),
        "elsewhere": np.zeros(1, dtype=bool),
        "source_c": here,
        "destination_c": here,
        "source_percent": np.array([USUAL_AIR["humidity_percent"]]),
        "destination_percent": np.array([USUAL_AIR["humidity_percent"]]),
    }
    for name, level in zip(channel.quantity.air_fields, channel.quantity.rise, strict=True):
        if channel.quantity.pooled and air.temperature_c is not None:
            level += air.temperature_c - USUAL_AIR["temperature_c"]
        changed[name] = np.array([level])
    shape = (1, time.size)
    weights = np.zeros((1, channel.rates))
    weights[0, ambient] = 1.0
    return replace(
        one,
        time_s=time[None, :],
        value=np.zeros(shape),
        count=np.ones(shape, dtype=np.int64),
        die_c=np.full(shape, np.nan),
        die_samples=(),
        conditions=replace(one.conditions, **changed),
        interpolation=weights,
        air=(None,),
        common=None,
        reference_known_to=0.0,
        reference_noise=0.0,
        wet_until_s=np.full(1, np.nan),
    )
