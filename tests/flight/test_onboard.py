"""Generated programs give the causal corrector's numbers, refuse what they cannot, and survive any row."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from shockrig.analysis.flight.simulated.scenes import to_flight
from shockrig.analysis.flight.simulated.sensor import fly
from shockrig.analysis.flight.simulated.typical import typical_profile
from shockrig.analysis.flight.simulated.weather import inversion
from shockrig.analysis.onboard import MOST_STATE_BYTES, c_source, flown, lua_source, state_bytes
from shockrig.files.errors import InputError
from shockrig.files.profile import StatedEffect, Uncertain, write_profile
from shockrig.protocols.cli import main
from shockrig.protocols.onboard_check import STRICT, build, compiler, difference, reference, run

ROWS = 500
SANITIZED = (*STRICT, "-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")  # optimized: half a minute
needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler on this computer")


def effect(name, **values):
    return StatedEffect(name, {key: Uncertain(value, 0.02 * abs(value)) for key, value in values.items()})


def rich_profile():
    """Airflow, a slow share, a delay and a calibration on the bead; a boundary layer and a calibration on the film."""
    plain = typical_profile()
    bead = (
        effect("convective_film", biot_at_5_m_s=3.0),
        effect("stem_conduction", fraction=0.05, time_constant_s=20.0),
        effect("dead_time", delay_s=0.15),
        effect("calibration_error", gain=0.01, offset=0.2),
    )
    film = (effect("vapour_boundary_layer", biot_at_5_m_s=20.0), effect("calibration_error", gain=-0.02, offset=1.0))
    return replace(
        plain,
        temperature=replace(plain.temperature, effects=bead),
        humidity=replace(plain.humidity, effects=film),
    )


def beside_bead(activity):
    """A film that is as warm as the bead reads, as flights tell it, on a rich profile."""
    rich = rich_profile()
    film = effect("film_beside_bead", behind_s=0.0, activity=activity, time_constant_s=0.0)
    return replace(rich, humidity=replace(rich.humidity, effects=(*rich.humidity.effects, film)))


@cache
def flown_log(rich):
    """What the sensors of a profile, rich or plain, log in an inversion."""
    return fly(inversion(np.random.default_rng([3, 1])), rich_profile() if rich else typical_profile(), 3).log


def flight_with(profile, damage=False):
    log = flown_log(bool(profile.humidity.effects)).iloc[600 : 600 + ROWS].reset_index(drop=True)
    if damage:
        log.loc[[50, 51], "temperature_c"] = -99.0
        log.loc[80:90, "humidity_percent"] = np.nan
        log.loc[120:180, "temperature_c"] = log.loc[120, "temperature_c"]
        log.loc[200, "time_s"] -= 30.0
        log.loc[260:, "time_s"] -= 40.0
        log.loc[350:, "time_s"] += 100.0
        log.loc[400:430, "temperature_c"] += np.random.default_rng(1).normal(0.0, 0.4, 31)
    return to_flight(log)


def sources(folder, design):
    for name, text in (
        c_source(design, "profile.json", "test") | {"shock_correct.lua": lua_source(design, "p")}
    ).items():
        assert not re.search(r"@[A-Z_]+@", text)
        (folder / name).write_text(text)
    return folder


@needs_compiler
@pytest.mark.parametrize(
    ("profile", "damage"),
    [(typical_profile(), False), (rich_profile(), True), (beside_bead(0.2), True), (beside_bead(0.9), True)],
    ids=["clean plain", "damaged rich", "vapour beside a bead", "activity beside a bead"],
)
def test_c_is_the_reference_in_single_precision(tmp_path, profile, damage):
    flight, design = flight_with(profile, damage), flown(profile, 0.1)
    found = run(build(sources(tmp_path, design), compiler(), tmp_path, SANITIZED), flight)
    one = difference(found, reference(design, flight))
    assert one.rows == ROWS and one.one_sided == 0
    assert one.temperature_k <= 0.01 and one.temperature_uncertainty_k <= 0.01
    assert one.humidity_percent <= 0.05 and one.humidity_uncertainty_percent <= 0.05


@pytest.mark.skipif(shutil.which("lua5.3") is None, reason="no Lua 5.3 on this computer")
@pytest.mark.parametrize("profile", [rich_profile(), beside_bead(0.2)], ids=["rich", "beside a bead"])
def test_lua_is_the_reference(tmp_path, profile):
    flight, design = flight_with(profile, damage=True), flown(profile, 0.1)
    sources(tmp_path, design)
    (tmp_path / "main.lua").write_text(
        'local shock = require("shock_correct")\n'
        "local state = shock.begin()\n"
        "for line in io.lines() do\n"
        "  local cell = {}\n"
        '  for one in (line .. ","):gmatch("([^,]*),") do cell[#cell + 1] = tonumber(one) or false end\n'
        "  local air = shock.step(state, {time_ms = math.tointeger(cell[1]), temperature_c = cell[2] or nil,\n"
        "    humidity_percent = cell[3] or nil, airspeed_m_s = cell[4] or nil, pressure_hpa = cell[5] or nil})\n"
        '  print(air.temperature_c or "nan", air.temperature_uncertainty_k or "nan", air.humidity_percent or "nan",\n'
        '    air.humidity_uncertainty_percent or "nan")\n'
        "end\n"
    )
    columns = (flight.temperature_c, flight.humidity_percent, flight.airspeed_m_s, flight.pressure_hpa)
    lines = [
        ",".join([str(round(time_s * 1000)), *("" if np.isnan(v) else repr(float(v)) for v in values)])
        for time_s, *values in zip(flight.time_s, *columns, strict=True)
    ]
    done = subprocess.run(
        ["lua5.3", "main.lua"], input="\n".join(lines) + "\n", capture_output=True, text=True, cwd=tmp_path, check=True
    )
    one = difference(np.genfromtxt(done.stdout.splitlines()), reference(design, flight))
    assert one.one_sided == 0
    assert one.temperature_k <= 0.001 and one.humidity_percent <= 0.005


@needs_compiler
def test_no_row_leaves_it_without_a_number(tmp_path):
    """The fuzz of the benchmark, short: it counts what is no number, and stretches of good rows that give nothing."""
    from pathlib import Path

    fuzz = Path(__file__).parents[2] / "benchmarks" / "onboard_fuzz.c"
    if not fuzz.is_file():
        pytest.skip("the benchmarks are not here")
    sources(tmp_path, flown(typical_profile()))
    program = tmp_path / "fuzz"
    command = [
        compiler(),
        *SANITIZED,
        f"-I{tmp_path}",
        "-o",
        str(program),
        str(fuzz),
        str(tmp_path / "shock_correct.c"),
    ]
    subprocess.run([*command, "-lm"], check=True)
    done = subprocess.run([str(program), "10000"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 of them no number" in done.stdout


def test_state_fits_whatever_lags_the_profile_has():
    plain, rich = flown(typical_profile()), flown(rich_profile())
    assert state_bytes(plain) <= MOST_STATE_BYTES and state_bytes(rich) <= MOST_STATE_BYTES
    slow = (effect("slow_relaxation", fraction=0.1, time_constant_s=60.0),)
    both = replace(rich_profile(), humidity=replace(rich_profile().humidity, effects=slow))
    assert state_bytes(flown(both)) <= MOST_STATE_BYTES


def test_what_cannot_fly_is_refused():
    profile = typical_profile()
    with pytest.raises(InputError, match="no humidity part"):
        flown(replace(profile, humidity=None))
    late = replace(profile, humidity=replace(profile.humidity, effects=(effect("dead_time", delay_s=0.5),)))
    with pytest.raises(InputError, match="later than the thermometer"):
        flown(late)


@needs_compiler
def test_the_command_writes_sources_and_measures_them(tmp_path, capsys):
    profile = rich_profile()
    write_profile(profile, tmp_path / "profile.json")
    flown_log(True).iloc[:200].to_csv(tmp_path / "flight.csv", index=False)
    out = tmp_path / "program"
    arguments = ["onboard", str(tmp_path / "profile.json"), "--out", str(out), "--flight", str(tmp_path / "flight.csv")]
    assert main(arguments) == 0
    assert "against the reference on 200 rows" in capsys.readouterr().out
    names = {"shock_correct.h", "shock_correct.c", "csv_main.c", "Makefile", "shock_correct.lua", "README.md"}
    assert {path.name for path in out.iterdir()} == names | {"rows.csv"}
    page = (out / "README.md").read_text()
    assert "on the 200 rows of flight.csv" in page and "-11 to 41 degC" in page and not re.search(r"@[A-Z_]+@", page)


@needs_compiler
def test_what_the_page_says_of_the_program_works_on_a_log_with_times_of_day(tmp_path):
    assert main(["example", "flight.csv", "--out", str(tmp_path / "flight.csv")]) == 0
    write_profile(typical_profile(), tmp_path / "profile.json")
    log, out = tmp_path / "flight.csv", tmp_path / "program"
    assert main(["onboard", str(tmp_path / "profile.json"), "--out", str(out), "--flight", str(log)]) == 0
    said = [line.strip() for line in (out / "README.md").read_text().splitlines() if line.startswith("    ")]
    assert "./shock_csv < rows.csv > corrected.csv" in said
    subprocess.run("make && ./shock_csv < rows.csv > corrected.csv", shell=True, check=True, cwd=out, timeout=300)
    rows = len((out / "corrected.csv").read_text().splitlines())
    assert rows == len(log.read_text().splitlines())


@pytest.mark.parametrize("column", ["temperature_c", "humidity_percent"])
def test_a_log_that_lacks_a_reading_compares_nothing_and_is_refused(tmp_path, capsys, column):
    write_profile(typical_profile(), tmp_path / "profile.json")
    flown_log(False).iloc[:200].drop(columns=column).to_csv(tmp_path / "flight.csv", index=False)
    out = tmp_path / "program"
    arguments = ["onboard", str(tmp_path / "profile.json"), "--out", str(out), "--flight", str(tmp_path / "flight.csv")]
    assert main(arguments) == 2
    assert f"no {column} in it" in capsys.readouterr().err and not out.exists()


def test_without_a_compiler_it_says_so(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("shockrig.protocols.onboard_check.shutil.which", lambda name: None)
    write_profile(typical_profile(), tmp_path / "profile.json")
    assert main(["onboard", str(tmp_path / "profile.json"), "--out", str(tmp_path / "program")]) == 0
    assert "not compared with the reference" in capsys.readouterr().out
    assert "Not measured: no flight was given" in (tmp_path / "program" / "README.md").read_text()
