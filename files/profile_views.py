"""How a profile shows itself: a table, labelled arrays, a card of HTML, a figure of D over temperature.

pandas, xarray and matplotlib are imported when they are asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from shockrig.files.figures import BLUE, GREY, INK, notebook_figure, styled
from shockrig.files.headline import LUMPED, headlines, time_text
from shockrig.files.numbers import plain
from shockrig.files.profile_data import HumidityProfile, ProfileData, response_columns
from shockrig.files.views import card, require_xarray

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def profile_frame(profile: ProfileData) -> pd.DataFrame:
    """One row for the bead (alpha) and one for each ambient of the film (D), with uncertainty and response times."""
    import pandas as pd

    parts = []
    if (t := profile.temperature) is not None:
        row = {
            "ambient_temperature_c": np.nan,
            "diffusivity_m2_s": t.thermal_diffusivity_m2_s.value,
            "standard_uncertainty": t.thermal_diffusivity_m2_s.standard_uncertainty,
            **response_columns(t.response_time_s),
        }
        parts.append(pd.DataFrame([row], index=["temperature"]))
    if (h := profile.humidity) is not None:
        table = h.to_frame().drop(columns="runs")
        parts.append(table.set_index(pd.Index(["humidity"] * len(table))))
    return pd.concat(parts).rename_axis("channel")


def profile_dataset(profile: ProfileData) -> xr.Dataset:
    """D(T) and the film's response times over the ambient temperature, and alpha, with units."""
    xarray = require_xarray()
    square_metre, second = {"units": "m2 s-1"}, {"units": "s"}
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {}
    if (t := profile.temperature) is not None:
        alpha = t.thermal_diffusivity_m2_s
        variables["thermal_diffusivity_m2_s"] = ((), alpha.value, square_metre)
        variables["thermal_diffusivity_standard_uncertainty"] = ((), alpha.standard_uncertainty, square_metre)
        for column, value in response_columns(t.response_time_s).items():
            variables[f"thermometer_{column}"] = ((), value, second)
    if (h := profile.humidity) is not None:
        frame, over = h.to_frame(), "ambient_temperature_c"
        coordinates[over] = (over, frame[over].to_numpy(), {"units": "degC"})
        for column, name in (("diffusivity_m2_s",) * 2, ("standard_uncertainty", "diffusivity_standard_uncertainty")):
            variables[name] = (over, frame[column].to_numpy(), square_metre)
        for column in response_columns(None):
            variables[column] = (over, frame[column].to_numpy(), second)
    return xarray.Dataset(variables, coordinates)


def profile_card(profile: ProfileData, notes: Sequence[str] = ()) -> str:
    """What a profile knows: headlines, noise, the effects that it carries, the table; `notes` are sentences to add."""
    facts = headlines(profile)
    if (t := profile.temperature) is not None:
        facts += [("noise of the bead", f"{plain(t.noise_k, 2)} K")] if t.noise_k is not None else []
    if (h := profile.humidity) is not None and h.noise_percent is not None:
        facts.append(("noise of the film", f"{plain(h.noise_percent, 2)} %RH"))
    for part, words in ((profile.temperature, "bead"), (profile.humidity, "film")):
        if part is not None and part.effects:
            facts.append((f"effects of the {words}", ", ".join(effect.effect for effect in part.effects)))
    facts += [("note", note) for note in notes]
    return card("Sensor profile", facts, profile_frame(profile))


