"""Commands over a campaign that recorded several probes at once: which ones, and where the results of each go.

The first probe's results stand in the --out folder itself, as those of a campaign with one probe do; the others' in
folders in it, `probe-2` for the probe "2". One that is asked for alone goes where --out says.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

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
    from shockrig.files.campaign import read_probes

    if only is not None:
        yield only, lambda path: path
        return
    wanted = read_probes(campaign)
    for number, probe in enumerate(wanted):
        if len(wanted) > 1:
            print(("\n" if number else "") + f"probe {probe}")
        yield probe, partial(_results_of, probe)


def _results_of(probe: str, path: Path) -> Path:
    if probe == FIRST_PROBE:
        return path
    return path.parent / f"probe-{probe}" / path.name if path.suffix == ".json" else path / f"probe-{probe}"
