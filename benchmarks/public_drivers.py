"""Do drivers and parsers of other people read what the rig plays? Each of them unmodified, on steady air.

    python benchmarks/public_drivers.py [--cache FOLDER]

Sensor libraries open /dev/i2c-1 of `shockrig emulate` and read each of five airs; listeners hear the node's messages
over UDP. A line for each: how often it was read, and the largest difference from the air that was played (the sensors
have noise and calibrations of their own, so it is not zero), of the first reading after power-on and of those after it.

From the package index: sensirion-i2c-sht, RPi.bme280, pymavlink, dronecan. FOLDER holds programs for the HYT family
that no package has, fetched by hand (no licence is stated for the second); what is not there is left out and said:
    HYT939.c            github.com/ControlEverythingCommunity/HYT939 @5313773, C/HYT939.c
    HYT939-Sensor.py    github.com/ahmed100553/Air-Compressor-Monitor @89fc6c6
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

AIRS = ((5.0, 80.0), (15.0, 30.0), (20.0, 50.0), (25.0, 60.0), (35.0, 20.0))
READS = 4  # of each air, the first of them after power-on
POLL_S = 0.2
LONGEST_S = 300.0
SENSIRION = """
from sensirion_i2c_driver import I2cConnection, LinuxI2cTransceiver
from sensirion_i2c_sht.{kind} import {kind_class}
with LinuxI2cTransceiver("/dev/i2c-1") as bus:
    found = {kind_class}(I2cConnection(bus)).single_shot_measurement()
    print(found[0].degrees_celsius, found[1].percent_rh)
"""
BME280 = """
import bme280, smbus2
bus = smbus2.SMBus(1)
found = bme280.sample(bus, 0x76, bme280.load_calibration_params(bus, 0x76))
print(found.temperature, found.humidity)
"""
MAVLINK = """
from pymavlink import mavutil
link = mavutil.mavlink_connection("udpin:127.0.0.1:{port}")
for _ in range({reads}):
    found = link.recv_match(type="HYGROMETER_SENSOR", blocking=True, timeout=60)
    print(found.temperature / 100, found.humidity / 100)
"""
DRONECAN = """
import dronecan
node, heard = dronecan.make_node("mcast:{bus}", node_id=100), []
node.add_handler(dronecan.dronecan.sensors.hygrometer.Hygrometer, lambda event: heard.append(event.message))
while len(heard) < {reads}:
    node.spin(1.0)
for found in heard[:{reads}]:
    print(found.temperature, found.humidity)
"""


@contextmanager
def emulating(folder: Path, *arguments: str) -> Iterator[None]:
    """The rig's emulated instruments, from when they answer until the end of the block."""
    command = [sys.executable, "-m", "shockrig", "emulate", *arguments, "--folder", str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            for line in process.stdout or ():
                if "export" in line or "mcast" in line or "udpout" in line:
                    break
            yield
        finally:
            process.terminate()


def answers(command: list[str], folder: Path, preload: bool = True) -> list[tuple[float, float]]:
    """Temperature and humidity of each answer that a program prints."""
    bus = {"LD_PRELOAD": str(folder / "i2c_preload.so"), "SHOCKRIG_I2C_1": str(folder / "i2c-1.socket")}
    # a status says nothing of some: their main ends with what printf gave
    said = subprocess.run(
        command, env=os.environ | (bus if preload else {}), capture_output=True, text=True, timeout=LONGEST_S
    ).stdout
    if not said:
        sys.exit(f"{command[0]} printed nothing")
    if found := re.search(r"umidity[^0-9-]*(-?[0-9.]+)", said):
        celsius = re.search(r"(?:Celsius|Temperature)[^0-9-]*(-?[0-9.]+)", said)
        assert celsius is not None, said
        return [(float(celsius[1]), float(found[1]))]
    return [(float(line.split()[0]), float(line.split()[1])) for line in said.splitlines()]


def sensor(kind: str, command: list[str]) -> list[list[tuple[float, float]]]:
    """A library's answers (air, read)."""
    found = []
    for celsius, percent in AIRS:
        with tempfile.TemporaryDirectory() as made:
            folder = Path(made)
            with emulating(folder, kind, "--source", f"{celsius:g},{percent:g}"):
                found.append([])
                for _ in range(READS):
                    found[-1] += answers(command, folder)
                    time.sleep(POLL_S)
    return found


def listener(link: tuple[str, ...], script: str) -> list[list[tuple[float, float]]]:
    """A listener's messages (air, message)."""
    found = []
    for celsius, percent in AIRS:
        with tempfile.TemporaryDirectory() as made:
            folder = Path(made)
            with emulating(folder, *link, "--source", f"{celsius:g},{percent:g}"):
                found.append(answers([sys.executable, "-W", "ignore", "-c", script], folder, preload=False))
    return found


def line(name: str, found: list[list[tuple[float, float]]]) -> None:
    """One row of the table."""

    def farthest(some: slice) -> str:
        off = [[abs(a - b) for a, b in zip(one, air, strict=True)] for air, own in zip(AIRS, found, strict=True)
               for one in own[some]]  # fmt: skip
        return f"{max(o[0] for o in off):>9.2f}{max(o[1] for o in off):>8.2f}"

    print(f"{name:<44}{sum(map(len, found)):>6}{farthest(slice(1))}{farthest(slice(1, None))}", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cache", type=Path, help="folder of the programs that are in no package")
    args = parser.parse_args()
    print(f"{'':<44}{'reads':>6}{'first, K':>9}{'%RH':>8}{'later, K':>9}{'%RH':>8}")
    python = [sys.executable, "-W", "ignore"]
    for kind, of in (("sht31", ("sht3x", "Sht3xI2cDevice")), ("sht41", ("sht4x", "Sht4xI2cDevice"))):
        script = SENSIRION.format(kind=of[0], kind_class=of[1])
        line(f"{kind} by sensirion-i2c-sht", sensor(kind, [*python, "-c", script]))
    line("bme280 by RPi.bme280", sensor("bme280", [*python, "-c", BME280]))
    line("MAVLink by pymavlink", listener(("--mavlink", "udpout:127.0.0.1:14599"),
                                          MAVLINK.format(port=14599, reads=READS)))  # fmt: skip
    line("DroneCAN by python-dronecan", listener(("--dronecan", "mcast:9"), DRONECAN.format(bus=9, reads=READS)))
    with tempfile.TemporaryDirectory() as made:
        for name in ("HYT939.c", "HYT939-Sensor.py"):
            program = None if args.cache is None else args.cache / name
            if program is None or not program.is_file():
                print(f"hyt-271 by {name}: not in --cache")
                continue
            command = [*python, str(program)]
            if program.suffix == ".c":
                command = [str(Path(made) / "hyt939")]
                subprocess.run(["cc", "-w", "-include", "unistd.h", "-o", *command, str(program)], check=True)
            line(f"hyt-271 by {name}", sensor("hyt-271", command))
    return 0


if __name__ == "__main__":
    sys.exit(main())
