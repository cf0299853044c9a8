"""shockrig certify: uncertainty budgets and a calibration certificate, as tables, a page to print and DCC XML."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from shockrig.analysis.characterize.response_times import ResponseAir
    from shockrig.files.certificate import Certificate

PARTIES = {
    "laboratory": "name of the laboratory",
    "person": "name of the person responsible",
    "customer": "name of the customer",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from shockrig.protocols import each_probe

    parser.epilog = (
        "campaign.json may state what is off in all runs alike (common_uncertainty); what it leaves out is taken as an "
        "ordinary laboratory has it, and printed as such. The certificate is not an accredited one."
    )
    parser.add_argument("campaign", metavar="CAMPAIGN", type=Path, help="campaign folder (campaign.json, runs/)")
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        required=True,
        help="folder for certificate.html, .json, .xml (DCC), budget.csv",
    )
    parser.add_argument(
        "--extend",
        metavar="DIAGNOSIS.json",
        type=Path,
        help="fit the model with the causes that this diagnosis names (one of the campaign as it is, in or beside it)",
    )
    parser.add_argument("--plain", action="store_true", help="fit the plain model, whatever a diagnosis named")
    air = "that response times are stated for (default: the campaign's median)"
    parser.add_argument("--airflow", metavar="M_S", type=float, help=f"airflow {air}")
    parser.add_argument("--pressure", metavar="HPA", type=float, help=f"pressure {air}")
    parser.add_argument(
        "--temperature",
        metavar="DEGC",
        type=float,
        help="air that the thermometer's times are stated for (default: 20 degC)",
    )
    parser.add_argument(
        "--traced",
        metavar="INSTRUMENT=CERTIFICATE",
        action="append",
        default=[],
        help="a reference's calibration certificate, repeatable (beside those that the bench file names)",
    )
    for name, words in PARTIES.items():
        parser.add_argument(f"--{name}", metavar="NAME", help=words)
    parser.add_argument(
        "--country", metavar="CC", default="ZZ", help="of the laboratory, ISO 3166 (default: ZZ, not stated)"
    )
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of the differential evolution (default: 0)")
    each_probe.add_argument(parser)


def main(args: argparse.Namespace) -> int:
    """Certify, write, print."""
    from datetime import UTC, datetime

    from shockrig.protocols import each_probe

    made_at = datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
    for probe, its in each_probe.each(args.campaign, args.probe):
        out = its(args.out)
        print(summary(write(args, out, None if args.extend is None else its(args.extend), made_at, probe)))
        print(f"certificate: {out / 'certificate.html'}, {out / 'certificate.xml'}")
        print(f"budget: {out / 'budget.csv'}", flush=True)
    return 0


def write(args: argparse.Namespace, out: Path, extend: Path | None, made_at: str, probe: str) -> Certificate:
    """The certificate of a campaign's probe, into the folder `out`, whole or not at all."""
    from shockrig.analysis.characterize.certified import calibrations, certified, with_common
    from shockrig.analysis.characterize.characterize import characterize
    from shockrig.analysis.characterize.part_fit import read_extension
    from shockrig.analysis.report.certificate_page import write_certificate_page
    from shockrig.files.campaign import read_campaign
    from shockrig.files.campaign_names import dated
    from shockrig.files.certificate import write_certificate
    from shockrig.files.dcc import dcc_text
    from shockrig.files.diagnosis import read_diagnosis
    from shockrig.files.disk import shown, write_whole
    from shockrig.files.errors import InputError
    from shockrig.files.numbers import counted
    from shockrig.protocols.folder import said_of_data, software_version, whole_folder
    from shockrig.protocols.made_before import current, newer_runs
    from shockrig.protocols.time_left import CERTIFYING, Phases

    say = Phases(CERTIFYING)
    air, traced, country = _air(args), _traced(args.traced), _country(args.country)
    if not dated(made_at):
        said = f"this computer's clock says {made_at[:10]}, and a certificate has its date"
        raise InputError(f"{said}: set the clock (sudo date --set ...)")
    with whole_folder(out) as folder:
        recorded = read_campaign(args.campaign, probe)
        if extend is None and not args.plain and (extend := current(args.campaign, recorded)) is not None:
            say(f"{shown(extend)}: is a diagnosis of this campaign as it is, and is used; --plain leaves it out")
        extensions = None if extend is None else read_extension(extend)
        campaign = with_common(recorded)
        if extend is not None and (newer := newer_runs(read_diagnosis(extend), campaign)):
            say(f"--extend {shown(extend)}: is out of date, {counted(newer, 'run')} of {campaign.name} came later")
        result = characterize(campaign, args.seed, extensions, say)
        provenance: dict[str, Any] = {
            "campaign": campaign.name,
            "campaign_path": str(args.campaign),
            "software": f"shockrig {software_version()}",
            "made_at": made_at,
            "seed": args.seed,
            **said_of_data(campaign),
        }
        if extend is not None:
            provenance["extended_by"] = str(extend)
        named = {name: value for name in PARTIES if (value := getattr(args, name))}
        certificate = certified(
            result,
            air,
            made_at[:10],
            traced=[*calibrations(campaign), *traced],
            provenance=provenance,
            country=country,
            software=software_version(),
            **named,
        )
        if not certificate.figures:
            why = "; ".join(note.rstrip(".") for note in certificate.notes if note.startswith("No "))
            remedy = "record more runs, or run shockrig diagnose and certify with --extend"
            if args.airflow is not None:
                remedy = f"give an --airflow that is nearer to the runs', {remedy}"
            raise InputError(f"{args.campaign}: no figure to certify. {why}; {remedy}")
        say("certificate")
        write_certificate(certificate, folder)
        write_whole(folder / "certificate.xml", dcc_text(certificate).encode("utf-8"))
        write_certificate_page(certificate, folder)
    return certificate


