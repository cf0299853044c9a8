"""The table of slips that the checks of the input must catch (made in `input_slips.py`)."""

from __future__ import annotations

import numpy as np
from input_slips import (
    Slip,
    airs,
    another,
    bead,
    clock,
    copied,
    die,
    every,
    fahrenheit,
    film,
    hundredth,
    in_campaign_json,
    in_files,
    kelvin_airs,
    length,
    one_of,
    share_of,
    start,
    swap_files,
    swapped_airs,
    swapped_columns,
    swapped_sensors,
    warmer,
    without,
)

BOTH = ("imet", "hyt")
F, FRACTION, MS = ("fahrenheit",), ("fraction_for_percent",), ("milliseconds",)
AIRS, SENSORS, COLUMNS = ("airs_swapped",), ("sensors_swapped",), ("columns_swapped",)
DEAD, RAIL, START, COPY = ("dead_sensor",), ("saturated_sensor",), ("start_disagrees",), ("run_copied",)
DEAD_OR_RAIL = (*DEAD, *RAIL)
STOOD = ("airs_disagree",)
OTHER, LATE = ("another_sensor",), ("clock_late",)


def milli(x):
    return 1000.0 * x


def stuck(x):
    return np.full(x.size, x[0])


def idle(x):
    """A thermometer that was left on the bench beside."""
    rng = np.random.default_rng(np.rint(1e6 * x).astype(np.int64).view(np.uint64))  # another noise for every run
    return np.round(21.3 + 0.02 * rng.standard_normal(x.size), 2)


def full(x):
    return np.minimum(x + 60.0, 100.0)


def seconds(by):
    return lambda t: t + by


