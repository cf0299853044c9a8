"""What to record next (`shock-plan/1`), and a campaign's log of such decisions, decisions.jsonl.

The log has one line of JSON for each decision, oldest first; a line that was cut off by the end of a process does not
count.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from shockrig.files.disk import is_there, read_text, shown
from shockrig.files.errors import InputError
from shockrig.files.json_files import as_object, json_text

PLAN_FORMAT = "shock-plan/1"
DECISION_FORMAT = "shock-decision/1"
LOG = "decisions.jsonl"
REMEDY = "restore the file, or move it away to decide anew"
NEEDED: dict[str, type | tuple[type, ...]] = {
    "number": int,
    "recorded": list,
    "runs": list,
    "targets": list,
    "verdicts": dict,
    "vetoed": list,
    "probes": list,
    "chased": int,
    "minutes_spent": (int, float),
}


def read_decisions(campaign: Path, probes: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """Every decision of a campaign's log; empty where there is none.

    Parameters
    ----------
    campaign : Path
    probes : sequence of str, optional
        By which further decisions are to be taken.

    Raises
    ------
    InputError
        A line is not a decision, or the last one was taken by other probes: names file, line and remedy.
    """
    path = campaign / LOG
    if not is_there(path):
        return []
    lines = read_text(path, REMEDY).split("\n")
    found = [_decision(line, f"{shown(path)}, line {n}") for n, line in enumerate(lines[:-1], 1)]
    by = found[-1]["probes"] if found else probes
    if probes is not None and by is not None and list(by) != list(probes):
        give = f"give --probe {by[0]}" if len(by) == 1 else "leave out --probe"
        raise InputError(f"{shown(path)}: decides by {_words(by)}, not by {_words(probes)}; {give}, or {REMEDY}")
    return found


def where_it_stands(goal: Mapping[str, Any]) -> tuple[str, str]:
    """A goal of a decision in words: whether it is met, and what is known now.

    What may be spent is no goal that could be met; ties are decided only once all runs are judged and explained.
    """
    now, met = goal["now"], "met" if goal["met"] else "not yet"
    if goal["goal"].startswith("minutes"):
        return "budget", f"{now:.2g} spent"
    if goal["goal"] == "ties decided":
        untied = "nothing is tied" if goal["met"] else "nothing is tied so far"
        return met, f"tied in {now} channel{'s' if now > 1 else ''}" if now else untied
    return met, "not known yet" if now is None else f"{now:.2g} %"


def _words(probes: Sequence[object]) -> str:
    return f"probe{'s' if len(probes) > 1 else ''} {' and '.join(map(str, probes))}"


def _decision(line: str, where: str) -> dict[str, Any]:
    try:
        content = json.loads(line)
    except (ValueError, RecursionError):
        raise InputError(f"{where}: not JSON; {REMEDY}") from None
    entry = as_object(content, where, DECISION_FORMAT, REMEDY)
    for key, kind in NEEDED.items():
        if not isinstance(entry.get(key), kind):
            raise InputError(f"{where}: key {key}: is missing or of another kind; {REMEDY}")
    return dict(entry.content)


def append_decision(campaign: Path, entry: Mapping[str, Any], *, sync: bool = False) -> None:
    """Add one decision to a campaign's log, behind the last whole line."""
    path = campaign / LOG
    line = " ".join(json_text(entry, indent=0).split("\n")).strip() + "\n"
    with path.open("ab+") as log:
        log.seek(0)
        written = log.read()
        log.truncate(written.rfind(b"\n") + 1)
        log.write(line.encode())
        log.flush()
        if sync:
            os.fsync(log.fileno())
