"""shockrig diagnose: what the plain simulation gets wrong, why, and what correcting it gains; profile, plots, report."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from concurrent.futures import Future, ProcessPoolExecutor

    from shockrig.analysis.diagnosis.diagnose import Diagnosis
    from shockrig.analysis.diagnosis.remainder import Tolerance
    from shockrig.analysis.inference.channel import Channel
    from shockrig.analysis.inference.quantity import ChannelName
    from shockrig.analysis.report.crossing import Crossing
    from shockrig.analysis.report.diagnosis_view import ChannelView, Compared
    from shockrig.files.campaign import Campaign

CHANNELS: tuple[ChannelName, ...] = ("temperature", "humidity")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("campaign", metavar="CAMPAIGN", type=Path, help="campaign folder (campaign.json, runs/)")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, required=True, help="folder for diagnosis, extended profile, plots, report"
    )
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of the flight in the report (0)")
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

    from shockrig.analysis.diagnosis.remainder import Tolerance
    from shockrig.files.errors import InputError

    made_at = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
    for option, value in (("--tolerance-k", args.tolerance_k), ("--tolerance-percent", args.tolerance_percent)):
        if not 0.0 <= value < 1e6:
            raise InputError(f"{option} {value:g}: expected a number from 0 on")
    diagnosis = write(args.campaign, args.out, args.seed, made_at, Tolerance(args.tolerance_k, args.tolerance_percent))
    print(summary(diagnosis))
    for name in ("report.html", "diagnosis.json", "profile.json"):
        print(f"{name.split('.')[0]}: {args.out / name}")
    return 0


def write(campaign: Path, out: Path, seed: int, made_at: str, tolerance: Tolerance | None = None) -> Diagnosis:
    """Diagnose a campaign into the folder `out`, whole or not at all."""
    _one_thread_a_process()
    import json

    from shockrig.analysis.checks.checked import checked
    from shockrig.analysis.diagnosis.diagnose import enough, gathered
    from shockrig.analysis.diagnosis.export import to_json
    from shockrig.analysis.inference.gather import build_channel, usable_runs
    from shockrig.files.campaign import read_campaign
    from shockrig.files.disk import write_whole
    from shockrig.protocols.folder import said_of_data, software_version, whole_folder

    with whole_folder(out) as folder:
        input_ = checked(read_campaign(campaign))
        recorded = input_.campaign
        for finding in input_.findings:
            _say(f"input: {finding.sentence}")
        built = [build_channel(recorded, name) for name in CHANNELS]
        channels = [channel for channel in built if channel is not None and enough(channel)]
        with _processes(max(len(channels), 1)) as pool:
            compared, drawing = _diagnosed(channels, tolerance, folder, pool)
            diagnosis = gathered(input_, [one.found for one in compared])
            content = json.dumps(to_json(diagnosis), indent=2, allow_nan=False) + "\n"
            write_whole(folder / "diagnosis.json", content.encode())
            provenance: dict[str, Any] = {
                "campaign_path": str(campaign),
                "software": f"shockrig {software_version()}",
                "made_at": made_at,
                "seed": seed,
                **said_of_data(recorded),
            }
            _say("extended profile, a flight with it, report")
            crossings, notes = _flown(recorded, diagnosis, compared, seed, provenance, folder)
            views = [work.result() for work in drawing]
        from shockrig.analysis.report.diagnosis_page import write_diagnosis

        left_out = [entry for name in CHANNELS for entry in usable_runs(recorded, name)[1]]
        used = {f"runs used, {c.name}": ", ".join(c.problem.channel.run_ids) for c in diagnosis.channels}
        write_diagnosis(
            diagnosis, views, crossings, notes, left_out, folder, {"campaign": recorded.name, **provenance, **used}
        )
    return diagnosis


def _diagnosed(
    channels: Sequence[Channel], tolerance: Tolerance | None, folder: Path, pool: ProcessPoolExecutor
) -> tuple[list[Compared], list[Future[ChannelView]]]:
    """Every channel diagnosed, all at once; what is done is drawn while the rest goes on."""
    from concurrent.futures import as_completed

    searching = [pool.submit(_search, channel, tolerance) for channel in channels]
    drawing = {}
    for work in as_completed(searching):
        drawing[work] = pool.submit(_draw, work.result(), folder)
        # What comes last takes long to import, and one process less is searching.
        for room in ("crossing", "diagnosis_page"):
            import_module(f"shockrig.analysis.report.{room}")
    return [work.result() for work in searching], [drawing[work] for work in searching]


def _search(channel: Channel, tolerance: Tolerance | None) -> Compared:
    from shockrig.analysis.diagnosis.diagnose import diagnose_channel
    from shockrig.analysis.report.diagnosis_view import compare

    return compare(diagnose_channel(channel, _say, tolerance))


def _draw(compared: Compared, folder: Path) -> ChannelView:
    from shockrig.analysis.report.diagnosis_view import look_at

    _say(f"{compared.found.name}: held-out residuals and plots")
    return look_at(compared, folder)


def _flown(
    campaign: Campaign,
    diagnosis: Diagnosis,
    compared: Sequence[Compared],
    seed: int,
    provenance: dict[str, Any],
    folder: Path,
) -> tuple[list[Crossing], list[str]]:
    """Write the extended profile and fly it; the crossings, and what has to be said of them."""
    from shockrig.analysis.diagnosis.diagnose import NO_STEP
    from shockrig.analysis.diagnosis.extended import extended_profile
    from shockrig.analysis.report.crossing import cross_inversion
    from shockrig.files.profile import write_profile

    reasons: dict[ChannelName, str] = dict.fromkeys(diagnosis.missing, NO_STEP)
    plain = {one.found.name: one.plain for one in compared}
    extended = {one.found.name: one.extended for one in compared}
    reasons |= {name: "no run determines the diffusivity" for name, result in extended.items() if result is None}
    if not any(extended.values()):
        return [], ["No run determines a diffusivity, so there is no profile to fly."]
    profile = extended_profile(campaign, seed, extended, reasons, provenance)
    write_profile(profile, folder / "profile.json")
    return cross_inversion(extended_profile(campaign, seed, plain, reasons), profile, seed)


def _processes(count: int) -> ProcessPoolExecutor:
    """Processes for the channels: forked where that is safe, so that they need not import and read everything anew."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    # A process of several threads, also such that a library has started, cannot be forked safely, and macOS' cannot.
    alone = sys.platform == "linux" and len(os.listdir("/proc/self/task")) == 1
    if alone:
        for used in ("matplotlib.figure", "matplotlib.backends.backend_agg", "shockrig.analysis.report.diagnosis_view"):
            import_module(used)
    # Ctrl-C reaches the workers too: they end without a word, this process says what happened.
    silent = (signal.SIGINT, signal.SIG_DFL)
    context = get_context("fork" if alone else "spawn")
    return ProcessPoolExecutor(count, mp_context=context, initializer=signal.signal, initargs=silent)


