"""What recording costs: the CPU time of the recording process at 10 Hz for two sensors, and at 1000 Hz what is dropped.

    python benchmarks/recording_overhead.py [--seconds 30]

The instruments are emulated in another process, in real time: an iMet-XF on a pseudo-terminal under the real pyserial,
and a HYT-271 behind the preload library under the real smbus2. No HYT-271 converts 1000 times a second, so that at the
high rate the second sensor is the one whose readings the XF sends in lines of its own. The recording process is
measured alone, drivers and forced writes to the disk included, by its own CPU clock. Every line carries its number, so
that a dropped one shows.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from shockrig.rig.virtual.chips.hyt271 import Hyt271Chip
from shockrig.rig.virtual.emulate.i2c_socket import I2cSocket, build_preload
from shockrig.rig.virtual.i2c_dev import I2cWire
from shockrig.rig.virtual.serial_line import OutputQueue, PtyDevice

BYTE_S = {1: 10 / 57600, 100: 10 / 2_000_000}
LIMIT_PERCENT = 5.0


class Counting:
    """A serial device that says `5,2000,N`, and `8,A,B` with N = A + 1000 B, at a steady rate, N counting up."""

    def __init__(self, period_s: float, byte_s: float, from_s: float, humidity: bool) -> None:
        self.byte_s = byte_s
        self._humidity = humidity
        self.said = 0
        self._period_s, self._from_s = period_s, from_s
        self._queue = OutputQueue(byte_s)

    def output(self, until_s: float) -> bytes:
        while (at_s := self._from_s + self.said * self._period_s) <= until_s:
            self._queue.send(b"5,2000,%d\r\n" % self.said, at_s)
            if self._humidity:
                self._queue.send(b"8,%d,%d\r\n" % (self.said % 1000, self.said // 1000), at_s)
            self.said += 1
        return self._queue.output(until_s)

    def next_output_s(self) -> float:
        return self._from_s + self.said * self._period_s

    def receive(self, data: bytes, at_s: float) -> None:
        pass


def emulate(folder: Path, factor: int) -> None:
    """The instruments' process: until its standard input is closed."""
    from shockrig.rig.clock import RealClock

    clock = RealClock()
    pty = PtyDevice(Counting(0.1 / factor, BYTE_S[factor], clock.now(), factor > 1), clock, tick_s=0.001)
    chip = Hyt271Chip(lambda at_s: 50.0, lambda at_s: 20.0)
    bus = I2cSocket(I2cWire([chip], clock), folder / "i2c.socket")
    print(pty.path, flush=True)
    sys.stdin.read()
    bus.close()
    pty.close()


