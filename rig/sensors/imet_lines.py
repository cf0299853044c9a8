"""Lines of the iMet family: an assembler that survives what serial lines do, and tables that say what the fields mean.

iMet-XF  5,2512,5376              first field an id (optional letters before it), then the fields of that id
iMet-XQ2 XQ,+095188,+2407,+0294,+2553,2015/10/18,00:38:44,+0000000000,+0000000000,-00017000,00
         some units say eight numbers of their analog inputs before the XQ; fields may have spaces around them
Sources: XF from NOAA-PMEL/envDS (InterMet), ids and meanings not confirmed by the maker; XQ2 from recorded logs. No
line has a checksum, so that only its shape and plausibility can be checked; widths differ by firmware: split on
commas.
"""

from __future__ import annotations

import re
import string
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from shockrig.rig.bench_errors import BenchError

NUMBER = re.compile(rb"[+-]?\d+(?:\.\d*)?")
_ANALOG = re.compile(rb"(?:[ \t]*[+-]?\d+(?:\.\d*)?[ \t]*,){8}[ \t]*")
LETTERS = string.ascii_letters.encode()
LONGEST_LINE = 256
PLAUSIBLE_VALUES = {
    "temperature_c": (-95.0, 80.0),
    "die_temperature_c": (-95.0, 80.0),
    "humidity_percent": (-5.0, 110.0),
    "pressure_hpa": (1.0, 1200.0),
}

# id of the line -> its fields after the id: "name", "name/divisor", or "name:text"
XF: Mapping[str, Sequence[str]] = {
    "0": (
        "pressure_hpa/100",
        "board_temperature_c/100",
        "board_humidity_percent/100",
        "board_humidity_temperature_c/100",
    ),
    "3": ("date:text", "time:text", "latitude_deg/1e7", "longitude_deg/1e7", "altitude_m/1000", "satellites"),
    "5": ("temperature_c/100", "resistance_ohm"),
    "8": ("humidity_percent/10", "die_temperature_c/100"),
    "13": ("temperature_c/100", "resistance_ohm"),
    "17": ("humidity_percent/10", "die_temperature_c/100"),
}
SECOND_BEAD, SECOND_FILM = "13", "17"
SECOND = (SECOND_BEAD, SECOND_FILM)  # never mixed with the unit's own
_XQ_END = ("date:text", "time:text", "longitude_deg/1e7", "latitude_deg/1e7", "altitude_m/1000", "satellites")
XQ2: Mapping[str, Sequence[str]] = {
    "XQ": ("pressure_hpa/100", "temperature_c/100", "humidity_percent/10", "die_temperature_c/100", *_XQ_END)
}
XQ: Mapping[str, Sequence[str]] = {"XQ": ("pressure_hpa/100", "temperature_c/100", "humidity_percent/10", *_XQ_END)}
# What the maker's own application calls the probes of an XF by their ids. How the fields of most are laid out nobody
# says, so that only those of the table above are read; those of the second bead and film are taken for the first ones'.
PROBES: Mapping[str, str] = {
    "1": "EE03", "2": "infrared thermometer", "4": "HTU21D", "5": "NTC A", "6": "CO", "7": "CH4", "8": "HYT-271",
    "13": "NTC B", "14": "EEH210", "15": "PT100", "16": "PT100", "17": "HYT-271 B",
}  # fmt: skip
ANALOG_INPUTS = 8
TABLES = {"imet-xf": XF, "imet-xq2": XQ2, "imet-xq": XQ}


@dataclass(frozen=True)
class Field:
    """One field of a line: the value is the printed number divided by `divisor`; None for text."""

    name: str
    divisor: float | None


class UnknownLine(ValueError):
    """A line whose id is in no table."""


