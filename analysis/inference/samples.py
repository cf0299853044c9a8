"""The fitted model at every single sample, where fits work on bins: for plots, residuals and the RMSE of Eq. (17)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.gls import Fit, predict

Array = NDArray[np.float64]


def model_at_samples(channel: Channel, found: Fit) -> tuple[Array, ...]:
    """Model readings [channel's unit] at each run's samples, each run's own deviations included."""
    most = max(time.size for time, _ in channel.samples)
    time = np.stack([np.pad(t, (0, most - t.size), mode="edge") for t, _ in channel.samples])
    die = np.full(time.shape, np.nan)
    for i, smooth in enumerate(channel.die_samples):
        die[i, : smooth.size] = smooth
    whole = replace(channel, time_s=time, value=np.zeros(time.shape), count=np.ones(time.shape, dtype=int), die_c=die)
    model = predict(whole, found.layout, found.theta, found.deviations)[0]
    return tuple(model[i, : t.size] for i, (t, _) in enumerate(channel.samples))


def rmse_over_samples(channel: Channel, found: Fit) -> float:
    """Root mean square of reading - model over the samples that the fit used [channel's unit]."""
    models = model_at_samples(channel, found)
    squares = [
        ((value - model)[place >= 0]) ** 2
        for (_, value), model, place in zip(channel.samples, models, channel.bin_of, strict=True)
    ]
    return float(np.sqrt(np.concatenate(squares).mean()))
