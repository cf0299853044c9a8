"""A certificate of response figures (`shock-certificate/1`): each figure with its uncertainty budget.

certificate.json holds everything, budget.csv the lines of all budgets as one table. The same numbers, to seven
significant digits, stand in the digital calibration certificate (`shockrig.files.dcc`).
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from shockrig.files.common_uncertainty import CommonUncertainty
from shockrig.files.disk import write_whole
from shockrig.files.json_files import known, measured, write_json

CERTIFICATE_FORMAT = "shock-certificate/1"
COVERAGE_PROBABILITY = 0.9545
NOT_ACCREDITED = (
    "Not issued by an accredited laboratory. The figures are those that shockrig finds from the campaign named here; "
    "nobody has confirmed them."
)
NOT_TRACEABLE = "No traceability is claimed: no calibration certificate of a reference was named."


@dataclass(frozen=True)
class BudgetLine:
    """One component: `kind` "A" or "B", the input's standard uncertainty in its unit, the figure's sensitivity to it in
    the figure's unit for one of these, its share of the variance (0 to 1), degrees of freedom (None: infinite)."""

    component: str
    kind: str
    distribution: str
    standard_uncertainty: float
    unit: str
    sensitivity: float
    share: float
    degrees_of_freedom: float | None


@dataclass(frozen=True)
class CertifiedFigure:
    """A figure with what it is stated for: "alpha", "D", "t63" or "t90" of one channel.

    `airflow_m_s` is None where nobody recorded it. `degrees_of_freedom` is None where they are infinite.
    `coverage_interval` are the ends that hold 95.45 % where distributions were propagated (JCGM 101) because the
    figure is no straight function of its inputs; the coverage factor is then half of it over the standard uncertainty.
    """

    figure: str
    channel: str
    unit: str
    value: float
    standard_uncertainty: float
    degrees_of_freedom: float | None
    coverage_factor: float
    temperature_c: float
    pressure_hpa: float
    airflow_m_s: float | None
    lines: tuple[BudgetLine, ...]
    coverage_interval: tuple[float, float] | None = None

    @property
    def expanded_uncertainty(self) -> float:
        """U = k u, as it is stated: from the u and k that are stated."""
        return rounded(self.coverage_factor * self.standard_uncertainty)

    @property
    def name(self) -> str:
        """What it is called on paper: "D at 20.0 °C", "t63 of the thermometer"."""
        said = self.figure
        if said.startswith("t"):
            said += f" of the {'hygrometer' if self.channel == 'humidity' else 'thermometer'}"
        return said + (f" at {self.air_c} °C" if self.channel == "humidity" else "")

    @property
    def air_c(self) -> str:
        """The air's temperature as it is written, to a tenth of a degree."""
        return f"{round(self.temperature_c, 1) + 0.0:.1f}".replace("-", "−")


@dataclass(frozen=True)
class Traced:
    """An instrument whose calibration certificate the user named."""

    instrument: str
    certificate: str
    calibrated: str = ""

    @property
    def sentence(self) -> str:
        """What may be said of it, and no more."""
        when = f" of {self.calibrated}" if self.calibrated else ""
        return f"{self.instrument}: calibrated by certificate {self.certificate}{when}, as the user states."


@dataclass(frozen=True)
class Certificate:
    """All that a certificate says.

    Attributes
    ----------
    identifier : str
    campaign : str
    serials : mapping
        "imet" and "hyt" -> serial number, as far as known.
    kinds : mapping
        Likewise -> kind.
    began_on, ended_on, issued_on : str
        Dates (ISO 8601) of the first and the last run, empty where they are not known, and of the certificate.
    figures : tuple of CertifiedFigure
    common : CommonUncertainty
        What was taken for the errors that all runs share; `by_default` says which nobody stated.
    traced : tuple of Traced
    notes : tuple of str
        What a reader must know besides: an effective number, emulated instruments.
    undescribed : tuple of str
        "bead", "film": whose readings the model does not describe down to the noise.
    laboratory, person, customer, country : str
        As the user names them.
    software : str
    """

    identifier: str
    campaign: str
    serials: Mapping[str, str]
    kinds: Mapping[str, str]
    began_on: str
    ended_on: str
    issued_on: str
    figures: tuple[CertifiedFigure, ...]
    common: CommonUncertainty
    traced: tuple[Traced, ...] = ()
    notes: tuple[str, ...] = ()
    undescribed: tuple[str, ...] = ()
    laboratory: str = "not stated"
    person: str = "not stated"
    customer: str = "not stated"
    country: str = "ZZ"
    software: str = "unknown"
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def traceability(self) -> str:
        """What is claimed of it."""
        return " ".join(one.sentence for one in self.traced) or NOT_TRACEABLE


