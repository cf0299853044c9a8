"""A campaign folder while it is being recorded (shock-campaign/1 and what the recorder keeps beside it).

campaign.json           name, sensors, the plan
runs/ID/                whole runs, and nothing else: run.json, imet.csv, hyt.csv, journal.log
recording/ID/           the run in progress; a rename to runs/ID is what makes it count
set_aside/ID-N/         interrupted and spoilt attempts, kept with status and reason in their run.json
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from shockrig.files.campaign_lock import lock
from shockrig.files.campaign_names import CAMPAIGN_FORMAT, RUN_FORMAT
from shockrig.files.campaign_write import campaign_document, write_campaign
from shockrig.files.common_uncertainty import NOTHING_COMMON
from shockrig.files.disk import is_there, read_bytes, real_path, shown, sync_folder
from shockrig.files.errors import InputError
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.protocol import PlannedRun, Protocol
from shockrig.rig.recorder.files import write_run_files
from shockrig.rig.recorder.run_journal import (
    COMPLETE,
    JOURNAL,
    SPOILT,
    Recorder,
    RecordingError,
    RunRecord,
    read_run,
)
from shockrig.rig.recorder.run_quality import judge
from shockrig.rig.recorder.session_record import changes
from shockrig.rig.recorder.state import REMEDY, read_content

FOLDERS = ("runs", "recording", "set_aside")


class CampaignFolder:
    """The one writer of a campaign folder, from opening (creating, or checking that it is the same plan) to closing."""

    def __init__(
        self,
        path: Path,
        protocol: Protocol,
        sensors: Mapping[str, Any],
        *,
        bench: str,
        sync_every_s: float | None,
        emulated: bool = False,
        common: Mapping[str, float] | None = None,
    ):
        self.path = path
        self._protocol = protocol
        self._sync_every_s = sync_every_s
        self._is_ours = False
        self._is_new = False
        self._made = [folder for folder in (path, *real_path(path).parents) if not is_there(folder)]
        content = _document(path, protocol, sensors, bench, emulated, common or {})
        _demand_beginning(path, protocol)
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._lock = lock(path)
        except OSError as error:
            raise BenchError(f"{path}: {error.strerror}; give another --out") from None
        except InputError as error:
            raise BenchError(str(error)) from None
        try:
            self._is_ours = True
            _demand_place(path)
            if is_there(path / "campaign.json"):
                if _is_longer(path, content, protocol.continues):
                    write_campaign(path, content)
            else:
                self._is_new = True
                write_campaign(path, content)
            for name in FOLDERS:
                (path / name).mkdir(exist_ok=True)
        except OSError as error:
            self.close()
            raise RecordingError(f"{path}: {error.strerror or error}") from error
        except BenchError:
            self.close()
            raise

    def close(self) -> None:
        """Let go of the folder; a second call does nothing."""
        if self._lock >= 0:
            for name in ("recording", "set_aside") if self._is_ours else ():
                if (self.path / name).is_dir() and not any((self.path / name).iterdir()):
                    (self.path / name).rmdir()
            os.close(self._lock)
            self._lock = -1

    def changed(self, session: Mapping[str, Any]) -> list[str]:
        """What differs from the campaign's last session; raises BenchError where that would shift time stamps."""
        sessions = read_content(self.path / "campaign.json", CAMPAIGN_FORMAT).get("sessions")
        last = sessions[-1] if isinstance(sessions, list) and sessions else None
        before = last.get("bench") if isinstance(last, dict) else None
        if not isinstance(before, dict):
            return []
        try:
            return changes(before, session["bench"])
        except BenchError as error:
            raise BenchError(f"{self.path}: {error}") from None

    def add_session(self, session: Mapping[str, Any]) -> int:
        """Keep a session that begins in campaign.json; its number, counted from 1."""
        content = read_content(self.path / "campaign.json", CAMPAIGN_FORMAT)
        sessions = content.get("sessions")
        kept = [*(sessions if isinstance(sessions, list) else []), dict(session)]
        write_campaign(self.path, content | {"sessions": kept})
        return len(kept)

    def abandon(self) -> None:
        """Take back a campaign that this opening began and that holds nothing; any other stays as it is."""
        self.close()
        content = [*FOLDERS, "campaign.json"]
        if not self._is_new or any(entry.name not in content or _holds(entry) for entry in self.path.iterdir()):
            return
        (self.path / "campaign.json").unlink(missing_ok=True)
        for folder in (*(self.path / name for name in FOLDERS), *self._made):
            with contextlib.suppress(OSError):  # not there, or of somebody else by now
                folder.rmdir()

    def recover(self) -> list[str]:
        """Bring what an earlier recording left unfinished into order; one line for each run found.

        Raises
        ------
        RecordingError
            The disk does not take the files; the journals stay where they are.
        """
        try:
            return self._recover()
        except BenchError:
            raise
        except OSError as error:
            raise RecordingError(
                f"{self.path / 'recording'}: {error.strerror or error}; what was recorded is in the journals there: "
                "free some space and run the same command again"
            ) from error

    def _recover(self) -> list[str]:
        said = []
        for folder in sorted((self.path / "recording").iterdir()):
            if not _has_a_record(folder):
                shutil.rmtree(folder)
                continue
            try:
                record = self._read(folder)
            except BenchError as error:
                shutil.move(folder, self._aside(folder.name))
                said.append(f"run {folder.name}: nothing could be recovered ({error})")
                continue
            if record.status == COMPLETE:
                self._keep(folder, record)
                said.append(f"run {record.id} was whole and is kept")
            else:
                target = self._put_aside(folder, record)
                said.append(f"run {record.id} was {record.status} ({record.reason}); kept in {target}, to be run again")
        return said

    def missing(self) -> list[PlannedRun]:
        """Runs of the plan that are not there yet, in order."""
        return self.missing_of(self._protocol)

    def missing_of(self, protocol: Protocol) -> list[PlannedRun]:
        """Runs of a protocol that are not there, in order. Raises BenchError where something else stands in a place."""
        missing = []
        for run in protocol.runs:
            document = self.path / "runs" / run.id / "run.json"
            if not document.exists():
                if is_there(document.parent) and not _is_empty_folder(document.parent):
                    raise BenchError(
                        f"{shown(document.parent)}: is no run, and stands in the place of one of the plan; move it out "
                        "of the campaign"
                    )
                missing.append(run)
            elif "imported" in read_content(document, RUN_FORMAT):
                raise BenchError(
                    f"{document.parent}: was imported, and stands in the place of a run of the plan; move it out of "
                    "the campaign, or give the folder a name that is no run of the plan (and its run.json the same id)"
                )
        return missing

    def extend(self, protocol: Protocol) -> None:
        """Take up a plan with further runs; what was planned behind them and is not recorded gives way to them.

        Raises BenchError where that would take the place of a recorded run.
        """
        content = read_content(self.path / "campaign.json", CAMPAIGN_FORMAT)
        before, now = content["plan"], [planned_entry(run) for run in protocol.runs]
        plan = before[: protocol.continues] + now
        missing = {run.id for run in self.missing_of(protocol)}
        for was, then in zip(before[protocol.continues :], now, strict=False):
            if was != then and then["id"] not in missing:
                raise BenchError(f"{self.path / 'campaign.json'}: run {then['id']} is recorded and was another")
        if plan != before:
            write_campaign(self.path, content | {"plan": plan}, sync=self._sync_every_s is not None)
        self._protocol = protocol

    def begin(self, run: PlannedRun, header: Mapping[str, Any], now_s: float) -> Recorder:
        """Start the journal of a run."""
        folder = self.path / "recording" / run.id
        try:
            folder.mkdir()
        except OSError as error:
            raise RecordingError(f"{folder}: {error.strerror}") from error
        content = planned_entry(run) | dict(header)
        return Recorder(folder, content, now_s, self._sync_every_s)

    def finish(self, folder: Path) -> RunRecord:
        """Make the files of a run whose journal has ended, and put it where it belongs by its status.

        Whether faults have spoilt it is judged from the journal alone, so that a run recovered later is judged alike.
        """
        record = self._read(folder)
        try:
            if record.status == COMPLETE:
                self._keep(folder, record)
            else:
                self._put_aside(folder, record)
        except OSError as error:
            raise RecordingError(
                f"{folder}: {error.strerror or error}; the run is whole in {JOURNAL} there: "
                "free some space and run the same command again"
            ) from error
        return record

    def _read(self, folder: Path) -> RunRecord:
        record = read_run(folder)
        reason = judge(record, self._protocol.faults) if record.status == COMPLETE else None
        return replace(record, status=SPOILT, reason=reason) if reason else record

    def _keep(self, folder: Path, record: RunRecord) -> None:
        write_run_files(folder, record, sync=self._sync_every_s is not None)
        os.rename(folder, self.path / "runs" / record.id)
        if self._sync_every_s is not None:
            sync_folder(self.path / "runs")

    def _put_aside(self, folder: Path, record: RunRecord) -> Path:
        write_run_files(folder, record, sync=self._sync_every_s is not None)
        target = self._aside(record.id)
        os.rename(folder, target)
        return target

    def _aside(self, id_: str) -> Path:
        number = 1
        while (target := self.path / "set_aside" / f"{id_}-{number}").exists():
            number += 1
        return target


