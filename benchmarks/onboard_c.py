"""Do the generated programs give the reference's numbers? C99 and Lua on the flights of flight_harm.py, and fuzzed.

    python benchmarks/onboard_c.py [--kinds NAME ...] [--seeds N] [--rows N] [--out FILE.jsonl] [--lua LUA] [--fuzz N]

C is built with -std=c99 -Wall -Wextra -Werror -pedantic and the address and undefined-behaviour sanitizers. A line a
kind: largest differences of values and uncertainties from the causal corrector in double precision, and values that one
of both gave alone. With --rows N a flight is so many rows of it, from a place that its seed draws. With --lua NAME an
interpreter runs the Lua file on the same rows. --fuzz N feeds N random rows (numbers of any size, NaN, infinities,
repeats, clocks that jump) and counts what is no number where a value is given.
"""

from __future__ import annotations

import argparse
import hashlib
import subprocess
import sys
import tempfile
import zlib
from functools import partial
from pathlib import Path

import numpy as np
from flight_harm import profile_of
from flight_kinds import KINDS
from flight_worlds import fly
from resumed import kept, scored

from shockrig.analysis.flight.causal import rows_of
from shockrig.analysis.flight.causal_design import Design
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.analysis.onboard import c_source, flown, lua_source
from shockrig.files.flight import Flight
from shockrig.protocols.onboard_check import STRICT, build, compiler, difference, reference, run

