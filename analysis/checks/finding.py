"""What a check of the input says: a kind, the channel and runs concerned, how serious it is, and one plain sentence.

The thresholds of all checks stand in one table: value, unit, what it decides, and where it comes from.

"Right campaigns" are those of benchmarks/input_checks.py: whatever the virtual bench can hide, other labs' benches, and
measured logs. What is given is the furthest that any of them comes to the threshold.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

Severity = Literal["stop", "warn"]
Channel = Literal["temperature", "humidity"] | None


@dataclass(frozen=True)
class InputFinding:
    """One likely fault of the input.

    Attributes
    ----------
    kind : str
        An id, such as "fahrenheit" or "start_disagrees".
    channel : "temperature", "humidity" or None
        The channel concerned; None where it is both.
    runs : tuple of str
        Ids of the runs to leave out until the fault is put right ("stop"), or to look at ("warn").
    severity : "stop" or "warn"
        "stop": what a fit of these runs would give is nonsense. "warn": worth knowing, and may be meant.
    sentence : str
        The likely cause, the numbers that show it, and the remedy.
    """

    kind: str
    channel: Channel
    runs: tuple[str, ...]
    severity: Severity
    sentence: str


def name_runs(runs: Collection[str], total: int) -> str:
    """Runs in words: "all 35 runs", "run 0003", "runs 0003 and 0007", "17 of 35 runs (0001, 0002, 0003, ...)"."""
    names = list(runs)
    if len(names) == 1:
        return f"run {names[0]}"
    if len(names) == total:
        return f"all {total} runs"
    if len(names) <= 4:
        return f"runs {', '.join(names[:-1])} and {names[-1]}"
    return f"{len(names)} of {total} runs ({', '.join(names[:3])}, ...)"


@dataclass(frozen=True)
class Threshold:
    """One number that a check compares with."""

    value: float
    unit: str
    meaning: str
    source: str


THRESHOLDS: dict[str, Threshold] = {
    # what counts as a step
    "fewest_readings": Threshold(20, "1", "a column with fewer readings is not looked at", "medians of a tenth of it"),
    "step_over_noise": Threshold(12, "1", "a step has at least so many sigma of the noise", "hum of 0.06 K is none"),
    "smallest_step_k": Threshold(0.5, "K", "and at least this size", "calibration errors reach 0.5 K"),
    "smallest_step_percent": Threshold(2.0, "%RH", "and at least this size", "hysteresis reaches 2 %RH"),
    # units
    "agree_k": Threshold(4.0, "K", "a plateau this near its air agrees with it", "wet or heated beads are off by 2 K"),
    "agree_percent": Threshold(8.0, "%RH", "the same of humidity", "calibration 4 %RH, hysteresis 2 %RH"),
    "apart_factor": Threshold(2.0, "1", "not agreeing is so many times that", "a gap between the two"),
    "unsettled_share": Threshold(0.4, "1", "share of its step that a slow sensor may lack at the end", "60 % reached"),
    "highest_dew_point_c": Threshold(60.0, "°C", "no bench has such a dew point", "35 °C is the record outdoors"),
    "lattice_share": Threshold(0.98, "1", "readings on a grid of °C seen through °F", "a few are edited by hand"),
    "highest_fraction": Threshold(
        1.3, "%RH", "a campaign that never exceeds it is in fractions", "130 %, the reader's"
    ),
    "shortest_ms_s": Threshold(9.0, "s", "readings this far apart may be in milliseconds", "100 Hz is 10 ms"),
    "long_period_s": Threshold(60.0, "s", "and these are, but for whole quarter minutes", "loggers' settings"),
    "slowest_rise_s": Threshold(1500.0, "s", "a rise from 10 to 63 % that no sensor has", "lags reach 500 s"),
    "unit_of_time_ratio": Threshold(300.0, "1", "two clocks so far apart differ in unit", "1000 or 1"),
    "pace_share": Threshold(2e-3, "1", "a pace this near a logger's is that pace", "rounded stamps; other paces 1 %"),
    # swaps
    "swap_k": Threshold(
        2.0, "K", "smallest stated step in which swapped airs show", "self-heating, calibration: 1.3 K"
    ),
    "swap_percent": Threshold(8.0, "%RH", "the same of humidity", "calibration and hysteresis: 6 %RH"),
    "stood_k": Threshold(4.0, "K", "a sensor at rest stands this near its air", "as agree_k, and as a bench's runs"),
    "stood_percent": Threshold(12.0, "%RH", "the same of humidity", "clipped, 10 %RH; as a bench's runs"),
    # dead and saturated sensors
    "dead_share": Threshold(0.995, "1", "equal readings of a dead sensor", "the rest before it died"),
    "dead_air_step_k": Threshold(2.0, "K", "a step that every live sensor shows", "the coarsest resolution is 0.2 K"),
    "dead_air_step_percent": Threshold(8.0, "%RH", "the same of humidity", "the coarsest resolution is 1 %RH"),
    "dead_follows": Threshold(
        0.03, "1", "a sensor that shows less of the step is dead", "a lag of 500 s in 20 s: 0.04"
    ),
    "dead_after_s": Threshold(20.0, "s", "if it was watched so long", "as above"),
    "flat_share": Threshold(0.9, "1", "share of a plateau at the run's extreme value", "rounded readings toggle"),
    "flat_short_k": Threshold(3.0, "K", "a flat end this far from its air is a rail", "calibration and heating: 2 K"),
    "flat_short_percent": Threshold(14.0, "%RH", "less is an effect, a clipped reading", "hidden ones cut 3 to 10 %RH"),
    # starts and clocks
    "onset_share": Threshold(0.01, "1", "a response begins at this share of the step", "above the noise of most"),
    "onset_sigmas": Threshold(4.0, "1", "and at so many sigma of the noise", "one reading in 3e4"),
    "latest_onset_share": Threshold(0.1, "1", "a response seen no earlier tells nothing", "a step of 40 sigma"),
    "onset_early_s": Threshold(0.7, "s", "readings moving so long before it: a late start", "right campaigns: 0.4 s"),
    "onset_late_s": Threshold(1.3, "s", "readings at rest so long after it: an early start", "right campaigns: 0.8 s"),
    "onset_late_unknown_s": Threshold(10.0, "s", "more, where a film may not be isothermal", "lag of the die: 6 s"),
    "onset_rise": Threshold(0.05, "1", "more, in shares of the rise from 10 to 63 %", "other labs' bodies"),
    "quick_rise_s": Threshold(3.0, "s", "a bead that shows how the air steps", "behind an air film: 1.3 s"),
    "slow_rise_s": Threshold(10.0, "s", "a slower response may be of any body", "films at 0 °C rise in 13 s"),
    "clock_runs": Threshold(0.6, "1", "share of a sensor's runs that tell of its clock", "more than half"),
    # stated airs, against both thermometers
    "both_off_k": Threshold(1.0, "K", "two thermometers at rest as far off, to one side", "right campaigns: 0.02 K"),
    "both_alike": Threshold(0.5, "1", "share of that by which they may differ", "calibrations are their own"),
    # copies
    "copy_correlation": Threshold(0.8, "1", "noise that only a copy has in common", "8 sigma at 100 readings"),
    "copy_readings": Threshold(60, "1", "fewest changes of a reading that tell", "6 sigma"),
    # response times
    "rate_step_k": Threshold(3.0, "K", "smallest step that gives a response time", "noise below 1 % of it"),
    "rate_step_percent": Threshold(10.0, "%RH", "the same of humidity", "noise below 1 % of it"),
    "rate_resolved": Threshold(1.5, "1", "response time over the time between fresh readings", "fewer hide its shape"),
    "isothermal_k": Threshold(1.5, "K", "humidity responds alone up to this change", "the die's lag spoils the rest"),
    "group_difference": Threshold(0.08, "1", "ln of the ratio of two thermometers' times", "right campaigns: 0.054"),
    "group_difference_film": Threshold(
        0.12, "1", "the same of films, whose D depends on more", "0.06, unless the scatter is as large"
    ),
    "group_over_scatter": Threshold(8.0, "1", "and so many times the scatter within the groups", "by chance: 6"),
    "group_chance": Threshold(0.35, "1", "squares left, over what the best labels leave", "right campaigns: 0.6"),
    "group_share": Threshold(0.2, "1", "smallest share of the runs that makes a group", "and three runs"),
    "group_share_airflow_unknown": Threshold(0.3, "1", "the same without the airflow", "few runs have another one"),
    "group_alone": Threshold(7.0, "1", "sigma that the groups explain without any one run", "no single run decides"),
    "smallest_alpha_m2_s": Threshold(1e-9, "m²/s", "effective alpha of a bead", "polymers 1e-7, behind an air film"),
    "largest_alpha_m2_s": Threshold(1e-5, "m²/s", "effective alpha of a bead", "steel, 4e-6 to 1e-5"),
    "smallest_d_m2_s": Threshold(1e-14, "m²/s", "D of vapour in a film", "dense polymers (Crank 1975, ch. 11)"),
    "largest_d_m2_s": Threshold(1e-9, "m²/s", "D of vapour in a film", "open polymers; liquid water 2e-9"),
}


def limit(name: str) -> float:
    """The value of a threshold; KeyError where there is none of that name."""
    return THRESHOLDS[name].value
