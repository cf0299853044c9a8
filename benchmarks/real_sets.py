"""Campaigns of steps that other people measured, cut from their logs as a careful user would, and plunges by hand
simulated in their likeness.

haar: github NorthernWidget-Skunkworks/Project-Haar @681b731, CC BY-SA 4.0; rbr: github
jtomfarrar/submersible_humidity_sensor @8af358d, MIT. Nothing is known of starts, airs or airflow in either.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

FILES = {"temperature": ("imet", "imet.csv"), "humidity": ("hyt", "hyt.csv")}
# Haar: the room at 16 degC, in which B still cools, then the box at 25 degC; humid air let into another box.
HAAR_COOLING_S, HAAR_BOX_S = (0.0, 800.0), (1450.0, 6000.0)
HAAR_HUMID_S = (3000.0, 9900.0)
# RBR: one plunge from the room into ice water; then the bath is warmed with hot water, some portions to each level.
RBR_PLUNGE_S = (1150.0, 1390.0)
RBR_BATHS_S = (
    *((3500.0, 4200.0), (5600.0, 6300.0), (7900.0, 8600.0), (10000.0, 10700.0)),
    *((12150.0, 12900.0), (14250.0, 15000.0), (20300.0, 21000.0)),
)
PUBLISHED_T63_S = {"A": 124.0, "B": 381.0, "Ctrl": 217.0}  # open, closed, control; the box's own approach included


@dataclass(frozen=True)
class RealSet:
    """One set: the channel that is judged, how its campaign is made, and what its authors published of t63 [s]."""

    name: str
    channel: str
    make: Callable[[Path, Path], None]  # (folder of the logs, campaign to write)
    published_t63_s: float | None = None
    forbidden: tuple[str, ...] = ()


def write_campaign(
    out: Path,
    channel: str,
    log: pd.DataFrame,
    cuts: list[tuple[float, float]],
    air: pd.DataFrame | None = None,
    reference: dict | None = None,
) -> None:
    """A campaign of stretches of a log (columns as in the format), each a run whose clock starts at its begin."""
    sensor, name = FILES[channel]
    for i, (begin, end) in enumerate(cuts, start=1):
        folder = out / "runs" / f"{i:04d}"
        folder.mkdir(parents=True)
        run: dict = {"format": "shock-run/1", "id": folder.name}
        for file, columns in ((name, log), ("air.csv", air)):
            if columns is not None:
                inside = columns[(columns["time_s"] >= begin) & (columns["time_s"] < end)]
                inside = inside.assign(time_s=inside["time_s"] - begin)
                inside.to_csv(folder / file, index=False, float_format="%.6g")
        if air is not None and reference:
            run["reference"] = reference
        (folder / "run.json").write_text(json.dumps(run))
    # As shockrig import states a sensor whose body nobody states.
    sensors = {sensor: {"kind": "as logged", "body": "lumped"}}
    head = {"format": "shock-campaign/1", "name": out.name, "sensors": sensors}
    (out / "campaign.json").write_text(json.dumps(head))


def haar(logs: Path, channel: str, sensor: str) -> pd.DataFrame:
    """One sensor of a Haar log; a hygrometer has its own temperature beside it."""
    frame = pd.read_csv(logs / "haar" / f"{channel.capitalize()}.csv", encoding="utf-8-sig")
    wanted = {"Time": "time_s", f"Temp{sensor}": "temperature_c"}
    if channel == "humidity":
        wanted[f"RH{sensor}"] = "humidity_percent"
    return frame[list(wanted)].rename(columns=wanted)


def rbr(logs: Path, which: int) -> pd.DataFrame:
    """The first (0) or second (1) thermistor of the logger, seconds from its first row."""
    path = next((logs / "rbr").glob("*.csv"))
    frame = pd.read_csv(path, header=None, skiprows=_head_lines(path), encoding="utf-8")
    stamps = pd.to_datetime(frame[0])
    return pd.DataFrame({"time_s": (stamps - stamps.iloc[0]).dt.total_seconds(), "temperature_c": frame[1 + which]})


def _head_lines(path: Path) -> int:
    with path.open(encoding="utf-8") as file:
        return next(i for i, text in enumerate(file) if text[:1].isdigit())


def _haar_set(channel: str, sensor: str, air: str | None) -> RealSet:
    cuts = [HAAR_BOX_S] if channel == "temperature" else [HAAR_HUMID_S]
    if sensor == "B" and channel == "temperature":
        cuts = [HAAR_COOLING_S, HAAR_BOX_S]
    # Sensors of the two makes differ by 0.2 K and 3 %RH on the plateaus; no data sheet promises better.
    known = {"temperature_standard_uncertainty_k": 0.2, "humidity_standard_uncertainty_percent": 2.0}

    def make(logs: Path, out: Path) -> None:
        beside = haar(logs, channel, air) if air else None
        write_campaign(out, channel, haar(logs, channel, sensor), cuts, beside, known)

    name = f"haar {channel} {sensor}" + (f", air from {air}" if air else "")
    forbidden = ("self_heating", "evaporative_cooling", "condensation")
    published = PUBLISHED_T63_S[sensor] if channel == "temperature" and air is None else None
    return RealSet(name, channel, make, published, forbidden)


def _rbr_set(which: int, cuts: tuple, air: int | None, label: str) -> RealSet:
    def make(logs: Path, out: Path) -> None:
        beside = None if air is None else rbr(logs, air)
        write_campaign(out, "temperature", rbr(logs, which), list(cuts), beside)

    forbidden = ("self_heating", "radiative_heating", "condensation", "evaporative_cooling")
    return RealSet(f"rbr thermistor {which + 1}, {label}", "temperature", make, None, forbidden)


def plunges(name: str, seed: int, scatter: float, transfer_s: float, start: bool, air_error: float) -> RealSet:
    """Six plunges of an RTD by hand: 10 ms samples, airs known, no airflow; a tenth of the reading follows slowly."""
    from foreign_lab import Arrival, Lab, LabLogger, LabRun, Written, make_body

    rng = np.random.default_rng(seed)
    body = make_body(
        "lumped", float(rng.uniform(1.0, 3.0)), slow=(float(rng.uniform(0.08, 0.2)), float(rng.uniform(4, 8)))
    )
    hot = [float(x) for x in rng.uniform(55.0, 95.0, 6)]
    plan = tuple(LabRun(23.0, h, float(rng.uniform(2.0, 12.0)), float(rng.uniform(45.0, 70.0))) for h in hot)
    approach = Arrival("ramp", transfer_s) if transfer_s else Arrival()
    written = Written(start=start, airflow=False, air_error=air_error)
    bench = Lab(
        "temperature", body, approach, LabLogger(0.01, 0.01, 0.03, 0.02, 0.1), plan, written, rate_scatter=scatter
    )

    def make(_: Path, out: Path) -> None:
        from foreign_lab import record

        record(bench, seed, out)

    return RealSet(
        name, "temperature", make, body.time_to_s(1.0 - np.exp(-1.0)), ("evaporative_cooling", "condensation")
    )


def real_sets() -> list[RealSet]:
    """All of them, in the order of the table."""
    sets = [_haar_set("temperature", s, a) for s, a in _PAIRS] + [_haar_set("humidity", s, a) for s, a in _PAIRS]
    both = (RBR_PLUNGE_S, *RBR_BATHS_S)
    for which in (0, 1):
        sets += [
            _rbr_set(which, (RBR_PLUNGE_S,), None, "the plunge"),
            _rbr_set(which, both, None, "plunge and baths"),
            _rbr_set(which, RBR_BATHS_S, 1 - which, "baths, air from the other"),
        ]
    sets += [
        plunges("plunges, two time constants", 1, 0.0, 0.0, False, 0.02),
        plunges("plunges, two time constants, start stated", 2, 0.0, 0.0, True, 0.02),
        plunges("plunges by hand", 3, 0.05, 0.2, False, 0.3),
        plunges("plunges by hand, start stated", 4, 0.05, 0.2, True, 0.3),
    ]
    return sets


_PAIRS = (("A", None), ("B", None), ("Ctrl", None), ("B", "A"), ("B", "Ctrl"), ("Ctrl", "A"), ("A", "Ctrl"))
