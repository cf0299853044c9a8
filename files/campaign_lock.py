"""The one writer of a campaign folder: whoever records into it or imports into it holds the folder itself (flock), for
as long as the process lives, however it ends."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from shockrig.files.disk import is_there, real_path, shown
from shockrig.files.errors import InputError


def hold(folder: Path) -> int:
    """Hold a folder for as long as this process lives; the handle to close. Raises OSError, a BlockingIOError where
    another process holds it."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BaseException:
        os.close(handle)
        raise
    return handle


def lock(campaign: Path) -> int:
    """Hold a campaign's folder; the handle to close. Raises OSError, and InputError where another process holds it."""
    try:
        return hold(campaign)
    except BlockingIOError:
        raise InputError(
            f"{shown(campaign)}: another recording or import is writing to this campaign; wait for it or stop it"
        ) from None


@contextmanager
def held(campaign: Path) -> Iterator[None]:
    """Hold a folder, made where it is not there; one that was made and holds nothing at the end is taken back.

    Raises InputError where another process holds it, or it can be no folder.
    """
    made = [folder for folder in (campaign, *real_path(campaign).parents) if not is_there(folder)]
    try:
        campaign.mkdir(parents=True, exist_ok=True)
        handle = lock(campaign)
    except OSError as error:
        for folder in made:
            with suppress(OSError):
                folder.rmdir()
        raise InputError(f"{shown(campaign)}: {error.strerror or error}; give another --out") from None
    try:
        yield
    finally:
        for folder in made:
            with suppress(OSError):  # it holds the campaign
                folder.rmdir()
        os.close(handle)
