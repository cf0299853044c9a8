"""Blind trials: draws stay in their ranges, seals keep and refuse, and scores say what happened."""

import json
from dataclasses import replace

import numpy as np
import pytest

from shockrig.files.errors import InputError
from shockrig.protocols import cli
from shockrig.protocols.reveal import score, table
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.virtual.effects import CATALOGUED, KINDS, OUTSIDE
from shockrig.rig.virtual.hide import DRAWS, draw_effect, draw_hidden, open_seal, seal
from shockrig.rig.virtual.truth import Hidden, draw_truth, serial_number, with_effects

STEM = Hidden("stem_conduction", {"fraction": 0.04, "time_constant_s": 9.0})
RAMP = Hidden("finite_transfer", {"duration_s": 0.4})
CREEP = Hidden("unknown_log_creep", {"fraction": 0.01, "onset_s": 2.0}, ("humidity",))


def test_every_kind_can_be_drawn_in_both_strengths():
    assert set(DRAWS) == set(KINDS)
    for effect in KINDS:
        for strength in ("comfortable", "limit"):
            for seed in range(20):
                hidden = draw_effect(np.random.default_rng(seed), effect, strength)
                assert np.isfinite(list(hidden.parameters.values())).all()
                assert len(hidden.channels) == (1 if KINDS[effect].single else len(KINDS[effect].channels))


@pytest.mark.parametrize(
    "effect, parameter, low, high",
    [
        ("convective_film", "biot_at_5_m_s", 0.08, 0.2),
        ("finite_transfer", "duration_s", 0.2, 0.6),
        ("stem_conduction", "fraction", 0.02, 0.08),
        ("vapour_boundary_layer", "biot_at_5_m_s", 3.0, 15.0),
        ("hysteresis", "rh_percent", 0.5, 2.0),
        ("dead_time", "delay_s", 0.15, 0.6),
    ],
)
def test_limit_is_a_tenth_to_a_third_of_comfortable(effect, parameter, low, high):
    def drawn(strength):
        return [draw_effect(np.random.default_rng(s), effect, strength).parameters[parameter] for s in range(300)]

    comfortable, limit = np.array(drawn("comfortable")), np.array(drawn("limit"))
    assert low <= comfortable.min() < comfortable.max() <= high
    if "biot" in parameter:  # the resistance is the effect
        comfortable, limit, low, high = 1 / comfortable, 1 / limit, 1 / high, 1 / low
    assert low / 10 <= limit.min() < limit.max() <= high / 3 + 1e-12


def test_which():
    rng = np.random.default_rng(0)
    assert draw_hidden(rng, "none") == []
    assert {h.effect for h in draw_hidden(rng, 4)} <= set(CATALOGUED)
    assert len({h.effect for h in draw_hidden(rng, "3")}) == 3
    assert draw_hidden(rng, "outside")[0].effect in OUTSIDE
    assert [h.effect for h in draw_hidden(rng, "dead_time, hysteresis")] == ["dead_time", "hysteresis"]
    assert {len(draw_hidden(rng)) for _ in range(100)} == {0, 1, 2, 4}
    assert draw_hidden(np.random.default_rng(5), 2) == draw_hidden(np.random.default_rng(5), 2)
    for wrong in ("magic", 99):
        with pytest.raises(BenchError):
            draw_hidden(rng, wrong)
    with pytest.raises(BenchError, match="strength"):
        draw_effect(rng, "dead_time", "huge")
    with pytest.raises(BenchError, match="acts in"):
        draw_effect(rng, "hysteresis", channel="temperature")


def sealed(tmp_path, *effects, seed=7):
    truth = with_effects(draw_truth(np.random.default_rng(seed), "rough"), effects)
    path = tmp_path / "answer.sealed"
    path.unlink(missing_ok=True)
    return seal(path, truth, seed), truth


def test_a_seal_keeps_and_does_not_show(tmp_path):
    path, truth = sealed(tmp_path, STEM)
    assert open_seal(path) == (truth, 7)
    text = path.read_text()
    assert "stem" not in text and "0.04" not in text and str(truth.thermal_diffusivity_m2_s) not in text


