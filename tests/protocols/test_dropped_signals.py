"""Ctrl-C and SIGTERM where Python drops what they raise, or takes it for another error, still end a command."""

import importlib
import signal
import time

import pytest

from shockrig.protocols.cli import AGAIN_S, ended_by_signals

pytestmark = pytest.mark.elsewhere


class Deleted:
    """Takes a signal while it is being deleted."""

    def __init__(self, number):
        self.number = number

    def __del__(self):
        signal.raise_signal(self.number)


@pytest.mark.parametrize(("number", "raised"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)])
def test_a_dropped_signal_is_sent_again(number, raised):
    with pytest.raises(raised), ended_by_signals():
        Deleted(number)
        time.sleep(600)


MODULE = """
import signal

class Named:
    def __set_name__(self, owner, name):
        signal.raise_signal(signal.Signals({number}))

class Owner:
    named = Named()
"""


@pytest.mark.parametrize(("number", "raised"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)])
def test_a_signal_waits_until_a_module_is_loaded(number, raised, monkeypatch, tmp_path):
    """As those of matplotlib, which make classes and run Python while they load compiled libraries: what is raised
    there comes out as a RuntimeError or an ImportError."""
    name = f"takes_signal_{int(number)}"
    (tmp_path / f"{name}.py").write_text(MODULE.format(number=int(number)))
    monkeypatch.syspath_prepend(tmp_path)
    loaded = []
    with pytest.raises(raised), ended_by_signals():
        loaded.append(importlib.import_module(name))
        time.sleep(600)
    assert loaded


def test_what_another_process_ends_with_meanwhile_is_no_error(monkeypatch, tmp_path):
    """Ctrl-C reaches all processes of a command: those beside one that loads a module end at once."""
    (tmp_path / "takes_signal.py").write_text(MODULE.format(number=int(signal.SIGINT)))
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(KeyboardInterrupt), ended_by_signals():
        importlib.import_module("takes_signal")
        raise OSError("got end of file during message")
    time.sleep(4 * AGAIN_S)  # nothing comes once more


def test_a_signal_that_waits_when_a_command_is_done_ends_it(monkeypatch, tmp_path):
    """Before: it came behind the command, whose handlers were gone by then."""
    (tmp_path / "takes_another.py").write_text(MODULE.format(number=int(signal.SIGTERM)))
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(SystemExit) as ended, ended_by_signals():
        importlib.import_module("takes_another")
    time.sleep(4 * AGAIN_S)
    assert ended.value.code == 128 + signal.SIGTERM


def test_what_else_is_dropped_is_said(capfd):
    class Faulty:
        def __del__(self):
            raise ValueError("no signal")

    with ended_by_signals():
        Faulty()
    assert "no signal" in capfd.readouterr().err
