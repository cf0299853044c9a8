"""The live view in the terminal: state, steps, values, health and the transient as a plot of Braille dots.

A Braille character (U+2800 + bits) holds 2 x 4 dots. Text from files is shown as text: no markup is read from it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from shockrig.protocols.run_progress import duration
from shockrig.protocols.watch import step_back
from shockrig.rig.watch.follow import Follower
from shockrig.rig.watch.view import Health, PromptView, ViewTrace, WatchView

# bit of a dot by row (0 at the top) and column
DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
PLOT_ROWS = 6
PLOT_EXTRA_ROWS = 3  # blank line, title, axis
PROMPT_ROWS = 9
RUNS_SHOWN = 5
MESSAGES_SHOWN = 4
STYLES = {
    "recording": "bold green",
    "asking": "bold black on yellow",
    "ended": "bold",
    "idle": "bold",
    "stalled": "bold yellow",
    "cut off": "bold red",
    "good": "green",
    "failing": "yellow",
    "silent": "red",
    "waiting": "dim",
}
MARKS = {"done": "x", "now": ">", "next": " ", "recorded": "x", "missing": " "}


def plot(points: Sequence[tuple[float, float]], width: int, height: int, ascii_only: bool = False) -> list[str]:
    """Points as rows of `width` characters, filling the range of both axes."""
    across, down = (1, 1) if ascii_only else (2, 4)
    columns, rows = width * across, height * down
    if not points:
        return [" " * width] * height
    (x0, x1), (y0, y1) = ((min(axis), max(axis)) for axis in zip(*points, strict=True))
    cells = [[0] * width for _ in range(height)]
    for x, y in points:
        column = round((x - x0) / (x1 - x0) * (columns - 1)) if x1 > x0 else columns - 1
        row = round((y1 - y) / (y1 - y0) * (rows - 1)) if y1 > y0 else rows // 2
        cells[row // down][column // across] |= 1 if ascii_only else DOTS[row % 4][column % 2]
    if ascii_only:
        return ["".join("*" if cell else " " for cell in line) for line in cells]
    return ["".join(chr(0x2800 + cell) for cell in line) for line in cells]


def render(view: WatchView, width: int, height: int, ascii_only: bool = False) -> Any:
    """The view as something that rich can print; the plots take the rows that the rest leaves, one each at least."""
    from rich.console import Group
    from rich.text import Text

    latest = view.messages[-MESSAGES_SHOWN:]
    messages = [Text(text, style="yellow", no_wrap=True, overflow="ellipsis") for text in latest]
    prompt = [] if view.prompt is None else [_prompt(view.prompt)]
    alarms = [Text(f" {one} ", "bold white on red", no_wrap=True, overflow="ellipsis") for one in view.alarms]
    above = [*prompt, *alarms, _head(view), Text(""), _steps(view), Text(""), _sensors(view.health), *messages]
    others = (
        10
        + PROMPT_ROWS * len(prompt)
        + len(alarms)
        + len(view.steps)
        + len(view.health)
        + len(messages)
        + min(RUNS_SHOWN, len(view.runs))
    )
    rows = (height - others) // max(1, len(view.traces)) - PLOT_EXTRA_ROWS
    traces: list[Any] = [Text("")]
    for trace in view.traces:
        traces.append(_trace(trace, view, width, min(rows, PLOT_ROWS), ascii_only))
    return Group(*above, *traces, _plan(view))


def _prompt(prompt: PromptView) -> Any:
    """What the operator must do now: the largest thing there is, a framed block over the whole width."""
    from rich.panel import Panel
    from rich.text import Text

    text = Text(prompt.text, style="bold", justify="center")
    text.append(f"\n\n{prompt.keys}", style="not bold")
    left = "" if prompt.left_s is None else f"  {duration(prompt.left_s)} left  "
    return Panel(text, title=" YOUR TURN ", subtitle=left, style="black on yellow", padding=(1, 2), expand=True)


def _head(view: WatchView) -> Any:
    from rich.text import Text

    text = Text(no_wrap=True, overflow="ellipsis")
    text.append(view.state, style=STYLES.get(view.state, ""))
    if view.state == "stalled" and view.heard_s is not None:
        text.append(f" for {duration(view.heard_s)}")
    text.append(f"  {view.campaign}", style="bold").append(f"  {view.protocol} on {view.bench}", style="dim")
    text.append("\n" + view.summary())
    if view.left_s is not None and view.left_at_most_s is not None:
        left = f"  about {duration(view.left_s)} left, at most {duration(view.left_at_most_s)}"
        text.append(left, style="bold cyan")
    return text


def _steps(view: WatchView) -> Any:
    from rich.text import Text

    text = Text(no_wrap=True, overflow="ellipsis")
    text.append(f"run {view.run or '-'}", style="bold")
    if view.attempt > 1:
        text.append(f" (attempt {view.attempt})", style="yellow")
    for step in view.steps:
        style = {"now": "bold", "done": "dim", "next": ""}[step.state]
        text.append(f"\n {MARKS[step.state]} {step.text}", style=style)
        if step.state == "now" and view.step_s is not None and view.step_left_s is not None:
            text.append(f"  {duration(view.step_s)}", style="cyan")
            text.append(f", {duration(view.step_left_s)} left" if view.step_left_s > 0 else "", style="cyan")
    return text


def _sensors(health: Sequence[Health]) -> Any:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, header_style="dim")
    for name in ("sensor", "health", "value", "good/s", "last 10 s"):
        table.add_column(name, justify="left")
    for one in health:
        values = "  ".join(value_words(name, value) for name, value in one.values.items())
        counts = ", ".join(f"{n} {outcome}" for outcome, n in one.outcomes.items())
        state = Text(one.state, style=STYLES[one.state])
        table.add_row(Text(one.sensor), state, Text(values), Text(f"{one.per_s:.3g}"), Text(counts))
    return table


def value_words(name: str, value: float) -> str:
    """A value with its unit, from a name that carries it."""
    for suffix, unit, digits in (("_c", "degC", 2), ("_percent", "%RH", 1), ("_ohm", "ohm", 0), ("_hpa", "hPa", 1)):
        if name.endswith(suffix):
            return f"{value:.{digits}f} {unit}"
    return f"{name} {value:.5g}"


def _trace(trace: ViewTrace, view: WatchView, width: int, height: int, ascii_only: bool) -> Any:
    """A plot under its title, or both in one line where there is no room for more than one row."""
    from rich.text import Text

    values = [value for _, value in trace.points]
    if height < 2:
        head = f"{trace.sensor} {trace.quantity} {min(values):.1f} to {max(values):.1f} {trace.unit} "
        (row,) = plot(trace.points, max(10, width - len(head) - 1), 1, ascii_only)
        return Text(head, style="bold").append(row, style="cyan")
    edge = 9
    rows = plot(trace.points, max(20, min(100, width - edge - 1)), height, ascii_only)
    labels = [f"{max(values):.2f}", *[""] * (height - 2), f"{min(values):.2f}"]
    text = Text(f"{trace.sensor} {trace.quantity} in {trace.unit}", style="bold")
    for label, row in zip(labels, rows, strict=True):
        text.append(f"\n{label:>{edge - 1}} ", style="dim").append(row, style="cyan")
    left_s, right_s = trace.points[0][0], trace.points[-1][0]
    text.append(f"\n{'':{edge}}{left_s:.1f} s to {right_s:.1f} s", style="dim")
    if view.transfer_s is not None:
        text.append(f", transfer at {view.transfer_s[0]:.2f} s", style="dim")
    return text.append("\n")


def _plan(view: WatchView) -> Any:
    from rich.text import Text

    states = [run.state for run in view.runs]
    now = states.index("now") if "now" in states else len(states)
    first = max(0, min(now - 1, len(view.runs) - RUNS_SHOWN))
    text = Text("plan", style="bold", no_wrap=True, overflow="ellipsis")
    for run in view.runs[first : first + RUNS_SHOWN]:
        mark = ">" if run.state == "now" else MARKS[run.state]
        words = f"\n {mark} {run.id}  {run.source} -> {run.destination}"
        text.append(words, style={"now": "bold", "recorded": "dim"}.get(run.state, ""))
        text.append(f"  {run.note}" if run.note else "", style="dim")
        text.append(f"  {run.set_aside} set aside" if run.set_aside else "", style="yellow")
    later = len(view.runs) - first - RUNS_SHOWN
    text.append(f"\n   and {later} more" if later > 0 else "", style="dim")
    return text


def watch_terminal(follower: Follower, wait: Callable[[float], None], every_s: float, once: bool) -> None:
    """Show the campaign until it has ended; a single picture where `once` or where nobody sits at a terminal."""
    from rich.console import Console
    from rich.live import Live

    console = Console(highlight=False)
    ascii_only = not console.encoding.lower().startswith("utf")
    if once or not console.is_terminal:
        console.print(render(follower.look(), console.width, console.height, ascii_only))
        return
    step_back()
    view = follower.look()
    rung: tuple[str, ...] = ()
    with Live(console=console, screen=True, auto_refresh=False, vertical_overflow="crop") as live:
        while True:
            told = (*view.alarms, *([] if view.prompt is None else [view.prompt.text]))
            if set(told) - set(rung):
                console.bell()
            rung = told
            live.update(render(view, console.width, console.height, ascii_only), refresh=True)
            if view.state in ("ended", "cut off"):
                break
            wait(every_s)
            view = follower.look()
    console.print(render(view, console.width, console.height, ascii_only))
