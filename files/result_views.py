"""How a diagnosis and a corrected flight show themselves in a notebook, from the content of their files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from shockrig.files.figures import BLUE, INK, ORANGE, literal, notebook_figure, styled
from shockrig.files.flight import Corrected, Flight
from shockrig.files.flight_figure import changes_of, channels_of
from shockrig.files.learned import LearnedFile
from shockrig.files.numbers import counted, plain
from shockrig.files.views import card, require_xarray

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

CHANNEL_UNITS = {"temperature": "K", "humidity": "%RH"}
NOTHING_TIED = "nothing is tied: no run would decide anything"
PLACES = {"pressure_hpa": "hPa", "altitude_m": "m", "latitude_deg": "degrees_north", "longitude_deg": "degrees_east"}
LEARNED_COLUMNS = (
    "channel",
    "verdict",
    "law",
    "would_be",
    "probability",
    "parameter",
    "value",
    "standard_uncertainty",
    "unit",
)
CAUSE_COLUMNS = (
    "channel",
    "verdict",
    "effect",
    "probability",
    "parameter",
    "value",
    "standard_uncertainty",
    "indistinguishable_from",
)


def causes_frame(document: Mapping[str, Any]) -> pd.DataFrame:
    """One row for each parameter of each named cause of a diagnosis; a channel without causes has one row as well."""
    import pandas as pd

    rows: list[tuple[Any, ...]] = []
    for channel, found in document["channels"].items():
        verdict = found["verdict"]
        for cause in found["causes"]:
            alike = ", ".join(cause.get("indistinguishable_from") or ())
            named = (channel, verdict, cause["effect"], cause.get("probability"))
            parameters = cause.get("parameters") or {"": {}}
            for name, estimate in parameters.items():
                rows.append((*named, name, estimate.get("value"), estimate.get("standard_uncertainty"), alike))
        if not found["causes"]:
            rows.append((channel, verdict, "", None, "", None, None, ""))
    return pd.DataFrame(rows, columns=list(CAUSE_COLUMNS)).set_index("channel")


def learned_frame(learned: LearnedFile) -> pd.DataFrame:
    """One row for each number of each law that flights show; of the altitude's clock as well."""
    import pandas as pd

    position = "named" if learned.position.named else "possible"
    parts = [(name, one.verdict, one.causes) for name, one in learned.channels.items()]
    rows = [
        (name, verdict, law.law, ", ".join(law.would_be), law.probability, key, number.value,
         number.standard_uncertainty, number.unit)
        for name, verdict, laws in (*parts, ("altitude", position, learned.position.causes))
        for law in laws
        for key, number in law.parameters.items()
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=list(LEARNED_COLUMNS)).set_index("channel")


def learned_dataset(learned: LearnedFile) -> xr.Dataset:
    """How far passes of flights that were not fitted disagree: mean, and spread about it (channel, correction)."""
    xr = require_xarray()
    names = list(learned.channels)
    corrections = list(learned.channels[names[0]].passes_disagree)
    apart = [[learned.channels[name].passes_disagree[key] for key in corrections] for name in names]
    arrays = {
        "passes_apart_mean": [[one.mean for one in row] for row in apart],
        "passes_apart_about_it": [[one.about_it for one in row] for row in apart],
    }
    units = ("channel", [CHANNEL_UNITS[name] for name in names])
    dims = ("channel", "correction")
    return xr.Dataset(
        {name: (dims, values) for name, values in arrays.items()},
        coords={"channel": names, "correction": corrections, "unit": units},
    )


