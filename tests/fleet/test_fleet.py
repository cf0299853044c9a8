"""Fleets: the population is recovered with its own uncertainty, sensors are shrunk and covered, those that do not
belong are found, what a bench shares is no spread; the command's files, and what is done is not done again."""

import functools
import json
import shutil
from dataclasses import replace
from importlib import resources

import jsonschema
import numpy as np
import pandas as pd
import pytest
from made_fleets import AMBIENTS_C, drawn_fleet, drawn_sensor, record_sensor, short_plan, type_of_sensors
from scipy.linalg import block_diag
from scipy.optimize import brentq
from scipy.special import polygamma

import shockrig
from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.characterize.part_fit import read_extension
from shockrig.analysis.diagnose.remainder import Tolerance
from shockrig.analysis.estimate.problem import OwnRates, restricted
from shockrig.analysis.fleet.fleet import common_share, fleet_of, members_of
from shockrig.analysis.fleet.fleet_prior import with_population
from shockrig.analysis.fleet.population import Reduced, benjamini_hochberg, degrees_of, estimate, level, reduce_members
from shockrig.analysis.fleet.scatter import TRIALS, scatter_of_benches
from shockrig.analysis.fleet.statistics import statistics_of
from shockrig.analysis.fleet.whose import DiagnosedProbe, causes_of, judged_causes
from shockrig.analysis.report.fleet_page import cause_sentence, write_fleet_page
from shockrig.files import diagnosis
from shockrig.files.campaign_names import sensor_name
from shockrig.files.causes import StatedEffect, Uncertain
from shockrig.files.errors import InputError
from shockrig.files.fleet_file import BENCH, SENSOR, TYPE, RunScatter, design, fleet_document, read_fleet
from shockrig.files.profile import read_profile, write_profile
from shockrig.protocols import fleet_map
from shockrig.protocols.cli import main
from shockrig.protocols.made_before import made_from
from shockrig.rig.clock import VirtualClock
from shockrig.rig.seams import Air
from shockrig.rig.virtual.hide import draw_hidden, open_seal
from shockrig.rig.virtual.truth import Truth, draw_truth, of_probe, of_type, serial_number, with_effects
from shockrig.rig.virtual.world import World

SCHEMA = json.loads((resources.files("shockrig.data") / "schemas" / "shock-fleet-1.json").read_text())


def away(fleet, truths):
    """Normalised errors of every shrunk number: (shrunk - true) / u."""
    found = []
    for sensor in fleet.sensors:
        alpha, d = truths[int(sensor.serials["temperature"][1:]) - 8]
        for channel, true in (("temperature", [alpha]), ("humidity", d)):
            for figure, value in zip(sensor.channels[channel].figures, true, strict=True):
                u = figure.shrunk.standard_uncertainty / figure.shrunk.value
                found.append((np.log(figure.shrunk.value) - value) / u)
    return np.array(found)


def numbers_of(truth):
    """ln alpha, and ln D at the ambients that a population of drawn sensors has."""
    alpha, d = truth
    return np.array([alpha, *d[::2]])


def test_the_population_is_recovered_and_every_sensor_covered():
    statistics, truths = drawn_fleet(np.random.default_rng(1), 120, uncertainty=0.02)
    fleet = fleet_of(statistics)
    one = fleet.population
    assert [c.label for c in one.coordinates] == ["alpha", "D(0 °C)", "D(20 °C)", "D(40 °C)"]
    spread = np.sqrt(np.diag(one.covariance))
    assert spread == pytest.approx([0.02, 0.02, 0.02, 0.02 * np.sqrt(0.94)], rel=0.3)
    assert one.covariance[1, 2] / (spread[1] * spread[2]) == pytest.approx(0.8, abs=0.25)
    u = np.sqrt(np.diag(one.mean_covariance))
    assert np.all(np.abs(one.mean - np.log([8e-8, 4e-12, 8e-12, 1.5e-11])) < 4 * u)
    errors = away(fleet, truths)
    assert 0.92 < (np.abs(errors) < 1.96).mean() < 0.98
    # Data half as good as the type is narrow: half of the variance goes.
    figure = fleet.sensors[0].channels["temperature"].figures[0]
    ratio = figure.shrunk.standard_uncertainty / figure.shrunk.value / 0.02
    assert ratio == pytest.approx(np.sqrt(0.5), rel=0.15) and figure.share == pytest.approx(0.5, abs=0.12)
    assert fleet.outsiders("temperature") == fleet.outsiders("humidity") == [] == list(fleet.trends)


def test_a_few_sensors_do_not_promise_a_narrow_type():
    """Of six sensors the predictive intervals of the next one's numbers hold at least as often as they say."""
    rng, off = np.random.default_rng(2), []
    for _ in range(8):
        statistics, truths = drawn_fleet(rng, 7)
        one = fleet_of(statistics[:6]).population
        off += list((numbers_of(truths[6]) - one.mean) / np.sqrt(np.diag(one.predictive)))
    assert np.mean(np.abs(off) < 1.96) >= 0.85


def reduced(values, u):
    """Sensors of a bench that know all of their coordinates to u (n, K)."""
    n, size = values.shape
    A = np.broadcast_to(np.eye(size) / u**2, (n, size, size)).copy()
    nobody, one = np.zeros((n, size, 0)), np.zeros(n, dtype=np.int64)
    return Reduced(A, values / u**2, nobody, np.zeros((n, 0, 0)), np.zeros((n, 0)), one, one, 0)


def test_how_sure_a_spread_is_does_not_hang_on_what_goes_with_it():
    """Trials of one spread that kept its correlations were held by the other's spread, and surer than these values."""
    first, other = np.random.default_rng(8).standard_normal((2, 30))
    values = 0.02 * np.column_stack([first, 0.95 * first + 0.3 * other])
    alone, both = (estimate(reduced(x, 1e-4), 1e-3 * np.eye(x.shape[1])) for x in (values[:, :1], values))
    assert both.sigma[0, 0] == pytest.approx(alone.sigma[0, 0], rel=0.02)
    assert both.degrees[0] == pytest.approx(alone.degrees[0], rel=0.05)
    assert alone.degrees[0] == pytest.approx(29, rel=0.1)  # Jeffreys's prior of exact values: those of their variance


def test_what_a_bench_shares_is_no_spread():
    statistics, _ = drawn_fleet(np.random.default_rng(3), 40, spread=0.005, common=0.05)
    one = fleet_of(statistics).population
    assert np.sqrt(np.diag(one.covariance)) == pytest.approx([0.005] * 4, rel=0.5)
    assert np.sqrt(np.diag(one.mean_covariance)) == pytest.approx([0.05] * 4, rel=0.05)


def test_what_runs_of_a_carriage_have_in_common_is_found():
    rng = np.random.default_rng(5)
    for true, low, high in ((0.0, 0.0, 0.1), (0.5, 0.3, 0.7), (0.9, 0.8, 0.95)):
        both = np.sqrt(true) * rng.standard_normal(16) + np.sqrt(1.0 - true) * rng.standard_normal((8, 16))
        both[0, 3] = np.nan
        assert low <= common_share(both) <= high
    assert common_share(both[:1]) is None and common_share(both[:, :3]) is None


