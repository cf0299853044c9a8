"""What the trials of `discovery.py` show together: one line per effect taken away, and counts over all."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from discovery_right import NUMBERS, RIGHT, is_right, states_it

CONFIDENT = 0.5  # probability from which on a name that stands alone is a wrong answer
WORSE = 1.02  # ratio of errors elsewhere from which on a description does harm there
KEYS = ("flagged", "described", "right", "in the set", "single wrong", "look-alike", "same law")
MEANING = """  flagged: any verdict but adequate; described: anything at all; right: behaviour and dependence are those
  of the truth (where nothing behaves so: nothing is described or named); in the set: or one of the alternatives is;
  single wrong: one description with more than even odds and without alternatives that is not right; look-alike: a
  catalogued effect that is not there is named with more than even odds, and nothing is described; same law: its
  equation is the behaviour of the truth all the same"""


def scored(result: dict) -> dict[str, object]:
    """What one trial of `one_out` shows."""
    effect, channel, told = result["effect"], result["channel"], result["discovered"]
    named = [one for one in told if is_right(one, effect, channel)]
    listed = [one for one in told if any(is_right(other, effect, channel) for other in one.get("alternatives", []))]
    single = len(told) == 1 and not told[0].get("alternatives") and told[0].get("probability", 1.0) > CONFIDENT
    certainty = result.get("certainty", {name: [1.0] for name in result["causes"]})
    wrong = [name for name, (p, *tied) in certainty.items() if name not in result["hidden"] and p > CONFIDENT]
    right = bool(named) if RIGHT[effect, channel] else not told and not wrong
    return {
        "flagged": result["verdict"] != "adequate",
        "described": bool(told),
        "right": right,
        "in the set": right or bool(listed),
        "single wrong": single and not named,
        "look-alike": bool(wrong) and not told,
        "same law": bool(wrong) and not told and all(states_it(name, effect, channel) for name in wrong),
        "beside": bool(wrong) and bool(told),
        "numbers": _off(named[0], result) if named and effect in result["hidden"] else [],
        "elsewhere": [after / before for before, after in filter(None, result.get("elsewhere", []))],
    }


def _off(one: dict, result: dict) -> list[tuple[str, float]]:
    """Relative errors of a description's numbers, by what they are."""
    off = []
    for name, true in result["hidden"][result["effect"]].items():
        key = NUMBERS.get((result["effect"], name))
        value = _number(one, key) if key else None
        if value is None or one["behaves_as"] in ("added_rate", "bursts"):
            continue
        # A swing of the other sign is the same half a turn on; a loop is as wide whichever branch is called the lower.
        either = one["behaves_as"] == "periodic" or any(on["form"] == "sign" for on in one["depends_on"])
        off.append((key, (abs(value / true) if either else value / true) - 1.0))
    return off


def _number(one: dict, key: str) -> float | None:
    if key in ("size", "time_constant_s", "period_s"):
        return one[key]["value"] if key in one else None
    return next((on["value"] for on in one["depends_on"] if on["factor"] == key), None)


def counts(lines: Sequence[dict]) -> list[str]:
    """Of plain worlds and of pairs: how often anything was discovered."""
    out = []
    for kind, title in (("none", "plain worlds"), ("two", "two catalogued effects at once")):
        some = [r for r in lines if r["kind"] == kind]
        if not some:
            continue
        verdicts: dict[str, int] = defaultdict(int)
        for r in some:
            verdicts[r["verdict"]] += 1
        told, worlds = sum(bool(r["discovered"]) for r in some), len({r["seed"] for r in some})
        seconds = np.mean([r["seconds"] for r in some])
        said = ", ".join(f"{count} {verdict}" for verdict, count in sorted(verdicts.items()))
        out.append(f"{title}: {worlds} worlds, {len(some)} channels ({said}), {seconds:.1f} s each")
        out.append(f"  channels with anything discovered: {told}")
        sold = [r for r in some if len(r["hidden"]) > 1]
        if sold:
            one = sum(len(r["discovered"]) == 1 and not r["causes"] for r in sold)
            out.append(f"  of {len(sold)} channels in which both act, sold as one unknown: {one}")
    return out


