"""Runs the tutorial from its first command to its last and writes what they print into it; `--check` only compares.

In `console` blocks the lines after `$ ` are commands; in `pycon` blocks those after `>>> ` and `... ` are Python.
Numbers may differ by 5 % or two of their last digit, since processors round differently; words may not.
"""

from __future__ import annotations

import argparse
import contextlib
import difflib
import io
import os
import re
import subprocess
import sys
import tempfile
from code import InteractiveInterpreter
from pathlib import Path

PAGE = Path(__file__).parent / "tutorial.md"
NUMBER = re.compile(r"\d+(?:\.\d+)?")
AGREE = 0.05


def main() -> int:
    """Write the page anew, or compare; 1 where it is out of date."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--check", action="store_true", help="write nothing; say what differs")
    check = parser.parse_args().check
    text = PAGE.read_text(encoding="utf-8")
    made = refreshed(text)
    if not check:
        PAGE.write_text(made, encoding="utf-8")
        return 0
    if agree(text, made):
        return 0
    print("".join(difflib.unified_diff(text.splitlines(True), made.splitlines(True), "tutorial.md", "what is printed")))
    print(f"{PAGE} is out of date; run {Path(__file__).name}", file=sys.stderr)
    return 1


def refreshed(text: str) -> str:
    """The page with the output of its commands, run one after the other in one empty folder."""
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            interpreter = InteractiveInterpreter({})
            make = {"console": printed_by, "pycon": lambda block: _python(block, interpreter)}
            block = r"^```(console|pycon)\n(.*?)^```$"
            return re.sub(block, lambda m: f"```{m[1]}\n{make[m[1]](m[2])}```", text, flags=re.MULTILINE | re.DOTALL)
        finally:
            os.chdir(here)


def printed_by(block: str) -> str:
    lines = []
    for command in (line[2:] for line in block.splitlines() if line.startswith("$ ")):
        print(command, file=sys.stderr)
        environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
        done = subprocess.run(command, shell=True, capture_output=True, text=True, env=environment)
        if done.returncode:
            raise SystemExit(f"{command}: status {done.returncode}\n{done.stderr}")
        here = f"{Path.cwd()}/"  # where the reader is does not belong to the page
        lines += [f"$ {command}\n", *(f"{line}\n" for line in done.stdout.replace(here, "").splitlines())]
    return "".join(lines)


def _python(block: str, interpreter: InteractiveInterpreter) -> str:
    lines, source = [], ""
    shown = [line for line in block.splitlines() if line.startswith((">>> ", "... "))]
    for line, following in zip(shown, [*shown[1:], ">>> "], strict=True):
        source += line[4:] + "\n"
        lines.append(f"{line}\n")
        if following.startswith(">>> "):
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                interpreter.runsource(source, symbol="single" if source.count("\n") == 1 else "exec")
            lines.append(printed.getvalue())
            source = ""
    return "".join(lines)


def agree(one: str, other: str) -> bool:
    """Whether two texts have the same words, and numbers that are as good as equal."""
    if NUMBER.sub("0", one).split() != NUMBER.sub("0", other).split():
        return False
    return all(_near(a, b) for a, b in zip(NUMBER.findall(one), NUMBER.findall(other), strict=True))


def _near(one: str, other: str) -> bool:
    last_digit = 10.0 ** -len(one.partition(".")[2])
    return abs(float(one) - float(other)) <= max(AGREE * float(one), 2.0 * last_digit)


if __name__ == "__main__":
    sys.exit(main())
