"""shockrig import LOG...: logs with many steps and sensors, looked at (--look) or made into campaigns (--map)."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from shockrig.files.errors import InputError
from shockrig.files.numbers import counted, short

if TYPE_CHECKING:
    from shockrig.rig.logs.found import LogStep
    from shockrig.rig.logs.log_campaigns import Imported, SensorCampaign
    from shockrig.rig.logs.sensor_logs import SensorLog


def look(args: argparse.Namespace) -> int:
    """Write a first map and a picture of every log; with --map only the pictures, of the steps that the map has."""
    from shockrig.files.disk import is_there, shown
    from shockrig.files.figures import figure_bytes
    from shockrig.protocols.folder import whole_folder
    from shockrig.protocols.log_picture import draw_log
    from shockrig.protocols.time_left import LOOKING_AT_LOG, Phases
    from shockrig.rig.logs.first_map import look_at
    from shockrig.rig.logs.found import steps_of
    from shockrig.rig.logs.map_file import read_map
    from shockrig.rig.logs.runs import unused
    from shockrig.rig.logs.sensor_logs import read_sensors

    say = Phases(LOOKING_AT_LOG, only_long=True)
    folder = args.out or Path(".")
    map_path = args.map or folder / f"{args.logs[0].stem}.toml"
    text, notes = None, tuple[str, ...]()
    if args.map is not None:
        map_ = read_map(args.map)
        logs = [read_sensors(path, map_) for path in args.logs]
        say("looking for steps")
        steps = [steps_of(one, map_, len(logs) > 1) for one in logs]
    else:
        if is_there(map_path):
            raise InputError(
                f"{shown(map_path)}: is there already and may hold your corrections; look with --map, move it away, or "
                "give another --out"
            )
        seen = look_at(args.logs, map_path, say, args.sensor)
        if args.sensor is not None and seen.whose and seen.whose[0] != args.sensor:
            raise InputError(f"--sensor {args.sensor}: no row is of it; rows are of {', '.join(seen.whose)}")
        map_, text, logs, steps, notes = seen.map, seen.text, list(seen.logs), list(seen.steps), seen.notes
    say("picture")
    left_out = [unused(one, those, map_) for one, those in zip(logs, steps, strict=True)]
    with whole_folder(folder) as partial:
        for one, those, why_not in zip(logs, steps, left_out, strict=True):
            used = [step.number not in why_not for step in those]
            (partial / f"{one.log.path.stem}.png").write_bytes(figure_bytes(draw_log(one, those, used)))
        if text is not None:
            (partial / map_path.name).write_text(text, encoding="utf-8")
    for one, those, why_not in zip(logs, steps, left_out, strict=True):
        _say_log(one, those, why_not)
    for said in notes:
        print(f"  {said}")
    for one in logs:
        print(f"picture: {folder / f'{one.log.path.stem}.png'}")
    names = " ".join(str(path) for path in args.logs)
    print(f"map: {map_path}{' (check columns, units and steps in it)' if text is not None else ''}")
    if any(len(why_not) < len(those) for those, why_not in zip(steps, left_out, strict=True)):
        print(f"next: shockrig import {names} --map {map_path} --out CAMPAIGN")
    else:
        print(
            "no step makes a run: state [[step]] at = ... in the map where the picture shows one, and look again with"
        )
        print(f"  shockrig import {names} --look --map {map_path}")
        print("  (a record that begins in its response is one run: shockrig import --imet LOG, --hyt LOG or both)")
    return 0


def import_by_map(args: argparse.Namespace) -> int:
    """Make a campaign of each sensor that the map wants, whole or not at all; or add to campaigns that are there."""
    from shockrig.files.campaign_lock import held
    from shockrig.files.campaign_write import write_campaign
    from shockrig.files.disk import real_path, shown
    from shockrig.protocols.folder import software_version, whole_folder
    from shockrig.rig.logs.adding import with_more
    from shockrig.rig.logs.log_campaigns import describe, import_logs, write_runs
    from shockrig.rig.logs.map_file import read_map
    from shockrig.rig.logs.runs import unused

    out: Path = args.out
    map_ = read_map(args.map)
    several = args.sensor is None and len(map_.wanted) > 1
    wanted = {sensor: out / sensor if several else out for sensor in ((args.sensor,) if args.sensor else map_.wanted)}
    with ExitStack() as stack:
        # Whoever records or imports into a folder holds it; what is not there yet appears whole, by a rename.
        for place in dict.fromkeys([out, *wanted.values()]):
            if place.is_dir():
                stack.enter_context(held(place))
        there = {sensor for sensor, place in wanted.items() if (place / "campaign.json").is_file()}
        if not there and (out.is_file() or (out.is_dir() and any(out.iterdir()))):
            raise InputError(f"--out {shown(out)}: is there already, and no campaign of this map; give another name")
        imported = import_logs(args.logs, map_, args.sensor)
        made = [campaign for campaign in imported.campaigns if campaign.runs]
        name = args.name or map_.name or real_path(out).name
        documents, first = {}, dict.fromkeys(wanted, 1)
        for campaign in made:
            sensor = campaign.sensor
            called = f"{name} {sensor}" if several else name
            documents[sensor] = describe(campaign, imported, called, software_version())
            if sensor in there:
                documents[sensor], first[sensor] = with_more(wanted[sensor], documents[sensor])
        new = [campaign for campaign in made if campaign.sensor not in there]
        if new:
            with whole_folder(out) as partial:
                for campaign in new:
                    place = partial / campaign.sensor if several else partial
                    place.mkdir(exist_ok=True)
                    write_runs(place / "runs", campaign.runs)
                    write_campaign(place, documents[campaign.sensor])
        for campaign in made:
            if campaign.sensor in there:
                place = wanted[campaign.sensor]
                with whole_folder(place / "runs") as partial:
                    write_runs(partial, campaign.runs, first[campaign.sensor])
                write_campaign(place, documents[campaign.sensor])
    for one, those in zip(imported.logs, imported.steps, strict=True):
        _say_log(one, those, unused(one, those, map_))
    for campaign in imported.campaigns:
        _say_campaign(campaign, wanted[campaign.sensor], first[campaign.sensor])
    _say_unknown(imported)
    for place in (wanted[campaign.sensor] for campaign in made):
        print(f"next: shockrig diagnose {place} --out {place}-diagnosis")
    return 0


def _when(sensors: SensorLog, one: LogStep) -> str:
    import math

    from shockrig.rig.logs.stamps import to_map, unit_shown

    unsure_s = one.step.uncertainty_s
    digits = min(max(math.ceil(-math.log10(max(unsure_s, 1e-3))), 0), 3)
    at = to_map(sensors.log.clock, sensors.log.origin_s, one.step.at_s, digits).strip('"')
    piece = f", piece {one.step.piece + 1}" if len(sensors.log.pieces) > 1 else ""
    return f"{at}{unit_shown(sensors.log.clock)} ± {short(unsure_s, 2)} s{piece}"


def sensors_said(names: Sequence[str]) -> str:
    """Sensors by their names; one that has none of its own is called "sensor" and needs no more words."""
    if list(names) == ["sensor"]:
        return "one sensor"
    return f"sensor{'' if len(names) == 1 else 's'} {', '.join(names)}"


def _say_log(sensors: SensorLog, steps: Sequence[LogStep], left_out: Mapping[int, str]) -> None:
    from shockrig.rig.logs.first_map import said_of

    log = sensors.log
    names = sensors_said(list(sensors.readings))
    print(f"{log.path.name}: {log.time_s.size} rows, one every {log.period_s:.4g} s; {names}")
    for said in (*log.remarks, *(said for readings in sensors.readings.values() for said in readings.remarks)):
        print(f"  {said}")
    if log.clock.doubt:
        print(f"  time: {log.clock.doubt}")
    how = "stated by the map" if any(one.said is not None for one in steps) else "seen"
    print(f"  {counted(len(steps), 'step')} {how}")
    for one in steps:
        why = f"  not used: {left_out[one.number]}" if one.number in left_out else ""
        print(f"  {one.number:3d}  {_when(sensors, one)}{why}")
        if not why:
            for move in one.step.moves:
                print(f"         {said_of(move, one.step.at_s)}")


def _say_campaign(campaign: SensorCampaign, place: Path, first: int) -> None:
    count = len(campaign.runs)
    added = f" added to {first - 1}" if first > 1 else ""
    print(f"{place}: {sensors_said([campaign.sensor])}, {counted(count, 'run')}{added}")
    for number, run in enumerate(campaign.runs, start=first):
        seen_s = run.step.step.at_s
        readings = ", ".join(f"{name} {size}" for name, size in run.readings.items())
        print(
            f"  {number:04d}  {run.log} step {run.step.number}: {short(seen_s - run.begin_s, 4)} s before, "
            f"{short(run.end_s - seen_s, 4)} s after; readings: {readings}"
        )
        for said in run.remarks:
            print(f"        {said}")
    for said in campaign.left_out_said:
        print(f"  left out  {said}")
    if not campaign.runs:
        print("  no campaign is written for it")


def _say_unknown(imported: Imported) -> None:
    """What was not recorded, and where it can be stated."""
    runs = [run for campaign in imported.campaigns for run in campaign.runs]
    count = len(runs)
    measured = [run for run in runs if "air" in run.tables]
    rest = [run for run in runs if "air" not in run.tables]
    if measured:
        print(f"air measured beside the sensor (air.csv): {len(measured)} of {count} runs")
    missing = {
        "when the transfer began (estimated run by run)": (
            "[[step]] start",
            [r for r in rest if "transfer" not in r.document],
        ),
        "the two airs (taken from the plateaus)": (
            "[[step]] source, destination",
            [r for r in rest if not {"source", "destination"} <= set(r.document)],
        ),
        "the airflow": ("airflow_m_s", [r for r in runs if "airflow_m_s" not in r.document]),
        "the pressure": ("pressure_hpa", [r for r in runs if "pressure_hpa" not in r.document]),
    }
    for what, (key, those) in missing.items():
        if those:
            print(f"not known: {what}, {len(those)} of {count} runs; state {key} in the map if it is known")
