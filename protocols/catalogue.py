"""The campaigns of a folder, what was found from each, and what changed from one to the next of the same sensor.

Campaigns are found by their campaign.json, results by their profile.json and diagnosis.json, whose provenance names the
campaign; a file that cannot be read is said and hides no other.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shockrig.files.campaign_names import dated, serial_numbers
from shockrig.files.disk import real_path
from shockrig.files.errors import InputError
from shockrig.files.headline import LUMPED, NEAREST_C, first_order
from shockrig.files.json_files import read_json
from shockrig.files.profile import Profile, read_profile
from shockrig.rig.bench_errors import RigError
from shockrig.rig.recorder.state import CampaignState, read_head, read_state

DEEPEST_FOLDER = 4  # folders below the one that was named
NEVER_INSIDE = ("runs", "recording", "set_aside")
BEGINS = {"temperature": "imet", "humidity": "hyt"}
FARTHEST_K = 1.0  # from that temperature a film's row is compared with another campaign's


@dataclass(frozen=True)
class Entry:
    """One campaign: its folder, its state, when it began (ISO 8601, empty where it is not known), serial numbers, and
    what was found: profiles by their files, verdicts by channel."""

    path: Path
    state: CampaignState
    began_at: str
    serials: dict[str, str]
    profiles: dict[Path, Profile] = field(default_factory=dict)
    verdicts: dict[str, str] = field(default_factory=dict)


def catalogue(folder: Path) -> tuple[list[Entry], list[str]]:
    """All campaigns in a folder, in the order in which they began, and what could not be read."""
    entries: dict[Path, Entry] = {}
    troubles: list[str] = []
    results: list[Path] = []
    for path in walk(folder, troubles):
        try:
            if (path / "campaign.json").is_file():
                entries[real_path(path)] = _entry(path)
            results += [path / name for name in ("profile.json", "diagnosis.json") if (path / name).is_file()]
        except (InputError, RigError) as error:
            troubles.append(str(error))
    for file in results:
        try:
            _attach(file, entries)
        except InputError as error:
            troubles.append(str(error))
    return sorted(entries.values(), key=lambda entry: (entry.began_at, str(entry.path))), troubles


def walk(folder: Path, troubles: list[str]) -> Iterator[Path]:
    """The folders in a folder, itself among them, in which a campaign or a result may be; what cannot be read is added
    to `troubles`."""

    def fault(error: OSError) -> None:
        troubles.append(f"{error.filename}: {error.strerror}")

    for where, folders, files in os.walk(folder, onerror=fault):
        path = Path(where)
        deep = len(path.relative_to(folder).parts) >= DEEPEST_FOLDER
        inside = NEVER_INSIDE if "campaign.json" in files else ()
        folders[:] = [] if deep else sorted(name for name in folders if not name.startswith(".") and name not in inside)
        yield path


def _entry(path: Path) -> Entry:
    head = read_head(path)
    state, sensors = read_state(path), head.get("sensors")
    serials = serial_numbers(sensors if isinstance(sensors, dict) else {}, state.emulated)
    began_at = ""
    if state.recorded:
        first = read_json(path / "runs" / state.recorded[0] / "run.json", None, "fix or restore the file")
        began_at = dated(first.get("started_at"))
    return Entry(path, state, began_at, serials)


def _attach(file: Path, entries: dict[Path, Entry]) -> None:
    """Give a result to the campaign that it is of, where that is among them."""
    content = read_json(file, None, "fix or restore the file")
    stated: Any = content.mapping("provenance").get("campaign_path") if file.name == "profile.json" else None
    name = content.get("campaign")
    if file.name == "profile.json":
        # the command was typed in some folder above its result
        places = [] if stated is None else [real_path(where / str(stated)) for where in (Path(), *file.parents)]
        for path in dict.fromkeys(places):
            if path in entries:
                entries[path].profiles[file] = read_profile(file)
                break
    elif (entry := _diagnosed(real_path(file), name, entries)) is not None:
        for channel, found in content.children("channels"):
            entry.verdicts[channel] = str(found.get("verdict") or "?")


def _diagnosed(file: Path, name: object, entries: dict[Path, Entry]) -> Entry | None:
    """The campaign of that name which a diagnosis lies in or nearest beside: many are called `campaign`."""
    called = {path: entry for path, entry in entries.items() if entry.state.name == name}
    near = [path for path in called if path.parent in file.parents]
    if near:
        return called[max(near, key=lambda path: (path in file.parents, len(path.parts)))]
    return next(iter(called.values())) if len(called) == 1 else None


def changes(entries: list[Entry]) -> list[str]:
    """What changed from one campaign to the next of the same sensor, one sentence each: value, and in sigma."""
    said = []
    for channel, sensor in BEGINS.items():
        last: dict[str, tuple[Entry, str, float, float]] = {}
        found = [(entry, one) for entry in entries for one in entry.profiles.values()]
        for entry, one in found:
            # of the profile's own probe, where several were recorded at once
            serial = (entry.serials | serial_numbers(one.sensors, entry.state.emulated)).get(sensor)
            rate = _rate(one, channel)
            if not serial or rate is None or (serial in last and last[serial][0] is entry):
                continue
            name, value, sigma = rate
            if serial in last and last[serial][1] == name:
                before, _, old, old_sigma = last[serial]
                apart = (value - old) / ((sigma**2 + old_sigma**2) ** 0.5 or 1.0)
                said.append(
                    f"{sensor} {serial}: {name} {100.0 * (value / old - 1.0):+.2f} % ({apart:+.1f} sigma) "
                    f"from {before.path.name} to {entry.path.name}"
                )
            last[serial] = (entry, name, value, sigma)
    return said


def _rate(profile: Profile, channel: str) -> tuple[str, float, float] | None:
    """Name, value and standard uncertainty of alpha, or of D at 20 degC; of a sensor that is one lag, of tau."""
    if channel == "temperature" and profile.temperature is not None:
        alpha = profile.temperature.thermal_diffusivity_m2_s
        symbol, length_m, rate = "alpha", profile.temperature.bead_radius_m, (alpha.value, alpha.standard_uncertainty)
    elif channel == "humidity" and profile.humidity is not None:
        row = min(profile.humidity.diffusivity_table, key=lambda row: abs(row.ambient_temperature_c - NEAREST_C))
        if abs(row.ambient_temperature_c - NEAREST_C) > FARTHEST_K:
            return None
        symbol, length_m, rate = (
            "D",
            profile.humidity.film_thickness_m,
            (row.diffusivity_m2_s, row.standard_uncertainty),
        )
    else:
        return None
    if profile.bodies[BEGINS[channel]] == LUMPED:
        return "tau", *first_order(length_m, *rate)
    return symbol, *rate
