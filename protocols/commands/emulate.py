"""shockrig emulate: emulated instruments that unmodified programs open, at rest, on a bench, or playing a flight."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shockrig.protocols.parser import whole_number
from shockrig.rig.virtual.chips.i2c import I2C_ADDRESSES

if TYPE_CHECKING:
    from shockrig.rig.virtual.emulate.live_session import Options

PRESSURE_HPA = 1013.25
CHAMBERS_FILE = "chambers.toml"
REGISTERS = ("temperature", "humidity", "airflow")  # of the emulated chambers and fan, from 0
KINDS = ("imet-xf", "imet-xq2", "imet-xq", *I2C_ADDRESSES, "grbl")
NODE_HZ, NODE = 10.0, 42


class _Kinds(tuple[str, ...]):
    """Choices of a word that may be there or not: argparse of Python 3.11 holds the empty list against them too."""

    def __contains__(self, word: object) -> bool:
        return word == [] or super().__contains__(word)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.set_defaults(ends_by_ctrl_c=True)
    parser.epilog = "Ends at the end of the flight, else by Ctrl-C. What each instrument does: docs/emulators.md."
    parser.add_argument(
        "kinds",
        metavar="KIND",
        nargs="*",
        choices=_Kinds(KINDS),
        help=f"{', '.join(KINDS)}; one named twice is there twice, on a further probe",
    )
    parser.add_argument(
        "--link",
        metavar="[NAME=]PATH",
        action="append",
        default=[],
        help="symbolic link to a serial instrument's terminal; of several each by its kind, as imet-xf=/tmp/ttyXF, or "
        "imet-xf-2=/tmp/ttyXF2 for the second of a kind",
    )
    parser.add_argument("--folder", metavar="F", type=Path, help="where the I2C socket and library go (default: /tmp)")
    parser.add_argument("--build", metavar="LIB.so", type=Path, help="build the I2C preload library there, and end")
    parser.add_argument("--bus", type=int, default=1, metavar="N", help="/dev/i2c-N that programs open (default: 1)")
    parser.add_argument(
        "--address", type=whole_number, default=0x28, help="of the HYT-271 (default: 0x28); a further one has the next"
    )
    parser.add_argument("--rate-hz", type=float, help="lines a second (default: 10 for an XF, 1 for an XQ)")
    parser.add_argument("--humidity", action="store_true", help="the iMet-XF carries a HYT-271 (lines with id 8)")
    parser.add_argument(
        "--second",
        action="store_true",
        help="the iMet-XF carries a second bead (lines with id 13) and, with --humidity, a second film (17)",
    )
    parser.add_argument("--flight", metavar="FLIGHT.csv", type=Path, help="play this air (time_s, temperature_c, ...)")
    parser.add_argument("--profile", metavar="P", type=Path, help="the sensors that fly (default: a typical pair)")
    parser.add_argument("--truth", metavar="F.csv", type=Path, help="write what was said and what was true, as it goes")
    parser.add_argument("--speed", type=float, default=1.0, help="how much faster than real time (default: 1)")
    parser.add_argument(
        "--seed", metavar="N", type=int, default=0, help="noise, and without a flight the sensors themselves"
    )
    air = parser.add_argument_group("without a flight")
    air.add_argument("--chambers", action="store_true", help="two chambers (SCPI, Modbus) and a fan that make the airs")
    air.add_argument("--source", metavar="DEGC,RH", default="20,50", help="air where the probes are (default: 20,50)")
    air.add_argument("--destination", metavar="DEGC,RH", default="40,20", help="air where grbl carries them")
    air.add_argument("--airflow", metavar="M_S", type=float, default=6.0, help="past the probes (default: 6)")
    links = parser.add_argument_group("as a node on links, with or without instruments beside it")
    links.add_argument("--dronecan", metavar="ADDRESS", help="mcast: or a CAN interface such as can0")
    links.add_argument(
        "--mavlink", metavar="ADDRESS", help="udpout:HOST:PORT or a serial port; in a flight with an autopilot's stream"
    )
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="KIND@START[-END]",
        help="inject a fault from START to END s, e.g. half_line@10-20; a wrong KIND lists them all",
    )


def main(args: argparse.Namespace) -> int:
    """Set the instruments up, say how to reach them, and serve them until the end."""
    import signal
    import tempfile
    import time

    from shockrig.files.disk import write_whole
    from shockrig.rig.bench_errors import BenchError
    from shockrig.rig.virtual.emulate.i2c_socket import build_preload
    from shockrig.rig.virtual.emulate.live_session import BAUD, FastClock, Session, instruments_of, probes_of

    if args.build is not None:
        print(f"{build_preload(args.build)}: name it in LD_PRELOAD, and the socket in SHOCKRIG_I2C_{args.bus}")
        return 0
    options = _options(args)
    instruments = instruments_of(args.kinds, options)
    probes = probes_of(instruments)
    if args.flight is not None and probes > 1:
        raise BenchError(f"--flight: one probe flies, and {' '.join(args.kinds)} are {probes}; emulate them one by one")
    links = _links(args.link, [one.name for one in instruments if one.kind in BAUD])
    if args.profile is not None and args.flight is None:
        raise BenchError(f"--profile {args.profile}: flies only with --flight FLIGHT.csv")
    worlds, end_s = _flight(args) if args.flight is not None else (_bench(args, probes), None)
    with ExitStack() as stack:
        if args.folder is None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="shockrig-emulate-")))
        else:
            folder = stack.enter_context(_made(args.folder))
        signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(0))
        clock = FastClock(args.speed)
        session = Session(
            args.kinds, worlds, clock, folder.resolve(), unix_s=time.time, truth=args.truth, options=options
        )
        stack.callback(session.close)
        vehicle = _vehicle(args, options.faults, session, worlds[0], clock) if options.linked else None
        if vehicle is not None:
            stack.callback(vehicle.close)
        for name, link in links.items():
            _link(link, session.serial[name])
            stack.callback(link.unlink, missing_ok=True)
        if session.climate:
            write_whole(folder / CHAMBERS_FILE, _chambers_toml(session.climate))
            stack.callback((folder / CHAMBERS_FILE).unlink, missing_ok=True)
        with suppress(KeyboardInterrupt):  # who reads how to reach them may end them in the same moment
            _introduce(args, session, links, folder)
            _serve(clock, session, end_s, args.speed, vehicle)
        if session.witness.trouble:
            raise BenchError(session.witness.trouble)
    return 0


@contextmanager
def _made(folder: Path) -> Iterator[Path]:
    """A folder, made where there is none; of what was made nothing is left that holds nothing in the end."""
    from shockrig.rig.bench_errors import BenchError

    new = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BenchError(f"--folder {folder}: {error.strerror}; give another one") from None
    try:
        yield folder
    finally:
        with suppress(OSError):  # one that holds something ends it: those above hold that one
            for one in new:
                one.rmdir()


def _options(args: argparse.Namespace) -> Options:
    """What is emulated, from arguments that can be."""
    from shockrig.files.ranges import RANGES, Range
    from shockrig.rig.bench_errors import BenchError
    from shockrig.rig.virtual.emulate.live_session import Options

    possible = {"speed": Range(0.01, 1000.0), "rate_hz": RANGES["rate_hz"], "airflow": RANGES["airflow_m_s"]}
    for name, limits in possible.items():
        value = getattr(args, name)
        if value is not None and not limits.holds(value):
            raise BenchError(f"--{name.replace('_', '-')} {value:g}: expected {limits}")
    for name, low, high in (("address", 0x08, 0x77), ("bus", 0, 255)):
        if not low <= getattr(args, name) <= high:
            raise BenchError(f"--{name} {getattr(args, name)}: expected {low} to {high}")
    faults = tuple(fault_of(text) for text in args.fault)
    airs = (*_both_airs(args), args.airflow) if args.chambers else None
    if airs is not None and args.flight is not None:
        raise BenchError("--chambers: make the airs of a bench; a flight has its own")
    linked = bool(args.dronecan or args.mavlink)
    if not args.kinds and not linked:
        raise BenchError(f"nothing to emulate: name {', '.join(KINDS)}, or give --dronecan or --mavlink")
    return Options(
        args.address, args.bus, args.rate_hz, args.humidity, args.second,
        seed=args.seed, faults=faults, chambers=airs, linked=linked,
    )  # fmt: skip


def _vehicle(args: argparse.Namespace, faults: Any, session: Any, world: Any, clock: Any) -> Any:
    """The node on its links, and of a flight the autopilot beside it."""
    from shockrig.rig.links.dronecan import DronecanNode, this_machine
    from shockrig.rig.links.mavlink import AUTOPILOT, PERIPHERAL, MavlinkEnd, MavlinkSpeaker
    from shockrig.rig.links.ports import open_bytes, open_frames
    from shockrig.rig.virtual.faults import LINK_KINDS
    from shockrig.rig.virtual.vehicle import FaultyPort, FaultySpeaker, Vehicle, as_kelvin, as_whole_units

    own = [fault for fault in faults if fault.kind in LINK_KINDS]
    speakers: list[Any] = []
    stream = None
    if args.dronecan is not None:
        can = FaultyPort(open_frames(args.dronecan), own, clock, args.seed)
        node = DronecanNode(can, NODE, this_machine(), "org.shockrig.emulate")
        speakers.append(FaultySpeaker(node, own, clock, as_kelvin))
    if args.mavlink is not None:
        port = FaultyPort(open_bytes(args.mavlink), own, clock, args.seed)
        speakers.append(FaultySpeaker(MavlinkSpeaker(MavlinkEnd(port, 1, PERIPHERAL)), own, clock, as_whole_units))
        stream = MavlinkEnd(port, 1, AUTOPILOT) if args.flight is not None else None
    sample = session.witness.sampler
    temperature, humidity = (sample("node", quantity) for quantity in ("temperature_c", "humidity_percent"))
    period_s = 1.0 / (args.rate_hz or NODE_HZ)
    return Vehicle(temperature, humidity, speakers, period_s, clock.now(), stream, world)


def _serve(clock: Any, session: Any, end_s: float | None, speed: float, vehicle: Any = None) -> None:
    """Wait while the instruments' own threads work, and play the vehicle."""
    while end_s is None or clock.now() < end_s:
        due_s = float("inf") if vehicle is None else vehicle.due_s()
        clock.sleep_until(min(clock.now() + 0.2 * speed, due_s, end_s or float("inf")))
        if vehicle is not None:
            vehicle.play(clock.now())
        if session.witness.trouble:
            return


