"""shockrig diagnose: what the plain simulation gets wrong, why, what correcting it gains; profile, plots, report."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from shockrig.files.numbers import counted
from shockrig.protocols.branch import Send, branch, received

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from shockrig.analysis.checks.finding import InputFinding
    from shockrig.analysis.diagnose.diagnosed import Diagnosis
    from shockrig.analysis.diagnose.remainder import Tolerance
    from shockrig.analysis.diagnose.search import Earlier
    from shockrig.analysis.estimate.channel import Channel
    from shockrig.analysis.estimate.quantity import ChannelName
    from shockrig.analysis.report.crossing import Crossing
    from shockrig.analysis.report.diagnosis_view import Compared
    from shockrig.files.campaign import Campaign

    Named = tuple[str, dict[ChannelName, Earlier]]

CHANNELS: tuple[ChannelName, ...] = ("temperature", "humidity")
EARLIER_REMEDY = "give the diagnosis of this campaign, or leave --from out"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from shockrig.protocols import each_probe

    parser.add_argument("campaign", metavar="CAMPAIGN", type=Path, help="campaign folder (campaign.json, runs/)")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, required=True, help="folder for diagnosis, extended profile, plots, report"
    )
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of the flight in the report (default: 0)")
    parser.add_argument(
        "--from",
        metavar="DIAGNOSIS",
        dest="earlier",
        type=Path,
        help="an earlier diagnosis of this campaign (its folder or diagnosis.json): the search begins with what it "
        "named, and tests it again",
    )
    each_probe.add_argument(parser)
    for option, unit, accuracy in (("--tolerance-k", "K", 0.03), ("--tolerance-percent", "%RH", 0.2)):
        parser.add_argument(
            option,
            metavar=unit.strip("%"),
            type=float,
            default=accuracy,
            help=f"from which size on something left unexplained matters ({accuracy:g} {unit.replace('%', '%%')})",
        )


def main(args: argparse.Namespace) -> int:
    """Diagnose, write, print."""
    _one_thread_a_process()
    from datetime import UTC, datetime

    from shockrig.analysis.diagnose.remainder import Tolerance
    from shockrig.files.errors import InputError
    from shockrig.protocols import each_probe

    made_at = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
    for option, value in (("--tolerance-k", args.tolerance_k), ("--tolerance-percent", args.tolerance_percent)):
        if not 0.0 <= value < 1e6:
            raise InputError(f"{option} {value:g}: expected a number from 0 on")
    tolerance = Tolerance(args.tolerance_k, args.tolerance_percent)
    for probe, its in each_probe.each(args.campaign, args.probe):
        out, earlier = its(args.out), None if args.earlier is None else _earlier(its(args.earlier))
        diagnosis = write(args.campaign, out, args.seed, made_at, tolerance, earlier, probe)
        print(summary(diagnosis))
        for name in ("report.html", "diagnosis.json", "profile.json"):
            if (out / name).is_file():  # there is no profile where no run determines a rate
                print(f"{name.split('.')[0]}: {out / name}", flush=True)
    return 0


def _earlier(path: Path) -> Named:
    """The campaign that a diagnosis is of, and what it named in each channel."""
    from shockrig.analysis.diagnose.diagnose import named_earlier
    from shockrig.files.diagnosis import read_diagnosis

    stated = read_diagnosis(path / "diagnosis.json" if path.is_dir() else path)
    return stated.campaign, {name: named_earlier(stated, name) for name in CHANNELS}


def write(
    campaign: Path,
    out: Path,
    seed: int,
    made_at: str,
    tolerance: Tolerance | None = None,
    earlier: Named | None = None,
    probe: str = "1",
) -> Diagnosis:
    """Diagnose a campaign's probe into the folder `out`, whole or not at all; `earlier` is what it begins from."""
    _one_thread_a_process()
    from shockrig.analysis.diagnose.diagnose import gathered
    from shockrig.analysis.diagnose.diagnosed import stated
    from shockrig.analysis.diagnose.remainder import Tolerance
    from shockrig.analysis.estimate.gather import usable_runs
    from shockrig.analysis.estimate.quantity import looked_for
    from shockrig.protocols.folder import said_of_data, software_version, whole_folder
    from shockrig.protocols.made_before import KEY, made_from
    from shockrig.protocols.time_left import DIAGNOSING, Phases

    _told[:] = [Phases(DIAGNOSING)]
    import_module("shockrig.analysis.report.diagnosis_view")  # the branches use it too
    with whole_folder(out) as folder, ExitStack() as stack:
        searching = stack.enter_context(branch(_read_and_search, campaign, probe, tolerance, earlier))
        # Meanwhile this process imports what draws and flies.
        from shockrig.analysis.report.diagnosis_page import write_diagnosis
        from shockrig.files.diagnosis import write_diagnosis as write_document
        from shockrig.files.plan_file import read_decisions

        for room in ("matplotlib.figure", "matplotlib.backends.backend_agg", "shockrig.analysis.report.crossing"):
            import_module(room)
        input_, channels = received(searching)
        compared: dict[ChannelName, Compared] = {}
        drawing = {}
        for _ in range(channels):
            one = received(searching)
            compared[one.found.name] = one
            drawing[one.found.name] = stack.enter_context(branch(_draw, one, folder))
        names = [name for name in CHANNELS if name in compared]
        diagnosis = gathered(input_, [compared[name].found for name in names])
        said = stated(diagnosis)
        rests_on = {"sensors": input_.campaign.sensors, KEY: made_from(input_.campaign, tolerance or Tolerance())}
        write_document(replace(said, extra={**said.extra, **rests_on}), folder / "diagnosis.json")
        provenance: dict[str, Any] = {
            "campaign_path": str(campaign),
            "software": f"shockrig {software_version()}",
            "made_at": made_at,
            "seed": seed,
            **said_of_data(input_.campaign),
        }
        _say("extended profile, a flight with it, report")
        recorded = input_.campaign
        crossings, notes = _flown(recorded, diagnosis, [compared[name] for name in names], seed, provenance, folder)
        views = [received(drawing[name]) for name in names]
        left_out = [entry for name in looked_for(recorded) for entry in usable_runs(recorded, name)[1]]
        used = {f"runs used, {c.name}": ", ".join(c.problem.channel.run_ids) for c in diagnosis.channels}
        shown = {"campaign": recorded.name, **provenance, **used}
        decisions = read_decisions(campaign)
        write_diagnosis(diagnosis, views, crossings, notes, left_out, folder, shown, decisions)
    return diagnosis


