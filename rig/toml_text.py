"""The text of a TOML file that a person wrote, read with an error in words for whatever cannot be read."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from typing import Any

from shockrig.files.spelling import did_you_mean
from shockrig.rig.bench_errors import BenchError

MOST_DOTS = 2000  # in a line: tomllib takes a minute for a key of 100 000 parts
LARGEST_INTEGER = 2**63  # whole numbers of TOML go to 64 bits (v1.0.0, Integer)


def read_toml(text: str, where: str) -> dict[str, Any]:
    """The tables of a TOML text; `where` names it in messages.

    Raises
    ------
    BenchError
        It is no TOML, or holds a number or a nesting beyond all sense: says what, and in which line where that is told.
    """
    for number, line in enumerate(text.splitlines(), start=1):
        if line.count(".") > MOST_DOTS:
            raise BenchError(f"{where}, line {number}: not TOML: {line.count('.')} points in it; fix the line")
    try:
        content = tomllib.loads(text)
    except RecursionError:
        raise BenchError(f"{where}: not TOML: brackets within brackets without end; fix the file") from None
    except ValueError as error:  # also numbers of too many digits
        raise BenchError(f"{where}: not TOML: {error}; fix the line") from None
    _demand_numbers(content, where)
    return content


def refuse_unknown_keys(table: Iterable[str], known: Iterable[str], where: str) -> None:
    """Raise BenchError for the first key that is not known, with the nearest one that is."""
    for key in table:
        if key not in known:
            raise BenchError(f"{where}: unknown key {key!r}{did_you_mean(key, known)}")


def _demand_numbers(value: object, where: str) -> None:
    if isinstance(value, int) and not -LARGEST_INTEGER <= value < LARGEST_INTEGER:
        raise BenchError(f"{where}: not TOML: a whole number of more than 64 bits; fix the line")
    for item in value.values() if isinstance(value, Mapping) else value if isinstance(value, list) else ():
        _demand_numbers(item, where)
