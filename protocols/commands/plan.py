"""shockrig plan: the runs to record next for given goals, as a protocol that `run` takes, or why there are none; or the
flight that would decide what flights left open, as a mission."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from shockrig.files.numbers import counted
from shockrig.protocols.each_probe import BY_WHICH


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = (
        "Every decision is kept in CAMPAIGN/decisions.jsonl. What is written with --out is a protocol: shockrig run "
        "NEXT.toml --out CAMPAIGN goes on with the campaign; any other program may record the runs of NEXT.json. A "
        "diagnosis of the campaign as it is, in its folder or beside it, is used and not made once more. "
        "With --flights there is no bench: it says which flight would decide most per minute of what is left open, "
        "and --out writes it as a mission."
    )
    parser.add_argument(
        "campaign", metavar="CAMPAIGN", nargs="?", type=Path, help="campaign folder; may be empty or not there"
    )
    parser.add_argument(
        "--until",
        metavar="GOALS",
        help='such as "alpha 0.2 %%, D 0.3 %%, ties decided"; "minutes 90" limits the bench time',
    )
    parser.add_argument(
        "--out",
        metavar="NEXT.toml",
        type=Path,
        help="the protocol, with NEXT.json; with --flights a mission, NEXT.waypoints or NEXT.plan",
    )
    parser.add_argument("--runs", metavar="N", type=int, default=6, help="how many runs to choose at most (default: 6)")
    parser.add_argument("--probe", metavar="NAME", help=BY_WHICH)
    parser.add_argument(
        "--fleet",
        metavar="FLEET.json",
        type=Path,
        help="what other sensors of the type say, as shockrig fleet wrote it",
    )
    parser.add_argument("--bench", metavar="BENCH.toml", type=Path, help="choose only what this bench can do")
    flights = parser.add_argument_group("the flight that would decide")
    flights.add_argument("--flights", metavar="LEARNED", type=Path, help="folder that shockrig learn wrote")
    flights.add_argument(
        "--home",
        metavar="LAT,LON,ALT",
        help="where the drone takes off, altitude above the sea (default: as learned); write --home=-33.5,151,20 south "
        "of the equator",
    )
    flights.add_argument("--ceiling", metavar="M", type=float, help="highest altitude above home (default: 120)")
    flights.add_argument("--endurance", metavar="MIN", type=float, help="how long the drone flies (default: 20)")


def main(args: argparse.Namespace) -> int:
    from shockrig.files.errors import InputError

    if args.flights is not None:
        for name in ("campaign", "until", "probe", "fleet", "bench"):
            if getattr(args, name) is not None:
                shown_name = "CAMPAIGN" if name == "campaign" else f"--{name}"
                raise InputError(f"{shown_name} is for a bench; leave it out with --flights")
        return _plan_flight(args)
    for name in ("home", "ceiling", "endurance"):
        if getattr(args, name) is not None:
            raise InputError(f"--{name} is of a flight; give --flights LEARNED, the folder that shockrig learn wrote")
    for name, value in (("CAMPAIGN", args.campaign), ("--until GOALS", args.until), ("--out NEXT.toml", args.out)):
        if value is None:
            raise InputError(f"{name} is missing; shockrig plan --help says what it takes")
    return _plan_runs(args)


def _plan_flight(args: argparse.Namespace) -> int:
    from shockrig.analysis.plan.decide_flight import AT_NIGHT, FlightLimits, advice, by_night, ranked
    from shockrig.analysis.plan.flight_plan import mission_of, words
    from shockrig.files.disk import demand_place, shown
    from shockrig.files.errors import InputError
    from shockrig.files.learned import read_learned
    from shockrig.files.mission import write_mission

    if args.out is not None:
        demand_place(args.out)  # before the work
        if args.out.suffix not in (".waypoints", ".plan"):
            raise InputError(f"--out {shown(args.out)}: a mission's name ends in .waypoints or .plan; name it so")
    path = args.flights / "learned.json"
    learned = read_learned(path)
    home = learned.home if args.home is None else _place(args.home)
    if home is None and args.out is not None:
        raise InputError(f"{shown(path)} does not say where home is; give --home LAT,LON,ALT")
    given = {"ceiling_m": args.ceiling, "endurance_minutes": args.endurance}
    limits = FlightLimits(**{name: value for name, value in given.items() if value is not None})
    flights = ranked(learned, limits)
    best = flights[0]
    print(f"the next flight: {best.what}; {advice(best)}")
    print("\n".join(f"  {sentence}" for sentence in words(best.legs)))
    if by_night(learned):
        print(f"  {AT_NIGHT}")
    for channel, one in learned.channels.items():
        models = [" and ".join(rival.laws).replace("_", " ") or "nothing" for rival in one.rivals]
        if len(models) > 1:
            print(f"{channel}: {best.nats_of[channel]:.1f} nats expected between {' / '.join(models)}")
    print("nats a minute, nats, minutes:")
    for flight in flights:
        print(f"  {flight.nats_per_minute:8.2f} {flight.nats:8.1f} {flight.minutes:6.1f}  {flight.what}")
    if args.out is not None and home is not None:
        write_mission(args.out, mission_of(home, best.legs))
        print(f"mission: {args.out}")
    return 0


def _place(text: str) -> tuple[float, float, float]:
    """LAT,LON,ALT as numbers that can be."""
    from shockrig.files.errors import InputError
    from shockrig.files.ranges import LIKELY_RANGES, Range

    try:
        latitude, longitude, altitude = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"--home {text!r}: expected latitude, longitude [deg] and altitude [m], such as 46.81,6.94,491"
        ) from None
    for name, value, possible in (
        ("latitude", latitude, Range(-89.0, 89.0)),
        ("longitude", longitude, Range(-180.0, 180.0)),
        ("altitude", altitude, LIKELY_RANGES["altitude_m"]),
    ):
        if not possible.holds(value):
            raise InputError(f"--home: {name} {possible.refusal(value)}; give latitude, longitude, altitude")
    return latitude, longitude, altitude


def _plan_runs(args: argparse.Namespace) -> int:
    from shockrig.analysis.design.goals import parse_goals
    from shockrig.analysis.design.menu import ORDINARY
    from shockrig.analysis.design.recorded_so_far import usual_of
    from shockrig.analysis.plan.decide import anything, decide
    from shockrig.analysis.plan.decision import CONTINUE, log_entry, plan_document, remembered
    from shockrig.files.disk import write_whole
    from shockrig.files.fleet_file import read_fleet
    from shockrig.files.json_files import write_json
    from shockrig.files.plan_file import append_decision, read_decisions
    from shockrig.protocols.decided import as_protocol, feasible_on, lines, surroundings_of
    from shockrig.protocols.decisions_page import write_loop_page
    from shockrig.protocols.each_probe import seen_by, wanted_probes
    from shockrig.protocols.made_before import outcomes
    from shockrig.protocols.time_left import PLANNING, Phases
    from shockrig.rig.bench import open_bench
    from shockrig.rig.bench_file import load_bench
    from shockrig.rig.protocol_text import protocol_text

    say = Phases(PLANNING)
    goals = parse_goals(args.until)
    _demand_sense(args)
    population = None if args.fleet is None else read_fleet(args.fleet).population
    recorded, planned = _counted(args.campaign)
    probes = wanted_probes(args.campaign, args.probe) if recorded else ()
    seen = seen_by(args.campaign, probes)
    campaign = seen[0] if seen else None
    log = read_decisions(args.campaign, probes) if recorded else []
    last = log[-1] if log else None
    bench = None if args.bench is None else open_bench(load_bench(args.bench))
    feasible = anything if bench is None else feasible_on(bench)
    surroundings = ORDINARY if bench is None else surroundings_of(bench)
    decision = decide(
        seen,
        goals,
        remembered(last),
        count=args.runs,
        feasible=feasible,
        surroundings=surroundings,
        made=outcomes(args.campaign, seen, say) if seen else {},
        population=population,
        progress=say,
    )
    document = plan_document(decision, goals)
    others = usual_of(campaign, goals, surroundings).other.pressures_hpa
    shocks = [c.shock for c in decision.choices]
    protocol = as_protocol(shocks, max(recorded, planned), args.out.stem, str(goals), others)
    if recorded:
        append_decision(args.campaign, log_entry(decision, goals, last, [], probes=probes))
        write_loop_page(args.campaign)
    if decision.status == CONTINUE:
        write_whole(args.out, protocol_text(protocol), False)
    else:
        args.out.unlink(missing_ok=True)  # of an earlier look: there is nothing more to record
    write_json(args.out.with_suffix(".json"), document)
    print("\n".join(lines(decision, document)))
    if decision.status == CONTINUE:
        command = shlex.join(["shockrig", "run", str(args.out), "--out", str(args.campaign)])
        print(f"{counted(len(decision.choices), 'run')} in {args.out}: {command}")
    return 0


def _demand_sense(args: argparse.Namespace) -> None:
    from shockrig.files.disk import demand_place, shown
    from shockrig.files.errors import InputError

    if args.out.suffix != ".toml":
        raise InputError(f"--out {shown(args.out)}: a protocol's name ends in .toml; NEXT.json is written beside it")
    for path in (args.out, args.out.with_suffix(".json")):
        demand_place(path)  # before the work, and so that one is not written without the other
    if not 1 <= args.runs <= 100:
        raise InputError(f"--runs {args.runs}: expected 1 to 100")


def _counted(path: Path) -> tuple[int, int]:
    """How many runs a campaign folder holds, and how many were planned; 0 where it is empty or not there."""
    from shockrig.files.disk import is_there
    from shockrig.rig.recorder.state import read_head, read_state

    if not is_there(path) or (path.is_dir() and not any(path.iterdir())):
        return 0, 0
    plan = read_head(path).get("plan")
    return len(read_state(path).recorded), len(plan) if isinstance(plan, list) else 0
