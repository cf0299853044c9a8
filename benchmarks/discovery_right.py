"""What counts as right in `discovery.py`: the behaviours and dependences by which each hidden effect may be described,
the plan that shows it, and which of a description's numbers are compared with the truth.

A look of the same thing counts where no campaign can part the two: a running mean is a delay, or a short lag; a ramp of
the air a delay, or a lag; a leak of heat a share that follows late, or a rate that is added.
"""

from __future__ import annotations

T, RH = "temperature", "humidity"
Rights = tuple[tuple[str, str, tuple[frozenset[str], ...]], ...]

# (effect, channel) -> (behaviour, driver or "" for any, sets of factors). A description is right where its behaviour
# (and driver) is one of these and its factors are exactly one of the sets. What nothing in the grammar behaves like is
# right where nothing is described, and has no entry but ().
NONE: frozenset[str] = frozenset()
AIRFLOW, AMBIENT, DIRECTION, HUMIDITY = (frozenset({name}) for name in ("airflow", "ambient", "direction", "humidity"))
LATE: Rights = (("lag_in_series", "", (NONE, frozenset({"history"}))), ("delay", "", (NONE,)))
DELAY: Rights = (("delay", "", (NONE,)),)
GROWING: Rights = (("delay", "", (frozenset({"history"}),)),)
SHARE: Rights = (("parallel_lag", "", (NONE,)), ("added_rate", "own_response", (NONE,)))
CYCLING: Rights = (("periodic", "none", (NONE,)),)
CREEP = (frozenset({"history"}), NONE)
RIGHT: dict[tuple[str, str], Rights] = {
    ("finite_transfer", T): LATE,
    ("finite_transfer", RH): LATE,
    ("air_relaxation", T): (("added_response", "air_temperature", (AMBIENT,)), ("added_rate", "none", (AMBIENT,))),
    ("air_relaxation", RH): (
        ("added_response", "air_humidity", (AMBIENT | HUMIDITY,)),
        ("added_rate", "none", (AMBIENT, HUMIDITY)),
    ),
    ("convective_film", T): (("lag_in_series", "", (AIRFLOW,)), ("rate_change", "", (AIRFLOW,))),
    ("exchange_temperature", T): (
        ("lag_in_series", "airflow", (AMBIENT, AIRFLOW | AMBIENT)),
        ("rate_change", "", (AMBIENT,)),
    ),
    ("vapour_boundary_layer", RH): (("lag_in_series", "", (AIRFLOW,)), ("rate_change", "", (AIRFLOW,))),
    ("series_lag", RH): (("lag_in_series", "", (NONE,)),),
    ("condensation", RH): (("delay", "", (AMBIENT, NONE)), ("added_rate", "none", (NONE, AMBIENT, HUMIDITY))),
    ("direction_dependent_diffusivity", RH): (("rate_change", "", (DIRECTION,)),),
    ("concentration_dependent_diffusivity", RH): (("rate_change", "", (HUMIDITY,)),),
    ("slow_relaxation", RH): SHARE,
    ("stem_conduction", T): SHARE,
    ("evaporative_cooling", T): (("added_rate", "none", (NONE, AMBIENT, HUMIDITY)),),
    ("self_heating", T): (("offset", "none", (AIRFLOW,)),),
    ("radiative_heating", T): (),  # it goes with the light, on which nothing in the grammar depends
    ("wall_radiation", T): (("gain", "own_response", (AIRFLOW | AMBIENT,)),),
    ("die_thermal_lag", RH): (("gain", "die_temperature", (NONE,)), ("added_rate", "air_temperature", (NONE,))),
    # A gain that goes with the chip's temperature, from where the air's is: the same for a film that is fast beside it.
    ("uptake_by_activity", RH): (("gain", "die_temperature", (NONE,)),),
    ("calibration_temperature", RH): (
        ("added_response", "die_temperature", (NONE,)),
        ("added_response", "air_temperature", (NONE,)),
    ),
    ("hysteresis", RH): (("offset", "none", (frozenset({"direction", "step"}),)),),
    ("calibration_error", T): (("gain", "own_response", (AMBIENT, NONE)), ("offset", "none", (NONE,))),
    ("calibration_error", RH): (("gain", "own_response", (NONE,)), ("offset", "none", (NONE,))),
    ("saturation_clipping", RH): (("gain", "own_response", (HUMIDITY,)), ("offset", "none", (HUMIDITY,))),
    ("dead_time", T): DELAY,
    ("dead_time", RH): DELAY,
    ("clock_drift", T): GROWING,  # counted from a run's first reading, it is late by the plateau's share
    ("clock_drift", RH): GROWING,
    ("moving_average", T): LATE,
    ("moving_average", RH): LATE,
    ("stale_samples", RH): LATE,
    ("quantization", T): (("offset", "own_response", (NONE,)),),
    ("quantization", RH): (("offset", "own_response", (NONE,)),),
    ("unknown_air_cycling", T): CYCLING,
    ("unknown_chamber_overshoot", T): (("periodic", "air_temperature", (NONE,)),),
    ("unknown_rate_with_temperature", T): (("rate_change", "", (AMBIENT,)),),
    ("unknown_log_creep", T): (("added_response", "air_temperature", (frozenset({"history"}),)),),
    ("unknown_log_creep", RH): (("added_response", "air_humidity", (frozenset({"history"}),)),),
    ("unknown_sorption_heat", RH): (("added_rate", "own_response", (NONE, HUMIDITY, DIRECTION, DIRECTION | HUMIDITY)),),
    ("unknown_run_drift", T): (("offset", "none", (frozenset({"run_order"}),)),),
    ("unknown_run_drift", RH): (("offset", "none", (frozenset({"run_order"}),)),),
    ("unknown_gain_drift", T): (("added_response", "own_response", CREEP),),
    ("unknown_gain_drift", RH): (("added_response", "own_response", CREEP),),
    ("unknown_interference", T): (("periodic", "", (NONE,)), ("bursts", "", (NONE,))),
    ("unknown_interference", RH): (("periodic", "", (NONE,)), ("bursts", "", (NONE,))),
}
# What acts on another alone is hidden beside it, and only it is taken away.
BESIDE = {"exchange_temperature": ("convective_film",)}
# Effects that the standard campaign does not show, and the runs that are recorded besides.
DEW, LIGHT = frozenset({"condensation", "evaporative_cooling"}), frozenset({"radiative_heating"})
# Numbers of the truth that a description's own can be compared with: parameter hidden -> what is stated.
NUMBERS = {
    ("stem_conduction", "time_constant_s"): "time_constant_s",
    ("stem_conduction", "fraction"): "size",
    ("slow_relaxation", "time_constant_s"): "time_constant_s",
    ("slow_relaxation", "fraction"): "size",
    ("series_lag", "time_constant_s"): "time_constant_s",
    ("unknown_log_creep", "onset_s"): "time_constant_s",
    ("unknown_log_creep", "fraction"): "size",
    ("dead_time", "delay_s"): "size",
    ("clock_drift", "ppm"): "size",
    ("self_heating", "rise_k_at_5_m_s"): "size",
    ("hysteresis", "rh_percent"): "size",
    ("quantization", "step"): "size",
    ("calibration_temperature", "percent_per_k"): "size",
    ("unknown_run_drift", "per_run"): "size",
    ("unknown_air_cycling", "amplitude_k"): "size",
    ("unknown_air_cycling", "period_s"): "period_s",
    ("unknown_gain_drift", "per_minute"): "size",
    ("unknown_interference", "amplitude"): "size",
    ("unknown_rate_with_temperature", "per_kelvin"): "ambient",
    ("direction_dependent_diffusivity", "ratio_drying_to_wetting"): "direction",
    ("concentration_dependent_diffusivity", "slope_per_unit_activity"): "humidity",
}


