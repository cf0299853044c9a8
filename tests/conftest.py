"""Every test process computes in one thread: two workers with a thread per core each only wait for one another.

And no test depends on how busy the machine is: examples may take as long as they take. Nor on who starts them: what
is started in the background (nohup, cron, a script's `&`) inherits that SIGINT or SIGHUP is ignored. A signal with a
handler is at its default again in every process that a test starts.
"""

import os
import signal
import sys
import threading

import pytest
from hypothesis import HealthCheck, settings

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# Hundreds of tests start a command: each would compile the whole project anew where bytecode is not to be written.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False  # nor is each worker to rewrite each test's assertions anew, which takes 8 s

for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, lambda *_: None)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, handler)

settings.register_profile("busy", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")


def pytest_collection_modifyitems(items):
    """A test that waits for minutes begins first, beside those that compute: as the last one all would wait for it."""
    items.sort(key=lambda item: item.get_closest_marker("waits") is None)


@pytest.fixture(scope="session", autouse=True)
def forked_as_in_a_terminal():
    """A worker of pytest-xdist has a thread that listens to pytest, beside which a command would not fork: each process
    that it starts would import everything again. That thread does nothing meanwhile; those of a test's own count."""
    from shockrig.protocols import branch

    before = threading.active_count()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(branch, "alone", lambda: sys.platform == "linux" and threading.active_count() <= before)
        yield


@pytest.fixture
def catalogue_as_it_was():
    """For tests that take an entry away: given back it would stand last, and effects act in the catalogue's order."""
    from shockrig.analysis.effects import CATALOGUE

    kept = dict(CATALOGUE)
    yield
    CATALOGUE.clear()
    CATALOGUE.update(kept)
