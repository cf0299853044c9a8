"""Files that are not what they seem, and options that cannot be, through every command as a user gives it.

    python benchmarks/fuzz_commands.py [--cases 500] [--seed 0] [--only WORD]

Each case copies a folder of sound files, damages one of them (or an option, or the place of the output), and runs a
command on it in a process of its own. Wrong is: a traceback or a warning, an exit status other than 0 and 2 (1 from
check and scan), a refusal that is not one readable line, anything left behind by a refusal, anything half-written, no
number or nothing that our own readers take in what was written, 20 s without an end beside its processor time, or with
that (of commands that fit, a minute).
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fuzz_kinds import BYTES, HOSTILE_WORDS, NAMES, THINGS, structured
from fuzz_made import GOALS, sound

NOBODY = 65534
HANG_S = 20.0
LOOK_S = 0.2  # between two looks at what a command does
PROCESSOR_S = 60  # beyond which a computing command is ended
COMPUTING = ("diagnose", "certify", "plan", "history")  # take as long as their fits do
FOLDERS = ("runs", "0001", "c")
STATUS = {"check": (0, 1, 2), "scan": (0, 1, 2)}
CAMPAIGN = ("campaign.json", "runs/0001/run.json", "runs/0001/imet.csv", "runs/0001/hyt.csv", "runs", "runs/0001")
RECORDED = ("r/campaign.json", "r/status.json", "r/runs/0001/journal.log", "r/runs/0001/run.json", "r/runs")
FLY = ("--profile", "p.json", "--out", "o.csv")
# (share, command, the files that it reads): the dear ones seldom
READS: tuple[tuple[int, tuple[str, ...], tuple[str, ...]], ...] = (
    (6, ("characterize", "c", "--out", "o"), tuple(f"c/{name}" for name in CAMPAIGN)),
    (3, ("characterize", "c", "--extend", "d.json", "--out", "o"), ("d.json",)),
    (3, ("characterize", "a", "--out", "o"), ("a/runs/0001/air.csv", "a/runs/0001/run.json")),
    (2, ("diagnose", "c", "--out", "o"), tuple(f"c/{name}" for name in CAMPAIGN)),
    (1, ("diagnose", "c", "--out", "o", "--from", "d.json"), ("d.json",)),
    (2, ("certify", "c", "--out", "o"), tuple(f"c/{name}" for name in CAMPAIGN)),
    (2, ("history", "c", "a"), ("c/campaign.json", "a/campaign.json", "c/runs/0001/run.json")),
    (3, ("plan", "c", "--until", GOALS, "--out", "n.toml"), (*(f"c/{name}" for name in CAMPAIGN), "c/decisions.jsonl")),
    (2, ("plan", "none", "--until", GOALS, "--out", "n.toml", "--bench", "b.toml"), ("b.toml",)),
    (3, ("status", "r"), RECORDED),
    (3, ("watch", "r", "--once"), RECORDED),
    (3, ("list", "."), ("r/campaign.json", "c/campaign.json", "c/runs/0001/run.json", "p.json", "c")),
    (2, ("export", "c", "--out", "o.nc"), tuple(f"c/{name}" for name in CAMPAIGN)),
    (1, ("export", "r", "--out", "o.jsonl"), ("r/campaign.json", "r/runs/0001/run.json", "r/runs/0001/imet.csv")),
    (1, ("export", "c", "--out", "o.parquet"), ("c/campaign.json", "c/runs/0002/hyt.csv")),
    (8, ("correct", "f.csv", *FLY), ("f.csv", "p.json")),
    (4, ("correct", "f.bin", *FLY), ("f.bin",)),
    (4, ("correct", "f.nc", *FLY), ("f.nc",)),
    (3, ("correct", "xq.csv", *FLY), ("xq.csv",)),
    (2, ("correct", "f.csv", *FLY, "--layers", "10"), ("f.csv",)),
    (2, ("correct", "log.csv", *FLY, "--map", "m.toml"), ("log.csv", "m.toml")),
    (3, ("import", "log.csv", "--map", "m.toml", "--out", "o"), ("log.csv", "m.toml")),
    (3, ("import", "log.csv", "--look", "--out", "o"), ("log.csv",)),
    (3, ("import", "--imet", "f.csv", "--hyt", "f.csv", "--out", "o"), ("f.csv",)),
    (2, ("import", "--imet", "f.csv", "--out", "c"), ("c/campaign.json", "f.csv")),
    (3, ("simulate", "inversion", "--profile", "p.json", "--set", "duration_s=60", "--out", "o"), ("p.json",)),
    (4, ("run", "q.toml", "--bench", "b.toml", "--out", "o", "--dry-run"), ("q.toml", "b.toml")),
    (2, ("run", "q.toml", "--out", "r"), ("r/campaign.json", "r/runs/0001", "r.sealed", "r/runs/0001/run.json")),
    (2, ("check", "--bench", "b.toml"), ("b.toml",)),
    (4, ("reveal", "r.sealed", "--diagnosis", "d.json"), ("r.sealed", "d.json")),
    (2, ("emulate", "imet-xf", "--flight", "f.csv", "--profile", "p.json", "--speed", "1000"), ("f.csv", "p.json")),
)
OPTIONS: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = (
    (("correct", "f.csv", *FLY), ("--cutoff-hz", "--temperature-noise-k", "--layers", "--wmo", "--column", "--method")),
    (("characterize", "c", "--out", "o"), ("--probe", "--extend", "--out")),
    (("diagnose", "c", "--out", "o"), ("--tolerance-k", "--seed", "--from", "--probe")),
    (("certify", "c", "--out", "o"), ("--airflow", "--pressure", "--temperature", "--traced", "--country")),
    (("plan", "none", "--out", "n.toml"), ("--until", "--runs", "--bench")),
    (("simulate", "inversion", "--out", "o"), ("--noise", "--set", "--seed", "--profile")),
    (("run", "q.toml", "--out", "o", "--dry-run"), ("--bench", "--hide", "--seed", "--sealed", "--operator")),
    (("emulate", "imet-xf", "--flight", "f.csv", "--speed", "1000"), ("--rate-hz", "--fault", "--link", "--speed")),
    (("import", "--imet", "f.csv", "--out", "o"), ("--id", "--start", "--time-unit", "--airflow", "--pressure",
      "--name", "--duration", "--skip-lines", "--source-temperature", "--bead-radius", "--imet-time",
      "--time-format")),
    (("export", "c"), ("--out", "--probe")),
    (("hyt-address",), ("--bus", "--to", "--from", "--address")),
    (("scan", "--i2c", "/none"), ("--out", "--port")),
)  # fmt: skip
WRITES = (
    (("characterize", "c", "--out", "o"), "o"),
    (("correct", "f.csv", *FLY), "o.csv"),
    (("export", "c", "--out", "o.nc"), "o.nc"),
    (("export", "c", "--out", "o.jsonl"), "o.jsonl"),
    (("plan", "none", "--until", GOALS, "--out", "n.toml"), "n.toml"),
    (("plan", "none", "--until", GOALS, "--out", "n.toml"), "n.json"),
    (("simulate", "inversion", "--set", "duration_s=60", "--out", "o"), "o"),
    (("run", "q.toml", "--out", "o"), "o.sealed"),
    (("run", "q.toml", "--out", "o"), "o"),
    (("import", "--imet", "f.csv", "--out", "o"), "o"),
    (("import", "log.csv", "--look", "--out", "o"), "o"),
    (("certify", "c", "--out", "o"), "o"),
    (("slips", "--out", "o"), "o"),
)


@dataclass(frozen=True)
class Case:
    """What is run on what; `spoil` damages the folder that it is given, `nobody`: by somebody without rights."""

    words: tuple[str, ...]
    about: str
    spoil: Callable[[Path], None]
    nobody: bool = False


def cases(count: int, seed: int) -> list[Case]:
    """Cases in a row of one seed."""
    rng = random.Random(f"commands {seed}")
    return [one_case(random.Random(rng.random())) for _ in range(count)]


def one_case(rng: random.Random) -> Case:
    kind = rng.choices(("thing", "bytes", "structured", "name", "option", "writes"), (20, 18, 36, 6, 12, 8))[0]
    if kind == "option":
        words, options = rng.choice(OPTIONS)
        option, value = rng.choice(options), rng.choice(HOSTILE_WORDS)
        return Case((*words, f"{option}={value}"), f"{option} {value!r:.40}", lambda folder: None)
    if kind == "writes":
        words, out = rng.choice(WRITES)
        thing = rng.choice(list(THINGS))
        return Case(words, f"output {out} is {thing}", lambda folder: THINGS[thing](folder / out), thing == "locked")
    _, words, files = rng.choices(READS, [share for share, _, _ in READS])[0]
    file = rng.choice([name for name in files if kind == "thing" or name.rpartition("/")[2] not in FOLDERS])
    if kind == "thing":
        thing = rng.choice(list(THINGS))
        return Case(words, f"{file} is {thing}", lambda folder: THINGS[thing](folder / file), thing == "locked")
    if kind == "name":
        given = rng.choice([i for i, w in enumerate(words) if i and not w.startswith("-") and words[i - 1] != "--set"])
        name = rng.choice(NAMES)
        renamed = (*words[:given], name, *words[given + 1 :])

        def rename(folder: Path) -> None:
            with_name = os.fsencode(folder) + b"/" + os.fsencode(name)
            if (folder / words[given]).exists():
                os.rename(folder / words[given], with_name)

        def spoil(folder: Path) -> None:
            try:
                rename(folder)
            except (OSError, ValueError):
                pass  # no such name can be: the command is given it all the same

        return Case(renamed, f"{words[given]} is called {name!r:.40}", spoil)
    how = rng.choice(list(BYTES)) if kind == "bytes" else "structured"
    own = rng.random()

    def damage(folder: Path) -> None:
        target, random_ = folder / file, random.Random(own)
        data = target.read_bytes()
        target.write_bytes(structured(random_, target.name, data) if how == "structured" else BYTES[how](random_, data))

    return Case(words, f"{file} {how}", damage)


def run(case: Case, made: Path, folder: Path, commands: Callable[[list[str]], int]) -> tuple[int, str, list[str]]:
    """Exit status, what was said on standard error, and what was wrong."""
    work = folder / "w"
    shutil.copytree(made, work, symlinks=True)
    (folder / "tmp").mkdir()
    case.spoil(work)
    if case.nobody and os.geteuid() == 0:  # root may read everything
        _give_away(folder)
    before, looked_s, worked_s, idle_s = entries(work), time.monotonic(), 0.0, 0.0
    child = os.fork()
    if not child:
        _child(case, work, folder, commands)
    status, used, hung = None, None, False
    while status is None:
        done, code, used = os.wait4(child, os.WNOHANG)
        if done:
            status = os.waitstatus_to_exitcode(code)
            break
        if (since_s := time.monotonic() - looked_s) > LOOK_S:
            now_s = at_work_s(child)
            idle_s += since_s - min(max(now_s - worked_s, 0.0), since_s)
            looked_s, worked_s = looked_s + since_s, now_s
            if not hung and idle_s > HANG_S:
                os.killpg(child, signal.SIGKILL)
                hung = True
        time.sleep(0.01)
    said = (folder / "stderr").read_bytes().decode("utf-8", "replace")
    return status, said, ["no end"] if hung else wrongs(case, status, said, work, folder, before, used.ru_utime)


def at_work_s(group: int) -> float:
    """Time [s] that the processes of a group have computed, or waited for a processor to do so."""
    total = 0
    for place in Path("/proc").glob("[0-9]*"):
        try:
            if os.getpgid(int(place.name)) == group:
                computed, waited, _ = (place / "schedstat").read_text().split()
                total += int(computed) + int(waited)
        except OSError:  # it has ended
            continue
    return 1e-9 * total


def _give_away(folder: Path) -> None:
    for where, folders, files in os.walk(folder):
        for name in (*folders, *files, "."):
            path = os.path.join(where, name)
            os.chown(path, NOBODY, NOBODY, follow_symlinks=False)
    os.chmod(folder, 0o755)


def _child(case: Case, work: Path, folder: Path, commands: Callable[[list[str]], int]) -> None:
    status = 99
    try:
        os.setpgid(0, 0)
        os.environ["TMPDIR"] = tempfile.tempdir = str(folder / "tmp")
        os.chdir(work)
        for number, flags in ((0, os.O_RDONLY), (1, os.O_WRONLY | os.O_CREAT), (2, os.O_WRONLY | os.O_CREAT)):
            name = ("/dev/null", folder / "stdout", folder / "stderr")[number]
            os.dup2(os.open(name, flags, 0o666), number)
        # As a terminal's: what cannot be encoded is an error on standard output.
        sys.stdout, sys.stderr = (
            open(number, "w", 1, "utf-8", errors, closefd=False)
            for number, errors in ((1, "strict"), (2, "backslashreplace"))
        )
        resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR_S, PROCESSOR_S + 5))
        if case.nobody and os.geteuid() == 0:
            os.setegid(NOBODY)
            os.seteuid(NOBODY)
        status = commands(list(case.words))
    except SystemExit as error:
        status = error.code if isinstance(error.code, int) else 98
    except BaseException:
        import traceback

        traceback.print_exc()
        status = 97
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status & 0xFF)


def entries(folder: Path) -> set[str]:
    """Everything in a folder, by its path from there."""
    return {os.path.relpath(os.path.join(w, n), folder) for w, ds, fs in os.walk(folder) for n in (*ds, *fs)}


def wrongs(
    case: Case, status: int, said: str, work: Path, folder: Path, before: set[str], processor_s: float
) -> list[str]:
    """What must not be."""
    command, found = case.words[0], []
    if "Traceback" in said or "Warning" in said:
        lines = [line for line in said.splitlines() if "Error" in line or "Warning" in line]
        found.append(f"traceback or warning: {(lines or ['?'])[-1][:160]}")
    if status not in STATUS.get(command, (0, 2)):
        found.append(f"exit status {status}")
    new = entries(work) - before
    if status == 2:
        own = [line for line in said.splitlines() if line.startswith(f"shockrig {command}: ")]
        several = command in ("check", "run")  # faults of a bench, one a line
        if not own or (len(own) > 1 and not several):
            found.append(f"{len(own)} lines of its own")
        if any(len(line) > 900 or not line.isprintable() for line in own):
            found.append("an unreadable line")
        if new:
            found.append(f"left behind: {sorted(new)[:3]}")
    half = [name for name in new if name.endswith(".part") or ".partial" in name]
    if half or any((folder / "tmp").iterdir()):
        found.append(f"half-written: {half or sorted(p.name for p in (folder / 'tmp').iterdir())[:3]}")
    given = [work / name for name in before if name in case.words]
    found += [f"no numbers in {name}" for name in sorted(new) if not numbers(work / name, given)]
    if status == 0:
        found += [f"not read again: {said}" for name in sorted(new) if (said := not_read(work / name))]
    if processor_s > (0.9 * PROCESSOR_S if command in COMPUTING else HANG_S):
        found.append(f"{processor_s:.0f} s of processor time")
    return found


def not_read(path: Path) -> str:
    """Why one of our own readers refuses a file that was written; empty where none does."""
    from shockrig.files.campaign import read_campaign
    from shockrig.files.diagnosis import read_diagnosis
    from shockrig.files.errors import InputError
    from shockrig.files.profile import read_profile

    readers = {"campaign.json": read_campaign, "profile.json": read_profile, "diagnosis.json": read_diagnosis}
    reader = readers.get(path.name)
    if reader is None:
        return ""
    try:
        reader(path.parent if reader is read_campaign else path)
    except InputError as error:
        return str(error)[:200]
    return ""


def numbers(path: Path, given: list[Path]) -> bool:
    """Whether a file that was written holds numbers where it should: JSON without NaN, CSV without infinities but those
    that stand in a file that was given, whose columns are copied as they are."""
    if not path.is_file() or path.suffix not in (".json", ".jsonl", ".csv"):
        return True
    if path.suffix == ".csv":
        copied = sum(infinities(one) for one in given if one.is_file() and one.suffix == ".csv")
        return infinities(path) <= copied
    text = path.read_text("utf-8", "replace")

    def refuse(word: str) -> None:
        raise ValueError(word)

    try:
        for part in text.splitlines() if path.suffix == ".jsonl" else [text]:
            json.loads(part, parse_constant=refuse)
    except ValueError:
        return False
    return True


def infinities(path: Path) -> int:
    """How many cells of a CSV file are infinite."""
    text = path.read_text("utf-8", "replace")
    return len(re.findall(r"(?:^|(?<=,))[+-]?inf(?:inity)?(?=,|$)", text, re.IGNORECASE | re.MULTILINE))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="cases whose command or damage has this word")
    parser.add_argument("--verbose", action="store_true")
    args = parser.parse_args()
    from shockrig.protocols.cli import build_parser
    from shockrig.protocols.cli import main as commands

    build_parser(None, every=True)
    # Imported late, where nobody may not read the interpreter's own files.
    late = ("_strptime", "colorsys", "multiprocessing.popen_fork", "pandas", "statistics", "xml.etree.ElementTree")
    for name in (*late, "zoneinfo._zoneinfo"):
        importlib.import_module(name)
    tally, wrong = Counter(), 0
    with tempfile.TemporaryDirectory() as name:
        os.chmod(name, 0o755)
        quiet = os.dup(1)
        os.dup2(os.open("/dev/null", os.O_WRONLY), 1)
        made = sound(Path(name) / "sound")
        os.dup2(quiet, 1)
        for number, case in enumerate(cases(args.cases, args.seed)):
            if args.only not in f"{' '.join(case.words)} {case.about}":
                continue
            folder = Path(name) / str(number)
            folder.mkdir()
            status, said, found = run(case, made, folder, commands)
            tally["wrong" if found else f"status {status}"] += 1
            if found or args.verbose:
                words = " ".join(case.words).encode("utf-8", "backslashreplace").decode()
                print(f"{number} [{status}] {words:.140} | {case.about}: {'; '.join(found)}", flush=True)
                last = said.strip().splitlines()[-1:] or [""]
                print(f"      {last[0][:240].encode('utf-8', 'backslashreplace').decode()}", flush=True)
            wrong += bool(found)
            os.system(f"chmod -R u+rwx {folder} 2>/dev/null")
            shutil.rmtree(folder, ignore_errors=True)
    counted = ", ".join(f"{times} {what}" for what, times in sorted(tally.items()))
    print(f"{sum(tally.values())} cases, seed {args.seed}: {counted}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
