"""Diagnoses that lie in or beside a campaign: those of the campaign as it is are taken, others are said to be old."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shockrig.files.disk import shown

if TYPE_CHECKING:
    from shockrig.analysis.design.goals import Place
    from shockrig.analysis.diagnose.diagnosed import ChannelOutcome
    from shockrig.analysis.diagnose.remainder import Tolerance
    from shockrig.files.campaign import Campaign
    from shockrig.files.diagnosis_data import StatedDiagnosis

KEY = "made_from"


def made_from(campaign: Campaign, tolerance: Tolerance) -> dict[str, Any]:
    """What diagnosis.json says of what it rests on."""
    from shockrig.files.fingerprint import fingerprint
    from shockrig.protocols.folder import software_version

    return {
        "probe": campaign.probe,
        "runs": [run.id for run in campaign.runs],
        "fingerprint": fingerprint(campaign),
        "tolerance_k": tolerance.temperature_k,
        "tolerance_percent": tolerance.humidity_percent,
        "software": f"shockrig {software_version()}",
    }


def outdated(stated: StatedDiagnosis, campaign: Campaign, tolerance: Tolerance | None = None) -> str:
    """Why a diagnosis is not one of the campaign as it is, in a phrase; empty where it is."""
    from shockrig.analysis.diagnose.remainder import Tolerance

    then, now = stated.extra.get(KEY), made_from(campaign, tolerance or Tolerance())
    if not isinstance(then, dict):
        return "it does not say what it was made from"
    if then == now:
        return ""
    if new := len(set(now["runs"]) - _runs(then)):
        return f"{new} of the {len(now['runs'])} runs are newer"
    if then.get("software") != now["software"]:
        return f"made by {then.get('software')}"
    if any(then.get(key) != now[key] for key in ("tolerance_k", "tolerance_percent")):
        return "made with another tolerance"
    return "made from other recordings"


def newer_runs(stated: StatedDiagnosis, campaign: Campaign) -> int:
    """How many runs a campaign has more than when a diagnosis of it was made; 0 where it is another campaign's."""
    then = stated.extra.get(KEY)
    if not isinstance(then, dict) or stated.campaign != campaign.name:
        return 0
    return len({run.id for run in campaign.runs} - _runs(then))


def _runs(then: dict[str, Any]) -> set[str]:
    runs = then.get("runs")
    return set(map(str, runs)) if isinstance(runs, list) else set()


def outcomes(path: Path, seen: Sequence[Campaign], say: Callable[[str], None]) -> dict[Place, ChannelOutcome]:
    """What diagnoses in and beside the campaign's folder found of it as it is, by place; `say` is told of each.

    `seen` is the campaign as each of its probes saw it.
    """
    from shockrig.analysis.diagnose.diagnosed import read_outcome
    from shockrig.analysis.estimate.quantity import QUANTITIES
    from shockrig.files.campaign_names import sensor_name

    found: dict[Place, ChannelOutcome] = {}
    for campaign in seen:
        old = ""
        for file, stated in _of(path, campaign):
            why = outdated(stated, campaign)
            taken = {
                sensor_name(name, campaign.probe): one
                for name in QUANTITIES
                if not why and (channel := stated.channels.get(name)) is not None
                and (one := read_outcome(channel.verdict, channel.extra.get("explanations"), name)) is not None
            }  # fmt: skip
            if taken:
                say(f"{shown(file)}: is a diagnosis of this campaign as it is, and is used")
                found |= taken
                break
            old = (
                old or f"{shown(file)}: is out of date ({why or 'of another version'}), the campaign is diagnosed anew"
            )
        else:
            if old:
                say(old)
    return found


def current(path: Path, campaign: Campaign) -> Path | None:
    """The newest diagnosis in or beside a campaign's folder that is of it as it is; None where there is none."""
    return next((file for file, stated in _of(path, campaign) if not outdated(stated, campaign)), None)


def key_of(campaign: str, made_from: Any) -> str:
    """By what a diagnosis is known: the campaign's name, and what it was made from."""
    return json.dumps([campaign, made_from], sort_keys=True)


def all_of(paths: Iterable[Path]) -> Iterator[tuple[str, StatedDiagnosis]]:
    """All diagnoses in or beside some campaigns' folders by `key_of`, each read once, the newest last.

    Campaigns lie beside one another, so that to look about for each of them by itself would take time as the square of
    their number.
    """
    from shockrig.files.diagnosis import read_diagnosis
    from shockrig.files.errors import InputError

    homes = {path.resolve() for path in paths}
    places = homes | {home.parent for home in homes}
    files = {file for place in places for deep in ("*", "*/probe-*") for file in place.glob(f"{deep}/diagnosis.json")}
    files |= {file for home in homes if (file := home / "diagnosis.json").is_file()}
    for file in sorted(files, key=_newest_first, reverse=True):
        try:
            stated = read_diagnosis(file)
        except InputError:
            continue
        yield key_of(stated.campaign, stated.extra.get(KEY)), stated


def _newest_first(file: Path) -> tuple[float, str]:
    return -file.stat().st_mtime, str(file)


def _of(path: Path, campaign: Campaign) -> Iterator[tuple[Path, StatedDiagnosis]]:
    """Diagnoses of a campaign's probe by name, in its folder, in folders in that and beside it; the newest first."""
    from shockrig.files.diagnosis import read_diagnosis
    from shockrig.files.errors import InputError

    home = path.resolve()
    files = {file for place in (home.parent, home) for file in place.glob("*/diagnosis.json")}
    files |= {file for place in (home.parent, home) for file in place.glob(f"*/probe-{campaign.probe}/diagnosis.json")}
    files |= {file for file in (home / "diagnosis.json",) if file.is_file()}
    for file in sorted(files, key=_newest_first):
        try:
            stated = read_diagnosis(file)
        except InputError:
            continue  # it is nobody's business here that it cannot be read
        then = stated.extra.get(KEY)
        same = {run.id for run in campaign.runs}
        its_own = not isinstance(then, dict) or (then.get("probe") == campaign.probe and _runs(then) <= same)
        if stated.campaign == campaign.name and its_own:
            yield file, stated
