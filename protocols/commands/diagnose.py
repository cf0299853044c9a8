"""shockrig diagnose: what the plain simulation gets wrong, why, and what mending it gains; profile, plots, report."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from shockrig.analysis.diagnosis.diagnose import Diagnosis
    from shockrig.analysis.diagnosis.remainder import Tolerance
    from shockrig.analysis.inference.quantity import ChannelName
    from shockrig.analysis.report.diagnosis_view import ChannelView

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
    import json

    from shockrig.protocols.folder import software_version, whole_folder

    with whole_folder(out) as folder, _looking(campaign, tolerance, folder) as waiting:
        from shockrig.analysis.checks.checked import checked
        from shockrig.analysis.diagnosis.diagnose import NO_STEP, gathered
        from shockrig.analysis.diagnosis.export import to_json
        from shockrig.analysis.diagnosis.extended import extended_profile
        from shockrig.analysis.inference.gather import usable_runs
        from shockrig.analysis.report.crossing import cross_inversion
        from shockrig.analysis.report.diagnosis_page import write_diagnosis
        from shockrig.analysis.report.style import write_whole
        from shockrig.files.campaign import read_campaign
        from shockrig.files.profile import write_profile

        input_ = checked(read_campaign(campaign))
        recorded = input_.campaign
        for finding in input_.findings:
            _say(f"input: {finding.sentence}")
        views = [view for work in waiting if (view := work.result()) is not None]
        diagnosis = gathered(input_, [view.found for view in views])
        content = json.dumps(to_json(diagnosis), indent=2, allow_nan=False) + "\n"
        write_whole(folder / "diagnosis.json", content.encode())
        provenance: dict[str, Any] = {
            "campaign_path": str(campaign),
            "software": f"shockrig {software_version()}",
            "made_at": made_at,
            "seed": seed,
        }
        _say("extended profile, a flight with it, report")
        reasons: dict[ChannelName, str] = dict.fromkeys(diagnosis.missing, NO_STEP)
        plain = {view.found.name: view.plain for view in views}
        extended = {view.found.name: view.extended for view in views}
        reasons |= {name: "no run determines the diffusivity" for name, result in extended.items() if result is None}
        if any(extended.values()):
            profile = extended_profile(recorded, seed, extended, reasons, provenance)
            write_profile(profile, folder / "profile.json")
            crossings, notes = cross_inversion(extended_profile(recorded, seed, plain, reasons), profile, seed)
        else:
            crossings, notes = [], ["No run determines a diffusivity, so there is no profile to fly."]
        left_out = [entry for name in CHANNELS for entry in usable_runs(recorded, name)[1]]
        used = {f"runs used, {c.name}": ", ".join(c.problem.channel.run_ids) for c in diagnosis.channels}
        write_diagnosis(
            diagnosis, views, crossings, notes, left_out, folder, {"campaign": recorded.name, **provenance, **used}
        )
    return diagnosis


@contextmanager
def _looking(campaign: Path, tolerance: Tolerance | None, folder: Path) -> Iterator[list[Future[ChannelView | None]]]:
    """Both channels at once, in processes of their own that start before this one has read anything."""
    # Two processes that each start as many threads as there are cores would stand in each other's way.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Ctrl-C reaches the workers too: they end without a word, this process says what happened.
    silent = (signal.SIGINT, signal.SIG_DFL)
    spawn = get_context("spawn")
    with ProcessPoolExecutor(len(CHANNELS), mp_context=spawn, initializer=signal.signal, initargs=silent) as pool:
        yield [pool.submit(_look_at_channel, campaign, name, tolerance, folder) for name in CHANNELS]


def _look_at_channel(
    campaign: Path, name: ChannelName, tolerance: Tolerance | None, folder: Path
) -> ChannelView | None:
    from shockrig.analysis.checks.checked import checked
    from shockrig.analysis.diagnosis.diagnose import diagnose_channel, enough
    from shockrig.analysis.inference.gather import build_channel
    from shockrig.analysis.report.diagnosis_view import look_at
    from shockrig.files.campaign import read_campaign

    channel = build_channel(checked(read_campaign(campaign)).campaign, name)
    if channel is None or not enough(channel):
        return None
    found = diagnose_channel(channel, _say, tolerance)
    _say(f"{name}: held-out residuals and plots")
    return look_at(found, folder)


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
