"""Heat that the bead gains or loses otherwise than to the air: dew that dries, its own current, light, walls."""

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.effect import Arrays, Effect, InFlight, Needs, Parameter, Words
from shockrig.analysis.physics.air_exchange import DEW_FALLS_K, dew_margin_k, ventilation_ratio
from shockrig.analysis.physics.chain import Chain, Recorded, relative_ventilation
from shockrig.analysis.physics.humidity import ZERO_CELSIUS_K

Array = NDArray[np.float64]

# A wetted bead: after the transfer it reads low by `depression_k` exp(-t / `time_constant_s`) while the water leaves.


def wetted(channel: Recorded) -> Array:
    """1 for the runs (R,) whose destination is known to be below saturation and so lets a wet bead dry, scaled by
    (100 - RH) / 50."""
    air = channel.conditions
    return np.where(dew_margin_k(air) > DEW_FALLS_K, np.clip((100.0 - air.destination_percent) / 50.0, 0.0, 2.0), 0.0)


def _cooled(chain: Chain, p: Arrays) -> Chain:
    def cooled(reading: Array, late: Array, die_c: Array) -> Array:
        decay = np.exp(-np.maximum(late, 0) / p["time_constant_s"][..., None]) * (late > 0)
        return reading - (p["depression_k"] * wetted(chain.channel))[..., None] * decay

    return chain.with_readout(cooled)


EVAPORATIVE_COOLING = Effect(
    id="evaporative_cooling",
    link="body",
    channels=("temperature",),
    equation=(
        "T = T_bead - depression (100 - RH) / 50 exp(-t / time_constant), where the source is below the "
        "destination's dew point"
    ),
    source="a wet thermistor cools below its bath by 0.2 to 0.5 K for up to a minute",
    parameters=(
        Parameter("depression_k", "K", 0.0, 5.0, (0.3,)),
        Parameter("time_constant_s", "s", 1.0, 200.0, (20.0,), log=True, none=None),
    ),
    apply=_cooled,
    words=Words(
        (
            "Dew on the bead evaporates after the transfer: it reads low by {depression_k} K at first, for "
            "{time_constant_s} s."
        ),
        "Keep the probes above the destination's dew point before the transfer.",
    ),
    needs=Needs(
        "needs a source air so moist that dew forms in the destination air",
        lambda channel: bool(((wetted(channel) > 0) & channel.conditions.airs_known).any()),
    ),
    in_flight=InFlight(left=True),
)


# The measuring current warms the bead: reading warmer by rise_k_at_5_m_s F(5 m/s) / F(v).


def _warmed(chain: Chain, at_5_m_s: Array) -> Chain:
    rise = (at_5_m_s / relative_ventilation(chain.channel))[..., None]
    return chain.with_readout(lambda reading, time, die_c: reading + rise)


SELF_HEATING = Effect(
    id="self_heating",
    link="readout",
    channels=("temperature",),
    equation="T = T_bead + rise(5 m/s) F(5 m/s) / F(v)",
    source="power over h A, Ranz and Marshall 1952",
    parameters=(Parameter("rise_k_at_5_m_s", "K", 0.0, 5.0, (0.1,)),),
    apply=lambda chain, p: _warmed(chain, p["rise_k_at_5_m_s"]),
    words=Words(
        "The measuring current warms the bead by {rise_k_at_5_m_s} K at 5 m/s, and more in slower air.",
        "Lower the excitation, or pulse it; check at two excitation powers.",
    ),
    needs=Needs(
        "needs runs whose airs and airflow were recorded",
        lambda channel: bool((channel.conditions.airflow_known & channel.conditions.airs_known).all()),
    ),
    in_flight=InFlight(
        undo=lambda p, reading, stream, radius: reading - p["rise_k_at_5_m_s"] / ventilation_ratio(stream, radius)
    ),
)


# Light on the bead: reading warmer by kelvin_per_w_m2_at_5_m_s E F(5 m/s) / F(v), E from run.json's irradiance_w_m2.

