"""shockrig history: campaigns of one serial number over time, as control charts; what changed, and since when."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from shockrig.analysis.characterize.history import Chart, Observation
    from shockrig.files.campaign import Campaign

HISTORY_FORMAT = "shock-history/1"
AT_C = 20.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.epilog = (
        "Each campaign is characterized anew. Limits come from the campaigns' own uncertainties; what a bench shares "
        "by all of its campaigns is no change."
    )
    parser.add_argument(
        "folders", metavar="DIR", type=Path, nargs="+", help="campaigns, or folders that hold campaigns"
    )
    parser.add_argument("--serial", metavar="NUMBER", help="only this sensor (default: all that have two campaigns)")
    parser.add_argument("--out", metavar="OUT", type=Path, help="folder for history.html, history.json and the charts")
    parser.add_argument(
        "--extend", metavar="DIAGNOSIS.json", type=Path, help="fit the model with the causes that this diagnosis names"
    )
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of the differential evolution (default: 0)")


def main(args: argparse.Namespace) -> int:
    """Characterize each campaign, chart, print."""
    from datetime import UTC, datetime

    from shockrig.analysis.report.certificate_page import sentences, write_history
    from shockrig.files.errors import InputError
    from shockrig.files.json_files import write_json
    from shockrig.protocols.commands.characterize import say
    from shockrig.protocols.folder import software_version, whole_folder

    campaigns = _campaigns(args.folders, say)
    charts = _charts(campaigns, args, say)
    if not charts:
        wanted = f"the serial number {args.serial}" if args.serial else "two campaigns"
        raise InputError(
            f"{args.folders[0]}: no sensor with {wanted} that can be characterized; state serial in campaign.json"
        )
    for one in charts:
        print(f"{one.figure} of {one.serial}")
        for o, low, high in zip(one.observations, one.low, one.high, strict=True):
            mark = "" if low <= o.value <= high else "  outside its limits"
            print(f"  {o.began_at[:10] or 'not known':<11}{o.campaign:<24}{_row(one, o)}{mark}")
    for text in sentences(charts):
        print(text)
    if args.out is not None:
        made_at = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
        provenance: dict[str, Any] = {
            "campaigns": ", ".join(dict.fromkeys(str(campaign.path) for campaign in campaigns)),
            "software": f"shockrig {software_version()}",
            "made_at": made_at,
        }
        with whole_folder(args.out) as folder:
            write_json(folder / "history.json", _document(charts, provenance))
            write_history(charts, folder, provenance)
        print(f"report: {args.out / 'history.html'}")
    return 0


def _row(chart: Chart, one: Observation) -> str:
    from shockrig.files.numbers import measured

    return measured(one.value, one.value * one.random, chart.unit)


def _campaigns(folders: Sequence[Path], say: Callable[[str], None]) -> list[Campaign]:
    """The campaigns in some folders as each of their probes saw them, in the order in which they began; each once, its
    copies left out."""
    from shockrig.analysis.characterize.history import began_at
    from shockrig.files.disk import real_path, shown
    from shockrig.files.errors import InputError
    from shockrig.protocols.catalogue import catalogue
    from shockrig.protocols.each_probe import seen_by, wanted_probes

    seen: set[Path] = set()
    found: dict[str, Campaign] = {}
    for folder in folders:
        if not folder.is_dir():
            raise InputError(f"{shown(folder)}: is no folder; name campaigns, or the folder that they are in")
        paths = [folder] if (folder / "campaign.json").is_file() else [entry.path for entry in catalogue(folder)[0]]
        if not paths:
            raise InputError(f"{shown(folder)}: holds no campaign (no campaign.json); name another folder")
        for path in paths:
            if real_path(path) in seen:
                continue
            seen.add(real_path(path))
            for campaign in seen_by(path, wanted_probes(path, None)):
                first = found.setdefault(_readings(campaign), campaign)
                if first is not campaign:
                    say(f"{path}: the same readings as {first.path}; left out")
    return sorted(found.values(), key=began_at)


def called(campaigns: Sequence[Campaign]) -> dict[tuple[Path, str], str]:
    """What each is called, by path and probe: its name, where another has the same its folder's, where that does not
    tell them apart its path."""
    from shockrig.files.disk import real_path

    taken = Counter(campaign.name for campaign in campaigns)
    folders = Counter(path.name for path in {real_path(campaign.path) for campaign in campaigns})
    names = {}
    for one in campaigns:
        folder = real_path(one.path).name
        place = (folder if folders[folder] == 1 else str(one.path)) + (
            f", probe {one.probe}" if one.probe != "1" else ""
        )
        names[one.path, one.probe] = one.name if taken[one.name] == 1 else place
    return names


def _readings(campaign: Campaign) -> str:
    """What two campaigns have in common that are copies of one: every reading and its time."""
    digest = sha256()
    for run in campaign.runs:
        for trace in (run.imet, run.hyt):
            for values in () if trace is None else (trace.time_s, *trace.values.values()):
                digest.update(values.tobytes())
    return digest.hexdigest()


def _charts(campaigns: Sequence[Campaign], args: argparse.Namespace, say: Any) -> list[Chart]:
    from shockrig.analysis.characterize.budget import budgets, diffusivity_at, mean_diffusivity
    from shockrig.analysis.characterize.certified import with_common
    from shockrig.analysis.characterize.characterize import characterize
    from shockrig.analysis.characterize.history import began_at, bench_of, chart, observed
    from shockrig.analysis.characterize.part_fit import read_extension
    from shockrig.files.campaign_names import serial_numbers
    from shockrig.files.errors import InputError
    from shockrig.protocols.time_left import TimeLeft

    extensions = None if args.extend is None else read_extension(args.extend)
    names = called(campaigns)
    series: dict[tuple[str, str, str], list[Observation]] = {}
    clock = TimeLeft()
    serials_of = [serial_numbers(campaign.sensors, campaign.emulated) for campaign in campaigns]
    of_path: dict[Path, set[str]] = {}
    for campaign, serials in zip(campaigns, serials_of, strict=True):
        of_path.setdefault(campaign.path, set()).update(serials.values())
    times = Counter(serial for there in of_path.values() for serial in there)
    looked_for = {args.serial} if args.serial else {serial for serial, count in times.items() if count > 1}
    for path, there in of_path.items():
        if not there & looked_for:
            others = "another sensor" if args.serial else "the only campaign of its sensors"
            say(f"{path}: {others if there else 'no serial number'}; left out")
    for number, (campaign, serials) in enumerate(zip(campaigns, serials_of, strict=True)):
        wanted = {name for name, serial in serials.items() if serial in looked_for}
        if not wanted:
            continue
        say(f"{campaign.path}: characterizing{clock.after(number / len(campaigns))}")
        try:
            result = characterize(with_common(campaign), args.seed, extensions)
        except InputError as error:
            say(f"left out: {error}")
            continue
        found = []
        if result.temperature is not None and "imet" in wanted:
            alpha, t63, _ = budgets(result.temperature)
            found += [("alpha", serials["imet"], alpha), ("t63", serials["imet"], t63)]
        if result.humidity is not None and "hyt" in wanted and (at := diffusivity_at(result.humidity, AT_C)):
            found.append((f"D({AT_C:g} °C)", serials["hyt"], at))
        if result.humidity is not None and "hyt" in wanted and (mean := mean_diffusivity(result.humidity)):
            # Campaigns with other ambients are another chart.
            over = ", ".join(f"{t + 0.0:g}" for t in mean[1])
            found.append((f"D, mean of {over} °C", serials["hyt"], mean[0]))
        for figure, serial, budget in found:
            one = observed(budget, names[campaign.path, campaign.probe], began_at(campaign), bench_of(campaign))
            series.setdefault((figure, serial, budget.unit), []).append(one)
    return [chart(*key, observations) for key, observations in series.items()]


def _document(charts: Sequence[Chart], provenance: dict[str, Any]) -> dict[str, Any]:
    from shockrig.analysis.report.certificate_page import sentence

    return {
        "format": HISTORY_FORMAT,
        "charts": [
            {
                "figure": one.figure,
                "serial": one.serial,
                "unit": one.unit,
                "campaigns": [
                    {
                        "campaign": o.campaign,
                        "began_at": o.began_at,
                        "value": o.value,
                        "standard_uncertainty": o.value * o.random,
                        "shared_by_the_bench": o.value * o.common,
                        "level": float(level),
                        "level_standard_uncertainty": float(unsure),
                        "limits": [float(low), float(high)],
                    }
                    for o, level, unsure, low, high in zip(
                        one.observations, one.level, one.standard_uncertainty, one.low, one.high, strict=True
                    )
                ],
                "changes": [
                    {
                        "since": one.observations[c.first].campaign,
                        "relative": c.relative,
                        "standard_uncertainty": c.standard_uncertainty,
                        "probability_by_accident": c.probability,
                        "sentence": sentence(one, c),
                    }
                    for c in one.changes
                ],
            }
            for one in charts
        ],
        "provenance": provenance,
    }
