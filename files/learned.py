"""What flights said of their sensor (`shock-learned/1`, learned.json): what it may be, and the air's sizes.

Of the air, `sizes` are logarithms of variances over the square of the channel's `unit`, as `analysis.learn.density` has
them: the rough walk and the smooth one over `altitude_m`, the change of all of the air and of its layers over
`minutes`, eddies, noise.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shockrig.files.causes import PROBABILITY
from shockrig.files.discovered import interval, plain
from shockrig.files.file_table import FileTable, is_number
from shockrig.files.json_files import read_json, write_json
from shockrig.files.ranges import LIKELY_RANGES, RANGES, Range

LEARNED_FORMAT = "shock-learned/1"
LEARNED_CHANNELS = ("temperature", "humidity")
SIZES = ("walk", "smooth_walk", "drift", "layers", "eddies", "noise")
VERDICTS = ("named", "tied", "described", "not identifiable", "adequate")
LOGARITHM = Range(-60.0, 60.0)  # of a variance over the channel's: more is no air and no sensor
MINUTES = Range(0.01, 1e5, "is it in seconds")
REMEDY = "write it anew with shockrig learn"
_LEVEL = {"temperature": RANGES["temperature_c"], "humidity": RANGES["humidity_reading_percent"]}


@dataclass(frozen=True)
class RivalModel:
    """A model of the sensor that may be right: keys of its laws, their parameters in their own units, probability."""

    laws: tuple[str, ...]
    values: Mapping[str, float]
    probability: float


@dataclass(frozen=True)
class StatedNumber:
    """A number of a law in its own unit."""

    value: float
    standard_uncertainty: float
    unit: str


@dataclass(frozen=True)
class StatedLaw:
    """A law that may act: its key, what would give it, and the numbers of the likeliest model that has it."""

    law: str
    would_be: tuple[str, ...]
    probability: float
    equation: str
    source: str
    would_decide: str
    parameters: Mapping[str, StatedNumber]


@dataclass(frozen=True)
class StatedPosition:
    """What may shift altitude against the readings, and whether it is named."""

    named: bool = False
    causes: tuple[StatedLaw, ...] = ()


@dataclass(frozen=True)
class PassesApart:
    """Later pass less the earlier one [K or %RH]: mean, and standard deviation about each flight's own."""

    mean: float
    about_it: float


@dataclass(frozen=True)
class GainOnNextFlight:
    """How far apart the model leaves passes of a next flight, over how far they are as read: 90 % from low to high."""

    ratio: float
    low: float
    high: float


@dataclass(frozen=True)
class StatedFlight:
    """A flight that was learned from."""

    name: str
    minutes: float
    climbs_m_s: tuple[float, ...]


@dataclass(frozen=True)
class StatedModel:
    """Laws of a whole model, joined by +, and its weight."""

    laws: str
    weight: float


@dataclass(frozen=True)
class LearnedChannel:
    """What flights said of one channel.

    Attributes
    ----------
    verdict : str
    unit : float
        The channel's spread along a flight [K or %RH].
    sizes : tuple of float
        Logarithms, as `SIZES`.
    rivals : tuple of RivalModel
        Most probable first.
    mean : float, optional
        Mean of the readings [degC or %RH].
    why, causes, refuted, passes_disagree, gain
        For readers and other programs; `read_learned` leaves them empty.
    """

    verdict: str
    unit: float
    sizes: tuple[float, ...]
    rivals: tuple[RivalModel, ...]
    mean: float | None = None
    why: str = ""
    causes: tuple[StatedLaw, ...] = ()
    refuted: tuple[str, ...] = ()
    passes_disagree: Mapping[str, PassesApart] = field(default_factory=dict)
    gain: GainOnNextFlight | None = None


