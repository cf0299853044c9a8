"""What an operator does at a prompt, through a pseudo-terminal and in real time: docs/watching.md lists it."""

import contextlib
import io
import json
import os
import re
import select
import signal
import subprocess
import sys
import termios
import time
from functools import partial
from pathlib import Path

import pytest
from fake_bench import STEPS, fake_bench, plan
from fake_bench import run as record
from made_recordings import STATUS, made_campaign, reading
from processes import PATIENCE_S, ended, wait_for

from shockrig.files.campaign import read_campaign
from shockrig.protocols.cli import main
from shockrig.protocols.watch.terminal import render
from shockrig.rig.bench_errors import CampaignAborted, CampaignPaused, RunRepeated, RunSkipped
from shockrig.rig.clock import VirtualClock
from shockrig.rig.journal import read_journal
from shockrig.rig.operator import KEYS, ConsoleOperator
from shockrig.rig.recorder import read_state
from shockrig.rig.watch.follow import Follower

pytestmark = pytest.mark.timeout(300)
ROOT = Path(__file__).parents[2]
# Emulated sensors that lie in their room, 20 degC and 50 %RH, in real time; everything else is a person's.
BENCH = """
[bench]
name = "by hand"
clock = "real"
answer_within_s = {answer_s}
[sensors.imet]
kind = "imet-xf"
port = "virtual"
[sensors.hyt]
kind = "hyt-271"
bus = "virtual"
conversion_s = 0.07
[stage]
kind = "manual"
within_s = {move_s}
[reference]
kind = "operator"
"""
PROTOCOL = """
format = "shock-protocol/1"
name = "by hand"
faults = {{ repeat_at_most = {repeat}, largest_gap_s = {gap_s}, missing_percent_at_most = 90 }} # a busy machine is none
[steps]
usual = [
  {{ do = "soak", over_s = 1, at_most_s = {soak_s}, probes_within_k = 1, probes_within_percent = 2 }},
  {{ do = "record", for_s = 1 }},
  {{ do = "transfer", at_most_s = 60 }},
  {{ do = "record", for_s = 1 }},
]
[[run]]
source = {{ temperature_c = 20, humidity_percent = 50 }}
destination = {{ temperature_c = 20, humidity_percent = 50 }}
[[run]]
source = {{ temperature_c = 20, humidity_percent = 50 }}
destination = {{ temperature_c = 20, humidity_percent = 50 }}
"""
SET, PUT, MOVE = "Set the source air", "Put the probes into the source air", "Move the probes to the destination air"
SOURCE_C, SOURCE_RH = "source air, temperature", "source air, relative humidity"
DESTINATION_C, DESTINATION_RH = "destination air, temperature", "destination air, relative humidity"
PROMPTS = (SET, PUT, SOURCE_C, SOURCE_RH, DESTINATION_C, DESTINATION_RH, MOVE)


