"""Plain checks of the input: is every slip caught, and is none cried on right campaigns?

    python benchmarks/input_checks.py --part slips --seeds 20
    python benchmarks/input_checks.py --part right --first 0 --count 40
    python benchmarks/input_checks.py --part measured --logs FOLDER

`slips`: clean campaigns of the virtual bench, each spoiled in every way of `input_slip_table.py`. `right`: campaigns
with nothing wrong with them, whatever is hidden in them, as they are and as other labs would hand them over.
`measured`: other people's logs (`real_sets.py`) and the examples.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from input_slip_table import SLIPS
from input_slips import Slip, clock, each, start, without

from shockrig.analysis.checks import InputFinding, check_campaign
from shockrig.files.campaign import Campaign, Run, read_campaign
from shockrig.files.errors import InputError
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.hide import draw_hidden
from shockrig.rig.virtual.plans import single_airflow_plan, single_direction_plan, standard_plan, wide_plan
from shockrig.rig.virtual.truth import Truth, draw_truth, with_effects

ORDINARY = ("convective_film", "finite_transfer", "stem_conduction", "die_thermal_lag")
PLANS = {
    "standard": standard_plan,
    "wide": wide_plan,
    "single direction": single_direction_plan,
    "single airflow": single_airflow_plan,
}
# what is hidden, tier, plans (in turn), how many campaigns
RIGHT = (
    ("none", "rough", ("standard", "wide"), 24),
    ("none", "smooth", ("standard", "wide"), 8),
    (1, "rough", ("standard", "wide"), 40),
    (2, "rough", ("standard", "wide"), 20),
    (4, "rough", ("standard", "wide"), 30),
    ("outside", "rough", ("standard", "wide"), 36),
    (ORDINARY, "rough", ("standard", "wide"), 8),
    (1, "rough", ("single direction",), 10),
    (1, "rough", ("single airflow",), 10),
)
FOREIGN_SEEDS = 4
DIFFERENT = 0.18  # ln of the ratio of two sensors' rates: what counts as another sensor
SLIP_SEED, RIGHT_SEED = 40_000, 41_000


def spoiled(slip: Slip, folder: Path, campaign: Campaign, second: Campaign, seed: int) -> Campaign:
    """The campaign in `folder` with a slip in it; raises InputError where the reader refuses the files."""
    if slip.make is not None:
        return slip.make(campaign, second, np.random.default_rng(seed))
    assert slip.edit is not None
    with tempfile.TemporaryDirectory() as scratch:
        copy = Path(scratch) / "campaign"
        shutil.copytree(folder, copy)
        slip.edit(copy)
        return read_campaign(copy)


def outcome(slip: Slip, folder: Path, campaign: Campaign, second: Campaign, seed: int) -> tuple[str, list[str]]:
    """ "caught", "refused" (by the reader, rightly) or "missed", and what else was said."""
    try:
        found = check_campaign(spoiled(slip, folder, campaign, second, seed))
    except InputError as error:
        return ("refused" if slip.refused and slip.refused in str(error) else f"missed: {error}"), []
    others = [finding.sentence for finding in found if finding.kind not in slip.kinds]
    return ("caught" if len(others) < len(found) else "missed"), others


def two_pairs(seed: int, folder: Path) -> tuple[Path, Campaign, Campaign]:
    """A clean campaign and the same plan on another pair of sensors, both of whose rates differ.

    Half of them on a plain bench, a quarter with the ordinary effects of one, a quarter with any one effect.
    """
    rng = np.random.default_rng(seed)
    plan = (standard_plan, wide_plan)[seed % 2]()
    hidden = draw_hidden(rng, ("none", "none", ORDINARY, 1)[seed // 2 % 4])
    first, second = draw_truth(rng, "rough" if seed % 5 else "smooth"), draw_truth(rng, "rough")
    while min(_apart(first, second)) < DIFFERENT:
        second = draw_truth(rng, "rough")
    first, second = with_effects(first, hidden), with_effects(second, hidden)
    paths = [simulate_campaign(t, plan, rng, folder / name) for t, name in ((first, "first"), (second, "second"))]
    return paths[0], read_campaign(paths[0]), read_campaign(paths[1])


def _apart(first: Truth, second: Truth) -> tuple[float, float]:
    return (
        abs(float(np.log(first.thermal_diffusivity_m2_s / second.thermal_diffusivity_m2_s))),
        abs(float(np.log(first.diffusivity_20c_m2_s / second.diffusivity_20c_m2_s))),
    )


def slips(first: int, seeds: int) -> int:
    """The table of slips; returns how many were missed."""
    told: dict[str, Counter[str]] = {slip.name: Counter() for slip in SLIPS}
    notes: list[str] = []
    example: dict[str, str] = {}
    for seed in range(SLIP_SEED + first, SLIP_SEED + first + seeds):
        with tempfile.TemporaryDirectory() as scratch:
            folder, campaign, second = two_pairs(seed, Path(scratch))
            for slip in SLIPS:
                word, others = outcome(slip, folder, campaign, second, seed)
                print(seed, slip.name, word, file=sys.stderr, flush=True)
                told[slip.name][word.split(":")[0]] += 1
                told[slip.name]["beside"] += bool(others)
                notes += [f"  seed {seed}, {slip.name}: {word}"] if word.startswith("missed") else []
                notes += [f"  seed {seed}, {slip.name}: also {text}" for text in others]
                if word == "caught" and slip.name not in example:
                    found = check_campaign(spoiled(slip, folder, campaign, second, seed))
                    example[slip.name] = next(f.sentence for f in found if f.kind in slip.kinds)
    width = max(map(len, told)) + 2
    print(f"{'slip':{width}}{'caught':>8}{'refused':>9}{'missed':>8}{'said beside':>13}   (of {seeds} campaigns)")
    for name, c in told.items():
        print(f"{name:{width}}{c['caught']:8}{c['refused']:9}{c['missed']:8}{c['beside']:13}")
    print(
        f"\nseeds {SLIP_SEED + first} to {SLIP_SEED + first + seeds - 1}; refused: by the reader, which names the unit"
    )
    print("\n".join(["\nmissed, or said beside:", *(notes or ["  nothing"]), "\nwhat is said:"]))
    for name, text in example.items():
        print(f"  {name}\n    {text}")
    return sum(c["missed"] for c in told.values())


def fewer(count: int, rng: np.random.Generator):
    """Only `count` runs of a campaign, drawn."""

    def change(campaign: Campaign) -> Campaign:
        kept = sorted(rng.permutation(len(campaign.runs))[:count].tolist())
        return replace(campaign, runs=tuple(campaign.runs[i] for i in kept))

    return change


def every_tenth(run: Run) -> Run:
    """Logged at 1 Hz."""
    traces = {}
    for sensor in ("imet", "hyt"):
        trace = getattr(run, sensor)
        if trace is not None:
            values = {name: value[::10] for name, value in trace.values.items()}
            traces[sensor] = replace(trace, time_s=trace.time_s[::10], values=values)
    return replace(run, **traces)


def at_another_pace(factor: float):
    """Everything `factor` times as slow: 10 gives lags of 5 to 600 s at 1 Hz, 0.1 lags below 1 s at 100 Hz."""
    slower = [clock(("imet", "hyt"), lambda t: factor * t), start(lambda t: factor * t)]

    def change(campaign: Campaign) -> Campaign:
        for one in slower:
            campaign = each(campaign, one)
        sensors = {name: {"kind": "as logged"} for name in campaign.sensors}  # a length would not fit any more
        return replace(campaign, sensors=sensors)

    return change


def variants(rng: np.random.Generator, plain: bool) -> dict:
    """What other labs leave out of a campaign. `plain`: nothing is hidden, so that it may also run at another pace (a
    dead time of 0.6 s would become one of 6 s)."""
    paces = {"ten times slower": at_another_pace(10.0), "ten times faster": at_another_pace(0.1)}
    return {
        "no starts": lambda c: each(c, without("start")),
        "no airs": lambda c: each(c, without("airs")),
        "no airflow": lambda c: each(c, without("airflow")),
        "nothing recorded": lambda c: each(c, without("start", "airs", "airflow")),
        "imet.csv alone": lambda c: each(c, without("hyt")),
        "hyt.csv alone": lambda c: each(c, without("imet")),
        "hyt.csv alone, no die": lambda c: each(c, without("imet", "die")),
        "1 run": fewer(1, rng),
        "2 runs": fewer(2, rng),
        "3 runs, no airs": lambda c: each(fewer(3, rng)(c), without("airs")),
        "6 runs": fewer(6, rng),
        "1 Hz": lambda c: each(c, every_tenth),
        **(paces if plain else {}),
    }


def right_campaigns(first: int, count: int) -> Iterator[tuple[str, str, Campaign]]:
    """Group, name and content of right campaigns: those of `RIGHT`, each as it is and in four variants."""
    jobs = [(kind, tier, plans[i % len(plans)]) for kind, tier, plans, n in RIGHT for i in range(n)]
    for i, (kind, tier, plan) in list(enumerate(jobs))[first : first + count]:
        rng = np.random.default_rng(RIGHT_SEED + i)
        hidden = draw_hidden(rng, kind)
        label = "ordinary" if kind is ORDINARY else str(kind)
        with tempfile.TemporaryDirectory() as scratch:
            path = simulate_campaign(draw_truth(rng, tier, hidden), PLANS[plan](), rng, Path(scratch) / "campaign")
            campaign = read_campaign(path)
        name = f"seed {RIGHT_SEED + i}, {plan}, {tier}: {', '.join(h.effect for h in hidden) or 'nothing'}"
        yield f"hidden: {label}", name, campaign
        made = variants(rng, not hidden)
        for j in range(4):
            variant = list(made)[(4 * i + j) % len(made)]
            yield f"variant: {variant}", f"{name} ({variant})", made[variant](campaign)
    if first + count >= len(jobs):
        yield from foreign_campaigns()


def foreign_campaigns() -> Iterator[tuple[str, str, Campaign]]:
    """Other labs' benches: bodies of every shape, lags of 0.05 to 500 s, 1 to 100 Hz, chambers with a measured air."""
    from foreign_lab import record
    from foreign_worlds import CLASSES, draw

    for name in (name for name in CLASSES if name != "two_media"):  # where the check is right to speak
        for seed in range(FOREIGN_SEEDS):
            world = draw(name, seed)
            with tempfile.TemporaryDirectory() as scratch:
                record(world.bench, seed, Path(scratch) / "campaign")
                yield "foreign benches", f"{name} {seed}: {world.words}", read_campaign(Path(scratch) / "campaign")


