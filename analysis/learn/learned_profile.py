"""A sensor profile from flights, and what a bench's profile says before them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from shockrig.analysis.effects import CATALOGUE, OF_FLIGHT
from shockrig.analysis.flight.response import LagResponse, bead_response, film_response, reference_stream
from shockrig.analysis.learn.bins import REFERENCE_TEMPERATURE_C
from shockrig.analysis.learn.laws import BESIDE_BEAD, LAWS, descent_from_m_s
from shockrig.analysis.learn.learn import ChannelLearned, FlightCause, FlightsLearned, LearnedNumber
from shockrig.analysis.physics.air_exchange import REFERENCE_C
from shockrig.files.causes import StatedEffect, Uncertain
from shockrig.files.profile import DiffusivityRow, HumidityProfile, Profile, ResponseTime, TemperatureProfile
from shockrig.files.profile_data import BEAD_RADIUS_M, FILM_THICKNESS_M

ROWS_K = 10.0  # between rows of a table of D over temperature
BEYOND_K = 10.0  # colder and warmer than was flown, that the table goes on to
INTO_PROFILE_FROM = 0.5  # probability from which a cause's effect goes into the profile


def stated_by(profile: Profile, temperature_c: float) -> dict[str, tuple[float, float]]:
    """What a bench has found, as `learn` takes it: mean and standard deviation of ln tau; of a film whose D(T) was
    measured at several temperatures, also of tau at 20 degC and how it grows in the cold.

    A profile that states no response time, as one by hand, has the one that its rate makes.
    """
    found = {}
    if (t := profile.temperature) is not None:
        relative = t.thermal_diffusivity_m2_s.standard_uncertainty / t.thermal_diffusivity_m2_s.value
        bead = bead_response(t, reference_stream(REFERENCE_C), profile.bodies["imet"])
        found["temperature.time_constant_s"] = (_log_time(t.response_time_s, bead), relative)
    if (h := profile.humidity) is not None:
        row = min(h.diffusivity_table, key=lambda one: abs(one.ambient_temperature_c - temperature_c))
        relative = row.standard_uncertainty / row.diffusivity_m2_s
        body = profile.bodies["hyt"]

        def log_time(row: DiffusivityRow) -> float:
            at_c = row.ambient_temperature_c
            return _log_time(row.response_time_s, film_response(h, np.array([at_c]), reference_stream(at_c), body))

        found["humidity.time_constant_s"] = (log_time(row), relative)
        rows = [row for row in h.diffusivity_table if row.response_time_s is not None] or list(h.diffusivity_table)
        if len({row.ambient_temperature_c for row in rows}) > 1:
            cold = REFERENCE_TEMPERATURE_C - np.array([row.ambient_temperature_c for row in rows])
            times = np.array([log_time(row) for row in rows])
            known = np.array([max(row.standard_uncertainty / row.diffusivity_m2_s, 1e-3) for row in rows])
            columns = np.column_stack([np.ones(cold.size), cold]) / known[:, None]
            at, growth = np.linalg.lstsq(columns, times / known, rcond=None)[0]
            spread = np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
            off = float(np.std(times - at - growth * cold))  # of the table from a straight line
            found["humidity.lag_in_the_cold.time_constant_s"] = (float(at), float(np.hypot(spread[0], off)))
            slope = np.hypot(spread[1], off / max(float(np.ptp(cold)), 1.0))
            found["humidity.growth_per_k"] = (float(growth), float(slope))
    return {key: (mean, max(sigma, 1e-3)) for key, (mean, sigma) in found.items()}


def _log_time(stated: ResponseTime | None, response: LagResponse) -> float:
    return float(np.log(response.t63_s if stated is None else stated.t63_s))


def learned_profile(
    learned: FlightsLearned, provenance: Mapping[str, Any], bench: Profile | None = None
) -> Profile | None:
    """A profile of first-order sensors with the lags that flights show; a bench's with its rates moved by them.

    None where no flight shows a lag and there is no bench's. A lag that is not identifiable, or that brings
    passes which were not fitted no nearer, is not in it.
    """
    temperature, humidity = (_shown(learned.channels.get(c)) for c in ("temperature", "humidity"))
    if bench is not None:
        return _moved(bench, temperature, humidity, learned, provenance)
    if temperature is None and humidity is None:
        return None
    sensors: dict[str, Any] = {}
    bead = film = None
    if temperature is not None:
        tau = temperature["time_constant_s"]
        alpha = BEAD_RADIUS_M**2 / tau.value
        bead = TemperatureProfile(
            Uncertain(alpha, alpha * tau.standard_uncertainty / tau.value),
            effects=_effects(learned, learned.channels["temperature"], temperature),
        )
        sensors["imet"] = {"kind": "learned from flights", "body": "lumped"}
    if humidity is not None:
        effects = _effects(learned, learned.channels["humidity"], humidity)
        film = HumidityProfile(_table(learned, humidity), effects=effects)
        sensors["hyt"] = {"kind": "learned from flights", "body": "lumped"}
    return Profile(bead, film, sensors, dict(provenance))


def _shown(channel: ChannelLearned | None) -> dict[str, LearnedNumber] | None:
    """Parameters of the likeliest law that gives a channel its lag, where flights show one and the likeliest model has
    a law of the channel: it is that model by which passes came nearer."""
    if channel is None or channel.verdict in ("adequate", "not identifiable") or not channel.gains:
        return None
    if all(law.channel != channel.channel for law in channel.fit.laws):
        return None
    lags = [cause for cause in channel.causes if cause.law.lags is not None]
    return {one.name: one for one in lags[0].parameters} if lags else None


def _table(learned: FlightsLearned, shown: Mapping[str, LearnedNumber]) -> tuple[DiffusivityRow, ...]:
    """D of a first-order film over the temperatures that were flown, and some kelvins beyond."""
    flown = np.concatenate([one.bead_c for one in learned.bins])
    low, high = float(flown.min()) - BEYOND_K, float(flown.max()) + BEYOND_K
    usual_growth = LAWS["humidity.lag_in_the_cold"].parameters[-1]
    tau = shown["time_constant_s"]
    growth = shown.get("growth_per_k")
    rows = []
    for ambient in np.linspace(low, high, max(int(np.ceil((high - low) / ROWS_K)) + 1, 2)):
        cold = REFERENCE_TEMPERATURE_C - ambient
        here, relative = tau.value, tau.standard_uncertainty / tau.value
        if growth is not None:
            middle = REFERENCE_TEMPERATURE_C - float(flown.mean())
            here *= float(np.exp(growth.value * cold))
            # uncertain as it is in the middle of what was flown, and more towards the ends
            relative = float(np.hypot(min(relative, 0.5), growth.standard_uncertainty * (cold - middle)))
        else:
            # a lag that was not seen to grow is as uncertain, away from there, as lags that do
            away = abs(ambient - float(np.clip(ambient, flown.min(), flown.max())))
            relative = float(np.hypot(relative, usual_growth.spread * away))
        d = FILM_THICKNESS_M**2 / here
        rows.append(DiffusivityRow(float(ambient), d, d * relative))
    return tuple(rows)


def _effects(
    learned: FlightsLearned, channel: ChannelLearned, shown: Mapping[str, LearnedNumber]
) -> tuple[StatedEffect, ...]:
    found = []
    if "fraction" in shown:
        second = {"fraction": shown["fraction"], "time_constant_s": shown["second_time_constant_s"]}
        found.append(_effect(LAWS[f"{channel.channel}.second_path"].flown_as, second, None))
    if "film_behind_bead_s" in shown:
        beside = {"behind_s": shown["film_behind_bead_s"], "activity": shown["activity"]}
        late = [cause.parameters[0] for cause in channel.causes if cause.law.flown_as == BESIDE_BEAD]
        if late and any(law.flown_as == BESIDE_BEAD for law in channel.fit.laws):
            beside["time_constant_s"] = late[0]
        stated = {"time_constant_s": Uncertain(0.0)} | {
            key: Uncertain(one.value, one.standard_uncertainty) for key, one in beside.items()
        }
        found.append(StatedEffect(BESIDE_BEAD, stated))
    for cause in channel.causes:
        law = cause.law
        if law.flown_as in ("", BESIDE_BEAD) or law.lags is not None:
            continue
        if cause.probability >= INTO_PROFILE_FROM:
            stated = _stated(cause, learned)
            entry = (CATALOGUE | OF_FLIGHT)[law.flown_as]
            if all(p.low <= stated[p.name].value <= p.high for p in entry.parameters if p.name in stated):
                found.append(StatedEffect(entry.id, stated, cause.probability))
    return tuple(found)


def _stated(cause: FlightCause, learned: FlightsLearned) -> dict[str, Uncertain]:
    """A law's numbers under the names of the effect that flies; how fast a descent is, it shares with the flights."""
    known = {parameter.name for parameter in (CATALOGUE | OF_FLIGHT)[cause.law.flown_as].parameters}
    if "from_m_s" in known:
        (offset,) = cause.parameters
        sinking = [speed for one in learned.bins if np.isfinite(speed := descent_from_m_s(one))]
        return {
            "offset": Uncertain(offset.value, offset.standard_uncertainty),
            "from_m_s": Uncertain(float(np.median(sinking))),
        }
    return {one.name: Uncertain(one.value, one.standard_uncertainty) for one in cause.parameters if one.name in known}


