"""A folder with one sound file of every kind that a user names, to damage and to run commands on."""

from __future__ import annotations

import json
import shutil
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parent.parent
GOALS = "alpha 5 %, D 5 %, minutes 60"
ROWS = 120


def sound(folder: Path) -> Path:
    """Make the folder: campaigns, flights in four forms, log, map, bench, protocol, profile, diagnosis, seal."""
    from shockrig.analysis.flight.simulated.typical import typical_profile
    from shockrig.files.profile import write_profile
    from shockrig.protocols.cli import main
    from shockrig.rig.virtual.batch import simulate_campaign
    from shockrig.rig.virtual.plans import standard_plan
    from shockrig.rig.virtual.truth import draw_truth

    folder.mkdir(parents=True)
    plan = standard_plan()
    at_20 = [run for run in plan if run.destination.temperature_c == 20.0][:6]
    runs = [replace(run, id=f"{i:04d}", duration_s=40.0) for i, run in enumerate(at_20, 1)]
    simulate_campaign(draw_truth(np.random.default_rng(4)), runs, 4, folder / "c")
    shutil.copytree(folder / "c", folder / "a")
    for run in runs[2:]:
        shutil.rmtree(folder / "a/runs" / run.id)
    for run in runs[:2]:
        (folder / "a/runs" / run.id / "air.csv").write_text(_air(run))
    assert main(["plan", str(folder / "c"), "--until", GOALS, "--out", str(folder / "n.toml")]) == 0
    for name in ("n.toml", "n.json"):
        (folder / name).unlink(missing_ok=True)
    status = main(["run", "quick", "--out", str(folder / "r"), "--seed", "2", "--operator", "fuzz"])
    assert status == 0, "the virtual bench records"
    write_profile(typical_profile(), folder / "p.json")
    (folder / "d.json").write_text(json.dumps(_diagnosis(), indent=1))
    time = 0.5 * np.arange(ROWS)
    temperature, humidity = 20.0 - 0.05 * time + 0.01 * np.sin(37 * time), 50.0 + 0.2 * time + 0.1 * np.sin(23 * time)
    table = np.column_stack([time, temperature, humidity, np.full(ROWS, 6.0), 1013.0 - time, 2.0 * time])
    head = "time_s,temperature_c,humidity_percent,airspeed_m_s,pressure_hpa,altitude_m"
    np.savetxt(folder / "f.csv", table, "%.3f", ",", header=head, comments="")
    _netcdf(folder / "f.nc", table, head.split(","))
    (folder / "f.bin").write_bytes(_dataflash(table))
    (folder / "xq.csv").write_bytes(b"XQ,095188,2407,0294,2553,2015/10/18,00:38:44,+0000000000,+0,-17000,00\r\n" * ROWS)
    (folder / "log.csv").write_text(_log())
    assert main(["import", str(folder / "log.csv"), "--look", "--out", str(folder / "look")]) == 0
    shutil.copy(next((folder / "look").glob("*.toml")), folder / "m.toml")
    shutil.rmtree(folder / "look")
    for kind, name in (("benches/virtual", "b"), ("protocols/quick", "q")):
        shutil.copy(ROOT / "data" / f"{kind}.toml", folder / f"{name}.toml")
    return folder


def _air(run) -> str:
    """A measured air of a run: the step with a lag of half a second."""
    time = np.arange(-1.0, 55.0, 0.5) + 1.0
    share = -np.expm1(-np.maximum(time - 10.5, 0.0) / 0.5)
    before, after = run.source, run.destination
    rows = (
        f"{t:.2f},{before.temperature_c + s * (after.temperature_c - before.temperature_c):.3f},"
        f"{before.humidity_percent + s * (after.humidity_percent - before.humidity_percent):.3f},6.0"
        for t, s in zip(time, share, strict=True)
    )
    return "\n".join(["time_s,temperature_c,humidity_percent,airflow_m_s", *rows, ""])


def _diagnosis() -> dict:
    estimate = {"value": 11.0, "standard_uncertainty": 0.5}
    share = {"value": 0.03, "standard_uncertainty": 0.002}
    stem = {
        "effect": "stem_conduction",
        "probability": 0.99,
        "parameters": {"fraction": share, "time_constant_s": estimate},
    }
    unlisted = {
        "behaves_as": "lag_in_series", "driver": "air_humidity", "time_constant_s": estimate, "probability": 0.9,
        "depends_on": [{"factor": "airflow", "form": "power", "value": -0.4, "standard_uncertainty": 0.1}],
        "seen_over": {"airflow_m_s": [2.5, 12.0]}, "alternatives": [],
    }  # fmt: skip
    channels = {
        "temperature": {"verdict": "explained", "causes": [stem], "indistinguishable_from": []},
        "humidity": {"verdict": "described", "causes": [], "discovered": [unlisted]},
    }
    return {"format": "shock-diagnosis/1", "campaign": "virtual", "channels": channels}


def _netcdf(path: Path, table: np.ndarray, names: list[str]) -> None:
    import netCDF4

    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("time", len(table))
        for name, column in zip(names, table.T, strict=True):
            file.createVariable(name, "f8", ("time",))[:] = column


def _dataflash(table: np.ndarray) -> bytes:
    """ArduPilot's log: 0xA3 0x95, the message's type, its fields; FMT messages say what those are."""
    formats = {
        "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
        "HYGR": (130, "QBff", "TimeUS,Id,Humidity,Temp"),
        "BARO": (132, "QBff", "TimeUS,I,Alt,Press"),
    }
    out, codes = b"", {"Q": "Q", "B": "B", "f": "f", "n": "4s", "N": "16s", "Z": "64s"}

    def message(name: str, *values: object) -> bytes:
        type_, form, _ = formats[name]
        return b"\xa3\x95" + struct.pack("<B" + "".join(codes[c] for c in form), type_, *values)

    for name, (type_, form, columns) in formats.items():
        length = 3 + struct.calcsize("<" + "".join(codes[c] for c in form))
        out += message("FMT", type_, length, name.encode(), form.encode(), columns.encode())
    for time, temperature, humidity, _, pressure, altitude in table:
        us = int(5e6 + 1e6 * time)
        out += message("HYGR", us, 0, humidity, temperature) + message("BARO", us, 0, altitude, 100.0 * pressure)
    return out


def _log() -> str:
    """Two sensors carried three times between two airs, as a spreadsheet has it."""
    time = 0.5 * np.arange(700)
    temperature, humidity = np.full(time.size, 22.0), np.full(time.size, 40.0)
    for k, at_s in enumerate((80.0, 170.0, 260.0)):
        since, sign = np.maximum(time - at_s, 0.0), 1.0 - 2.0 * (k % 2)
        temperature += sign * 13.0 * -np.expm1(-since / 2.0)
        humidity -= sign * 20.0 * -np.expm1(-since / 6.0)
    rng = np.random.default_rng(1)
    temperature, humidity = (x + s * rng.standard_normal(time.size) for x, s in ((temperature, 0.03), (humidity, 0.1)))
    rows = (f"{t:.1f},{a:.2f},{b:.2f}" for t, a, b in zip(time, temperature, humidity, strict=True))
    return "\n".join(["Time (s),Temperature (degC),RH (%)", *rows, ""])