class Terminal:
    """A recording on a pseudo-terminal of its own, which is its controlling terminal: what it says, and a keyboard."""

    def __init__(
        self, folder, *more, answer_s=60, move_s=60, soak_s=60, repeat=0, bench=BENCH, source_c=20, gap_s=5, plan=None
    ):
        (folder / "bench.toml").write_text(bench.format(answer_s=answer_s, move_s=move_s))
        protocol = PROTOCOL.format(soak_s=soak_s, repeat=repeat, gap_s=gap_s)
        (folder / "protocol.toml").write_text(
            protocol.replace("{ temperature_c = 20", f"{{ temperature_c = {source_c}", 1)
        )
        self.out = folder / "c"
        words = ["run", plan or folder / "protocol.toml", "--bench", folder / "bench.toml", "--out", self.out, *more]
        self._master, slave = os.openpty()
        termios.tcsetwinsize(slave, (40, 120))
        self.process = subprocess.Popen(
            [sys.executable, "-m", "shockrig", *map(str, words)],
            cwd=ROOT,
            env={**os.environ, "TERM": "xterm"},
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
            preexec_fn=lambda: __import__("fcntl").ioctl(0, termios.TIOCSCTTY, 0),
        )
        os.close(slave)
        self.said, self._from = "", 0

    def wait_for(self, text, within_s=PATIENCE_S):
        """Wait until something new is said that has this text."""
        deadline_s = time.monotonic() + within_s
        while text not in self.said[self._from :]:
            assert time.monotonic() < deadline_s, f"waited in vain for {text!r} in {self.said[self._from :]!r}"
            if select.select([self._master], [], [], 0.1)[0]:
                try:
                    self.said += os.read(self._master, 1 << 16).decode("utf-8", "replace")
                except OSError:
                    assert text in self.said[self._from :], f"closed before {text!r}: {self.said[self._from :]!r}"
        self._from = self.said.index(text, self._from) + len(text)

    def type(self, line):
        os.write(self._master, f"{line}\n".encode())

    def answer(self, prompts=PROMPTS, with_=""):
        """Wait for each of the prompts and press Enter at it."""
        for prompt in prompts:
            self.wait_for(prompt)
            self.type(with_)

    def end(self, within_s=PATIENCE_S):
        """The exit status, with all that was said until then read."""
        deadline_s = time.monotonic() + within_s
        while self.process.poll() is None:
            assert time.monotonic() < deadline_s, f"it does not end: {self.said!r}"
            if select.select([self._master], [], [], 0.05)[0]:
                with contextlib.suppress(OSError):
                    self.said += os.read(self._master, 1 << 16).decode("utf-8", "replace")
        with contextlib.suppress(OSError):
            while select.select([self._master], [], [], 0.05)[0] and (more := os.read(self._master, 1 << 16)):
                self.said += more.decode("utf-8", "replace")
        return self.process.returncode

    def hang_up(self):
        os.close(self._master)
        self._master = -1

    def close(self):
        self.process.kill()
        self.process.wait()
        if self._master >= 0:
            os.close(self._master)


@pytest.fixture
def start(tmp_path):
    """Starts recordings that are gone after the test."""
    begun = []

    def begin(*more, **settings):
        begun.append(Terminal(tmp_path, *more, **settings))
        return begun[-1]

    yield begin
    for one in begun:
        one.close()


def aside(terminal):
    return [(one.id, one.status, one.reason) for one in read_state(terminal.out).set_aside]


def test_a_campaign_by_hand_with_wrong_keys_a_note_a_repeat_and_a_skip(start):
    one = start()
    one.wait_for(SET)
    one.type("q")
    one.wait_for("'q' is no answer here: Enter goes on, s skips this run")
    one.type("n the fan rattles, 3.2 m/s")
    one.wait_for("note: the fan rattles, 3.2 m/s")
    one.type("")
    one.answer([PUT])
    one.wait_for(SOURCE_C)
    one.type("warm")
    one.wait_for("'warm' is not a number from -100 to 150")
    one.type("q")
    one.wait_for("'q' is not a number")
    one.type("20,4")
    one.answer([SOURCE_RH, DESTINATION_C, DESTINATION_RH])
    one.wait_for(MOVE)
    one.type("r")
    one.wait_for("run 0001: the operator asked to repeat it")
    one.answer(PROMPTS)
    one.answer([SET, PUT])
    one.wait_for(SOURCE_C)
    one.type("s")
    one.wait_for("run 0002 is skipped by the operator; running the same command again records it")
    assert one.end() == 0
    state = read_state(one.out)
    assert state.recorded == ("0001",) and state.missing == ("0002",)
    assert aside(one) == [
        ("0001", "interrupted", "the operator asked to repeat it"),
        ("0002", "interrupted", "skipped by the operator"),
    ]
    (run,) = read_campaign(one.out).runs
    assert run.start_s is not None and run.extra["airs_from"] == {"source": "typed", "destination": "typed"}
    noted = json.loads((one.out / "set_aside/0001-1/run.json").read_text())
    assert [note["text"] for note in noted["notes"]] == ["the fan rattles, 3.2 m/s"]
    assert one.said.count("\a") >= 16  # every prompt rings


