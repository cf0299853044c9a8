"""Writes a campaign (`shock-campaign/1`): campaign.json, runs/ID/run.json, imet.csv, hyt.csv, air.csv.

The one writer, for the recorder, the import and the virtual benches. Every file appears whole or not at all, what is
unknown is left out, and run.json is written last: a run counts from the moment that it is there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from shockrig.files.campaign_names import CAMPAIGN_FORMAT, RUN_FORMAT, ReferenceResponse, sensor_and_probe
from shockrig.files.disk import write_whole
from shockrig.files.json_files import json_text, known

USUAL_FORM = "%.4f"  # finer than any of the sensors' own steps

Columns = Mapping[str, Sequence[float | None]]


def campaign_document(name: str, sensors: Mapping[str, Mapping[str, Any]], **more: Any) -> dict[str, Any]:
    """Content of campaign.json.

    Parameters
    ----------
    name : str
    sensors : mapping
        "imet" and/or "hyt" -> what is known of it: kind, serial, bead_radius_m or film_thickness_m, body; "imet-2"
        and "hyt-2" are those of the probe "2", and so on.
    **more
        What else a writer has to say, after that.
    """
    return {
        "format": CAMPAIGN_FORMAT,
        "name": name,
        "sensors": {key: dict(sensor) for key, sensor in sensors.items()},
        **more,
    }


def run_document(
    id_: str,
    *,
    started_at: str | None = None,
    source: Mapping[str, float] | None = None,
    destination: Mapping[str, float] | None = None,
    airflow_m_s: float | None = None,
    pressure_hpa: float | None = None,
    start_s: float | None = None,
    duration_s: float | None = None,
    reference: ReferenceResponse | Mapping[str, float] | None = None,
    **more: Any,
) -> dict[str, Any]:
    """Content of run.json; None is left out.

    Parameters
    ----------
    id_ : str
        The run's id and its folder's name.
    started_at : str, optional
        ISO 8601, UTC.
    source, destination : mapping, optional
        The two airs: temperature_c and humidity_percent, as far as they are known.
    airflow_m_s, pressure_hpa : float, optional
    start_s, duration_s : float, optional
        Of the transfer, on the clock of the CSV files.
    reference : Reference or mapping, optional
        What is known of the instrument that measured the airs; a mapping has the keys that are known.
    **more
        What else a writer has to say, after that.
    """
    return known(
        format=RUN_FORMAT,
        id=id_,
        started_at=started_at,
        source=None if source is None else dict(source),
        destination=None if destination is None else dict(destination),
        airflow_m_s=airflow_m_s,
        pressure_hpa=pressure_hpa,
        transfer=known(start_s=start_s, duration_s=duration_s) or None,
        reference=asdict(reference) if isinstance(reference, ReferenceResponse) else reference,
        **more,
    )


def table_text(columns: Columns, forms: Mapping[str, str] | None = None) -> str:
    """A CSV file: the header, then one row for each instant; an unknown value (None or NaN) is an empty cell.

    Parameters
    ----------
    columns : mapping
        Name -> values; "time_s" first, all of one length.
    forms : mapping, optional
        Name -> printf form of its cells, where it is not "%.4f".

    Raises
    ------
    ValueError
        The first column is not time_s, or they differ in length.
    """
    if next(iter(columns), None) != "time_s":
        raise ValueError(f"the first column must be time_s, not {next(iter(columns), None)!r}")
    forms = forms or {}
    cells = [_cells(values, forms.get(name, USUAL_FORM)) for name, values in columns.items()]
    return "\n".join([",".join(columns), *map(",".join, zip(*cells, strict=True))]) + "\n"


def write_run(folder: Path, document: Mapping[str, Any], tables: Mapping[str, str], *, sync: bool = False) -> None:
    """Write the files of a run into its folder, which is there.

    Parameters
    ----------
    folder : Path
    document : mapping
        From `run_document`.
    tables : mapping
        "imet", "hyt", "air", also "imet-2" -> text from `table_text`; an instrument without readings has none.
    sync : bool
        Wait for the disk.

    Raises
    ------
    ValueError
        A table that the format does not know, or a number that is not finite.
    OSError
        The disk does not take it.
    """
    unknown = sorted(name for name in tables if name != "air" and sensor_and_probe(name) is None)
    if unknown:
        raise ValueError(f"no such table of a run: {unknown[0]!r}; known are imet, hyt, air, and imet-2, hyt-2, ...")
    text = json_text(document)
    for name, table in tables.items():
        write_whole(folder / f"{name}.csv", table, sync)
    write_whole(folder / "run.json", text, sync)


def write_campaign(folder: Path, document: Mapping[str, Any], *, sync: bool = False) -> None:
    """Write campaign.json, from `campaign_document`, into the campaign's folder; errors as for `write_run`."""
    write_whole(folder / "campaign.json", json_text(document), sync)


def _cells(values: Sequence[float | None], form: str) -> list[str]:
    return ["" if value is None or value != value else form % value for value in values]