def test_of_too_few_runs_nothing_is_said_to_be_in_common(tmp_path):
    statistics, _ = drawn_fleet(np.random.default_rng(5), 6, probes=3)
    fleet = fleet_of(statistics)
    page = write_fleet_page(fleet, tmp_path).read_text()
    assert not fleet.runs_in_common and "in common" not in page and "Whose the causes are" not in page


def test_sums_over_carriages_are_generalised_least_squares_of_all_numbers():
    statistics, _ = drawn_fleet(
        np.random.default_rng(6), 6, common=0.01, probes=3, run_scatter=0.03, run_share=0.8, ambients_c=(0.0, 20.0)
    )
    members = members_of([replace(one, bench="other" if k > 4 else "bench") for k, one in enumerate(statistics)])
    sigma = np.diag([1e-4, 2e-4, 3e-4])
    found = level(reduce_members(members), sigma)
    H = [design(members.coordinates, one.coordinates) for one in members.sensors]
    R = [h @ sigma @ h.T + one.errors(members.table_scatter) for h, one in zip(H, members.sensors, strict=True)]
    V, keys = block_diag(*R), len(members.keys)
    for i, one in enumerate(members.sensors):
        for j, other in enumerate(members.sensors):
            here = np.ix_(range(3 * i, 3 * i + 3), range(3 * j, 3 * j + 3))
            if one.bench == other.bench:
                V[here] += one.common[:, :keys] @ other.common[:, :keys].T
            if one.carriage and one.carriage == other.carriage and one.bench == other.bench:
                V[here] += one.common[:, keys:] @ other.common[:, keys:].T
    assert any(one.common[:, keys:].any() for one in members.sensors)
    H, x = np.vstack(H), np.concatenate([one.value for one in members.sensors])
    covariance = np.linalg.inv(H.T @ np.linalg.solve(V, H))
    mean = covariance @ H.T @ np.linalg.solve(V, x)
    assert np.allclose(found.mean, mean, rtol=1e-9) and np.allclose(found.mean_covariance, covariance, rtol=1e-8)
    left = x - H @ mean
    whole = np.linalg.slogdet(V)[1] + left @ np.linalg.solve(V, left) - np.linalg.slogdet(covariance)[1]
    own = sum(np.linalg.slogdet(one.errors(members.table_scatter))[1] for one in members.sensors)
    own += sum(one.value @ np.linalg.solve(one.errors(members.table_scatter), one.value) for one in members.sensors)
    assert found.log_likelihood == pytest.approx(-0.5 * (whole - own), rel=1e-6)


def test_the_mean_of_a_carriage_is_no_surer_than_its_runs_allow():
    """Eight probes whose runs scatter alike are one look at the type's mean, and many at how they differ."""
    off, apart, middle = [], [], np.log([8e-8, 4e-12, 8e-12, 1.5e-11])
    for seed in range(8):
        rng = np.random.default_rng([7, seed])
        statistics, truths = drawn_fleet(
            rng, 8, spread=0.002, uncertainty=0.001, probes=8, run_scatter=0.04, run_share=0.9
        )
        fleet = fleet_of(statistics)
        assert fleet.runs_in_common["c0"]["temperature"] > 0.6
        off += list((fleet.population.mean - middle) / np.sqrt(np.diag(fleet.population.mean_covariance)))
        apart += list(away(fleet, truths))
    assert np.mean(np.abs(off) < 2.0) >= 0.85 and np.mean(np.abs(apart) < 2.0) >= 0.85


def test_one_film_that_is_off_by_2_percent_is_found_among_200():
    statistics, _ = drawn_fleet(np.random.default_rng(4), 200, spread=0.003, uncertainty=0.0015, off={17: 0.02})
    fleet = fleet_of(statistics)
    assert fleet.outsiders("humidity") == ["X25 / H25"]
    assert fleet.outsiders("temperature") == []
    found = next(s for s in fleet.sensors if s.name == "X25 / H25").channels["humidity"]
    assert all(f.shrunk == f.own and f.share == 1.0 for f in found.figures)
    assert found.adjusted < 0.05


def test_several_that_do_not_belong_do_not_hide_one_another():
    off = dict.fromkeys(range(8), 0.15)
    fleet = fleet_of(drawn_fleet(np.random.default_rng(5), 30, off=off)[0])
    assert set(fleet.outsiders("humidity")) == {f"X{i + 8} / H{i + 8}" for i in off}
    assert np.sqrt(fleet.population.covariance[2, 2]) < 0.035


def test_who_does_not_belong_is_who_is_too_far_off():
    """Six sensors, one 30 % off: it made the spread of all so well known that it was left out, and what was then said
    of it was that it belongs. It is held against the five others, however sure these are of their own spread."""
    found = 0
    for seed in range(8):
        fleet = fleet_of(drawn_fleet(np.random.default_rng([6, seed]), 6, off={2: 0.3})[0])
        for sensor in fleet.sensors:
            assert all(one.belongs == (one.adjusted >= 0.05) for one in sensor.channels.values())
        found += fleet.outsiders("humidity") == ["X10 / H10"]
    assert found >= 5


@pytest.mark.parametrize("degrees", [1.0, 2.0, 5.0, 40.0, 1e4])
def test_a_spread_is_as_sure_as_its_logarithm(degrees):
    """var ln s of a standard deviation with nu degrees of freedom: a quarter of trigamma(nu / 2)."""
    assert degrees_of(0.25 * float(polygamma(1, 0.5 * degrees))) == pytest.approx(degrees, rel=1e-6)


@pytest.mark.trial
def test_plain_fleets_have_few_false_discoveries():
    rng, said = np.random.default_rng(6), 0
    for _ in range(25):
        fleet = fleet_of(drawn_fleet(rng, 8)[0])
        said += bool(fleet.outsiders("temperature") or fleet.outsiders("humidity"))
    assert said <= 4  # 5 % of plain fleets, and three standard deviations


def test_benjamini_and_hochberg_of_their_own_example():
    """Fifteen probabilities of their paper (1995, section 4.1): four are rejected at 0.05."""
    stated = [0.0001, 0.0004, 0.0019, 0.0095, 0.0201, 0.0278, 0.0298, 0.0344, 0.0459, 0.3240, 0.4262, 0.5719, 0.6528]
    adjusted = benjamini_hochberg(np.array([*stated, 0.7590, 1.0, np.nan]))
    assert (adjusted[:15] <= 0.05).sum() == 4 and np.isnan(adjusted[15])


def test_another_batch_is_said_and_since_which_serial_number():
    plain, _ = drawn_fleet(np.random.default_rng(7), 60)
    assert fleet_of(plain).trends == ()
    moved, _ = drawn_fleet(np.random.default_rng(7), 60, since=(30, 0.04))
    trends = {trend.per: trend for trend in fleet_of(moved).trends}
    assert set(trends) == {"batch", "year"} and trends["batch"].channel == "humidity"
    assert abs(int(trends["batch"].since[1:]) - 38) <= 3  # serial numbers count on from 8, as numbers
    assert abs(trends["batch"].change.value - 0.04) < 4 * trends["batch"].change.standard_uncertainty


