"""Files as a whole: a file that a user names is opened and read within limits, a file of ours is written whole or not
at all.

Only regular files are read: a pipe would hang, a device never ends, a folder is a slip. All of them, names that are too
long or loop, and files larger than the stated limit are a clear error before anything is done.
"""

from __future__ import annotations

import errno
import io
import os
import stat
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from shockrig.files.errors import InputError

MIB = 1 << 20
JSON_AT_MOST = 64 * MIB
TOML_AT_MOST = 16 * MIB
TABLE_AT_MOST = 1024 * MIB  # of CSV that is held in memory: a day at 200 Hz is a third of it
STREAM_AT_MOST = 64 * 1024 * MIB  # of CSV that is read in blocks
CODE_PAGES = ("cp932", "gb18030", "cp949", "cp1251")  # Windows in Japanese, Chinese, Korean, Russian
NAMES_WITHIN = 1 << 16  # bytes, in which a table has the names of its columns

_KINDS = (
    (stat.S_ISDIR, "Is a directory"),
    (stat.S_ISFIFO, "is a pipe"),
    (stat.S_ISSOCK, "is a socket"),
    (stat.S_ISCHR, "is a device"),
    (stat.S_ISBLK, "is a device"),
)


def shown(path: str | os.PathLike[str]) -> str:
    """A path as a message can carry it: one line, and printable whatever bytes its name has."""
    text = os.fspath(path)
    short = text if len(text) <= 400 else f"{text[:200]}...{text[-150:]}"
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in short)


def is_there(path: Path) -> bool:
    """Whether the name is taken by anything at all, a link to nothing included; False where it cannot even be one."""
    return os.path.lexists(path)


def real_path(path: Path) -> Path:
    """Where a name leads; as far as it leads where links go in a circle, for which `Path.resolve` has no OSError."""
    return Path(os.path.realpath(path))


def open_regular(path: str | os.PathLike[str], remedy: str, at_most: int = STREAM_AT_MOST) -> BinaryIO:
    """Open a file for reading as bytes.

    Parameters
    ----------
    path : path
    remedy : str
        What the user can do where it cannot be read; the end of the message.
    at_most : int
        Largest size in bytes.

    Raises
    ------
    InputError
        It is not there, cannot be read, is no regular file, or is larger than `at_most`.
    """
    where = shown(path)
    try:
        _demand_regular(os.stat(path), where, remedy, at_most)
        # Between the two looks the name may have become another file: without O_NONBLOCK a pipe would hang here.
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{where}: {_reason(error)}; {remedy}") from None
    except ValueError as error:  # a NUL, or half a character, in the name
        raise InputError(f"{where}: is no file name ({error}); {remedy}") from None
    try:
        _demand_regular(os.fstat(file), where, remedy, at_most)
        return os.fdopen(file, "rb")
    except BaseException:
        os.close(file)
        raise


def read_bytes(path: str | os.PathLike[str], remedy: str, at_most: int = TABLE_AT_MOST) -> bytes:
    """The content of a file; arguments and errors as for `open_regular`."""
    try:
        with open_regular(path, remedy, at_most) as file:
            content = file.read(os.fstat(file.fileno()).st_size + 1)
            # A file that grows, or one of the system's without a size, stops at `at_most`.
            while len(content) <= at_most and (more := file.read(1 << 20)):
                content += more
    except OSError as error:
        raise InputError(f"{shown(path)}: {_reason(error)}; {remedy}") from None
    if len(content) > at_most:
        raise InputError(f"{shown(path)}: {_too_large(at_most)}; {remedy}")
    return content


def decoded(content: bytes, names: Collection[str] = ()) -> str:
    """Text of a table that some other program wrote: UTF-8, or what spreadsheets on Windows write.

    Nothing but its words tells what Windows of which language wrote it: of `CODE_PAGES` the first by which one of the
    `names` stands in it, else that of Western Europe.
    """
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        pass
    begins = content[:NAMES_WITHIN]
    texts = ((page, begins.decode(page, errors="replace").lower()) for page in CODE_PAGES)
    found = (page for page, text in texts if any(name in text for name in names))
    return content.decode(next(found, "cp1252"), errors="replace")


