"""Checked access to the tables of a TOML file that a person wrote: every error names the file and the whole key."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from shockrig.files.json_files import is_number
from shockrig.files.ranges import Range
from shockrig.rig.errors import BenchError
from shockrig.rig.keys import refuse_unknown_keys


@dataclass(frozen=True)
class TomlTable:
    """A TOML table with checked access; every error names the file and the whole key."""

    content: Mapping[str, Any]
    where: str
    path: str

    def know(self, *keys: str) -> None:
        refuse_unknown_keys(self.content, keys, f"{self.where}{f': [{self.path[:-1]}]' if self.path else ''}")

    def wrong(self, key: str, expected: str) -> BenchError:
        found = repr(self.content.get(key))[:60]
        return BenchError(
            f"{self.where}: key {self.path}{key}: expected {expected}, found {found}; fix it or leave it out"
        )

    def _get(self, key: str, is_right: Callable[[Any], bool], expected: str) -> Any:
        value = self.content.get(key)
        if value is not None and not is_right(value):
            raise self.wrong(key, expected)
        return value

    def text(self, key: str) -> str | None:
        value = self._get(key, lambda item: isinstance(item, str) and item.isprintable() and bool(item), "text")
        return None if value is None else str(value)

    def flag(self, key: str) -> bool | None:
        value = self._get(key, lambda item: isinstance(item, bool), "true or false")
        return None if value is None else bool(value)

    def one_of(self, key: str, words: tuple[str, ...]) -> str | None:
        value = self._get(key, lambda item: item in words, f"one of {', '.join(words)}")
        return None if value is None else str(value)

    def whole(self, key: str, low: int, high: int) -> int | None:
        def is_right(item: Any) -> bool:
            return isinstance(item, int) and not isinstance(item, bool) and low <= item <= high

        value = self._get(key, is_right, f"a whole number of at least {low}")
        return None if value is None else int(value)

    def number(self, key: str, within: Range) -> float | None:
        value = self._get(key, is_number, "a number")
        if value is None:
            return None
        if not within.low <= value <= within.high:
            raise BenchError(f"{self.where}: key {self.path}{key}: {within.refusal(value)}; fix it or leave it out")
        return float(value)

    def several(self, key: str) -> list[Any]:
        """A text or number, or a list of them, as a list."""
        value = self.content.get(key)
        items = value if isinstance(value, list) else [] if value is None else [value]
        if not all(isinstance(item, str | int | float) and not isinstance(item, bool) for item in items):
            raise self.wrong(key, "text or a list of text")
        return items

    def table(self, key: str) -> TomlTable:
        value = self._get(key, lambda item: isinstance(item, dict), "a table")
        return TomlTable(value or {}, self.where, f"{self.path}{key}.")

    def tables(self, key: str) -> list[tuple[str, TomlTable]]:
        under = self.table(key)
        return [(name, under.table(name)) for name in under.content]

    def list(self, key: str) -> list[TomlTable]:
        value = self.content.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise self.wrong(key, f"tables, each under [[{key}]]")
        return [TomlTable(item, self.where, f"{self.path}{key}[{n}].") for n, item in enumerate(value, start=1)]
