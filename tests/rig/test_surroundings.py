"""Pressure and light of single runs: in the protocol, made by benches that list them, refused in a line by others."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from small_worlds import QUIET

from shockrig.analysis.design.goals import parse_goals
from shockrig.analysis.design.menu import PlannedShock, Surroundings
from shockrig.analysis.plan.decide import decide
from shockrig.files.campaign import read_campaign
from shockrig.protocols.decided import as_protocol, feasible_on, surroundings_of
from shockrig.rig.bench import default_bench, open_bench, virtual_bench
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.bench_file import check_bench
from shockrig.rig.planning import check_plan
from shockrig.rig.protocol import parse_protocol
from shockrig.rig.protocol_text import protocol_text
from shockrig.rig.runner import record_campaign
from shockrig.rig.stages.manual import AskedSurroundings as Prompted
from shockrig.rig.virtual.truth import Hidden

HEATED = replace(QUIET, effects=(Hidden("radiative_heating", {"kelvin_per_w_m2_at_5_m_s": 5e-4}),))
COOL = PlannedShock(30.0, 30.0, 20.0, 55.0, dwell_s=8.0, why="cool")
LIT, HIGH = replace(COOL, irradiance_w_m2=1000.0, airflow_m_s=5.0), replace(COOL, pressure_hpa=700.0)


def lit_bench():
    config = default_bench(seed=1)
    general = replace(config.general, pressures_hpa=(700.0,), irradiances_w_m2=(1000.0,))
    return open_bench(replace(config, general=general), truth=HEATED)


def test_a_protocol_has_them_and_its_file_reads_back_the_same():
    protocol = as_protocol([COOL, LIT, HIGH], 0, "c", "g", [700.0])
    found = [(run.pressure_hpa, run.irradiance_w_m2) for run in protocol.runs]
    assert found == [(None, None), (None, 1000.0), (700.0, None)]
    assert parse_protocol(protocol_text(protocol).encode(), "c.toml").runs == protocol.runs
    text = protocol_text(protocol).replace("irradiance_w_m2 = 1000.0", "irradiance_w_m2 = -1")
    with pytest.raises(BenchError, match=r"run 2: irradiance_w_m2 is -1; expected 0 to 3000"):
        parse_protocol(text.encode(), "c.toml")


def test_a_bench_that_does_not_list_them_refuses_in_a_line():
    plain, lit = virtual_bench(QUIET), lit_bench()
    for shock, said in ((LIT, "irradiance_w_m2 1000: bench .* has 0 W/m2"), (HIGH, "pressure_hpa 700: .* 1013.25 hPa")):
        protocol = as_protocol([shock], 0, "c", "g", [700.0])
        with pytest.raises(BenchError, match=f"run 0001: {said}; leave it out, or list it under"):
            check_plan(protocol, plain)
        assert check_plan(protocol, lit) == []
        assert feasible_on(lit)(shock) and not feasible_on(plain)(shock)
    assert feasible_on(plain)(COOL) and feasible_on(plain)(replace(COOL, pressure_hpa=990.0))  # the weather's


def test_a_bench_file_lists_them():
    content = {
        "bench": {"name": "b", "clock": "virtual", "pressures_hpa": [700.0], "irradiances_w_m2": [800]},
        "sensors": {"imet": {"kind": "imet-xf", "port": "virtual"}},
        "stage": {"kind": "grbl", "port": "virtual", "source_mm": 0.0, "destination_mm": 300.0, "feed_mm_min": 3e4},
        "reference": {"kind": "set-points"},
    }
    assert surroundings_of(open_bench(check_bench(content, "b.toml"))) == Surroundings((700.0,), (800,))
    for wrong, said in (([0.1], "pressures_hpa: 0.1 cannot be"), ("x", "must be a list of numbers")):
        with pytest.raises(BenchError, match=said):
            check_bench(content | {"bench": content["bench"] | {"pressures_hpa": wrong}}, "b.toml")


def test_runs_are_recorded_in_them_and_say_so(tmp_path):
    """Under 1000 W/m2 the bead that light heats by 0.5 K reads that much more, and in the dark what the air is."""
    bench = lit_bench()
    protocol = as_protocol([COOL, LIT, HIGH], 0, "c", "g", [700.0])
    with bench:
        record_campaign(bench, protocol, tmp_path / "c", utc=lambda: "2026-05-01T00:00:00.000Z", sync_every_s=None)
    runs = [json.loads((tmp_path / "c" / "runs" / f"000{i}" / "run.json").read_text()) for i in (1, 2, 3)]
    assert [run["irradiance_w_m2"] for run in runs] == [0.0, 1000.0, 0.0]
    assert [run["pressure_hpa"] for run in runs] == [1013.25, 1013.25, 700.0]
    plan = json.loads((tmp_path / "c" / "campaign.json").read_text())["plan"]
    assert plan[1]["irradiance_w_m2"] == 1000.0 and "irradiance_w_m2" not in plan[0]
    campaign = read_campaign(tmp_path / "c")
    plateau = [
        float(np.mean(run.imet.values["temperature_c"][run.imet.time_s < run.start_s - 0.5])) for run in campaign.runs
    ]
    assert np.array(plateau) - 30.0 == pytest.approx([0.0, 0.5, 0.0], abs=0.03)


def test_the_menu_has_what_bench_and_campaign_have(tmp_path):
    goals = parse_goals("ties decided")
    from shockrig.analysis.design.recorded_so_far import usual_of

    assert usual_of(None, goals, Surroundings((700.0, 1000.0), (800.0,))).other == Surroundings((700.0,), (800.0,))
    assert decide((), goals, surroundings=Surroundings((700.0,))).choices


def test_a_person_is_asked_when_they_change():
    class Person:
        said: tuple[str, ...] = ()

        def ask(self, message):
            self.said = (*self.said, message)

    person = Person()
    around = Prompted(person)
    for light in (0.0, 0.0, 800.0, 0.0):
        around.ask(1013.25, light)
    assert [("off" in text, "800" in text) for text in person.said] == [(True, False), (False, True), (True, False)]
