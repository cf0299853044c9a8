"""Which runs of a channel are fitted, which together, and with which models; and which are set aside, and why.

A film's ambient is read from its isothermal shocks where it has at least two: in a thermal shock the film's own
temperature lags behind the air.
"""

from __future__ import annotations

import numpy as np

from shockrig.analysis.characterization.extension import Extension
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.channel import Channel, LeftOut
from shockrig.analysis.inference.model import Structure
from shockrig.analysis.inference.noise import Noise

STEP_IN_NOISE = 10.0
LEAST_ISOTHERMAL = 2
THERMAL_SHOCK = "thermal shock: the film's own temperature lags; the isothermal shocks of this ambient are used"
OTHER_KIND = (
    "so much faster or slower than most runs that it ends in another medium, or is of another sensor: make a campaign "
    "of each, or run shockrig diagnose"
)
# Where an ambient has thermal shocks alone: else at the die's own, or taken up at it.
AT_AIR = "thermal shocks, read at the air's temperature"


def choose_runs(
    whole: Channel, noise: Noise, extension: Extension
) -> tuple[list[tuple[Channel, dict[str, Extension]]], list[LeftOut]]:
    """Runs that are fitted together, each set with the models to try by the name of their basis; and runs set aside."""
    quantity = whole.quantity
    step = np.abs(quantity.step(whole.conditions))
    keep = (step >= max(quantity.least_step, STEP_IN_NOISE * noise.standard_deviation)) | whole.measured
    reasons = {int(i): f"no {quantity.name} step ({step[i]:.2g} {quantity.unit})" for i in np.flatnonzero(~keep)}
    if not extension.structure.effects:
        reasons |= {int(i): OTHER_KIND for i in np.flatnonzero(keep & whole.conditions.elsewhere)}
    alone = np.zeros(whole.runs, dtype=bool)
    plain_film = whole.jumps_with_air and not extension.structure.effects and not whole.measured.any()
    if plain_film:
        isothermal = whole.isothermal
        for g in range(whole.ambients_c.size):
            here = keep & (whole.ambient == g)
            if (here & isothermal).sum() >= LEAST_ISOTHERMAL:
                reasons |= dict.fromkeys((int(i) for i in np.flatnonzero(here & ~isothermal)), THERMAL_SHOCK)
            elif (here & ~isothermal).any():
                alone |= here
    keep[list(reasons)] = False
    basis = "isothermal shocks" if plain_film else "all runs"
    readings = [e for e in CATALOGUE.values() if e.readout.thermal and e.acts_in(whole)]
    thermal = {AT_AIR: Extension()} | {e.readout.thermal: Extension(Structure((e,))) for e in readings}
    choices = [(keep & ~alone, {basis: extension}), (keep & alone, thermal)]
    groups = [(whole.select(mask).without_lost_ambients(), models) for mask, models in choices if mask.any()]
    return groups, [*whole.left_out, *(LeftOut(whole.run_ids[i], whole.name, reasons[i]) for i in sorted(reasons))]
