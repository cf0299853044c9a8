"""Names that a person wrote into a file and that are not known: refused, with what may have been meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from shockrig.rig.errors import BenchError


def nearest(key: str, known: Iterable[str]) -> str:
    """The end of a message: what the writer may have meant, and what is known."""
    names = list(known)
    close = difflib.get_close_matches(key, names, n=1, cutoff=0.5)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    return f"{hint} (known: {', '.join(names)})"


def refuse_unknown_keys(table: Iterable[str], known: Iterable[str], where: str) -> None:
    """Raise BenchError for the first key that is not known, with the nearest one that is."""
    for key in table:
        if key not in known:
            raise BenchError(f"{where}: unknown key {key!r}{nearest(key, known)}")
