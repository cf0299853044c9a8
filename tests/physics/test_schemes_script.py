"""The script that benchmarks stand in for a user finds the diffusivity that was put in, from the files alone."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np
import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "obvious_script.py"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("obvious_script", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def write_campaign(folder, alpha):
    """One thermal run with a start between samples, its readings from the series; no humidity file."""
    run = folder / "runs" / "0001"
    run.mkdir(parents=True)
    (folder / "campaign.json").write_text(json.dumps({"format": "shock-campaign/1", "sensors": {"imet": {}}}))
    airs = {"source": {"temperature_c": 30.0, "humidity_percent": 30.0},
            "destination": {"temperature_c": 10.0, "humidity_percent": 60.0}}  # fmt: skip
    (run / "run.json").write_text(json.dumps({"id": "0001", **airs, "transfer": {"start_s": 3.0417}}))
    time = np.arange(0.013, 15.0, 0.1)
    n = np.arange(1, 200)
    elapsed = np.maximum(time - 3.0417, 0.0)
    decay = np.exp(-np.multiply.outer(elapsed, (n * np.pi) ** 2 * alpha / 4e-4**2))
    share = np.where(time > 3.0417, 1 + 2 * np.sum((-1.0) ** n * decay, axis=1), 0.0)
    lines = "".join(f"{t:.4f},{30.0 - 20.0 * s:.5f}\n" for t, s in zip(time, share, strict=True))
    (run / "imet.csv").write_text("time_s,temperature_c\n" + lines)


def test_the_script_finds_alpha_to_the_accuracy_of_its_scheme(script, tmp_path, capsys):
    write_campaign(tmp_path, 7.5e-8)
    lines = []
    (fit,) = script.fit_campaign(tmp_path, layers=16, popsize=6, progress=lines.append)
    assert (fit.run, fit.channel, fit.ambient_c) == ("0001", "temperature", 10.0)
    assert fit.diffusivity_m2_s == pytest.approx(7.5e-8, rel=0.02) and len(lines) == 1
    (printed,) = script.fit_campaign(tmp_path, layers=5, scheme="printed", popsize=6)
    assert printed.diffusivity_m2_s > 1.2 * fit.diffusivity_m2_s
    script.main([str(tmp_path), "--popsize", "6", "--maxiter", "3"])
    assert "1 fits" in capsys.readouterr().out
