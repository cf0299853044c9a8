"""The two quantities that a campaign measures, and everything in which their channels differ.

A run differs a little from its neighbours: its random effects are named here, column by column.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.physics.air_exchange import Conditions
from shockrig.analysis.physics.chain import Airs, Chain, MeasuredAir
from shockrig.analysis.physics.humidity import saturation_pressure_hpa
from shockrig.analysis.physics.readings import humidity_reading, temperature_reading
from shockrig.files.campaign import Campaign, Run, Trace

Array = NDArray[np.float64]
ChannelName = Literal["temperature", "humidity"]


class RunEffect(IntEnum):
    """Columns of a run's random effects: how late it starts [s], ln of its rate, and how far its airs are off.

    STRENGTH is by how much the one effect of the model that differs from run to run is stronger than usual, in the unit
    of its strength.
    DRIFT is what an air that nobody recorded changes by from the transfer to the record's end, in steps of the run.
    Where the air was measured, DESTINATION is how far off the air was that the sensor had settled to before its record.
    """

    START = 0
    RATE = 1
    SOURCE = 2
    DESTINATION = 3
    STRENGTH = 4
    DRIFT = 5
    DESTINATION_C = 6


RUN_EFFECT_NAMES = ("start", "rate", "source", "destination", "strength", "drift", "destination temperature")


@dataclass(frozen=True)
class Quantity:
    """One measured quantity.

    Attributes
    ----------
    name, sensor, file, column : str
        Of the channel, the sensor in campaign.json, its file, and its column there.
    length : str
        What the sensing body's length is called in `Campaign`.
    reference_lag, reference_uncertainty : str
        What is known of the instrument that measures the airs, as `Reference` calls it.
    noun, symbol : str
        What the sensing body is called, and the diffusivity that is fitted.
    instrument : str
        What the sensor is called where nobody knows its body.
    followed : str
        What of the air the sensor has to follow: a film that warms at constant vapour has nothing to take up.
    unit : str
        Of differences.
    resolution : float
        To which the sensor itself rounds.
    least_step : float
        A smaller change of the air says nothing of a rate.
    air_scatter, unknown_air_scatter : float
        Standard uncertainty of an air that was recorded, and of one taken from a plateau.
    usual_air : float
        Of an air of which nothing at all is known.
    settled_within : float
        Drift of a plateau from which on it has not settled.
    air_fields : (str, str)
        Names in `Conditions` of the two airs that the channel is driven by.
    rise : (float, float)
        The ideal step by which response times are stated.
    pooled : bool
        Whether one rate holds at all ambients.
    run_steps : tuple of float
        Finite differences of the random effects, in their order.
    reading : function Chain -> ndarray
    airs : function (Conditions, random effects (..., R, U)) -> Airs
    step : function Conditions -> ndarray (R,)
        Size of each run's step, signed, that the sensor has to follow.
    """

    name: ChannelName
    sensor: str
    file: str
    column: str
    length: str
    reference_lag: str
    reference_uncertainty: str
    noun: str
    symbol: str
    instrument: str
    followed: str
    unit: str
    resolution: float
    least_step: float
    air_scatter: float
    unknown_air_scatter: float
    usual_air: float
    settled_within: float
    air_fields: tuple[str, str]
    rise: tuple[float, float]
    pooled: bool
    run_steps: tuple[float, ...]
    reading: Callable[[Chain], Array]
    airs: Callable[[Conditions, Array], Airs]
    step: Callable[[Conditions], Array]

    def recorded(self, run: Run) -> Trace | None:
        """What the sensor recorded of a run."""
        trace: Trace | None = getattr(run, self.sensor)
        return trace

    def of_air(self, air: MeasuredAir) -> Array:
        """This quantity of a measured air (m,)."""
        values: Array = getattr(air, self.column)
        return values

    @property
    def run_effects(self) -> int:
        """How many random effects a run has."""
        return len(self.run_steps)

    def diffusivity_label(self, ambient_c: float) -> str:
        """What a fitted diffusivity is called: its symbol, with the ambient where each has its own."""
        return self.symbol if self.pooled else f"{self.symbol} at {round(ambient_c, 1) + 0.0:.1f} °C"

    def air_step(self, conditions: Conditions) -> Array:
        """Change of the air's own quantity in each run (R,)."""
        source, destination = self.air_fields
        step: Array = getattr(conditions, destination) - getattr(conditions, source)
        return step

    def air_scatters(self, conditions: Conditions) -> tuple[Array, Array]:
        """Standard uncertainties of the two airs of each run (R,)."""
        source, destination = self.air_fields
        return getattr(conditions, f"{source}_scatter"), getattr(conditions, f"{destination}_scatter")


