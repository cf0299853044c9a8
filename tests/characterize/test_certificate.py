"""Budgets and certificates: known answers, shares that add up, files that others read back number for number."""

import csv
import json
import math
import os
import re
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import xmlschema
from small_worlds import record

from shockrig.analysis.characterize.budget import Budget, Component, budgets
from shockrig.analysis.characterize.certified import calibrations, certified, with_common
from shockrig.analysis.characterize.characterize import characterize, characterize_channel
from shockrig.analysis.characterize.part_fit import Extension
from shockrig.analysis.characterize.response_times import ResponseAir
from shockrig.analysis.effects import structure_of
from shockrig.analysis.report.certificate_page import write_certificate_page
from shockrig.files.campaign import read_campaign
from shockrig.files.certificate import NOT_TRACEABLE, Traced, certificate_document
from shockrig.files.common_uncertainty import NOTHING_COMMON, ORDINARY_LABORATORY, CommonUncertainty
from shockrig.files.dcc import dcc_text
from shockrig.files.errors import InputError
from shockrig.protocols.cli import build_parser, main
from shockrig.protocols.commands import certify
from shockrig.rig.virtual.hide import draw_effect

SCHEMA = Path(__file__).parents[1] / "dcc_schemas" / "dcc_used.xsd"
STATED = CommonUncertainty(0.05, 0.5, 2.0, 5.0, 0.01, 50.0)


def test_degrees_of_freedom_of_the_published_example_of_an_end_gauge():
    """JCGM 100:2008, H.1: u = 32 nm of four components, effective degrees of freedom 16 (16.7)."""
    parts = ((25.0, 18.0), (9.7, 25.6), (2.9, 50.0), (16.6, 2.0))
    lines = tuple(Component(f"u{i}", "A", "normal", u, "nm", 1.0, nu) for i, (u, nu) in enumerate(parts))
    budget = Budget("l", "temperature", "nm", 50.000838e6, ResponseAir(), lines)
    assert budget.standard_uncertainty == pytest.approx(32.0, abs=0.4)
    assert budget.degrees == pytest.approx(16.7, abs=0.2)
    assert sum(budget.share(line) for line in lines) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("degrees", "factor"),
    [(1.0, 13.97), (2.0, 4.53), (10.0, 2.28), (18.9, 2.15), (50.0, 2.05), (100.0, 2.025), (math.inf, 2.0)],
)
def test_coverage_factor_is_that_of_the_published_table(degrees, factor):
    """JCGM 100:2008, table G.2, p = 95.45 %; degrees of freedom are cut to a whole number."""
    budget = Budget(
        "x", "temperature", "s", 1.0, ResponseAir(), (Component("a", "A", "normal", 0.1, "s", 1.0, degrees),)
    )
    assert budget.coverage_factor == pytest.approx(factor, abs=0.006)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    return record(tmp_path_factory.mktemp("certificate") / "c", 5, tier="rough")


@pytest.fixture(scope="module")
def result(campaign):
    return characterize(replace(campaign, common=STATED))


def test_shares_add_up_and_the_budget_is_the_uncertainty_of_the_profile(result):
    for found in result.channels().values():
        made = budgets(found)
        assert len(made) == 3 * len(found.rows)
        for row, of_rate, t63, t90 in zip(found.rows, made[::3], made[1::3], made[2::3], strict=True):
            for budget in (of_rate, t63, t90):
                assert sum(budget.share(line) for line in budget.lines) == pytest.approx(1.0, abs=1e-9)
                assert budget.lines == tuple(sorted(budget.lines, key=lambda line: -line.contribution))
                assert budget.random < budget.standard_uncertainty
            assert of_rate.standard_uncertainty == pytest.approx(row.standard_uncertainty, rel=1e-6)
            assert t63.value == row.response.t63_s
            assert t63.standard_uncertainty == pytest.approx(row.response.standard_uncertainties_s[0], rel=1e-6)
            assert t90.standard_uncertainty == pytest.approx(row.response.standard_uncertainties_s[1], rel=1e-6)


def test_a_scatter_that_no_repeat_shows_is_not_evaluated_from_readings(campaign):
    """One run at one ambient: by how much runs differ is what sensors usually do (JCGM 100, 4.3)."""
    (run,) = [run for run in campaign.runs if run.id == characterize(campaign).humidity.runs[0]]
    (one, *_) = budgets(characterize(replace(campaign, runs=[run]), channels=["humidity"]).humidity)
    (line,) = [line for line in one.lines if line.component == "rate, run by run"]
    assert (line.kind, line.degrees) == ("B", 2.0)


