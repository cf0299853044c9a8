"""What is said of the time that is left: nothing of what is soon over, else the share done over the time spent."""

import io

import pytest

from shockrig.protocols.cli import main
from shockrig.protocols.run_progress import LineObserver
from shockrig.protocols.time_left import CountedRows, Phases, TimeLeft, in_words


class Clock:
    def __init__(self):
        self.s = 0.0

    def __call__(self):
        return self.s


def test_the_time_left_is_as_coarse_as_it_is_known():
    assert [in_words(s) for s in (1.0, 27.0, 200.0, 9000.0)] == [
        "about 5 s left",
        "about 25 s left",
        "about 3 min left",
        "about 2.5 h left",
    ]


def test_what_is_soon_over_is_not_worth_a_word():
    now = Clock()
    clock = TimeLeft(now)
    now.s = 1.0
    assert clock.after(0.5) == ""  # two seconds in all
    assert clock.after(0.1) == " (about 10 s left)"
    assert clock.after(0.0) == clock.after(1.0) == ""


def test_a_phase_says_what_is_left_by_what_phases_usually_take():
    now, said = Clock(), io.StringIO()
    say = Phases({"first": 0.1, "second": 0.5}, said, TimeLeft(now))
    say("reading")
    now.s = 10.0
    say("second: of one")
    say("first: of another, which is behind")
    assert said.getvalue().splitlines() == [
        "reading",
        "second: of one (about 10 s left)",
        "first: of another, which is behind",
    ]


def test_rows_are_told_every_few_seconds(capsys):
    now = Clock()
    progress = CountedRows(1000, TimeLeft(now), now)
    for s, rows in ((2.0, 100), (6.0, 200), (8.0, 300), (12.0, 400)):
        now.s = s
        progress(rows)
    assert capsys.readouterr().err.splitlines() == [
        "200 of about 1000 rows corrected (about 25 s left)",
        "400 of about 1000 rows corrected (about 20 s left)",
    ]


def test_a_campaign_that_goes_on_counts_from_its_first_run(monkeypatch):
    from shockrig.rig.protocol import load_protocol

    now, said = Clock(), io.StringIO()
    monkeypatch.setattr("shockrig.protocols.run_progress.TimeLeft", lambda: TimeLeft(now))
    lines = LineObserver(said)
    run = load_protocol("quick").runs[0]
    lines.run_began(run, 21, 30, 0.0)
    now.s = 20.0
    lines.run_began(run, 22, 30, 20.0)
    first, second = said.getvalue().splitlines()
    assert "left" not in first and second.endswith("(about 3 min left)")


def test_the_tour_is_told_where_it_would_write_over_something(tmp_path, capsys):
    (tmp_path / "there").write_text("")
    assert main(["tour", "--yes", "--out", str(tmp_path)]) == 2
    assert "is there already" in capsys.readouterr().err


def test_the_tour_types_commands_that_there_are():
    import shlex

    from shockrig.protocols.cli import build_parser
    from shockrig.protocols.commands.tour import STOPS

    for command in (command for stop in STOPS for command in stop.commands):
        name, *words = shlex.split(command)[1:]
        assert build_parser(name).parse_args([name, *words]).command == name


@pytest.mark.parametrize("name", ["steps.csv", "plain-rough"])
def test_examples_are_copied_and_never_over_something(tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    assert main(["example", name]) == 0 and capsys.readouterr().out == f"{name}\n"
    assert (tmp_path / name).exists()
    assert main(["example", name]) == 2 and "is there already" in capsys.readouterr().err
    assert main(["example"]) == 0 and name in capsys.readouterr().out


def test_a_shipped_bench_is_printed_to_be_copied(capsys):
    from shockrig.rig.bench_file import check_bench

    assert main(["bench"]) == 0 and "raspberry-pi" in capsys.readouterr().out
    assert main(["bench", "raspberry-pi"]) == 0
    import tomllib

    check_bench(tomllib.loads(capsys.readouterr().out), "copied")
    assert main(["bench", "pi"]) == 2 and "give one of drone, manual, raspberry-pi, virtual" in capsys.readouterr().err