@dataclass(frozen=True)
class LineTable:
    """What the fields of each line mean."""

    lines: Mapping[str, tuple[Field, ...]]

    @classmethod
    def of(cls, lines: Mapping[str, Sequence[str]]) -> LineTable:
        """From id -> ["name/divisor", "name", "name:text"]. Raises BenchError."""
        return cls({key: tuple(_field(key, text) for text in fields) for key, fields in lines.items()})

    def parse(self, line: bytes) -> tuple[str, dict[str, float]]:
        """Id and numbers of a line; empty fields are left out.

        Raises
        ------
        UnknownLine
            No table has this id.
        ValueError
            Wrong number of fields, or a field that is not a number.
        """
        head, *fields = self._own([part.strip(b" \t") for part in line.split(b",")])
        if not head.isascii():
            raise ValueError("not ASCII")
        key = head.decode()
        if key not in self.lines:
            bare = head.lstrip(LETTERS).decode()  # "XF5,..." or "XF,5,..."
            if bare in self.lines:
                key = bare
            elif bare != key and fields and fields[0].decode("ascii", "replace") in self.lines:
                key, fields = fields[0].decode(), fields[1:]
        if key not in self.lines:
            raise UnknownLine(key)
        expected = self.lines[key]
        if len(fields) != len(expected):
            raise ValueError(f"{len(fields)} fields after {key!r}, not {len(expected)}")
        values = {}
        for field, text in zip(expected, fields, strict=True):
            if field.divisor is None or not text:
                continue
            if not NUMBER.fullmatch(text):
                raise ValueError(f"{field.name} is {text!r}, not a number")
            values[field.name] = float(text) / field.divisor
        if values.get("satellites") == 0:  # without a fix the positions are zeros, not measurements
            for name in ("latitude_deg", "longitude_deg", "altitude_m"):
                values.pop(name, None)
        return key, values

    def _own(self, parts: list[bytes]) -> list[bytes]:
        """The fields from the line's id on: what the analog inputs say before it is left out."""
        before, after = parts[:ANALOG_INPUTS], parts[ANALOG_INPUTS:]
        lettered = after and after[0].isalpha() and after[0].decode() in self.lines
        return after if lettered and all(map(NUMBER.fullmatch, before)) else parts

    def names(self, key: str) -> set[str]:
        """What lines of this id tell."""
        return {field.name for field in self.lines[key]}

    def begins(self) -> tuple[bytes, ...]:
        """Starts of lines that letters mark, by which a line glued to a broken one is found."""
        return tuple(key.encode() + b"," for key in self.lines if key[:1].isalpha())


def _field(key: str, text: str) -> Field:
    if text.endswith(":text"):
        return Field(text.removesuffix(":text"), None)
    name, _, divisor = text.partition("/")
    try:
        value = float(divisor or 1)
    except ValueError:
        value = 0.0
    if not name.isidentifier() or not value > 0:
        raise BenchError(f'line {key!r}: field {text!r} is not of the form "name", "name/divisor" or "name:text"')
    return Field(name, value)


def implausible(values: Mapping[str, float]) -> bool:
    """Whether any value is beyond what the instrument could ever say."""
    return any(not low <= values[name] <= high for name, (low, high) in PLAUSIBLE_VALUES.items() if name in values)


@dataclass(frozen=True)
class SerialLine:
    """One line as it arrived, NULs and all, and when its first byte began; `whole` is False for a broken one."""

    raw: bytes
    start_s: float
    whole: bool = True


class LineAssembler:
    """Makes lines of chunks. CR, LF and CRLF all end a line; empty lines and NULs are nothing.

    The first piece after (re)opening is usually the tail of a line and is handed out like any other: its shape decides.
    """

    def __init__(self, begins: Sequence[bytes] = ()) -> None:
        self._begins = begins
        self._partial = b""
        self._start_s = 0.0
        self._overflowing = False

    def feed(self, chunk: bytes, time_s: float, byte_s: float) -> list[SerialLine]:
        """Lines completed by a chunk whose last byte had arrived at `time_s`."""
        lines: list[SerialLine] = []
        first_s = time_s - len(chunk) * byte_s
        for match in re.finditer(rb"([^\r\n]*)([\r\n]?)", chunk):
            piece, end = match[1], match[2]
            if piece and not self._partial.strip(b"\0"):
                skipped = len(piece) - len(piece.lstrip(b"\0"))
                self._start_s = first_s + (match.start() + skipped) * byte_s
            self._partial += piece
            if end:
                lines += self._complete()
            elif len(self._partial) > LONGEST_LINE:
                lines.append(SerialLine(self._partial, self._start_s, whole=False))
                self._partial, self._overflowing = b"", True
        return lines

    def _complete(self) -> list[SerialLine]:
        raw, self._partial = self._partial, b""
        broken, self._overflowing = self._overflowing, False
        if not raw.strip(b"\0"):
            return []
        if broken or len(raw) > LONGEST_LINE:
            return [SerialLine(raw, self._start_s, whole=False)]
        glued = max((raw.rfind(begin) for begin in self._begins), default=-1)
        if glued > 0 and raw[:glued].strip(b"\0") and not _ANALOG.fullmatch(raw[:glued].lstrip(b"\0")):
            return [SerialLine(raw[:glued], self._start_s, whole=False), SerialLine(raw[glued:], self._start_s)]
        return [SerialLine(raw, self._start_s)]