SANITIZED = (*STRICT, "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
MOST_K, MOST_PERCENT = 0.01, 0.05
FUZZ = Path(__file__).with_name("onboard_fuzz.c")
LUA_MAIN = """
local shock = require("shock_correct")
local state = shock.begin()
for line in io.lines() do
  local cells = {}
  for cell in (line .. ","):gmatch("([^,]*),") do cells[#cells + 1] = tonumber(cell) or false end
  local row = {temperature_c = cells[2] or nil, humidity_percent = cells[3] or nil}
  local air = {temperature_flags = 4, humidity_flags = 4}
  if cells[1] then
    row.time_ms = math.tointeger(cells[1])
    air = shock.step(state, row)
  end
  local function show(x) return x and string.format("%.6f", x) or "nan" end
  print(show(air.temperature_c), show(air.temperature_uncertainty_k), show(air.humidity_percent),
    show(air.humidity_uncertainty_percent))
end
"""


def flight_of(name: str, seed: int) -> tuple[Flight, object]:
    """A flight of that kind, and the lab's profile of its sensors."""
    world = KINDS[name](np.random.default_rng([seed, zlib.crc32(name.encode())]))
    log = fly(world, seed + zlib.crc32(name.encode())).log
    log = {key: np.round(values, 9) for key, values in log.items()}
    unknown = np.full(log["time_s"].size, np.nan)
    return Flight(log["time_s"], log["temperature_c"], log["humidity_percent"], *[unknown] * 3), profile_of(world)


def by_lua(lua: str, folder: Path, flight: Flight) -> np.ndarray:
    (folder / "main.lua").write_text(LUA_MAIN)
    lines = []
    for row in rows_of(flight):
        time = "" if np.isnan(row.time_s) else str(round(row.time_s * 1000))
        cells = ["" if np.isnan(v) else repr(v) for v in (row.temperature_c, row.humidity_percent)]
        lines.append(",".join([time, *cells]))
    done = subprocess.run(
        [lua, "main.lua"], input="\n".join(lines) + "\n", capture_output=True, text=True, check=True, cwd=folder
    )
    return np.genfromtxt(done.stdout.splitlines(), ndmin=2)


def built(design: Design, cc: str, place: Path) -> Path:
    """The folder of a design's programs in a place; flights of one profile fly the same ones."""
    texts = c_source(design, "profile", "benchmark") | {"shock_correct.lua": lua_source(design, "p")}
    folder = place / hashlib.sha256("".join(texts.values()).encode()).hexdigest()[:16]
    if not folder.exists():
        folder.mkdir()
        for file, text in texts.items():
            (folder / file).write_text(text)
        build(folder, cc, folder, SANITIZED)
    return folder


def stretch(flight: Flight, rows: int, rng: np.random.Generator) -> Flight:
    """So many rows of a flight, from anywhere in it."""
    first = int(rng.integers(max(flight.time_s.size - rows, 0) + 1))
    names = ("time_s", "temperature_c", "humidity_percent", "airspeed_m_s", "pressure_hpa", "die_temperature_c")
    return Flight(*(getattr(flight, name)[first : first + rows] for name in names))


def score(name: str, seed: int, cc: str, lua: str | None, place: Path, rows: int | None) -> dict:
    """One flight through the programs and the reference."""
    flight, profile = flight_of(name, seed)
    design = flown(profile, typical_period(flight.time_s[np.isfinite(flight.time_s)]))
    if rows is not None:
        flight = stretch(flight, rows, np.random.default_rng([seed, zlib.crc32(name.encode()), rows]))
    folder = built(design, cc, place)
    wanted = reference(design, flight)
    line = {"kind": name, "seed": seed}
    found = {"C": run(folder / "shock_csv", flight)}
    if lua is not None:
        found["Lua"] = by_lua(lua, folder, flight)
    for what, values in found.items():
        one = difference(values, wanted)
        line |= {f"{what} {key}": value for key, value in vars(one).items()}
        off = np.abs(values[:, :4] - wanted)
        line[f"{what} rows beyond"] = int(np.sum((off[:, 0] > MOST_K) | (off[:, 2] > MOST_PERCENT)))
    return line


def fuzz(rows: int, cc: str, options: tuple[str, ...]) -> None:
    """Random rows through a build of the typical profile."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for file, text in c_source(flown(typical_profile()), "typical", "benchmark").items():
            (folder / file).write_text(text)
        sources = [str(FUZZ), str(folder / "shock_correct.c")]
        command = [cc, *options, f"-I{folder}", "-o", str(folder / "fuzz"), *sources, "-lm"]
        subprocess.run(command, check=True)
        print(subprocess.run([str(folder / "fuzz"), str(rows)], stdout=subprocess.PIPE, text=True).stdout)


def table(lines: list[dict]) -> None:
    for what in [name for name in ("C", "Lua") if any(f"{name} rows" in line for line in lines)]:
        columns = ("K", "u, K", "%RH", "u, %RH")
        names = "".join(f"{column:>10}" for column in columns)
        print(f"{what:<22}{'flights':>7}{'rows':>9}{names}{'beyond':>7}{'alone':>7}")
        keys = ("temperature_k", "temperature_uncertainty_k", "humidity_percent", "humidity_uncertainty_percent")
        own = [line for line in lines if f"{what} rows" in line]
        for name in [*dict.fromkeys(line["kind"] for line in own), "all"]:
            flights = [line for line in own if name in (line["kind"], "all")]
            largest = "".join(f"{max(f[f'{what} {key}'] for f in flights):>10.5f}" for key in keys)
            rows, beyond, alone = (
                sum(f[f"{what} {key}"] for f in flights) for key in ("rows", "rows beyond", "one_sided")
            )
            print(f"{name:<22}{len(flights):>7}{rows:>9}{largest}{beyond:>7}{alone:>7}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="+", default=list(KINDS))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--rows", type=int, help="of each flight, from a place that its seed draws")
    parser.add_argument("--lua", help="an interpreter of Lua 5.3")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--fuzz", type=int, default=0)
    parser.add_argument(
        "--plain", action="store_true", help="fuzz a build without sanitizers, which is ten times as fast"
    )
    parser.add_argument("--table", type=Path, help="print what this file holds, and fly nothing")
    args = parser.parse_args()
    if args.table:
        table(kept(args.table))
        return 0
    cc = compiler()
    if cc is None:
        sys.exit("no C compiler on this computer")
    if args.fuzz:
        fuzz(args.fuzz, cc, STRICT if args.plain else SANITIZED)
        return 0
    jobs = [(name, seed) for seed in range(args.first_seed, args.first_seed + args.seeds) for name in args.kinds]
    with tempfile.TemporaryDirectory() as made:
        place = Path(made)
        flown_one = partial(score, cc=cc, lua=args.lua, place=place, rows=args.rows)
        table(scored(args.out, jobs, ("kind", "seed"), lambda name, seed: [flown_one(name, seed)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
