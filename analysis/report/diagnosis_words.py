"""The sentences of a diagnosis: what a colleague would say; of effects that nobody listed 'behaves as', never 'is'."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from shockrig.analysis.characterize.result import FAR_ABOVE_NOISE
from shockrig.analysis.diagnose.candidates import may_be_anything
from shockrig.analysis.diagnose.diagnosed import Cause, ChannelDiagnosis, Diagnosis
from shockrig.analysis.diagnose.gain import Gain
from shockrig.analysis.diagnose.remainder import left_rms
from shockrig.analysis.effects import CATALOGUE
from shockrig.analysis.effects.described import entry_of, is_described, of_readings, rounded
from shockrig.analysis.effects.forms import ONLY_FROM, SCATTER, SPREAD, form_of, is_group, is_step
from shockrig.analysis.estimate.effect import Parameter
from shockrig.analysis.estimate.quantity import QUANTITIES
from shockrig.analysis.estimate.seen import seen
from shockrig.analysis.report.fitted import UNIT
from shockrig.files.causes import Uncertain
from shockrig.files.diagnosis_data import Dependence, Discovered
from shockrig.files.numbers import between, measured, plain

# Sentences on effects that nobody listed: 'behaves as', never 'is'.

DRIVERS = {
    "air_temperature": "the air's temperature",
    "air_humidity": "the air's humidity",
    "own_response": "the reading itself",
    "die_temperature": "the die's temperature",
    "other_sensor": "the other sensor",
    "airflow": "the airflow",
    "none": "the transfer",
}
BEHAVIOURS = {
    "lag_in_series": "a lag before the sensing body",
    "parallel_lag": "a share of the response that follows slowly",
    "added_response": "something that leaks in with {driver}",
    "added_rate": "something that goes with the rate of change of {driver}",
    "gain": "a gain on the reading",
    "offset": "an offset of the reading",
    "rate_change": "a diffusivity that moves",
    "delay": "a delay",
    "periodic": "a swing",
    "bursts": "bursts",
}
EACH = {"ambient": "per K", "humidity": "from dry to saturated"}
FACTORS = {"run_order": "the order of the runs", "time_of_campaign": "time", "history": "how long the run has lasted"}


def behaves(one: Discovered) -> str:
    """How an effect behaves, in a few words."""
    if one.behaves_as == "lag_in_series" and one.driver == "airflow":
        return "a resistance between the air and the sensing body"
    if one.behaves_as == "delay" and one.driver == "air_humidity":
        return "vapour that reaches the film late"
    if one.behaves_as == "gain" and one.driver == "die_temperature":
        return "a gain that goes with the die's temperature"
    text = BEHAVIOURS[one.behaves_as].format(driver=DRIVERS[one.driver])
    if one.behaves_as == "added_rate" and one.driver == "none":
        return "a pulse that the transfer itself brings, and that dies away"
    if one.behaves_as == "lag_in_series" and any(on.factor == "history" for on in one.depends_on):
        if one.driver == "own_response":
            return "a mean of the last readings over a time"
        return "air that comes in evenly over a time"
    if rounded(one):
        return "a rounding of the readings"
    if one.behaves_as == "periodic" and of_readings(one):
        return "a hum that goes on all along"
    return text


def sentence(one: Discovered, unit: str) -> str:
    """What was described, with its numbers, what it depends on and what not, and what else could be said."""
    text = f"It behaves as {behaves(one)}{_numbers(one, unit)}"
    if conditions := [_depends(on) for on in one.depends_on if on != _spread(one)]:
        text += "; it depends on " + listed(conditions)
    if one.does_not_depend_on:
        text += "; it does not depend on " + listed([_factor(f) for f in one.does_not_depend_on], "or")
    text += "."
    if one.alternatives:
        others = [_short(other) for other in one.alternatives]
        text += f" These runs fit as well: {listed(others, 'or')}."
    if one.nearest_catalogued is not None:
        near = one.nearest_catalogued
        not_it = f"and is not it: {near.why_not}" if near.why_not else "and these runs do not tell the two apart"
        name = near.effect.replace("_", " ")
        text += f" Of the catalogue, {name} is most alike ({100 * near.likeness:.0f} %), {not_it}."
    return text


def flies(one: Discovered, channel: str) -> str:
    """What a correction does with it."""
    effect = entry_of(one, channel)
    if of_readings(one):
        return "of single readings: no part in a flight"
    if effect is None or effect.in_flight is None:
        return "taken for the bench's: no part in a flight"
    if effect.in_flight.left:
        return "left in the reading of a flight, and said to be"
    return "undone in a flight, within the conditions seen"


def seen_over(one: Discovered) -> str:
    """Over which conditions it was seen."""
    words = {"airflow_m_s": "m/s", "ambient_temperature_c": "°C", "pressure_hpa": "hPa"}
    ends = one.seen_over.items()
    return ", ".join(f"{plain(low, 3)} to {plain(high, 3)} {words.get(name, name)}" for name, (low, high) in ends)


def _short(one: Discovered) -> str:
    factors = [_factor(on.factor) for on in one.depends_on if on != _spread(one)]
    return behaves(one) + (f" that depends on {listed(factors)}" if factors else "")


def _numbers(one: Discovered, unit: str) -> str:
    said = []
    if one.size is not None:
        of = {"1": "", "1e-6": " parts per million"}.get(one.size.unit, f" {one.size.unit}")
        said.append(f"size {_value(Uncertain(one.size.value, one.size.standard_uncertainty))}{of}")
    if one.time_constant_s is not None:
        said.append(f"time constant {_value(one.time_constant_s)} s{_to_either_side(one)}")
    if one.period_s is not None:
        said.append(f"period {_value(one.period_s)} s")
    return f" ({', '.join(said)})" if said else ""


def _spread(one: Discovered) -> Dependence | None:
    """What says that its time constants are several."""
    return next((on for on in one.depends_on if (on.factor, on.form) == SPREAD), None)


def _to_either_side(one: Discovered) -> str:
    on = _spread(one)
    if on is None or on.value is None or one.time_constant_s is None:
        return ""
    low, high = (one.time_constant_s.value * math.exp(side * on.value) for side in (-1.0, 1.0))
    return f" in the middle of many, evenly spread in their logarithm from {plain(low, 2)} to {plain(high, 2)} s"


def _value(value: Uncertain) -> str:
    return measured(value.value, value.standard_uncertainty)


def _factor(name: str) -> str:
    return FACTORS.get(name, f"the {name}")


def _depends(on: Dependence) -> str:
    factor = _factor(on.factor)
    if on.form == "dew_margin":
        return "how far the dew point lies above the air that a run comes from"
    if is_group(on.form):
        side = "only from the {} run on" if on.form.startswith(ONLY_FROM) else "only before the {} run"
        return f"{factor} ({side.format(nth_run(on.form))})"
    if on.value is None:
        return f"{factor} ({on.form.replace('_', ' ')})" if on.form not in ("sign", "linear") else factor
    value = measured(on.value, on.standard_uncertainty or 0.0)
    if (on.factor, on.form) == SCATTER:
        return f"chance, by {value} times its size from run to run (one standard deviation)"
    if is_step(on.form):
        return f"{factor} ({value} times as much from the {nth_run(on.form)} run on)"
    how = {
        "power": f"as its power {value}",
        "exponential": f"a factor exp({value} {EACH.get(on.factor, '')})",
        "ratio": f"{value} times as much downwards",
        "trend": f"by {value} of itself with each run",
        "zero_at": f"none at {value}",
        "linear": f"slope {value}",
        "sets_in_over": f"setting in over {value}",
    }.get(on.form, f"{on.form.replace('_', ' ')} {value}")
    return f"{factor} ({how})"


def nth_run(step: str) -> str:
    """At which run a step in their order begins, as an ordinal number."""
    number = int(step.rpartition("_")[2]) + 1
    ending = "th" if 10 <= number % 100 <= 20 else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"


SENSOR: dict[str, str] = {name: quantity.noun for name, quantity in QUANTITIES.items()}
INSTRUMENT: dict[str, str] = {name: quantity.instrument for name, quantity in QUANTITIES.items()}
NOT_TOLD = "these runs do not tell how much it is on others"
MOST_SHOWN = 99.9  # percent of an error, above which nothing more exact is said


def named(effect: str) -> str:
    """An effect's id as words."""
    return effect.replace("_", " ")


