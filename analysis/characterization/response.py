"""Response times t63, t90, t98 of a fitted chain to a step of the air, at the campaign's median airflow.

The plain chain has them in closed form; with effects the chain is evaluated on a rising step and crossings are read.
What belongs to the bench (slow transfers, room air) is left off; what belongs to the sensor stays.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.channel import Channel, Conditions
from shockrig.analysis.inference.gls import Fit, Layout, predict
from shockrig.analysis.physics.modes import film_mean, response_times, sphere_core
from shockrig.files.profile import ResponseTime

SHARES = (1.0 - np.exp(-1.0), 0.90, 0.98)
RISE = {"temperature": (15.0, 25.0), "humidity": (40.0, 60.0)}  # degC, %RH


def response_time(channel: Channel, found: Fit, ambient: int) -> ResponseTime:
    """Times [s] to 1 - 1/e, 90 and 98 % of a rising step at one ambient (its index), including the sensor's effects."""
    rate = float(np.exp(found.theta[ambient]))
    of_sensor = [e for e in found.layout.effects if CATALOGUE[e].of_sensor]
    if not of_sensor:
        modes = sphere_core() if channel.name == "temperature" else film_mean()
        return ResponseTime(*(float(t) for t in response_times(modes.scaled(rate))))
    groups = channel.interpolation.shape[1]
    values = found.values(groups)
    layout = Layout(tuple(of_sensor), tuple((e, p, v) for e in of_sensor for p, (v, _) in values[e].items()))
    lags = [v for e in of_sensor for p, (v, _) in values[e].items() if p == "time_constant_s"]
    slowest = 1.0 / rate + max(lags, default=0.0)
    time = np.concatenate([[-100.0], np.geomspace(1e-3 / rate, 60.0 * slowest, 6000)])
    step = _one_step(channel, ambient, time)
    width = found.deviations.shape[1]
    reading = predict(step, layout, found.theta[:groups], np.zeros((1, width)))[0, 0]
    share = (reading - reading[0]) / (reading[-1] - reading[0])
    # The last crossing counts: a reading that overshoots has not settled yet.
    times = []
    for wanted in SHARES:
        last = int(np.flatnonzero(share < wanted)[-1])
        times.append(float(np.interp(wanted, share[last : last + 2], time[last : last + 2])))
    return ResponseTime(*times)


def _one_step(channel: Channel, ambient: int, time: np.ndarray) -> Channel:
    """A channel of one ideal run: a rising step at one ambient and the median airflow."""
    one = channel.select(np.array([int(np.flatnonzero(channel.ambient == ambient)[0])]))
    c = one.conditions
    low, high = RISE[channel.name]
    here = np.array([float(channel.ambients_c[ambient])])
    changed = {
        "airflow_m_s": np.array([float(np.median(channel.conditions.airflow_m_s))]),
        "irradiance_w_m2": np.zeros(1),
        "source_c": np.array([low]) if channel.name == "temperature" else here,
        "destination_c": np.array([high]) if channel.name == "temperature" else here,
        "source_percent": np.array([50.0 if channel.name == "temperature" else low]),
        "destination_percent": np.array([50.0 if channel.name == "temperature" else high]),
    }
    conditions = Conditions(**{k: changed.get(k, getattr(c, k)) for k in Conditions.__dataclass_fields__})
    shape = (1, time.size)
    weights = np.zeros((1, channel.interpolation.shape[1]))
    weights[0, ambient] = 1.0
    return replace(
        one,
        time_s=time[None, :],
        value=np.zeros(shape),
        count=np.ones(shape, dtype=int),
        die_c=np.full(shape, np.nan),
        conditions=conditions,
        interpolation=weights,
    )
