"""Goals as a person writes them, and the channels that they are for: `alpha 0.2 %, D 0.3 %, D 0.5 % at 0, t63 1 %,
minutes 90`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from shockrig.analysis.estimate.quantity import ChannelName, looked_for
from shockrig.files.campaign import Campaign
from shockrig.files.campaign_names import sensor_name
from shockrig.files.errors import InputError
from shockrig.files.ranges import RANGES

# Where a decision looks: every probe's channels, `temperature` and `humidity`, of the probe "2" `temperature-2`.

Place = str


def places(campaigns: Iterable[Campaign]) -> dict[Place, tuple[Campaign, ChannelName]]:
    """Every channel that some probes have, by name: the campaign as its probe saw it, and which channel of it."""
    return {sensor_name(name, one.probe): (one, name) for one in campaigns for name in looked_for(one)}


QUANTITY_OF: dict[str, tuple[ChannelName, ...]] = {
    "alpha": ("temperature",),
    "D": ("humidity",),
    "tau": ("temperature", "humidity"),
    "t63": ("temperature", "humidity"),
}
TIES = "ties decided"
USUAL_AMBIENTS_C = (0.0, 10.0, 20.0, 30.0, 40.0)
EXAMPLE = "alpha 0.2 %, D 0.3 %, ties decided, minutes 90"
_PRECISION = re.compile(r"(alpha|D|tau|t63) +(\d+(?:\.\d+)?) *%((?: +at(?: +-?\d+(?:\.\d+)?)+)?)(?: *(?:degC|°C))?")
_MINUTES = re.compile(r"minutes +(\d+(?:\.\d+)?)")


@dataclass(frozen=True)
class Precision:
    """One quantity to be known to a relative standard uncertainty, at some ambients (empty: at all that are wanted)."""

    quantity: str
    relative: float
    ambients_c: tuple[float, ...] = ()

    def __str__(self) -> str:
        where = f" at {' '.join(f'{t:g}' for t in self.ambients_c)}" if self.ambients_c else ""
        return f"{self.quantity} {100.0 * self.relative:g} %{where}"


@dataclass(frozen=True)
class Goals:
    """What a campaign is for.

    Attributes
    ----------
    precisions : tuple of Precision
    ties : bool
        Whether explanations that the data cannot tell apart have to be decided.
    minutes : float or None
        Most bench time that may be spent in all.
    ambients_c : tuple of float
        At which D is wanted; those of the standard campaign where nothing else is said.
    """

    precisions: tuple[Precision, ...]
    ties: bool = False
    minutes: float | None = None
    ambients_c: tuple[float, ...] = USUAL_AMBIENTS_C

    def __str__(self) -> str:
        parts = [*map(str, self.precisions), *([TIES] if self.ties else [])]
        return ", ".join(parts + ([f"minutes {self.minutes:g}"] if self.minutes is not None else []))

    @property
    def channels(self) -> tuple[ChannelName, ...]:
        """Whose rates are wanted; both where only ties are."""
        named = {name for p in self.precisions for name in QUANTITY_OF[p.quantity]}
        every: tuple[ChannelName, ...] = ("temperature", "humidity")
        return tuple(name for name in every if name in named or not named)


def parse_goals(text: str) -> Goals:
    """Goals from a text such as `alpha 0.2 %, D 0.3 %, ties decided, minutes 90`.

    `at` and temperatures [degC] behind a percentage say for which ambients it holds; where any does, D is wanted at
    those ambients alone, unless another D stands without.

    Raises
    ------
    InputError
        Naming the part that is not understood.
    """
    precisions: list[Precision] = []
    ties, minutes = False, None
    for part in (part.strip() for part in text.split(",")):
        if part == TIES:
            ties = True
        elif found := _MINUTES.fullmatch(part):
            minutes = float(found[1])
        elif found := _PRECISION.fullmatch(part):
            relative = float(found[2]) / 100.0
            if not 0.0 < relative < 0.5:
                raise InputError(f"--until: {part!r}: expected more than 0 and less than 50 %")
            ambients = tuple(float(t) for t in found[3].split()[1:])
            if far := next((t for t in ambients if not RANGES["temperature_c"].holds(t)), None):
                raise InputError(f"--until: {part!r}: {RANGES['temperature_c'].refusal(far)}; give degC")
            precisions.append(Precision(found[1], relative, ambients))
        else:
            raise InputError(f"--until: {part!r} is no goal; write e.g. {EXAMPLE!r}")
    if not precisions and not ties:
        raise InputError(f"--until: names nothing to be reached; write e.g. {EXAMPLE!r}")
    film = [p for p in precisions if "humidity" in QUANTITY_OF[p.quantity]]
    at = tuple(sorted({t for p in film for t in p.ambients_c}))
    everywhere = not film or any(not p.ambients_c for p in film)
    return Goals(tuple(precisions), ties, minutes, tuple(sorted({*at, *USUAL_AMBIENTS_C})) if everywhere else at)
