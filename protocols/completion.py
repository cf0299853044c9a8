"""Completion scripts for shells, made from the parsers by shtab; paths are completed where an argument is a path."""

from __future__ import annotations

import argparse
from pathlib import Path


def completion_script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script that makes `shell` (bash, zsh or tcsh) complete the program of `parser`.

    Every argument whose type is Path completes to files and folders.
    """
    import shtab

    for action in _actions(parser):
        if action.type is Path and action.choices is None:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    script: str = shtab.complete(parser, shell=shell)
    return script


def _actions(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    """Actions of a parser and of all its commands."""
    found = []
    for action in parser._actions:  # argparse has no public list of them; shtab itself reads this one
        found.append(action)
        if isinstance(action, argparse._SubParsersAction):
            for sub in {id(sub): sub for sub in action.choices.values()}.values():
                found += _actions(sub)
    return found
