"""Compiled parts: what was built from another source than lies beside it is told, and not used."""

import importlib.util
import sys
import types
from pathlib import Path

import pytest

from shockrig.analysis.flight import smoother
from shockrig.analysis.physics import driven, exponentials
from shockrig.files import flight_cells
from shockrig.files.compiled import demand_current
from shockrig.rig.virtual.physics import chains

USERS = [
    (flight_cells, "_cells"),
    (smoother, "_kernel"),
    (exponentials, "_sums"),
    (driven, "_sums"),
    (chains, "_march"),
]


@pytest.mark.parametrize(("user", "name"), USERS, ids=[user.__name__.rpartition(".")[2] for user, _ in USERS])
def test_a_part_of_another_source_is_told_once_and_not_used(monkeypatch, user, name):
    old = types.ModuleType(f"{user.__package__}.{name}", "of before the change")
    old.__file__ = str(Path(user.__file__).with_name(f"{name}.abi3.so"))
    monkeypatch.setattr(sys.modules[user.__package__], name, old, raising=False)
    spec = importlib.util.spec_from_file_location("beside_an_old_build", user.__file__)
    anew = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, anew)
    with pytest.warns(RuntimeWarning, match=rf"{name}.*takes longer; build it once more: pip install -e \.") as told:
        spec.loader.exec_module(anew)
    assert len(told) == 1 and getattr(anew, name) is None


def test_a_part_without_its_source_beside_it_is_used(tmp_path):
    part = types.ModuleType("shockrig.files._cells", "of any version")
    part.__file__ = str(tmp_path / "_cells.abi3.so")
    demand_current(part)
