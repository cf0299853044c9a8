"""Writes a protocol as its file has it (TOML, shock-protocol/1), so that `load_protocol` reads back the same plan."""

from __future__ import annotations

import json
from dataclasses import fields

from shockrig.rig.protocol import FORMAT, STEPS, Faults, PlannedRun, Protocol, Step
from shockrig.rig.seams import Air

NAMES = {kind: name for name, kind in STEPS.items()}


def protocol_text(protocol: Protocol) -> str:
    """A protocol as the text of its file; runs with the same steps share one recipe."""
    recipes: dict[tuple[Step, ...], str] = {}
    for run in protocol.runs:
        recipes.setdefault(run.steps, f"recipe_{len(recipes) + 1}")
    lines = [
        f'format = "{FORMAT}"',
        f"name = {_quoted(protocol.name)}",
        f"description = {_quoted(protocol.description)}",
        *(["by_hand = true"] if protocol.by_hand else []),
        *([f"continues = {protocol.continues}"] if protocol.continues else []),
        "",
        "[faults]",
        *(f"{field.name} = {getattr(protocol.faults, field.name)!r}" for field in fields(Faults)),
        "",
        "[steps]",
    ]
    for steps, name in recipes.items():
        lines += [f"{name} = [", *(f"  {_step(step)}," for step in steps), "]"]
    for run in protocol.runs:
        lines += ["", *_run(run, recipes[run.steps])]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    """A basic string of TOML, which has JSON's escapes."""
    return json.dumps(text)


def _step(step: Step) -> str:
    numbers = "".join(f", {field.name} = {getattr(step, field.name)!r}" for field in fields(step))
    return f'{{ do = "{NAMES[type(step)]}"{numbers} }}'


def _air(air: Air) -> str:
    known = ((name, getattr(air, name)) for name in ("temperature_c", "humidity_percent"))
    inside = ", ".join(f"{name} = {value!r}" for name, value in known if value is not None)
    return f"{{ {inside} }}" if inside else "{}"


def _run(run: PlannedRun, recipe: str) -> list[str]:
    return [
        f"[[run]]  # {run.id}",
        *([f"note = {_quoted(run.note)}"] if run.note else []),
        f"source = {_air(run.source)}",
        f"destination = {_air(run.destination)}",
        *([f"airflow_m_s = {run.airflow_m_s!r}"] if run.airflow_m_s is not None else []),
        *(
            f"{name} = {value!r}"
            for name in ("pressure_hpa", "irradiance_w_m2")
            if (value := getattr(run, name)) is not None
        ),
        *([f"transfer = {{ duration_s = {run.transfer_s!r} }}"] if run.transfer_s is not None else []),
        f'steps = "{recipe}"',
    ]
