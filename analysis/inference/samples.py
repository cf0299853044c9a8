"""The fitted model at every single sample, where fits work on bins: for plots, residuals and the RMSE of Eq. (17)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.inference.bins import as_single_samples
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.fit import Fit

Array = NDArray[np.float64]


def model_at_samples(channel: Channel, found: Fit) -> tuple[Array, ...]:
    """Model readings [channel's unit] at each run's samples, each run's own deviations included."""
    model = found.model.on(as_single_samples(channel)).predict(found.point)[0]
    return tuple(model[i, : t.size] for i, (t, _) in enumerate(channel.samples))


def rmse_over_samples(channel: Channel, found: Fit) -> float:
    """Root mean square of reading - model over the samples that the fit used [channel's unit]."""
    models = model_at_samples(channel, found)
    squares = [
        ((value - model)[place >= 0]) ** 2
        for (_, value), model, place in zip(channel.samples, models, channel.bin_of, strict=True)
    ]
    return float(np.sqrt(np.concatenate(squares).mean()))
