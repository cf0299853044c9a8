"""Where a decision looks: every probe's channels, `temperature` and `humidity`, of the probe "2" `temperature-2`."""

from __future__ import annotations

from collections.abc import Iterable

from shockrig.analysis.inference.quantity import QUANTITIES, ChannelName
from shockrig.files.campaign import Campaign
from shockrig.files.campaign_names import sensor_name

Place = str


def place_of(channel: ChannelName, probe: str) -> Place:
    """The name of a probe's channel, made as those of sensors are."""
    return sensor_name(channel, probe)


def places(campaigns: Iterable[Campaign]) -> dict[Place, tuple[Campaign, ChannelName]]:
    """Every channel of some probes, by name: the campaign as its probe saw it, and which channel of it."""
    return {place_of(name, one.probe): (one, name) for one in campaigns for name in QUANTITIES}
