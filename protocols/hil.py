"""`hil`: a flight played through emulated sensors, flown, heard, corrected, and held against what was played.

    emulated sensors -> drivers -> fly -> messages -> logs -> correct -> against the air that was played

Everything but the sensors is what flies: the drivers, smbus2 and pyserial, the corrector, the messages on UDP sockets.
Time is virtual: ten minutes take as long as the computing takes.
"""

from __future__ import annotations

import csv
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.checks.link import HeardMessages, SentRows, link_findings, rows_before
from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.simulated.weather import Weather
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.analysis.onboard import c_source, flown
from shockrig.analysis.report.hil_page import AFTER, AS_READ, IN_C, ON_BOARD, SETTLED_S, HilResult, LossStage
from shockrig.files.errors import InputError
from shockrig.files.flight import Corrected, Flight
from shockrig.files.flight_rows import whole_flight
from shockrig.files.numbers import counted
from shockrig.files.profile import Profile
from shockrig.protocols.flight_world import FlightWorld
from shockrig.protocols.fly import LOG, FlySettings, OnboardFlight
from shockrig.protocols.onboard_check import build, compiler, run
from shockrig.rig.bench import default_bench, open_bench
from shockrig.rig.links.dronecan import DronecanNode, HygrometerFrame, decoded, this_machine
from shockrig.rig.links.mavlink import AutopilotListener, MavlinkEnd, MavlinkSpeaker
from shockrig.rig.links.ports import FramePort, UdpPort, open_frames
from shockrig.rig.recorder.run_journal import read_run
from shockrig.rig.virtual.faults import I2C_KINDS, LINK_KINDS, SERIAL_KINDS, Fault
from shockrig.rig.virtual.vehicle import FaultyPort, FaultySpeaker, Vehicle, as_kelvin, as_whole_units

Array = NDArray[np.float64]
Courses = tuple[Array, Array]
HERE = "127.0.0.1"
NODE = 44
MESSAGES = "messages.csv"
MESSAGE_COLUMNS = ("heard_s", "kind", "number", "sensor", "stamp_s", "temperature_c", "humidity_percent")
HYGROMETER_SENSOR, NAMED, HYGROMETER = "HYGROMETER_SENSOR", "NAMED_VALUE_FLOAT", "Hygrometer"
OTHER = "other"
ROUNDED_HOW = {
    HYGROMETER_SENSOR: "in hundredths, as integers",
    NAMED: "in numbers of 32 bits",
    HYGROMETER: "in numbers of 16 bits (DroneCAN)",
}
COVERAGE_SIGMAS = 1.96
KINDS = (*LINK_KINDS, *I2C_KINDS, *(kind for kind in SERIAL_KINDS if kind not in (*I2C_KINDS, "alarm", "stall")))


def fly_emulated(
    world: FlightWorld, profile: Profile, out: Path, faults: Iterable[Fault], seed: int, lag_s: float
) -> Path:
    """Fly a world's sensors through `fly`; the flight's folder, with what was heard in messages.csv."""
    faults = list(faults)
    of_parts = {
        "imet": [fault for fault in faults if fault.kind in SERIAL_KINDS],
        "hyt": [fault for fault in faults if fault.kind in I2C_KINDS],
    }
    of_link = [fault for fault in faults if fault.kind in LINK_KINDS]
    bench = open_bench(default_bench(seed), faults={k: v for k, v in of_parts.items() if v}, world=world)
    clock = bench.clock
    bus = f"mcast:{1 + os.getpid() % 254}"  # so that two of these do not hear each other
    ear, ground, autopilot = open_frames(bus), UdpPort(HERE, 0, True), UdpPort(HERE, 0, True)
    to_ground = FaultyPort(UdpPort(HERE, ground.number, False), of_link, clock, seed)
    can = FaultyPort(open_frames(bus), of_link, clock, seed)
    speakers = [
        FaultySpeaker(MavlinkSpeaker(MavlinkEnd(to_ground)), of_link, clock, as_whole_units),
        FaultySpeaker(DronecanNode(can, NODE, this_machine()), of_link, clock, as_kelvin),
    ]
    stream = MavlinkEnd(UdpPort(HERE, autopilot.number, False))
    vehicle = Vehicle(float, float, (), world.end_s, clock.now(), stream, world)
    listener = _Listener(MavlinkEnd(ground), ear)
    flight = OnboardFlight(
        bench.sensors, clock, profile, out, speakers, FlySettings(lag_s, sync_every_s=None),
        autopilot=AutopilotListener(MavlinkEnd(autopilot)), say=lambda text: None, unix_s=clock.now,
    )  # fmt: skip
    try:
        while clock.now() < world.end_s:
            vehicle.play(clock.now())
            flight.step(min(world.end_s, vehicle.due_s()))
            for port in (to_ground, can):
                port.release()
            listener.hear(clock.now())
    finally:
        flight.close()
        listener.hear(clock.now())
        vehicle.close()
        listener.close()
        bench.close()
    listener.write(flight.log.folder / MESSAGES)
    return flight.log.folder


