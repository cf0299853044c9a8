"""Whose a cause is, of pairs of look-alikes: one of them hidden in the bench, the other in one sensor of a carriage.

    python benchmarks/fleet_pairs.py [--pairs 15] [--probes 8] [--seed 1]

A type of rough virtual sensors and a carriage of them are drawn for each pair from its own seed. The bench's effect is
hidden in all probes; the sensor's in one, drawn too, as `shockrig run --fleet SEED --probes 8 --hide EFFECT@PROBE`
does. Eleven runs at 20 degC. Each probe's channel is diagnosed by itself, then the fleet says whose each cause is. A
case is right where a cause with the hidden effect, or with a look-alike that is still open, is the bench's, or that
sensor's, and no other cause is given to bench or type. Probes in which nothing is hidden are the plain ones: each
carriage is diagnosed plain once, and of the sensor's case only the probe that has the effect is another.
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
from shockrig.analysis.diagnose.diagnosed import stated_cause
from shockrig.analysis.estimate.gather import build_channel
from shockrig.analysis.fleet.whose import DiagnosedProbe, judged_causes
from shockrig.files.campaign import read_campaign
from shockrig.files.causes import StatedEffect
from shockrig.files.fleet import BENCH, SENSOR, TYPE, FleetCause
from shockrig.rig.virtual.batch import simulate_campaign
from shockrig.rig.virtual.hide import draw_effect
from shockrig.rig.virtual.plans import wide_plan
from shockrig.rig.virtual.truth import Hidden, Truth, of_probe, of_type, with_effects

T, RH = "temperature", "humidity"
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
    parser.add_argument("--pairs", type=int, default=len(PAIRS), help="of the list, in its order (15)")
    parser.add_argument("--probes", type=int, default=8)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args(argv)
    right = {"plain": 0, BENCH: 0, SENSOR: 0}
    named = {BENCH: 0, SENSOR: 0}
    probes = [str(k) for k in range(1, args.probes + 1)]
    false, diagnosed, spent = 0, 0, time.process_time()
    for number, (channel, of_bench, of_sensor) in enumerate(PAIRS[: args.pairs]):
        rng = np.random.default_rng([args.seed, number])
        usual = of_type(int(rng.integers(1 << 31)), int(rng.integers(1 << 31)), "rough")
        probe = str(rng.choice(probes))
        shared, own = (draw_effect(rng, one, channel=_of(one, channel)) for one in (of_bench, of_sensor))
        plain = {one: diagnosis(usual, one, channel, (args.seed, number, 0)) for one in probes}
        affected = diagnosis(_with(usual, replace(own, probe=probe)), probe, channel, (args.seed, number, 0))
        for case, hidden, found in (
            ("plain", None, plain),
            (SENSOR, own, plain | {probe: affected}),
            (BENCH, shared, {one: diagnosis(_with(usual, shared), one, channel, (args.seed, number, 1))
                             for one in probes}),
        ):  # fmt: skip
            causes = judged_causes(channel, [DiagnosedProbe(one, "carriage", "bench", found[one]) for one in probes])
            good, name = judged(case, hidden, probe, causes)
            right[case] += good
            if case != "plain":
                named[case] += name
            said = ", ".join(f"{c.effect} {c.whose} ({len(c.sensors)})" for c in causes) or "nothing"
            what = "" if hidden is None else hidden.effect
            print(f"{'ok' if good else 'NO'}  {channel:<12}{case:<8}{what:<22}{said}", flush=True)
        false += sum(bool(causes) for causes in plain.values())
        diagnosed += len(plain)
    count = len(PAIRS[: args.pairs])
    print(
        f"{args.probes} probes, seed {args.seed}: of {count} pairs the bench's is the bench's in {right[BENCH]}", end=""
    )
    print(f" (named rightly {named[BENCH]}), the sensor's the sensor's in {right[SENSOR]} ({named[SENSOR]});")
    print(
        f"nothing is said of {right['plain']} of {count} plain carriages; {false} of {diagnosed} plain probes' ", end=""
    )
    print(f"diagnoses name something; {time.process_time() - spent:.0f} s of the processor")


def _of(effect: str, channel: str) -> str | None:
    """The channel, for effects that are hidden in one."""
    from shockrig.rig.virtual.effects import KINDS

    return channel if KINDS[effect].single else None


def _with(truth: Truth, hidden: Hidden) -> Truth:
    return with_effects(truth, [hidden])


def diagnosis(truth: Truth, probe: str, channel: str, seed: tuple[int, ...]) -> Named:
    """What the diagnosis of one probe's channel names."""
    plan = [shock for shock in wide_plan() if int(shock.id) in AT_20_C]
    print(f"{seed} {probe}", file=sys.stderr, flush=True)
    with tempfile.TemporaryDirectory() as folder:
        rng = np.random.default_rng([*seed, int(probe)])
        campaign = read_campaign(simulate_campaign(of_probe(truth, probe), plan, rng, Path(folder) / "c"))
    found = diagnose_channel(build_channel(campaign, channel))
    return tuple(stated_cause(cause).as_effect() for cause in found.causes)


def judged(case: str, hidden: Hidden | None, probe: str, causes: tuple[FleetCause, ...]) -> tuple[bool, bool]:
    """Whether what is said is right, and whether the effect's own name is said."""
    others = [one for one in causes if one.whose in (BENCH, TYPE)]
    if hidden is None:
        return not others, not causes
    its = [one for one in causes if hidden.effect in (one.effect, *one.look_alikes) and one.whose == case]
    its = [one for one in its if case == BENCH or one.sensors == (probe,)]
    return bool(its) and all(one in its for one in others), any(one.effect == hidden.effect for one in its)


if __name__ == "__main__":
    main()
