"""Reads a campaign folder (`shock-campaign/1`: campaign.json, runs/ID/run.json, imet.csv, hyt.csv, air.csv).

Unknown keys and columns are ignored; every error names the file, the line or key, and the remedy.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shockrig.files.campaign_data import CampaignData, Run, RunAir
from shockrig.files.campaign_names import (
    BODIES,
    CAMPAIGN_FORMAT,
    DEFAULT_BODIES,
    FIRST_PROBE,
    RUN_FORMAT,
    ReferenceResponse,
    is_run_id,
    probes_of,
    read_body,
    sensor_and_probe,
    sensor_name,
)
from shockrig.files.campaign_views import campaign_card, campaign_dataset, plot_campaign
from shockrig.files.common_uncertainty import read_common
from shockrig.files.disk import is_there, shown
from shockrig.files.errors import InputError
from shockrig.files.file_table import FileTable
from shockrig.files.json_files import read_json
from shockrig.files.misspelt import CAMPAIGN_KEYS, RUN_KEYS, misspelt
from shockrig.files.numbers import counted, first_of
from shockrig.files.ranges import RANGES
from shockrig.files.traces import Trace, read_air, read_sensor

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray as xr
    from matplotlib.figure import Figure

__all__ = [
    "BODIES",
    "CAMPAIGN_FORMAT",
    "DEFAULT_BEAD_RADIUS_M",
    "DEFAULT_BODIES",
    "DEFAULT_FILM_THICKNESS_M",
    "DEFAULT_PRESSURE_HPA",
    "RUN_FORMAT",
    "RunAir",
    "Campaign",
    "ReferenceResponse",
    "Run",
    "Trace",
    "is_run_id",
    "read_campaign",
    "read_probes",
]

DEFAULT_BEAD_RADIUS_M = 4e-4
DEFAULT_FILM_THICKNESS_M = 1e-5
DEFAULT_PRESSURE_HPA = 1013.25
REMEDY = "fix or restore the file"


_REFERENCE_RANGES = {
    "temperature_time_constant_s": RANGES["reference_time_constant_s"],
    "temperature_standard_uncertainty_k": RANGES["reference_uncertainty_k"],
    "humidity_time_constant_s": RANGES["reference_time_constant_s"],
    "humidity_standard_uncertainty_percent": RANGES["reference_uncertainty_percent"],
}


@dataclass(frozen=True, repr=False)
class Campaign(CampaignData):
    """A campaign: several runs on one pair of sensors, that of the probe which was read.

    `sensors` and the runs hold that pair as "imet" and "hyt"; `name` names the probe where it is not the first.
    `bodies` maps "imet" and "hyt" to the shape that the plain model has, one of `BODIES`. `emulated` says that nothing
    of it was measured: it comes from emulated instruments. `common` is what it states of errors that all runs share;
    None where it states nothing. `sessions` are those of its recording, as campaign.json has them; `misspelt` are its
    keys that mean nothing, with the ones that they are nearly; `planned` are the ids of the runs that its plan has,
    recorded or not.
    """

    def to_xarray(self) -> xr.Dataset:
        """All readings as labelled arrays, for each sensor (run, sample), filled up with NaN; needs xarray."""
        return campaign_dataset(self)

    def plot(self, runs: Sequence[str] | None = None) -> Figure:
        """Readings against the time since the transfer; `runs` are the ids to show, all where left out."""
        return plot_campaign(self, runs)

    def __repr__(self) -> str:
        counts = {name: sum(getattr(run, name) is not None for run in self.runs) for name in ("imet", "hyt")}
        said = [f"{name} in {count}" for name, count in counts.items() if count]
        return f"<Campaign {self.name!r}: {counted(len(self.runs), 'run')}, {', '.join(said) or 'no readings'}>"

    def _repr_html_(self) -> str:
        return campaign_card(self)


def read_probes(path: str | Path) -> tuple[str, ...]:
    """The probes of a campaign, the first one first: ("1",) for most. Raises InputError as `read_campaign` does."""
    return probes_of(_read_head(Path(path)).mapping("sensors").content) or (FIRST_PROBE,)


def _read_head(folder: Path) -> FileTable:
    if not is_there(folder):
        raise InputError(f"{shown(folder)}: no such campaign folder; give the folder that holds campaign.json")
    around = next((at for at in folder.absolute().parents if is_there(at / "campaign.json")), None)
    if around is not None and not is_there(folder / "campaign.json"):
        raise InputError(f"{shown(folder)}: is only a part of a campaign; give {shown(around)}")
    if folder.is_file():
        raise InputError(
            f"{shown(folder)}: is a file; give the folder that holds campaign.json (shockrig import makes one of a log)"
        )
    remedy = "give the folder that holds a whole campaign.json"
    if not is_there(folder / "campaign.json"):
        # An import of several sensors leaves a campaign of each.
        within = [shown(one.parent) for one in sorted(folder.glob("*/campaign.json"))]
        remedy += f": {first_of(within)}" if within else ""
    return read_json(folder / "campaign.json", CAMPAIGN_FORMAT, remedy)


def read_campaign(path: str | Path, probe: str = FIRST_PROBE) -> Campaign:
    """Read and validate a campaign folder.

    Parameters
    ----------
    path : str or Path
    probe : str
        Which one, where several were recorded at once: "2" is the one with the sensors `imet-2` and `hyt-2`.

    Raises
    ------
    InputError
        A file is missing, is not of its format, or holds a value that cannot be: names file, line or key, remedy.

    Examples
    --------
    >>> import shockrig
    >>> campaign = shockrig.read_campaign(shockrig.example("plain-rough"))
    >>> len(campaign.runs)
    33
    >>> round(campaign.runs[10].destination.temperature_c), campaign.runs[10].airflow_m_s
    (20, 6.0)
    """
    folder = Path(path)
    head = _read_head(folder)
    stated = dict(head.children("sensors"))
    there = probes_of(stated)
    if probe not in (FIRST_PROBE, *there):
        raise InputError(
            f"{shown(folder / 'campaign.json')}: key sensors: no probe {shown(probe)!r}; name one of {', '.join(there)}"
        )
    sensors = {name: one for name, one in stated.items() if sensor_and_probe(name) is None}
    places = {sensor_name(name, probe): name for name in DEFAULT_BODIES}
    sensors |= {places[name]: one for name, one in stated.items() if name in places}
    its = {name: head.mapping("sensors").mapping(place) for place, name in places.items()}
    radius = its["imet"].number("bead_radius_m", RANGES["bead_radius_m"])
    thickness = its["hyt"].number("film_thickness_m", RANGES["film_thickness_m"])
    bodies = {name: read_body(its[name], name) for name in DEFAULT_BODIES}
    folders = _run_folders(folder / "runs")
    runs = tuple(_read_run(one, probe) for one in folders)
    first: dict[str, Path] = {}
    for one, run in zip(folders, runs, strict=True):
        if first.setdefault(run.id, one) != one:
            raise InputError(
                f"{shown(one / 'run.json')}: key id: {run.id!r} is the id of runs/{shown(first[run.id].name)} already; "
                "give each run its folder's name"
            )
    return Campaign(
        name=shown(str(head.get("name") or folder.name)) + ("" if probe == FIRST_PROBE else f", probe {probe}"),
        path=folder,
        sensors={name: dict(sensor.content) for name, sensor in sensors.items()},
        bead_radius_m=DEFAULT_BEAD_RADIUS_M if radius is None else radius,
        film_thickness_m=DEFAULT_FILM_THICKNESS_M if thickness is None else thickness,
        runs=runs,
        bodies=bodies,
        emulated=head.get("emulated") is True,
        probe=probe,
        common=read_common(head),
        sessions=tuple(one for one in _listed(head.get("sessions")) if isinstance(one, dict)),
        misspelt=tuple(misspelt(head.content, CAMPAIGN_KEYS)),
        planned=tuple(str(one.get("id")) for one in _listed(head.get("plan")) if isinstance(one, dict)),
    )


def _listed(value: object) -> list[Any]:
    return value if isinstance(value, list) else []


def _run_folders(runs: Path) -> list[Path]:
    """The folders that hold a run.json, in order of their names; those that begin with a dot are being written."""
    try:
        found = sorted(entry for entry in runs.iterdir() if not entry.name.startswith(".")) if is_there(runs) else []
    except OSError as error:
        raise InputError(f"{shown(runs)}: {error.strerror}; make it a folder that can be read") from None
    for entry in found:
        if entry.is_symlink() and not entry.exists():
            raise InputError(f"{shown(entry)}: is a link that leads nowhere; restore the run or take the link away")
        if entry.is_dir() and not os.access(entry, os.R_OK | os.X_OK, effective_ids=True):
            raise InputError(f"{shown(entry)}: may not be read (permission denied); make it a folder that can be read")
    folders = [entry for entry in found if is_there(entry / "run.json")]
    if not folders:
        raise InputError(f"{shown(runs)}: no runs/ID/run.json in it; record or import at least one run")
    return folders


_KNOWN_RUN_KEYS = RUN_KEYS[""] - {"irradiance_w_m2"}


def _read_run(folder: Path, probe: str) -> Run:
    head = read_json(folder / "run.json", RUN_FORMAT, REMEDY)
    transfer = head.mapping("transfer")
    pressure = head.number("pressure_hpa", RANGES["pressure_hpa"])
    return Run(
        id=_read_id(head, folder.name),
        source=_read_airs(head.mapping("source")),
        destination=_read_airs(head.mapping("destination")),
        airflow_m_s=head.number("airflow_m_s", RANGES["airflow_m_s"]),
        pressure_hpa=DEFAULT_PRESSURE_HPA if pressure is None else pressure,
        start_s=transfer.number("start_s", RANGES["time_s"]),
        duration_s=transfer.number("duration_s", RANGES["transfer_s"]),
        imet=read_sensor(folder, sensor_name("imet", probe)),
        hyt=read_sensor(folder, sensor_name("hyt", probe)),
        extra={key: value for key, value in head.content.items() if key not in _KNOWN_RUN_KEYS},
        air=read_air(folder),
        reference=_read_reference(head.mapping("reference")),
        started_at=began if isinstance(began := head.get("started_at"), str) else None,
        misspelt=tuple(misspelt(head.content, RUN_KEYS)),
        pressure_known=pressure is not None,
    )


def _read_id(head: FileTable, folder: str) -> str:
    """The run's id; its folder's name where none is given."""
    given = head.get("id")
    if given is None:
        return folder
    id_ = str(given) if isinstance(given, int) and not isinstance(given, bool) else given
    if not is_run_id(id_):
        raise head.error("id", f"a plain name, such as that of its folder ({shown(folder)})", given)
    return str(id_)


def _read_airs(air: FileTable) -> RunAir:
    return RunAir(*(air.number(name, RANGES[name]) for name in ("temperature_c", "humidity_percent")))


def _read_reference(given: FileTable) -> ReferenceResponse:
    stated = {name: given.number(name, limits) for name, limits in _REFERENCE_RANGES.items()}
    return ReferenceResponse(**{name: value for name, value in stated.items() if value is not None})
