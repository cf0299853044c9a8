"""One session of recording as campaign.json keeps it: by whom, with what software, on which host, with which settings.

    "sessions": [{"began_at", "software", "commit", "python", "host", "system", "operator", "clock_synchronised",
                  "bench": {...}, "calibration": {...}}]

A campaign that goes on under other settings says so; where they would shift its time stamps it does not go on.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from shockrig.rig.bench_errors import BenchError

# settings that enter the time stamps of readings: under another value the same sensor would look faster or slower
SHIFTS_TIME = ("latency_s", "sampled_after_s")


def changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """What differs between the bench settings of two sessions, one text each: "sensors.hyt.retries: 3, now 5".

    Raises
    ------
    BenchError
        A setting that shifts time stamps differs.
    """
    old, new = dict(_leaves(before)), dict(_leaves(now))
    said = []
    for key in sorted(old.keys() | new.keys()):
        if (was := old.get(key)) != (value := new.get(key)):
            text = f"{key}: {_words(was)}, now {_words(value)}"
            if key.rpartition(".")[2] in SHIFTS_TIME:
                raise BenchError(
                    f"{text}; that shifts the time stamps within one campaign: restore it in the bench file, "
                    "or give another --out"
                )
            said.append(text)
    return said


def _leaves(table: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, Mapping) and value:
            yield from _leaves(value, f"{path}{key}.")
        else:
            yield f"{path}{key}", value


def _words(value: Any) -> str:
    return "not there" if value is None else json.dumps(value)
