"""The house itself: the linters are clean, all packages ship, the README's test command is what CI runs."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


@pytest.mark.parametrize("command", [["ruff", "check", "."], ["lint-imports"]], ids=["ruff", "import-linter"])
def test_linters_are_clean(command):
    done = subprocess.run(
        [Path(sys.executable).parent / command[0], *command[1:]], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr


def test_every_package_ships():
    found = {
        ".".join(file.parent.relative_to(ROOT).parts)
        for top in ("rig", "analysis", "protocols")
        for file in (ROOT / top).rglob("__init__.py")
    }
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == found | {"shockrig_data"}
    folders = {file.parent for top in ("rig", "analysis", "protocols") for file in (ROOT / top).rglob("*.py")}
    assert all((folder / "__init__.py").exists() for folder in folders)


def test_the_readme_and_ci_run_one_test_command():
    command = "python3 -m venv .venv && .venv/bin/pip install -q -c requirements.lock -e '.[test]' && .venv/bin/pytest"
    assert command in (ROOT / "README.md").read_text()
    assert command.replace("'", '"') in (ROOT / ".ci" / "run").read_text()


def test_the_lock_pins_every_dependency():
    lines = (ROOT / "requirements.lock").read_text().splitlines()
    pinned = {line.split("==")[0].lower() for line in lines if "==" in line}
    wanted = [*PROJECT["project"]["dependencies"], *PROJECT["project"]["optional-dependencies"]["test"]]
    assert {w.split(">=")[0].lower() for w in wanted} <= pinned
