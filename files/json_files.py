"""JSON as this project reads and writes it: one reader whose errors name file, line and key, one writer.

UTF-8, every number finite, unknown keys ignored, an unknown value left out or null.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

from shockrig.files.disk import read_text, shown, write_whole
from shockrig.files.errors import InputError
from shockrig.files.file_table import FileTable, kind_of, shortened

ROOM_FOR_DIGITS = 7  # significant ones of a number that was measured: more would claim more than is known


def read_json(path: str | os.PathLike[str], expected: str | None, remedy: str) -> FileTable:
    """Read a file that holds one JSON object.

    Parameters
    ----------
    path : path
    expected : str or None
        What its key `format` must say; None where any will do.
    remedy : str
        What the user can do where it is not that; the end of the message.

    Raises
    ------
    InputError
        The file cannot be read, is not JSON, is no object, or is of another format: names file, line or key, remedy.
    """
    return parse_json(read_text(path, remedy), shown(path), expected, remedy)


def parse_json(text: str, source: str, expected: str | None, remedy: str) -> FileTable:
    """As `read_json`, from text; `source` names it in errors."""
    try:
        content = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:  # also numbers of too many digits
        line = getattr(error, "lineno", None)
        where = source if line is None else f"{source}, line {line}"
        raise InputError(f"{where}: not JSON: {getattr(error, 'msg', error)}; {remedy}") from None
    if "\\u" in text:
        _refuse_half_characters(content, source)
    return as_object(content, source, expected, remedy)


def as_object(content: object, source: str, expected: str | None, remedy: str) -> FileTable:
    """Parsed JSON as an object of format `expected` (None: of any); arguments and errors as for `read_json`."""
    if not isinstance(content, dict):
        wanted = "a JSON object" if expected is None else f'a JSON object with "format": "{expected}"'
        raise InputError(f"{source}: expected {wanted}, found {kind_of(content)}; {remedy}")
    if expected is not None and content.get("format") != expected:
        raise InputError(
            f'{source}: key format: expected "{expected}", found {shortened(content.get("format"))}; {remedy}'
        )
    return FileTable(content, source)


def json_text(content: Mapping[str, Any], indent: int = 1) -> str:
    """The text of a JSON file. Raises ValueError where a number is not finite."""
    return json.dumps(content, indent=indent, allow_nan=False, ensure_ascii=False) + "\n"


def write_json(path: Path, content: Mapping[str, Any], *, indent: int = 1, sync: bool = False) -> None:
    """Write a JSON file, whole or not at all; `sync` waits for the disk.

    Raises
    ------
    ValueError
        A number is not finite; nothing is written.
    OSError
        The disk does not take it; nothing is left.
    """
    write_whole(path, json_text(content, indent), sync)


def known(**items: Any) -> dict[str, Any]:
    """The items that are not None, in their order: what is unknown is left out of a file."""
    return {key: value for key, value in items.items() if value is not None}


def made_of(kind: Any, content: Any) -> Any:
    """A dataclass from what `dataclasses.asdict` left of it in a JSON file, with all that is within it.

    Raises
    ------
    AttributeError, TypeError, ValueError
        A field is missing, or is not of its kind.
    """
    if isinstance(kind, type) and is_dataclass(kind):
        kinds = get_type_hints(kind)
        return kind(**{field.name: made_of(kinds[field.name], content.get(field.name)) for field in fields(kind)})
    if isinstance(kind, UnionType):  # with None
        return None if content is None else made_of(get_args(kind)[0], content)
    if content is None:
        raise TypeError(f"a field is missing, of {kind}")
    if get_origin(kind) is tuple:
        return tuple(made_of(get_args(kind)[0], one) for one in content)
    if get_origin(kind) is Mapping:
        return {key: made_of(get_args(kind)[1], one) for key, one in content.items()}
    return kind(content) if kind in (bool, float, int, str) else content


def measured(value: float | None) -> float | None:
    """A measured number to seven significant digits; None (left out) where it is unknown or not finite."""
    if value is None or not math.isfinite(value):
        return None
    return float(f"{float(value):.{ROOM_FOR_DIGITS}g}")


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is no number of JSON; leave an unknown value out")


def _refuse_half_characters(content: object, source: str) -> None:
    """Raise where a text or key holds half of a surrogate pair: it has no UTF-8 form, so no file could repeat it."""
    left: list[tuple[object, str]] = [(content, "")]
    while left:
        value, path = left.pop()
        if isinstance(value, str) and any("\ud800" <= c <= "\udfff" for c in value):
            raise InputError(f"{source}: key {path or 'top level'}: holds half of a character; fix the text")
        if isinstance(value, dict):
            for key, item in value.items():
                name = key.encode("utf-8", "backslashreplace").decode()
                left += [(key, f"{path}.{name}".lstrip(".")), (item, f"{path}.{name}".lstrip("."))]
        elif isinstance(value, list):
            left += [(item, f"{path}[{i}]") for i, item in enumerate(value)]
