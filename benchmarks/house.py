"""The source counted, at any revisions of the repository, a column each.

    house.py 9c391cd HEAD           # 9c391cd: before the house was set in order
    house.py HEAD --long            # names every function above 60 lines
    house.py HEAD --single          # names the modules of `analysis` that one module imports

Source is what ships: `files`, `rig`, `analysis`, `protocols`, `shockrig`. A *named number* is an assignment to a name
in capitals, at a module's level, whose value holds a number. A *bare number* stands inside a function and is not one
of -1, 0, 1, 2 or a half of them, an index, or a default of a parameter.
"""

from __future__ import annotations

import argparse
import ast
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
TOPS = ("files", "rig", "analysis", "protocols", "shockrig")
LONG_LINES, COMFORTABLE_LINES, LARGE_LINES, LONGEST_SHOWN = 60, 250, 500, 5
UNREMARKABLE = {0, 0.5, 1, 2}
Function = ast.FunctionDef | ast.AsyncFunctionDef


def sources(revision: str, tops: tuple[str, ...]) -> dict[str, str]:
    """Path -> text of the Python files below some folders, as a revision holds them."""

    def git(*words: str, given: str = "") -> bytes:
        return subprocess.run(["git", *words], cwd=ROOT, input=given.encode(), check=True, capture_output=True).stdout

    listed = git("ls-tree", "-r", revision, "--", *tops).decode().splitlines()
    paths = [line.split("\t")[1] for line in listed if line.startswith("100") and line.endswith(".py")]
    answer, texts = git("cat-file", "--batch", given="".join(f"{revision}:{path}\n" for path in paths)), {}
    for path in paths:
        head, answer = answer.split(b"\n", 1)
        size = int(head.split()[2])
        texts[path], answer = answer[:size].decode(), answer[size + 1 :]
    return texts


def functions(tree: ast.AST) -> Iterator[Function]:
    return (node for node in ast.walk(tree) if isinstance(node, Function))


def lines_of(function: Function) -> int:
    assert function.end_lineno is not None
    return function.end_lineno - function.lineno + 1


def docstring_lines(function: Function) -> int:
    if ast.get_docstring(function) is None:
        return 0
    first = function.body[0]
    assert first.end_lineno is not None
    return first.end_lineno - first.lineno + 1


def named_numbers(tree: ast.Module) -> int:
    count = 0
    for statement in tree.body:
        if isinstance(statement, ast.Assign):
            names = [name.id for name in ast.walk(statement.targets[0]) if isinstance(name, ast.Name)]
        elif isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            names = [statement.target.id]
        else:
            continue
        if statement.value is not None and any(_number(node) is not None for node in ast.walk(statement.value)):
            count += sum(name.isupper() for name in names)
    return count


def bare_numbers(tree: ast.Module) -> int:
    bodies = [statement for function in functions(tree) for statement in function.body]
    seen: dict[int, bool] = {}
    for body in bodies:
        indices = {id(n) for s in ast.walk(body) if isinstance(s, ast.Subscript) for n in ast.walk(s.slice)}
        inner = {
            id(n) for f in functions(body) for d in (*f.args.defaults, *f.args.kw_defaults) if d for n in ast.walk(d)
        }
        for node in ast.walk(body):
            value = _number(node)
            if value is not None and id(node) not in indices | inner:
                seen[id(node)] = value not in UNREMARKABLE
    return sum(seen.values())


def _number(node: ast.AST) -> float | None:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        return float(node.value)
    return None


def single_importers(texts: dict[str, str]) -> list[tuple[str, str]]:
    """(module, its one importer) of the modules in `analysis`; imports at any depth, those of packages aside."""
    modules = {f"shockrig.{path[:-3].replace('/', '.')}": path for path in texts if not path.endswith("__init__.py")}
    by: dict[str, set[str]] = {}
    for path, text in texts.items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and node.module:
                for name in (node.module, *(f"{node.module}.{alias.name}" for alias in node.names)):
                    by.setdefault(name, set()).add(path)
            elif isinstance(node, ast.Import):
                for alias in node.names:
                    by.setdefault(alias.name, set()).add(path)
    return [
        (path, next(iter(by[module])))
        for module, path in sorted(modules.items())
        if path.startswith("analysis/") and len(by.get(module, ())) == 1
    ]


def counted(revision: str) -> tuple[dict[str, int | str], list[str], list[tuple[str, str]]]:
    """What -> how much; every long function; the modules with one importer."""
    texts = sources(revision, TOPS)
    trees = {path: ast.parse(text) for path, text in texts.items()}
    lengths = sorted(((lines_of(f), f.name, path) for path, t in trees.items() for f in functions(t)), reverse=True)
    long = [f"{length:4} {path}:{name}" for length, name, path in lengths if length > LONG_LINES]
    bodies = [lines_of(f) - docstring_lines(f) for t in trees.values() for f in functions(t)]
    classes = Counter(n.name for t in trees.values() for n in ast.walk(t) if isinstance(n, ast.ClassDef))
    stems = Counter(Path(path).stem for path in texts if not path.endswith("__init__.py"))
    sizes = {path: text.count("\n") for path, text in texts.items()}
    single = single_importers(texts)
    row: dict[str, int | str] = {}
    for top in TOPS:
        row[f"files in {top}"] = sum(path.startswith(f"{top}/") for path in texts)
    for top in TOPS:
        row[f"lines in {top}"] = sum(size for path, size in sizes.items() if path.startswith(f"{top}/"))
    row[f"files above {COMFORTABLE_LINES} lines"] = sum(size > COMFORTABLE_LINES for size in sizes.values())
    row[f"files above {LARGE_LINES} lines"] = sum(size > LARGE_LINES for size in sizes.values())
    row["modules of analysis with one importer"] = len(single)
    row["class names that occur more than once"] = sum(count > 1 for count in classes.values())
    row["file names that occur more than once"] = sum(count > 1 for count in stems.values())
    row["named numbers"] = sum(named_numbers(tree) for tree in trees.values())
    row["of these in analysis"] = sum(
        named_numbers(tree) for path, tree in trees.items() if path.startswith("analysis/")
    )
    row["bare numbers inside functions"] = sum(bare_numbers(tree) for tree in trees.values())
    row[f"functions above {LONG_LINES} lines"] = len(long)
    row["of these without their docstrings"] = sum(length > LONG_LINES for length in bodies)
    for place in range(LONGEST_SHOWN):
        row[f"longest function {place + 1}"] = f"{lengths[place][1]} {lengths[place][0]}"
    return row, long, single


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revisions", nargs="+", metavar="REVISION")
    parser.add_argument("--long", action="store_true", help="name every long function of the last revision")
    parser.add_argument("--single", action="store_true", help="name the modules of analysis with one importer")
    args = parser.parse_args()
    columns = [counted(revision) for revision in args.revisions]
    wide = max(len(str(value)) for row, _, _ in columns for value in row.values())
    print(f"{'':38}", *(f"{revision[:wide]:>{wide}}" for revision in args.revisions))
    for what in columns[0][0]:
        print(f"{what:38}", *(f"{row[what]:>{wide}}" for row, _, _ in columns))
    if args.long:
        print("", *columns[-1][1], sep="\n")
    if args.single:
        print("", *(f"{module}  <- {importer}" for module, importer in columns[-1][2]), sep="\n")


if __name__ == "__main__":
    main()
