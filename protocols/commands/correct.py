"""shockrig correct: a flight's CSV and a profile in, the flight with corrected values and their uncertainty out."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from shockrig.analysis.flight.comparisons import Layers
    from shockrig.analysis.flight.stream import Summary
    from shockrig.analysis.report.corrected_page import FlightGathered
    from shockrig.files.profile import Profile

QUANTITIES = (
    "time", "temperature", "humidity", "airspeed", "die", "pressure", "altitude", "latitude", "longitude",
    "vertical_speed",
)  # fmt: skip

SAMPLE_BYTES = 65_536
FORMS = ("", ".csv", ".txt", ".nc", ".png")  # by which endings of --out a form is known


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        "flight",
        type=Path,
        metavar="FLIGHT",
        help="log of the flight: CSV, netCDF (.nc), ArduPilot's .bin, FlySight 2, radiosonde_auto_rx",
    )
    known = parser.add_mutually_exclusive_group(required=True)
    known.add_argument("--profile", type=Path, metavar="P", help="profile.json of the sensors flown")
    known.add_argument(
        "--fleet",
        type=Path,
        metavar="FLEET.json",
        help="in its place, where nobody has characterized these sensors: what others of the type say, as shockrig "
        "fleet wrote it",
    )
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="F",
        help="corrected flight: CSV, netCDF (.nc), or a figure of it (.png); with --wmo a folder",
    )
    parser.add_argument("--report", type=Path, metavar="PAGE.html", help="where the page goes (default: beside --out)")
    parser.add_argument("--no-report", action="store_true", help="write no page")
    parser.add_argument(
        "--method",
        choices=("smoother", "causal", "inverse", "paper"),
        default="smoother",
        help="how: optimal smoother (default), its causal form (with what came before a row alone), or the paper's "
        "inverse, corrected or as printed",
    )
    parser.add_argument(
        "--lag-s", type=float, metavar="S", help="of causal: how long each row waits for those after it (default: 0)"
    )
    parser.add_argument(
        "--clock-s",
        type=float,
        metavar="S",
        help="seconds by which the position's times are behind the readings' (shockrig learn finds them)",
    )
    parser.add_argument(
        "--column",
        action="append",
        default=[],
        metavar="QUANTITY=NAME",
        help=f"name of a column that is not recognised; quantities: {', '.join(QUANTITIES)}",
    )
    parser.add_argument(
        "--map", type=Path, metavar="MAP.toml", help="read any text log by a map, as shockrig import does (or its name)"
    )
    parser.add_argument(
        "--layers", type=float, metavar="M", help="also means over layers of so many metres, in OUT_layers.csv"
    )
    parser.add_argument(
        "--wmo",
        metavar="OPERATOR:AIRFRAME",
        help="write WMO's drone demonstration format instead, into the folder --out (such as 007:ABC12)",
    )
    parser.add_argument(
        "--cutoff-hz", type=float, help="low-pass of inverse and paper; suggested from the noise if left out"
    )
    parser.add_argument(
        "--temperature-noise-k", type=float, help="noise floor of the flight's bead, where not the profile's"
    )
    parser.add_argument("--humidity-noise-percent", type=float, help="noise floor of the flight's film")


def chosen_columns(choices: list[str]) -> dict[str, str]:
    """Columns that were chosen as QUANTITY=NAME.

    Raises
    ------
    InputError
        Names the choice that is none.
    """
    from shockrig.files.errors import InputError

    columns = {}
    for choice in choices:
        quantity, equals, name = choice.partition("=")
        if not equals or quantity not in QUANTITIES:
            raise InputError(f"--column {choice}: expected QUANTITY=NAME with a quantity of {', '.join(QUANTITIES)}")
        columns[quantity] = name
    return columns


def _demand_options(args: argparse.Namespace) -> None:
    """InputError where options do not go together, or have a value that cannot be."""
    from shockrig.files.errors import InputError

    if args.out.suffix.lower() not in FORMS and args.wmo is None:
        raise InputError(f"--out {args.out}: the flight is written as .csv or .nc, a figure of it as .png; name it so")
    if args.no_report and args.report is not None:
        raise InputError("--no-report: and --report is given; leave one of them out")
    for option in ("cutoff_hz", "temperature_noise_k", "humidity_noise_percent", "layers"):
        value = getattr(args, option)
        if value is not None and not 0 < value < 1e6:
            raise InputError(f"--{option.replace('_', '-')} {value:g}: expected a positive number")
    if args.lag_s is not None and args.method != "causal":
        raise InputError(f"--lag-s {args.lag_s:g}: only --method causal waits; the smoother has the whole flight")


def _said(args: argparse.Namespace, written: Path, done: Summary, drawn: FlightGathered, layers: Layers | None) -> None:
    """Print what became of each sensor, the layers' file, the flags."""
    from shockrig.files.flight_figure import changes_of
    from shockrig.files.numbers import plain

    print(f"{written}: {done.rows} rows, method {args.method}")
    changed = {one.name: one for one in changes_of(*drawn.whole())}
    for name in ("temperature", "humidity"):
        if (one := changed.get(name)) is not None:
            sigma = f"standard uncertainty {plain(one.standard_uncertainty, 2)} {one.unit}"
            print(f"  {name}: changed by {plain(one.rms, 2)} {one.unit} rms; {sigma}")
        else:
            print(f"  {name}: not corrected")
    if layers is not None:
        path = written.with_name(f"{written.stem}_layers.csv")
        print(f"  {path}: {layers.write(path)} layers of {args.layers:g} m")
    flagged = ", ".join(f"{name} {count}" for name, count in done.flags.items() if count)
    print(f"  flags: {flagged or 'none'}", flush=True)