def _is_empty_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink() and not any(path.iterdir())


def planned_entry(run: PlannedRun) -> dict[str, Any]:
    entry = {"id": run.id, "source": asdict(run.source), "destination": asdict(run.destination)}
    if run.transfer_s is not None:
        entry["transfer"] = {"duration_s": run.transfer_s}
    entry |= {name: value for name in ("pressure_hpa", "irradiance_w_m2") if (value := getattr(run, name)) is not None}
    return entry | {"airflow_m_s": run.airflow_m_s, "note": run.note, "steps": [str(step) for step in run.steps]}


def check_folder(
    path: Path, protocol: Protocol, sensors: Mapping[str, Any], *, bench: str, emulated: bool = False
) -> None:
    """Raise BenchError where a recording would not be begun, or gone on with, in this folder; touches nothing."""
    if is_there(path) and not path.is_dir():
        raise BenchError(f"{shown(path)}: is a file; give another --out")
    if is_there(path):
        _demand_place(path)
    if is_there(path / "campaign.json"):
        _is_longer(path, _document(path, protocol, sensors, bench, emulated, {}), protocol.continues)
    _demand_beginning(path, protocol)


def _document(
    path: Path,
    protocol: Protocol,
    sensors: Mapping[str, Any],
    bench: str,
    emulated: bool,
    common: Mapping[str, float],
) -> dict[str, Any]:
    # Emulated references, anemometers and triggers have no error of their own, unless the bench file says so.
    stated = (NOTHING_COMMON.document() if emulated else {}) | dict(common)
    return campaign_document(
        path.name or protocol.name,
        sensors,
        protocol=protocol.name,
        bench=bench,
        emulated=emulated,
        **({"common_uncertainty": stated} if stated else {}),
        plan=[planned_entry(run) for run in protocol.runs],
    )