def _links(given: list[str], serial: list[str]) -> dict[str, Path]:
    """Name of an instrument -> link, from PATH (one serial instrument) or NAME=PATH."""
    from shockrig.files.disk import demand_name
    from shockrig.rig.bench_errors import BenchError

    links = {}
    for text in given:
        name, equals, path = text.partition("=")
        if not equals and len(serial) == 1:
            name, path = serial[0], text
        if name not in serial or not path:
            known = " or ".join(f"{one}=PATH" for one in serial) or "nothing: there is no serial instrument"
            raise BenchError(f"--link {text}: here are {len(serial)} serial instruments; expected {known}")
        demand_name(path, "give another path")
        links[name] = Path(path)
    return links


def _chambers_toml(climate: dict[str, tuple[str, str]]) -> str:
    """The sections of a bench file by which the emulated chambers and fan are reached."""
    lines = []
    for name, (kind, port) in climate.items():
        lines += ["", f"[chambers.{name}]", f'kind = "{kind}"', f'port = "{port}"']
        if kind == "modbus":
            for quantity in ("airflow",) if name == "airflow" else ("temperature", "humidity"):
                lines += [f"{way}_{quantity} = {REGISTERS.index(quantity)}" for way in ("set", "read")]
    return "\n".join(lines) + "\n"


