"""Argument parser whose errors are one line that names the option and the remedy, with exit status 2.

argparse prints its usage and a message on two lines. Here every message is one line that points to --help; how numbers
are read is registered with the parser, so that what is said of them is ours.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterable, Sequence

from shockrig.files.spelling import nearest

TYPE_CHECKING = False  # as in shockrig/__init__.py
if TYPE_CHECKING:
    from typing import Any, NoReturn

LONGEST_WORD = 40  # characters of what was given that a message repeats


class Parser(argparse.ArgumentParser):
    """An ArgumentParser without abbreviations and with errors of one line."""

    def __init__(self, **settings: Any) -> None:
        # With exit_on_error argparse would turn its errors into text before they come here.
        super().__init__(**{"allow_abbrev": False, "exit_on_error": False} | settings)
        self.register("type", int, _number(int, "a whole number"))
        self.register("type", float, _number(float, "a number"))

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """As argparse's; an error ends the program."""
        try:
            return super().parse_known_args(args, namespace)
        except argparse.ArgumentError as error:
            self.error(str(error).removeprefix("argument "))

    def parse_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> argparse.Namespace:
        """As argparse's; what no argument takes is an error of the command that it was said to."""
        parsed, extra = self.parse_known_args(args, namespace)
        if extra:
            of: Parser = getattr(parsed, "parser", self)
            of.error(of.unknown(extra[0]))
        return parsed

    def error(self, message: str) -> NoReturn:
        """Say what is wrong in one line and end with status 2."""
        remedy = "" if "--help" in message or "did you mean" in message else f"; {self.prog} --help says what it takes"
        print(f"{self.prog}: {' '.join(message.split())}{remedy}", file=sys.stderr)
        sys.exit(2)

    def unknown(self, word: str) -> str:
        """What to say of a word that no argument takes."""
        if not word.startswith("-"):
            return f"{word!r} is one argument too many; {self.prog} --help says what it takes"
        name = word.partition("=")[0]
        # The help is where argparse tells its options without private attributes.
        options = set(re.findall(r"(?<![\w-])--?[A-Za-z][\w-]*", self.format_help()))
        return f"{name}: no such option; {meant_or(name, options, f'{self.prog} --help lists them')}"


def meant_or(word: str, known: Iterable[str], otherwise: str) -> str:
    """A question after the word that was probably meant, else `otherwise`."""
    meant = nearest(word, known)
    return f"did you mean {meant}?" if meant else otherwise


def whole_number(text: str) -> int:
    """A whole number, decimal or as 0x28, as the type of an argument."""
    try:
        return int(text, 0)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a whole number such as 40 or 0x28, found {text[:40]!r}") from None


def _number(kind: type[int] | type[float], words: str) -> Callable[[str], int | float]:
    """A type of an argument that says what it expects."""

    def read(text: str) -> int | float:
        try:
            return kind(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"expected {words}, found {text[:LONGEST_WORD]!r}") from None

    return read
