"""One map over many tasks: in this process, on processes of this machine, or on a Dask cluster; outcomes as they come.

Only a few tasks are under way at a time, so that memory does not grow with their number. A worker that dies costs its
task, which is begun again; the outcome of a task whose workers die each time is None.
"""

from __future__ import annotations

import asyncio
import importlib
import importlib.util
import logging
import os
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from shockrig.files.errors import InputError

DEATHS = 3  # of the workers of one task, from which on it is not begun again
AHEAD = 3  # tasks for each worker that are handed out at a time
JOINED_WITHIN = "10s"
LOOKED_AFTER_S = 0.5  # between two looks at whether a worker has ended: no outcome hangs on it

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")


def processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0))


def mapped(
    work: Callable[[Task], Outcome],
    tasks: Sequence[Task],
    workers: int,
    scheduler: str | None = None,
    *,
    with_dask: bool | None = None,
) -> Iterator[tuple[int, Outcome | None]]:
    """Place and outcome of each task, as they come.

    Parameters
    ----------
    work : function of a task
        Defined in a module, so that workers find it. It catches what it knows how to say.
    tasks : sequence
    workers : int
        Processes on this machine; with 1 the work is done in this one.
    scheduler : str, optional
        Address of a Dask cluster that is running already, which sees the same files.
    with_dask : bool, optional
        Whether the processes here are a local Dask cluster: where Dask is installed, unless this says otherwise.

    Raises
    ------
    InputError
        The scheduler cannot be reached, or Dask is not installed.
    """
    there = importlib.util.find_spec("distributed") is not None
    if scheduler is not None and not there:
        raise InputError("--scheduler: needs Dask; pip install 'shockrig[fleet]'")
    if scheduler is None and min(workers, len(tasks)) <= 1:
        return ((place, work(task)) for place, task in enumerate(tasks))
    if scheduler is not None or (there if with_dask is None else with_dask):
        return _on_dask(work, tasks, workers, scheduler)
    return _on_processes(work, tasks, workers)


def _on_dask(
    work: Callable[[Task], Outcome], tasks: Sequence[Task], workers: int, scheduler: str | None
) -> Iterator[tuple[int, Outcome | None]]:
    distributed: Any = importlib.import_module("distributed")  # whose functions have no annotations
    with _client(distributed, workers, scheduler) as client:
        waiting = iter(enumerate(tasks))
        places: dict[Any, int] = {}

        def hand_out(count: int) -> list[Any]:
            futures = []
            for _, (place, task) in zip(range(count), waiting, strict=False):
                future = client.submit(work, task, key=f"{work.__name__}-{id(places)}-{place}", pure=False)
                places[future] = place
                futures.append(future)
            return futures

        suspects = []
        threads = workers if scheduler is None else max(sum(client.nthreads().values()), 1)
        under_way = distributed.as_completed(hand_out(AHEAD * threads))
        for future in under_way:
            place = places.pop(future)
            try:
                yield place, future.result()
            except distributed.KilledWorker:  # by this task, or by one that waited beside it
                suspects.append(place)
            future.release()
            for more in hand_out(1):
                under_way.add(more)
        for place in suspects:
            alone = client.submit(work, tasks[place], pure=False)
            try:
                yield place, alone.result()
            except distributed.KilledWorker:
                yield place, None


