"""What each rule, cap and threshold of the diagnosis is good for: taken away in turn, on a few small campaigns.

    python benchmarks/ablation.py --work DIR [--samples DIR] [--logs DIR] [--only TEXT] [--minutes N] [--table]

Each campaign has one channel. It is diagnosed with every rule in place, then without each rule of `ablation_rules.py`
that had a say in the first diagnosis: a function whose result was another than its neutral one's, a number that a
function mentions which ran. The others count as unchanged. A JSON line per rule and campaign is kept in --work, so that
it can be stopped and resumed; `--table` only prints what is there.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ablation_rules import RULES, Rule, lines, there, watching, without

FRESH = 1_000_000
NOTHING = "nothing taken away"
SAME = 0.02  # relative, of errors that are alike
LIMIT_S = 240
FIRST_SEED = 26000
T, RH = "temperature", "humidity"
FILES = {T: ("imet", "hyt"), RH: ("hyt", "imet")}  # what is kept of a channel, and what is not
SAMPLES = {
    "unlisted-probe-swap": T,
    "unlisted-ageing": RH,
    "unlisted-mains-pickup": T,
    "unlisted-warm-gain": RH,
    "unlisted-capacitive-crosstalk": RH,
}
SETS = ("haar temperature A", "haar temperature B", "plunges by hand", "rbr thermistor 1, plunge and baths")
ORDINARY = ("convective_film", "stem_conduction")


@dataclass(frozen=True)
class Case:
    """One campaign of one channel: the verdicts that are right (all where empty), what may be named, and its maker.

    `make` writes campaign and, where there can be one, a fresh one of the same world beside it. With `exact` every
    significant remainder is material.
    """

    name: str
    channel: str
    right: tuple[str, ...]
    make: Callable[[Path], tuple[str, ...]]
    exact: bool = True


def only(campaign: Path, channel: str) -> None:
    """Take the other sensor out of a campaign."""
    keep, drop = FILES[channel]
    head = json.loads((campaign / "campaign.json").read_text(encoding="utf-8"))
    head["sensors"] = {k: v for k, v in head["sensors"].items() if k == keep}
    (campaign / "campaign.json").write_text(json.dumps(head), encoding="utf-8")
    for file in campaign.glob(f"runs/*/{drop}.csv"):
        file.unlink()


def virtual(name: str, seed: int, channel: str, hidden: str | int | tuple[str, ...], strength: float | str) -> Case:
    """A world of the virtual bench, drawn until its effects act in the channel alone or besides."""
    outside = hidden == "outside"
    right = ("adequate",) if hidden == "none" else ("unexplained", "described") if outside else ("explained",)

    def make(home: Path) -> tuple[str, ...]:
        from shockrig.rig.virtual.batch import simulate_campaign
        from shockrig.rig.virtual.hide import draw_effect, draw_hidden
        from shockrig.rig.virtual.plans import standard_plan
        from shockrig.rig.virtual.truth import draw_truth

        rng = np.random.default_rng(seed)
        if isinstance(hidden, tuple):
            drawn = [draw_effect(rng, one, strength, channel) for one in hidden]
        else:
            drawn = draw_hidden(rng, hidden, strength)
            while hidden != "none" and not all(channel in one.channels for one in drawn):
                drawn = draw_hidden(rng, hidden, strength)
        truth = draw_truth(rng, "rough", drawn)
        for place, folder in ((seed, "campaign"), (seed + FRESH, "fresh")):
            only(simulate_campaign(truth, standard_plan(), place, home / folder), channel)
        return tuple(one.effect for one in truth.effects if channel in one.channels)

    return Case(name, channel, right, make)


def sample(name: str, samples: Path) -> Case:
    """A campaign of another program, with an effect that nobody lists."""

    def make(home: Path) -> tuple[str, ...]:
        shutil.copytree(samples / name, home / "campaign")
        only(home / "campaign", SAMPLES[name])
        return ()

    return Case(name, SAMPLES[name], ("unexplained", "described"), make, exact=False)


def real(name: str, logs: Path) -> Case:
    """One of the sets of `real_data.py`."""
    from real_sets import real_sets

    chosen = next(s for s in real_sets() if s.name == name)

    def make(home: Path) -> tuple[str, ...]:
        chosen.make(logs, home / "campaign")
        return ()

    return Case(name, chosen.channel, (), make, exact=False)


def cases(samples: Path | None, logs: Path) -> list[Case]:
    """The base set."""
    found = [
        virtual("plain T", FIRST_SEED, T, "none", 1.0),
        virtual("plain RH", FIRST_SEED + 1, RH, "none", 1.0),
        virtual("single T", FIRST_SEED + 2, T, 1, "comfortable"),
        virtual("single RH", FIRST_SEED + 3, RH, 1, "comfortable"),
        virtual("weak T", FIRST_SEED + 4, T, 1, 0.15),
        virtual("weak RH", FIRST_SEED + 5, RH, 1, 0.15),
        virtual("pair T", FIRST_SEED + 6, T, ORDINARY, "comfortable"),
        virtual("pair RH", FIRST_SEED + 7, RH, 2, "comfortable"),
        virtual("outside T", FIRST_SEED + 8, T, "outside", "comfortable"),
        *(real(name, logs) for name in SETS),
    ]
    if samples is not None:
        found += [sample(name, samples) for name in SAMPLES if (samples / name).exists()]
    return found


def diagnosed(case: Case, home: Path, rule: Rule | None) -> dict[str, Any]:
    """What the diagnosis says of a case without a rule, and how well it predicts the fresh campaign."""
    from ours import fresh_errors, judge

    known = home / case.name.replace(" ", "_").replace(",", "")
    if not (known / "hidden.json").exists():
        shutil.rmtree(known, ignore_errors=True)
        known.mkdir(parents=True)
        hidden = case.make(known)
        (known / "hidden.json").write_text(json.dumps(hidden), encoding="utf-8")
    hidden = json.loads((known / "hidden.json").read_text(encoding="utf-8"))
    with without(rule):
        outcome = judge(known / "campaign", 0, LIMIT_S, characterized=False, exact=case.exact)
    told = outcome.tells(case.channel)
    result: dict[str, Any] = {"hidden": hidden, "seconds": round(outcome.seconds.get("diagnose", 0.0), 2)}
    if told is None:
        return result | {
            "failed": list((outcome.refused | outcome.crashed).values())[0].strip().splitlines()[-1][-160:]
        }
    error = None
    if (known / "fresh").exists():
        fresh = fresh_errors(outcome, known / "fresh", case.channel)
        error = None if fresh is None else fresh[1]
    elif told["gain"] is not None:
        error = told["gain"]["held_out_rmse_after"]
    names = [
        (c["effect"], c["probability"], c["effect"] in hidden or bool(set(c["indistinguishable_from"]) & set(hidden)))
        for c in told["causes"]
    ]
    return result | {
        "verdict": told["verdict"],
        "right": told["verdict"] in case.right if case.right else None,
        "names": names,
        "missed": [e for e in hidden if not e.startswith("unknown_") and e not in [n[0] for n in names]],
        "described": [d["behaves_as"] for d in told.get("discovered") or []],
        "sure": [round(d["probability"], 3) for d in told.get("discovered") or [] if d.get("probability") is not None],
        "error": error,
    }


class Watch:
    """Names and texts that the functions of the diagnosis mention which ran while it watched."""

    def __enter__(self) -> Watch:
        self._codes: set[Any] = set()
        sys.settrace(lambda frame, *_: self._codes.add(frame.f_code))  # returns None: no line is traced
        return self

    def __exit__(self, *_: object) -> None:
        sys.settrace(None)

    def mentioned(self) -> list[str]:
        found: set[str] = set()
        for code in self._codes:
            if f"{os.sep}analysis{os.sep}" in code.co_filename:
                found |= set(code.co_names) | {c for c in code.co_consts if isinstance(c, str)}
        return sorted(found)


def comes_to(base: dict[str, Any], rule: Rule) -> bool:
    """Whether a rule had a say in a diagnosis with every rule."""
    return rule.name in base["fired"] if rule.acts else bool(rule.marks & set(base["mentioned"]))


def state() -> str:
    """The last commit that changed the analysis."""
    command = ["git", "log", "-1", "--format=%h", "--", "analysis"]
    told = subprocess.run(command, cwd=Path(__file__).parent.parent, capture_output=True, text=True)
    return told.stdout.strip()


def run(work: Path, chosen: list[Case], rules: list[Rule], until: float) -> None:
    """Every rule on every case that comes to it; what is in the file already is not done again."""
    file, commit, home = work / "ablation.jsonl", state(), work / "campaigns"
    known = read(file, commit)
    with file.open("a", encoding="utf-8") as out:

        def keep(rule: str, case: str, result: dict[str, Any]) -> None:
            known[rule, case] = result
            out.write(json.dumps({"commit": commit, "rule": rule, "case": case, **result}) + "\n")
            out.flush()
            print(
                f"{rule:24} {case:28} {result.get('verdict', result.get('failed'))} {result['seconds']:.0f} s",
                flush=True,
            )

        for case in chosen:
            if (NOTHING, case.name) not in known:
                with watching(RULES) as fired, Watch() as watch:
                    diagnosed(case, home, None)
                result = diagnosed(case, home, None)  # watching takes time
                keep(NOTHING, case.name, {**result, "mentioned": watch.mentioned(), "fired": sorted(fired)})
        # Rules that are known to have done something first, and the cheap campaigns.
        pairs = [(rule, case) for rule in rules for case in chosen if comes_to(known[NOTHING, case.name], rule)]
        for rule, case in sorted(pairs, key=lambda p: (not p[0].acts, known[NOTHING, p[1].name]["seconds"])):
            if (rule.name, case.name) in known or not there(rule):
                continue
            if time.monotonic() > until:
                return
            keep(rule.name, case.name, diagnosed(case, home, rule))


def read(file: Path, commit: str) -> dict[tuple[str, str], dict[str, Any]]:
    """Results by rule and case of one state of the analysis."""
    if not file.exists():
        return {}
    told = map(json.loads, file.read_text(encoding="utf-8").splitlines())
    return {(one["rule"], one["case"]): one for one in told if one["commit"] == commit}


def changes(before: dict[str, Any], after: dict[str, Any]) -> tuple[int, list[str]]:
    """Whether a case is worse (1), better (-1) or alike (0) without a rule, and how."""
    if "verdict" not in after or "verdict" not in before:
        same = before.get("failed") == after.get("failed")
        return (0, []) if same else (1, [f"fails: {after.get('failed')}"])
    said, sign = [], 0
    if before["verdict"] != after["verdict"]:
        sign += int(bool(before["right"])) - int(bool(after["right"])) if before["right"] is not None else 0
        said.append(f"{before['verdict']} -> {after['verdict']}")
    names = [{n[0]: n for n in r["names"]} for r in (before, after)]
    for effect in names[0].keys() - names[1].keys():
        sign += 1 if names[0][effect][2] else -1
        said.append(f"-{effect}")
    for effect in names[1].keys() - names[0].keys():
        sign += -1 if names[1][effect][2] else 1
        said.append(f"+{effect}{'' if names[1][effect][2] else ' (wrong)'}")
    for effect in names[0].keys() & names[1].keys():
        was, now = names[0][effect][1], names[1][effect][1]
        if abs(was - now) > SAME:
            sign += int(np.sign(was - now)) * (1 if names[0][effect][2] else -1)
            said.append(f"{effect} {was:.2f} -> {now:.2f}")
    if before["described"] != after["described"]:
        sign += max(len(before["described"]) - len(after["described"]), 0)  # more of them is no gain by itself
        said.append(f"described {before['described']} -> {after['described']}")
    elif before["sure"] != after["sure"]:
        said.append(f"description {before['sure']} -> {after['sure']}")
    if before["error"] and after["error"]:
        ratio = after["error"] / before["error"]
        if abs(ratio - 1.0) > SAME:
            sign += 1 if ratio > 1.0 else -1
            said.append(f"error x {ratio:.2f}")
    return int(np.sign(sign)), said


def table(work: Path, chosen: list[Case], rules: list[Rule]) -> str:
    """What is kept of one state of the analysis, as text."""
    commit = state()
    known = read(work / "ablation.jsonl", commit)
    base = {c.name: known[NOTHING, c.name] for c in chosen if (NOTHING, c.name) in known}
    out = [f"analysis at {commit}; {len(base)} campaigns", "", "with every rule:"]
    for name, one in base.items():
        told = one.get("failed") or f"{one['verdict']}, names {[(n[0], n[1]) for n in one['names']]}"
        right = {True: "right", False: "WRONG", None: ""}[one.get("right")]
        extra = f", described {one['described']}" if one.get("described") else ""
        error = "" if not one.get("error") else f", error {one['error']:.3g}"
        out.append(f"  {name:34} {told}{extra}{error} {right} hidden {one['hidden']} {one['seconds']:.0f} s")
    out += ["", f"{'without':26} {'lines':>5} {'came to it':>10} {'worse':>6} {'better':>6} {'s':>6}"]
    for rule in rules:
        if not there(rule):
            out.append(f"{rule.name:26} is not in this code")
            continue
        reach = [n for n, one in base.items() if comes_to(one, rule)]
        told = {n: known[rule.name, n] for n in reach if (rule.name, n) in known}
        judged = {n: changes(base[n], one) for n, one in told.items()}
        worse, better = (sum(sign == s for sign, _ in judged.values()) for s in (1, -1))
        spent = sum(one["seconds"] - base[n]["seconds"] for n, one in told.items())
        left = "" if len(told) == len(reach) else f" (run on {len(told)})"
        out.append(
            f"{rule.name:26} {lines(rule):5} {len(reach):10} {worse:6} {better:6} {spent:+6.0f}  {rule.does}{left}"
        )
        for name, (sign, said) in judged.items():
            if said:
                mark = {1: "worse", -1: "better", 0: "other"}[sign]
                out.append(f"      {mark:6} {name}: {'; '.join(said)}")
    idle = [r.name for r in rules if there(r) and not any(rule_changes(r, n, known, base) for n in base)]
    out += ["", f"nothing changed without: {', '.join(idle) or 'none'}"]
    return "\n".join(out)


def rule_changes(rule: Rule, case: str, known: dict[tuple[str, str], dict[str, Any]], base: dict[str, Any]) -> bool:
    """Whether anything that is counted changed in a case without a rule."""
    one = known.get((rule.name, case))
    return one is not None and bool(changes(base[case], one)[1])


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--work", type=Path, required=True, metavar="DIR", help="where campaigns and results are kept")
    parser.add_argument("--samples", type=Path, metavar="DIR", help="folder with campaigns unlisted-*")
    parser.add_argument("--logs", type=Path, default=Path(__file__).parent.parent / "data" / "real")
    parser.add_argument("--only", default="", help="rules whose name contains this text")
    parser.add_argument("--minutes", type=float, default=1e9, help="after these nothing further is begun")
    parser.add_argument("--table", action="store_true", help="only print what is there")
    args = parser.parse_args(argv)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    from shockrig.analysis.diagnose import diagnose  # noqa: F401 - loads every module that a rule may stand in

    args.work.mkdir(parents=True, exist_ok=True)
    chosen = cases(args.samples, args.logs)
    rules = [rule for rule in RULES if args.only in rule.name]
    if not args.table:
        run(args.work, chosen, rules, time.monotonic() + 60.0 * args.minutes)
    print(table(args.work, chosen, rules))
    return 0


if __name__ == "__main__":
    sys.exit(main())
