"""Ctrl-C and SIGTERM where Python drops what they raise, or takes it for another error, still end a command."""

import importlib.machinery
import importlib.util
import signal
import time

import pytest

from shockrig.protocols.cli import ended_by_signals

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


@pytest.mark.parametrize(("number", "raised"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)])
def test_a_signal_waits_until_a_compiled_library_is_loaded(number, raised, monkeypatch):
    """As matplotlib's ft2font runs Python while it is loaded: what is raised there comes out as "ImportError:
    initialization failed", or ends the interpreter."""
    calm = importlib.machinery.ExtensionFileLoader.exec_module
    loaded = []

    def interrupted(self, module):
        signal.raise_signal(number)
        loaded.append(module)
        calm(self, module)

    monkeypatch.setattr(importlib.machinery.ExtensionFileLoader, "exec_module", interrupted)
    with pytest.raises(raised), ended_by_signals():
        load_compiled()
        time.sleep(600)
    assert loaded


def load_compiled():
    found = importlib.util.find_spec("shockrig.files._cells")
    found.loader.exec_module(importlib.util.module_from_spec(found))


def test_what_else_is_dropped_is_said(capfd):
    class Faulty:
        def __del__(self):
            raise ValueError("no signal")

    with ended_by_signals():
        Faulty()
    assert "no signal" in capfd.readouterr().err
