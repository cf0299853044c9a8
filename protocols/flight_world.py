"""A flight's air felt by a pair of sensors: what emulated instruments sample when they play it.

The element's equations are those of analysis.flight.sensor; effects of the logger's link (averaging, repeats, delay,
rounding) are left out, because the logger under test brings its own.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.flight.simulated.sensor import REFERENCE_AIRSPEED_M_S, fly
from shockrig.analysis.flight.simulated.weather import FINE_STEP_S, Weather
from shockrig.files.disk import TABLE_AT_MOST, open_text, shown
from shockrig.files.errors import InputError
from shockrig.files.profile import Profile
from shockrig.files.profile_data import NOISE_K, NOISE_PERCENT
from shockrig.files.ranges import RANGES, Range
from shockrig.protocols.flight_logs import read_flight
from shockrig.rig.seams import Air

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
LONGEST_S = 90_000.0
PRESSURE_HPA = 1013.25
COLUMNS = {
    "temperature_c": ("temperature_corrected_c", "temperature_c"),
    "humidity_percent": ("humidity_corrected_percent", "humidity_percent"),
    "airspeed_m_s": ("airspeed_m_s",),
    "pressure_hpa": ("pressure_hpa",),
    "altitude_m": ("altitude_m",),
}
LIMITS = {
    "temperature_c": RANGES["temperature_c"],
    "humidity_percent": RANGES["humidity_set_percent"],
    "airspeed_m_s": RANGES["airflow_m_s"],
    "pressure_hpa": RANGES["pressure_hpa"],
}


def read_flown_air(path: Path) -> Weather:
    """The air along a flight: time_s, temperature_c, humidity_percent and, where known, airspeed_m_s, pressure_hpa.

    The corrected columns of a corrected flight are taken before the readings; between rows the air is a straight line.
    A log without time_s is read as `correct` reads it, in any form.

    Raises
    ------
    InputError
        A column is missing, time does not rise, or a value cannot be: names the file, the line, the remedy.
    """
    frame = _frame(path)
    time_s = _numbers(frame["time_s"], path, "time_s")
    if time_s.size < 2:
        raise InputError(f"{path}: fewer than two rows; give a flight")
    if not np.all(np.isfinite(time_s)) or not np.all(np.diff(time_s) > 0):
        line = int(np.argmax(~(np.diff(time_s, prepend=-np.inf) > 0))) + 2
        raise InputError(f"{path}, line {line}: time_s must be there in every row and rise from row to row")
    span_s = float(time_s[-1] - time_s[0])
    if not 1.0 <= span_s <= LONGEST_S:
        raise InputError(f"{path}: the flight takes {span_s:g} s; 1 s to {LONGEST_S:g} s can be played")
    fine_s: Array = np.arange(round(span_s / FINE_STEP_S) + 1.0) * FINE_STEP_S
    air: dict[str, Array] = {}
    for quantity, names in COLUMNS.items():
        name = next((name for name in names if name in frame), None)
        if name is None:
            if quantity in ("temperature_c", "humidity_percent"):
                raise InputError(f"{path}, line 1: no column {quantity}; the air needs temperature_c, humidity_percent")
            default = {"airspeed_m_s": REFERENCE_AIRSPEED_M_S, "pressure_hpa": PRESSURE_HPA}.get(quantity, 0.0)
            air[quantity] = np.full(fine_s.size, default)
            continue
        values = _numbers(frame[name], path, name)
        known = np.isfinite(values)
        if known.sum() < 2:
            raise InputError(f"{path}: column {name}: fewer than two values")
        possible = LIMITS.get(quantity, Range(-np.inf, np.inf))
        wrong = np.flatnonzero(known & ((values < possible.low) | (values > possible.high)))
        if wrong.size:
            raise InputError(
                f"{shown(path)}, line {int(wrong[0]) + 2}: {name} {possible.refusal(values[wrong[0]])}; "
                "fix the row or leave the cell empty"
            )
        air[quantity] = np.interp(fine_s, time_s[known] - time_s[0], values[known])
    return Weather(
        path.name,
        fine_s,
        air["temperature_c"],
        air["humidity_percent"],
        air["airspeed_m_s"],
        air["pressure_hpa"],
        air["altitude_m"],
    )


def _frame(path: Path) -> pd.DataFrame:
    import pandas as pd

    why = ""
    try:
        with open_text(path, "name a flight's CSV file", TABLE_AT_MOST) as stream, warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header would be cut short
            frame = pd.read_csv(stream, index_col=False, skipinitialspace=True, low_memory=False)
    except InputError:
        raise
    except (ValueError, UnicodeDecodeError, pd.errors.ParserWarning) as error:
        frame, why = None, f"cannot be read as CSV ({' '.join(str(error).split())})"
    if frame is not None and "time_s" in frame:
        return frame
    try:
        flight = read_flight(path)
    except InputError as error:
        raise InputError(f"{path}: {why}") if frame is None else error from None
    found = {one.name: values for one in fields(flight) if (values := getattr(flight, one.name)) is not None}
    return pd.DataFrame(found)[np.isfinite(flight.time_s)]


def _numbers(column: Any, path: Path, name: str) -> Array:
    import pandas as pd

    try:
        numbers = pd.to_numeric(column, errors="coerce").to_numpy(dtype=float)
    except OverflowError:
        raise InputError(f"{path}: column {name}: a number of too many digits") from None
    wrong = np.flatnonzero(np.isnan(numbers) & ~(column.isna() | (column.astype(str).str.strip() == "")).to_numpy())
    if wrong.size:
        found = str(column.iloc[int(wrong[0])])[:40]
        raise InputError(f"{path}, line {int(wrong[0]) + 2}: column {name}: {found!r} is not a number")
    return np.where(np.isfinite(numbers), numbers, np.nan)


Course = Callable[[Any], Any]  # of times in the flight, as an array of their shape or a float


@dataclass(frozen=True)
class FlightWorld:
    """What the instruments sample; times are the flight's own, from 0 to `end_s`, and hold beyond."""

    weather: Weather
    bead: Course
    film: Course
    die: Course
    noise_k: float
    noise_percent: float
    rng: np.random.Generator
    left_out: tuple[str, ...]

    @property
    def end_s(self) -> float:
        return float(self.weather.time_s[-1])

    def _inside(self, at_s: float) -> float:
        return min(max(at_s, 0.0), self.end_s)

    def bead_temperature_c(self, at_s: float) -> float:
        return float(self.bead(self._inside(at_s))) + self.noise_k * self.rng.standard_normal()

    def film_humidity_percent(self, at_s: float) -> float:
        return float(self.film(self._inside(at_s))) + self.noise_percent * self.rng.standard_normal()

    def die_temperature_c(self, at_s: float) -> float:
        return float(self.die(self._inside(at_s)))

    def air(self, at_s: float) -> Air:
        weather, at_s = self.weather, self._inside(at_s)
        return Air(
            float(np.interp(at_s, weather.time_s, weather.temperature_c)),
            float(np.interp(at_s, weather.time_s, weather.humidity_percent)),
        )

    def pressure_hpa(self, at_s: float) -> float:
        return float(np.interp(self._inside(at_s), self.weather.time_s, self.weather.pressure_hpa))

    def airspeed_m_s(self, at_s: float) -> float:
        return float(np.interp(self._inside(at_s), self.weather.time_s, self.weather.airspeed_m_s))

    def altitude_m(self, at_s: float) -> float:
        return float(np.interp(self._inside(at_s), self.weather.time_s, self.weather.altitude_m))

    def begin_transfer(self, at_s: float, duration_s: float | None = None) -> None:
        """A carriage changes nothing in flight."""

    def begin_return(self, at_s: float) -> None:
        """A carriage changes nothing in flight."""


