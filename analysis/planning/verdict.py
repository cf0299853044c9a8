"""What is kept of a channel from look to look: its verdict, what is tied, and what new runs have ruled out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from shockrig.analysis.characterization.extension import Extension, extension_of
from shockrig.analysis.diagnosis.outcome import Explanation
from shockrig.analysis.effects.described import described, discovered_of, is_described
from shockrig.analysis.inference.quantity import ChannelName
from shockrig.analysis.planning.evidence import REJECTED, Dispute, label_of
from shockrig.files.causes import StatedEffect, Uncertain


@dataclass(frozen=True)
class Verdict:
    """What is kept of a channel from look to look.

    Attributes
    ----------
    verdict : str
        As in a diagnosis; "adequate" before the first.
    runs : int
        With how many runs the last diagnosis was made; 0: none yet.
    causes : mapping
        What its model carries beside the plain one, named or described, with the values that a fit begins from.
    dispute : Dispute or None
        What was tied then.
    against : tuple of float
        ln E against each of its explanations by now.
    out : tuple of tuple of str
        Effects of each explanation that new runs have ruled out.
    looks : int
        How many diagnoses were made.
    settled : tuple of (Dispute, tuple of float)
        Disputes that are over, with ln E against each explanation at their ends.
    final : bool
        Whether the last diagnosis would be no other as one of all runs at the end.
    due : bool
        Whether a diagnosis of the runs of this look is to be made while the next run is recorded.
    """

    verdict: str = "adequate"
    runs: int = 0
    causes: Explanation = field(default_factory=dict)
    dispute: Dispute | None = None
    against: tuple[float, ...] = ()
    out: tuple[tuple[str, ...], ...] = ()
    looks: int = 0
    settled: tuple[tuple[Dispute, tuple[float, ...]], ...] = ()
    final: bool = False
    due: bool = False

    @property
    def tied(self) -> tuple[str, ...]:
        """Explanations that still stand beside one another; empty where there is one."""
        standing = self.standing
        return tuple(label_of(e, self.explanations) for e in standing) if len(standing) > 1 else ()

    @property
    def explanations(self) -> tuple[Explanation, ...]:
        """Of the dispute."""
        return self.dispute.explanations if self.dispute else ()

    @property
    def standing(self) -> tuple[Explanation, ...]:
        """Explanations of the dispute that are not out."""
        return tuple(e for e, out in zip(self.explanations, self.against, strict=True) if out < REJECTED)

    @property
    def left(self) -> bool:
        """Whether something is left that no catalogued effect explains, described or not."""
        return self.verdict in ("unexplained", "described")

    @property
    def decided(self) -> bool:
        """Whether there was a dispute and new runs have left at most one explanation."""
        return self.dispute is not None and len(self.standing) < 2

    @property
    def named(self) -> tuple[str, ...]:
        """Effects of the catalogue that it names."""
        return tuple(e for e in self.causes if not is_described(e))

    @property
    def describes(self) -> bool:
        """Whether an explanation that stands beside others is one that nobody listed."""
        return bool(self.tied) and any(is_described(e) for one in self.standing for e in one)

    def extension(self, channel: ChannelName) -> Extension:
        """The model that the characterization uses: with what is named or described, or may be."""
        causes = [
            StatedEffect(effect, {name: Uncertain(value, 0.0) for name, value in self.causes[effect].items()}, 1.0)
            for effect in self.named
        ]
        others = [
            discovered_of(described(id_, channel == "humidity"), {k: (v, 0.0) for k, v in values.items()})
            for id_, values in self.causes.items()
            if is_described(id_)
        ]
        return extension_of(causes, others, channel)


def extended(verdicts: Mapping[ChannelName, Verdict]) -> dict[ChannelName, Extension]:
    """Extended models of the channels of which something is named."""
    return {name: verdict.extension(name) for name, verdict in verdicts.items() if verdict.causes}
