"""The sentences of a diagnosis: what a colleague would say, for the terminal, the page's head and its sections."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from shockrig.analysis.diagnosis.diagnosed import Cause, ChannelDiagnosis, Diagnosis
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.behaviours import form_of, is_step
from shockrig.analysis.effects.described import is_described
from shockrig.analysis.inference.effect import Parameter
from shockrig.analysis.inference.quantity import QUANTITIES
from shockrig.analysis.inference.seen import seen
from shockrig.analysis.report import described_words
from shockrig.analysis.report.fitted import UNIT
from shockrig.analysis.report.numbers import measured, plain

SENSOR: dict[str, str] = {name: quantity.noun for name, quantity in QUANTITIES.items()}
NOT_TOLD = "these runs do not tell how much it is on others"


def named(effect: str) -> str:
    """An effect's id as words."""
    return effect.replace("_", " ")


def label(effect: str) -> str:
    """An effect's id as words, or what a form of the grammar behaves as."""
    if not is_described(effect):
        return named(effect)
    form = form_of(effect)
    of = "" if form.driver == "none" else f" of {named(form.driver)}"
    steps = [f" from the {described_words.nth_run(how)} run on" for _, how in form.depends_on if is_step(how)]
    on = [named(factor) for factor, how in form.depends_on if not is_step(how)]
    return f"{named(form.behaves_as)}{of}" + (f" by {listed(on)}" if on else "") + "".join(steps)


def listed(words: Sequence[str], last: str = "and") -> str:
    """Words joined by commas, with `last` before the last one."""
    return " ".join([", ".join(words[:-1]), last, words[-1]]) if len(words) > 1 else "".join(words)


def value_text(channel: str, parameter: Parameter, value: float, spread: float) -> str:
    """A parameter with its uncertainty, without its unit where the sentence gives it."""
    if parameter.percent:
        return measured(100 * value, 100 * spread) + " %"
    text = measured(value, spread)
    return f"{text} {UNIT[channel]}" if parameter.unit == "channel's unit" else text


def cause_sentence(channel: str, cause: Cause) -> str:
    """What the cause is, with its parameters, how sure, and who could stand in its place."""
    effect = CATALOGUE[cause.effect]
    texts = {
        p.name: value_text(channel, p, *cause.parameters[p.name])
        for p in effect.parameters
        if p.name in cause.parameters
    }
    text = effect.words.sentence.format(**texts)
    if cause.probability < 0.9:
        doubt = "Probably" if cause.probability >= 0.6 else "Possibly"
        text = f"{doubt} ({100 * cause.probability:.0f} %): {text[0].lower()}{text[1:]}"
    if cause.indistinguishable_from:
        others = listed([named(e) for e in cause.indistinguishable_from], "or")
        text += f" These runs cannot tell that from {others}."
    if cause.at_bound:
        names = listed([named(p) for p in cause.at_bound])
        text += f" Its {names} stands at the end of its range: no value to rely on."
    return text


def values_text(channel: str, cause: Cause) -> str:
    """A cause's parameters by name, with uncertainties and units."""
    values = [
        f"{p.name} {value_text(channel, p, *cause.parameters[p.name])}"
        + ("" if p.unit in ("1", "channel's unit") else f" {p.unit}")
        + (" (at its bound)" if p.name in cause.at_bound else "")
        for p in CATALOGUE[cause.effect].parameters
        if p.name in cause.parameters
    ]
    return "; ".join(values)


def terminal_causes(found: ChannelDiagnosis) -> list[str]:
    """Causes in columns: effect, probability, parameters."""
    causes = ordered(found.causes)
    width = max((len(c.effect) for c in causes), default=0)
    return [
        f"    {c.effect:<{width}}  {100 * c.probability:5.1f} %  {values_text(found.name, c)}".rstrip() for c in causes
    ]


def ordered(causes: Sequence[Cause]) -> list[Cause]:
    """Causes, those that the data need most first."""
    return sorted(causes, key=lambda c: -c.evidence)


