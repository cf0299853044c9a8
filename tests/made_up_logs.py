"""Made-up logs for the tests of importing: a thermometer and a hygrometer carried to and fro, and ways to write it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MadeUp:
    """What the sensors read, rounded to 0.01, and when they were carried."""

    time_s: Array
    temperature_c: Array
    humidity_percent: Array
    steps_s: tuple[float, ...]


def lag(since_s: Array, tau_s: float) -> Array:
    """Step response of a first-order lag."""
    return 1.0 - np.exp(-np.maximum(since_s, 0.0) / tau_s)


def two_lags(since_s: Array, tau_s: float) -> Array:
    """Step response of two lags in series, the second 0.4 times the first."""
    x = np.maximum(since_s, 0.0) / tau_s
    return 1.0 - (np.exp(-x) - 0.4 * np.exp(-x / 0.4)) / 0.6


def film(since_s: Array, t63_s: float) -> Array:
    """Mean of a film behind a step at its face: 1 - 8/pi^2 sum exp(-(2n+1)^2 pi^2 x/4)/(2n+1)^2, t63 at x = 0.32025."""
    odd = 2.0 * np.arange(60)[:, None] + 1.0
    x = 0.32025 * np.maximum(since_s, 0.0) / t63_s
    return np.where(
        since_s > 0, 1.0 - 8.0 / np.pi**2 * (np.exp(-(odd**2) * np.pi**2 * x / 4.0) / odd**2).sum(axis=0), 0.0
    )


def sphere(since_s: Array, t63_s: float) -> Array:
    """Core of a sphere behind a step at its surface: 1 + 2 sum (-1)^n exp(-n^2 pi^2 x), t63 at x = 0.17091."""
    n = np.arange(1, 40)[:, None]
    x = np.maximum(0.17091 * since_s / t63_s, 1e-9)
    return np.where(
        x > 0.005, 1.0 + 2.0 * ((-1.0) ** n * np.exp(-(n**2) * np.pi**2 * np.maximum(x, 0.005))).sum(axis=0), 0.0
    )


def made_up(period_s: float = 0.5, seed: int = 1) -> MadeUp:
    """Three transfers between 22 degC, 40 %RH and 35 degC, 20 %RH; t63 of 2 s and 6 s; noise 0.03 K and 0.1 %RH."""
    random = np.random.default_rng(seed)
    steps_s = (80.13, 170.71, 260.42)
    time_s = 0.25 + period_s * np.arange(int(340.0 / period_s))
    temperature, humidity = np.full(time_s.size, 22.0), np.full(time_s.size, 40.0)
    for k, at_s in enumerate(steps_s):
        way = 1.0 if k % 2 == 0 else -1.0
        temperature += 13.0 * way * lag(time_s - at_s, 2.0)
        humidity -= 20.0 * way * film(time_s - at_s, 6.0)
    temperature += random.normal(0.0, 0.03, time_s.size)
    humidity += random.normal(0.0, 0.1, time_s.size)
    return MadeUp(time_s, np.round(temperature, 2), np.round(humidity, 2), steps_s)


LOG = made_up()
DAY = datetime(2026, 5, 1, 12, 0, tzinfo=UTC)
NIGHT = datetime(2026, 5, 1, 23, 57, tzinfo=UTC)


def lines_of(header, row, rows=None):
    """A log: the header, then `row(time_s, temperature, humidity, number)` for every reading."""
    body = [
        row(*reading, n)
        for n, reading in enumerate(zip(LOG.time_s, LOG.temperature_c, LOG.humidity_percent, strict=True))
    ]
    return [*([header] if header else []), *body]


def date(form, day=DAY):
    return lambda t: (day + timedelta(seconds=float(t))).strftime(form)


def unpadded(t):
    """Date and time of day as a logger writes them that prints numbers as they are: 2026/5/3,4:7:9.250000."""
    moment = DAY + timedelta(seconds=float(t))
    return f"{moment:%Y}/{moment.month}/{moment.day},{moment.hour}:{moment.minute}:{moment.second}.{moment:%f}"


halves = date("%m/%d/%y %I:%M:%S.%f %p")


def plain(header, time=lambda t: f"{t:.2f}", separator=",", decimal=".", value=lambda v: f"{v:.2f}"):
    def row(t, temperature, humidity, n):
        cells = [value(temperature), value(humidity)]
        return separator.join([time(t), *(cell.replace(".", decimal) for cell in cells)])

    return lines_of(header, row)


def with_lines(lines, where, *more):
    return [*lines[:where], *more, *lines[where:]]


def missing(mark):
    """Every 17th temperature is not there."""
    return lines_of(
        "time_s,temperature_c,humidity_percent",
        lambda t, a, b, n: f"{t:.2f},{mark if n % 17 == 3 else f'{a:.2f}'},{b:.2f}",
    )


def toa5():
    names = ['"TOA5","logger","CR1000","E123","CR1000.Std","CPU:program"', '"TIMESTAMP","RECORD","AirTC_Avg","RH"']
    stamps = date("%Y-%m-%d %H:%M:%S.%f")
    body = lines_of("", lambda t, a, b, n: f'"{stamps(t)}",{n},{a:.2f},{b:.2f}')
    return [*names, '"TS","RN","Deg C","%"', '"","","Avg","Smp"', *body]


def disordered():
    lines = plain("time_s,temperature_c,humidity_percent")
    for k in range(10, len(lines), 50):
        lines[k], lines[k + 1] = lines[k + 1], lines[k]
    return lines


def newest_first(header, time):
    names, *body = plain(header, time)
    return [names, *reversed(body)]


def labview():
    """As LabVIEW writes its measurement files: rows lack the cell of the comment that names and headers have."""
    head = [
        "LabVIEW Measurement\t",
        "Separator\tTab",
        "Date\t2017/04/21",
        "***End_of_Header***\t",
        "\t",
        "Channels\t2\t\t\t",
    ]
    blocks = [
        "Date\t2017/04/21\t2017/04/21\t",
        "Samples\t1\t1\t",
        "X0\t0.0E+0\t0.0E+0\t",
        "Delta_X\t0.5\t0.5\t",
        "***End_of_Header***\t\t\t",
    ]
    return [*head, *blocks, *plain("X_Value\tTemperature\tHumidity\tComment", separator="\t")]


def in_places():
    """As Vaisala writes soundings: columns end in one place each, and a name may be of two words."""
    row = "{:>5} {:>13} {:>6} {:>6}".format
    head = [row("n", "Elapsed time", "Temp", "RH"), row("", "s", "°C", "%")]
    return [*head, *lines_of("", lambda t, a, b, n: row(n, f"{t:.2f}", f"{a:.2f}", f"{b:.2f}"))]


def text(lines, end="\n"):
    return end.join(lines) + end


# what the log looks like -> its bytes
WAYS = {
    "plain": text(plain("time_s,temperature_c,humidity_percent")),
    "units in brackets": text(plain("Time [s],Temperature [°C],Humidity [%]")),
    "units in parentheses, a byte-order mark": "\ufeff" + text(plain("Time,temperature(°C),humidity(%RH)")),
    "UTF-16": text(plain("Time,temperature(°C),humidity(%RH)")).encode("utf-16"),
    "Windows' encoding and line ends": text(plain("Time,Temp (°C),RH (%)"), "\r\n").encode("cp1252"),
    "milliseconds": text(plain("Time [ms],Temp [°C],RH [%]", time=lambda t: f"{1000 * t:.0f}")),
    "millis, without a unit": text(plain("millis,temp,rh", time=lambda t: f"{1000 * t:.0f}")),
    "a clock called by its unit alone": text(plain("Milliseconds,temp,rh", time=lambda t: f"{1000 * t:.0f}")),
    "minutes": text(plain("elapsed [min],temp,rh", time=lambda t: f"{t / 60:.6f}")),
    "since 1970": text(plain("unixtime,temp,rh", time=lambda t: f"{DAY.timestamp() + t:.2f}")),
    "since 1970 in ms": text(plain("timestamp,temp,rh", time=lambda t: f"{1000 * (DAY.timestamp() + t):.0f}")),
    "since 1970 in ns": text(plain("time,temp,rh", time=lambda t: f"{round(1e3 * (DAY.timestamp() + t))}000000")),
    "a spreadsheet's days": text(plain("Date,temp,rh", time=lambda t: f"{46143.5 + t / 86400.0:.10f}")),
    "Windows in Japanese": text(plain("日時,気温(℃),湿度(%)", date("%Y/%m/%d %H:%M:%S.%f"))).encode("cp932"),
    "Windows in Chinese": text(plain("记录时间,温度,湿度", date("%Y-%m-%d %H:%M:%S.%f"))).encode("gb18030"),
    "Windows in Russian": text(
        plain("Дата и время;Температура, °C;Влажность, %", date("%d.%m.%Y %H:%M:%S.%f"), ";", ",")
    ).encode("cp1251"),
    "ISO": text(plain("timestamp,temp,rh", time=date("%Y-%m-%dT%H:%M:%S.%f"))),
    "ISO with a zone": text(plain("timestamp,temp,rh", time=lambda t: (DAY + timedelta(seconds=float(t))).isoformat())),
    "German": text(plain("Zeit;Temperatur;Feuchte", date("%d.%m.%Y %H:%M:%S.%f"), ";", ",")),
    "American": text(plain("Date Time,Temp (°F),RH (%)", date("%m/%d/%y %I:%M:%S.%f %p"))),
    "day before month": text(plain("Date,Temp,RH", date("%d/%m/%Y %H:%M:%S.%f", datetime(2026, 5, 23, tzinfo=UTC)))),
    "thousandths behind a colon": text(
        lines_of(
            "Sweep #,Time,Temp (C),RH",
            lambda t, a, b, n: f"{n + 1},{date('%m/%d/%Y %H:%M:%S:%f')(t)[:-3]},{a:.2f},{b:.2f}",
        )
    ),
    "thousandths behind a colon, no date": text(plain("Time,Temp,RH", lambda t: date("%H:%M:%S:%f", NIGHT)(t)[:-3])),
    "date and time in two columns": text(plain("Date,Time,Temp,RH", date("%Y/%m/%d,%H:%M:%S.%f"))),
    "a date in six columns": text(plain("Year,Month,Day,Hour,Minute,Second,Temp,RH", date("%Y,%m,%d,%H,%M,%S.%f"))),
    "clocks without zeros in front": text(plain("Date,Time,Temp,RH", unpadded)),
    "months in letters, between points": text(plain("Date,Time,Temp,RH", date("%d.%b.%Y,%H:%M:%S.%f"))),
    "names parted by commas above tabs": text(["Time [s],Temp [°C],RH [%]", *plain("", separator="\t")]),
    "degC and degF": text(
        lines_of("time_s,Temp (C),Temp (F),rh", lambda t, a, b, n: f"{t:.2f},{a:.2f},{1.8 * a + 32.0:.2f},{b:.2f}")
    ),
    "time of day, past midnight": text(plain("Time,Temp,RH", date("%H:%M:%S.%f", NIGHT))),
    "the newest row on top": text(newest_first("Date,Temp,RH", date("%m/%d/%Y %H:%M:%S.%f"))),
    "the newest row on top, seconds": text(newest_first("time_s,temp,rh", lambda t: f"{t:.2f}")),
    "the newest row on top, past midnight": text(newest_first("Time,Temp,RH", date("%H:%M:%S.%f", NIGHT))),
    "tabs and decimal commas": text(plain("t\ttemp\thumidity", separator="\t", decimal=",")),
    "blanks": text(plain("time temp humidity", separator="   ")),
    "blanks, and a comma behind": text(
        lines_of("time temp humidity", lambda t, a, b, n: f"{t:.2f} {a:.2f}C, {b:.2f}%,")
    ),
    "kelvin": text(lines_of("time,temp [K],rh", lambda t, a, b, n: f"{t:.2f},{a + 273.15:.2f},{b:.2f}")),
    "kelvin and a fraction, not named": text(
        lines_of("time,temp,rh", lambda t, a, b, n: f"{t:.2f},{a + 273.15:.2f},{b / 100:.4f}")
    ),
    "quotes": text(plain('"time","temp","rh"', time=lambda t: f'"{t:.2f}"')),
    "metadata above, comments within": text(
        with_lines(["# logger 7", "Serial,123", "", *plain("time_s,temp,rh")], 400, "# pause", "// and on")
    ),
    "names in a comment": text(plain("# time temp rh", separator=" ")),
    "units in a row of their own": text(with_lines(plain("time,temp,rh"), 1, "s,degC,%")),
    "Campbell's four lines": text(toa5()),
    "columns of other things": text(
        lines_of("id,time_s,battery,temp,rh,dew point", lambda t, a, b, n: f"7,{t:.2f},3.6,{a:.2f},{b:.2f},{a - 9:.1f}")
    ),
    "NaN": text(missing("NaN")),
    "-999": text(missing("-999")),
    "empty cells": text(missing("")),
    "dashes": text(missing("---")),
    "6526.9 now and then": text(missing("6526.9")),
    "words in cells": text(missing("overflow")),
    "disordered": text(disordered()),
    "repeated rows": text([line for k, line in enumerate(plain("time_s,temp,rh")) for _ in range(1 + (k % 9 == 5))]),
    "header again and again": text(with_lines(plain("time_s,temp,rh"), 300, "time_s,temp,rh", "time_s,temp,rh")),
    "last line cut off": text(plain("time_s,temp,rh")) + "340.2",
    "a separator at the end": text([line + "," if k else line for k, line in enumerate(plain("time_s,temp,rh"))]),
    "a column of units": text(
        lines_of("Date/Time,Unit,Value,RH (%)", lambda t, a, b, n: f"{halves(t)},F,{a:.2f},{b:.2f}")
    ),
    "LabVIEW's, with two headers": text(labview()),
    "names of two words above blanks": text(in_places()),
    "received on a serial line": text(
        [
            "12:00:00.000 -> Temp,RH",
            *lines_of("", lambda t, a, b, n: f"{date('%H:%M:%S.%f')(t)[:-3]} -> {a:.2f},{b:.2f}"),
        ]
    ),
    "names before readings, as a board prints them": text(
        [
            "DHT22 test!",
            *lines_of("", lambda t, a, b, n: f"[{date('%H:%M:%S.%f')(t)}] Humidity: {b:.2f} % Temperature: {a:.2f} *C"),
        ]
    ),
    "names before readings, a line for each": text(
        lines_of(
            "",
            lambda t, a, b, n: "\n".join(
                f"{date('%H:%M:%S.%f')(t)[:-3]} -> {said}"
                for said in (f"Temperature = {a:.2f} °C", f"Pressure = {1013 + n % 3} hPa", f"Humidity = {b:.2f} %")
            ),
        )
    ),
    "names before readings, in cells": text(
        lines_of("Date,T,RH", lambda t, a, b, n: f"{date('%Y-%m-%d %H:%M:%S.%f')(t)},Temp={a:.2f},Hum={b:.2f}")
    ),
    "JSON in lines": text(
        lines_of("", lambda t, a, b, n: f'{{"ms":{1000 * t:.0f},"id":"x","temperature":{a:.2f},"humidity":{b:.2f}}}')
    ),
    "JSON in a cell": text(
        lines_of("", lambda t, a, b, n: f'{halves(t)},"{{""id"":7,""BME_Temp"":{a:.2f},""BME_Humidity"":{b:.2f}}}"')
    ),
    "unit in every cell": text(lines_of("time,temp,rh", lambda t, a, b, n: f"{t:.2f},{a:.2f} °C,{b:.2f} %")),
    "unit in every cell, stamps beside": text(
        lines_of("Time,Temp,RH", lambda t, a, b, n: f"{date('%H:%M:%S.%f')(t)},{a:.2f}*F,{b:.2f}%")
    ),
    "silent at first": text(
        with_lines(
            plain("TimeElapsed,Temp,RH", date("%H:%M:%S.%f")), 1, *[f"11:59:{s}.25,NAN,NAN" for s in (40, 50)]
        )
    ),
}  # fmt: skip
MARKED = {"NaN", "-999", "empty cells", "dashes", "6526.9 now and then", "words in cells"}
FAHRENHEIT = {"American", "a column of units", "unit in every cell, stamps beside"}


def written(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def series(run_folder, sensor):
    head, *rows = (run_folder / f"{sensor}.csv").read_text().splitlines()
    table = np.array([[float(cell) if cell else np.nan for cell in row.split(",")] for row in rows])
    return dict(zip(head.split(","), table.T, strict=True))


def in_full(times, values, recorded_s, recorded):
    """Whether a run's readings are a stretch of what was recorded: value by value, and the times between them."""
    place = int(
        np.argmin([np.abs(recorded[k : k + 8] - values[:8]).max() for k in range(recorded.size - values.size + 1)])
    )
    stretch = slice(place, place + values.size)
    assert values == pytest.approx(recorded[stretch], abs=2e-5 * np.abs(recorded).max())
    assert times == pytest.approx(recorded_s[stretch] - recorded_s[place], abs=2e-3)
    return recorded_s[place]


