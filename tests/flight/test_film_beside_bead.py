"""A film that is as warm as the bead beside it reads: humidity of the air from both, by every corrector."""

import numpy as np
import pytest
from test_offset_in_descent import BEAD_S, FILM_S, TIME_S, lagged, magnus_hpa, off, profile

from shockrig.analysis.flight.correct import correct
from shockrig.files.flight import Flight
from shockrig.files.profile import StatedEffect, Uncertain

INVERSION_M, AFTER_START = 500.0, TIME_S > 40.0


def flown(activity, behind_s, late_s=0.0):
    """Through an inversion of 6 K and back: the air, and what bead and film read of it."""
    altitude = 4.0 * np.minimum(TIME_S, 600.0 - TIME_S)
    air = 18.0 - 0.0098 * altitude + 3.0 * np.tanh((altitude - INVERSION_M) / 25.0)
    vapour = 9.0 - 2.0 * np.tanh((altitude - INVERSION_M) / 40.0)
    noise = np.random.default_rng(2).standard_normal((2, TIME_S.size))
    bead = lagged(air, BEAD_S)
    own = magnus_hpa(np.interp(TIME_S - behind_s, TIME_S, lagged(bead, late_s) if late_s else bead))
    film = 100.0 * lagged(vapour * own**-activity, FILM_S) * own ** (activity - 1.0)
    nothing = np.full(TIME_S.size, np.nan)
    read = bead + 0.01 * noise[0], film + 0.05 * noise[1]
    flight = Flight(TIME_S, *read, np.full(TIME_S.size, 8.0), nothing, nothing, altitude)
    return flight, 100.0 * vapour / magnus_hpa(air)


def told(activity, behind_s=0.0, late_s=0.0, sigma=0.0):
    numbers = {"behind_s": behind_s, "activity": activity, "time_constant_s": late_s}
    stated = StatedEffect("film_beside_bead", {name: Uncertain(value, sigma) for name, value in numbers.items()})
    plain = profile(of_bead=0.0)
    return plain, profile(of_bead=0.0, film_effects=(stated,))


@pytest.mark.parametrize(
    ("activity", "behind_s", "late_s"), [(0.0, 0.0, 0.0), (1.0, 2.0, 0.0), (0.5, -1.0, 0.0), (0.3, 0.0, 6.0)]
)
def test_humidity_is_of_the_air_where_the_bead_tells_how_warm_the_film_was(activity, behind_s, late_s):
    flight, humidity = flown(activity, behind_s, late_s)
    plain, knowing = told(activity, behind_s, late_s)
    left = off(correct(flight, knowing).humidity_percent, humidity, AFTER_START)
    assert left < 0.25 * off(correct(flight, plain).humidity_percent, humidity, AFTER_START)
    assert left < 0.2 * off(flight.humidity_percent, humidity, AFTER_START)


@pytest.mark.parametrize("activity", [0.0, 1.0])
def test_the_causal_corrector_takes_the_beads_reading_too(activity):
    flight, humidity = flown(activity, 0.0)
    plain, knowing = told(activity)
    left, without = (
        off(correct(flight, one, "causal", lag_s=2.0).humidity_percent, humidity, AFTER_START)
        for one in (knowing, plain)
    )
    assert left < 0.6 * without


def test_what_is_not_known_of_the_film_is_uncertainty():
    flight, humidity = flown(0.6, 1.5)
    _, unsure = told(0.4, 0.5, sigma=1.0)
    found = correct(flight, unsure)
    steep = np.abs(4.0 * np.minimum(TIME_S, 600.0 - TIME_S) - INVERSION_M) < 40.0
    error = np.abs(found.humidity_percent - humidity)
    assert np.median(found.common["humidity"][steep]) > 3.0 * np.median(found.common["humidity"][~steep])
    assert np.mean(error[steep] < 2.0 * found.humidity_uncertainty_percent[steep]) > 0.9
