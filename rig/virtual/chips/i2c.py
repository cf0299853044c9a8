"""The emulated I2C chips by their kinds, as bench files (`bus = "virtual"`) and `shockrig emulate` name them."""

from __future__ import annotations

from collections.abc import Callable

from shockrig.rig.bench_errors import BenchError
from shockrig.rig.virtual.chips.bme280 import Bme280Chip
from shockrig.rig.virtual.chips.hyt271 import Hyt271Chip
from shockrig.rig.virtual.chips.sht import Sht3xChip, Sht4xChip
from shockrig.rig.virtual.i2c_dev import Chip

Sampler = Callable[[float], float]
I2C_ADDRESSES = {"hyt-271": 0x28, "sht31": 0x44, "sht41": 0x44, "bme280": 0x76}  # of the first one of a kind


def i2c_chip(kind: str, humidity_percent: Sampler, temperature_c: Sampler, pressure_hpa: Sampler, address: int) -> Chip:
    """A chip that feels film, die and pressure as they are at a time; BenchError where no such kind is emulated."""
    if kind == "bme280":
        return Bme280Chip(humidity_percent, temperature_c, pressure_hpa, address)
    of_film: dict[str, Callable[[Sampler, Sampler, int], Chip]]
    of_film = {"hyt-271": Hyt271Chip, "sht31": Sht3xChip, "sht41": Sht4xChip}
    if kind not in of_film:
        emulated = ", ".join(I2C_ADDRESSES)
        raise BenchError(f'bus = "virtual": no {kind} is emulated ({emulated} are); name the bus of one')
    return of_film[kind](humidity_percent, temperature_c, address)
