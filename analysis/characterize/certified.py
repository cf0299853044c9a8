"""A characterization as a certificate: its figures with their budgets, and what a reader must know besides."""

from __future__ import annotations

import json
import uuid
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import date, timedelta
from typing import Any

from shockrig.analysis.characterize.budget import Budget, budgets
from shockrig.analysis.characterize.response_times import ResponseAir
from shockrig.analysis.characterize.result import Characterization
from shockrig.analysis.estimate.quantity import QUANTITIES
from shockrig.files.campaign import Campaign
from shockrig.files.campaign_names import dated, sensor_and_probe
from shockrig.files.certificate import (
    BudgetLine,
    Certificate,
    CertifiedFigure,
    Traced,
    certificate_document,
    finite,
    rounded,
)
from shockrig.files.common_uncertainty import NOTHING_COMMON, ORDINARY_LABORATORY

NAMESPACE = uuid.UUID("6f1c2f0e-6b3e-4c2b-9a52-6c1a0d9a7f11")  # of certificates' identifiers
FEW_DEGREES = 100.0  # of freedom: of more the coverage factor is 2
SENSORS = tuple(quantity.sensor for quantity in QUANTITIES.values())


def with_common(campaign: Campaign) -> Campaign:
    """The campaign with what may be off in all its runs: as it states, else as an ordinary laboratory has it.

    Emulated references have no error of their own, whatever is left unsaid.
    """
    if campaign.common is not None:
        return campaign
    return replace(campaign, common=NOTHING_COMMON if campaign.emulated else ORDINARY_LABORATORY)


def certified(
    result: Characterization,
    air: ResponseAir,
    issued_on: str,
    *,
    traced: Sequence[Traced] = (),
    provenance: Mapping[str, Any] | None = None,
    **named: str,
) -> Certificate:
    """The certificate of a characterization of a campaign `with_common`.

    Parameters
    ----------
    result : Characterization
    air : Air
        What response times are stated for; None in it is the campaign's own.
    issued_on : str
        ISO 8601 date.
    traced : sequence of Traced
        Calibration certificates that the user named.
    provenance : mapping, optional
    **named
        `laboratory`, `person`, `customer`, `country`, `software`.
    """
    campaign = result.campaign
    assert campaign.common is not None
    # the diffusivity of a sensor that is one lag is one of lengths that nobody stated: its times are what is known
    figured = [
        one
        for found in result.channels().values()
        for one in budgets(found, air)
        if not (found.channel.lumped and one.figure == found.channel.quantity.symbol)
    ]
    figures = tuple(_figure(one) for one in figured if one.determined)
    lacking = _not_determined([one for one in figured if not one.determined])
    dates = _dates(campaign)
    sensors = {name: campaign.sensors.get(name, {}) for name in SENSORS}
    made = Certificate(
        identifier="",
        campaign=campaign.name,
        serials={name: str(one["serial"]) for name, one in sensors.items() if one.get("serial")},
        kinds={name: str(one["kind"]) for name, one in sensors.items() if one.get("kind")},
        began_on=min(dates, default=""),
        ended_on=max(dates, default=""),
        issued_on=issued_on,
        figures=figures,
        common=campaign.common,
        traced=tuple(traced),
        undescribed=tuple(one.channel.sensor for one in result.channels().values() if not one.explained),
        notes=(*_notes(result), *_notes_on_dates(campaign, dates, issued_on), *lacking),
        provenance=provenance or {},
        **named,
    )
    content = json.dumps(certificate_document(made), sort_keys=True)
    return replace(made, identifier=f"shockrig-{uuid.uuid5(NAMESPACE, content)}")


def calibrations(campaign: Campaign) -> list[Traced]:
    """The calibration certificates that the bench file named when the campaign was recorded, the latest session's."""
    found: dict[str, Traced] = {}
    for session in campaign.sessions:
        stated = session.get("calibration")
        for name, one in (stated if isinstance(stated, dict) else {}).items():
            # The sensors on trial are what is characterized here: their own certificates trace nothing.
            if isinstance(one, dict) and one.get("certificate") and sensor_and_probe(name) is None:
                found[name] = Traced(name, str(one["certificate"]), str(one.get("calibrated") or ""))
    return list(found.values())