def diagnosed(rng, places, benches, spread):
    """Eight sensors, each diagnosed; those at `places` show a lag of (1 + spread z) s, known to 2 %."""
    statistics, _ = drawn_fleet(rng, 8)
    found = []
    for i, one in enumerate(statistics):
        lag_s = 1.0 + spread * rng.standard_normal() + 0.02 * rng.standard_normal()
        cause = StatedEffect("series_lag", {"time_constant_s": Uncertain(lag_s, 0.02)})
        causes = {"temperature": (cause,) if i in places else (), "humidity": ()}
        probe = str(1 + i % (8 // benches))
        bench = i // (8 // benches)
        found.append(replace(one, path=f"b{bench}", probe=probe, bench=f"b{bench}", causes=causes))
    return found


@pytest.mark.parametrize(
    ("places", "benches", "spread", "whose", "said"),
    [
        (range(8), 1, 0.0, "bench", "is the bench's: 8 of 8 sensors show it, with one value, in 1 campaign."),
        (range(7), 1, 0.0, "bench", "7 of 8 sensors"),
        ((3,), 1, 0.0, "sensor", "is X11 / H11's own: none of the other 7 sensors shows it."),
        (range(8), 1, 0.3, "type", "is the type's: 8 of 8 sensors show it, with values that differ."),
        (range(8), 2, 0.0, "type", "with one value in 2 campaigns."),
        (range(4), 2, 0.0, "bench", "in 1 campaign."),
        ((0, 5), 1, 0.0, "several", "whether it is theirs or a bench's is open."),
    ],
)
def test_whose_a_cause_is(tmp_path, places, benches, spread, whose, said):
    fleet = fleet_of(diagnosed(np.random.default_rng(1), places, benches, spread))
    (cause,) = fleet.causes
    assert (cause.whose, len(cause.sensors), cause.diagnosed) == (whose, len(places), 8)
    assert said in cause_sentence(cause)
    lag = cause.parameters["time_constant_s"]
    assert abs(lag.mean.value - 1.0) < 4 * lag.mean.standard_uncertainty
    assert (lag.spread == pytest.approx(spread, rel=0.6)) if spread else lag.spread < 0.03
    fleet.write(tmp_path / "fleet.json")
    jsonschema.validate(json.loads((tmp_path / "fleet.json").read_text()), SCHEMA)
    assert read_fleet(tmp_path / "fleet.json").causes == fleet.causes
    assert "Whose the causes are" in write_fleet_page(fleet, tmp_path).read_text()


def test_walls_are_what_all_probes_feel_and_warmth_what_one_has():
    value = {"rise_k_at_10_k": Uncertain(0.2, 0.01)}
    warm = StatedEffect("self_heating", {"rise_k_at_5_m_s": Uncertain(0.2, 0.01)}, 0.6, ("wall_radiation",))
    walls = StatedEffect("wall_radiation", value, 0.6, ("self_heating",))
    for showing, whose, named, out in (
        ([warm] * 5 + [walls] * 3, BENCH, "wall_radiation", "self_heating"),
        ([None, None, walls, *[None] * 5], SENSOR, "self_heating", "wall_radiation"),
    ):
        probes = [DiagnosedProbe(str(k), "c", "b", (one,) if one else ()) for k, one in enumerate(showing)]
        (cause,) = judged_causes("temperature", probes)
        assert (cause.whose, cause.effect, cause.ruled_out) == (whose, named, (out,))


def test_values_that_are_one_are_told_from_those_of_a_type():
    """Eight probes: one value is the bench's in 95 %, values that differ by five of their uncertainties the type's."""
    rng = np.random.default_rng(31)

    def shared(differ):
        values = 0.3 * (1.0 + differ * rng.standard_normal(8)) + 0.006 * rng.standard_normal(8)
        causes = [
            (StatedEffect("wall_radiation", {"rise_k_at_10_k": Uncertain(float(v), 0.006)}, 1.0),) for v in values
        ]
        probes = [DiagnosedProbe(str(k), "c", "b", one) for k, one in enumerate(causes)]
        return judged_causes("temperature", probes)[0].whose

    assert sum(shared(0.0) == BENCH for _ in range(100)) >= 95
    assert sum(shared(0.1) == TYPE for _ in range(100)) >= 95


@pytest.mark.parametrize(
    ("stem_in", "relaxation_in", "whose", "effect", "ruled_out"),
    [
        (range(5), range(5, 8), "bench", "air_relaxation", ("stem_conduction",)),
        (range(8), (), "bench", "air_relaxation", ("stem_conduction",)),
        ((), (2,), "sensor", "stem_conduction", ("air_relaxation",)),
    ],
)
def test_the_other_probes_tell_look_alikes_apart(tmp_path, stem_in, relaxation_in, whose, effect, ruled_out):
    """Whichever of two each diagnosis names: what all show is the air's, what one shows is not."""
    statistics, found = drawn_fleet(np.random.default_rng(1), 8)[0], []
    value = {"time_constant_s": Uncertain(8.0, 0.4)}
    stem = StatedEffect("stem_conduction", value, 0.6, ("air_relaxation",))
    relaxation = StatedEffect("air_relaxation", value, 0.6, ("stem_conduction",))
    for i, one in enumerate(statistics):
        cause = (stem,) if i in stem_in else (relaxation,) if i in relaxation_in else ()
        found.append(replace(one, path="b", probe=str(1 + i), bench="b", causes={"temperature": cause}))
    fleet = fleet_of(found)
    (cause,) = fleet.causes
    assert (cause.whose, cause.effect, cause.look_alikes, cause.ruled_out) == (whose, effect, (), ruled_out)
    assert len(cause.sensors) == len(stem_in) + len(relaxation_in)
    assert f"and not {ruled_out[0]}" in cause_sentence(cause)
    jsonschema.validate(fleet_document(fleet), SCHEMA)
    fleet.write(tmp_path / "fleet.json")
    assert read_fleet(tmp_path / "fleet.json").causes == fleet.causes


def test_a_value_that_is_one_is_seldom_denied():
    rng = np.random.default_rng(2)
    said = [fleet_causes(diagnosed(rng, range(8), 1, 0.0)) for _ in range(100)]
    assert said.count("bench") >= 90


def test_values_without_uncertainties_are_not_called_one():
    statistics = diagnosed(np.random.default_rng(3), range(8), 1, 0.0)
    blunt = {"temperature": (StatedEffect("series_lag", {"time_constant_s": Uncertain(1.0)}),)}
    assert fleet_causes([replace(one, causes=blunt) for one in statistics]) == "several"


def fleet_causes(statistics):
    return causes_of(members_of(statistics).sensors)[0].whose


def test_sensors_with_other_ambients_and_without_a_channel_take_part():
    rng = np.random.default_rng(8)
    statistics, truths = drawn_fleet(rng, 40)
    at_20 = [
        replace(s, channels={**s.channels, "humidity": at(s.channels["humidity"], [2])}) if i % 2 else s
        for i, s in enumerate(statistics)
    ]
    at_20[0] = replace(at_20[0], channels={"humidity": at_20[0].channels["humidity"]}, missing={"temperature": "none"})
    fleet = fleet_of(at_20)
    assert fleet.population.sensors == {"temperature": 39, "humidity": 40}
    assert len(fleet.sensors[1].channels["humidity"].figures) == 1
    assert fleet.to_frame()["failed"].to_list().count("none") == 1


def at(channel, keep):
    return replace(
        channel,
        coordinates=tuple(channel.coordinates[k] for k in keep),
        value=channel.value[keep],
        covariance=channel.covariance[np.ix_(keep, keep)],
        responses=channel.responses.knowing(np.isin(np.arange(channel.value.size), keep), channel.covariance),
    )


def moved(channel, by_k):
    coordinates = tuple(replace(c, temperature_c=c.temperature_c + by_k) for c in channel.coordinates)
    return replace(channel, coordinates=coordinates)


def test_sensors_of_one_ambient_each_still_tell_that_d_changes():
    statistics, _ = drawn_fleet(np.random.default_rng(14), 40)
    single = [
        replace(s, channels={**s.channels, "humidity": at(s.channels["humidity"], [i % 5])})
        for i, s in enumerate(statistics)
    ]
    one = fleet_of(single).population
    assert one.nodes_c == (0.0, 40.0)
    # Chambers come to a set point by some hundredths: that is no other ambient.
    beside = [replace(s, channels={**s.channels, "humidity": moved(s.channels["humidity"], 0.03)}) for s in single]
    assert fleet_of(beside).population.nodes_c == (0.0, 40.0)
    assert np.exp(one.mean[2] - one.mean[1]) == pytest.approx(1.5 / 0.4, rel=0.1)
    assert np.sqrt(np.diag(one.covariance))[1:] == pytest.approx([0.02, 0.02], rel=1.0)


@pytest.mark.parametrize("off", [0.0, 1.0])
def test_what_one_sensor_alone_has_is_no_number_of_the_type(off):
    """Nine sensors at 40 degC and one at five ambients. Where it did not belong, D(0 degC) was (0.07 ± 0.98) m²/s, in
    the profile as well, and where it was unlucky the command ended in a traceback."""
    statistics, _ = drawn_fleet(np.random.default_rng(15), 10, off={3: off})
    short = [
        s if i == 3 else replace(s, channels={**s.channels, "humidity": at(s.channels["humidity"], [4])})
        for i, s in enumerate(statistics)
    ]
    fleet = fleet_of(short)
    assert fleet.population.nodes_c == (40.0,)
    assert np.exp(fleet.population.mean[1]) == pytest.approx(1.5e-11, rel=0.05)
    assert [c.temperature_c for c in members_of(short).sensors[3].coordinates] == [None, 40.0]
    assert fleet.outsiders("humidity") == (["X11 / H11"] if off else [])
    cold = replace(
        statistics[3], channels=statistics[3].channels | {"humidity": at(statistics[3].channels["humidity"], [0])}
    )
    (odd,) = [one for one in fleet_of([*short[:3], cold, *short[4:]]).sensors if one.name == "X11 / H11"]
    assert "not at its temperatures" in odd.missing["humidity"] and list(odd.channels) == ["temperature"]
    alone = replace(cold, channels={"humidity": cold.channels["humidity"]}, missing={"temperature": "no run"})
    fleet = fleet_of([*short[:3], alone, *short[4:]])
    assert len(fleet.sensors) == 9  # it had been left out without a word
    said = "humidity: no others have its numbers, or not at its temperatures; temperature: no run"
    assert fleet.left_out == {"c3": said}


def test_two_campaigns_of_one_serial_number_are_one_sensor():
    statistics, _ = drawn_fleet(np.random.default_rng(9), 10)
    again = replace(statistics[0], name="later", path="later", fingerprint="later")
    copy = replace(statistics[1], path="copy of c1")
    fleet = fleet_of([*statistics, again, copy])
    assert len(fleet.sensors) == 10
    (twice,) = (s for s in fleet.sensors if len(s.campaigns) == 2)
    assert set(twice.campaigns) == {"c0", "later"} and len(twice.channels["humidity"].figures) == 2 * len(AMBIENTS_C)
    assert fleet.left_out == {"copy of c1": "the same readings as c1"}


def test_another_type_is_left_out_and_two_sensors_are_no_fleet():
    statistics, _ = drawn_fleet(np.random.default_rng(10), 5)
    plate = replace(statistics[0].channels["humidity"], body="plate")
    other = replace(statistics[0], channels={**statistics[0].channels, "humidity": plate})
    fleet = fleet_of([other, *statistics[1:]])
    assert "is a plate of 1e-05 m, most are a film" in fleet.sensors[0].missing["humidity"]
    with pytest.raises(InputError, match="2 sensors that can be characterized, a fleet needs 3"):
        fleet_of(statistics[:2])


def test_the_order_of_the_campaigns_changes_no_digit():
    statistics, _ = drawn_fleet(np.random.default_rng(11), 12)
    assert fleet_document(fleet_of(statistics)) == fleet_document(fleet_of(statistics[::-1]))


def test_a_fleet_is_read_as_it_was_written(tmp_path):
    beside = {"probes": 3, "run_scatter": 0.01, "run_share": 0.8}
    drawn = drawn_fleet(np.random.default_rng(12), 60, since=(30, 0.04), **beside)[0]
    fleet = fleet_of(drawn, {"c99": "no runs"}, {"seed": 0})
    assert len(fleet.runs_in_common) == 20
    jsonschema.validate(fleet_document(fleet), SCHEMA)
    fleet.write(tmp_path / "fleet.json")
    again = read_fleet(tmp_path / "fleet.json")
    assert fleet_document(again) == fleet_document(fleet) and again.runs_in_common == fleet.runs_in_common
    assert repr(again).startswith("<Fleet: sensors 60; alpha (") and "left out" in again._repr_html_()
    typical = again.population.typical()
    assert typical.temperature.thermal_diffusivity_m2_s.value == pytest.approx(8e-8, rel=0.02)
    assert [row.ambient_temperature_c for row in typical.humidity.diffusivity_table] == [0.0, 20.0, 40.0]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"format": "shock-plan/1"}, 'key format: expected "shock-fleet/1"'),
        ({"population": {}}, "key population.coordinates"),
        ({"mean": [1.0]}, "key population.mean: expected 4 numbers"),
        ({"covariance": [[-1.0 if i == j else 0.0 for i in range(4)] for j in range(4)]}, "is no covariance"),
        ({"channels": {"humidity": {"length_m": 1e-5}}}, "key population.channels: expected an entry temperature"),
    ],
)
def test_every_fault_is_named_by_its_key(tmp_path, change, said):
    document = fleet_document(fleet_of(drawn_fleet(np.random.default_rng(13), 4)[0]))
    top = {key: value for key, value in change.items() if key in document}
    document |= top if top else {"population": {**document["population"], **change}}
    (tmp_path / "fleet.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match="shockrig fleet wrote") as error:
        read_fleet(tmp_path / "fleet.json")
    assert said in str(error.value)


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """Five virtual sensors of one type, the fourth with a film 30 % faster; and a campaign that cannot be read."""
    folder, rng = tmp_path_factory.mktemp("fleet"), np.random.default_rng(21)
    base = type_of_sensors(20)
    truths = [drawn_sensor(base, rng) for _ in range(5)]
    truths[3] = replace(truths[3], diffusivity_20c_m2_s=1.3 * truths[3].diffusivity_20c_m2_s)
    for i, truth in enumerate(truths):
        record_sensor(truth, short_plan(), 30 + i, folder / f"s{i}", 100 + i)
    (folder / "broken").mkdir()
    (folder / "broken" / "campaign.json").write_text("{")
    return folder, truths


@pytest.fixture(scope="module")
def type_fleet(bench):
    """The fleet of the four sensors that are alike, of a campaign and of folders."""
    folder, _ = bench
    return shockrig.fleet([shockrig.read_campaign(folder / "s0"), *(folder / f"s{i}" for i in (1, 2, 4))])


@pytest.fixture(scope="module")
def alone_of(bench):
    """The characterization of a sensor by itself, made once."""
    folder, _ = bench
    return functools.cache(lambda name: shockrig.characterize(folder / name))


def test_the_command_writes_what_it_found_and_does_nothing_twice(bench, alone_of, tmp_path, capsys, monkeypatch):
    folder, truths = bench
    out = tmp_path / "out"
    assert main(["fleet", str(folder), "--out", str(out), "--workers", "1"]) == 0
    said = capsys.readouterr().out
    assert "5 sensors of one type." in said and f"left out: {folder / 'broken'}" in said
    fleet = read_fleet(out / "fleet.json")
    jsonschema.validate(json.loads((out / "fleet.json").read_text()), SCHEMA)
    for sensor, truth in zip(fleet.sensors, truths, strict=True):
        own = sensor.channels["temperature"].figures[0].own
        assert abs(own.value - truth.thermal_diffusivity_m2_s) < 4 * own.standard_uncertainty
    for sensor in fleet.sensors[:1]:
        alone = alone_of(sensor.campaigns[0].rpartition("/")[2]).profile
        stated = [alone.temperature.response_time_s] + [r.response_time_s for r in alone.humidity.diffusivity_table]
        figures = [figure for channel in ("temperature", "humidity") for figure in sensor.channels[channel].figures]
        for figure, times in zip(figures, stated, strict=True):
            own, shrunk = figure.own_t63_s, figure.t63_s
            assert (own.value, own.standard_uncertainty) == pytest.approx(
                (times.t63_s, times.standard_uncertainties_s[0]),
                rel=1e-4,  # one least squares from two starts
            )
            assert shrunk.value * figure.shrunk.value == pytest.approx(own.value * figure.own.value, rel=1e-6)
    assert len(list((out / "measured").iterdir())) == 5
    page = (out / "fleet.html").read_text()
    assert "5 sensors of one type" in page and "invented, not measured" in page
    table = pd.read_csv(out / "sensors.csv")
    assert table.loc[table.figure == "alpha", "shrunk"].to_list() == pytest.approx(
        [s.channels["temperature"].figures[0].shrunk.value for s in fleet.sensors], rel=1e-6
    )
    assert {"fleet.nc", "sensors.parquet", "fleet.png"} <= {file.name for file in out.iterdir()}
    assert read_profile(out / "profile.json").temperature is not None

    # Started again, it characterizes only what is new, whatever the folder is called now.
    shutil.copytree(folder, tmp_path / "moved")
    asked = []
    monkeypatch.setattr(fleet_map, "measured_fleet", counting(asked, fleet_map.measured_fleet))
    assert main(["fleet", str(tmp_path / "moved"), "--out", str(out), "--workers", "1"]) == 0
    assert asked[-1].startswith("5 of 5 characterized, 5 of them before")
    again = read_fleet(out / "fleet.json")
    assert fleet_document(again)["population"] == fleet_document(fleet)["population"]


def reading(read, function):
    return lambda path: read.append(path) or function(path)


def counting(asked, function):
    return lambda tasks, workers, scheduler, say: function(tasks, workers, scheduler, asked.append)


def test_python_finds_what_the_command_finds(type_fleet):
    fleet = type_fleet
    assert [s.name for s in fleet.sensors] == ["X100 / H100", "X101 / H101", "X102 / H102", "X104 / H104"]
    assert len(fleet.plot().axes) == len(fleet.population.coordinates)
    data = fleet.to_xarray()
    assert data.population_mean.size == len(fleet.population.coordinates)
    assert data.sizes["row"] == len(fleet.to_frame())
    with pytest.raises(InputError, match="is no folder"):
        shockrig.fleet("nowhere")


def record_logger(folder, rng, fast_s, slow_s, share):
    """Two plunges of a lump of which a share follows slowly, each second."""
    folder.mkdir()
    sensor = {"kind": "as logged", "body": "lumped", "serial": folder.name}
    (folder / "campaign.json").write_text(
        json.dumps({"format": "shock-campaign/1", "name": folder.name, "sensors": {"imet": sensor}})
    )
    for i, (first, last) in enumerate([(22.0, 2.0), (2.0, 22.0)]):
        run = folder / "runs" / f"{i:04d}"
        run.mkdir(parents=True)
        ends = {"source": {"temperature_c": first}, "destination": {"temperature_c": last}}
        (run / "run.json").write_text(
            json.dumps({"format": "shock-run/1", "id": run.name, **ends, "transfer": {"start_s": 20.0}})
        )
        time = np.arange(0.0, 220.0)
        since = np.maximum(time - 20.0, 0.0)
        left = (1.0 - share) * np.exp(-since / fast_s) + share * np.exp(-since / slow_s)
        value = last + (first - last) * left + 0.02 * rng.standard_normal(time.size)
        table = pd.DataFrame({"time_s": time, "temperature_c": value})
        table.to_csv(run / "imet.csv", index=False, float_format="%.3f")


@pytest.fixture(scope="module")
def loggers(tmp_path_factory):
    """Four loggers of two exponentials, and diagnoses that call either of them the body."""
    folder, rng = tmp_path_factory.mktemp("loggers"), np.random.default_rng(31)
    true = np.array([4.0, 20.0, 0.4]) * np.exp(0.05 * rng.standard_normal((4, 3)))
    for i, (fast, slow, share) in enumerate(true):
        record_logger(folder / f"L{i}", rng, fast, slow, share)
    return folder, true, {"slow lag": (0.4, 20.0), "fast lag": (0.6, 4.0)}


def extended_by(path, fraction, time_constant_s, campaign=None):
    parameters = {"fraction": {"value": fraction}, "time_constant_s": {"value": time_constant_s}}
    channels = {
        "temperature": {"verdict": "explained", "causes": [{"effect": "parallel_lag", "parameters": parameters}]}
    }
    document = {"format": "shock-diagnosis/1", "campaign": "x", "channels": channels}
    if campaign is not None:
        document |= {"campaign": campaign.name, "made_from": made_from(campaign, Tolerance())}
    path.write_text(json.dumps(document))
    return read_extension(path)


def test_two_time_constants_are_one_solution_whichever_is_called_the_body(loggers, tmp_path):
    folder, true, starts = loggers
    found = []
    for i in range(4):
        campaign = shockrig.read_campaign(folder / f"L{i}")
        both = [
            statistics_of(characterize(campaign, 0, extended_by(tmp_path / "d.json", *start)), f"{i}")
            for start in starts.values()
        ]
        one, other = (s.channels["temperature"] for s in both)
        assert one.value == pytest.approx(other.value, abs=2e-3)
        assert one.covariance == pytest.approx(other.covariance, rel=0.02, abs=1e-7)
        found.append(both[i % 2])
    fleet = fleet_of(found)
    assert fleet.outsiders("temperature") == []
    for sensor, (fast, slow, share) in zip(fleet.sensors, true, strict=True):
        figure = sensor.channels["temperature"].figures[0]
        left = lambda t: (1.0 - share) * np.exp(-t / fast) + share * np.exp(-t / slow) - np.exp(-1.0)  # noqa: B023, E731
        for t63 in (figure.own_t63_s, figure.t63_s):
            assert abs(t63.value - brentq(left, 0.0, 100.0)) < 3.5 * t63.standard_uncertainty
        assert figure.t63_s.standard_uncertainty <= 1.001 * figure.own_t63_s.standard_uncertainty
    assert fleet.population.mean[2] == pytest.approx(np.log(20.0), abs=0.1)  # the slower one is the lag
    # Who has one of the type that nobody has characterized is given the second time constant too.
    (effect,) = fleet.typical().temperature.effects
    lag = effect.parameters["time_constant_s"]
    assert effect.effect == "parallel_lag" and lag.value == pytest.approx(20.0, rel=0.1)
    assert effect.parameters["fraction"].value == pytest.approx(true[:, 2].mean(), abs=0.05)
    own = [sensor.channels["temperature"].figures[2].own for sensor in fleet.sensors]
    assert lag.standard_uncertainty > np.std([one.value for one in own], ddof=1)


def test_diagnoses_beside_the_campaigns_are_read_once(loggers, monkeypatch):
    """To look through all of them for each campaign would take time as the square of their number."""
    folder, _, starts = loggers
    for i in range(4):
        campaign = shockrig.read_campaign(folder / f"L{i}")
        extended_by(folder / f"L{i}" / "diagnosis.json", *starts["slow lag"], campaign)
    outdated = json.loads((folder / "L3" / "diagnosis.json").read_text())
    outdated["made_from"]["fingerprint"] = "another"
    (folder / "L3" / "diagnosis.json").write_text(json.dumps(outdated))
    read = []
    monkeypatch.setattr(diagnosis, "read_diagnosis", reading(read, diagnosis.read_diagnosis))
    found, _ = fleet_map.measured_fleet(fleet_map.tasks_of([folder], None, None)[0], 1, None, lambda text: None)
    assert len(read) == 4
    (cause,) = fleet_of(found).causes
    assert (cause.effect, cause.sensors, cause.diagnosed) == ("parallel_lag", ("L0", "L1", "L2"), 3)
    assert cause.whose == "type" and shockrig.fleet(folder).causes == (cause,)


def test_the_virtual_bench_makes_fleets(tmp_path, capsys):
    """Three sensors recorded at once and one by itself are four of one type, and each is found where its seal says."""
    type_7 = ["--fleet", "7", "--spread", "3"]
    assert main(["run", "quick", *type_7, "--probes", "3", "--seed", "1", "--out", str(tmp_path / "f/a")]) == 0
    assert main(["run", "quick", *type_7, "--seed", "2", "--out", str(tmp_path / "f/b")]) == 0
    assert main(["fleet", str(tmp_path / "f"), "--out", str(tmp_path / "out"), "--workers", "1"]) == 0
    fleet = read_fleet(tmp_path / "out" / "fleet.json")
    truths = {}
    for name, probes in (("a", "123"), ("b", "1")):
        first = open_seal(tmp_path / "f" / f"{name}.sealed")[0]
        for probe in probes:
            truth = of_probe(first, probe)
            truths[serial_number(truth, sensor_name("imet", probe))] = truth
    assert len(truths) == len({truth.thermal_diffusivity_m2_s for truth in truths.values()}) == len(fleet.sensors) == 4
    for sensor in fleet.sensors:
        own = sensor.channels["temperature"].figures[0].own
        truth = truths[sensor.serials["temperature"]]
        assert abs(own.value - truth.thermal_diffusivity_m2_s) < 4 * own.standard_uncertainty
    # The same command goes on with the same sensors.
    capsys.readouterr()
    assert main(["run", "quick", *type_7, "--probes", "3", "--seed", "1", "--out", str(tmp_path / "f/a")]) == 0
    assert "(0 recorded now)" in capsys.readouterr().out


def test_virtual_sensors_of_a_type_differ_by_as_much_as_is_said():
    first = of_type(7, 1, "rough", 0.03)
    probes = [of_probe(first, str(k)) for k in range(2, 200)] + [of_type(7, k, "rough", 0.03) for k in range(99)]
    mean = draw_truth(np.random.default_rng(7), "rough")
    for true in (lambda t: t.thermal_diffusivity_m2_s, lambda t: t.diffusivity_20c_m2_s):
        away = np.log([true(one) / true(mean) for one in probes])
        assert away.std() == pytest.approx(0.03, rel=0.15) and abs(away.mean()) < 0.008
    at_0 = np.log([one.diffusivity_m2_s(0.0) / mean.diffusivity_m2_s(0.0) for one in probes])
    assert at_0.std() == pytest.approx(0.03 * np.sqrt(1 + 1 / 9), rel=0.15)
    again = Truth.from_json(first.to_json())
    assert of_probe(again, "5") == of_probe(first, "5")


def test_an_effect_is_hidden_in_one_probe_alone():
    rng = np.random.default_rng(5)
    usual = of_type(7, 1)
    hidden = draw_hidden(rng, "convective_film@3,stem_conduction@1,finite_transfer")
    bench = Truth.from_json(with_effects(usual, hidden).to_json())
    having = {probe: {one.effect for one in of_probe(bench, probe).effects} for probe in "123"}
    assert having == {
        "1": {"stem_conduction", "finite_transfer"},
        "2": {"finite_transfer"},
        "3": {"convective_film", "finite_transfer"},
    }
    # As in `with_effects`, a bead behind a film of air has a faster body; other probes stay as they were.
    alpha = [of_probe(one, probe).thermal_diffusivity_m2_s for probe in "123" for one in (bench, usual)]
    assert alpha[0] == alpha[1] and alpha[2] == alpha[3] and alpha[4] > 1.5 * alpha[5]


def test_probes_in_one_carriage_leave_at_one_time():
    """The trigger's jitter is the carriage's: beads without a body of their own differ by their noise alone."""
    airs = Air(20.0, 50.0), Air(40.0, 30.0)
    truth = replace(of_type(7, 1), trigger_jitter_s=0.5, thermal_diffusivity_m2_s=1e-5)
    left = []
    for seed, carriage in ((1, None), (2, 1), (2, None)):
        world = World(truth, VirtualClock(), seed, carriage_seed=carriage)
        world.set_airs(*airs, 5.0, 1013.25)
        world.begin_transfer(10.0)
        left.append([world.bead_temperature_c(t) > 30.0 for t in np.arange(8.0, 12.0, 0.002)].index(True))
    assert abs(left[0] - left[1]) <= 1 and abs(left[0] - left[2]) > 10


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--probes", "0"], "expected 1 to 99"),
        (["--spread", "2"], "give --fleet SEED too"),
        (["--fleet", "7", "--spread", "90"], "expected 0.01 to 30"),
        (["--fleet", "7", "--fleet", "8"], "one SEED"),
        (["--fleet", "fleet.json"], "is for shockrig run adaptive"),
        (["--fleet", "0", "--bench", "manual"], "is for emulated instruments"),
        (["--probes", "2", "--bench", "manual"], "is for emulated instruments"),
        (["--probes", "2", "--hide", "stem_conduction@3"], "there is no probe 3; the bench has 1, 2"),
        (["--probes", "2", "--hide", "air_relaxation@2"], "hide it without @2"),
    ],
)
def test_options_of_a_virtual_fleet_that_do_not_fit_are_refused(tmp_path, capsys, options, said):
    assert main(["run", "quick", *options, "--out", str(tmp_path / "c")]) == 2
    assert said in capsys.readouterr().err


