"""Slips of the pen, of units and of cables, made in a clean campaign: what `input_checks.py` expects to be caught.

Each is a function from a campaign to the spoiled one, or an edit of the campaign's files where the reader itself has a
say. `kinds` are the findings that count as caught.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from shockrig.files.campaign import Campaign, Run, RunAir, Trace

Make = Callable[[Campaign, Campaign, np.random.Generator], Campaign]
COPIES = 10


@dataclass(frozen=True)
class Slip:
    """One slip: its name, the kinds of finding that name it, and how it is made (of the campaign and a second one of
    another pair of sensors, or in its files). `refused` is what the reader says where it already refuses the files."""

    name: str
    kinds: tuple[str, ...]
    make: Make | None = None
    edit: Callable[[Path], None] | None = None
    refused: str = ""


def fahrenheit(celsius):
    return None if celsius is None else celsius * 1.8 + 32.0


def hundredth(percent):
    return None if percent is None else percent / 100.0


def each(campaign: Campaign, change: Callable[[Run], Run], which=lambda i: True) -> Campaign:
    """The campaign with `change` made in the runs whose index `which` accepts."""
    return replace(campaign, runs=tuple(change(r) if which(i) else r for i, r in enumerate(campaign.runs)))


def column(trace: Trace | None, name: str, change) -> Trace | None:
    if trace is None or name not in trace.values:
        return trace
    return replace(trace, values={**trace.values, name: change(trace.values[name])})


def later(trace: Trace | None, change) -> Trace | None:
    return None if trace is None else replace(trace, time_s=change(trace.time_s))


def of_airs(run: Run, temperature=lambda x: x, humidity=lambda x: x) -> Run:
    return replace(
        run,
        source=RunAir(temperature(run.source.temperature_c), humidity(run.source.humidity_percent)),
        destination=RunAir(temperature(run.destination.temperature_c), humidity(run.destination.humidity_percent)),
    )


def bead(change) -> Callable[[Run], Run]:
    return lambda run: replace(run, imet=column(run.imet, "temperature_c", change))


def die(change) -> Callable[[Run], Run]:
    return lambda run: replace(run, hyt=column(run.hyt, "temperature_c", change))


def film(change) -> Callable[[Run], Run]:
    return lambda run: replace(run, hyt=column(run.hyt, "humidity_percent", change))


def airs(temperature=lambda x: x, humidity=lambda x: x) -> Callable[[Run], Run]:
    return lambda run: of_airs(run, temperature, humidity)


def all_of(*changes: Callable[[Run], Run]) -> Callable[[Run], Run]:
    def change(run: Run) -> Run:
        for one in changes:
            run = one(run)
        return run

    return change


def clock(sensors: tuple[str, ...], change) -> Callable[[Run], Run]:
    return lambda run: replace(run, **{s: later(getattr(run, s), change) for s in sensors})


def start(change) -> Callable[[Run], Run]:
    return lambda run: replace(run, start_s=None if run.start_s is None else change(run.start_s))


def without(*what: str) -> Callable[[Run], Run]:
    """A run as other labs record it: without "start", "airs", "airflow", "imet", "hyt", "die"."""

    def change(run: Run) -> Run:
        if "start" in what:
            run = replace(run, start_s=None, duration_s=None)
        if "airs" in what:
            run = replace(run, source=RunAir(None, None), destination=RunAir(None, None))
        if "airflow" in what:
            run = replace(run, airflow_m_s=None)
        if "die" in what and run.hyt is not None:
            run = die(lambda x: np.full(x.size, np.nan))(run)
        return replace(run, **{s: None for s in ("imet", "hyt") if s in what})

    return change


def swapped_airs(run: Run) -> Run:
    return replace(run, source=run.destination, destination=run.source)


def swapped_sensors(run: Run) -> Run:
    """The readings of imet.csv under hyt.csv's humidity, and the other way round; each keeps its clock."""
    if run.imet is None or run.hyt is None:
        return run
    warm, moist = run.imet.values["temperature_c"], run.hyt.values["humidity_percent"]
    as_bead = np.interp(run.imet.time_s, run.hyt.time_s, moist)
    as_film = np.interp(run.hyt.time_s, run.imet.time_s, warm)
    return film(lambda _: as_film)(bead(lambda _: as_bead)(run))