RADIATIVE_HEATING = Effect(
    id="radiative_heating",
    link="readout",
    channels=("temperature",),
    equation="T = T_bead + kappa E F(5 m/s) / F(v)",
    source="absorbed irradiance over h A, Ranz and Marshall 1952",
    parameters=(Parameter("kelvin_per_w_m2_at_5_m_s", "K m2/W", 0.0, 0.01, (3e-4,)),),
    apply=lambda chain, p: _warmed(chain, p["kelvin_per_w_m2_at_5_m_s"] * chain.channel.conditions.irradiance_w_m2),
    words=Words(
        "Light warms the bead by {kelvin_per_w_m2_at_5_m_s} K per W/m2 at 5 m/s.",
        "Shade the bead, or log the irradiance with every run and in flight.",
    ),
    needs=Needs(
        "needs runs under light, with irradiance_w_m2 in run.json",
        lambda channel: bool((channel.conditions.irradiance_w_m2 > 0).any()),
    ),
    in_flight=InFlight(left=True),
)


# Heat radiated between bead and walls: reading off by rise_k_at_10_k for walls 10 K warmer, at 5 m/s.
#
# Walls have a temperature of their own: at one airflow, or where the air is as warm as they are, that is a calibration
# error. Three airflows in air that is warmer or colder than the walls tell the two apart.

PER_10_K = 4.0 * 293.15**3 * 10.0  # K^4 that walls 10 K warmer than 20 degC radiate more, to first order
LEAST_RATIO = 1.5  # of the fastest airflow to the slowest
LEAST_RANGE_K = 10.0  # of the airs in which it varies


def _radiated_to(chain: Chain, p: Arrays) -> Chain:
    weaker = (p["rise_k_at_10_k"] / relative_ventilation(chain.channel))[..., None]
    wall = (p["wall_temperature_c"] + ZERO_CELSIUS_K)[..., None] ** 4

    def radiated(reading: Array, time: Array, die_c: Array) -> Array:
        return reading + weaker * (wall - (reading + ZERO_CELSIUS_K) ** 4) / PER_10_K

    return chain.with_readout(radiated)


def _airflow_varied(channel: Channel) -> bool:
    """Whether the airflow varies in airs that differ, of runs whose airs and airflow were recorded."""
    air = channel.conditions
    slow = air.airflow_m_s < float(np.median(air.airflow_m_s)) / LEAST_RATIO**0.5
    fast = air.airflow_m_s > float(np.median(air.airflow_m_s)) * LEAST_RATIO**0.5
    unusual = slow | fast
    if not (air.airflow_known & air.airs_known).all() or not unusual.any():
        return False
    return bool(np.ptp(np.concatenate([air.source_c[unusual], air.destination_c[unusual]])) > LEAST_RANGE_K)


WALL_RADIATION = Effect(
    id="wall_radiation",
    link="readout",
    channels=("temperature",),
    equation="T = T_bead + rise (T_wall^4 - T_bead^4) / (4 (293.15 K)^3 10 K) F(5 m/s) / F(v)",
    source="Stefan and Boltzmann over h A, Ranz and Marshall 1952; 4 emissivity sigma T^3 is 1.6 % of h at 5 m/s",
    parameters=(
        Parameter("rise_k_at_10_k", "K", 0.0, 3.0, (0.1,)),
        Parameter("wall_temperature_c", "degC", -60.0, 90.0, (21.0,), none=None, prior=(21.0, 10.0)),
    ),
    apply=_radiated_to,
    words=Words(
        (
            "The walls around the bead radiate to it: walls 10 K warmer than the air (they are at "
            "{wall_temperature_c} °C) add {rise_k_at_10_k} K at 5 m/s, and more in slower air."
        ),
        "Shield the bead, keep walls at the air's temperature, or aspirate harder.",
    ),
    needs=Needs(
        "needs recorded airs and airflow, and airflows that differ in air warmer or colder than the walls",
        _airflow_varied,
    ),
    in_flight=InFlight(left=True),
    surroundings=True,
)


EFFECTS = (EVAPORATIVE_COOLING, SELF_HEATING, RADIATIVE_HEATING, WALL_RADIATION)
