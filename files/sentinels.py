"""Numbers that loggers and sensors write where they have no reading, in one table, each with who writes it.

A number that no reading of its quantity can be is a code wherever it stands. One that a reading can be (85 degC is an
oven's) is a code only where the log jumps to it and from it, as nearly no two readings differ.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from shockrig.files.ranges import Range

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NO_VALUE_WORDS = ("", "na", "n/a", "null", "none", "-", "--", "---")  # what loggers write for no value, as text
# code -> who writes it, of any quantity
_ANY_QUANTITY = (
    dict.fromkeys((-9.0, -99.0, -999.0, -9999.0, -99999.0, -999999.0), "no value, in the archives of weather services")
    | dict.fromkeys((-9.9, -99.9, -999.9, -9999.9, -99.99, -999.99, -9999.99), "the same, by the digits of a column")
    | dict.fromkeys((999.0, 999.9, 999.99, 9999.0, 9999.9, 9999.99, 99999.0, 999999.0), "the same")
    | dict.fromkeys((-888.0, -8888.0, -7777.0, -777.0), "no value, of data that were looked through")
    | dict.fromkeys((-32768.0, -3276.8, -327.68, 32767.0, 3276.7, 327.67), "the ends of 16 bits, by their divisor")
    | dict.fromkeys((65535.0, 6553.5, 655.35), "16 bits that are all set: a bus that nothing answers on")
    | dict.fromkeys((-2147483648.0, 2147483647.0, 4294967295.0), "the ends of 32 bits")
    | {1e20: "missing_value of CMIP's netCDF", 9.969209968386869e36: "netCDF's own fill value"}
)
_ZERO = {0.0: "zeros where nothing is connected or has a fix, as InterMet's application writes them"}
_TEMPERATURE = _ZERO | {
    85.0: "DS18B20 before its first conversion (data sheet, power-on value)",
    -127.0: "DallasTemperature's DEVICE_DISCONNECTED_C",
    -40.0: "HYT-271 on a bus that is held low: raw 0",
    125.0: "HYT-271 on a bus that is held high",
    -45.0: "SHT3x and SHT4x, raw 0",
    130.0: "SHT3x and SHT4x, all bits set",
    -46.85: "SHT2x and HTU21D, raw 0",
    128.86: "SHT2x and HTU21D, all bits set",
    -273.15: "no kelvin at all",
    -242.02: "Pt100 whose converter reads no resistance (MAX31865, raw 0)",
    988.79: "Pt100 that is broken (MAX31865, all bits set)",
}
# a logger that writes degF converts the codes as well
_TEMPERATURE = {1.8 * code + 32.0: f"{who}; in degF" for code, who in _TEMPERATURE.items()} | _TEMPERATURE
_HUMIDITY = _ZERO | {
    -6.0: "SHT2x, SHT4x and HTU21D, raw 0",
    118.99: "SHT2x and HTU21D, all bits set",
    119.0: "SHT2x, SHT4x and HTU21D, all bits set",
    998.0: "SparkFun's HTU21D library: no answer",
}
CODES: Mapping[str, Mapping[float, str]] = MappingProxyType(
    {
        "temperature": _ANY_QUANTITY | _TEMPERATURE,
        "die": _ANY_QUANTITY | _TEMPERATURE,
        "humidity": _ANY_QUANTITY | _HUMIDITY,
    }
    | dict.fromkeys(("pressure", "latitude", "longitude"), _ANY_QUANTITY | _ZERO)
    | dict.fromkeys(("time", "airspeed", "altitude", "vertical_speed"), _ANY_QUANTITY)
)
# that 8 bits of degrees hold, and 16 bits of hundredths, sixteenths (as of DS18B20) and tenths
SPANS = (256.0, 655.36, 4096.0, 6553.6)
NEAR_SENTINEL = 1e-6  # relative, and 1e-4 in the quantity's unit: digits that a column of text has lost
FAR_STEPS = 2.0  # times what nine of ten readings differ from the next by
LEAST_JUMP = 1.0  # in the quantity's unit
LARGEST_MEASURED = 1e25  # in whatever unit: nothing that flies measures so much, and sums of squares still hold it
LEAST_COURSE = 5  # readings in a row: as few as a run of a log needs before its step
SIGNED_SHARE = 0.9  # of the readings that are too high
GOES_ON_SHARE = 0.25  # of the ends of stretches without a sign
JUMP_STEPS = 20.0  # times what readings usually differ from the next by


def coded(quantity: str, values: Array, low: float = -np.inf, high: float = np.inf) -> dict[float, Mask]:
    """Rows (n,) that hold each code there is among `values` (n,); `low` to `high` is what a reading can be.

    A number that nothing measures is a code as well, the first there is for all of them.
    """
    codes = np.array(list(CODES[quantity]))
    known = np.isfinite(values)
    near = np.sort(codes)
    place = np.clip(np.searchsorted(near, np.where(known, values, 0.0)), 1, near.size - 1)
    lower, upper = near[place - 1], near[place]
    nearest = np.where(np.abs(values - lower) <= np.abs(values - upper), lower, upper)
    with np.errstate(invalid="ignore"):
        equal = known & (np.abs(values - nearest) <= np.maximum(1e-4, NEAR_SENTINEL * np.abs(nearest)))
    found: dict[float, Mask] = {}
    suspect = {float(code): equal & (nearest == code) for code in np.unique(nearest[equal])}
    others = known & (values >= low) & (values <= high) & ~equal
    for code, rows in suspect.items():
        if not low <= code <= high:
            found[code] = rows
        elif (jumped := rows & _jumped_to(values, others, rows, code)).any():
            found[code] = jumped
    beyond = known & (np.abs(values) > LARGEST_MEASURED) & ~equal
    if beyond.any():
        found[float(values[beyond][0])] = beyond
    return found


def without_sign(values: Array, possible: Range) -> tuple[float, Mask]:
    """Where 16 bits, or 8, of temperatures begin anew, in their unit, and the rows (n,) whose readings are so much too
    high, having been decoded without their sign; no row of any other log.

    Those that are too high for what is `possible` nearly all lie there, and go on from the others once that is taken
    off: an oven's do so as they are.
    """
    known = np.flatnonzero(np.isfinite(values))
    read = values[known]
    above = read > possible.high
    for span in SPANS:
        # all bits set are no reading
        there = above & (read >= span + possible.low) & (read < span - 1.5 * span / 65536)
        ends = np.diff(there)
        if not ends.any() or np.count_nonzero(there) < max(LEAST_COURSE, SIGNED_SHARE * np.count_nonzero(above)):
            continue
        taken_off = read - span * there
        jumps = np.abs(np.diff(taken_off))[ends]
        # one number again and again is a code, and there may be other codes, which are jumped to from either side
        if np.ptp(read[there]) > 0.0 and np.quantile(jumps, GOES_ON_SHARE) <= _usual_jump(taken_off):
            rows = np.zeros(values.shape, dtype=bool)
            rows[known[there]] = True
            return span, rows
    return 0.0, np.zeros(values.shape, dtype=bool)


def momentary(quantity: str, values: Array, low: float, high: float) -> dict[float, Mask]:
    """Rows (n,) that hold a code which a reading can be (`low` to `high`) and that the log jumps to and back from, for
    fewer rows than a course has; zeros are no such code here, a fridge has them."""
    known = np.flatnonzero(np.isfinite(values))
    found: dict[float, Mask] = {}
    for code, rows in coded(quantity, values, low, high).items():
        if code == 0.0 or not low <= code <= high:
            continue
        brief = np.zeros(values.shape, dtype=bool)
        for begin, end in np.flatnonzero(np.diff(rows[known], prepend=False, append=False)).reshape(-1, 2):
            beside = [*values[known[begin - 1 : begin]], *values[known[end : end + 1]]]
            is_passed = min(beside) <= code <= max(beside)  # as an oven is that warms
            brief[known[begin:end]] = end - begin < LEAST_COURSE and not is_passed
        if brief.any():
            found[code] = brief
    return found


def unread(values: Array, usual: Range, readable: Range) -> Mask:
    """Temperatures (n,) beyond what is `usual` that nothing measured.

    They are beyond what is `readable`, or a code, or the log jumps to them and back, for fewer rows than a course has
    or to one number, as of a contact that is open. What it goes to as it goes elsewhere, as into an oven, is measured.
    """
    known = np.flatnonzero(np.isfinite(values))
    outside = (values[known] < usual.low) | (values[known] > usual.high)
    if not outside.any():
        return np.zeros(values.shape, dtype=bool)
    wrong = (values < readable.low) | (values > readable.high)
    for rows in coded("temperature", values, readable.low, readable.high).values():
        wrong[known[outside]] |= rows[known[outside]]
    known = known[~wrong[known]]
    there = values[known]
    beyond = (there < usual.low) | (there > usual.high)
    jump = _usual_jump(there[~beyond])
    for begin, end in np.flatnonzero(np.diff(beyond, prepend=False, append=False)).reshape(-1, 2):
        part = there[begin:end]
        ends = [*np.abs(there[begin - 1 : begin] - part[0]), *np.abs(there[end : end + 1] - part[-1])]
        varies = part.size >= LEAST_COURSE and np.ptp(part) > 0.0
        if not varies and min(ends, default=np.inf) > jump:
            wrong[known[begin:end]] = True
    return wrong


def _usual_jump(believed: Array) -> float:
    """How far readings go from one to the next at the most, in the quantity's unit; coarse ones, which mostly stay, by
    steps."""
    step = np.abs(np.diff(believed))
    if not (step > 0.0).any():
        return LEAST_JUMP
    of_log = float(step[step > 0.0].min())
    return max(FAR_STEPS * max(float(np.quantile(step, 0.9)), of_log), JUMP_STEPS * float(np.median(step)), LEAST_JUMP)


def _jumped_to(values: Array, others: Mask, rows: Mask, code: float) -> Mask:
    """Which of the `rows` with a code the log jumps to: those farther from the readings beside them, of the `others`,
    than these are from one another."""
    jumped = np.zeros(values.shape, dtype=bool)
    believed = np.flatnonzero(others)
    if not believed.size:
        return jumped
    at = np.flatnonzero(rows)
    after = np.searchsorted(believed, at)
    before, behind = values[believed[np.maximum(after - 1, 0)]], values[believed[np.minimum(after, believed.size - 1)]]
    away = np.minimum(np.abs(before - code), np.abs(behind - code))
    jumped[at] = away > _usual_jump(values[believed])
    return jumped
