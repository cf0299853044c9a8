"""shockrig import: another logger's CSV files -> one run of a campaign, new or existing."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

DELIMITERS = {"comma": ",", "semicolon": ";", "tab": "\t"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = (
        "Columns are named, or numbered from 1; usual names are found without help. Both files must be on one clock; "
        "they may be one file. Example: shockrig import --imet log.csv --hyt log.csv --imet-temperature T_bead "
        "--source-temperature 40 --destination-temperature 20 --start 12.4 --out mine"
    )
    files = parser.add_argument_group("files")
    files.add_argument("--imet", metavar="FILE", type=Path, help="CSV file of the thermometer")
    files.add_argument("--hyt", metavar="FILE", type=Path, help="CSV file of the hygrometer (may be the same file)")
    files.add_argument("--out", metavar="CAMPAIGN", type=Path, required=True, help="campaign folder, new or existing")
    files.add_argument("--id", help="id of the run (default: the next free number)")
    columns = parser.add_argument_group("columns")
    columns.add_argument("--imet-time", metavar="COLUMN")
    columns.add_argument("--imet-temperature", metavar="COLUMN")
    columns.add_argument("--hyt-time", metavar="COLUMN")
    columns.add_argument("--hyt-humidity", metavar="COLUMN")
    columns.add_argument("--hyt-temperature", metavar="COLUMN", help="the hygrometer's own die temperature")
    layout = parser.add_argument_group("how the logger writes (found out where left out)")
    layout.add_argument("--time-unit", choices=["auto", "s", "ms", "us", "iso"], default="auto")
    layout.add_argument("--time-format", metavar="FORMAT", help="strptime format, e.g. '%%d.%%m.%%Y %%H:%%M:%%S.%%f'")
    layout.add_argument("--delimiter", choices=sorted(DELIMITERS))
    layout.add_argument("--decimal", choices=["point", "comma"])
    layout.add_argument("--skip-lines", metavar="N", type=int, default=0, help="lines before the header")
    layout.add_argument("--temperature-unit", choices=["c", "k", "f"], default="c")
    layout.add_argument("--humidity-unit", choices=["percent", "fraction"], default="percent")
    run = parser.add_argument_group("the run (leave out what is not known)")
    run.add_argument("--source-temperature", metavar="DEGC", type=float)
    run.add_argument("--source-humidity", metavar="PERCENT", type=float)
    run.add_argument("--destination-temperature", metavar="DEGC", type=float)
    run.add_argument("--destination-humidity", metavar="PERCENT", type=float)
    run.add_argument("--airflow", metavar="M_S", type=float)
    run.add_argument("--pressure", metavar="HPA", type=float)
    run.add_argument("--start", metavar="TIME", help="when the probes left the source air, on the clock of the files")
    run.add_argument("--duration", metavar="S", type=float, help="how long the transfer took")
    sensors = parser.add_argument_group("the sensors (for a new campaign)")
    sensors.add_argument("--name", help="name of the campaign")
    sensors.add_argument("--imet-kind")
    sensors.add_argument("--imet-serial")
    sensors.add_argument("--bead-radius", metavar="M", type=float)
    sensors.add_argument("--hyt-kind")
    sensors.add_argument("--hyt-serial")
    sensors.add_argument("--film-thickness", metavar="M", type=float)


def main(args: argparse.Namespace) -> int:
    from shockrig.rig.errors import BenchError
    from shockrig.rig.import_csv import CsvLayout, RunFacts, import_run, read_series

    _check_numbers(args)
    if args.imet is None and args.hyt is None:
        raise BenchError("no file: give --imet FILE, --hyt FILE or both")

    def layout(**columns: str | None) -> CsvLayout:
        return CsvLayout(
            columns={key: value for key, value in columns.items() if value is not None},
            time_unit=args.time_unit,
            time_format=args.time_format,
            delimiter=DELIMITERS.get(args.delimiter),
            decimal={"point": ".", "comma": ","}.get(args.decimal),
            skip_lines=args.skip_lines,
            temperature_unit=args.temperature_unit,
            humidity_unit=args.humidity_unit,
        )

    series = {}
    if args.imet is not None:
        imet = layout(time=args.imet_time or args.hyt_time, temperature_c=args.imet_temperature)
        series["imet"] = read_series(args.imet, ("temperature_c",), imet)
    if args.hyt is not None:
        hyt = layout(
            time=args.hyt_time or args.imet_time,
            humidity_percent=args.hyt_humidity,
            # In a common file the usual temperature name is the thermometer's, so the die's must be named.
            temperature_c=args.hyt_temperature,
        )
        wanted = ("humidity_percent", "temperature_c")
        shared = args.hyt == args.imet and args.hyt_temperature is None
        series["hyt"] = read_series(args.hyt, wanted[:1] if shared else wanted, hyt)
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
    sources = {key: path.name for key, path in (("imet", args.imet), ("hyt", args.hyt)) if path is not None}
    id_ = import_run(args.out, series, facts, layout(), id_=args.id, name=args.name, sensors=sensors, sources=sources)
    for name, one in series.items():
        left_out = ", ".join(f"{count} {why}" for why, count in one.left_out.items())
        print(f"{name}: {len(one.time_s)} readings over {one.time_s[-1] - one.time_s[0]:.1f} s", file=sys.stderr)
        if left_out:
            print(f"{name}: left out {left_out}", file=sys.stderr)
    if args.start is None:
        print("no --start: the time of the transfer will be estimated from the data", file=sys.stderr)
    print(args.out / "runs" / id_)
    return 0


def _check_numbers(args: argparse.Namespace) -> None:
    """Numbers on the command line must be finite and possible."""
    import math

    from shockrig.rig.errors import BenchError

    limits = {
        "source_temperature": (-100.0, 150.0),
        "source_humidity": (0.0, 110.0),
        "destination_temperature": (-100.0, 150.0),
        "destination_humidity": (0.0, 110.0),
        "airflow": (0.0, 100.0),
        "pressure": (1.0, 1200.0),
        "duration": (0.0, 600.0),
        "bead_radius": (1e-6, 0.1),
        "film_thickness": (1e-9, 0.01),
        "skip_lines": (0, 10**6),
    }
    for name, (low, high) in limits.items():
        value = getattr(args, name)
        if value is not None and not (math.isfinite(value) and low <= value <= high):
            raise BenchError(f"--{name.replace('_', '-')} {value:g}: expected a number from {low:g} to {high:g}")
