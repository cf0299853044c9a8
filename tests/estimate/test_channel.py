"""Channels: binning loses nothing, ambients are grouped, starts are estimated, and runs that cannot be used say why."""

import numpy as np
import pytest

from shockrig.analysis.characterize.characterize import characterize
from shockrig.analysis.diagnose.cannot_tell import cannot_tell
from shockrig.analysis.estimate.channel import bin_means, group_ambients
from shockrig.analysis.estimate.gather import build_channel, usable_runs
from shockrig.analysis.estimate.seen import seen
from shockrig.analysis.estimate.without_model import curved_noise, estimate_start
from shockrig.files.campaign import Campaign, ReferenceResponse, Run, RunAir, Trace


def run_of(value, time, start_s=10.0, **changes):
    trace = Trace(np.asarray(time, dtype=float), {"temperature_c": np.asarray(value, dtype=float)})
    given = {
        "id": "1",
        "source": RunAir(20.0, 50.0),
        "destination": RunAir(30.0, 50.0),
        "airflow_m_s": 5.0,
        "pressure_hpa": 1000.0,
    }
    return Run(**(given | {"start_s": start_s, "duration_s": None, "imet": trace, "hyt": None} | changes))


def campaign_of(*runs):
    return Campaign("c", None, {}, 4e-4, 1e-5, tuple(runs))


def lag(time, start_s=10.0, tau_s=0.5):
    return 20.0 + 10.0 * np.where(time > start_s, 1 - np.exp(-(time - start_s) / tau_s), 0.0)


TIME = np.arange(0.03, 60.0, 0.1)
NOBODY = {"start_s": None, "source": RunAir(None, None), "destination": RunAir(None, None)}
SPARSE = np.arange(-58.0, 71.0, 4.0)


def reason_of(run):
    usable, left_out = usable_runs(campaign_of(run), "temperature")
    assert not usable
    return left_out[0].reason


def test_bins_keep_every_sample_and_the_mean_of_each():
    rng = np.random.default_rng(1)
    time, value = np.sort(rng.random(500)), rng.random(500)
    place = np.minimum((time * 7).astype(int), 6)
    mean_time, mean_value, count = bin_means([time], [value], (place,))
    assert count.sum() == 500
    assert (mean_value * count).sum() == pytest.approx(value.sum())
    assert (mean_time * count).sum() == pytest.approx(time.sum())


def test_a_channel_holds_all_samples_but_those_at_the_uncertain_start():
    channel = build_channel(campaign_of(run_of(lag(TIME), TIME)), "temperature")
    near = np.abs(TIME - 10.0) < 0.04
    assert channel.count.sum() == TIME.size - near.sum()
    since = channel.time_s[0]
    expected = np.where(since > 0, 30.0 - 10.0 * np.exp(-since / 0.5), 20.0)
    narrow = (channel.count[0] > 0) & (since < 2.5)
    assert channel.value[0][narrow] == pytest.approx(expected[narrow], abs=0.05)


def test_destinations_within_a_kelvin_are_one_ambient():
    index, means = group_ambients(np.array([20.02, 0.0, 19.9, 40.0, 0.6, 39.5]))
    assert index.tolist() == [1, 0, 1, 2, 0, 2]
    assert means == pytest.approx([0.3, 19.96, 39.75])


@pytest.mark.parametrize(
    ("run", "words"),
    [
        (run_of(lag(TIME)[95:], TIME[95:]), "plateau before the transfer is missing (5 samples); it alone shows"),
        (run_of(lag(TIME)[95:], TIME[95:]), "record 8 samples and 0.86 s before it, or more"),
        (run_of(lag(SPARSE, tau_s=9.0)[:20], SPARSE[:20]), "8.0 s and 2 samples after the transfer: record 6 or more"),
        (
            run_of(np.delete(lag(TIME), slice(99, 112)), np.delete(TIME, slice(99, 112))),
            "a gap of 1.4 s over the transfer",
        ),
        (run_of(lag(TIME) + 0.1 * np.maximum(10.0 - TIME, 0), TIME), "not settled before the transfer"),
        (run_of(lag(TIME)[:20], TIME[:20]), "too short: 0.0 s and 0 samples"),
        (run_of(lag(TIME)[97:104], TIME[97:104]), "only 7 usable samples"),
        (run_of(np.full(TIME.size, 20.0), TIME, start_s=None), "no transfer.start_s"),
        (run_of(lag(TIME), TIME, imet=None), "no imet.csv"),
    ],
)
def test_runs_that_cannot_be_used_say_why(run, words):
    assert words in reason_of(run)


