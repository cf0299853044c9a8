"""shockrig run: record a campaign on a bench, by default the embedded virtual one, whose truth is sealed beside it."""

from __future__ import annotations

import argparse
import contextlib
import secrets
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shockrig.files.numbers import counted

ADAPTIVE = "adaptive"
MOST_PROBES = 99
LEAST_SPREAD, MOST_SPREAD = 0.01, 30.0  # percent
EXAMPLE = "alpha 0.2 %, D 0.3 %, ties decided, minutes 90"


@dataclass(frozen=True)
class _Sealed:
    """What is true of emulated sensors, and the file that keeps it."""

    path: Path
    truth: Any
    seed: int


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from shockrig.protocols.each_probe import BY_WHICH

    parser.set_defaults(ends_by_ctrl_c=True)
    parser.epilog = (
        "A campaign that was interrupted goes on when the same command is run again. Ctrl-C makes the bench safe and "
        "keeps what was recorded; a second Ctrl-C ends at once."
    )
    parser.add_argument("protocol", metavar="PROTOCOL", help="quick, standard, extended, manual, adaptive, or a file")
    loop = parser.add_argument_group("run adaptive: record, look, decide, until the goals are met")
    loop.add_argument(
        "--until",
        metavar="GOALS",
        help='such as "alpha 0.2 %%, D 0.3 %%, ties decided"; "minutes 90" limits the bench time',
    )
    loop.add_argument("--confirm", action="store_true", help="ask before each run: Enter, s vetoes, p pauses, a aborts")
    loop.add_argument("--probe", metavar="NAME", help=BY_WHICH)
    loop.add_argument(
        "--fleet",
        metavar="FLEET.json",
        action="append",
        default=[],
        help="what other sensors of the type say, as shockrig fleet wrote it; a number is a SEED, see below",
    )
    loop.add_argument("--add", metavar="RUNS.toml", type=Path, help="a protocol whose runs are recorded first")
    parser.add_argument(
        "--bench",
        metavar="BENCH.toml",
        type=Path,
        help="bench file, or virtual (the default: emulated instruments), manual, raspberry-pi",
    )
    parser.add_argument("--out", metavar="CAMPAIGN", type=Path, help="campaign folder, new or to go on with")
    parser.add_argument(
        "--operator", metavar="NAME", help="who records, for campaign.json (asked once on a real bench)"
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="print the plan and what shockrig check finds; nothing moves"
    )
    parser.add_argument("--watch", action="store_true", help="show the live view of shockrig watch meanwhile")
    _add_emulated(parser)


def _add_emulated(parser: argparse.ArgumentParser) -> None:
    virtual = parser.add_argument_group("emulated instruments")
    virtual.add_argument("--seed", type=int, help="which sensors, noise and hidden effects")
    virtual.add_argument("--probes", metavar="N", type=int, help="how many are recorded at once (default: 1)")
    virtual.add_argument(
        "--spread",
        metavar="PERCENT",
        type=float,
        help="with --fleet SEED, which draws a type of sensors (--seed draws which of them): how far alpha and D "
        "differ from sensor to sensor (default: 2)",
    )
    virtual.add_argument("--rough", action="store_true", help="correlated noise, trigger jitter, gaps")
    virtual.add_argument(
        "--realistic",
        action="store_true",
        help="rough, sensors that show what every real one does, and effects as strong as real ones",
    )
    virtual.add_argument(
        "--hide",
        metavar="WHAT",
        help="effects to hide in the sensors: random, none, outside, a number, or the catalogue's ids joined by "
        "commas; ID@3 hides one in probe 3 alone, the others are in all probes",
    )
    virtual.add_argument(
        "--sealed", metavar="FILE", type=Path, help="where the truth is sealed (default: CAMPAIGN.sealed)"
    )


