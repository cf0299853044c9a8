"""A run that could be made, in the terms of run.json, and the menu of those that are worth a thought."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from shockrig.analysis.estimate.quantity import ChannelName
from shockrig.analysis.physics.humidity import saturation_pressure_hpa

LEAD_S, LONG_LEAD_S = 6.0, 30.0  # recorded before a transfer; longer, for what a run's own clock does
USUAL_AIRFLOW_M_S = 6.0
USUAL_C = 20.0
WARMER_K = 20.0  # the other air of a thermal shock
LONG_S, LONGEST_S = 70.0, 150.0  # of a record after the transfer that shows slow tails too
SHORTEST_S = 8.0
SLOWED_S = 2.0
SLOWEST_M_S = 0.7  # that a fan keeps steady
Airs = tuple[float, float, float, float]  # source degC and %RH, destination degC and %RH


@dataclass(frozen=True)
class PlannedShock:
    """One run: its two airs, airflow, pressure, light, how long it is recorded before the transfer and after it, and
    how slowly it is carried over.

    `transfer_s` is None where the stage goes as fast as it can; `why` is what it is for.
    """

    source_c: float
    source_percent: float
    destination_c: float
    destination_percent: float
    airflow_m_s: float = USUAL_AIRFLOW_M_S
    dwell_s: float = LONG_S
    transfer_s: float | None = None
    pressure_hpa: float = 1013.25
    irradiance_w_m2: float = 0.0
    lead_s: float = LEAD_S
    why: str = field(default="", compare=False)

    @property
    def airs(self) -> Airs:
        """Both."""
        return self.source_c, self.source_percent, self.destination_c, self.destination_percent

    @property
    def isothermal(self) -> bool:
        """Whether the temperature does not change."""
        return self.source_c == self.destination_c

    @property
    def shows(self) -> ChannelName:
        """The channel that it is for."""
        return "humidity" if self.isothermal else "temperature"

    @property
    def way(self) -> tuple[ChannelName, bool]:
        """That, and whether it is a step up."""
        rises = self.destination_percent > self.source_percent
        return self.shows, rises if self.isothermal else self.destination_c > self.source_c

    @property
    def recorded_s(self) -> float:
        """Of the record, with the plateau before the transfer."""
        return self.lead_s + (self.transfer_s or 0.0) + self.dwell_s

    def as_run(self) -> dict[str, Any]:
        """In the terms of run.json."""
        names = ("temperature_c", "humidity_percent")
        light = {"irradiance_w_m2": self.irradiance_w_m2} if self.irradiance_w_m2 else {}
        return {
            "source": dict(zip(names, (self.source_c, self.source_percent), strict=True)),
            "destination": dict(zip(names, (self.destination_c, self.destination_percent), strict=True)),
            "airflow_m_s": self.airflow_m_s,
            "pressure_hpa": self.pressure_hpa,
            "transfer": {} if self.transfer_s is None else {"duration_s": self.transfer_s},
            **light,
            "lead_s": self.lead_s,
            "dwell_s": self.dwell_s,
            "why": self.why,
        }


def from_run(run: dict[str, Any]) -> PlannedShock:
    """The shock that `PlannedShock.as_run` wrote."""
    return PlannedShock(
        run["source"]["temperature_c"],
        run["source"]["humidity_percent"],
        run["destination"]["temperature_c"],
        run["destination"]["humidity_percent"],
        run["airflow_m_s"],
        run["dwell_s"],
        run["transfer"].get("duration_s"),
        run["pressure_hpa"],
        run.get("irradiance_w_m2", 0.0),
        run.get("lead_s", LEAD_S),
        run["why"],
    )


@dataclass(frozen=True)
class Surroundings:
    """Other pressures and lights that runs can be recorded at, besides the laboratory's and none."""

    pressures_hpa: tuple[float, ...] = ()
    irradiances_w_m2: tuple[float, ...] = ()


ORDINARY = Surroundings()


@dataclass(frozen=True)
class Usual:
    """What a campaign's runs usually have: airflow, pressure; others and lights that there are; its coldest and warmest
    air.
    """

    airflow_m_s: float = USUAL_AIRFLOW_M_S
    pressure_hpa: float = 1013.25
    other: Surroundings = ORDINARY
    coldest_c: float = 0.0
    warmest_c: float = 40.0

    def allows(self, shock: PlannedShock) -> bool:
        """Whether both airs lie between the coldest and the warmest."""
        return all(self.coldest_c <= t <= self.warmest_c for t in (shock.source_c, shock.destination_c))


