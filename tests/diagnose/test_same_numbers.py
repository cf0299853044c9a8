"""The benchmark that holds two states of the project against each other: it must see what differs, and resume."""

import sys

import pytest
from benchmark_scripts import benchmark

same = benchmark("same_numbers")


def result(seed, alpha, causes, verdict="explained", gain=0.9):
    found = {"verdict": verdict, "causes": causes, "gain": gain}
    material = {"temperature": alpha}
    return {
        "seed": seed,
        "hidden": {"temperature": ["dead_time"]},
        "seconds": {"characterize": 2.0, "diagnose": 10.0},
        "plain": material,
        "extended": material,
        "channels": {"temperature": found},
    }


def test_differences_are_in_units_of_the_old_uncertainty():
    old = result(1, (5.0, 0.5), {"dead_time": {"delay_s": (0.3, 0.02)}})
    new = result(1, (5.1, 0.4), {"dead_time": {"delay_s": (0.29, 0.01)}})
    steps = {step.name: step.in_u for step in same.differences(old, new, "temperature")}
    assert steps == pytest.approx({"plain": 0.2, "extended": 0.2, "dead_time.delay_s": -0.5})


def test_extended_numbers_of_different_models_are_not_compared():
    old, new = result(1, (5.0, 0.5), {"dead_time": {}}), result(1, (9.0, 0.5), {"moving_average": {}})
    assert [step.name for step in same.differences(old, new, "temperature")] == ["plain"]


def test_the_summary_lists_what_is_said_otherwise_with_the_truth():
    trials = [same.Trial(1, 1, "rough"), same.Trial(2, 1, "rough")]
    old = {1: result(1, (5.0, 0.5), {"dead_time": {}}), 2: result(2, (5.0, 0.5), {"dead_time": {}})}
    new = {1: result(1, (5.5, 0.5), {"dead_time": {}}), 2: result(2, (5.0, 0.5), {}, "unexplained", gain=0.4)}
    text = same.summary(trials, old, new)
    assert "2 campaigns, 2 channels, seeds 1 to 2" in text
    assert "median difference 0.5 u, largest 1 u (plain of 1)" in text
    assert "2 temperature: old explained, new unexplained, hidden ['dead_time']" in text
    assert "2 temperature: old ['dead_time'], new [], hidden ['dead_time']" in text
    assert "largest 0.5" in text.partition("gain")[2] and "ratio 1.00" in text


def test_forty_campaigns_of_five_kinds_each_with_a_seed_of_its_own():
    trials = same.trials()
    assert len({trial.seed for trial in trials}) == 40
    kinds = [(trial.label, trial.tier) for trial in trials]
    assert [kinds.count(kind) for kind in dict.fromkeys(kinds)] == [12, 16, 6, 3, 3]


def test_what_is_kept_is_not_run_again(tmp_path, monkeypatch):
    monkeypatch.setattr(same, "simulated", lambda trial, work: (tmp_path / str(trial.seed), {"temperature": []}))
    command = tmp_path / "shockrig"
    command.write_text(
        f"#!{sys.executable}\nimport json, pathlib, sys\n"
        "if '--help' in sys.argv: sys.exit(0)\n"
        f"with open({str(tmp_path / 'calls')!r}, 'a') as calls: print(*sys.argv[1:3], file=calls)\n"
        "out = pathlib.Path(sys.argv[sys.argv.index('--out') + 1]); out.mkdir(parents=True)\n"
        "alpha = {'value': 8e-8, 'standard_uncertainty': 1e-10}\n"
        "profile = {'temperature': {'thermal_diffusivity_m2_s': alpha}}\n"
        "(out / 'profile.json').write_text(json.dumps(profile))\n"
        "(out / 'diagnosis.json').write_text(json.dumps({'channels': {'temperature':\n"
        "    {'verdict': 'adequate', 'causes': [], 'gain': None}}}))\n"
    )
    command.chmod(0o755)
    chosen = same.trials()[:3]
    same.cached("old", command, tmp_path, chosen[:2])
    done = same.cached("old", command, tmp_path, chosen)
    calls = (tmp_path / "calls").read_text().splitlines()
    assert calls == [f"{verb} {tmp_path / str(t.seed)}" for t in chosen for verb in ("characterize", "diagnose")]
    assert [done[t.seed]["plain"]["temperature"][0] for t in chosen] == [8e-8] * 3
    assert len((tmp_path / "old.jsonl").read_text().splitlines()) == 3
