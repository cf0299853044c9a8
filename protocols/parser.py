"""Argument parser whose errors are one line that names the option and the remedy, with exit status 2.

argparse prints its usage and a message in its own words. Here every message becomes one line; those it does not know (a
later Python may word them otherwise) keep argparse's words and point to --help.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable, Sequence

TYPE_CHECKING = False  # as in shockrig/__init__.py
if TYPE_CHECKING:
    from typing import Any, NoReturn

EXPECTED = {"int": "a whole number", "float": "a number", "Path": "a path"}


class Parser(argparse.ArgumentParser):
    """An ArgumentParser without abbreviations and with errors of one line."""

    def __init__(self, **settings: Any) -> None:
        # With exit_on_error argparse would turn its errors into text before they come here.
        super().__init__(**{"allow_abbrev": False, "exit_on_error": False} | settings)

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """As argparse's; an error ends the program."""
        try:
            return super().parse_known_args(args, namespace)
        except argparse.ArgumentError as error:
            if error.argument_name is None:
                self.error(error.message)
            self.error(f"{error.argument_name}: {_explained(error.message)}")

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
        if found := re.fullmatch(r"the following arguments are required: (.*)", message):
            missing = _joined(found[1].split(", "))
            message = f"{missing} {'are' if ' and ' in missing else 'is'} missing; {self.prog} --help says what to give"
        print(f"{self.prog}: {' '.join(message.split())}", file=sys.stderr)
        sys.exit(2)

    def unknown(self, word: str) -> str:
        """What to say of a word that no argument takes."""
        if not word.startswith("-"):
            return f"{word!r} is one argument too many; {self.prog} --help says what it takes"
        name = word.partition("=")[0]
        # The help is where argparse tells its options without private attributes.
        options = set(re.findall(r"(?<![\w-])--?[A-Za-z][\w-]*", self.format_help()))
        return f"{name}: no such option; {nearest(name, options, f'{self.prog} --help lists them')}"


def nearest(word: str, known: Iterable[str], otherwise: str) -> str:
    """A question after the word that was probably meant, else `otherwise`."""
    from difflib import get_close_matches  # not needed for --help, which shall answer at once

    names = {name.lstrip("-"): name for name in sorted(known)}  # dashes alone are no likeness
    alike = get_close_matches(word.lstrip("-"), names, n=1)
    return f"did you mean {names[alike[0]]}?" if alike else otherwise


def whole_number(text: str) -> int:
    """A whole number, decimal or as 0x28, as the type of an argument."""
    try:
        return int(text, 0)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a whole number such as 40 or 0x28, found {text!r}") from None


def _explained(message: str) -> str:
    """One of argparse's messages about an argument, with the remedy."""
    if found := re.fullmatch(r"invalid (\w+) value: (.*)", message, re.DOTALL):
        return f"expected {EXPECTED.get(found[1], 'another value')}, found {found[2][:40]}"
    if found := re.fullmatch(r"invalid choice: (.*) \(choose from (.*)\)", message, re.DOTALL):
        choices = [choice.strip("'\"") for choice in found[2].split(", ")]
        return f"expected {_joined(choices, 'or')}, found {found[1][:40]}"
    if message == "expected one argument":
        return "needs a value; give one after it"
    if message == "expected at least one argument":
        return "needs one value or more; give them after it"
    if found := re.fullmatch(r"ignored explicit argument (.*)", message, re.DOTALL):
        return f"takes no value; leave {found[1]} out"
    return message


def _joined(words: Sequence[str], by: str = "and") -> str:
    """`a, b and c`."""
    return f" {by} ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
