"""Every snippet of README and how-to's runs, on the samples that ship; tutorial and gallery are run by .ci/docs."""

import contextlib
import doctest
import re
import shlex
from pathlib import Path

import pytest

from shockrig.protocols.cli import main

ROOT = Path(__file__).parents[2]
RUN_BY_CI = {"tutorial.md", "gallery_logs.md"}  # docs/refresh_tutorial.py, docs/refresh_gallery.py
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```(console|pycon)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
WITH_SNIPPETS = [page for page in PAGES if page.name not in RUN_BY_CI and BLOCK.search(page.read_text("utf-8"))]
NUMBER = re.compile(r"\d+(?:\.\d+)?")
WIDEST = 120


class Near(doctest.OutputChecker):
    """What is printed has the same words; numbers as good as equal, since processors round differently."""

    def check_output(self, want, got, optionflags):
        words = [NUMBER.sub("0", text).split() for text in (want, got)]
        numbers = zip(NUMBER.findall(want), NUMBER.findall(got), strict=False)
        return words[0] == words[1] and all(
            abs(float(a) - float(b)) <= max(0.05 * float(a), 2.0 * 10.0 ** -len(a.partition(".")[2]))
            for a, b in numbers
        )


@pytest.mark.parametrize("page", WITH_SNIPPETS, ids=lambda page: page.name)
def test_a_page_does_what_it_shows(page, tmp_path, monkeypatch, capsys):
    """Its blocks one after the other, in one empty folder."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for number, (kind, text) in enumerate(BLOCK.findall(page.read_text(encoding="utf-8"))):
        if kind == "pycon":
            example = doctest.DocTestParser().get_doctest(text, names, f"{page.name}, block {number}", page.name, 0)
            runner = doctest.DocTestRunner(Near(), optionflags=doctest.NORMALIZE_WHITESPACE)
            assert runner.run(example, clear_globs=False).failed == 0
            names = example.globs
            continue
        for line in re.findall(r"^\$ (.*)$", text, re.MULTILINE):
            run(line, tmp_path, capsys)


def run(line, folder, capsys):
    """One line as a shell would: a command of shockrig, and where its output goes."""
    words = shlex.split(line, comments=True)
    target = words[words.index(">") + 1] if ">" in words else None
    arguments = words[1 : words.index(">")] if target else words[1:]
    assert words[0] == "shockrig", line
    if "[ardupilot]" in line or any(word.endswith(".bin") for word in words):
        pytest.importorskip("pymavlink")
    with contextlib.suppress(SystemExit):
        status = main(arguments)
        printed = capsys.readouterr()
        assert status == 0, f"{line}: {printed.err}"
        if target:
            (folder / target).write_text(printed.out)
        return
    raise AssertionError(f"{line}: {capsys.readouterr().err}")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_lines_are_as_wide_as_they_can_be_read(page):
    """Tables and what commands print are as wide as they are."""
    text = page.read_text(encoding="utf-8")
    prose = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.MULTILINE | re.DOTALL)
    wide = [line for line in prose.splitlines() if len(line) > WIDEST and not line.startswith(("|", "    "))]
    assert not wide, wide[0]


def test_the_readme_is_read_in_two_minutes():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 100 and max(map(len, lines)) <= WIDEST
