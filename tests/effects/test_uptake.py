"""A film that takes up by the relative humidity at its own temperature, against an integration of its own equation."""

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from shockrig.analysis.diagnose.diagnose import diagnose
from shockrig.analysis.effects import structure_of
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.estimate.model import Model, Point
from shockrig.analysis.physics.chain import evaluate
from shockrig.files.campaign import read_campaign

START_S, END_S, PERIOD_S = 60.0, 260.0, 1.0
FILM_S = 12.0
ROOM, FRIDGE = (22.0, 40.0), (4.0, 70.0)
PAIRS = [(ROOM, FRIDGE), (FRIDGE, ROOM), ((22.0, 30.0), (5.0, 60.0)), ((5.0, 60.0), (22.0, 30.0))]


def saturation_hpa(temperature_c):
    """Over water, Magnus (Sonntag 1990)."""
    return 6.112 * np.exp(17.62 * temperature_c / (243.12 + temperature_c))


def record(folder, chip_s, noise, with_chip, seed=1):
    """Runs of a well-mixed film on a chip that lags the air by `chip_s`: f' = (e / P_s(T_chip) - f) / FILM_S."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, END_S, PERIOD_S)
    after = time > START_S
    for i, ((source_c, source), (air_c, air)) in enumerate(PAIRS, start=1):

        def chip(at, source_c=source_c, air_c=air_c):
            return air_c + (source_c - air_c) * np.exp(-np.maximum(at - START_S, 0.0) / max(chip_s, 1e-3))

        def slope(at, film, air=air, air_c=air_c, chip=chip):
            return (min(air * saturation_hpa(air_c) / saturation_hpa(chip(at)), 100.0) - film) / FILM_S

        film = np.full(time.size, source)
        solved = solve_ivp(slope, (START_S, END_S), [source], t_eval=time[after], rtol=1e-9, atol=1e-9, max_step=0.2)
        film[after] = solved.y[0]
        table = {"time_s": time, "humidity_percent": film + random.normal(0.0, noise, time.size)}
        if with_chip:
            table["temperature_c"] = chip(time)
        home = folder / "runs" / f"{i:04d}"
        home.mkdir(parents=True)
        rows = np.column_stack(list(table.values()))
        np.savetxt(home / "hyt.csv", rows, "%.5f", ",", header=",".join(table), comments="")
        airs = {
            name: {"temperature_c": c, "humidity_percent": percent}
            for name, c, percent in (("source", source_c, source), ("destination", air_c, air))
        }
        run = {"format": "shock-run/1", "id": home.name, "transfer": {"start_s": START_S}} | airs
        (home / "run.json").write_text(json.dumps(run))
    sensors = {"hyt": {"kind": "as logged", "body": "lumped"}}
    (folder / "campaign.json").write_text(json.dumps({"format": "shock-campaign/1", "name": "x", "sensors": sensors}))
    return read_campaign(folder)


@pytest.mark.parametrize(("chip_s", "with_chip"), [(15.0, True), (40.0, True), (0.0, False)])
def test_it_is_the_films_own_equation_on_a_chip_that_lags_and_on_one_that_does_not(tmp_path, chip_s, with_chip):
    channel = build_channel(record(tmp_path, chip_s, 0.0, with_chip), "humidity")
    model = Model(channel, structure_of(["uptake_by_activity"]))
    rates = np.full((1, channel.rates), -np.log(FILM_S))
    reading = evaluate(model.chain(Point(rates, channel.at_rest()[None])), channel.quantity.reading)[0]
    # Of Magnus against McRae, in a factor 3 of saturation, 0.1 %; of the die, smoothed, 0.02 K.
    off = np.where(channel.count > 0, reading - channel.value, 0.0)
    assert np.abs(off).max() < 0.35
    assert np.abs(channel.value - channel.conditions.source_percent[:, None]).max() > 25.0


def test_it_is_named_from_the_readings_and_predicts_runs_that_took_no_part(tmp_path):
    found = diagnose(record(tmp_path, 15.0, 0.1, True)).channels[0]
    assert [cause.effect for cause in found.causes] == ["uptake_by_activity"]
    assert found.gain.before > 20 * found.gain.after
    assert found.gain.after < 0.3
