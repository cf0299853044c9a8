"""Whose log it is: a serial number in a column, or in the name that InterMet's application gives a file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any

from shockrig.files.flight import FlightColumns
from shockrig.files.flight_cells import read_blocks
from shockrig.files.unit_names import squeeze

COLUMN = re.compile(r"(imet|hyt|sensor|probe|logger|xq)?(serial|serialno|serialnumber|sn)")
INTERMET_FILE = re.compile(r"\d{8}-\d{6}-(\d{8})\b")  # 20230914-193303-00061169.csv
LOOKED_AT = 100  # rows


def of_log(path: Path, layout: FlightColumns, name: str) -> set[str]:
    """Serial numbers that a log states, without leading zeros; `name` is the file's own."""
    found = set(INTERMET_FILE.findall(name))
    places = [place for place, column in enumerate(layout.header) if COLUMN.fullmatch(squeeze(column))]
    if places:
        for rows in islice(read_blocks(path, layout, LOOKED_AT), 1):
            found |= {cell.strip() for place in places for cell in rows.cells(place)}
    return {_plain(one) for one in found} - {""}


def serial_doubts(logged: set[str], sensors: Mapping[str, Any]) -> list[str]:
    """A sentence where a log and a profile's sensors both have serial numbers and none is the same."""
    own = {str(sensor["serial"]) for sensor in sensors.values() if isinstance(sensor, Mapping) and sensor.get("serial")}
    if not logged or not own or logged & {_plain(one) for one in own}:
        return []
    return [
        f"profile: it is of serial {', '.join(sorted(own))}, and the log of {', '.join(sorted(logged))}: response "
        "times of one sensor are not those of another; take the profile of the sensor that flew"
    ]


def _plain(serial: str) -> str:
    return serial.strip().lstrip("0").upper()
