"""Plain checks of the input: every slip is named for what it is, and right campaigns are left alone.

A fixed sample of benchmarks/input_checks.py; the full table is kept in benchmarks/results/input_checks.txt.
"""

import json
import shutil
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from benchmark_scripts import benchmark
from small_worlds import record

from shockrig.analysis.checks import CHECKS, check_campaign
from shockrig.analysis.checks.finding import THRESHOLDS, limit, name_runs
from shockrig.analysis.checks.rates import begins_after, responses, two_groups
from shockrig.analysis.checks.signals import look
from shockrig.files.campaign import Campaign, Run, RunAir, Trace, read_campaign
from shockrig.files.errors import InputError
from shockrig.files.misspelt import CAMPAIGN_KEYS, misspelt
from shockrig.protocols.cli import main
from shockrig.rig.virtual.hide import draw_hidden
from shockrig.rig.virtual.plans import wide_plan

slips = benchmark("input_slips")
SLIPS = benchmark("input_slip_table").SLIPS
trials = benchmark("input_checks")
ROOT = Path(__file__).parents[2]
SEED = 42_001
# One of each sort; the benchmark tries them all, in twenty campaigns.
LEFT_TO_THE_BENCHMARK = ("not stated", "in one run", "of one run", "in a third", "every second", "the die", "in memory")
SAMPLE = [slip for slip in SLIPS if not any(words in slip.name for words in LEFT_TO_THE_BENCHMARK)]


@pytest.fixture(scope="module")
def pairs(tmp_path_factory):
    """A clean campaign's folder, the campaign, and the same plan on another pair of sensors."""
    return trials.two_pairs(SEED, tmp_path_factory.mktemp("pairs"))


def lag(tau_s, *, noise=0.0, step=20.0, start=10.0, length=60.0, period=0.1, seed=0, name="r"):
    """One run of a first-order thermometer, from 10 degC, in closed form."""
    time = np.arange(0.03, length, period)
    value = 10.0 + step * np.where(time > start, 1.0 - np.exp(-np.maximum(time - start, 0.0) / tau_s), 0.0)
    value = value + noise * np.random.default_rng(seed).standard_normal(time.size)
    airs = RunAir(10.0, 40.0), RunAir(10.0 + step, 40.0)
    return Run(name, *airs, 5.0, 1013.25, start, None, Trace(time, {"temperature_c": value}), None)


def thermometer(*runs, **sensor):
    return Campaign("t", Path("t"), {"imet": sensor}, 4e-4, 1e-5, tuple(runs))


def kinds(campaign):
    return [finding.kind for finding in check_campaign(campaign)]


@pytest.mark.parametrize("slip", SAMPLE, ids=lambda slip: slip.name)
def test_every_slip_is_named_and_nothing_beside_it(slip, pairs):
    word, beside = trials.outcome(slip, *pairs, SEED)
    assert word == ("refused" if slip.refused else "caught")
    assert beside == []


def test_a_key_that_is_nearly_another_is_said_with_the_runs_that_have_it(pairs, tmp_path):
    folder = tmp_path / "c"
    shutil.copytree(pairs[0], folder)
    head = json.loads((folder / "campaign.json").read_text())
    head["sensorz"] = head.pop("sensors")
    head["sensors_seen_by"] = "somebody"  # a key of one's own
    (folder / "campaign.json").write_text(json.dumps(head))
    names = sorted(p.name for p in (folder / "runs").iterdir())
    for name in names[2:4]:
        run = json.loads((folder / "runs" / name / "run.json").read_text())
        run["airflow"] = run.pop("airflow_m_s")
        run["source"]["temperature"] = 20.0  # beside the right one
        (folder / "runs" / name / "run.json").write_text(json.dumps(run))
    of_keys = [f for f in check_campaign(read_campaign(folder)) if f.kind == "misspelt_key"]
    assert [(f.runs, f.severity) for f in of_keys] == [((), "warn"), *[(tuple(names[2:4]), "warn")] * 2]
    assert "key sensorz: is sensors meant?" in of_keys[0].sentence
    of_runs = " ".join(f.sentence for f in of_keys[1:])
    assert "key airflow: is airflow_m_s meant?" in of_runs
    assert "key source.temperature: temperature_c stands beside it and counts, is one too many? It says" in of_runs


