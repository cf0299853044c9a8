"""The sensor profile (`sensor-profile/1`): what a characterization knows of a pair of sensors, read and written.

One thermal diffusivity alpha for the bead, a table D(T) for the film (read between its rows as ln D over 1/T), response
times, noise, and the effects that the extended model carries. docs/flights.md says how a flight uses it.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from shockrig.files.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

FORMAT = "sensor-profile/1"
BEAD_RADIUS_M = 4e-4
FILM_THICKNESS_M = 1e-5
AMBIENT_TOLERANCE_K = 1.0  # destinations within 1 K of one another are one ambient, so a row holds that far
ASSUMED_RELATIVE_UNCERTAINTY = 0.05  # of a diffusivity whose file gives no standard uncertainty


@dataclass(frozen=True)
class Uncertain:
    """A value and its standard uncertainty (one sigma), in the unit that the name of its key carries."""

    value: float
    standard_uncertainty: float = 0.0


@dataclass(frozen=True)
class Effect:
    """An extension of the plain model: an id of the catalogue with its parameters (names carry units)."""

    effect: str
    parameters: Mapping[str, Uncertain] = field(default_factory=dict)
    probability: float | None = None
    indistinguishable_from: tuple[str, ...] = ()

    def value(self, name: str, default: float | None = None) -> float:
        """Value of a parameter; InputError when the profile lacks it and there is no default."""
        if name in self.parameters:
            return self.parameters[name].value
        if default is None:
            raise InputError(
                f"profile: effect {self.effect} lacks the parameter {name!r}; add it or take the effect out"
            )
        return default


@dataclass(frozen=True)
class ResponseTime:
    """Seconds to 63, 90 and 98 % of a step (t63_s is the exact 1 - 1/e)."""

    t63_s: float
    t90_s: float
    t98_s: float


@dataclass(frozen=True)
class TemperatureProfile:
    """The bead: a sphere of radius `bead_radius_m`, read at its core."""

    thermal_diffusivity_m2_s: Uncertain
    bead_radius_m: float = BEAD_RADIUS_M
    response_time_s: ResponseTime | None = None
    noise_k: float | None = None
    sampling_period_s: float | None = None
    effects: tuple[Effect, ...] = ()


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
    effects: tuple[Effect, ...] = ()

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
        """D and its standard uncertainty at `temperature_c`: ln D linear in 1/T between the table's rows.

        The uncertainty carries the rows' own and the curvature that a straight line between two rows cannot know (the
        second difference of the rows around, zero at the rows themselves and for an Arrhenius law).

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
            bend = _curvature(node, ln_d)
            sag = 0.5 * np.maximum(bend[left], bend[left + 1]) * np.abs((x - node[left]) * (node[left + 1] - x))
            rows_part = np.hypot((1 - weight) * relative[left], weight * relative[left + 1])
            sigma = np.hypot(rows_part, sag / math.sqrt(3))
        sigma = np.hypot(sigma, 0.05 * np.abs(wanted - inside_c))
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

        def seconds(row: DiffusivityRow, name: str) -> float:
            return getattr(row.response_time_s, name) if row.response_time_s else math.nan

        rows = self.diffusivity_table
        return pd.DataFrame(
            {
                "ambient_temperature_c": [r.ambient_temperature_c for r in rows],
                "diffusivity_m2_s": [r.diffusivity_m2_s for r in rows],
                "standard_uncertainty": [r.standard_uncertainty for r in rows],
                "runs": pd.array([r.runs for r in rows], dtype="Int64"),
                "t63_s": [seconds(r, "t63_s") for r in rows],
                "t90_s": [seconds(r, "t90_s") for r in rows],
                "t98_s": [seconds(r, "t98_s") for r in rows],
            }
        )


@dataclass(frozen=True)
class Profile:
    """A pair of sensors; either part may be missing."""

    temperature: TemperatureProfile | None = None
    humidity: HumidityProfile | None = None
    sensors: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    provenance: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))