def _effect(name: str, numbers: Mapping[str, LearnedNumber], probability: float | None) -> StatedEffect:
    stated = {key: Uncertain(one.value, one.standard_uncertainty) for key, one in numbers.items()}
    return StatedEffect(name, stated, probability)


def _moved(
    bench: Profile,
    temperature: Mapping[str, LearnedNumber] | None,
    humidity: Mapping[str, LearnedNumber] | None,
    learned: FlightsLearned,
    provenance: Mapping[str, Any],
) -> Profile:
    """A bench's profile, its rates times what the flights moved the response time by."""
    flown = np.concatenate([one.bead_c for one in learned.bins])
    before = stated_by(bench, float(flown.mean()))
    bead, film = bench.temperature, bench.humidity
    if bead is not None and temperature is not None:
        tau = temperature["time_constant_s"]
        alpha = bead.thermal_diffusivity_m2_s.value * np.exp(before["temperature.time_constant_s"][0]) / tau.value
        bead = replace(
            bead,
            thermal_diffusivity_m2_s=Uncertain(float(alpha), float(alpha * tau.standard_uncertainty / tau.value)),
            response_time_s=None,
            effects=(*bead.effects, *_effects(learned, learned.channels["temperature"], temperature)),
        )
    if film is not None and humidity is not None:
        tau, growth = humidity["time_constant_s"], humidity.get("growth_per_k")
        cold = REFERENCE_TEMPERATURE_C - float(flown.mean())
        here = tau.value * (1.0 if growth is None else float(np.exp(growth.value * cold)))
        ratio = float(np.exp(before["humidity.time_constant_s"][0]) / here)
        relative = tau.standard_uncertainty / tau.value
        film = replace(
            film,
            diffusivity_table=tuple(
                replace(
                    row,
                    diffusivity_m2_s=row.diffusivity_m2_s * ratio,
                    standard_uncertainty=row.diffusivity_m2_s * ratio * relative,
                    response_time_s=None,
                )
                for row in film.diffusivity_table
            ),
            effects=(*film.effects, *_effects(learned, learned.channels["humidity"], humidity)),
        )
    return replace(bench, temperature=bead, humidity=film, provenance=dict(provenance))