def test_four_shocks_and_a_fleet_say_what_a_campaign_does(bench, type_fleet, tmp_path, capsys):
    """D at 0 and 40 degC from runs at 20 degC, within their uncertainty, and the profile can be read and flown."""
    truth = drawn_sensor(type_of_sensors(20), np.random.default_rng(77))
    plan = short_plan()[3:7]
    path = record_sensor(truth, plan, 3, tmp_path / "new", 900)
    type_fleet.write(tmp_path / "fleet.json")
    assert main(["characterize", str(path), "--out", str(tmp_path), "--fleet", str(tmp_path / "fleet.json")]) == 0
    said = capsys.readouterr().out
    assert "fleet: The film belongs to the fleet, which brings" in said
    profile = read_profile(tmp_path / "profile.json")
    assert profile.provenance["belongs_to_fleet"] == {"temperature": True, "humidity": True}
    rows = profile.humidity.diffusivity_table
    assert {0, 20, 40} <= {round(row.ambient_temperature_c) for row in rows}
    alone, one = shockrig.characterize(path), type_fleet.population
    assert 0 not in {round(row.ambient_temperature_c) for row in alone.profile.humidity.diffusivity_table}
    # By its own runs, were these known to differ as those of the fleet do.
    unknown = with_population(alone.result, replace(one, covariance=1e4 * one.covariance)).profile.humidity
    known = {round(row.ambient_temperature_c): row for row in unknown.diffusivity_table}
    for row in rows:
        true = float(truth.diffusivity_m2_s(row.ambient_temperature_c))
        assert abs(row.diffusivity_m2_s - true) < 3.5 * row.standard_uncertainty
        own = known.get(round(row.ambient_temperature_c))
        assert own is None or row.standard_uncertainty < 1.001 * own.standard_uncertainty * row.diffusivity_m2_s / (
            own.diffusivity_m2_s
        )
        product = row.response_time_s.t63_s * row.diffusivity_m2_s  # of the plain film one number
        assert product == pytest.approx(rows[0].response_time_s.t63_s * rows[0].diffusivity_m2_s, rel=1e-3)
    assert "With the fleet" in (tmp_path / "report.html").read_text()


