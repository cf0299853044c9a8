"""The page and plots of `shockrig diagnose`: the sentence first, then what is left, why, what it gains, what to do."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.diagnose.diagnosed import ChannelDiagnosis, Diagnosis, correlations
from shockrig.analysis.diagnose.thresholds import level
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.described import entry_of
from shockrig.analysis.estimate.channel import FIRST_LOG_BIN_S, LeftOut
from shockrig.analysis.estimate.quantity import QUANTITIES
from shockrig.analysis.report import diagnosis_words
from shockrig.analysis.report.characterize_page import input_section
from shockrig.analysis.report.crossing import Crossing, crossing_figure
from shockrig.analysis.report.diagnosis_view import ChannelView
from shockrig.analysis.report.diagnosis_words import (
    NOT_TOLD,
    channel_verdict,
    experiments,
    has_hygrometer,
    headline,
    label,
    listed,
    missing,
    named,
    ordered,
    predicting_sentence,
    remainder_sentence,
    removed,
    sensor_of,
    values_text,
    wandering,
    worse,
)
from shockrig.analysis.report.fitted import UNIT, drifts, rate_label, rate_text, relative_runs
from shockrig.analysis.report.html import (
    Block,
    Cell,
    Details,
    Equation,
    Figure,
    HtmlPage,
    KeyNumber,
    Section,
    Table,
    Text,
    Tone,
)
from shockrig.analysis.report.loop_page import chosen_section
from shockrig.analysis.report.next_time import next_time, seen_sentence
from shockrig.analysis.report.remaining import autocorrelation, size
from shockrig.files.figures import save_figure
from shockrig.files.headline import time_text
from shockrig.files.numbers import plain

# What data sheets of the HYT family promise (IST AHHYTM E2.2.1); a bead is calibrated to about the same.
ACCURACY = {"temperature": 0.2, "humidity": 1.8}
STRONG_CORRELATION = 0.5  # correlation of two parameters from which on it is worth a word
MOST_MODELS, FEWEST_MODELS = 12, 4  # in the table of what was weighed
LEAST_WEIGHT = 0.001  # of a model in that table, beyond the fewest


def write_diagnosis(
    diagnosis: Diagnosis,
    views: Sequence[ChannelView],
    crossings: Sequence[Crossing],
    notes: Sequence[str],
    left_out: Sequence[LeftOut],
    folder: Path,
    provenance: Mapping[str, Cell],
    decisions: Sequence[Mapping[str, Any]] = (),
) -> Path:
    """Write FOLDER/report.html (and the plots of crossing and decisions); returns the page's path.

    `decisions` is the campaign's log of them.
    """
    sections = input_section(diagnosis.input_findings)
    for view in views:
        sections.append(Section(f"{sensor_of(view.found).capitalize()}: {view.found.verdict}", _channel(view)))
    sections.append(Section(f"What it means for {_numbers(views)}", _material(views)))
    sections.append(Section("What it means in flight", _flight(crossings, notes, folder)))
    sections.append(Section("What to do on the bench", _advice(views)))
    sections.append(Section("What to measure next", _next(diagnosis)))
    sections += chosen_section(decisions, folder)
    sections.append(Section("What was left out, and why", _left_out(diagnosis, left_out)))
    verdicts = {c.verdict for c in diagnosis.channels}
    tied = any(cause.indistinguishable_from for c in diagnosis.channels for cause in c.causes)
    doubt = tied or diagnosis.missing or "described" in verdicts
    tone: Tone = "bad" if "unexplained" in verdicts else "warning" if doubt else "good"
    report = HtmlPage(
        title=f"Diagnosis of {diagnosis.campaign}",
        verdict=headline(diagnosis),
        key_numbers=_key_numbers(views, crossings),
        sections=sections,
        provenance=provenance,
        tone=tone,
    )
    return report.write(folder / "report.html")


def _key_numbers(views: Sequence[ChannelView], crossings: Sequence[Crossing]) -> list[KeyNumber]:
    numbers = []
    for view in views:
        gain, unit = view.found.gain, UNIT[view.found.name]
        if not gain.measured:
            label = f"error on unseen runs, {sensor_of(view.found)}"
            numbers.append(KeyNumber(label, "not measured", "no run was left to try a model on"))
            continue
        arrow = f" → {plain(gain.after, 2)}" if view.found.causes or view.found.discovered else ""
        numbers.append(
            KeyNumber(
                f"error on unseen runs, {sensor_of(view.found)}",
                f"{plain(gain.before, 2)}{arrow} {unit}",
                f"noise {plain(gain.noise_floor, 2)} {unit}",
            )
        )
        if view.found.causes or view.found.discovered:
            share, interval = removed(gain)
            numbers.append(
                KeyNumber(
                    f"of the explainable error removed, {sensor_of(view.found)}",
                    share,
                    interval if interval in ("", NOT_TOLD) else f"95 % interval {interval}",
                )
            )
    numbers += [
        KeyNumber(
            f"crossing an inversion, {c.channel}",
            f"{plain(c.rms_plain, 2)} → {plain(c.rms_extended, 2)} {UNIT[c.channel]}",
            f"rms error corrected, plain → extended profile; uncorrected {plain(c.rms_reading, 2)} {UNIT[c.channel]}",
        )
        for c in crossings
        if any(view.found.name == c.channel and view.found.final.structure.effects for view in views)
    ]
    return numbers


def _channel(view: ChannelView) -> list[Block]:
    found = view.found
    blocks: list[Block] = []

    def figure(name: str) -> list[Figure]:
        return [Figure(*view.figures[name])] if name in view.figures else []

    if sentence := seen_sentence(found.problem.channel):
        blocks += [Text(sentence), *figure("seen")]
    blocks.append(Text(channel_verdict(found), "bad" if found.verdict == "unexplained" else "good"))
    blocks += figure("remaining")
    blocks.append(Text(remainder_sentence(found)))
    if sentence := predicting_sentence(found):
        blocks.append(Text(sentence))
    if found.causes:
        blocks.append(_causes_table(found))
    if found.discovered:
        blocks.append(_described_table(found))
    if found.cannot_tell:
        blocks.append(Text("What these runs cannot tell: " + " ".join(found.cannot_tell), "warning"))
    if found.tried:
        rows = [[named(effect), why] for effect, why in found.tried.items()]
        caption = f"What was tried, helps the fit, and is not named: a name takes a probability of {level('named'):g}"
        blocks.append(Table(("effect", "why not"), rows, caption))
    blocks += figure("before_after")
    if found.gain.measured:
        blocks.append(Text(_size_words(view)))
    blocks += figure("residuals")
    extended = figure("residuals_extended")
    if extended:
        blocks.append(Details("The same under the extended model", extended))
    if found.gain.measured:
        blocks += [Text(_noise_words(view)), *figure("autocorrelation")]
    blocks += [Text(_drift_words(view)), *figure("by_condition")]
    extended = figure("by_condition_extended")
    if extended:
        blocks.append(Details("The same under the extended model", extended))
    blocks += _rivals(view, figure("causes"))
    blocks += _equations(found)
    blocks.append(Details("Every test of what is left", [_tests(found)]))
    if found.untestable:
        rows = [[named(e), needs.words] for e in found.untestable if (needs := CATALOGUE[e].needs) is not None]
        blocks.append(Table(("effect", "why"), rows, "Effects that this campaign cannot show, and so says nothing of"))
    return blocks


def _causes_table(found: ChannelDiagnosis) -> Table:
    rows = []
    for cause in ordered(found.causes):
        effect = CATALOGUE[cause.effect]
        own = effect.of_sensor and not effect.of_surroundings
        rows.append(
            [
                named(cause.effect),
                values_text(found.name, cause) or "no parameter",
                f"{100 * cause.probability:.1f} %",
                effect.link + (", the sensor's" if own else ", the bench's"),
                listed([named(e) for e in cause.indistinguishable_from], "or") or "–",
            ]
        )
    columns = ("cause", "parameters ± standard uncertainty", "probability", "link of the chain", "could as well be")
    return Table(columns, rows)


def _described_table(found: ChannelDiagnosis) -> Table:
    rows: list[list[Cell]] = []
    for one in found.discovered:
        effect = entry_of(one, found.name)
        rows.append(
            [
                diagnosis_words.behaves(one),
                "" if effect is None else effect.equation,
                f"{100 * (one.probability or 0.0):.0f} %",
                diagnosis_words.seen_over(one),
                diagnosis_words.flies(one, found.name),
            ]
        )
    columns = ("behaves as", "equation", "probability", "seen over", "in flight")
    return Table(columns, rows, "Effects that nobody listed, described by how they behave")


def _size_words(view: ChannelView) -> str:
    found, unit = view.found, UNIT[view.found.name]
    noise, accuracy = found.noise.standard_deviation, ACCURACY[found.name]

    def words(model: str, residuals: tuple[NDArray[np.float64], ...]) -> str:
        s = size(view.found.gain.held, residuals)
        return (
            f"From {FIRST_LOG_BIN_S} s after the transfer on, the {model} model misses runs that it was not fitted to "
            f"by {plain(s.rms, 2)} {unit} rms: {plain(s.rms / noise, 2)} times the noise, "
            f"{plain(s.rms / accuracy, 2)} times the sensor's stated accuracy of ±{plain(accuracy, 2)} {unit}. "
            f"It is farthest off, by {plain(s.peak, 2)} {unit}, "
            f"{plain(s.peak_time_s, 2)} s after the transfer of run {s.peak_run}."
        )

    text = words("plain", view.found.gain.held.before)
    if found.final.structure.effects:
        text += "\n\n" + words("extended", view.found.gain.held.after)
    return text


def _noise_words(view: ChannelView) -> str:
    found, unit = view.found, UNIT[view.found.name]
    period = found.problem.channel.sampling_period_s
    noise = found.noise
    share = float(noise.autocovariance(2)[1] / noise.autocovariance(1)[0])
    text = (
        f"One reading's noise is {plain(noise.standard_deviation, 2)} {unit}, estimated from the plateaus before any "
        f"model; from one reading to the next it is correlated by {_coefficient(share)}. "
    )
    before = float(autocorrelation(view.found.gain.held, view.found.gain.held.before, period, 1)[0][0])
    text += f"What the plain model leaves is correlated by {_coefficient(before)}"
    if found.final.structure.effects:
        after = float(autocorrelation(view.found.gain.held, view.found.gain.held.after, period, 1)[0][0])
        text += f", what the extended model leaves by {_coefficient(after)}"
    verdict = found.plain_adequacy.passed
    text += (
        ". To the model-free tests the plain model leaves nothing but noise"
        if verdict
        else ". To the model-free tests what the plain model leaves is more than noise "
        f"(p {_chance(found.plain_adequacy.p)})"
    )
    if not verdict and found.final.structure.effects:
        left = "nothing but noise" if found.adequacy.passed else "still something"
        text += f"; the extended model leaves {left} (p {_chance(found.adequacy.p)})"
    return text + "."


def _coefficient(value: float) -> str:
    return f"{value + 0.0:.2f}".replace("-0.00", "0.00").replace("-", "−")


def _signed(value: float) -> str:
    text = f"{value:+.{1 if abs(value) >= 10 else 2}f}".replace("-", "−")
    return text if any(digit in text for digit in "123456789") else "0"


def _chance(p: float) -> str:
    return f"= {plain(p, 1)}" if p > 1e-12 else "below 10⁻¹²"


def _drift_words(view: ChannelView) -> str:
    channel = view.found.problem.channel
    letter = f"the {channel.rate_name}" if channel.lumped else channel.rate_name
    sentences = []
    sides = (("plain", view.plain), ("extended", view.extended if view.found.causes else None))
    for words, result in sides:
        if result is None:
            continue
        told = drifts(relative_runs(result), result)
        moving = [
            f"with {d.condition} ({_signed(100 * d.change)} % across the campaign, {abs(d.sigmas):.0f} σ)"
            for d in told
            if d.moves
        ]
        still = [d.condition for d in told if not d.moves]
        model = f"Under the {words} model {letter}, fitted run by run,"
        if moving:
            sentences.append(f"{model} moves with what it should not depend on: {listed(moving)}.")
        elif told:
            sentences.append(f"{model} does not move with {listed(still, 'or')}.")
        else:
            sentences.append(f"{model} cannot be set against single conditions: too few of them vary on their own.")
    return " ".join(sentences)


def _rivals(view: ChannelView, figure: list[Figure]) -> list[Block]:
    search, carried = view.found.search, view.found.predicting.model
    rows: list[list[Cell]] = []
    shown = list(zip(search.pool, search.weights, strict=True))[:MOST_MODELS]
    shown = [pair for i, pair in enumerate(shown) if pair[1] >= LEAST_WEIGHT or i < FEWEST_MODELS]
    for one, weight in [*shown, *([] if search.may_state(carried) else [(carried, 0.0)])]:
        effects = " + ".join(label(e) for e in sorted(one.ids - search.plain.ids)) or "the plain model"
        little = f"below {plain(100 * LEAST_WEIGHT, 1)} %" if search.may_state(one) else "none: too open"
        share = f"{100 * weight:.1f} %" if weight >= LEAST_WEIGHT else little
        behind = search.best.score.total - one.score.total
        said = "stated" if one is search.best else worse(behind)
        said += ", in the profile" if one is carried is not search.best else ""
        numbers = [_signed(-behind), _signed(one.log_prior - search.best.log_prior)]
        rows.append([effects, share, said, *numbers, f"{plain(100 * one.score.discrepancy, 2)} %"])
    columns = ("model", "weight", "on unseen runs", "score, nats", "prior, nats", "discrepancy")
    caption = (
        "Models by their weight. The score is the log predictive density of runs that the model was not fitted to, "
        "less that of the model stated. The prior is the logarithm of its prior probability, less that of the model "
        "stated. The weight follows from both, averaged over a bootstrap of the runs. The discrepancy is the error "
        "that the model has to allow itself in order to predict best, in percent of a step. A model that gains in few "
        "runs alone has less weight than its score suggests: each run is missing in a third of the draws."
    )
    return [Table(columns, rows, caption), *figure]


def _equations(found: ChannelDiagnosis) -> list[Block]:
    blocks: list[Block] = []
    for cause in ordered(found.causes):
        effect = CATALOGUE[cause.effect]
        blocks += [
            Text(f"{named(cause.effect).capitalize()}: added to the {effect.link} link of the chain."),
            Equation(effect.equation),
            Text(f"Source: {effect.source}."),
        ]
    names, matrix = correlations(found)
    pairs = [
        (abs(matrix[i, j]), f"{names[i]} and {names[j]}", float(matrix[i, j]))
        for i in range(len(names))
        for j in range(i)
        if abs(matrix[i, j]) >= STRONG_CORRELATION
    ]
    for one in found.discovered:
        if (entry := entry_of(one, found.name)) is not None:
            blocks += [
                Text(f"Described: added to the {entry.link} link of the chain."),
                Equation(entry.equation),
                Text(f"Source: {entry.source}."),
            ]
    rows = [[words, f"{value:+.2f}".replace("-", "−")] for _, words, value in sorted(pairs, reverse=True)]
    if rows:
        pairs_said = f"{len(rows)} pair{'s' if len(rows) > 1 else ''}"
        title = f"Parameters that are correlated by {STRONG_CORRELATION} or more: {pairs_said}"
        blocks.append(Details(title, [Table(("parameters", "correlation"), rows)]))
    elif found.causes:
        blocks.append(Text(f"No two parameters are correlated by {STRONG_CORRELATION} or more."))
    return blocks


def _tests(found: ChannelDiagnosis) -> Table:
    before = {check.name: check.p for check in found.plain_adequacy.checks}
    rows = [[c.name, _p(before.get(c.name)), _p(c.p)] for c in found.adequacy.checks]
    least = plain(level("adequacy") / max(len(rows), 1), 2)
    caption = f"Probability of so much by accident. Where one is below {least}, something is left."
    return Table(("test", "p, plain model", "p, final model"), rows, caption)


def _p(p: float | None) -> str:
    return "–" if p is None else plain(p, 2) if p > 1e-12 else "< 10⁻¹²"


def _numbers(views: Sequence[ChannelView]) -> str:
    """What the channels' numbers are called."""
    symbols = {name: quantity.symbol for name, quantity in QUANTITIES.items()}
    return listed(list(dict.fromkeys("tau" if is_lag(view) else symbols[view.found.name] for view in views)))


