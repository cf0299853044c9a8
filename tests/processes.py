"""Processes that tests start: none is waited for longer than a minute, and one that is too slow tells what it said."""

import shlex
import signal
import subprocess
import threading
import time

import pytest

PATIENCE_S = 60.0
LAST_WORDS_S = 5.0


def in_background():
    """To be called in a process before its program begins: as a script, nohup or cron starts it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def wait_for(what, process=None):
    """The first answer of `what` that is true; in vain after a minute, or when the process that makes it has ended."""
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        if found := what():
            return found
        if process is not None and process.poll() is not None:
            break
        time.sleep(0.02)
    _give_up(process, "waited in vain")


def heard(process, stream, *wanted):
    """What a process says on a stream, up to the first line that has one of `wanted`."""
    said = ""
    late = threading.Timer(PATIENCE_S, process.kill)  # what is read from is then at its end
    late.start()
    try:
        while line := stream.readline():
            said += line
            if any(one in line for one in wanted):
                return said
    finally:
        late.cancel()
    _give_up(process, f"waited in vain for {' or '.join(wanted)} after {said!r}")


def ended(process, number=None):
    """What a process has still said, on both its streams, when it is at its end; `number` is a signal to end by."""
    if number is not None:
        process.send_signal(number)
    try:
        return process.communicate(timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        _give_up(process, "it does not end")


def _give_up(process, why):
    if process is None:
        pytest.fail(why)
    process.kill()
    try:
        said = process.communicate(timeout=LAST_WORDS_S)
    except subprocess.TimeoutExpired as late:  # a process of its own holds its streams
        said = late.stdout, late.stderr
    pytest.fail(f"{why}: {shlex.join(map(str, process.args))} ended with {process.returncode}; it said {said}")
