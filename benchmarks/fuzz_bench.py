"""Damaged input for what reads a bench: sensors' lines and frames, journals, the stage, bench and protocol files."""

from __future__ import annotations

import json
import random
import re
import zlib
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

from fuzz_damage import damage, demand, finite

ROOT = Path(__file__).parents[1]


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
            cells = [cell.strip(" \t") for cell in raw.decode("latin-1").split(",")]  # fields may be padded
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
    from shockrig.rig.recorder.run_journal import JOURNAL
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
