"""The page of a campaign's decisions, beside them."""

from __future__ import annotations

from pathlib import Path

PAGE = "decisions.html"


def write_loop_page(campaign: Path) -> Path:
    """Write CAMPAIGN/decisions.html from its log, and return its path; there is at least one decision in it."""
    from shockrig.analysis.report.loop_page import loop_report
    from shockrig.files.plan_file import read_decisions
    from shockrig.protocols.folder import EMULATED
    from shockrig.rig.recorder.state import read_head

    head = read_head(campaign)
    data = EMULATED if head.get("emulated") is True else ""
    page = loop_report(str(head.get("name") or campaign.name), read_decisions(campaign), data)
    return page.write(campaign / PAGE)
