"""shockrig import: other loggers' files -> a campaign. Logs with many steps by a map (import_log), or one run at a time
from CSV files of one sensor each (here)."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from shockrig.rig.logs.one_run import SensorSeries


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = (
        "First look: shockrig import LOG --look writes LOG.toml, a map of what is recognised, and LOG.png with the "
        "steps that are seen. Then: shockrig import LOG --map LOG.toml --out mine. One run at a time (columns are "
        "named, or numbered from 1; usual names are found without help): shockrig import --imet log.csv --hyt log.csv "
        "--imet-temperature T_bead --source-temperature 40 --destination-temperature 20 --start 12.4 --out mine"
    )
    logs = parser.add_argument_group("logs with any number of sensors and steps")
    logs.add_argument("logs", metavar="LOG", type=Path, nargs="*", help="text files of any layout, all of one")
    logs.add_argument(
        "--look", action="store_true", help="write a first map and a picture of the log into --out (default: .)"
    )
    logs.add_argument(
        "--map",
        metavar="MAP.toml",
        type=Path,
        help="what the columns are and which steps are runs; a file, or haar, intermet, rbr",
    )
    logs.add_argument("--sensor", metavar="NAME", help="of several sensors only this one; --out is then its campaign")
    files = parser.add_argument_group("one run at a time")
    files.add_argument("--imet", metavar="FILE", type=Path, help="CSV file of the thermometer")
    files.add_argument("--hyt", metavar="FILE", type=Path, help="CSV file of the hygrometer (may be the same file)")
    files.add_argument("--out", metavar="CAMPAIGN", type=Path, help="campaign folder; new, or (one run) existing")
    files.add_argument("--id", help="id of the run (default: the next free number)")
    columns = parser.add_argument_group("columns")
    columns.add_argument("--imet-time", metavar="COLUMN", help="time in the thermometer's file")
    columns.add_argument("--imet-temperature", metavar="COLUMN", help="what the thermometer reads")
    columns.add_argument("--hyt-time", metavar="COLUMN", help="time in the hygrometer's file")
    columns.add_argument("--hyt-humidity", metavar="COLUMN", help="relative humidity that the hygrometer reads")
    columns.add_argument("--hyt-temperature", metavar="COLUMN", help="the hygrometer's own die temperature")
    _add_layout(parser)
    _add_run(parser)


def _add_layout(parser: argparse.ArgumentParser) -> None:
    layout = parser.add_argument_group("how the logger writes (found out where left out)")
    layout.add_argument(
        "--time-unit",
        choices=["auto", "s", "ms", "us", "min", "h", "iso"],
        default="auto",
        help="of the time columns; iso: ISO 8601 dates (default: as their names say, else s)",
    )
    layout.add_argument("--time-format", metavar="FORMAT", help="strptime format, e.g. '%%d.%%m.%%Y %%H:%%M:%%S.%%f'")
    layout.add_argument("--delimiter", choices=["comma", "semicolon", "tab"], help="between the columns")
    layout.add_argument("--decimal", choices=["point", "comma"], help="what numbers are written with")
    layout.add_argument("--skip-lines", metavar="N", type=int, default=0, help="lines before the header")
    layout.add_argument(
        "--temperature-unit",
        choices=["c", "k", "f"],
        help="of all temperature columns (default: as their names say, else c)",
    )
    layout.add_argument(
        "--humidity-unit",
        choices=["percent", "fraction"],
        help="of the humidity column (default: as its name says, else percent)",
    )


def _add_run(parser: argparse.ArgumentParser) -> None:
    run = parser.add_argument_group("the run (leave out what is not known)")
    run.add_argument("--source-temperature", metavar="DEGC", type=float, help="of the air that the probes come from")
    run.add_argument(
        "--source-humidity", metavar="PERCENT", type=float, help="relative, of the air that they come from"
    )
    run.add_argument(
        "--destination-temperature", metavar="DEGC", type=float, help="of the air that they are moved into"
    )
    run.add_argument(
        "--destination-humidity", metavar="PERCENT", type=float, help="relative, of the air that they are moved into"
    )
    run.add_argument("--airflow", metavar="M_S", type=float, help="of the destination air past the probes")
    run.add_argument("--pressure", metavar="HPA", type=float, help="of the air")
    run.add_argument("--start", metavar="TIME", help="when the probes left the source air, on the clock of the files")
    run.add_argument("--duration", metavar="S", type=float, help="how long the transfer took")
    sensors = parser.add_argument_group("the sensors (for a new campaign)")
    sensors.add_argument("--name", help="name of the campaign")
    sensors.add_argument("--imet-kind", help="model of the thermometer, such as imet-xf")
    sensors.add_argument("--imet-serial", help="its serial number")
    sensors.add_argument("--bead-radius", metavar="M", type=float, help="of the thermometer's bead (default: 4e-4)")
    sensors.add_argument("--hyt-kind", help="model of the hygrometer, such as hyt-271")
    sensors.add_argument("--hyt-serial", help="its serial number")
    sensors.add_argument("--film-thickness", metavar="M", type=float, help="of the hygrometer's film (default: 1e-5)")


def main(args: argparse.Namespace) -> int:
    from shockrig.rig.bench_errors import BenchError

    _check_numbers(args)
    if args.logs or args.look or args.map is not None or args.sensor is not None:
        return _import_logs(args)
    from shockrig.analysis.checks import check_campaign
    from shockrig.files.campaign import read_campaign
    from shockrig.rig.logs.one_run import RunFacts, import_run

    if args.imet is None and args.hyt is None:
        raise BenchError("no file: give LOG and --look, or for one run --imet FILE, --hyt FILE or both")
    if args.out is None:
        raise BenchError("--out: is missing; name the campaign's folder")
    series = _series(args)
    facts = RunFacts(
        source_temperature_c=args.source_temperature,
        source_humidity_percent=args.source_humidity,
        destination_temperature_c=args.destination_temperature,
        destination_humidity_percent=args.destination_humidity,
        airflow_m_s=args.airflow,
        pressure_hpa=args.pressure,
        start=args.start,
        duration_s=args.duration,
    )
    described = {
        "imet": {"kind": args.imet_kind, "serial": args.imet_serial, "bead_radius_m": args.bead_radius},
        "hyt": {"kind": args.hyt_kind, "serial": args.hyt_serial, "film_thickness_m": args.film_thickness},
    }
    sensors = {name: {k: v for k, v in entry.items() if v is not None} for name, entry in described.items()}
    id_ = import_run(args.out, series, facts, id_=args.id, name=args.name, sensors=sensors)
    for name, one in series.items():
        print(f"{name}: {one.time_s.size} readings over {one.time_s[-1] - one.time_s[0]:.1f} s", file=sys.stderr)
        for remark in one.remarks:
            print(f"{name}: {remark}", file=sys.stderr)
    for finding in check_campaign(read_campaign(args.out)):
        if id_ in finding.runs:
            print(f"input: {finding.sentence}", file=sys.stderr)
    if args.start is None:
        print("no --start: the time of the transfer will be estimated from the data", file=sys.stderr)
    print(args.out / "runs" / id_)
    return 0


def _series(args: argparse.Namespace) -> dict[str, SensorSeries]:
    """The readings of one run, of each sensor that has a file."""
    from shockrig.rig.logs.one_run import LogOptions, read_sensor
    from shockrig.rig.logs.text import Layout

    decimal = {"point": ".", "comma": ","}.get(args.decimal)
    layout = Layout(args.delimiter, decimal, args.skip_lines + 1 if args.skip_lines else None)

    def options(**columns: str | None) -> LogOptions:
        return LogOptions(
            columns={key: value for key, value in columns.items() if value is not None},
            layout=layout,
            time_unit=None if args.time_unit == "auto" else args.time_unit,
            time_format=args.time_format,
            temperature_unit=args.temperature_unit,
            humidity_unit=args.humidity_unit,
        )

    series = {}
    if args.imet is not None:
        imet = options(time=args.imet_time or args.hyt_time, temperature=args.imet_temperature)
        series["imet"] = read_sensor(args.imet, "imet", imet)
    if args.hyt is not None:
        hyt = options(
            time=args.hyt_time or args.imet_time, humidity=args.hyt_humidity, die_temperature=args.hyt_temperature
        )
        # In a common file the temperature is the thermometer's, so the die's must be named.
        series["hyt"] = read_sensor(args.hyt, "hyt", hyt, die=args.hyt != args.imet)
    return series


def _import_logs(args: argparse.Namespace) -> int:
    """Logs by a map, or a first look at them."""
    from shockrig.protocols.commands.import_log import import_by_map, look
    from shockrig.rig.bench_errors import BenchError

    if not args.logs:
        raise BenchError("no LOG given; --look, --map and --sensor need one, such as shockrig import LOG --look")
    # Every other option belongs to the other way of importing: it would have no effect here.
    here = ("logs", "look", "map", "sensor", "out", "name")
    for name, default in _defaults().items():
        if name not in here and getattr(args, name) != default:
            raise BenchError(f"--{name.replace('_', '-')}: is for one run at a time; with LOG state it in the map")
    if args.look:
        return look(args)
    if args.map is None:
        raise BenchError(f"no --map: run shockrig import {args.logs[0]} --look first, which writes one to correct")
    if args.out is None:
        raise BenchError("--out: is missing; name the campaign's folder")
    return import_by_map(args)


def _defaults() -> dict[str, object]:
    """The options' values where nothing was said."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return vars(parser.parse_args([]))


def _check_numbers(args: argparse.Namespace) -> None:
    """Numbers on the command line must be finite and possible."""
    import math

    from shockrig.files.ranges import RANGES, Range
    from shockrig.rig.bench_errors import BenchError

    limits = {
        "source_temperature": RANGES["temperature_c"],
        "source_humidity": RANGES["humidity_percent"],
        "destination_temperature": RANGES["temperature_c"],
        "destination_humidity": RANGES["humidity_percent"],
        "airflow": RANGES["airflow_m_s"],
        "pressure": RANGES["pressure_hpa"],
        "duration": RANGES["transfer_s"],
        "bead_radius": RANGES["bead_radius_m"],
        "film_thickness": RANGES["film_thickness_m"],
        "skip_lines": Range(0, 10**6),
    }
    for name, possible in limits.items():
        value = getattr(args, name)
        if value is not None and not possible.holds(value):
            slip = f"; {possible.slip}?" if possible.slip and math.isfinite(value) else ""
            raise BenchError(f"--{name.replace('_', '-')} {value:g}: expected a number from {possible}{slip}")