@styled
def plot_profile(profile: ProfileData) -> Figure:
    """Response times with their uncertainty, and D over temperature as it is interpolated where a film has a table."""
    h, t = profile.humidity, profile.temperature
    table = h is not None and len(h.diffusivity_table) > 1
    lumped = profile.bodies["hyt"] == LUMPED
    figure = notebook_figure(9.2 if table else 6.0, 3.6)
    axes = figure.subplots(1, 2 if table else 1, squeeze=False)[0]
    if table and h is not None:
        draw_diffusivity(axes[0], h, lumped)
        axes[0].set_title(_bead_title(profile))
        _over_temperature(axes[1], h)
        return figure
    rows = {}
    if t is not None and t.response_time_s is not None:
        rows["thermometer"] = t.response_time_s
    if h is not None and (times := h.diffusivity_table[0].response_time_s) is not None:
        rows["hygrometer"] = times
    if rows:
        _times_as_bars(axes[0], rows)
    else:
        axes[0].axis("off")
        axes[0].text(0.0, 0.5, "\n".join(f"{name}: {value}" for name, value in headlines(profile)))
    axes[0].set_title(_bead_title(profile) or headlines(profile)[0][0] + ": " + headlines(profile)[0][1])
    return figure


def _bead_title(profile: ProfileData) -> str:
    """What is known of the thermometer, in a line."""
    if (t := profile.temperature) is None:
        return ""
    name, value = headlines(profile)[0]
    times = t.response_time_s
    rest = "" if times is None or profile.bodies["imet"] == LUMPED else f", t63 {time_text(times, 0)}"
    return f"{name}: {value}{rest}"


def draw_diffusivity(axes: Axes, h: HumidityProfile, lumped: bool) -> None:
    """D (of a lumped sensor tau) over temperature with its uncertainty, and as it is interpolated."""
    table = h.to_frame()
    at_c, value, sigma = (
        table[name].to_numpy() for name in ("ambient_temperature_c", "diffusivity_m2_s", "standard_uncertainty")
    )
    fine_c = np.linspace(at_c[0], at_c[-1], 200)
    between, spread = h.diffusivity_m2_s(fine_c)
    if lumped:
        square = h.film_thickness_m**2
        value, sigma = square / value, square * sigma / value**2
        between, spread = square / between, square * spread / between**2
    scale = 1.0 if lumped else 1e12
    axes.fill_between(fine_c, scale * (between - 2 * spread), scale * (between + 2 * spread), color=BLUE, alpha=0.2)
    axes.plot(fine_c, scale * between, color=BLUE, lw=1.0)
    axes.errorbar(
        at_c, scale * value, 2 * scale * sigma, fmt="o", color=BLUE, capsize=2, label="hygrometer, ± 2 standard unc."
    )
    axes.set_ylabel("tau, s" if lumped else "D, 10⁻¹² m²/s")
    axes.set_xlabel("ambient temperature, °C")
    axes.legend(loc="best")


def _over_temperature(axes: Axes, h: HumidityProfile) -> None:
    table = h.to_frame()
    at_c = table["ambient_temperature_c"].to_numpy()
    for name, colour in zip(("t63", "t90", "t98"), (BLUE, INK, GREY), strict=True):
        seconds, spread = (table[f"{name}{end}"].to_numpy() for end in ("_s", "_standard_uncertainty_s"))
        if np.isfinite(seconds).any():
            axes.errorbar(
                at_c, seconds, 2 * np.nan_to_num(spread), fmt="o-", color=colour, capsize=2, label=f"hygrometer, {name}"
            )
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("{x:g}")
    axes.set_ylabel("response time, s")
    axes.set_xlabel("ambient temperature, °C")
    if axes.lines:
        axes.legend(loc="best")


def _times_as_bars(axes: Axes, rows: Mapping[str, Any]) -> None:
    """t63, t90 and t98 of each sensor with two standard uncertainties."""
    labels, seconds, spread = [], [], []
    for sensor, times in rows.items():
        columns = response_columns(times)
        for place, name in enumerate(("t63", "t90", "t98")):
            labels.append(f"{sensor}, {name}: {time_text(times, place)}")
            seconds.append(columns[f"{name}_s"])
            spread.append(2 * np.nan_to_num(columns[f"{name}_standard_uncertainty_s"]))
    axes.barh(labels, seconds, xerr=spread, color=BLUE, height=0.55, capsize=2)
    axes.invert_yaxis()
    axes.set_xlim(left=0.0)
    axes.set_xlabel("response time, s (± 2 standard uncertainties)")
