"""One channel's diagnosis made ready to be shown: the models to compare, held-out residuals, and the plots of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shockrig.analysis.characterize.result import ChannelResult
from shockrig.analysis.diagnose.diagnosed import ChannelDiagnosis
from shockrig.analysis.diagnose.extended_profile import extended_result, plain_result
from shockrig.analysis.diagnose.gain import HeldOut
from shockrig.analysis.diagnose.thresholds import level
from shockrig.analysis.estimate.seen import little_known, seen
from shockrig.analysis.report import fit_figures as drawings
from shockrig.analysis.report.diagnosis_words import label, listed, named, sensor_of
from shockrig.analysis.report.fit_figures import parameter_by_condition
from shockrig.analysis.report.fitted import UNIT, conditions, relative_runs
from shockrig.analysis.report.next_time import seen_figure
from shockrig.analysis.report.panels import log_time, panels
from shockrig.analysis.report.remaining import MeanCourse, Remaining, autocorrelation, remaining
from shockrig.files.figures import BLUE, CYCLE, GREY, save_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.figure import Figure as Drawing

# The picture of what is left without any form: its course over the step by condition, and its relaxation times.

BAND_SIGMAS = 2.0
SIZE_IN = (8.4, 3.3)


def parted_by(left: Remaining, seen_elsewhere: Sequence[str]) -> str:
    """What parts the course, in words. Conditions that tests of every reading see it vary with, and those that what is
    described depends on, are not denied: these see more than the course of a few runs does."""
    varies = f"It varies with {listed(left.varies_with)}." if left.varies_with else "No condition parts this course."
    unseen = [name for name in left.does_not_vary_with if not any(name in one for one in seen_elsewhere)]
    return f"{varies} It is not seen to vary with {listed(unseen, 'or')}." if unseen else varies


@styled
def remaining_figure(left: Remaining) -> Figure:
    """Left: the course as percent of the step, with a band of two standard uncertainties. Right: the spectrum."""
    figure, ((course, spectrum),) = panels((1, 2), SIZE_IN, across_in=0.86)
    course.axhline(0.0, color=GREY, linewidth=0.8)
    for colour, one in zip(CYCLE if left.varies_with else (BLUE,), left.courses, strict=False):
        _draw_relaxation(course, one, colour)
    course.set_ylabel("left, % of the step")
    course.set_xlabel("time since the transfer / s")
    course.set_title(f"what is left, by {left.varies_with[0]}" if left.varies_with else "what is left, all runs")
    course.legend(loc="best")
    taus, size = left.time_constants_s, 100.0 * left.amplitude
    spectrum.axhline(0.0, color=GREY, linewidth=0.8)
    band = BAND_SIGMAS * 100.0 * left.uncertainty
    spectrum.fill_between(taus, size - band, size + band, color=BLUE, alpha=0.25, linewidth=0)
    spectrum.plot(taus, size, color=BLUE)
    spectrum.set_ylabel("amplitude, % of the step")
    spectrum.set_xlabel("relaxation time / s")
    spectrum.set_title("its relaxation times, all runs")
    log_time([course], [one.time_s for one in left.courses])
    log_time([spectrum], [taus])
    return figure


def _draw_relaxation(axes: Axes, one: MeanCourse, colour: str) -> None:
    mean, band = 100.0 * one.mean, BAND_SIGMAS * 100.0 * one.uncertainty
    axes.fill_between(one.time_s, mean - band, mean + band, color=colour, alpha=0.2, linewidth=0)
    axes.plot(one.time_s, mean, color=colour, label=f"{one.condition} ({one.runs})")


MOST_CANDIDATES = 8  # that are drawn beside those of the model


@dataclass(frozen=True)
class Compared:
    """One channel's diagnosis, and the channel as a characterization without and with the causes found."""

    found: ChannelDiagnosis
    plain: ChannelResult | None
    extended: ChannelResult | None


@dataclass(frozen=True)
class ChannelView(Compared):
    """One channel's diagnosis with all that the page shows of it; `figures` are name -> (file, caption, alt)."""

    figures: Mapping[str, tuple[Path, str, str]]


def compare(found: ChannelDiagnosis) -> Compared:
    """Fit what a diagnosis is compared by."""
    return Compared(found, plain_result(found), extended_result(found))


def look_at(compared: Compared, folder: Path) -> ChannelView:
    """Draw the channel's plots into `folder`."""
    found, before, after = compared.found, compared.plain, compared.extended
    figures = {}
    for name, (drawing, caption, alt) in _draw(found, before, after).items():
        figures[name] = (save_figure(drawing, folder, f"{found.name}_{name}"), caption, alt)
    return ChannelView(found, before, after, figures)


Figures = dict[str, tuple["Drawing", str, str]]  # name -> (figure, caption, alt)


def _draw(found: ChannelDiagnosis, before: ChannelResult | None, after: ChannelResult | None) -> Figures:
    figures = _of_what_is_seen(found)
    if found.gain.measured:
        figures |= _of_held_out(found, found.gain.held)
    figures |= _of_single_runs(found, before, after)
    scores = _evidence(found)
    if scores:
        names, values, kept = zip(*scores, strict=True)
        figures["causes"] = (
            drawings.cause_bars(names, values, kept, level("effect"), "nats on unseen runs"),
            "Filled: by how much unseen runs are predicted worse without the effect, nothing in its place. Open: "
            "by how much better with another one in the model that is stated. The line is what is held against any "
            "effect before the data; effects with a range to search, and forms, need more.",
            f"What unseen runs say of the effects in the {sensor_of(found)}, and of the other candidates",
        )
    return figures