def test_a_flight_is_corrected_by_what_the_type_says(type_fleet, tmp_path, capsys):
    type_fleet.write(tmp_path / "fleet.json")
    write_profile(type_fleet.typical(), tmp_path / "typical.json")
    log = pd.read_csv(shockrig.example("flight.csv")).iloc[:400]
    log.to_csv(tmp_path / "flight.csv", index=False)
    for option, name in (("--fleet", "fleet"), ("--profile", "typical")):
        files = [option, str(tmp_path / f"{name}.json"), "--out", str(tmp_path / f"{name}.csv"), "--no-report"]
        assert main(["correct", str(tmp_path / "flight.csv"), *files]) == 0
    both = [pd.read_csv(tmp_path / f"{name}.csv") for name in ("fleet", "typical")]
    pd.testing.assert_frame_equal(*both, rtol=1e-6)
    corrected = both[0].filter(like="corrected")
    assert corrected.shape[1] and not np.allclose(corrected.iloc[:, 0], log["temperature_c"], atol=1e-3)
    with pytest.raises(SystemExit) as ended:
        main(["correct", str(tmp_path / "flight.csv"), "--out", str(tmp_path / "none.csv")])
    assert ended.value.code == 2 and "--profile --fleet" in capsys.readouterr().err


def test_a_sensor_that_does_not_belong_is_said_and_left_alone(bench, type_fleet, alone_of):
    folder, _ = bench
    alone = alone_of("s3")
    assert not shockrig.characterize(folder / "s3", fleet=type_fleet).fleet.belongs("humidity")
    # Of two sensors, which have one degree of freedom, 30 % are not too far.
    few = replace(type_fleet, population=replace(type_fleet.population, degrees=np.ones(4)))
    assert shockrig.characterize(folder / "s3", fleet=few).fleet.belongs("humidity")
    # As forty sensors would know it.
    known = replace(type_fleet.population, covariance=4e-4 * np.eye(4), degrees=np.full(4, 40.0), run_scatter=None)
    found = shockrig.characterize(folder / "s3", fleet=replace(type_fleet, population=known))
    assert found.fleet.belongs("temperature") and not found.fleet.belongs("humidity")
    assert found.profile.humidity == alone.profile.humidity
    assert any("film does not belong to the fleet" in note for note in found.notes)
    assert found.profile.temperature != alone.profile.temperature
    # How much runs differ is the bench's, whichever sensor it has.
    restless = replace(type_fleet, population=replace(known, run_scatter=RunScatter(0.02, 200.0)))
    of_bench = shockrig.characterize(folder / "s3", fleet=restless).profile.humidity.diffusivity_table
    for row, before in zip(of_bench, alone.profile.humidity.diffusivity_table, strict=True):
        assert row.standard_uncertainty > 1.3 * before.standard_uncertainty
        assert abs(row.diffusivity_m2_s - before.diffusivity_m2_s) < before.standard_uncertainty