SLIPS = (
    Slip("fahrenheit: every temperature", F, every(bead(fahrenheit), die(fahrenheit), airs(fahrenheit))),
    Slip("fahrenheit: imet.csv", F, every(bead(fahrenheit))),
    Slip("fahrenheit: imet.csv, airs not stated", F, every(bead(fahrenheit), without("airs"))),
    Slip("fahrenheit: imet.csv of one run", F, one_of(bead(fahrenheit))),
    Slip("fahrenheit: the die in hyt.csv", F, every(die(fahrenheit))),
    Slip("fahrenheit: both files, not run.json", F, every(bead(fahrenheit), die(fahrenheit))),
    Slip("fahrenheit: run.json alone", F, every(airs(fahrenheit))),
    Slip("kelvin: imet.csv", ("kelvin",), edit=in_files("imet.csv", warmer)),
    Slip("kelvin: the die in hyt.csv", ("kelvin",), edit=in_files("hyt.csv", warmer)),
    Slip("kelvin: run.json alone", ("kelvin",), edit=in_files(None, kelvin_airs), refused="kelvin"),
    Slip("fraction for percent: every humidity", FRACTION, every(film(hundredth), airs(humidity=hundredth))),
    Slip("fraction for percent: hyt.csv", FRACTION, every(film(hundredth))),
    Slip("fraction for percent: hyt.csv, airs not stated", FRACTION, every(film(hundredth), without("airs"))),
    Slip("fraction for percent: run.json alone", FRACTION, every(airs(humidity=hundredth))),
    Slip("milliseconds: time_s and start_s", MS, every(clock(BOTH, milli), start(milli))),
    Slip("milliseconds: time_s", MS, every(clock(BOTH, milli))),
    Slip("milliseconds: time_s, start not stated", MS, every(clock(BOTH, milli), without("start"))),
    Slip("milliseconds: imet.csv", MS, every(clock(("imet",), milli))),
    Slip("milliseconds: hyt.csv", MS, every(clock(("hyt",), milli))),
    Slip("milliseconds: start_s", MS, every(start(milli))),
    Slip("source and destination swapped in one run", AIRS, one_of(swapped_airs)),
    Slip("source and destination swapped in all", AIRS, every(swapped_airs)),
    Slip("airs of another run, 10 K off, in one run", STOOD, one_of(airs(temperature=lambda x: x + 10.0))),
    Slip("airs 25 %RH off in a third of the runs", STOOD, share_of(airs(humidity=lambda x: x - 25.0), 1 / 3)),
    Slip("sensors swapped", SENSORS, every(swapped_sensors)),
    Slip("sensors swapped in one run", SENSORS, one_of(swapped_sensors)),
    Slip("sensors swapped, airs not stated", SENSORS, every(swapped_sensors, without("airs"))),
    Slip("imet.csv and hyt.csv renamed", SENSORS, edit=swap_files, refused="no column humidity_percent"),
    Slip("columns of hyt.csv swapped", COLUMNS, every(swapped_columns)),
    Slip("columns of hyt.csv swapped in one run", COLUMNS, one_of(swapped_columns)),
    Slip("columns of hyt.csv swapped, airs not stated", COLUMNS, every(swapped_columns, without("airs"))),
    Slip("imet.csv constant", DEAD, every(bead(stuck))),
    Slip("imet.csv constant, airs not stated", DEAD, every(bead(stuck), without("airs"))),
    Slip("hyt.csv constant", DEAD, every(film(stuck))),
    Slip("hyt.csv constant in a third of the runs", DEAD, share_of(film(stuck), 1 / 3)),
    Slip("hyt.csv constant in one run", DEAD, one_of(film(stuck))),
    Slip("imet.csv noise alone", DEAD, every(bead(idle))),
    Slip("hyt.csv at 100 %RH in a third of the runs", DEAD_OR_RAIL, share_of(film(full), 1 / 3)),
    Slip("imet.csv reads -999", DEAD, edit=in_files("imet.csv", lambda f: f.assign(temperature_c=-999.0))),
    Slip("imet.csv not above 25 °C", RAIL, every(bead(lambda x: np.minimum(x, 25.0)))),
    Slip("hyt.csv not above 50 %RH", RAIL, every(film(lambda x: np.minimum(x, 50.0)))),
    Slip("start 5 s late in one run", START, one_of(start(seconds(5.0)))),
    Slip("start 5 s early in one run", START, one_of(start(seconds(-5.0)))),
    Slip("start 30 s late in a third of the runs", START, share_of(start(seconds(30.0)), 1 / 3)),
    Slip("start 3 s early in all", START, every(start(seconds(-3.0)))),
    Slip("start beyond the record", START, one_of(start(seconds(500.0)))),
    Slip("one run ten times, alone", COPY, copied(0.0, True)),
    Slip("one run ten times among the others", COPY, copied(0.0, False)),
    Slip("one run ten times, shaken by 1 mK", COPY, copied(1e-3, False)),
    Slip("half of imet.csv of another sensor, drawn", OTHER, another("imet", "drawn")),
    Slip("half of imet.csv of another sensor, from the middle on", OTHER, another("imet", "from the middle on")),
    Slip("half of imet.csv of another sensor, every second", OTHER, another("imet", "every second")),
    Slip("half of hyt.csv of another sensor, drawn", OTHER, another("hyt", "drawn")),
    Slip("half of hyt.csv of another sensor, from the middle on", OTHER, another("hyt", "from the middle on")),
    Slip("half of hyt.csv of another sensor, every second", OTHER, another("hyt", "every second")),
    Slip("bead radius in millimetres, in memory", ("length_in_millimetres",), length("imet", "bead_radius_m", 1e3)),
    Slip(
        "bead radius in millimetres",
        ("length_in_millimetres",),
        edit=in_campaign_json("imet", "bead_radius_m", 1e3),
        refused="millimetres",
    ),
    Slip(
        "film thickness in millimetres",
        ("length_in_millimetres",),
        edit=in_campaign_json("hyt", "film_thickness_m", 1e3),
        refused="millimetres",
    ),
    Slip("film thickness in micrometres", ("length_in_micrometres",), length("hyt", "film_thickness_m", 1e6)),
    Slip("bead radius 50 times too large", ("implausible_rate",), length("imet", "bead_radius_m", 50.0)),
    Slip("film thickness a thousandth", ("implausible_rate",), length("hyt", "film_thickness_m", 1e-3)),
    Slip("clock of imet.csv 2 s late", LATE, every(clock(("imet",), seconds(2.0)))),
    Slip("clock of hyt.csv 2 s late", LATE, every(clock(("hyt",), seconds(2.0)))),
    Slip("clock of imet.csv 2 s early", ("clock_early",), every(clock(("imet",), seconds(-2.0)))),
    Slip("clock of hyt.csv 2 s late, start not stated", LATE, every(clock(("hyt",), seconds(2.0)), without("start"))),
    Slip("clock of imet.csv 2 s late, start not stated", LATE, every(clock(("imet",), seconds(2.0)), without("start"))),
)