@dataclass(frozen=True)
class StatedBeside:
    """How two sensors side by side differ, second less first, and what this one's flights say of it alone.

    `offset` is between their calibrations; `lag_ratio` the second's time constant over the first's, None where one of
    them shows no lag.
    """

    offset: StatedNumber
    lag_ratio: StatedNumber | None
    alone: str
    alone_causes: tuple[StatedLaw, ...] = ()


@dataclass(frozen=True)
class LearnedFile:
    """What flights said of their sensor.

    Attributes
    ----------
    channels : mapping of channel -> LearnedChannel
    altitude_m : tuple
        From where to where they flew, above the sea.
    home : tuple, optional
        Latitude [deg], longitude [deg], altitude above the sea [m] where they began.
    minutes : float, optional
        Median length of a flight.
    position, flights, left_out, models, beside, provenance
        For readers and other programs; `read_learned` leaves them empty.
    """

    channels: Mapping[str, LearnedChannel]
    altitude_m: tuple[float, float]
    home: tuple[float, float, float] | None = None
    minutes: float | None = None
    position: StatedPosition = StatedPosition()
    flights: tuple[StatedFlight, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    models: tuple[StatedModel, ...] = ()
    beside: Mapping[str, StatedBeside] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)


def write_learned(learned: LearnedFile, path: Path) -> None:
    """Write a learned.json."""
    write_json(path, {"format": LEARNED_FORMAT, **plain(learned)}, indent=2)


def read_learned(path: str | os.PathLike[str]) -> LearnedFile:
    """Read a learned.json.

    Raises
    ------
    InputError
        Names the file, the key, what was expected, and the remedy.
    """
    table = read_json(path, LEARNED_FORMAT, REMEDY)
    under = table.mapping("channels")
    channels = {name: _channel(name, under, item) for name, item in table.children("channels")}
    if not channels:
        raise table.error("channels", f"one or more of {', '.join(LEARNED_CHANNELS)}", table.get("channels"), REMEDY)
    altitude_m = interval(table, "altitude_m")
    if altitude_m is None or altitude_m[0] == altitude_m[1]:
        raise table.error(
            "altitude_m", "two altitudes above the sea, the lower one first", table.get("altitude_m"), REMEDY
        )
    return LearnedFile(channels, altitude_m, _home(table), table.number("minutes", MINUTES))


def _channel(name: str, under: FileTable, item: FileTable) -> LearnedChannel:
    if name not in LEARNED_CHANNELS:
        raise under.refuse(name, f"no channel; expected {' or '.join(LEARNED_CHANNELS)}", REMEDY)
    sizes = item.sequence("sizes")
    if len(sizes) != len(SIZES) or not all(is_number(one) and LOGARITHM.holds(one) for one in sizes):
        raise item.error("sizes", f"{len(SIZES)} logarithms ({', '.join(SIZES)})", sizes, REMEDY)
    return LearnedChannel(
        verdict=item.word("verdict", VERDICTS),
        unit=item.demand("unit", item.number("unit", positive=True)),
        sizes=tuple(float(one) for one in sizes),
        rivals=tuple(_rival(one) for one in item.items("rivals")),
        mean=item.number("mean", _LEVEL[name]),
    )


def _rival(item: FileTable) -> RivalModel:
    values = item.mapping("values")
    return RivalModel(
        laws=item.texts("laws"),
        values={name: values.demand(name, values.number(name)) for name in values.content},
        probability=item.demand("probability", item.number("probability", PROBABILITY)),
    )


def _home(table: FileTable) -> tuple[float, float, float] | None:
    place = table.get("home")
    if place is None:
        return None
    within = (Range(-89.0, 89.0), Range(-180.0, 180.0), LIKELY_RANGES["altitude_m"])  # as a mission takes them
    if (
        not isinstance(place, list)
        or len(place) != len(within)
        or not all(is_number(one) and possible.holds(one) for one, possible in zip(place, within, strict=True))
    ):
        raise table.error("home", "latitude [deg], longitude [deg], altitude above the sea [m]", place, REMEDY)
    return float(place[0]), float(place[1]), float(place[2])
