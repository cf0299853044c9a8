"""What to record next: goals, minutes, what a run would tell, evidence from later runs, and when to stop."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from importlib import resources

import jsonschema
import numpy as np
import pytest
from benchmark_scripts import benchmark
from small_worlds import QUIET

from shockrig.analysis.design.choose import choose_runs
from shockrig.analysis.design.evidence import (
    REJECTED_FROM,
    Dispute,
    OpenDispute,
    against,
    expected,
    of_second_probe,
    student,
)
from shockrig.analysis.design.goals import Goals, Precision, parse_goals
from shockrig.analysis.design.information import information, nats
from shockrig.analysis.design.menu import PlannedShock, Surroundings, Usual, deciding_menu, opening, precision_menu
from shockrig.analysis.design.minutes import USUAL_BETWEEN_RECORDS, learn, moves, spent_minutes
from shockrig.analysis.design.prospects import Prospects
from shockrig.analysis.design.recorded_so_far import farthest, variety
from shockrig.analysis.design.targets import Target, gained_by, measured, targets
from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.diagnose.prepare import prepare
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.estimate.fit import fit
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import PLAIN, Model
from shockrig.analysis.estimate.refitting import plain_fit, refit
from shockrig.analysis.plan.decide import decide
from shockrig.analysis.plan.decision import (
    CONTINUE,
    DONE,
    INCONCLUSIVE,
    Decision,
    chosen,
    ended_by,
    log_entry,
    plan_document,
    remembered,
)
from shockrig.analysis.plan.look import ChannelLook, Conclusion, look_at, spending
from shockrig.analysis.report.loop_page import chosen_section
from shockrig.files.campaign import Run, RunAir
from shockrig.files.errors import InputError
from shockrig.files.plan_file import append_decision, read_decisions, where_it_stands
from shockrig.rig.virtual.hide import draw_effect
from shockrig.rig.virtual.truth import ROUGH, Hidden, TrueNoise, draw_truth

bench_script = benchmark("loop_bench")
UP, DOWN = PlannedShock(20.0, 20.0, 20.0, 80.0, dwell_s=30.0), PlannedShock(20.0, 80.0, 20.0, 20.0, dwell_s=30.0)
COOL, WARM = PlannedShock(40.0, 17.0, 20.0, 55.0, dwell_s=20.0), PlannedShock(20.0, 55.0, 40.0, 17.0, dwell_s=20.0)
LIVELY = replace(
    QUIET,
    temperature_noise=TrueNoise(0.015),
    humidity_noise=TrueNoise(0.07),
    temperature_step_k=0.01,
    humidity_step_percent=100 / 16383,
)


def recorded(folder, truth, shocks, seed=0, travel_s_per_k=0.0):
    bench = bench_script.FileBench(truth, folder / "c", seed, travel_s_per_k)
    for shock in shocks:
        bench.record_run(shock.as_run())
    return bench


# ---- goals


def test_goals_are_read_as_people_write_them():
    goals = parse_goals("alpha 0.2 %, D 0.3 %, D 0.5 % at 0 -10, t63 1%, ties decided, minutes 90")
    assert goals.precisions == (
        Precision("alpha", 0.002),
        Precision("D", 0.003),
        Precision("D", 0.005, (0.0, -10.0)),
        Precision("t63", 0.01),
    )
    assert goals.ties and goals.minutes == 90.0 and goals.ambients_c == (-10.0, 0.0, 10.0, 20.0, 30.0, 40.0)
    assert parse_goals(str(goals)) == goals
    assert parse_goals("D 0.3 % at 20").ambients_c == (20.0,)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("alpha", "'alpha' is no goal; write e.g."),
        ("alpha 0 %", "more than 0 and less than 50"),
        ("alpha 60 %", "more than 0 and less than 50"),
        ("minutes 90", "names nothing to be reached"),
        ("", "is no goal"),
        ("beta 1 %", "is no goal"),
        ("D 0.3 % at 20 293", "293 cannot be; expected -100 to 150 .is it in kelvin or fahrenheit"),
        ("D 0.3 % at -300", "-300 cannot be"),
    ],
)
def test_what_is_no_goal(text, said):
    with pytest.raises(InputError, match=f"--until: .*{said}"):
        parse_goals(text)


def test_the_strictest_of_two_goals_counts_where_both_hold():
    wanted = {t.ambient_c: t.wanted for t in targets(parse_goals("D 0.5 %, D 0.2 % at 0"), None)}
    assert wanted == {0.0: 0.002, 10.0: 0.005, 20.0: 0.005, 30.0: 0.005, 40.0: 0.005}


# ---- the menu and its minutes


def test_the_menu_varies_everything_that_a_bench_can_vary():
    menu = deciding_menu([20.0], Usual(other=Surroundings((700.0,), (800.0,))))
    assert {s.airflow_m_s for s in menu} == {1.8, 6.0, 12.0} and {s.transfer_s for s in menu} == {None, 2.0}
    assert {s.lead_s for s in menu} == {6.0, 30.0} and {s.pressure_hpa for s in menu} == {1013.25, 700.0}
    assert len({s.dwell_s for s in menu}) == 2 and {s.irradiance_w_m2 for s in menu} == {0.0, 800.0}
    signs = {(np.sign(s.destination_c - s.source_c), np.sign(s.destination_percent - s.source_percent)) for s in menu}
    assert {(0.0, 1.0), (0.0, -1.0), (-1.0, 1.0), (1.0, -1.0)} <= signs
    every = precision_menu((0.0, 40.0), Usual(), lambda t, isothermal: 10.0)
    assert all(0.0 <= t <= 40.0 for s in every for t in (s.source_c, s.destination_c))


def test_minutes_are_learnt_from_the_bench_itself(tmp_path):
    """A chamber of 5 s/K; a film that settles by 60 %RH to 0.1 %RH after a soak of 12 s and a way back of 2 s."""
    near, far = replace(UP, dwell_s=8.0), PlannedShock(30.0, 20.0, 30.0, 80.0, dwell_s=8.0)
    bench = recorded(tmp_path, QUIET, [near, far, near, far, near, near, near], travel_s_per_k=5.0)
    learnt = learn(bench.campaign())
    here = (20.0, 20.0, 20.0, 80.0)
    stay, travel = learnt.between_s(here, near.airs), learnt.between_s(here, far.airs)
    assert len(moves(bench.campaign().runs)) == 6
    assert travel - stay == pytest.approx(50.0, rel=0.15)
    film_s = 4.0 * QUIET.film_thickness_m**2 / (np.pi**2 * float(QUIET.diffusivity_m2_s(20.0)))
    assert stay == pytest.approx(14.0 + film_s * np.log(600.0), rel=0.15)
    assert sum(spent_minutes(bench.campaign()).values()) == pytest.approx(bench.minutes, rel=0.05)


def test_a_bench_of_which_nothing_is_known_is_taken_for_a_usual_one():
    assert (learn(None).coefficients == USUAL_BETWEEN_RECORDS).all()


# ---- what a run would tell


def test_a_run_brings_the_information_that_was_expected_of_it(tmp_path):
    """Normal equations with a run that was recorded, less those without it: what `information` said before."""
    campaign = recorded(tmp_path, LIVELY, [UP, DOWN, COOL, WARM, UP, DOWN, COOL]).campaign()
    for name, shock, index in (("humidity", DOWN, 5), ("temperature", COOL, 6)):
        ready = prepare(build_channel(campaign, name))
        problem = ready.problem.with_rate_scatter(0.004)
        theta = np.log([0.7] if name == "temperature" else [0.08, 0.12])
        found = fit(problem, PLAIN, theta, adapt_scatter=False)
        others = np.array([i for i in range(7) if i != index])
        without = fit(problem.select(others), PLAIN, found.theta, adapt_scatter=False)
        told = information(problem.select(others), without, ready.noise, [shock, replace(shock, dwell_s=8.0)], [])
        came = (found.arrow.normal - without.arrow.normal)[0, 0]
        assert told.added[0, 0, 0] == pytest.approx(came, rel=0.05)
        assert told.added[1, 0, 0] <= told.added[0, 0, 0] * 1.001


def test_nats_are_half_the_change_of_the_log_determinant_of_what_is_wanted():
    """Against covariances with all parameters in them; and n equal runs of one rate: ln sqrt(n / (n - 1))."""
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(30, 5))
    before, after = rows[:20].T @ rows[:20], rows.T @ rows
    wanted = np.ix_([0, 3], [0, 3])
    dets = [np.linalg.det(np.linalg.inv(normal)[wanted]) for normal in (before, after)]
    assert nats(before, after, [0, 3]) == pytest.approx(0.5 * np.log(dets[0] / dets[1]))
    assert nats(np.array([[6.0]]), np.array([[7.0]]), [0]) == pytest.approx(0.5 * np.log(7 / 6))


def test_what_a_run_brought_is_told_by_its_own_record(tmp_path):
    """As much as was expected of it; less where it was noisy, nothing where it was lost; its value does not matter."""
    wanted = targets(parse_goals("D 0.3 % at 20"), None)
    bench = recorded(tmp_path / "well", LIVELY, [UP, DOWN, UP, DOWN, UP])
    before = decide(bench.seen(), parse_goals("D 0.01 % at 20"))
    part = measured(bench.campaign()).humidity
    told = information(part.parts[0].problem, part.parts[0].fit, part.noise, [DOWN], [20.0])
    bench.record_run(DOWN.as_run())
    well = gained_by({"0006"}, measured(bench.campaign()), wanted)
    assert well == pytest.approx(nats(told.known, told.known + told.added[0], [0]), rel=0.15)
    later = decide(bench.seen(), parse_goals("D 0.01 % at 20"), before)
    assert later.gained == pytest.approx(well, rel=1e-6)
    assert well == pytest.approx(0.5 * np.log(6 / 5), rel=0.05)  # runs that are as good as one another
    noisy = recorded(tmp_path / "noisy", LIVELY, [UP, DOWN, UP, DOWN, UP])
    noisy.truth = replace(LIVELY, humidity_noise=TrueNoise(0.7))
    noisy.record_run(DOWN.as_run())
    assert gained_by({"0006"}, measured(noisy.campaign()), wanted) < 0.5 * well
    assert gained_by({"0007"}, measured(bench.campaign()), wanted) == 0.0


def test_an_ambient_without_runs_is_worth_most(tmp_path):
    campaign = recorded(tmp_path, LIVELY, [UP, DOWN, UP, COOL]).campaign()
    part = measured(campaign).humidity
    there, elsewhere = UP, PlannedShock(0.0, 20.0, 0.0, 80.0, dwell_s=60.0)
    told = information(part.parts[0].problem, part.parts[0].fit, part.noise, [there, elsewhere], [0.0, 20.0])
    assert told.ambients_c == pytest.approx([20.0, 0.0], abs=0.1)
    now = told.variances(told.known)
    assert now[1] == pytest.approx(0.25, rel=0.01)
    assert told.variances(told.known + told.added[1])[1] < 1e-3
    assert told.variances(told.known + told.added[0])[1] == pytest.approx(0.25, rel=0.01)


def test_progress_is_the_share_of_the_information_that_is_wanted():
    target = Target("humidity", 20.0, "D", 0.003, 0.006, 4)
    assert target.reached(0.006**2, 4) == pytest.approx(0.25)
    assert target.reached(0.001**2, 4) == 1.0
    assert target.reached(0.001**2, 1) == 0.5  # one run says nothing of how much runs differ


# ---- evidence

HEATED = replace(LIVELY, effects=(Hidden("self_heating", {"rise_k_at_5_m_s": 0.2}),))
HEATING = {"self_heating": {"rise_k_at_5_m_s": 0.2}}
OFFSET = {"calibration_error": {"gain": 0.0, "offset": 0.2}}


def evidence_after(folder, truth, more):
    start = [COOL, WARM, COOL, WARM, COOL, WARM]
    bench = recorded(folder, truth, [*start, *more])
    ready = prepare(build_channel(bench.campaign(), "temperature"))
    old = tuple(f"{i + 1:04d}" for i in range(len(start)))
    return against(ready.problem, ready.structure, Dispute((HEATING, OFFSET), old)), ready, old


@pytest.mark.trial
def test_evidence_comes_from_runs_that_tell_the_explanations_apart(tmp_path):
    """Nothing new, nothing; the same airflow once more, hardly anything; another airflow, the right one stays alone."""
    assert evidence_after(tmp_path / "none", HEATED, [])[0] == [0.0, 0.0]
    same, _, _ = evidence_after(tmp_path / "same", HEATED, [COOL, WARM])
    assert max(same) < 2.0
    slow = replace(COOL, airflow_m_s=1.8)
    told, ready, old = evidence_after(tmp_path / "slow", HEATED, [slow])
    assert told[0] < 0.0 and told[1] > REJECTED_FROM
    # what was expected of that run, before it was made, is about what came
    problem = ready.problem.select(np.isin(ready.problem.channel.run_ids, old))
    fits = [_fitted(problem, one) for one in (HEATING, OFFSET)]
    tied = OpenDispute(problem, ready.noise, fits, Dispute((HEATING, OFFSET), old, (0.0, 0.0)))
    once, further = expected(tied, [slow, COOL])
    slowly, same = once[0, 1]
    assert told[1] == pytest.approx(slowly, rel=0.5) and same < 2.0
    # what an explanation is allowed at the first run of a dispute, no further one pays
    assert (further[0, 1] > once[0, 1]).all()
    # both are the sensor's own, of which a second one says nothing
    assert of_second_probe(tied, [slow]) == pytest.approx(0.0, abs=1e-9)


def test_a_second_probe_tells_the_air_from_the_sensor(tmp_path):
    """Of a chamber that recovers and a stem, about as much comes of a second probe as is expected of it."""
    room = {"room_temperature_c": 22.0, "room_humidity_percent": 45.0}
    relaxing = {"air_relaxation": {"fraction": 0.03, "time_constant_s": 20.0, **room}}
    stem = {"stem_conduction": {"fraction": 0.03, "time_constant_s": 20.0}}
    truth = replace(LIVELY, effects=(Hidden("air_relaxation", relaxing["air_relaxation"]),))
    ready = prepare(build_channel(recorded(tmp_path, truth, [COOL, WARM] * 3).campaign(), "temperature"))
    _, *fits = (_fitted(ready.problem, one) for one in ({}, relaxing, stem))
    dispute = Dispute((relaxing, stem), ready.problem.channel.run_ids, (0.0, 0.0))
    told = of_second_probe(OpenDispute(ready.problem, ready.noise, fits, dispute), [COOL, WARM])
    for place, shock in enumerate((COOL, WARM)):
        # runs of another probe in the same air, where it shows and where it is left out
        beside = prepare(build_channel(recorded(tmp_path / f"{place}", truth, [shock] * 4).campaign(), "temperature"))
        without, with_it = (_fitted(beside.problem, one) for one in ({}, relaxing))
        came = student(0.5 * (without.deviance - with_it.deviance) / 4.0, dispute.degrees(ready.problem.channel.rates))
        assert came == pytest.approx(told[place], rel=0.3) and came > 5.0


@pytest.mark.trial
def test_what_nobody_listed_is_held_against_what_is_catalogued(tmp_path):
    """A described offset and a self-heating: a slow run of a bead with an offset rules the heating out, one of a bead
    that heats itself the description."""
    form = "offset|none"
    dispute = ({form: {"size": 0.2}}, HEATING)
    off = replace(LIVELY, effects=(Hidden("calibration_error", {"gain": 0.0, "offset": 0.2}, ("temperature",)),))
    for name, truth, wrong in (("off", off, 1), ("heated", HEATED, 0)):
        _, ready, old = evidence_after(tmp_path / name, truth, [replace(COOL, airflow_m_s=1.8)] * 2)
        told = against(ready.problem, ready.structure, Dispute(dispute, old))
        assert told[wrong] > REJECTED_FROM and told[1 - wrong] < 0.0
    assert Dispute(dispute, old).labels() == ["offset", "self_heating"]
    verdict = Conclusion("described", 6, dispute[0], Dispute(dispute, old, (0.0, 0.0)))
    assert verdict.named == () and verdict.describes and verdict.left
    assert verdict.extension("temperature").structure.ids == (form,)


def _fitted(problem, explanation):
    from shockrig.analysis.design.explanation import structure_of

    structure = structure_of(explanation, PLAIN, "temperature")
    choice = {f"{e}.{p}": v for e, values in explanation.items() for p, v in values.items()}
    return fit(problem, structure, Model(problem.channel, structure).start([np.log(0.56)], choice))


def test_the_true_explanation_is_not_ruled_out_by_looking_on(tmp_path):
    """A calibration error; eight more runs of any kind, looked at after each: it never comes near the limit."""
    off = replace(LIVELY, effects=(Hidden("calibration_error", {"gain": 0.0, "offset": 0.2}, ("temperature",)),))
    more = [replace(s, airflow_m_s=v) for v in (1.8, 12.0, 6.0, 3.0) for s in (COOL, WARM)]
    told, ready, old = evidence_after(tmp_path, off, more)
    runs = ready.problem.channel.run_ids
    looks = [
        against(ready.problem.select(np.arange(k)), ready.structure, Dispute((HEATING, OFFSET), old))
        for k in range(7, len(runs) + 1)
    ]
    assert max(look[1] for look in looks) < 2.0 and told[0] > REJECTED_FROM


@pytest.mark.trial
def test_what_new_runs_bear_out_is_named_though_most_runs_cannot_show_it(tmp_path):
    """Light in one of eight runs may be that run's own accident; two further ones rule out that it does nothing."""
    lit = replace(LIVELY, effects=(Hidden("radiative_heating", {"kelvin_per_w_m2_at_5_m_s": 1e-3}),))
    sunny = replace(COOL, irradiance_w_m2=800.0)
    bench = recorded(tmp_path, lit, [sunny, *(COOL, WARM) * 3, COOL])
    before = look_at(bench.campaign(), "temperature", Conclusion()).conclusion
    assert set(before.tied) >= {"nothing", "radiative_heating"}
    bench.record_run(sunny.as_run())
    bench.record_run(sunny.as_run())
    after = look_at(bench.campaign(), "temperature", before).conclusion
    assert () in after.out and after.named == ("radiative_heating",) and after.verdict == "explained"