class _Listener:
    """A ground station: every message that is heard, as a row."""

    def __init__(self, ground: MavlinkEnd, ear: FramePort) -> None:
        self._ground, self._ear = ground, ear
        self._rows: list[tuple[Any, ...]] = []

    def hear(self, now_s: float) -> None:
        for message in self._ground.received():
            kind, number, stamp_s = message.get_type(), message.get_seq(), ""
            sensor: Any = ""
            values: tuple[Any, Any] = "", ""
            if kind == HYGROMETER_SENSOR:
                sensor, values = message.id, (message.temperature / 100.0, message.humidity / 100.0)
            elif kind == NAMED and message.name in ("T_air", "RH_air"):
                value = f"{message.value:.9g}"
                sensor, stamp_s = 0, f"{message.time_boot_ms / 1000.0:.3f}"
                values = (value, "") if message.name == "T_air" else ("", value)
            else:
                kind = OTHER
            self._rows.append((f"{now_s:.7f}", kind, number, sensor, stamp_s, *values))
        for identifier, data in self._ear.receive():
            said = decoded(identifier, data)
            if isinstance(said, HygrometerFrame):
                values = f"{said.temperature_c:.9g}", f"{said.humidity_percent:.9g}"
                self._rows.append((f"{now_s:.7f}", HYGROMETER, said.transfer, said.sensor, "", *values))

    def write(self, path: Path) -> None:
        with path.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(MESSAGE_COLUMNS)
            writer.writerows(self._rows)

    def close(self) -> None:
        self._ground.close()
        self._ear.close()


def judge(folder: Path, world: FlightWorld, profile: Profile) -> HilResult:
    """Hold a flight's logs against what was played; what is named on the links is told from the logs alone."""
    log = _table(folder / LOG)
    rows = whole_flight(folder / LOG)
    sent = SentRows(log["time_s"], log["sent_s"], log["onboard_temperature_c"], log["onboard_humidity_percent"])
    heard = _heard(_messages(folder / MESSAGES))
    time_s = rows.time_s
    weather = world.weather
    air = _course(weather, time_s)
    read_s = log["humidity_read_s"]
    felt = np.asarray(world.bead(time_s)), np.asarray(world.film(time_s))
    felt_as_dated = felt[0], np.where(np.isfinite(read_s), world.film(np.nan_to_num(read_s)), np.nan)
    onboard = log["onboard_temperature_c"], log["onboard_humidity_percent"]
    sigma = log["onboard_temperature_uncertainty_k"], log["onboard_humidity_uncertainty_percent"]
    smooth = correct(rows, profile)
    after = smooth.temperature_c, smooth.humidity_percent
    after_sigma = smooth.temperature_uncertainty_k, smooth.humidity_uncertainty_percent
    read = rows.temperature_c, rows.humidity_percent
    counts = time_s > time_s[0] + SETTLED_S

    def stage(name: str, words: str, one: Courses, other: Courses, sigmas: Courses | None = None) -> LossStage:
        errors = [(a - b)[counts] for a, b in zip(one, other, strict=True)]
        covered = None
        if sigmas is not None:
            covered = _covered(errors[0], sigmas[0][counts]), _covered(errors[1], sigmas[1][counts])
        return LossStage(name, _rms(errors[0]), _rms(errors[1]), words, covered)

    stages = [
        stage("sensor", "what bead and film feel, against the air", felt, air),
        stage("reading", "noise and rounding of the instruments, dating by the drivers", read, felt_as_dated),
        stage("pairing", "bead and film share a row and are read at two times", felt_as_dated, felt),
        stage("delay", "how far the air moves on until its row is sent", air, _course(weather, log["sent_s"])),
        *(_message_stage(f"message {kind}", words, heard[kind], sent) for kind, words in ROUNDED_HOW.items()),
    ]
    totals = [
        stage(AS_READ, "", read, air),
        stage(ON_BOARD, "corrected with what came before", onboard, air, sigma),
        stage(AFTER, "corrected with the whole flight" + _left(smooth), after, air, after_sigma),
    ]
    in_c = _in_c(profile, rows)
    if in_c is not None:
        totals.insert(2, stage(IN_C, "the same rows through the generated program", in_c[:2], air, in_c[2:]))
    findings = tuple(link_findings(sent, list(heard.values())))
    sensors = tuple(_sensor_words(folder))
    return HilResult(folder, tuple(stages), tuple(totals), findings, sensors, time_s, air, read, onboard, after)


