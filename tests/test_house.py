"""The house itself: CI runs the linters, all packages ship, the README's test command is what CI runs."""

import re
import tomllib
from collections import Counter
from hashlib import sha256
from pathlib import Path

ROOT = Path(__file__).parent.parent
TOPS = ("files", "rig", "analysis", "protocols")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_every_package_ships():
    found = {
        "shockrig." + ".".join(file.parent.relative_to(ROOT).parts)
        for top in TOPS
        for file in (ROOT / top).rglob("__init__.py")
    }
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == found | {"shockrig", "shockrig.data"}
    folders = {file.parent for top in TOPS for file in (ROOT / top).rglob("*.py")}
    assert all((folder / "__init__.py").exists() for folder in folders)


def test_a_module_is_where_its_name_says():
    """Editors and type checkers follow `shockrig.analysis.x` in a plain checkout."""
    for top in (*TOPS, "data"):
        assert (ROOT / "shockrig" / top).samefile(ROOT / top)


def test_a_class_has_a_name_of_its_own():
    texts = [file.read_text() for top in TOPS for file in (ROOT / top).rglob("*.py")]
    names = Counter(name for text in texts for name in re.findall(r"^class (\w+)[(:]", text, re.MULTILINE))
    assert [name for name, count in names.items() if count > 1] == []


def test_a_file_has_a_name_of_its_own():
    """But a command's file bears the name of what it calls, an emulated chip that of its driver, and a family of the
    catalogue that of its link of the chain."""
    files = [*(ROOT / "shockrig").glob("*.py"), *(file for top in TOPS for file in (ROOT / top).rglob("*.py"))]
    on_purpose = {ROOT / "protocols" / "commands", ROOT / "rig" / "virtual" / "chips", ROOT / "analysis" / "effects"}
    names = Counter(file.name for file in files if file.parent not in on_purpose and file.name != "__init__.py")
    assert [name for name, count in names.items() if count > 1] == []


def test_compiled_parts_say_which_source_they_are_of():
    """So that what was built before a change is not used after it (files/compiled.py)."""
    for part in PROJECT["tool"]["setuptools"]["ext-modules"]:
        text = (ROOT / part["sources"][0]).read_text()
        others, said = re.subn(r'^#define SOURCE "\w+".*\n', "", text, flags=re.MULTILINE)
        wanted = f'#define SOURCE "{sha256(others.encode()).hexdigest()[:16]}"'
        assert said == 1 and wanted in text, f"{part['sources'][0]}: state {wanted}"


def test_the_readme_and_ci_run_one_test_command():
    command = "python3 -m venv .venv && .venv/bin/pip install -q -c requirements.lock -e '.[test]' && .venv/bin/pytest"
    assert command in (ROOT / "README.md").read_text()
    assert command.replace("'", '"') in (ROOT / ".ci" / "run").read_text()


def test_ci_runs_the_static_checks():
    """They take half a minute of a processor, and are run by hand with `.ci/lint`."""
    assert 'PATH="$environment/bin:$PATH" .ci/lint\n' in (ROOT / ".ci" / "run").read_text()


def test_the_lock_pins_every_dependency():
    lines = (ROOT / "requirements.lock").read_text().splitlines()
    pinned = {line.split("==")[0].lower() for line in lines if "==" in line}
    extras = PROJECT["project"]["optional-dependencies"].values()
    wanted = [*PROJECT["project"]["dependencies"], *(name for extra in extras for name in extra)]
    assert {w.split(">=")[0].lower() for w in wanted} <= pinned


def test_the_citation_and_the_changelog_know_the_version():
    version = PROJECT["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"## [{version}]" in (ROOT / "CHANGELOG.md").read_text()
