"""Every threshold of the diagnosis: derived from one false-alarm rate and one level for ties, or in the table below.

A wrong name in a hundred plain campaigns is allowed. A campaign has two channels, and each looks at the whole
catalogue: an effect with k parameters must lower the deviance by the chi-square quantile at 0.01 / (2 x entries). One
without parameters is another simple hypothesis; a drop of x then comes by chance with at most half the chance of a
chi-square of one degree of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import log

from scipy.special import chdtri

from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.inference.channel import Channel
from shockrig.analysis.inference.effect import Effect

FALSE_ALARMS = 0.01  # of plain campaigns in which anything may be named
TIE_ODDS = 20.0  # explanations less than that much likelier than one another are tied
TIE = 2.0 * log(TIE_ODDS)
CHANNELS = 2


@dataclass(frozen=True)
class Threshold:
    """One number that cannot be derived: what it means, and where it was found."""

    value: float
    meaning: str
    source: str


_TRIALS = "benchmarks/diagnosis_trials.py --kind"
THRESHOLDS = {
    name: Threshold(value, meaning, source)
    for name, value, meaning, source in (
        ("adequacy", 1e-6, "probability below which what is left is no accident", f"{_TRIALS} none"),
        ("rate_scatter", 0.022, "scatter of the runs' rates that is an effect", f"{_TRIALS} none"),
        ("open_rate_scatter", 0.25, "the same where nobody recorded the airflow", "benchmarks/foreign_benches.py"),
        ("stated_scatter", 1.7, "by how much stated uncertainties may be exceeded", f"{_TRIALS} none"),
        ("certain_excess", 20.0, "multiple of what is left that a cause must dwarf", f"{_TRIALS} outside"),
        ("certain_least", 200.0, "drop in deviance that it must bring besides", f"{_TRIALS} outside"),
        ("average_gain", 6.0, "drop in deviance of a mean that noise hides", f"{_TRIALS} ID, a mean of readings"),
        ("average_unlikely", 40.0, "log likelihood below which a length is out", f"{_TRIALS} one"),
        ("hidden_noise", 0.5, "noise in steps that rounding hides", f"{_TRIALS} ID, rounding"),
        ("not_gaussian", 1.5, "by how much codes say less than their variance", f"{_TRIALS} ID, rounding"),
        ("many_runs", 20.0, "runs whose fit tells a small effect by itself", f"{_TRIALS} one --strength limit"),
        ("held_out_excess", 2.0, "multiple of the noise that is no accident on unseen runs", "benchmarks/real_data.py"),
        ("shape_in_doubt", 0.8, "most that a shape is given beside what is left", "benchmarks/real_data.py"),
        ("shape_beside_most", 0.5, "the same where most of the error is left", "benchmarks/discovery.py"),
        (
            "plain_to_see",
            1.5,
            "ratio of mean squares by which a shape shows in one run",
            "benchmarks/foreign_benches.py",
        ),
        ("outdone", 0.5, "most of a cause in whose place a plain behaviour does better", "benchmarks/discovery.py"),
        ("anything", 2.0, "uncertainty, in its logarithm, of what may be anything", f"{_TRIALS} ordinary"),
    )
}


def level(name: str) -> float:
    """Value of an entry of the table."""
    return THRESHOLDS[name].value


@cache
def _quantile(parameters: int) -> float:
    alpha = FALSE_ALARMS / (CHANNELS * len(CATALOGUE))
    return float(chdtri(parameters, alpha) if parameters else chdtri(1, 2.0 * alpha))


def penalty(effect: Effect, channel: Channel) -> float:
    """Drop in deviance that an effect must bring to be named in a channel."""
    return _quantile(len(effect.parameters)) + effect.rarity(channel)
