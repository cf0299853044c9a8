"""What a channel's runs cannot tell, whatever is in them, and what its diagnosis leaves open: a sentence on each thing,
with what the campaign would have needed.
"""

from __future__ import annotations

import numpy as np

from shockrig.analysis.design.recorded_so_far import VARIED_RATIO
from shockrig.analysis.diagnose.pool import Search
from shockrig.analysis.diagnose.thresholds import level
from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.fit import Fit
from shockrig.analysis.estimate.gather import UNSETTLED
from shockrig.analysis.estimate.seen import FEW_RUNS
from shockrig.files.numbers import counted


def left_open(found: Search, final: Fit) -> tuple[str, ...]:
    """Sentences on what the search and its model leave open."""
    channel = final.model.channel
    further = found.ended_early and found.best.ids != found.plain.ids
    said = {
        "Another model is likelier than the plain one, but these runs leave open which: no effect is sure enough to "
        "be stated.": found.leaves_open,
        f"The runs differ in how fast they are by some {final.rate_scatter:.0%}, and nothing that was named says why: "
        "see that all are of one sensor, in one airflow.": final.rate_scatter > level("rate_scatter"),
        f"Readings go on behind the response, by some {100 * final.drift_scatter:.2g} % of the step and by another "
        "amount in each run: that is taken for air that still moved. Log a reference beside the probes: a slow part of "
        "the sensor would go on alike in all.": channel.may_drift.any()
        and final.drift_scatter > level("drift_scatter"),
        f"The search ended at its limit of work, after {found.fits} fits: what it had reached by then is judged, and "
        "more may be there, or something else that explains the runs as well.": found.ended_early,
        "Diagnosed again with --from this diagnosis, the search begins with the causes that it names, and goes on from "
        "there.": further,
    }
    return tuple(sentence for sentence, holds in said.items() if holds)


def mostly_unsettled(channel: Channel) -> tuple[str, ...]:
    """A sentence where more runs were left out for readings that drift at rest than are judged."""
    drifting = sum(one.reason.startswith(UNSETTLED) for one in channel.left_out)
    if drifting <= channel.runs:
        return ()
    return (
        f"In {drifting} of {drifting + channel.runs} runs the {channel.sensor} was not settled before the transfer: "
        f"what is judged is the other {channel.runs} alone. Where it had time to settle, what moves it at rest is "
        "unexplained.",
    )


def cannot_tell(channel: Channel) -> tuple[str, ...]:
    """Sentences, each on one thing that the campaign leaves open and what it would have needed."""
    c, sensor = channel.conditions, channel.sensor
    several, step, driven = channel.runs > 1, channel.quantity.step(c), bool(channel.measured.any())
    alike = c.airflow_m_s.max() < VARIED_RATIO * max(c.airflow_m_s.min(), 1e-9)
    one_airflow = several and c.airflow_known.all() and alike
    one_way = several and not driven and (np.all(step > 0) or np.all(step < 0))
    own_unknown = channel.name == "humidity" and not np.isfinite(channel.die_c).any() and not channel.isothermal.all()
    few, alone = 1 < channel.runs <= FEW_RUNS, several and not has_repeats(channel)
    begun = int(np.count_nonzero(channel.begun_s))
    lag_unknown = driven and not any(air is not None and air.lag_s > 0.0 for air in channel.air)
    said = {
        "One run: nothing can be tried on a run that was not fitted. What is named says how the response goes; what "
        "makes it go so is not borne out by one run.": not several,
        f"{counted(channel.runs, 'run')}: only what is plain in each can be told, and uncertainties are wide.": few,
        "No condition was repeated: how much runs differ by chance is taken from what sensors usually do.": alone,
        "The start of the transfer was not recorded: it is estimated from the readings, so a delay, a slow transfer "
        f"and a lag before the {sensor} cannot be told apart. Log the trigger.": not c.start_known.all(),
        f"In {begun} of {counted(channel.runs, 'run')} no readings at rest come before the response: the record begins "
        f"within it, or the {sensor} drifted until a start that nobody logged. When it began, and from what, is "
        "estimated with it: such a run tells little of how a response begins. Log the trigger, and some time at rest "
        "before it.": begun > 0,
        "The airs were not recorded: plateaus are taken for them, so errors of the calibration cannot be seen, nor an "
        "air that still moves. Log a reference beside the probes.": not c.airs_known.all(),
        f"The airflow was not recorded: what an exchange with the air does to the {sensor} cannot be told from its own "
        "body or a housing. Log the airflow, and vary it.": not c.airflow_known.all(),
        "All runs have one airflow: what depends on it cannot be told from what does not. Vary it.": one_airflow,
        f"The {sensor}'s own temperature was not recorded: where the temperature changes, its lag and the {sensor}'s "
        "cannot be told apart. Log it (temperature_c in hyt.csv, die_temperature in a map).": own_unknown,
        "All steps go one way: what depends on the direction cannot be told from what does not.": one_way,
        "The air was measured: slow transfers and room air are in the trace, and are not looked for.": driven,
        "The reference's own lag was not stated: it is taken for none, and the times are those behind what it shows. "
        f"State {channel.quantity.reference_lag} of the reference (run.json, or the map).": lag_unknown,
    }
    return tuple(sentence for sentence, holds in said.items() if holds)


def has_repeats(channel: Channel) -> bool:
    """Whether any two runs had the same airs and airflow, within what chambers reach."""
    c = channel.conditions
    flow = np.log(np.maximum(c.airflow_m_s, 0.05)) / 0.2
    airs = (c.source_c, c.destination_c, c.source_percent / 3.0, c.destination_percent / 3.0)
    keys = np.round(np.column_stack([*airs, flow]))
    return np.unique(keys, axis=0).shape[0] < channel.runs
