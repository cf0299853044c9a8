"""What a channel's runs cannot tell, whatever is in them: said before anything is fitted."""

from __future__ import annotations

import numpy as np

from shockrig.analysis.diagnosis.adequacy import most_scatter
from shockrig.analysis.diagnosis.search import Search
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.fit import Fit
from shockrig.analysis.inference.seen import FEW_RUNS
from shockrig.files.numbers import counted

SAME_AIRFLOW = 1.2  # ratio between airflows below which they are one


def ended(found: Search) -> tuple[str, ...]:
    """What is said where the search made as many fits as it may."""
    if not found.ended_early:
        return ()
    return (
        f"The search ended at its limit of work, after {found.fits} fits: what it had reached by then is judged, and "
        "more may be there. Diagnose again with --from this diagnosis to go on from there.",
    )


def rates_apart(final: Fit) -> tuple[str, ...]:
    """A sentence where the runs' own rates lie far apart and nothing in the model says why."""
    if final.rate_scatter <= most_scatter(final.model.channel):
        return ()
    return (
        f"The runs differ in how fast they are by some {final.rate_scatter:.0%}, and nothing that was named says why: "
        "see that all are of one sensor, in one airflow.",
    )


def cannot_tell(channel: Channel) -> tuple[str, ...]:
    """Sentences, each on one thing that the campaign leaves open and what it would have needed."""
    c, sensor = channel.conditions, channel.quantity.noun
    said = []
    if channel.runs == 1:
        said.append(
            "One run: nothing can be tried on a run that was not fitted. What is named says how the response goes; "
            "what makes it go so is not borne out by one run."
        )
    elif channel.runs <= FEW_RUNS:
        said.append(
            f"{counted(channel.runs, 'run')}: only what is plain in each can be told, and uncertainties are wide."
        )
    if channel.runs > 1 and not has_repeats(channel):
        said.append("No condition was repeated: how much runs differ by chance is taken from what sensors usually do.")
    if not c.start_known.all():
        said.append(
            "The start of the transfer was not recorded: it is estimated from the readings, so a delay, a slow "
            f"transfer and a lag before the {sensor} cannot be told apart. Log the trigger."
        )
    if not c.airs_known.all():
        said.append(
            "The airs were not recorded: plateaus are taken for them, so errors of the calibration cannot be seen, nor "
            "an air that still moves. Log a reference beside the probes."
        )
    if not c.airflow_known.all():
        said.append(
            f"The airflow was not recorded: what an exchange with the air does to the {sensor} cannot be told from its "
            "own body or a housing. Log the airflow, and vary it."
        )
    elif channel.runs > 1 and c.airflow_m_s.max() < SAME_AIRFLOW * max(c.airflow_m_s.min(), 1e-9):
        said.append("All runs have one airflow: what depends on it cannot be told from what does not. Vary it.")
    if own_temperature_unknown(channel):
        said.append(
            f"The {sensor}'s own temperature was not recorded: where the temperature changes, its lag and the "
            f"{sensor}'s cannot be told apart. Log it (temperature_c in hyt.csv, die_temperature in a map)."
        )
    step = channel.quantity.step(c)
    if channel.runs > 1 and not channel.measured.any() and (np.all(step > 0) or np.all(step < 0)):
        said.append("All steps go one way: what depends on the direction cannot be told from what does not.")
    if channel.measured.any():
        said.append("The air was measured: slow transfers and room air are in the trace, and are not looked for.")
        if not any(air is not None and air.lag_s > 0.0 for air in channel.air):
            said.append(
                "The reference's own lag was not stated: it is taken for none, and the times are those behind what it "
                f"shows. State {channel.quantity.reference_lag} of the reference (run.json, or the map)."
            )
    return tuple(said)


def own_temperature_unknown(channel: Channel) -> bool:
    """Whether a film went through changes of temperature and nobody recorded its own."""
    return bool(channel.name == "humidity" and not np.isfinite(channel.die_c).any() and not channel.isothermal.all())


def air_of_a_film_unknown(channel: Channel) -> bool:
    """Whether a film went through changes of temperature in airs that nobody recorded, or with dew on it."""
    warmed = channel.name == "humidity" and not channel.isothermal.all()
    return bool(warmed and (not channel.conditions.airs_known.all() or np.isfinite(channel.wet_until_s).any()))


def has_repeats(channel: Channel) -> bool:
    """Whether any two runs had the same airs and airflow, within what chambers reach."""
    c = channel.conditions
    keys = np.column_stack(
        [
            np.round(c.source_c),
            np.round(c.destination_c),
            np.round(c.source_percent / 3.0),
            np.round(c.destination_percent / 3.0),
            np.round(np.log(np.maximum(c.airflow_m_s, 0.05)) / 0.2),
        ]
    )
    return np.unique(keys, axis=0).shape[0] < channel.runs