# what is asked before, and the prompt itself
PLACES = {"question": ((), SET), "number": ((SET, PUT), SOURCE_C), "transfer": (PROMPTS[:-1], MOVE)}


@pytest.fixture(params=PLACES)
def place(request):
    return PLACES[request.param]


def test_a_wrong_key_is_said_to_be_none_and_the_prompt_stays(start, place):
    before, prompt = place
    one = start()
    one.answer(before)
    one.wait_for(prompt)
    for key in ("q", "x y", "\x1b[A"):
        one.type(key)
        one.wait_for("is not a number from -100 to 150" if prompt is SOURCE_C else "is no answer here: Enter goes on")
    assert json.loads((one.out / "status.json").read_text())["prompt"]["text"].startswith(prompt)
    one.type("a")
    assert one.end() == 130 and aside(one) == [("0001", "interrupted", "aborted by the operator")]
    assert not [
        record for record in journal(one.out / "set_aside/0001-1") if record[0] == "move"
    ]  # it dates no transfer


def test_ctrl_c_keeps_what_there_is(start, place):
    before, prompt = place
    one = start()
    one.answer(before)
    one.wait_for(prompt)
    one.type("\x03")
    assert one.end() == 130 and aside(one) == [("0001", "interrupted", "stopped by the operator")]


@pytest.mark.elsewhere
def test_a_paused_campaign_goes_on(start):
    one = start()
    one.answer()
    one.wait_for(SET)
    one.type("p")
    assert one.end() == 2 and read_state(one.out).recorded == ("0001",)
    assert aside(one) == [("0002", "interrupted", "paused by the operator; the same command goes on from here")]
    again = start()
    again.answer()
    assert again.end() == 0 and read_state(again.out).recorded == ("0001", "0002")


def test_a_hang_up_is_filed_as_such(start, place):
    before, prompt = place
    one = start()
    one.answer(before)
    one.wait_for(prompt)
    one.hang_up()
    assert one.process.wait(PATIENCE_S) in (2, 128 + signal.SIGHUP)
    ((id_, status, reason),) = aside(one)
    assert (id_, status) == ("0001", "interrupted") and "hang-up" in reason and "Errno" not in reason
    assert "hang-up" in json.loads((one.out / "status.json").read_text())["reason"]


def test_absence_pauses(start, place):
    before, prompt = place
    one = start(gap_s=60, **{"move_s" if prompt is MOVE else "answer_s": 4})
    one.answer(before)
    one.wait_for(prompt)
    assert one.end() == 2
    ((_, status, reason),) = aside(one)
    assert status == "interrupted", reason
    assert reason.startswith(f"nobody answered in time ('{prompt}")


def test_what_is_typed_ahead_answers_questions_and_numbers_but_no_transfer(start):
    """All answers at once, and an Enter too many, which comes before the transfer is asked for."""
    one = start()
    one.wait_for(SET)
    one.type("\n\n20.25\n50.5\n20\n50\n")
    one.wait_for(MOVE)
    one.type("q")
    one.wait_for("is no answer here")
    one.type("a")
    assert one.end() == 130
    records = journal(one.out / "set_aside/0001-1")
    assert [record[3:] for record in records if record[0] == "air"][0] == [20.25, 50.5]
    assert not [record for record in records if record[0] == "move"]


def journal(folder):
    return read_journal(folder / "journal.log").records


def test_a_slow_typist_does_not_spoil_the_soak(tmp_path):
    """On a virtual clock: typing the airs takes ten times as long as the soak may, and the soak as long as ever."""
    bench = fake_bench()
    source, typed_s = bench.reference.source, []

    def typed():
        if not typed_s:
            typed_s.append(bench.clock.now())
            bench.clock.sleep_until(bench.clock.now() + 1200.0)
        return source()

    bench.reference.source = typed
    soak = STEPS[0]
    assert soak.at_most_s == 120.0
    assert record(bench, tmp_path / "c", plan(1)) == ["0001"]
    steps = [line for line in read_journal(tmp_path / "c/runs/0001/journal.log").records if line[0] == "step"]
    soaked_s = steps[1][1] - steps[0][1] - 1200.0
    assert soak.over_s <= soaked_s < soak.at_most_s
    assert read_state(tmp_path / "c").set_aside == ()