def _figure(budget: Budget) -> CertifiedFigure:
    assert budget.air.temperature_c is not None
    assert budget.air.pressure_hpa is not None
    return CertifiedFigure(
        figure=budget.figure,
        channel=budget.channel,
        unit=budget.unit,
        value=rounded(budget.value),
        standard_uncertainty=rounded(budget.standard_uncertainty),
        degrees_of_freedom=finite(budget.degrees),
        coverage_factor=rounded(budget.coverage_factor),
        temperature_c=round(budget.air.temperature_c, 2),
        pressure_hpa=rounded(budget.air.pressure_hpa),
        airflow_m_s=None if budget.air.airflow_m_s is None else rounded(budget.air.airflow_m_s),
        coverage_interval=None
        if budget.interval is None
        else (rounded(budget.interval[0]), rounded(budget.interval[1])),
        lines=tuple(
            BudgetLine(
                line.component,
                line.kind,
                line.distribution,
                rounded(line.standard_uncertainty),
                line.unit,
                rounded(line.sensitivity),
                rounded(budget.share(line)),
                finite(line.degrees),
            )
            for line in budget.lines
        ),
    )


def _not_determined(budgets: Sequence[Budget]) -> list[str]:
    """Why figures are not among those certified: a sentence for those of one sensor that lack the same."""
    lacking: dict[str, list[str]] = {}
    for budget in budgets:
        standard = 100.0 * budget.standard_uncertainty / budget.value
        at = "" if budget.air.temperature_c is None else f" at {budget.air.temperature_c:.1f} °C"
        why = f"the {budget.channel} sensor{at}: the standard uncertainty would be {standard:.0f} %"
        if budget.interval is None and budget.degrees < FEW_DEGREES:
            expanded = 100.0 * budget.expanded_uncertainty / budget.value
            why += f", expanded for {budget.degrees:.1f} degrees of freedom {expanded:.0f} %"
        why += f" ({budget.lines[0].component} most of all)"
        lacking.setdefault(why, []).append(budget.figure)
    return [f"No {', '.join(figures)} of {why}." for why, figures in lacking.items()]


def _dates(campaign: Campaign) -> list[str]:
    """The days of its runs (ISO 8601), as far as they are known."""
    found = []
    for run in campaign.runs:
        with suppress(ValueError):
            found.append(date.fromisoformat(dated(run.started_at)[:10]).isoformat())
    return found


def _notes_on_dates(campaign: Campaign, dates: Sequence[str], issued_on: str) -> list[str]:
    """Where a date is not known, or a clock's that was wrong."""
    if not dates:
        return ["Nobody recorded when the runs were made, or by a clock that was not set."]
    last = max(dates)
    if date.fromisoformat(last) - date.fromisoformat(issued_on) > timedelta(days=1):
        return [f"The last run is dated {last}, later than this certificate: one of the two clocks was wrong."]
    if any(session.get("clock_synchronised") is False for session in campaign.sessions):
        return ["The clock of the computer that recorded was not synchronised: the days of the runs are by its own."]
    return []


def _notes(result: Characterization) -> list[str]:
    """What a reader of the figures must know besides."""
    said = [finding.sentence for finding in result.findings]
    if result.campaign.emulated:
        said.append("Emulated instruments: nothing here was measured, and no sensor is certified by it.")
    for name, found in result.channels().items():
        quantity = QUANTITIES[name]
        lumped, noun, body = found.channel.lumped, found.channel.sensor, found.channel.body
        symbol = "t63" if lumped else quantity.symbol
        length = f"{quantity.length.removesuffix('_m').replace('_', ' ')} of {found.channel.length_m:.3g} m"
        if found.effects:
            causes = ", ".join(effect.effect for effect in found.effects)
            said.append(
                f"Beside one lag the model of the {noun} carries {causes}."
                if lumped
                else f"{symbol} is the {noun}'s own, beside what the model carries: {causes}."
            )
        else:
            said.append(
                f"{symbol} is an effective number of the plain model ({body}): what is around the {noun} is in it."
            )
        if not lumped:
            said.append(f"{symbol} is quoted for a {length}; only its ratio to the square of that is observed.")
        if not found.explained:
            said.append(
                f"The model does not describe the {noun}'s readings down to the noise, and the uncertainty holds what "
                "it is wrong by: run shockrig diagnose, and certify with --extend."
            )
        if not found.channel.conditions.airflow_known.any():
            said.append(f"Nobody recorded the airflow: the {noun}'s figures hold for the airflow that there was.")
    return [*said, *(f"No {name} figures: {reason}" for name, reason in result.missing.items())]
