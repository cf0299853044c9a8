"""A causal design as a program: templates of data/onboard filled with numbers and tables, and the page beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight import causal, causal_bank, causal_guard
from shockrig.analysis.flight.air_prior import OU_VARIANCES, RATES_PER_S, UNSEEN_VARIANCE
from shockrig.analysis.flight.causal_bank import AIR_STATES, FILTER_COUNT
from shockrig.analysis.flight.causal_design import (
    AIRSPEEDS_M_S,
    STRENGTH_COUNT,
    ChannelDesign,
    Design,
    DesignTable,
    design_of,
)
from shockrig.analysis.flight.flight_channel import LONGEST_FILL_S, LONGEST_REPEAT_S
from shockrig.analysis.flight.screen import (
    FEWEST_CHANGES,
    FEWEST_ROWS,
    GAP_PERIODS,
    LONE_SIGMAS,
    LONGEST_GAP_S,
    SPIKE_STEPS,
)
from shockrig.analysis.flight.smooth_channel import MOST_PARTS
from shockrig.analysis.flight.stretches import (
    BURST_FACTORS,
    BY_CHANCE,
    MOST_SHARE,
    NORM_1,
    NORM_3,
    ROUNDING_FACTOR,
    STUCK_LEVELS,
    WHITE_SHARE,
    WINDOW_ROWS,
)
from shockrig.analysis.flight.sweep import COARSE_IN_NOISE
from shockrig.analysis.flight.undo_readout import not_causal, not_undone
from shockrig.analysis.physics.air_exchange import REFERENCE_AIRFLOW_M_S
from shockrig.files.errors import InputError
from shockrig.files.profile import Profile
from shockrig.files.sentinels import LEAST_JUMP

Array = NDArray[np.float64]
MOST_STATE_BYTES = 2048
REST_BYTES = 248  # of a state beside its filters and strengths: two guards, the clock, what is held, and padding
FEWEST_MODES = 2
TABLES, LUA_TABLES = "/*@TABLES@*/", "@TABLES@"
C_FILES = ("shock_correct.h", "shock_correct.c", "csv_main.c", "Makefile")


@dataclass(frozen=True)
class ProgramDifference:
    """Largest differences of values and uncertainties over a flight's rows, and values that one of both gave alone."""

    rows: int
    temperature_k: float
    temperature_uncertainty_k: float
    humidity_percent: float
    humidity_uncertainty_percent: float
    one_sided: int


def flown(profile: Profile, period_s: float | None = None) -> Design:
    """The design that a generated program holds: as many of the bodies' modes as fit into its state.

    Raises
    ------
    InputError
        The profile lacks a sensor, its hygrometer is read later than its thermometer, or it has too many lags.
    """
    if profile.temperature is None or profile.humidity is None:
        lacking = "temperature" if profile.temperature is None else "humidity"
        raise InputError(
            f"profile: no {lacking} part; a program on board needs both sensors, because humidity is reckoned with the "
            "corrected temperature; correct such a log with shockrig correct"
        )
    for modes in range(4, FEWEST_MODES - 1, -1):
        design = design_of(profile, period_s, most_modes=modes)
        if state_bytes(design) <= MOST_STATE_BYTES:
            break
    else:
        raise InputError(
            f"profile: its lags need {state_bytes(design)} bytes of state, and {MOST_STATE_BYTES} are the most; take a "
            "slow share out of the profile"
        )
    bead, film = design.temperature, design.humidity
    assert bead is not None and film is not None
    if film.delay_s - bead.delay_s >= 0.5 * design.period_s:
        raise InputError(
            f"profile: the hygrometer is read {film.delay_s - bead.delay_s:.2g} s later than the thermometer, which a "
            "program on board cannot wait for; correct the log with shockrig correct"
        )
    return design


@dataclass(frozen=True)
class _Sensor:
    """One channel of a program."""

    name: str
    design: ChannelDesign
    passing: bool  # whether something passes sensor and air alike
    quantity: str
    spread: float

    @property
    def states(self) -> int:
        """How many states each of its filters has."""
        return AIR_STATES + self.design.modes + 2 * self.passing

    @property
    def strengths(self) -> tuple[Array, Array]:
        """What is weighed: vapour's turbulence has a usual strength, by the temperature's."""
        return causal_bank.strengths_weighed(self.design.ladder if self.name == "BEAD" else None)

    def numbers(self) -> dict[str, float]:
        """By the names of the programs' fields, in their order."""
        d = self.design
        return {
            "noise": d.noise,
            "share": min(d.share, 1.0),
            "low": d.possible[0],
            "high": d.possible[1],
            "swing": d.swing,
            "ceiling": d.ceiling,
            "left": d.left,
            "delay_s": d.delay_s,
            "lowest": d.ladder.lowest,
            "highest": d.ladder.highest,
            "door": d.ladder.door,
            "low_c": d.covers_c[0],
            "high_c": d.covers_c[1],
            "straight_s": d.straight_s,
            "unsure_of_airspeed": d.unsure_of_airspeed,
            "spread": self.spread,
        }


