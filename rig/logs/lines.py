"""The lines of a text, held as its bytes and where each begins: a million of them take 8 MB beside the text itself."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import overload

import numpy as np
from numpy.typing import NDArray

from shockrig.files.disk import decoded, demand_text_name, read_bytes, shown
from shockrig.files.unit_names import FOREIGN_WORDS
from shockrig.rig.bench_errors import BenchError

Index = NDArray[np.uint32]  # no file of more than 2^30 bytes is read

BYTES = 1 << 20  # that are searched for line ends at a time
NO_TEXT = "\N{REPLACEMENT CHARACTER}".encode()
# bytes that a log of text holds: all but control characters, of which loggers write those from 7 to 13, 26 and 27
NO_BINARY = bytes([0, *range(7, 14), 26, 27, *range(32, 256)])
BLOCK = 10_000  # lines that are looked up at a time
# "13:00:00.000 -> 20.02,45.4": when a program on the serial line received what stands behind
RECEIVED = re.compile(rb"^(\S*\d:\d\d:\d\d\S*) -> (?=[^,;\t|\n]*([,;\t|])|)", re.M)


@dataclass(frozen=True, eq=False)
class Lines(Sequence[str]):
    """Some lines of a text: `content` is all of it in UTF-8, `begins` is where each of its lines begins, and one beyond
    its end; `places` are those of these lines among them, from 0."""

    content: bytes
    begins: Index
    places: Index

    @property
    def numbers(self) -> Index:
        """The lines' numbers in the file, from 1."""
        return self.places + np.uint32(1)

    def number(self, place: int) -> int:
        """One line's number in the file, from 1."""
        return int(self.places[place]) + 1

    def __len__(self) -> int:
        return int(self.places.size)

    @overload
    def __getitem__(self, place: int) -> str: ...
    @overload
    def __getitem__(self, place: slice) -> Lines: ...
    def __getitem__(self, place: int | slice) -> str | Lines:
        if isinstance(place, slice):
            return Lines(self.content, self.begins, self.places[place])
        line = int(self.places[place])
        return self.content[int(self.begins[line]) : int(self.begins[line + 1]) - 1].decode()

    def __iter__(self) -> Iterator[str]:
        for first in range(0, len(self), BLOCK):
            places = self.places[first : first + BLOCK]
            for begin, end in zip(self.begins[places].tolist(), self.begins[places + 1].tolist(), strict=True):
                yield self.content[begin : end - 1].decode()

    def text(self) -> bytes | None:
        """The lines, each with its end; None where others stand between them."""
        if not len(self) or int(self.places[-1]) - int(self.places[0]) != len(self) - 1:
            return None
        content = self.content[int(self.begins[self.places[0]]) : int(self.begins[self.places[-1] + 1])]
        return content if content.endswith(b"\n") else content + b"\n"

    def where(self, holds: NDArray[np.bool_]) -> Lines:
        """Those of the lines for which it holds."""
        return self if holds.all() else Lines(self.content, self.begins, self.places[holds])


def _parted(content: bytes) -> bytes:
    """A text whose lines bear the time of day at which they were received as if it were a cell of theirs."""
    between = Counter(match[2] for match in RECEIVED.finditer(content)) if b" -> " in content else Counter()
    if 2 * between.total() <= content.count(b"\n"):
        return content
    separator = between.most_common(1)[0][0] or b" "
    return RECEIVED.sub(lambda match: match[1] + separator, content)


def read_lines(path: Path) -> Lines:
    """The lines of a text file in whatever encoding, line ends and all.

    Raises
    ------
    BenchError
        It is no text: names the line and the remedy.
    """
    demand_text_name(path, "rename it")
    content = read_bytes(path, "name a text file of readings")
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        content = content.decode("utf-16", errors="replace").encode(errors="replace")
    elif not content.isascii():
        content = decoded(content, FOREIGN_WORDS).encode(errors="replace")
    if b"\r" in content:
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    content = _parted(content)
    if b"\0" in content:
        every = content.split(b"\n")
        spoilt = [k for k, line in enumerate(every, start=1) if b"\0" in line]
        if len(spoilt) > 0.5 * len(every) or content.translate(None, delete=NO_BINARY):
            raise BenchError(f"{shown(path)}, line {spoilt[0]}: holds a NUL byte; is it a text file? Export it as CSV")
        # A logger that lost its power while it wrote: what is there is no number, and counted as such.
        content = content.replace(b"\0", NO_TEXT)
    found = [
        (
            np.flatnonzero(np.frombuffer(content, np.uint8, min(BYTES, len(content) - at), at) == ord("\n")) + at + 1
        ).astype(np.uint32)
        for at in range(0, len(content), BYTES)
    ]
    begins: Index = np.concatenate([np.zeros(1, np.uint32), *found, np.full(1, len(content) + 1, np.uint32)])
    places: Index = np.arange(begins.size - 1, dtype=np.uint32)
    return Lines(content, begins, places)
