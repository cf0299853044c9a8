"""Branches: what they send arrives, their errors are raised here, and they end with the block or with a word."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from shockrig.files.errors import InputError
from shockrig.protocols.branch import branch, received

pytestmark = pytest.mark.elsewhere


def numbers(send, count):
    for number in range(count):
        send(number)


def refuse(send, words):
    send("before")
    raise InputError(words)


def die(send):
    os.kill(os.getpid(), signal.SIGKILL)


def go_on(send):
    os.kill(os.getpid(), signal.SIGINT)
    send("not for me")


def sleep(send):
    send(os.getpid())
    time.sleep(600)


def sleep_below(send):
    with branch(sleep) as below:
        send(received(below))
        received(below)


@pytest.mark.parametrize("threads", [0, 1])
def test_what_is_sent_arrives_in_order_forked_or_not(threads):
    done = threading.Event()
    for _ in range(threads):
        threading.Thread(target=done.wait).start()
    try:
        with branch(numbers, 3) as one, branch(numbers, 2) as other:
            assert [received(one) for _ in range(3)] == [0, 1, 2]
            assert [received(other) for _ in range(2)] == [0, 1]
    finally:
        done.set()


def test_an_error_is_raised_here_with_where_it_came_from():
    with branch(refuse, "campaign.json, line 3: fix it") as one:
        assert received(one) == "before"
        with pytest.raises(InputError, match="line 3: fix it") as caught:
            received(one)
    assert "in refuse" in caught.value.__notes__[0]


@pytest.mark.parametrize("threads", [0, 1])
def test_what_ignores_ctrl_c_has_branches_that_do(threads):
    """Whatever a script starts in the background; Ctrl-C is for the script."""
    done = threading.Event()
    for _ in range(threads):
        threading.Thread(target=done.wait).start()
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with branch(go_on) as one:
            assert received(one) == "not for me"
    finally:
        signal.signal(signal.SIGINT, before)
        done.set()


def test_a_branch_that_is_killed_is_an_error():
    with branch(die) as one, pytest.raises(RuntimeError, match="ended before it was done"):
        received(one)


@pytest.mark.parametrize("function", [sleep, sleep_below])
def test_no_branch_outlives_its_block(function):
    with branch(function) as one:
        lowest = received(one)
    ends_soon(lowest)


IMPATIENT = """
import multiprocessing, os, signal
if multiprocessing.current_process().name != "MainProcess":
    os.kill(os.getpid(), signal.SIGINT)  # Ctrl-C while a spawned process imports what it is to run

def numbers(send):
    send(1)
"""
SPAWNS = """
import threading
from shockrig.protocols.branch import branch, received

if __name__ == "__main__":
    from impatient import numbers
    done = threading.Event()
    threading.Thread(target=done.wait, daemon=True).start()  # beside which nothing is forked
    try:
        with branch(numbers) as one:
            received(one)
    except RuntimeError as error:
        print(error)
"""


def test_a_branch_that_is_interrupted_while_it_imports_ends_without_a_word(tmp_path):
    (tmp_path / "impatient.py").write_text(IMPATIENT)
    (tmp_path / "spawns.py").write_text(SPAWNS)
    command = [sys.executable, "spawns.py"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert ended.stderr == ""
    assert "ended before it was done" in ended.stdout


KILLED = """
import os, signal, sys, threading, time
sys.path[:0] = [{tests!r}]
from test_branch import sleep, sleep_below
from shockrig.protocols.branch import branch, received
if __name__ == "__main__":
    held = threading.Event()
    if {threads}:
        threading.Thread(target=held.wait, daemon=True).start()
    with branch(sleep if {threads} else sleep_below) as one:
        print(received(one), flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("threads", [0, 1])
def test_a_killed_process_takes_its_branches_with_it(tmp_path, threads):
    """Forked or not, and the branch of a branch: no process is left that works for nobody."""
    script = tmp_path / "killed.py"
    script.write_text(KILLED.format(tests=os.path.dirname(__file__), threads=threads))
    done = subprocess.run([sys.executable, script], stdout=subprocess.PIPE, text=True, timeout=120)
    assert done.returncode == -signal.SIGKILL
    ends_soon(int(done.stdout))


def ends_soon(pid):
    """Ended, or ending: on a busy machine the kernel ends a branch's branch a moment after the branch itself."""
    deadline = time.monotonic() + 30.0
    while is_running(pid):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def is_running(pid):
    """Whether a process is there and no mere entry that nobody has asked for yet."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
