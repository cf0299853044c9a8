"""An eleventh group of campaigns from logs that others published, found and cut before anything of it was judged.

Each file lies in a cache as published, at DIR/OWNER/NAME/PATH of its repository on github:

- JonasStage/Methane-and-CO2-sensor @04c4c5f, validation/bubbles_raw_data.csv: a methane sensor of metal oxide and a
  laser's analyser in one chamber, into which methane is let and which is flushed, each 2 s and 1 s (CC BY-NC 4.0)
- delimabs/Gas-Sensor-Data-Analysis-System @559921d, dataSample{1,2,3}.zip: gas sensors (resistances) of graphene oxide
  in NO2, of zinc oxide in ozone and of polyaniline in ammonia, of several concentrations and in air between them, each
  60 s and 30 s (GPL 3.0)
- Karan96Kaushik/Capacitive-Humidity-Sensor-Charter @6408aa5, SGS_Vais_June/Log-{02,03,09,10}-06-2020-*.csv and
  RMY_Vais_June/Log-12-06-2020-14:59.csv: two makes of thermo-hygrometer, each beside a Vaisala probe in air (a box's,
  it seems) that is cooled, dried and moistened, each second (no licence stated)
- water-splitting-group/HTE-experimental-data @2ee7511, experimental_data/Experiments for reproducibility and screening/
  csv files/results_MRG-059-ZM-1-{1..12}.csv: an oxygen optode in twelve vials of one recipe, which are degassed and,
  after a rest, lit so that oxygen arises, each 3.4 s (CC BY 4.0)
- walkerjeffd/riffle-ito-apps @6d511ff, analyses/20140806_thermistor_water/data/LOGGER17.CSV: a thermistor and its
  logger in a bottle in a jar of water, which is put into hot water and then left, each 63 s (MIT)
- hayesall/Informatics-Temperature-Study @b51b309, data/data1.txt: a TMP102 put into a fridge and taken out again, each
  2 s, in degF (MIT)

Cuts follow the files' phases, the routines that the authors state for the gases, and the rows that they name as the
fridge. Where none tells it, they follow what a plot shows: when the laser sees methane come or go, when the humid air
was changed, when the jar was put into hot water and was hottest, and the coldest reading in the fridge. Of the
thermometers brought into the box, the first minutes of each log are taken but of one, in which that comes later. What
is no temperature goes as a humidity, scaled into its range.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pandas as pd
from real_cache_sets import COLUMN, NO_WATER, NOT_WARMED, RH, Log, T, join_logs, log_since, write_logs
from real_sets import RealSet, write_campaign

METHANE = "JonasStage/Methane-and-CO2-sensor/validation/bubbles_raw_data.csv"
PERCENT_PER_PPM = 0.08
# Seconds since the earliest row: from each coming or going of the methane to the next.
METHANE_COMES_S = (
    *((5930.0, 6270.0), (6270.0, 6600.0), (6600.0, 6800.0), (7110.0, 7370.0), (7370.0, 7620.0)),
    *((7980.0, 8250.0), (8450.0, 8690.0), (8890.0, 9350.0)),
)
METHANE_GOES_S = ((5380.0, 5930.0), (6800.0, 7110.0), (7620.0, 7980.0), (8250.0, 8450.0), (8690.0, 8890.0))
LASER_PERCENT = {"humidity_standard_uncertainty_percent": 1.0}
MINUTE_S = 60.0
# Minutes of the log, by the authors: when each gas came, for how long, and until when there was air after it.
NO2_CAME, NO2_LASTED, NO2_EVERY = tuple(310 + at for at in (50, 110, 170, 230)), 10, 60
OZONE_CAME, OZONE_LASTED, OZONE_EVERY = tuple(670 + at for at in range(725, 1251, 75)), 15, 75
AMMONIA_CAME, AMMONIA_LASTED, AMMONIA_EVERY = tuple(3 + at for at in range(15, 316, 60)), 15, 60
PERCENT_PER_OHM = {1: 4e-3, 2: 4e-5, 3: 4e-6}  # by the number of the file
HYGROMETERS = "Karan96Kaushik/Capacitive-Humidity-Sensor-Charter"
BROUGHT_IN = ("02-06-2020-12:57", "03-06-2020-13:08", "03-06-2020-16:02", *("09-06-2020-13:28", "09-06-2020-15:33"))
BROUGHT_IN_S = 500.0
MOISTENED = ("02-06-2020-15:58", "03-06-2020-13:08", "03-06-2020-16:02", "10-06-2020-10:19")
RMY_S = ((1000.0, 2650.0), (2650.0, 4850.0), (4850.0, 6200.0), (6200.0, 8400.0), (8400.0, 11700.0))
VAISALA_K, VAISALA_PERCENT = {"temperature_standard_uncertainty_k": 0.2}, {"humidity_standard_uncertainty_percent": 2.0}
VIALS, PERCENT_PER_UM = range(1, 13), 0.3
JAR_S = ((14150.0, 16700.0), (16750.0, 22500.0))
FRIDGE_ROWS = 571, 679  # from its first to the first of the authors' next place


def _methane(cuts: Sequence[tuple[float, float]], beside: bool) -> Callable[[Path, Path], None]:
    def make(cache: Path, out: Path) -> None:
        frame = pd.read_csv(cache / METHANE)
        stamps = pd.to_datetime(frame["datetime"])
        frame["time_s"] = (stamps - stamps.min()).dt.total_seconds()
        frame = frame.sort_values("time_s")  # one row is out of order, and some are there twice
        log, air = (
            frame[["time_s", one]].dropna().drop_duplicates("time_s").set_axis(["time_s", COLUMN[RH]], axis=1)
            * (1.0, PERCENT_PER_PPM)
            for one in ("DIY_CH4", "LGR_CH4")
        )
        write_campaign(out, RH, log, list(cuts), air if beside else None, LASER_PERCENT)

    return make


def _in_gas(number: int, begins: Sequence[float], lasts: float) -> Callable[[Path, Path], None]:
    """The file's first sensor, from each of the minutes on."""

    def make(cache: Path, out: Path) -> None:
        with ZipFile(cache / f"delimabs/Gas-Sensor-Data-Analysis-System/dataSample{number}.zip") as archive:
            text = archive.read(f"dataSample_{number}.dat")
        table = pd.read_csv(BytesIO(text), sep="\t", header=None).to_numpy(float)
        log = pd.DataFrame({"time_s": table[:, 0], COLUMN[RH]: PERCENT_PER_OHM[number] * table[:, 1]})
        write_campaign(out, RH, log, [(MINUTE_S * at, MINUTE_S * (at + lasts)) for at in begins])

    return make