@contextmanager
def _client(distributed: Any, workers: int, scheduler: str | None) -> Iterator[Any]:
    """A Dask client: of a cluster on this machine that ends with it, or of one that is running already."""
    import dask

    if scheduler is not None:
        try:
            client = distributed.Client(scheduler, timeout=JOINED_WITHIN)
        except (OSError, ValueError, TypeError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(f"--scheduler {scheduler}: {reason}; start one with dask scheduler") from None
        with client:
            try:
                client.wait_for_workers(1, timeout=JOINED_WITHIN)
            except OSError:
                raise InputError(f"--scheduler {scheduler}: has no worker; start some with dask worker") from None
            yield client
        return
    settings = {
        "distributed.scheduler.allowed-failures": DEATHS - 1,
        "distributed.worker.profile.enabled": False,  # it keeps an hour of call stacks: hundreds of megabytes
    }
    with (
        dask.config.set(settings),
        tempfile.TemporaryDirectory() as scratch,
        distributed.LocalCluster(
            n_workers=0,
            dashboard_address=":0",  # another fleet may be under way on this machine
            silence_logs=logging.CRITICAL,
        ) as cluster,
        distributed.Client(cluster) as client,
        _kept_up(partial(_begun, _serve, cluster.scheduler_address, scratch, settings), workers) as ended,
    ):
        _wait_for_first(client, ended, DEATHS * workers)
        yield client


def _wait_for_first(client: Any, ended: Sequence[int | None], most: int) -> None:
    """Until a worker has joined, however long a busy machine takes; not while they end before they have."""
    while True:
        try:
            client.wait_for_workers(1, timeout=LOOKED_AFTER_S)
        except OSError:
            if len(ended) < most:
                continue
            raise InputError(
                f"workers: {len(ended)} were begun and each ended before it took a task, the last with status "
                f"{ended[-1]}; a script that begins them needs if __name__ == '__main__', and one worker needs none"
            ) from None
        return


def _begun(work: Callable[..., None], *given: Any) -> BaseProcess:
    process = get_context("spawn").Process(target=work, args=given, daemon=True)
    process.start()
    return process


def _serve(address: str, scratch: str, settings: dict[str, Any]) -> None:
    """One of the cluster's workers, until the scheduler has gone."""
    import dask

    distributed: Any = importlib.import_module("distributed")
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one that waits for it ends it

    async def serve() -> None:
        async with distributed.Worker(
            address, nthreads=1, memory_limit=0, local_directory=scratch, dashboard=False, silence_logs=logging.CRITICAL
        ) as worker:
            await worker.finished()

    with dask.config.set(settings):
        asyncio.run(serve())


@contextmanager
def _kept_up(begun: Callable[[], BaseProcess], count: int) -> Iterator[Sequence[int | None]]:
    """So many processes, each begun anew where it has ended; with what status, so far. Dask's own nannies give a worker
    up that is not back in time, as on a busy machine, and may then count it for ever as there: what is waited for would
    never come."""
    ended = threading.Event()
    processes = [begun() for _ in range(count)]
    statuses: list[int | None] = []

    def look_after() -> None:
        while not ended.wait(LOOKED_AFTER_S):
            for place, process in enumerate(processes):
                if not process.is_alive():
                    statuses.append(process.exitcode)
                    with suppress(OSError):  # the machine has no room for another one now: at the next look
                        processes[place] = begun()
                        process.close()

    thread = threading.Thread(target=look_after, daemon=True)
    thread.start()
    try:
        yield statuses
    finally:
        ended.set()
        thread.join()
        for process in processes:
            process.kill()
        for process in processes:
            process.join()
            process.close()


def _on_processes(
    work: Callable[[Task], Outcome], tasks: Sequence[Task], workers: int
) -> Iterator[tuple[int, Outcome | None]]:
    """A pool of the standard library. One in which a process died is broken as a whole: what was under way is begun
    again, each task with a pool of its own, so that the one that kills its process is found."""
    waiting = list(enumerate(tasks))[::-1]
    under_way: dict[Future[Outcome], tuple[int, Task]] = {}
    while waiting:
        with _pool(workers) as pool:
            yield from _until_broken(pool, work, waiting, under_way, workers)
        lost, under_way = list(under_way.values()), {}
        for place, task in lost:
            yield place, _alone(work, task)


def _until_broken(
    pool: ProcessPoolExecutor,
    work: Callable[[Task], Outcome],
    waiting: list[tuple[int, Task]],
    under_way: dict[Future[Outcome], tuple[int, Task]],
    workers: int,
) -> Iterator[tuple[int, Outcome | None]]:
    """Outcomes until all is done, or a process died: then `under_way` holds what was lost."""
    try:
        while waiting or under_way:
            while waiting and len(under_way) < workers:
                future = pool.submit(work, waiting[-1][1])
                under_way[future] = waiting.pop()
            for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                outcome = future.result()
                yield under_way.pop(future)[0], outcome
    except BrokenProcessPool:
        return


def _alone(work: Callable[[Task], Outcome], task: Task) -> Outcome | None:
    for _ in range(DEATHS):
        with _pool(1) as pool:
            try:
                return pool.submit(work, task).result()
            except BrokenProcessPool:
                continue
    return None


def _pool(workers: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(workers, mp_context=get_context("spawn"))
