"""shockrig fly: on a drone's companion computer, sensors in, corrected values out while they are read."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from shockrig.protocols.fly_page import FlightFollower
    from shockrig.protocols.watch.web import WatchServer
    from shockrig.rig.links.mavlink import AutopilotListener
    from shockrig.rig.links.said import Speaker

WATCHDOG_S = 10  # without a sign of life: systemd starts the program anew
UNIT = """\
# systemctl enable --now shockrig-fly, after this was saved as /etc/systemd/system/shockrig-fly.service
[Unit]
Description=shockrig fly: corrected temperature and humidity during the flight
StartLimitIntervalSec=0

[Service]
Type=notify
ExecStart={command}
WorkingDirectory={folder}
User={user}
Restart=always
RestartSec=1
WatchdogSec={watchdog_s}
TimeoutStartSec=120

[Install]
WantedBy=multi-user.target
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.set_defaults(ends_by_ctrl_c=True)
    parser.epilog = (
        "ADDRESS of bytes: udpout:HOST:PORT, udpin:HOST:PORT, or /dev/NAME[,BAUD]; of CAN frames: mcast: (UDP "
        "multicast) or an interface such as can0. A sensor that is missing is reported, and used when it comes back."
    )
    parser.add_argument(
        "--bench",
        metavar="BENCH.toml",
        type=Path,
        required=True,
        help="bench file with the sensors that fly, or drone; its stage and reference are left alone",
    )
    parser.add_argument("--profile", metavar="P", type=Path, required=True, help="profile.json of the sensors")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="folder of flights: each is DIR/NNNN")
    parser.add_argument(
        "--lag-s", type=float, default=0.0, metavar="S", help="how long each row waits for those after it (default: 0)"
    )
    parser.add_argument("--period-s", type=float, metavar="S", help="between rows (default: as the sensors are read)")
    parser.add_argument("--for-s", type=float, metavar="S", help="end after so long (default: by Ctrl-C or SIGTERM)")
    links = parser.add_argument_group("links")
    links.add_argument("--mavlink", metavar="ADDRESS", action="append", default=[], help="MAVLink out; may be repeated")
    links.add_argument("--dronecan", metavar="ADDRESS", action="append", default=[], help="DroneCAN out")
    links.add_argument("--node", type=int, default=44, metavar="N", help="DroneCAN node number (default: 44)")
    links.add_argument("--system", type=int, default=1, metavar="N", help="MAVLink system, the vehicle's (default: 1)")
    links.add_argument(
        "--autopilot", metavar="ADDRESS", help="MAVLink in: airspeed, pressure, position; may be that of --mavlink"
    )
    web = parser.add_argument_group("in the browser")
    web.add_argument("--web", action="store_true", help="serve a page with the profile as it is flown")
    web.add_argument("--port", type=int, default=0, help="port of the page (default: any free one)")
    web.add_argument("--host", default="127.0.0.1", help="address to listen at (default: 127.0.0.1)")
    parser.add_argument("--unit", action="store_true", help="print a systemd unit that flies so at each boot, and end")


def main(args: argparse.Namespace) -> int:
    """Fly until told to end."""
    import math

    from shockrig.files.profile import read_profile
    from shockrig.protocols.fly import FlySettings, OnboardFlight, Watchdog
    from shockrig.protocols.fly_page import FlightFollower
    from shockrig.protocols.folder import software_version
    from shockrig.rig.bench import load_bench, open_bench
    from shockrig.rig.bench_errors import BenchError

    _demand_numbers(args)
    config = load_bench(args.bench)
    if config.emulated:
        raise BenchError(f"{args.bench}: its instruments are emulated; shockrig hil flies emulated ones")
    profile = read_profile(args.profile)
    if args.unit:
        print(unit(args), end="")
        return 0
    bench = open_bench(config)
    settings = FlySettings(
        args.lag_s,
        args.period_s,
        about={"profile": str(args.profile), "bench": bench.name, "software": f"shockrig {software_version()}"},
    )
    speakers, autopilot = links(args)
    follower = FlightFollower() if args.web else None
    server = None if follower is None else _served(follower, args)
    watchdog = Watchdog()
    flight = OnboardFlight(
        bench.sensors,
        bench.clock,
        profile,
        args.out,
        speakers,
        settings,
        autopilot=autopilot,
        say=lambda text: print(text, file=sys.stderr, flush=True),
        watchdog=watchdog,
        follower=follower,
    )
    try:
        print(f"{flight.log.folder}: Ctrl-C ends the flight", flush=True)
        watchdog.say("READY=1")
        end_s = math.inf if args.for_s is None else bench.clock.now() + args.for_s
        while bench.clock.now() < end_s:
            flight.step(end_s)
    except KeyboardInterrupt:
        pass
    finally:
        flight.close()
        watchdog.close()
        if server is not None:
            server.shutdown()
        print(f"{flight.log.folder}: {flight.rows} rows", flush=True)
    return 0