def main(args: argparse.Namespace) -> int:
    """Correct the flight and print what was done."""
    from shockrig.analysis.flight.comparisons import USE_READINGS, Layers
    from shockrig.analysis.flight.doubts import profile_doubts
    from shockrig.analysis.flight.stream import correct_file
    from shockrig.analysis.report.corrected_page import FlightGathered
    from shockrig.files.errors import InputError
    from shockrig.files.fleet_file import read_fleet
    from shockrig.files.profile import read_profile
    from shockrig.protocols.flight_logs import named_both
    from shockrig.protocols.time_left import CountedRows
    from shockrig.protocols.wmo import demand_position, of_argument

    columns = chosen_columns(args.column)
    _demand_options(args)
    profile = read_fleet(args.fleet).typical() if args.profile is None else read_profile(args.profile)
    option = "--profile" if args.fleet is None else "--fleet"
    doubted = profile_doubts(profile)
    for note in doubted:
        print(f"note: {note}", file=sys.stderr)
    wmo = of_argument(args.wmo, datetime.now(UTC)) if args.wmo else None
    layers = Layers(args.layers) if args.layers else None
    as_figure = wmo is None and args.out.suffix.lower() == ".png"
    drawn = FlightGathered()
    gather = [one.add for one in (wmo, layers, drawn) if one is not None]
    with tempfile.TemporaryDirectory() as folder:
        source, chosen, read_how = _as_csv(args, columns, Path(folder))
        try:
            if wmo is not None:
                demand_position(source, chosen)
            done = correct_file(
                source,
                profile,
                Path(folder) / "corrected.csv" if wmo or as_figure else args.out,
                args.method,
                columns=chosen,
                cutoff_hz=args.cutoff_hz,
                temperature_noise_k=args.temperature_noise_k,
                humidity_noise_percent=args.humidity_noise_percent,
                lag_s=args.lag_s,
                named=named_both(columns, args.map),
                history=f"shockrig correct --method {args.method} {option} {(args.fleet or args.profile).name}"
                + ("" if args.clock_s is None else f" --clock-s {args.clock_s:g}"),
                progress=CountedRows(about_rows(source)),
                gather=gather,
            )
        except InputError as error:
            raise type(error)(str(error).replace(str(source), str(args.flight))) from error
    written = wmo.write(args.out, args.flight.name) if wmo else args.out
    done = replace(done, notes=(*read_how, *done.notes))
    done = replace(done, notes=(*done.notes, *offered(done.notes, args.flight, args.profile)))
    notes = [note for note in done.notes if note not in doubted]
    for note in (first := [note for note in notes if USE_READINGS in note]):
        print(f"note: {note}", file=sys.stderr, flush=True)
    if as_figure:
        write_figure(args.out, drawn)
    page = None if args.no_report else _page(args, drawn, profile, done.notes)
    _said(args, written, done, drawn, layers)
    if page is not None:
        print(f"report: {page}")
    if "data" in profile.provenance:
        print(f"note: the profile is not of real sensors: {profile.provenance['data']}", file=sys.stderr)
    for note in [note for note in notes if note not in first]:
        print(f"note: {note}", file=sys.stderr)
    return 0


