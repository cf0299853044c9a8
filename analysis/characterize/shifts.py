"""How far a fit's parameters are off where an input is off in all runs alike and no reading shows it.

An airflow, a pressure, a clock: the channel is looked at with the input perturbed, and the estimate moves by
covariance @ pull of what changes in the prediction (-H^-1 d2/dtheta dq, with the runs' random effects eliminated).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.estimate.fit import Fit
from shockrig.analysis.estimate.model import LEAST_TRIGGER_OFFSET_S, PERTURBED_INPUTS, TRIGGER
from shockrig.analysis.estimate.problem import Problem
from shockrig.analysis.estimate.quantity import RunEffect

Array = NDArray[np.float64]

# An effective rate at a stated airflow: with how large a power of the airflow it may go, before the runs say. A time
# constant that an air film makes goes about as airflow^-0.45 (Ranz and Marshall 1952 at a bead's Reynolds numbers).
LARGEST_EXPONENT = 0.45
USUAL_SLOPE_PER_K = 0.03  # of ln D over temperature, where one ambient alone was recorded: 21 kJ/mol at 20 degC
NO_CHANGE_SIGMAS = 1e-9  # change of a prediction, in standard deviations of the noise, that is none


def disturbances(problem: Problem, found: Fit) -> dict[str, tuple[Array, Array]]:
    """What an input that is off by one standard uncertainty in all runs does, by its key: to the whitened readings
    (R, n), and to theta (P,) whatever they are.

    Empty where the campaign states nothing, but for the trigger: nobody's is perfect. What the fit carries itself
    (`Model.shared`) is not among them.
    """
    done: dict[str, tuple[Array, Array]] = {}
    model, channel = found.model, problem.channel
    fitted = {one.name for one in model.shared}
    nothing = np.zeros(found.theta.size)
    if TRIGGER not in fitted:
        done[TRIGGER] = found.arrow.run_jacobian[..., RunEffect.START] * LEAST_TRIGGER_OFFSET_S, nothing
    stated = model.channel.common
    if stated is None:
        return done
    base = model.predict(found.point)[0]
    for name, (perturbed, step) in PERTURBED_INPUTS.items():
        uncertainty = float(getattr(stated, name))
        if name in fitted or name == TRIGGER or uncertainty == 0.0:
            continue
        there = model.on(perturbed(channel, step)).predict(found.point)[0]
        unused = found.residual == 0.0  # empty bins, and those too near a jump to say anything
        change = problem.whiten(np.where(unused, 0.0, there - base)) / step * uncertainty
        if np.abs(change).max() > NO_CHANGE_SIGMAS:
            done[name] = change, nothing
        elif name == "airflow_percent" and channel.conditions.airflow_known.any():
            done[name] = np.zeros(change.shape), _of_rates(found, airflow_exponent(found) * uncertainty / 100.0)
    if not channel.quantity.pooled and stated.air_temperature_k > 0:
        # The rate is right, and belongs to another temperature than the one that is stated.
        name = "air_temperature_k"
        change, own = done.get(name, (np.zeros(base.shape), nothing))
        done[name] = change, own + _of_rates(found, temperature_slopes(found) * stated.air_temperature_k)
    return done


def shifts(problem: Problem, found: Fit) -> dict[str, Array]:
    """By how much each of the `disturbances` moves the estimate of theta (P,), to first order."""
    covariance = found.arrow.covariance()
    done = disturbances(problem, found)
    return {name: covariance @ found.arrow.pull(change) + own for name, (change, own) in done.items()}


def _of_rates(found: Fit, values: Array | float) -> Array:
    theta = np.zeros(found.theta.size)
    theta[found.model.rates] = values
    return theta


def widened(problem: Problem, found: Fit) -> Fit:
    """The fit with its covariance widened by the shifts that it does not carry itself."""
    extra = [moved for name, moved in shifts(problem, found).items() if name != TRIGGER]
    if not extra:
        return found
    return replace(found, covariance=found.covariance + sum(np.outer(one, one) for one in extra))


def knows_airflow(problem: Problem, found: Fit) -> bool:
    """Whether the model's readings change with the airflow."""
    perturbed, step = PERTURBED_INPUTS["airflow_percent"]
    there = found.model.on(perturbed(problem.channel, step)).predict(found.point)
    return bool(np.abs(there - found.model.predict(found.point)).max() > NO_CHANGE_SIGMAS)


def airflow_exponent(found: Fit) -> float:
    """With what power of the airflow an effective rate may go: root mean square, after what the runs say of it."""
    own, air = found.own_rates(), found.model.channel.conditions
    known = air.airflow_known & (air.airflow_m_s > 0)
    log_airflow = np.log(np.where(known, air.airflow_m_s, 1.0))
    weight = np.where(known, 1.0 / (own.spread**2 + found.rate_scatter**2), 0.0)
    squares = product = 0.0
    for g in np.unique(own.ambient):
        w = np.where(own.ambient == g, weight, 0.0)
        if w.sum() <= 0:
            continue
        x = log_airflow - (w * log_airflow).sum() / w.sum()
        squares += float((w * x**2).sum())
        product += float((w * x * own.own).sum())
    variance = 1.0 / (squares + 1.0 / LARGEST_EXPONENT**2)
    return float(np.sqrt((variance * product) ** 2 + variance))


def temperature_slopes(found: Fit) -> Array:
    """d ln rate / dT at each ambient (G,) [1/K]."""
    ambients = found.model.channel.ambients_c
    if ambients.size < 2:
        return np.full(ambients.size, USUAL_SLOPE_PER_K)
    return np.asarray(np.gradient(found.log_rates, ambients))
