"""shockrig demo: what it hides it finds, what it says at the end is so, and nothing is claimed that did not happen."""

import json
from dataclasses import replace

import numpy as np
import pytest

from shockrig.protocols.cli import main
from shockrig.protocols.commands import demo
from shockrig.protocols.reveal import ChannelScore, RevealScore
from shockrig.rig.virtual.hide import open_seal
from shockrig.rig.virtual.truth import draw_truth

TRUTH = draw_truth(np.random.default_rng(0))


def test_the_air_film_is_found_and_the_first_line_says_so(demonstrated):
    out, printed, _ = demonstrated
    truth, seed = open_seal(out / "campaign.sealed")
    assert seed == 5 and [hidden.effect for hidden in truth.effects] == ["convective_film"]
    assert printed.startswith("Found what was hidden, and nothing else: convective film (temperature).\n")
    stated = json.loads((out / "diagnosis" / "diagnosis.json").read_text())["channels"]["temperature"]["causes"][0]
    found, true = stated["parameters"]["biot_at_5_m_s"], truth.effects[0].parameters["biot_at_5_m_s"]
    assert abs(found["value"] - true) < 4 * found["standard_uncertainty"]
    assert f"hidden {true:.4g}, found " in printed


def test_the_extended_alpha_is_the_materials_where_the_plain_one_is_not(demonstrated):
    out, _, _ = demonstrated
    truth, _ = open_seal(out / "campaign.sealed")
    alpha = {
        name: json.loads((out / name / "profile.json").read_text())["temperature"]["thermal_diffusivity_m2_s"]
        for name in ("plain", "extended")
    }
    true = truth.thermal_diffusivity_m2_s
    assert alpha["plain"]["value"] < 0.5 * true
    assert abs(alpha["extended"]["value"] - true) < 4 * alpha["extended"]["standard_uncertainty"] < true


def test_progress_is_on_standard_error_and_every_path_that_is_printed_exists(demonstrated):
    out, printed, progress = demonstrated
    assert [line[0] for line in progress.splitlines() if " of 5: " in line] == ["1", "2", "3", "4", "5"]
    assert "of 5:" not in printed and "run 0001" not in printed
    reports, figures = printed.splitlines()[-2:]
    paths = [*reports.removeprefix("reports: ").split(", "), *figures.removeprefix("before and after: ").split(", ")]
    assert paths == [
        *(str(out / name / "report.html") for name in ("plain", "diagnosis", "extended")),
        str(out / "diagnosis" / "temperature_before_after.png"),
    ]
    assert all((out.parent / path).is_file() for path in paths)


def test_progress_of_the_plain_model_says_whose_it_is(demonstrated, tmp_path, capsys):
    """It is fitted while the diagnosis goes on, whose lines begin with the same channels."""
    demo._plain(lambda nothing: None, demonstrated[0] / "campaign", tmp_path / "plain", "2026-01-01T00:00:00Z")
    said = capsys.readouterr().err.splitlines()
    assert said and all(line.startswith("plain model: ") for line in said)


def ended(**channels):
    return demo.ending(RevealScore(TRUTH, 1, {name: ChannelScore(name, *judged) for name, judged in channels.items()}))


NOTHING = ((), "adequate", "adequate")


@pytest.mark.parametrize(
    "temperature, humidity, sentence",
    [
        (NOTHING, NOTHING, "Nothing was hidden, and nothing was named."),
        (
            ((), "adequate", "explained", (), (), (), ("dead_time",)),
            NOTHING,
            "Nothing was hidden, and dead time (temperature) was named.",
        ),
        (
            (("finite_transfer",), "explained", "explained", ("finite_transfer",)),
            (("finite_transfer",), "explained", "explained", ("finite_transfer",)),
            "Found what was hidden, and nothing else: finite transfer (temperature and humidity).",
        ),
        (
            NOTHING,
            (("unknown_log_creep",), "unexplained", "unexplained"),
            "Hidden was what no catalogue has, unknown log creep (humidity), "
            "and the diagnosis says that it cannot explain it.",
        ),
        (
            (("stem_conduction", "dead_time"), "explained", "explained", ("dead_time",), (), ("stem_conduction",)),
            (("hysteresis",), "explained", "adequate", (), (), ("hysteresis",)),
            "Not all came out as hidden: found dead time (temperature); missed stem conduction (temperature) and "
            "hysteresis (humidity); humidity should be explained.",
        ),
        (
            (("dead_time",), "explained", "explained", (), ("dead_time",)),
            (("hysteresis",), "explained", "explained", ("hysteresis",), (), (), ("slow_relaxation",)),
            "Not all came out as hidden: found hysteresis (humidity); only among the look-alikes of what was named: "
            "dead time (temperature); named but not hidden: slow relaxation (humidity).",
        ),
    ],
)
def test_the_first_sentence_says_what_became_of_what_was_hidden(temperature, humidity, sentence):
    assert ended(temperature=temperature, humidity=humidity) == sentence


def test_the_table_gives_errors_in_percent_and_in_standard_uncertainties(monkeypatch):
    truth = replace(TRUTH, thermal_diffusivity_m2_s=5.0e-8)
    found = {"plain": {("alpha", None): (4.0e-8, 0.1e-8)}, "extended": {("alpha", None): (5.01e-8, 0.02e-8)}}
    monkeypatch.setattr(demo, "diffusivities", found.get)
    header, row = demo.against_truth(["plain", "extended"], truth)
    assert "-20.00 %, -10.0 σ" in row and "+0.20 %, +0.5 σ" in row and row.endswith("5.0000")
    starts = [header.rindex(name) for name in ("plain", "extended", "truth")]
    assert [row[start:].split()[0] for start in starts] == ["4.00", "5.010", "5.0000"]


def test_of_one_profile_there_is_no_extended_column(monkeypatch):
    monkeypatch.setattr(demo, "diffusivities", {"plain": {("D", 20.0): (5e-12, 1e-14)}}.get)
    header, row = demo.against_truth(["plain"], TRUTH)
    assert "extended" not in header and row.startswith("  D at 20.0 °C")


def test_a_demo_that_cannot_begin_leaves_no_folder(tmp_path, capsys):
    assert main(["demo", "--out", str(tmp_path / "new"), "--hide", "no_such_effect"]) == 2
    assert "effect 'no_such_effect' is not known" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
