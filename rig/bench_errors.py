"""Errors of the bench.

RigError                     the tree's root; the command line prints it as one line and exits with status 2
|-- BenchError (ValueError)  a bench, protocol or campaign file is wrong: names the file, the key and the remedy
|-- BusError (OSError)       a bus is gone or will not answer; a single failed reading is an Outcome, not an error
|   `-- ConnectionFaults     everything on the bench that cannot be opened, each with its cause and its remedy
|-- StageError (OSError)     the stage is in alarm, stalled, or did not arrive in time
|-- CampaignPaused           the bench needs a person, or a person wants a pause; the same command goes on later
|-- CampaignAborted          a person ended the campaign
`-- RunDecision              of the run alone: RunSkipped, RunRepeated, as a person at a prompt wants it
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import astuple, dataclass

from shockrig.files.errors import InputError


class RigError(Exception):
    """Root of all errors that the bench raises."""


class BenchError(RigError, ValueError):
    """A bench, protocol or campaign file is wrong."""


class BusError(RigError, OSError):
    """A bus is gone or will not answer."""


@dataclass(frozen=True)
class ConnectionFault:
    """One instrument that cannot be used: device -> cause -> remedy."""

    device: str
    cause: str
    remedy: str

    def __str__(self) -> str:
        return ": ".join(filter(None, astuple(self)))


class ConnectionFaults(BusError):
    """Everything that is unplugged, at once. `tree()` is the same over several lines."""

    def __init__(self, faults: list[ConnectionFault]) -> None:
        self.faults = tuple(faults)
        super().__init__("; ".join(map(str, faults)))

    def tree(self) -> str:
        """Device, cause and remedy of each fault, each indented below the one before."""
        rows = (
            "\n".join(filter(None, (f.device, f"    {f.cause}", f.remedy and f"        {f.remedy}")))
            for f in self.faults
        )
        return "\n".join(rows)


class StageError(RigError, OSError):
    """The stage is in alarm, stalled, or did not arrive in time."""


class CampaignPaused(RigError, RuntimeError):
    """A run stays spoilt however often it is repeated, nobody answers, or a person wants a pause."""


class CampaignAborted(RigError):
    """A person at a prompt ended the campaign."""


class RunDecision(RigError):
    """What a person at a prompt decided for the run in progress."""


class RunSkipped(RunDecision):
    """The run is left out for now; the campaign goes on with the next one."""


class RunRepeated(RunDecision):
    """The run begins anew, which does not count as a fault."""


@contextmanager
def as_bench_errors() -> Iterator[None]:
    """What the file formats refuse, as the bench's own error, word for word."""
    try:
        yield
    except InputError as error:
        raise BenchError(str(error)) from None