def _after_gas(number: int, came: Sequence[int], lasted: int, every: int) -> Callable[[Path, Path], None]:
    return _in_gas(number, [at + lasted for at in came], every - lasted)


def _box_table(cache: Path, name: str) -> pd.DataFrame:
    """One log, by seconds since its first row."""
    frame = pd.read_csv(cache / HYGROMETERS / name)
    since = pd.to_timedelta(frame.pop("Time")).dt.total_seconds()
    return frame.assign(time_s=since - since.iloc[0]).drop_duplicates("time_s")


def _brought_in(cache: Path, *columns: str) -> list[list[Log]]:
    """Of each column the first minutes of each log, each second row."""
    tables = [_box_table(cache, f"SGS_Vais_June/Log-{name}.csv") for name in (*BROUGHT_IN, MOISTENED[-1])]
    tables = [table[table["time_s"] < BROUGHT_IN_S].iloc[1::2] for table in tables]
    return [[log_since(one["time_s"].to_numpy(), one[column].to_numpy(float)) for one in tables] for column in columns]


def vaisala_thermometer(cache: Path, out: Path) -> None:
    write_logs(out, T, _brought_in(cache, "Vaisala Temp")[0])


def sgs_thermometer(cache: Path, out: Path) -> None:
    logs, airs = _brought_in(cache, "SGS Temp", "Vaisala Temp")
    joined, cuts = join_logs(logs)
    write_campaign(out, T, joined, cuts, join_logs(airs)[0], VAISALA_K)


def sgs_hygrometer(cache: Path, out: Path) -> None:
    """Logs whole but for their first rows, which hold no reading yet, each tenth row."""
    tables = [_box_table(cache, f"SGS_Vais_June/Log-{name}.csv").iloc[10::10] for name in MOISTENED]
    logs = [table[["time_s", "SGS Temp", "SGS Hum"]] for table in tables]
    airs = [table[["time_s", "Vaisala Hum"]] for table in tables]
    joined, cuts = join_logs([one.set_axis(["time_s", COLUMN[T], COLUMN[RH]], axis=1) for one in logs])
    air = join_logs([one.set_axis(["time_s", COLUMN[RH]], axis=1) for one in airs])[0]
    write_campaign(out, RH, joined, cuts, air, VAISALA_PERCENT)


