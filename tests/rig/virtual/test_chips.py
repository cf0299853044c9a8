"""Emulated SHT3x, SHT4x and BME280: worked examples of their data sheets, and drivers that other people wrote."""

import os
import shutil
import subprocess
import sys

import pytest
from emulated import emulating, with_bus

from shockrig.rig.virtual.chips.bme280 import Bme280Chip, Trimming, count_of
from shockrig.rig.virtual.chips.sht import Sht3xChip, Sht4xChip, crc8, words


def steady(value):
    return lambda at_s: value


def test_the_checksum_is_that_of_the_data_sheet():
    assert crc8(b"\xbe\xef") == 0x92
    assert words(0xBEEF) == b"\xbe\xef\x92"


def test_an_sht3x_measures_when_told_and_says_nothing_before():
    chip = Sht3xChip(steady(50.0), steady(25.0))
    with pytest.raises(OSError):
        chip.read(6, 0.0)
    chip.write(b"\x24\x00", 1.0)
    with pytest.raises(OSError):
        chip.read(6, 1.010)  # the longest measurement takes 15.5 ms
    answer = chip.read(6, 1.016)
    temperature, humidity = (int.from_bytes(answer[at : at + 2], "big") for at in (0, 3))
    assert -45 + 175 * temperature / 65535 == pytest.approx(25.0, abs=0.002)
    assert 100 * humidity / 65535 == pytest.approx(50.0, abs=0.001)
    assert (answer[2], answer[5]) == (crc8(answer[:2]), crc8(answer[3:5]))
    with pytest.raises(OSError):
        chip.read(6, 2.0)  # a value is there once


def test_an_sht3x_measures_by_itself_and_each_value_is_fetched_once():
    chip = Sht3xChip(lambda at_s: 10.0 + at_s, steady(25.0))
    chip.write(b"\x27\x37", 0.0)  # ten times a second
    chip.write(b"\xe0\x00", 0.5)
    assert 100 * int.from_bytes(chip.read(6, 0.5)[3:5], "big") / 65535 == pytest.approx(10.4, abs=0.001)
    chip.write(b"\xe0\x00", 0.51)
    with pytest.raises(OSError):
        chip.read(6, 0.51)
    chip.write(b"\x30\x93", 0.6)
    chip.write(b"\xf3\x2d", 0.6)
    assert chip.read(3, 0.6) == words(0x8010)


def test_an_sht4x_has_a_scale_of_its_own():
    chip = Sht4xChip(steady(0.0), steady(-45.0))
    chip.write(b"\xfd", 0.0)
    answer = chip.read(6, 0.009)
    assert answer[:3] == words(0) and -6 + 125 * int.from_bytes(answer[3:5], "big") / 65535 == pytest.approx(
        0, abs=1e-3
    )
    chip.write(b"\x89", 1.0)
    assert len(chip.read(6, 1.0)) == 6


def test_the_bme280_reckons_as_the_worked_example_of_the_data_sheet():
    """BMP280, section 3.12: counts 519888 and 415148 are 25.08 degC and 100653.27 Pa."""
    trimming = Trimming()
    assert trimming.temperature_c(519888) == pytest.approx(25.08, abs=0.005)
    assert trimming.pressure_pa(415148, trimming.fine(519888)) == pytest.approx(100653.27, abs=0.5)
    assert count_of(25.0825, trimming.temperature_c, 20) == pytest.approx(519888, abs=20)


def test_the_bme280_sleeps_until_told_and_skips_what_is_not_wanted():
    chip = Bme280Chip(steady(50.0), steady(20.0), steady(950.0))
    chip.write(b"\xd0", 0.0)
    assert chip.read(1, 0.0) == b"\x60"
    chip.write(b"\xf7", 0.0)
    assert chip.read(8, 0.0) == b"\x80\x00\x00\x80\x00\x00\x80\x00"
    chip.write(b"\xf2\x01", 0.0)
    chip.write(b"\xf4\x21", 0.0)  # forced: temperature once, pressure not at all, humidity once
    chip.write(b"\xf3", 0.001)
    assert chip.read(1, 0.001)[0] & 0x08
    chip.write(b"\xf3", 0.1)
    assert not chip.read(1, 0.1)[0] & 0x08
    chip.write(b"\xf7", 0.1)
    data = chip.read(8, 0.1)
    temperature, humidity = int.from_bytes(data[3:6], "big") >> 4, int.from_bytes(data[6:], "big")
    trimming = chip.trimming
    assert data[:3] == b"\x80\x00\x00" and trimming.temperature_c(temperature) == pytest.approx(20.0, abs=0.005)
    assert trimming.humidity_percent(humidity, trimming.fine(temperature)) == pytest.approx(50.0, abs=0.01)
    chip.write(b"\xf4", 0.1)
    assert chip.read(1, 0.1)[0] & 3 == 0  # asleep again


READ_BME280 = """
import bme280, smbus2
bus = smbus2.SMBus(1)
found = bme280.sample(bus, 0x76, bme280.load_calibration_params(bus, 0x76))
print(found.temperature, found.humidity, found.pressure)
"""
READ_SHT3X = """
from sensirion_i2c_driver import I2cConnection, LinuxI2cTransceiver
from sensirion_i2c_sht.sht3x import Sht3xI2cDevice
with LinuxI2cTransceiver("/dev/i2c-1") as bus:
    found = Sht3xI2cDevice(I2cConnection(bus)).single_shot_measurement()
    print(found[0].degrees_celsius, found[1].percent_rh)
"""
READ_SHT4X = """
from sensirion_i2c_driver import I2cConnection, LinuxI2cTransceiver
from sensirion_i2c_sht.sht4x import Sht4xI2cDevice
with LinuxI2cTransceiver("/dev/i2c-1") as bus:
    found = Sht4xI2cDevice(I2cConnection(bus)).single_shot_measurement()
    print(found[0].degrees_celsius, found[1].percent_rh)
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) to build the preload library with")
@pytest.mark.parametrize(
    ("chips", "scripts"),
    [(("sht31", "bme280"), {"bme280": READ_BME280, "sensirion_i2c_sht": READ_SHT3X}),
     (("sht41",), {"sensirion_i2c_sht": READ_SHT4X})],
)  # fmt: skip
def test_drivers_of_other_people_read_the_chips(tmp_path, chips, scripts):
    for module in scripts:
        pytest.importorskip(module)
    with emulating(tmp_path, *chips, "--source", "25,60"):
        for script in scripts.values():
            done = subprocess.run(
                [sys.executable, "-W", "ignore", "-c", script],
                env=with_bus(tmp_path) | {"PYTHONPATH": os.environ.get("PYTHONPATH", "")},
                capture_output=True,
                text=True,
                timeout=300,
            )
            assert done.returncode == 0, done.stderr
            temperature, humidity, *pressure = map(float, done.stdout.split())
            assert (temperature, humidity) == (pytest.approx(25.0, abs=0.5), pytest.approx(60.0, abs=2.0))
            assert pressure == pytest.approx([1013.25] * len(pressure), abs=0.1)