def is_lag(view: ChannelView) -> bool:
    """Whether no more is known of the sensor than that it is one lag."""
    return view.found.problem.channel.lumped


def _material(views: Sequence[ChannelView]) -> list[Block]:
    rows: list[list[Cell]] = []
    blocks: list[Block] = []
    for view in views:
        before = {r.ambient_c: r for r in view.plain.rows} if view.plain else {}
        after = {r.ambient_c: r for r in view.extended.rows} if view.extended else {}
        for ambient in sorted(before.keys() | after.keys()):
            b, a = before.get(ambient), after.get(ambient)
            label = rate_label(view.found.problem.channel, ambient)
            ratio = b.diffusivity_m2_s / a.diffusivity_m2_s if a and b else math.nan
            change = _signed(100 * ((1 / ratio if is_lag(view) else ratio) - 1)) + " %" if a and b else "–"
            times = ["–" if r is None else time_text(r.response, 0) for r in (b, a)]
            values = ["–" if r is None else rate_text(view.found.problem.channel, r) for r in (b, a)]
            rows.append([label, *values, change, *times])
        if not (view.found.predicting.causes or view.found.predicting.discovered):
            blocks.append(
                Text(f"The {sensor_of(view.found)}'s profile has no effect: both columns are the plain model's.")
            )
        elif view.found.verdict == "unexplained":
            words = f"The {sensor_of(view.found)} is not explained: its values stay effective ones."
            blocks.append(Text(words, "warning"))
    columns = (
        "",
        "plain model, effective",
        "with the causes, the sensor's own",
        "effective off by",
        "t63 plain",
        "t63 with the sensor's effects",
    )
    return [Table(columns, rows), *blocks] if rows else [Text("No diffusivity is determined."), *blocks]


