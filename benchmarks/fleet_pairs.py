"""Whose a cause is, of pairs of look-alikes: one of them hidden in the bench, the other in one sensor of a carriage.

    python benchmarks/fleet_pairs.py [--pairs 0 1 ...] [--probes 8] [--seed 1]

For each channel a carriage of rough virtual sensors of one type is drawn from the seed. The bench's effect is hidden in
all of its probes, with new noise for each pair; the sensor's in one probe, drawn too, as `shockrig run --fleet SEED
--probes 8 --hide EFFECT@PROBE` does. Eleven runs at 20 degC. Each probe's channel is diagnosed by itself, then the
fleet says whose each cause is. A case is right where a cause with the hidden effect, or with a look-alike that is still
open, is the bench's, or that sensor's, and no other cause is given to bench or type. In the sensor's case the other
probes are plain, and the same for all pairs of a channel: they are diagnosed once.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from shockrig.analysis.diagnose.diagnose import diagnose_channel
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.fleet.whose import DiagnosedProbe, judged_causes
from shockrig.files.campaign import read_campaign
from shockrig.files.causes import StatedEffect
from shockrig.files.fleet_file import BENCH, SENSOR, TYPE, FleetCause
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.effects import KINDS
from shockrig.rig.virtual.hide import draw_effect
from shockrig.rig.virtual.plans import wide_plan
from shockrig.rig.virtual.truth import Hidden, Truth, of_probe, of_type, with_effects

T, RH = "temperature", "humidity"
PLAIN = "plain"
PAIRS = (  # channel, the bench's effect, the sensor's
    (T, "air_relaxation", "stem_conduction"),
    (T, "finite_transfer", "moving_average"),
    (T, "finite_transfer", "convective_film"),
    (T, "finite_transfer", "dead_time"),
    (T, "dead_time", "dead_time"),  # in all probes: a trigger that comes late
    (T, "wall_radiation", "self_heating"),
    (T, "wall_radiation", "calibration_error"),
    (T, "calibration_error", "calibration_error"),  # in all probes: the reference's
    (RH, "air_relaxation", "slow_relaxation"),
    (RH, "finite_transfer", "series_lag"),
    (RH, "finite_transfer", "vapour_boundary_layer"),
    (RH, "finite_transfer", "moving_average"),
    (RH, "dead_time", "dead_time"),
    (RH, "calibration_error", "calibration_error"),
    (RH, "air_relaxation", "hysteresis"),
)
AT_20_C = (11, 12, 13, 14, 15, 26, 27, 28, 29, 30, 31)  # of the wide plan
Named = tuple[StatedEffect, ...]


def main(argv: list[str] | None = None) -> None:
    """Print a line for each case, then the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, nargs="+", default=range(len(PAIRS)), help="places in the list (all 15)")
    parser.add_argument("--probes", type=int, default=8)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args(argv)
    right, named = dict.fromkeys((PLAIN, BENCH, SENSOR), 0), dict.fromkeys((BENCH, SENSOR), 0)
    probes = [str(k) for k in range(1, args.probes + 1)]
    carriages: dict[str, tuple[Truth, dict[str, Named]]] = {}
    began_s = time.process_time()

    def told(case: str, channel: str, found: dict[str, Named], hidden: Hidden | None = None, probe: str = "") -> None:
        causes = judged_causes(channel, [DiagnosedProbe(one, "carriage", "bench", found[one]) for one in probes])
        good, name = judged(case, hidden, probe, causes)
        right[case] += good
        if hidden is not None:
            named[case] += name
        said = ", ".join(f"{c.effect} {c.whose} ({len(c.sensors)})" for c in causes) or "nothing"
        what = "" if hidden is None else hidden.effect
        print(f"{'ok' if good else 'NO'}  {channel:<12}{case:<8}{what:<22}{said}", flush=True)

    for number in args.pairs:
        channel, *both = PAIRS[number]
        rng = np.random.default_rng([args.seed, number])
        if channel not in carriages:
            which = (T, RH).index(channel)
            usual = of_type(args.seed, which, "rough")
            plain = {one: diagnosis(usual, one, channel, (args.seed, 99, which)) for one in probes}
            carriages[channel] = usual, plain
            told(PLAIN, channel, plain)
        usual, plain = carriages[channel]
        probe = str(rng.choice(probes))
        shared, own = (draw_effect(rng, one, channel=channel if KINDS[one].single else None) for one in both)
        one_has = with_effects(usual, [replace(own, probe=probe)])
        told(SENSOR, channel, plain | {probe: diagnosis(one_has, probe, channel, (args.seed, number, 0))}, own, probe)
        all_have = with_effects(usual, [shared])
        told(BENCH, channel, {one: diagnosis(all_have, one, channel, (args.seed, number, 1)) for one in probes}, shared)
    count, false = len(args.pairs), [one for _, plain in carriages.values() for one in plain.values() if one]
    which = " ".join(str(number) for number in args.pairs)
    print(
        f"{args.probes} probes, seed {args.seed}, pairs {which}; {time.process_time() - began_s:.0f} s of the processor"
    )
    print(f"the bench's is the bench's in {right[BENCH]} of {count} (by its own name in {named[BENCH]}),")
    print(f"a sensor's is that sensor's in {right[SENSOR]} of {count} ({named[SENSOR]});")
    print(f"nothing is given to bench or type in {right[PLAIN]} of {len(carriages)} plain carriages,")
    print(f"and {len(false)} of their {args.probes * len(carriages)} diagnoses name something")


def diagnosis(truth: Truth, probe: str, channel: str, seed: tuple[int, ...]) -> Named:
    """What the diagnosis of one probe's channel names."""
    plan = [shock for shock in wide_plan() if int(shock.id) in AT_20_C]
    print(f"{seed} {probe}", file=sys.stderr, flush=True)
    with tempfile.TemporaryDirectory() as folder:
        rng = np.random.default_rng([*seed, int(probe)])
        campaign = read_campaign(simulate_campaign(of_probe(truth, probe), plan, rng, Path(folder) / "c"))
    found = diagnose_channel(build_channel(campaign, channel))
    return tuple(cause.as_effect() for cause in found.causes)


def judged(case: str, hidden: Hidden | None, probe: str, causes: tuple[FleetCause, ...]) -> tuple[bool, bool]:
    """Whether what is said is right, and whether the effect's own name is said."""
    others = [one for one in causes if one.whose in (BENCH, TYPE)]
    if hidden is None:
        return not others, False
    its = [one for one in causes if hidden.effect in (one.effect, *one.look_alikes) and one.whose == case]
    its = [one for one in its if case == BENCH or one.sensors == (probe,)]
    return bool(its) and all(one in its for one in others), any(one.effect == hidden.effect for one in its)


if __name__ == "__main__":
    main()
