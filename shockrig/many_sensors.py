"""`shockrig.fleet`: what several sensors of one type have in common."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from shockrig.analysis.characterize.characterize import characterize as _characterize
from shockrig.channels import Channels, of_campaign
from shockrig.characterizing import extensions_of
from shockrig.diagnosing import Diagnosed
from shockrig.files.campaign import Campaign, read_campaign
from shockrig.files.errors import InputError
from shockrig.files.fleet_file import Fleet
from shockrig.given import PathLike, Progress
from shockrig.protocols.folder import software_version
from shockrig.remedies import as_python


def fleet(
    campaigns: PathLike | Sequence[Campaign | PathLike],
    *,
    channels: Channels = None,
    extend: Diagnosed | PathLike | None = None,
    progress: Progress | None = None,
) -> Fleet:
    """Say what several sensors of one type have in common, which do not belong, and what differs along them.

    The command `shockrig fleet` does the same on several processes or on a Dask cluster, and keeps what is done.

    Parameters
    ----------
    campaigns : path, or sequence of Campaign or path
        Campaigns, or folders that hold campaigns; those of the same serial numbers are one sensor's.
    channels : {"temperature", "humidity"} or several of them, optional
        Which sensors to look at; all that were recorded where it is left out.
    extend : Diagnosed or path, optional
        A diagnosis whose causes the models shall carry; the population is then of their parameters too.
    progress : function of a sentence, optional

    Returns
    -------
    Fleet

    Raises
    ------
    InputError
        A folder holds no campaign, or fewer than three sensors can be characterized.

    See Also
    --------
    read_fleet : reads what the command wrote.
    """
    from shockrig.analysis.diagnose.remainder import Tolerance
    from shockrig.analysis.fleet.fleet import fleet_of
    from shockrig.analysis.fleet.statistics import statistics_of
    from shockrig.protocols.fleet_map import FleetTask, causes_of_campaigns, tasks_of
    from shockrig.protocols.made_before import key_of, made_from

    say = progress or (lambda text: None)
    given = [campaigns] if isinstance(campaigns, str | os.PathLike) else list(campaigns)
    with as_python():
        read = [one for one in given if isinstance(one, Campaign)]
        folders = [Path(one) for one in given if not isinstance(one, Campaign)]
        tasks, failed = tasks_of(folders, None, None)
        found, extensions = [], extensions_of(extend)
        sources: list[Campaign | FleetTask] = [*read, *tasks]
        causes = causes_of_campaigns(Path(one.path) for one in sources)
        for one in sources:
            name = str(one.path)
            say(f"{name}: characterizing")
            try:
                campaign = one if isinstance(one, Campaign) else read_campaign(Path(one.path), one.probe)
                wanted = of_campaign(campaign, channels)
                result = _characterize(campaign, extensions=extensions, quickly=True, channels=wanted)
                made = made_from(campaign, Tolerance())
                its_own = causes.get(key_of(campaign.name, made), {})
                found.append(replace(statistics_of(result, made["fingerprint"]), causes=its_own))
            except InputError as error:
                failed[name] = str(error)
        return fleet_of(found, failed, {"software": f"shockrig {software_version()}"})
