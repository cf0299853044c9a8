"""shockrig hyt-address: read a HYT-271's I2C address, or store another one in it."""

from __future__ import annotations

import argparse
import sys

from shockrig.protocols.parser import whole_number


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = (
        "A HYT-271 takes commands in the first 10 ms after its power-on: this knocks at its address (A0 00 00) until "
        "you have switched its supply off and on, and then reads word 0x1C of its EEPROM, whose lowest seven bits are "
        "the address. Two sensors at one address cannot be told apart: connect one."
    )
    parser.add_argument("--bus", required=True, help="I2C bus: its number or its device file (1 is /dev/i2c-1)")
    parser.add_argument("--address", type=_address, default=0x28, help="the address it has now (default: 0x28)")
    parser.add_argument("--to", type=_address, metavar="ADDRESS", help="store this address in it")
    parser.add_argument(
        "--yes-change-it", action="store_true", help="that you mean --to: nothing on the sensor shows it"
    )
    parser.add_argument("--dry-run", action="store_true", help="say what --to would change; write nothing")
    parser.add_argument(
        "--wait-s", type=float, default=30.0, help="how long to wait for the sensor's power-on (default: 30)"
    )


def _address(text: str) -> int:
    value = whole_number(text)
    if not 0 <= value <= 0x7F:
        raise argparse.ArgumentTypeError(f"expected 0x00 to 0x7F, found {text[:40]}")
    return value


def main(args: argparse.Namespace) -> int:
    import tempfile
    from pathlib import Path

    from shockrig.rig.bench_errors import BusError
    from shockrig.rig.buses.i2c import SmbusBus
    from shockrig.rig.clock import RealClock
    from shockrig.rig.sensors.hyt271_commands import answering, change_address, read_address, wait_for_answer

    clock = RealClock()
    path = f"/dev/i2c-{args.bus}" if args.bus.isdigit() else args.bus
    bus = SmbusBus(path, clock, Path(tempfile.gettempdir()))
    try:
        bus.open()
        if not bus.acquire(bus):
            raise BusError(f"{path} is in use by another program: end that one")
        there = ", ".join(f"{address:#04x}" for address in answering(bus)) or "nobody"
        print(f"answering on {path}: {there}", file=sys.stderr)
        print(
            f"knocking at {args.address:#04x} for {args.wait_s:g} s: switch the sensor's supply off and on",
            file=sys.stderr,
            flush=True,
        )
        if args.to is None:
            print(f"{read_address(bus, clock, args.address, args.wait_s):#04x}")
            return 0
        words = change_address(
            bus,
            clock,
            args.address,
            args.to,
            confirmed=args.yes_change_it,
            dry_run=args.dry_run,
            wait_s=args.wait_s,
        )
        print(f"word 0x1c was {words.old:#06x}, {'would be' if args.dry_run else 'is'} {words.new:#06x}")
        if args.dry_run:
            return 0
        print("it holds from the next power-on: switch the supply off and on once more", file=sys.stderr, flush=True)
        if not wait_for_answer(bus, clock, args.to, args.wait_s):
            raise BusError(f"nobody answers at {args.to:#04x} in {args.wait_s:g} s; look for it with shockrig scan")
        print(f"answers at {args.to:#04x}")
    except OSError as error:
        raise error if isinstance(error, BusError) else BusError(f"{path}: {error.strerror or error}") from None
    finally:
        bus.close()
    return 0
