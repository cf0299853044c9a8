"""shockrig export: a campaign as netCDF (CF), Parquet, or bluesky event documents."""

from __future__ import annotations

import argparse
from pathlib import Path

from shockrig.files.numbers import counted


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("campaign", metavar="CAMPAIGN", type=Path, help="campaign folder (campaign.json, runs/)")
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        required=True,
        help="its ending says the format: .nc (netCDF, CF), .parquet, .jsonl (bluesky event documents)",
    )
    parser.add_argument(
        "--probe", metavar="NAME", default="1", help="which of several probes recorded at once (default: 1)"
    )


def main(args: argparse.Namespace) -> int:
    """Read the campaign and write the file."""
    from shockrig.files.campaign import read_campaign, read_probes
    from shockrig.files.disk import shown
    from shockrig.files.errors import InputError
    from shockrig.files.exports import write_bluesky, write_netcdf, write_parquet
    from shockrig.protocols.folder import software_version

    out: Path = args.out
    if out.suffix not in (".nc", ".parquet", ".jsonl"):
        raise InputError(f"--out {out}: its ending names no format; end it in .nc, .parquet or .jsonl")
    campaign = read_campaign(args.campaign, args.probe)
    try:
        if out.suffix == ".nc":
            write_netcdf(campaign, out, f"shockrig {software_version()} export {shown(args.campaign.name)}")
        elif out.suffix == ".parquet":
            write_parquet(campaign, out)
        else:
            write_bluesky(campaign, out)
    except (OSError, RuntimeError) as error:  # netCDF's own library says RuntimeError where the disk is full
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"--out {out}: {reason}; name a file in a folder that can be written") from error
    readings = sum(trace.time_s.size for run in campaign.runs for trace in (run.imet, run.hyt, run.air) if trace)
    probes = read_probes(args.campaign)
    of = f" of probe {args.probe} alone: --probe takes one of {', '.join(probes)}" if len(probes) > 1 else ""
    print(f"{out}: {counted(len(campaign.runs), 'run')}, {readings} readings{of}")
    return 0