def _demand_numbers(args: argparse.Namespace) -> None:
    from shockrig.files.errors import InputError
    from shockrig.rig.links.dronecan import OWN_NUMBERS

    for name, low, high in (("lag_s", 0.0, 60.0), ("period_s", 0.01, 10.0), ("for_s", 0.1, 1e6)):
        value = getattr(args, name)
        if value is not None and not low <= value <= high:
            raise InputError(f"--{name.replace('_', '-')} {value:g}: expected {low:g} to {high:g} s")
    for name, least, most in (("port", 0, 65535), ("system", 1, 255), ("node", OWN_NUMBERS[0], OWN_NUMBERS[-1])):
        if not least <= getattr(args, name) <= most:
            raise InputError(f"--{name} {getattr(args, name)}: expected {least} to {most}")


def _served(follower: FlightFollower, args: argparse.Namespace) -> WatchServer:
    """The page, and its address told."""
    from shockrig.files.errors import InputError
    from shockrig.protocols.fly_page import serve_beside
    from shockrig.protocols.watch.web import is_local

    if not is_local(args.host):
        print(f"warning: whoever can reach {args.host} can see this page", file=sys.stderr)
    try:
        server = serve_beside(follower, args.host, args.port)
    except OSError as error:
        raise InputError(f"--host {args.host} --port {args.port}: {error.strerror}; give another") from None
    print(server.url, flush=True)
    return server


def links(args: argparse.Namespace) -> tuple[list[Speaker], AutopilotListener | None]:
    """Who is told, and the autopilot that is listened to; where both have one address they share it."""
    from shockrig.rig.links.dronecan import DronecanNode, this_machine
    from shockrig.rig.links.mavlink import AutopilotListener, MavlinkEnd, MavlinkSpeaker
    from shockrig.rig.links.ports import open_bytes, open_frames

    ends = {address: MavlinkEnd(open_bytes(address), args.system) for address in args.mavlink}
    speakers: list[Speaker] = [MavlinkSpeaker(end) for end in ends.values()]
    speakers += [DronecanNode(open_frames(address), args.node, this_machine()) for address in args.dronecan]
    if args.autopilot is None:
        return speakers, None
    shared = ends.get(args.autopilot)
    return speakers, AutopilotListener(shared or MavlinkEnd(open_bytes(args.autopilot), args.system))


def unit(args: argparse.Namespace) -> str:
    """The systemd unit of this command, its paths made absolute."""
    import getpass
    import shlex

    words = [sys.executable, "-m", "shockrig", "fly"]
    bench = str(args.bench.resolve()) if args.bench.exists() else str(args.bench)
    words += ["--bench", bench, "--profile", str(args.profile.resolve()), "--out", str(args.out.resolve())]
    for name in ("mavlink", "dronecan"):
        for address in getattr(args, name):
            words += [f"--{name}", address]
    for name, default in (("lag_s", 0.0), ("period_s", None), ("node", 44), ("system", 1), ("autopilot", None)):
        if (value := getattr(args, name)) != default:
            words += [f"--{name.replace('_', '-')}", str(value)]
    if args.web:
        words += ["--web", "--port", str(args.port), "--host", args.host]
    command = shlex.join(words).replace("%", "%%")
    return UNIT.format(command=command, folder=Path.cwd(), user=getpass.getuser(), watchdog_s=WATCHDOG_S)
