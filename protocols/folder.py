"""Output folders that appear whole or not at all, and the version that their provenance names."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from shockrig.files.errors import InputError


@contextmanager
def whole_folder(out: Path) -> Iterator[Path]:
    """A temporary folder in or beside `out` to write to; when all went well its files take their places in `out`.

    A folder that exists keeps its other files; those of the same names are replaced. Raises InputError where `out`
    cannot be written: before the work where that is known by then. Nothing is left of what went wrong.
    """
    out = Path(out)
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: is a file; name a folder")
    # In a folder that is there already: the one above may be another file system, or closed to us.
    place = out.resolve() if out.exists() else out.resolve().parent
    partial = place / f".{out.resolve().name}.partial-{os.getpid()}"
    new = [folder for folder in partial.parents if not folder.exists()]
    try:
        partial.mkdir(parents=True)
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
        for folder in new:
            with suppress(OSError):  # it holds the results
                folder.rmdir()


def software_version() -> str:
    """Version of the installed distribution; "unknown" from a bare checkout."""
    try:
        return version("shockrig")
    except PackageNotFoundError:
        return "unknown"
