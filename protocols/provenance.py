"""Where and with what a campaign is recorded: the snapshot that each session of recording leaves in campaign.json."""

from __future__ import annotations

import ctypes
import json
import platform
import socket
import subprocess
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from shockrig.protocols.folder import software_version
from shockrig.rig.bench import Bench

TIME_ERROR = 5  # adjtimex(2): the kernel's clock is not synchronised
TIMEX_BYTES = 512  # more than struct timex takes on any machine; modes = 0 only reads


def session(bench: Bench, began_at: str, operator: str | None) -> dict[str, Any]:
    """What is known of a session of recording at its begin; what is not known is left out."""
    content = {
        "began_at": began_at,
        "software": f"shockrig {software_version()}",
        "commit": _commit(),
        "python": platform.python_version(),
        "host": socket.gethostname(),
        "system": platform.platform(),
        "operator": operator,
        "clock_synchronised": _clock_synchronised(),
        "bench": bench.settings,
        "calibration": bench.calibration or None,
    }
    return json.loads(json.dumps({key: value for key, value in content.items() if value is not None}))


def _clock_synchronised() -> bool | None:
    """Whether the kernel takes its clock for synchronised (NTP, PTP); None where it cannot be asked."""
    try:
        state = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.create_string_buffer(TIMEX_BYTES))
    except (OSError, AttributeError):
        return None
    return None if state < 0 else state != TIME_ERROR


def _commit() -> str | None:
    """The source's commit, with "+" where files differ from it: as pip noted it, or of an editable installation."""
    try:
        noted = json.loads(distribution("shockrig").read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, ValueError):
        return None
    if commit := noted.get("vcs_info", {}).get("commit_id"):
        return str(commit)
    folder = Path(unquote(urlsplit(noted.get("url", "")).path))
    if not noted.get("dir_info", {}).get("editable") or not (folder / ".git").exists():
        return None
    try:
        head, state = (
            subprocess.run(["git", "-C", str(folder), *words], capture_output=True, text=True, timeout=5, check=True)
            for words in (("rev-parse", "HEAD"), ("status", "--porcelain", "--untracked-files=no"))
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return head.stdout.strip() + ("+" if state.stdout.strip() else "")
