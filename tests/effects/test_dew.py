"""Dew needs a humidity: where nobody recorded one, nothing is said of what dew would do."""

import json

import numpy as np
import pytest

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.physics.air_exchange import dew_margin_k
from shockrig.files.campaign import read_campaign


def channel_of(folder, humidity):
    """A thermometer out of 0 degC into 60 degC; `humidity` (percent) is that of both airs where it is recorded."""
    time = np.arange(0.0, 60.0, 0.1)
    for i in (1, 2):
        run = folder / "runs" / f"{i:04d}"
        run.mkdir(parents=True)
        shown = 60.0 - 60.0 * np.exp(-np.maximum(time - 10.0, 0.0) / 4.0)
        shown = shown + 0.02 * np.random.default_rng(i).standard_normal(time.size)
        rows = "".join(f"{t:.6g},{y:.4f}\n" for t, y in zip(time, shown, strict=True))
        (run / "imet.csv").write_text("time_s,temperature_c\n" + rows)
        airs = {name: {"temperature_c": t} | humidity for name, t in (("source", 0.0), ("destination", 60.0))}
        (run / "run.json").write_text(json.dumps({"format": "shock-run/1", "id": run.name, "start_s": 10.0, **airs}))
    head = {"format": "shock-campaign/1", "name": "carried", "sensors": {"imet": {"kind": "probe", "body": "lumped"}}}
    (folder / "campaign.json").write_text(json.dumps(head))
    return build_channel(read_campaign(folder), "temperature")


@pytest.mark.parametrize(("humidity", "known"), [({}, False), ({"humidity_percent": 50.0}, True)])
def test_dew_is_looked_for_where_the_humidity_is_known(tmp_path, humidity, known):
    channel = channel_of(tmp_path / "c", humidity)
    assert CATALOGUE["evaporative_cooling"].acts_in(channel) is known
    assert (dew_margin_k(channel.conditions) > 0).all() == known
