"""The GRBL stage against an emulated controller: byte dialogue, measured transfers, alarms, stalls; every wait ends."""

from __future__ import annotations

import re

import pytest
from emulated import Replay, memory_port

from shockrig.rig.bench_errors import StageError
from shockrig.rig.buses.serial_port import PyserialPort, pyserial_opener
from shockrig.rig.clock import RealClock, VirtualClock
from shockrig.rig.seams import Air, Move
from shockrig.rig.stages.grbl import GrblSettings, GrblStage, StatusReport, why_late
from shockrig.rig.stages.manual import ManualSettings, ManualStage, PromptedChambers
from shockrig.rig.virtual.chips.grbl import GrblController
from shockrig.rig.virtual.faults import Fault, FaultySerial
from shockrig.rig.virtual.serial_line import PtyDevice

WARM, COLD = Air(40.0, 20.0), Air(20.0, 55.0)


class Chambers:
    def __init__(self):
        self.asked = []

    def set_airs(self, source, destination, airflow_m_s):
        self.asked.append((source, destination, airflow_m_s))

    def airs(self):
        return self.asked[-1][:2]


class Rig:
    """A stage on an emulated controller; `left_s` is when the carriage truly left the source switch."""

    def __init__(self, faults=(), clock=None, travel_s=0.4, **values):
        self.clock = clock or VirtualClock()
        self.left_s = []
        self.controller = GrblController(0.0, -300.0, self.left_s.append)
        device = FaultySerial(self.controller, faults, self.clock) if faults else self.controller
        self.heard = []
        receive = self.controller.receive
        self.controller.receive = lambda data, at_s: (self.heard.append(bytes(data)), receive(data, at_s))
        self.chambers = Chambers()
        settings = GrblSettings("memory", 0.0, -300.0, 300.0 / travel_s * 60, **values)
        self.stage = GrblStage(settings, memory_port(device, self.clock, 115200), self.clock, self.chambers)

    def follow(self, at_most_s=30.0, meanwhile=lambda now: None):
        """Poll until the move is finished."""
        end_s = self.clock.now() + at_most_s
        while self.clock.now() < end_s:
            self.clock.sleep_until(min(end_s, max(self.stage.due_s(), self.clock.now() + 1e-4)))
            meanwhile(self.clock.now())
            if move := self.stage.poll():
                return move
        raise AssertionError("the driver hangs")


def test_dialogue_of_a_run():
    rig = Rig()
    rig.stage.open()
    rig.stage.prepare(WARM, COLD, 5.0)
    rig.stage.begin_transfer()
    rig.follow()
    commands = [data for data in rig.heard if data != b"?"]
    assert commands == [b"\x18", b"$H\n", b"G90 G53 G1 X0.000 F45000.0\n", b"G90 G53 G1 X-300.000 F45000.0\n"]
    assert rig.chambers.asked == [(WARM, COLD, 5.0)]
    assert rig.controller.position_mm(rig.clock.now()) == -300.0


@pytest.mark.parametrize("limit_pin", ["X", ""])
@pytest.mark.parametrize("travel_s", [0.002, 0.05, 0.4, 3.0])
def test_measured_start_and_end_of_the_transfer(travel_s, limit_pin):
    """Good to half the time between two reports, plus what one report takes on the wire."""
    rig = Rig(travel_s=travel_s, limit_pin=limit_pin)
    rig.stage.open()
    starts, lengths = [], []
    for _ in range(5):
        rig.stage.prepare(WARM, COLD, 5.0)
        rig.clock.sleep_until(rig.clock.now() + 0.137)
        rig.stage.begin_transfer()
        move = rig.follow()
        starts.append(move.start_s - rig.left_s[-1])
        lengths.append(move.end_s - move.start_s)
    assert max(map(abs, starts)) < (0.001 if limit_pin else 0.008)
    assert lengths == pytest.approx([travel_s] * 5, abs=0.015)