def test_a_wrong_air_that_was_typed_is_found_by_the_probes(start):
    one = start()
    one.answer([SET, PUT])
    one.wait_for(SOURCE_C)
    one.type("40")
    one.answer([SOURCE_RH, DESTINATION_C, DESTINATION_RH, MOVE])
    assert one.end() == 2
    ((id_, status, reason),) = aside(one)
    assert (id_, status) == ("0001", "spoilt")
    assert re.fullmatch(
        r"imet stood at (19|20)\.\d degC in the source air, which is said to have 40\.0 degC \(typed\)", reason
    )


def test_a_source_air_that_was_not_set_is_found_by_the_probes(start):
    """40 degC is asked for, and confirmed without being made: the room stays at 20 degC."""
    one = start(bench=BENCH.replace('"operator"', '"set-points"'), source_c=40)
    one.answer([SET, PUT, MOVE])
    assert one.end() == 2
    ((id_, status, reason),) = aside(one)
    assert (id_, status) == ("0001", "spoilt")
    assert re.fullmatch(
        r"imet stood at (19|20)\.\d degC in the source air, which is said to have 40\.0 degC \(set point\)", reason
    )


# An iMet on a port of its own, in another process that stands for its cable.
UNPLUGGABLE = BENCH.replace('port = "virtual"', 'port = "bus/imet"').replace(
    '[sensors.hyt]\nkind = "hyt-271"\nbus = "virtual"\nconversion_s = 0.07\n', ""
)


@pytest.fixture
def cable(tmp_path, monkeypatch):
    """Plugs an emulated iMet in (the function that it gives) and out (what that returns)."""
    monkeypatch.chdir(tmp_path)
    plugged = []

    def plug_in():
        words = ["emulate", "imet-xf", "--folder", tmp_path / "bus", "--link", f"imet-xf={tmp_path / 'bus/imet'}"]
        command = [sys.executable, "-m", "shockrig", *map(str, words)]
        plugged.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE))
        wait_for((tmp_path / "bus/imet").exists, plugged[-1])
        return partial(ended, plugged[-1], signal.SIGINT)

    yield plug_in
    for one in plugged:
        one.kill()
        one.communicate()


@pytest.mark.parametrize("prompt", [SET, SOURCE_C])
def test_a_sensor_unplugged_at_a_prompt_holds_the_soak_until_it_is_back(start, cable, tmp_path, prompt):
    pull_out = cable()
    one = start("--operator", "A", bench=UNPLUGGABLE.replace("bus/imet", str(tmp_path / "bus/imet")))
    prompts = [SET, PUT, SOURCE_C, SOURCE_RH]
    one.answer(prompts[: prompts.index(prompt)])
    one.wait_for(prompt)
    pull_out()
    one.type("")
    one.answer(prompts[prompts.index(prompt) + 1 :])
    time.sleep(3.0)  # three times as long as the soak takes at least
    steps = [record[2] for record in journal(one.out / "recording/0001") if record[0] == "step"]
    assert len(steps) == 1 and steps[0].startswith("soak")
    cable()
    one.answer([DESTINATION_C, DESTINATION_RH, MOVE])
    one.wait_for(SET)
    assert read_state(one.out).recorded == ("0001",)


def test_a_sensor_unplugged_at_the_transfer_spoils_the_run(start, cable, tmp_path):
    pull_out = cable()
    one = start("--operator", "A", bench=UNPLUGGABLE.replace("bus/imet", str(tmp_path / "bus/imet")))
    one.answer(PROMPTS[:-1])
    one.wait_for(MOVE)
    pull_out()
    time.sleep(6.0)  # longer than the largest gap that this protocol allows
    one.type("")
    assert one.end() == 2
    ((id_, status, reason),) = aside(one)
    assert (id_, status) == ("0001", "spoilt") and re.match(r"imet gave no good reading for \d+\.\d s", reason)


