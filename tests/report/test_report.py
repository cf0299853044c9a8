"""Reports: nothing runs, nothing is fetched, everything is said; numbers as people write them; figures show data."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shockrig.analysis.report import (
    Details,
    Equation,
    Figure,
    HtmlPage,
    KeyNumber,
    Section,
    Table,
    Text,
    measured,
    plain,
    render,
    save_figure,
)
from shockrig.analysis.report.fit_figures import (
    BeforeAfter,
    Curve,
    ResidualRun,
    RunParameter,
    autocorrelation,
    before_after,
    cause_bars,
    diffusivity,
    log_bins,
    parameter_by_condition,
    residual_overview,
)
from shockrig.analysis.report.panels import RunPanel, run_panels, times_named
from shockrig.files.figures import BLUE, GREY, INK, RED, figure_bytes
from shockrig.files.numbers import power_of_ten, short

EVIL = "\"><script>alert('x')</script><img src=http://example.org/x onerror=alert(1)> & $\\alpha$ </style>"


class Page(HTMLParser):
    """Collects tags, attributes and text of a page."""

    def __init__(self, page: str):
        super().__init__(convert_charrefs=True)
        self.tags: list[tuple[str, dict]] = []
        self.text = ""
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text += data


def small_figure():
    return autocorrelation({"temperature": (np.array([0.5, 0.2, 0.01]), 400)}, 0.1)


def full_report(name: str) -> HtmlPage:
    return HtmlPage(
        name,
        name,
        [KeyNumber(name, name, name)],
        [
            Section(name, [Text(name, "warning"), Equation(name), Table([name, "n"], [[name, 1.5]], name)]),
            Section("b", [Figure(small_figure(), name, name), Details(name, [Text(name)])]),
            Section("c", []),
        ],
        {name: name},
    )


def test_names_from_files_are_shown_and_never_run():
    parsed = Page(render(full_report(EVIL)))
    assert {tag for tag, _ in parsed.tags}.isdisjoint({"script", "iframe", "object", "link", "form"})
    assert not any(key.startswith("on") for _, attributes in parsed.tags for key in attributes)
    assert all(a["src"].startswith("data:image/") for tag, a in parsed.tags if tag == "img")
    assert parsed.text.count("alert('x')") == 18
    policy = next(a["content"] for tag, a in parsed.tags if a.get("http-equiv") == "Content-Security-Policy")
    assert "default-src 'none'" in policy and "script" not in policy


@given(st.text(max_size=40))
def test_any_name_comes_back_as_text(name):
    table = HtmlPage("t", "v", [], [Section("s", [Table(["c"], [["[" + name + "]"]])])])
    page = Page(render(table))
    assert [tag for tag, _ in page.tags if tag not in ("meta", "br")] == [
        "html", "head", "title", "style", "body", "main", "h1", "p", "section", "h2", "div", "table", "thead", "tr",
        "th", "tbody", "tr", "td",
    ]  # fmt: skip
    assert f"[{name}]".replace("\r\n", "\n").replace("\r", "\n") in page.text.replace("\r\n", "\n").replace("\r", "\n")


def test_the_page_needs_no_other_file_and_is_the_same_each_time(tmp_path):
    path = full_report("campaign 7").write(tmp_path / "new" / "report.html")
    page = path.read_text(encoding="utf-8")
    assert full_report("campaign 7").write(tmp_path / "again.html").read_bytes() == path.read_bytes()
    assert [p.name for p in path.parent.iterdir()] == ["report.html"]
    assert not re.findall(r"(?:src|href)=\"(?!data:|#)", page) and "url(" not in page and "@import" not in page
    assert page.index("verdict") < page.index('class="key"') < page.index("<section") < page.index("Provenance")
    assert all(a.get("alt") for tag, a in Page(page).tags if tag == "img")
    links = {a["href"][1:] for tag, a in Page(page).tags if tag == "a"}
    assert links == {a["id"] for tag, a in Page(page).tags if tag == "section"}


def test_figures_are_embedded_whole(tmp_path):
    png = save_figure(small_figure(), tmp_path / "plots", "acf")
    assert png.read_bytes().startswith(b"\x89PNG")
    assert not list((tmp_path / "plots").glob("*.part"))
    for block in (Figure(png, "c", "a"), Figure(small_figure(), "c", "a")):
        page = Page(render(HtmlPage("t", "v", [], [Section("s", [block])])))
        source = next(a["src"] for tag, a in page.tags if tag == "img")
        assert base64.b64decode(source.split(",")[1]) == png.read_bytes()


def test_figures_and_tables_scroll_by_themselves_on_a_narrow_screen():
    blocks = [Figure(small_figure(), "c", "a"), Table(["run"], [["a"]], "caption")]
    page = render(HtmlPage("t", "v", [], [Section("s", blocks)]))
    assert '<div class="scroll"><img' in page and '<div class="scroll"><table>' in page


def test_a_table_must_be_rectangular_and_its_numbers_stand_right():
    with pytest.raises(ValueError, match="row 1 has 1 cells for 2"):
        Table(["a", "b"], [[1, 2], [3]])
    page = render(HtmlPage("t", "v", [], [Section("s", [Table(["run", "D"], [["a", 2.345678e-12], ["b", None]])])]))
    assert '<td>a</td><td class="number">2.346 × 10⁻¹²</td>' in page and '<td class="number">–</td>' in page


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.0, "0"), (12.3456, "12.35"), (-0.5, "−0.5000"), (123456.0, "123456"), (2.5e-12, "2.500 × 10⁻¹²"), (7, "7"),
     (None, "–"), (float("nan"), "–"), (float("inf"), "∞"), ("x", "x"), (True, "yes"), (9.99996, "10.00"),
     (9.99996e-9, "1.000 × 10⁻⁸")],
)  # fmt: skip
def test_plain_numbers(value, shown):
    assert plain(value) == shown


def test_seconds_and_readings_are_written_without_powers_of_ten():
    assert [short(value, 3) for value in (1.337, 136.0, 1095.4, 25420.6)] == ["1.34", "136", "1095", "25421"]


@pytest.mark.parametrize(
    ("value", "uncertainty", "unit", "shown"),
    [
        (7.5e-8, 2e-10, "m²/s", "(7.500 ± 0.020) × 10⁻⁸ m²/s"),
        (0.99812, 0.0123, "s", "(0.998 ± 0.012) s"),
        (36.123, 0.5, "", "36.12 ± 0.50"),
        (36.1, None, "s", "36.10 s"),
        (-0.02, 0.1, "K", "(−0.02 ± 0.10) K"),
        (1234.5, 60.0, "", "1234 ± 60"),
    ],
)
def test_measured_numbers_carry_two_digits_of_their_uncertainty(value, uncertainty, unit, shown):
    assert measured(value, uncertainty, unit) == shown


def test_axes_are_scaled_by_a_power_of_ten():
    assert power_of_ten(14.0) == (1.0, "")
    scale, power = power_of_ten(3.2e-12)
    assert scale == pytest.approx(1e-12) and power == "10⁻¹² "


def panel(k, used=True):
    time = np.linspace(-5, 40, 120) + 0.01 * k
    reading = 20 + np.where(time > 0, 1 - np.exp(-time / (1 + k)), 0.0)
    return RunPanel(
        f"{k:04d} $x_", f"{10 * (k % 3)} °C", time, reading, reading - 0.01 if used else None, "" if used else EVIL
    )


def test_run_panels_draw_every_run_grouped_by_condition():
    panels = [panel(k, used=k != 4) for k in range(7)]
    figure = run_panels(panels, "temperature", "°C", 0.02, columns=3)
    (axes,) = figure.axes
    titles = [t.get_text() for t in axes.texts if " · " in t.get_text()]
    assert [t[:4] for t in titles] == ["0000", "0003", "0006", "0001", "0004", "0002", "0005"]
    dots = {
        line.get_color(): np.isfinite(line.get_xydata()).all(axis=1).sum()
        for line in axes.lines
        if line.get_marker() == "."
    }
    assert dots[BLUE] == 6 * 120
    assert dots[GREY] == 120
    assert dots[INK] == 6 * 120  # residuals of what was fitted alone
    model = next(line for line in axes.lines if line.get_color() == RED)
    assert np.isnan(model.get_xdata()).sum() == 6  # one line that is interrupted between the runs
    assert len(figure_bytes(figure, dpi=40)) > 5000
    with pytest.raises(ValueError, match="no runs"):
        run_panels([], "temperature", "°C")


def residual_run(k):
    time = np.linspace(-2, 30, 300)
    residual = np.full(300, 0.1 * (k + 1))
    return ResidualRun(
        f"{k}",
        time,
        residual,
        "up" if k % 2 else "down",
        10.0 * (k // 2),
        [2.0, None][k % 2],
        [10.0, 10.2, 40.0][k % 3],
    )


def test_residual_overview_colours_by_each_factor():
    figure = residual_overview([residual_run(k) for k in range(6)], "K", 0.02)
    legends = [[t.get_text() for t in axes.get_legend().get_texts()] for axes in figure.axes]
    assert legends == [["up", "down"], ["0", "10", "20"], ["2", "unknown"], ["10", "40"]]
    for axes in figure.axes:
        # the runs of a colour are one line that is interrupted between them
        curves = [line.get_ydata() for line in axes.lines if np.isnan(line.get_ydata()).any()]
        assert len(curves) == len(axes.get_legend().get_texts())
        firsts = [y[np.flatnonzero(np.isfinite(y) & np.isnan(np.append(np.nan, y[:-1])))] for y in curves]
        assert sorted(np.concatenate(firsts)) == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    assert figure_bytes(figure, dpi=40)


@given(st.lists(st.floats(0.051, 500.0), min_size=1, max_size=60))
def test_log_bins_keep_the_mean_and_lose_no_sample(times):
    time, mean = log_bins(np.array(times), np.array(times))
    assert np.all(np.diff(time) > 0) and mean == pytest.approx(time)
    assert time[0] >= min(times) * (1 - 1e-9) and time[-1] <= max(times) * (1 + 1e-9)


def test_before_after_states_the_errors():
    time = np.linspace(0.1, 30, 200)
    runs = [BeforeAfter("1", time, np.full(200, 0.3), np.full(200, -0.04))]
    titles = [axes.get_title(loc="left") for axes in before_after(runs, "K", 0.05).axes]
    assert titles == ["before: 0.3 K rms", "after: 0.04 K rms", "after, enlarged"]
    shown = before_after(runs, "K", 0.05).axes[0].xaxis
    assert [t.get_text() for t in shown.get_ticklabels()] == ["0.1", "1", "10"] and shown.get_scale() == "log"
    assert before_after(runs, "K", 0.05, rms=(0.9, 0.1)).axes[0].get_title(loc="left") == "before: 0.9 K rms"


def test_autocorrelation_has_the_band_of_white_noise():
    axes = small_figure().axes[0]
    assert axes.patches[0].get_height() == pytest.approx(2 * 1.96 / 20)


def test_cause_bars_stand_in_order_with_the_kept_ones_filled():
    axes = cause_bars(["a", "b", "c"], [3.0, 900.0, -1.0], [False, True, False], 4.0).axes[0]
    assert [t.get_text() for t in axes.get_yticklabels()] == ["c", "a", "b"]
    assert [bar.get_width() for bar in axes.patches] == [-1.0, 3.0, 900.0]
    assert len({bar.get_facecolor() for bar in axes.patches[:2]}) == 1
    assert axes.patches[2].get_facecolor() != axes.patches[0].get_facecolor()


def test_diffusivity_and_run_parameters_show_their_values():
    table = Curve(np.array([0.0, 20.0, 40.0]), np.array([1e-12, 3e-12, 9e-12]), np.array([1e-14, 3e-14, 9e-14]))
    figure = diffusivity(table, table, runs=table, truth=(table.temperature_c, table.value))
    assert "10⁻¹² m²/s" in figure.axes[0].get_ylabel()
    assert figure.axes[0].lines[0].get_ydata() == pytest.approx([1.0, 3.0, 9.0])
    assert figure.axes[1].lines[0].get_xdata() == pytest.approx(1000 / (table.temperature_c + 273.15))
    runs = [RunParameter(str(k), 7.5e-8, 1e-10, "up" if k else "down", 20.0, None, 5.0 * k) for k in range(3)]
    figure = parameter_by_condition(runs, "alpha", "m²/s", (7.5e-8, 1e-10), "K")
    assert figure.axes[0].get_ylabel() == "alpha, 10⁻⁸ m²/s"
    assert [t.get_text() for t in figure.axes[1].texts] == ["unknown"]
    assert figure_bytes(figure)


def test_drawing_leaves_the_callers_settings_alone():
    import matplotlib

    with matplotlib.rc_context({"font.size": 17.0, "axes.grid": False}):
        figure = small_figure()
        assert (matplotlib.rcParams["font.size"], matplotlib.rcParams["axes.grid"]) == (17.0, False)
    assert figure_bytes(figure) == figure_bytes(small_figure())


@pytest.mark.parametrize(
    ("first_s", "last_s", "named"),
    [
        (-10.0, 60.0, [-5, 0, 1, 5, 20, 60]),
        (0.0, 13000.0, [0, 150, 1000, 3000, 10000]),
        (-2.0, 900.0, [0, 20, 60, 150, 400]),
    ],
)
def test_times_of_an_axis_are_so_far_apart_that_each_can_be_read(first_s, last_s, named):
    assert times_named(first_s, last_s).tolist() == named