def main(args: argparse.Namespace) -> int:
    from shockrig.files.disk import is_there, real_path
    from shockrig.rig.bench import carrying, default_bench, load_bench, open_bench
    from shockrig.rig.bench_errors import BenchError
    from shockrig.rig.planning import check_plan
    from shockrig.rig.protocol import load_protocol
    from shockrig.rig.virtual.hide import seal

    adaptive = args.protocol == ADAPTIVE
    args.fleet, args.type_seed = _fleets(args)
    _demand_goals(args, adaptive)
    protocol = _opening(args) if adaptive else load_protocol(args.protocol)
    if args.bench is None and protocol.by_hand and not args.dry_run:
        _ask_for_invented_data(protocol.name)
    config = default_bench() if args.bench is None else load_bench(args.bench)
    if args.out is None and not args.dry_run:
        raise BenchError("--out CAMPAIGN is missing: where shall the recording go?")
    if not config.emulated:
        for name in ("seed", "rough", "realistic", "hide", "sealed", "probes", "spread", "type_seed"):
            if (given := getattr(args, name)) is not None and given is not False:
                option = "fleet SEED" if name == "type_seed" else name
                raise BenchError(f"--{option} is for emulated instruments; this bench has none")
        bench, sealed = open_bench(config), None
    else:
        bench, sealed = _emulated(args, config if args.probes is None else carrying(config, args.probes))
    for warning in check_plan(protocol, bench, _free_bytes(args.out)):
        print(f"warning: {warning}", file=sys.stderr)
    if args.dry_run:
        _print_plan(protocol, bench)
        return _preflight(args, protocol, bench)
    if sealed is None or sealed.path.exists():
        return _record(args, protocol, bench, sealed)
    new = [folder for folder in real_path(sealed.path).parents if not folder.exists()]
    try:
        sealed.path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BenchError(f"{sealed.path}: {error.strerror}; name a folder that can be written") from None
    seal(sealed.path, sealed.truth, sealed.seed)
    try:
        return _record(args, protocol, bench, sealed)
    finally:
        if not is_there(args.out / "campaign.json"):  # nor where nobody may look
            sealed.path.unlink()  # nothing was begun
            for folder in new:
                with contextlib.suppress(OSError):  # somebody else has put something there
                    folder.rmdir()


def _demand_goals(args: argparse.Namespace, adaptive: bool) -> None:
    """What belongs to `run adaptive` alone, and what that needs."""
    from shockrig.rig.bench_errors import BenchError

    if adaptive and not args.until:
        raise BenchError(f"--until is missing: what shall be reached? e.g. --until {EXAMPLE!r}")
    if adaptive and args.dry_run:
        raise BenchError("--dry-run: nothing is planned ahead here; shockrig plan says what would be recorded first")
    for name in () if adaptive else ("until", "confirm", "add", "probe", "fleet"):
        if getattr(args, name):
            raise BenchError(f"--{name} is for shockrig run adaptive; leave it out")


def _fleets(args: argparse.Namespace) -> tuple[Path | None, int | None]:
    """The fleet that is a prior, and the seed of a type of emulated sensors; and whether what goes with them fits."""
    from shockrig.rig.bench_errors import BenchError

    seeds = [int(text) for text in args.fleet if text.isdecimal()]
    files = [Path(text) for text in args.fleet if not text.isdecimal()]
    if len(seeds) > 1 or len(files) > 1:
        raise BenchError("--fleet: give one FLEET.json, one SEED, or one of each")
    if args.probes is not None and not 1 <= args.probes <= MOST_PROBES:
        raise BenchError(f"--probes {args.probes}: expected 1 to {MOST_PROBES}")
    if args.spread is not None and not seeds:
        raise BenchError("--spread: is how far sensors of a type differ; give --fleet SEED too")
    if args.spread is not None and not LEAST_SPREAD <= args.spread <= MOST_SPREAD:
        raise BenchError(f"--spread {args.spread:g}: expected {LEAST_SPREAD:g} to {MOST_SPREAD:g}")
    return next(iter(files), None), next(iter(seeds), None)


def _opening(args: argparse.Namespace) -> Any:
    """What `run adaptive` opens a campaign with: no runs yet, behind those that it has."""
    from shockrig.analysis.design.goals import parse_goals
    from shockrig.files.disk import is_there
    from shockrig.protocols.decided import as_protocol
    from shockrig.rig.bench_errors import BenchError
    from shockrig.rig.recorder.state import read_head

    goals = parse_goals(args.until)
    if args.out is None:
        raise BenchError("--out CAMPAIGN is missing: where shall the recording go?")
    plan = read_head(args.out).get("plan") if is_there(args.out / "campaign.json") else None
    return as_protocol([], len(plan) if isinstance(plan, list) else 0, ADAPTIVE, str(goals))


def _ask_for_invented_data(protocol: str) -> None:
    """A protocol for a person at a real bench is not run on the virtual one because an option was forgotten."""
    from shockrig.rig.bench_errors import BenchError

    missing = f"--bench is missing: the protocol {protocol} is for instruments of your own"
    if sys.stdin.isatty():
        print(f"{missing}. Record invented data on the virtual bench instead? [yes/No]", file=sys.stderr)
        if sys.stdin.readline().strip().lower() in ("y", "yes"):
            return
    raise BenchError(f"{missing}; name them by --bench, or give --bench virtual for invented data")