def _introduce(args: argparse.Namespace, session: Any, links: dict[str, Path], folder: Path) -> None:
    for name, path in session.serial.items():
        named = f" ({links[name]})" if name in links else ""
        print(f"{name} on {path}{named}", flush=True)
    if session.climate:
        print(f"chambers and a fan: append {folder / CHAMBERS_FILE} to a bench file", flush=True)
    if session.environment:
        setting = " ".join(f"{name}={value}" for name, value in session.environment.items())
        places = " and ".join(
            f"{kind} at {', '.join(f'{address:#04x}' for address in addresses)}"
            for kind, addresses in session.addresses.items()
        )
        print(f"{places} on /dev/i2c-{args.bus} for programs with")
        print(f"  export {setting}", flush=True)
        if "hyt-271" in session.addresses:
            request = f"i2ctransfer -y {args.bus} w0@{args.address:#04x}"
            fetch = f"i2ctransfer -y {args.bus} r4@{args.address:#04x}"
            print(f"then for instance: {request}; sleep 0.1; {fetch}", file=sys.stderr)
    for address in filter(None, (args.dronecan, args.mavlink)):
        print(f"node on {address}", flush=True)


def _bench(args: argparse.Namespace, probes: int) -> list[Any]:
    """Pairs of sensors at rest between two chambers; a carriage moves them."""
    from shockrig.rig.virtual.emulate.rest import RestingBench

    airs = _both_airs(args)
    return [RestingBench(*airs, args.airflow, PRESSURE_HPA, args.seed, probe + 1) for probe in range(probes)]