def _read_and_search(
    send: Send, campaign: Path, probe: str, tolerance: Tolerance | None, earlier: Named | None
) -> None:
    """Send the campaign as checked with the number of its channels, then each channel's diagnosis when it is found."""
    from multiprocessing.connection import wait

    from shockrig.analysis.checks.campaign_checks import checked
    from shockrig.analysis.diagnose.diagnose import enough
    from shockrig.analysis.estimate.gather import build_channel
    from shockrig.files.campaign import read_campaign
    from shockrig.files.errors import InputError

    recorded = read_campaign(campaign, probe)
    if earlier is not None and earlier[0] != recorded.name:
        raise InputError(f"--from: diagnosis of {earlier[0]!r}, not of {recorded.name!r}; {EARLIER_REMEDY}")
    input_ = checked(recorded)
    for finding in input_.findings:
        _say(f"input: {finding.sentence}")
    built = [build_channel(input_.campaign, name) for name in CHANNELS]
    channels = [channel for channel in built if channel is not None and enough(channel)]
    with ExitStack() as stack:
        given = tolerance, earlier, input_.findings
        waiting: list[Any] = [stack.enter_context(branch(_search, channel, *given)) for channel in channels]
        send((input_, len(channels)))
        while waiting:
            for ready in wait(waiting):
                waiting.remove(ready)
                send(received(cast("Connection", ready)))


