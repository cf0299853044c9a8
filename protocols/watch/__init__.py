"""What somebody who watches a campaign sees: in the terminal, and on a page in the browser."""

import os

NICENESS = 10


def step_back() -> None:
    """Let the recording have the processor first: it has readings to be in time for, a watcher has not."""
    os.setpriority(os.PRIO_PROCESS, 0, max(NICENESS, os.getpriority(os.PRIO_PROCESS, 0)))
