"""The map of a fleet: every campaign is characterized once, on processes here or on a Dask cluster, and kept.

What is done lies in OUT/measured/KEY.json, KEY from the campaign's fingerprint and the settings, so that a command that
is started again goes on. Only a few tasks are under way at a time: memory does not grow with the fleet. A worker that
dies costs its task, which is begun again; a task whose worker dies each time, or that fails, is a row that says why.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shockrig.files.errors import InputError

if TYPE_CHECKING:
    from shockrig.analysis.fleet.statistics import CampaignStatistics

KEPT_IN = "measured"
KEPT_FORMAT = "shock-fleet-sensor/1"
DEATHS = 3  # of the workers of one task, from which on it is not begun again
AHEAD = 3  # tasks for each worker that are handed out at a time
DIED = f"the process that worked on it died {DEATHS} times (out of memory?); characterize it by itself"


@dataclass(frozen=True)
class FleetTask:
    """One probe of one campaign, and with what to characterize it; `kept` is the folder of what is done."""

    path: str
    probe: str
    seed: int
    extend: str | None
    kept: str | None

    @property
    def name(self) -> str:
        return self.path if self.probe == "1" else f"{self.path}, probe {self.probe}"


def measure(task: FleetTask) -> dict[str, Any]:
    """Characterize one; or say that it is done already, or why it cannot be. Runs on a worker."""
    from shockrig.analysis.characterization.characterize import characterize
    from shockrig.analysis.characterization.extension import read_extension
    from shockrig.analysis.fleet.statistics import statistics_document, statistics_of
    from shockrig.files.campaign import read_campaign
    from shockrig.files.fingerprint import fingerprint
    from shockrig.protocols.folder import software_version

    try:
        campaign = read_campaign(task.path, task.probe)
        mark = fingerprint(campaign)
        extended = "" if task.extend is None else Path(task.extend).read_text(encoding="utf-8")
        settings = json.dumps([mark, task.probe, task.seed, extended, software_version(), KEPT_FORMAT])
        key = sha256(settings.encode()).hexdigest()[:32]
        if task.kept is not None and (Path(task.kept) / f"{key}.json").is_file():
            return {"key": key}
        extensions = None if task.extend is None else read_extension(task.extend)
        found = statistics_of(characterize(campaign, task.seed, extensions), mark)
    except InputError as error:
        return {"failed": str(error)}
    except Exception as error:  # one campaign must not end the work on all others
        return {"failed": f"{type(error).__name__}: {error}; please report it with the campaign"}
    return {"key": key, "found": statistics_document(found)}


def tasks_of(
    folders: Sequence[Path], seed: int, extend: Path | None, kept: Path | None
) -> tuple[list[FleetTask], dict[str, str]]:
    """A task for each probe of each campaign in some folders, and what could not be read."""
    from shockrig.files.campaign import read_probes
    from shockrig.files.disk import real_path, shown
    from shockrig.protocols.catalogue import walk

    paths: dict[Path, Path] = {}
    troubles: list[str] = []
    for folder in folders:
        if not folder.is_dir():
            raise InputError(f"{shown(folder)}: is no folder; name campaigns, or the folder that they are in")
        here = [path for path in walk(folder, troubles) if (path / "campaign.json").is_file()]
        if not here:
            raise InputError(f"{shown(folder)}: holds no campaign (no campaign.json); name another folder")
        paths.update({real_path(path): path for path in here})
    tasks, failed = [], {text: "cannot be read" for text in troubles}
    for path in paths.values():
        try:
            probes = read_probes(path)
        except InputError as error:
            failed[str(path)] = str(error)
            continue
        of_both = (None if x is None else str(x.resolve()) for x in (extend, kept))
        stated, place = of_both
        tasks += [FleetTask(str(path), probe, seed, stated, place) for probe in probes]
    return tasks, failed


def measured_fleet(
    tasks: Sequence[FleetTask], workers: int, scheduler: str | None, say: Callable[[str], None]
) -> tuple[list[CampaignStatistics], dict[str, str]]:
    """What each task found, in the order of the tasks, and why others found nothing.

    Parameters
    ----------
    tasks : sequence of FleetTask
    workers : int
        Processes on this machine; 1 works in this one.
    scheduler : str or None
        Address of a Dask cluster that is running already, which sees the same files.
    say : function of a sentence

    Raises
    ------
    InputError
        The scheduler cannot be reached, or Dask is not installed.
    """
    from shockrig.analysis.fleet.statistics import statistics_from
    from shockrig.files.json_files import read_json, write_json
    from shockrig.protocols.time_left import TimeLeft

    found: dict[int, CampaignStatistics] = {}
    failed: dict[str, str] = {}
    clock, before = TimeLeft(), 0
    for done, (place, outcome) in enumerate(_mapped(tasks, workers, scheduler), 1):
        task = tasks[place]
        if "failed" in outcome:
            failed[task.name] = outcome["failed"]
        else:
            document = outcome.get("found")
            file = None if task.kept is None else Path(task.kept) / f"{outcome['key']}.json"
            if document is None:
                assert file is not None
                document = read_json(file, KEPT_FORMAT, "remove it").content
                before += 1
            elif file is not None:
                file.parent.mkdir(parents=True, exist_ok=True)
                write_json(file, {"format": KEPT_FORMAT, **document})
            found[place] = statistics_from({**document, "path": task.path})
        kept = f", {before} of them before" if before else ""
        say(f"{done} of {len(tasks)} characterized{kept}{clock.after(done / len(tasks))}")
    return [found[place] for place in sorted(found)], failed


def _mapped(tasks: Sequence[FleetTask], workers: int, scheduler: str | None) -> Iterator[tuple[int, dict[str, Any]]]:
    """Outcomes with their task's place, as they come."""
    with_dask = importlib.util.find_spec("distributed") is not None
    if scheduler is not None and not with_dask:
        raise InputError("--scheduler: needs Dask; pip install 'shockrig[fleet]'")
    if scheduler is None and min(workers, len(tasks)) <= 1:
        return ((place, measure(task)) for place, task in enumerate(tasks))
    if with_dask:
        return _on_dask(tasks, workers, scheduler)
    return _on_processes(tasks, workers)