def test_the_live_view_shows_the_prompt_and_takes_the_answer(start):
    one = start("--watch")
    one.wait_for("YOUR TURN")
    one.wait_for(SET)
    before = one.said
    assert "\a" in before and "stalled" not in before and f"{SET} to 20 degC" in before
    one.type("")
    one.wait_for(PUT)
    one.type("a")
    assert one.end() == 130


class Answers:
    """Lines that are there at once, through a pipe, as the keyboard's."""

    def __init__(self, text):
        reading, self.writing = os.pipe()
        os.write(self.writing, text.encode())
        self.stream = os.fdopen(reading)

    def close(self):
        """End of the input; a second call does nothing."""
        if self.writing >= 0:
            os.close(self.writing)
            self.writing = -1


@pytest.fixture
def keyboard():
    """Makes keyboards whose streams are closed after the test."""
    made = []

    def make(text=""):
        made.append(Answers(text))
        return made[-1]

    yield make
    for one in made:
        one.close()
        one.stream.close()


WISHES = {"s": RunSkipped, "r": RunRepeated, "p": CampaignPaused, "a": CampaignAborted, "pause": CampaignPaused}


@pytest.mark.parametrize("key", WISHES)
def test_each_key_means_the_same_at_every_kind_of_prompt(key, keyboard):
    for way in ("ask", "number", "request"):
        answers, clock = keyboard(f"{key}\n" * 2), VirtualClock(3.0)
        operator = ConsoleOperator(clock, answers.stream, io.StringIO())
        asked = []
        operator.attend(lambda: None, asked.append, lambda text: None, lambda text: None)
        if way == "request":
            operator.request("Move", 10.0)
            assert operator.confirmed_s() is None  # what was typed before the question is no answer to it
            os.write(answers.writing, f"{key}\n".encode())
        with pytest.raises(WISHES[key]):
            operator.confirmed_s() if way == "request" else operator.ask("?", str if way == "number" else lambda a: "")
        operator.leave()
        assert asked[0].text in ("Move", "?") and asked[-1] is None


def test_lines_typed_ahead_are_answers_in_their_order_and_an_end_of_input_pauses(keyboard):
    answers, clock, prompts = keyboard("21.5\n\nn so\n\n"), VirtualClock(3.0), io.StringIO()
    operator, notes = ConsoleOperator(clock, answers.stream, prompts), []
    operator.attend(lambda: None, lambda prompt: None, notes.append, lambda text: None)
    assert operator.ask("Temperature?", lambda answer: "") == "21.5"
    assert operator.ask("Steady?") == "" and operator.ask("Still?") == "" and notes == ["so"]
    answers.close()
    with pytest.raises(CampaignPaused, match="terminal was closed .hang-up."):
        operator.ask("And now?")
    assert prompts.getvalue().count("\a") == 4


def test_a_request_is_dated_by_the_instant_and_never_waited_for(keyboard):
    answers, clock = keyboard(""), VirtualClock(3.0)
    operator = ConsoleOperator(clock, answers.stream, io.StringIO())
    operator.request("Move now.", 20.0)
    assert operator.confirmed_s() is None
    clock.sleep_until(4.5)
    os.write(answers.writing, b"q\n")
    assert operator.confirmed_s() is None
    os.write(answers.writing, b"\n")
    assert operator.confirmed_s() == 4.5
    operator.request("Move back.", 20.0)
    clock.sleep_until(24.6)
    with pytest.raises(CampaignPaused, match="nobody answered in time"):
        operator.confirmed_s()