def test_a_seal_is_never_put_into_a_campaign_nor_over_another(tmp_path):
    path, truth = sealed(tmp_path)
    with pytest.raises(BenchError, match="exists already"):
        seal(path, truth, 1)
    (tmp_path / "c" / "runs").mkdir(parents=True)
    (tmp_path / "c" / "campaign.json").write_text("{}")
    with pytest.raises(BenchError, match="lies in the campaign"):
        seal(tmp_path / "c" / "runs" / "truth.sealed", truth, 1)
    with pytest.raises(BenchError, match="Not a directory; name another file"):
        seal(path / "truth.sealed", truth, 1)


def test_a_damaged_seal_is_known(tmp_path):
    path, _ = sealed(tmp_path, STEM)
    content = json.loads(path.read_text())
    middle = len(content["sealed"]) // 2
    swapped = "A" if content["sealed"][middle] != "A" else "B"
    content["sealed"] = content["sealed"][:middle] + swapped + content["sealed"][middle + 1 :]
    path.write_text(json.dumps(content))
    with pytest.raises(BenchError, match="checksum"):
        open_seal(path)
    for wrong in ("", "[]", "{}", '{"format": "sealed-truth/1"}', '{"format": "sealed-truth/1", "sealed": []}'):
        path.write_text(wrong)
        with pytest.raises(
            BenchError, match="not a sealed truth: .*; give the sealed file that hiding wrote"
        ) as raised:
            open_seal(path)
        assert "object" not in str(raised.value)


def cause(effect, alike=(), probability=0.9, **parameters):
    return {
        "effect": effect,
        "probability": probability,
        "parameters": {k: {"value": v, "standard_uncertainty": u} for k, (v, u) in parameters.items()},
        "indistinguishable_from": list(alike),
    }


def diagnosis(temperature, humidity):
    channels = {
        name: {"verdict": verdict, "causes": causes}
        for name, (verdict, causes) in (("temperature", temperature), ("humidity", humidity))
    }
    return {"format": "shock-diagnosis/1", "campaign": "x", "channels": channels}


def test_all_right(tmp_path):
    path, _ = sealed(tmp_path, STEM, RAMP)
    stem = cause("stem_conduction", fraction=(0.043, 0.002), time_constant_s=(8.0, 0.5))
    ramp = cause("finite_transfer", duration_s=(0.41, 0.01))
    result = score(path, diagnosis(("explained", [stem, ramp]), ("explained", [ramp])))
    assert result.exact and result.seed == 7
    sigmas = {(e.effect, e.parameter): e.sigmas for e in result.channels["temperature"].errors}
    assert sigmas == pytest.approx(
        {
            ("stem_conduction", "fraction"): 1.5,
            ("stem_conduction", "time_constant_s"): -2.0,
            ("finite_transfer", "duration_s"): 1.0,
        }
    )
    assert result.channels["humidity"].hidden == ("finite_transfer",)


def test_missed_listed_wrong(tmp_path):
    path, _ = sealed(tmp_path, STEM, RAMP)
    film = cause("convective_film", probability=0.7)
    average = cause("moving_average", alike=["finite_transfer"])
    result = score(path, diagnosis(("explained", [film]), ("explained", [average])))
    temperature, humidity = result.channels["temperature"], result.channels["humidity"]
    assert set(temperature.missed) == {"stem_conduction", "finite_transfer"}
    assert temperature.wrong == ("convective_film",)
    assert temperature.probabilities == (("convective_film", 0.7, False),)
    assert humidity.listed == ("finite_transfer",) and not humidity.wrong and not humidity.missed
    assert not result.exact and temperature.verdict_right


def test_expected_verdicts(tmp_path):
    path, _ = sealed(tmp_path, CREEP, STEM)
    stem = cause("stem_conduction", fraction=(0.04, None), time_constant_s=(9.0, None))
    right = score(path, diagnosis(("explained", [stem]), ("unexplained", [])))
    assert right.exact and right.channels["temperature"].errors[0].sigmas is None
    forced = score(path, diagnosis(("explained", [stem]), ("explained", [cause("hysteresis")])))
    assert not forced.exact and forced.channels["humidity"].wrong == ("hysteresis",)
    path, _ = sealed(tmp_path)
    assert score(path, diagnosis(("adequate", []), ("adequate", []))).exact
    assert not score(path, diagnosis(("adequate", []), ("unexplained", []))).exact