@pytest.mark.parametrize(
    ("sensors", "beside", "said"),
    [
        ({"imett": {"kind": "imet-xf"}}, {}, "key sensors.imett: is imet meant?"),
        ({"imet-2": {"serail": "7"}}, {}, "key sensors.imet-2.serail: is serial meant?"),
        ({}, {"bead_radius_m": 4e-4}, "key bead_radius_m: is sensors.imet.bead_radius_m meant?"),
        ({"film_thickness_m": 1e-5}, {}, "key sensors.film_thickness_m: is sensors.hyt.film_thickness_m meant?"),
        (
            {"imet": {"bead_radius": 4e-4, "bead_radius_m": 5e-4}},
            {},
            "key sensors.imet.bead_radius: bead_radius_m stands beside it and counts, is one too many?",
        ),
    ],
)
def test_a_slip_in_what_is_said_of_the_sensors_is_told(sensors, beside, said):
    """Before: a sensor's name, a second probe's keys and a key one level off were ignored without a word."""
    assert list(misspelt({"name": "c", "sensors": sensors} | beside, CAMPAIGN_KEYS)) == [said]


def test_a_plan_that_is_not_done_is_said_once(pairs, tmp_path, capsys):
    """What is wrong with the input had been said as progress and then with the result; of a part nothing was said."""
    folder = shutil.copytree(pairs[0], tmp_path / "c")
    head = json.loads((folder / "campaign.json").read_text())
    names = sorted(path.name for path in (folder / "runs").iterdir())
    head |= {"plan": [{"id": name} for name in names], "operater": "A. Uthor"}
    (folder / "campaign.json").write_text(json.dumps(head))
    assert [one.kind for one in check_campaign(read_campaign(folder))] == ["misspelt_key"]
    for name in names[5:]:
        shutil.rmtree(folder / "runs" / name)
    for command in ("characterize", "certify"):
        assert main([command, str(folder), "--out", str(tmp_path / command)]) == 0
        said = "".join(capsys.readouterr())
        missing = len(names) - 5
        assert (
            said.count(f"Of the plan {missing} of {len(names)} runs ({', '.join(names[5:8])}, ...) are not there") == 1
        )
        assert said.count("key operater: is operator meant?") == 1
    assert "What looks wrong with the input" in (tmp_path / "characterize" / "report.html").read_text()
    assert "or was interrupted" in (tmp_path / "certify" / "certificate.html").read_text()


def test_what_is_right_is_left_alone(pairs):
    _, first, second = pairs
    assert check_campaign(first) == check_campaign(second) == ()


@pytest.mark.parametrize("variant", sorted(trials.variants(np.random.default_rng(0), True)))
def test_what_other_labs_leave_out_is_no_fault(variant, pairs):
    _, campaign, _ = pairs
    assert check_campaign(trials.variants(np.random.default_rng(0), True)[variant](campaign)) == ()


@pytest.mark.parametrize(("which", "seed", "plan"), [(4, 42_100, wide_plan), ("outside", 42_101, wide_plan)])
def test_what_a_diagnosis_is_for_is_no_fault_of_the_input(which, seed, plan, tmp_path):
    hidden = draw_hidden(np.random.default_rng(seed), which)
    assert check_campaign(record(tmp_path / "c", seed, hidden, "rough", plan())) == ()


@pytest.mark.parametrize("name", ["plain-rough", "ordinary-bench"])
def test_another_programs_campaigns_are_left_alone(name):
    assert check_campaign(read_campaign(ROOT / "data" / "examples" / name)) == ()


def test_a_sentence_says_cause_numbers_and_remedy(pairs):
    _, campaign, _ = pairs
    spoiled = slips.each(campaign, slips.bead(slips.fahrenheit), lambda i: i == 3)
    (finding,) = check_campaign(spoiled)
    assert (finding.kind, finding.channel, finding.severity) == ("fahrenheit", "temperature", "stop")
    assert finding.runs == (campaign.runs[3].id,)
    reading, air = campaign.runs[3].imet.values["temperature_c"], campaign.runs[3].source.temperature_c
    before = float(np.median(reading[campaign.runs[3].imet.time_s < 9.0])) * 1.8 + 32.0
    assert f"{before:.3g}"[:3] in finding.sentence
    assert f"{air:.4g}" in finding.sentence
    assert "(value - 32) / 1.8" in finding.sentence
    assert "\n" not in finding.sentence


def test_two_faults_are_said_as_two(pairs):
    _, campaign, _ = pairs
    spoiled = slips.each(campaign, slips.bead(slips.fahrenheit))
    spoiled = slips.each(spoiled, slips.swapped_airs, lambda i: i == 0)
    assert sorted(kinds(spoiled)) == ["airs_swapped", "fahrenheit"]


