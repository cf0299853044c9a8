"""What a campaign folder holds, ours or another lab's: read only."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shockrig.files.campaign_names import CAMPAIGN_FORMAT
from shockrig.files.disk import is_there, shown
from shockrig.files.json_files import read_json
from shockrig.rig.bench_errors import BenchError, as_bench_errors
from shockrig.rig.recorder.run_journal import INTERRUPTED

REMEDY = "fix or restore the file"


@dataclass(frozen=True)
class SetAside:
    """An attempt that does not count, and why."""

    id: str
    folder: Path
    status: str
    reason: str


@dataclass(frozen=True)
class CampaignState:
    """What a campaign folder holds."""

    name: str
    planned: tuple[str, ...]
    recorded: tuple[str, ...]
    in_progress: tuple[str, ...]
    set_aside: tuple[SetAside, ...]
    emulated: bool = False

    @property
    def missing(self) -> tuple[str, ...]:
        return tuple(id_ for id_ in self.planned if id_ not in self.recorded)


def read_state(path: Path) -> CampaignState:
    """What is in a campaign folder, ours or another lab's (which has no plan: then nothing is missing).

    Raises
    ------
    BenchError
        Not a campaign, or a file of it cannot be read.
    """
    content = read_head(path)
    plan = content.get("plan")
    planned = [str(entry.get("id")) for entry in plan if isinstance(entry, dict)] if isinstance(plan, list) else []
    aside = []
    for folder in _folders(path / "set_aside"):
        said = read_content(folder / "run.json") if is_there(folder / "run.json") else {}
        status = str(said.get("status", INTERRUPTED))
        reason = str(said.get("reason", "nothing could be recovered"))
        aside.append(SetAside(folder.name.rsplit("-", 1)[0], folder, status, reason))
    return CampaignState(
        name=str(content.get("name", path.name)),
        planned=tuple(planned),
        recorded=tuple(folder.name for folder in _folders(path / "runs") if (folder / "run.json").exists()),
        in_progress=tuple(folder.name for folder in _folders(path / "recording")),
        set_aside=tuple(aside),
        emulated=content.get("emulated") is True,
    )


def read_head(path: Path) -> dict[str, Any]:
    """campaign.json of a campaign folder; raises BenchError where it is not there, is damaged, or is something else."""
    if not is_there(path / "campaign.json"):
        found = "is no campaign (it has no campaign.json)" if path.is_dir() else "no such campaign folder"
        raise BenchError(f"{shown(path)}: {found}; give the folder that holds campaign.json, the --out of shockrig run")
    return read_content(path / "campaign.json", CAMPAIGN_FORMAT)


def read_content(path: Path, expected: str | None = None) -> dict[str, Any]:
    """A JSON object from a file, of format `expected`; raises BenchError naming the file and the place."""
    with as_bench_errors():
        return dict(read_json(path, expected, REMEDY).content)


def _folders(path: Path) -> list[Path]:
    try:
        return sorted(entry for entry in path.iterdir() if entry.is_dir()) if path.is_dir() else []
    except OSError as error:
        raise BenchError(f"{shown(path)}: {error.strerror}; make it a folder that can be read") from None
