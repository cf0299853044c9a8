"""Effects of air density and temperature, walls, caps and a calibration that moves, as the bench has them; and its tier
whose sensors are as real ones. That they are found and told apart is seen by benchmarks/fixed_trials.py.
"""

from pathlib import Path

import numpy as np
import pytest
from small_worlds import QUIET, record

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.physics.air_exchange import Stream, temperature_ratio, vapour_ratio, ventilation_ratio
from shockrig.files.campaign import read_campaign
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.seams import Air
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.effects import KINDS
from shockrig.rig.virtual.hide import REALISTIC, draw_effect, draw_hidden
from shockrig.rig.virtual.physics import moist
from shockrig.rig.virtual.plans import Shock
from shockrig.rig.virtual.realistic import REAL_SENSORS, draw_real, drawable, real
from shockrig.rig.virtual.truth import Hidden, draw_truth, with_effects

RADIUS = 4e-4


def test_both_sides_know_air_alike():
    """The bench's own formulas, from other sources, agree with the analysis's to half a percent."""
    for pressure in (500.0, 700.0, 1013.25):
        for flow in (1.0, 5.0, 20.0):
            stream = Stream(np.array(flow), np.array(pressure))
            assert ventilation_ratio(stream, RADIUS) == pytest.approx(moist.heat_carried_off(flow, RADIUS, pressure))
            warm = Stream(np.array(flow), np.array(pressure), np.array([-20.0, 0.0, 20.0, 40.0]))
            own = moist.warm_air(warm.temperature_c, flow, RADIUS, pressure)
            assert temperature_ratio(warm, RADIUS) == pytest.approx(own, rel=6e-3)
    assert ventilation_ratio(Stream(np.array(5.0), np.array(700.0)), RADIUS) == pytest.approx(0.863, abs=0.001)
    assert vapour_ratio(Stream(np.array(5.0), np.array(700.0))) == pytest.approx((1013.25 / 700.0) ** 0.5)


def test_a_cap_delays_the_film_by_its_own_time_constant(tmp_path):
    """Known answer: the area between air and reading, over the step, is the film's L^2 / 3D and the cap's lag."""
    shock = [Shock("0001", Air(20.0, 20.0), Air(20.0, 80.0), duration_s=120.0, lead_s=10.0)]
    areas = []
    for hidden in ((), (Hidden("series_lag", {"time_constant_s": 4.0}),)):
        path = simulate_campaign(with_effects(QUIET, hidden), shock, 1, tmp_path / f"c{len(hidden)}")
        trace = read_campaign(path).runs[0].hyt
        late = trace.time_s > 10.0
        left = 80.0 - np.append(20.0, trace.values["humidity_percent"][late])
        areas.append(np.trapezoid(left, np.append(10.0, trace.time_s[late])) / 60.0)
    film_s = QUIET.film_thickness_m**2 / QUIET.diffusivity_m2_s(20.0) / 3.0
    assert areas[0] == pytest.approx(film_s, rel=0.01)
    assert areas[1] - areas[0] == pytest.approx(4.0, rel=2e-3)


def test_what_the_campaign_cannot_show_is_not_searched(tmp_path):
    channel = build_channel(record(tmp_path / "c", 5), "temperature")
    one = channel.select(np.abs(channel.conditions.airflow_m_s - 6.0) < 0.1)
    assert CATALOGUE["wall_radiation"].acts_in(channel) and not CATALOGUE["wall_radiation"].acts_in(one)


def test_a_realistic_film_reads_at_its_own_temperature(tmp_path):
    """In a thermal shock at constant vapour pressure plain RH jumps with the air, a real film's follows the die."""
    shock = [Shock("0001", Air(40.0, 14.0), Air(20.0, 44.0), duration_s=90.0, lead_s=10.0)]
    first = {}
    for tier, truth in (("plain", QUIET), ("real", with_effects(QUIET, [Hidden("die_thermal_lag")]))):
        trace = read_campaign(simulate_campaign(truth, shock, 1, tmp_path / tier)).runs[0].hyt
        reading = trace.values["humidity_percent"]
        first[tier] = reading[trace.time_s > 10.05][0] - reading[trace.time_s < 10.0][-1]
    assert first["plain"] > 25.0 and abs(first["real"]) < 1.0
    world = draw_truth(np.random.default_rng(1), REALISTIC)
    assert (
        world.effect("die_thermal_lag") is not None and 0.09 <= world.effect("convective_film")["biot_at_5_m_s"] <= 0.18
    )
    assert world.rate_scatter > 0 and world.trigger_jitter_s > 0


def test_realistic_strengths_lie_in_their_sourced_ranges():
    rng = np.random.default_rng(3)
    for (effect, channel), entry in REAL_SENSORS.items():
        assert entry.source and entry.low < entry.high and channel in KINDS[effect].channels
        values = draw_real(rng, effect, channel)
        assert set(values) == set(KINDS[effect].parameters)
        assert entry.low * (1 - 1e-9) <= abs(values[entry.strength]) <= entry.high * (1 + 1e-9)
        hidden = draw_effect(rng, effect, REALISTIC)
        assert set(hidden.parameters) == set(KINDS[effect].parameters)
    weak, strong = (draw_real(np.random.default_rng(4), "convective_film", size=size) for size in (0.5, 2.0))
    assert weak["biot_at_5_m_s"] == pytest.approx(4.0 * strong["biot_at_5_m_s"])
    assert {h.effect for h in draw_hidden(rng, 4, REALISTIC)} <= set(drawable())
    with pytest.raises(BenchError, match="moving_average has no realistic strength"):
        real("moving_average")


def test_the_documented_strengths_are_those_that_are_drawn():
    text = (Path(__file__).parents[3] / "docs" / "realistic.md").read_text()
    table = text.partition("## Naming")[0]
    rows = [line.split(" | ") for line in table.splitlines() if line.startswith("| `")]
    told = {(row[0].strip("| `"), row[1]): (row[2].strip("`"), float(row[3]), float(row[4])) for row in rows}
    assert told == {key: (entry.strength, entry.low, entry.high) for key, entry in REAL_SENSORS.items()}
