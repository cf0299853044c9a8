"""A sample of benchmarks/fuzz_commands.py: files that are not what they seem, and options that cannot be."""

import json
import os
import random
import tempfile
from pathlib import Path

import pytest
from benchmark_scripts import benchmark

fuzz, kinds = benchmark("fuzz_commands"), benchmark("fuzz_kinds")
SAMPLE, SEED = 16, 12


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return benchmark("fuzz_made").sound(tmp_path_factory.mktemp("made") / "sound")


@pytest.fixture
def place():
    """A folder that nobody, too, may look into: some cases are run as nobody."""
    with tempfile.TemporaryDirectory(dir="/tmp") as name:
        os.chmod(name, 0o755)
        yield Path(name)
        for where, folders, _ in os.walk(name):
            for one in folders:
                if not os.path.islink(os.path.join(where, one)):
                    os.chmod(os.path.join(where, one), 0o755)


@pytest.mark.parametrize("number", range(SAMPLE))
def test_nothing_that_a_user_names_breaks_a_command(made, place, number):
    from shockrig.protocols.cli import main

    case = fuzz.cases(SAMPLE, SEED)[number]
    status, said, wrong = fuzz.run(case, made, place, main)
    assert not wrong, (case.words, case.about, status, said)


def test_what_is_wrong_is_seen(made, place):
    """The measure itself can fail: a traceback, a status, something left behind, a number that is none."""

    def bad(words):
        Path("o.json").write_text('{"a": NaN}')
        Path("o.csv.part").write_text("half")
        raise RuntimeError("no")

    case = fuzz.Case(("status", "r"), "nothing", lambda folder: None)
    status, _, wrong = fuzz.run(case, made, place, bad)
    assert status == 97
    for words in ("RuntimeError: no", "exit status 97", "half-written: ['o.csv.part']", "no numbers in o.json"):
        assert any(words in one for one in wrong), wrong


def test_the_damage_is_real_and_of_every_kind():
    sound = json.dumps({"a": {"b": [1.0, 2.0]}, "c": "x"}).encode()
    assert all(kinds.structured(random.Random(i), "x.json", sound) != sound for i in range(100))
    about = [case.about for case in fuzz.cases(400, 1)]
    for thing in kinds.THINGS:
        assert any(f" is {thing}" in one for one in about), thing