@pytest.mark.trial
def test_what_hardly_ever_happens_is_tied_too_and_stays_where_the_likelier_is_ruled_out(tmp_path):
    """A clock that runs fast, which looks like a delay until a run is recorded for longer before its transfer."""
    fast = replace(LIVELY, effects=(Hidden("clock_drift", {"ppm": 14000.0}, ("temperature",)),))
    bench = recorded(tmp_path, fast, [COOL] * 4)
    before = look_at(bench.campaign(), "temperature", Conclusion()).conclusion
    assert before.tied == ("dead_time", "clock_drift")
    bench.record_run(replace(COOL, lead_s=30.0).as_run())
    after = look_at(bench.campaign(), "temperature", before).conclusion
    assert after.out == (("dead_time",),) and after.named == ("clock_drift",) and after.verdict == "explained"


def late_film(folder, seed, pair):
    """A film that is logged late, in four equal runs: its kink lies between other samples in each of them."""
    rng = np.random.default_rng([seed, pair])
    late = draw_truth(rng, ROUGH, [draw_effect(rng, "dead_time", "comfortable", "humidity")])
    runs = [PlannedShock(20.0, 20.0, 20.0, 80.0)] * 4
    channel = build_channel(recorded(folder, late, runs, 1000 * seed + pair).campaign(), "humidity")
    return channel, late.effects[0].parameters["delay_s"]