def _emulated(args: argparse.Namespace, config: Any) -> tuple[Any, _Sealed]:
    """A bench with emulated sensors, and their truth: drawn for a new campaign, or the sealed one of a campaign."""
    from dataclasses import replace

    import numpy as np

    from shockrig.files.campaign_names import probes_of
    from shockrig.files.disk import is_there, real_path
    from shockrig.rig.bench import open_bench
    from shockrig.rig.bench_errors import BenchError
    from shockrig.rig.bench_file import LARGEST_SEED
    from shockrig.rig.virtual.hide import COMFORTABLE, draw_hidden
    from shockrig.rig.virtual.truth import (
        REALISTIC,
        ROUGH,
        SMOOTH,
        TYPE_SPREAD,
        draw_truth,
        of_type,
        with_effects,
    )

    out = real_path(args.out or Path("dry-run"))
    path = args.sealed or out.with_name(out.name + ".sealed")
    seed, truth, recorded = args.seed, None, 0
    if is_there(out / "campaign.json") and not args.dry_run:
        truth, seed = _unsealed(args, path)
        recorded = sum(1 for _ in out.glob("runs/*/run.json"))
    elif is_there(path) and not args.dry_run:
        raise BenchError(f"{path}: is the sealed truth of another campaign; remove it, or give another --out")
    if seed is None:
        # A blind trial that could be looked up by its seed would not be blind.
        seed = secrets.randbits(32) if args.hide is not None else config.virtual.seed
    given = args.hide is not None or args.rough or args.realistic or args.type_seed is not None
    if truth is None and (given or config.virtual.truth is None):
        rng = np.random.default_rng(seed)
        tier = REALISTIC if args.realistic else ROUGH if args.rough else SMOOTH
        if args.type_seed is None:
            truth = draw_truth(rng, tier)
        else:
            spread = TYPE_SPREAD if args.spread is None else 0.01 * args.spread
            truth = of_type(args.type_seed, seed, tier, spread)
        strength = REALISTIC if args.realistic else COMFORTABLE
        truth = with_effects(truth, draw_hidden(rng, args.hide or "none", strength))
    # A campaign that goes on must not replay the noise that it began with.
    noise_seed = (seed + 1_000_003 * recorded) % (LARGEST_SEED + 1)
    config = replace(config, virtual=replace(config.virtual, seed=noise_seed))
    for probe in {} if truth is None else {hidden.probe for hidden in truth.effects} - {"", *probes_of(config.sensors)}:
        raise BenchError(f"--hide: there is no probe {probe}; the bench has {', '.join(probes_of(config.sensors))}")
    bench = open_bench(config, truth=truth)
    return bench, _Sealed(path, bench.truth, seed)


def _unsealed(args: argparse.Namespace, path: Path) -> tuple[Any, int]:
    """The truth and the seed of a campaign that goes on."""
    from shockrig.rig.bench_errors import BenchError
    from shockrig.rig.recorder.state import read_head
    from shockrig.rig.virtual.hide import open_seal

    head = read_head(args.out)
    if not head.get("emulated", path.exists()):
        there = f"the bench {head['bench']!r}" if "bench" in head else "another bench"
        raise BenchError(f"{args.out}: was recorded on {there}, not on emulated instruments; name it by --bench")
    if not path.exists():
        raise BenchError(f"{path}: the sealed truth of {args.out} is gone; name it by --sealed, or another --out")
    truth, seed = open_seal(path)
    if args.seed not in (None, seed):
        raise BenchError(f"{args.out} was begun with another --seed; leave it out, or give another --out")
    return truth, seed


def _free_bytes(out: Path | None) -> int | None:
    import shutil

    from shockrig.files.disk import real_path

    if out is None:
        return None
    existing = next((folder for folder in (out, *real_path(out).parents) if folder.is_dir()), None)
    return None if existing is None else shutil.disk_usage(existing).free


def _print_plan(protocol: Any, bench: Any) -> None:
    from shockrig.protocols.run_progress import duration, words

    print(f"{protocol.name}: {protocol.description}")
    invented = " (emulated instruments)" if bench.emulated else ""
    print(f"{counted(len(protocol.runs), 'run')} on {bench.name}{invented} with {', '.join(bench.describe())}")
    steps: tuple[Any, ...] = ()
    for run in protocol.runs:
        if run.steps != steps:
            steps = run.steps
            print("  each: " + "; ".join(str(step) for step in steps))
        flow = "" if run.airflow_m_s is None else f", {run.airflow_m_s:g} m/s"
        note = f"  ({run.note})" if run.note else ""
        print(f"  {run.id}  {words(run.source)} -> {words(run.destination)}{flow}{note}")
    shortest_s = sum(run.shortest_s() for run in protocol.runs)
    longest_s = sum(run.longest_s() for run in protocol.runs)
    print(f"bench time: {duration(shortest_s)} where every soak is stable at once, at most {duration(longest_s)}")


