"""Output folders that appear whole or not at all, and the version that their provenance names."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from glob import escape
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from shockrig.files.campaign_lock import hold
from shockrig.files.disk import is_there, real_path, shown
from shockrig.files.errors import InputError

TYPE_CHECKING = False  # as in shockrig/__init__.py
if TYPE_CHECKING:
    from shockrig.files.campaign import Campaign

EMULATED = "emulated instruments: invented, not measured"


@contextmanager
def whole_folder(out: Path) -> Iterator[Path]:
    """A temporary folder in or beside `out` to write to; when all went well its files take their places in `out`.

    A folder that exists keeps its other files; those of the same names are replaced. Raises InputError where `out`
    cannot be written: before the work where that is known by then. Nothing is left of what went wrong.
    """
    out = Path(out)
    if is_there(out) and not out.is_dir():
        raise InputError(f"--out {shown(out)}: is a file; name a folder")
    # In a folder that is there already: the one above may be another file system, or closed to us.
    place = real_path(out) if out.exists() else real_path(out).parent
    partial = place / f".{real_path(out).name}.partial-{os.getpid()}"
    new = [folder for folder in partial.parents if not folder.exists()]
    lock, reaper = -1, None
    try:
        for where in {place, real_path(out).parent}:
            _remove_left_behind(where, real_path(out).name)
        partial.mkdir(parents=True)
        lock = hold(partial)
        reaper = _reaper(partial)
        yield partial
        if not out.exists():
            os.rename(partial, out)
        else:
            # Looked at before the first file moves: a folder in the way must not leave half of the results.
            for file in sorted(partial.iterdir()):
                if (out / file.name).is_dir():
                    raise InputError(f"--out {out}: {file.name} is a folder there; move it away or name another folder")
            for file in sorted(partial.iterdir()):
                os.replace(file, out / file.name)
    except OSError as error:
        raise InputError(f"--out {out}: {error.strerror or error}; name a folder that can be written") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        if reaper is not None:
            reaper.communicate()
        if lock >= 0:
            os.close(lock)
        for folder in new:
            with suppress(OSError):  # it holds the results
                folder.rmdir()


def _reaper(folder: Path) -> subprocess.Popen[bytes] | None:
    """A shell that removes a folder once this process has ended, were it killed: it waits for a pipe to be closed."""
    command = ["/bin/sh", "-c", 'read -r _; rm -rf -- "$1"', "sh", str(folder)]
    try:
        return subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
    except OSError:
        return None  # the next command that writes there clears it away


def _remove_left_behind(place: Path, name: str) -> None:
    """Clear away what a process that was killed could not: unfinished folders that nobody holds."""
    for folder in place.glob(f".{escape(name)}.partial-*"):
        with suppress(OSError):
            handle = hold(folder)
            shutil.rmtree(folder, ignore_errors=True)
            os.close(handle)


def said_of_data(campaign: Campaign) -> dict[str, str]:
    """What a result's provenance must say of the data that it comes from; nothing where they were measured."""
    named = "" if campaign.name == "campaign" else f" (campaign {campaign.name})"
    return {"data": f"{EMULATED}{named}"} if campaign.emulated else {}


def software_version() -> str:
    """Version of the installed distribution; "unknown" from a bare checkout."""
    try:
        return version("shockrig")
    except PackageNotFoundError:
        return "unknown"