def test_moving_there_and_back_many_times():
    rig = Rig()
    rig.stage.open()
    for n in range(1, 6):
        rig.stage.prepare(WARM, COLD, None)
        rig.stage.begin_transfer()
        assert isinstance(rig.follow(), Move)
        assert len(rig.left_s) == n


def test_nothing_is_due_and_nothing_moves_between_transfers():
    rig = Rig()
    rig.stage.open()
    assert rig.stage.due_s() == float("inf") and rig.stage.poll() is None
    assert rig.left_s == []


def test_a_controller_that_needs_homing_is_refused_without_it():
    with pytest.raises(StageError, match="home"):
        Rig(home=False).stage.open()


@pytest.mark.parametrize(("code", "says"), [(1, "hard limit"), (3, "reset while moving"), (99, "GRBL manual")])
def test_an_alarm_in_mid_move_is_an_error_with_its_meaning(code, says):
    rig = Rig(travel_s=1.0)
    rig.stage.open()
    rig.stage.prepare(WARM, COLD, 5.0)
    rig.stage.begin_transfer()
    strike_s = rig.clock.now() + 0.5
    pending = [strike_s]

    def strike(now):
        if pending and now >= pending[0]:
            rig.controller.alarm(code, pending.pop())

    with pytest.raises(StageError, match=f"alarm {code}.*{says}"):
        rig.follow(meanwhile=strike)
    assert rig.clock.now() < strike_s + 0.1
    rig.stage.make_safe()
    with pytest.raises(StageError, match="locked since an alarm"):
        rig.stage.prepare(WARM, COLD, 5.0)
    rig.stage.open()
    rig.stage.prepare(WARM, COLD, 5.0)  # homed again


def test_a_stalled_carriage_is_an_error_in_time():
    rig = Rig(travel_s=0.4)
    rig.stage.open()
    rig.stage.prepare(WARM, COLD, 5.0)
    rig.controller.stalled = True
    rig.stage.begin_transfer()
    began_s = rig.clock.now()
    with pytest.raises(StageError, match="did not arrive in time.*at 0 mm"):
        rig.follow()
    assert rig.clock.now() - began_s == pytest.approx(0.4 + 2.0, abs=0.1)


def test_a_stage_held_by_somebody_else_is_an_error():
    rig = Rig(travel_s=1.0)
    rig.stage.open()
    rig.stage.prepare(WARM, COLD, 5.0)
    rig.stage.begin_transfer()
    at_s = rig.clock.now() + 0.3
    with pytest.raises(StageError, match="stopped"):
        rig.follow(meanwhile=lambda now: rig.controller.receive(b"!", now) if now > at_s else None)


def test_beginning_without_preparing_is_an_error():
    rig = Rig()
    rig.stage.open()
    rig.stage.prepare(WARM, COLD, 5.0)
    rig.stage.begin_transfer()
    rig.follow()
    with pytest.raises(StageError, match="not at the source"):
        rig.stage.begin_transfer()


@pytest.mark.parametrize("when", ["open", "prepare", "begin", "move"])
def test_silence_of_the_controller_never_hangs(when):
    rig = Rig(travel_s=1.0)
    silence = [Fault("silence", {"open": 0.0, "prepare": 100.0, "begin": 200.0, "move": 200.3}[when])]
    rig = Rig(silence, travel_s=1.0)
    with pytest.raises(StageError, match="did not boot|does not answer|did not take"):
        rig.stage.open()
        rig.clock.sleep_until(100.0)
        rig.stage.prepare(WARM, COLD, 5.0)
        rig.clock.sleep_until(200.0)
        rig.stage.begin_transfer()
        rig.follow()
    began_s = rig.clock.now()
    if when in ("prepare", "move"):  # it had been told to move, and does not say that it has stopped
        with pytest.raises(StageError, match="does not answer"):
            rig.stage.make_safe()
    else:
        rig.stage.make_safe()
    assert rig.clock.now() - began_s <= 1.6