@pytest.mark.parametrize("begun_s", [0.01, 0.15, 0.6])
def test_a_fit_is_carried_over_the_steps_of_its_objective(tmp_path, begun_s):
    """A film's response begins with a kink, and no gradient leads it over a sample."""
    channel, delay_s = late_film(tmp_path, 209, 11)
    problem = prepare(channel).problem
    plain, structure = plain_fit(problem), PLAIN.adding(CATALOGUE["dead_time"])
    theta = Model(problem.channel, structure).start(plain.log_rates, {"dead_time.delay_s": begun_s})
    found = refit(problem, structure, fit(problem, structure, theta))
    assert found.values()["dead_time"]["delay_s"][0] == pytest.approx(delay_s, abs=0.006)
    assert found.objective < 1.3 * problem.channel.count.size


@pytest.mark.trial
def test_a_delay_is_not_named_a_clock_by_four_equal_runs(tmp_path):
    found = diagnose_channel(late_film(tmp_path, 205, 14)[0], describing=False)
    assert [cause.effect for cause in found.causes] == ["dead_time"]
    assert any("clock_drift" in one.ids for one, _ in found.search.instead("dead_time"))


def test_a_longer_plateau_before_the_transfer_tells_a_dead_time_from_a_clock_that_runs_fast(tmp_path):
    """A stamp runs ahead by so much a second from the run's first sample on, a dead time is the same in all runs."""
    late = replace(LIVELY, effects=(Hidden("dead_time", {"delay_s": 0.2}, ("temperature",)),))
    dispute = ({"dead_time": {"delay_s": 0.2}}, {"clock_drift": {"ppm": 30000.0}})
    told = []
    for name, lead_s in (("usual", 6.0), ("long", 30.0)):
        bench = recorded(tmp_path / name, late, [COOL, WARM] * 3)
        bench.record_run(replace(WARM, lead_s=lead_s).as_run())
        ready = prepare(build_channel(bench.campaign(), "temperature"))
        old = ready.problem.channel.run_ids[:-1]
        told.append(against(ready.problem, ready.structure, Dispute(dispute, old)))
    assert max(told[0]) < 1.0 and told[1][0] < 0.0 and told[1][1] > REJECTED_FROM


