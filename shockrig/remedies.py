"""Errors of the command line said in Python's words: its options become the keyword arguments of the functions."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from shockrig.files.errors import InputError
from shockrig.rig.bench_errors import BenchError

# What messages say -> what Python says; the first that fits is taken, the longer ones stand first.
WORDS: tuple[tuple[str, str], ...] = (
    (
        r"read it by a map: shockrig import \S+ --look writes one, --map takes it",
        "read it by a map: shockrig import FILE --look writes one, map= takes it",
    ),
    (
        r"look at it \(--look --map [^)]*\), then state \[\[step\]\] at = \.\.\. or a smaller \[steps\] "
        r"least_temperature_k, least_humidity_percent in the map",
        "plot it; then give map=, a map in which [[step]] at = ... states it or [steps] least_temperature_k, "
        "least_humidity_percent are smaller (shockrig import FILE --look writes a map to begin with)",
    ),
    (
        r"look at it \(--look --map [^)]*\) and correct the map",
        "give map=, a map that is corrected (shockrig import FILE --look writes one)",
    ),
    (
        r"name them with --column \w+=NAME --column \w+=NAME",
        "name them by columns={'temperature': ..., 'humidity': ...}",
    ),
    (r"name the columns \(--column (\w+)=NAME\)", r"name the columns (columns={'\1': ...})"),
    (r"--column \.\.\.=", "columns: "),
    (r"--column (\w+)=NAME", r"columns={'\1': ...}"),
    (r"--column (\w+)=(\S+)", r"columns={'\1': '\2'}"),
    (r"--sensor (\S+):", r"sensor='\1':"),
    (
        r"write a map by hand, \[log\] .*, as docs/importing\.md shows",
        "name the columns by columns={'time': ..., 'temperature': ...}",
    ),
    (r"--map MAP\.toml says otherwise", "map= says otherwise"),
    (r"run shockrig diagnose", "call shockrig.diagnose"),
    (r"--cutoff-hz\b", "cutoff_hz="),
    (r"(?<![\w-])--(map|sensor|out|name|until)\b", r"\1="),
)  # fmt: skip


def in_python(message: str) -> str:
    """A message of the command line as Python's."""
    for pattern, words in WORDS:
        message = re.sub(pattern, words, message)
    return message


@contextmanager
def as_python() -> Iterator[None]:
    """Refuse in Python's words, as InputError whatever was raised."""
    try:
        yield
    except (InputError, BenchError) as error:
        raise InputError(in_python(str(error))) from None  # one traceback, of what was called
