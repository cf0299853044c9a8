"""The append-only journal of a run: one text line for each record, so that a recording killed at any byte can be read.

    CRC32 of the JSON (8 hex digits), space, the JSON of the record (one list, no line break), line feed

A line without its line feed or with a wrong checksum is not whole: at the end a torn tail, elsewhere damage.
"""

from __future__ import annotations

import json
import os
import zlib
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shockrig.files.disk import read_bytes

_encode = json.JSONEncoder(separators=(",", ":"), allow_nan=False, ensure_ascii=True).encode


class AppendedFile:
    """A new file that lines are appended to; every line is handed to the operating system at once.

    A killed process therefore loses at most the line being written. Against a power cut the file is also forced to
    the disk, once in `sync_every_s` (None: never, for virtual clocks). A thread of its own waits for that, because a
    memory card may take a second, in which the sensors' lines would come late. What it finds wrong, the next line
    says.
    """

    def __init__(self, path: Path, sync_every_s: float | None = 1.0):
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
        self._sync_every_s = sync_every_s
        self._synced_s = float("-inf")
        self._disk = None if sync_every_s is None else ThreadPoolExecutor(1, "journal")
        self._syncing: Future[None] | None = None

    def write(self, line: bytes, now_s: float) -> None:
        """Write one line, its line feed with it; raises OSError when the disk is full or gone."""
        written = os.write(self._file, line)
        while written < len(line):  # a disk about to be full takes a part; the next write says why
            written += os.write(self._file, line[written:])
        if self._disk is None or self._sync_every_s is None:
            return
        if now_s - self._synced_s >= self._sync_every_s:
            if self._syncing is not None:
                if not self._syncing.done():
                    return  # a slow disk is not hurried by asking twice
                self._syncing.result()
            self._syncing = self._disk.submit(os.fdatasync, self._file)
            self._synced_s = now_s

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        if self._file >= 0:
            file, self._file = self._file, -1
            try:
                if self._disk is not None:
                    self._disk.shutdown()
                    os.fsync(file)
            finally:
                os.close(file)


class JournalWriter(AppendedFile):
    """Appends records to a new journal."""

    def append(self, record: list[Any], now_s: float) -> None:
        """Write one record, stamped by the caller; raises OSError when the disk is full or gone."""
        text = _encode(record).encode("ascii")
        self.write(b"%08x %b\n" % (zlib.crc32(text), text), now_s)


@dataclass(frozen=True)
class Journal:
    """What a journal file holds: every whole record in order, and how much was not whole."""

    records: tuple[list[Any], ...]
    damaged_lines: int
    torn_bytes: int


def read_journal(path: Path) -> Journal:
    """Read every whole record of a journal, however it ended.

    Raises
    ------
    InputError
        The file cannot be read, or is no file.
    """
    lines = read_bytes(path, "take it away or restore it").split(b"\n")
    tail = lines.pop()
    whole = [decode_line(line) for line in lines]
    records = tuple(record for record in whole if record is not None)
    return Journal(records=records, damaged_lines=len(whole) - len(records), torn_bytes=len(tail))


def _refuse(constant: str) -> float:
    raise ValueError(f"{constant} is no number of JSON")


def decode_line(line: bytes) -> list[Any] | None:
    """The record of one line (without its line feed); None where it is not whole."""
    text = line[9:]
    try:
        if line[:9] != b"%08x " % zlib.crc32(text):
            return None
        record = json.loads(text, parse_constant=_refuse)
    except (ValueError, RecursionError):
        return None
    return record if isinstance(record, list) and record else None