def label(effect: str) -> str:
    """An effect's id as words, or what a form of the grammar behaves as."""
    if not is_described(effect):
        return named(effect)
    form = form_of(effect)
    of = "" if form.driver == "none" else f" of {named(form.driver)}"
    on = [_condition(factor, how) for factor, how in form.depends_on]
    return f"{named(form.behaves_as)}{of}" + (f" by {listed(on)}" if on else "")


def _condition(factor: str, how: str) -> str:
    """What a form's strength depends on, and how, without its size."""
    if is_group(how):
        return f"{named(factor)} (only {'from' if how.startswith(ONLY_FROM) else 'before'} the {nth_run(how)} run)"
    if is_step(how):
        return f"{named(factor)} (from the {nth_run(how)} run on)"
    return "chance" if (factor, how) == SCATTER else f"{named(factor)} ({named(how)})"


def listed(words: Sequence[str], last: str = "and") -> str:
    """Words joined by commas, with `last` before the last one."""
    return " ".join([", ".join(words[:-1]), last, words[-1]]) if len(words) > 1 else "".join(words)


def value_text(channel: str, parameter: Parameter, stated: Uncertain) -> str:
    """A parameter with its uncertainty, without its unit where the sentence gives it."""
    value, spread = stated.value, stated.standard_uncertainty
    scale, unit = (100.0, " %") if parameter.percent else (1.0, "")
    unit = f" {UNIT[channel]}" if parameter.unit == "channel's unit" else unit
    low, high = value - spread, value + spread
    if parameter.log and spread >= value > 0.0:
        # What is positive is no less than nothing: a standard uncertainty in its logarithm of 1 and more is a factor.
        factor = math.exp(min(spread / value, math.log(parameter.high / parameter.low)))
        low, high = value / factor, value * factor
    elif math.isfinite(spread) and parameter.low <= low and high <= parameter.high:
        return measured(scale * value, scale * spread) + unit
    # No further than its range goes: of a share 15 ± 855 % says nothing that 0 to 100 % does not.
    low, high = max(low, parameter.low), min(high, parameter.high)
    return between(scale * value, scale * low, scale * high) + unit