def _of_what_is_seen(found: ChannelDiagnosis) -> Figures:
    """The readings' own way where little else is known, and what the plain model leaves of them."""
    channel, sensor, figures = found.problem.channel, sensor_of(found), {}
    steps = seen(channel) if little_known(channel) else ()
    if any(one.times_s is not None for one in steps):
        figures["seen"] = (
            seen_figure(channel, steps),
            "Readings over the way that they went, since the change is seen to begin. Circles: 63 % and 90 % of it.",
            f"Readings of the {sensor} as shares of their way, with the times to 63 % and 90 %",
        )
    described = [named(on.factor) for one in found.discovered for on in one.depends_on]
    left = remaining(channel, found.plain) if found.verdict in ("unexplained", "described") else None
    if left is not None:
        figures["remaining"] = (
            remaining_figure(left),
            "What the plain model leaves, as a share of each run's step, with two standard "
            "uncertainties (number of runs in brackets), and its spectrum of relaxation times. "
            + parted_by(left, [*found.remainder.varies_with, *described]),
            f"What is left in the readings of the {sensor}, and its relaxation times",
        )
    return figures


def _of_held_out(found: ChannelDiagnosis, held: HeldOut) -> Figures:
    """Residuals of runs under models that were fitted without them."""
    unit, noise, sensor, figures = UNIT[found.name], found.noise.standard_deviation, sensor_of(found), {}
    extended, period = bool(found.final.structure.effects), found.problem.channel.sampling_period_s
    lags = {"plain model": autocorrelation(held, held.before, period)}
    if extended:
        both = zip(held.run_ids, held.time_s, held.before, held.after, strict=True)
        figures["before_after"] = (
            drawings.before_after(
                [drawings.BeforeAfter(*run) for run in both], unit, noise, (found.gain.before, found.gain.after)
            ),
            "Each run under models that were fitted without it: the plain one, and the one with the causes found, or "
            "as much of it as the other runs bear out. Means in log time; grey: two standard deviations of one "
            "reading's noise.",
            f"Held-out residuals of the {sensor} before and after the model was extended",
        )
    figures["residuals"] = (
        _overview(found, held, held.before),
        "Residuals of the plain model on runs that it was not fitted to, coloured by what the runs were. A pattern "
        "that goes with a colour says what the missing effect depends on.",
        f"Held-out residuals of the plain model of the {sensor} by condition",
    )
    if extended:
        figures["residuals_extended"] = (
            _overview(found, held, held.after),
            "The same under the extended model.",
            f"Held-out residuals of the extended model of the {sensor} by condition",
        )
        lags["extended model"] = autocorrelation(held, held.after, period)
    own = found.noise.autocovariance(len(lags["plain model"][0]) + 1)
    lags["noise of the plateaus"] = (own[1:] / own[0], lags["plain model"][1])
    figures["autocorrelation"] = (
        drawings.autocorrelation(lags, period),
        "Autocorrelation of the held-out residuals after the transfer, beside that of the noise as estimated from "
        "the plateaus. A model that leaves nothing leaves the noise.",
        f"Autocorrelation of the residuals of the {sensor}",
    )
    return figures


def _of_single_runs(found: ChannelDiagnosis, before: ChannelResult | None, after: ChannelResult | None) -> Figures:
    """The material's number of each run alone under either model, by what the runs were."""
    channel = found.problem.channel
    letter, figures, whose = channel.rate_name, {}, "sensor" if channel.lumped else "material"
    for name, result, words in (("by_condition", before, "plain"), ("by_condition_extended", after, "extended")):
        if result is None or (result is after and not found.causes):
            continue
        runs = relative_runs(result)
        if len(runs) > 2:
            figures[name] = (
                parameter_by_condition(runs, f"{letter}, run / joint", "", (1.0, 0.0), UNIT[found.name]),
                f"{letter} of each run alone under the {words} model, as a ratio to the joint fit, with two standard "
                f"uncertainties. It is a property of the {whose}: it should not move with airflow, direction or step.",
                f"{letter} of single runs of the {sensor_of(found)} by condition, {words} model",
            )
    return figures


def _overview(found: ChannelDiagnosis, held: HeldOut, residuals: Sequence[np.ndarray]) -> Drawing:
    channel = found.problem.channel
    runs = []
    for i, run, time, residual in zip(held.runs, held.run_ids, held.time_s, residuals, strict=True):
        direction, ambient_c, airflow, amplitude = conditions(channel, i)
        # A step within the references' uncertainty is none.
        runs.append(drawings.ResidualRun(run, time, residual, direction, ambient_c, airflow, round(amplitude, 1)))
    return drawings.residual_overview(runs, UNIT[found.name], found.noise.standard_deviation)


def _evidence(found: ChannelDiagnosis) -> list[tuple[str, float, bool]]:
    """(words, nats, kept) of the effects in the model that is stated and of the candidates that come next."""
    search, told = found.search, list[tuple[str, float, bool]]()
    for effect in sorted(search.best.ids - search.plain.ids):
        parts = [one.score.total for one in search.pool if one.ids <= search.best.ids - {effect}]
        told.append((label(effect), search.best.score.total - max(parts, default=search.plain.score.total), True))
    more = [one for one in search.pool if one.ids > search.best.ids and len(one.ids - search.best.ids) == 1]
    for one in sorted(more, key=lambda one: -one.score.total)[:MOST_CANDIDATES]:
        (effect,) = one.ids - search.best.ids
        if (gained := one.score.total - search.best.score.total) > 0.0:
            told.append((label(effect), gained, False))
    return told