def test_airs_in_which_the_probes_did_not_stand_are_said(pairs):
    """A source 15 K off: its run is left out where others agree, and said where it is the only one."""
    _, campaign, _ = pairs

    def moved(run):
        return replace(run, source=replace(run.source, temperature_c=run.source.temperature_c + 15.0))

    downwards = [run.source.temperature_c - run.destination.temperature_c > 5.0 for run in campaign.runs]
    which = downwards.index(True)
    spoiled = slips.each(campaign, moved, lambda i: i == which)
    (finding,) = check_campaign(spoiled)
    wrong = spoiled.runs[which]
    assert (finding.kind, finding.channel, finding.severity) == ("airs_disagree", "temperature", "stop")
    assert finding.runs == (wrong.id,)
    assert f"which is said to have {wrong.source.temperature_c:.1f} °C" in finding.sentence
    (alone,) = check_campaign(replace(spoiled, runs=[wrong]))
    assert (alone.kind, alone.severity) == ("airs_disagree", "warn")
    assert check_campaign(slips.each(spoiled, slips.without("start"))) == ()


def test_a_wrong_length_counts_only_where_it_is_stated():
    runs = [lag(1.0, noise=0.01, seed=i, name=f"{i}") for i in range(4)]
    assert kinds(thermometer(*runs, bead_radius_m=0.4)) == ["length_in_millimetres"]
    assert kinds(thermometer(*runs, bead_radius_m=400.0)) == ["length_in_micrometres"]
    assert kinds(thermometer(*runs)) == []
    lump = replace(thermometer(*runs, bead_radius_m=0.4), bodies={"imet": "lumped", "hyt": "film"})
    assert kinds(lump) == []


def test_a_response_time_is_that_of_the_closed_form():
    """To 63 % a first-order lag takes its time constant, whatever the phase of the sampling and the thinning."""
    for tau in (0.3, 2.0, 8.0):
        (found,) = responses(look(thermometer(lag(tau, noise=0.005))), "temperature")
        assert found.t63_s == pytest.approx(tau, rel=0.01)


def test_a_response_begins_when_its_closed_form_says():
    """A lag shows 1 % after -ln 0.99 time constants; its rise from 10 to 63.2 % takes 1 + ln 0.9 of them."""
    assert begins_after("lag", 0.01) == pytest.approx(-np.log(0.99) / (1.0 + np.log(0.9)), rel=0.01)


def test_a_start_between_two_readings_is_not_blamed_for_a_gap():
    run = lag(0.5, noise=0.01)
    kept = (run.imet.time_s < 9.0) | (run.imet.time_s > 10.2)  # the readings around the transfer are lost
    gap = Trace(run.imet.time_s[kept], {"temperature_c": run.imet.values["temperature_c"][kept]})
    assert kinds(thermometer(replace(run, imet=gap))) == []
    assert kinds(thermometer(replace(run, imet=gap, start_s=6.0))) == ["start_disagrees"]


def test_a_start_before_the_record_says_where_the_record_begins():
    """A log that begins at its trigger has its first row up to one period later: that is no contradiction."""
    run = replace(lag(5.0, start=0.0, noise=0.01), start_s=-0.05)  # rows at 0.03 s and every 0.1 s
    assert "start_disagrees" not in kinds(thermometer(run))
    (finding,) = (f for f in check_campaign(thermometer(replace(run, start_s=-0.5))) if f.kind == "start_disagrees")
    assert "run r goes from 0.03 to 59.93 s, its start is -0.5 s" in finding.sentence


def test_a_record_that_begins_at_its_trigger_is_not_taken_for_a_dead_sensor():
    """Its first readings are no plateau: a quick sensor has nearly arrived within them."""
    for start_s in (0.0, 0.2):
        assert kinds(thermometer(lag(0.3, start=start_s, noise=0.01, length=150.0))) == []


def test_a_measured_air_silences_what_needs_a_step():
    air = Trace(np.arange(0.0, 60.0, 0.5), {"temperature_c": np.full(120, 20.0)})
    assert kinds(thermometer(replace(lag(1.0, start=10.0), start_s=40.0))) == ["start_disagrees"]
    assert kinds(thermometer(replace(lag(1.0, start=10.0), start_s=40.0, air=air))) == []


def test_a_coarse_resolution_is_neither_dead_nor_a_rail():
    runs = []
    for i, step in enumerate((20.0, 0.0, -15.0)):
        run = lag(1.0, step=step, noise=0.01, seed=i, name=f"{i}")
        coarse = np.round(run.imet.values["temperature_c"] / 0.5) * 0.5
        runs.append(replace(run, imet=Trace(run.imet.time_s, {"temperature_c": coarse})))
    assert kinds(thermometer(*runs)) == []


