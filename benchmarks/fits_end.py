"""Where fits end: those of diagnoses begun again with each number of the fit halved and doubled.

    python benchmarks/fits_end.py [--seeds 10330 10345 10353 10355 10357] [--campaigns DIR ...] [--most 20]

Diagnosed are the worlds of `unforeseen_worlds.py` with these seeds, and campaigns in folders. Of the fits that each
takes, drawn at random, this prints the share that ends within 1 of the lowest -2 log likelihood that any variant
reaches, the share that goes down by more than 10 when begun anew where it had ended, and evaluations of a model over
those as it is.
"""

from __future__ import annotations

import argparse
import inspect
import random
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from ours import judge
from unforeseen_worlds import draw, record

from shockrig.analysis.estimate import fit as fitting
from shockrig.analysis.estimate.model import Point, Structure
from shockrig.analysis.estimate.problem import Problem

NUMBERS = ("MOST_STEPS", "MOST_TRIES", "LEAST_DAMPING", "NEAR_FIRST", "LONGEST_RUN_STEP")
WHOLE = {"MOST_STEPS", "MOST_TRIES"}
ALIKE, GOES_ON = 1.0, 10.0  # of -2 log likelihood
Begun = tuple[Problem, Structure, Point]


@contextmanager
def watched(names: tuple[str, ...], seen: list[Any]) -> Iterator[None]:
    """Functions of the fit with the arguments of each call put down."""
    own = {name: getattr(fitting, name) for name in names}

    def watch(name: str) -> Any:
        def call(*arguments: Any, **keywords: Any) -> Any:
            seen.append((arguments, keywords))
            return own[name](*arguments, **keywords)

        return call

    try:
        for name in names:
            setattr(fitting, name, watch(name))
        yield
    finally:
        for name in names:
            setattr(fitting, name, own[name])


def fits_of(campaign: Path, most: int) -> list[Begun]:
    """Problem, structure and start of some fits of a diagnosis."""
    seen: list[Any] = []
    with watched(("_descend",), seen):
        judge(campaign, characterized=False)
    calls = (inspect.signature(fitting._descend).bind(*arguments, **keywords) for arguments, keywords in seen)
    free = [call.arguments for call in calls if not call.arguments.get("hold_theta")]
    whole = [(one["problem"], one["model"].structure, one["at"].point) for one in free]
    random.Random(0).shuffle(whole)
    return whole[:most]


def ends(begun: list[Begun]) -> tuple[list[float], list[float], int]:
    """-2 log likelihood of each, by how much it goes down when begun anew there, and evaluations of all together."""
    deviances, further, calls = [], [], list[Any]()
    for problem, structure, at in begun:
        with watched(("_linearise", "_settled"), calls):
            end = fitting.fit(problem, structure, at.theta, at.deviations, fitting.MOST_STEPS)
        anew = fitting.fit(end.on_its_scatters(problem), structure, end.theta, end.deviations, fitting.MOST_STEPS)
        deviances.append(end.deviance)
        further.append(end.deviance - anew.deviance)
    return deviances, further, len(calls)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="*", default=[10330, 10345, 10353, 10355, 10357])
    parser.add_argument("--campaigns", type=Path, nargs="*", default=[])
    parser.add_argument("--most", type=int, default=20)
    asked = parser.parse_args()
    begun: list[Begun] = []
    with tempfile.TemporaryDirectory() as folder:
        made = (record(draw(seed), Path(folder) / str(seed)) for seed in asked.seeds)
        for campaign in (*made, *asked.campaigns):
            begun += fits_of(campaign, asked.most)
    found = {("as it is", 1.0): ends(begun)}
    for name in NUMBERS:
        own = getattr(fitting, name)
        for times in (0.5, 2.0):
            setattr(fitting, name, round(own * times) if name in WHOLE else own * times)
            found[name, times] = ends(begun)
        setattr(fitting, name, own)
    lowest = np.min([deviances for deviances, _, _ in found.values()], axis=0)
    _, _, usual = found["as it is", 1.0]
    print(f"{len(begun)} fits\n{'number':18s} times  within 1  goes on  evaluations")
    for (name, times), (deviances, further, count) in found.items():
        within, on = np.mean(deviances - lowest < ALIKE), np.mean(np.array(further) > GOES_ON)
        print(f"{name:18s} {times:5.1f} {within:9.3f} {on:8.3f} {count / usual:12.2f}")


if __name__ == "__main__":
    main()
