"""The sensor profile (`sensor-profile/1`) read and written: the one place for both. What it holds is in profile_data.

Keys that the format does not know are ignored, but for one that is nearly a key that is missing: that is a slip.
Unknown values are left out.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from shockrig.files.campaign_names import DEFAULT_BODIES, read_body
from shockrig.files.causes import StatedEffect, Uncertain, effect_document, read_effect, uncertain_document
from shockrig.files.discovered import plain, read_discovered
from shockrig.files.errors import InputError
from shockrig.files.file_table import FileTable
from shockrig.files.headline import headlines
from shockrig.files.json_files import as_object, known, read_json, write_json
from shockrig.files.misspelt import CAMPAIGN_KEYS
from shockrig.files.profile_data import (
    BEAD_RADIUS_M,
    FILM_THICKNESS_M,
    DiffusivityRow,
    HumidityProfile,
    ProfileData,
    ResponseTime,
    TemperatureProfile,
)
from shockrig.files.profile_views import plot_profile, profile_card, profile_dataset, profile_frame
from shockrig.files.ranges import RANGES, Range

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

__all__ = [
    "FORMAT",
    "DiffusivityRow",
    "StatedEffect",
    "HumidityProfile",
    "Profile",
    "ResponseTime",
    "TemperatureProfile",
    "Uncertain",
    "effect_document",
    "profile_document",
    "profile_from_document",
    "read_profile",
    "write_profile",
]

LEAST_APART_K = 1e-6  # rows of the table: a slope between them must be a number
FORMAT = "sensor-profile/1"
ASSUMED_RELATIVE_UNCERTAINTY = 0.05  # of a diffusivity whose file gives no standard uncertainty
LARGEST_RELATIVE_UNCERTAINTY = 1e6  # beyond it nothing was measured, and arithmetic would not survive it
OF_BOTH = ("response_time_s", "sampling_period_s", "effects", "discovered")  # keys of either sensor
REMEDY = "give the profile.json that shockrig characterize or learn wrote"


@dataclass(frozen=True, repr=False)
class Profile(ProfileData):
    """A pair of sensors; either part may be missing."""

    def to_frame(self) -> pd.DataFrame:
        """One row for the bead (alpha) and one for each ambient of the film (D), with uncertainty, response times."""
        return profile_frame(self)

    def to_xarray(self) -> xr.Dataset:
        """D(T), response times and alpha as labelled arrays with units; needs xarray."""
        return profile_dataset(self)

    def plot(self) -> Figure:
        """D over temperature with its uncertainty and as it is interpolated; response times."""
        return plot_profile(self)

    def __repr__(self) -> str:
        return f"<Profile: {'; '.join(f'{name} {value}' for name, value in headlines(self))}>"

    def _repr_html_(self) -> str:
        return profile_card(self)


def read_profile(path: str | os.PathLike[str]) -> Profile:
    """Read and check a profile; keys that the format does not know are ignored, where they are no slips.

    Raises
    ------
    InputError
        Names the file, the key, what was expected and the remedy.

    See Also
    --------
    write_profile : with an example of both.
    """
    return _profile(read_json(path, FORMAT, REMEDY))


def profile_from_document(document: object, source: str = "profile") -> Profile:
    """A Profile from the parsed JSON; `source` names it in errors, which are those of `read_profile`."""
    return _profile(as_object(document, source, FORMAT, REMEDY))


def write_profile(profile: Profile, path: str | os.PathLike[str]) -> None:
    """Write a profile; the file appears whole or not at all.

    Raises
    ------
    ValueError
        A number is not finite.
    OSError
        The disk does not take it.

    Examples
    --------
    A bead of 0.4 mm that is known alone, written and read:

    >>> import tempfile
    >>> from shockrig.files.profile import Profile, TemperatureProfile, Uncertain, read_profile, write_profile
    >>> profile = Profile(temperature=TemperatureProfile(Uncertain(7.5e-8, 2e-10), bead_radius_m=4e-4))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_profile(profile, f"{folder}/profile.json")
    ...     read_profile(f"{folder}/profile.json").temperature.thermal_diffusivity_m2_s
    Uncertain(value=7.5e-08, standard_uncertainty=2e-10)
    """
    write_json(Path(path), profile_document(profile), indent=2)


def profile_document(profile: Profile) -> dict[str, Any]:
    """The profile as the JSON document of `sensor-profile/1`; unknown values are left out."""
    document: dict[str, Any] = {"format": FORMAT, "sensors": dict(profile.sensors)}
    if (t := profile.temperature) is not None:
        document["temperature"] = known(
            bead_radius_m=t.bead_radius_m,
            thermal_diffusivity_m2_s=uncertain_document(t.thermal_diffusivity_m2_s),
            response_time_s=None if t.response_time_s is None else _response_document(t.response_time_s),
            noise_k=t.noise_k,
            sampling_period_s=t.sampling_period_s,
            effects=[effect_document(e) for e in t.effects],
            discovered=[plain(one) for one in t.discovered] or None,
        )
    if (h := profile.humidity) is not None:
        document["humidity"] = known(
            film_thickness_m=h.film_thickness_m,
            diffusivity_table=[
                known(
                    ambient_temperature_c=row.ambient_temperature_c,
                    diffusivity_m2_s=row.diffusivity_m2_s,
                    standard_uncertainty=row.standard_uncertainty,
                    runs=row.runs,
                )
                for row in h.diffusivity_table
            ],
            response_time_s=[
                {"ambient_temperature_c": row.ambient_temperature_c} | _response_document(row.response_time_s)
                for row in h.diffusivity_table
                if row.response_time_s is not None
            ],
            noise_percent=h.noise_percent,
            sampling_period_s=h.sampling_period_s,
            effects=[effect_document(e) for e in h.effects],
            discovered=[plain(one) for one in h.discovered] or None,
        )
    document["provenance"] = dict(profile.provenance)
    return document


def _profile(top: FileTable) -> Profile:
    top.know_nearly("format", "sensors", "temperature", "humidity", "provenance")
    temperature = None if (part := top.child("temperature")) is None else _temperature(part)
    humidity = None if (part := top.child("humidity")) is None else _humidity(part)
    if temperature is None and humidity is None:
        raise InputError(
            f"{top.source}: neither temperature nor humidity is there; a profile holds at least one of them"
        )
    sensors, provenance = top.get("sensors"), top.get("provenance")
    if isinstance(sensors, dict):
        for name in DEFAULT_BODIES:
            if isinstance(sensors.get(name), dict):
                sensor = top.mapping("sensors").mapping(name)
                sensor.know_nearly(*CAMPAIGN_KEYS[f"sensors.{name}."])
                read_body(sensor, name)
    return Profile(
        temperature,
        humidity,
        MappingProxyType(sensors if isinstance(sensors, dict) else {}),
        MappingProxyType(provenance if isinstance(provenance, dict) else {}),
    )


def _temperature(part: FileTable) -> TemperatureProfile:
    key = "thermal_diffusivity_m2_s"
    part.know_nearly("bead_radius_m", key, "noise_k", *OF_BOTH)
    stated = part.child(key)
    if stated is None:
        raise part.error(key, 'an object with "value" and "standard_uncertainty"', None, "add it")
    stated.know_nearly("value", "standard_uncertainty")
    alpha = stated.demand("value", _rate(stated, "value"), "a positive number")
    radius = part.number("bead_radius_m", RANGES["bead_radius_m"])
    return TemperatureProfile(
        thermal_diffusivity_m2_s=Uncertain(alpha, _uncertainty(stated, alpha)),
        bead_radius_m=BEAD_RADIUS_M if radius is None else radius,
        response_time_s=_response_time(part.child("response_time_s")),
        noise_k=part.number("noise_k", RANGES["noise_k"], at_least=0.0),
        sampling_period_s=part.number("sampling_period_s", RANGES["sampling_period_s"], positive=True),
        effects=tuple(read_effect(item) for item in part.items("effects")),
        discovered=tuple(read_discovered(item) for item in part.items("discovered")),
    )


def _humidity(part: FileTable) -> HumidityProfile:
    part.know_nearly("film_thickness_m", "diffusivity_table", "noise_percent", *OF_BOTH)
    thickness = part.number("film_thickness_m", RANGES["film_thickness_m"])
    return HumidityProfile(
        diffusivity_table=_table(part),
        film_thickness_m=FILM_THICKNESS_M if thickness is None else thickness,
        noise_percent=part.number("noise_percent", RANGES["noise_percent"], at_least=0.0),
        sampling_period_s=part.number("sampling_period_s", RANGES["sampling_period_s"], positive=True),
        effects=tuple(read_effect(item) for item in part.items("effects")),
        discovered=tuple(read_discovered(item) for item in part.items("discovered")),
    )


def _table(humidity: FileTable) -> tuple[DiffusivityRow, ...]:
    times = {item.number("ambient_temperature_c"): _response_time(item) for item in humidity.items("response_time_s")}
    rows: list[DiffusivityRow] = []
    for item in humidity.items("diffusivity_table"):
        item.know_nearly("ambient_temperature_c", "diffusivity_m2_s", "standard_uncertainty", "runs")
        stated = item.number("ambient_temperature_c", RANGES["temperature_c"])
        ambient_c = item.demand("ambient_temperature_c", stated)
        key = "diffusivity_m2_s"
        value = item.demand(key, _rate(item, key), "a positive number")
        if rows and ambient_c < rows[-1].ambient_temperature_c + LEAST_APART_K:
            expected = "rows ordered by rising temperature, each once"
            raise item.error("ambient_temperature_c", expected, ambient_c, "put them in order")
        runs = item.number("runs", at_least=0.0)
        rows.append(
            DiffusivityRow(
                ambient_c,
                value,
                _uncertainty(item, value),
                None if runs is None else int(runs),
                times.get(ambient_c),
            )
        )
    if not rows:
        key = "diffusivity_table"
        raise humidity.error(key, "a list with at least one row", humidity.get(key), "add a row")
    return tuple(rows)


def _rate(stated: FileTable, key: str) -> float | None:
    return stated.number(key, RANGES["fitted_m2_s"], positive=True)


def _uncertainty(stated: FileTable, value: float) -> float:
    """The standard uncertainty beside a diffusivity; a cautious one where none is stated."""
    given = stated.number("standard_uncertainty", Range(0.0, LARGEST_RELATIVE_UNCERTAINTY * value), at_least=0.0)
    return ASSUMED_RELATIVE_UNCERTAINTY * value if given is None else given


def _response_time(stated: FileTable | None) -> ResponseTime | None:
    """The three times; None where one of them is not there."""
    times = [None if stated is None else stated.number(name, positive=True) for name in ("t63", "t90", "t98")]
    given = [time for time in times if time is not None]
    if stated is None or len(given) != len(times):
        return None
    spread = [stated.number(f"{name}_standard_uncertainty") for name in ("t63", "t90", "t98")]
    known = [u for u in spread if u is not None]
    t63, t90, t98 = given
    return ResponseTime(t63, t90, t98, (known[0], known[1], known[2]) if len(known) == len(spread) else None)


def _response_document(time: ResponseTime) -> dict[str, float]:
    times = {"t63": time.t63_s, "t90": time.t90_s, "t98": time.t98_s}
    known = time.standard_uncertainties_s
    return times | ({f"{n}_standard_uncertainty": u for n, u in zip(times, known, strict=True)} if known else {})
