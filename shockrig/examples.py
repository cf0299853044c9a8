"""Samples that ship with the package: campaigns, a log with steps, a flight with position in three forms."""

from __future__ import annotations

from pathlib import Path

from shockrig.files.errors import InputError

WHAT = {
    "plain-rough": "a campaign of 33 runs; sensors as the plain model has them, a rough bench's noise",
    "ordinary-bench": "a campaign of 33 runs with what a real bench ordinarily has",
    "steps.csv": "a logger's file: a thermometer and a hygrometer carried eight times between two rooms",
    "flight.csv": "a drone's ascent and descent through an inversion, with position",
    "flight.bin": "the same flight as ArduPilot's log",
    "flight.nc": "the same flight as netCDF",
    "profile.json": "the profile of the sensors that flew it",
    "truth.csv": "the air along that flight",
}


def example(name: str = "plain-rough") -> Path:
    """The folder or file of an example that ships with the package.

    Parameters
    ----------
    name : str
        "plain-rough" and "ordinary-bench" are campaigns: sensors as the plain model has them with a rough bench's
        noise, or with what a real bench ordinarily has (an air film around the bead, a transfer of half a second, heat
        through the support, a film read at its own die's temperature). "steps.csv" is a log with eight steps.
        "flight.csv", "flight.bin" and "flight.nc" are one flight, "profile.json" are its sensors, "truth.csv" its air.

    Raises
    ------
    InputError
        No example of that name ships.

    Examples
    --------
    >>> import shockrig
    >>> shockrig.example("plain-rough").name
    'plain-rough'
    """
    from importlib.resources import files

    if name not in WHAT:
        raise InputError(f"no example {name!r}; give one of {', '.join(sorted(WHAT))}")
    return Path(str(files("shockrig.data") / "examples")) / name
