"""What an effect is: one change to one link of the chain, with its parameters, where it can be seen, and what to do."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.inference.channel import Channel, ChannelName
from shockrig.analysis.physics.chain import Chain

Array = NDArray[np.float64]
Link = Literal["air", "exchange", "body", "readout", "logger"]


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    `starts` are the values a fit begins from; `log` fits a positive scale in its logarithm; `none` is the value at
    which the effect vanishes, where it has one.
    """

    name: str
    unit: str
    low: float
    high: float
    starts: tuple[float, ...]
    log: bool = False
    none: float | None = 0.0


@dataclass(frozen=True)
class Effect:
    """One entry of the catalogue.

    Attributes
    ----------
    id, link : str
        Name and link of the chain: air, exchange, body, readout or logger.
    channels : tuple of channel names
        Where it can be seen.
    parameters : tuple of Parameter
    apply : function (chain, {name: ndarray (B, 1)}) -> chain
        The chain with the effect added.
    sentence : str
        What a colleague would say, with {name} places for parameters.
    equation, source, advice : str
        The equation added, where it comes from, and what to do about it on the bench.
    testable : function (channel) -> bool
        Whether the campaign's conditions let the effect act at all.
    start_from : function (channel) -> {parameter: start}, optional
        A start that only the data can give, in place of those of the parameters; empty where they give none.
    refused : function (channel, {parameter: value}) -> bool, optional
        True where a fit that ends there is no finding, whatever it gains.
    from_readings : bool
        True where the single readings show it (rounding, repeats, averages, flat tops) and not the mean response.
    of_sensor : bool
        True where it belongs to the sensor and flies with it; False where it belongs to the bench.
    """

    id: str
    link: Link
    channels: tuple[ChannelName, ...]
    parameters: tuple[Parameter, ...]
    apply: Callable[[Chain, Mapping[str, Array]], Chain]
    sentence: str
    equation: str
    source: str
    advice: str
    testable: Callable[[Channel], bool] = lambda channel: True
    start_from: Callable[[Channel], Mapping[str, float]] | None = None
    refused: Callable[[Channel, Mapping[str, float]], bool] | None = None
    from_readings: bool = False
    of_sensor: bool = True


def unchanged(chain: Chain, values: Mapping[str, Array]) -> Chain:
    """The chain as it is, for effects of the single readings that leave the mean response alone."""
    return chain


PAPER = "Segales et al. 2022, doi 10.5194/amt-15-2607-2022"