def gain_frame(document: Mapping[str, Any]) -> pd.DataFrame:
    """The error on unseen runs before and after the extension, one row a channel, in its unit (K or %RH)."""
    import pandas as pd

    rows = {}
    for channel, found in document["channels"].items():
        gain = found.get("gain") or {}
        low, high = gain.get("interval_95") or (None, None)
        rows[channel] = {
            "unit": CHANNEL_UNITS[channel],
            "held_out_rmse_before": gain.get("held_out_rmse_before"),
            "held_out_rmse_after": gain.get("held_out_rmse_after"),
            "noise_floor": gain.get("noise_floor"),
            "explained_fraction": gain.get("explained_fraction"),
            "low_95": low,
            "high_95": high,
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("channel")


def diagnosis_dataset(document: Mapping[str, Any]) -> xr.Dataset:
    """The errors on unseen runs over the channel, and the causes' parameters one below the other, with their units."""
    xarray = require_xarray()
    gain, causes = gain_frame(document), causes_frame(document).reset_index()
    variables: dict[str, Any] = {}
    for name in gain.columns.drop("unit"):
        variables[name] = ("channel", gain[name].to_numpy(dtype=float))
    variables["unit"] = ("channel", gain["unit"].to_numpy(dtype=str))
    variables["verdict"] = ("channel", [document["channels"][name]["verdict"] for name in gain.index])
    for name in causes.columns:
        numbers = name in ("probability", "value", "standard_uncertainty")
        values = causes[name].to_numpy(dtype=float) if numbers else causes[name].to_numpy(dtype=str)
        variables[f"cause_{name}"] = ("cause", values)
    return xarray.Dataset(variables, {"channel": gain.index.to_list()}, {"campaign": str(document.get("campaign", ""))})


def plan_dataset(runs: Sequence[Mapping[str, Any]]) -> xr.Dataset:
    """The runs to record, a variable for each column of their table over the run's number."""
    frame = plan_frame(runs)
    frame.columns = [str(name).replace(".", "_") for name in frame.columns]
    frame.index = frame.index.rename("run") + 1
    return require_xarray().Dataset({name: ("run", frame[name].to_numpy()) for name in frame}, {"run": frame.index})


def diagnosis_card(document: Mapping[str, Any]) -> str:
    """Verdict and error of each channel, and the causes."""
    facts = []
    for channel, row in gain_frame(document).iterrows():
        words = [str(document["channels"][channel]["verdict"])]
        before, after, noise = (row[name] for name in ("held_out_rmse_before", "held_out_rmse_after", "noise_floor"))
        if before is not None and after is not None and noise is not None:
            errors = f"{plain(before, 3)} {row.unit} on unseen runs, {plain(after, 3)} with its causes"
            words.append(f"{errors} (noise {plain(noise, 3)})")
        facts.append((str(channel), ": ".join(words)))
    facts += [("note", str(note)) for note in document.get("input_findings") or ()]
    next_runs = document.get("next_experiments") or []
    if next_runs:
        facts.append(("to measure next", counted(len(next_runs), "run")))
    return card(f"Diagnosis of {document.get('campaign', '')}", facts, causes_frame(document).drop(columns="verdict"))


@styled
def plot_diagnosis(document: Mapping[str, Any]) -> Figure:
    """The error on unseen runs before and after the extension, beside the noise, a panel for each channel."""
    gain = gain_frame(document)
    figure = notebook_figure(4.4 * max(len(gain), 1), 2.4)
    panels = figure.subplots(1, max(len(gain), 1), squeeze=False)[0]
    for axes, (channel, row) in zip(panels, gain.iterrows(), strict=False):
        values = [row["held_out_rmse_before"], row["held_out_rmse_after"]]
        known = [np.nan if value is None else float(value) for value in values]
        axes.barh(["plain", "with its causes"], known, color=(ORANGE, BLUE), height=0.55)
        if row["noise_floor"] is not None:
            axes.axvline(float(row["noise_floor"]), color=INK, lw=1.0, label="noise")
            axes.legend(loc="best")
        axes.invert_yaxis()
        axes.set_xlabel(f"error on unseen runs, {row['unit']}")
        axes.set_title(literal(f"{channel}: {document['channels'][channel]['verdict']}"))
    return figure


def plan_frame(runs: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """One row for each run to record: airs and airflow in the terms of run.json, expected evidence and why."""
    import pandas as pd

    return pd.json_normalize([dict(run) for run in runs])


def plan_card(runs: Sequence[Mapping[str, Any]], advice: Sequence[str], stands: Sequence[tuple[str, str]] = ()) -> str:
    """Where the goals stand, the runs to record next, and what else to do."""
    return card("To record next", [*stands, *(("to do", sentence) for sentence in advice)], plan_frame(runs))


def _airs(run: Mapping[str, Any]) -> str:
    """From which air to which a run goes, in a line."""

    def air(side: str) -> str:
        stated = run.get(side) or {}
        known = ((stated.get("temperature_c"), "°C"), (stated.get("humidity_percent"), "%RH"))
        return " ".join(f"{value:.3g} {unit}" for value, unit in known if value is not None)

    flow = run.get("airflow_m_s")
    return f"{air('source')} → {air('destination')}" + ("" if flow is None else f", {flow:g} m/s")


@styled
def plot_plan(runs: Sequence[Mapping[str, Any]], reason: str = "") -> Figure:
    """What each proposed run is expected to bring to the goals, or between the explanations that are tied."""
    figure = notebook_figure(8.0, 1.2 + 0.35 * max(len(runs), 1))
    axes = figure.subplots()
    if not runs:
        axes.axis("off")
        axes.text(0.0, 0.5, literal(reason or NOTHING_TIED), va="center", wrap=True)
        axes.set_title("nothing more to record" if reason else "nothing is tied")
        return figure
    worth = any("expected_worth" in run for run in runs)
    brings = [float(run.get("expected_worth" if worth else "expected_evidence") or np.nan) for run in runs]
    axes.barh(range(len(runs)), brings, color=BLUE, height=0.55)
    axes.set_yticks(range(len(runs)), [f"{i}  {_airs(run)}" for i, run in enumerate(runs, start=1)])
    axes.invert_yaxis()
    axes.set_xlabel("what it is worth, in goals" if worth else "expected ln E between what is tied")
    axes.set_title("runs to record next, the first first")
    return figure


def flight_frame(flight: Flight, corrected: Corrected) -> pd.DataFrame:
    """Readings and corrected values of a flight row by row, columns as in the file; flags joined by "|".

    Pressure and position follow where the log has them.
    """
    import pandas as pd

    return pd.DataFrame(
        {
            "time_s": flight.time_s,
            "temperature_c": flight.temperature_c,
            "humidity_percent": flight.humidity_percent,
            "temperature_corrected_c": corrected.temperature_c,
            "temperature_uncertainty_k": corrected.temperature_uncertainty_k,
            "humidity_corrected_percent": corrected.humidity_percent,
            "humidity_uncertainty_percent": corrected.humidity_uncertainty_percent,
            "flags": corrected.flag_texts(),
        }
        | {
            name: values
            for name in PLACES
            if (values := getattr(flight, name)) is not None and np.isfinite(values).any()
        }
    )


def flight_dataset(flight: Flight, corrected: Corrected) -> xr.Dataset:
    """The same as labelled arrays over time with units and, where CF has them, standard names; a mask for each flag."""
    xarray = require_xarray()
    units = {"_c": "degC", "_k": "K", "_percent": "%"}
    standard = {"temperature_corrected_c": "air_temperature", "humidity_corrected_percent": "relative_humidity"}
    frame = flight_frame(flight, corrected)
    variables = {}
    for name in frame.columns.drop(["time_s", "flags", *PLACES], errors="ignore"):
        attributes = {"units": next(unit for ending, unit in units.items() if name.endswith(ending))}
        if name in standard:
            attributes["standard_name"] = standard[name]
        variables[name] = ("time", frame[name].to_numpy(), attributes)
    for channel, unit, ending in (("temperature", "K", "k"), ("humidity", "%", "percent")):
        if channel in corrected.common:
            common = corrected.common[channel]
            sigma = frame[f"{channel}_uncertainty_{ending}"].to_numpy()
            independent = np.sqrt(np.maximum(sigma**2 - common**2, 0.0))
            after = {"units": unit, "independent_after_s": f"{corrected.independent_after_s[channel]:.4g}"}
            variables[f"{channel}_uncertainty_independent_{ending}"] = ("time", independent, after)
            variables[f"{channel}_uncertainty_common_{ending}"] = ("time", common, {"units": unit})
    for name, unit in PLACES.items():
        if name in frame:
            variables[name] = ("time", frame[name].to_numpy(), {"units": unit})
    variables |= {f"flag_{name}": ("time", mask, {}) for name, mask in corrected.flags.items()}
    return xarray.Dataset(variables, {"time": ("time", flight.time_s, {"units": "s"})})


def flight_facts(flight: Flight, corrected: Corrected) -> list[tuple[str, str]]:
    """How many rows, and by how much each channel was corrected."""
    facts = [("rows", str(flight.time_s.size))]
    changed = {one.name: one for one in changes_of(flight, corrected)}
    for name in (one.name for one in channels_of(flight, corrected)):
        if (one := changed.get(name)) is not None:
            sigma = f"standard uncertainty {plain(one.standard_uncertainty, 2)} {one.unit}"
            facts.append((name, f"changed by up to {plain(one.most, 3)} {one.unit}, {sigma}"))
        else:
            facts.append((name, "not corrected"))
    return facts


def flight_card(flight: Flight, corrected: Corrected) -> str:
    """How long the flight is, by how much it was corrected, what the correction had to say."""
    facts = [*flight_facts(flight, corrected), *(("note", note) for note in corrected.notes)]
    return card("Corrected flight", facts, flight_frame(flight, corrected), rows=5)
