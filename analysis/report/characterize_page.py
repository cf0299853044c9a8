"""The page and plots of `shockrig characterize`: verdict and numbers, every run with its fit, D(T), runs left out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from shockrig.analysis.characterize.result import FAR_DEVIATED, ChannelResult, Characterization, TableRow, to_profile
from shockrig.analysis.report.diagnosis_words import SENSOR, listed, named
from shockrig.analysis.report.fit_figures import Curve, diffusivity, parameter_by_condition, residual_overview
from shockrig.analysis.report.fitted import UNIT, panels, rate_label, rate_text, relative_runs, residuals, single_runs
from shockrig.analysis.report.html import Block, Cell, Details, Figure, HtmlPage, KeyNumber, Section, Table, Text
from shockrig.analysis.report.loop_page import chosen_section
from shockrig.analysis.report.next_time import seen_sentence
from shockrig.analysis.report.panels import panels as placed_panels
from shockrig.analysis.report.panels import run_panels
from shockrig.files.figures import save_figure, styled
from shockrig.files.headline import first_order, is_more, time_text
from shockrig.files.numbers import counted, measured, plain
from shockrig.files.profile import HumidityProfile
from shockrig.files.profile_views import draw_diffusivity

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

AXIS = {"temperature": "°C", "humidity": "%RH"}


def verdict(result: Characterization) -> str:
    """The sentence a colleague would say."""
    sentences = []
    for name, found in result.channels().items():
        noise, unit = found.noise.standard_deviation, UNIT[name]
        model = "One lag" if found.channel.lumped else "The plain diffusion model"
        model = f"The model with {_names(found)}" if found.effects else model
        if found.explained:
            sentences.append(
                f"{model} describes the {found.channel.sensor}: residuals of {plain(found.rmse, 2)} {unit}, "
                f"noise {plain(noise, 2)} {unit}."
            )
        else:
            sentences.append(hint(name, found))
    sentences += [
        f"The {SENSOR[name]} could not be characterized: {reason}." for name, reason in result.missing.items()
    ]
    return " ".join(sentences)


def hint(name: str, found: ChannelResult) -> str:
    """What to say, and to do, where the model does not explain the data: its times are then none of the readings'."""
    noise, unit = found.noise.standard_deviation, UNIT[name]
    model = "the plain model" if not found.effects else f"the model with {_names(found)}"
    how = f"rms {plain(found.rmse, 2)} {unit}, noise {plain(noise, 2)} {unit}"
    if found.normalised_deviation >= FAR_DEVIATED:
        how += f"; start times and airs bent by {plain(found.normalised_deviation, 2)} times their uncertainty"
    shown = seen_sentence(found.channel) if len(found.parts) == 1 else ""
    what = found.channel.sensor.capitalize()
    return f"{what}: {model} does not explain these data ({how}): run shockrig diagnose. {shown}".rstrip()


def _names(found: ChannelResult) -> str:
    return listed([named(effect.effect) for effect in found.effects])


def draw_figures(result: Characterization) -> dict[str, tuple[Drawing, str]]:
    """All figures of the page by file name, each with its caption."""
    figures: dict[str, tuple[Drawing, str]] = {}
    rows = () if result.humidity is None else result.humidity.rows
    if result.humidity is not None and len(rows) > 1 and (profile := to_profile(result).humidity) is not None:
        grid = np.linspace(rows[0].ambient_c, rows[-1].ambient_c, 120)
        value, spread = profile.diffusivity_m2_s(grid)
        table = Curve(*(np.array([getattr(r, k) for r in rows]) for k in _CURVE))
        single = single_runs(result.humidity)
        runs = Curve(
            np.array([r.ambient_c for r in single]),
            np.array([r.value for r in single]),
            np.array([r.standard_uncertainty for r in single]),
        )
        figures["diffusivity"] = (
            (_tau(profile), "tau over temperature with two standard uncertainties, and as it is interpolated.")
            if result.humidity.channel.lumped
            else (
                diffusivity(table, Curve(grid, value, spread), runs),
                "D over temperature with two standard uncertainties, and as it is interpolated: ln D over 1/T.",
            )
        )
    for name, found in result.channels().items():
        figures[f"{name}_runs"] = (
            run_panels(
                panels(result.campaign, found),
                name,
                AXIS[name],
                found.noise.standard_deviation,
                residual_unit=UNIT[name],
            ),
            "Every run's readings with the fit, each run's own start and airs included, and the residual under it "
            "(grey band: two standard deviations of the noise). Runs left out say why.",
        )
        if len(found.runs) < 2:  # by what they were, runs can be told apart where there are some
            continue
        figures[f"{name}_residuals"] = (
            residual_overview(residuals(found), UNIT[name], found.noise.standard_deviation),
            "The same residuals averaged in log time, coloured by what the runs were: a pattern is a missing effect.",
        )
        ratios = relative_runs(found)
        if not ratios:  # none says anything of its rate by itself
            continue
        title = f"{found.channel.rate_name}, run / joint"
        figures[f"{name}_by_condition"] = (
            parameter_by_condition(ratios, title, "", (1.0, 0.0), UNIT[name]),
            f"The {'rate' if found.channel.lumped else 'diffusivity'} of each run alone as a ratio to the joint fit, "
            "two standard uncertainties: it should not move with airflow, direction or size of the step.",
        )
    return figures


