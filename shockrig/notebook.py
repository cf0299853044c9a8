"""What `import shockrig` offers beside reading: characterize, diagnose, correct, as functions of data or of paths."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from shockrig.analysis.characterization.characterize import characterize as _characterize
from shockrig.analysis.characterization.extension import Extension, extension_of, read_extension
from shockrig.analysis.characterization.to_profile import to_profile
from shockrig.analysis.diagnosis.diagnose import diagnose as _diagnose
from shockrig.analysis.diagnosis.export import stated_cause, to_json
from shockrig.analysis.diagnosis.remainder import Tolerance
from shockrig.analysis.flight.correct import correct as _correct
from shockrig.analysis.report.next_time import next_time
from shockrig.files.campaign import Campaign, read_campaign
from shockrig.files.errors import InputError
from shockrig.files.flight import Flight, read_layout
from shockrig.files.flight_cells import joined, read_blocks
from shockrig.files.flight_rows import BLOCK_ROWS, to_flight
from shockrig.files.profile import Profile, read_profile
from shockrig.results import Characterized, CorrectedFlight, Diagnosed, Planned

if TYPE_CHECKING:
    import pandas as pd

PathLike = str | os.PathLike[str]
ChannelName = Literal["temperature", "humidity"]
TRACES: dict[ChannelName, str] = {"temperature": "imet", "humidity": "hyt"}
Progress = Callable[[str], None]


def example(name: str = "plain-rough") -> Path:
    """The folder of a campaign that ships with the package.

    Parameters
    ----------
    name : {"plain-rough", "ordinary-bench"}
        Sensors as the plain model has them, with a rough bench's noise; or with what a real bench ordinarily has: an
        air film around the bead, a transfer of half a second, heat through the support, a film read at its own die's
        temperature.

    Raises
    ------
    InputError
        No campaign of that name ships.

    Examples
    --------
    >>> import shockrig
    >>> shockrig.example("plain-rough").name
    'plain-rough'
    """
    from importlib.resources import files

    folder = Path(str(files("shockrig.data") / "examples"))
    names = sorted(entry.name for entry in folder.iterdir() if (entry / "campaign.json").exists())
    if name not in names:
        raise InputError(f"no example {name!r}; give one of {', '.join(names)}")
    return folder / name


def characterize(
    campaign: Campaign | PathLike,
    *,
    seed: int = 0,
    extend: Diagnosed | PathLike | None = None,
    progress: Progress | None = None,
) -> Characterized:
    """Fit alpha of the bead and D(T) of the film to a campaign.

    Parameters
    ----------
    campaign : Campaign or path
        A campaign, or the folder that holds campaign.json.
    seed : int
        Of the differential evolution that finds the start of the fit.
    extend : Diagnosed or path, optional
        A diagnosis (or its diagnosis.json) whose causes the model shall carry; alpha and D are then the material's, no
        longer effective numbers.
    progress : function of a sentence, optional

    Returns
    -------
    Characterized

    Raises
    ------
    InputError
        The campaign cannot be read, or neither sensor has a run that can be used; the reasons are named.

    See Also
    --------
    diagnose : what the model that is fitted here gets wrong.

    Examples
    --------
    >>> import shockrig
    >>> found = shockrig.characterize(shockrig.example("plain-rough"))
    >>> alpha = found.profile.temperature.thermal_diffusivity_m2_s
    >>> print(f"{alpha.value:.1e} m2/s, known to {100 * alpha.standard_uncertainty / alpha.value:.1f} %")
    8.3e-08 m2/s, known to 0.1 %
    >>> film = found.to_frame().loc["humidity", ["ambient_temperature_c", "t63_s"]]
    >>> film.round(0).head(3).to_numpy().tolist()
    [[0.0, 5.0], [10.0, 4.0], [20.0, 3.0]]
    """
    result = _characterize(_campaign(campaign), seed=seed, extensions=_extensions(extend), progress=progress)
    return Characterized(to_profile(result, {"software": f"shockrig {_version()}"}), result)


def diagnose(
    campaign: Campaign | PathLike,
    *,
    channels: Iterable[ChannelName] = ("temperature", "humidity"),
    tolerance_k: float = 0.03,
    tolerance_percent: float = 0.2,
    progress: Progress | None = None,
) -> Diagnosed:
    """Say what the plain model of a campaign's sensors gets wrong, which effects cause it, and what is gained by them.

    Parameters
    ----------
    campaign : Campaign or path
        A campaign, or the folder that holds campaign.json.
    channels : iterable of {"temperature", "humidity"}
        Which sensors to look at.
    tolerance_k, tolerance_percent : float
        From which size on what is left spoils a verdict; by default a tenth of the sensors' stated accuracy.
    progress : function of a sentence, optional

    Returns
    -------
    Diagnosed

    Raises
    ------
    InputError
        The campaign cannot be read, or no sensor has enough runs that can be used.

    Examples
    --------
    Sensors in which nothing is hidden; of those of `example("ordinary-bench")` the bead is explained by three effects.

    >>> import shockrig
    >>> found = shockrig.diagnose(shockrig.example("plain-rough"), channels=["temperature"])
    >>> found.verdicts
    {'temperature': 'adequate'}
    >>> found.gain.loc["temperature", ["held_out_rmse_before", "noise_floor"]].astype(float).round(3).to_list()
    [0.023, 0.023]
    """
    recorded, wanted = _campaign(campaign), set(channels)
    for name, trace in TRACES.items():
        if name not in wanted:
            dropped: dict[str, Any] = {trace: None}
            recorded = replace(recorded, runs=tuple(replace(run, **dropped) for run in recorded.runs))
    tolerance = Tolerance(tolerance_k, tolerance_percent)
    result = _diagnose(recorded, progress=progress or (lambda text: None), tolerance=tolerance)
    return Diagnosed(to_json(result), result)


def plan(found: Diagnosed) -> Planned:
    """Say which runs to record next, so that what a diagnosis could not tell can be told.

    Parameters
    ----------
    found : Diagnosed
        What `diagnose` returned.

    Returns
    -------
    Planned
        Runs that would tell tied explanations apart, and advice on what was not recorded.

    Examples
    --------
    Five ambients, three airflows, both directions and repeats leave nothing tied where nothing is hidden.

    >>> import shockrig
    >>> found = shockrig.diagnose(shockrig.example("plain-rough"), channels=["temperature"])
    >>> shockrig.plan(found).runs
    ()
    """
    channels = [channel.problem.channel for channel in found.result.channels]
    return Planned(tuple(found.result.next_experiments), tuple(next_time(channels)))


def correct(
    flight: pd.DataFrame | Flight | PathLike,
    profile: Profile | Characterized | PathLike,
    *,
    method: str = "smoother",
    columns: Mapping[str, str] | None = None,
    **settings: float | None,
) -> CorrectedFlight:
    """Correct a flight's temperature and humidity for the lag of the sensors that flew.

    A flight that does not fit into memory is corrected from file to file by the command `shockrig correct`.

    Parameters
    ----------
    flight : DataFrame, Flight or path
        A log: its CSV file, or a DataFrame with `time_s`, `temperature_c`, `humidity_percent` and, where known,
        `airspeed_m_s`.
    profile : Profile, Characterized or path
        Of the sensors that flew; a channel that it lacks is given as it came and flagged `not_corrected`.
    method : {"smoother", "inverse", "paper"}
        The optimal smoother, or the published inverse, corrected or as printed.
    columns : mapping, optional
        Quantity ("time", "temperature", "humidity", "airspeed", "die") -> the column's name in the file, where it is
        not recognised.
    **settings
        `cutoff_hz` of the inverses' low-pass; `temperature_noise_k`, `humidity_noise_percent` where they differ from
        the profile's.

    Returns
    -------
    CorrectedFlight

    Raises
    ------
    InputError
        The log or the profile cannot be read, the method is not known, no row can be used.

    Examples
    --------
    A bead with a time constant of a third of a second, carried through a front of 5 K:

    >>> import numpy as np
    >>> import pandas as pd
    >>> import shockrig
    >>> sensors = shockrig.characterize(shockrig.example("plain-rough"))
    >>> t63_s = sensors.profile.temperature.response_time_s.t63_s
    >>> time_s = np.arange(0.0, 60.0, 0.1)
    >>> late = np.where(time_s < 30.0, 0.0, 1.0 - np.exp(-np.maximum(time_s - 30.0, 0.0) / t63_s))
    >>> noise = 0.02 * np.random.default_rng(0).standard_normal(time_s.size)
    >>> log = pd.DataFrame({"time_s": time_s, "temperature_c": 15.0 + 5.0 * late + noise, "humidity_percent": 50.0})
    >>> done = shockrig.correct(log, sensors).to_frame().set_index("time_s")
    >>> bool(done.temperature_corrected_c[30.3] > done.temperature_c[30.3])
    True
    """
    known = {"cutoff_hz", "temperature_noise_k", "humidity_noise_percent", "lag_s"}
    if unknown := sorted(set(settings) - known):
        raise TypeError(f"correct() has no setting {unknown[0]!r}; known are {', '.join(sorted(known))}")
    rows = _flight(flight, columns)
    if isinstance(profile, Characterized):
        profile = profile.profile
    sensors = profile if isinstance(profile, Profile) else read_profile(profile)
    return CorrectedFlight(rows, _correct(rows, sensors, method, **settings))


def _campaign(campaign: Campaign | PathLike) -> Campaign:
    return campaign if isinstance(campaign, Campaign) else read_campaign(Path(campaign))


def _flight(flight: pd.DataFrame | Flight | PathLike, columns: Mapping[str, str] | None) -> Flight:
    if isinstance(flight, Flight):
        return flight
    if isinstance(flight, str | os.PathLike):
        layout = read_layout(Path(flight), columns)
        blocks = list(read_blocks(Path(flight), layout, BLOCK_ROWS))
        return to_flight(joined(blocks) if blocks else [], layout)
    import numpy as np

    given = columns or {}
    names = {
        "time": "time_s",
        "temperature": "temperature_c",
        "humidity": "humidity_percent",
        "airspeed": "airspeed_m_s",
        "die": "humidity_sensor_temperature_c",
        "pressure": "pressure_hpa",
        "altitude": "altitude_m",
        "latitude": "latitude_deg",
        "longitude": "longitude_deg",
    }
    unknown = np.full(len(flight), np.nan)
    chosen = {quantity: given.get(quantity, name) for quantity, name in names.items()}
    values = {q: flight[name].to_numpy(dtype=float) if name in flight else unknown for q, name in chosen.items()}
    if not np.isfinite(values["time"]).any():
        raise InputError(f"flight: no column {chosen['time']} with numbers; name it by columns={{'time': ...}}")
    return Flight(*values.values())


def _extensions(extend: Diagnosed | PathLike | None) -> dict[ChannelName, Extension] | None:
    """Models that carry a diagnosis's causes."""
    if extend is None:
        return None
    if not isinstance(extend, Diagnosed):
        return read_extension(Path(extend))
    return {
        found.name: extension_of([stated_cause(cause).as_effect() for cause in found.causes])
        for found in extend.result.channels
    }


def _version() -> str:
    from importlib.metadata import version

    return version("shockrig")