def _preflight(args: argparse.Namespace, protocol: Any, bench: Any) -> int:
    """What `shockrig check` says, the stage left alone; 0 where all is ready."""
    import time

    from shockrig.protocols.commands.check import ready
    from shockrig.rig.bench_findings import examine, lacking, tree

    with bench:
        findings = examine(bench, protocol, args.out or Path(), wall=time.time, may_move=False)
    print(tree(bench.name, findings))
    missing = lacking(findings)
    print(missing or ready(args.protocol, args.bench, args.out or Path(), _given(args)))
    return 1 if missing else 0


def _given(args: argparse.Namespace) -> list[str]:
    """The options that make it this recording and no other, as they were typed."""
    words: list[str] = []
    for name in ("operator", "watch", "type_seed", "seed", "probes", "spread", "rough", "realistic", "hide", "sealed"):
        value, option = getattr(args, name), f"--{'fleet' if name == 'type_seed' else name}"
        if value is not None and value is not False:
            words += [option] if value is True else [option, str(value)]
    return words


def _record(args: argparse.Namespace, protocol: Any, bench: Any, sealed: _Sealed | None) -> int:
    from shockrig.protocols.decisions_page import write_loop_page
    from shockrig.protocols.provenance import session
    from shockrig.protocols.run_progress import duration, observer
    from shockrig.protocols.watch.beside import LiveObserver
    from shockrig.rig.clock import VirtualClock
    from shockrig.rig.recorder import read_state
    from shockrig.rig.runner import record_campaign
    from shockrig.rig.watch.status_file import StatusFile

    operator = args.operator or _operator(args.out, bench)
    in_real_time = not isinstance(bench.clock, VirtualClock)
    shown: Any = observer()
    if args.watch:
        shown = LiveObserver(args.out)
        bench.operator.hidden = lambda: shown.shows
    with bench, shown, StatusFile(args.out, protocol, bench.name, shown) as told:
        loop = _loop(args, bench, told.say) if args.protocol == ADAPTIVE else None
        with contextlib.nullcontext() if loop is None else contextlib.closing(loop):
            recorded = record_campaign(
                bench,
                protocol,
                args.out,
                utc=_utc(bench.clock),
                observer=told,
                sync_every_s=1.0 if in_real_time else None,
                session=session(bench, _utc(bench.clock)(), operator),
                more=loop,
            )
    state = read_state(args.out)
    spoilt = f", {counted(len(state.set_aside), 'attempt')} set aside" if state.set_aside else ""
    print(f"{counted(len(state.recorded), 'run')} in {args.out} ({len(recorded)} recorded now{spoilt})")
    if recorded:
        print(f"bench time: {duration(bench.clock.now())} on {bench.name}")
    if loop is not None and loop.decision is not None:
        print(f"{loop.decision.status}: {loop.decision.reason}")
        if in_real_time:
            print(f"the bench waited {duration(loop.waited_s)} for decisions")
        print(f"decisions: {write_loop_page(args.out)}")
    if sealed is not None:
        print(f"sealed truth: {sealed.path}")
    return 0


def _loop(args: argparse.Namespace, bench: Any, say: Callable[[str], None]) -> Any:
    """What decides on the next run, whenever the recorder asks."""
    from shockrig.analysis.design.goals import parse_goals
    from shockrig.files.fleet_file import read_fleet
    from shockrig.protocols.adaptive import Loop
    from shockrig.rig.protocol import load_protocol

    added = () if args.add is None else load_protocol(args.add).runs
    population = None if args.fleet is None else read_fleet(args.fleet).population
    return Loop(args.out, parse_goals(args.until), bench, say, added, args.confirm, args.probe, population)


def _operator(out: Path, bench: Any) -> str | None:
    """Who recorded this campaign's last session; for a new one on a real bench the person at the terminal is asked."""
    from shockrig.files.disk import is_there
    from shockrig.rig.recorder.state import read_head

    if is_there(out / "campaign.json"):
        sessions = read_head(out).get("sessions")
        last = sessions[-1] if isinstance(sessions, list) and sessions else {}
        return last.get("operator") if isinstance(last, dict) else None
    if bench.emulated or not (sys.stdin.isatty() and sys.stderr.isatty()):
        return None
    print("Who records? [name, Enter for nobody] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip() or None


def _utc(clock: Any) -> Callable[[], str]:
    """Time of day that goes along with the bench clock, which a jump of the host's clock does not touch."""
    from datetime import UTC, datetime, timedelta

    zero = datetime.now(UTC) - timedelta(seconds=clock.now())

    def utc() -> str:
        return (zero + timedelta(seconds=clock.now())).isoformat(timespec="milliseconds").replace("+00:00", "Z")

    return utc