MAP = """
[sensor.bead]
temperature = "temperature_c"
humidity = "humidity_percent"
"""


def plain_log(tmp_path, extra=""):
    log = written(tmp_path / "log.csv", WAYS["plain"])
    return log, written(tmp_path / "map.toml", MAP + extra)


TWO = """
[sensor.slow]
temperature = "temp slow"
{reference}
[sensor.fast]
temperature = "temp fast [°C]"
humidity = "rh"
temperature_time_constant_s = 0.5
humidity_standard_uncertainty_percent = 0.8
"""


def two_sensors(tmp_path):
    """A slow thermometer (a lag of 8 s behind the fast one), which is read in every other row only."""
    slow = np.empty(LOG.time_s.size)
    slow[0] = LOG.temperature_c[0]
    for k in range(1, slow.size):
        slow[k] = slow[k - 1] + (LOG.temperature_c[k] - slow[k - 1]) * (1.0 - np.exp(-0.5 / 8.0))
    rows = zip(LOG.time_s, slow, LOG.temperature_c, LOG.humidity_percent, strict=True)
    body = [f"{t:.2f},{a if k % 2 else float('nan'):.3f},{b:.2f},{c:.2f}" for k, (t, a, b, c) in enumerate(rows)]
    return written(tmp_path / "two.csv", text(["time_s,temp slow,temp fast [°C],rh", *body]))
