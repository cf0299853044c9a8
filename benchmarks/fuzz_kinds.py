"""What a file may be instead of what it should be: no file at all, damaged bytes, content of the right form with values
that cannot be; and words that cannot be options or names."""

from __future__ import annotations

import copy
import gzip
import json
import os
import random
import re
import shutil
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fuzz_damage import TOKEN, damage

BIG = 10**400
HOSTILE: tuple[Any, ...] = (
    BIG, -BIG, 10**30, 1e308, -1e308, 1e-320, float("nan"), float("inf"), -1, 0, True, False, None, "", " ", "x", "1e5",
    "NaN", [], {}, [[]], [1], ["stem_conduction"], {"value": [1]}, "../../etc/passwd", "a\0b", "\ud800", "line\nline",
    "<b>&",
    "x" * 5000, [[1] * 50] * 50, 1e9, 1e12, -273.15, 273.15, 0.5, 2**63, "2026-13-01T00:00:00Z",
    "9999-12-31T23:59:59Z",
)  # fmt: skip
CELLS = (
    "", "nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "x", "1,5", "9" * 400, "1e9", "-1e9", "0x10", "1_0", "--",
    "\0", '"', "\u0661", " 5 ", "5;5", "-999", "-9999", "999.9", "2026-05-01T00:00:00", "True", "1e5000", "\ud7ff",
)  # fmt: skip
HOSTILE_WORDS = (
    "nan", "inf", "-inf", "1e309", "-1", "0", "1e-320", "9" * 5000, "", " ", "x", "../..", "/dev/null", "/dev/zero",
    "/",
    "a/b/c", "x" * 300, "x/" * 3000, "\ud800", "a\nb", "%s", "{}", "--", "=", "a=b", "=5", "1e9", "-273.15", "true",
    "[1]",
    "\u0661", "p.json", "c", "f.csv", "o", "temperature=", "=temperature", "temperature=time_s", "alpha 0 %",
    "alpha nan %",
    "minutes -5", "A:B", "A:B:C", "\u00fc\u00f6", "duration_s=nan", "duration_s=1e12", "5,", "1e3",
    "2026-05-01T00:00:00Z",
)  # fmt: skip
NAMES = (
    "\udcff\udcfe", "b\u00fccher", "a b", "a\nb", "x" * 200, "x" * 300, "\u202eevil", "a'b\"c", "%s{}", "*", "c ", "\t",
    "-c",
    "$(ls)", "a;b", "\U0001f600", "CON", ".", "..", "a\\b", "=", "#",
)  # fmt: skip


def _gone(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _as(make: Callable[[Path], object]) -> Callable[[Path], None]:
    def put(path: Path) -> None:
        _gone(path)
        make(path)

    return put


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as one:
        here = os.getcwd()
        os.chdir(path.parent)  # the name of a socket is short
        try:
            one.bind(path.name)
        finally:
            os.chdir(here)


def _sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(1 << 40)


def _locked(path: Path) -> None:
    if not os.path.lexists(path):
        path.mkdir()
    os.chmod(path, 0)


THINGS: dict[str, Callable[[Path], None]] = {
    "a pipe": _as(os.mkfifo),
    "a socket": _as(_socket),
    "a folder": _as(Path.mkdir),
    "a full folder": _as(lambda path: (path / "a/b/report.html").mkdir(parents=True)),
    "endless": _as(lambda path: path.symlink_to("/dev/zero")),
    "a full disk": _as(lambda path: path.symlink_to("/dev/full")),
    "a terminal": _as(lambda path: path.symlink_to("/dev/ptmx")),
    "a circle": _as(lambda path: path.symlink_to(path.name)),
    "a link to nothing": _as(lambda path: path.symlink_to("none")),
    "a link to itself through a folder": _as(lambda path: path.symlink_to("..")),
    "gone": _gone,
    "empty": _as(lambda path: path.write_bytes(b"")),
    "a terabyte": _as(_sparse),
    "zeros": _as(lambda path: path.write_bytes(bytes(1 << 20))),
    "one long line": _as(lambda path: path.write_bytes(b"1" * (1 << 21))),
    "many brackets": _as(lambda path: path.write_bytes(b"[" * 200_000)),
    "a picture": _as(lambda path: path.write_bytes(b"\x89PNG\r\n\x1a\n" + random.Random(1).randbytes(4000))),
    "locked": _locked,
}
BYTES: dict[str, Callable[[random.Random, bytes], bytes]] = {
    "damaged": lambda rng, data: damage(rng, data),
    "damaged often": lambda rng, data: damage(rng, damage(rng, damage(rng, damage(rng, data)))),
    "cut": lambda rng, data: data[: rng.randrange(len(data))],
    "twice": lambda rng, data: data + data,
    "as UTF-16": lambda rng, data: data.decode("latin-1").encode("utf-16"),
    "with a mark": lambda rng, data: b"\xef\xbb\xbf" + data,
    "with CR": lambda rng, data: data.replace(b"\n", b"\r"),
    "with CRLF": lambda rng, data: data.replace(b"\n", b"\r\n"),
    "packed": lambda rng, data: gzip.compress(data),
    "behind noise": lambda rng, data: rng.randbytes(200) + data,
    "followed by noise": lambda rng, data: data + rng.randbytes(200),
    "with semicolons": lambda rng, data: data.replace(b".", b";").replace(b",", b".").replace(b";", b","),
    "reversed": lambda rng, data: b"\n".join(reversed(data.split(b"\n"))),
}


def structured(rng: random.Random, name: str, data: bytes) -> bytes:
    """Content of the right form with something in it that cannot be, by the file's name."""
    if name.endswith((".json", ".sealed")):
        return _json(rng, data)
    if name.endswith(".csv"):
        return _csv(rng, data)
    tokens = [t for t in TOKEN.finditer(data) if re.match(rb'[-+\d"]', t[0])]
    if not tokens:
        return damage(rng, data)
    for token in sorted(rng.sample(tokens, min(len(tokens), rng.choice((1, 1, 2, 6)))), key=lambda t: -t.start()):
        value = _literal(rng.choice(HOSTILE)).encode("utf-8", "surrogatepass")
        data = data[: token.start()] + value + data[token.end() :]
    return data


def _literal(value: Any) -> str:
    """A value as JSON and TOML have it, as far as they can."""
    if isinstance(value, float) and (value != value or value in (float("inf"), float("-inf"))):
        return str(value)
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value)
    return json.dumps(value)


