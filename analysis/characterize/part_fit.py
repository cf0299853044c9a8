"""Runs fitted together: two searches for each ambient's rate, then one joint fit from the better one, and its rows.

`characterize --extend DIAGNOSIS.json` fits a model with a diagnosis's causes in it (`Extension`), not the plain one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.characterize.response_times import response_time
from shockrig.analysis.characterize.result import FAR_DEVIATED, Part, TableRow
from shockrig.analysis.characterize.shifts import widened
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.described import entry_of, stated_values, with_values
from shockrig.analysis.effects.forms import MEAN
from shockrig.analysis.estimate.channel import Channel, LeftOut
from shockrig.analysis.estimate.coarse_codes import with_errors_of_codes
from shockrig.analysis.estimate.drifting import where_airs_drift
from shockrig.analysis.estimate.fit import Fit, fit, rmse_over_samples
from shockrig.analysis.estimate.fit_starts import (
    RATE_BOUNDS_PER_S,
    Misfit,
    Optimum,
    better,
    descend,
    descended_point,
    evolve,
    rough_point,
    unstuck,
)
from shockrig.analysis.estimate.model import PLAIN, Held, Model, Point, Structure
from shockrig.analysis.estimate.noise import Noise, whiteners
from shockrig.analysis.estimate.predictive import as_stated, bumps, score
from shockrig.analysis.estimate.problem import UNVENTILATED_LIMIT, Problem, make_problem
from shockrig.analysis.estimate.quantity import QUANTITIES, ChannelName, RunEffect
from shockrig.analysis.estimate.refitting import labelled
from shockrig.analysis.estimate.seen import by_themselves, crossings
from shockrig.files.causes import StatedEffect
from shockrig.files.diagnosis import read_diagnosis
from shockrig.files.diagnosis_data import Discovered
from shockrig.files.numbers import counted, plain
from shockrig.files.profile import ResponseTime, Uncertain


@dataclass(frozen=True)
class Extension:
    """Extended model of one channel: its structure, starts by "effect.parameter", the causes as they were named, and
    the effects that nobody listed as they were described."""

    structure: Structure = PLAIN
    starts: Mapping[str, float] | None = None
    causes: tuple[StatedEffect, ...] = ()
    discovered: tuple[Discovered, ...] = ()


def read_extension(path: str | Path) -> dict[ChannelName, Extension]:
    """Extended models of the channels that a diagnosis holds.

    Raises
    ------
    InputError
        Where the file is no diagnosis or names what the catalogue does not know: names file, key and remedy.
    """
    stated = read_diagnosis(path, {name: effect.channels for name, effect in CATALOGUE.items()})
    return {
        name: extension_of(
            [cause.as_effect() for cause in stated.channels[name].causes], stated.channels[name].discovered, name
        )
        for name in QUANTITIES
        if name in stated.channels
    }


def extension_of(
    causes: Sequence[StatedEffect], discovered: Sequence[Discovered] = (), channel: ChannelName = "temperature"
) -> Extension:
    """The model that carries `causes`, and what was described beside them in `channel`; what single readings show
    (rounding, repeats, averages) is held, not fitted."""
    causes = tuple({cause.effect: cause for cause in causes}.values())
    held: list[Held] = []
    starts: dict[str, float] = {}
    for cause in causes:
        entry = CATALOGUE[cause.effect]
        for parameter in entry.parameters:
            if parameter.name in cause.parameters:
                value = float(min(max(cause.parameters[parameter.name].value, parameter.low), parameter.high))
            else:
                value = parameter.starts[0]
            if entry.fitted:
                starts[f"{cause.effect}.{parameter.name}"] = value
            else:
                held.append(Held(cause.effect, parameter.name, value))
    entries = [CATALOGUE[c.effect] for c in causes]
    carried = []
    for one in discovered:
        described = entry_of(one, channel)
        if described is None:
            continue
        values = stated_values(one)
        for parameter in described.parameters:
            value = values[parameter.name].value if parameter.name in values else parameter.starts[0]
            value = float(min(max(value, parameter.low), parameter.high))
            if described.id == MEAN.key:
                held.append(Held(described.id, parameter.name, value))
            else:
                starts[f"{described.id}.{parameter.name}"] = value
        entries.append(described)
        carried.append(one)
    return Extension(Structure(tuple(entries), tuple(held)), starts, causes, tuple(carried))


Array = NDArray[np.float64]

# Which runs of a channel are fitted, which together, and with which models; and which are set aside, and why.
#
# A film's ambient is read from its isothermal shocks where it has at least two: in a thermal shock the film's own
# temperature lags behind the air.

STEP_IN_NOISE = 10.0
LEAST_ISOTHERMAL_RUNS = 2
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
    reasons = {int(i): f"no {quantity.followed} step ({step[i]:.2g} {quantity.unit})" for i in np.flatnonzero(~keep)}
    if not extension.structure.effects:
        reasons |= {int(i): OTHER_KIND for i in np.flatnonzero(keep & whole.conditions.elsewhere)}
    alone = np.zeros(whole.runs, dtype=bool)
    plain_film = whole.jumps_with_air and not extension.structure.effects and not whole.measured.any()
    if plain_film:
        isothermal = whole.isothermal
        for g in range(whole.ambients_c.size):
            here = keep & (whole.ambient == g)
            if (here & isothermal).sum() >= LEAST_ISOTHERMAL_RUNS:
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


Shown = Mapping[str, tuple[float, float, float]]  # what runs show by themselves, see `by_themselves`
SAME_DEVIANCE = 2.0  # a factor e in the likelihood, within which two fits are one
WORST_RELATIVE = 0.5  # a diffusivity or a response time known no better than this is none


def fit_part(
    channel: Channel,
    noise: Noise,
    models: Mapping[str, Extension],
    seed: int,
    rounding: float,
    say: Callable[[str], None],
) -> tuple[Part, list[TableRow], list[LeftOut]]:
    """Fit runs together with the model that leaves the least; rows of what is determined, runs of what is not."""
    searched = {}
    for basis, extension in models.items():
        optima, late_s = [], np.zeros(channel.runs)
        for g, ambient_c in enumerate(channel.ambients_c):
            misfit = Misfit(channel.select(channel.ambient == g), extension.structure, dict(extension.starts or {}))
            where = "" if channel.quantity.pooled else f" at {round(ambient_c)} degC"
            say(f"{channel.name}: differential evolution over {counted(misfit.channel.runs, 'run')}{where}")
            optima.append((evolve(misfit, np.random.default_rng([seed, g])), descend(misfit)))
            late_s[channel.ambient == g] = misfit.late_s(better(optima[-1]).log_rate)
        searched[basis] = optima, late_s
    basis = min(searched, key=lambda name: sum(better(both).rmse ** 2 for both in searched[name][0]))
    extension, (optima, late_s) = models[basis], searched[basis]
    say(f"{channel.name}: generalised least squares over {counted(channel.runs, 'run')}")
    problem = make_problem(channel, whiteners(channel, noise), rounding=rounding)
    log_rates = np.array([better(both).log_rate for both in optima])
    start = Model(channel, extension.structure).start(log_rates, dict(extension.starts or {}))
    deviations = channel.at_rest()
    deviations[:, RunEffect.START] = late_s
    found = unstuck(problem, fit(problem, extension.structure, start, deviations))
    # Neither optimiser moves effects or airs; nobody knows where those are that were not recorded.
    if start.size > channel.rates or not channel.conditions.airs_known.all():
        again = descended_point(problem, extension.structure)
        second = unstuck(problem, fit(problem, extension.structure, again.theta, again.deviations))
        found = second if second.deviance < found.deviance - SAME_DEVIANCE else found
    part = _ended(problem, found, noise)
    rows, undetermined = joint_rows(part, noise, basis, optima)
    return part, rows, undetermined


def _ended(problem: Problem, found: Fit, noise: Noise) -> Part:
    """A fit as it is stated: with errors of a coarse rounding as they come about its signal, in airs that drift where
    these explain the runs."""
    if noise.step:
        problem, _ = with_errors_of_codes(problem, noise, found)
        found = unstuck(problem, fit(problem, found.structure, found.theta, found.deviations))
    problem, found = where_airs_drift(problem, found)
    return make_part(problem, labelled(problem, found), noise)


def make_part(problem: Problem, found: Fit, noise: Noise) -> Part:
    """A fit with its RMSE, as uncertain as what else may be off in all runs alike makes it, and, where it misfits, what
    its model is wrong by."""
    if Part(problem, found, rmse_over_samples(problem.channel, found)).misfits(noise):
        bump = bumps(problem)
        found = as_stated(problem, found, bump, score(problem, found, bump).discrepancy, than_runs=True)
    return Part(problem, widened(problem, found), rmse_over_samples(problem.channel, found))


def fit_parts(
    whole: Channel,
    noise: Noise,
    extension: Extension,
    seed: int = 0,
    rounding: float = 0.0,
    say: Callable[[str], None] = lambda _: None,
    quickly: bool = True,
) -> tuple[list[Part], list[TableRow], list[LeftOut]]:
    """Fits of all runs that determine anything, those together that may be; their rows, and runs set aside."""
    groups, set_aside = choose_runs(whole, noise, extension)
    parts: list[Part] = []
    rows: list[TableRow] = []
    for channel, models in groups:
        fitted = quick_part if quickly else fit_part
        part, found, undetermined = fitted(channel, noise, models, seed, rounding, say)
        known = [row for row in found if row.standard_uncertainty < row.diffusivity_m2_s]
        rows += known
        set_aside += undetermined
        if len(known) < len(found):
            reason = _misfits(channel, by_themselves(channel))
            set_aside += [LeftOut(run, whole.name, reason) for row in found if row not in known for run in row.runs]
        if known:
            parts.append(part)
    return parts, rows, set_aside


def quick_part(
    channel: Channel,
    noise: Noise,
    models: Mapping[str, Extension],
    seed: int,
    rounding: float,
    say: Callable[[str], None],
) -> tuple[Part, list[TableRow], list[LeftOut]]:
    """As `fit_part`, from a rough scan of the rates in place of the two optimisers."""
    problem = make_problem(channel, whiteners(channel, noise), rounding=rounding)
    parts = {}
    for basis, extension in models.items():
        point = rough_point(problem, extension.structure, extension.starts)
        theta = Model(channel, extension.structure).start(point.theta[: channel.rates], dict(extension.starts or {}))
        found = unstuck(problem, fit(problem, extension.structure, theta, point.deviations))
        parts[basis] = _ended(problem, found, noise)
    basis = min(parts, key=lambda name: parts[name].rmse)
    rows, undetermined = joint_rows(parts[basis], noise, basis)
    return parts[basis], rows, undetermined


def joint_rows(
    part: Part, noise: Noise, basis: str, optima: Sequence[tuple[Optimum | None, Optimum | None]] | None = None
) -> tuple[list[TableRow], list[LeftOut]]:
    """Rows of the ambients whose diffusivity a joint fit determines, and the runs of those that it does not.

    Rows of a model that does not explain its runs are as uncertain as these by themselves are far from it: where a
    model is wrong alike in all runs, no run that others predict tells by how much. Far is how far apart the rates are
    that single runs have, or each of the model's times from the one that readings show by no model, whichever is more.

    `optima` are each ambient's findings of the two optimisers, where they were asked.
    """
    channel, found = part.channel, part.fit
    most = min(FAR_DEVIATED * part.problem.rate_scatter_limit, UNVENTILATED_LIMIT)
    scattered, missed = found.deviations[:, RunEffect.RATE].std() > most, not part.explained(noise)
    looked_at = scattered or missed
    apart = _apart(part) if looked_at else np.zeros(channel.ambients_c.size)
    shown = by_themselves(channel) if looked_at else {}
    modelled = _modelled(part) if missed else {}
    rows: list[TableRow] = []
    undetermined: list[LeftOut] = []
    for g, (first, check) in enumerate(optima or [(None, None)] * channel.ambients_c.size):
        runs = tuple(channel.run_ids[i] for i in np.flatnonzero(channel.ambient == g))
        formal = float(np.sqrt(max(found.covariance[g, g], 0.0)))
        disagree = float(apart[g]) if scattered else 0.0
        relative = float(np.hypot(formal, disagree))
        low, high = np.log(RATE_BOUNDS_PER_S)
        response = None
        # Beside another lag a body may be as fast as it likes.
        if 0.0 < relative and (low < found.theta[g] < high or found.structure.of_sensor().effects):
            response = response_time(channel, found, g)
        # With two time constants in the model either may be the body's: how fast the sensor is, is told all the same.
        if response is None or not min(relative, _relative(_wider(response, disagree))) < WORST_RELATIVE:
            reason = _undetermined(channel, float(channel.ambients_c[g]), disagree, shown, misfits=part.misfits(noise))
            undetermined += [LeftOut(run, channel.name, reason) for run in runs]
            continue
        own = {run: shown[run] for run in runs if run in shown}
        far = np.maximum(apart[g], _off(own, modelled, response)) if missed else np.full(3, disagree)
        value = float(np.exp(found.theta[g]) * channel.length_m**2)
        rows.append(
            TableRow(
                ambient_c=round(float(channel.ambients_c[g]), 3),
                diffusivity_m2_s=value,
                standard_uncertainty=value * float(np.hypot(formal, far[0])),
                response=_wider(response, far),
                runs=runs,
                basis=basis,
                evolution=first,
                check=check,
            )
        )
    return rows, undetermined


def _apart(part: Part) -> Array:
    """How far runs that a model misses are from one another in ln rate, by ambient (G,).

    Runs of a sensor that the model describes agree; where they do not, nobody knows which of them is right, and no
    number of runs makes their mean better.
    """
    found, problem = part.fit, part.problem
    held = tuple(Held(e, name, value) for e, p in found.values().items() for name, (value, _) in p.items())
    rates_alone = Structure(found.structure.effects, held)
    start = np.concatenate([found.log_rates, found.theta[Model(problem.channel, found.structure).behind]])
    own = np.empty(problem.channel.runs)
    for run, ambient in enumerate(problem.channel.ambient):
        one = problem.select(np.array([run]))
        own[run] = fit(one, rates_alone, start, found.deviations[[run]]).log_rates[ambient]
    return np.array([own[problem.channel.ambient == g].std() for g in range(problem.channel.ambients_c.size)])


def _wider(response: ResponseTime, relative: Array | float) -> ResponseTime:
    """Response times less certain by what runs are apart, one for all or one for each (3,)."""
    if response.standard_uncertainties_s is None or not np.any(relative):
        return response
    times = np.array([response.t63_s, response.t90_s, response.t98_s])
    first, second, third = np.hypot(response.standard_uncertainties_s, times * relative).tolist()
    return replace(response, standard_uncertainties_s=(first, second, third))


def _modelled(part: Part) -> dict[str, tuple[float, float, float]]:
    """Times to 63 and 90 % [s] that the model's readings take since its start, each run at the common rate in the
    surroundings that it was made in, and how long its record lasts [s]; without those that followed a measured air.

    Readings count from the start that was recorded, so that a model that has it begin at another is off by that.
    """
    channel, found = part.channel, part.fit
    deviations = found.deviations.copy()
    deviations[:, [RunEffect.START, RunEffect.RATE]] = 0.0
    theta = found.theta.copy()
    theta[found.model.behind] *= [RunEffect.START not in one.moves for one in found.model.shared]
    times: dict[str, tuple[float, float, float]] = {}
    for i, reading in enumerate(found.model.predict(Point(theta, deviations))[0]):
        there = channel.count[i] > 0
        time, value = channel.time_s[i][there], reading[there]
        if channel.air[i] is None and abs(value[-1] - value[0]) > channel.quantity.least_step:
            (t63_s, t90_s), _ = crossings(time, (value - value[0]) / (value[-1] - value[0]))
            times[channel.run_ids[i]] = t63_s, t90_s, float(time[-1])
    return times


def _off(shown: Shown, modelled: Shown, response: ResponseTime) -> Array:
    """How far times to 63, 90 and 98 % (3,) are, in their logarithms, from those that runs show by no model; the last
    as the one before it.

    What a run shows is in its own surroundings, and so is what it is compared with, but where a record ends before the
    response: there the end of both is not the response's.
    """
    if not shown:
        return np.zeros(3)
    off = []
    for run, (*times_s, _) in shown.items():
        *own_s, until_s = modelled.get(run, (0.0, 0.0, 0.0))
        stated_s = own_s if until_s > response.t98_s else (response.t63_s, response.t90_s)
        off.append(np.log(np.divide(stated_s, times_s)))
    first, second = np.abs(np.median(off, axis=0))
    second = max(first, second)  # where the curves cross, a model is right by accident
    unsure = float(np.median([u for *_, u in shown.values()]))
    return np.hypot([first, second, second], unsure)


def _relative(response: ResponseTime) -> float:
    """Relative standard uncertainty of a time to 63 %."""
    return response.standard_uncertainties_s[0] / response.t63_s if response.standard_uncertainties_s else np.inf


def _undetermined(channel: Channel, ambient_c: float, apart: float, shown: Shown, *, misfits: bool) -> str:
    """Why runs give no diffusivity, and the remedy."""
    symbol = channel.quantity.symbol
    if apart > WORST_RELATIVE:
        return (
            f"the runs disagree in {symbol} by {apart:.0%}{_told(channel, shown)}; see that all are of one sensor, and "
            "run shockrig diagnose"
        )
    if misfits:
        return _misfits(channel, shown)
    if channel.quantity.pooled:
        return f"does not determine {symbol}; record more runs, or larger steps"
    return f"does not determine {symbol}, alone at {round(ambient_c)} degC; record isothermal shocks there"


def _misfits(channel: Channel, shown: Shown) -> str:
    return (
        f"the plain model ({channel.body}) fits too badly to give {channel.quantity.symbol}{_told(channel, shown)}; "
        "run shockrig diagnose, which tries other bodies, or state another body in campaign.json"
    )


def _told(channel: Channel, shown: Shown) -> str:
    """What runs show by no model, in words; empty where they show nothing."""
    times_s = sorted(t63_s for t63_s, _, unsure in shown.values() if not unsure)
    if not times_s:
        return ""
    ends = dict.fromkeys(plain(times_s[i], 2) for i in (0, -1))
    what = "they follow the measured air by" if channel.measured.all() else "63 % of the way takes"
    return f" (seen in the readings, {what} {' to '.join(ends)} s)"


def fitted_effects(extension: Extension, part: Part) -> tuple[StatedEffect, ...]:
    """The extension's causes with the parameters of a fit."""
    values = part.fit.values()
    fitted = []
    for cause in extension.causes:
        parameters = dict(cause.parameters)
        for name, (value, spread) in values[cause.effect].items():
            # What the single readings showed is held in this fit and keeps the uncertainty it came with.
            parameters[name] = Uncertain(value, spread) if spread > 0 or name not in parameters else parameters[name]
        fitted.append(replace(cause, parameters=parameters))
    return tuple(fitted)


def fitted_discovered(extension: Extension, part: Part) -> tuple[Discovered, ...]:
    """The extension's described effects with the numbers of a fit."""
    fitted = []
    for one in extension.discovered:
        entry = entry_of(one, part.channel.name)
        if entry is not None:
            fitted.append(with_values(one, entry, part.fit.values_of(entry)))
    return tuple(fitted)
