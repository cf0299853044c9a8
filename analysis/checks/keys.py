"""Keys of campaign.json and run.json that mean nothing and are nearly the name of one that does."""

from __future__ import annotations

from collections.abc import Iterator

from shockrig.analysis.checks.finding import InputFinding
from shockrig.analysis.checks.signals import CampaignView


def misspelt_keys(view: CampaignView) -> Iterator[InputFinding]:
    """One finding for each slip, with the runs that have it."""
    campaign, runs = view.campaign, dict[str, list[str]]()
    for said in campaign.misspelt:
        yield InputFinding("misspelt_key", None, (), "warn", f"campaign.json, {said} It says nothing as it is.")
    for run in campaign.runs:
        for said in run.misspelt:
            runs.setdefault(said, []).append(run.id)
    for said, those in runs.items():
        sentence = f"run.json of {view.words(those)}, {said} It says nothing as it is."
        yield InputFinding("misspelt_key", None, tuple(those), "warn", sentence)
