"""What is known of a pair of sensors: alpha of the bead, D(T) of the film, response times, noise, the model's effects.

Between the rows of its table D is read as ln D over 1/T. docs/flights_method.md says how a flight uses it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shockrig.files.campaign_names import DEFAULT_BODIES
from shockrig.files.causes import StatedEffect, Uncertain
from shockrig.files.diagnosis_data import Discovered
from shockrig.files.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

BEAD_RADIUS_M = 4e-4
FILM_THICKNESS_M = 1e-5
NOISE_K, NOISE_PERCENT = 0.02, 0.06  # standard deviations of single readings, where a profile states none
AMBIENT_TOLERANCE_K = 1.0  # destinations within 1 K of one another are one ambient, so a row holds that far
GROWTH_PER_KELVIN = 0.05  # of D's relative uncertainty beyond the table, where the outer row is held


@dataclass(frozen=True)
class ResponseTime:
    """Seconds to 63, 90 and 98 % of a step (t63_s is the exact 1 - 1/e), and their standard uncertainties if known."""

    t63_s: float
    t90_s: float
    t98_s: float
    standard_uncertainties_s: tuple[float, float, float] | None = None


def response_columns(times: ResponseTime | None) -> dict[str, float]:
    """Columns that tables of response times have: each time [s] and its standard uncertainty; NaN where not known."""
    names = ("t63", "t90", "t98")
    seconds = (math.nan,) * 3 if times is None else (times.t63_s, times.t90_s, times.t98_s)
    spread = (None if times is None else times.standard_uncertainties_s) or (math.nan,) * 3
    columns = {f"{name}_s": value for name, value in zip(names, seconds, strict=True)}
    return columns | {f"{name}_standard_uncertainty_s": u for name, u in zip(names, spread, strict=True)}


@dataclass(frozen=True)
class TemperatureProfile:
    """The bead: a sphere of radius `bead_radius_m`, read at its core."""

    thermal_diffusivity_m2_s: Uncertain
    bead_radius_m: float = BEAD_RADIUS_M
    response_time_s: ResponseTime | None = None
    noise_k: float | None = None
    sampling_period_s: float | None = None
    effects: tuple[StatedEffect, ...] = ()
    discovered: tuple[Discovered, ...] = ()


@dataclass(frozen=True)
class DiffusivityRow:
    """One ambient temperature of the table D(T)."""

    ambient_temperature_c: float
    diffusivity_m2_s: float
    standard_uncertainty: float
    runs: int | None = None
    response_time_s: ResponseTime | None = None


@dataclass(frozen=True)
class HumidityProfile:
    """The film: vapour diffuses into `film_thickness_m`, the reading is its mean; D depends on temperature."""

    diffusivity_table: tuple[DiffusivityRow, ...]
    film_thickness_m: float = FILM_THICKNESS_M
    noise_percent: float | None = None
    sampling_period_s: float | None = None
    effects: tuple[StatedEffect, ...] = ()
    discovered: tuple[Discovered, ...] = ()

    @property
    def temperature_range_c(self) -> tuple[float, float]:
        """Lowest and highest temperature that the table speaks for (its outer rows and 1 K beyond)."""
        return (
            self.diffusivity_table[0].ambient_temperature_c - AMBIENT_TOLERANCE_K,
            self.diffusivity_table[-1].ambient_temperature_c + AMBIENT_TOLERANCE_K,
        )

    def covers(self, temperature_c: float | np.ndarray) -> np.ndarray:
        """True where the table speaks for `temperature_c`, same shape; never where it is NaN."""
        low, high = self.temperature_range_c
        temperature_c = np.asarray(temperature_c, dtype=float)
        return (temperature_c >= low) & (temperature_c <= high)

    def diffusivity_m2_s(self, temperature_c: float | np.ndarray, *, outside: str = "raise") -> tuple[Any, Any]:
        """D and its standard uncertainty at `temperature_c`: ln D over 1/T bends between rows as the rows around say.

        An Arrhenius law is a straight line. Where the rows bend, D may bend evenly between two of them or all at one
        point: it lies between their chord and the continued chords beside it, and the uncertainty has that range in it
        (none at the rows themselves). The rows' own uncertainties count as common to all of them: airs and airflow are.

        Parameters
        ----------
        temperature_c : float or array
            Air temperature.
        outside : {"raise", "nan", "hold"}
            Beyond the table and 1 K around it: raise, give NaN, or hold the outer row's D with an uncertainty that
            grows by 5 % for each kelvin (for those who flag such values, as `correct` does).

        Returns
        -------
        (D, standard uncertainty) in m2/s, floats or arrays as `temperature_c`.

        Raises
        ------
        InputError
            If `outside` is "raise" and a temperature lies beyond the table.
        """
        wanted = np.asarray(temperature_c, dtype=float)
        low, high = self.temperature_range_c
        covered = self.covers(wanted)
        if outside == "raise" and not np.all(covered):
            worst = wanted[~covered].flat[0] if wanted.ndim else float(wanted)
            raise InputError(
                f"profile: humidity.diffusivity_table speaks for {low:g} to {high:g} degC, not for {worst:g} degC; "
                "characterize the sensor at that ambient temperature"
            )
        rows = self.diffusivity_table
        node_c = np.array([r.ambient_temperature_c for r in rows])
        node = 1.0 / (node_c + 273.15)
        ln_d = np.log([r.diffusivity_m2_s for r in rows])
        relative = np.array([r.standard_uncertainty / r.diffusivity_m2_s for r in rows])
        inside_c = np.clip(wanted, node_c[0], node_c[-1])
        x = 1.0 / (inside_c + 273.15)
        if len(rows) == 1:
            value, sigma = np.full(wanted.shape, ln_d[0]), np.full(wanted.shape, relative[0])
        else:
            left = np.clip(np.searchsorted(node_c, inside_c, side="right") - 1, 0, len(rows) - 2)
            weight = (x - node[left]) / (node[left + 1] - node[left])
            value = (1 - weight) * ln_d[left] + weight * ln_d[left + 1]
            sag, spread = _between(node, ln_d, left, weight)
            value = value + sag
            sigma = np.hypot((1 - weight) * relative[left] + weight * relative[left + 1], spread)
        sigma = np.hypot(sigma, GROWTH_PER_KELVIN * np.abs(wanted - inside_c))
        diffusivity = np.exp(value)
        uncertainty = diffusivity * sigma
        if outside != "hold":
            diffusivity, uncertainty = np.where(covered, diffusivity, np.nan), np.where(covered, uncertainty, np.nan)
        if wanted.ndim == 0:
            return float(diffusivity), float(uncertainty)
        return diffusivity, uncertainty

    def to_frame(self) -> pd.DataFrame:
        """The table as a DataFrame, one row for each ambient temperature, columns as in the file."""
        import pandas as pd

        rows = self.diffusivity_table
        return pd.DataFrame(
            {
                "ambient_temperature_c": [r.ambient_temperature_c for r in rows],
                "diffusivity_m2_s": [r.diffusivity_m2_s for r in rows],
                "standard_uncertainty": [r.standard_uncertainty for r in rows],
                "runs": pd.array([r.runs for r in rows], dtype="Int64"),
            }
            | {name: [response_columns(r.response_time_s)[name] for r in rows] for name in response_columns(None)}
        )


@dataclass(frozen=True)
class ProfileData:
    """What `Profile` (profile.py) holds: both sensors, where they are from and how they were measured."""

    temperature: TemperatureProfile | None = None
    humidity: HumidityProfile | None = None
    sensors: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    provenance: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def bodies(self) -> dict[str, str]:
        """The shape that each sensor's plain model has, "imet" and "hyt", as in a campaign."""
        stated = {name: self.sensors.get(name) for name in DEFAULT_BODIES}
        return {
            name: str(sensor["body"]) if isinstance(sensor, Mapping) and sensor.get("body") else DEFAULT_BODIES[name]
            for name, sensor in stated.items()
        }


