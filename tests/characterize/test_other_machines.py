"""The same seed makes the same world, and the same readings the same result, whatever the processor computes last."""

import json
import os
import platform
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_worlds import record, small_plan
from test_curvature import bent_ridge, itself

from shockrig.analysis.characterize import curvature
from shockrig.rig.virtual.hide import draw_effect

pytestmark = pytest.mark.elsewhere

TOLD_APART = 1e-3  # standard uncertainties


def older_machine():
    """The environment in which NumPy and OpenBLAS leave out all that this processor has beyond the oldest."""
    found = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    without = {"NPY_DISABLE_CPU_FEATURES": " ".join([os.environ.get("NPY_DISABLE_CPU_FEATURES", ""), *found]).strip()}
    return without | ({"OPENBLAS_CORETYPE": "Nehalem"} if platform.machine() in ("x86_64", "AMD64") else {})


def of(environment, *arguments):
    """What machine_process.py prints in an environment."""
    command = [sys.executable, str(Path(__file__).parents[1] / "machine_process.py"), *map(str, arguments)]
    done = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def leaves(value, path=""):
    """{path: number, text or None} of JSON content."""
    if isinstance(value, dict | list):
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        return {k: v for key, one in pairs for k, v in leaves(one, f"{path}/{key}").items()}
    return {path: value}


@pytest.fixture(scope="module")
def drawn_here():
    return leaves(of({"PYTHONHASHSEED": "1"}, "draws"))


@pytest.mark.parametrize(
    ("environment", "options"),
    [
        (older_machine() | {"PYTHONHASHSEED": "2"}, ()),
        ({"PYTHONHASHSEED": "3"}, ("--nudged", "up")),
        ({"PYTHONHASHSEED": "4"}, ("--nudged", "down")),
    ],
)
def test_a_seed_draws_the_same_on_every_machine(drawn_here, environment, options):
    there = leaves(of(environment, "draws", *options))
    assert list(there) == list(drawn_here)
    for path, here in drawn_here.items():
        if isinstance(here, float):
            assert there[path] == pytest.approx(here, rel=1e-12, abs=0.0), path
        else:
            assert there[path] == here, path


def test_a_campaign_says_the_same_on_every_machine(tmp_path):
    rng = np.random.default_rng(3)
    record(tmp_path / "c", 11, [draw_effect(rng, "convective_film")], tier="rough", plan=small_plan()[::3])
    here = of({"PYTHONHASHSEED": "1"}, "fits", tmp_path / "c")
    there = of(older_machine() | {"PYTHONHASHSEED": "2"}, "fits", tmp_path / "c", "--nudged", "up")
    assert there["names"] == here["names"] and here["names"][0] == "explained"
    assert list(there["numbers"]) == list(here["numbers"])
    for name, pairs in here["numbers"].items():
        for (value, u), (other, other_u) in zip(pairs, there["numbers"][name], strict=True):
            assert other == pytest.approx(value, abs=TOLD_APART * u, rel=1e-12), name
            assert other_u == pytest.approx(u, rel=TOLD_APART), name


def test_draws_along_a_ridge_hang_on_no_sign():
    ridge = bent_ridge()
    sign = np.array([-1.0, 1.0])
    other = replace(ridge, basis=ridge.basis * sign, z=ridge.z * sign, effects=ridge.effects * sign[:, None])
    (here,), (there,) = (curvature.drawn(one, [itself]) for one in (ridge, other))
    assert there.error == pytest.approx(here.error, abs=1e-12)
