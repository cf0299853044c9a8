"""Keys that mean nothing to a reader and are nearly the name of one that does: unknown keys are allowed, slips are not
meant.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields

from shockrig.files.campaign_names import DEFAULT_BODIES, ReferenceResponse, sensor_and_probe
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
    "sensors.": frozenset(DEFAULT_BODIES),
    "sensors.imet.": _SENSOR | {"bead_radius_m"},
    "sensors.hyt.": _SENSOR | {"film_thickness_m"},
    "common_uncertainty.": frozenset(INPUTS),
}


def misspelt(
    content: Mapping[str, object], known: Mapping[str, frozenset[str]], path: str = "", its: str | None = None
) -> Iterator[str]:
    """Each slip in the words of a remedy, such as "key airflow: is airflow_m_s meant?".

    `known` maps the path of an object in the file ("", "transfer.") to the keys that it may have; an object that is not
    in it may have any. A key that only another object may have stands at the wrong place; one that lacks its unit says
    nothing beside the one that has it. `path` is the object's own, `its` that in `known`: a sensor of another probe
    ("sensors.imet-2.") has the keys of the first one's.
    """
    its = path if its is None else its
    names = known.get(its, frozenset())
    for key, value in content.items():
        place = sensor_and_probe(key) if its == "sensors." else None
        name = place[0] if place else key
        if names and name not in names:
            near = nearest(key, names - set(content), ALIKE_KEYS)
            meant = [near] if near else [f"{home}{key}" for home in known if key in known[home]]
            beside = [one for one in names & set(content) if one.startswith(f"{key}_")]
            if beside:
                yield f"key {path}{key}: {beside[0]} stands beside it and counts, is one too many?"
            elif meant:
                yield f"key {path}{key}: is {' or '.join(meant)} meant?"
        if isinstance(value, Mapping):
            yield from misspelt(value, known, f"{path}{key}.", f"{its}{name}.")
