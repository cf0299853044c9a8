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
_NUMBER: Any = (int, float)
_MAYBE: Any = (int, float, type(None))
_TOOK = {"minutes": _NUMBER, "expected_minutes": _NUMBER}
_TOLD = {"information?": _NUMBER, "expected_information?": _NUMBER, "evidence?": _NUMBER, "expected_evidence?": _NUMBER}
_AIR = {"temperature_c": _NUMBER, "humidity_percent": _NUMBER}
_EXPECTED = {"expected_minutes": _NUMBER, "expected_evidence": _MAYBE, "expected_information": _MAYBE,
             "expected_progress?": _NUMBER}  # fmt: skip
_SHOCK = {"source": _AIR, "destination": _AIR, "airflow_m_s": _NUMBER, "dwell_s": _NUMBER, "why": str}
_DISPUTE = {"explanations": [{str: {str: _NUMBER}}], "labels": [str], "runs": [str], "against": [_NUMBER]}
# What a line has and is read again: kinds, [of each item], {str: of each value}; a key with "?" may be missing or null.
DECISION: Mapping[Any, Any] = {
    "number": int,
    "status": str,
    "reason": str,
    "recorded": [str],
    "goals": [{"goal": str, "met": bool, "now": _MAYBE}],
    "runs": [_SHOCK | _EXPECTED],
    "considered": [_SHOCK | _EXPECTED],
    "targets": [{"label": str, "relative": _NUMBER, "wanted": _NUMBER, "runs": int}],
    "verdicts": {
        str: {
            "verdict": str,
            "runs": int,
            "causes": {str: {str: _NUMBER}},
            "out": [[str]],
            "looks": int,
            "settled": [_DISPUTE],
            "dispute?": _DISPUTE,
            "final": bool,
            "due": bool,
        }
    },
    "vetoed": [_SHOCK],
    "probes": [str],
    "chased": int,
    "minutes_spent": _NUMBER,
    "waited_s?": _NUMBER,
    "realised?": {"runs": [str]} | _TOOK | _TOLD,
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
    if (wrong := _amiss(entry.content, DECISION)) is not None:
        raise InputError(f"{where}: key {wrong}: is missing or of another kind; {REMEDY}")
    for place, verdict in entry.content["verdicts"].items():
        for one in (*verdict["settled"], verdict.get("dispute")):
            if one and not len(one["explanations"]) == len(one["labels"]) == len(one["against"]):
                raise InputError(f"{where}: key verdicts.{place}: not as many labels as explanations; {REMEDY}")
    return dict(entry.content)


def _amiss(content: Any, shape: Any, path: str = "") -> str | None:
    """The first key that is not as its shape says; None where all are."""
    if isinstance(shape, list):
        pairs = [(str(i), one, shape[0]) for i, one in enumerate(content)] if isinstance(content, list) else None
    elif isinstance(shape, Mapping) and isinstance(content, Mapping):
        if str in shape:
            pairs = [(key, one, shape[str]) for key, one in content.items()]
        else:
            there = [
                (key, of) for key, of in shape.items() if not key.endswith("?") or content.get(key[:-1]) is not None
            ]
            pairs = [(key := name.removesuffix("?"), content.get(key, ...), of) for name, of in there]
    elif isinstance(shape, Mapping) or not isinstance(content, shape):
        pairs = None
    else:
        return None
    if pairs is None:
        return path.removeprefix(".")
    found = (_amiss(one, of, f"{path}.{key}") for key, one, of in pairs)
    return next((key for key in found if key is not None), None)


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
