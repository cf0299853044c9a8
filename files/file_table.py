"""Checked access to what a JSON or TOML file holds: every error names the file, the whole key and the remedy."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from shockrig.files.errors import InputError
from shockrig.files.ranges import Range
from shockrig.files.spelling import ALIKE_KEYS, did_you_mean, nearest

LONGEST_SHOWN = 60


@dataclass(frozen=True)
class FileTable:
    """Checked access to one object of a JSON file or one table of a TOML file; errors name the file and the whole key.

    A key that is left out and one that is null are alike.
    """

    content: Mapping[str, Any]
    source: str
    path: str = ""  # of this object in the file, such as "sensors.imet."
    remedy: str = ""  # of all that is wrong in this file; empty: what fits the single fault

    def know(self, *keys: str) -> None:
        """Raise the error of the first key that is none of `keys`, with the one that may have been meant."""
        for key in self.content:
            if key not in keys:
                raise self._unknown(key, keys)

    def know_nearly(self, *keys: str) -> None:
        """As `know`, of a format that may hold other keys as well: only of a key that is nearly one that is missing."""
        missing = set(keys) - set(self.content)
        for key in self.content:
            if key not in keys and nearest(key, missing, ALIKE_KEYS):
                raise self._unknown(key, keys)

    def _unknown(self, key: str, keys: Collection[str]) -> InputError:
        where = f": [{self.path[:-1]}]" if self.path else ""
        return InputError(f"{self.source}{where}: unknown key {key!r}{did_you_mean(key, keys)}")

    def refuse(self, key: str, what: str, remedy: str = "fix it or leave it out") -> InputError:
        """The error of one key, to be raised: what is wrong with it, and the remedy."""
        return InputError(f"{self.source}: key {self.path}{key}: {what}; {self.remedy or remedy}")

    def error(self, key: str, expected: str, found: object, remedy: str = "fix it or leave it out") -> InputError:
        """The error of one key, to be raised: what was expected of it, what was found, the remedy."""
        return self.refuse(key, f"expected {expected}, found {shortened(found)}", remedy)

    def wrong(self, key: str, expected: str) -> InputError:
        """As `error`, of what stands under the key."""
        return self.error(key, expected, self.get(key))

    def get(self, key: str) -> Any:
        """The value as it stands; None where there is none."""
        return self.content.get(key)

    def child(self, key: str) -> FileTable | None:
        """The object under `key`; None where there is none."""
        value = self.get(key)
        if value is None:
            return None
        if not isinstance(value, dict):
            raise self.error(key, "an object", value, "write it as {...}")
        return FileTable(value, self.source, f"{self.path}{key}.", self.remedy)

    def mapping(self, key: str) -> FileTable:
        """As `child`, an empty object where there is none."""
        return self.child(key) or FileTable({}, self.source, f"{self.path}{key}.", self.remedy)

    def children(self, key: str) -> Iterator[tuple[str, FileTable]]:
        """Names and objects of the object under `key` that are there."""
        under = self.mapping(key)
        for name in under.content:
            child = under.child(name)
            if child is not None:
                yield name, child

    def items(self, key: str, first: int = 0) -> list[FileTable]:
        """The objects of the list under `key`, counted from `first` in messages; empty where there is none."""
        items = []
        for i, item in enumerate(self.sequence(key), start=first):
            if not isinstance(item, dict):
                raise self.error(f"{key}[{i}]", "an object", item, "write it as {...}")
            items.append(FileTable(item, self.source, f"{self.path}{key}[{i}].", self.remedy))
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

    def one_of(self, key: str, words: Collection[str]) -> str | None:
        """As `word`; None where there is none."""
        return None if self.get(key) is None else self.word(key, words)

    def name(self, key: str) -> str | None:
        """A text of one line under `key`; None where there is none."""
        value = self.text(key)
        if value is not None and not (value and value.isprintable()):
            raise self.error(key, "text of one line", value)
        return value

    def flag(self, key: str) -> bool | None:
        """True or false under `key`; None where there is none."""
        return None if self.get(key) is None else self.yes_or_no(key)

    def whole(self, key: str, within: Range) -> int | None:
        """The whole number under `key`; None where there is none."""
        value = self.get(key)
        if value is None:
            return None
        if not isinstance(value, int) or isinstance(value, bool) or not within.holds(value):
            raise self.error(key, f"a whole number from {within.low:.0f} to {within.high:.0f}", value)
        return value

    def several(self, key: str) -> tuple[str, ...]:
        """A text or number under `key`, or a list of them, as texts; empty where there is none."""
        value = self.get(key)
        items = value if isinstance(value, list) else [] if value is None else [value]
        if not all(isinstance(item, str | int | float) and not isinstance(item, bool) for item in items):
            raise self.error(key, "text or a list of text", value)
        return tuple(str(item) for item in items)

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


def kind_of(value: object) -> str:
    """What a value is, in words for a message."""
    kinds = {dict: "an object", list: "a list", str: "text", bool: "true or false", type(None): "null"}
    return kinds.get(type(value), "a number")


def shortened(value: object) -> str:
    """What was found, as far as a line can show it."""
    if isinstance(value, dict | list):
        return kind_of(value)
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 10**LONGEST_SHOWN:
        return f"a number of more than {LONGEST_SHOWN} digits"
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."
