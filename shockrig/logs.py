"""`shockrig.import_log`: a logger's file, or a DataFrame, made into a campaign as `shockrig import` makes it."""

from __future__ import annotations

import json
import os
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from shockrig.campaigns import ChainedCampaign, chained
from shockrig.files.campaign import read_campaign
from shockrig.files.campaign_write import write_campaign
from shockrig.files.errors import InputError
from shockrig.flights import demand_frame, with_times
from shockrig.given import PathLike
from shockrig.protocols.folder import software_version, whole_folder
from shockrig.remedies import as_python, in_python
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.logs.first_map import look_at
from shockrig.rig.logs.log_campaigns import Imported, SensorCampaign, describe, import_logs, write_runs
from shockrig.rig.logs.map_file import parse_map, read_map
from shockrig.rig.logs.mapping import COLUMNS, FORMAT, LogMap

if TYPE_CHECKING:
    import pandas as pd

FRAME = "log.csv"  # what a DataFrame is called meanwhile
QUANTITIES = ("time", *COLUMNS)


def import_log(
    log: pd.DataFrame | PathLike | Sequence[PathLike],
    *,
    columns: Mapping[str, str] | None = None,
    map: PathLike | None = None,
    sensor: str | None = None,
    name: str | None = None,
    airflow_m_s: float | None = None,
    pressure_hpa: float | None = None,
    out: PathLike | None = None,
) -> ChainedCampaign:
    """Make a campaign of a logger's file: its columns are recognised, its steps are found, each step is a run.

    Parameters
    ----------
    log : DataFrame, path or sequence of paths
        Any text file of rows with times; several of one layout become runs of one campaign. A DataFrame's index is
        taken as a column where it has a name or holds times.
    columns : mapping, optional
        Quantity ("time", "temperature", "humidity", "die_temperature", "pressure", "airflow") -> the column's name.
        Only the columns that are named are read; left out, all are recognised by their names.
    map : path, optional
        A map (shock-map/1) that says all of it, as `shockrig import FILE --look` writes one, or the name of one that
        ships.
    sensor : str, optional
        Which one, where the log has several.
    name : str, optional
        Of the campaign.
    airflow_m_s, pressure_hpa : float, optional
        Of the air past the sensors, where no column has it.
    out : path, optional
        A new folder in which the campaign is kept; left out, it is in memory alone.

    Returns
    -------
    ChainedCampaign
        Runs with the time at which each step was seen. A sensor whose body nobody states is one first-order lag.
        `notes` say which columns, rows and steps are not used, and why.

    Raises
    ------
    InputError
        The log cannot be read, no step is seen in it, or it has several sensors and none is named.

    Examples
    --------
    >>> import shockrig
    >>> campaign = shockrig.import_log(shockrig.example("steps.csv"))
    >>> campaign
    <Campaign 'steps': 8 runs, imet in 8, hyt in 8>
    >>> table = campaign.characterize(channels="temperature").to_frame()
    >>> table.loc["temperature", ["t63_s", "t63_standard_uncertainty_s"]].astype(float).round(1).to_list()
    [4.0, 0.0]
    """
    with as_python(), tempfile.TemporaryDirectory() as temporary, _named(Path(temporary)):
        paths = _files(log, Path(temporary))
        said, seen = _map(paths, columns, map, sensor, airflow_m_s, pressure_hpa, Path(temporary))
        by_rows = map is None and bool(said.layout.only)
        imported = import_logs(paths, said, None if by_rows else sensor)
        made = [one for one in imported.campaigns if one.runs]
        if len(made) > 1:
            listed = ", ".join(repr(one.sensor) for one in made)
            raise InputError(f"{paths[0].name}: has the sensors {listed}; name one by sensor=")
        called = name or said.name or paths[0].stem
        folder = Path(temporary) / "campaign" if out is None else Path(out)
        if out is not None and folder.exists():
            raise InputError(f"out={str(out)!r}: is there already; give another name")
        _write(folder, imported, made[0], called)
        found = read_campaign(folder)
        path = found.path if out is not None else Path(called)
        notes = [in_python(said) for said in (*seen, *_remarks(imported, made[0]))]
        return chained(found, path=path, notes=tuple(notes))