def _sensors(design: Design) -> tuple[_Sensor, _Sensor]:
    assert design.temperature is not None and design.humidity is not None
    return (
        _Sensor("BEAD", design.temperature, False, "temperature", causal.START_K),
        _Sensor("FILM", design.humidity, not design.by_activity, "humidity", causal.START_PERCENT),
    )


def state_bytes(design: Design) -> int:
    """Memory that a program needs, at most."""
    sizes = [one.states for one in _sensors(design)]
    floats = sum(FILTER_COUNT * (n + n * (n + 1) // 2) + causal_bank.STRENGTHS_WEIGHED for n in sizes)
    return 4 * floats + REST_BYTES


def c_source(design: Design, profile_name: str, note: str) -> dict[str, str]:
    """The C files by name."""
    values = _numbers(design, _single) | {"PROFILE": _comment(profile_name), "NOTE": _comment(note)}
    sources = {}
    for name in C_FILES:
        text = (files("shockrig.data") / "onboard" / name).read_text(encoding="utf-8")
        for key, value in values.items():
            text = text.replace(f"@{key}@", value)
        sources[name] = text.replace(TABLES, _c_tables(design)) if TABLES in text else text
    return sources


def lua_source(design: Design, profile_name: str) -> str:
    """The Lua file."""
    text = (files("shockrig.data") / "onboard" / "shock_correct.lua").read_text(encoding="utf-8")
    for key, value in (_numbers(design, _lua_number) | {"PROFILE": _comment(profile_name)}).items():
        text = text.replace(f"@{key}@", value)
    return text.replace(f"--{LUA_TABLES}", _lua_tables(design))


def _comment(text: str) -> str:
    """Text that ends no comment and no line."""
    return " ".join(text.replace("*/", "* /").replace("/*", "/ *").split())


def _single(value: float) -> str:
    """A number of single precision in C."""
    if not np.isfinite(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    text = f"{float(np.float32(value)):.9g}"
    return text + ("f" if any(mark in text for mark in ".e") else ".0f")


def _numbers(design: Design, number: Callable[[float], str]) -> dict[str, str]:
    """What templates name, as text."""
    longest = max(LONGEST_GAP_S, GAP_PERIODS * design.period_s)
    counts = {f"{one.name}_STATES": one.states for one in _sensors(design)} | {
        "STATE_BYTES": state_bytes(design),
        "FEWEST_CHANGES": FEWEST_CHANGES,
        "DECIMAL_COUNT": len(causal_guard.DECIMAL_STEPS),
        "CHANGES_KEPT": causal_guard.CHANGES_KEPT,
        "LASTING": causal_guard.LASTING_ROWS,
        "STRENGTHS": STRENGTH_COUNT,
        "WIDTH_STEPS": causal_bank.WIDTH_STEPS,
        "WEIGHED": causal_bank.STRENGTHS_WEIGHED,
        "LONGEST_US": round(longest * 1e6),
        "LONGEST_MS": round(longest * 1e3),
        "FEWEST_ROWS": FEWEST_ROWS,
    }
    lists: dict[str, Sequence[float] | Array] = {
        "RATES": RATES_PER_S,
        "OU_VARIANCES": OU_VARIANCES,
        "TURBULENCE": causal_bank.TURBULENCE,
        "BENDS": (*2 * (causal_bank.BEND_IN_TURBULENCE,), causal_bank.BEND_OVER_DOOR, 1.0),
        "DECIMAL_STEPS": causal_guard.DECIMAL_STEPS,
    }
    decimals = _of_filters(design) | _of_guards() | {"LONGEST_S": longest}
    return (
        {name: number(float(value)) for name, value in decimals.items()}
        | {name: str(value) for name, value in counts.items()}
        | {name: ", ".join(number(float(v)) for v in values) for name, values in lists.items()}
    )


def _unread_s(design: Design) -> float:
    """How long a hygrometer is heard without a thermometer."""
    return max(causal.UNREAD_S, causal.UNREAD_PERIODS * design.period_s)


def _of_filters(design: Design) -> dict[str, float]:
    """Numbers of the filters and of what is around them."""
    return {
        "LEAST_AIRSPEED": AIRSPEEDS_M_S[0],
        "CONFIDENCE": causal_bank.CONFIDENCE,
        "ERF": causal_bank.ERF,
        "ERF_BEND": causal_bank.ERF_BEND,
        "ERF_ENDS": causal_bank.ERF_ENDS,
        "NORMAL_WIDTH": causal_bank.NORMAL_WIDTH,
        "WIDTH_SETTLED": causal_bank.WIDTH_SETTLED,
        "CHANGE_S": causal_bank.STRENGTH_LASTS_S,
        "BENDS_S": causal_bank.BETWEEN_BENDS_S,
        "BEND_S": causal_bank.BEND_LASTS_S,
        "DOORS_S": causal_bank.BETWEEN_DOORS_S,
        "DOOR_S": causal_bank.DOOR_LASTS_S,
        "MOST_PARTS": MOST_PARTS,
        "UNSEEN": UNSEEN_VARIANCE,
        "VAPOUR": causal.VAPOUR_PER_K,
        "PERIOD_STEP": design.period_s,
        "LEAST_VARIANCE": causal_bank.LEAST_VARIANCE,
        "MOST_UNLIKELY": causal_bank.MOST_UNLIKELY,
        "LEAST_LIKELY": causal_bank.LEAST_LIKELY,
        "LEAST_SHARE": causal_bank.LEAST_SHARE,
        "FAR_C": causal.FAR_C,
        "REFERENCE_AIRSPEED": REFERENCE_AIRFLOW_M_S,
        "LONGEST_FILL": LONGEST_FILL_S,
        "LONGEST_REPEAT": LONGEST_REPEAT_S,
        "UNREAD": _unread_s(design),
    }


def _of_guards() -> dict[str, float]:
    """Numbers of the guards."""
    size = causal_guard.MEAN_SIZE
    return {
        "COARSE": COARSE_IN_NOISE,
        "WHITE": WHITE_SHARE,
        "SOFT": causal_guard.SOFT_EDGE,
        "LEAST_NOISE": causal_guard.LEAST_NOISE,
        "MOST_NOISE": causal_guard.MOST_NOISE,
        "LOUD": BURST_FACTORS[WINDOW_ROWS],
        "MOST_SHARE": MOST_SHARE,
        "THIRD": float(NORM_3) * size,
        "FIRST": float(NORM_1) * size,
        "MOST_DIFFERENCE": causal_guard.MOST_DIFFERENCE,
        "BURST_ROWS": causal_guard.BURST_ROWS,
        "NOISE_ROWS": causal_guard.NOISE_ROWS,
        "REPEATS_ROWS": causal_guard.REPEATS_ROWS,
        "WRITTEN_WITHIN": causal_guard.WRITTEN_WITHIN,
        "LEVELS": STUCK_LEVELS * ROUNDING_FACTOR,
        "LEVELS_PLAIN": STUCK_LEVELS,
        "MEAN_SIZE": size,
        "TIMES_BY_CHANCE": causal_guard.TIMES_BY_CHANCE,
        "LN_BY_CHANCE": float(np.log(BY_CHANCE)),
        "LONE": LONE_SIGMAS,
        "SPIKE": SPIKE_STEPS,
        "LEAST_JUMP": LEAST_JUMP,
        "NEAR_CODE": causal_guard.NEAR_CODE,
    }


def _c_tables(design: Design) -> str:
    """The profile's tables and numbers as constants."""
    parts = [
        f"#define DIE_SHARE {_single(design.die_share)}",
        f"#define BESIDE_BEAD {int(design.beside_bead)}",
        f"#define BY_ACTIVITY {int(design.by_activity)}",
        f"#define UNREAD_S {_single(_unread_s(design))}",
        "",
    ]
    for one in _sensors(design):
        name, channel, tables = one.name, one.design, []
        for what, table in (("RESPONSE", channel.response), ("READOUT", channel.readout)):
            parts += _c_table(f"{name}_{what}", table)
            axes = table.temperature_c, table.ln_airspeed, table.ln_pressure
            nodes = ", ".join(str(axis.size) for axis in axes)
            places = ", ".join(f"{name}_{what}_{axis}" for axis in ("C", "AIRSPEED", "PRESSURE"))
            tables.append(f"{{{{{nodes}}}, {table.values.shape[-1]}, {{{places}}}, {name}_{what}_VALUES}}")
        codes = causal_guard.CODES_WITHIN[one.quantity]
        parts += _c_array(f"{name}_SLOW", channel.slow_uncertainty or (0.0,))
        parts += _c_array(f"{name}_CODES", codes)
        parts += _c_array(f"{name}_RESOLVED", np.log(channel.resolved_rate))
        ln_strengths, before = one.strengths
        parts += _c_array(f"{name}_STRENGTHS", np.exp(ln_strengths)) + _c_array(f"{name}_LN_STRENGTHS", ln_strengths)
        parts += _c_array(f"{name}_BEFORE", before)
        counts = (channel.modes, channel.slow, int(one.passing), one.states, len(codes))
        parts.append(
            f"static const design {name} = {{{', '.join(map(str, counts))},\n  {tables[0]},\n  {tables[1]},\n"
            f"  {name}_SLOW, {name}_CODES, {name}_RESOLVED,\n"
            f"  {name}_STRENGTHS, {name}_LN_STRENGTHS, {name}_BEFORE,\n"
            f"  {', '.join(_single(v) for v in one.numbers().values())}}};\n"
        )
    return "\n".join(parts)


def _c_table(name: str, table: DesignTable) -> list[str]:
    axes = {"C": table.temperature_c, "AIRSPEED": table.ln_airspeed, "PRESSURE": table.ln_pressure}
    parts = []
    for axis, values in axes.items():
        parts += _c_array(f"{name}_{axis}", values)
    return parts + _c_array(f"{name}_VALUES", table.values.ravel())


def _c_array(name: str, values: Sequence[float] | Array) -> list[str]:
    lines, line = [f"static const float {name}[] = {{"], ""
    for value in np.asarray(values, dtype=float).tolist():
        text = f"{_single(value)}, "
        if len(line) + len(text) > 110:
            lines.append("  " + line.rstrip())
            line = ""
        line += text
    return [*lines, "  " + line.rstrip(", ") + "};"]


def _lua_number(value: float) -> str:
    if not np.isfinite(value):
        return "math.huge" if value > 0 else "-math.huge"
    text = f"{float(np.float32(value)):.9g}"
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def _lua_list(values: Sequence[float] | Array) -> str:
    return "{" + ", ".join(_lua_number(v) for v in np.asarray(values, dtype=float).ravel().tolist()) + "}"


def _lua_tables(design: Design) -> str:
    """The profile's tables and numbers as Lua's."""
    beside, by_activity = ("true" if yes else "false" for yes in (design.beside_bead, design.by_activity))
    parts = [f"local DIE_SHARE, BESIDE_BEAD, BY_ACTIVITY = {_lua_number(design.die_share)}, {beside}, {by_activity}"]
    for one in _sensors(design):
        channel = one.design
        fields = [f"modes = {channel.modes}, slow = {channel.slow}, size = {one.states}"]
        fields.append(f"passing = {'true' if one.passing else 'false'}")
        fields += [f"{key} = {_lua_number(value)}" for key, value in one.numbers().items()]
        fields.append(f"codes = {_lua_list(causal_guard.CODES_WITHIN[one.quantity])}")
        fields.append(f"slow_uncertainty = {_lua_list(channel.slow_uncertainty)}")
        fields.append(f"ln_resolved = {_lua_list(np.log(channel.resolved_rate))}")
        fields += [f"{k} = {_lua_list(v)}" for k, v in zip(("ln_strengths", "before"), one.strengths, strict=True)]
        for what, table in (("response", channel.response), ("readout", channel.readout)):
            axes = ", ".join(_lua_list(axis) for axis in (table.temperature_c, table.ln_airspeed, table.ln_pressure))
            columns = table.values.shape[-1]
            fields.append(f"{what} = {{columns = {columns}, axes = {{{axes}}}, values = {_lua_list(table.values)}}}")
        parts.append(f"local {one.name} = {{\n  " + ",\n  ".join(fields) + "\n}")
    return "\n".join(parts)


def page(
    profile: Profile,
    design: Design,
    name: str,
    note: str,
    flight: str | None,
    measured: ProgramDifference | None,
    why: str,
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


def _measured(flight: str | None, measured: ProgramDifference | None, why: str) -> str:
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
