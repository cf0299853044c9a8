"""Runs of further logs beside those that a campaign already has: what must agree, and the whole description then."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from shockrig.files.campaign_names import CAMPAIGN_FORMAT
from shockrig.files.disk import shown
from shockrig.files.json_files import read_json
from shockrig.rig.bench_errors import BenchError

RESTORE = "restore it, or give another --out"


def with_more(place: Path, new: Mapping[str, Any]) -> tuple[dict[str, Any], int]:
    """campaign.json of the campaign at `place` once it has the logs of `new` too, and the number of its next run.

    Raises
    ------
    BenchError
        The campaign was not imported, is of another sensor, air or instrument, or has one of the logs already.
    """
    there = read_json(place / "campaign.json", CAMPAIGN_FORMAT, RESTORE)
    where, before, now = shown(place), there.mapping("imported"), new["imported"]
    if before.get("logs") is None:
        raise BenchError(f"--out {where}: is a campaign that was not imported from logs; give another --out")
    for key, noun in (("sensor", "sensor"), ("reference", "reference for the air")):
        if before.get(key) != now[key]:
            found = _said(before.get(key))
            raise BenchError(f"--out {where}: its {noun} is {found}, the map's {_said(now[key])}; give another --out")
    stated = {key: sensor.content for key, sensor in there.children("sensors")}
    for key, instrument in new["sensors"].items():
        its = stated.setdefault(key, instrument)
        differing = sorted(k for k in {*its, *instrument} if its.get(k) != instrument.get(k))
        if differing:
            name = differing[0]
            raise BenchError(
                f"--out {where}: campaign.json has sensors.{key}.{name} {_said(its.get(name))}, the map "
                f"{_said(instrument.get(name))}; one campaign is of one sensor: make them agree, or give another --out"
            )
    digests = {log.get("sha256"): log.get("file") for log in before.items("logs")}
    again = next((log for log in now["logs"] if log["sha256"] in digests), None)
    if again is not None:
        was = digests[again["sha256"]]
        called = "" if was == again["file"] else f" as {was}, which holds the same bytes"
        raise BenchError(f"--out {where}: has the runs of {again['file']} already{called}; give only logs new to it")
    logs = [*before.sequence("logs"), *now["logs"]]
    merged = {**there.content, "sensors": stated, "imported": {**before.content, "logs": logs}}
    numbers = [int(p.name) for p in (place / "runs").glob("*") if p.name.isdecimal()]
    return merged, max(numbers, default=0) + 1


def _said(value: object) -> str:
    if value in (None, [], ""):
        return "not stated"
    return ", ".join(map(str, value)) if isinstance(value, list) else repr(value)