def _as_csv(
    args: argparse.Namespace, columns: Mapping[str, str], folder: Path
) -> tuple[Path, Mapping[str, str] | None, tuple[str, ...]]:
    """The log as a CSV file on the clock that is asked for, made in a folder where it is none; the columns to look for
    in it, where they are not those of this project; and what is to be said of how it was read.

    Raises
    ------
    InputError
        The log cannot be read, or is the file to be written.
    """
    from shockrig.files.disk import real_path
    from shockrig.files.errors import InputError
    from shockrig.protocols.flight_clock import clocked_csv
    from shockrig.protocols.flight_logs import to_csv

    source = folder / args.flight.name  # by the name that the result and messages carry
    read = to_csv(args.flight, source, columns=columns, map_path=args.map)
    if read is None:
        source = args.flight
    elif real_path(args.out) == real_path(args.flight):
        raise InputError(f"{args.out}: the log itself; name another file for the corrected flight")
    chosen = columns if read is None else None
    if args.clock_s is not None:
        clocked = folder / "clocked" / args.flight.name
        clocked.parent.mkdir()
        clocked_csv(source, clocked, chosen, args.clock_s)
        source = clocked
    return source, chosen, tuple(read.said) if read else ()


def _page(args: argparse.Namespace, drawn: FlightGathered, profile: Profile, notes: tuple[str, ...]) -> Path:
    """Write the page beside the corrected flight, or where it is wanted."""
    from shockrig.analysis.report.corrected_page import write_corrected_page
    from shockrig.protocols.folder import software_version

    beside = args.out.with_name(f"{args.out.name}.html") if args.wmo else args.out.with_suffix(".html")
    provenance = {
        "log": str(args.flight),
        "profile": str(args.fleet or args.profile),
        "method": args.method,
        "software": f"shockrig {software_version()}",
        "made_at": datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
    }
    if "data" in profile.provenance:
        provenance["data"] = str(profile.provenance["data"])
    return write_corrected_page(args.report or beside, args.flight.name, drawn, profile, notes, provenance)


def offered(notes: Sequence[str], log: Path, profile: Path | None) -> tuple[str, ...]:
    """What says more of a flight whose ascent and descent disagree once corrected, in a sentence; else nothing."""
    from shockrig.analysis.flight.comparisons import DISAGREE

    if not any(DISAGREE in note for note in notes):
        return ()
    given = "" if profile is None else f" --profile {profile}"
    return (f"shockrig learn {log}{given} --out learned says what the sensor lacks in the air",)


def about_rows(log: Path) -> int:
    """How many rows a CSV file has, by its size and the length of its first lines.

    Raises
    ------
    InputError
        It cannot be read.
    """
    from shockrig.files.disk import open_regular
    from shockrig.files.flight import REMEDY

    with open_regular(log, REMEDY) as stream:
        lines = stream.readlines(SAMPLE_BYTES)
        return round(os.fstat(stream.fileno()).st_size * len(lines) / max(sum(map(len, lines)), 1))


def write_figure(path: Path, drawn: FlightGathered) -> None:
    """The flight as a figure: over altitude where it has one that changes, else over time."""
    from shockrig.files.disk import write_whole
    from shockrig.files.errors import InputError
    from shockrig.files.figures import figure_bytes
    from shockrig.files.flight_figure import plot_flight
    from shockrig.files.readings_figure import has_altitude

    flight, found = drawn.whole()
    content = figure_bytes(plot_flight(flight, found, "altitude" if has_altitude(flight.altitude_m) else "time"))
    try:
        write_whole(path, content)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; name a file in a folder that can be written") from error
