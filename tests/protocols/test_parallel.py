"""One map in this process, on processes, on Dask: the same outcomes; a worker that dies costs its task alone."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from unittest import mock

import distributed
import pytest

from shockrig.files.errors import InputError
from shockrig.protocols import parallel
from shockrig.protocols.fleet_map import measure, tasks_of

WAYS = {"here": (1, None), "processes": (2, False), "dask": (2, True)}
KILLS = 5
MANY = 4  # workers, more than one is handed tasks ahead


def square(number):
    return number * number


def square_or_die(number):
    """One of the tasks kills the process that works on it, whichever that is."""
    if number == KILLS:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def die(number):
    """Each of the tasks kills the process that works on it."""
    os.kill(os.getpid(), signal.SIGKILL)


def dead(*_):
    """A worker that ends before it has joined."""
    os._exit(3)


def among_others(folder):
    """Whether as many tasks as there are workers are under way at a time."""
    (folder / str(os.getpid())).touch()
    deadline = time.monotonic() + 60.0
    while len(list(folder.iterdir())) < MANY and time.monotonic() < deadline:
        time.sleep(0.05)
    return len(list(folder.iterdir())) >= MANY


def kept_up(number):
    """What Dask does from time to time on the worker."""
    return sorted(distributed.get_worker().periodic_callbacks)


def outcomes(work, way, count):
    workers, with_dask = WAYS[way]
    return dict(parallel.mapped(work, range(count), workers, with_dask=with_dask))


def test_all_tasks_are_done_once_here():
    assert outcomes(square, "here", 30) == {i: i * i for i in range(30)}
    assert outcomes(square, "here", 0) == {}


@pytest.mark.parametrize("way", ["processes", "dask"])
def test_a_worker_that_dies_costs_its_task_alone(way, monkeypatch):
    monkeypatch.setattr(parallel, "DEATHS", 2)
    expected = {i: i * i for i in range(9)} | {KILLS: None}
    assert outcomes(square_or_die, way, 9) == expected


def test_every_worker_that_dies_is_replaced():
    """With none left the map would wait for ever."""
    assert outcomes(die, "dask", 3) == {0: None, 1: None, 2: None}


def test_workers_that_end_as_soon_as_they_begin_are_said(monkeypatch):
    """A script that does not ask whether it is __main__. Before: they were begun anew for ever."""
    monkeypatch.setattr(parallel, "_serve", dead)
    monkeypatch.setattr(parallel, "LOOKED_AFTER_S", 0.1)
    with pytest.raises(InputError, match="each ended before it took a task, the last with status 3; a script"):
        outcomes(square, "dask", 3)


def test_a_machine_that_has_no_room_for_another_worker_is_asked_again(monkeypatch):
    """Before: the thread that looks after them ended, and so did all that waited."""
    monkeypatch.setattr(parallel, "LOOKED_AFTER_S", 0.01)
    first, enough = mock.Mock(), threading.Event()
    first.is_alive.return_value, first.exitcode = False, -9

    first.close.side_effect = enough.set
    begun = mock.Mock(side_effect=[first, OSError("no memory"), mock.Mock()])
    with parallel._kept_up(begun, 1) as ended:
        assert enough.wait(60.0)
    assert ended == [-9, -9] and begun.call_count == 3


def test_all_workers_have_a_task(tmp_path):
    """Before: three were handed out to the worker that came first, and so no more were ever under way."""
    done = parallel.mapped(among_others, [tmp_path] * 2 * MANY, MANY, with_dask=True)
    assert all(all_there for _, all_there in done)


def test_two_maps_are_under_way_at_a_time():
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with contextlib.suppress(OSError):  # whoever has it
            taken.bind(("", 8787))  # where Dask shows what it does, and warns where that is taken
            taken.listen()
        assert outcomes(square, "dask", 2) == {0: 0, 1: 1}


def test_workers_keep_no_call_stacks():
    """Dask would sample them a hundred times a second and keep an hour of it: 0.1 MB a second."""
    (found,) = {tuple(one) for one in outcomes(kept_up, "dask", 2).values()}
    assert "heartbeat" in found and "profile" not in found


def test_a_scheduler_that_is_not_there_is_said(monkeypatch):
    monkeypatch.setattr(parallel, "JOINED_WITHIN", "0.2s")
    with pytest.raises(InputError, match="--scheduler tcp://127.0.0.1:9: .*start one with dask scheduler"):
        list(parallel.mapped(square, range(3), 2, "tcp://127.0.0.1:9"))
    monkeypatch.setattr(parallel.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install 'shockrig\[fleet\]'"):
        parallel.mapped(square, range(3), 2, "tcp://127.0.0.1:9")


@contextlib.contextmanager
def started(*words, folder):
    """A command of Dask in a process of its own, in another folder than this one."""
    command = [sys.executable, "-m", "dask", *words, "--no-dashboard"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, cwd=folder, **quiet) as process:
        try:
            yield
        finally:
            process.terminate()


def test_a_cluster_that_is_running_already_takes_the_tasks(tmp_path, monkeypatch):
    """Without a worker it would wait for ever. With one, relative paths are those of who asks, not of the worker."""
    file = tmp_path / "scheduler.json"
    monkeypatch.setattr(parallel, "JOINED_WITHIN", "1s")
    with started("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file), folder=tmp_path):
        deadline = time.monotonic() + 60.0
        while not file.exists() or not file.read_text():
            assert time.monotonic() < deadline
            time.sleep(0.05)
        address = json.loads(file.read_text())["address"]
        with pytest.raises(InputError, match="has no worker; start some with dask worker"):
            list(parallel.mapped(abs, [-1], 2, address))
        monkeypatch.setattr(parallel, "JOINED_WITHIN", "60s")
        (tmp_path / "mine" / "c").mkdir(parents=True)
        head = {"format": "shock-campaign/1", "name": "c", "sensors": {"imet": {"kind": "imet-xf"}}}
        (tmp_path / "mine" / "c" / "campaign.json").write_text(json.dumps(head))
        with started("worker", address, "--nthreads", "1", "--no-nanny", folder=tmp_path):
            monkeypatch.chdir(tmp_path / "mine")
            tasks, _ = tasks_of([Path("c")], None, None)
            ((_, outcome),) = parallel.mapped(measure, tasks, 2, address)
    assert outcome["failed"].startswith(f"{tmp_path / 'mine' / 'c' / 'runs'}: no runs")
