"""Radiosondes as radiosonde_auto_rx tells of them in JSON: its UDP packets a line each, or SondeHub's array of frames.

A packet (auto_rx/autorx/ozimux.py) has `callsign`, `time` (HH:MM:SS), `latitude`, `longitude`, `altitude`, `temp`; a
frame of a decoder or of SondeHub `id` or `serial`, `datetime`, `lat`, `lon`, `alt`. Both have `frame`, `humidity`,
`pressure`, `vel_v`; -273 degC, -1 %RH and -1 hPa are no values.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import TABLE_AT_MOST, read_text, shown
from shockrig.files.errors import InputError
from shockrig.files.flight import REMEDY
from shockrig.files.flight_cells import number_of
from shockrig.files.flight_known import AUTO_RX
from shockrig.files.numbers import counted

Array = NDArray[np.float64]
DAY_S = 86_400.0
KEYS = {
    "temperature": ("temp",),
    "humidity": ("humidity",),
    "pressure": ("pressure",),
    "altitude": ("alt", "altitude"),
    "latitude": ("lat", "latitude"),
    "longitude": ("lon", "longitude"),
    "vertical_speed": ("vel_v",),
}
SONDE = ("serial", "id", "callsign")
Frame = dict[str, Any]


def read_telemetry(path: Path) -> tuple[dict[str, tuple[Array, Array]], tuple[str, ...]]:
    """Time [s since 1970, or of the day] and value of each quantity of the sonde that most frames are of, each frame
    once, in order; and what was read as what.

    Raises
    ------
    InputError
        The file is no JSON, or no frame has a time with a temperature or a humidity: names file, line and remedy.
    """
    frames, damaged, first = _frames(path)
    sondes = Counter(_name(frame) for frame in frames)
    own = sondes.most_common(1)[0][0]
    said = f"read as frames of radiosonde_auto_rx of the sonde {own or 'without a name'}"
    if len(sondes) > 1:
        said += f"; frames of {counted(len(sondes) - 1, 'other sonde')} are left out"
    if damaged:
        said += f"; {counted(damaged, 'damaged line')} left out (first: line {first})"
    frames = [frame for frame in frames if _name(frame) == own]
    time_s = _times(frames)
    # several receivers hear one frame, and a network does not keep their order
    _, once = np.unique(np.where(np.isfinite(time_s), time_s, np.inf), return_index=True)
    once = once[np.isfinite(time_s[once])]
    found = {}
    for quantity, keys in KEYS.items():
        values = np.array([_number(_first(frame, keys)) for frame in frames])[once]
        if np.isfinite(values := AUTO_RX.values(quantity, values)).any():
            found[quantity] = (time_s[once], values)
    if not {"temperature", "humidity"} & found.keys():
        raise InputError(
            f"{shown(path)}: no frame has a time with a temperature (temp) or a humidity; give a log of a sonde that "
            "sends them"
        )
    if not any("datetime" in frame for frame in frames):
        said += "; times are of a day that they do not say"
    return found, (said,)


def _frames(path: Path) -> tuple[list[Frame], int, int]:
    """Objects of the file, how many lines hold none, and the first of those."""
    text = read_text(path, REMEDY, TABLE_AT_MOST)
    if text.lstrip().startswith("["):
        try:
            content = json.loads(text)
        except (ValueError, RecursionError) as error:
            line = getattr(error, "lineno", 1)
            said = getattr(error, "msg", error)
            raise InputError(f"{shown(path)}, line {line}: not JSON: {said}; {REMEDY}") from None
        frames = [one for one in content if isinstance(one, dict)]
        damaged, first = len(content) - len(frames), 1
    else:
        frames, damaged, first = [], 0, 0
        for number, line in enumerate(text.splitlines(), start=1):
            try:
                one = json.loads(line) if line.strip(" \0") else {}
            except (ValueError, RecursionError):
                one = None
            if isinstance(one, dict):
                frames += [one] if one else []
            else:
                damaged, first = damaged + 1, first or number
    if damaged > len(frames) or not frames:
        raise InputError(f"{shown(path)}, line {first or 1}: no frame of a sonde, a JSON object a line; {REMEDY}")
    return frames, damaged, first


def _times(frames: list[Frame]) -> Array:
    """Seconds since 1970 of frames with a date, else of the day, which goes on past midnight."""
    import pandas as pd

    dated = any("datetime" in frame for frame in frames)
    texts = [str(frame.get("datetime", "") if dated else f"1970-01-01T{frame.get('time', '')}") for frame in frames]
    stamps = pd.to_datetime(texts, errors="coerce", utc=True, format="ISO8601")
    time_s = np.asarray((stamps - pd.Timestamp(0, tz="UTC")).total_seconds(), dtype=float)
    known = np.isfinite(time_s)
    if not dated and known.any():
        time_s[known] = np.unwrap(time_s[known], period=DAY_S)
    return time_s


def _first(frame: Frame, keys: tuple[str, ...]) -> Any:
    return next((frame[key] for key in keys if key in frame), None)


def _name(frame: Frame) -> str:
    return str(_first(frame, SONDE) or "")


def _number(value: object) -> float:
    number = number_of(str(value))
    return np.nan if number is None else number
