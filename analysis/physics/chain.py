"""The measurement chain air -> exchange -> body -> readout -> logger, evaluated in closed form for many candidates at
once.

The plain model (Segales et al. 2022, Eqs. 1 and 8, doi 10.5194/amt-15-2607-2022) is the chain with nothing added; an
effect replaces fields of the chain. Leading axes are always (candidates B, runs R), times add a last axis n.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.physics import concentration, modes
from shockrig.analysis.physics.humidity import saturation_pressure_hpa

Array = NDArray[np.float64]

KINEMATIC_VISCOSITY_M2_S = 1.5e-5
PRANDTL = 0.71
SHORT_RAMP_S = 0.2  # a change of the air within a sample or two is a jump to whoever samples it
JUMP_K = 0.3  # change of the air's temperature from which RH jumps with it
JUMP_S = 0.05  # this near a jump, five times the trigger's uncertainty, nobody knows on which side of it a sample is


@dataclass(frozen=True)
class RoomAir:
    """Air let in at the transfer: share `fraction` exp(-t / time_constant) of air at the room's state; each (B, 1)."""

    fraction: Array
    time_constant_s: Array
    temperature_c: Array
    humidity_percent: Array


@dataclass(frozen=True)
class Chain:
    """One campaign channel, ready to be evaluated.

    Attributes
    ----------
    channel : Channel
        Conditions, die temperatures and the sampling period.
    time_s : ndarray (B, R, n)
        Time since the air began to change, later links' delays taken off.
    source_c, destination_c, source_percent, destination_percent : ndarray (B, R)
        The two airs.
    rate : ndarray (B, R)
        alpha / R^2 or D / L^2 [1/s] at the destination.
    ramp_s : ndarray (B, 1 or R) or None
        Duration of the transfer [s]; None is a step.
    rooms : tuple of RoomAir
    biot : ndarray (B, R) or None
        Biot number of the exchange; None holds the surface at the air.
    activity_slope : ndarray (B, 1) or None
        Relative slope of D with water activity.
    lags : tuple of (share, time constant [s]), each (B, 1)
        Parts of the body that follow the air as a first-order lag.
    wet_until_s : ndarray (B, R) or None
        Until when a film with dew on it sees saturated air [s]; 0 or less for runs without dew.
    at_die_temperature : bool
        Whether ppmv is turned into RH at the die's temperature.
    readouts : tuple of functions reading (B, R, n) -> reading
        Applied in order.
    averaged : int
        Each logged value is the mean of this many readings.
    """

    channel: Channel
    time_s: Array
    source_c: Array
    destination_c: Array
    source_percent: Array
    destination_percent: Array
    rate: Array
    ramp_s: Array | None = None
    rooms: tuple[RoomAir, ...] = ()
    biot: Array | None = None
    activity_slope: Array | None = None
    lags: tuple[tuple[Array, Array], ...] = ()
    wet_until_s: Array | None = None
    at_die_temperature: bool = False
    readouts: tuple[Callable[[Array], Array], ...] = ()
    averaged: int = 1


def ventilation(airflow_m_s: Array, radius_m: float) -> Array:
    """Nusselt number F = 2 + 0.6 Re^1/2 Pr^1/3 of a sphere (Ranz and Marshall 1952), Re = 2 R v / nu."""
    reynolds = np.maximum(airflow_m_s, 0.0) * 2 * radius_m / KINEMATIC_VISCOSITY_M2_S
    return 2.0 + 0.6 * np.sqrt(reynolds) * PRANDTL ** (1 / 3)


def relative_ventilation(channel: Channel) -> Array:
    """F(v) / F(5 m/s) of each run (R,)."""
    radius = channel.length_m
    return ventilation(channel.conditions.airflow_m_s, radius) / ventilation(np.array(5.0), radius)


def evaluate(chain: Chain) -> Array:
    """Readings of the chain, shape (B, R, n) [degC or %RH]."""
    if chain.averaged > 1:
        period = chain.channel.sampling_period_s
        one = replace(chain, averaged=1)
        shifted = (evaluate(replace(one, time_s=chain.time_s - j * period)) for j in range(chain.averaged))
        return sum(shifted) / chain.averaged
    reading = _temperature(chain) if chain.channel.name == "temperature" else _humidity(chain)
    for readout in chain.readouts:
        reading = readout(reading)
    return reading


def at_jump(chain: Chain) -> NDArray[np.bool_]:
    """Bins (R, n) of the first candidate that stand so near a jump of the reading that they say nothing.

    RH read at the air's temperature jumps with it: 10 K are worth as much as the whole transient.
    """
    time = chain.time_s[0]
    stepped = np.abs(chain.destination_c[0] - chain.source_c[0]) > JUMP_K
    ramp = np.zeros(()) if chain.ramp_s is None else chain.ramp_s[0]
    if chain.channel.name == "temperature" or chain.at_die_temperature or np.max(ramp) > SHORT_RAMP_S:
        return np.zeros(time.shape, dtype=bool)
    # A logger that averages spreads the jump over the readings that it averages.
    shifts = chain.channel.sampling_period_s * np.arange(chain.averaged)
    until = np.broadcast_to(ramp, (time.shape[0],))[:, None] + JUMP_S
    late = [(time - shift > -JUMP_S) & (time - shift < until) for shift in shifts]
    return stepped[:, None] & np.any(late, axis=0) & (chain.channel.count > 0)