def is_right(stated: dict, effect: str, channel: str) -> bool:
    """Whether one description has the behaviour and the dependence of what was hidden."""
    factors = frozenset(on["factor"] for on in stated["depends_on"])
    return any(
        stated["behaves_as"] == behaviour and driver in ("", stated["driver"]) and factors in sets
        for behaviour, driver, sets in RIGHT[effect, channel]
    )


def states_it(name: str, effect: str, channel: str) -> bool:
    """Whether a catalogued effect's own equation has the behaviour and the dependence of what was hidden."""
    from shockrig.analysis.effects.forms import LAWS

    own = [key for key, laws in LAWS.items() if name in [law for law, _ in laws]]
    stated = [
        {"behaves_as": behaviour, "driver": driver, "depends_on": [{"factor": factor} for factor, _ in depends_on]}
        for behaviour, driver, depends_on in own
    ]
    return any(is_right(one, effect, channel) for one in stated)


def plan_for(effect: str) -> list:
    """The standard campaign, and what else is needed for an effect to act."""
    from dataclasses import replace

    from shockrig.rig.seams import Air
    from shockrig.rig.virtual.plans import Shock, standard_plan

    plan = standard_plan()
    if effect in LIGHT:
        return [replace(run, extra={"irradiance_w_m2": 800.0}) if i % 4 == 0 else run for i, run in enumerate(plan)]
    if effect in DEW:
        airs = ((Air(2.0, 60.0), Air(20.0, 70.0)), (Air(5.0, 50.0), Air(30.0, 60.0)))
        flows = (4.0, 6.0, 8.0)
        plan += [
            Shock(f"{len(plan) + 3 * i + k + 1:04d}", *pair, flow)
            for i, pair in enumerate(airs)
            for k, flow in enumerate(flows)
        ]
    return plan


def unrecorded_plan(airflows_m_s: tuple[float, float], more_c: tuple[float, ...]) -> list:
    """Runs at the standard campaign's ambients with other airflows, steps and levels; `more_c` are ambients besides."""
    from shockrig.rig.seams import Air
    from shockrig.rig.virtual.plans import Shock

    runs = []
    for i, ambient in enumerate((0.0, 10.0, 20.0, 30.0, 40.0, *more_c)):
        flow, other = airflows_m_s if i % 2 else airflows_m_s[::-1]
        runs += [
            (Air(ambient, 30.0), Air(ambient, 62.0), flow),
            (Air(ambient, 68.0), Air(ambient, 36.0), other),
            (Air(ambient + 9.0, 38.0), Air(ambient, 58.0), other),
            (Air(ambient - 7.0 if ambient else ambient + 14.0, 60.0 if ambient else 26.0), Air(ambient, 50.0), flow),
        ]
    return [Shock(f"{i:04d}", source, there, flow) for i, (source, there, flow) in enumerate(runs, 1)]
