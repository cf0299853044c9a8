"""Errors of the bench.

RigError                     the tree's root; the command line prints it as one line and exits with status 2
|-- BenchError (ValueError)  a bench, protocol or campaign file is wrong: names the file, the key and the remedy
|-- BusError (OSError)       a bus is gone or will not answer; a single failed reading is an Outcome, not an error
`-- StageError (OSError)     the stage is in alarm, stalled, or did not arrive in time
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from shockrig.files.errors import InputError


class RigError(Exception):
    """Root of all errors that the bench raises."""


class BenchError(RigError, ValueError):
    """A bench, protocol or campaign file is wrong."""


class BusError(RigError, OSError):
    """A bus is gone or will not answer."""


class StageError(RigError, OSError):
    """The stage is in alarm, stalled, or did not arrive in time."""


@contextmanager
def as_bench_errors() -> Iterator[None]:
    """What the file formats refuse, as the bench's own error, word for word."""
    try:
        yield
    except InputError as error:
        raise BenchError(str(error)) from None