def _on_dask(tasks: Sequence[FleetTask], workers: int, scheduler: str | None) -> Iterator[tuple[int, dict[str, Any]]]:
    from distributed import KilledWorker, as_completed

    with _client(workers, scheduler) as client:
        waiting = iter(enumerate(tasks))
        places: dict[Any, int] = {}

        def hand_out(count: int) -> list[Any]:
            futures = []
            for _, (place, task) in zip(range(count), waiting, strict=False):
                future = client.submit(measure, task, key=f"measure-{place}-{task.name}", pure=False)
                places[future] = place
                futures.append(future)
            return futures

        threads = max(sum(client.nthreads().values()), 1)
        under_way = as_completed(hand_out(AHEAD * threads))
        for future in under_way:
            place = places.pop(future)
            try:
                outcome = future.result()
            except KilledWorker:
                outcome = {"failed": DIED}
            future.release()
            for more in hand_out(1):
                under_way.add(more)
            yield place, outcome


@contextmanager
def _client(workers: int, scheduler: str | None) -> Iterator[Any]:
    """A Dask client: of a cluster on this machine that ends with it, or of one that is running already."""
    import logging

    import dask
    from distributed import Client, LocalCluster

    dask.config.set({"distributed.scheduler.allowed-failures": DEATHS - 1})
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout="10s")
        except (OSError, ValueError, TypeError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(f"--scheduler {scheduler}: {reason}; start one with dask scheduler") from None
        with client:
            yield client
        return
    with (
        tempfile.TemporaryDirectory() as scratch,
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            dashboard_address=None,
            local_directory=scratch,
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def _on_processes(tasks: Sequence[FleetTask], workers: int) -> Iterator[tuple[int, dict[str, Any]]]:
    """A pool of the standard library. A pool in which a process died is broken as a whole: what was under way is begun
    again, each with a pool of its own, so that the one that kills its process is found."""
    waiting = list(enumerate(tasks))[::-1]
    suspects: list[tuple[int, FleetTask]] = []
    while waiting or suspects:
        if suspects:
            place, task = suspects.pop()
            yield place, _alone(task)
            continue
        pool = _pool(workers)
        under_way: dict[Any, tuple[int, FleetTask]] = {}
        try:
            yield from _until_broken(pool, waiting, under_way, workers)
        finally:
            pool.shutdown(wait=not under_way, cancel_futures=True)
        suspects = list(under_way.values())


def _until_broken(
    pool: Any, waiting: list[tuple[int, FleetTask]], under_way: dict[Any, tuple[int, FleetTask]], workers: int
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Outcomes until all is done, or a process died: then `under_way` holds what was lost."""
    from concurrent.futures import FIRST_COMPLETED, wait
    from concurrent.futures.process import BrokenProcessPool

    while waiting or under_way:
        while waiting and len(under_way) < workers:
            try:
                future = pool.submit(measure, waiting[-1][1])
            except BrokenProcessPool:
                return
            under_way[future] = waiting.pop()
        for future in wait(under_way, return_when=FIRST_COMPLETED).done:
            try:
                outcome = future.result()
            except BrokenProcessPool:
                return
            yield under_way.pop(future)[0], outcome


def _alone(task: FleetTask) -> dict[str, Any]:
    from concurrent.futures.process import BrokenProcessPool

    for _ in range(DEATHS):
        with _pool(1) as pool:
            try:
                return pool.submit(measure, task).result()
            except BrokenProcessPool:
                continue
    return {"failed": DIED}


def _pool(workers: int) -> Any:
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    return ProcessPoolExecutor(workers, mp_context=get_context("spawn"))


def processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0))


def said_now_and_then(every_s: float) -> Callable[[str], None]:
    """Progress on standard error: the first line, then one every few seconds."""
    import time

    last = -every_s

    def say(text: str) -> None:
        nonlocal last
        if time.monotonic() - last >= every_s:
            last = time.monotonic()
            print(text, file=sys.stderr, flush=True)

    return say


def silent(_: Iterable[str] | str) -> None:
    """Progress that nobody wants."""
