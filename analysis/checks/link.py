"""What a link did to messages, from logs alone: rows as they were sent against messages as they were heard.

A message belongs to the row that was sent last before it was heard. Where values agree with an earlier row instead,
they were late: with their stamps, and the link held them back; under new stamps, and the sender said an old poll.
Windows are looked at one by one, so that what happens for a while is named with its time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
WINDOW_ROWS = 50
CLOCK_S = 1e-6  # to which logs write times
FEWEST_MESSAGES = 20  # messages of a window that say anything
MOST_ROWS_LATE = 30
AGREES, DISAGREES = 0.9, 0.5  # shares of a window's messages
LOSS_SHARE = 0.01  # share of a window's messages that is a loss
HALF_DIGITS = 2.0**-11  # float16 has eleven digits
KELVIN, HUNDREDTHS = 273.15, 0.01
NAMES = {
    "loss": "messages are lost",
    "delay": "messages are held back",
    "units": "values are in another unit",
    "stamps": "stamps are repeated",
    "one_old": "values are one poll old, under new stamps",
    "silent": "nothing is heard",
}


@dataclass(frozen=True)
class SentRows:
    """Rows as the sender logged them: when read, when sent [s], and what was said of the air."""

    time_s: Array
    sent_s: Array
    temperature_c: Array
    humidity_percent: Array


@dataclass(frozen=True)
class HeardMessages:
    """Messages of one kind: when heard, their number modulo `modulus`, their stamp (NaN where the kind has none) [s].

    `counted` are the numbers of everything that shares them, with when it was heard; `step` is what a value is rounded
    to, `half` whether it has 16 bits, `whole` whether it has no word for a missing value, so that none is sent then.
    """

    name: str
    heard_s: Array
    stamp_s: Array
    temperature_c: Array
    humidity_percent: Array
    counted_s: Array
    numbers: NDArray[np.int64]
    modulus: int
    step: float
    half: bool = False
    whole: bool = False


@dataclass(frozen=True)
class LinkFinding:
    """One thing that a link did, from when to when [s], and how it was told."""

    link: str
    fault: str
    from_s: float
    to_s: float
    words: str

    def __str__(self) -> str:
        return f"{self.link}, {self.from_s:.0f} to {self.to_s:.0f} s: {NAMES[self.fault]} ({self.words})"


def link_findings(sent: SentRows, heard: Sequence[HeardMessages]) -> list[LinkFinding]:
    """What the links did, in the order of time; neighbouring windows with one fault are one finding."""
    found: list[LinkFinding] = []
    window_s = WINDOW_ROWS * _period(sent)
    for messages in heard:
        place = rows_before(sent, messages)
        edges = np.arange(float(sent.sent_s[0]), float(sent.sent_s[-1]) + window_s, window_s).tolist()
        for start, end in pairwise(edges):
            for one in _window(sent, messages, place, start, end):
                before = next((f for f in found if (f.link, f.fault, f.to_s) == (one.link, one.fault, start)), None)
                if before is not None:
                    found.remove(before)
                    one = LinkFinding(one.link, one.fault, before.from_s, one.to_s, before.words)
                found.append(one)
    return sorted(found, key=lambda one: (one.from_s, one.link))


def rows_before(sent: SentRows, messages: HeardMessages) -> NDArray[np.int64]:
    """The row that each message belongs to: the last one that was sent before it; -1 where there is none.

    Of several messages that say that they were heard at once, the last belongs to the last row.
    """
    place = np.searchsorted(sent.sent_s, messages.heard_s + CLOCK_S, side="right") - 1
    known = 2 * np.isfinite(messages.temperature_c) + np.isfinite(messages.humidity_percent)
    after: dict[tuple[float, int], int] = {}
    for k in range(messages.heard_s.size - 1, -1, -1):
        key = float(messages.heard_s[k]), int(known[k])
        place[k] -= after.get(key, 0)
        after[key] = after.get(key, 0) + 1
    return np.maximum(place, -1)


def _period(sent: SentRows) -> float:
    return float(np.median(np.diff(sent.time_s)))


def _window(
    sent: SentRows, messages: HeardMessages, places: NDArray[np.int64], start_s: float, end_s: float
) -> list[LinkFinding]:
    inside = (messages.heard_s >= start_s) & (messages.heard_s < end_s)
    said = np.isfinite(sent.temperature_c) & np.isfinite(sent.humidity_percent) | (not messages.whole)
    rows = int(np.count_nonzero((sent.sent_s >= start_s) & (sent.sent_s < end_s) & said))

    def finding(fault: str, words: str) -> LinkFinding:
        return LinkFinding(messages.name, fault, start_s, end_s, words)

    if rows < FEWEST_MESSAGES:
        return []
    if not inside.any():
        return [finding("silent", f"{rows} rows were sent")]
    found = []
    lost = _lost(messages, start_s, end_s)
    if lost > LOSS_SHARE:
        found.append(finding("loss", "their numbers have gaps"))
    if np.count_nonzero(inside) < FEWEST_MESSAGES:
        return found
    stamps = messages.stamp_s[inside]
    stamped = stamps[np.isfinite(stamps)]
    repeated = float(np.mean(np.diff(stamped) == 0.0)) if stamped.size > 1 else 0.0
    if repeated > LOSS_SHARE:
        found.append(finding("stamps", "two in a row are equal"))
    values = messages.temperature_c[inside], messages.humidity_percent[inside]
    place = places[inside]
    in_unit, unit = _unit(sent, place, values)
    if unit:
        found.append(finding("units", unit))
    late = _rows_late(sent, messages, place, in_unit, bool(unit))
    if late > 0:
        period_s = _period(sent)
        behind_s = float(np.nanmedian(messages.heard_s[inside] - stamps)) if stamped.size else np.nan
        current = behind_s < (late - 0.5) * period_s if np.isfinite(behind_s) else late == 1
        if current:
            found.append(finding("one_old", f"{late} row late" if late == 1 else f"{late} rows late"))
        else:
            found.append(finding("delay", f"by about {late * period_s:.1f} s"))
    return found


def _lost(messages: HeardMessages, start_s: float, end_s: float) -> float:
    """Share of the numbers that are missing."""
    numbers = messages.numbers[(messages.counted_s >= start_s) & (messages.counted_s < end_s)]
    if numbers.size < FEWEST_MESSAGES:
        return 0.0
    ahead = np.diff(numbers) % messages.modulus
    return float(np.sum(np.maximum(ahead - 1, 0)) / max(float(np.sum(ahead)), 1.0))


def _middle(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _unit(sent: SentRows, place: NDArray[np.int64], values: tuple[Array, Array]) -> tuple[tuple[Array, Array], str]:
    """Values in degC and %RH, and the slip they came with; empty where none."""
    rows = np.maximum(place, 0)
    temperature, humidity = values
    aside = _middle(temperature - sent.temperature_c[rows])
    with np.errstate(invalid="ignore", divide="ignore"):
        share = _middle(humidity / sent.humidity_percent[rows])
    if abs(aside - KELVIN) < 0.1 * KELVIN:
        return (temperature - KELVIN, humidity), "kelvin for degC"
    if abs(share / HUNDREDTHS - 1.0) < 0.3:
        return (temperature / HUNDREDTHS, humidity / HUNDREDTHS), "a hundredth of the value"
    return values, ""


def _rows_late(
    sent: SentRows, messages: HeardMessages, place: NDArray[np.int64], values: tuple[Array, Array], slipped: bool
) -> int:
    """By how many rows values are late; 0 where they are those of their rows, or of none."""
    shares = []
    for late in range(MOST_ROWS_LATE + 1):
        rows = place - late
        good = rows >= 0
        agrees = np.ones(int(np.count_nonzero(good)), dtype=bool)
        for said, told in zip(values, (sent.temperature_c, sent.humidity_percent), strict=True):
            wanted, got = told[rows[good]], said[good]
            close: Array | float = messages.step / (HUNDREDTHS if slipped else 1.0)
            if messages.half:
                close = HALF_DIGITS * np.maximum(np.abs(wanted) + KELVIN * slipped, 1.0)
            agrees &= ~(np.abs(got - wanted) > close)  # where there is no value nothing disagrees
        shares.append(float(np.mean(agrees)) if agrees.size >= FEWEST_MESSAGES else 0.0)
    best = int(np.argmax(shares))
    return best if shares[best] >= AGREES and shares[0] < DISAGREES else 0
