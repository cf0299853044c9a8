"""Figures that are no straight function of what is uncertain: known answers, whole fits, certificates of two ends."""

import json
import sys
import warnings
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from small_worlds import record
from test_certificate import STATED, bead, validated

from shockrig.analysis.characterize import curvature
from shockrig.analysis.characterize.budget import budgets, log_figure
from shockrig.analysis.characterize.certified import certified
from shockrig.analysis.characterize.response_times import ResponseAir
from shockrig.analysis.characterize.result import Characterization
from shockrig.analysis.characterize.shifts import disturbances
from shockrig.analysis.estimate.fit import fit
from shockrig.analysis.estimate.model import Point
from shockrig.files.certificate import certificate_document
from shockrig.files.dcc import dcc_text
from shockrig.files.numbers import between
from shockrig.rig.virtual.hide import draw_effect

BEND = 0.3


def bent_ridge():
    """One parameter s that is read twice, as s and as BEND s^2, each with noise 1: the fit is the root of a cubic."""
    at = np.linspace(-6.0, 6.0, 121)
    return curvature.Ridge(
        at=at,
        theta=at[:, None],
        across=np.zeros((1, 0)),
        basis=np.eye(2)[None],
        z=np.column_stack([at, BEND * at**2])[:, None],
        jacobian=np.zeros((at.size, 1, 2, 0)),
        metric=np.tile(np.eye(2), (at.size, 1, 1, 1)),
        effects=np.zeros((1, 2, 1)),
        known=np.zeros(1),
        disturbances=(),
    )


def itself(theta):
    return float(theta[0]), np.ones(1)


def test_where_a_fit_ends_is_the_root_of_its_cubic():
    errors = np.random.default_rng(3).standard_normal((200, 1, 2))
    found = curvature.reached(bent_ridge(), itself, curvature.fits(bent_ridge(), errors, np.zeros((200, 1))))
    for (x, y), s in zip(errors[:, 0], found, strict=True):
        roots = np.roots([2 * BEND**2, 0.0, 1.0 - 2 * BEND * y, -x])
        real = roots[np.abs(roots.imag) < 1e-9].real
        best = min(real, key=lambda r, x=x, y=y: (r - x) ** 2 + (BEND * r**2 - y) ** 2)
        assert s == pytest.approx(best, abs=0.01)


def test_what_no_straight_line_explains_is_the_rest_of_the_variance():
    bent = curvature.drawn(bent_ridge(), [itself])[0]
    whole = sum(one**2 for one in bent.contributions) + bent.beyond**2
    assert whole == pytest.approx(np.var(bent.error), rel=1e-9)
    assert bent.beyond > 0.1
    low, high = bent.interval(0.0, 2.0)
    assert np.mean((np.expm1(bent.error) > low) & (np.expm1(bent.error) < high)) == pytest.approx(0.9545, abs=1e-3)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """A bead behind an air film: alpha and the film do nearly the same."""
    hidden = [draw_effect(np.random.default_rng(63001), "convective_film")]
    recorded = record(tmp_path_factory.mktemp("film") / "c", 63001, hidden, tier="rough")
    campaign = replace(recorded, common=STATED)
    return campaign, bead(campaign, "convective_film")


@pytest.fixture(scope="module")
def of_film(found):
    return budgets(found[1])


@pytest.mark.trial
def test_a_whole_fit_ends_where_the_ridge_says(found, of_film):
    """Readings as they are with every transfer later, and with every run's rate off: fitted anew as a whole."""
    _, result = found
    (part,), budget = result.parts, of_film[0]
    problem, channel, model = part.problem, part.channel, part.fit.model
    ridge = curvature.ridge(problem, part.fit, list(disturbances(problem, part.fit).values()))
    of = log_figure(part, 0, budget)
    start = np.where(np.arange(model.size) >= model.behind.start, 0.0, part.fit.theta)
    rest = Point(start, channel.at_rest())
    clean = model.predict(rest)[0]
    bent = []
    for late_s, slower in ((0.012, 0.0), (-0.012, 0.0), (0.0, 0.003), (0.01, -0.004)):
        own = channel.at_rest()
        own[:, 0] += late_s
        own[:, 1] += slower * np.cos(np.arange(channel.runs))
        value = model.predict(Point(start, own))[0]
        there = channel.count > 0
        moved = replace(channel, value=np.where(there, value, channel.value))
        again = replace(problem, channel=moved).with_rate_scatter(part.fit.rate_scatter)
        whole = fit(again, part.fit.structure, part.fit.theta, adapt_scatter=False, tolerance=1e-7, iterations=100)
        readings = np.einsum("rbk,rb->rk", ridge.basis, problem.whiten(np.where(there, value - clean, 0.0)))
        ended = curvature.fits(ridge, readings[None], np.zeros((1, model.size)))
        (reached,) = curvature.reached(ridge, of, ended)
        assert reached == pytest.approx(whole.theta[0] - part.fit.theta[0], abs=0.02)
        bent.append(abs(reached))
    assert max(bent) > 0.1


def test_alpha_behind_a_film_has_two_ends_and_shares_that_add_up(of_film):
    alpha, t63, _ = of_film
    assert alpha.interval is not None
    low, high = (end / alpha.value for end in alpha.interval)
    assert 1.5 * (1.0 - low) < high - 1.0
    assert alpha.coverage_factor * alpha.standard_uncertainty == pytest.approx(0.5 * (high - low) * alpha.value)
    for budget in (alpha, t63):
        assert sum(budget.share(line) for line in budget.lines) == pytest.approx(1.0, abs=1e-9)
    assert any(line.component == "curvature of the response" for line in alpha.lines)
    assert t63.standard_uncertainty < 0.05 * t63.value


def test_a_certificate_carries_both_ends_and_pydcc_reads_them(found, monkeypatch):
    campaign, result = found
    whole = Characterization(campaign, 0, result, None, {})
    certificate = certified(whole, ResponseAir(), "2026-06-01")
    alpha = certificate.figures[0]
    assert alpha.coverage_interval is not None
    content = certificate_document(certificate)["figures"][0]
    assert json.loads(json.dumps(content["coverage_interval"])) == list(alpha.coverage_interval)
    text = dcc_text(certificate)
    validated(text)
    assert "JCGM 101:2008" in text
    absent = ModuleType("certvalidator")
    absent.CertificateValidator = absent.ValidationContext = absent.errors = None
    monkeypatch.setitem(sys.modules, "certvalidator", absent)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what pydcc imports is older than this Python
        import dcc.dcc as pydcc
    monkeypatch.setattr(pydcc, "DCCXMLValidator", lambda: None)
    read = pydcc.DCC(byte_array=text.encode(), signature_verification=False).get_calibration_results("name", "en")
    own = read[0][1]["real"]["measurementUncertaintyUnivariate"]["coverageIntervalMU"]
    assert float(own["valueStandardMU"]) == alpha.standard_uncertainty
    assert (float(own["intervalMin"]), float(own["intervalMax"])) == alpha.coverage_interval


def test_two_ends_are_written_with_the_digits_of_the_shorter_side():
    assert between(1.0156e-6, 0.645e-6, 2.51e-6, "m²/s") == "1.02 (0.65 to 2.51) × 10⁻⁶ m²/s"
    assert between(7.5, 6.94, 9.41, "s") == "7.50 (6.94 to 9.41) s"
