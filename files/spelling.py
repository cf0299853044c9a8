"""What a word that is not known was probably meant to be: one likeness for keys, columns, options and commands."""

from __future__ import annotations

from collections.abc import Iterable

LEAST_LIKENESS = 0.6  # of difflib's ratio, its own default
ALIKE_KEYS = 0.72  # where unknown keys are allowed: "airflow" and "airflow_m_s" are alike, "note" and "name" are not


def nearest(word: str, known: Iterable[str], least: float = LEAST_LIKENESS) -> str | None:
    """The known word that is most like `word`, dashes at its beginning apart; None where none is."""
    from difflib import get_close_matches  # slow to import, and help shall answer at once

    names = {name.lstrip("-"): name for name in sorted(known)}
    alike = get_close_matches(word.lstrip("-"), names, 1, least)
    return names[alike[0]] if alike else None


def proposed(word: str, known: Iterable[str]) -> str:
    """What a word that is not known may have been meant to be, before the remedy; nothing where none is like it."""
    meant = nearest(word, known)
    return f"did you mean {meant!r}? Else " if meant else ""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """The end of a message on a word that is not known: what may have been meant, and what is known."""
    names = list(known)
    meant = nearest(word, names)
    return f"{f'; did you mean {meant!r}?' if meant else ''} (known: {', '.join(names)})"