def test_repeats_without_noise_are_no_copies():
    """A calculated campaign repeats itself exactly; only noise tells a copy."""
    assert kinds(thermometer(*(lag(1.0, name=f"{i}") for i in range(3)))) == []
    shaken = lag(1.0, noise=0.01)
    assert kinds(thermometer(*(replace(shaken, id=f"{i}") for i in range(3)))) == ["run_copied"]


def test_seconds_of_a_slow_logger_are_no_milliseconds():
    def every(period, tau):
        length = 20.0 * period + 6.0 * tau
        return thermometer(lag(tau, noise=0.01, start=20.0 * period, length=length, period=period))

    assert kinds(every(30.0, 300.0)) == kinds(every(60.0, 300.0)) == kinds(every(10.0, 400.0)) == []
    assert kinds(every(100.0, 1000.0)) == kinds(every(10.0, 5000.0)) == ["milliseconds"]
    (found,) = check_campaign(every(100.0, 1000.0))
    assert found.severity == "stop"
    other = replace(every(100.0, 1000.0), sensors={"imet": {"kind": "porous silicon", "body": "lumped"}})
    (found,) = check_campaign(other)  # how slow that is nobody knows
    assert found.severity == "warn" and "changed so slowly itself" in found.sentence


def test_two_groups_are_those_of_every_labelling():
    """The search against all labellings of twelve runs, each fitted by least squares."""
    rng = np.random.default_rng(5)
    n, slope = 12, np.linspace(-1.0, 1.0, 12)
    conditions = [np.ones(n), slope, np.tile([0.0, 1.0], 6)]
    y = rng.standard_normal(n) + 4.0 * np.array([0, 1, 1, 0, 1, 0, 0, 1, 1, 0, 0, 1])
    found = two_groups(y, conditions, None, smallest_share=0.3)
    least = np.inf
    for labels in product((0.0, 1.0), repeat=n):
        if 4 <= sum(labels) <= 8:
            design = np.column_stack([*conditions, labels])
            rest, rank = np.linalg.lstsq(design, y, rcond=1e-8)[1:3]
            inner = np.linalg.lstsq(design[:, :3], np.array(labels), rcond=None)[0]
            own = np.sum((np.array(labels) - design[:, :3] @ inner) ** 2)
            share = np.mean(labels)
            if rank == 4 and own > 0.15 * n * share * (1 - share):
                least = min(least, float(rest[0]))
    assert found.scatter**2 * (n - 4) == pytest.approx(least, rel=1e-9)


def test_two_groups_are_found_and_chance_is_not_taken_for_them():
    rng = np.random.default_rng(6)
    n = 20
    conditions = [np.ones(n), rng.standard_normal(n)]
    cried = 0
    for _ in range(15):
        labels = rng.permutation(n) < n // 2
        noise = 0.01 * rng.standard_normal(n)
        found = two_groups(0.2 * labels + conditions[1] + noise, conditions)
        assert np.array_equal(found.second, labels) or np.array_equal(found.second, ~labels)
        assert found.difference == pytest.approx(0.2, abs=0.02)
        assert found.chance < limit("group_chance")
        cried += two_groups(conditions[1] + noise, conditions).chance < limit("group_chance")
    assert cried == 0


def test_runs_in_words():
    assert name_runs(["a"], 5) == "run a"
    assert name_runs(["a", "b"], 5) == "runs a and b"
    assert name_runs("abcde", 5) == "all 5 runs"
    assert name_runs("abcde", 9) == "5 of 9 runs (a, b, c, ...)"


def test_every_threshold_says_what_it_is_and_is_used():
    code = "".join(path.read_text() for path in (ROOT / "analysis" / "checks").glob("*.py"))
    for name, threshold in THRESHOLDS.items():
        assert threshold.meaning, name
        assert threshold.source, name
        assert code.count(f'"{name}"') > 1, f"{name} is in no check"
    with pytest.raises(KeyError):
        limit("no such threshold")


def test_the_document_names_every_kind():
    text = (ROOT / "docs" / "input_checks.md").read_text()
    for kind in {kind for slip in SLIPS for kind in slip.kinds}:
        assert f"`{kind}`" in text
    assert len(CHECKS) == len(set(CHECKS))


def test_an_empty_campaign_is_silent():
    bare = Run("1", RunAir(None, None), RunAir(None, None), None, 1013.25, None, None, None, None)
    assert check_campaign(thermometer(bare)) == ()


