"""A generated program against its reference on one flight: built, run, and compared row by row."""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
from dataclasses import astuple
from io import StringIO
from pathlib import Path

import numpy as np

from shockrig.analysis.flight.causal import Corrector, rows_of
from shockrig.analysis.flight.causal_design import Design
from shockrig.analysis.onboard import ProgramDifference
from shockrig.files.errors import InputError
from shockrig.files.flight import Flight

STRICT = ("-O2", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
LONGEST_RUN_S = 600.0
COLUMNS = (
    "time_s", "temperature_c", "humidity_percent", "airspeed_m_s", "pressure_hpa", "humidity_sensor_temperature_c",
)  # fmt: skip


def compiler() -> str | None:
    """A C compiler of this computer: that of CC, or cc, gcc or clang; None where there is none."""
    names = (os.environ.get("CC", ""), "cc", "gcc", "clang")
    return next((found for name in names if name and (found := shutil.which(name))), None)


def build(folder: Path, cc: str, place: Path, options: tuple[str, ...] = STRICT) -> Path:
    """Build `shock_csv` of a folder of sources, in another `place`.

    Raises
    ------
    InputError
        The compiler refuses; what it said.
    """
    target = place / "shock_csv"
    sources = [str(folder / name) for name in ("csv_main.c", "shock_correct.c")]
    done = subprocess.run([cc, *options, "-o", str(target), *sources, "-lm"], capture_output=True, text=True)
    if done.returncode:
        raise InputError(f"{cc} does not build {folder}: {done.stderr.strip()[:400]}")
    return target


def as_csv(flight: Flight) -> str:
    """A flight as `shock_csv` reads it."""
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows_of(flight):
        writer.writerow(["" if value != value else repr(value) for value in astuple(row)])
    return text.getvalue()


def run(program: Path, flight: Flight) -> np.ndarray:
    """What a program makes of a flight (n, 6): temperature, its uncertainty, humidity, its uncertainty, both flags."""
    done = subprocess.run(
        [str(program)], input=as_csv(flight), capture_output=True, text=True, timeout=LONGEST_RUN_S, check=True
    )
    return np.genfromtxt(StringIO(done.stdout), delimiter=",", skip_header=1, usecols=range(1, 7), ndmin=2)


def reference(design: Design, flight: Flight) -> np.ndarray:
    """The same by the causal corrector, values and uncertainties (n, 4)."""
    corrector, given = Corrector(design), []
    for row in rows_of(flight):
        given += corrector.step(row)
    return np.array([[v for one in pair for v in (one.value, one.uncertainty)] for pair in given])


def difference(found: np.ndarray, wanted: np.ndarray) -> ProgramDifference:
    """How far values (n, 4) are from the reference's."""
    off = np.abs(found[:, :4] - wanted)
    bead, of_bead, film, of_film = (float(np.nanmax(v)) if np.isfinite(v).any() else 0.0 for v in off.T)
    one_sided = int(np.count_nonzero(np.isnan(found[:, :4]) != np.isnan(wanted)))
    return ProgramDifference(len(wanted), bead, of_bead, film, of_film, one_sided)