def _air(args: argparse.Namespace) -> ResponseAir:
    from shockrig.analysis.characterize.response_times import ResponseAir
    from shockrig.analysis.physics.air_exchange import LEAST_AIRFLOW_M_S
    from shockrig.files.errors import InputError
    from shockrig.files.ranges import RANGES

    stated = {"airflow": "airflow_m_s", "temperature": "temperature_c", "pressure": "pressure_hpa"}
    for option, quantity in stated.items():
        value = getattr(args, option)
        if value is not None and not RANGES[quantity].holds(value):
            raise InputError(f"--{option}: {RANGES[quantity].refusal(value)}; give what the figures are wanted for")
    if args.airflow is not None and args.airflow < LEAST_AIRFLOW_M_S:
        said = f"no response is known in air that stands still; expected {LEAST_AIRFLOW_M_S:g} m/s or more"
        raise InputError(f"--airflow {args.airflow:g}: {said}")
    return ResponseAir(args.airflow, args.temperature, args.pressure)


def _traced(words: list[str]) -> list[Any]:
    from shockrig.files.certificate import Traced
    from shockrig.files.errors import InputError

    found = []
    for word in words:
        instrument, equals, number = (part.strip() for part in word.partition("="))
        if not (instrument and equals and number):
            expected = "expected INSTRUMENT=CERTIFICATE, such as 'reference thermometer=PTB 12345 of 2026-04-01'"
            raise InputError(f"--traced {word}: {expected}; name both")
        found.append(Traced(instrument, number))
    return found


def _country(code: str) -> str:
    from shockrig.files.errors import InputError

    if not (len(code) == 2 and code.isascii() and code.isalpha()):
        raise InputError(
            f"--country {code}: expected two letters of ISO 3166, such as DE; leave it out where not known"
        )
    return code.upper()


def summary(certificate: Certificate) -> str:
    """What the command prints: each figure with U, what dominates it, what was taken by default."""
    from shockrig.analysis.report.certificate_page import stated

    width = 2 + max(len(one.name) for one in certificate.figures)
    lines = [f"{'figure':<{width}}{'value ± U (95.45 %)':<34}{'k':>6}   largest part"]
    for one in certificate.figures:
        first = one.lines[0]
        largest = f"{first.component} ({100 * first.share:.0f} %)"
        lines.append(f"{one.name:<{width}}{stated(one):<34}{one.coverage_factor:>6.2f}   {largest}")
    common = certificate.common
    if common.by_default:
        values = ", ".join(f"{key} {getattr(common, key):g}" for key in common.document() if key in common.by_default)
        lines.append(f"by default, as an ordinary laboratory has it: {values}")
    lines += [f"note: {note}" for note in certificate.notes]
    lines.append("not accredited; " + certificate.traceability[0].lower() + certificate.traceability[1:])
    return "\n".join(lines)