def test_student_says_less_than_a_known_scatter_and_the_same_for_many_runs():
    assert student(20.0, 5) < 10.0 and student(20.0, 10**6) == pytest.approx(20.0, rel=1e-3)
    assert student(-3.0, 5) == -3.0


def test_what_is_spent_on_all_looks_together_is_what_is_permitted():
    assert sum(spending(look) for look in range(1, 10**5)) == pytest.approx(1.0, abs=1e-4)


# ---- decisions


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A small campaign on a bench of files, to its end: decisions and their log."""
    goals = parse_goals("alpha 0.5 %, D 0.5 % at 20, minutes 60")
    bench = bench_script.FileBench(LIVELY, tmp_path_factory.mktemp("loop") / "c", 1)
    decision, log = None, []
    while decision is None or decision.status == "continue":
        decision = decide(bench.seen(), goals, decision)
        log.append(log_entry(decision, goals, log[-1] if log else None, []))
        for choice in decision.choices:
            bench.record_run(choice.shock.as_run())
    return bench, goals, decision, log


def test_it_stops_by_itself_when_the_goals_are_met(finished):
    bench, goals, decision, log = finished
    assert decision.status == DONE and bench.runs <= 10
    found = measured(bench.campaign())
    alpha, film = found.temperature.rows[0], found.humidity.rows[0]
    true = QUIET.thermal_diffusivity_m2_s, float(QUIET.diffusivity_m2_s(20.0))
    for row, value in zip((alpha, film), true, strict=True):
        assert row.standard_uncertainty / row.diffusivity_m2_s <= 0.005
        assert abs(row.diffusivity_m2_s - value) < 4 * row.standard_uncertainty
    assert decision.minutes_spent == pytest.approx(bench.minutes, rel=0.1)
    assert [entry["status"] for entry in log] == ["continue"] * (len(log) - 1) + ["done"]


def test_every_decision_keeps_to_the_schema_and_comes_back_from_the_log(finished, tmp_path):
    _, goals, decision, log = finished
    schema = json.loads((resources.files("shockrig.data") / "schemas" / "shock-plan-1.json").read_text())
    jsonschema.validate(json.loads(json.dumps(plan_document(decision, goals))), schema)
    for entry in log:
        jsonschema.validate(entry | {"format": "shock-plan/1"}, schema)
        append_decision(tmp_path, entry)
    again = read_decisions(tmp_path)
    assert again == json.loads(json.dumps(log))
    back = remembered(again[-1])
    assert back.verdicts == decision.verdicts and back.status == decision.status
    assert [s.as_run() for s in chosen(again[0])] == [
        {k: v for k, v in run.items() if not k.startswith("expected")} for run in log[0]["runs"]
    ]
    took = [entry["realised"] for entry in again if entry["realised"]]
    assert sum(one["minutes"] for one in took) == pytest.approx(decision.minutes_spent, abs=0.05)


def test_the_same_files_give_the_same_decision(finished):
    bench, goals, _, log = finished
    last = log[-2]
    part = replace(bench.campaign(), runs=bench.campaign().runs[: len(last["recorded"])])
    again = decide([part], goals, remembered(log[-3]))
    assert [c.shock.as_run() for c in again.choices] == [s.as_run() for s in chosen(last)]


def test_a_line_that_was_cut_off_does_not_count_and_damage_is_told(finished, tmp_path):
    log = finished[3]
    append_decision(tmp_path, log[0])
    path = tmp_path / "decisions.jsonl"
    whole = path.read_bytes()
    path.write_bytes(whole + whole[: len(whole) // 2])
    assert len(read_decisions(tmp_path)) == 1
    append_decision(tmp_path, log[1])
    assert [entry["number"] for entry in read_decisions(tmp_path)] == [1, 2]
    path.write_bytes(b"{}\n" + whole)
    with pytest.raises(InputError, match="decisions.jsonl, line 1: key format"):
        read_decisions(tmp_path)
    for damaged, key in (
        (
            log[0] | {"considered": [log[0]["considered"][0] | {"expected_progress": [[]]}]},
            "considered.0.expected_prog",
        ),
        (log[0] | {"goals": [{"goal": "alpha 1 %", "met": False, "now": "x"}]}, "goals.0.now"),
        (log[0] | {"realised": [1]}, "realised"),
    ):
        path.write_text(json.dumps(damaged) + "\n")
        with pytest.raises(InputError, match=f"decisions.jsonl, line 1: key {key}"):
            read_decisions(tmp_path)


def test_a_spent_budget_is_inconclusive_and_says_what_is_missing(finished):
    bench, _, _, log = finished
    campaign = bench.campaign()
    part = replace(campaign, runs=campaign.runs[:2])
    stopped = decide([part], parse_goals("alpha 0.01 %, minutes 1"), None)
    assert stopped.status == INCONCLUSIVE and "the 1 min given are spent; alpha" in stopped.reason
    free = decide([part], parse_goals("alpha 0.01 %, minutes 400"), None)
    assert free.status == "continue" and free.choices


def test_without_minutes_it_ends_where_no_run_brings_enough(finished):
    campaign = finished[0].campaign()
    part = replace(campaign, runs=campaign.runs[:6])
    stopped = decide([part], parse_goals("alpha 0.01 %"), None)
    assert stopped.status == INCONCLUSIVE and "no run brings 1 % of a goal" in stopped.reason
    assert decide([part], parse_goals("alpha 0.01 %, minutes 400"), None).choices


def at_hours(campaign, hours):
    """The campaign with its runs begun at these hours of a day."""
    begun = datetime(2026, 5, 4, tzinfo=UTC)
    return replace(
        campaign,
        runs=tuple(
            replace(run, started_at=(begun + timedelta(hours=float(hour))).isoformat())
            for run, hour in zip(campaign.runs, hours, strict=False)
        ),
    )


def test_without_minutes_no_time_is_too_long(finished):
    """Runs some hours apart: what is asked for is still to be recorded, and the bench needs as long as it does."""
    decision = decide([at_hours(finished[0].campaign(), 2.5 * np.arange(7))], parse_goals("alpha 0.1 %"), None)
    assert decision.minutes_spent > 240.0 and decision.status == CONTINUE and decision.choices


def test_a_lunch_break_is_not_spent_and_teaches_nothing(finished):
    campaign = finished[0].campaign()
    runs = len(campaign.runs)
    straight = at_hours(campaign, 0.1 * np.arange(runs))
    lunch = at_hours(campaign, 0.1 * np.arange(runs) + np.where(np.arange(runs) >= 3, 1.0, 0.0))
    assert sum(spent_minutes(lunch).values()) == pytest.approx(sum(spent_minutes(straight).values()), abs=6.0)
    assert len(moves(lunch.runs)) == len(moves(straight.runs)) - 1
    assert set(spent_minutes(lunch)) == set(spent_minutes(straight))


def test_a_clock_that_was_set_back_between_two_sessions_mixes_no_runs(finished):
    """As of a computer without a clock of its own, or of a virtual bench that is taken up again."""
    campaign = finished[0].campaign()
    count = len(campaign.runs)
    second = np.arange(count) >= count // 2
    sessions = [
        replace(run, extra={**run.extra, "session": 1 + int(s)}) for run, s in zip(campaign.runs, second, strict=True)
    ]
    hours = 0.1 * np.arange(count)
    straight = at_hours(replace(campaign, runs=tuple(sessions)), hours)
    back = at_hours(straight, hours - np.where(second, 0.1 * (count // 2) - 0.05, 0.0))
    assert spent_minutes(back) == spent_minutes(straight)
    assert list(moves(back.runs)) == list(moves(straight.runs))
    assert learn(back).coefficients == pytest.approx(learn(straight).coefficients, rel=1e-12)


def test_an_empty_campaign_begins_with_both_quantities_and_a_veto_is_kept(finished):
    goals = Goals((Precision("alpha", 0.01), Precision("D", 0.01)), ambients_c=(20.0,))
    first = decide((), goals, count=4)
    assert [c.shock for c in first.choices] == opening(20.0, Usual())
    other = decide((), goals, count=4, feasible=lambda shock: shock != first.choices[0].shock)
    assert first.choices[0].shock not in [c.shock for c in other.choices]
    dry = decide((), goals, count=4, feasible=lambda shock: shock.isothermal)
    assert all(c.shock.isothermal for c in dry.choices)


def test_where_the_first_runs_cannot_be_another_of_the_menu_begins():
    """A chamber that cannot dry below 30 %RH, say, or an operator who wants none of them."""
    goals = parse_goals("D 1 % at 20")
    damp = decide((), goals, feasible=lambda shock: min(shock.source_percent, shock.destination_percent) >= 30.0)
    assert damp.choices and min(damp.choices[0].shock.source_percent, damp.choices[0].shock.destination_percent) >= 30.0
    assert damp.choices[0].shock.isothermal
    first = decide((), goals, count=4).choices
    assert len(first) == 2  # up and down
    others = decide((), goals, count=4, feasible=lambda shock: shock not in [c.shock for c in first]).choices
    assert others and not {c.shock for c in others} & {c.shock for c in first}
    assert decide((), goals, feasible=lambda shock: False).status == INCONCLUSIVE


def test_one_run_in_another_direction_or_airflow_is_not_enough(tmp_path):
    """Runs differ, so one says nothing; a small step says less."""
    small = PlannedShock(20.0, 35.0, 20.0, 20.0)
    menu = (DOWN, UP, replace(UP, airflow_m_s=12.0), small)
    bench = recorded(tmp_path, QUIET, [UP, UP, UP])

    def worth():
        ready = prepare(build_channel(bench.campaign(), "humidity"))
        return variety([ready.problem.channel], menu, planned)

    planned, both = [], replace(DOWN, airflow_m_s=12.0)
    wanted = np.array([0.5, 0.0, 0.5, 0.125])
    assert worth() == pytest.approx(np.column_stack([wanted, wanted]), rel=0.02)
    bench.record_run(both.as_run())
    assert worth() == pytest.approx(np.column_stack([wanted, [0.0, 0.0, 0.0, 0.125]]), rel=0.02)
    planned = [both]
    assert not worth().any()
    bench.record_run(both.as_run())
    planned = []
    assert not worth().any()


def test_a_run_that_serves_two_disputes_comes_before_those_that_serve_one_better():
    """Three runs of the same minutes: 4 for one pair, 4 for another, 3 for both."""
    menu = tuple(replace(UP, why=why) for why in ("one", "other", "both"))
    pairs = np.array([[4.0, 0.0, 3.0], [0.0, 4.0, 3.0]])
    prospects = Prospects(menu, None, (), pairs, np.array([4.6, 4.6]), np.zeros(3), lambda planned: np.zeros((3, 2)))
    chosen, considered = choose_runs(prospects, learn(None), (), 1)
    assert chosen[0].shock.why == "both" and {c.shock.why for c in considered} == {"one", "other", "both"}


def test_a_run_is_worth_what_two_of_its_kind_bring():
    """What needs two runs, elsewhere: the chambers travel there once. What is near brings a bit over half."""
    far = replace(UP, source_c=40.0, destination_c=40.0, why="far")
    menu, worth = (replace(UP, why="near"), far), np.array([[0.27, 0.0], [0.5, 0.5]])
    minutes = learn(None)
    there = [minutes.of(UP.airs, shock) for shock in menu]
    assert 0.27 / there[0] > 0.5 / there[1]
    prospects = Prospects(menu, None, (), np.zeros((0, 2)), np.zeros(0), np.zeros(2), lambda planned: worth)
    here = Run("0001", RunAir(20.0, 20.0), RunAir(20.0, 80.0), 6.0, 1013.25, 6.0, None, None, None)
    assert choose_runs(prospects, minutes, [here], 1)[0][0].shock.why == "far"


def test_where_no_airs_are_known_any_run_is_unlike_those_recorded():
    """A thermometer's bench states no humidity of its airs: what nothing explains is looked for there all the same."""
    unknown = Run("0001", RunAir(20.0, None), RunAir(40.0, None), 6.0, 1013.25, 6.0, None, None, None)
    assert farthest([UP, DOWN], [unknown]) is UP
    known = replace(unknown, source=RunAir(20.0, 20.0), destination=RunAir(20.0, 80.0))
    assert farthest([UP, DOWN], [unknown, known]) is DOWN


