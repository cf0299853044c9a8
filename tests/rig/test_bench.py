"""Bench files: what is refused and how; and the whole virtual bench through the real drivers."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections import Counter
from dataclasses import fields
from importlib import resources
from pathlib import Path
from pkgutil import resolve_name

import numpy as np
import pytest

from shockrig.rig.bench import ConnectionFaults, default_bench, load_bench, open_bench, virtual_bench
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.bench_file import KINDS, check_bench
from shockrig.rig.references import Hyt271Reference, Hyt271ReferenceSettings, OperatorEntry
from shockrig.rig.seams import Air, Outcome, Reading
from shockrig.rig.virtual.chips.i2c import I2C_ADDRESSES
from shockrig.rig.virtual.faults import Fault
from shockrig.rig.virtual.truth import Hidden, draw_truth, with_effects

BENCHES = Path(str(resources.files("shockrig.data"))) / "benches"
VIRTUAL = (BENCHES / "virtual.toml").read_text()
SOURCE, DESTINATION = Air(20.0, 20.0), Air(20.0, 55.0)


class Operator:
    def __init__(self, answers=()):
        self.answers, self.prompts = list(answers), []

    def say(self, message):
        self.prompts.append(message)

    def ask(self, message, check=lambda answer: ""):
        while True:
            self.prompts.append(message)
            answer = self.answers.pop(0) if self.answers else ""
            if not (complaint := check(answer)):
                return answer
            self.say(complaint)

    def request(self, message, within_s):
        self.prompts.append(message)

    def leave(self):
        pass

    def confirmed_s(self):
        return None


def drive(bench, for_s):
    """Poll everything that is due for a while: (readings, moves)."""
    clock, readings, moves = bench.clock, [], []
    end_s = clock.now() + for_s
    askable = [*bench.sensors, bench.reference]
    while clock.now() < end_s:
        due_s = min(part.due_s() for part in (*askable, bench.stage))
        clock.sleep_until(min(end_s, max(due_s, clock.now() + 1e-4)))
        readings += [r for part in askable if part.due_s() <= clock.now() for r in part.poll()]
        if bench.stage.due_s() <= clock.now() and (move := bench.stage.poll()):
            moves.append(move)
    return readings, moves


@pytest.mark.parametrize("path", sorted(BENCHES.glob("*.toml")), ids=lambda path: path.stem)
def test_every_bench_that_ships_is_valid_and_can_be_put_together(path):
    bench = open_bench(load_bench(path), operator=Operator())
    try:
        assert set(bench.describe()) == {"imet", "hyt"}
    finally:
        bench.close()


@pytest.mark.parametrize("section", KINDS)
def test_every_registered_backend_exists(section):
    import importlib

    for target in KINDS[section].values():
        module, _, name = target.partition(":")
        backend = getattr(importlib.import_module(module), name)
        assert backend.Settings and backend.build


def test_a_real_bench_imports_nothing_virtual():
    code = f"""
