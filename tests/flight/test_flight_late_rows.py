"""Rows out of order by their times are taken by time and given where they stood; clocks that were set are let be."""

import csv

import numpy as np
import pytest

from shockrig.analysis.flight.correct import correct
from shockrig.analysis.flight.late_rows import BACKWARDS, SORTED, UNSURE_ORDER, by_time
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.stream import correct_file
from shockrig.files.flight import Flight

PROFILE = typical_profile()
CLOCK = np.arange(600.0)


def flown(time_s):
    rng = np.random.default_rng(2)
    unknown = np.full(time_s.size, np.nan)
    temperature_c = 20.0 + 3.0 * np.sin(time_s / 60.0) + 0.02 * rng.standard_normal(time_s.size)
    return Flight(time_s, temperature_c, 50.0 + 5.0 * np.cos(time_s / 90.0), unknown, unknown, unknown)


def shuffled(rows, seed=3):
    """As a receiver has packets: most a few places off, and now and then all that was kept of an hour before."""
    near = np.argsort(np.arange(rows) + np.random.default_rng(seed).uniform(0.0, 6.0, rows), kind="stable")
    return np.concatenate([near[1::2], near[::2]])


def late_packets():
    return np.insert(np.delete(CLOCK, [100, 200, 300]), [105, 210, 299], [100.0, 200.0, 300.0])


@pytest.mark.parametrize(
    "time_s",
    [CLOCK[shuffled(600)], 5.0 * np.repeat(CLOCK[:300][shuffled(300)], 2), late_packets()],
    ids=["shuffled", "heard twice", "three late"],
)
def test_rows_that_came_late_are_sorted(time_s):
    order, said = by_time(time_s)
    assert order is not None and said == [SORTED] and (np.diff(time_s[order]) >= 0).all()


@pytest.mark.parametrize(
    ("time_s", "said"),
    [
        (CLOCK, []),
        (np.concatenate([CLOCK, CLOCK - 2.0 + 600.0]), []),
        (np.concatenate([CLOCK, CLOCK + 499.4]), []),
        (np.concatenate([CLOCK + 1e9, CLOCK]), []),
        (np.concatenate([CLOCK[:100], CLOCK[100:150] + 900.0, CLOCK[150:] - 50.0]), []),
        (np.where(CLOCK == 300.0, 20.3, CLOCK), []),
        (CLOCK - 4.3 * (np.arange(600) % 2), [UNSURE_ORDER]),
    ],
    ids=["in order", "set by 2 s", "set by 100 s", "begun anew", "ahead and back", "a stray", "two clocks"],
)
def test_a_clock_that_was_set_is_not_sorted(time_s, said):
    assert by_time(time_s) == (None, said)


def test_a_log_that_begins_with_its_last_row_is_turned_round():
    """As every dropsonde that NCAR's ASPEN wrote. Before: refused, and a netCDF file is not soon turned."""
    whole = flown(CLOCK)
    wanted, found = correct(whole, PROFILE), correct(whole.at(np.arange(600)[::-1]), PROFILE)
    assert BACKWARDS in found.notes
    for name in ("temperature_c", "humidity_percent", "humidity_uncertainty_percent"):
        np.testing.assert_array_equal(getattr(found, name)[::-1], getattr(wanted, name))
    order, said = by_time(late_packets()[::-1])
    assert said == [BACKWARDS, SORTED] and (np.diff(late_packets()[::-1][order]) == 1.0).all()


def test_a_shuffled_flight_is_corrected_as_the_sorted_one_and_given_as_it_came(tmp_path):
    whole, order = flown(CLOCK), shuffled(600)
    wanted, found = correct(whole, PROFILE), correct(whole.at(order), PROFILE)
    assert SORTED in found.notes and SORTED not in wanted.notes
    for name in ("temperature_c", "temperature_uncertainty_k", "humidity_percent"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name)[order])
    rows = [
        f"{t:.0f},{c!r},{h!r}\n" for t, c, h in zip(CLOCK, whole.temperature_c, whole.humidity_percent, strict=True)
    ]
    rows = [row.replace("np.float64(", "").replace(")", "") for row in rows]
    (tmp_path / "log.csv").write_text("time_s,temperature_c,humidity_percent\n" + "".join(rows[k] for k in order))
    for block_rows in (None, 250):
        seen = []
        done = correct_file(
            tmp_path / "log.csv",
            PROFILE,
            tmp_path / "out.csv",
            block_rows=block_rows,
            gather=[lambda flight, _, seen=seen: seen.append(flight.time_s)],
        )
        with (tmp_path / "out.csv").open() as stream:
            written = list(csv.DictReader(stream))
        assert done.notes.count(SORTED) == 1
        np.testing.assert_array_equal([float(row["time_s"]) for row in written], CLOCK[order])
        assert all((np.diff(block) > 0).all() for block in seen)  # the page draws lines
        assert np.concatenate(seen).size == CLOCK.size
        if block_rows is None:
            values = [float(row["temperature_corrected_c"]) for row in written]
            np.testing.assert_allclose(values, found.temperature_c, atol=1e-4)