def test_while_a_question_waits_the_bench_is_listened_to(keyboard):
    answers, clock, heard = keyboard(""), VirtualClock(), []

    def idle():
        heard.append(clock.now())
        if len(heard) == 50:
            os.write(answers.writing, b"\n")

    operator = ConsoleOperator(clock, answers.stream, io.StringIO())
    operator.attend(idle, lambda prompt: None, lambda text: None, lambda text: None)
    operator.ask("Ready?")
    assert len(heard) == 50 and max(b - a for a, b in zip(heard, heard[1:], strict=False)) < 0.05


PROMPT = {"text": "Put the probes into the source air, then press Enter.", "deadline_s": 70.0, "keys": KEYS}


def test_a_prompt_is_the_largest_thing_in_the_terminal_and_on_the_page(tmp_path):
    records = [["step", 0.0, "soak"], reading("imet", 10.0, temperature_c=20.0)]
    made_campaign(tmp_path / "c", records, STATUS | {"prompt": PROMPT})
    follower = Follower(tmp_path / "c", lambda: 1000.0)
    view = follower.look()
    assert view.state == "asking" and view.prompt.left_s == pytest.approx(60.0, abs=0.2)
    from rich.console import Console

    for width, height in ((80, 24), (200, 60)):
        console = Console(width=width, height=height, file=io.StringIO(), highlight=False)
        console.print(render(view, width, height))
        lines = console.file.getvalue().splitlines()
        assert "YOUR TURN" in lines[0] and len(lines[0].rstrip()) == width
        block = next(i for i, line in enumerate(lines) if line.startswith("╰"))
        assert block >= 6 and "Put the probes" in "".join(lines[:block]) and "60 s left" in lines[block]
    follower.close()
    style = (ROOT / "data/watch/page.css").read_text()
    sizes = {name: float(size) for name, size in re.findall(r"([#.\w-]+) \{[^}]*font-size: ([\d.]+)rem", style)}
    assert sizes["#prompt-text"] > 1.5 * max(size for name, size in sizes.items() if name != "#prompt-text")
    page = (ROOT / "data/watch/page.html").read_text()
    assert page.index('id="prompt"') < page.index("<header>") and 'role="alert"' in page


def test_a_hostile_prompt_in_the_status_is_text(tmp_path):
    for prompt in ({"text": "\x1b[31mred\n" * 100, "keys": 5, "deadline_s": "soon"}, {}, {"deadline_s": 1e400}):
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        made_campaign(folder, [["step", 0.0, "soak"]], STATUS)
        (folder / "status.json").write_text(json.dumps(STATUS | {"prompt": prompt}).replace("Infinity", "null"))
        view = Follower(folder, lambda: 0.0).look()
        assert view.prompt.left_s is None and view.prompt.text.isprintable() and len(view.prompt.text) <= 500
        assert main(["watch", str(folder), "--once"]) == 0


def test_the_loop_by_hand_asks_is_vetoed_pauses_and_goes_on_with_the_same_decision(start):
    """`run adaptive --confirm` in real time: a veto at its own question and at the bench's, and a pause between."""
    words = ("--until", "D 1 % at 20, minutes 30", "--confirm")
    up, down = "Next: 20 degC 20 %RH -> 20 degC 80 %RH, 6 m/s", "Next: 20 degC 80 %RH -> 20 degC 20 %RH, 6 m/s"
    one = start(*words, plan="adaptive")
    one.answer([up], "r")
    one.wait_for("this run is not recorded yet")
    one.answer([up], "s")
    one.answer([down], "n no draught")
    one.wait_for("note: no draught")
    one.type("")
    one.answer([SET], "p")
    assert one.end() != 0 and "the same command goes on" in one.said
    log = (one.out / "decisions.jsonl").read_bytes()
    again = start(*words, plan="adaptive")
    again.wait_for("going on with the decision before")
    again.wait_for(SET)
    assert (again.out / "decisions.jsonl").read_bytes() == log
    again.type("s")
    again.answer(["Next: "], "a")
    assert again.end() != 0
    vetoed = json.loads((again.out / "decisions.jsonl").read_text().splitlines()[-1])["vetoed"]
    assert [run["destination"]["humidity_percent"] for run in vetoed] == [20.0, 80.0]
