"""What reader and writer of a campaign share: names of the formats, of sensors and probes, ids, bodies, references.

A campaign may record several probes at once: `imet` and `hyt` are the first one's sensors, `imet-2` and `hyt-2` those
of the probe "2".
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from shockrig.files.file_table import FileTable

CAMPAIGN_FORMAT = "shock-campaign/1"
RUN_FORMAT = "shock-run/1"
BODIES = ("sphere", "film", "sphere_mean", "cylinder", "cylinder_mean", "plate", "lumped")
DEFAULT_BODIES: Mapping[str, str] = {"imet": "sphere", "hyt": "film"}
KNOWN_KINDS = ("imet-xf", "imet-xq", "imet-xq2", "hyt-271")  # whose bodies those are
LONGEST_ID = 100
FIRST_PROBE = "1"
_SENSOR = re.compile(rf"({'|'.join(DEFAULT_BODIES)})(?:-([A-Za-z0-9]{{1,20}}))?")


@dataclass(frozen=True)
class ReferenceResponse:
    """What is known of the instrument that measured the airs: its lag and its standard uncertainty (one sigma)."""

    temperature_time_constant_s: float = 0.0
    temperature_standard_uncertainty_k: float = 0.02
    humidity_time_constant_s: float = 0.0
    humidity_standard_uncertainty_percent: float = 0.1


def sensor_and_probe(name: str) -> tuple[str, str] | None:
    """What a sensor is and on which probe: ("imet", "2") for "imet-2", ("hyt", "1") for "hyt"; None for other names."""
    found = _SENSOR.fullmatch(name)
    if found is None or found[2] == FIRST_PROBE:
        return None
    return found[1], found[2] or FIRST_PROBE


def sensor_name(sensor: str, probe: str) -> str:
    """The name of a probe's sensor, which is also that of its file: "imet-2" of "imet" and "2"."""
    return sensor if probe == FIRST_PROBE else f"{sensor}-{probe}"


def probes_of(names: Iterable[str]) -> tuple[str, ...]:
    """The probes that have any of these sensors, the first one first."""
    found = {place[1] for name in names if (place := sensor_and_probe(name)) is not None}
    return tuple(sorted(found, key=lambda probe: (probe != FIRST_PROBE, len(probe), probe)))


def serial_numbers(sensors: Mapping[str, object], emulated: bool) -> dict[str, str]:
    """Of each sensor in campaign.json that has one. Emulated ones that are called "virtual..." have none: simulated
    campaigns and earlier versions call all of them so."""
    stated = {name: str(one.get("serial") or "") for name, one in sensors.items() if isinstance(one, Mapping)}
    return {name: one for name, one in stated.items() if one and not (emulated and one.startswith("virtual"))}


def dated(stated: object) -> str:
    """When a run began (ISO 8601) as its file states it; empty where it states nothing, or what a clock says that was
    never set: it begins at 1970-01-01."""
    return stated if isinstance(stated, str) and stated >= "1971" else ""


def is_run_id(text: object) -> bool:
    """Whether a text can be a run's id: a plain name, which becomes a folder's and a word of reports."""
    return (
        isinstance(text, str)
        and 0 < len(text) <= LONGEST_ID
        and text.isprintable()
        and not text.startswith(".")
        and not set(text) & {"/", "\\"}
    )


def read_body(sensor: FileTable, name: str) -> str:
    """The shape of a sensor's plain model, its usual one where none is stated; InputError for an unknown one."""
    body = sensor.get("body")
    if body is None:
        return DEFAULT_BODIES[name]
    if not isinstance(body, str) or body not in BODIES:
        remedy = f"name one of them or leave it out ({DEFAULT_BODIES[name]})"
        raise sensor.error("body", f"one of {', '.join(BODIES)}", body, remedy)
    return body
