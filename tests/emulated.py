"""Emulated instruments under the real drivers, over a tiny analytic world; the command `emulate` in its own process."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
from contextlib import contextmanager

from processes import ended, heard

from shockrig.rig.buses.i2c import SmbusBus
from shockrig.rig.buses.serial_port import PyserialPort
from shockrig.rig.clock import VirtualClock
from shockrig.rig.sensors.hyt271 import Hyt271, Hyt271Settings
from shockrig.rig.virtual.chips.hyt271 import Hyt271Chip
from shockrig.rig.virtual.faults import FaultyI2c
from shockrig.rig.virtual.i2c_dev import I2cWire, plug_in, pull_out
from shockrig.rig.virtual.serial_line import MemorySerial, OutputQueue

_numbers = itertools.count(1)


def ramp_percent(at_s: float) -> float:
    """A humidity that tells the time: 1 %RH per second from 10 %RH."""
    return 10.0 + at_s


def steady_c(at_s: float) -> float:
    return 22.0


class Spy:
    """A wire that writes down every transaction."""

    def __init__(self, wire):
        self.wire, self.log = wire, []

    def open(self):
        self.wire.open()

    def write(self, address, data):
        self.log.append(("write", address, bytes(data)))
        self.wire.write(address, data)

    def read(self, address, length):
        answer = self.wire.read(address, length)
        self.log.append(("read", address, answer))
        return answer


@contextmanager
def hyt_bench(faults=(), settings=None, clock=None, humidity=ramp_percent, temperature=steady_c, **wire_options):
    """(sensor, chip, spy, clock) with a HYT-271 under the real smbus2; faults strike between spy and chip."""
    clock = clock or VirtualClock()
    settings = settings or {}
    chip = Hyt271Chip(humidity, temperature, conversion_s=wire_options.pop("conversion_s", 0.06))
    wire = I2cWire([chip], clock, **wire_options)
    spy = Spy(FaultyI2c(wire, faults, clock, chip) if faults else wire)
    path = f"/dev/i2c-test-{next(_numbers)}"
    plug_in(path, spy)
    sensor = Hyt271("hyt", Hyt271Settings(bus=path, **settings), SmbusBus(path, clock), clock)
    try:
        yield sensor, chip, spy, clock
    finally:
        sensor.close()
        pull_out(path)


class Replay:
    """A serial device that says given bytes at given times; it writes down what it is told."""

    byte_s = 10 / 57600

    def __init__(self, bursts):
        self._queue = OutputQueue(self.byte_s)
        for at_s, data in bursts:
            self._queue.send(data, at_s)
        self.heard = []

    def output(self, until_s):
        return self._queue.output(until_s)

    def next_output_s(self):
        return self._queue.next_output_s()

    def receive(self, data, at_s):
        self.heard.append((at_s, data))


def memory_port(device, clock, baud=57600):
    """The driver's own port class over a device in memory."""
    return PyserialPort(lambda: MemorySerial(device, clock), clock, baud)


def watch(part, clock, for_s):
    """Poll one part whenever it is due; its readings."""
    end_s, readings = clock.now() + for_s, []
    while (due_s := part.due_s()) < end_s:
        clock.sleep_until(max(due_s, clock.now() + 1e-4))
        if part.due_s() <= clock.now():  # as the runner asks: what is due must stay due
            readings += part.poll()
    clock.sleep_until(end_s)
    return readings


@contextmanager
def emulating(tmp_path, *arguments, begin=None, number=signal.SIGINT):
    """The command in a process of its own; yields it once it has said how to reach its instruments."""
    command = [sys.executable, "-m", "shockrig", "emulate", *arguments, "--folder", str(tmp_path)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=begin
    ) as process:
        try:
            on_bus = {"hyt-271", "sht31", "sht41"} & set(arguments)
            process.hello = heard(process, process.stdout, "export", *([] if on_bus else [" on /dev/"]))
            yield process
        finally:
            process.last_words = ended(process, number)


def with_bus(tmp_path):
    return os.environ | {
        "LD_PRELOAD": str(tmp_path / "i2c_preload.so"),
        "SHOCKRIG_I2C_1": str(tmp_path / "i2c-1.socket"),
        "PATH": os.environ["PATH"] + ":/usr/sbin",
    }
