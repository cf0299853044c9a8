"""What must hold of readings that leap away and back: a run has none that its sensor cannot have made."""

import numpy as np
from made_up_logs import lag, series, text, written

from shockrig.protocols.cli import main
from shockrig.rig.logs.leaps import leaps

TIME_S = 30.0 * np.arange(200)


def test_broken_frames_of_a_slow_sensor_are_no_readings(tmp_path, capsys):
    """A shifted frame of a DHT22 reads half the temperature: of a sensor of 100 s a tenth of a run's noise was that."""
    random = np.random.default_rng(1)
    true = 20.0 + 8.0 * lag(TIME_S - 3000.0, 100.0) + random.normal(0.0, 0.03, TIME_S.size)
    read = true.copy()
    broken = [40, 95, 103, 150, 151]  # at rest, before the step, on the way, two in a row
    read[broken] *= 0.5
    lines = [f"{t:.0f},{value:.1f}" for t, value in zip(TIME_S, read, strict=True)]
    log, out = written(tmp_path / "log.csv", text(["time_s,temp", *lines])), tmp_path / "campaign"
    assert main(["import", str(log), "--look", "--out", str(tmp_path)]) == 0
    assert main(["import", str(log), "--map", str(tmp_path / "log.toml"), "--out", str(out)]) == 0
    assert "5 readings of temperature left out: away and back" in capsys.readouterr().out
    run = series(out / "runs" / "0001", "imet")
    assert run["temperature_c"].min() > 19.0


def test_what_a_sensor_can_do_is_left():
    """A sensor that is faster than its readings may leap; a slow one that comes back as slowly; and a step is none."""
    calm = 20.0 + 0.02 * np.sin(np.arange(200.0))
    leapt = np.where(np.arange(200) == 50, 30.0, calm)
    assert np.flatnonzero(leaps(TIME_S, leapt, 100.0, 0.5)).tolist() == [50]
    assert not leaps(TIME_S, leapt, 3.0, 0.5).any()
    after_s = TIME_S - 1500.0
    decays = 10.0 * np.exp(-np.maximum(after_s, 0.0) / 60.0) * (after_s >= 0.0)
    for value in (calm + 10.0 * (after_s >= 0.0), calm + decays):
        assert not leaps(TIME_S, value, 60.0, 0.5).any()
    # what turns back towards an air beyond where it came from comes back the faster: DS18B20 of 18 s, every 16 s
    turned = [31.11, 25.16, 26.48, 30.33, 33.0, 34.71, 35.99, 37.25, 37.31, 36.24, 35.7, 35.01, 34.6, *(50 * [33.25])]
    assert not leaps(16.0 * np.arange(63.0), np.array(turned), 17.8, 0.5).any()
