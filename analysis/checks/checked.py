"""A campaign with what the plain checks stop set aside, so that no fit ever sees it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from shockrig.analysis.checks.check import check_campaign
from shockrig.analysis.checks.finding import InputFinding
from shockrig.files.campaign import Campaign

CHANNELS = ("temperature", "humidity")


@dataclass(frozen=True)
class Checked:
    """A campaign without what must not be fitted, and everything that the checks say of it."""

    campaign: Campaign
    findings: tuple[InputFinding, ...]


def checked(campaign: Campaign) -> Checked:
    """Check a campaign; runs that a finding stops are set aside in its channel, for the reason it gives."""
    findings = check_campaign(campaign)
    why: dict[str, dict[str, str]] = {}
    for finding in findings:
        if finding.severity == "stop":
            for run in finding.runs:
                for channel in CHANNELS if finding.channel is None else (finding.channel,):
                    why.setdefault(run, {}).setdefault(channel, finding.sentence)
    if not why:
        return Checked(campaign, findings)
    runs = tuple(replace(run, set_aside=why[run.id]) if run.id in why else run for run in campaign.runs)
    return Checked(replace(campaign, runs=runs), findings)