def gain_sentence(found: ChannelDiagnosis) -> str:
    """What the extension gains on unseen runs."""
    gain, unit = found.gain, UNIT[found.name]
    them = "it" if len(found.causes) + len(found.discovered) == 1 else "them"
    before, after, noise = (f"{plain(x, 2)} {unit}" for x in (gain.before, gain.after, gain.noise_floor))
    if before == after:
        return f"On unseen runs the error is {after} with {them} as without (noise {noise})."
    return f"With {them} the model predicts unseen runs to {after} instead of {before} (noise {noise})."


def removed_share(found: ChannelDiagnosis) -> str:
    """What share of the explainable error what is named removes on unseen runs; empty where nothing is named."""
    if not (found.causes or found.discovered):
        return ""
    if not found.gain.measured:
        return "of the explainable error removed on unseen runs: unknown, none was left to try it on"
    low, high = (100 * share for share in found.gain.interval_95)
    interval = f"{low:.1f} to {high:.1f} %" if low >= 0.0 else NOT_TOLD
    return f"of the explainable error removed on unseen runs: {100 * found.gain.explained_fraction:.1f} % ({interval})"


def channel_verdict(found: ChannelDiagnosis, whole: bool = True) -> str:
    """The verdict on one channel; without `whole` only the strongest of many causes is spelled out."""
    gain, unit, sensor = found.gain, UNIT[found.name], SENSOR[found.name]
    causes = ordered(found.causes)
    if found.verdict == "adequate" and not gain.measured:
        return (
            f"The plain diffusion model fits the {sensor}'s readings; there is no run left to try it on, so nothing is "
            "said of unseen ones."
        )
    if found.verdict == "adequate":
        return (
            f"The plain diffusion model describes the {sensor}: it predicts unseen runs to {plain(gain.before, 2)} "
            f"{unit} (noise {plain(gain.noise_floor, 2)} {unit}), and no candidate predicts them better."
        )
    if found.verdict == "described":
        said = [cause_sentence(found.name, c) for c in causes] if whole else []
        behaviours = [described_words.sentence(one, unit) for one in found.discovered]
        opening = f"No set of catalogued effects explains the {sensor}'s readings, and what they do can be described."
        return " ".join([opening, *said, *behaviours, gain_sentence(found)])
    spelled = causes if whole or len(causes) <= 2 else causes[:1]
    said = [cause_sentence(found.name, c) for c in spelled]
    if len(spelled) < len(causes):
        said.append(f"Also at work: {listed([named(c.effect) for c in causes[1:]])}.")
    if found.verdict == "explained":
        return " ".join([*said, gain_sentence(found)])
    if not whole:
        said = [f"{listed([named(c.effect) for c in causes]).capitalize()}."] if causes else []
    # A shape claims no cause: it says how the sensor behaves as far as these runs tell.
    shapes = all(CATALOGUE[c.effect].candidacy.shape for c in causes)
    opening = "As far as these runs tell:" if shapes else "Certain all the same:"
    if not (gain.measured or (found.remainder.significant and found.remainder.material)):
        return " ".join([f"{sensor.capitalize()}: there is no other run to try an explanation on.", opening, *said])
    told = [described_words.sentence(one, unit) for one in found.discovered]
    much = "Most" if found.gain.measured and found.gain.explained_fraction > 0.5 else "Some"
    most = [f"{much} of it can be described.", *told] if told else []
    return " ".join([unexplained(found, whole), *([opening, *said] if said else []), *most])


def unexplained(found: ChannelDiagnosis, whole: bool = True) -> str:
    """What is left, without physics: its size, when it occurs, what it varies with."""
    unit, sensor = UNIT[found.name], SENSOR[found.name]
    text = f"Something is left in the {sensor}'s readings that no catalogued effect explains"
    left: Mapping[str, Any] = found.discrepancy or {}
    parts: list[str] = []
    if "size_rms" in left:
        parts.append(
            f"{plain(float(left['size_rms']), 2)} {unit} rms beside a noise of "
            f"{plain(found.noise.standard_deviation, 2)} {unit}"
            + (f", at most {plain(float(left['size_peak']), 2)} {unit}" if whole else "")
        )
    if "largest_from_s" in left:
        parts.append(
            f"largest from {plain(float(left['largest_from_s']), 2)} to {plain(float(left['largest_until_s']), 2)} s "
            "after the transfer"
            + (", when the response is over: rather an air that moved than the sensor" if _late(found, left) else "")
        )
    varying = [str(v) for v in left.get("varies_with") or ()]
    alike = [v for v in varying if v.startswith("nothing")]
    varying = [v for v in varying if v not in alike]
    if varying:
        steady = ", and part of it is the same in every run" if alike else ""
        parts.append(f"it varies with {listed(varying)}{steady}")
    elif alike:
        parts.append("it is the same in every run")
    if whole and left.get("test"):
        parts.append(f"the test that shows it best: {left['test']}")
    return f"{text}: {'; '.join(parts)}." if parts else f"{text}."