def flight_world(weather: Weather, profile: Profile, seed: int = 0, noise: float = 1.0) -> FlightWorld:
    """Fly a profile's sensors through the air; both elements must be in the profile. Raises InputError."""
    from scipy.interpolate import CubicSpline

    if profile.temperature is None or profile.humidity is None:
        missing = "temperature" if profile.temperature is None else "humidity"
        raise InputError(f"profile: key {missing} is missing; to play a flight a profile needs both sensors")
    left_out: list[str] = []

    def without_logger(part: Any) -> Any:
        logger = [e for e in part.effects if e.effect in CATALOGUE and CATALOGUE[e.effect].link == "logger"]
        left_out.extend(e.effect for e in logger)
        return replace(part, effects=tuple(e for e in part.effects if e not in logger))

    element = replace(
        profile, temperature=without_logger(profile.temperature), humidity=without_logger(profile.humidity)
    )
    log = fly(weather, element, seed, noise=0.0, rounded=False).log  # the instrument rounds, not the simulation
    time_s = log["time_s"].to_numpy()

    def smooth(column: str) -> Course:
        return CubicSpline(time_s, log[column].to_numpy(), bc_type="natural")

    die_column = "humidity_sensor_temperature_c"
    die = (
        smooth(die_column) if die_column in log else lambda at_s: np.interp(at_s, weather.time_s, weather.temperature_c)
    )
    noises = profile.temperature.noise_k, profile.humidity.noise_percent
    return FlightWorld(
        weather,
        smooth("temperature_c"),
        smooth("humidity_percent"),
        die,
        noise * (NOISE_K if noises[0] is None else noises[0]),
        noise * (NOISE_PERCENT if noises[1] is None else noises[1]),
        np.random.default_rng([seed, 2]),
        tuple(dict.fromkeys(left_out)),
    )