def _temperature_airs(c: Conditions, deviations: Array) -> Airs:
    source = c.source_c + deviations[..., RunEffect.SOURCE]
    return Airs(
        source_c=source,
        destination_c=c.destination_c + deviations[..., RunEffect.DESTINATION],
        source_percent=np.broadcast_to(c.source_percent, source.shape),
        destination_percent=np.broadcast_to(c.destination_percent, source.shape),
    )


def _temperature_step(c: Conditions) -> Array:
    return c.thermal_step_k


def _humidity_airs(c: Conditions, deviations: Array) -> Airs:
    return Airs(
        source_c=np.broadcast_to(c.source_c, deviations.shape[:-1]),
        destination_c=c.destination_c + deviations[..., RunEffect.DESTINATION_C],
        source_percent=c.source_percent + deviations[..., RunEffect.SOURCE],
        destination_percent=c.destination_percent + deviations[..., RunEffect.DESTINATION],
    )


def _taken_up(c: Conditions) -> Array:
    """%RH at the destination's temperature that the film has to take up."""
    held = c.source_percent * saturation_pressure_hpa(c.source_c) / saturation_pressure_hpa(c.destination_c)
    return c.destination_percent - held


TEMPERATURE = Quantity(
    name="temperature",
    sensor="imet",
    file="imet.csv",
    column="temperature_c",
    length="bead_radius_m",
    reference_lag="temperature_time_constant_s",
    reference_uncertainty="temperature_standard_uncertainty_k",
    noun="bead",
    symbol="alpha",
    instrument="thermometer",
    followed="temperature",
    unit="K",
    resolution=0.01,
    least_step=0.3,
    air_scatter=0.02,
    unknown_air_scatter=3.0,
    usual_air=20.0,
    settled_within=0.15,
    air_fields=("source_c", "destination_c"),
    rise=(15.0, 25.0),
    pooled=True,
    run_steps=(1e-4, 1e-4, 1e-3, 1e-3, 1e-3, 1e-4),
    reading=temperature_reading,
    airs=_temperature_airs,
    step=_temperature_step,
)
HUMIDITY = Quantity(
    name="humidity",
    sensor="hyt",
    file="hyt.csv",
    column="humidity_percent",
    length="film_thickness_m",
    reference_lag="humidity_time_constant_s",
    reference_uncertainty="humidity_standard_uncertainty_percent",
    noun="film",
    symbol="D",
    instrument="hygrometer",
    followed="vapour",
    unit="%RH",
    resolution=100.0 / 16383.0,
    least_step=1.0,
    air_scatter=0.1,
    unknown_air_scatter=10.0,
    usual_air=50.0,
    settled_within=0.8,
    air_fields=("source_percent", "destination_percent"),
    rise=(40.0, 60.0),
    pooled=False,
    run_steps=(1e-4, 1e-4, 1e-2, 1e-2, 1e-3, 1e-4, 1e-3),
    reading=humidity_reading,
    airs=_humidity_airs,
    step=_taken_up,
)
QUANTITIES: dict[ChannelName, Quantity] = {"temperature": TEMPERATURE, "humidity": HUMIDITY}


def looked_for(campaign: Campaign) -> tuple[ChannelName, ...]:
    """The channels that a campaign is about: of sensors that it states or has readings of, both where there are none.

    What is not among them is no loss: a log of a thermometer alone lacks no hygrometer.
    """
    return tuple(
        name
        for name, quantity in QUANTITIES.items()
        if quantity.sensor in campaign.sensors or any(quantity.recorded(run) is not None for run in campaign.runs)
    ) or tuple(QUANTITIES)