def _flight(crossings: Sequence[Crossing], notes: Sequence[str], folder: Path) -> list[Block]:
    blocks: list[Block] = [Text(" ".join(notes))] if notes else []
    if not crossings:
        return blocks or [Text("Nothing could be flown.")]
    text = (
        "An inversion of 5 K over 40 m is crossed at 5 m/s by the sensor that the extended model describes, and the "
        "flight corrected with the plain profile and with the extended one (optimal smoother): "
    )
    parts = [
        f"{c.channel}: {plain(c.rms_reading, 2)} {UNIT[c.channel]} rms uncorrected, {plain(c.rms_plain, 2)} with the "
        f"plain profile, {plain(c.rms_extended, 2)} with the extended one"
        for c in crossings
    ]
    path = save_figure(crossing_figure(crossings), folder, "inversion")
    caption = "Above: air, reading and corrections about the inversion. Below: the errors of both corrections."
    alt = "A simulated crossing of an inversion, corrected with the plain and with the extended profile"
    return [Text(text + "; ".join(parts) + "."), *blocks, Figure(path, caption, alt)]


def _advice(views: Sequence[ChannelView]) -> list[Block]:
    rows: dict[str, list[str]] = {}
    for view in views:
        for cause in ordered(view.found.causes):
            for effect in (cause.effect, *cause.indistinguishable_from):
                rows.setdefault(effect, [named(effect), CATALOGUE[effect].words.advice])
    if rows:
        return [Table(("because of", "do"), list(rows.values()))]
    if any(view.found.verdict in ("unexplained", "described") or wandering(view.found) for view in views):
        return [
            Text("No cause is named that would say what to do: look for what behaves like what is left.", "warning")
        ]
    return [Text("Nothing: the bench and the sensors do what the plain model says.")]


def _next(diagnosis: Diagnosis) -> list[Block]:
    lines = experiments(diagnosis.next_experiments, has_hygrometer(diagnosis))
    open_ = [Text(sentence) for sentence in next_time([c.problem.channel for c in diagnosis.channels])]
    if lines:
        return [Text("These runs would best tell apart what is still tied:"), *(Text(line) for line in lines), *open_]
    if open_:
        return [Text("What these runs leave open could be told from others:"), *open_]
    if any(c.verdict == "unexplained" for c in diagnosis.channels):
        text = (
            "Nothing is tied, but something is unexplained: repeat one run many times to see whether it repeats, then "
            "change one condition at a time, beginning with those that what is left varies with."
        )
        return [Text(text)]
    return [Text("Nothing: no two explanations are tied.")]


def _left_out(diagnosis: Diagnosis, entries: Sequence[LeftOut]) -> list[Block]:
    rows = [[e.run, e.channel, e.reason] for e in entries]
    blocks: list[Block] = [Text(sentence, "warning") for sentence in missing(diagnosis)]
    nothing = Text("Every run was used in what was diagnosed.")
    return [*blocks, Table(("run", "channel", "why"), rows) if rows else nothing]
