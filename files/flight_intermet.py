"""Which clock of a log by InterMet's application is the readings': the sensor's own, or the application's.

Recorded live, `Time` is when the computer received a row; of a log that is downloaded from the sensor afterwards it is
when it was downloaded, and only `XQ-iMet-XQ Date` and `XQ-iMet-XQ Time` say when the sensor read.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
CLOCK_ROWS = 400  # that the two clocks' paces are told from
ALIKE_READINGS = 0.2  # relative, that they differ by where both are of the readings
DAY_S = 86400.0


def clock_of(lines: Iterable[str], application: int, own: int, own_date: int | None) -> tuple[int, int | None]:
    """Place of the time and of the date that the readings have, of rows of a log (`lines` under its header).

    The application's clock stays where the sensor's goes at the same pace: it has fractions of a second, and a date
    without a fix.
    """
    rows = [row for row in islice(csv.reader(lines), CLOCK_ROWS) if len(row) > max(application, own, own_date or 0)]
    if len(rows) < 2 or any(row[application].replace(".", "", 1).strip().isdigit() for row in rows):
        return application, None
    of_application = pace([row[application] for row in rows])
    date = [row[own_date] for row in rows] if own_date is not None else [""] * len(rows)
    of_sensor = pace([f"{day} {time}".strip() for day, time in zip(date, [row[own] for row in rows], strict=True)])
    if not of_sensor > 0.0:
        return application, None
    if of_application > 0.0 and abs(np.log(of_application / of_sensor)) < ALIKE_READINGS:
        return application, None
    return own, own_date


def pace(cells: Sequence[str]) -> float:
    """Seconds a row, of clock times with or without a date; NaN where they are none."""
    import pandas as pd

    text = pd.Series(cells, dtype=str).str.strip()
    stamps = pd.to_datetime(text, errors="coerce", utc=True, format="mixed", dayfirst=day_first(text.tolist()))
    seconds = np.asarray((stamps - pd.Timestamp(0, tz="UTC")).dt.total_seconds(), dtype=float)
    seconds = seconds[np.isfinite(seconds)]
    return float((seconds[-1] - seconds[0]) / (len(cells) - 1)) if seconds.size > 1 else float("nan")


def day_first(cells: Iterable[str]) -> bool:
    """Whether dates such as 14/09/2023 have the day before the month: one of them could not be read otherwise."""
    for cell in cells:
        parts = cell.replace("-", "/").replace(".", "/").split("/")
        if len(parts) > 2 and len(parts[0]) <= 2 and parts[0].isdigit() and int(parts[0]) > 12:
            return True
    return False
