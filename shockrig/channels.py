"""`channels=` of the functions: one name, several, or all that there are; what cannot be had is refused by name."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from shockrig.analysis.estimate.quantity import QUANTITIES, ChannelName
from shockrig.files.campaign import Campaign
from shockrig.files.errors import InputError
from shockrig.files.profile import Profile

Channels = ChannelName | Iterable[ChannelName] | None


def named(channels: Channels) -> tuple[ChannelName, ...]:
    """The channels that are wanted, in the usual order; all where nothing is said.

    Raises
    ------
    InputError
        A name is none of the two, or none is given.
    """
    if channels is None:
        return tuple(QUANTITIES)
    given = [channels] if isinstance(channels, str) else list(channels)
    wrong = next((name for name in given if name not in QUANTITIES), None)
    if wrong is not None or not given:
        said = "is empty" if not given else f"there is no channel {wrong!r}"
        raise InputError(f"channels: {said}; give 'temperature', 'humidity' or both")
    return tuple(name for name in QUANTITIES if name in given)


def recorded(campaign: Campaign) -> tuple[ChannelName, ...]:
    """The channels of which a campaign has any readings."""
    return tuple(
        name
        for name, quantity in QUANTITIES.items()
        if any(getattr(run, quantity.sensor) is not None for run in campaign.runs)
    )


def of_campaign(campaign: Campaign, channels: Channels) -> tuple[ChannelName, ...]:
    """The channels that are wanted of a campaign: those that it recorded where nothing is said.

    Raises
    ------
    InputError
        One that is asked for was not recorded.
    """
    there = recorded(campaign)
    if channels is None:
        return there or tuple(QUANTITIES)
    wanted = named(channels)
    if lacking := [name for name in wanted if name not in there]:
        has = f"it has {' and '.join(there)}" if there else "it has no readings at all"
        raise InputError(f"{campaign.name}: has no readings of {' or '.join(lacking)}; leave that channel out ({has})")
    return wanted


def of_profile(profile: Profile, channels: Channels) -> Profile:
    """A profile of the channels that are wanted alone.

    Raises
    ------
    InputError
        One that is asked for is not in the profile.
    """
    if channels is None:
        return profile
    wanted = named(channels)
    there = [name for name in QUANTITIES if getattr(profile, name) is not None]
    if lacking := [name for name in wanted if name not in there]:
        raise InputError(
            f"the profile has no {' or '.join(lacking)}; leave that channel out (it has {', '.join(there)})"
        )
    return replace(
        profile,
        temperature=profile.temperature if "temperature" in wanted else None,
        humidity=profile.humidity if "humidity" in wanted else None,
    )


def only(campaign: Campaign, wanted: tuple[ChannelName, ...]) -> Campaign:
    """A campaign with the sensors and readings of some channels alone."""
    unwanted: dict[str, Any] = {q.sensor: None for name, q in QUANTITIES.items() if name not in wanted}
    sensors = {name: stated for name, stated in campaign.sensors.items() if name not in unwanted}
    return replace(campaign, sensors=sensors, runs=tuple(replace(run, **unwanted) for run in campaign.runs))