@contextmanager
def _named(folder: Path) -> Iterator[None]:
    """Errors name the DataFrame and what was recognised, not the files that they are in meanwhile."""
    try:
        yield
    except (InputError, BenchError) as error:
        said = str(error).replace(str(folder / FRAME), "the DataFrame")
        raise InputError(re.sub(rf"{re.escape(str(folder))}/\S+\.toml", "what is recognised in it", said)) from error


def _files(log: pd.DataFrame | PathLike | Sequence[PathLike], folder: Path) -> list[Path]:
    if isinstance(log, str | os.PathLike):
        return [Path(log)]
    if isinstance(log, Sequence):
        if not log:
            raise InputError("log: no file is given; name a logger's file")
        return [Path(one) for one in log]
    demand_frame(log, "log", "a path, paths")
    path = folder / FRAME
    with_times(log).to_csv(path, index=False)
    return [path]


def _map(
    paths: Sequence[Path],
    columns: Mapping[str, str] | None,
    map_path: PathLike | None,
    sensor: str | None,
    airflow_m_s: float | None,
    pressure_hpa: float | None,
    folder: Path,
) -> tuple[LogMap, tuple[str, ...]]:
    """The map that is given, or one of the columns that are named, or the first map of what is recognised; in that
    case also what a first look notes of it."""
    facts = {"airflow_m_s": airflow_m_s, "pressure_hpa": pressure_hpa}
    stated = [f"{key} = {value!r}\n" for key, value in facts.items() if value is not None]
    if map_path is not None:
        if columns is not None or stated:
            raise InputError("map: says the columns and the airs itself; leave columns, airflow_m_s, pressure_hpa out")
        return read_map(Path(map_path)), ()
    if columns is None:
        seen = look_at(paths, folder / f"{paths[0].stem}.toml", sensor=sensor)
        if seen.whose and seen.whose[0] != sensor:
            raise InputError(
                f"{paths[0].name}: has the sensors {', '.join(map(repr, seen.whose))}; name one by sensor="
            )
        # the first map ends with [runs], in which the facts belong, and says of steps only what was seen
        return parse_map(seen.text + "".join(stated), seen.map.path), seen.notes
    unknown = sorted(set(columns) - set(QUANTITIES))
    if unknown or not {"temperature", "humidity"} & set(columns):
        what = f"there is no quantity {unknown[0]!r}" if unknown else "names neither temperature nor humidity"
        raise InputError(f"columns: {what}; quantities are {', '.join(QUANTITIES)}")
    lines = [f'format = "{FORMAT}"\nname = {json.dumps(paths[0].stem)}\n']
    if "time" in columns:
        lines.append(f"[log]\ntime = {json.dumps(columns['time'])}\n")
    lines.append("[sensor.sensor]\n")
    lines += [f"{key} = {json.dumps(columns[key])}\n" for key in COLUMNS if key in columns]
    return parse_map("".join([*lines, "[runs]\n", *stated]), Path("columns")), ()


def _remarks(imported: Imported, made: SensorCampaign) -> list[str]:
    """What reading the logs had to say, and the steps that made no run of the sensor."""
    said = []
    for one in imported.logs:
        doubt = [f"time: {one.log.clock.doubt}"] if one.log.clock.doubt else []
        said += [*one.log.remarks, *one.readings[made.sensor].remarks, *doubt]
    return said + [f"left out: {words}" for words in made.left_out_said]


def _write(folder: Path, imported: Imported, made: SensorCampaign, called: str) -> None:
    with whole_folder(folder) as partial:
        write_runs(partial / "runs", made.runs)
        write_campaign(partial, describe(made, imported, called, software_version()))
