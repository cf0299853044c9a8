"""shockrig demo: an effect that nobody knows is hidden in emulated sensors, found, modelled, and the seal opened.

It runs what one would type: run --hide, characterize, diagnose, characterize --extend, reveal. Only the last step reads
the truth; those before see the campaign's files and nothing else.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from shockrig.analysis.diagnose.diagnosed import ChannelDiagnosis, Diagnosis
    from shockrig.files.profile import Profile
    from shockrig.protocols.reveal import ChannelScore, RevealScore
    from shockrig.rig.virtual.truth import Truth

PROTOCOL = "standard"
WIDTH = 112
UNIT_ALPHA, UNIT_D = 1e-8, 1e-12  # m²/s, in which the table's numbers are of order one


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("demo"), help="folder for everything (default: demo)"
    )
    parser.add_argument(
        "--seed", metavar="N", type=int, default=5, help="which effect is hidden, which sensors and noise (default: 5)"
    )
    parser.add_argument(
        "--hide",
        metavar="WHAT",
        default="1",
        help="what to hide, as in shockrig run: a number, random, none, outside, ids (default: 1)",
    )


def main(args: argparse.Namespace) -> int:
    """Hide, record, characterize, diagnose, extend, open the seal; print the story, its end first."""
    from datetime import UTC, datetime

    from shockrig.files.profile import read_profile
    from shockrig.protocols.branch import branch, received
    from shockrig.protocols.commands import characterize, diagnose
    from shockrig.protocols.reveal import score
    from shockrig.rig.bench_errors import BenchError

    made_at = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
    campaign, sealed = args.out / "campaign", args.out / "campaign.sealed"
    is_new = not args.out.exists()
    try:
        args.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BenchError(f"--out {args.out}: {error.strerror}; name a folder that can be written") from None
    _step(1, "an effect is drawn, sealed and hidden in the sensors; shocks are recorded")
    try:
        _record(campaign, args.seed, args.hide)
    except BenchError:
        if is_new and not any(args.out.iterdir()):  # nothing was recorded
            args.out.rmdir()
        raise
    # Neither needs the other's result, and one processor alone would wait for both.
    _step(2, "the plain model is fitted")
    with branch(_plain, campaign, args.out / "plain", made_at) as plain:
        _step(3, "the diagnosis looks for what the plain model gets wrong")
        diagnosis = diagnose.write(campaign, args.out / "diagnosis", 0, made_at)
        received(plain)
    stated = args.out / "diagnosis" / "diagnosis.json"
    profiles = [read_profile(args.out / "plain" / "profile.json")]
    if any(found.causes for found in diagnosis.channels):
        _step(4, "the model with what was named is fitted")
        characterize.write(campaign, args.out / "extended", 0, stated, made_at)
        profiles.append(read_profile(args.out / "extended" / "profile.json"))
    _step(5, "the seal is opened")
    result = score(sealed, stated)
    print(story(diagnosis, result))
    print()
    print("\n".join(against_truth(profiles, result.truth)))
    reports = [args.out / name / "report.html" for name in ("plain", "diagnosis", "extended")[: len(profiles) + 1]]
    figures = sorted(str(path) for path in (args.out / "diagnosis").glob("*_before_after.png"))
    print()
    for label, paths in (("reports", [str(path) for path in reports]), ("before and after", figures)):
        if paths:
            print(f"{label}: {', '.join(paths)}", flush=True)
    for line in what_next(args.out, args.seed):
        print(line, file=sys.stderr)
    return 0


def _plain(send: Callable[[object], None], campaign: Path, out: Path, made_at: str) -> None:
    """The plain characterization, in a process of its own."""
    from shockrig.protocols.commands import characterize

    characterize.write(campaign, out, 0, None, made_at, whose="plain model")
    send(None)


def what_next(out: Path, seed: int) -> list[str]:
    """What to try after the demonstration."""
    return [
        "what to try next:",
        f"  open {out / 'diagnosis' / 'report.html'}: what was found, and by how much it helps",
        f"  shockrig demo --seed {seed + 1} --out another: another effect, other sensors; --hide none hides nothing",
        "  shockrig tour: bench, log and flight in ten minutes, with what each command is for",
        "  your own log or flight: shockrig example lists samples to begin with",
    ]


def story(diagnosis: Diagnosis, result: RevealScore) -> str:
    """How it ended, what the diagnosis said before the seal was open, and what was under it."""
    from shockrig.analysis.report.diagnosis_words import channel_verdict, removed_share

    lines = [_filled(ending(result), "")]
    for found in diagnosis.channels:
        lines += ["", f"{found.name}: {found.verdict}", _filled(channel_verdict(found), "  ")]
        lines += [f"  {sentence}"] if (sentence := removed_share(found)) else []
        judged = result.channels[found.name]
        lines += [f"  {line}" for line in _under_the_seal(found, judged, result.truth)]
    return "\n".join(lines)


def ending(result: RevealScore) -> str:
    """One sentence on what was hidden, and what became of it."""
    from shockrig.analysis.report.diagnosis_words import listed, named

    def where(outcome: str) -> list[str]:
        """Effects with this outcome, each with the channels where it came out so."""
        channels: dict[str, list[str]] = {}
        for name, judged in result.channels.items():
            for effect in getattr(judged, outcome):
                channels.setdefault(effect, []).append(name)
        return [f"{named(effect)} ({listed(names)})" for effect, names in channels.items()]

    hidden = where("hidden")
    if not hidden:
        wrong = where("wrong")
        return f"Nothing was hidden, and {listed(wrong) if wrong else 'nothing'} was named."
    if result.exact:
        nameable = where("named")
        if not nameable:
            described = any(channel.verdict == "described" for channel in result.channels.values())
            told = "describes how it behaves" if described else "says that it cannot explain it"
            return f"Hidden was what no catalogue has, {listed(hidden)}, and the diagnosis {told}."
        return f"Found what was hidden, and nothing else: {listed(nameable)}."
    parts = [f"{label} {listed(where(outcome))}" for outcome, label in _OUTCOMES if where(outcome)]
    verdicts = [f"{name} should be {c.expected_verdict}" for name, c in result.channels.items() if not c.verdict_right]
    return f"Not all came out as hidden: {'; '.join([*parts, *verdicts])}."


_OUTCOMES = (
    ("named", "found"),
    ("listed", "only among the look-alikes of what was named:"),
    ("missed", "missed"),
    ("wrong", "named but not hidden:"),
)


def _under_the_seal(found: ChannelDiagnosis, judged: ChannelScore, truth: Truth) -> list[str]:
    """What was hidden in a channel, each parameter beside the one found."""
    from shockrig.analysis.report.diagnosis_words import named
    from shockrig.files.numbers import measured, plain

    parameters = {hidden.effect: hidden.parameters for hidden in truth.effects}
    spreads = {(c.effect, name): u.standard_uncertainty for c in found.causes for name, u in c.parameters.items()}
    lines = []
    for effect in judged.hidden:
        lines.append(f"under the seal: {named(effect)}" + ("" if effect in judged.named else ", not named"))
        for name, true in parameters[effect].items():
            line = f"  {name:<26} hidden {plain(true, 4)}"
            error = next((e for e in judged.errors if (e.effect, e.parameter) == (effect, name)), None)
            if error is not None:
                line += f", found {measured(error.value, spreads[effect, name])}"
            if error is not None and error.sigmas is not None:
                line += f", off by {error.sigmas:+.1f} σ"
            lines.append(line)
    return lines or ["under the seal: nothing"]


def against_truth(profiles: Sequence[Profile], truth: Truth) -> list[str]:
    """alpha and D(T) of the plain profile, and of the extended one if there is one, beside the sealed truth."""
    from shockrig.files.numbers import measured, plain

    columns = [diffusivities(profile) for profile in profiles]
    names = ("plain", "off by", "extended", "off by")[: 2 * len(columns)]
    header = f"{'against the sealed truth':<24} {'unit':<10}  " + "".join(f"{name:<18}" for name in names) + "truth"
    lines = [header]
    for key in dict.fromkeys(key for column in columns for key in column):
        symbol, ambient_c = key
        scale = UNIT_ALPHA if symbol == "alpha" else UNIT_D
        true = truth.thermal_diffusivity_m2_s if ambient_c is None else float(truth.diffusivity_m2_s(ambient_c))
        cells = []
        for column in columns:
            if key not in column:
                cells += ["not determined", ""]
                continue
            value, spread = column[key]
            cells += [measured(value / scale, spread / scale)]
            cells += [f"{100 * (value / true - 1):+.2f} %, {(value - true) / spread:+.1f} σ"]
        label = symbol if ambient_c is None else f"{symbol} at {round(ambient_c, 1) + 0.0:.1f} °C"
        row = "".join(f"{cell:<18}" for cell in cells)
        lines.append(f"  {label:<22} {scale:.0e} m²/s  {row}{plain(true / scale, 5)}")
    return lines


def diffusivities(profile: Profile) -> dict[tuple[str, float | None], tuple[float, float]]:
    """Value and standard uncertainty [m²/s] of alpha, and of D at each ambient [°C], of a profile."""
    found: dict[tuple[str, float | None], tuple[float, float]] = {}
    if profile.temperature is not None:
        alpha = profile.temperature.thermal_diffusivity_m2_s
        found["alpha", None] = (alpha.value, alpha.standard_uncertainty)
    if profile.humidity is not None:
        for row in profile.humidity.diffusivity_table:
            found["D", row.ambient_temperature_c] = (row.diffusivity_m2_s, row.standard_uncertainty)
    return found


def _record(campaign: Path, seed: int, hide: str) -> None:
    """`shockrig run standard` on the virtual bench; what it prints is progress here."""
    from shockrig.protocols.cli import build_parser

    arguments = ["run", PROTOCOL, "--out", str(campaign), "--seed", str(seed), "--hide", hide]
    parsed = build_parser("run").parse_args(arguments)
    with contextlib.redirect_stdout(sys.stderr):
        parsed.main(parsed)


def _step(number: int, text: str) -> None:
    print(f"{number} of 5: {text}", file=sys.stderr, flush=True)


def _filled(text: str, indent: str) -> str:
    return textwrap.fill(text, WIDTH, initial_indent=indent, subsequent_indent=indent)
