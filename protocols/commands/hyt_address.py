"""shockrig hyt-address: read a HYT-271's I2C address, or store another one in it."""

from __future__ import annotations

import argparse
import sys

from shockrig.protocols.parser import whole_number


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--bus", required=True, help="I2C bus: its number or its device file (1 is /dev/i2c-1)")
    parser.add_argument("--address", type=_address, default=0x28, help="the address it has now (default 0x28)")
    parser.add_argument("--to", type=_address, metavar="ADDRESS", help="store this address in it, from 0x08 to 0x77")
    parser.add_argument(
        "--yes-change-it", action="store_true", help="that you mean --to: nothing on the sensor shows it"
    )
    parser.add_argument(
        "--wait-s", type=float, default=30.0, help="how long to wait for the sensor's power-on (default 30)"
    )


def _address(text: str) -> int:
    value = whole_number(text)
    if not 0 <= value <= 0x7F:
        raise argparse.ArgumentTypeError(f"expected 0x00 to 0x7F, found {text}")
    return value


def main(args: argparse.Namespace) -> int:
    import tempfile
    from pathlib import Path

    from shockrig.rig.buses.i2c import SmbusBus
    from shockrig.rig.clock import RealClock
    from shockrig.rig.errors import BusError
    from shockrig.rig.sensors.hyt271_commands import change_address, read_address

    clock = RealClock()
    path = f"/dev/i2c-{args.bus}" if args.bus.isdigit() else args.bus
    bus = SmbusBus(path, clock, Path(tempfile.gettempdir()))
    try:
        bus.open()
        if not bus.acquire(bus):
            raise BusError(f"{path} is in use by another program: end that one")
        print(f"waiting {args.wait_s:g} s: switch the sensor's supply off and on", file=sys.stderr)
        if args.to is None:
            print(f"{read_address(bus, clock, args.address, args.wait_s):#04x}")
        else:
            change_address(bus, clock, args.address, args.to, confirmed=args.yes_change_it, wait_s=args.wait_s)
            print(f"{args.to:#04x} is stored and holds from the next power-on")
    except OSError as error:
        raise error if isinstance(error, BusError) else BusError(f"{path}: {error.strerror or error}") from None
    finally:
        bus.close()
    return 0
