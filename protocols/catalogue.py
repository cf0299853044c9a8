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

from shockrig.files.disk import real_path
from shockrig.files.errors import InputError
from shockrig.files.json_files import read_json
from shockrig.files.profile import Profile, read_profile
from shockrig.rig.errors import RigError
from shockrig.rig.recorder.state import CampaignState, read_head, read_state

DEEPEST = 4  # folders below the one that was named
NEVER_INSIDE = ("runs", "recording", "set_aside")
BEGINS = {"temperature": "imet", "humidity": "hyt"}


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
        deep = len(path.relative_to(folder).parts) >= DEEPEST
        inside = NEVER_INSIDE if "campaign.json" in files else ()
        folders[:] = [] if deep else sorted(name for name in folders if not name.startswith(".") and name not in inside)
        yield path


def _entry(path: Path) -> Entry:
    head = read_head(path)
    sensors = head.get("sensors")
    serials = {
        name: str(sensor["serial"])
        for name, sensor in (sensors if isinstance(sensors, dict) else {}).items()
        if isinstance(sensor, dict) and sensor.get("serial")
    }
    state = read_state(path)
    began_at = ""
    if state.recorded:
        first = read_json(path / "runs" / state.recorded[0] / "run.json", None, "fix or restore the file")
        began_at = str(first.get("started_at") or "")
    return Entry(path, state, began_at, serials)


def _attach(file: Path, entries: dict[Path, Entry]) -> None:
    """Give a result to the campaign that it is of, where that is among them."""
    content = read_json(file, None, "fix or restore the file")
    stated: Any = content.mapping("provenance").get("campaign_path") if file.name == "profile.json" else None
    name = content.get("campaign")
    for path, entry in entries.items():
        theirs = stated is not None and real_path(file.parent / str(stated)) == path
        theirs |= stated is not None and real_path(Path(str(stated))) == path
        if file.name == "profile.json" and theirs:
            entry.profiles[file] = read_profile(file)
        elif file.name == "diagnosis.json" and name == entry.state.name:
            for channel, found in content.children("channels"):
                entry.verdicts[channel] = str(found.get("verdict") or "?")


def changes(entries: list[Entry]) -> list[str]:
    """What changed from one campaign to the next of the same sensor, one sentence each: value, and in sigma."""
    said = []
    for channel, sensor in BEGINS.items():
        last: dict[str, tuple[Entry, float, float]] = {}
        found = [(entry, one) for entry in entries for one in entry.profiles.values()]
        for entry, one in found:
            stated = one.sensors.get(sensor)  # of the profile's own probe, where several were recorded at once
            serial = (stated.get("serial") if isinstance(stated, dict) else None) or entry.serials.get(sensor)
            rate = _rate(one, channel)
            if not serial or rate is None or (serial in last and last[serial][0] is entry):
                continue
            value, sigma = rate
            if serial in last:
                before, old, old_sigma = last[serial]
                apart = (value - old) / ((sigma**2 + old_sigma**2) ** 0.5 or 1.0)
                name = "alpha" if channel == "temperature" else "D"
                said.append(
                    f"{sensor} {serial}: {name} {100.0 * (value / old - 1.0):+.2f} % ({apart:+.1f} sigma) "
                    f"from {before.path.name} to {entry.path.name}"
                )
            last[serial] = (entry, value, sigma)
    return said


def _rate(profile: Profile, channel: str) -> tuple[float, float] | None:
    """alpha, or D at 20 degC, with its standard uncertainty."""
    if channel == "temperature" and profile.temperature is not None:
        alpha = profile.temperature.thermal_diffusivity_m2_s
        return alpha.value, alpha.standard_uncertainty
    if channel == "humidity" and profile.humidity is not None:
        row = min(profile.humidity.diffusivity_table, key=lambda row: abs(row.ambient_temperature_c - 20.0))
        if abs(row.ambient_temperature_c - 20.0) <= 1.0:
            return row.diffusivity_m2_s, row.standard_uncertainty
    return None


def rates(profile: Profile) -> str:
    """alpha and D at 20 degC in words; empty where the profile has neither."""
    parts = []
    for channel, name, unit in (("temperature", "alpha", 1e-8), ("humidity", "D(20 degC)", 1e-12)):
        if found := _rate(profile, channel):
            value, sigma = found
            parts.append(f"{name} {value / unit:.4g} ± {sigma / unit:.2g} ({unit:g} m2/s)")
    return ", ".join(parts)
