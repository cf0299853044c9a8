"""Flights to what they say of their sensor: read, learned, and as the files that `shockrig learn` writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from shockrig.files.errors import InputError
from shockrig.files.flight import Flight

if TYPE_CHECKING:
    from shockrig.analysis.learn.learn import ChannelLearned, FlightCause, FlightsLearned
    from shockrig.files.profile import Profile


def named_flights(
    paths: Sequence[Path], columns: Mapping[str, str] | None = None, map_path: Path | None = None
) -> tuple[dict[str, Flight], list[str]]:
    """Flights by their files' names, and what was read as what.

    Raises
    ------
    InputError
        A log cannot be read, or is named twice.
    """
    from shockrig.protocols.flight_logs import read_log

    flights: dict[str, Flight] = {}
    said: list[str] = []
    for path in paths:
        name = path.name if path.name not in flights else str(path)
        if name in flights:
            raise InputError(f"{path}: named twice; each flight counts once")
        flights[name], notes = read_log(path, columns, map_path)
        said += [f"{name}: {note}" for note in notes]
    return flights, said


def learned_from(
    flights: Mapping[str, Flight], bench: Profile | None = None, progress: Callable[[str], None] = lambda said: None
) -> FlightsLearned:
    """What flights say of their sensor; InputError where none passes the same air twice."""
    from shockrig.analysis.learn.learn import learn
    from shockrig.analysis.learn.profile import stated_by

    stated = None
    if bench is not None:
        temperatures = np.concatenate([one.temperature_c for one in flights.values()])
        known = temperatures[np.isfinite(temperatures)]
        stated = stated_by(bench, float(np.median(known)) if known.size else 20.0)
    try:
        return learn(flights, stated, progress)
    except ValueError as error:
        raise InputError(f"{error}; give flights that go up and come down again through the same air") from error


def learned_document(
    learned: FlightsLearned, flights: Mapping[str, Flight], provenance: Mapping[str, Any]
) -> dict[str, Any]:
    """The JSON document of `shock-learned/1`."""
    from shockrig.files.learned import LEARNED_FORMAT

    altitudes = np.concatenate([one.altitude_m for one in learned.bins])
    document: dict[str, Any] = {
        "format": LEARNED_FORMAT,
        "channels": {name: _channel(one, learned) for name, one in learned.channels.items()},
        "position": {
            "named": learned.position_named,
            "causes": [_cause(one) for one in learned.position],
        },
        "altitude_m": [float(altitudes.min()), float(altitudes.max())],
        "minutes": float(np.median([one.minutes for one in learned.bins])),
        "flights": [
            {"name": one.name, "minutes": one.minutes, "climbs_m_s": [p.climb_m_s for p in one.passes]}
            for one in learned.bins
        ],
        "left_out": dict(learned.left_out),
        "models": [{"laws": said, "weight": weight} for said, weight in learned.weights],
        "provenance": dict(provenance),
    }
    if (home := _home(flights)) is not None:
        document["home"] = home
    return document


def _channel(one: ChannelLearned, learned: FlightsLearned) -> dict[str, Any]:
    from shockrig.analysis.learn.density import MOVES

    units = [i for i, _ in enumerate(one.lag.sizes)]
    values = np.concatenate([b.values[one.channel][b.seen(one.channel)] for b in learned.bins if b.has(one.channel)])
    spreads = [float(np.nanstd(b.values[one.channel])) for b in learned.bins if b.has(one.channel)]
    return {
        "verdict": one.verdict,
        "why": one.why,
        "causes": [_cause(cause) for cause in one.causes],
        "unit": float(np.median(spreads)),
        "mean": float(values.mean()),
        "sizes": np.median([one.lag.sizes[i][:-MOVES] for i in units], axis=0).tolist(),
        "rivals": [
            {"laws": list(rival.laws), "values": dict(rival.values), "probability": rival.probability}
            for rival in one.rivals
        ],
        "refuted": list(one.refuted),
        "passes_disagree": {
            key: {"mean": off.mean, "about_it": off.spread}
            for key, off in (("as_read", one.read), ("one_lag", one.single), ("model", one.model))
        },
    }


def _cause(cause: FlightCause) -> dict[str, Any]:
    return {
        "law": cause.law.key,
        "would_be": list(cause.law.causes),
        "probability": cause.probability,
        "equation": cause.law.equation,
        "source": cause.law.source,
        "would_decide": cause.law.needs,
        "parameters": {
            p.name: {"value": p.value, "standard_uncertainty": p.standard_uncertainty, "unit": p.unit}
            for p in cause.parameters
        },
    }


def _home(flights: Mapping[str, Flight]) -> list[float] | None:
    """Where the first flight with a position began: latitude, longitude [deg], altitude [m]."""
    for one in flights.values():
        if one.latitude_deg is None or one.longitude_deg is None or one.altitude_m is None:
            continue
        known = np.flatnonzero(np.isfinite(one.latitude_deg + one.longitude_deg + one.altitude_m))
        if known.size:
            first = known[0]
            return [float(one.latitude_deg[first]), float(one.longitude_deg[first]), float(one.altitude_m[first])]
    return None


def disagree(one: ChannelLearned) -> str:
    """How far passes of a flight disagree, in a sentence."""
    unit = "K" if one.channel == "temperature" else "%RH"
    parts = [
        f"{name} by {off.mean:+.2g} on average and {off.spread:.2g} {unit} about it"
        for name, off in (("as read", one.read), ("with one lag", one.single), ("with the model", one.model))
    ]
    said = f"passes of flights that were not fitted differ {', '.join(parts)}"
    if one.verdict != "adequate" and not one.gains:
        said += ": no gain, so the profile leaves this channel as it is read"
    elif one.verdict != "adequate" and one.model.rms > one.read.rms:
        said += ": nearer in their structure, and on average farther apart than as read"
    return said


def sentence(one: ChannelLearned) -> str:
    """A channel's verdict in a sentence."""
    said = ", or ".join(_said(cause) for cause in one.causes)
    if one.verdict == "adequate":
        return f"{one.channel}: adequate: no lag above {one.limit_s:.2g} s, and nothing else shows"
    if one.verdict == "not identifiable":
        others = f"; it may be: {said}" if said else ""
        return f"{one.channel}: a lag is not identifiable from these flights: {one.why}{others}"
    return f"{one.channel}: {one.verdict}: {said}"


def _said(cause: FlightCause) -> str:
    numbers = ", ".join(f"{p.value:.3g} ± {p.standard_uncertainty:.2g} {p.unit}" for p in cause.parameters)
    names = " or ".join(name.replace("_", " ") for name in cause.law.causes)
    if cause.law.key == "lag_in_the_cold":
        names = "a lag that grows in the cold"
    elif cause.law.key == "second_path":
        names = f"a second path ({names})"
    return f"{names} ({numbers}; probability {cause.probability:.2f})"