def _temperature(chain: Chain) -> Array:
    body = modes.sphere_core() if chain.biot is None else modes.sphere_core_biot(chain.biot)
    response = _with_lags(chain, body.scaled(chain.rate))
    step = (chain.destination_c - chain.source_c)[..., None]
    reading = chain.source_c[..., None] + step * _driven(response, chain.time_s, chain.ramp_s)
    for room in chain.rooms:
        excess = room.fraction * (room.temperature_c - chain.destination_c)
        reading = reading + excess[..., None] * _let_in(chain, response, room)
    return reading


def _humidity(chain: Chain) -> Array:
    body = modes.film_mean() if chain.biot is None else modes.film_mean_biot(chain.biot)
    source_hpa = chain.source_percent * saturation_pressure_hpa(chain.source_c)
    destination_hpa = chain.destination_percent * saturation_pressure_hpa(chain.destination_c)
    rate, time, ramp_s = chain.rate, chain.time_s, chain.ramp_s
    if chain.activity_slope is not None:
        rate, time, ramp_s = _concentration_dependent(chain, source_hpa, destination_hpa)
    response = _with_lags(chain, body.scaled(rate))
    held = source_hpa[..., None] + (destination_hpa - source_hpa)[..., None] * _driven(response, time, ramp_s)
    if chain.wet_until_s is not None:
        wet = np.maximum(chain.wet_until_s, 0.0)[..., None]
        excess = 100.0 * saturation_pressure_hpa(chain.destination_c) - destination_hpa
        held = held + excess[..., None] * (response.step(time) - response.step(time - wet))
    for room in chain.rooms:
        excess = room.fraction * (room.humidity_percent * saturation_pressure_hpa(room.temperature_c) - destination_hpa)
        held = held + excess[..., None] * _let_in(chain, response, room)
    return held / saturation_pressure_hpa(_conversion_temperature(chain))


def _concentration_dependent(
    chain: Chain, source_hpa: Array, destination_hpa: Array
) -> tuple[Array, Array, Array | None]:
    """Rate at the destination's concentration; time, and the ramp's duration, warped so that the linear film gives the
    nonlinear film's mean.
    """
    saturated = saturation_pressure_hpa(chain.destination_c)
    at_source = 1.0 + chain.activity_slope * (source_hpa / saturated / 100.0 - 0.5)
    at_destination = np.maximum(1.0 + chain.activity_slope * (chain.destination_percent / 100.0 - 0.5), 0.05)
    rate = chain.rate * at_destination
    ratio = np.maximum(at_source, 0.05) / at_destination
    if chain.ramp_s is None:
        return rate, chain.time_s * concentration.time_warp(chain.time_s * rate[..., None], ratio[..., None]), None
    # A ramp is a step at its middle; while it lasts the film takes up as fast as it does at first.
    early = concentration.time_warp(np.zeros(()), ratio[..., None])
    middle = 0.5 * chain.ramp_s[..., None]
    late = np.maximum(chain.time_s - middle, 0.0)
    warp = concentration.time_warp(late * rate[..., None], ratio[..., None])
    return rate, np.minimum(chain.time_s, middle) * early + late * warp, chain.ramp_s * early[..., 0]


def _with_lags(chain: Chain, response: modes.Modes) -> modes.Modes:
    for share, time_constant_s in chain.lags:
        response = modes.mix(response, modes.first_order(time_constant_s), share)
    return response


def _driven(response: modes.Modes, time: Array, ramp_s: Array | None) -> Array:
    """Response to the unit transfer."""
    if ramp_s is None:
        return _shared(modes.Modes.step, response, time)
    return _shared(modes.Modes.ramp, response, time, ramp_s)


def _shared(form, response: modes.Modes, time: Array, *arguments: Array) -> Array:
    """A closed form for all candidates; those that differ only in what it is multiplied with share one evaluation."""
    keys = (response.amplitude, response.rate, time, *arguments)
    count = max(key.shape[0] if key.ndim > 1 else 1 for key in keys)
    whole = [key.ndim > 1 and key.shape[0] == count for key in keys]
    if count < 3:
        return form(response, time, *arguments)
    same = np.ones(count, dtype=bool)
    for key, full in zip(keys, whole, strict=True):
        if full:
            same &= (key == key[:1]).reshape(count, -1).all(axis=1)
    own = np.flatnonzero(~same)
    pick = np.concatenate([[0], own])
    place = np.zeros(count, dtype=int)
    place[own] = np.arange(1, pick.size)
    amplitude, rate, *rest = (key[pick] if full else key for key, full in zip(keys, whole, strict=True))
    return form(modes.Modes(amplitude, rate), *rest)[place]


def _let_in(chain: Chain, response: modes.Modes, room: RoomAir) -> Array:
    """Response to a room's air that comes in with the transfer and decays from its start."""
    if chain.ramp_s is None:
        return _shared(modes.Modes.exponential, response, chain.time_s, room.time_constant_s)
    return _shared(modes.Modes.exponential, response, chain.time_s, room.time_constant_s, chain.ramp_s)


def _conversion_temperature(chain: Chain) -> Array:
    time = chain.time_s
    if chain.ramp_s is None:
        progress = (time > 0).astype(float)
    else:
        progress = np.clip(time / np.maximum(chain.ramp_s[..., None], 1e-6), 0.0, 1.0)
    air = chain.source_c[..., None] + (chain.destination_c - chain.source_c)[..., None] * progress
    for room in chain.rooms:
        share = room.fraction[..., None] * np.exp(-np.maximum(time, 0) / room.time_constant_s[..., None])
        air = air + progress * share * (room.temperature_c - chain.destination_c)[..., None]
    if chain.at_die_temperature:
        die = chain.channel.die_c
        air = np.where(np.isfinite(die), die, air)
    return air
