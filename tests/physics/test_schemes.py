"""The layered schemes against the series (written out again here), published landmarks, and each other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, least_squares

from shockrig.analysis.physics import schemes
from shockrig.analysis.physics.schemes import FILM_SCHEMES, SPHERE_SCHEMES, film_layers, sphere_layers, step_response
from shockrig.protocols.cli import main

SHARE_63 = 1 - np.exp(-1)
SPHERE_T98, FILM_T98 = 0.46660, 1.50037
ALL = [(sphere_layers, s) for s in SPHERE_SCHEMES] + [(film_layers, s) for s in FILM_SCHEMES]


def core_series(time):
    """T(0, t) = 1 + 2 sum (-1)^n exp(-n^2 pi^2 t)."""
    n = np.arange(1, 200)
    return 1 + 2 * np.sum((-1.0) ** n * np.exp(-np.multiply.outer(time, (n * np.pi) ** 2)), axis=-1)


def mean_series(time):
    """Mean c = 1 - 8/pi^2 sum exp(-(2n+1)^2 pi^2 t / 4) / (2n+1)^2."""
    odd = 2 * np.arange(2000) + 1
    return 1 - 8 / np.pi**2 * np.sum(np.exp(-np.multiply.outer(time, (odd * np.pi / 2) ** 2)) / odd**2, axis=-1)


SERIES = {sphere_layers: core_series, film_layers: mean_series}


def t63(response):
    return brentq(lambda t: float(response(np.array([t]))[0]) - SHARE_63, 1e-3, 5.0, xtol=1e-12)


def error_percent(build, scheme, layers):
    exact = t63(SERIES[build])
    return 100 * (t63(lambda t: step_response(build(scheme, layers), t)) / exact - 1)


def fitted_ratio(build, scheme, layers):
    """Fitted over true diffusivity / length^2, from samples of the series with the start between two of them."""
    t98 = {sphere_layers: SPHERE_T98, film_layers: FILM_T98}[build]
    time = np.arange(0.0043, 5.0, 0.1) * t98 + 0.003
    reading = SERIES[build](time)
    fit = least_squares(lambda p: step_response(build(scheme, layers), np.exp(p[0]) * time) - reading, [0.1])
    return float(np.exp(fit.x[0]))


def test_the_series_have_the_known_landmarks():
    for series, landmarks in (
        (core_series, (0.13879, 0.17091, 0.30352, 0.46660)),
        (mean_series, (0.19673, 0.32025, 0.84809, 1.50037)),
    ):
        assert series(np.array(landmarks)) == pytest.approx([0.5, SHARE_63, 0.90, 0.98], abs=3e-5)


@pytest.mark.parametrize("build", [sphere_layers, film_layers])
def test_collocation_has_the_response_times_of_the_series(build):
    for layers in (5, 8, 16, 64):
        time = np.array([0.05, 0.13879, 0.19673, 0.30352, 0.46660, 0.84809, 1.50037, 3.0])
        tolerance = 1e-3 if layers == 5 else 1e-5
        assert step_response(build("collocation", layers), time) == pytest.approx(SERIES[build](time), abs=tolerance)


@pytest.mark.parametrize("build", [sphere_layers, film_layers])
def test_8_and_64_layers_give_the_same_diffusivity_only_with_the_high_order_fix(build):
    few, many = (fitted_ratio(build, "collocation", n) for n in (8, 64))
    assert few == pytest.approx(many, rel=1e-3) and many == pytest.approx(1.0, rel=1e-3)
    assert error_percent(build, "collocation", 8) == pytest.approx(error_percent(build, "collocation", 64), abs=0.1)
    few, many = (fitted_ratio(build, "printed", n) for n in (8, 64))
    assert few > 1.1 * many and many > 1.01


@pytest.mark.parametrize(
    ("build", "scheme", "published"),
    [
        (sphere_layers, "printed", {3: 51, 5: 34, 10: 18, 20: 10, 50: 4}),
        (sphere_layers, "corrected", {3: 1.6, 5: 0.9, 10: 0.3}),
        (sphere_layers, "centre_3_beta", {3: 14, 5: 5, 10: 1.3}),
        (film_layers, "printed", {5: 34, 10: 17, 20: 8}),
        (film_layers, "corrected", {5: 1.9, 10: 0.5, 20: 0.1}),
    ],
)
def test_t63_is_too_long_by_the_published_share(build, scheme, published):
    measured = {n: error_percent(build, scheme, n) for n in published}
    for layers, percent in published.items():
        assert measured[layers] == pytest.approx(percent, abs=0.5 if percent >= 4 else 0.06)


@pytest.mark.parametrize("layers", [5, 10, 20])
def test_the_printed_film_is_half_a_cell_too_thick(layers):
    slowest = np.linalg.eigvalsh(film_layers("printed", layers).a).max()
    assert (-(np.pi**2) / 4) / slowest == pytest.approx(((2 * layers + 1) / (2 * layers)) ** 2, rel=1e-2)


@pytest.mark.parametrize(("build", "scheme"), ALL)
@pytest.mark.parametrize("layers", [2, 3, 8])
def test_every_scheme_keeps_a_uniform_sensor_uniform_and_settles_at_the_air(build, scheme, layers):
    system = build(scheme, layers, 2.5)
    assert system.a.sum(axis=1) + system.b == pytest.approx(np.zeros(layers), abs=1e-9 * np.abs(system.a).max())
    assert system.c.sum() + system.d == pytest.approx(1.0)
    assert np.linalg.eigvals(system.a).real.max() < 0
    assert step_response(system, np.array([-1.0, 0.0, 100.0])) == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)


@pytest.mark.parametrize(("build", "scheme"), ALL)
@pytest.mark.parametrize("layers", [3, 6])
def test_the_step_response_is_that_of_the_differential_equation(build, scheme, layers):
    system = build(scheme, layers, 0.7)
    time = np.array([0.05, 0.4, 1.1, 2.0])
    solution = solve_ivp(
        lambda _, x: system.a @ x + system.b, (0, 2), np.zeros(layers), "LSODA", time, rtol=1e-10, atol=1e-12
    )
    assert step_response(system, time) == pytest.approx(system.c @ solution.y, abs=1e-7)


@pytest.mark.parametrize(("build", "scheme"), ALL)
def test_zero_order_hold_is_exact_for_an_air_in_steps(build, scheme):
    system = build(scheme, 6, 0.4)
    sampled = schemes.sample(system, 0.1)
    assert sampled.a == pytest.approx(expm(0.1 * system.a), abs=1e-12)
    state = np.zeros(6)
    for _ in range(20):
        state = sampled.a @ state + sampled.b
    assert sampled.c @ state == pytest.approx(step_response(system, np.array([2.0]))[0], abs=1e-10)


@pytest.mark.parametrize("method", schemes.METHODS)
def test_every_discretisation_tends_to_the_exact_one(method):
    system = film_layers("corrected", 5, 0.3)
    assert schemes.sample(system, 0.1, method).period_s == 0.1
    errors = []
    for period in (0.02, 0.01):
        sampled = schemes.sample(system, period, method)
        state, air = np.zeros(5), 1.0
        for _ in range(round(1 / period)):
            state = sampled.a @ state + sampled.b * air
        errors.append(abs(sampled.c @ state + sampled.d * air - step_response(system, np.array([1.0]))[0]))
    assert errors[1] < 0.6 * errors[0] + 1e-12


def test_explicit_steps_grow_beyond_the_limit_and_not_within():
    for scheme, limit in (("corrected", 1 / 3), ("printed", 0.5)):
        for layers in (3, 5, 10):
            phi = schemes.stable_period_s(sphere_layers(scheme, layers)) * layers**2
            assert phi == pytest.approx(limit, rel=1e-9 if scheme == "corrected" else 0.03)
    system = sphere_layers("corrected", 5)
    limit = schemes.stable_period_s(system)
    for factor, grows in ((0.98, False), (1.02, True)):
        sampled = schemes.sample(system, factor * limit, "explicit_euler")
        assert (np.abs(schemes.poles(sampled)).max() > 1) == grows


def test_sampling_puts_the_published_zeros_into_the_core():
    for layers, published in ((3, -1.45), (5, -3.2), (10, -5.9)):
        sampled = schemes.sample(sphere_layers("corrected", layers, SPHERE_T98 / 1.0), 0.1)
        assert schemes.zeros(sampled).real.min() == pytest.approx(published, abs=0.05)
        assert not schemes.is_minimum_phase(sampled) and schemes.inverse_noise_gain(sampled) == np.inf


@pytest.mark.parametrize("method", schemes.METHODS)
def test_zeros_make_the_transfer_function_vanish(method):
    sampled = schemes.sample(sphere_layers("corrected", 4, 0.4666), 0.1, method)
    for zero in schemes.zeros(sampled):
        transfer = sampled.c @ np.linalg.solve(zero * np.eye(4) - sampled.a, sampled.b.astype(complex)) + sampled.d
        elsewhere = sampled.c @ np.linalg.solve((zero + 0.5) * np.eye(4) - sampled.a, sampled.b + 0j) + sampled.d
        assert abs(transfer) < 1e-6 * max(abs(elsewhere), 1e-3)


def test_the_explicit_step_is_a_pure_delay_and_the_trapezoidal_rule_puts_zeros_at_minus_one():
    for layers in (3, 5, 10):
        system = sphere_layers("printed", layers, SPHERE_T98)
        explicit = schemes.sample(system, 0.1, "explicit_euler")
        assert schemes.delay_samples(explicit) == layers and schemes.zeros(explicit).size == 0
        trapezoidal = schemes.zeros(schemes.sample(system, 0.1, "trapezoidal"))
        # N zeros in one place scatter by the N-th root of rounding
        assert trapezoidal == pytest.approx(-np.ones(layers), abs=5 * 1e-16 ** (1 / layers))


def test_what_can_be_inverted():
    for layers in (3, 5, 10, 20):
        for scheme in FILM_SCHEMES:
            assert schemes.is_minimum_phase(schemes.sample(film_layers(scheme, layers, FILM_T98 / 4), 0.1))
        for build, rate in ((sphere_layers, SPHERE_T98), (film_layers, FILM_T98 / 4)):
            for scheme in ("printed", "corrected"):
                assert schemes.is_minimum_phase(schemes.sample(build(scheme, layers, rate), 0.1, "backward_euler"))
        for skew, cured in ((0.0, True), (1.0, True), (4.0, False)):
            sampled = schemes.sample(sphere_layers("printed", layers, SPHERE_T98, skew), 0.1)
            assert schemes.is_minimum_phase(sampled) == cured


def test_noise_gain_of_the_inverse_is_the_published_one_and_what_filtering_noise_gives():
    for t98, published in ((4.0, 9), (18.7, 36)):
        coarse = schemes.sample(film_layers("printed", 5, FILM_T98 / t98), 0.1)
        assert schemes.inverse_noise_gain(coarse) == pytest.approx(published, rel=0.02)
    sampled = schemes.sample(film_layers("corrected", 5, FILM_T98 / 4), 0.1)
    noise = np.random.default_rng(3).standard_normal(200_000)
    state, air = np.zeros(5), np.empty(noise.size)
    first = sampled.c @ sampled.b
    row = sampled.c @ sampled.a
    for k, reading in enumerate(noise):
        air[k] = (reading - row @ state) / first
        state = sampled.a @ state + sampled.b * air[k]
    assert schemes.inverse_noise_gain(sampled) == pytest.approx(air[100:].std(), rel=0.02)


def test_noise_gain_of_the_converged_film_goes_with_the_root_of_its_response_time():
    fast, slow = (
        schemes.inverse_noise_gain(schemes.sample(film_layers("collocation", 32, FILM_T98 / t), 0.1)) for t in (4, 16)
    )
    assert slow / fast == pytest.approx(2.0, rel=0.01)


def test_the_table_holds_every_slip_with_its_published_number():
    table = {slip.id: slip for slip in schemes.slips_table()}
    rows = {key: {row.case: row for row in slip.rows} for key, slip in table.items()}
    assert len(table) == 16
    for slip in table.values():
        assert slip.rows and all(
            np.isfinite([v for v in (r.corrected, r.high_order, r.exact) if v is not None]).all() for r in slip.rows
        )
    assert rows["response_time_names"]["sphere, core"].exact == pytest.approx(2.730, abs=1e-3)
    assert rows["response_time_names"]["film, mean"].exact == pytest.approx(4.685, abs=1e-3)
    biot = [row.exact for case, row in rows["one_alpha"].items() if case.startswith("Biot")]
    assert (biot[0], biot[-1]) == pytest.approx((0.09, 0.18), abs=0.006)
    lags = [row.exact for case, row in rows["one_alpha"].items() if case.startswith("lag")]
    assert lags == pytest.approx([0.77, 4.0], rel=0.05)
    assert rows["one_alpha"]["rms misfit of the ideal sphere at 5 m/s, % of the step"].printed == pytest.approx(
        5.6, abs=0.3
    )
    assert rows["air_temperature_ppmv"]["die 10 K colder than the air"].exact - 50 == pytest.approx(45, abs=0.5)
    formula = list(rows["saturation_formula"].values())
    assert (formula[0].printed, formula[1].printed) == pytest.approx((0.22, -48.6), abs=0.05)
    start = rows["transfer_as_step"]
    assert [start[f"{s}, start fixed"].printed for s in ("sphere", "film")] == pytest.approx([1.15, 1.21], abs=0.015)
    assert [start[f"{s}, start free"].corrected for s in ("sphere", "film")] == pytest.approx([1.01, 1.01], abs=0.005)


def test_schemes_refuse_what_they_cannot_build():
    with pytest.raises(ValueError, match="not one of"):
        sphere_layers("simple", 5)
    with pytest.raises(ValueError, match="at least 2"):
        film_layers("corrected", 1)
    with pytest.raises(ValueError, match="positive"):
        film_layers("corrected", 4, -1.0)
    with pytest.raises(ValueError, match="already sampled"):
        schemes.sample(schemes.sample(film_layers("corrected", 4), 0.1), 0.1)


def test_the_command_prints_the_table_and_writes_the_page(tmp_path, capsys):
    assert main(["slips", "--out", str(tmp_path / "slips")]) == 0
    printed = capsys.readouterr().out
    assert "0.2585 (+51.2 %)" in printed and "Noise through the inverse of the film" in printed
    names = sorted(path.name for path in (tmp_path / "slips").iterdir())
    assert names == ["grid_errors.png", "report.html", "step_responses.png", "zeros.png"]
    page = (tmp_path / "slips" / "report.html").read_text(encoding="utf-8")
    assert page.count("<img ") == 3 and "0.2585 (+51.2 %)" in page


def test_the_command_says_which_folder_it_cannot_write(tmp_path, capsys):
    (tmp_path / "taken").write_text("a file")
    assert main(["slips", "--out", str(tmp_path / "taken")]) == 2
    assert "taken" in capsys.readouterr().err
