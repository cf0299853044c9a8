"""What was fitted at an ambient, said: the diffusivity, of a sensor that is one lag its time constant."""

from __future__ import annotations

from shockrig.analysis.characterize.result import TableRow
from shockrig.analysis.estimate.channel import Channel
from shockrig.files.headline import first_order
from shockrig.files.numbers import measured


def rate_text(channel: Channel, row: TableRow, unit: str = "s") -> str:
    """Value and standard uncertainty, with the unit: m²/s, or `unit` of a lumped sensor's time constant."""
    if channel.lumped:
        return measured(*first_order(channel.length_m, row.diffusivity_m2_s, row.standard_uncertainty), unit)
    return measured(row.diffusivity_m2_s, row.standard_uncertainty, "m²/s")


def rate_label(channel: Channel, ambient_c: float) -> str:
    """What it is called, with its ambient [°C] where it depends on that."""
    label = channel.quantity.diffusivity_label(ambient_c)
    if channel.lumped:
        label = label.replace(channel.quantity.symbol, f"tau, {channel.name}", 1)
    return label
