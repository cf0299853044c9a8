"""Scores that are kept as JSON lines, so that a benchmark can be stopped at any time and goes on where it ended."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Hashable, Iterable
from pathlib import Path
from typing import Any


def kept(path: Path | None) -> list[dict[str, Any]]:
    """Lines of a file; none where there is no file yet."""
    if path is None or not path.exists():
        return []
    return [json.loads(text) for text in path.read_text(encoding="utf-8").splitlines()]


def keep(path: Path | None, lines: Iterable[dict[str, Any]]) -> None:
    """Add lines to a file, if there is to be one."""
    if path is not None:
        with path.open("a", encoding="utf-8") as stream:
            stream.writelines(json.dumps(line) + "\n" for line in lines)


def scored(
    path: Path | None,
    jobs: Iterable[tuple[Hashable, ...]],
    names: tuple[str, ...],
    score: Callable[..., list[dict[str, Any]]],
) -> list[dict[str, Any]]:
    """All lines of a benchmark: what `path` holds, and what `score` gives of each job that it does not hold.

    A job's parts stand in its lines under `names`.
    """
    lines = kept(path)
    done = {tuple(line[name] for name in names) for line in lines}
    for job in jobs:
        if job in done:
            continue
        print(*job, file=sys.stderr, flush=True)
        new = score(*job)
        lines.extend(new)
        keep(path, new)
    return lines