def _both_airs(args: argparse.Namespace) -> tuple[Any, Any]:
    from shockrig.rig.seams import Air

    source, destination = (Air(*_air(name, getattr(args, name))) for name in ("source", "destination"))
    return source, destination


def _flight(args: argparse.Namespace) -> tuple[list[Any], float]:
    from shockrig.analysis.flight.simulated.typical import typical_profile
    from shockrig.files.profile import read_profile
    from shockrig.protocols.flight_world import flight_world, read_flown_air

    profile = typical_profile() if args.profile is None else read_profile(args.profile)
    air = read_flown_air(args.flight)
    print(f"flying the sensors through {air.time_s[-1]:.0f} s of air ...", file=sys.stderr)
    world = flight_world(air, profile, args.seed)
    if world.left_out:
        print(f"note: left to the logger that listens: {', '.join(world.left_out)}", file=sys.stderr)
    return [world], world.end_s


def _air(name: str, text: str) -> tuple[float, float]:
    from shockrig.files.ranges import RANGES
    from shockrig.rig.bench_errors import BenchError

    try:
        temperature_c, humidity_percent = (float(part) for part in text.split(","))
    except ValueError:
        temperature_c = humidity_percent = float("nan")
    if not (RANGES["temperature_c"].holds(temperature_c) and RANGES["humidity_set_percent"].holds(humidity_percent)):
        raise BenchError(f"--{name} {text}: expected DEGC,RH such as 20,50")
    return temperature_c, humidity_percent


def fault_of(text: str) -> Any:
    """A fault of KIND@START[-END]."""
    import math
    import re

    from shockrig.rig.bench_errors import BenchError
    from shockrig.rig.virtual.faults import Fault

    found = re.fullmatch(r"(\w+)@(\d+(?:\.\d+)?)(?:-(\d+(?:\.\d+)?))?", text)
    if found is None:
        raise BenchError(f"--fault {text}: expected KIND@START or KIND@START-END, in s, such as silence@10-20")
    start_s, end_s = float(found[2]), math.inf if found[3] is None else float(found[3])
    if end_s <= start_s:
        raise BenchError(f"--fault {text}: ends before it begins; write KIND@START-END, such as silence@10-20")
    return Fault(found[1], start_s, end_s)


def _link(link: Path, target: str) -> None:
    """Never over a file, which may be somebody's; a link that was left behind is replaced."""
    from shockrig.rig.bench_errors import BenchError

    if link.is_symlink():
        link.unlink()
    try:
        link.symlink_to(target)
    except OSError as error:
        raise BenchError(f"--link {link}: {error.strerror}; give another path") from None