def _demand_place(path: Path) -> None:
    """Raise BenchError where a folder holds what is not a campaign; half a campaign.json is of a recording killed at
    once."""
    if not is_there(path / "campaign.json") and any(entry.name != "campaign.json.part" for entry in path.iterdir()):
        raise BenchError(f"{path}: is neither empty nor a campaign; give another --out")


def _demand_beginning(path: Path, protocol: Protocol) -> None:
    """Raise BenchError where a protocol goes on with a campaign that is not there."""
    if protocol.continues and not is_there(path / "campaign.json"):
        raise BenchError(
            f"{path}: is no campaign, and the protocol {protocol.name!r} goes on after {protocol.continues} runs of "
            "one; give that campaign's folder by --out"
        )


def _joined(before: list[Any], now: list[Any], continues: int) -> list[Any] | None:
    """The plan of a campaign once `now` follows its first runs; None where that would change what was planned.

    A plan that the campaign has gone beyond already is no other plan.
    """
    plan = before[:continues] + now
    if len(before) < continues or plan[: len(before)] != before[: len(plan)]:
        return None
    return plan + before[len(plan) :]


def _is_longer(path: Path, content: dict[str, Any], continues: int) -> bool:
    """Whether a plan extends that of a campaign, which goes on with the sensors and the plan that it began with.

    `content` then has what the campaign's own file knows besides. Raises BenchError where it is another.
    """
    file = path / "campaign.json"
    there = read_content(file, CAMPAIGN_FORMAT)
    if "plan" not in there:
        raise BenchError(f"{path}: was not recorded by shockrig run and has no plan to go on with; give another --out")
    if there.get("emulated", content["emulated"]) != content["emulated"]:
        here = "emulated instruments" if content["emulated"] else "real ones"
        raise BenchError(
            f"{file}: was recorded on the bench {there.get('bench')!r}, and this one has {here}; name that bench"
        )
    if _numberless(there.get("sensors"), content) != _numberless(content["sensors"], content):
        raise BenchError(f"{file}: was recorded with other sensors than this bench has; give another --out")
    before = there["plan"]
    plan = _joined(before, content["plan"], continues)
    if plan is None:
        after = f" of {len(before)} runs; the one given goes on after {continues}" if continues else ""
        raise BenchError(
            f"{file}: was begun with the protocol {there.get('protocol')!r} and another plan{after}; "
            "give the same protocol, or another --out"
        )
    content |= {"plan": plan, "protocol": there.get("protocol", content["protocol"])}
    for key in ("sessions", "common_uncertainty"):
        if key in there:
            content[key] = there[key]
    return len(plan) > len(before)


def _numberless(sensors: Any, content: Mapping[str, Any]) -> Any:
    """A campaign's sensors; emulated ones without serial numbers, which come from what is sealed and not yet open."""
    if not (content["emulated"] and isinstance(sensors, dict)):
        return sensors
    return {name: one | {"serial": None} if isinstance(one, dict) else one for name, one in sensors.items()}


def _has_a_record(folder: Path) -> bool:
    """Whether a journal was begun and has one whole line at least; before that there is nothing to keep."""
    if not is_there(folder / JOURNAL):
        return False
    try:
        return b"\n" in read_bytes(folder / JOURNAL, REMEDY)
    except InputError:
        return True  # whoever reads it says why it cannot be


def _holds(entry: Path) -> bool:
    return entry.is_dir() and any(entry.iterdir())
