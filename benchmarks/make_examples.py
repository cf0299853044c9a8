"""Makes the samples of data/examples that are files: a log with steps, and one flight as CSV, netCDF and .bin.

The log: a thermometer of 4 s and a hygrometer of 9 s (one lag each), carried four times between a room and a humid box
of its temperature, and four times between the room and a warm, dry box. The flight: up through an
inversion and down again, read by sensors with a known profile. All of it is simulated; the seeds are fixed. The docs'
picture of a flight is drawn from it.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pandas as pd
from scipy.signal import lfilter

import shockrig
from shockrig.analysis.flight.simulated.sensor import fly
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import Weather, inversion
from shockrig.analysis.physics.humidity import saturation_pressure_hpa
from shockrig.files.figures import figure_bytes
from shockrig.files.profile import write_profile

OUT = Path(__file__).parent.parent / "data" / "examples"
PICTURE = OUT.parent.parent / "docs" / "images" / "flight_corrected.png"
ROOM, HUMID_BOX, WARM_BOX = (22.0, 40.0), (22.0, 75.0), (35.0, 19.5)  # degC, %RH; the warm one has the room's vapour
TAU_S = (4.0, 9.0)
FINE_S = 0.01
BEGAN = datetime(2026, 5, 5, 6, 30, tzinfo=UTC)
LATITUDE, LONGITUDE, GROUND_M = 52.21, 14.12, 73.0
GPS_EPOCH = datetime(1980, 1, 6, tzinfo=UTC)
LEAP_S, WEEK_S = 18.0, 604_800.0
MOST_ROWS_S = 0.2  # from row to row of the flight


def main() -> None:
    """Write all of them."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=OUT, help="folder (data/examples)")
    out = parser.parse_args().out
    steps().to_csv(out / "steps.csv", index=False)
    profile = replace(
        typical_profile(bead_t98_s=6.0, film_t98_s=25.0),
        provenance={"kind": "made up for the example flight, not measured"},
    )
    write_profile(profile, out / "profile.json")
    flown = fly(up_and_down(), profile, 7)
    keep = slice(None, None, round(MOST_ROWS_S / 0.1))
    log, truth = (frame.iloc[keep].reset_index(drop=True) for frame in (flown.log, flown.truth))
    flight = pd.DataFrame(
        {
            "time": [f"{BEGAN + timedelta(seconds=float(t)):%Y-%m-%dT%H:%M:%S.%f}"[:-3] + "Z" for t in log["time_s"]],
            "temperature_c": log["temperature_c"].round(3),
            "humidity_percent": log["humidity_percent"].round(3),
            "airspeed_m_s": log["airspeed_m_s"].round(2),
            "pressure_hpa": log["pressure_hpa"].round(2),
            "altitude_m": (GROUND_M + log["altitude_m"]).round(2),
            "latitude_deg": (LATITUDE + 2e-6 * np.sin(0.1 * log["time_s"])).round(7),
            "longitude_deg": (LONGITUDE + 3e-6 * np.cos(0.1 * log["time_s"])).round(7),
        }
    )
    flight.to_csv(out / "flight.csv", index=False)
    truth.assign(time=flight["time"])[["time", "temperature_c", "humidity_percent"]].round(4).to_csv(
        out / "truth.csv", index=False
    )
    seconds = log["time_s"].to_numpy()
    write_netcdf(out / "flight.nc", flight, seconds)
    write_bin(out / "flight.bin", flight, seconds)
    if out == OUT:
        corrected = shockrig.correct(out / "flight.csv", out / "profile.json")
        PICTURE.write_bytes(figure_bytes(corrected.plot("altitude"), dpi=100))


def steps() -> pd.DataFrame:
    """Eight transfers, each once both sensors have settled; a reading every half second."""
    random = np.random.default_rng(29)
    time_s = np.arange(0.0, 900.0, 0.5)
    at_s = 60.0 + 100.0 * np.arange(8) + random.uniform(-3.0, 3.0, 8)
    places = [ROOM, HUMID_BOX, ROOM, HUMID_BOX, ROOM, WARM_BOX, ROOM, WARM_BOX, ROOM]
    fine_s = np.arange(0.0, 900.0, FINE_S)
    place = np.array(places)[np.searchsorted(at_s, fine_s, side="right")]
    temperature = lagged(place[:, 0], TAU_S[0])
    # The film takes up by the relative humidity at its own temperature, which is the probe's.
    vapour_hpa = 0.01 * place[:, 1] * saturation_pressure_hpa(place[:, 0])
    humidity = lagged(100.0 * vapour_hpa / saturation_pressure_hpa(temperature), TAU_S[1])
    values = [np.interp(time_s, fine_s, one) for one in (temperature, humidity)]
    stamps = [f"{BEGAN + timedelta(seconds=float(t)):%Y-%m-%d %H:%M:%S.%f}"[:-5] for t in time_s]
    return pd.DataFrame(
        {
            "Time (UTC)": stamps,
            "Probe T (degC)": np.round(values[0] + random.normal(0.0, 0.03, time_s.size), 2),
            "Probe RH (%)": np.round(values[1] + random.normal(0.0, 0.1, time_s.size), 2),
        }
    )


