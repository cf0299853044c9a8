"""Ctrl-C and SIGTERM in the middle of a deletion, where Python drops what they raise, still end a command."""

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


def test_what_else_is_dropped_is_said(capfd):
    class Faulty:
        def __del__(self):
            raise ValueError("no signal")

    with ended_by_signals():
        Faulty()
    assert "no signal" in capfd.readouterr().err
