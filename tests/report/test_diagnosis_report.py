"""What the diagnosis page is made of: sentences, held-out residuals' numbers, single runs by condition, the flight."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from shockrig.analysis.diagnose.diagnosed import Cause
from shockrig.analysis.diagnose.gain import Gain, HeldOut
from shockrig.analysis.diagnose.remainder import is_material
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.estimate.quantity import QUANTITIES, TEMPERATURE
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.report import diagnosis_page
from shockrig.analysis.report.crossing import cross_inversion
from shockrig.analysis.report.diagnosis_view import parted_by
from shockrig.analysis.report.diagnosis_words import (
    cause_sentence,
    channel_verdict,
    experiments,
    listed,
    missing,
    remainder_sentence,
    removed_share,
    value_text,
    worse,
)
from shockrig.analysis.report.fit_figures import RunParameter
from shockrig.analysis.report.fitted import drifts
from shockrig.analysis.report.remaining import autocorrelation, size
from shockrig.files.diagnosis_data import StatedRemainder
from shockrig.files.profile import HumidityProfile, Profile, StatedEffect, TemperatureProfile, Uncertain


def gain(before, after, floor):
    runs = [np.full(3, x**2) for x in (before, after)]
    return Gain(before, after, floor, 0.99, (0.98, 1.0), *runs)


def recorded(airs_known, body="sphere", name="temperature"):
    """One run of a lag of 1 s, 90 % of its way after 2.3 s."""
    time_s = np.linspace(-2.0, 20.0, 441)
    reading = np.where(time_s > 0, 30.0 - 10.0 * np.exp(-np.maximum(time_s, 0.0)), 20.0)
    airs = {"source_c": 20.0, "destination_c": 30.0, "source_percent": 20.0, "destination_percent": 30.0}
    airs = {key: np.array([value]) for key, value in {**airs, "thermal_step_k": 10.0}.items()}
    conditions = SimpleNamespace(airs_known=np.array([airs_known]), start_known=np.array([True]), **airs)
    runs = {"run_ids": ("0001",), "samples": ((time_s, reading),), "air": (None,)}
    quantity, lumped = QUANTITIES[name], body == "lumped"
    named = {"lumped": lumped, "sensor": quantity.instrument if lumped else quantity.noun}
    return SimpleNamespace(quantity=quantity, conditions=conditions, body=body, **named, **runs)


def channel(name, verdict, causes=(), discrepancy=None, airs_known=True, body="sphere"):
    return SimpleNamespace(
        problem=SimpleNamespace(channel=recorded(airs_known, body, name)),
        name=name,
        discovered=(),
        verdict=verdict,
        causes=causes,
        gain=gain(0.9, 0.021, 0.020),
        noise=SimpleNamespace(standard_deviation=0.020),
        discrepancy=discrepancy,
        remainder=SimpleNamespace(significant=False, material=False),
        search=SimpleNamespace(leaves_open=False),
    )


FILM = Cause("convective_film", {"biot_at_5_m_s": Uncertain(0.12, 0.01)}, 0.99)


def test_the_sentence_a_colleague_would_say():
    assert channel_verdict(channel("temperature", "explained", (FILM,))) == (
        "The bead does not follow the air at once: the air film around it (Biot 0.120 ± 0.010 at 5 m/s) makes it "
        "slower at low airflow. With it the model predicts unseen runs to 0.021 K instead of 0.90 K (noise 0.020 K)."
    )


def test_what_is_likelier_and_left_open_is_said_where_nothing_is_left():
    one = channel("temperature", "unexplained", body="lumped")
    one.search = SimpleNamespace(leaves_open=True)
    assert channel_verdict(one) == (
        "One lag is not all that moves the thermometer's readings, and what else does these runs leave open."
    )


def test_what_one_run_leaves_that_passes_for_noise_is_said_with_its_size():
    """Held by hand and let go: the readings drift by kelvins, all of which a noise that hangs together explains. They
    had nothing above the noise, and the bench was as it should."""
    one = channel("temperature", "adequate", body="lumped")
    one.gain = SimpleNamespace(measured=False)
    one.problem.channel.count = np.ones((1, 400))
    one.remainder = StatedRemainder(0.0, 0.0, "K", False, True, 0.03, 30.0, 150.0)
    for left, said in ((1.1, "1.1 K rms beside a noise of 0.020 K"), (0.02, "One lag fits the thermometer's readings")):
        one.final = SimpleNamespace(residual=np.full((1, 400), left))
        assert said in channel_verdict(one)
        assert ("nothing above the noise" in remainder_sentence(one)) == (left < 0.1)
        page = diagnosis_page._advice([SimpleNamespace(found=one)])
        assert ("do what the plain model says" in str(page)) == (left < 0.1)


def test_what_a_test_tells_from_noise_is_not_said_to_be_like_it():
    """Of one run, 0.6 K beside a noise of 0.02 K, which "no catalogued effect explains", "hangs together as noise"."""
    one = channel("temperature", "unexplained", body="lumped")
    one.gain = SimpleNamespace(measured=False)
    one.problem.channel.count, one.final = np.ones((1, 400)), SimpleNamespace(residual=np.full((1, 400), 0.6))
    for significant in (True, False):
        one.remainder = StatedRemainder(0.0, 0.0, "K", significant, True, 0.03, 30.0, 150.0)
        assert remainder_sentence(one).startswith("Left in the readings: 0.60 K rms, ")
        assert ("as noise of theirs may" in remainder_sentence(one)) != significant


def test_a_positive_number_that_is_not_told_has_the_ends_of_its_range():
    """A time constant of 94 s with a standard uncertainty of 708 s is not said to be that, nor to be below nothing."""
    (lag,) = CATALOGUE["series_lag"].parameters
    assert value_text("temperature", lag, Uncertain(94.0, 708.0)) == f"94 (0 to {lag.high:.0f})"
    assert value_text("temperature", lag, Uncertain(10.0, 10.0)) == "10.0 (3.7 to 27.2)"
    assert value_text("temperature", lag, Uncertain(94.0, 20.0)) == "94 ± 20"
    share = next(p for p in CATALOGUE["parallel_lag"].parameters if p.name == "fraction")
    assert value_text("temperature", share, Uncertain(0.15, 8.55)) == f"15 (0 to {100.0 * share.high:.0f}) %"
    assert value_text("temperature", share, Uncertain(0.15, 0.02)) == "15.0 ± 2.0 %"


def test_a_number_of_which_runs_say_nothing_is_said_to_be_one():
    cause = Cause("series_lag", {"time_constant_s": Uncertain(94.0, 708.0)}, 0.7, (), ())
    assert cause_sentence("temperature", cause).endswith("Of its time constant these runs say nothing.")
    sure = Cause("series_lag", {"time_constant_s": Uncertain(94.0, 20.0)}, 0.7, (), ())
    assert "say nothing" not in cause_sentence("temperature", sure)


def test_a_tie_a_doubt_and_a_bound_are_said():
    cause = Cause("dead_time", {"delay_s": Uncertain(0.2, 0.1)}, 0.6, ("finite_transfer",), ("delay_s",))
    text = cause_sentence("humidity", cause)
    assert text.startswith("Probably (60 %): this channel is logged late by 0.20 ± 0.10 s.")
    assert "cannot tell that from finite transfer" in text and "Its delay stands at the end of its range" in text


def test_shares_are_percent_and_the_channels_unit_is_named():
    parameters = {"gain": Uncertain(0.012, 0.001), "offset": Uncertain(-0.3, 0.02)}
    cause = Cause("calibration_error", parameters, 0.99)
    text = cause_sentence("humidity", cause)
    assert "gain 1.20 ± 0.10 %" in text and "offset −0.300 ± 0.020 %RH" in text


@pytest.mark.parametrize("effect", CATALOGUE)
def test_every_effect_of_the_catalogue_has_a_sentence_without_blanks(effect):
    parameters = {p.name: Uncertain(p.starts[0], 0.1 * abs(p.starts[0])) for p in CATALOGUE[effect].parameters}
    for name in CATALOGUE[effect].channels:
        text = cause_sentence(name, Cause(effect, parameters, 0.99))
        assert "{" not in text and text.endswith(".")


def test_adequate_and_unexplained_are_said_honestly():
    assert "plain diffusion model describes the film" in channel_verdict(channel("humidity", "adequate"))
    one_lag = channel("temperature", "adequate", body="lumped")
    assert channel_verdict(one_lag).startswith("One lag describes the thermometer: it predicts unseen runs to")
    left = {
        "size_rms": 0.08,
        "size_peak": 0.2,
        "largest_from_s": 2.5,
        "largest_until_s": 10.0,
        "varies_with": ["nothing: the same in every run", "airflow"],
        "in_common": 0.42,
        "test": "mean response",
    }
    text = channel_verdict(channel("temperature", "unexplained", (FILM,), left))
    assert text.startswith("Something is left in the bead's readings that no catalogued effect explains: 0.080 K rms")
    assert "from 2.5 to 10 s" in text and "it varies with airflow; 42 % of it is the same in every run" in text
    assert "Certain all the same: The bead does not follow" in text
    unsure = channel_verdict(channel("temperature", "unexplained", (replace(FILM, probability=0.7),), left))
    assert "Certain" not in unsure and "As far as these runs tell: Probably (70 %)" in unsure
    assert channel_verdict(channel("temperature", "unexplained")).endswith("explains.")


@pytest.mark.parametrize(
    ("airs_known", "from_s", "late"), [(False, 2.5, True), (False, 2.0, False), (True, 9.0, False)]
)
def test_what_is_left_when_the_response_is_over_is_the_airs(airs_known, from_s, late):
    left = {"size_rms": 0.08, "size_peak": 0.2, "largest_from_s": from_s, "largest_until_s": 20.0}
    text = channel_verdict(channel("temperature", "unexplained", (), left, airs_known))
    assert ("rather an air that moved than the sensor" in text) == late


def test_what_is_left_is_said_with_whether_it_matters():
    def said(rms, significant, tolerance, measured=True, peak=None):
        peak = 4 * rms if peak is None else peak
        material = is_material(significant, rms, peak, tolerance)
        left = StatedRemainder(rms, peak, "K", significant, material, tolerance, 0.6, 2.5)
        return remainder_sentence(SimpleNamespace(remainder=left, gain=SimpleNamespace(measured=measured)))

    assert said(0.01, False, 0.03) == (
        "Left on unseen runs: 0.010 K rms above the noise, at most 0.040 K; no more than chance leaves."
    )
    assert said(0.01, False, 0.03, measured=False).startswith("Left in the readings: ")
    # The peak is of the fit to all runs, the rms of unseen ones: no "at most" that is less than the rms.
    assert "0.68 K rms above the noise (fitted to all runs, 0.20 K at most)" in said(0.68, True, 0.03, peak=0.2)
    assert "at a tolerance of 0.030 K it does not matter" in said(0.01, True, 0.03)
    assert "more than the tolerance of 0.030 K" in said(0.05, True, 0.03)
    assert is_material(True, 0.01, 0.2, 0.03)  # a peak of five tolerances and more
    assert not is_material(False, 0.0, 0.0, 0.0)
    assert is_material(True, 0.0, 0.0, 0.0)  # where nothing is tolerated


def test_what_parts_the_course_does_not_gainsay_the_tests_of_every_reading():
    """Beside a verdict that what is left varies with the ambient, the figure said that it does not."""
    left = SimpleNamespace(varies_with=(), does_not_vary_with=("ambient", "direction"))
    assert parted_by(left, ["the ambient", "the step"]) == (
        "No condition parts this course. It is not seen to vary with direction."
    )
    left = SimpleNamespace(varies_with=("airflow",), does_not_vary_with=("ambient",))
    assert parted_by(left, ["the step times the ambient"]) == "It varies with airflow."


def test_rivals_in_words():
    assert worse(2.0).endswith("as well")
    assert "100 times less likely" in worse(np.log(100.0))
    assert worse(900.0).endswith("far worse")
    assert listed(["a", "b", "c"]) == "a, b and c" and listed([]) == ""


def test_runs_to_measure_next_are_counted():
    run = {
        "source": {"temperature_c": 40.0, "humidity_percent": 18.0},
        "destination": {"temperature_c": 20.0, "humidity_percent": 55.0},
        "airflow_m_s": 1.8,
        "transfer": {"duration_s": 2.0},
        "reason": "a thermal shock downwards",
    }
    assert experiments([run, dict(run)]) == [
        "2 × 40.0 °C, 18.0 %RH → 20.0 °C, 55.0 %RH, 1.8 m/s, transfer slowed to 2.0 s (a thermal shock downwards)"
    ]
    one = {"source": {"temperature_c": 1.0, "humidity_percent": 2.0}}
    assert experiments([one]) == ["1.00 °C, 2.00 %RH"]
    assert experiments([one], humid=False) == ["1.00 °C"]  # of a thermometer in a kiln at 223 degC it had been 55 %RH


def held(times, residuals):
    names = tuple(f"{i:04d}" for i in range(len(times)))
    return HeldOut(tuple(range(len(times))), names, tuple(times), tuple(residuals), tuple(residuals))


def test_autocorrelation_of_a_known_process_with_samples_missing():
    rng = np.random.default_rng(3)
    times, residuals = [], []
    for _ in range(20):
        x = np.zeros(1200)
        for k in range(1, x.size):
            x[k] = 0.8 * x[k - 1] + rng.standard_normal()
        keep = rng.random(x.size) > 0.1
        times.append(0.05 + 0.1 * np.arange(x.size)[keep])
        residuals.append(x[keep])
    h = held(times, residuals)
    found, count = autocorrelation(h, h.before, 0.1, 5)
    assert found == pytest.approx(0.8 ** np.arange(1, 6), abs=0.04)
    assert count == sum(t.size for t in times)


def test_size_says_how_far_off_when_and_in_which_run():
    time = np.arange(-5.0, 60.0, 0.1)
    quiet, bump = np.zeros(time.size), np.where((time > 9) & (time < 16), -0.5, 0.0)
    found = size(held([time, time], [quiet, bump]), (quiet, bump))
    assert found.peak_run == "0001" and found.peak == pytest.approx(-0.5) and 9 < found.peak_time_s < 16
    after = np.concatenate([quiet[time > 0], bump[time > 0]])
    assert found.rms == pytest.approx(np.sqrt(np.mean(after**2)))


def test_one_reading_amid_the_airs_jump_is_no_misfit():
    """A start that is 20 ms off puts one reading on the wrong side of a step of 40 %RH."""
    time = np.arange(0.02, 60.0, 0.1)
    jump = np.where(time < 0.05, 40.0, 0.1)
    assert size(held([time], [jump]), (jump,)).rms == pytest.approx(0.1)


def single_runs(rng, exponent):
    runs = []
    for i in range(24):
        flow, up = (2.5, 6.0, 12.0)[i % 3], (i // 3) % 2 == 0
        value = (flow / 6.0) ** exponent * np.exp(0.004 * rng.standard_normal())
        runs.append(RunParameter(f"{i}", value, 0.004 * value, "up" if up else "down", 20.0 + 5 * (i % 4), flow, 20.0))
    return runs


def test_a_diffusivity_that_moves_with_airflow_is_found_to_and_by_how_much():
    result = SimpleNamespace(channel=SimpleNamespace(quantity=TEMPERATURE))
    found = {d.condition: d for d in drifts(single_runs(np.random.default_rng(1), 0.3), result)}
    assert set(found) == {"airflow", "direction", "ambient"}  # one size of step: nothing to be said of it
    assert found["airflow"].moves and not found["direction"].moves and not found["ambient"].moves
    assert found["airflow"].change == pytest.approx((12.0 / 2.5) ** 0.3 - 1, abs=0.02)


def test_of_steady_diffusivities_hardly_any_is_said_to_move():
    result = SimpleNamespace(channel=SimpleNamespace(quantity=TEMPERATURE))
    moved = [d.moves for seed in range(40) for d in drifts(single_runs(np.random.default_rng(seed), 0.0), result)]
    assert len(moved) == 120 and sum(moved) <= 1


def film_profile():
    plain = typical_profile()
    bead = TemperatureProfile(
        Uncertain(5e-7, 1e-8),
        noise_k=0.02,
        sampling_period_s=0.1,
        effects=(
            StatedEffect("convective_film", {"biot_at_5_m_s": Uncertain(0.1, 0.002)}),
            StatedEffect("finite_transfer", {"duration_s": Uncertain(0.5, 0.01)}),
        ),
    )
    return plain, Profile(bead, plain.humidity)


def test_the_extended_profile_corrects_the_inversion_better_and_the_bench_stays_on_the_ground():
    plain, extended = film_profile()
    crossings, notes = cross_inversion(plain, extended)
    bead = next(c for c in crossings if c.channel == "temperature")
    assert bead.rms_extended < 0.6 * bead.rms_plain and bead.rms_extended < 0.3 * bead.rms_reading
    assert bead.time_s.shape == bead.air.shape == bead.reading.shape == bead.plain.shape == bead.extended.shape
    assert any("finite_transfer" in note for note in notes)


def test_a_film_known_at_one_ambient_is_not_flown_and_that_is_said():
    plain, extended = film_profile()
    one = HumidityProfile(plain.humidity.diffusivity_table[3:4], noise_percent=0.06, sampling_period_s=0.1)
    crossings, notes = cross_inversion(Profile(plain.temperature, one), Profile(extended.temperature, one))
    assert [c.channel for c in crossings] == ["temperature"]
    assert any("too little" in note for note in notes)
    crossings, notes = cross_inversion(Profile(None, one), Profile(None, one))
    assert crossings == [] and notes


def test_a_gain_that_few_runs_cannot_tell_is_said_to_be_so():
    """The interval of six runs may reach from -175832 % to 100 %: no number that anybody can use."""
    found = channel("temperature", "explained", (FILM,))
    found.discovered = ()
    few = replace(found.gain, explained_fraction=0.979, interval_95=(-1758.32, 1.0))
    for gained, words in (
        (few, "97.9 % (these runs do not tell how much it is on others)"),
        (replace(few, interval_95=(0.912, 0.9999)), "97.9 % (91.2 to 100.0 %)"),
        (replace(few, explained_fraction=0.99996, interval_95=(0.912, 1.0)), "more than 99.9 % (91.2 to 100.0 %)"),
        (replace(few, explained_fraction=0.99996, interval_95=(0.9999, 1.0)), "more than 99.9 %"),
    ):
        found.gain = gained
        assert removed_share(found) == f"of the explainable error removed on unseen runs: {words}"


@pytest.mark.parametrize("why", ["no run has a step", "it stands still: leave these runs out."])
def test_a_channel_that_is_missing_is_told_in_one_sentence(why):
    said = missing(SimpleNamespace(missing={"humidity": why}))
    assert said == [f"The hygrometer could not be diagnosed: {why.rstrip('.')}."]
