"""What can go wrong with some bytes, and what a reader must not do with them."""

from __future__ import annotations

import math
import random
import re
from typing import Any

TOKEN = re.compile(rb'"[^"\n]*"|[-+]?\d[\d.eE+-]*|[A-Za-z_]\w*|\S')
HOSTILE = (
    b"-1", b"0", b"-0.0", b"1e308", b"1e999", b"-1e999", b"5e-324", b"NaN", b"nan", b"inf", b"Infinity", b"null",
    b"true", b"false", b'""', b'"x"', b"[]", b"{}", b"[[]]", b"9" * 400, b"9" * 5000, b"0x28", b"1_0", b"1,5",
    b"\xff", b"\0", b'"\\u0000"', b'"../../etc"', b'"<script>"', "\u0661\u0662".encode(), b"1979-05-27",
    b"07:32:00", b"[" * 3000, b"{" * 20, b",", b"\n", b"\r", b'"', b"=", b"1e-400", b"273.15", b"-273.15",
    b"100.0000001",
)  # fmt: skip


def damage(rng: random.Random, data: bytes, others: tuple[bytes, ...] = ()) -> bytes:
    """One to three things that go wrong with some bytes."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        at = rng.randrange(len(data) + 1)
        match rng.randrange(9 if others else 8):
            case 0 if data:
                at = min(at, len(data) - 1)
                data = data[:at] + bytes((data[at] ^ 1 << rng.randrange(8),)) + data[at + 1 :]
            case 1:
                data = data[:at] + data[at + rng.randrange(1, 9) :]
            case 2:
                data = data[:at] + rng.randbytes(rng.randrange(1, 5)) + data[at:]
            case 3:
                data = data[:at]
            case 4:
                data = data[:at] + data[max(0, at - rng.randrange(1, 40)) :]
            case 5 | 6 | 7:
                tokens = list(TOKEN.finditer(data))
                if tokens:
                    token = rng.choice(tokens)
                    data = data[: token.start()] + rng.choice(HOSTILE) + data[token.end() :]
            case 8:
                data = data[:at] + rng.choice(others)[rng.randrange(20) :]
    return data


class Forbidden(Exception):
    """A reader accepted what its format forbids."""


def demand(holds: bool, what: str) -> None:
    if not holds:
        raise Forbidden(what)


def finite(*values: Any) -> bool:
    return all(isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v) for v in values)
