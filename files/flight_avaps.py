"""Dropsondes as AVAPS, the receiver in the aircraft, writes them down: a line of 20 cells each quarter of a second.

`AVAPS-D04 S00 234150007 240811 174154.50  507.83  -5.14  76.51 ...`: what kind of line it is, the sonde, date and time
(UTC, yymmdd hhmmss), pressure [hPa], temperature [degC], humidity [%RH], wind, longitude and latitude, ..., altitude by
GPS [m]. A kind is P before the launch and S behind it; nines are no value. Lines of AVAPS-T are the file's own words.
(NCAR, https://www.eol.ucar.edu/content/avaps-dropsonde-system)
"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import open_text, shown
from shockrig.files.errors import InputError
from shockrig.files.flight import REMEDY
from shockrig.files.flight_cells import numbers_of
from shockrig.files.numbers import counted

Array = NDArray[np.float64]
BEGINS = "AVAPS-"
DATA, CELLS = "AVAPS-D", 20
PLACES = {"pressure": 5, "temperature": 6, "humidity": 7, "longitude": 11, "latitude": 12, "altitude": 19}
NOTHING = {5: 9999.0, 6: 99.0, 7: 999.0, 11: 999.0, 12: 99.0, 19: 99999.0}  # code for no value at each place


def read_avaps(path: Path) -> tuple[dict[str, tuple[Array, Array]], tuple[str, ...]]:
    """Time [s since 1970] and value of each quantity from the launch on, and what was read as what.

    Raises
    ------
    InputError
        No line of a sonde that was launched: names the file and the remedy.
    """
    rows: list[list[str]] = []
    times: list[float] = []
    waiting = damaged = 0
    with open_text(path, REMEDY, errors="replace") as stream:
        for line in stream:
            cells = line.split()
            if not cells or not cells[0].startswith(DATA):
                continue
            if len(cells) > 1 and not cells[1].startswith("S"):
                waiting += 1
                continue
            try:
                at = datetime.strptime(f"{cells[3]} {cells[4]}", "%y%m%d %H%M%S.%f").replace(tzinfo=UTC)
                times.append(at.timestamp())
            except (IndexError, ValueError):
                damaged += 1
                continue
            rows.append([*cells, *[""] * CELLS][:CELLS])
    if not rows:
        raise InputError(
            f"{shown(path)}: no line of a sonde behind its launch ({DATA}.. S..); give a whole drop's file"
        )
    table, time_s = list(zip(*rows, strict=True)), np.array(times)
    found = {}
    for quantity, place in PLACES.items():
        values = numbers_of(table[place])
        found[quantity] = (time_s, np.where(values == NOTHING[place], np.nan, values))
    said = [f"read as a dropsonde's file of AVAPS: the sonde {table[2][0]}"]
    if waiting:
        said.append(f"{counted(waiting, 'line')} before the launch left out")
    if damaged:
        said.append(f"{counted(damaged, 'damaged line')} left out")
    return found, ("; ".join(said),)
