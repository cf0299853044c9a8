"""The map of a fleet: every campaign is characterized once, on as many workers as there are, and kept.

The least squares of a campaign begin from a rough scan of the rates: the two optimisers that `characterize` asks
besides end at the same numbers and take a third of the time.

What is done lies in OUT/measured/KEY.json, KEY from the campaign's fingerprint and the settings, so that a command that
is started again goes on. What fails is a row that says why.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shockrig.files.errors import InputError
from shockrig.protocols.parallel import DEATHS, mapped

if TYPE_CHECKING:
    from shockrig.analysis.fleet.statistics import CampaignStatistics
    from shockrig.files.causes import StatedEffect

KEPT_IN = "measured"
KEPT_FORMAT = "shock-fleet-sensor/4"
DIED = f"the process that worked on it died {DEATHS} times (out of memory?); characterize it by itself"


@dataclass(frozen=True)
class FleetTask:
    """One probe of one campaign, and with what to characterize it; `kept` is the folder of what is done.

    `path` is the campaign's folder as it was named; the others are absolute: a worker may have been started elsewhere.
    """

    path: str
    folder: str
    probe: str
    extend: str | None
    kept: str | None

    @property
    def name(self) -> str:
        return self.path if self.probe == "1" else f"{self.path}, probe {self.probe}"


def measure(task: FleetTask) -> dict[str, Any]:
    """Characterize one; or say that it is done already, or why it cannot be. Runs on a worker."""
    from shockrig.analysis.characterize.characterize import characterize
    from shockrig.analysis.characterize.part_fit import read_extension
    from shockrig.analysis.diagnose.remainder import Tolerance
    from shockrig.analysis.fleet.statistics import statistics_document, statistics_of
    from shockrig.files.campaign import read_campaign
    from shockrig.protocols.folder import software_version
    from shockrig.protocols.made_before import key_of, made_from

    try:
        campaign = read_campaign(task.folder, task.probe)
        made = made_from(campaign, Tolerance())
        mark, diagnosis = made["fingerprint"], key_of(campaign.name, made)
        extended = "" if task.extend is None else Path(task.extend).read_text(encoding="utf-8")
        settings = json.dumps([mark, task.probe, extended, software_version(), KEPT_FORMAT])
        key = sha256(settings.encode()).hexdigest()[:32]
        if task.kept is not None and (Path(task.kept) / f"{key}.json").is_file():
            return {"key": key, "diagnosis": diagnosis}
        extensions = None if task.extend is None else read_extension(task.extend)
        found = statistics_of(characterize(campaign, extensions=extensions, quickly=True), mark)
    except InputError as error:
        return {"failed": str(error)}
    except Exception as error:  # one campaign must not end the work on all others
        return {"failed": f"{type(error).__name__}: {error}; please report it with the campaign"}
    return {"key": key, "found": statistics_document(found), "diagnosis": diagnosis}


def tasks_of(folders: Sequence[Path], extend: Path | None, kept: Path | None) -> tuple[list[FleetTask], dict[str, str]]:
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
        stated, place = (None if x is None else str(x.resolve()) for x in (extend, kept))
        tasks += [FleetTask(str(path), str(path.absolute()), probe, stated, place) for probe in probes]
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

    causes = causes_of_campaigns(Path(task.path) for task in tasks)
    found: dict[int, CampaignStatistics] = {}
    failed: dict[str, str] = {}
    clock, before = TimeLeft(), 0
    for done, (place, outcome) in enumerate(mapped(measure, tasks, workers, scheduler), 1):
        task = tasks[place]
        if outcome is None:
            failed[task.name] = DIED
        elif "failed" in outcome:
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
            one = statistics_from({**document, "path": task.path})
            found[place] = replace(one, causes=causes.get(outcome["diagnosis"], {}))
        kept = f", {before} of them before" if before else ""
        say(f"{done} of {len(tasks)} characterized{kept}{clock.after(done / len(tasks))}")
    return [found[place] for place in sorted(found)], failed


def causes_of_campaigns(paths: Iterable[Path]) -> dict[str, dict[str, tuple[StatedEffect, ...]]]:
    """Key of each diagnosis that lies in or beside some campaigns (`made_before.key_of`) -> channel -> the causes that
    it names."""
    from shockrig.protocols.made_before import all_of

    return {
        key: {name: tuple(cause.as_effect() for cause in channel.causes) for name, channel in stated.channels.items()}
        for key, stated in all_of(paths)
    }


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