def _json(rng: random.Random, data: bytes) -> bytes:
    content = json.loads(data)
    for _ in range(rng.choice((1, 1, 2, 4))):
        if not content:
            break
        holder, key = rng.choice(_places(content))
        match rng.randrange(6):
            case 0:
                del holder[key]
            case 1 if isinstance(holder, dict):
                holder[str(key) + rng.choice(("_", "s", " ", "\0"))] = holder.pop(key)
            case 2 if isinstance(holder[key], float | int) and not isinstance(holder[key], bool):
                holder[key] = holder[key] * rng.choice((-1, 0, 1e3, 1e-3, 1e12, 1e300, 1e-300))
            case 3 if isinstance(holder, list):
                holder *= 3
            case _:
                holder[key] = copy.deepcopy(rng.choice(HOSTILE))
    return json.dumps(content).encode()


def _places(content: Any) -> list[tuple[Any, Any]]:
    found: list[tuple[Any, Any]] = []
    keys = content if isinstance(content, dict) else range(len(content)) if isinstance(content, list) else ()
    for key in keys:
        found.append((content, key))
        found += _places(content[key])
    return found


def _csv(rng: random.Random, data: bytes) -> bytes:
    rows = [line.split(",") for line in data.decode("utf-8", "replace").splitlines()]
    column, row = rng.randrange(len(rows[0])), rng.randrange(1, len(rows))
    match rng.randrange(11):
        case 0 | 1:
            rows[row][min(column, len(rows[row]) - 1)] = rng.choice(CELLS)
        case 2:
            cell = rng.choice(CELLS)
            for one in rows[1:]:
                one[min(column, len(one) - 1)] = cell
        case 3:
            rows[0][column] = rng.choice(("", "x", rows[0][0], rows[0][-1], "time_s", "\0", " " + rows[0][column]))
        case 4:
            factor = rng.choice((1e3, 1e-3, 1e9, 1e-9, -1.0, 0.0, 1e300))
            for one in rows[1:]:
                one[column] = _times(one[column], factor)
        case 5:
            rows = rows[: rng.choice((1, 2, 3, 4))]
        case 6:
            rows = [rows[0], *sorted(rows[1:], key=lambda _: rng.random())]
        case 7:
            rows = [one[:column] + one[column + 1 :] for one in rows]
        case 8:
            rows[row:row] = [rows[row]] * rng.choice((1, 50))
        case 9:
            step = rng.choice(("1e9", "-1e9", "1e-9", "3600", "1e15"))
            for one in rows[row:]:
                one[0] = _plus(one[0], float(step))
        case _:
            rows[row] = rows[row] * rng.choice((0, 2, 500))
    return ("\n".join(map(",".join, rows)) + "\n").encode("utf-8", "replace")


def _times(cell: str, factor: float) -> str:
    try:
        return repr(float(cell) * factor)
    except ValueError:
        return cell


def _plus(cell: str, shift: float) -> str:
    try:
        return repr(float(cell) + shift)
    except ValueError:
        return cell