def test_a_replugged_controller_is_opened_anew_and_homed():
    """Its power went with the plug, so that its position means nothing any more."""
    rig = Rig([Fault("unplug", 100.0, 105.0)], travel_s=1.0)
    rig.stage.open()
    rig.clock.sleep_until(101.0)
    for _ in range(2):
        with pytest.raises(StageError, match="is gone.*check its cable and supply"):
            rig.stage.prepare(WARM, COLD, 5.0)
    rig.clock.sleep_until(106.0)
    rig.stage.prepare(WARM, COLD, 5.0)
    rig.stage.begin_transfer()
    assert rig.follow().start_s == pytest.approx(rig.left_s[-1], abs=0.008)


def test_a_damaged_report_is_asked_for_again():
    rig = Rig([Fault("headless", 100.2, 100.3)], travel_s=1.0)
    rig.stage.open()
    rig.stage.prepare(WARM, COLD, 5.0)
    rig.clock.sleep_until(100.0)
    rig.stage.begin_transfer()
    assert rig.follow().start_s == pytest.approx(rig.left_s[0], abs=0.008)


def test_a_late_answer_to_an_earlier_question_is_not_believed():
    rig = Rig(travel_s=1.0)
    rig.stage.open()
    rig.stage.prepare(WARM, COLD, 5.0)
    rig.controller._queue.send(b"<Idle|MPos:-300.000,0.000,0.000|FS:0,0|Pn:X>\r\n", rig.clock.now())
    rig.clock.sleep_until(rig.clock.now() + 1.0)
    rig.stage.begin_transfer()
    assert rig.follow().start_s == pytest.approx(rig.left_s[0], abs=0.008)


@pytest.mark.parametrize("kind", ["flip", "half_line", "headless", "garbage", "nul", "doubled", "unplug"])
def test_a_bad_cable_ends_in_a_move_or_an_error(kind):
    """A single report that is damaged is no reason to stop; one that never comes is."""
    for seed_s in range(5):
        rig = Rig([Fault(kind, 100.0, 100.35 + 0.01 * seed_s, probability=0.3)], travel_s=1.0)
        rig.stage.open()
        rig.stage.prepare(WARM, COLD, 5.0)
        rig.clock.sleep_until(100.0)
        try:
            rig.stage.begin_transfer()
            move = rig.follow()
        except OSError:
            pass
        else:
            assert abs(move.start_s - rig.left_s[-1]) < 0.6 and move.end_s >= move.start_s
        rig.stage.make_safe()


def test_make_safe_stops_the_carriage_and_keeps_its_position():
    rig = Rig(travel_s=2.0)
    rig.stage.open()
    rig.stage.prepare(WARM, COLD, 5.0)
    rig.stage.begin_transfer()
    rig.clock.sleep_until(rig.clock.now() + 0.5)
    rig.stage.make_safe()
    here = rig.controller.position_mm(rig.clock.now())
    assert -300.0 < here < 0.0
    rig.clock.sleep_until(rig.clock.now() + 5.0)
    assert rig.controller.position_mm(rig.clock.now()) == here
    assert rig.heard[-1] == b"\x18" and b"!" in rig.heard
    rig.stage.prepare(WARM, COLD, 5.0)  # goes on from there without homing
    assert rig.controller.position_mm(rig.clock.now()) == 0.0


def test_make_safe_on_a_closed_port_is_harmless():
    Rig().stage.make_safe()


def test_errors_of_the_controller_are_told():
    clock = VirtualClock()
    device = Replay([(0.1, b"\r\nGrbl 1.1h ['$' for help]\r\n"), (0.2, b"error:5\r\n")])
    stage = GrblStage(GrblSettings("memory", 0, 300, 6000), memory_port(device, clock, 115200), clock, Chambers())
    with pytest.raises(StageError, match="error:5"):
        stage.open()