def read_text(path: str | os.PathLike[str], remedy: str, at_most: int = JSON_AT_MOST) -> str:
    """The content of a UTF-8 file, with or without a byte-order mark; arguments and errors as for `open_regular`."""
    content = read_bytes(path, remedy, at_most)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{shown(path)}, line {line}: not UTF-8 text (byte {error.start}); save it as UTF-8, or {remedy}"
        ) from None


def open_text(
    path: str | os.PathLike[str], remedy: str, at_most: int = STREAM_AT_MOST, *, errors: str = "strict"
) -> io.TextIOWrapper:
    """Open a CSV file as UTF-8 text, line ends kept, as the csv module wants it.

    `errors` says what becomes of bytes that are not UTF-8, as for `open`; else arguments and errors as `open_regular`.
    """
    return io.TextIOWrapper(open_regular(path, remedy, at_most), encoding="utf-8-sig", errors=errors, newline="")


def write_whole(path: Path, content: str | bytes, sync: bool = False) -> None:
    """Write a file beside its name, then rename it: it is there whole or not at all.

    `sync` waits for the disk, which guards against a power cut. Half characters of text become question marks. Raises
    OSError, and then leaves nothing.
    """
    data = content.encode("utf-8", "replace") if isinstance(content, str) else content
    part = beside(path)
    try:
        with part.open("wb") as file:
            file.write(data)
            if sync:
                file.flush()
                os.fsync(file.fileno())
        os.replace(part, path)
    except BaseException:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise


def beside(path: Path) -> Path:
    """Where a file is written until it is whole: NAME.part in the same folder, which a rename puts into its place.

    Raises OSError where something other than a file has that place: the rename would take a device's or a pipe's name.
    """
    demand_place(path)
    return path.with_name(path.name + ".part")


def demand_place(path: Path) -> None:
    """Raise OSError where a file cannot be written: its name is that of a folder, a pipe, a socket or a device."""
    try:
        found = os.stat(path)
    except FileNotFoundError:
        return
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EEXIST, _kind(found), os.fspath(path))


def demand_name(path: str | os.PathLike[str], remedy: str) -> None:
    """Raise InputError where a path can be no file's: it is too long, holds a NUL or half a character, or its links
    lead in a circle. Whether something is there, and may be read, is another question.
    """
    try:
        os.stat(path)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENAMETOOLONG):
            raise InputError(f"{shown(path)}: {_reason(error)}; {remedy}") from None
    except ValueError as error:
        raise InputError(f"{shown(path)}: is no file name ({error}); {remedy}") from None


def demand_text_name(path: str | os.PathLike[str], remedy: str) -> None:
    """Raise InputError where a file's name, or a folder's above it, is no text in UTF-8, which libraries for other
    forms cannot write or read."""
    try:
        os.path.abspath(path).encode()
    except UnicodeEncodeError:
        raise InputError(f"{shown(path)}: its name is no text in UTF-8; {remedy}") from None


def sync_folder(path: Path) -> None:
    """Wait until a folder's own entries are on the disk, after a rename in it. Raises OSError."""
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _demand_regular(found: os.stat_result, where: str, remedy: str, at_most: int) -> None:
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{where}: {_kind(found)}, expected a file; {remedy}")
    if found.st_size > at_most:
        raise InputError(f"{where}: {_too_large(at_most)}; {remedy}")


def _kind(found: os.stat_result) -> str:
    return next((words for is_kind, words in _KINDS if is_kind(found.st_mode)), "is no regular file")


def _too_large(at_most: int) -> str:
    return f"is larger than {at_most // MIB} MiB, the most that is read"


def _reason(error: OSError) -> str:
    words = {
        errno.ENOTDIR: "No such file (a part of its path is no folder)",
        errno.ELOOP: "its links lead in a circle",
        errno.ENAMETOOLONG: "its name is too long",
        errno.EACCES: "may not be read (permission denied)",
    }
    return words.get(error.errno or 0, error.strerror or str(error))