def read_profile(path: str | os.PathLike) -> Profile:
    """Read and check a profile; keys that the format does not know are ignored.

    Raises
    ------
    InputError
        Names the file, the key, what was expected and the mend.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as a profile ({error}); give a profile.json") from error
    try:
        document = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid JSON ({error}); give the profile.json that characterize wrote") from error
    return profile_from_document(document, str(path))


def profile_from_document(document: object, source: str = "profile") -> Profile:
    """A Profile from the parsed JSON; `source` names it in errors."""
    top = _Keys(document, source, "")
    if top.get("format") != FORMAT:
        raise top.error("format", repr(FORMAT), top.get("format"))
    temperature = humidity = None
    if (part := top.child("temperature")) is not None:
        temperature = TemperatureProfile(
            thermal_diffusivity_m2_s=part.uncertain("thermal_diffusivity_m2_s"),
            bead_radius_m=part.number("bead_radius_m", BEAD_RADIUS_M, positive=True),
            response_time_s=_response_time(part.child("response_time_s")),
            noise_k=part.number("noise_k", None, at_least=0.0),
            sampling_period_s=part.number("sampling_period_s", None, positive=True),
            effects=part.effects(),
        )
    if (part := top.child("humidity")) is not None:
        humidity = HumidityProfile(
            diffusivity_table=_table(part),
            film_thickness_m=part.number("film_thickness_m", FILM_THICKNESS_M, positive=True),
            noise_percent=part.number("noise_percent", None, at_least=0.0),
            sampling_period_s=part.number("sampling_period_s", None, positive=True),
            effects=part.effects(),
        )
    if temperature is None and humidity is None:
        raise InputError(f"{source}: neither temperature nor humidity is there; a profile holds at least one of them")
    sensors, provenance = top.get("sensors"), top.get("provenance")
    return Profile(
        temperature,
        humidity,
        MappingProxyType(sensors if isinstance(sensors, dict) else {}),
        MappingProxyType(provenance if isinstance(provenance, dict) else {}),
    )


def write_profile(profile: Profile, path: str | os.PathLike) -> None:
    """Write a profile; the file appears whole or not at all."""
    path = Path(path)
    text = json.dumps(profile_document(profile), indent=2, allow_nan=False) + "\n"
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def profile_document(profile: Profile) -> dict[str, Any]:
    """The profile as the JSON document of `sensor-profile/1`; unknown values are left out."""
    document: dict[str, Any] = {"format": FORMAT, "sensors": dict(profile.sensors)}
    if (t := profile.temperature) is not None:
        document["temperature"] = _without_none(
            bead_radius_m=t.bead_radius_m,
            thermal_diffusivity_m2_s=_uncertain_document(t.thermal_diffusivity_m2_s),
            response_time_s=_response_document(t.response_time_s),
            noise_k=t.noise_k,
            sampling_period_s=t.sampling_period_s,
            effects=[effect_document(e) for e in t.effects],
        )
    if (h := profile.humidity) is not None:
        document["humidity"] = _without_none(
            film_thickness_m=h.film_thickness_m,
            diffusivity_table=[
                _without_none(
                    ambient_temperature_c=r.ambient_temperature_c,
                    diffusivity_m2_s=r.diffusivity_m2_s,
                    standard_uncertainty=r.standard_uncertainty,
                    runs=r.runs,
                )
                for r in h.diffusivity_table
            ],
            response_time_s=[
                {"ambient_temperature_c": r.ambient_temperature_c} | _response_document(r.response_time_s)
                for r in h.diffusivity_table
                if r.response_time_s is not None
            ],
            noise_percent=h.noise_percent,
            sampling_period_s=h.sampling_period_s,
            effects=[effect_document(e) for e in h.effects],
        )
    document["provenance"] = dict(profile.provenance)
    return document


def effect_document(effect: Effect) -> dict[str, Any]:
    """An effect as in a profile's `effects` and a diagnosis's `causes`."""
    return _without_none(
        effect=effect.effect,
        probability=effect.probability,
        parameters={name: _uncertain_document(u) for name, u in effect.parameters.items()},
        indistinguishable_from=list(effect.indistinguishable_from),
    )


def _curvature(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """|second derivative| of y(x) at each node, from divided differences; zero with fewer than three nodes."""
    if len(x) < 3:
        return np.zeros(len(x))
    slope = np.diff(y) / np.diff(x)
    second = np.abs(np.diff(slope) / (0.5 * (x[2:] - x[:-2])))
    return np.concatenate([second[:1], second, second[-1:]])


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number of JSON; leave an unknown value out")


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


class _Keys:
    """Checked access to one JSON object; every error names the file and the whole key."""

    def __init__(self, value: object, source: str, path: str) -> None:
        self.source, self.path = source, path
        if not isinstance(value, dict):
            raise self.error(path.rstrip(".") or "top level", "a JSON object", value)
        self.value = value

    def error(self, key: str, expected: str, came: object) -> InputError:
        return InputError(f"{self.source}: key {key}: expected {expected}, came {_short(came)}; mend it")

    def get(self, key: str) -> Any:
        return self.value.get(key)

    def child(self, key: str) -> _Keys | None:
        value = self.get(key)
        return None if value is None else _Keys(value, self.source, f"{self.path}{key}.")

    def items(self, key: str) -> list[_Keys]:
        value = self.get(key)
        if value is None:
            return []
        if not isinstance(value, list):
            raise self.error(self.path + key, "a list", value)
        return [_Keys(item, self.source, f"{self.path}{key}[{i}].") for i, item in enumerate(value)]

    def number(self, key: str, default: Any = ..., *, positive: bool = False, at_least: float | None = None) -> Any:
        value = self.get(key)
        if value is None and default is not ...:
            return default
        bound = "a positive number" if positive else "a number"
        bound += "" if at_least is None else f" of at least {at_least:g}"
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.error(self.path + key, bound, value)
        try:
            number = float(value)
        except OverflowError:
            raise self.error(self.path + key, bound, value) from None
        if not math.isfinite(number) or (positive and number <= 0) or (at_least is not None and number < at_least):
            raise self.error(self.path + key, bound, value)
        return number

    def uncertain(self, key: str) -> Uncertain:
        part = self.child(key)
        if part is None:
            raise self.error(self.path + key, 'an object with "value" and "standard_uncertainty"', None)
        value = part.number("value", positive=True)
        return Uncertain(value, part.number("standard_uncertainty", ASSUMED_RELATIVE_UNCERTAINTY * value, at_least=0.0))

    def effects(self) -> tuple[Effect, ...]:
        return tuple(_effect(item) for item in self.items("effects"))


def _effect(keys: _Keys) -> Effect:
    name = keys.get("effect")
    if not isinstance(name, str) or not name:
        raise keys.error(keys.path + "effect", "the id of an effect", name)
    parameters: dict[str, Uncertain] = {}
    given = keys.child("parameters")
    for key in given.value if given else ():
        part = given.child(key)
        if part is not None and part.get("value") is not None:
            parameters[key] = Uncertain(part.number("value"), part.number("standard_uncertainty", 0.0, at_least=0.0))
    probability = keys.number("probability", None, at_least=0.0)
    if probability is not None and probability > 1.0:
        raise keys.error(keys.path + "probability", "a number between 0 and 1", probability)
    others = keys.get("indistinguishable_from")
    others = [] if others is None else others
    if not isinstance(others, list) or not all(isinstance(o, str) for o in others):
        raise keys.error(keys.path + "indistinguishable_from", "a list of effect ids", others)
    return Effect(name, MappingProxyType(parameters), probability, tuple(others))


def _table(humidity: _Keys) -> tuple[DiffusivityRow, ...]:
    rows = []
    times = {item.number("ambient_temperature_c"): _response_time(item) for item in humidity.items("response_time_s")}
    for item in humidity.items("diffusivity_table"):
        ambient_c = item.number("ambient_temperature_c", at_least=-150.0)
        value = item.number("diffusivity_m2_s", positive=True)
        runs = item.number("runs", None, at_least=0.0)
        rows.append(
            DiffusivityRow(
                ambient_c,
                value,
                item.number("standard_uncertainty", ASSUMED_RELATIVE_UNCERTAINTY * value, at_least=0.0),
                None if runs is None else int(runs),
                times.get(ambient_c),
            )
        )
        if len(rows) > 1 and ambient_c <= rows[-2].ambient_temperature_c:
            raise item.error(
                item.path + "ambient_temperature_c", "rows ordered by rising temperature, each once", ambient_c
            )
    if not rows:
        raise humidity.error(
            humidity.path + "diffusivity_table", "a list with at least one row", humidity.get("diffusivity_table")
        )
    return tuple(rows)


def _response_time(keys: _Keys | None) -> ResponseTime | None:
    if keys is None or any(keys.get(name) is None for name in ("t63", "t90", "t98")):
        return None
    return ResponseTime(*(keys.number(name, positive=True) for name in ("t63", "t90", "t98")))


def _response_document(time: ResponseTime | None) -> dict[str, float] | None:
    return None if time is None else {"t63": time.t63_s, "t90": time.t90_s, "t98": time.t98_s}


def _uncertain_document(value: Uncertain) -> dict[str, float]:
    return {"value": value.value, "standard_uncertainty": value.standard_uncertainty}


def _without_none(**items: Any) -> dict[str, Any]:
    return {key: value for key, value in items.items() if value is not None}
