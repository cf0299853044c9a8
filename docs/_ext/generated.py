"""Pages made from the code (every command from its parser, every effect from the catalogue), and links out of docs/."""

from __future__ import annotations

import argparse
import re
import textwrap
from pathlib import Path
from typing import Any

REPOSITORY = "https://github.com/shockrig/shockrig/tree/main/"


def setup(app: Any) -> dict[str, bool]:
    """Write the pages before Sphinx looks for its sources."""
    app.connect("config-inited", _write)
    app.connect("source-read", _link_to_the_repository)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _write(app: Any, config: object) -> None:
    folder = Path(app.srcdir) / "reference"
    folder.mkdir(exist_ok=True)
    for name, text in (("commands.md", commands_page()), ("effects.md", effects_page())):
        file = folder / name
        if not file.exists() or file.read_text(encoding="utf-8") != text:  # a new date would mean a new build
            file.write_text(text, encoding="utf-8")


def _link_to_the_repository(app: Any, name: str, source: list[str]) -> None:
    """Links to what stands outside docs/ lead to the repository: on the site there is nothing beside the pages."""
    source[0] = re.sub(r"\]\(\.\./(?!CONTRIBUTING|CHANGELOG)", f"]({REPOSITORY}", source[0])


def commands_page() -> str:
    """The commands with their arguments, as MyST."""
    from shockrig.protocols.cli import COMMANDS, build_parser

    parser = build_parser(None, every=True)
    lines = [
        "# Commands",
        "",
        "Exit status 0 on success, 2 on bad arguments or bad input, with one line on standard error that names the",
        "file, the line or key, and the remedy; nothing half-written is left behind. Results go to files and standard",
        "output, progress to standard error. [How to have them completed](../command_line.md).",
        "",
        *_arguments(parser, skip=(argparse._SubParsersAction,)),
    ]
    subparsers = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction)).choices
    for name in COMMANDS:
        sub = subparsers[name]
        sub.formatter_class = lambda prog: argparse.HelpFormatter(prog, width=100)
        usage = sub.format_usage().removeprefix("usage: ").rstrip()
        lines += [f"## shockrig {name}", "", _text(sub.description or ""), "", "```text", usage, "```", ""]
        lines += _arguments(sub)
        if sub.epilog:
            lines += [_text(sub.epilog), ""]
    return "\n".join(lines)


def _arguments(parser: argparse.ArgumentParser, skip: tuple[type, ...] = ()) -> list[str]:
    rows = []
    for action in parser._actions:
        if isinstance(action, (*skip, argparse._HelpAction)) or action.help == argparse.SUPPRESS:
            continue
        shown = action.metavar or (action.dest.upper() if action.nargs != 0 and not action.choices else "")
        if action.choices and not action.metavar:
            shown = "{" + ",".join(map(str, action.choices)) + "}"
        names = ", ".join(action.option_strings) or str(shown)
        value = f" {shown}" if action.option_strings and action.nargs != 0 else ""
        rows.append(f"| `{names}{value}` | {_cell(action.help or '')} |")
    return ["| argument | |", "|---|---|", *rows, ""] if rows else []


def effects_page() -> str:
    """The catalogue of effects, as MyST."""
    from shockrig.analysis.effects import CATALOGUE

    lines = [
        "# Effects that a diagnosis can name",
        "",
        "Each changes one link of the measurement chain, air → exchange → body → readout → logger. The parameters",
        "carry their units; a fit keeps them within the bounds.",
        "",
        "| effect | link | seen in |",
        "|---|---|---|",
        *(
            f"| [`{e.id}`](#{e.id.replace('_', '-')}) | {e.link} | {', '.join(e.channels)} |"
            for e in CATALOGUE.values()
        ),
        "",
    ]
    for effect in CATALOGUE.values():
        lines += [f"({effect.id.replace('_', '-')})=", f"## {effect.id}", "", _sentence(effect.words.sentence), ""]
        lines += ["```text", *textwrap.wrap(effect.equation, 100), "```", ""]
        lines += [
            "Source",
            f":   {_text(effect.source)}",
            "",
            "What to do about it",
            f":   {_text(effect.words.advice)}",
            "",
        ]
        if effect.parameters:
            lines += ["| parameter | unit | from | to |", "|---|---|---|---|"]
            lines += [f"| `{p.name}` | {_cell(p.unit)} | {p.low:g} | {p.high:g} |" for p in effect.parameters]
            lines.append("")
    return "\n".join(lines)


def _sentence(template: str) -> str:
    """A report's sentence with the parameters' names in their places."""
    parts = re.split(r"\{(\w+)[^}]*\}", template)
    return "".join(f"`{part}`" if i % 2 else _escaped(part) for i, part in enumerate(parts))


def _text(text: str) -> str:
    return " ".join(_escaped(text).split())


def _escaped(text: str) -> str:
    """Plain text as MyST: nothing in it is markup."""
    return re.sub(r"([\\`*_\[\]<>$|])", r"\\\1", text)


def _cell(text: str) -> str:
    return _text(text) or " "
