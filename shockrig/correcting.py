"""`shockrig.correct`: a flight, or a path of one, and what comes of it."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shockrig.analysis.flight.correct import correct as _correct
from shockrig.channels import Channels, of_profile
from shockrig.files import result_views as views
from shockrig.files.fleet_file import Fleet
from shockrig.files.flight import Corrected, Flight
from shockrig.files.flight_figure import plot_flight
from shockrig.files.profile import Profile, read_profile
from shockrig.files.readings_figure import Against
from shockrig.flights import with_words
from shockrig.given import PathLike, WithProfile
from shockrig.protocols.flight_clock import on_clock
from shockrig.protocols.flight_logs import named_both
from shockrig.remedies import as_python, in_python

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class CorrectedFlight:
    """A flight and its correction.

    Attributes
    ----------
    flight : Flight
        The readings.
    result : Corrected
        Corrected values, one standard uncertainty each, flags, and notes in plain words.
    profile : Profile
        Of the sensors that it was corrected with.
    """

    flight: Flight
    result: Corrected
    profile: Profile

    @property
    def notes(self) -> tuple[str, ...]:
        """What the correction had to say."""
        return self.result.notes

    def to_frame(self) -> pd.DataFrame:
        """Readings and corrected values row by row, columns as in the file that `shockrig correct` writes."""
        return views.flight_frame(self.flight, self.result)

    def to_xarray(self) -> xr.Dataset:
        """The same as labelled arrays over time, with units and CF standard names."""
        return views.flight_dataset(self.flight, self.result)

    def plot(self, against: Against = "time") -> Figure:
        """Reading and corrected value against "time" or "altitude", with its 95 % band.

        Raises
        ------
        InputError
            The log has no altitude that changes.
        """
        return plot_flight(self.flight, self.result, against)

    def __repr__(self) -> str:
        said = [f"{name} {words}" for name, words in views.flight_facts(self.flight, self.result)]
        return f"<CorrectedFlight: {'; '.join(said)}>"

    def _repr_html_(self) -> str:
        return views.flight_card(self.flight, self.result)


def correct(
    flight: pd.DataFrame | Flight | PathLike,
    profile: Profile | WithProfile | Fleet | PathLike,
    *,
    method: str = "smoother",
    columns: Mapping[str, str] | None = None,
    map: PathLike | None = None,
    channels: Channels = None,
    clock_s: float | None = None,
    **settings: float | None,
) -> CorrectedFlight:
    """Correct a flight's temperature and humidity for the lag of the sensors that flew.

    A flight that does not fit into memory is corrected from file to file by the command `shockrig correct`.

    Parameters
    ----------
    flight : DataFrame, Flight or path
        A log as `read_flight` reads it: CSV, netCDF, ArduPilot's .bin, any text file by a map, or a DataFrame, whose
        columns are recognised by their names as a file's are.
    profile : Profile, Characterized, Fleet or path
        Of the sensors that flew, or a result that holds it as `profile`; a channel that it lacks is given as it came
        and flagged `not_corrected`. A fleet stands for one of its sensors that nobody has characterized.
    method : {"smoother", "inverse", "paper"}
        The optimal smoother, or the published inverse, corrected or as printed.
    columns : mapping, optional
        Quantity ("time", "temperature", "humidity", "airspeed", "die", "pressure", "altitude", "latitude",
        "longitude") -> the column's name where it is not recognised.
    map : path, optional
        A map (shock-map/1) by which any text log is read, or the name of one that ships.
    channels : {"temperature", "humidity"} or several of them, optional
        What to correct; all that the profile has where it is left out.
    clock_s : float, optional
        Seconds by which the position's times are behind the readings', as `learn` finds them.
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
    if isinstance(profile, Fleet):
        profile = profile.typical()
    elif not isinstance(profile, Profile | str | os.PathLike):
        profile = profile.profile
    with as_python():
        sensors = of_profile(profile if isinstance(profile, Profile) else read_profile(profile), channels)
        rows, said = with_words(flight, columns, map)
        rows = rows if clock_s is None else on_clock(rows, clock_s)
        named = named_both(columns, None if map is None else Path(map))
        found = _correct(rows, sensors, method, named=named, **settings)
    notes = [*said, *(in_python(note) for note in found.notes)]
    for name, values in (("temperature", rows.temperature_c), ("humidity", rows.humidity_percent)):
        if getattr(sensors, name) is not None and not np.isfinite(values).any():
            notes.append(f"{name}: no column of it recognised; if there is one, columns={{{name!r}: ...}}")
    return CorrectedFlight(rows, replace(found, notes=tuple(notes)), sensors)
