"""shockrig scan: find HYT-271s, iMets and GRBL controllers on this computer and write a bench file to start from."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import Any

SWITCH_ON = (
    "on a Raspberry Pi switch it on: sudo raspi-config nonint do_i2c 0, then restart; elsewhere: sudo modprobe i2c-dev"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = (
        "Serial ports are listened to first, at 57600 and at 115200 baud. Nothing is ever written to a port that "
        "speaks; one that stays silent, or said that it is GRBL, gets the one byte '?', which GRBL answers, unless "
        "--listen-only is given. "
        "Opening a port resets some GRBL boards: let no stage move meanwhile. Exit status: 0 a sensor was found, "
        "1 none was, 2 bad arguments."
    )
    parser.add_argument("--out", metavar="BENCH.toml", type=Path, help="bench file to write (default: standard output)")
    parser.add_argument("--i2c", metavar="DEVICE", action="append", help="only these buses (default: /dev/i2c-*)")
    parser.add_argument("--port", metavar="DEVICE", action="append", help="only these serial ports (default: all)")
    parser.add_argument("--listen-only", action="store_true", help="write nothing to silent serial ports")


def main(args: argparse.Namespace) -> int:
    import tempfile
    import tomllib

    from shockrig.files.disk import write_whole
    from shockrig.rig.bench_errors import BenchError
    from shockrig.rig.bench_file import check_bench
    from shockrig.rig.buses.i2c import SmbusBus
    from shockrig.rig.buses.serial_port import PyserialPort, pyserial_opener
    from shockrig.rig.clock import RealClock
    from shockrig.rig.scan import bench_toml, scan_i2c, scan_serial

    if args.out is not None and args.out.exists():
        raise BenchError(f"{args.out}: is there already; give another --out")
    clock = RealClock()
    found: list[Any] = []
    buses = _buses() if args.i2c is None and args.port is None else args.i2c or []
    ports = _ports() if args.i2c is None and args.port is None else args.port or []
    for path in buses:
        films, trouble = scan_i2c(path, SmbusBus(path, clock, Path(tempfile.gettempdir())), clock)
        _say(path, films, trouble or "no HYT-271")
        found += films
    if ports:
        print(f"listening to {', '.join(ports)} ...", file=sys.stderr, flush=True)
    listeners = scan_serial(
        ports,
        lambda path, baud: PyserialPort(pyserial_opener(path, baud), clock, baud),
        clock,
        may_ask=not args.listen_only,
    )
    for listener in listeners:
        items = [listener.found] if listener.found else []
        _say(listener.path, items, listener.trouble)
        found += items
    if not buses and args.port is None:
        print(f"no I2C bus on this computer; {SWITCH_ON}", file=sys.stderr)
    if not ports and args.i2c is None:
        print("no serial port on this computer; plug in the instrument's USB cable or adapter", file=sys.stderr)
    try:
        text = bench_toml(found)
    except BenchError as error:
        print(f"shockrig scan: {error}", file=sys.stderr)
        return 1
    check_bench(tomllib.loads(text), "the bench file")
    if args.out is None:
        print(text, end="")
        return 0
    try:
        write_whole(args.out, text)
    except OSError as error:
        raise BenchError(f"{args.out}: {error.strerror}; give another --out") from None
    command = shlex.join(["shockrig", "check", "standard", "--bench", str(args.out)])
    print(f"wrote {args.out}: go through the lines marked SET, then run {command}")
    return 0


def _say(path: str, items: list[Any], trouble: str) -> None:
    for text in map(str, items):
        print(text, file=sys.stderr, flush=True)
    if not items:
        print(f"{path}: {trouble}", file=sys.stderr, flush=True)


def _buses() -> list[str]:
    return sorted(map(str, Path("/dev").glob("i2c-*")), key=lambda path: (len(path), path))


def _ports() -> list[str]:
    """Serial ports, by the name that survives replugging where there is one."""
    from serial.tools.list_ports import comports

    by_id = Path("/dev/serial/by-id")
    lasting = {str(link.resolve()): str(link) for link in by_id.iterdir()} if by_id.is_dir() else {}
    return sorted(lasting.get(port.device, port.device) for port in comports())
