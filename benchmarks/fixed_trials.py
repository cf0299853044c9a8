"""Blind trials that once went wrong, or that are dear: each has to come out as it says. Too slow for the test suite.

    python benchmarks/fixed_trials.py

prints a line a trial and ends with status 1 where one is not as expected. `tests/test_diagnosis_trials.py` has the
cheap ones.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from diagnosis_trials import line, trial

Result = dict[str, Any]
FLOOR = 1.3  # times the noise: what an extended model leaves on unseen runs at most
WON = 0.5  # of the plain model's error: what it leaves at most


def exact(result: Result) -> bool:
    """What is hidden is named in every channel, and nothing else."""
    return bool(result["score"].exact)


def nothing(result: Result) -> bool:
    """Every channel is adequate, and nothing is named."""
    return all(c["verdict"] == "adequate" and not c["causes"] for c in result["diagnosis"]["channels"].values())


def exact_to_the_noise(result: Result) -> bool:
    """Exact, and what is named predicts unseen runs about as well as their noise lets one."""
    gains = [channel["gain"] for channel in result["diagnosis"]["channels"].values()]
    predicts = all(
        gain["held_out_rmse_after"] < FLOOR * gain["noise_floor"] < WON * gain["held_out_rmse_before"] for gain in gains
    )
    return exact(result) and predicts


def rate_that_moves_with_the_ambient(result: Result) -> bool:
    """Described as that, with nothing named, and every channel's verdict is right."""
    found = result["diagnosis"]["channels"]["temperature"]
    behaviours = [(one["behaves_as"], [on["factor"] for on in one["depends_on"]]) for one in found["discovered"]]
    described = (found["verdict"], found["causes"], behaviours) == ("described", [], [("rate_change", ["ambient"])])
    return described and all(c.verdict_right and not c.wrong for c in result["score"].channels.values())


@dataclass(frozen=True)
class Fixed:
    """A trial of `diagnosis_trials.trial`, tier rough, and what its result has to be."""

    kind: str
    strength: str
    seed: int
    expected: Callable[[Result], bool]


FIXED = (
    Fixed("one", "comfortable", 7000, exact),
    Fixed("one", "comfortable", 7002, exact),
    Fixed("none", "comfortable", 7011, nothing),
    # A lag does not stand in the place of a slow transfer: the fit without the lag ends at five times the film's Biot
    # number, and no transfer leads back from there.
    Fixed("ordinary", "comfortable", 47706, exact_to_the_noise),
    Fixed("outside", "comfortable", 7034, rate_that_moves_with_the_ambient),
    # Two or three runs in each ambient and direction say little of how much runs differ in their rate.
    Fixed("one", "limit", 47107, exact),
)


def main() -> int:
    wrong = 0
    for fixed in FIXED:
        result = trial(fixed.kind, "rough", fixed.strength, fixed.seed)
        right = fixed.expected(result)
        wrong += not right
        print(f"{'right' if right else 'WRONG'} {fixed.kind} {fixed.strength} {line(fixed.seed, result)}", flush=True)
    print(f"{len(FIXED) - wrong} of {len(FIXED)} as expected")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
