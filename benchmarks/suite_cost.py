"""What the tests cost by file and by test: a plugin of pytest.

    PYTHONPATH=benchmarks pytest -p suite_cost

After the run it prints seconds of the processor (those of the processes that a test started and waited for included)
and of the clock. What a fixture of a session makes counts where it was made first.
"""

from __future__ import annotations

import os
import time
from collections import defaultdict
from collections.abc import Generator
from typing import Any

import pytest

FEWEST_S, TESTS_SHOWN = 1.0, 60
Cost = tuple[float, float]
by_file: dict[str, list[Cost]] = defaultdict(list)
by_test: dict[str, Cost] = {}
SPENT = pytest.StashKey[Cost]()


def spent() -> Cost:
    times = os.times()
    return sum(times[:4]), time.monotonic()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Generator[None, Any, Any]:
    report = yield
    before, now = item.stash.get(SPENT, None), spent()
    item.stash[SPENT] = now
    report.cost = tuple(b - a for a, b in zip(before, now, strict=True)) if before else (0.0, 0.0)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, Any, Any]:
    item.stash[SPENT] = spent()
    return (yield)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    cost: Cost = tuple(getattr(report, "cost", (0.0, 0.0)))  # type: ignore[assignment]
    by_file[report.nodeid.split("::")[0]].append(cost)
    key = f"{report.nodeid} ({report.when})"
    by_test[key] = cost


def pytest_terminal_summary(terminalreporter: Any) -> None:
    write = terminalreporter.write_line
    files = {file: tuple(map(sum, zip(*costs, strict=True))) for file, costs in by_file.items()}
    write(f"\n{'processor':>10} {'clock':>7}  seconds of {len(files)} files")
    write(f"{sum(c for c, _ in files.values()):10.1f} {sum(w for _, w in files.values()):7.1f}  all")
    for file, (processor, clock) in sorted(files.items(), key=lambda item: -item[1][0]):
        if processor + clock >= FEWEST_S:
            write(f"{processor:10.1f} {clock:7.1f}  {file}")
    write("")
    for test, (processor, clock) in sorted(by_test.items(), key=lambda item: -max(item[1]))[:TESTS_SHOWN]:
        write(f"{processor:10.1f} {clock:7.1f}  {test}")
