"""Flights as `shockrig.correct` takes them: whatever the command reads, and DataFrames with the same guessing."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from shockrig.files.errors import InputError
from shockrig.files.flight import Flight
from shockrig.given import PathLike
from shockrig.protocols.flight_logs import read_log
from shockrig.remedies import as_python

if TYPE_CHECKING:
    import pandas as pd


def read_flight(
    flight: pd.DataFrame | Flight | PathLike,
    columns: Mapping[str, str] | None = None,
    map: PathLike | None = None,
) -> Flight:
    """A flight's rows from a file (CSV, netCDF, ArduPilot's .bin, soundings' logs, any by a map) or a DataFrame.

    Parameters
    ----------
    flight : DataFrame, Flight or path
        A DataFrame's columns are recognised by their names as a file's are; times in its index are taken where no
        column has any.
    columns : mapping, optional
        Quantity ("time", "temperature", "humidity", "airspeed", "die", "pressure", "altitude", "latitude",
        "longitude", "vertical_speed") -> the column's name where it is not recognised; in a .bin log MESSAGE.FIELD.
    map : path, optional
        A map (shock-map/1) by which any text log is read, or the name of one that ships.

    Returns
    -------
    Flight

    Raises
    ------
    InputError
        The log cannot be read, or has no time, or neither temperature nor humidity.

    Examples
    --------
    >>> import shockrig
    >>> flight = shockrig.read_flight(shockrig.example("flight.csv"))
    >>> bool(flight.altitude_m.max() > 300.0)
    True
    """
    return with_words(flight, columns, map)[0]


def with_words(
    flight: pd.DataFrame | Flight | PathLike,
    columns: Mapping[str, str] | None = None,
    map: PathLike | None = None,
) -> tuple[Flight, tuple[str, ...]]:
    """As `read_flight`, with sentences on what was read as what."""
    if isinstance(flight, Flight):
        return flight, ()
    with as_python(), tempfile.TemporaryDirectory() as folder:
        if isinstance(flight, str | os.PathLike):
            source = Path(flight)
            called = str(source)
        else:
            demand_frame(flight, "flight", "a path, a Flight")
            source, called = Path(folder) / "frame.csv", "the DataFrame"
            with_times(flight).to_csv(source, index=False)
        try:
            return read_log(source, columns, None if map is None else Path(map))
        except InputError as error:
            said = str(error).replace(str(source), called)
            raise InputError(said.replace(f"{called}, line 1:", f"{called}:")) from error


def demand_frame(given: object, name: str, else_: str) -> None:
    """Refuse what is no table: an array or a Series has no names by which its columns could be known."""
    if not hasattr(given, "to_csv") or not hasattr(given, "columns"):
        raise InputError(f"{name}: expected {else_} or a DataFrame, got {type(given).__name__}")


def with_times(frame: pd.DataFrame) -> pd.DataFrame:
    """A DataFrame with its index as a column where the index says something: a name, or times."""
    import pandas as pd

    index = frame.index
    timed = isinstance(index, pd.DatetimeIndex | pd.TimedeltaIndex)
    if not timed and index.name is None:
        return frame
    frame = frame.reset_index(names=str(index.name or "time"))
    first = frame.columns[0]
    if isinstance(index, pd.TimedeltaIndex):
        frame[first] = frame[first].dt.total_seconds()
    return frame