def test_the_reader_names_kelvin_in_run_json(tmp_path, pairs):
    folder, _, _ = pairs
    slip = next(slip for slip in SLIPS if slip.name == "kelvin: run.json alone")
    with pytest.raises(InputError, match="kelvin"):
        trials.spoiled(slip, folder, None, None, 0)


def every_time(campaign, factor):
    """The tables' times of a campaign in another unit."""

    def change(run):
        scaled = {
            name: replace(trace, time_s=trace.time_s * factor)
            for name in ("imet", "hyt")
            if (trace := getattr(run, name)) is not None
        }
        return replace(run, **scaled)

    return replace(campaign, runs=tuple(map(change, campaign.runs)))


def test_times_in_minutes_are_said(pairs):
    """Starts in seconds speak against them for certain; where these are in minutes too, the pace does."""
    _, campaign, _ = pairs
    (found,) = [f for f in check_campaign(every_time(campaign, 1 / 60)) if f.kind == "minutes"]
    assert found.severity == "stop" and "multiply it by 60" in found.sentence
    starts = tuple(replace(run, start_s=run.start_s / 60) for run in every_time(campaign, 1 / 60).runs)
    (found,) = [f for f in check_campaign(replace(campaign, runs=starts)) if f.kind == "minutes"]
    assert found.severity == "warn" and "0.1 s in minutes" in found.sentence


@pytest.mark.parametrize("by_k", [2.0, -2.0])
def test_airs_that_bead_and_die_contradict_together_are_said(pairs, by_k):
    _, campaign, _ = pairs
    off = slips.each(campaign, slips.airs(lambda celsius: None if celsius is None else celsius + by_k))
    (found,) = [f for f in check_campaign(off) if f.kind == "airs_disagree"]
    assert found.severity == "warn" and len(found.runs) == len(campaign.runs)
    assert f"read 2 K {'less' if by_k > 0 else 'more'}" in found.sentence


def test_a_destination_stated_too_warm_is_no_dead_thermometer(pairs):
    """In runs of humidity alone the air is then said to step by 2 K: bead and die show noise and no step."""
    _, campaign, _ = pairs

    def warmer(run):
        air = run.destination
        return (
            run
            if air.temperature_c is None
            else replace(run, destination=replace(air, temperature_c=air.temperature_c + 2))
        )

    assert any(abs(run.source.temperature_c - run.destination.temperature_c) < 0.5 for run in campaign.runs)
    assert {f.kind for f in check_campaign(slips.each(campaign, warmer))} == {"airs_disagree"}


def test_cooling_water_is_not_said_to_be_in_milliseconds():
    """An hour's rise read every 30 s: where the log names its unit nothing is said, and else both that may be."""
    slow = lag(4000.0, length=40000.0, period=30.0, noise=0.02)
    (found,) = [f for f in check_campaign(thermometer(slow)) if f.kind == "milliseconds"]
    assert found.severity == "warn" and "what was measured changed so slowly itself" in found.sentence
    named = replace(slow, extra={"imported": {"times": "named"}})
    assert "milliseconds" not in kinds(thermometer(named))


def test_an_oven_that_was_cold_before_is_not_in_kelvin():
    """Its readings go from a room to 240 degC; of another run, whose record begins in the heat, the others tell."""
    runs = [lag(2.0, noise=0.02, seed=i, name=f"{i}") for i in range(3)]
    for run in runs:
        readings = run.imet.values["temperature_c"]
        readings[:] = 20.0 + 220.0 * (readings - readings.min()) / np.ptp(readings)
    runs[2].imet.values["temperature_c"][:] = 200.0 + runs[2].imet.values["temperature_c"] / 5.0
    assert "kelvin" not in kinds(thermometer(*runs))
    for run in runs[:2]:
        run.imet.values["temperature_c"][:] = runs[2].imet.values["temperature_c"]
    assert "kelvin" in kinds(thermometer(*runs))


@pytest.mark.parametrize("usual_c, lost, kind", [(110.0, 186.0, "dead_sensor"), (20.0, 293.0, "kelvin")])
def test_a_run_is_in_kelvin_where_that_brings_it_nearer_to_the_others(usual_c, lost, kind):
    runs = [lag(2.0, noise=0.02, seed=i, name=f"{i}") for i in range(3)]
    for run in runs:
        run.imet.values["temperature_c"] += usual_c - 20.0
    last = runs[2].imet
    some = replace(last, dropped={"implausible": 2 * last.time_s.size}, impossible={"temperature_c": lost})
    found = check_campaign(thermometer(*runs[:2], replace(runs[2], imet=some)))
    assert [f.kind for f in found if f.runs == ("2",) and f.severity == "stop"] == [kind]