def test_the_command_prints_a_table(tmp_path, capsys):
    path, _ = sealed(tmp_path, STEM, CREEP)
    found = tmp_path / "diagnosis.json"
    stem = cause("stem_conduction", fraction=(0.05, 0.005), time_constant_s=(9.0, 1.0))
    found.write_text(json.dumps(diagnosis(("explained", [stem]), ("adequate", []))))
    assert cli.main(["reveal", str(path), "--diagnosis", str(found)]) == 0
    printed = capsys.readouterr().out
    assert "named    stem_conduction" in printed and "off by +2.0 standard uncertainties" in printed
    assert "no name  unknown_log_creep" in printed and "should be unexplained" in printed
    assert printed.strip() == table(score(path, found))
    for wrong in ("", "[]", '{"format": "x"}', '{"format": "shock-diagnosis/1", "channels": {"humidity": {}}}'):
        found.write_text(wrong)
        assert cli.main(["reveal", str(path), "--diagnosis", str(found)]) == 2
        assert str(found) in capsys.readouterr().err
        with pytest.raises(InputError):
            score(path, found)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"channels": []}, "key channels: expected an object, found a list"),
        ({"channels": {"temperature": []}}, "key channels.temperature: expected an object, found a list"),
        ({"verdict": None}, "key channels.temperature.verdict: expected text"),
        ({"causes": {"x": 1}}, "key channels.temperature.causes: expected a list, found an object"),
        ({"causes": ["stem"]}, "key channels.temperature.causes[0]: expected an object, found 'stem'"),
        ({"causes": [{}]}, "causes[0].effect: expected the id of an effect, found nothing"),
        ({"causes": [{"effect": ["a"]}]}, "causes[0].effect: expected the id of an effect, found a list"),
        ({"causes": [{"effect": "a", "probability": "high"}]}, "causes[0].probability: expected a finite number"),
        ({"causes": [{"effect": "a", "parameters": [1]}]}, "causes[0].parameters: expected an object, found a list"),
        (
            {"causes": [{"effect": "a", "parameters": {"b": "1"}}]},
            "causes[0].parameters.b: expected an object",
        ),
        (
            {"causes": [{"effect": "a", "parameters": {"b": {"value": True}}}]},
            "causes[0].parameters.b.value: expected a finite number, found True",
        ),
        (
            {"causes": [{"effect": "a", "indistinguishable_from": [{}]}]},
            "indistinguishable_from: expected a list",
        ),
    ],
)
def test_a_diagnosis_of_other_things_is_named_by_its_key(tmp_path, capsys, change, words):
    path, _ = sealed(tmp_path, STEM)
    content = diagnosis(("explained", []), ("adequate", []))
    (content if "channels" in change else content["channels"]["temperature"]).update(change)
    found = tmp_path / "diagnosis.json"
    found.write_text(json.dumps(content))
    assert cli.main(["reveal", str(path), "--diagnosis", str(found)]) == 2
    error = capsys.readouterr().err
    assert f"{found}: " in error and words in error and "give the diagnosis.json" in error and error.count("\n") == 1


def test_a_diagnosis_of_other_sensors_is_not_scored(tmp_path, capsys):
    path, truth = sealed(tmp_path, STEM)
    found, content = tmp_path / "diagnosis.json", diagnosis(("explained", []), ("adequate", []))
    own, other = (serial_number(one, "imet") for one in (truth, replace(truth, probe_seed=8)))
    for serial, status in ((own, 0), ("virtual-bead", 0), ("X1", 0), (other, 2)):
        found.write_text(json.dumps(content | {"sensors": {"imet": {"serial": serial}}, "made_from": {"probe": "1"}}))
        assert cli.main(["reveal", str(path), "--diagnosis", str(found)]) == status
    assert f"{found}: is a diagnosis of imet {other}, and {path} is the truth of {own}" in capsys.readouterr().err
    assert cli.main(["reveal", str(path), "--diagnosis", str(found), "--probe", "2"]) == 2
    assert "is a diagnosis of probe 1; give --probe 1" in capsys.readouterr().err


def test_files_that_are_not_there_are_said_in_plain_words(tmp_path, capsys):
    path, _ = sealed(tmp_path)
    for arguments, words in (
        (
            [path, "--diagnosis", tmp_path / "none.json"],
            "none.json: No such file or directory; give the diagnosis.json",
        ),
        ([tmp_path / "none", "--diagnosis", path], "none: No such file or directory; give the sealed file"),
    ):
        assert cli.main(["reveal", *map(str, arguments)]) == 2
        error = capsys.readouterr().err
        assert words in error and "Errno" not in error and error.count("\n") == 1