import sys
from shockrig.rig.bench import load_bench, open_bench
open_bench(load_bench({str(BENCHES / "raspberry-pi.toml")!r}))
print([m for m in sys.modules if m.startswith("shockrig.rig.virtual") or m in ("scipy", "smbus2", "serial")])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('kind = "hyt-271"', 'kind = "hyt-270"', r"\[sensors.hyt\]: kind = \"hyt-270\".*did you mean 'hyt-271'"),
        (
            "conversion_s",
            "convertion_s",
            r"\[sensors.hyt\]: unknown key 'convertion_s'; did you mean 'conversion_s'\?",
        ),
        ("pressure_hpa", "presure_hpa", r"\[bench\]: unknown key 'presure_hpa'; did you mean 'pressure_hpa'"),
        ("[stage]", "[stages]", "unknown key 'stages'.*did you mean 'stage'"),
        ("[sensors.imet]", "[sensors.imett]", "unknown key 'imett'.*did you mean 'imet'"),
        ("conversion_s = 0.07", 'conversion_s = "fast"', "conversion_s = 'fast' must be a number"),
        ("conversion_s = 0.07", "conversion_s = -1", "conversion_s = -1 must be positive"),
        ("conversion_s = 0.07", "conversion_s = nan", "must be finite"),
        ("conversion_s = 0.07", "address = 200", "address = 200 must be from 0x00 to 0x7F"),
        ("conversion_s = 0.07", "address = true", "address = True must be a whole number"),
        ("conversion_s = 0.07", "plausible_temperature_c = [1]", "must be a list of 2 numbers"),
        ('bus = "virtual"', "", r"\[sensors.hyt\]: bus is missing; it must be a whole number or text"),
        ('bus = "virtual"', "bus = 1", 'hyt is real.*clock = "real"'),
        ('clock = "virtual"', 'clock = "sundial"', 'must be "real" or "virtual"'),
        ('kind = "set-points"', 'kind = "operator"', "reference is real"),
        ("seed = 0", 'seed = "x"', r"\[virtual\]: seed = 'x' must be a whole number"),
        (
            "pressure_hpa = 1013.25",
            "pressure_hpa = 101325.0",
            r"\[bench\]: pressure_hpa = 101325 must be from 1 to 2000",
        ),
        ("seed = 0", "seed = -1", r"\[virtual\]: seed = -1 must be from 0 to 18446744073709551615"),
        ("[bench]", "[bench", "not TOML"),
    ],
)
def test_a_wrong_bench_file_is_refused_with_file_key_and_remedy(tmp_path, old, new, says):
    assert old in VIRTUAL
    path = tmp_path / "mine.toml"
    path.write_text(VIRTUAL.replace(old, new, 1))
    with pytest.raises(BenchError, match=says) as caught:
        load_bench(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_missing_bench_file_is_refused(tmp_path):
    with pytest.raises(BenchError, match="nowhere.toml"):
        load_bench(tmp_path / "nowhere.toml")


def test_lines_of_a_firmware_that_the_tables_do_not_know(tmp_path):
    path = tmp_path / "b.toml"
    path.write_text(VIRTUAL.replace('"imet-xf"', '"imet-xf"\nlines = { "7" = ["temperature_c/100", "note:text"] }'))
    assert load_bench(path).sensors["imet"].settings.lines["7"] == ["temperature_c/100", "note:text"]
    path.write_text(VIRTUAL.replace('"imet-xf"', '"imet-xf"\nlines = { "7" = ["temperature_c/x"] }'))
    with pytest.raises(BenchError, match="imet: line '7'"):
        open_bench(load_bench(path))


def test_everything_unplugged_is_named_at_once(tmp_path):
    path = tmp_path / "bench.toml"
    text = (BENCHES / "raspberry-pi.toml").read_text()
    path.write_text(text.replace("/dev/serial/by-id/", f"{tmp_path}/").replace("bus = 1", f'bus = "{tmp_path}/i2c-1"'))
    bench = open_bench(load_bench(path), operator=Operator())
    with pytest.raises(ConnectionFaults) as caught:
        bench.open()
    assert [fault.device.split()[0] for fault in caught.value.faults] == ["imet", "hyt", "reference", "stage"]
    tree = caught.value.tree().splitlines()
    assert (
        tree[0].startswith("imet (imet-xf on ")
        and tree[1].startswith("    ")
        and tree[2].startswith("        there is no")
    )
    assert "\n" not in str(caught.value)
    bench.close()


def test_a_whole_run_on_the_virtual_bench():
    with virtual_bench(seed=3) as bench:
        bench.open()
        assert bench.describe()["imet"]["bead_radius_m"] == bench.truth.bead_radius_m
        bench.stage.prepare(SOURCE, DESTINATION, 5.0)
        before, _ = drive(bench, 60.0)
        bench.stage.begin_transfer()
        began_s = bench.clock.now()
        after, moves = drive(bench, 120.0)
        outcomes = Counter((r.sensor, r.outcome) for r in before + after)
        assert outcomes["imet", Outcome.OK] >= 1798 and outcomes["hyt", Outcome.OK] == pytest.approx(1800, abs=5)
        assert moves[0].start_s == pytest.approx(began_s, abs=0.01) and moves[0].end_s < began_s + 0.02
        humidity = [r.values["humidity_percent"] for r in after if r.sensor == "hyt"]
        settled = [r.values["humidity_percent"] for r in before if r.sensor == "hyt"][-100:]
        # the chambers miss their set points by 0.02 K and 0.1 %RH (one sigma), and the references say by how much
        source, destination = bench.reference.source(), bench.reference.destination()
        for made, wanted in ((source, SOURCE), (destination, DESTINATION)):
            assert made.temperature_c == pytest.approx(wanted.temperature_c, abs=0.08)
            assert made.humidity_percent == pytest.approx(wanted.humidity_percent, abs=0.4)
        assert np.mean(settled) == pytest.approx(source.humidity_percent, abs=0.05)
        assert humidity[0] == pytest.approx(source.humidity_percent, abs=0.5)
        assert np.mean(humidity[-100:]) == pytest.approx(destination.humidity_percent, abs=0.3)


def test_a_bus_is_virtual_only_for_kinds_whose_chip_is_emulated(monkeypatch, tmp_path):
    """Another chip in its place would answer, and its bytes would be read as something else."""
    monkeypatch.setitem(KINDS["sensors"], "sht99", KINDS["sensors"]["hyt-271"])
    path = tmp_path / "bench.toml"
    path.write_text(VIRTUAL.replace('kind = "hyt-271"', 'kind = "sht99"'))
    with pytest.raises(BenchError, match=rf"no sht99 is emulated \({', '.join(I2C_ADDRESSES)} are\)"):
        open_bench(load_bench(path))


def test_the_same_seed_gives_the_same_bytes():
    def record(seed):
        with virtual_bench(seed=seed) as bench:
            bench.open()
            bench.stage.prepare(SOURCE, DESTINATION, 5.0)
            return [(r.time_s, r.raw) for r in drive(bench, 3.0)[0]]

    assert record(4) == record(4) != record(5)


def test_the_hidden_transfer_time_is_what_the_stage_measures():
    truth = with_effects(draw_truth(np.random.default_rng(0)), [Hidden("finite_transfer", {"duration_s": 0.5})])
    with virtual_bench(truth) as bench:
        bench.open()
        bench.stage.prepare(SOURCE, DESTINATION, 5.0)
        bench.stage.begin_transfer()
        _, (move,) = drive(bench, 2.0)
    assert move.end_s - move.start_s == pytest.approx(0.5, abs=0.015)


def test_a_sealed_truth_from_a_file(tmp_path):
    truth = draw_truth(np.random.default_rng(9))
    (tmp_path / "truth.json").write_text(truth.to_json())
    path = tmp_path / "bench.toml"
    path.write_text(VIRTUAL + f'truth = "{tmp_path}/truth.json"\n')
    bench = open_bench(load_bench(path))
    assert bench.truth == truth
    bench.close()
    (tmp_path / "truth.json").write_text("{}")
    with pytest.raises(BenchError, match="truth"):
        open_bench(load_bench(path))


def test_the_virtual_bench_in_real_time_over_pseudo_terminals():
    with virtual_bench(seed=2, clock="real") as bench:
        bench.instruments.parts["stage"].BOOT_S = 0.05
        bench.open()
        bench.stage.prepare(SOURCE, DESTINATION, 5.0)
        bench.stage.begin_transfer()
        readings, moves = drive(bench, 1.2)
        outcomes = Counter((r.sensor, r.outcome) for r in readings)
        assert outcomes["imet", Outcome.OK] >= 8 and outcomes["hyt", Outcome.OK] >= 7
        assert len(moves) == 1


def test_faults_reach_the_part_that_they_are_meant_for():
    faults = {"hyt": [Fault("nack", 5.0, 8.0)], "imet": [Fault("silence", 10.0, 15.0)]}
    with virtual_bench(seed=2, faults=faults) as bench:
        bench.open()
        readings, _ = drive(bench, 20.0)
    bad = Counter((r.sensor, r.outcome) for r in readings if r.outcome is not Outcome.OK and r.time_s > 1.0)
    assert bad["hyt", Outcome.NOT_ACKNOWLEDGED] > 10
    assert bad["imet", Outcome.TIMED_OUT] == 2
    assert bad.pop(("hyt", Outcome.STALE), 0) <= 1  # the result of the request whose fetch failed came late
    assert len(bad) == 2


def test_a_dead_instrument_among_living_ones():
    with virtual_bench(seed=2) as bench:
        bench.instruments.parts["hyt"].power_off()
        with pytest.raises(ConnectionFaults, match="hyt.*nobody answers at this address") as caught:
            bench.open()
        assert len(caught.value.faults) == 1


def test_no_device_is_left_behind():
    bench = virtual_bench()
    path = bench.instruments._paths[0]
    bench.close()
    with pytest.raises(OSError) as caught:
        os.open(path, os.O_RDWR)
    assert caught.value.errno == errno.ENOENT
    import smbus2

    with pytest.raises(FileNotFoundError):
        smbus2.SMBus(path)


def test_an_operator_enters_both_airs_once_for_each_run():
    class Chambers:
        pair = (SOURCE, DESTINATION)

        def airs(self):
            return self.pair

    chambers = Chambers()
    operator = Operator(["20,3", "", "warm", "200", "19.8", "54.1"])
    reference = OperatorEntry(chambers, operator)
    assert reference.source() == Air(20.3, 20.0)
    assert reference.destination() == Air(19.8, 54.1)
    assert sum("not a number from" in prompt for prompt in operator.prompts) == 2
    asked = len(operator.prompts)
    reference.source()
    assert len(operator.prompts) == asked
    chambers.pair = (DESTINATION, SOURCE)
    assert reference.source() == DESTINATION
    assert len(operator.prompts) == asked + 4


@pytest.mark.parametrize(
    ("stands_in", "source", "destination"),
    [("probes", 21.0, 21.0), ("source", 21.0, 20.0), ("destination", 20.0, 21.0)],
)
def test_a_second_hyt_271_as_reference(stands_in, source, destination):
    class Chambers:
        def airs(self):
            return SOURCE, DESTINATION

    class Sensor:
        def poll(self):
            return [
                Reading("reference", Outcome.OK, t, t, {"temperature_c": 20.5 + t % 2, "humidity_percent": 40.0})
                for t in range(2)
            ] + [Reading("reference", Outcome.NOT_ACKNOWLEDGED, 2, 2)]

    reference = Hyt271Reference(Hyt271ReferenceSettings(1, air=stands_in), Sensor(), Chambers())
    assert len(reference.poll()) == 3
    assert reference.source().temperature_c == source and reference.destination().temperature_c == destination


def test_a_hyt_271_reference_on_the_virtual_bench_sees_the_air():
    content = {
        "bench": {"name": "b", "clock": "virtual"},
        "sensors": {"hyt": {"kind": "hyt-271", "bus": "virtual"}},
        "stage": {"kind": "grbl", "port": "virtual", "source_mm": 0, "destination_mm": 100, "feed_mm_min": 6000},
        "reference": {"kind": "hyt-271", "bus": "virtual", "air": "probes"},
    }
    with open_bench(check_bench(content, "b")) as bench:
        bench.open()
        bench.stage.prepare(SOURCE, DESTINATION, 5.0)
        drive(bench, 15.0)
        made = bench.instruments.world.air(bench.clock.now())
        assert made.humidity_percent == pytest.approx(20.0, abs=0.4)
        assert bench.reference.source().humidity_percent == pytest.approx(made.humidity_percent, abs=0.01)
        bench.stage.begin_transfer()
        drive(bench, 15.0)
        made = bench.instruments.world.air(bench.clock.now())
        assert made.humidity_percent == pytest.approx(55.0, abs=0.4)
        assert bench.reference.destination().humidity_percent == pytest.approx(made.humidity_percent, abs=0.01)


def test_default_bench_is_the_file_that_ships():
    config = default_bench(seed=7)
    assert config.virtual.seed == 7 and config.stage.kind == "grbl" and config.path.endswith("virtual.toml")


@pytest.mark.parametrize("kind", sorted(KINDS["sensors"]))
@pytest.mark.parametrize("fault", [None, "unplug"])
def test_contract_of_every_registered_sensor(kind, fault):
    """What the runner relies on: progress, ordered times, values only where there are some, never an exception."""
    through = {"imet-humidity": ("hyt", "imet-xq2"), "imet-bead": ("imet-2", "imet-xf")}
    if kind in through:
        name, unit = through[kind]
        sensors = {"imet": {"kind": unit, "port": "virtual"}, name: {"kind": kind}}
    elif "port" in {field.name for field in fields(resolve_name(KINDS["sensors"][kind]).Settings)}:
        sensors = {"imet": {"kind": kind, "port": "virtual"}}
    else:
        sensors = {"hyt": {"kind": kind, "bus": "virtual"}}
    content = {
        "bench": {"name": "contract", "clock": "virtual"},
        "sensors": sensors,
        "stage": {"kind": "grbl", "port": "virtual", "source_mm": 0, "destination_mm": 100, "feed_mm_min": 6000},
        "reference": {"kind": "set-points"},
    }
    faults = {name: [Fault(fault, 4.0, 8.0)] for name in sensors} if fault else {}
    with open_bench(check_bench(content, "contract"), faults=faults) as bench:
        bench.open()
        sensor = bench.sensors[-1]
        assert sensor.describe().keys() >= {"kind", "serial"}
        readings = [r for r in drive(bench, 12.0)[0] if r.sensor == sensor.name]
    assert len(readings) > 50
    assert readings[-1].outcome is Outcome.OK and readings[-1].time_s > 11.5
    if fault and kind not in through:
        assert {r.outcome for r in readings if 4.5 < r.time_s < 7.5} == {Outcome.NOT_ACKNOWLEDGED}
    times = [r.time_s for r in readings]
    assert times == sorted(times)
    for reading in readings:
        assert reading.requested_s <= reading.time_s
        assert bool(reading.values) == (reading.outcome in (Outcome.OK, Outcome.STALE))
        assert (reading.sampled_s is not None) == (reading.outcome is Outcome.OK)


@pytest.mark.parametrize(("unit", "kind"), [("imet-xf", "hyt-271"), ("imet-xq2", "imet-xq2-humidity")])
def test_a_units_own_hygrometer_is_called_what_it_is(tmp_path, unit, kind):
    text = VIRTUAL.replace('kind = "imet-xf"', f'kind = "{unit}"')
    film = text.index("[sensors.hyt]")
    text = text[:film] + '[sensors.hyt]\nkind = "imet-humidity"\n' + text[text.index("[stage]") :]
    path = tmp_path / "bench.toml"
    path.write_text(text)
    assert open_bench(load_bench(path)).describe()["hyt"]["kind"] == kind