def test_the_first_run_comes_again_at_every_sixth_place_and_not_behind_one_that_closes():
    menu = (replace(UP, why="told"), replace(DOWN, why="again"))
    pairs, nothing = np.array([[1.0, 0.0]]), np.zeros(2)
    prospects = Prospects(menu, 1, (), pairs, np.array([99.0]), nothing, lambda planned: np.zeros((2, 2)))

    def planned(*recorded):
        runs = [
            Run(f"{i}", RunAir(20.0, 80.0 if a == "A" else 20.0), RunAir(20.0, 20.0 if a == "A" else 80.0),
                None, 1013.25, 6.0, None, None, None) for i, a in enumerate("".join(recorded))
        ]  # fmt: skip
        chosen, _ = choose_runs(prospects, learn(None), runs, 8)
        return "".join("A" if one.shock.why == "again" else "b" for one in chosen)

    assert planned("Abbbb") == "AbbbbbAb" and planned("Abbb") == "bAbbbbbA"
    assert planned("AbbA") == "bbbbbbbA"[:8] and planned("Abbbbbb", "AbbA") == "bbbbbbAb"


def test_nothing_is_chosen_from_an_empty_menu():
    nothing = Prospects((), None, (), np.zeros((0, 0)), np.zeros(0), np.zeros(0), lambda planned: np.zeros((0, 2)))
    assert choose_runs(nothing, learn(None), (), 3) == ([], ())
    assert Decision("", "").tied == {}