@styled
def _tau(profile: HumidityProfile) -> Drawing:
    """The time constant of a film that is one lag, over temperature."""
    drawing, axes = placed_panels((1, 1), (6.4, 3.7))
    draw_diffusivity(axes[0, 0], profile, lumped=True)
    return drawing


_CURVE = ("ambient_c", "diffusivity_m2_s", "standard_uncertainty")


def write_characterization(
    result: Characterization,
    directory: Path,
    provenance: Mapping[str, Cell],
    decisions: Sequence[Mapping[str, Any]] = (),
    more: Sequence[Section] = (),
) -> Path:
    """Write the plots and DIRECTORY/report.html; returns the page's path. `decisions` is the campaign's log of them,
    `more` are sections that follow the numbers."""
    folder = Path(directory)
    drawn = draw_figures(result)
    saved = {name: save_figure(drawing, folder, name) for name, (drawing, _) in drawn.items()}

    def figure(name: str, alt: str) -> Figure:
        return Figure(saved[name], drawn[name][1], alt)

    numbers = _number_blocks(result)
    if "diffusivity" in drawn:
        numbers.append(figure("diffusivity", "How fast the film is, over temperature"))
    sections = [*input_section(one.sentence for one in result.findings), Section("The numbers", numbers), *more]
    for name, found in result.channels().items():
        noise = found.noise
        text = Text(
            f"Noise of one reading, from the plateaus before any fit: {plain(noise.standard_deviation, 3)} "
            f"{UNIT[name]} ({_noise_words(found)}). Residuals of all used samples: {plain(found.rmse, 3)} {UNIT[name]}."
        )
        blocks: list[Block] = [text, figure(f"{name}_runs", f"Every run of the {name} channel with fit and residual")]
        if len(found.runs) > 1:
            blocks.append(figure(f"{name}_residuals", f"Residuals of the {name} channel by condition"))
            of_runs = (
                f"{'Rate' if found.channel.lumped else 'Diffusivity'} of single runs of the {name} channel by condition"
            )
            if f"{name}_by_condition" in drawn:
                blocks.append(figure(f"{name}_by_condition", of_runs))
        blocks.append(Details("How the fit was made", [_search_table(found), Text(_METHOD)]))
        sections.append(Section(f"{name.capitalize()}: {counted(len(found.runs), 'run')}", blocks))
    sections += chosen_section(decisions, folder)
    sections.append(Section("What was left out, and why", [_left_out(result)]))
    bad = any(not found.explained for found in result.channels().values()) or bool(result.missing)
    report = HtmlPage(
        title=f"Characterization of {result.campaign.name}",
        verdict=verdict(result),
        key_numbers=_key_numbers(result),
        sections=sections,
        provenance=provenance,
        tone="warning" if bad else "good",
    )
    return report.write(folder / "report.html")


def input_section(sentences: Iterable[str]) -> list[Section]:
    """What the checks of the input say; no section where they say nothing."""
    warnings = [Text(sentence, "warning") for sentence in sentences]
    return [Section("What looks wrong with the input", warnings)] if warnings else []


_METHOD = (
    "Differential evolution searches each ambient for the rate with the smallest RMSE (Eq. 17 of Segales et al. 2022), "
    "with start times and airs as recorded; nlopt's SBPLX descends to it from the time to half-way. From whichever "
    "left less all ambients are fitted together by generalised least squares: the noise's autocorrelation is counted, "
    "and each run has a start time, a rate and two airs of its own that deviate as much as is known of them. "
    "Uncertainties are one standard uncertainty; where residuals or deviations are larger than they should be, they "
    "hold what the model is wrong by, and how far single runs and the readings' own times are from it."
)