def measured_campaigns(logs: Path) -> Iterator[tuple[str, str, Campaign]]:
    """Other people's logs as campaigns, and the examples that ship."""
    from real_sets import real_sets

    for one in real_sets():
        with tempfile.TemporaryDirectory() as scratch:
            one.make(logs, Path(scratch) / "campaign")
            yield "measured and plunges", one.name, read_campaign(Path(scratch) / "campaign")
    examples = Path(__file__).parent.parent / "data" / "examples"
    for folder in sorted(path for path in examples.iterdir() if path.is_dir()):
        yield "examples", folder.name, read_campaign(folder)


def right(campaigns: Iterator[tuple[str, str, Campaign]]) -> int:
    """The table of right campaigns; returns in how many something was said."""
    told: dict[str, Counter[str]] = {}
    seconds = 0.0
    notes: list[str] = []
    for group, name, campaign in campaigns:
        begun = time.perf_counter()
        found: tuple[InputFinding, ...] = check_campaign(campaign)
        seconds += time.perf_counter() - begun
        print(group, name, *found, sep="; ", file=sys.stderr, flush=True)
        told.setdefault(group, Counter())["campaigns"] += 1
        told[group]["cried"] += bool(found)
        notes += [f"  {name}: {finding.kind}: {finding.sentence}" for finding in found]
    for group, c in sorted(told.items()):
        print(f"{group:40}{c['campaigns']:6} campaigns{c['cried']:6} with a finding")
    total, cried = (sum(c[key] for c in told.values()) for key in ("campaigns", "cried"))
    print(f"{'all':40}{total:6} campaigns{cried:6} with a finding; {seconds / total:.2f} s each")
    print("\n".join(notes))
    return cried


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--part", choices=("slips", "right", "measured"), required=True)
    parser.add_argument("--seeds", type=int, default=20, help="campaigns that are spoiled")
    parser.add_argument("--first", type=int, default=0, help="number of the first campaign")
    parser.add_argument("--count", type=int, default=1000, help="right campaigns, at most")
    parser.add_argument("--logs", type=Path, help="folder of other people's logs (haar, rbr)")
    args = parser.parse_args()
    if args.part == "slips":
        return 1 if slips(args.first, args.seeds) else 0
    if args.part == "measured":
        if args.logs is None:
            parser.error("--logs: name the folder that holds haar and rbr")
        return 1 if right(measured_campaigns(args.logs)) else 0
    return 1 if right(right_campaigns(args.first, args.count)) else 0


if __name__ == "__main__":
    sys.exit(main())