def test_a_record_that_ends_within_the_response_is_used():
    (used,), left_out = usable_runs(campaign_of(run_of(lag(TIME)[:118], TIME[:118])), "temperature")
    assert used.trace.time_s[-1] - used.start_s == pytest.approx(1.73)  # of a step of 0.5 s, 97 %
    assert not left_out


def test_a_long_record_of_a_fast_sensor_has_few_bins_and_no_half_time_below_its_period():
    """An hour beside a response that is over in one reading: 1,218 bins of 3 s took a diagnosis five times as long."""
    time = np.arange(0.0, 3600.0)
    channel = build_channel(campaign_of(run_of(lag(time, tau_s=0.2), time)), "temperature")
    assert channel.tempo == 1.0
    assert channel.time_s.shape[1] < 150


@pytest.mark.parametrize("start", [8.013, 10.0, 12.77])
def test_a_start_that_nobody_recorded_is_estimated(start):
    rng = np.random.default_rng(2)
    value = lag(TIME, start) + 0.01 * rng.standard_normal(TIME.size)
    assert estimate_start(TIME, value) == pytest.approx(start, abs=0.15)
    (used,), _ = usable_runs(campaign_of(run_of(value, TIME, start_s=None)), "temperature")
    assert used.start_s == pytest.approx(start, abs=0.15)


@pytest.mark.parametrize("rest_s", [10.3, 20.0, 20.3, 40.0, 60.3])
def test_a_short_rest_before_a_long_record_is_seen(rest_s):
    """Before: so few relaxations met one lag so badly at a start just before a reading that one at once did as well in
    the last comparison, and 63 % of the way was said to come 20 s late."""
    rng, time = np.random.default_rng(1), np.arange(0.0, 920.0)
    value = lag(time, rest_s, 60.0) + 0.005 * rng.standard_normal(time.size)
    assert estimate_start(time, value) == pytest.approx(rest_s, abs=3.0)


@pytest.mark.parametrize(("readings", "every_s"), [(15, 3.0), (60, 1.0)])
def test_records_that_begin_in_the_response_are_used(readings, every_s):
    """Somebody began to write when the probe was in the other air already: what is not recorded is not presumed."""
    tau_s, rng, runs = 9.0, np.random.default_rng(4), []
    for i in range(4):
        time = every_s * np.arange(readings)
        value = lag(time, -4.0 - i, tau_s) + 0.02 * rng.standard_normal(time.size)
        runs.append(run_of(value, time, id=str(i), airflow_m_s=None, **NOBODY))
        assert estimate_start(time, value) == 0.0
    as_logged = {"imet": {"kind": "as logged", "body": "lumped"}}
    campaign = Campaign("c", None, as_logged, 4e-4, 1e-5, tuple(runs), bodies={"imet": "lumped", "hyt": "lumped"})
    found = characterize(campaign, channels=["temperature"]).temperature
    assert found is not None and not found.set_aside
    (row,) = found.rows
    t63_s = row.response.t63_s
    assert abs(t63_s - tau_s) < 2.5 * t63_s * row.standard_uncertainty / row.diffusivity_m2_s < 0.3 * tau_s


def test_a_run_that_drifts_before_a_start_that_nobody_recorded_begins_in_its_response():
    """Before: it was left out, as one is whose start was stated; of a heat exchanger's eight runs five were."""
    drifting = lag(TIME, tau_s=4.0) + 0.1 * np.maximum(10.0 - TIME, 0)
    (used,), left_out = usable_runs(campaign_of(run_of(drifting, TIME, **NOBODY)), "temperature")
    assert not left_out and used.start_s < used.trace.time_s[0] == pytest.approx(10.0, abs=2.0)
    assert used.trace.values["temperature_c"].size == used.trace.time_s.size < TIME.size
    assert "not settled" in reason_of(run_of(drifting, TIME))


def test_readings_that_go_to_and_fro_before_a_transfer_rest():
    """Before: the medians of two thirds stood at two levels of a relay, and 28 of 36 runs were left out."""
    swings = 1.4 * np.sign(np.sin(2.0 * np.pi * 0.49 * TIME + 1.0))
    assert abs(np.median(swings[:33]) - np.median(swings[66:99])) > 2.0
    (used,), left_out = usable_runs(campaign_of(run_of(lag(TIME) + swings, TIME)), "temperature")
    assert not left_out and used.trace.time_s.size == TIME.size


def test_a_response_that_is_over_in_three_readings_is_a_step():
    readings = np.concatenate([[0.0, -5.8, -6.6, -7.1, -7.4], np.linspace(-7.5, -8.7, 25)])
    assert estimate_start(20.0 * np.arange(readings.size), readings) == 0.0