def test_a_run_over_a_pseudo_terminal_and_the_real_pyserial():
    clock = RealClock()
    left_s = []
    controller = GrblController(0.0, 300.0, left_s.append)
    controller.BOOT_S = 0.02
    pty = PtyDevice(controller, clock)
    port = PyserialPort(pyserial_opener(pty.path, 115200), clock, 115200)
    stage = GrblStage(GrblSettings(pty.path, 0.0, 300.0, 60000.0), port, clock, Chambers())
    try:
        stage.open()
        stage.prepare(WARM, COLD, 5.0)
        stage.begin_transfer()
        for _ in range(3000):
            clock.sleep_until(min(stage.due_s(), clock.now() + 0.1))
            if move := stage.poll():
                break
        assert move.start_s == pytest.approx(left_s[0], abs=0.05)
        assert move.end_s - move.start_s == pytest.approx(0.3, abs=0.1)
    finally:
        stage.make_safe()
        stage.close()
        pty.close()


class Person:
    """An operator who confirms `after_s` each time."""

    def __init__(self, clock, after_s=0.8):
        self.clock, self.after_s = clock, after_s
        self.prompts, self.at_s = [], None

    def say(self, message):
        self.prompts.append(message)

    def ask(self, message, check=None):
        self.prompts.append(message)
        return ""

    def leave(self):
        pass

    def request(self, message, within_s):
        self.prompts.append(message)
        self.at_s, self.within_s = self.clock.now() + self.after_s, within_s

    def confirmed_s(self):
        return self.at_s if self.clock.now() >= self.at_s else None


@pytest.mark.parametrize("confirm_arrival", [False, True])
def test_a_transfer_by_hand_is_dated_by_the_confirmation(confirm_arrival):
    clock = VirtualClock(50.0)
    person = Person(clock)
    chambers = PromptedChambers(person)
    stage = ManualStage(ManualSettings(confirm_arrival=confirm_arrival), clock, person, chambers)
    stage.open()
    stage.prepare(WARM, COLD, 5.0)
    assert "40 degC and 20 %RH" in person.prompts[0] and chambers.airs() == (WARM, COLD)
    stage.begin_transfer()
    move = None
    for _ in range(10000):
        clock.sleep_until(stage.due_s())
        if move := stage.poll():
            break
    assert move.start_s == pytest.approx(50.8)
    assert move.end_s == (pytest.approx(51.6, abs=0.01) if confirm_arrival else None)


def test_how_long_a_transfer_may_take_is_the_operators_to_keep():
    """One deadline: two would race, and a run that nobody answered for would be spoilt and repeated, not paused."""
    clock = VirtualClock()
    person = Person(clock, 1e9)
    stage = ManualStage(ManualSettings(within_s=20.0), clock, person, Chambers())
    stage.begin_transfer()
    assert person.within_s == 20.0
    while clock.now() < 60.0:
        clock.sleep_until(stage.due_s())
        assert stage.poll() is None


LATE = {
    "a switch that sticks": (dict(pressed=True), "switch X has stayed pressed since the source end"),
    "a carriage that hangs": (dict(position_mm=300.0, left_s=1.0), "switch X is not pressed: the carriage hangs"),
    "a slow axis": (dict(position_mm=200.0, state="Run", left_s=1.0), "slower than feed_mm_min = .*see .110"),
    "a move that was taken": (dict(position_mm=200.0, left_s=1.0), "stopped before 300 mm; find out"),
}


@pytest.mark.parametrize("case", LATE)
def test_a_late_stage_names_the_cause(case):
    """Each as the controller would report it when the time is over."""
    state, words = LATE[case]
    settings = GrblSettings("memory", 0.0, 300.0, 30000.0)
    report = StatusReport(0.0, state.get("state", "Idle"), state.get("position_mm", 0.0), state.get("pressed", False))
    assert re.search(words, why_late(report, state.get("left_s"), settings))
