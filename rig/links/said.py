"""What is said of the air at one instant, and who says it: the same for every kind of message."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

Pair = tuple[float, float]


@dataclass(frozen=True)
class SaidAir:
    """Temperature [degC] and humidity [%RH] at `time_s` on the sender's clock; NaN where there is no value.

    `air` is the best that is known; `uncertainty` its standard uncertainty and `read` the readings, None where nothing
    was corrected.
    """

    time_s: float
    air: Pair
    uncertainty: Pair | None = None
    read: Pair | None = None

    def pairs(self) -> tuple[Pair, ...]:
        """The air, and what was read where that is another: sensors 0 and 1 of a message's sensor ids."""
        return (self.air,) if self.read is None else (self.air, self.read)


class Speaker(Protocol):
    """What says airs to others. Nothing that it does waits or fails: a flight goes on without listeners."""

    @property
    def dropped(self) -> int:
        """Messages that could not be sent."""
        ...

    def send(self, said: SaidAir) -> None: ...

    def tell(self, text: str, now_s: float) -> None:
        """A line for whoever watches the flight."""
        ...

    def beat(self, now_s: float) -> None:
        """Once a second: signs of life, and answers."""
        ...

    def close(self) -> None: ...