def _one_thread_a_process() -> None:
    """Two processes that each start as many threads as there are cores would stand in each other's way.

    Only a library that is not imported yet heeds it.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def summary(diagnosis: Diagnosis) -> str:
    """What the command prints: verdicts, causes with parameters, gain, what to measure next."""
    from shockrig.analysis.report.diagnosis_words import (
        channel_verdict,
        experiments,
        missing,
        named,
        remainder_sentence,
        terminal_causes,
    )

    lines = [f"input: {sentence}" for sentence in diagnosis.input_findings]
    for found in diagnosis.channels:
        lines += [f"{found.name}: {found.verdict}", f"  {channel_verdict(found)}", *terminal_causes(found)]
        gain = found.gain
        if found.causes:
            low, high = gain.interval_95
            share = f"{100 * gain.explained_fraction:.1f} % ({100 * low:.1f} to {100 * high:.1f} %)"
            lines.append(f"  of the explainable error removed on unseen runs: {share}")
        lines.append(f"  {remainder_sentence(found)}")
        lines += [f"  tried and not named: {named(tried.effect)}: {tried.why}" for tried in found.tried]
        lines += [f"  cannot be told: {sentence}" for sentence in found.cannot_tell]
        left_out = len(found.problem.channel.left_out)
        if left_out:
            lines.append(f"  {found.problem.channel.runs} runs used, {left_out} left out (the report says why)")
    lines += missing(diagnosis)
    wanted = experiments(diagnosis.next_experiments)
    lines.append("to measure next: " + ("" if wanted else "nothing; no two explanations are tied"))
    return "\n".join([*lines, *(f"  {line}" for line in wanted)])


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