def _left(corrected: Corrected) -> str:
    """What of a flight was left as it was read."""
    counts = {name: int(corrected.flags[f"{name}_not_corrected"].sum()) for name in ("temperature", "humidity")}
    left = [f"{name} of {counted(count, 'row')} as it was read" for name, count in counts.items() if count]
    return f"; {' and '.join(left)}" if left else ""


def _course(weather: Weather, at_s: Array) -> Courses:
    """The air at some times."""
    return (
        np.interp(at_s, weather.time_s, weather.temperature_c),
        np.interp(at_s, weather.time_s, weather.humidity_percent),
    )


def _in_c(profile: Profile, rows: Flight) -> Any:
    """What the generated C makes of the rows, temperature and humidity and then their uncertainties; None where there
    is no compiler, or no program of this profile."""
    cc = compiler()
    if cc is None:
        return None
    try:
        design = flown(profile, typical_period(rows.time_s))
    except InputError:
        return None
    with tempfile.TemporaryDirectory() as name:
        for file, text in c_source(design, "profile", "hil").items():
            (Path(name) / file).write_text(text, encoding="utf-8")
        found = run(build(Path(name), cc, Path(name)), rows)
    return found[:, 0], found[:, 2], found[:, 1], found[:, 3]


def _rms(errors: Array) -> float:
    known = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def _covered(errors: Array, sigma: Array) -> float:
    known = np.isfinite(errors) & np.isfinite(sigma)
    return float(np.mean(np.abs(errors[known]) <= COVERAGE_SIGMAS * sigma[known])) if known.any() else float("nan")


def _message_stage(name: str, words: str, messages: HeardMessages, sent: SentRows) -> LossStage:
    """What a message's type rounds away, and what the link does beside it."""
    place = rows_before(sent, messages)
    temperature = (messages.temperature_c - sent.temperature_c[place])[place >= 0]
    humidity = (messages.humidity_percent - sent.humidity_percent[place])[place >= 0]
    return LossStage(name, _rms(temperature), _rms(humidity), words)


def _table(path: Path) -> dict[str, Array]:
    import pandas as pd

    frame = pd.read_csv(path)
    return {name: frame[name].to_numpy(dtype=float) for name in frame.columns if name != "onboard_flags"}


def _messages(path: Path) -> Any:
    import pandas as pd

    return pd.read_csv(path)


def _heard(frame: Any) -> dict[str, HeardMessages]:
    """Messages about the air, kind by kind; the numbers of MAVLink are shared by all its kinds."""
    mavlink = frame[frame.kind != HYGROMETER]
    found = {}
    for kind, step, modulus in ((HYGROMETER_SENSOR, 0.0051, 256), (NAMED, 1e-4, 256), (HYGROMETER, 0.0, 32)):
        own = frame[(frame.kind == kind) & (frame.sensor == 0)]
        # sensors 0 and 1 of a row are two transfers of one type
        counted = frame[frame.kind == kind] if kind == HYGROMETER else mavlink
        temperature = own.temperature_c.to_numpy(dtype=float)
        # of two messages with one stamp, one for each quantity, the first one's counts
        stamps = np.where(np.isfinite(temperature), own.stamp_s.to_numpy(dtype=float), np.nan)
        found[kind] = HeardMessages(
            kind,
            own.heard_s.to_numpy(dtype=float),
            stamps,
            temperature,
            own.humidity_percent.to_numpy(dtype=float),
            counted.heard_s.to_numpy(dtype=float),
            counted.number.to_numpy(dtype=np.int64),
            modulus,
            step,
            half=kind == HYGROMETER,
            whole=kind == HYGROMETER_SENSOR,
        )
    return found


def _sensor_words(folder: Path) -> list[str]:
    """What the journal says of the sensors: what fly noted, and answers that were none."""
    run = read_run(folder)
    found = [f"{at_s:.1f} s: {text}" for at_s, text in run.notes if not text.startswith("rows ")]
    for name in ("imet", "hyt"):
        bad = {kind: n for kind, n in run.counts.get(name, {}).items() if kind != "ok"}
        if bad:
            said = ", ".join(f"{n} {kind.replace('_', ' ')}" for kind, n in bad.items())
            found.append(f"{name}: {said} of {sum(run.counts[name].values())} answers")
    return found
