"""The command line's own words: errors are one line with a remedy; --version, completion, a quick --help."""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from shockrig.protocols.cli import COMMANDS, build_parser, main
from shockrig.protocols.parser import Parser

ROOT = Path(__file__).parents[2]


def said(capsys, *arguments):
    """Standard error of a command line that must be refused: one line, status 2, nothing on standard output."""
    with pytest.raises(SystemExit) as end:
        main(list(arguments))
    captured = capsys.readouterr()
    assert end.value.code == 2
    assert captured.out == ""
    assert captured.err.count("\n") == 1 and captured.err.endswith("\n")
    return captured.err


@pytest.mark.parametrize(
    ("arguments", "names", "remedy"),
    [
        ([], "COMMAND is missing", "--help lists"),
        (["charcterize"], "charcterize", "did you mean characterize?"),
        (["zzz"], "zzz", "--help lists"),
        (["--verzion"], "--verzion", "did you mean --version?"),
        (["--foo=1", "diagnose"], "--foo", "--help lists"),
        (["diagnose"], "CAMPAIGN, --out", "diagnose --help"),
        (["diagnose", "c"], "required: --out", "diagnose --help"),
        (["diagnose", "c", "--out"], "--out", "expected one argument"),
        (["diagnose", "c", "--out", "d", "--sed", "3"], "--sed", "did you mean --seed?"),
        (["diagnose", "c", "--out", "d", "--seed", "3.5"], "--seed", "expected a whole number, found '3.5'"),
        (["diagnose", "c", "--out", "d", "--seed", "x" * 500], "--seed", "expected a whole number"),
        (["diagnose", "c", "--out", "d", "--seed", "a\nb"], "--seed", "expected a whole number"),
        (["watch", "c", "--every", "often"], "--every", "expected a number"),
        (["watch", "c", "--once=3"], "--once", "watch --help"),
        (["correct", "f", "--profile", "p", "--out", "o", "--method", "best"], "--method", "smoother"),
        (["simulate", "tornado", "--out", "o"], "scene", "frontal"),
        (["status", "a", "b"], "'b'", "one argument too many"),
        (["hyt-address", "--bus", "1", "--address", "0x80"], "--address", "expected 0x00 to 0x7F"),
        (["emulate", "hyt-271", "--address", "forty"], "--address", "such as 40 or 0x28"),
        (["--print-completion", "fish"], "--print-completion", "zsh"),
    ],
)
def test_an_error_in_the_arguments_is_one_line_that_names_it_and_the_remedy(capsys, arguments, names, remedy):
    line = said(capsys, *arguments)
    assert line.startswith("shockrig")
    assert names in line and remedy in line
    assert len(line) < 200


def test_a_command_takes_one_thread_for_linear_algebra_unless_told_otherwise(monkeypatch):
    """Small matrices in many threads wait for one another; NumPy reads this when it is first imported."""
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    with pytest.raises(SystemExit):
        main(["--version"])
    assert (os.environ["OPENBLAS_NUM_THREADS"], os.environ["OMP_NUM_THREADS"]) == ("1", "3")


def test_messages_of_argparse_that_are_not_known_keep_its_words(capsys):
    parser = Parser(prog="shockrig x")
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--a", action="store_true")
    group.add_argument("--b", action="store_true")
    with pytest.raises(SystemExit) as end:
        parser.parse_args(["--a", "--b"])
    assert end.value.code == 2
    line = capsys.readouterr().err
    assert line.startswith("shockrig x: --b: ") and "--a" in line and line.count("\n") == 1


def test_no_option_may_be_abbreviated(capsys):
    assert "--profile" in said(capsys, "correct", "f", "--prof", "p", "--out", "o")


def test_version(capsys):
    with pytest.raises(SystemExit) as end:
        main(["--version"])
    assert end.value.code == 0
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert capsys.readouterr().out == f"shockrig {version}\n"


def test_help_does_not_wait_for_anything_heavy():
    """`--help` and `import shockrig` load no package that takes long to load."""
    heavy = "{'numpy', 'scipy', 'pandas', 'matplotlib', 'serial', 'nlopt', 'rich', 'shtab'} & set(sys.modules)"
    for program in (
        "import sys, shockrig, shockrig.protocols.cli",
        "import sys\nfrom shockrig.protocols.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass",
    ):
        code = f"{program}\nfound = {heavy}\nassert not found, found"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


def _completed(script, words, tmp_path):
    """What bash offers for the last of `words`."""
    file = tmp_path / "completion.bash"
    file.write_text(script)
    program = (
        f"source {file}; COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; "
        "complete -p shockrig | grep -o -- '-F [^ ]*' | cut -c4- > name; $(cat name); "
        "printf '%s\\n' \"${COMPREPLY[@]}\""
    )
    done = subprocess.run(["bash", "-c", program], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_bash_completes_commands_options_choices_and_files(capsys, tmp_path):
    with pytest.raises(SystemExit) as end:
        main(["--print-completion", "bash"])
    assert end.value.code == 0
    script = capsys.readouterr().out
    (tmp_path / "flight.csv").write_text("")
    assert _completed(script, ["shockrig", "''"], tmp_path) >= set(COMMANDS)
    assert _completed(script, ["shockrig", "di"], tmp_path) == {"diagnose"}
    assert _completed(script, ["shockrig", "correct", "--me"], tmp_path) == {"--method"}
    assert _completed(script, ["shockrig", "correct", "--method", "s"], tmp_path) == {"smoother"}
    assert _completed(script, ["shockrig", "correct", "fli"], tmp_path) == {"flight.csv"}


@pytest.mark.parametrize("shell", ["zsh", "tcsh"])
def test_other_shells_have_a_script_with_every_command(capsys, shell):
    with pytest.raises(SystemExit):
        main(["--print-completion", shell])
    script = capsys.readouterr().out
    assert all(name in script for name in COMMANDS)


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_argument_says_what_it_is_for(name):
    """No argument without a word of help, for people, completion and the reference alike."""
    commands = next(a for a in build_parser(name)._actions if isinstance(a, argparse._SubParsersAction))
    silent = [a.dest for a in commands.choices[name]._actions if not a.help]
    assert not silent


def test_the_readme_lists_commands_that_exist():
    named = set(re.findall(r"`shockrig ([a-z][a-z-]*)", (ROOT / "README.md").read_text()))
    assert named <= set(COMMANDS)
