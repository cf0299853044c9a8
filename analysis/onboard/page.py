"""The page beside a generated program: what it can, what it cannot, and how near to its reference it is."""

from __future__ import annotations

from importlib.resources import files
from typing import Protocol

from shockrig.analysis.flight.causal_design import Design
from shockrig.analysis.flight.readout import not_causal, not_undone
from shockrig.analysis.onboard.source import state_bytes
from shockrig.files.profile import Profile


class Measured(Protocol):
    """Largest differences between a program and its reference on one flight."""

    @property
    def rows(self) -> int: ...
    @property
    def temperature_k(self) -> float: ...
    @property
    def temperature_uncertainty_k(self) -> float: ...
    @property
    def humidity_percent(self) -> float: ...
    @property
    def humidity_uncertainty_percent(self) -> float: ...
    @property
    def one_sided(self) -> int: ...


def page(
    profile: Profile, design: Design, name: str, note: str, flight: str | None, measured: Measured | None, why: str
) -> str:
    """The page as Markdown; `why` it was not measured where it was not."""
    assert design.humidity is not None
    left = [
        line
        for channel, part in (("temperature", profile.temperature), ("humidity", profile.humidity))
        if part is not None
        for line in not_undone(part.effects, channel, part.discovered, not_causal)
    ]
    low, high = design.humidity.covers_c
    values = {
        "PROFILE": name,
        "NOTE": note,
        "STATE_BYTES": str(state_bytes(design)),
        "LOW_C": f"{low:g}",
        "HIGH_C": f"{high:g}",
        "PERIOD_S": f"{design.period_s:g}",
        "LEFT": "".join(f"- Undo what {line[0].lower()}{line[1:]}.\n" for line in left),
        "MEASURED": _measured(flight, measured, why),
    }
    text = (files("shockrig.data") / "onboard" / "README.md").read_text(encoding="utf-8")
    for key, value in values.items():
        text = text.replace(f"@{key}@", value)
    return text


def _measured(flight: str | None, measured: Measured | None, why: str) -> str:
    if measured is None:
        return (
            f"Not measured: {why}. With a log of yours and a C compiler\n"
            "`shockrig onboard PROFILE --out DIR --flight LOG` compares them row by row."
        )
    one_sided = "none" if not measured.one_sided else str(measured.one_sided)
    return f"""The C program, built with this computer's compiler, against `shockrig correct --method causal` in double
precision, on the {measured.rows} rows of {flight}. Largest differences:

| | value | standard uncertainty |
|---|---|---|
| temperature [K] | {measured.temperature_k:.2g} | {measured.temperature_uncertainty_k:.2g} |
| humidity [%RH] | {measured.humidity_percent:.2g} | {measured.humidity_uncertainty_percent:.2g} |

Values that one of both gave and the other did not: {one_sided}."""
