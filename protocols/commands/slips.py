"""shockrig slips: the paper's schemes as printed and corrected, beside the series; table, plots and a page."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from shockrig.analysis.physics.schemes import Slip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("--out", type=Path, metavar="DIR", help="also write report.html and the plots here")


def main(args: argparse.Namespace) -> int:
    """Print the table of slips; with --out write the report too."""
    from shockrig.analysis.physics.schemes import slips_table

    if args.out is None:
        print(as_text(slips_table()))
        return 0
    from shockrig.analysis.report.slips_page import write_slips_report
    from shockrig.protocols.folder import whole_folder

    with whole_folder(args.out) as folder:
        slips = slips_table()
        path = args.out / write_slips_report(slips, folder).name
    print(as_text(slips))
    print(f"\nreport: {path}")
    return 0


def as_text(slips: Iterable[Slip]) -> str:
    """The table for a terminal: one block for each slip."""
    from shockrig.analysis.report.slips_page import as_table

    lines = []
    for slip in slips:
        table = as_table(slip)
        rows = [["", *table.columns[1:]], *([str(cell) for cell in row] for row in table.rows)]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines += [slip.title, f"  taken: {slip.printed}", f"  fix:   {slip.fix}", f"  {slip.quantity}:"]
        for case, *numbers in rows:
            shown = [case.ljust(widths[0]), *(n.rjust(w) for n, w in zip(numbers, widths[1:], strict=True))]
            lines.append("    " + "   ".join(shown).rstrip())
        lines.append("")
    return "\n".join(lines).rstrip()