def test_a_prior_of_another_body_or_length_is_refused(bench, type_fleet):
    folder, _ = bench
    one = type_fleet.population
    for change, said in (
        ({"bodies": {**one.bodies, "humidity": "plate"}}, "is a film, the fleet's are of plate"),
        ({"lengths_m": {**one.lengths_m, "humidity": 2e-5}}, "state the same length in campaign.json"),
    ):
        with pytest.raises(InputError, match=said):
            shockrig.characterize(folder / "s0", fleet=replace(type_fleet, population=replace(one, **change)))


def test_a_wide_population_changes_nothing_and_a_narrow_one_is_the_answer(bench, type_fleet, alone_of):
    folder, _ = bench
    campaign, one = shockrig.read_campaign(folder / "s0"), type_fleet.population
    alone = alone_of("s0").profile
    one = replace(one, run_scatter=None)
    wide = replace(type_fleet, population=replace(one, covariance=1e4 * one.covariance))
    found = shockrig.characterize(campaign, fleet=wide).profile
    assert found.temperature.thermal_diffusivity_m2_s.value == pytest.approx(
        alone.temperature.thermal_diffusivity_m2_s.value, rel=1e-5
    )
    for a, b in zip(found.humidity.diffusivity_table, alone.humidity.diffusivity_table, strict=True):
        # Rows beside one another say a little of each other, since D is smooth.
        assert abs(a.diffusivity_m2_s - b.diffusivity_m2_s) < 1.5 * b.standard_uncertainty
    result = alone_of("s0").result
    below = replace(wide.population, coordinates=one.coordinates[:3], mean=one.mean[:3])
    below = replace(below, covariance=1e4 * one.covariance[:3, :3], mean_covariance=1e-4 * np.eye(3))
    below = replace(below, degrees=one.degrees[:3])
    beyond = with_population(result, below).profile.humidity.diffusivity_table[-1]  # at 40 degC, the nodes end at 20
    assert beyond.diffusivity_m2_s == pytest.approx(alone.humidity.diffusivity_table[-1].diffusivity_m2_s, rel=1e-3)
    own = with_population(result, one).figures["temperature"][0]
    mean = np.array([np.log(own.own.value), *one.mean[1:]])
    narrow = replace(one, mean=mean, covariance=1e-12 * np.eye(mean.size), mean_covariance=1e-12 * np.eye(mean.size))
    exact = with_population(result, narrow)
    alpha = exact.profile.temperature.thermal_diffusivity_m2_s
    assert alpha.value == pytest.approx(own.own.value, rel=1e-6) and alpha.standard_uncertainty < 1e-5 * alpha.value