def opening(middle_c: float, usual: Usual) -> list[PlannedShock]:
    """The first runs of a campaign: both quantities, both directions, at one ambient."""
    return [_between(usual, *pair, LONG_S, "no run has shown it yet") for pair in _both_ways(middle_c).values()]


def precision_menu(
    ambients_c: Sequence[float], usual: Usual, dwell_s: Callable[[float, bool], float]
) -> list[PlannedShock]:
    """Humidity shocks at each ambient and thermal shocks into it, recorded for as long as the sensor needs, or longer.

    `dwell_s` says how long that is at an ambient [degC], for an isothermal shock or a thermal one.
    """
    menu = []
    for t in ambients_c:
        shocks = _both_ways(t) | {"temperature up": _both_ways(t - WARMER_K)["temperature up"]}
        for why, (source, destination) in shocks.items():
            enough = dwell_s(destination[0], source[0] == destination[0])
            menu += [_between(usual, source, destination, round(f * enough), why) for f in (1.0, 1.7)]
    return [shock for shock in menu if usual.allows(shock)]


def deciding_menu(
    ambients_c: Sequence[float], usual: Usual, dwell_s: Callable[[float, bool], float] | None = None
) -> list[PlannedShock]:
    """Everything else that a bench can vary: size of the step, level, direction, airflow, how slowly, light; long.

    With `dwell_s`, see `precision_menu`, other airflows also no longer than the sensor needs.
    """
    slow, fast = max(SLOWEST_M_S, round(0.3 * usual.airflow_m_s, 1)), round(2.0 * usual.airflow_m_s, 1)
    airflows = {"little airflow": {"airflow_m_s": slow}, "much airflow": {"airflow_m_s": fast}}
    variants = {
        **airflows,
        "the transfer slowed": {"transfer_s": SLOWED_S},
        "recorded for longer before it": {"lead_s": LONG_LEAD_S},
        **{f"under {light:g} W/m2": {"irradiance_w_m2": light} for light in usual.other.irradiances_w_m2},
        **{f"at {pressure:g} hPa": {"pressure_hpa": pressure} for pressure in usual.other.pressures_hpa},
    }
    menu = []
    for t in ambients_c:
        shocks = _both_ways(t) | {
            f"a step of temperature of {2.0 * WARMER_K:g} K": (_warm(t, 2.0 * WARMER_K), (t, 55.0)),
            "a small step of temperature": ((t + 7.0, 40.0), (t, 50.0)),
            "a small step at high humidity": ((t, 65.0), (t, 80.0)),
            "a small step at low humidity": ((t, 35.0), (t, 20.0)),
            "a small step down at high humidity": ((t, 80.0), (t, 65.0)),
        }
        for why, (source, destination) in shocks.items():
            enough = LONG_S if dwell_s is None else float(round(dwell_s(destination[0], source[0] == destination[0])))
            base = _between(usual, source, destination, max(LONG_S, enough), why)
            longer = {"recorded for longer": {"dwell_s": LONGEST_S}} if base.dwell_s < LONGEST_S else {}
            others = variants | longer
            menu += [base, *(replace(base, why=f"{why}, {more}", **other) for more, other in others.items())]
            if enough < LONG_S:
                short = replace(base, dwell_s=enough)
                menu += [replace(short, why=f"{why}, {more}", **other) for more, other in airflows.items()]
    return [shock for shock in menu if usual.allows(shock)]


def _both_ways(t: float) -> dict[str, tuple[tuple[float, float], tuple[float, float]]]:
    """The airs [degC, %RH] of a step of either quantity in either direction about an ambient."""
    dry, wet, warm, here = (t, 20.0), (t, 80.0), _warm(t), (t, 55.0)
    return {
        "humidity up": (dry, wet),
        "humidity down": (wet, dry),
        "temperature down": (warm, here),
        "temperature up": (here, warm),
    }


def _between(
    usual: Usual, source: tuple[float, float], destination: tuple[float, float], dwell: float, why: str
) -> PlannedShock:
    return PlannedShock(*source, *destination, usual.airflow_m_s, float(dwell), None, usual.pressure_hpa, why=why)


def _warm(ambient_c: float, by_k: float = WARMER_K) -> tuple[float, float]:
    """Air warmer than that at 55 %RH, with about its vapour: the film's own water hardly changes."""
    warm_c = ambient_c + by_k
    percent = 55.0 * saturation_pressure_hpa(np.array(ambient_c)) / saturation_pressure_hpa(np.array(warm_c))
    return warm_c, float(max(round(float(percent)), 3.0))
