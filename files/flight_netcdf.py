"""Writes a corrected flight as netCDF: the same content as the CSV file, numbers as numbers, flags as bits.

CF conventions 1.11 (cfconventions.org), discrete sampling geometry "trajectory" without positions.
"""

from __future__ import annotations

import contextlib
import os
import re
from pathlib import Path
from typing import Any

import numpy as np

from shockrig.files.disk import beside, demand_text_name, shown
from shockrig.files.flight import FLAGS, Corrected, Flight, FlightColumns
from shockrig.files.flight_cells import Rows, numbers_of
from shockrig.files.flight_rows import numeric_places
from shockrig.files.unit_names import squeeze

CHANNELS = (("temperature", "K"), ("humidity", "%"))
SUFFIX = {"K": "k", "%": "percent"}
PARTS = {
    "independent": "the part that is independent from sample to sample and shrinks in a mean",
    "common": "the part that is common to the flight and does not",
}
EARLIEST_DATE_S = 5e8  # a clock that says more counts from 1970 (this is 1985)


class NetcdfWriter:
    """As CsvWriter; text columns are strings, flags are bits of one byte."""

    STANDARD = {
        "temperature": ("temperature_c", "degC", "temperature of the bead as read"),
        "humidity": ("humidity_percent", "%", "relative humidity of the film as read"),
        "airspeed": ("airspeed_m_s", "m s-1", "speed of the air past the probes"),
        "pressure": ("pressure_hpa", None, "air pressure"),  # units as the column's name says
        "altitude": ("altitude_m", None, "altitude"),
        "latitude": ("latitude_deg", "degrees_north", "latitude"),
        "longitude": ("longitude_deg", "degrees_east", "longitude"),
        "die": ("humidity_sensor_temperature_c", "degC", "temperature of the humidity sensor's die"),
    }
    STANDARD_NAMES = {
        "pressure": "air_pressure",
        "altitude": "altitude",
        "latitude": "latitude",
        "longitude": "longitude",
        "airspeed": "platform_speed_wrt_air",
    }
    ENDINGS = {
        "pressure": {"hpa": "hPa", "mbar": "hPa", "pa": "Pa", "pascal": "Pa"},
        "altitude": {"m": "m", "mmsl": "m"},
    }
    # as CF spells what maps write otherwise
    UDUNITS = {
        "fraction": "1", "mmHg": "mm_Hg", "inHg": "in_Hg", "km/h": "km h-1", "knots": "knot", "mph": "mile h-1",
        "cdegC": "0.01 degC",
    }  # fmt: skip
    CORRECTED = (
        ("temperature_corrected_c", "temperature_c", "air_temperature", "degC", "air temperature, sensor lag undone"),
        (
            "temperature_uncertainty_k",
            "temperature_uncertainty_k",
            "air_temperature standard_error",
            "K",
            "standard uncertainty",
        ),
        (
            "humidity_corrected_percent",
            "humidity_percent",
            "relative_humidity",
            "%",
            "relative humidity, sensor lag undone",
        ),
        (
            "humidity_uncertainty_percent",
            "humidity_uncertainty_percent",
            "relative_humidity standard_error",
            "%",
            "standard uncertainty",
        ),
    )

    def __init__(self, path: Path, layout: FlightColumns, history: str) -> None:
        import netCDF4

        demand_text_name(path, "give another --out")
        self.path, self._temporary = path, beside(path)
        self._layout = layout
        self._set = netCDF4.Dataset(self._temporary, "w", format="NETCDF4")
        data = self._set
        data.Conventions, data.title, data.history = "CF-1.11", "Flight corrected for sensor lag", history
        data.source = f"thermo-hygrometer log {shown(Path(layout.source).name)}"
        data.createDimension("row", None)
        self._names: list[str] = []
        self._text: list[bool] = []
        data.createVariable("time", "f8", ("row",), zlib=True).long_name = "time of the sample"
        by_place = {place: quantity for quantity, place in layout.place.items()}
        numeric = numeric_places(Path(layout.source), layout)
        for place, column in enumerate(layout.header):
            name = self._free_name(column)
            self._names.append(name)
            quantity = by_place.get(place)
            known = None if layout.raw_xq2 or quantity is None else self.STANDARD.get(quantity)
            self._text.append(known is None and place not in numeric)
            if self._text[-1]:
                variable = data.createVariable(name, str, ("row",))
                variable.long_name = f"column {column} of the log, as it came"
            elif known is not None and quantity is not None:
                _, unit, words = known
                stated = layout.units.get(quantity)
                unit = self.UDUNITS.get(stated, stated) if stated else unit or self._unit_in_name(quantity, column)
                variable = self._number(name, unit, words)
                if unit and quantity == "altitude":
                    variable.positive = "up"
                if unit and quantity in self.STANDARD_NAMES:
                    variable.standard_name = self.STANDARD_NAMES[quantity]
            else:
                self._number(name, None, f"column {column} of the log, as it came")
        for name, _, standard, unit, words in self.CORRECTED:
            variable = self._number(name, unit, words)
            variable.standard_name = standard
            if standard.startswith("air_temperature"):
                variable.units_metadata = (
                    f"temperature: {'on_scale' if standard == 'air_temperature' else 'difference'}"
                )
        for channel, unit in CHANNELS:
            for part, words in PARTS.items():
                self._number(f"{channel}_uncertainty_{part}_{SUFFIX[unit]}", unit, f"standard uncertainty, {words}")
        data["temperature_corrected_c"].ancillary_variables = "temperature_uncertainty_k flags"
        data["humidity_corrected_percent"].ancillary_variables = "humidity_uncertainty_percent flags"
        flags = data.createVariable("flags", "i1", ("row",))
        flags.long_name, flags.standard_name = "what is special about a row", "quality_flag"
        flags.flag_masks = np.array([1 << i for i in range(len(FLAGS))], dtype="i1")
        flags.flag_meanings = " ".join(FLAGS)

    def _number(self, name: str, unit: str | None, words: str) -> Any:
        variable = self._set.createVariable(name, "f8", ("row",), fill_value=np.nan, zlib=True)
        variable.long_name = words
        if unit:
            variable.units = unit
        return variable

    def _unit_in_name(self, quantity: str, column: str) -> str | None:
        endings = self.ENDINGS.get(quantity, {})
        return next((unit for ending, unit in endings.items() if squeeze(column).endswith(ending)), None)

    def _date(self, first_s: float) -> None:
        """Time since 1970 is a time coordinate; a clock that starts at the flight has no date to count from."""
        time = self._set["time"]
        if first_s < EARLIEST_DATE_S:
            time.units = "s"
            return
        time.units, time.standard_name, time.calendar = "seconds since 1970-01-01 00:00:00", "time", "standard"
        time.units_metadata = "leap_seconds: none"
        for variable in self._set.variables.values():
            if variable.name != "time":
                variable.coordinates = "time"

    def _free_name(self, column: str) -> str:
        base = re.sub(r"[^A-Za-z0-9_]", "_", column) or "column"
        base = base if base[0].isalpha() else f"c_{base}"
        own = {"time", "flags", *(entry[0] for entry in self.CORRECTED)}
        own |= {f"{channel}_uncertainty_{part}_{SUFFIX[unit]}" for channel, unit in CHANNELS for part in PARTS}
        name, count = base if base not in own else f"{base}_log", 1
        while name in self._names:
            name, count = f"{base}_{count + 1}", count + 1
        return name

    def write(self, rows: Rows, flight: Flight, corrected: Corrected) -> None:
        data, start = self._set, len(self._set.dimensions["row"])
        if start == 0:
            self._date(float(np.nanmin(flight.time_s)))
        part = slice(start, start + len(rows))
        data["time"][part] = flight.time_s
        for name, is_text, cells in zip(self._names, self._text, zip(*rows.table(), strict=True), strict=True):
            data[name][part] = np.array(cells, dtype=object) if is_text else numbers_of(cells)
        for name, attribute, *_ in self.CORRECTED:
            data[name][part] = getattr(corrected, attribute)
        for channel, unit in CHANNELS:
            if channel not in corrected.common:
                continue
            common = corrected.common[channel]
            sigma = getattr(corrected, f"{channel}_uncertainty_{SUFFIX[unit]}")
            independent = data[f"{channel}_uncertainty_independent_{SUFFIX[unit]}"]
            independent[part] = np.sqrt(np.maximum(sigma**2 - common**2, 0.0))
            independent.independent_after_s = corrected.independent_after_s[channel]
            data[f"{channel}_uncertainty_common_{SUFFIX[unit]}"][part] = common
            if channel in corrected.widened:
                data.setncattr(f"{channel}_time_scale_uncertainty_added", corrected.widened[channel])
            if channel in corrected.slower:
                data.setncattr(f"{channel}_time_scale_longer_by", corrected.slower[channel])
        data["flags"][part] = sum(
            (corrected.flags[name].astype("i1") << i for i, name in enumerate(FLAGS)), np.zeros(len(rows), "i1")
        )

    def close(self) -> None:
        self._set.close()
        os.replace(self._temporary, self.path)

    def discard(self) -> None:
        with contextlib.suppress(OSError, RuntimeError):
            self._set.close()
        self._temporary.unlink(missing_ok=True)