def rmy_hygrometer(cache: Path, out: Path) -> None:
    """Each fifth row."""
    table = _box_table(cache, "RMY_Vais_June/Log-12-06-2020-14:59.csv").iloc[::5]
    log, air = (table[["time_s", one]].set_axis(["time_s", COLUMN[RH]], axis=1) for one in ("RMY Hum", "Vaisala Hum"))
    write_campaign(out, RH, log, list(RMY_S), air, VAISALA_PERCENT)


def _vials(phase: str) -> Callable[[Path, Path], None]:
    """From the second row of a phase on, since the first may still be of the vial before."""

    def make(cache: Path, out: Path) -> None:
        folder = cache / "water-splitting-group/HTE-experimental-data/experimental_data"
        folder = folder / "Experiments for reproducibility and screening/csv files"
        logs = []
        for one in VIALS:
            frame = pd.read_csv(folder / f"results_MRG-059-ZM-1-{one}.csv", usecols=["status", "uM_1", "duration"])
            rows = frame[frame["status"] == phase].dropna().iloc[1:]
            logs.append(log_since(rows["duration"].to_numpy(), PERCENT_PER_UM * rows["uM_1"].to_numpy(float), RH))
        write_logs(out, RH, logs)

    return make


def jar(cache: Path, out: Path) -> None:
    frame = pd.read_csv(cache / "walkerjeffd/riffle-ito-apps/analyses/20140806_thermistor_water/data/LOGGER17.CSV")
    stamps = pd.to_datetime(frame["DATETIME"])
    log = log_since((stamps - stamps.iloc[0]).dt.total_seconds().to_numpy(), frame["TEMP_C"].to_numpy(float))
    write_campaign(out, T, log, list(JAR_S))


def in_and_out(cache: Path, out: Path) -> None:
    """Into the fridge until the coldest reading, and out of it until the authors' next place."""
    table = pd.read_csv(cache / "hayesall/Informatics-Temperature-Study/data/data1.txt").to_numpy(float)
    table = table[slice(*FRIDGE_ROWS)]
    coldest = int(np.argmin(table[:, 1]))
    parts = table[: coldest + 1], table[coldest:]
    write_logs(out, T, [log_since(part[:, 0], (part[:, 1] - 32.0) / 1.8) for part in parts])


def eleventh_sets() -> list[RealSet]:
    """All of them, in the order of the table."""
    dry, dark = (*NOT_WARMED, *NO_WATER), ("radiative_heating",)
    both = sorted((*METHANE_COMES_S, *METHANE_GOES_S))
    after_no2 = _after_gas(1, NO2_CAME, NO2_LASTED, NO2_EVERY)
    after_ozone = _after_gas(2, OZONE_CAME, OZONE_LASTED, OZONE_EVERY)
    after_ammonia = _after_gas(3, AMMONIA_CAME[:-1], AMMONIA_LASTED, AMMONIA_EVERY)  # the log ends after the last one
    return [
        RealSet("methane sensor, air from a laser", RH, _methane(both, True), None, dry),
        RealSet("methane sensor, flushed", RH, _methane(METHANE_GOES_S, False), None, dry),
        RealSet("graphene oxide after NO2", RH, after_no2, None, dry),
        RealSet("zinc oxide after ozone", RH, after_ozone, None, dry),
        RealSet("polyaniline in ammonia", RH, _in_gas(3, AMMONIA_CAME, AMMONIA_LASTED), None, dry),
        RealSet("polyaniline after ammonia", RH, after_ammonia, None, dry),
        RealSet("Vaisala thermometer brought into a box", T, vaisala_thermometer, None, (*dark, *NO_WATER)),
        RealSet("SGS thermometer, air from Vaisala", T, sgs_thermometer, None, (*dark, *NO_WATER)),
        RealSet("SGS humidity, air from Vaisala", RH, sgs_hygrometer, None, dark),
        RealSet("RM Young humidity, air from Vaisala", RH, rmy_hygrometer, None, dark),
        RealSet("oxygen optode in vials, degassed", RH, _vials("DEGASSING"), None, dry),
        RealSet("oxygen optode in vials, lit", RH, _vials("REACTION"), None, dry),
        RealSet("thermistor in a bottle in a jar", T, jar, None, dry),
        RealSet("TMP102 into a fridge and out", T, in_and_out, None, dark),
    ]