def lagged(air: np.ndarray, tau_s: float) -> np.ndarray:
    """One first-order lag behind an air that stands still between the instants of the fine clock, FINE_S apart."""
    share = 1.0 - np.exp(-FINE_S / tau_s)
    return np.asarray(lfilter([0.0, share], [1.0, share - 1.0], air - air[0]) + air[0])


def up_and_down() -> Weather:
    """Up through an inversion with some turbulence, and down again through the same air."""
    up = inversion(
        np.random.default_rng(3), top_m=450.0, base_m=180.0, depth_m=30.0, turbulence_k=0.08, turbulence_percent=0.4
    )
    step_s = float(up.time_s[1] - up.time_s[0])
    turned: dict[str, Any] = {"time_s": np.arange(2 * up.time_s.size - 1) * step_s}
    for name in ("temperature_c", "humidity_percent", "airspeed_m_s", "pressure_hpa", "altitude_m"):
        values = getattr(up, name)
        turned[name] = np.concatenate([values, values[-2::-1]])
    return replace(up, **turned)


def write_netcdf(path: Path, flight: pd.DataFrame, seconds: np.ndarray) -> None:
    """By CF standard names, as other programs write flights."""
    named = {
        "temperature_c": ("air_temperature", "degC"),
        "humidity_percent": ("relative_humidity", "%"),
        "pressure_hpa": ("air_pressure", "hPa"),
        "altitude_m": ("altitude", "m"),
        "latitude_deg": ("latitude", "degrees_north"),
        "longitude_deg": ("longitude", "degrees_east"),
    }
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("time", seconds.size)
        clock = file.createVariable("time", "f8", ("time",), zlib=True)
        clock.units, clock.standard_name = f"seconds since {BEGAN:%Y-%m-%d %H:%M:%S}", "time"
        clock[:] = seconds
        for column, (standard, unit) in named.items():
            kind = "f8" if standard in ("latitude", "longitude") else "f4"
            variable = file.createVariable(standard, kind, ("time",), zlib=True)
            variable.units, variable.standard_name = unit, standard
            variable[:] = flight[column].to_numpy()


def write_bin(path: Path, flight: pd.DataFrame, seconds: np.ndarray) -> None:
    """ArduPilot's dataflash log by pymavlink's own packing of its messages."""
    from pymavlink import DFReader  # type: ignore[import-untyped]

    formats = {
        "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
        "HYGR": (130, "QBff", "TimeUS,Id,Humidity,Temp"),
        "TEMP": (131, "QBff", "TimeUS,Inst,Temp,Raw"),
        "BARO": (132, "QBff", "TimeUS,I,Alt,Press"),
        "ARSP": (134, "Qf", "TimeUS,Airspeed"),
        "GPS": (133, "QBBIHLLf", "TimeUS,I,Status,GMS,GWk,Lat,Lng,Alt"),
    }
    size = {"Q": 8, "B": 1, "f": 4, "I": 4, "H": 2, "L": 4, "n": 4, "N": 16, "Z": 64}
    made = {
        name: DFReader.DFFormat(kind, name, 3 + sum(size[c] for c in form), form, columns)
        for name, (kind, form, columns) in formats.items()
    }

    def packed(name: str, *values: object) -> bytes:
        return bytes(DFReader.DFMessage(made[name], list(values), True, None).get_msgbuf())

    content = [packed("FMT", f.type, f.len, f.name, f.format, ",".join(f.columns)) for f in made.values()]
    since_epoch_s = (BEGAN - GPS_EPOCH).total_seconds() + LEAP_S
    for number, (row, second) in enumerate(zip(flight.itertuples(), seconds.tolist(), strict=True)):
        us = int(5e6 + 1e6 * second)
        content.append(packed("TEMP", us, 0, row.temperature_c, 0.0))
        content.append(packed("HYGR", us, 0, row.humidity_percent, row.temperature_c))
        if number % 5 == 0:
            week, ms = divmod(since_epoch_s + second, WEEK_S)
            place = round(1e7 * row.latitude_deg), round(1e7 * row.longitude_deg)
            content.append(packed("BARO", us, 0, row.altitude_m - GROUND_M, 100.0 * row.pressure_hpa))
            content.append(packed("ARSP", us, row.airspeed_m_s))
            content.append(packed("GPS", us, 0, 3, round(1e3 * ms), int(week), *place, row.altitude_m))
    path.write_bytes(b"".join(content))


if __name__ == "__main__":
    main()
