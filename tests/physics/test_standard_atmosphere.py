"""Altitude by pressure, against the table of the standard."""

import numpy as np
import pytest

from shockrig.analysis.physics.standard_atmosphere import pressure_altitude_m


@pytest.mark.parametrize(
    ("pressure_hpa", "altitude_m"),
    [
        (1139.29, -1000.0),
        (1013.25, 0.0),
        (898.746, 1000.0),
        (226.321, 11_000.0),
        (54.7489, 20_000.0),
        (8.68019, 32_000.0),
    ],
)
def test_altitudes_of_iso_2533(pressure_hpa, altitude_m):
    """Table 1, geopotential altitudes."""
    assert float(pressure_altitude_m(pressure_hpa)) == pytest.approx(altitude_m, abs=0.6)


def test_what_is_no_pressure_has_no_altitude():
    """Zero, below it, missing."""
    assert np.isnan(pressure_altitude_m([0.0, -3.0, np.nan])).all()