def rounded(value: float) -> float:
    """A number as every file of a certificate has it."""
    return measured(value) or 0.0


def finite(degrees: float) -> float | None:
    """Degrees of freedom as they are stated; None for infinitely many."""
    return rounded(degrees) if math.isfinite(degrees) else None


def write_certificate(certificate: Certificate, folder: Path) -> None:
    """Write certificate.json and budget.csv into a folder that is there."""
    write_json(folder / "certificate.json", certificate_document(certificate))
    write_whole(folder / "budget.csv", budget_table(certificate))


def certificate_document(certificate: Certificate) -> dict[str, Any]:
    """Content of certificate.json; infinite degrees of freedom are left out."""
    return {
        "format": CERTIFICATE_FORMAT,
        "identifier": certificate.identifier,
        "accredited": False,
        "statement": NOT_ACCREDITED,
        "traceability": certificate.traceability,
        "campaign": certificate.campaign,
        "sensors": {
            name: known(kind=certificate.kinds.get(name), serial=certificate.serials.get(name))
            for name in dict.fromkeys((*certificate.kinds, *certificate.serials))
        },
        **known(runs_from=certificate.began_on or None, runs_until=certificate.ended_on or None),
        "issued_on": certificate.issued_on,
        "coverage_probability": COVERAGE_PROBABILITY,
        "figures": [
            {
                **known(
                    figure=one.figure,
                    channel=one.channel,
                    unit=one.unit,
                    value=one.value,
                    standard_uncertainty=one.standard_uncertainty,
                    degrees_of_freedom=one.degrees_of_freedom,
                    coverage_factor=one.coverage_factor,
                    expanded_uncertainty=one.expanded_uncertainty,
                    coverage_interval=one.coverage_interval and list(one.coverage_interval),
                    temperature_c=one.temperature_c,
                    pressure_hpa=one.pressure_hpa,
                    airflow_m_s=one.airflow_m_s,
                ),
                "budget": [known(**asdict(line)) for line in one.lines],
            }
            for one in certificate.figures
        ],
        "common_uncertainty": {
            key: {"value": value, "by_default": key in certificate.common.by_default}
            for key, value in certificate.common.document().items()
        },
        "notes": list(certificate.notes),
        "laboratory": certificate.laboratory,
        "person": certificate.person,
        "customer": certificate.customer,
        "provenance": dict(certificate.provenance),
    }


def budget_table(certificate: Certificate) -> str:
    """The lines of all budgets as CSV."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(
        "figure,channel,temperature_c,component,type,distribution,standard_uncertainty,unit,sensitivity,"
        "contribution,figure_unit,share_percent,degrees_of_freedom".split(",")
    )
    for one in certificate.figures:
        for line in one.lines:
            table.writerow(
                [
                    one.figure,
                    one.channel,
                    one.temperature_c,
                    line.component,
                    line.kind,
                    line.distribution,
                    line.standard_uncertainty,
                    line.unit,
                    line.sensitivity,
                    rounded(abs(line.sensitivity) * line.standard_uncertainty),
                    one.unit,
                    rounded(100.0 * line.share),
                    "infinite" if line.degrees_of_freedom is None else line.degrees_of_freedom,
                ]
            )
    return text.getvalue()