def _late(found: ChannelDiagnosis, left: Mapping[str, Any]) -> bool:
    """Whether what is left, in airs that nobody recorded, is largest after 90 % of the way in every run."""
    channel = found.problem.channel
    if channel.conditions.airs_known.all():
        return False
    over = [one.times_s[1] for one in seen(channel) if one.times_s is not None]
    return bool(over) and float(left["largest_from_s"]) > max(over)


def remainder_sentence(found: ChannelDiagnosis) -> str:
    """What is left on unseen runs, and whether it matters."""
    left = found.remainder
    size = f"{plain(left.rms, 2)} {left.unit} rms above the noise"
    where = "on unseen runs" if found.gain.measured else "in the readings"
    if left.peak > left.rms:
        size += f", at most {plain(left.peak, 2)} {left.unit}"
    elif found.gain.measured:  # the peak is that of the fit to all runs: less than unseen runs are off by is no most
        size += f" (fitted to all runs, {plain(left.peak, 2)} {left.unit} at most)" if left.peak > 0.0 else ""
    if left.rms <= 0.0 and left.peak <= 0.0:
        seen = ", though statistics sees a pattern in it" if left.significant else ""
        return f"Left {where}: nothing above the noise{seen}."
    if not left.significant:
        return f"Left {where}: {size}; no more than chance leaves."
    if left.material:
        return f"Left {where}: {size}, which is more than the tolerance of {plain(left.tolerance, 2)} {left.unit}."
    return (
        f"Left {where}: {size}. Statistics sees it; at a tolerance of {plain(left.tolerance, 2)} {left.unit} it "
        "does not matter."
    )


def headline(diagnosis: Diagnosis) -> str:
    """The sentence of the page's head: both channels, the strongest cause of each spelled out."""
    return " ".join([*(channel_verdict(c, whole=False) for c in diagnosis.channels), *missing(diagnosis)])


def missing(diagnosis: Diagnosis) -> list[str]:
    """A sentence for each channel that could not be diagnosed."""
    return [f"The {SENSOR[name]} could not be diagnosed: {why}." for name, why in diagnosis.missing.items()]


def worse(nats: float) -> str:
    """How much worse a model predicts unseen runs, from the nats that it is behind."""
    odds = nats / math.log(10)
    if abs(odds) < 1:
        return "predicts unseen runs about as well"
    if abs(odds) < 3:
        times = plain(float(f"{10 ** abs(odds):.0e}"), 1)
        return f"makes unseen runs some {times} times {'less' if odds > 0 else 'more'} likely"
    return f"predicts unseen runs far {'worse' if odds > 0 else 'better'}"


def experiment(run: dict[str, Any]) -> str:
    """A run to measure next, in a line."""
    airs = [
        f"{plain(run[k]['temperature_c'], 3)} °C, {plain(run[k]['humidity_percent'], 3)} %RH"
        for k in ("source", "destination")
        if isinstance(run.get(k), dict)
    ]
    text = " → ".join(airs)
    if run.get("airflow_m_s") is not None:
        text += f", {plain(float(run['airflow_m_s']), 2)} m/s"
    if (run.get("transfer") or {}).get("duration_s") is not None:
        text += f", transfer slowed to {plain(float(run['transfer']['duration_s']), 2)} s"
    return text + (f" ({run['reason']})" if run.get("reason") else "")


def experiments(runs: Sequence[dict[str, Any]]) -> list[str]:
    """Runs to measure next, repeats counted together."""
    lines: dict[str, int] = {}
    for run in runs:
        text = experiment(run)
        lines[text] = lines.get(text, 0) + 1
    return [f"{count} × {text}" if count > 1 else text for text, count in lines.items()]
