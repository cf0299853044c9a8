"""The thresholds of all checks of the input in one table: value, unit, what it decides, and where it comes from.

"Right campaigns" are those of benchmarks/input_checks.py: whatever the virtual bench can hide, and measured sets.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Threshold:
    """One number that a check compares with."""

    value: float
    unit: str
    meaning: str
    source: str


_RIGHT = "right campaigns"
THRESHOLDS: dict[str, Threshold] = {
    # what counts as a step
    "fewest_readings": Threshold(20, "1", "a column with fewer readings is not looked at", "medians of a tenth of it"),
    "step_over_noise": Threshold(12, "1", "a step is at least so many sigma of the noise", "hum of 0.06 K is none"),
    "smallest_step_k": Threshold(0.5, "K", "and at least this", "calibration errors reach 0.5 K"),
    "smallest_step_percent": Threshold(2.0, "%RH", "and at least this", "hysteresis reaches 2 %RH"),
    # units
    "agree_k": Threshold(4.0, "K", "a plateau agrees with its air", "a wet or heated bead is off by less"),
    "agree_percent": Threshold(8.0, "%RH", "a plateau agrees with its air", "calibration 4 %RH and hysteresis 2 %RH"),
    "apart_factor": Threshold(2.0, "1", "not agreeing: so many times the above", "a gap between the two"),
    "unsettled_share": Threshold(0.4, "1", "share of its step that a slow sensor may lack at the end", "60 % reached"),
    "highest_dew_point_c": Threshold(60.0, "°C", "dew point that no air of a bench has", "35 °C is a record outdoors"),
    "lattice_share": Threshold(0.98, "1", "share of readings on a grid of °C, seen through °F", "dropped digits"),
    "highest_fraction": Threshold(1.3, "%RH", "a campaign that never exceeds it is in fractions", "130 % as fraction"),
    "longest_period_s": Threshold(9.0, "s", "readings further apart are suspected of milliseconds", "100 Hz is 10 ms"),
    "unit_of_time_ratio": Threshold(300.0, "1", "two clocks so far apart differ in their unit", "near 1000"),
    # swaps
    "swap_k": Threshold(2.0, "K", "smallest stated step for which a swap of the airs shows", _RIGHT),
    "swap_percent": Threshold(8.0, "%RH", "smallest stated step for which a swap of the airs shows", _RIGHT),
    # dead and saturated sensors
    "dead_share": Threshold(0.995, "1", "share of equal readings of a dead sensor", "a few rows of the moment it died"),
    "dead_air_step_k": Threshold(2.0, "K", "a step of the air that a live sensor follows", "above the coarsest 0.2 K"),
    "dead_air_step_percent": Threshold(8.0, "%RH", "a step of the air that a live sensor follows", "above 1 %RH"),
    "dead_follows": Threshold(0.03, "1", "a sensor that moves by less of the air's step is dead", "500 s lag in 20 s"),
    "dead_after_s": Threshold(20.0, "s", "how long after the start it must have been watched", "the above"),
    "flat_share": Threshold(0.15, "1", "share of a run's readings at its one extreme value", "a tenth is the plateau"),
    "flat_short_k": Threshold(1.5, "K", "a flat top this short of its air is a rail", "errors of 0.5 K and 2 %"),
    "flat_short_percent": Threshold(
        14.0, "%RH", "the same; a smaller deficit is the diagnosis's saturation_clipping", "it is 3 to 10 %RH"
    ),
    # starts and clocks
    "onset_share": Threshold(0.01, "1", "share of the step at which a response is said to begin", "above its noise"),
    "onset_sigmas": Threshold(4.0, "1", "and at least so many sigma of the noise", "one in 3e4 readings"),
    "latest_onset_share": Threshold(0.1, "1", "a response so noisy that it begins later tells nothing", _RIGHT),
    "onset_early_s": Threshold(
        0.7, "s", "readings move so long before the start: it is stated late", "0.4 s: " + _RIGHT
    ),
    "onset_late_s": Threshold(1.3, "s", "readings move so long after it: stated early", "dead time 0.6 s, hold 0.8 s"),
    "onset_rise": Threshold(0.05, "1", "tolerance in shares of the rise from 10 to 63 %", _RIGHT),
    "slow_rise_s": Threshold(10.0, "s", "a longer rise may be of any body, also one read at its core", _RIGHT),
    "clock_runs": Threshold(
        0.6, "1", "share of a sensor's runs that must be off, and of the other's that agree", _RIGHT
    ),
    # copies
    "copy_correlation": Threshold(
        0.8, "1", "correlation of two runs' noise that only a copy has", "8 sigma at n = 100"
    ),
    "copy_readings": Threshold(60, "1", "fewest changes between readings that tell", "the above"),
    # rates
    "rate_step_k": Threshold(3.0, "K", "smallest step that gives a response time", "1 % of it is the noise"),
    "rate_step_percent": Threshold(10.0, "%RH", "smallest step that gives a response time", "1 % of it is the noise"),
    "rate_resolved": Threshold(1.5, "1", "response time over the time between fresh readings", "the shape must show"),
    "isothermal_k": Threshold(
        1.5, "K", "temperature change up to which humidity responds alone", "die lag spoils more"
    ),
    "group_difference": Threshold(0.08, "1", "ln of the ratio of two sensors' response times", "0.05: " + _RIGHT),
    "group_over_scatter": Threshold(8.0, "1", "and so many times the scatter within them", "6 by chance at 8 d.o.f."),
    "group_chance": Threshold(0.26, "1", "scatter left, over what the best of all labels leaves by chance", _RIGHT),
    "group_share": Threshold(0.2, "1", "smallest share of the runs that makes a group", "and three runs"),
    "group_share_airflow_unknown": Threshold(0.3, "1", "the same where the airflow was not recorded", "three airflows"),
    "group_alone": Threshold(0.5, "1", "share of the difference that is left without any one run", "no run decides"),
    "smallest_alpha_m2_s": Threshold(
        1e-9, "m²/s", "effective thermal diffusivity of a bead", "polymers 1e-7, air film"
    ),
    "largest_alpha_m2_s": Threshold(1e-5, "m²/s", "effective thermal diffusivity of a bead", "steel 4e-6 to 1e-5"),
    "smallest_d_m2_s": Threshold(
        1e-14, "m²/s", "diffusivity of vapour in a film", "dense polymers; Crank 1975, ch. 11"
    ),
    "largest_d_m2_s": Threshold(1e-9, "m²/s", "diffusivity of vapour in a film", "water in water 2e-9"),
}


def limit(name: str) -> float:
    """The value of a threshold; KeyError where there is none of that name."""
    return THRESHOLDS[name].value