@pytest.mark.trial
def test_goals_are_reached_with_fewer_runs_where_the_type_is_known(bench, type_fleet, alone_of):
    """D at 0 and 40 degC from runs at 20 degC: done with a narrow type, to be recorded without."""
    folder, _ = bench
    campaign = shockrig.read_campaign(folder / "s1")
    at_20 = replace(campaign, runs=tuple(r for r in campaign.runs if abs(r.destination.temperature_c - 20.0) < 1.0))
    one = type_fleet.population
    film = with_population(alone_of("s1").result, one)
    mean = np.array([one.mean[0], *(np.log(f.shrunk.value) for f in film.figures["humidity"])])
    alike = 4e-4 * np.full((4, 4), 0.9999) + 4e-8 * np.eye(4)  # sensors differ by one factor of D at all temperatures
    known = replace(one, mean=mean, covariance=alike, mean_covariance=1e-10 * np.eye(4), degrees=np.full(4, 40.0))
    until = "D 2 % at 0 20 40"
    alone = shockrig.plan(at_20, until=until, runs=2)
    assert alone.status == "continue" and {r["destination"]["temperature_c"] for r in alone.runs} & {0.0, 40.0}
    helped = shockrig.plan(at_20, until=until, fleet=replace(type_fleet, population=known))
    assert helped.status == "done", helped.reason


