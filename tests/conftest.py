"""Every test process computes in one thread: two workers with a thread per core each only wait for one another.

And no test depends on how busy the machine is: examples may take as long as they take. Nor on who starts them: what
is started in the background (nohup, cron, a script's `&`) inherits that SIGINT or SIGHUP is ignored. A signal with a
handler is at its default again in every process that a test starts.
"""

import contextlib
import fcntl
import io
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


@pytest.fixture(scope="session", autouse=True)
def figures_without_layout():
    """Fitting a layout takes as long as drawing: tests/report has it, and the pages that .ci/docs makes."""
    from shockrig.files import figures

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(figures.RC, "figure.constrained_layout.use", False)
        yield


@pytest.fixture(scope="session")
def demonstrated(tmp_path_factory):
    """A demo of an air film on eight short runs, made once: (its folder, what it printed, what went to standard
    error)."""
    from small_worlds import SHORT

    from shockrig.protocols.cli import main
    from shockrig.protocols.commands import demo

    base = tmp_path_factory.getbasetemp()
    home = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "demonstrated"
    home.mkdir(exist_ok=True)
    with open(home / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (home / "printed").exists():
            (home / "short.toml").write_text(SHORT)
            out, err = io.StringIO(), io.StringIO()
            with (
                pytest.MonkeyPatch.context() as patch,
                contextlib.redirect_stdout(out),
                contextlib.redirect_stderr(err),
            ):
                patch.setattr(demo, "PROTOCOL", str(home / "short.toml"))
                assert main(["demo", "--out", str(home / "out"), "--seed", "5", "--hide", "convective_film"]) == 0
            (home / "said").write_text(err.getvalue())
            (home / "printed").write_text(out.getvalue())
    return home / "out", (home / "printed").read_text(), (home / "said").read_text()


@pytest.fixture
def catalogue_as_it_was():
    """For tests that take an entry away: given back it would stand last, and effects act in the catalogue's order."""
    from shockrig.analysis.effects import CATALOGUE

    kept = dict(CATALOGUE)
    yield
    CATALOGUE.clear()
    CATALOGUE.update(kept)
