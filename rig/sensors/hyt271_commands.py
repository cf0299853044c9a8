"""HYT-271 command mode: read and change the I2C address.

Within 10 ms of power-on `A0 00 00` enters command mode; a successful reply begins with 0x81. 0x00-0x1F read an EEPROM
word, 0x40-0x5F write it (12 ms), 0x80 leaves. The address is word 0x1C, bits 6:0. Source: IST AHHYTM_E2.2.1.
"""

from __future__ import annotations

import errno
from dataclasses import dataclass

from shockrig.rig.bench_errors import BenchError, BusError
from shockrig.rig.seams import Clock, I2cBus

SUCCESS = 0x81
ADDRESS_WORD = 0x1C
ENTER, LEAVE = bytes((0xA0, 0, 0)), bytes((0x80, 0, 0))
EEPROM_WRITE_S = 0.015
REPLY_S = 0.0005
LOOK_S = 0.05
# For anybody: not reserved, and not of memories (SPD, EDID), which are not to be tried. Where `shockrig scan` looks.
FREE_ADDRESSES = tuple(
    address for address in range(0x08, 0x78) if address not in {*range(0x30, 0x38), *range(0x50, 0x60)}
)
ABSENT = {errno.EREMOTEIO, errno.ENXIO, errno.EIO, errno.ETIMEDOUT}


def enter_command_mode(bus: I2cBus, clock: Clock, address: int, wait_s: float = 30.0) -> None:
    """Catch the sensor's first 10 ms after power-on: knock without pause while somebody switches its supply on.

    Raises
    ------
    BusError
        Nobody entered command mode within `wait_s`.
    """
    deadline_s = clock.now() + wait_s
    answered = False
    while clock.now() < deadline_s:
        try:
            bus.write(address, ENTER)
            answered = True
            clock.sleep_until(clock.now() + REPLY_S)
            if bus.read(address, 1)[0] == SUCCESS:
                return
        except OSError as error:
            if error.errno not in ABSENT:
                raise
        clock.sleep_until(clock.now() + REPLY_S)
    seen = "it answers, but was switched on before" if answered else "it never answered"
    raise BusError(
        f"no sensor at {address:#04x} entered command mode in {wait_s:g} s ({seen}); "
        "switch the sensor's supply off and on again while this runs"
    )


def _command(bus: I2cBus, clock: Clock, address: int, command: bytes, wait_s: float) -> int:
    bus.write(address, command)
    clock.sleep_until(clock.now() + wait_s)
    reply = bus.read(address, 3)
    if reply[0] != SUCCESS:
        raise BusError(f"the sensor at {address:#04x} refused command {command.hex(' ')}: it replied {reply.hex(' ')}")
    return reply[1] << 8 | reply[2]


def read_address_word(bus: I2cBus, clock: Clock, address: int) -> int:
    """EEPROM word 0x1C of a sensor in command mode."""
    return _command(bus, clock, address, bytes((ADDRESS_WORD, 0, 0)), REPLY_S)


def read_address(bus: I2cBus, clock: Clock, address: int, wait_s: float = 30.0) -> int:
    """The address stored in a sensor that is switched on while this waits."""
    enter_command_mode(bus, clock, address, wait_s)
    try:
        return read_address_word(bus, clock, address) & 0x7F
    finally:
        bus.write(address, LEAVE)


def answering(bus: I2cBus) -> list[int]:
    """Addresses at which somebody acknowledges a plain read, which asks nothing of a chip; reserved ones left alone."""
    return [address for address in FREE_ADDRESSES if _answers(bus, address)]


def _answers(bus: I2cBus, address: int) -> bool:
    try:
        bus.read(address, 1)
    except OSError as error:
        if error.errno not in ABSENT:
            raise
        return False
    return True


def wait_for_answer(bus: I2cBus, clock: Clock, address: int, wait_s: float) -> bool:
    """Whether somebody acknowledges a read at an address within some time."""
    deadline_s = clock.now() + wait_s
    while clock.now() < deadline_s:
        if _answers(bus, address):
            return True
        clock.sleep_until(clock.now() + LOOK_S)
    return False


@dataclass(frozen=True)
class AddressWords:
    """EEPROM word 0x1C as it was and as it is to be; the address is bits 6:0, the others are the maker's."""

    old: int
    new: int


def change_address(
    bus: I2cBus,
    clock: Clock,
    address: int,
    new_address: int,
    *,
    confirmed: bool,
    dry_run: bool = False,
    wait_s: float = 30.0,
) -> AddressWords:
    """Store another address in the sensor; it holds from the next power-on.

    Parameters
    ----------
    confirmed : bool
        That a person wants this: nothing on the sensor shows its address, so that a forgotten one must be searched for.
    dry_run : bool
        Read the word and say what it would become; nothing is written.

    Raises
    ------
    BenchError
        Not confirmed, an address that is not `FREE_ADDRESSES`, or one at which somebody answers already.
    BusError
        No sensor, or it did not take the address (it keeps the old one then).
    """
    if new_address not in FREE_ADDRESSES:
        raise BenchError(
            f"address {new_address:#04x} is reserved on I2C or a memory's, where shockrig scan does not look: "
            "choose one from 0x08 to 0x77, not 0x30 to 0x37 or 0x50 to 0x5f"
        )
    if not (confirmed or dry_run):
        change = f"changing the address from {address:#04x} to {new_address:#04x}"
        raise BenchError(f"{change} is permanent: confirm it by --yes-change-it")
    if new_address != address and _answers(bus, new_address):
        raise BenchError(f"somebody answers at {new_address:#04x} already: choose another address, or unplug that one")
    enter_command_mode(bus, clock, address, wait_s)
    try:
        word = read_address_word(bus, clock, address)
        wanted = word & ~0x7F | new_address  # the other bits belong to the maker
        if dry_run:
            return AddressWords(word, wanted)
        _command(bus, clock, address, bytes((0x40 | ADDRESS_WORD, wanted >> 8, wanted & 0xFF)), EEPROM_WRITE_S)
        stored = read_address_word(bus, clock, address)
        if stored != wanted:
            raise BusError(f"the sensor at {address:#04x} stored {stored:#06x} and not {wanted:#06x}; try again")
        return AddressWords(word, wanted)
    finally:
        bus.write(address, LEAVE)