@pytest.mark.parametrize(
    ("goal", "said"),
    [
        ({"goal": "alpha 0.3 %", "now": None, "met": False}, ("not yet", "not known yet")),
        ({"goal": "alpha 0.3 %", "now": 0.25, "met": True}, ("met", "0.25 %")),
        ({"goal": "ties decided", "now": 2, "met": False}, ("not yet", "tied in 2 channels")),
        ({"goal": "ties decided", "now": 0, "met": False}, ("not yet", "nothing is tied so far")),
        ({"goal": "minutes 60", "now": 16.2, "met": True}, ("budget", "16 spent")),
    ],
)
def test_a_goal_says_in_words_where_it_stands(goal, said):
    assert where_it_stands(goal) == said


def test_ties_are_not_decided_while_a_channel_has_too_few_runs_to_be_judged(tmp_path):
    """One run of each says nothing of ties, though nothing is tied; then come those that vary what no two runs have."""
    bench = recorded(tmp_path, LIVELY, [UP])
    goals = parse_goals("ties decided, minutes 60")
    one = decide(bench.seen(), goals)
    assert one.status == CONTINUE and not one.choices[0].shock.isothermal
    bench.record_run(COOL.as_run())
    both = decide(bench.seen(), goals, one)
    assert both.status == CONTINUE and both.unvaried and "fewer than two runs" in both.reason
    assert both.choices[0].worth >= 0.5 and both.choices[0].shock != COOL
    assert chosen_section([log_entry(both, goals, None, [])], tmp_path)  # a page without goals of precision