def _between(x: np.ndarray, y: np.ndarray, left: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far y(x) hangs from its chord between nodes `left` and the next, and how far it may be from there, one sigma.

    `weight` is the place between the two, 0 to 1. Evenly bent it is a parabola; what bends one way lies between the
    chord and the nearer of the two chords beside it, continued.
    """
    if len(x) < 3:
        return np.zeros(weight.shape), np.zeros(weight.shape)
    second = np.diff(np.diff(y) / np.diff(x)) / (0.5 * (x[2:] - x[:-2]))
    second = np.concatenate([second[:1], second, second[-1:]])
    width = x[left + 1] - x[left]
    first, last = second[left] * width**2, second[left + 1] * width**2  # bends at both ends, in the unit of y
    reach = np.minimum(np.abs(first) * weight, np.abs(last) * (1 - weight))
    # the lesser of the two bends: beside a kink the other is not this stretch's own
    bend = np.where(first * last > 0, np.sign(first) * np.minimum(np.abs(first), np.abs(last)), 0.0)
    sag = -0.5 * weight * (1 - weight) * bend
    # rectangular, about its own middle; to either side of the chord where the rows bend to both
    middle, half = -0.5 * np.sign(bend) * reach, np.where(bend == 0, reach, 0.5 * reach)
    return sag, np.hypot(half / math.sqrt(3), sag - middle)