def test_lines_say_where_they_come_from(result):
    by_name = {line.component: line for found in result.channels().values() for b in budgets(found) for line in b.lines}
    assert {by_name[name].kind for name in ("noise of the readings", "rate, run by run")} == {"A"}
    assert by_name["rate, run by run"].degrees < 60
    reference = by_name["reference thermometer, all runs alike"]
    assert (reference.kind, reference.standard_uncertainty, reference.unit) == ("B", 0.05, "K")
    assert reference.degrees == math.inf
    # A film's times go with 1 / D, and D with a few percent a kelvin.
    (one,) = (b for b in budgets(result.humidity)[:1])
    line = next(x for x in one.lines if x.key == "air_temperature_k")
    assert 0.02 < line.sensitivity / one.value < 0.05


@pytest.fixture(scope="module")
def behind_a_film(tmp_path_factory):
    hidden = [draw_effect(np.random.default_rng(9), "convective_film")]
    recorded = record(tmp_path_factory.mktemp("film") / "c", 9, hidden, tier="rough")
    return replace(recorded, common=STATED)


def bead(campaign, *effects):
    return characterize_channel(campaign, "temperature", 0, Extension(structure_of(effects)), lambda said: None)


def test_a_model_that_misfits_has_a_line_for_it(behind_a_film):
    found = bead(behind_a_film)
    assert not found.explained
    (alpha, *_) = budgets(found)
    assert any(line.component == "misfit of the model" for line in alpha.lines)
    assert alpha.standard_uncertainty == pytest.approx(found.rows[0].standard_uncertainty, rel=1e-6)


def test_what_all_runs_share_is_held_where_runs_are_looked_at_alone(behind_a_film):
    """How far runs are apart, that a model misses, is the same whether common errors are fitted along or not."""
    plain = bead(replace(behind_a_film, common=None))
    along = bead(replace(behind_a_film, common=STATED))
    assert not plain.explained and not along.explained
    relative = [found.rows[0].standard_uncertainty / found.rows[0].diffusivity_m2_s for found in (plain, along)]
    assert relative[0] <= relative[1] < 1.2 * relative[0]
    several = with_common(read_campaign(Path(__file__).parents[2] / "data" / "examples" / "ordinary-bench"))
    film = characterize_channel(several, "humidity", 0, Extension(), lambda said: None)
    assert not film.explained and len(film.rows) >= 5


def test_a_figure_whose_interval_reaches_0_is_not_certified(behind_a_film):
    (alpha, *_) = budgets(bead(behind_a_film))
    assert alpha.determined
    lines = (Component("one run", "A", "normal", 0.2, "1", alpha.value, 1.0),)
    once = replace(alpha, lines=lines, interval=None)
    assert once.standard_uncertainty == pytest.approx(0.2 * alpha.value)
    assert once.coverage_factor == pytest.approx(13.97, abs=0.01)  # JCGM 100, table G.2
    assert not once.determined


def test_the_page_says_at_its_top_that_figures_are_effective(certificate, tmp_path):
    names = {one.figure + one.channel: one.name for one in certificate.figures}
    assert names["t63temperature"] == "t63 of the thermometer" and names["t63humidity"].startswith(
        "t63 of the hygrometer at "
    )
    pages = [
        write_certificate_page(replace(certificate, undescribed=missed), tmp_path).read_text()
        for missed in ((), ("bead", "film"))
    ]
    assert "effective numbers of this campaign" not in pages[0]
    assert "does not describe the readings of the bead and the film: effective numbers" in pages[1]


def test_times_are_those_of_the_air_that_is_asked_for(behind_a_film):
    """Behind an air film a bead is slower in a slower airflow, and what dominates is the anemometer."""
    found = bead(behind_a_film, "convective_film")
    _, slow, _ = budgets(found, ResponseAir(airflow_m_s=2.0))
    _, fast, _ = budgets(found, ResponseAir(airflow_m_s=12.0))
    assert slow.value > 1.1 * fast.value
    assert slow.air.airflow_m_s == 2.0
    assert slow.lines[0].key == fast.lines[0].key == "airflow_percent"
    # Time goes at most as airflow^-0.45 behind a film, so 2 % are worth up to 0.9 % of it.
    assert 0.003 < slow.lines[0].contribution / slow.value < 0.009


def test_an_effective_figure_for_another_airflow_says_so(result):
    """The plain model knows no airflow: what it may do between that of the runs and another one is counted."""
    _, here, _ = budgets(result.temperature)
    _, there, _ = budgets(result.temperature, ResponseAir(airflow_m_s=40.0))
    assert there.standard_uncertainty > 1.05 * here.standard_uncertainty
    assert any(line.component == "airflow other than the runs'" for line in there.lines)


@pytest.fixture(scope="module")
def certificate(result):
    named = {"laboratory": "Bench & Sons", "person": "A. Nobody", "country": "DE", "software": "0.1"}
    return certified(
        result, ResponseAir(airflow_m_s=5.0), "2026-06-01", traced=[Traced("reference", "K-1 <2>")], **named
    )


