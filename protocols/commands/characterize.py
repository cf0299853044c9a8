"""shockrig characterize: fit alpha and D(T) to a campaign; profile, lookup table, plots and report in one folder."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shockrig.files.numbers import counted

if TYPE_CHECKING:
    from shockrig.analysis.characterize.result import Characterization
    from shockrig.analysis.fleet.fleet_prior import WithFleet


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from shockrig.protocols import each_probe

    parser.add_argument("campaign", metavar="CAMPAIGN", type=Path, help="campaign folder (campaign.json, runs/)")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, required=True, help="folder for profile, table, plots, report"
    )
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of the differential evolution (default: 0)")
    parser.add_argument(
        "--extend", metavar="DIAGNOSIS.json", type=Path, help="fit the model with the causes that this diagnosis names"
    )
    parser.add_argument(
        "--fleet",
        metavar="FLEET.json",
        type=Path,
        help="what other sensors of the type say, as shockrig fleet wrote it",
    )
    each_probe.add_argument(parser)


def main(args: argparse.Namespace) -> int:
    """Characterize, write, print."""
    from datetime import UTC, datetime

    from shockrig.protocols import each_probe

    made_at = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
    for probe, its in each_probe.each(args.campaign, args.probe):
        out, extend = its(args.out), None if args.extend is None else its(args.extend)
        result, fleet = write(args.campaign, out, args.seed, extend, made_at, probe, args.fleet)
        print(summary(result))
        if fleet is not None:
            print(fleet_summary(fleet))
        print(f"report: {out / 'report.html'}")
        print(f"profile: {out / 'profile.json'}", flush=True)
    return 0


def write(
    campaign: Path,
    out: Path,
    seed: int,
    extend: Path | None,
    made_at: str,
    probe: str = "1",
    fleet: Path | None = None,
    whose: str = "",
) -> tuple[Characterization, WithFleet | None]:
    """Characterize a campaign's probe into the folder `out`, whole or not at all; and what a fleet makes of it.

    `whose` is said before each line of progress, where another command prints its own beside it.
    """
    from shockrig.analysis.characterize.characterize import characterize
    from shockrig.analysis.characterize.part_fit import read_extension
    from shockrig.analysis.characterize.result import to_profile
    from shockrig.analysis.fleet.fleet_prior import with_population
    from shockrig.analysis.report.characterize_page import write_characterization
    from shockrig.analysis.report.fleet_page import fleet_section
    from shockrig.files.campaign import read_campaign
    from shockrig.files.fleet_file import read_fleet
    from shockrig.files.plan_file import read_decisions
    from shockrig.files.profile import write_profile
    from shockrig.protocols.folder import said_of_data, software_version, whole_folder
    from shockrig.protocols.time_left import CHARACTERIZING, Phases

    say = Phases(CHARACTERIZING, whose=whose)
    extensions = None if extend is None else read_extension(extend)
    population = None if fleet is None else read_fleet(fleet).population
    with whole_folder(out) as folder:
        result = characterize(read_campaign(campaign, probe), seed, extensions, say)
        provenance: dict[str, Any] = {
            "campaign_path": str(campaign),
            "software": f"shockrig {software_version()}",
            "made_at": made_at,
            "seed": seed,
            **said_of_data(result.campaign),
        }
        if extend is not None:
            provenance["extended_by"] = str(extend)
        profile = to_profile(result, provenance)
        found = None if population is None else with_population(result, population)
        if found is not None:
            belongs = {name: found.belongs(name) for name in found.probability}
            provenance["fleet"] = str(fleet)
            kept = {**profile.provenance, "fleet": str(fleet), "belongs_to_fleet": belongs}
            profile = replace(found.profile, provenance=kept)
        write_profile(profile, folder / "profile.json")
        if profile.humidity is not None:
            profile.humidity.to_frame().to_csv(folder / "diffusivity.csv", index=False, float_format="%.6g")
        say("plots and report")
        used = {f"runs used, {name}": ", ".join(found.runs) for name, found in result.channels().items()}
        shown = {"campaign": result.campaign.name, **provenance, **used}
        more = [] if found is None else [fleet_section(found)]
        write_characterization(result, folder, shown, read_decisions(campaign), more)
    return result, found


def fleet_summary(fleet: WithFleet) -> str:
    """A sentence for each sensor, and its numbers with what the fleet says."""
    from shockrig.files.numbers import measured

    lines = [f"fleet: {sentence}" for sentence in fleet.sentences]
    for figures in fleet.figures.values():
        for one in figures:
            value = measured(one.shrunk.value, one.shrunk.standard_uncertainty, one.coordinate.unit)
            lines.append(f"  {one.coordinate.label} = {value}")
    return "\n".join(lines)


def summary(result: Characterization) -> str:
    """What the command prints: alpha or tau, the table D(T), response times, what does not fit."""
    from shockrig.analysis.report.characterize_page import hint
    from shockrig.analysis.report.fitted import rate_text
    from shockrig.files.headline import time_text
    from shockrig.files.numbers import measured

    def bare(text: str) -> str:
        """A value in a column that has the unit."""
        return text.removesuffix(" s").removeprefix("(").removesuffix(")")

    lines: list[str] = []
    if (t := result.temperature) is not None:
        row = t.rows[0]
        lumped = t.channel.lumped
        lines.append(f"{'tau' if lumped else 'alpha'} = {rate_text(t.channel, row)}  ({counted(len(row.runs), 'run')})")
        shown = [f"{name} {time_text(row.response, place)}" for place, name in enumerate(("t63", "t90", "t98"))]
        lines.append(f"  {', '.join(shown)}")
    if (h := result.humidity) is not None:
        lumped = h.channel.lumped
        symbol = f"{'tau, s' if lumped else 'D, 1e-12 m²/s':<18}"
        lines.append(f"ambient, °C   {symbol}{'t63, s':<18}{'t90, s':<18}{'t98, s':<18}runs")
        for row in h.rows:
            value = (
                rate_text(h.channel, row, "")
                if lumped
                else measured(1e12 * row.diffusivity_m2_s, 1e12 * row.standard_uncertainty)
            )
            times = "".join(f"{bare(time_text(row.response, place)):<18}" for place in range(3))
            mark = " *" if row.basis.startswith("thermal") else ""
            lines.append(f"{round(row.ambient_c, 1) + 0.0:>11.1f}   {bare(value):<18}{times}{len(row.runs):>4}{mark}")
        for basis in dict.fromkeys(row.basis for row in h.rows if row.basis.startswith("thermal")):
            lines.append(f"  * {basis}: this ambient has fewer than two isothermal shocks")
    lines += [f"input: {finding.sentence}" for finding in result.findings]
    for name, found in result.channels().items():
        if not found.explained:
            lines.append(f"note: {hint(name, found)}")
        left_out = len({entry.run for entry in found.set_aside})
        if left_out:
            used = counted(len(found.runs), "run")
            lines.append(f"{name}: {used} used, {left_out} left out (the report says why)")
    lines += [f"note: {name}: {reason}" for name, reason in result.missing.items()]
    return "\n".join(lines)


def say(text: str) -> None:
    """Progress, on standard error."""
    print(text, file=sys.stderr, flush=True)
