"""Commands over a campaign that recorded several probes at once: which ones, and where the results of each go.

The first probe's results stand in the --out folder itself, as those of a campaign with one probe do; the others' in
folders in it, `probe-2` for the probe "2". One that is asked for alone goes where --out says.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from shockrig.files.campaign import Campaign

BY_WHICH = "decide by this one of several probes alone: 1, or 2 for imet-2 and hyt-2 (default: by all of them)"
FIRST_PROBE = "1"  # as in files.campaign_names, whose import would delay --help


def add_argument(parser: argparse.ArgumentParser) -> None:
    """The option --probe."""
    parser.add_argument(
        "--probe",
        metavar="NAME",
        help="only this one of several probes that were recorded at once: 1, or 2 for imet-2 and hyt-2",
    )


def each(campaign: Path, only: str | None) -> Iterator[tuple[str, Callable[[Path], Path]]]:
    """Each probe that is wanted, said on standard output where there are several, and what finds its own place by the
    first one's: of a folder of results, or of a file in one."""
    wanted = wanted_probes(campaign, only)
    if only is not None:
        yield only, lambda path: path
        return
    for number, probe in enumerate(wanted):
        if len(wanted) > 1:
            print(("\n" if number else "") + f"probe {probe}")
        yield probe, partial(_results_of, probe)


def wanted_probes(campaign: Path, only: str | None) -> tuple[str, ...]:
    """The probe that is named, or all that a campaign has."""
    from shockrig.files.campaign import read_probes

    return read_probes(campaign) if only is None else (only,)


def seen_by(campaign: Path, probes: Iterable[str]) -> list[Campaign]:
    """A campaign as each of some probes saw it."""
    from shockrig.files.campaign import read_campaign

    return [read_campaign(campaign, probe) for probe in probes]


def _results_of(probe: str, path: Path) -> Path:
    if probe == FIRST_PROBE:
        return path
    return path.parent / f"probe-{probe}" / path.name if path.suffix == ".json" else path / f"probe-{probe}"