def _search(
    send: Send,
    channel: Channel,
    tolerance: Tolerance | None,
    earlier: Named | None,
    findings: tuple[InputFinding, ...],
) -> None:
    from shockrig.analysis.diagnose.diagnose import diagnose_channel
    from shockrig.analysis.report.diagnosis_view import compare

    known = {} if earlier is None else earlier[1][channel.name]
    send(compare(diagnose_channel(channel, _say, tolerance, known, findings=findings)))


def _draw(send: Send, compared: Compared, folder: Path) -> None:
    from shockrig.analysis.report.diagnosis_view import look_at

    _say(f"{compared.found.name}: plots")
    send(look_at(compared, folder))


def _flown(
    campaign: Campaign,
    diagnosis: Diagnosis,
    compared: Sequence[Compared],
    seed: int,
    provenance: dict[str, Any],
    folder: Path,
) -> tuple[list[Crossing], list[str]]:
    """Write the extended profile and fly it; the crossings, and what has to be said of them."""
    from shockrig.analysis.diagnose.extended_profile import extended_profile
    from shockrig.analysis.report.crossing import cross_inversion
    from shockrig.files.profile import write_profile

    reasons: dict[ChannelName, str] = dict(diagnosis.missing)
    plain = {one.found.name: one.plain for one in compared}
    extended = {one.found.name: one.extended for one in compared}
    reasons |= {name: "no run determines the diffusivity" for name, result in extended.items() if result is None}
    if not any(extended.values()):
        return [], ["No run determines a diffusivity, so there is no profile to fly."]
    profile = extended_profile(campaign, seed, extended, reasons, provenance)
    write_profile(profile, folder / "profile.json")
    return cross_inversion(extended_profile(campaign, seed, plain, reasons), profile, seed)


def _one_thread_a_process() -> None:
    """Two processes that each start as many threads as there are cores would stand in each other's way.

    Only a library that is not imported yet heeds it.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def summary(diagnosis: Diagnosis) -> str:
    """What the command prints: verdicts, causes with parameters, gain, the input, what to measure next."""
    from shockrig.analysis.report.diagnosis_words import (
        channel_verdict,
        experiments,
        has_hygrometer,
        missing,
        named,
        predicting_sentence,
        remainder_sentence,
        removed_share,
        terminal_causes,
    )
    from shockrig.analysis.report.next_time import next_time, seen_sentence

    lines: list[str] = []
    for found in diagnosis.channels:
        lines += [f"{found.name}: {found.verdict}", f"  {channel_verdict(found)}", *terminal_causes(found)]
        lines += [f"  {sentence}"] if (sentence := removed_share(found)) else []
        lines.append(f"  {remainder_sentence(found)}")
        lines += [f"  {sentence}"] if (sentence := predicting_sentence(found)) else []
        lines += [f"  {sentence}"] if (sentence := seen_sentence(found.problem.channel)) else []
        lines += [f"  tried and not named: {named(effect)}: {why}" for effect, why in found.tried.items()]
        lines += [f"  cannot be told: {sentence}" for sentence in found.cannot_tell]
        left_out = len(found.problem.channel.left_out)
        if left_out:
            used = counted(found.problem.channel.runs, "run")
            lines.append(f"  {used} used, {left_out} left out (the report says why)")
    lines += missing(diagnosis) + [f"input: {sentence}" for sentence in diagnosis.input_findings]
    wanted = experiments(diagnosis.next_experiments, has_hygrometer(diagnosis))
    wanted += next_time([c.problem.channel for c in diagnosis.channels])
    lines.append("to measure next:" + ("" if wanted else " nothing; no two explanations are tied"))
    return "\n".join([*lines, *(f"  {line}" for line in wanted)])


def _say(text: str) -> None:
    """Progress, on standard error; a branch that is forked goes by the clock that was started before it."""
    (_told[-1] if _told else _plainly)(text)


_told: list[Callable[[str], None]] = []  # the clock of the diagnosis under way


def _plainly(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