CERTAIN = 0.9  # from here on a cause is said without a doubt


def cause_sentence(channel: str, cause: Cause) -> str:
    """What the cause is, with its parameters, how sure, and who could stand in its place."""
    effect = CATALOGUE[cause.effect]
    texts = {
        p.name: value_text(channel, p, cause.parameters[p.name])
        for p in effect.parameters
        if p.name in cause.parameters
    }
    text = effect.words.sentence.format(**texts)
    words = {p.name: named(p.name.removesuffix(f"_{p.unit}")) for p in effect.parameters}
    if cause.probability < CERTAIN:
        doubt = "Probably" if cause.probability >= 0.6 else "Possibly"
        text = f"{doubt} ({100 * cause.probability:.0f} %): {text[0].lower()}{text[1:]}"
    if cause.indistinguishable_from:
        others = listed([named(e) for e in cause.indistinguishable_from], "or")
        text += f" These runs cannot tell that from {others}."
    if cause.at_bound:
        names = listed([words[name] for name in cause.at_bound])
        text += f" Its {names} stands at the end of its range: no value to rely on."
    values = {name: (one.value, one.standard_uncertainty) for name, one in cause.parameters.items()}
    if open_ := may_be_anything(effect, values):
        text += f" Of its {listed([words[name] for name in open_])} these runs say nothing."
    return text


