"""What reader and writer of a campaign share: names of the formats, ids, bodies, what is known of a reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from shockrig.files.json_files import JsonObject

CAMPAIGN_FORMAT = "shock-campaign/1"
RUN_FORMAT = "shock-run/1"
BODIES = ("sphere", "film", "sphere_mean", "cylinder", "cylinder_mean", "plate", "lumped")
DEFAULT_BODIES: Mapping[str, str] = {"imet": "sphere", "hyt": "film"}
LONGEST_ID = 100


@dataclass(frozen=True)
class Reference:
    """What is known of the instrument that measured the airs: its lag and its standard uncertainty (one sigma)."""

    temperature_time_constant_s: float = 0.0
    temperature_standard_uncertainty_k: float = 0.02
    humidity_time_constant_s: float = 0.0
    humidity_standard_uncertainty_percent: float = 0.1


def is_run_id(text: object) -> bool:
    """Whether a text can be a run's id: a plain name, which becomes a folder's and a word of reports."""
    return (
        isinstance(text, str)
        and 0 < len(text) <= LONGEST_ID
        and text.isprintable()
        and not text.startswith(".")
        and not set(text) & {"/", "\\"}
    )


def read_body(sensor: JsonObject, name: str) -> str:
    """The shape of a sensor's plain model, its usual one where none is stated; InputError for an unknown one."""
    body = sensor.get("body")
    if body is None:
        return DEFAULT_BODIES[name]
    if not isinstance(body, str) or body not in BODIES:
        remedy = f"name one of them or leave it out ({DEFAULT_BODIES[name]})"
        raise sensor.error("body", f"one of {', '.join(BODIES)}", body, remedy)
    return body
