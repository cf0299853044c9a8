"""A certificate as digital calibration certificate: DCC 3.3.0 with quantities in D-SI 2.2 (PTB; XML).

    digitalCalibrationCertificate
      administrativeData   dccSoftware coreData items calibrationLaboratory respPersons customer statements
      measurementResults   measurementResult: usedMethods usedSoftware measuringEquipments results

Structure: https://ptb.de/dcc/v3.3.0/. A quantity is si:real with an expanded uncertainty, or with a
coverage interval where distributions were propagated. What nobody stated is said to
be "not stated", since the schema wants something there.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

from shockrig.files.certificate import (
    COVERAGE_PROBABILITY,
    NOT_ACCREDITED,
    Certificate,
    CertifiedFigure,
)

DCC, SI = "https://ptb.de/dcc", "https://ptb.de/si"
SCHEMA_VERSION = "3.3.0"
NOT_STATED = "not stated"
RELEASE = re.compile(r"\d{1,3}(\.\d{1,3}){0,3}")
SCHEMA_LOCATION = f"{DCC} https://ptb.de/dcc/v{SCHEMA_VERSION}/dcc.xsd"
INSTANCE = "http://www.w3.org/2001/XMLSchema-instance"
UNITS = {
    "m²/s": r"\metre\tothe{2}\second\tothe{-1}",
    "s": r"\second",
    "°C": r"\degreecelsius",
    "hPa": r"\hecto\pascal",
    "m/s": r"\metre\second\tothe{-1}",
}
METHODS = (
    (
        "Shocks from one air to another; the diffusion model fitted by generalised least squares",
        "doi:10.5194/amt-15-2607-2022",
    ),
    ("Uncertainty budget, Welch-Satterthwaite, 95.45 %", "JCGM 100:2008"),
)
PROPAGATED = ("Propagation of distributions, where the figure is no straight function of the inputs", "JCGM 101:2008")
ITEMS = {"temperature": ("imet", "thermometer"), "humidity": ("hyt", "hygrometer")}


def dcc_text(certificate: Certificate) -> str:
    """The certificate as XML."""
    for prefix, space in (("dcc", DCC), ("si", SI), ("xsi", INSTANCE)):
        ET.register_namespace(prefix, space)
    root = ET.Element(f"{{{DCC}}}digitalCalibrationCertificate", {"schemaVersion": SCHEMA_VERSION})
    root.set(f"{{{INSTANCE}}}schemaLocation", SCHEMA_LOCATION)
    _administrative(root, certificate)
    results = _add(root, "measurementResults")
    for channel in dict.fromkeys(one.channel for one in certificate.figures):
        _result(results, certificate, channel)
    ET.indent(root, " ")
    return ET.tostring(root, encoding="unicode", xml_declaration=False).join(
        ('<?xml version="1.0" encoding="UTF-8"?>\n', "\n")
    )


def _administrative(root: ET.Element, certificate: Certificate) -> None:
    part = _add(root, "administrativeData")
    _software(_add(part, "dccSoftware"), certificate.software)
    core = _add(part, "coreData")
    _add(core, "countryCodeISO3166_1", certificate.country)
    _add(core, "usedLangCodeISO639_1", "en")
    _add(core, "mandatoryLangCodeISO639_1", "en")
    _add(core, "uniqueIdentifier", certificate.identifier)
    # the schema wants days: where those of the runs are not known it is the certificate's, and a note says so
    _add(core, "beginPerformanceDate", certificate.began_on or certificate.issued_on)
    _add(core, "endPerformanceDate", certificate.ended_on or certificate.issued_on)
    _add(core, "performanceLocation", "other")
    _add(core, "issueDate", certificate.issued_on)
    items = _add(part, "items")
    for channel in dict.fromkeys(one.channel for one in certificate.figures):
        sensor, noun = ITEMS[channel]
        item = _add(items, "item")
        _said(item, "name", noun)
        _add(item, "model", certificate.kinds.get(sensor, NOT_STATED))
        number = _add(_add(item, "identifications"), "identification")
        _add(number, "issuer", "manufacturer")
        _add(number, "value", certificate.serials.get(sensor, NOT_STATED))
        _said(number, "name", "serial number")
    _contact(_add(_add(part, "calibrationLaboratory"), "contact"), certificate.laboratory, certificate.country)
    person = _add(_add(part, "respPersons"), "respPerson")
    _said(_add(person, "person"), "name", certificate.person)
    _contact(_add(part, "customer"), certificate.customer, certificate.country)
    statements = _add(part, "statements")
    _statement(statements, "Accreditation", NOT_ACCREDITED)
    _statement(statements, "Traceability", certificate.traceability, traceable=None if certificate.traced else "false")
    for place, note in enumerate(certificate.notes, 1):
        _statement(statements, f"Note {place}", note)
    defaults = ", ".join(sorted(certificate.common.by_default))
    if defaults:
        said = f"Standard uncertainties of an ordinary laboratory were taken where nobody stated any: {defaults}."
        _statement(statements, "Errors that all runs share", said)


def _result(parent: ET.Element, certificate: Certificate, channel: str) -> None:
    figures = [one for one in certificate.figures if one.channel == channel]
    part = _add(parent, "measurementResult")
    _said(part, "name", f"Response of the {ITEMS[channel][1]}")
    methods = _add(part, "usedMethods")
    propagated = any(one.coverage_interval is not None for one in figures)
    for name, reference in (*METHODS, *([PROPAGATED] if propagated else [])):
        method = _add(methods, "usedMethod")
        _said(method, "name", name)
        _add(method, "reference", reference)
    _software(_add(part, "usedSoftware"), certificate.software)
    if certificate.traced:
        equipments = _add(part, "measuringEquipments")
        for traced in certificate.traced:
            equipment = _add(equipments, "measuringEquipment")
            _said(equipment, "name", traced.instrument)
            number = _add(_add(equipment, "identifications"), "identification")
            _add(number, "issuer", "other")
            _add(number, "value", traced.certificate)
            _said(number, "name", "calibration certificate, as the user states")
    results = _add(part, "results")
    result = _add(results, "result")
    _said(result, "name", "Response figures")
    data = _add(result, "data")
    for figure in figures:
        _figure(data, figure)


def _figure(data: ET.Element, figure: CertifiedFigure) -> None:
    quantity = _add(data, "quantity", refType="basic_measuredValue")
    _said(quantity, "name", figure.name)
    real = _real(quantity, figure.value, figure.unit)
    uncertainty = _si(real, "measurementUncertaintyUnivariate")
    if figure.coverage_interval is None:
        expanded = _si(uncertainty, "expandedMU")
        _si(expanded, "valueExpandedMU", _number(figure.expanded_uncertainty))
        _si(expanded, "coverageFactor", _number(figure.coverage_factor))
        _si(expanded, "coverageProbability", _number(COVERAGE_PROBABILITY))
        _si(expanded, "distribution", "normal" if figure.degrees_of_freedom is None else "t")
    else:
        interval = _si(uncertainty, "coverageIntervalMU")
        _si(interval, "valueStandardMU", _number(figure.standard_uncertainty))
        for name, end in zip(("intervalMin", "intervalMax"), figure.coverage_interval, strict=True):
            _si(interval, name, _number(end))
        _si(interval, "coverageProbability", _number(COVERAGE_PROBABILITY))
    conditions = _add(quantity, "influenceConditions")
    stated = (("Airflow", figure.airflow_m_s, "m/s"), ("Air temperature", figure.temperature_c, "°C"))
    for name, value, unit in (*stated, ("Air pressure", figure.pressure_hpa, "hPa")):
        condition = _add(conditions, "influenceCondition")
        _said(condition, "name", name)
        place = _add(condition, "data")
        if value is None:
            _add(_add(place, "text"), "content", "nobody recorded it", lang="en")
        else:
            _real(_add(place, "quantity"), value, unit)


def _real(parent: ET.Element, value: float, unit: str) -> ET.Element:
    real = _si(parent, "real")
    _si(real, "value", _number(value))
    _si(real, "unit", UNITS[unit])
    return real


def _statement(parent: ET.Element, name: str, text: str, traceable: str | None = None) -> None:
    statement = _add(parent, "statement")
    _said(statement, "name", name)
    if traceable is not None:
        _add(statement, "traceable", traceable)
    _add(_add(statement, "declaration"), "content", text, lang="en")


def _software(parent: ET.Element, version: str) -> None:
    """This program: PTB's rules want a release as a letter and up to four numbers."""
    software = _add(parent, "software")
    _said(software, "name", "shockrig")
    numbers = RELEASE.match(version)
    _add(software, "release", f"v{numbers[0]}" if numbers else version)


def _contact(contact: ET.Element, name: str, country: str) -> None:
    _said(contact, "name", name)
    _add(_add(contact, "location"), "countryCode", country)


def _said(parent: ET.Element, tag: str, text: str) -> None:
    _add(_add(parent, tag), "content", text, lang="en")


def _add(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    return _under(parent, DCC, tag, text, attributes)


def _si(parent: ET.Element, tag: str, text: str | None = None) -> ET.Element:
    return _under(parent, SI, tag, text, {})


def _under(parent: ET.Element, space: str, tag: str, text: str | None, attributes: dict[str, str]) -> ET.Element:
    element = ET.SubElement(parent, f"{{{space}}}{tag}", attributes)
    element.text = None if text is None else _one_line(text)
    return element


def _number(value: float) -> str:
    """As JSON has it: the shortest text that reads back as the same number."""
    return repr(float(value))


def _one_line(text: str) -> str:
    """Printable text of at least one character, without blanks at its ends."""
    return " ".join("".join(c for c in text if c.isprintable() or c.isspace()).split()) or NOT_STATED
