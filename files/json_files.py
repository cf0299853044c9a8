"""JSON as this project reads and writes it: one reader whose errors name file, line and key, one writer.

UTF-8, every number finite, unknown keys ignored, an unknown value left out or null.
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shockrig.files.disk import read_text, shown, write_whole
from shockrig.files.errors import InputError
from shockrig.files.ranges import Range

LONGEST_SHOWN = 60
ROOM_FOR_DIGITS = 7  # significant ones of a number that was measured: more would claim more than is known


def read_json(path: str | os.PathLike[str], expected: str | None, remedy: str) -> JsonObject:
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


def parse_json(text: str, source: str, expected: str | None, remedy: str) -> JsonObject:
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


def as_object(content: object, source: str, expected: str | None, remedy: str) -> JsonObject:
    """Parsed JSON as an object of format `expected` (None: of any); arguments and errors as for `read_json`."""
    if not isinstance(content, dict):
        wanted = "a JSON object" if expected is None else f'a JSON object with "format": "{expected}"'
        raise InputError(f"{source}: expected {wanted}, found {_kind(content)}; {remedy}")
    if expected is not None and content.get("format") != expected:
        raise InputError(
            f'{source}: key format: expected "{expected}", found {_short(content.get("format"))}; {remedy}'
        )
    return JsonObject(content, source)


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


def measured(value: float | None) -> float | None:
    """A measured number to seven significant digits; None (left out) where it is unknown or not finite."""
    if value is None or not math.isfinite(value):
        return None
    return float(f"{float(value):.{ROOM_FOR_DIGITS}g}")


@dataclass(frozen=True)
class JsonObject:
    """Checked access to one JSON object of a file; every error names the file and the whole key.

    A key that is left out and one that is null are alike.
    """

    content: Mapping[str, Any]
    source: str
    path: str = ""  # of this object in the file, such as "sensors.imet."
    remedy: str = ""  # of all that is wrong in this file; empty: what fits the single fault

    def refuse(self, key: str, what: str, remedy: str = "fix it or leave it out") -> InputError:
        """The error of one key, to be raised: what is wrong with it, and the remedy."""
        return InputError(f"{self.source}: key {self.path}{key}: {what}; {self.remedy or remedy}")

    def error(self, key: str, expected: str, found: object, remedy: str = "fix it or leave it out") -> InputError:
        """The error of one key, to be raised: what was expected of it, what was found, the remedy."""
        return self.refuse(key, f"expected {expected}, found {_short(found)}", remedy)

    def get(self, key: str) -> Any:
        """The value as it stands; None where there is none."""
        return self.content.get(key)

    def child(self, key: str) -> JsonObject | None:
        """The object under `key`; None where there is none."""
        value = self.get(key)
        if value is None:
            return None
        if not isinstance(value, dict):
            raise self.error(key, "an object", value, "write it as {...}")
        return JsonObject(value, self.source, f"{self.path}{key}.", self.remedy)

    def mapping(self, key: str) -> JsonObject:
        """As `child`, an empty object where there is none."""
        return self.child(key) or JsonObject({}, self.source, f"{self.path}{key}.", self.remedy)

    def children(self, key: str) -> Iterator[tuple[str, JsonObject]]:
        """Names and objects of the object under `key` that are there."""
        under = self.mapping(key)
        for name in under.content:
            child = under.child(name)
            if child is not None:
                yield name, child

    def items(self, key: str) -> list[JsonObject]:
        """The objects of the list under `key`; empty where there is none."""
        items = []
        for i, item in enumerate(self.sequence(key)):
            if not isinstance(item, dict):
                raise self.error(f"{key}[{i}]", "an object", item, "write it as {...}")
            items.append(JsonObject(item, self.source, f"{self.path}{key}[{i}].", self.remedy))
        return items

    def sequence(self, key: str) -> list[Any]:
        """The list under `key`; empty where there is none."""
        value = self.get(key)
        if value is None:
            return []
        if not isinstance(value, list):
            raise self.error(key, "a list", value, "write it as [...]")
        return value

    def text(self, key: str, what: str = "text") -> str | None:
        """The text under `key`; None where there is none. `what` it should be, for the message."""
        value = self.get(key)
        if value is not None and not isinstance(value, str):
            raise self.error(key, what, value)
        return value

    def word(self, key: str, words: Collection[str]) -> str:
        """The text under `key`, which must be one of `words`."""
        value = self.get(key)
        if not isinstance(value, str) or value not in words:
            raise self.error(key, f"one of {', '.join(words)}", value, "name one of them")
        return value

    def yes_or_no(self, key: str) -> bool:
        """True or false under `key`, which must be there."""
        value = self.get(key)
        if not isinstance(value, bool):
            raise self.error(key, "true or false", value, "say which")
        return value

    def texts(self, key: str, what: str = "a list of text") -> tuple[str, ...]:
        """The list of texts under `key`; empty where there is none."""
        value = self.get(key)
        if value is None:
            return ()
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise self.error(key, what, value)
        return tuple(value)

    def number(
        self, key: str, within: Range | None = None, *, positive: bool = False, at_least: float | None = None
    ) -> float | None:
        """The number under `key`; None where there is none.

        Raises
        ------
        InputError
            It is no number, not finite, not positive where that is demanded, below `at_least`, or not `within` a range.
        """
        value = self.get(key)
        if value is None:
            return None
        wanted = "a positive number" if positive else "a finite number"
        wanted += "" if at_least is None else f" of at least {at_least:g}"
        if not is_number(value) or (positive and value <= 0) or (at_least is not None and value < at_least):
            raise self.error(key, wanted, value)
        if within is not None and not within.holds(value):
            raise self.refuse(key, within.refusal(value))
        return float(value)

    def demand(self, key: str, value: float | None, expected: str = "a number") -> float:
        """`value`, which must not be None; raises the error of `key` where it is."""
        if value is None:
            raise self.error(key, expected, None, "add it")
        return value


def is_number(value: object) -> bool:
    """Whether a parsed value is a finite number (true and false are none)."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


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


def _kind(value: object) -> str:
    kinds = {dict: "an object", list: "a list", str: "text", bool: "true or false", type(None): "null"}
    return kinds.get(type(value), "a number")


def _short(value: object) -> str:
    """What was found, as far as a line can show it."""
    if isinstance(value, dict | list):
        return _kind(value)
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 10**LONGEST_SHOWN:
        return f"a number of more than {LONGEST_SHOWN} digits"
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."
