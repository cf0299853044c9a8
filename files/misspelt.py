"""Keys that mean nothing to a reader and are nearly the name of one that does: unknown keys are allowed, slips are not
meant.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields

from shockrig.files.campaign_names import ReferenceResponse
from shockrig.files.common_uncertainty import INPUTS
from shockrig.files.spelling import ALIKE_KEYS, nearest

_AIR = frozenset({"temperature_c", "humidity_percent"})
RUN_KEYS = {
    "": frozenset(
        "format id started_at source destination airflow_m_s pressure_hpa irradiance_w_m2 transfer reference".split()
    ),
    "source.": _AIR,
    "destination.": _AIR,
    "transfer.": frozenset({"start_s", "duration_s"}),
    "reference.": frozenset(one.name for one in fields(ReferenceResponse)),
}
_SENSOR = frozenset({"kind", "serial", "body"})
CAMPAIGN_KEYS = {
    "": frozenset("format name sensors bench protocol operator emulated common_uncertainty plan sessions".split()),
    "sensors.imet.": _SENSOR | {"bead_radius_m"},
    "sensors.hyt.": _SENSOR | {"film_thickness_m"},
    "common_uncertainty.": frozenset(INPUTS),
}


def misspelt(content: Mapping[str, object], known: Mapping[str, frozenset[str]], path: str = "") -> Iterator[str]:
    """Each slip in the words of a remedy, such as "key airflow: is airflow_m_s meant?".

    `known` maps the path of an object in the file ("", "transfer.") to the keys that it may have; an object that is not
    in it may have any.
    """
    names = known.get(path, frozenset())
    for key, value in content.items():
        if names and key not in names:
            near = nearest(key, names - set(content), ALIKE_KEYS)
            if near:
                yield f"key {path}{key}: is {near} meant?"
        if isinstance(value, Mapping):
            yield from misspelt(value, known, f"{path}{key}.")