def _key_numbers(result: Characterization) -> list[KeyNumber]:
    numbers: list[KeyNumber] = []
    if (t := result.temperature) is not None:
        numbers += _of_sensor(t, t.rows[0], "")
    if (h := result.humidity) is not None:
        row = min(h.rows, key=lambda r: abs(r.ambient_c - 20.0))
        numbers += _of_sensor(h, row, f" at {round(row.ambient_c)} °C")
    for name, found in result.channels().items():
        note = f"residuals {plain(found.rmse, 2)} {UNIT[name]}"
        numbers.append(KeyNumber(f"noise, {name}", f"{plain(found.noise.standard_deviation, 2)} {UNIT[name]}", note))
    return numbers


def _of_sensor(found: ChannelResult, row: TableRow, where: str) -> list[KeyNumber]:
    """The rate, or tau, of a sensor and its response times; of one lag alone the time to 63 % is tau once more."""
    channel, instrument = found.channel, found.channel.quantity.instrument
    effective = "" if found.explained else "effective: the model does not explain the data"
    label = f"tau of the {instrument}" if channel.lumped else f"{channel.rate_name} of the {channel.sensor}"
    tau_s = first_order(channel.length_m, row.diffusivity_m2_s, 0.0)[0] if channel.lumped else None
    if not is_more(row.response, tau_s):
        note = "; ".join(filter(None, (_later(row), effective)))
        return [KeyNumber(f"{label}{where}", rate_text(channel, row), note)]
    return [
        KeyNumber(f"{label}{where}", rate_text(channel, row), effective),
        KeyNumber(f"time to 63 % of the {instrument}{where}", time_text(row.response, 0), _later(row)),
    ]


def _later(row: TableRow) -> str:
    return f"90 % {time_text(row.response, 1)}, 98 % {time_text(row.response, 2)}"


def _number_blocks(result: Characterization) -> list[Block]:
    rows: list[list[Cell]] = []
    for found in result.channels().values():
        for row in found.rows:
            label = rate_label(found.channel, row.ambient_c)
            times = [time_text(row.response, place) for place in range(3)]
            rows.append([label, rate_text(found.channel, row), *times, len(row.runs), row.basis])
    columns = ("", "value ± standard uncertainty", "to 63 %", "to 90 %", "to 98 %", "runs", "from")
    blocks: list[Block] = [Table(columns, rows)]
    effects: list[list[Cell]] = []
    for name, found in result.channels().items():
        for effect in found.effects:
            values = {p: measured(v.value, v.standard_uncertainty) for p, v in effect.parameters.items()}
            effects += [[name, named(effect.effect), p, text] for p, text in (values or {"–": "–"}).items()]
    if effects:
        blocks.append(Table(("channel", "effect", "parameter", "value"), effects, "Effects that the model carries"))
    return blocks


def _noise_words(found: ChannelResult) -> str:
    noise, unit = found.noise, UNIT[found.channel.name]
    if noise.correlated < 0.1 * noise.standard_deviation:
        words = f"rounded to {plain(noise.step, 2)} {unit}" if noise.step else "white"
    else:
        memory = -found.channel.reading_period_s / np.log(np.clip(noise.memory, 1e-9, 0.9999))
        words = (
            f"white {plain(noise.white, 2)} {unit} and {plain(noise.correlated, 2)} {unit} over {plain(memory, 2)} s"
        )
    return words + (f", averaged over {noise.averaged} readings" if noise.averaged > 1 else "")


def _search_table(found: ChannelResult) -> Table:
    length = found.channel.length_m
    rows: list[list[Cell]] = [
        [
            "all" if found.channel.quantity.pooled else f"{round(row.ambient_c, 1) + 0.0:.1f} °C",
            plain(float(np.exp(row.evolution.log_rate)) * length**2, 6),
            row.evolution.rmse,
            row.evolution.evaluations,
            plain(float(np.exp(row.check.log_rate)) * length**2, 6),
            row.check.evaluations,
            plain(row.diffusivity_m2_s, 6),
        ]
        for row in found.rows
        if row.evolution is not None and row.check is not None
    ]
    columns = ("ambient", "evolution", "RMSE", "candidates", "SBPLX", "evaluations", "least squares, m²/s")
    differ = found.disagreement
    return Table(columns, rows, "" if differ is None else f"The two optimisers differ by {100 * differ:.2g} % at most.")


def _left_out(result: Characterization) -> Table | Text:
    entries = [e for found in result.channels().values() for e in found.set_aside]
    rows = [[e.run, e.channel, e.reason] for e in entries]
    rows += [["all", name, reason] for name, reason in result.missing.items()]
    return Table(("run", "channel", "why"), rows) if rows else Text("Nothing: every run was used in both channels.")