def times(lines: Sequence[dict]) -> list[str]:
    """How long whole campaigns take whose diagnosis has to discover, the longest first."""
    some = sorted((r for r in lines if r["kind"] == "both"), key=lambda r: -sum(r["seconds"].values()))
    if not some:
        return []
    out = ["processor time of both channels of a campaign together, and of the longer, with the entry taken away:"]
    for r in some:
        seconds = r["seconds"].values()
        world = f"{r['effect']}, {r['channel']}, seed {r['seed']}"
        out.append(f"  {world:56}{sum(seconds):6.0f} s {max(seconds):6.0f} s   {', '.join(r['verdicts'].values())}")
    return out


def tables(lines: Sequence[dict]) -> str:
    """What all trials show together."""
    out = [*counts(lines), *times(lines)]
    rows: dict[tuple[str, str], list[dict]] = defaultdict(list)
    for r in lines:
        if r["kind"] == "one_out":
            rows[r["effect"], r["channel"]].append(r)
    if not rows:
        return "\n".join(out)
    head = "".join(f"{k:>13}" for k in KEYS)
    out.append("one effect hidden, its entry taken away:")
    out.append(MEANING)
    ends = f"{'fresh':>7}{'number':>9}{'elsewhere':>11}{'s':>5}"
    out.append(f"  {'effect and channel':44}{'trials':>7}{head}{ends}")
    total: dict[str, int] = defaultdict(int)
    every: list[dict[str, object]] = []
    for (effect, channel), some in sorted(rows.items()):
        scores = [scored(r) for r in some]
        every += scores
        cells = [sum(bool(s[k]) for s in scores) for k in KEYS]
        for k, v in zip(KEYS, cells, strict=True):
            total[k] += v
        fresh = [r["fresh_share"] for r in some if r["fresh_share"] is not None]
        off = [abs(v) for s in scores for _, v in s["numbers"]]
        worse = [ratio for s in scores for ratio in s["elsewhere"]]
        out.append(
            f"  {effect + ', ' + channel:44}{len(some):7}"
            + "".join(f"{c:13}" for c in cells)
            + (f"{min(fresh):7.3f}" if fresh else f"{'-':>7}")
            + (f"{100 * max(off):7.1f} %" if off else f"{'-':>9}")
            + (f"{max(worse):11.3f}" if worse else f"{'-':>11}")
            + f"{max(r['seconds'] for r in some):5.0f}"
        )
    count = len(every)
    out.append(f"  {'all':44}{count:7}" + "".join(f"{total[k]:13}" for k in KEYS))
    reached, same = total["in the set"], total["same law"]
    out.append(
        f"  behaviour and dependence right or in the set: {reached} of {count} ({100 * reached / count:.0f} %), with "
        f"names of the same law {reached + same} ({100 * (reached + same) / count:.0f} %)"
    )
    out.append(
        "  fresh: least share of the explainable error of a fresh campaign that the description removes; number:\n"
        "  largest relative error of its numbers; elsewhere: largest ratio of errors with it to without at conditions\n"
        "  that were not recorded"
    )
    gains = np.array([r["fresh_share"] for some in rows.values() for r in some if r["fresh_share"] is not None])
    ratios = np.array([ratio for s in every for ratio in s["elsewhere"]])
    beside = sum(bool(s["beside"]) for s in every)
    out.append(
        f"  a fresh campaign: at least 0.9 of the explainable error removed in {(gains >= 0.9).sum()} of {gains.size}"
    )
    if ratios.size:
        harm = int((ratios > WORSE).sum())
        out.append(
            f"  conditions not recorded: worse than without by more than 2 % in {harm} of {ratios.size} campaigns"
        )
    out.append(f"  a catalogued effect that is not there named beside a description: {beside} of {count}")
    return "\n".join(out)
