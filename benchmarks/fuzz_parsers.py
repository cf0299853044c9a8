"""Mutated lines, frames and files through every parser and reader: only documented errors, nothing forbidden accepted.

    python benchmarks/fuzz_parsers.py [--count 1000000] [--seed 0] [--only TARGET]

Each target takes sound input, damages it (bytes flipped, cut, doubled, spliced; numbers, words and keys replaced by
hostile ones) and holds what is accepted against rules written here from the formats, not taken from the readers.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import re
import sys
import tempfile
import time
import traceback
import warnings
import zlib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
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


@dataclass(frozen=True)
class Target:
    """`make(rng)` gives a function that tries one damaged input and returns whether something was accepted."""

    share: float
    documented: tuple[type[Exception], ...]
    make: Callable[[random.Random, Path], Callable[[], bool]]


def imet(rng: random.Random, folder: Path) -> Callable[[], bool]:
    from shockrig.rig.sensors.imet_lines import TABLES, LineAssembler, LineTable, implausible

    lines = (
        b"XQ,+095188,+2407,+0294,+2553,2015/10/18,00:38:44,+0000000000,+0000000000,-00017000,00\r\n",
        b"5,2512,5376\r\n", b"8,452,2012\r\n", b"0,101325,2500,4000,2500\r\n", b"3,2015/10/18,00:00:00,0,0,0,0\r\n",
        b"XF5,2512,5376\r\n", b"XQ,+095188,+2407,+0294,2015/10/18,00:38:44,+0,+0,-00017000,00\n",
    )  # fmt: skip
    tables = [LineTable.of(table) for table in TABLES.values()]
    number = re.compile(r"[+-]?[0-9]+(\.[0-9]*)?", re.ASCII)

    def one() -> bool:
        table = rng.choice(tables)
        text = damage(rng, b"".join(rng.choice(lines) for _ in range(rng.randrange(1, 4))), lines)
        assembler, at, found = LineAssembler(table.begins()), 0, []
        while at < len(text):
            size = rng.randrange(1, 60)
            found += assembler.feed(text[at : at + size], at / 5760, 1 / 5760)
            at += size
        accepted = False
        for line in found:
            demand(b"\n" not in line.raw and b"\r" not in line.raw, "a line holds a line end")
            demand(-0.1 < line.start_s <= at / 5760, "a line began before its first byte")
            if not line.whole:
                continue
            raw = line.raw.replace(b"\0", b"")
            try:
                key, values = table.parse(raw)
            except ValueError:
                continue
            accepted = True
            cells = raw.strip(b" \t").decode("latin-1").split(",")
            expected = table.lines[key]
            demand(len(cells) - 1 in (len(expected), len(expected) + 1), f"wrong number of fields: {raw!r}")
            demand(cells[0].lstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz") in (key, "")
                   or cells[0] == key, f"another line's id: {raw!r}")  # fmt: skip
            told = dict(zip([f.name for f in expected], cells[-len(expected) :], strict=True))
            for name, value in values.items():
                demand(number.fullmatch(told[name]) is not None, f"{name} from {told[name]!r}")
                divisor = next(f.divisor for f in expected if f.name == name)
                demand(finite(value) or implausible(values) or name not in ("temperature_c",), f"{name} {value}")
                demand(not finite(value) or abs(value * divisor - float(told[name])) <= 1e-9 * abs(float(told[name])),
                       f"{name} is {value} from {told[name]!r}")  # fmt: skip
        return accepted

    return one


def frames(rng: random.Random, folder: Path) -> Callable[[], bool]:
    from shockrig.rig.seams import Outcome
    from shockrig.rig.sensors.hyt271 import decode_frame

    def one() -> bool:
        frame = rng.randbytes(4 if rng.random() < 0.8 else rng.randrange(7))
        if rng.random() < 0.3:
            frame = damage(rng, rng.choice((b"\x20\x00\x5d\x18", bytes(4), b"\xff" * 4, b"\x60\x01\x5d\x18")))
        outcome, values = decode_frame(frame)
        if outcome in (Outcome.OK, Outcome.STALE):
            word = int.from_bytes(frame, "big")
            demand(len(frame) == 4 and not word >> 31 and word != 0, f"accepted {frame.hex()}")
            demand((outcome is Outcome.STALE) == bool(word >> 30 & 1), f"stale bit of {frame.hex()}")
            demand(0 <= values["humidity_percent"] <= 100 and -40 <= values["temperature_c"] <= 125, frame.hex())
            demand(round(values["humidity_percent"] * 163.83) == word >> 16 & 0x3FFF, frame.hex())
            demand(round((values["temperature_c"] + 40) * 16383 / 165) == word >> 2 & 0x3FFF, frame.hex())
            return True
        demand(not values, f"values without a reading: {frame.hex()}")
        return False

    return one


def journals(rng: random.Random, folder: Path) -> Callable[[], bool]:
    from shockrig.rig.journal import read_journal
    from shockrig.rig.recorder import Recorder, read_run
    from shockrig.rig.recorder.run import JOURNAL
    from shockrig.rig.seams import Air, Move, Outcome, Reading

    run = folder / "journal"
    run.mkdir(exist_ok=True)
    (run / JOURNAL).unlink(missing_ok=True)
    recorder = Recorder(run, {"id": "0001", "sensors": ["imet"]}, 0.0, None)
    recorder.zero(1.0, "2026-01-01T00:00:00Z")
    recorder.air(1.0, "source", Air(20.0, None))
    for i in range(6):
        recorder.reading(Reading("imet", Outcome.OK, i, i + 0.1, {"temperature_c": 20.0 + i}, b"5,2", float(i)))
    recorder.move(Move(2.0, 2.5))
    recorder.end(9.0, "complete")
    content = (run / JOURNAL).read_bytes()
    lines = content.splitlines(keepends=True)

    def one() -> bool:
        if rng.random() < 0.5:  # records that are whole, but hold something else
            records = [json.loads(line[9:]) for line in lines]
            texts = [json.dumps(record).encode() for record in records]
            hit = rng.randrange(len(texts))
            texts[hit] = damage(rng, texts[hit]).replace(b"\n", b"")
            data = b"".join(b"%08x %b\n" % (zlib.crc32(text), text) for text in texts)
        else:
            data = damage(rng, content, tuple(lines))
        (run / JOURNAL).write_bytes(data)
        journal = read_journal(run / JOURNAL)
        for record in journal.records:
            demand(isinstance(record, list) and bool(record), "a record that is no list")
        demand(len(journal.records) + journal.damaged_lines == data.count(b"\n"), "lines are not accounted for")
        whole = (line for line in data.split(b"\n") if re.fullmatch(rb"[0-9a-fA-F]{8} .*", line, re.DOTALL))
        intact = sum(int(line[:8], 16) == zlib.crc32(line[9:]) for line in whole)
        demand(len(journal.records) <= intact, "a record with a wrong checksum")
        record = read_run(run)
        for readings in record.readings.values():
            for reading in readings:
                demand(finite(reading.requested_s, reading.time_s), f"times {reading}")
                demand(reading.sampled_s is None or finite(reading.sampled_s), f"time {reading}")
                demand(isinstance(reading.values, dict) and finite(*reading.values.values()), f"values {reading}")
        demand(record.zero_s is None or finite(record.zero_s), "zero")
        demand(record.move is None or finite(record.move.start_s), "move")
        for airs in record.airs.values():
            for air in airs:
                demand(all(v is None or finite(v) for v in (air.temperature_c, air.humidity_percent)), f"air {air}")
        return True

    return one


def grbl(rng: random.Random, folder: Path) -> Callable[[], bool]:
    from shockrig.rig.clock import VirtualClock
    from shockrig.rig.stages.grbl import GrblSettings, GrblStage

    lines = (
        b"<Run|MPos:12.000,0.000,0.000|FS:600,0|Pn:X>\r\n", b"<Idle|MPos:-300.000,0.000,0.000|FS:0,0>\r\n", b"ok\r\n",
        b"error:9\r\n", b"ALARM:1\r\n", b"[MSG:Caution: Unlocked]\r\n", b"<Hold:0|MPos:5.000,0.000,0.000|FS:0,0>\r\n",
        b"Grbl 1.1h ['$' for help]\r\n",
    )  # fmt: skip
    report = re.compile(rb"<[A-Za-z]+(:[0-9])?\|MPos:-?[0-9]+(\.[0-9]+)?[^>]*>")

    class Port:
        byte_s = 1e-4
        data = b""

        def read_waiting(self) -> bytes:
            data, self.data = self.data, b""
            return data

    port = Port()
    stage = GrblStage(GrblSettings("fuzz", 0, 300, 6000), port, VirtualClock(), None)

    def one() -> bool:
        port.data = damage(rng, b"".join(rng.choice(lines) for _ in range(rng.randrange(1, 4))), lines)
        stage._partial, accepted = b"", False
        for line in stage._lines():
            stage._asked_s = 0.0
            found = stage._report(line)
            if found is not None:
                accepted = True
                demand(report.fullmatch(line) is not None, f"took {line!r}")
                demand(finite(found.position_mm), f"position of {line!r}")
        return accepted

    return one


def benches(rng: random.Random, folder: Path) -> Callable[[], bool]:
    from shockrig.rig.bench_file import load_bench

    texts = tuple(path.read_bytes() for path in sorted((ROOT / "data" / "benches").glob("*.toml")))
    file = folder / "bench.toml"

    def one() -> bool:
        file.write_bytes(damage(rng, rng.choice(texts), texts))
        config = load_bench(file)
        demand(bool(config.sensors) and set(config.sensors) <= {"imet", "hyt"}, "sensors")
        for settings in (config.general, *(part.settings for part in config.parts().values())):
            for entry in fields(settings):
                value = getattr(settings, entry.name)
                if isinstance(value, int | float) and not isinstance(value, bool):
                    demand(finite(value), f"{entry.name} = {value}")
                    if entry.name.endswith(("_s", "_m", "_hpa", "_mm_min", "baud")):
                        demand(value >= 0, f"{entry.name} = {value}")
                    if entry.name == "address":
                        demand(0 <= value <= 0x7F, f"address {value}")
        demand(config.general.clock in ("real", "virtual"), "clock")
        return True

    return one


def protocols(rng: random.Random, folder: Path) -> Callable[[], bool]:
    from shockrig.rig.protocol import Record, Soak, Transfer, parse_protocol

    texts = tuple((ROOT / "data" / "protocols" / f"{name}.toml").read_bytes() for name in ("quick", "manual"))

    def one() -> bool:
        plan = parse_protocol(damage(rng, rng.choice(texts), texts), "fuzz.toml")
        demand(bool(plan.runs) and len({run.id for run in plan.runs}) == len(plan.runs), "runs")
        demand(all(re.fullmatch(r"[A-Za-z0-9_-]+", run.id) for run in plan.runs), f"ids {[r.id for r in plan.runs]}")
        demand(0 <= plan.faults.repeat_at_most <= 100 and plan.faults.largest_gap_s > 0, f"{plan.faults}")
        for run in plan.runs:
            for air in (run.source, run.destination):
                demand(finite(air.temperature_c, air.humidity_percent), f"{air}")
                demand(-100 <= air.temperature_c <= 150 and 0 <= air.humidity_percent <= 100, f"{air}")
            demand(run.airflow_m_s is None or (finite(run.airflow_m_s) and run.airflow_m_s >= 0), f"{run.airflow_m_s}")
            kinds = [type(step) for step in run.steps]
            demand(kinds[0] is Soak and kinds.count(Transfer) == 1 and kinds[-1] is Record, f"{kinds}")
            for step in run.steps:
                demand(all(finite(v) and v > 0 for v in vars(step).values()), f"{step}")
            demand(finite(run.longest_s(), run.shortest_s()), "length")
        return True

    return one


def profiles(rng: random.Random, folder: Path) -> Callable[[], bool]:
    from shockrig.analysis.flight.typical import typical_profile
    from shockrig.files.profile import profile_document, read_profile

    document = profile_document(typical_profile())
    document["temperature"]["effects"] = [
        {"effect": "stem_conduction", "probability": 0.99, "parameters": {"fraction": {"value": 0.03}}}
    ]
    text = json.dumps(document, indent=1).encode()
    file = folder / "profile.json"

    def one() -> bool:
        file.write_bytes(damage(rng, text))
        profile = read_profile(file)
        demand(profile.temperature is not None or profile.humidity is not None, "neither part")
        _all_finite(profile.temperature)
        if profile.temperature is not None:
            alpha = profile.temperature.thermal_diffusivity_m2_s
            demand(
                alpha.value > 0 and alpha.standard_uncertainty >= 0 and profile.temperature.bead_radius_m > 0, "alpha"
            )
        if profile.humidity is not None:
            rows = profile.humidity.diffusivity_table
            demand(bool(rows) and profile.humidity.film_thickness_m > 0, "table")
            ambients = [row.ambient_temperature_c for row in rows]
            demand(ambients == sorted(set(ambients)) and finite(*ambients), f"ambients {ambients}")
            demand(all(finite(row.diffusivity_m2_s) and row.diffusivity_m2_s > 0 for row in rows), "D")
            demand(all(row.standard_uncertainty >= 0 for row in rows), "uncertainty")
        return True

    return one


def diagnoses(rng: random.Random, folder: Path) -> Callable[[], bool]:
    from shockrig.files.diagnosis import read_diagnosis

    estimate = {"value": 1.4, "standard_uncertainty": 0.1}
    cause = {"effect": "stem_conduction", "probability": 0.99, "parameters": {"time_constant_s": estimate}}
    unlisted = {
        "behaves_as": "lag_in_series", "driver": "air_humidity", "time_constant_s": estimate,
        "size": {**estimate, "unit": "1"}, "depends_on": [{"factor": "airflow", "form": "power", **estimate}],
        "nearest_catalogued": {"effect": "stem_conduction", "likeness": 0.9}, "probability": 0.97,
        "seen_over": {"airflow_m_s": [2.5, 12.0]},
    }  # fmt: skip
    gain = {"held_out_rmse_before": 0.21, "held_out_rmse_after": 0.02, "interval_95": [0.98, 1.0]}
    left = {"rms": 0.1, "peak": 0.2, "unit": "K", "significant": True, "material": False, "tolerance": 0.03}
    channels = {
        "temperature": {"verdict": "explained", "causes": [cause], "gain": gain, "remainder": left},
        "humidity": {"verdict": "described", "causes": [], "discovered": [unlisted | {"alternatives": [unlisted]}]},
    }
    text = json.dumps({"format": "shock-diagnosis/1", "campaign": "x", "channels": channels}, indent=1).encode()
    file = folder / "diagnosis.json"

    def one() -> bool:
        file.write_bytes(damage(rng, text))
        found = read_diagnosis(file)
        demand(bool(found.channels) and set(found.channels) <= {"temperature", "humidity"}, "channels")
        for channel in found.channels.values():
            demand(channel.verdict in (None, "adequate", "explained", "described", "unexplained"), "verdict")
            _all_finite((channel.causes, channel.discovered, channel.gain, channel.remainder))
            for effect in (*channel.causes, *channel.discovered):
                demand(effect.probability is None or 0 <= effect.probability <= 1, "probability")
            for stated in (value for effect in channel.causes for value in effect.parameters.values()):
                demand(stated.standard_uncertainty >= 0, "uncertainty")
            if channel.gain is not None and channel.gain.interval_95 is not None:
                demand(channel.gain.interval_95[0] <= channel.gain.interval_95[1], "interval")
        return True

    return one


def _all_finite(part: Any) -> None:
    if is_dataclass(part):
        for entry in fields(part):
            _all_finite(getattr(part, entry.name))
    elif isinstance(part, tuple | list):
        for entry in part:
            _all_finite(entry)
    elif isinstance(part, Mapping):
        for entry in part.values():
            _all_finite(entry)
    elif isinstance(part, float):
        demand(math.isfinite(part), f"{part}")


def campaigns(rng: random.Random, folder: Path) -> Callable[[], bool]:
    import numpy as np

    from shockrig.files.campaign import read_campaign

    path = folder / "campaign"
    (path / "runs" / "0001").mkdir(parents=True, exist_ok=True)
    run = {
        "format": "shock-run/1", "id": "0001", "started_at": "2026-05-01T00:00:00Z",
        "source": {"temperature_c": 40.0, "humidity_percent": 20.0},
        "destination": {"temperature_c": 20.0, "humidity_percent": 55.0},
        "airflow_m_s": 6.0, "pressure_hpa": 1013.25, "transfer": {"start_s": 1.53, "duration_s": 0.4},
        "reference": {"temperature_time_constant_s": 0.05, "humidity_standard_uncertainty_percent": 0.3},
    }  # fmt: skip
    sensors = {
        "imet": {"kind": "imet-xf", "bead_radius_m": 4e-4, "body": "cylinder_mean"},
        "hyt": {"kind": "hyt-271", "film_thickness_m": 1e-5},
    }
    sound = {
        "campaign.json": json.dumps({"format": "shock-campaign/1", "name": "x", "sensors": sensors}).encode(),
        "runs/0001/run.json": json.dumps(run, indent=1).encode(),
        "runs/0001/imet.csv": b"time_s,temperature_c\n"
        + b"".join(b"%.4f,%.2f\n" % (i / 10, 40 - i) for i in range(20)),
        "runs/0001/hyt.csv": b"time_s,humidity_percent,temperature_c,stale\n"
        + b"".join(b"%.4f,%.4f,20.1,%d\n" % (i / 10, 20 + i, i % 7 == 0) for i in range(20)),
        "runs/0001/air.csv": b"time_s,temperature_c,airflow_m_s\n"
        + b"".join(b"%.4f,%.4f,%s\n" % (i / 10, 40 - i, b"6.0" if i % 3 else b"") for i in range(20)),
    }

    def one() -> bool:
        hit = rng.choice(list(sound))
        for name, content in sound.items():
            (path / name).write_bytes(damage(rng, content) if name == hit else content)
        campaign = read_campaign(path)
        demand(finite(campaign.bead_radius_m, campaign.film_thickness_m), "lengths")
        demand(campaign.bead_radius_m > 0 and campaign.film_thickness_m > 0, "lengths")
        bodies = {"sphere", "film", "sphere_mean", "cylinder", "cylinder_mean", "plate", "lumped"}
        demand(set(campaign.bodies) == {"imet", "hyt"} and set(campaign.bodies.values()) <= bodies, "bodies")
        for one_run in campaign.runs:
            for air in (one_run.source, one_run.destination):
                demand(
                    air.temperature_c is None or (finite(air.temperature_c) and air.temperature_c > -273.15), f"{air}"
                )
                demand(air.humidity_percent is None or -1 <= air.humidity_percent <= 120, f"{air}")
            for value in (one_run.airflow_m_s, one_run.start_s, one_run.duration_s, one_run.pressure_hpa):
                demand(value is None or finite(value), f"{value}")
            demand(one_run.pressure_hpa > 0, "pressure")
            for trace in (one_run.imet, one_run.hyt):
                if trace is not None:
                    demand(bool(np.all(np.isfinite(trace.time_s)) and np.all(np.diff(trace.time_s) > 0)), "times")
                    main = "humidity_percent" if trace is one_run.hyt else "temperature_c"
                    demand(bool(np.all(np.isfinite(trace.values[main]))), "values")
                    demand(all(v.shape == trace.time_s.shape for v in trace.values.values()), "shapes")
            reference = vars(one_run.reference).values()
            demand(finite(*reference) and min(reference) >= 0, f"{one_run.reference}")
            if one_run.air is not None:
                air = np.array(list(one_run.air.values.values()))
                demand(one_run.air.time_s.size >= 2 and bool(np.all(np.diff(one_run.air.time_s) > 0)), "air's times")
                demand(air.size > 0 and not np.any(np.isinf(air)), "air's values")
                demand(bool(np.all(np.isfinite(air).any(axis=0)) and np.all(np.isfinite(air).any(axis=1))), "empty air")
        return True

    return one


def flights(rng: random.Random, folder: Path) -> Callable[[], bool]:
    import numpy as np

    from shockrig.files.flight import read_layout
    from shockrig.files.flight_rows import read_blocks, to_flight
    from shockrig.protocols.flight_world import read_flown_air

    xq2 = b"XQ,095188,2407,0294,2553,2015/10/18,00:38:44,+0000000000,+0000000000,-00017000,00\r\n"
    rows = b"".join(b"%.1f,%.2f,%.3f,6.0,1013.2,%d\n" % (i / 10, 20 - i / 9, 40 + i, i) for i in range(15))
    sound = (
        b"time_s,temperature_c,humidity_percent,airspeed_m_s,pressure_hpa,altitude_m\n" + rows,
        b"Timestamp,Temp,RH,ARSP,P,note\n" + rows,
        xq2 * 5,
    )
    file = folder / "flight.csv"

    def one() -> bool:
        file.write_bytes(damage(rng, rng.choice(sound), sound))
        if rng.random() < 0.5:
            air = read_flown_air(file)
            values = (air.time_s, air.temperature_c, air.humidity_percent, air.airspeed_m_s, air.pressure_hpa)
            demand(all(np.all(np.isfinite(v)) for v in values), "air that is no number")
            demand(bool(np.all((air.humidity_percent >= 0) & (air.humidity_percent <= 100))), "humidity")
            demand(air.time_s.size >= 2, "rows")
            return True
        layout = read_layout(file)
        for block in read_blocks(file, layout, 7):
            demand(all(len(row) == len(layout.header) for row in block), "a row of another width")
            flight = to_flight(block, layout)
            for values in (flight.time_s, flight.temperature_c, flight.humidity_percent, flight.airspeed_m_s):
                demand(values.shape == (len(block),) and not np.any(np.isinf(values)), "values")
        return True

    return one


def truths(rng: random.Random, folder: Path) -> Callable[[], bool]:
    import numpy as np

    from shockrig.rig.virtual.truth import Truth, draw_truth

    text = draw_truth(np.random.default_rng(1)).to_json().encode()

    def one() -> bool:
        truth = Truth.from_json(damage(rng, text).decode("utf-8", "replace"))
        demand(finite(truth.bead_radius_m, truth.film_thickness_m), "lengths")
        return True

    return one


def targets() -> dict[str, Target]:
    from shockrig.files.errors import InputError
    from shockrig.rig.errors import BenchError, StageError

    return {
        "imet": Target(0.5, (), imet),
        "frames": Target(0.3, (), frames),
        "grbl": Target(0.12, (StageError,), grbl),
        "journals": Target(0.03, (BenchError,), journals),
        "profiles": Target(0.015, (InputError,), profiles),
        "diagnoses": Target(0.005, (InputError,), diagnoses),
        "benches": Target(0.01, (BenchError,), benches),
        "protocols": Target(0.01, (BenchError,), protocols),
        "truths": Target(0.004, (BenchError,), truths),
        "campaigns": Target(0.003, (InputError,), campaigns),
        "flights": Target(0.003, (InputError,), flights),
    }


def fuzz(name: str, count: int, seed: int, folder: Path) -> tuple[Counter, Counter]:
    """Try `count` inputs on one target; (accepted, refused, wrong), and what was wrong."""
    target = targets()[name]
    rng = random.Random(f"{name} {seed}")
    tally, wrong = Counter(), Counter()
    one = target.make(rng, folder)
    for _ in range(count):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                tally["accepted" if one() else "refused"] += 1
        except target.documented as error:
            tally["refused"] += 1
            if not str(error).strip():
                wrong["an error without a word"] += 1
        except Forbidden as error:
            wrong[f"forbidden but accepted: {error}"[:160]] += 1
        except Exception as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            wrong[f"{type(error).__name__} at {Path(where.filename).name}:{where.lineno}: {str(error)[:100]}"] += 1
    tally["wrong"] = sum(wrong.values())
    return tally, wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="")
    args = parser.parse_args()
    print(f"{'target':10} {'inputs':>8} {'accepted':>9} {'refused':>8} {'wrong':>6} {'s':>5}")
    total = Counter()
    with tempfile.TemporaryDirectory() as name:
        for target, entry in targets().items():
            if args.only in ("", target):
                count, began_s = round(entry.share * args.count), time.monotonic()
                tally, wrong = fuzz(target, count, args.seed, Path(name))
                total += tally
                cells = f"{count:8} {tally['accepted']:9} {tally['refused']:8} {tally['wrong']:6}"
                print(f"{target:10} {cells} {time.monotonic() - began_s:5.0f}", flush=True)
                for what, times in wrong.most_common(12):
                    print(f"    {times:6} {what!r}")
    inputs = sum(total.values())
    print(f"{inputs} mutated inputs, seed {args.seed}: {total['wrong']} wrong")
    return 1 if total["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
