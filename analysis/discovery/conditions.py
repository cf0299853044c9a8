"""Whole conditions that can be held out: all runs of one airflow, one ambient, one direction, one kind."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.discovery.grammar import varied
from shockrig.analysis.inference.channel import Channel

SAME_AIRFLOW_LN = 0.1  # of the logarithm of two airflows that are one condition
LEAST_TRAINED = 6  # runs that are left to fit to
LEAST_P_VALUE = 1e-3  # of so much by accident, above which a finding is none


def held_out(channel: Channel, factors: set[str]) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    """Names and runs (R,) of the conditions that a description may be tried on."""
    c, there = channel.conditions, varied(channel)
    if "airflow" in there:
        levels = np.round(np.log(np.maximum(c.airflow_m_s, 0.05)) / SAME_AIRFLOW_LN)
        if np.unique(levels).size > 2 or "airflow" not in factors:
            for level in np.unique(levels):
                runs = levels == level
                if runs.sum() < channel.runs - LEAST_TRAINED:
                    yield f"airflow {c.airflow_m_s[runs].mean():.2g} m/s", runs
    if "ambient" in there and channel.quantity.pooled:
        ambient = np.round(c.destination_c / 2.0)
        if np.unique(ambient).size > 2 or "ambient" not in factors:
            for level in np.unique(ambient):
                yield f"ambient {c.destination_c[ambient == level].mean():.0f} degC", ambient == level
    if "direction" in there and not factors & {"direction", "humidity"}:
        up = channel.quantity.step(c) > 0
        yield "steps upwards", up
        yield "steps downwards", ~up
    if "step" in there and "step" not in factors:
        size = np.abs(channel.quantity.step(c))
        yield "small steps", size < 0.5 * size.max()
    if channel.jumps_with_air and channel.isothermal.any() and (~channel.isothermal).any():
        yield "thermal shocks", ~channel.isothermal
        yield "isothermal shocks", channel.isothermal
