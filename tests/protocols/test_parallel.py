"""One map in this process, on processes, on Dask: the same outcomes; a worker that dies costs its task alone."""

import os
import signal

import pytest

from shockrig.files.errors import InputError
from shockrig.protocols import parallel

WAYS = {"here": (1, None), "processes": (2, False), "dask": (2, True)}
KILLS = 5


def square(number):
    return number * number


def square_or_die(number):
    """One of the tasks kills the process that works on it, whichever that is."""
    if number == KILLS:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def outcomes(work, way, count):
    workers, with_dask = WAYS[way]
    return dict(parallel.mapped(work, range(count), workers, with_dask=with_dask))


def test_all_tasks_are_done_once_here():
    assert outcomes(square, "here", 30) == {i: i * i for i in range(30)}
    assert outcomes(square, "here", 0) == {}


@pytest.mark.parametrize("way", ["processes", "dask"])
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_worker_that_dies_costs_its_task_alone(way, monkeypatch):
    monkeypatch.setattr(parallel, "DEATHS", 2)
    expected = {i: i * i for i in range(9)} | {KILLS: None}
    assert outcomes(square_or_die, way, 9) == expected


def test_a_scheduler_that_is_not_there_is_said(monkeypatch):
    monkeypatch.setattr(parallel, "JOINED_WITHIN", "0.2s")
    with pytest.raises(InputError, match="--scheduler tcp://127.0.0.1:9: .*start one with dask scheduler"):
        list(parallel.mapped(square, range(3), 2, "tcp://127.0.0.1:9"))
    monkeypatch.setattr(parallel.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install 'shockrig\[fleet\]'"):
        parallel.mapped(square, range(3), 2, "tcp://127.0.0.1:9")
