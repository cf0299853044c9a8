"""The paper's trial: weather, the sensor flown through it, every correction, and how near each comes to the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.correct import METHODS, correct
from shockrig.analysis.flight.inverse import RefusedError
from shockrig.analysis.flight.judging import coverage, rmse
from shockrig.analysis.flight.simulated.sensor import Flown, fly_many
from shockrig.analysis.flight.simulated.weather import SCENES, Weather
from shockrig.files.flight import Corrected, Flight
from shockrig.files.profile import Profile

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

UNCERTAINTY = {"temperature": "temperature_uncertainty_k", "humidity": "humidity_uncertainty_percent"}
CHANNELS = {"temperature": ("temperature_c", "K"), "humidity": ("humidity_percent", "%RH")}


@dataclass(frozen=True)
class Trial:
    """One flight with its truth and what each method made of it; `refused` says why a method is missing."""

    scene: str
    flown: Flown
    corrected: dict[str, Corrected]
    refused: dict[str, str]


@dataclass(frozen=True)
class SceneScore:
    """Of one method in one scene and channel: errors of the reading and of the correction, stated uncertainty,
    coverage.
    """

    scene: str
    channel: str
    method: str
    raw: float
    rmse: float
    stated: float
    coverage: float


def to_flight(log: pd.DataFrame) -> Flight:
    """A log's frame as arrays; columns that it lacks are unknown."""

    def column(name: str) -> Array:
        return log[name].to_numpy(dtype=float) if name in log else np.full(len(log), np.nan)

    return Flight(
        column("time_s"),
        column("temperature_c"),
        column("humidity_percent"),
        column("airspeed_m_s"),
        column("humidity_sensor_temperature_c"),
        column("pressure_hpa"),
        column("altitude_m"),
    )


def try_scene(
    scene: str, profile: Profile, seeds: Sequence[int], *, flown_with: Profile | None = None, **options: float
) -> list[Trial]:
    """Fly a scene once for each seed and correct it with every method.

    `flown_with` is the sensor's true profile where the one that corrects is not exactly right.
    """
    weathers: list[Weather] = [SCENES[scene](np.random.default_rng([seed, 1]), **options) for seed in seeds]
    flights = fly_many(weathers, flown_with or profile, list(seeds))
    return [try_flight(scene, flown, profile) for flown in flights]


def try_flight(scene: str, flown: Flown, profile: Profile) -> Trial:
    """Correct one flight with every method."""
    corrected, refused = {}, {}
    for method in METHODS:
        try:
            corrected[method] = correct(to_flight(flown.log), profile, method)
        except RefusedError as reason:
            refused[method] = str(reason)
    return Trial(scene, flown, corrected, refused)


def scores(trial: Trial) -> list[SceneScore]:
    """Every method's score in both channels."""
    found = []
    for channel, (column, _) in CHANNELS.items():
        if column not in trial.flown.log:
            continue
        truth, raw = trial.flown.truth[column].to_numpy(), trial.flown.log[column].to_numpy()
        for method, result in trial.corrected.items():
            value = getattr(result, column)
            sigma = getattr(result, UNCERTAINTY[channel])
            stated = float(np.sqrt(np.nanmean(sigma**2))) if np.isfinite(sigma).any() else float("nan")
            found.append(
                SceneScore(
                    trial.scene,
                    channel,
                    method,
                    rmse(raw, truth),
                    rmse(value, truth),
                    stated,
                    coverage(value, sigma, truth),
                )
            )
    return found