def values_text(channel: str, cause: Cause) -> str:
    """A cause's parameters by name, with uncertainties and units."""
    values = [
        f"{p.name} {value_text(channel, p, cause.parameters[p.name])}"
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
    return sorted(causes, key=lambda c: -c.nats)


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
    share, interval = removed(found.gain)
    return f"of the explainable error removed on unseen runs: {share}{f' ({interval})' if interval else ''}"


def removed(gain: Gain) -> tuple[str, str]:
    """The share of the explainable error that is removed on unseen runs, and its 95 % interval, empty where that says
    nothing more: what rounds to all of it is not all, and an interval from 100.0 to 100.0 % would read like a fault.
    """
    low, high = (100 * share for share in gain.interval_95)
    share = 100 * gain.explained_fraction
    said = f"more than {MOST_SHOWN} %" if share > MOST_SHOWN else f"{share:.1f} %"
    if low >= MOST_SHOWN:
        return said, ""
    return said, f"{low:.1f} to {high:.1f} %" if low >= 0.0 else NOT_TOLD


def sensor_of(found: ChannelDiagnosis) -> str:
    """What is looked at."""
    return found.problem.channel.sensor


def channel_verdict(found: ChannelDiagnosis, whole: bool = True) -> str:
    """The verdict on one channel; without `whole` only the strongest of many causes is spelled out."""
    gain, unit, sensor = found.gain, UNIT[found.name], sensor_of(found)
    model = "One lag" if found.problem.channel.lumped else "The plain diffusion model"
    causes = ordered(found.causes)
    if found.verdict == "adequate" and not gain.measured:
        if left := wandering(found):
            return (
                f"{model} is all that these runs tell of the {sensor}: what it leaves, {plain(left, 2)} {unit} "
                f"rms beside a noise of {plain(found.noise.standard_deviation, 2)} {unit}, hangs together as noise of "
                "theirs may, and whether the air or the sensor does it they cannot tell."
            )
        return (
            f"{model} fits the {sensor}'s readings; there is no run left to try it on, so nothing is "
            "said of unseen ones."
        )
    if found.verdict == "adequate":
        return (
            f"{model} describes the {sensor}: it predicts unseen runs to {plain(gain.before, 2)} "
            f"{unit} (noise {plain(gain.noise_floor, 2)} {unit}), and no candidate is more "
            "probable, its prior counted."
        )
    if found.verdict == "described":
        said = [cause_sentence(found.name, c) for c in causes] if whole else []
        behaviours = [sentence(one, unit) for one in found.discovered]
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
    left = found.remainder.significant and found.remainder.material
    if found.search.leaves_open and not (causes or found.discovered or left):
        return f"{model} is not all that moves the {sensor}'s readings, and what else does these runs leave open."
    # A shape claims no cause: it says how the sensor behaves as far as these runs tell.
    sure = all(c.probability >= CERTAIN for c in causes)
    shapes = all(CATALOGUE[c.effect].candidacy.shape for c in causes)
    opening = "Certain all the same:" if sure and not shapes else "As far as these runs tell:"
    if not (gain.measured or left):
        return " ".join([f"{sensor.capitalize()}: there is no other run to try an explanation on.", opening, *said])
    told = [sentence(one, unit) for one in found.discovered]
    much = "Most" if found.gain.measured and found.gain.explained_fraction > 0.5 else "Some"
    most = [f"{much} of it can be described.", *told] if told else []
    return " ".join([unexplained(found, whole), *([opening, *said] if said else []), *most])


def unexplained(found: ChannelDiagnosis, whole: bool = True) -> str:
    """What is left, without physics: its size, when it occurs, what it varies with."""
    unit, sensor = UNIT[found.name], sensor_of(found)
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
    varying = [str(v) for v in left.get("varies_with") or () if not str(v).startswith("nothing")]
    if varying:
        parts.append(f"it varies with {listed(varying)}")
    if "in_common" in left:
        parts.append(f"{100.0 * float(left['in_common']):.0f} % of it is the same in every run")
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


def wandering(found: ChannelDiagnosis) -> float:
    """Rms of what the stated model leaves [channel's unit], where no other run could be tried and that is far above the
    noise of single readings, and passes for noise only because it hangs together; else 0."""
    if found.gain.measured:
        return 0.0
    size = left_rms(found.problem, found.final)
    return size if size > FAR_ABOVE_NOISE * found.noise.standard_deviation else 0.0


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
        if wanders := wandering(found):
            # What a test has told from noise does not hang together like it.
            why = (
                "more than single readings scatter by"
                if left.significant
                else "which hangs together as noise of theirs may"
            )
            return f"Left {where}: {plain(wanders, 2)} {left.unit} rms, {why}."
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


PREDICTS = "What predicts other runs, and a profile carries where one can be made, is"


def predicting_sentence(found: ChannelDiagnosis) -> str:
    """What the model that predicts has that the stated one has not, and why it predicts; empty where it is the same, or
    leaves the same."""
    best, other = found.search.best, found.predicting.model
    if found.predicting.errors is None:
        return ""

    stated_if_sure = found.search.may_state(other)

    def words(ids: frozenset[str]) -> str:
        shares = {e: f" ({100 * found.search.probability(e):.0f} %)" if stated_if_sure else "" for e in ids}
        return listed([label(e) + shares[e] for e in sorted(ids)])

    stated, own = found.predicting.errors
    digits = next((n for n in range(2, 6) if plain(own, n) != plain(stated, n)), None)
    if digits is None:
        return ""
    missed = f"misses them by {plain(own, digits)}, not {plain(stated, digits)} {UNIT[found.name]}"
    why = f"At the rate that runs have in common it {missed}"
    if other is best:
        fitted = "gives all runs one rate and all readings one weight"
        return f"{PREDICTS} what is stated, with the numbers of a fit that {fitted}. {why}."
    more, less = other.ids - best.ids, best.ids - other.ids
    how = ", ".join([*([f"with {words(more)}"] if more else []), *([f"without {words(less)}"] if less else [])])
    kind = "that is not sure enough" if stated_if_sure else "whose values these runs leave too open"
    return f"{PREDICTS} a model {kind} to be stated, {how}. {why}."


def headline(diagnosis: Diagnosis) -> str:
    """The sentence of the page's head: both channels, the strongest cause of each spelled out."""
    return " ".join([*(channel_verdict(c, whole=False) for c in diagnosis.channels), *missing(diagnosis)])


def missing(diagnosis: Diagnosis) -> list[str]:
    """A sentence for each channel that could not be diagnosed."""
    # A finding of the checks of the input is a whole sentence, with its stop.
    whys = {name: why.removesuffix(".") for name, why in diagnosis.missing.items()}
    return [f"The {INSTRUMENT[name]} could not be diagnosed: {why}." for name, why in whys.items()]


def worse(nats: float) -> str:
    """How much worse a model predicts unseen runs, from the nats that it is behind."""
    odds = nats / math.log(10)
    if abs(odds) < 1:
        return "predicts unseen runs about as well"
    if abs(odds) < 3:
        times = plain(float(f"{10 ** abs(odds):.0e}"), 1)
        return f"makes unseen runs some {times} times {'less' if odds > 0 else 'more'} likely"
    return f"predicts unseen runs far {'worse' if odds > 0 else 'better'}"


def experiment(run: dict[str, Any], humid: bool = True) -> str:
    """A run to measure next, in a line; a thermometer alone (`humid` False) needs no air of a certain humidity."""
    airs = [
        f"{plain(run[k]['temperature_c'], 3)} °C" + (f", {plain(run[k]['humidity_percent'], 3)} %RH" if humid else "")
        for k in ("source", "destination")
        if isinstance(run.get(k), dict)
    ]
    text = " → ".join(airs)
    if run.get("airflow_m_s") is not None:
        text += f", {plain(float(run['airflow_m_s']), 2)} m/s"
    if (run.get("transfer") or {}).get("duration_s") is not None:
        text += f", transfer slowed to {plain(float(run['transfer']['duration_s']), 2)} s"
    return text + (f" ({run['reason']})" if run.get("reason") else "")


def has_hygrometer(diagnosis: Diagnosis) -> bool:
    """Whether there is one, diagnosed or not."""
    return "humidity" in diagnosis.missing or any(channel.name == "humidity" for channel in diagnosis.channels)


def experiments(runs: Sequence[dict[str, Any]], humid: bool = True) -> list[str]:
    """Runs to measure next, repeats counted together."""
    lines: dict[str, int] = {}
    for run in runs:
        text = experiment(run, humid)
        lines[text] = lines.get(text, 0) + 1
    return [f"{count} × {text}" if count > 1 else text for text, count in lines.items()]