@pytest.mark.parametrize("begun_s", [0.0, 4.0, 20.0])
def test_a_record_in_the_response_may_have_begun_as_long_before_as_it_takes(begun_s):
    """How long before, nothing says: a time as uncertain as it is long, in which the readings went as far again."""
    tau_s, time = 9.0, np.arange(0.0, 60.0, 0.5)
    channel = build_channel(campaign_of(run_of(lag(time, -begun_s, tau_s), time, **NOBODY)), "temperature")
    begun, ((since, value),) = channel.conditions, channel.samples
    half_s = tau_s * np.log(2.0)
    assert since[0] == pytest.approx(half_s, rel=0.15) == begun.start_scatter_s[0]
    moved = float(value[-1] - value[0])
    assert begun.source_c[0] == pytest.approx(value[0] - moved, rel=0.02)
    assert begun.source_c_scatter[0] == pytest.approx(np.hypot(moved, channel.quantity.unknown_air_scatter), rel=0.02)
    (run,) = seen(channel)
    assert run.times_s is not None and run.times_s[0] == pytest.approx(tau_s, rel=0.15)  # and is seen from there on


def test_noise_is_what_readings_miss_a_curve_by_however_far_apart_they_stand():
    rng = np.random.default_rng(6)
    time = np.sort(rng.uniform(0.0, 100.0, 4000))
    value = 20.0 * np.exp(-time / 30.0) + 0.05 * rng.standard_normal(time.size)
    assert curved_noise(time, value) == pytest.approx(0.05, rel=0.06)
    few = np.arange(0.0, 100.0, 4.0)
    smooth = 20.0 * np.exp(-few / 30.0)
    assert curved_noise(few, smooth) < 0.05 < np.std(np.diff(smooth)) / np.sqrt(2.0)


def test_selecting_runs_selects_everything_that_belongs_to_them():
    runs = [run_of(lag(TIME, tau_s=tau), TIME, id=str(tau)) for tau in (0.3, 0.5, 0.9)]
    channel = build_channel(campaign_of(*runs), "temperature")
    some = channel.select(np.array([False, True, True]))
    assert some.run_ids == ("0.5", "0.9")
    assert some.value.shape[0] == some.conditions.start_s.size == len(some.samples) == len(some.bin_of) == 2
    assert np.array_equal(some.value, channel.value[1:])


def test_a_slight_step_in_airs_that_nobody_recorded_is_left_out():
    slight = 20.0 + 0.08 * (lag(TIME) - 20.0)
    full = run_of(lag(TIME), TIME, id="full", **NOBODY)
    usable, left_out = usable_runs(campaign_of(full, run_of(slight, TIME, id="slight", **NOBODY)), "temperature")
    assert [one.run.id for one in usable] == ["full"]
    assert left_out[0].reason.startswith("a step of 0.8 K is slight beside 10 K of another run")
    known, _ = usable_runs(campaign_of(full, run_of(slight, TIME, id="known", start_s=10.0)), "temperature")
    assert [one.run.id for one in known] == ["full", "known"]


@pytest.mark.parametrize(("recorded", "ambients"), [(True, 2), (False, 1)])
def test_ambients_that_nobody_recorded_are_as_wide_as_rooms_are(recorded, ambients):
    def run(warmer_k, id_):
        columns = {"humidity_percent": lag(TIME, tau_s=5.0), "temperature_c": np.full(TIME.size, np.nan)}
        air = RunAir(30.0 + warmer_k if recorded else None, None)
        return run_of(lag(TIME) + warmer_k, TIME, id=id_, source=air, destination=air, hyt=Trace(TIME, columns))

    assert build_channel(campaign_of(run(0.0, "1"), run(3.0, "2")), "humidity").ambients_c.size == ambients


def test_what_nobody_recorded_is_said_before_any_fit():
    """A film's own temperature in a thermal shock, and the lag of the reference that measured the air."""

    def said(**changes):
        columns = {"humidity_percent": lag(TIME, tau_s=5.0), "temperature_c": np.full(TIME.size, np.nan)} | changes
        run = run_of(lag(TIME), TIME, hyt=Trace(TIME, columns))
        return " ".join(cannot_tell(build_channel(campaign_of(run), "humidity")))

    assert "own temperature was not recorded" in said()
    assert "own temperature was not recorded" not in said(temperature_c=lag(TIME, tau_s=2.0))

    def beside(lag_s):
        air = Trace(TIME, {"temperature_c": np.where(TIME > 10.0, 30.0, 20.0)})
        run = run_of(lag(TIME), TIME, air=air, reference=ReferenceResponse(temperature_time_constant_s=lag_s))
        return " ".join(cannot_tell(build_channel(campaign_of(run), "temperature")))

    assert "own lag was not stated" in beside(0.0)
    assert "own lag was not stated" not in beside(0.2)