def test_before_its_own_runs_a_sensor_is_known_as_its_type_is(bench, type_fleet, tmp_path, capsys):
    one = type_fleet.population
    spread = 100 * np.sqrt(np.diag(one.predictive))
    type_fleet.write(tmp_path / "fleet.json")
    empty = ["plan", str(tmp_path / "new"), "--until", "alpha 0.1 %, D 0.1 % at 20", "--out", str(tmp_path / "n.toml")]
    assert main([*empty, "--fleet", str(tmp_path / "fleet.json")]) == 0
    said = capsys.readouterr().out
    assert f"alpha is known to {spread[0]:.2g} % by the fleet alone" in said and "known yet" not in said
    goals = json.loads((tmp_path / "n.json").read_text())["goals"]
    assert [goal["now"] for goal in goals] == pytest.approx([spread[0], spread[2]], rel=1e-3)
    assert not any(goal["met"] for goal in goals)
    assert main(empty) == 0 and "is not known yet" in capsys.readouterr().out
    campaign = shockrig.read_campaign(bench[0] / "s0")
    films = [run for run in campaign.runs if run.source.temperature_c == run.destination.temperature_c]
    of_film = replace(campaign, runs=tuple(films))
    assert shockrig.plan(of_film, until="alpha 0.1 %", fleet=type_fleet).goals[0]["now"] == pytest.approx(spread[0])


def test_how_much_runs_differ_is_learned_from_benches_as_far_as_these_are_alike():
    rng = np.random.default_rng(31)

    def cost(scatter):
        spread = np.full(28, 0.0025)
        own = rng.normal(0.0, np.hypot(scatter, spread))
        return restricted(TRIALS, [OwnRates(own, spread, np.zeros(28, dtype=int))])

    alike = scatter_of_benches([cost(0.008) for _ in range(30)])
    unlike = scatter_of_benches([cost(0.008 * np.exp(0.3 * rng.standard_normal())) for _ in range(30)])
    lone = scatter_of_benches([cost(0.008)])
    assert alike.standard_deviation == pytest.approx(0.008, rel=0.1) and alike.degrees > 40.0
    assert unlike.standard_deviation == pytest.approx(0.008, rel=0.25)
    assert lone.degrees < unlike.degrees < 12.0  # 0.3 of ln sigma are 6 degrees
    assert scatter_of_benches([]) is None


def test_a_few_runs_are_as_uncertain_as_runs_of_the_fleet_differ(type_fleet, alone_of, tmp_path):
    result, one = alone_of("s0").result, type_fleet.population
    assert one.run_scatter.standard_deviation == pytest.approx(type_of_sensors(20).rate_scatter, rel=0.4)
    wide = replace(one, covariance=1e4 * one.covariance)
    calm, restless = (
        with_population(result, replace(wide, run_scatter=RunScatter(s, 200.0))).figures["temperature"][0]
        for s in (0.002, 0.02)
    )
    assert restless.shrunk.standard_uncertainty > 2.0 * calm.shrunk.standard_uncertainty
    assert restless.own == calm.own  # what it is by itself stays
    type_fleet.write(tmp_path / "fleet.json")
    assert read_fleet(tmp_path / "fleet.json").population.run_scatter == one.run_scatter