def validated(text):
    xmlschema.XMLSchema(SCHEMA).validate(text)
    if official := os.environ.get("SHOCKRIG_DCC_XSD"):
        xmlschema.XMLSchema(official).validate(text)


def test_the_xml_keeps_to_the_structure_of_a_dcc(certificate):
    text = dcc_text(certificate)
    validated(text)
    bare = dcc_text(replace(certificate, traced=(), serials={}, kinds={}, notes=(), person="  a\x00b\nc "))
    validated(bare)
    assert ">ab c</dcc:content>" in bare
    unseen = {"serials": {"imet": "\u200b"}, "kinds": {"hyt": "\xad "}, "traced": (Traced("reference", "K-1 \x00"),)}
    validated(dcc_text(replace(certificate, **unseen)))
    assert "<dcc:traceable>false</dcc:traceable>" in bare
    assert "traceable" not in text
    wrong = text.replace("dcc:uniqueIdentifier>", "dcc:uniqueName>")
    with pytest.raises(xmlschema.XMLSchemaValidationError):
        validated(wrong)
    with pytest.raises(xmlschema.XMLSchemaValidationError):
        validated(re.sub(r"(<si:coverageFactor>)[^<]*", r"\g<1>0.2", text))


def test_ptbs_own_rules_find_nothing(certificate):
    """PTB's Schematron rules (methods, software and conditions of each quantity, units, languages, dates, releases)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what dcclib imports is older than this Python
        from dcclib.validation import SchematronValidator
    rules = SchematronValidator.for_dcc()

    def broken(text):
        found = rules.validate_str(text)
        reports = [*found.failed_assertions, *found.successful_reports]
        return [one.text for one in reports if one.role != "information"]

    text = dcc_text(certificate)
    assert not broken(text)
    assert not broken(dcc_text(replace(certificate, traced=(), serials={}, kinds={}, software="0.1.0.dev3+g1234")))
    for was, becomes in (("usedSoftware>", "usedMachines>"), ("\\second<", "\\milli \\second<"), ('"en"', '"de"')):
        assert broken(text.replace(was, becomes))


def test_pydcc_reads_it_back_number_for_number(certificate, monkeypatch):
    # What pydcc checks signatures with does not know every OpenSSL; nothing is signed here.
    absent = ModuleType("certvalidator")
    absent.CertificateValidator = absent.ValidationContext = absent.errors = None
    monkeypatch.setitem(sys.modules, "certvalidator", absent)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what pydcc imports is older than this Python
        import dcc.dcc as pydcc
    monkeypatch.setattr(pydcc, "DCCXMLValidator", lambda: None)  # downloads schemas as soon as it is made
    dcc = pydcc.DCC(byte_array=dcc_text(certificate).encode(), signature_verification=False)
    assert dcc.uid() == certificate.identifier
    assert dcc.version() == "3.3.0"
    assert dcc.calibration_laboratory_name() == "Bench & Sons"
    assert dcc.mandatory_language() == "en"
    read = dcc.get_calibration_results("name", "en")
    assert len(read) == len(certificate.figures)
    for (name, content), figure in zip(read, certificate.figures, strict=True):
        assert name.endswith(figure.name)
        real = content["real"]
        expanded = real["measurementUncertaintyUnivariate"]["expandedMU"]
        assert float(real["value"]) == figure.value
        assert float(expanded["valueExpandedMU"]) == figure.expanded_uncertainty
        assert float(expanded["coverageFactor"]) == figure.coverage_factor
        assert float(expanded["coverageProbability"]) == 0.9545


def test_the_days_of_a_wrong_clock_are_said_and_not_certified(result, certificate):
    """A computer without a battery begins at 1970-01-01."""

    def dated(begins, issued_on="2026-06-01", **session):
        runs = tuple(replace(run, started_at=begins) for run in result.campaign.runs)
        recorded = replace(result.campaign, runs=runs, sessions=(session,))
        return certified(replace(result, campaign=recorded), ResponseAir(), issued_on)

    for begins in (None, "1970-01-01T00:03:10.000Z"):
        made = dated(begins)
        assert made.began_on == made.ended_on == "" and "runs_from" not in certificate_document(made)
        assert "Nobody recorded when the runs were made, or by a clock that was not set." in made.notes
        validated(dcc_text(made))
    (note,) = set(dated("2026-06-03T00:03:10.000Z").notes) - set(certificate.notes)
    assert "The last run is dated 2026-06-03, later than this certificate" in note
    (note,) = set(dated("2026-05-03T00:03:10.000Z", clock_synchronised=False).notes) - set(certificate.notes)
    assert "was not synchronised" in note


def test_no_certificate_is_dated_by_a_clock_that_was_not_set(campaign, tmp_path):
    args = build_parser("certify").parse_args(["certify", str(campaign.path), "--out", str(tmp_path / "out")])
    with pytest.raises(InputError, match="this computer's clock says 1970-01-01, .*: set the clock"):
        certify.write(args, args.out, None, "1970-01-01T00:00:40Z", "1")
    assert not args.out.exists()


def test_what_nobody_states_is_an_ordinary_laboratorys_and_emulated_references_have_no_error(campaign):
    assert with_common(replace(campaign, common=None)).common == NOTHING_COMMON
    measured = replace(campaign, common=None, emulated=False)
    assert with_common(measured).common is ORDINARY_LABORATORY
    assert with_common(replace(campaign, common=STATED)).common is STATED


def test_traceability_comes_from_certificates_that_somebody_named(campaign, certificate):
    own, theirs = {"certificate": "x"}, {"certificate": "K-7", "calibrated": "2026-04-01"}
    session = {"calibration": {"reference": theirs, "hyt": own, "imet-2": own}}
    recorded = replace(campaign, sessions=({}, session, {"calibration": "none"}))
    assert calibrations(recorded) == [Traced("reference", "K-7", "2026-04-01")]
    assert "K-7 of 2026-04-01, as the user states" in calibrations(recorded)[0].sentence
    assert replace(certificate, traced=()).traceability == NOT_TRACEABLE


def test_the_command_writes_every_form_and_says_what_was_taken_by_default(campaign, tmp_path, capsys):
    head = json.loads((campaign.path / "campaign.json").read_text())
    head["common_uncertainty"] = {"airflow_percent": 2.0}
    copied = tmp_path / "c"
    copied.mkdir()
    (copied / "campaign.json").write_text(json.dumps(head))
    (copied / "runs").symlink_to(campaign.path / "runs")
    assert main(["certify", str(copied), "--out", str(tmp_path / "out"), "--airflow", "6", "--country", "de"]) == 0
    said = capsys.readouterr().out
    assert "trigger_offset_s 0.01" in said
    assert "not accredited; no traceability is claimed" in said
    assert "Emulated instruments: nothing here was measured" in said
    out = tmp_path / "out"
    content = json.loads((out / "certificate.json").read_text())
    assert content["accredited"] is False
    assert content["common_uncertainty"]["airflow_percent"] == {"value": 2.0, "by_default": False}
    assert content["common_uncertainty"]["clock_ppm"]["by_default"]
    validated((out / "certificate.xml").read_text())
    rows = list(csv.DictReader((out / "budget.csv").read_text().splitlines()))
    first = content["figures"][0]
    own = [row for row in rows if row["figure"] == first["figure"] and row["channel"] == first["channel"]]
    assert sum(float(row["share_percent"]) for row in own) == pytest.approx(100.0, abs=1e-3)
    total = math.sqrt(sum(float(row["contribution"]) ** 2 for row in own))
    assert total == pytest.approx(first["standard_uncertainty"], rel=1e-5)
    page = (out / "certificate.html").read_text()
    assert "@page { size: A4; }" in page
    assert "Not issued by an accredited laboratory" in page
    assert "an ordinary laboratory" in page
    assert (out / "budget.png").stat().st_size > 10_000


def test_an_airflow_for_which_nothing_is_known_is_named(tmp_path, capsys):
    """It had been "215 %, expanded for 13103485941.3 degrees of freedom 431 %; record more runs"."""
    assert main(["run", "quick", "--out", str(tmp_path / "c")]) == 0  # at 6 m/s alone
    assert main(["certify", str(tmp_path / "c"), "--out", str(tmp_path / "out"), "--airflow", "0.05"]) == 2
    said = capsys.readouterr().err
    assert "degrees of freedom" not in said and "% (airflow other than the runs' most of all)" in said
    assert said.endswith(
        "; give an --airflow that is nearer to the runs', record more runs, or run shockrig diagnose and certify with "
        "--extend\n"
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--traced", "PTB 123"], "--traced PTB 123: expected INSTRUMENT=CERTIFICATE"),
        (["--country", "Germany"], "--country Germany: expected two letters"),
        (["--airflow", "-3"], "--airflow: -3 cannot be"),
        (["--airflow", "nan"], "--airflow: nan cannot be"),
        (["--airflow", "0"], "--airflow 0: no response is known in air that stands still; expected 0.05 m/s or more"),
    ],
)
def test_bad_arguments_end_with_one_line(campaign, tmp_path, capsys, words, said):
    assert main(["certify", str(campaign.path), "--out", str(tmp_path / "out"), *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert not (tmp_path / "out").exists()


def test_a_certificate_of_a_campaign_of_another_program_is_made(tmp_path):
    """No trigger stated in common, no sessions: everything by default."""
    example = Path(__file__).parents[2] / "data/examples/plain-rough"
    campaign = with_common(read_campaign(example))
    assert campaign.common.by_default == ORDINARY_LABORATORY.by_default
