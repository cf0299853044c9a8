"""Follow a campaign from its folder: the journal that grows, status.json and campaign.json, folded into one View.

Reads only. Whatever is in the files is taken for what it is: text is cleaned of control characters, numbers that are
not finite are dropped, and records of unknown shape are passed over.
"""

from __future__ import annotations

import os
import socket
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from shockrig.files.disk import open_regular
from shockrig.files.errors import InputError
from shockrig.files.json_files import read_json
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.journal import decode_line
from shockrig.rig.recorder.run_journal import JOURNAL, SPOILT
from shockrig.rig.watch.run_so_far import RunSoFar, health, traces
from shockrig.rig.watch.status_file import FILE as STATUS_FILE
from shockrig.rig.watch.view import Health, PromptView, RunView, StepView, WatchView, air_words, as_list, clean, finite

SOAK_SHOWN_S = 60.0
STALLED_AFTER_S = 10.0
LONGEST_READ = 1 << 24


class Follower:
    """Follows one campaign folder. `look` reads what is new and returns the View; close it when done.

    Parameters
    ----------
    path : Path
        Campaign folder.
    now : callable
        Monotonic seconds of this host, to say how long ago something was heard.
    """

    def __init__(self, path: Path, now: Callable[[], float]) -> None:
        if not (path / "campaign.json").is_file():
            raise BenchError(f"{path}: is no campaign (it has no campaign.json); name the --out of shockrig run")
        self.path = path
        self._now = now
        self._file = -1
        self._torn = b""
        self._run = RunSoFar()
        self._heard_s: float | None = None

    def look(self) -> WatchView:
        """The campaign as it is now. A file that cannot be read at this instant is left for the next look."""
        self._follow()
        campaign, status = _json(self.path / "campaign.json"), _json(self.path / STATUS_FILE)
        runs = self._runs(campaign)
        state, reason = self._state(status, runs)
        live = state in ("recording", "asking", "stalled")
        step_s, step_left_s, left_s, at_most_s = self._times(status, runs) if live else (None, None, None, None)
        emulated = " (EMULATED: invented, not measured)" if campaign.get("emulated") is True else ""
        run = self._run
        now_s = run.last_s or 0.0
        sensors = tuple(health(run, sensor, now_s) for sensor in run.sensors)
        zero_s = run.zero_s if run.zero_s is not None else now_s
        begin_s = zero_s if run.zero_s is not None else now_s - SOAK_SHOWN_S
        move = run.move and (run.move[0] - zero_s, None if run.move[1] is None else run.move[1] - zero_s)
        return WatchView(
            campaign=clean(campaign.get("name", self.path.name)),
            protocol=clean(status.get("protocol", campaign.get("protocol", ""))),
            bench=clean(status.get("bench", campaign.get("bench", ""))) + emulated,
            state=state,
            reason=reason,
            run=run.id,
            attempt=run.attempt,
            steps=self._steps(live),
            step_s=step_s,
            step_left_s=step_left_s,
            left_s=left_s,
            left_at_most_s=at_most_s,
            heard_s=None if self._heard_s is None else self._now() - self._heard_s,
            transfer_s=move,
            traces=tuple(traces(run, begin_s, zero_s)),
            health=sensors,
            runs=runs,
            messages=tuple(clean(text) for text in as_list(status.get("messages"))),
            prompt=self._prompt(status.get("prompt")) if state == "asking" else None,
            alarms=tuple(self._alarms(state, reason, sensors)),
            notes=tuple((round(at_s - zero_s, 1), text) for at_s, text in run.notes),
        )

    def close(self) -> None:
        """Let go of the journal; a second call does nothing."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _follow(self) -> None:
        """Read on in the journal; a journal goes on being read to its end after its folder was renamed."""
        self._read_on()
        newest = self._newest_journal()
        if newest is None or self._is_open(newest):
            return
        self._read_on()
        try:
            with open_regular(newest, "look again") as opened:
                file = os.dup(opened.fileno())
        except InputError:
            return  # renamed in this very moment: next time
        self.close()
        self._file, self._torn, self._run = file, b"", RunSoFar()
        self._read_on()

    def _newest_journal(self) -> Path | None:
        """That of the run in progress, else of the last one recorded."""
        for folder in ("recording", "runs"):
            try:
                found = sorted((self.path / folder).glob(f"*/{JOURNAL}"))
            except OSError:
                found = []
            if found and (folder == "recording" or self._file < 0):
                return found[-1]
        return None

    def _is_open(self, path: Path) -> bool:
        try:
            return self._file >= 0 and os.path.samestat(os.fstat(self._file), os.stat(path))
        except OSError:
            return True  # gone since: nothing to change to

    def _read_on(self) -> None:
        if self._file < 0:
            return
        try:
            while chunk := os.read(self._file, LONGEST_READ):
                self._heard_s = self._now()
                *lines, self._torn = (self._torn + chunk).split(b"\n")
                for line in lines:
                    record = decode_line(line)
                    if record is not None:
                        self._run.fold(record)
        except OSError:
            pass

    def _state(self, status: Mapping[str, Any], runs: Sequence[RunView]) -> tuple[str, str]:
        reason = clean(status.get("reason", ""))
        if status.get("state") != "recording":
            ended = status.get("state") == "ended" or all(run.state == "recorded" for run in runs)
            return ("ended" if ended else "idle"), reason
        if status.get("host") == socket.gethostname() and not _alive(status.get("pid")):
            return "cut off", "the recorder is gone; running the same command again puts things in order"
        if isinstance(status.get("prompt"), dict):
            return "asking", reason
        stalled = self._heard_s is not None and self._now() - self._heard_s > STALLED_AFTER_S
        return ("stalled" if stalled else "recording"), reason

    def _alarms(self, state: str, reason: str, sensors: Sequence[Health]) -> Iterator[str]:
        """What somebody should look at now, worst first."""
        if state == "cut off" or (state == "ended" and reason):
            yield f"{state}: {reason}"
        if state == "stalled" and self._heard_s is not None:
            yield "stalled: nothing has been written for some time"
        if state not in ("recording", "asking", "stalled"):
            return
        for one in sensors:
            if one.state in ("silent", "failing"):
                yield f"{one.sensor} is {one.state}"
        id_ = self._run.id
        aside = sorted(
            (name for name in _names(self.path / "set_aside") if name.rpartition("-")[0] == id_),
            key=lambda name: (len(name), name),
        )
        if aside and not self._run.ended:
            last = _json(self.path / "set_aside" / aside[-1] / "run.json")
            if last.get("status") == SPOILT:
                yield f"run {id_} was spoilt and is recorded again: {clean(last.get('reason', ''))}"

    def _prompt(self, found: Any) -> PromptView:
        stated = found if isinstance(found, dict) else {}
        deadline_s, now_s = stated.get("deadline_s"), self._run.last_s
        known = finite(deadline_s) and now_s is not None
        left_s = max(0.0, float(deadline_s or 0.0) - (now_s or 0.0)) if known else None
        return PromptView(clean(stated.get("text", "")), clean(stated.get("keys", "")), left_s)

    def _runs(self, campaign: Mapping[str, Any]) -> tuple[RunView, ...]:
        aside = Counter(name.rpartition("-")[0] for name in _names(self.path / "set_aside"))
        recording = set(_names(self.path / "recording"))
        views = []
        for entry in as_list(campaign.get("plan")):
            if not isinstance(entry, dict):
                continue
            id_ = str(entry.get("id", ""))
            recorded = "/" not in id_ and "\0" not in id_ and (self.path / "runs" / id_ / "run.json").exists()
            state = "recorded" if recorded else "now" if id_ in recording else "missing"
            words = (air_words(entry.get("source")), air_words(entry.get("destination")))
            views.append(RunView(clean(id_), *words, clean(entry.get("note", "")), state, aside[id_]))
        return tuple(views)

    def _steps(self, live: bool) -> tuple[StepView, ...]:
        done = len(self._run.steps)
        now = done - 1 if live and not self._run.ended else done
        texts = self._run.planned or tuple(text for _, text in self._run.steps)
        states = ("done" if i < now else "now" if i == now < done else "next" for i in range(len(texts)))
        return tuple(StepView(text, state) for text, state in zip(texts, states, strict=True))

    def _times(self, status: Mapping[str, Any], runs: Sequence[RunView]) -> tuple[float | None, ...]:
        """Time in the step, left in the step, and left in the campaign: as a guess and at most."""
        run, planned_s = self._run, status.get("planned_s", {})
        missing = [view.id for view in runs if view.state == "missing"]
        try:
            limits = [(float(s["at_least_s"]), float(s["at_most_s"])) for s in status["steps"]]
            ahead = [(float(planned_s[id_][0]), float(planned_s[id_][1])) for id_ in missing]
            recorded, began_s = int(status.get("recorded_here", 0)), float(status["began_s"])
            mean_s = (float(status["last_end_s"]) - began_s) / recorded if recorded else 0.0
        except (KeyError, TypeError, ValueError, IndexError, OverflowError):
            return (None, None, None, None)
        if not run.steps or len(run.steps) > len(limits) or run.last_s is None:
            return (None, None, None, None)
        number, step_s = len(run.steps) - 1, run.last_s - run.steps[-1][0]
        least_s, most_s = (0.0, 0.0) if run.ended else limits[number]
        here_s = max(0.0, least_s - step_s) + sum(least for least, _ in limits[number + 1 :])
        here_at_most_s = max(0.0, most_s - step_s) + sum(most for _, most in limits[number + 1 :])
        # Soaks take longer than they must: the runs recorded up to now say by how much.
        left_s = here_s + sum(max(mean_s, least) for least, _ in ahead)
        values = (step_s, max(0.0, least_s - step_s), left_s, here_at_most_s + sum(most for _, most in ahead))
        return values if all(map(finite, values)) else (None, None, None, None)


def _names(folder: Path) -> list[str]:
    try:
        return os.listdir(folder)
    except OSError:
        return []


def _json(path: Path) -> dict[str, Any]:
    try:
        return dict(read_json(path, None, "look again").content)
    except InputError:
        return {}


def _alive(pid: Any) -> bool:
    if not isinstance(pid, int) or pid <= 0:
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        pass  # somebody else's
    return True