def record(folder: Path, port: str, factor: int, seconds: float) -> None:
    """The recording process: loop, drivers and journal as in a run, then what it cost and what came."""
    from shockrig.rig.buses.i2c import SmbusBus
    from shockrig.rig.buses.serial_port import PyserialPort, pyserial_opener
    from shockrig.rig.clock import RealClock
    from shockrig.rig.listening import SHORTEST_WAIT_S
    from shockrig.rig.recorder import Recorder, read_run
    from shockrig.rig.sensors.hyt271 import Hyt271, Hyt271Settings
    from shockrig.rig.sensors.imet import Imet, ImetSettings
    from shockrig.rig.sensors.imet_parts import ImetHumidity, ImetHumiditySettings

    clock, baud = RealClock(), round(10 / BYTE_S[factor])
    period_s = 0.1 / factor
    imet = Imet("imet", ImetSettings(port, baud=baud), PyserialPort(pyserial_opener(port, baud), clock, baud), clock)
    if factor == 1:
        hyt = Hyt271("hyt", Hyt271Settings(bus=7, conversion_s=0.07), SmbusBus("/dev/i2c-7", clock), clock)
    else:
        hyt = ImetHumidity("hyt", ImetHumiditySettings(), imet)
    for sensor in (imet, hyt):
        sensor.open()
    run = folder / f"run{factor}"
    run.mkdir()
    recorder = Recorder(run, {"id": f"run{factor}"}, clock.now(), sync_every_s=1.0)
    recorder.zero(clock.now(), "2026-01-01T00:00:00Z")
    handed, began_s, cpu_s = 0, clock.now(), time.process_time()
    while clock.now() < began_s + seconds:
        due_s = min(imet.due_s(), hyt.due_s())
        clock.sleep_until(max(due_s, clock.now() + SHORTEST_WAIT_S))
        now = clock.now()
        for sensor in (imet, hyt):
            if sensor.due_s() <= now:
                for reading in sensor.poll():
                    recorder.reading(reading)
                    handed += 1
    cpu_s, span_s = time.process_time() - cpu_s, clock.now() - began_s
    recorder.end(clock.now(), "complete")
    for sensor in (imet, hyt):
        sensor.close()
    kept = read_run(run)
    usable = {
        name: [r for r in kept.readings[name] if r.outcome.value in ("ok", "stale") and r.values]
        for name in ("imet", "hyt")
    }
    dropped = {"imet": _missing([int(r.raw.split(b",")[2]) for r in usable["imet"]])}
    if factor == 1:
        dropped["hyt"] = max(0, round((span_s - 0.5) / period_s) - len(usable["hyt"]))
    else:
        numbers = [round(10 * r.values["humidity_percent"]) for r in usable["hyt"]]
        dies = [round(100 * r.values["temperature_c"]) for r in usable["hyt"]]
        dropped["hyt"] = _missing([n + 1000 * die for n, die in zip(numbers, dies, strict=True)])
    lost = handed - sum(len(readings) for readings in kept.readings.values())
    size = (run / "journal.log").stat().st_size
    print(f"at {10 * factor} Hz for {span_s:.0f} s:")
    for name, readings in usable.items():
        late = sum(r.outcome.value == "stale" for r in readings)
        rate_hz = len(readings) / span_s
        fate = f"{dropped[name]} dropped, {late} marked late"
        print(f"  {name:4} readings       {len(readings)} recorded ({rate_hz:.1f}/s), {fate}")
    print(f"  readings not on disk {lost} of {handed}; journal {size / span_s / 1000:.1f} kB/s")
    print(f"  CPU of one core     {100 * cpu_s / span_s:.2f} %")
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"  memory              {memory_mb:.0f} MB")
    bad = any(dropped.values()) or lost or kept.damage or (factor == 1 and 100 * cpu_s / span_s > LIMIT_PERCENT)
    sys.exit(1 if bad else 0)


def _missing(numbers: list[int]) -> int:
    """How many of a count that goes up by one are not there."""
    return numbers[-1] - numbers[0] + 1 - len(set(numbers))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--role", choices=("emulate", "record"), help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--port", help=argparse.SUPPRESS)
    parser.add_argument("--factor", type=int, default=1, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.role == "emulate":
        emulate(args.folder, args.factor)
        return 0
    if args.role == "record":
        record(args.folder, args.port, args.factor, args.seconds)
    status = 0
    for factor in (1, 100):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            library = build_preload(folder / "i2c_preload.so")
            this = [sys.executable, __file__, "--folder", name, "--factor", str(factor)]
            with subprocess.Popen(
                [*this, "--role", "emulate"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            ) as instruments:
                port = instruments.stdout.readline().strip()
                environment = os.environ | {"LD_PRELOAD": str(library), "SHOCKRIG_I2C_7": str(folder / "i2c.socket")}
                status |= subprocess.run(
                    [*this, "--role", "record", "--port", port, "--seconds", str(args.seconds)], env=environment
                ).returncode
                instruments.stdin.close()
    print("within the limits" if status == 0 else "BEYOND THE LIMITS")
    return status


if __name__ == "__main__":
    sys.exit(main())