def test_it_does_not_end_inconclusive_between_causes_of_which_all_runs_bear_out_another(tmp_path):
    """Before: of a film whose D depends on the humidity two others stood tied, since no run of the menu told them
    apart, and the diagnosis of the same runs named the right one at 99 %."""
    start = [COOL, WARM, COOL, WARM, COOL, WARM]
    slow = [replace(one, airflow_m_s=1.8) for one in (COOL, WARM)]
    bench = recorded(tmp_path, HEATED, [*start, *slow])
    recorded_then = tuple(f"{i + 1:04d}" for i in range(len(start)))
    late = OFFSET | {"dead_time": {"delay_s": 0.01}}
    tied = Conclusion("explained", 6, OFFSET, Dispute((OFFSET, late), recorded_then, (0.0, 0.0)), looks=1)
    before = Decision(recorded=recorded_then, verdicts={"temperature": tied})
    probes = [replace(one, sensors={"imet": {}}) for one in bench.seen()]
    ended = decide(probes, parse_goals("ties decided"), before, feasible=lambda _: False)
    assert ended.verdicts["temperature"].named == ("self_heating",)
    assert "tied" not in ended.reason


def test_a_channel_that_is_given_up_is_said_to_be_and_no_tie_is_decided(monkeypatch, tmp_path):
    """Before: all goals were met, and the plain model was enough of what nobody had judged."""
    monkeypatch.setattr("shockrig.analysis.plan.look.MOST_RUNS_TRIED", 2)
    ended = decide(recorded(tmp_path, LIVELY, [UP, COOL]).seen(), parse_goals("ties decided"))
    assert ended.status == INCONCLUSIVE
    assert ended.reason == "temperature and humidity: fewer than 4 runs can be used, too few to judge by"


def test_a_channel_that_no_run_shows_is_said_to_be_beside_one_that_is_judged():
    """Before: the plain model was enough, and nothing told that it was of one channel alone."""
    judged, silent = Conclusion("adequate", 8), Conclusion()
    state = Decision("", "", ("0001",), verdicts={"temperature": judged, "humidity": silent})
    looks = {"temperature": ChannelLook(judged), "humidity": ChannelLook(silent)}
    said = "all goals are met; the plain model is enough; humidity: no run shows it"
    assert ended_by(state, parse_goals("ties decided"), looks) == ("done", said)