def swapped_columns(run: Run) -> Run:
    values = run.hyt.values
    exchanged = {"humidity_percent": values["temperature_c"], "temperature_c": values["humidity_percent"]}
    return replace(run, hyt=replace(run.hyt, values=exchanged))


def one_of(change: Callable[[Run], Run]) -> Make:
    """`change` in one run, drawn among those in which both sensors step clearly."""

    def make(campaign: Campaign, _: Campaign, rng: np.random.Generator) -> Campaign:
        able = [
            i
            for i, r in enumerate(campaign.runs)
            if abs(r.destination.humidity_percent - r.source.humidity_percent) > 20.0
        ]
        chosen = int(rng.choice(able))
        return each(campaign, change, lambda i: i == chosen)

    return make


def every(*changes: Callable[[Run], Run]) -> Make:
    return lambda campaign, _, rng: each(campaign, all_of(*changes))


def share_of(change: Callable[[Run], Run], share: float) -> Make:
    def make(campaign: Campaign, _: Campaign, rng: np.random.Generator) -> Campaign:
        chosen = set(rng.permutation(len(campaign.runs))[: int(share * len(campaign.runs))].tolist())
        return each(campaign, change, lambda i: i in chosen)

    return make


def copied(noise: float, keep_conditions: bool) -> Make:
    """One run ten times over, its readings as they are or shaken a little, alone or among the others."""

    def make(campaign: Campaign, _: Campaign, rng: np.random.Generator) -> Campaign:
        run = campaign.runs[int(rng.integers(len(campaign.runs)))]
        copies = []
        for i in range(COPIES):
            again = all_of(
                bead(lambda x: x + noise * rng.standard_normal(x.size)),
                film(lambda x: x + 4.0 * noise * rng.standard_normal(x.size)),
            )(run)
            copies.append(replace(again, id=f"copy{i}"))
        others = () if keep_conditions else tuple(r for r in campaign.runs if r.id != run.id)
        return replace(campaign, runs=(*copies, *others))

    return make


def another(sensor: str, how: str) -> Make:
    """Half of the runs with `sensor` of another campaign: drawn, the second half, or every second one."""

    def make(campaign: Campaign, second: Campaign, rng: np.random.Generator) -> Campaign:
        n = len(campaign.runs)
        chosen = {
            "drawn": set(rng.permutation(n)[: n // 2].tolist()),
            "from the middle on": set(range(n // 2, n)),
            "every second": set(range(1, n, 2)),
        }[how]
        by_id = {run.id: run for run in second.runs}

        def exchange(run: Run) -> Run:
            other = by_id[run.id]
            late = run.start_s - other.start_s
            return replace(run, **{sensor: later(getattr(other, sensor), lambda t: t + late)})

        return each(campaign, exchange, lambda i: i in chosen)

    return make


def length(sensor: str, key: str, factor: float) -> Make:
    def make(campaign: Campaign, _: Campaign, rng: np.random.Generator) -> Campaign:
        sensors = {**campaign.sensors, sensor: {**campaign.sensors[sensor]}}
        sensors[sensor][key] *= factor
        return replace(campaign, sensors=sensors, **{key: getattr(campaign, key) * factor})

    return make


def in_files(table: str | None, change) -> Callable[[Path], None]:
    """An edit of every `table` (a DataFrame to a DataFrame); where it is None of every run.json (a dict, in place)."""

    def edit(folder: Path) -> None:
        for run in sorted((folder / "runs").iterdir()):
            if table is None:
                head = json.loads((run / "run.json").read_text())
                change(head)
                (run / "run.json").write_text(json.dumps(head))
            else:
                change(pd.read_csv(run / table)).to_csv(run / table, index=False)

    return edit


def in_campaign_json(sensor: str, key: str, factor: float) -> Callable[[Path], None]:
    def edit(folder: Path) -> None:
        head = json.loads((folder / "campaign.json").read_text())
        head["sensors"][sensor][key] *= factor
        (folder / "campaign.json").write_text(json.dumps(head))

    return edit


def kelvin_airs(head: dict) -> None:
    for air in ("source", "destination"):
        head[air]["temperature_c"] += 273.15


def swap_files(folder: Path) -> None:
    for run in (folder / "runs").iterdir():
        (run / "imet.csv").rename(run / "other.csv")
        (run / "hyt.csv").rename(run / "imet.csv")
        (run / "other.csv").rename(run / "hyt.csv")


def warmer(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.assign(temperature_c=frame["temperature_c"] + 273.15)
