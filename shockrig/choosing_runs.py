"""`shockrig.plan`: which runs to record next, and why."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from shockrig.analysis.diagnose.next_experiments import next_experiments
from shockrig.analysis.report.next_time import next_time
from shockrig.channels import Channels, of_campaign, only
from shockrig.files import result_views as views
from shockrig.files.campaign import Campaign
from shockrig.files.errors import InputError
from shockrig.files.fleet_file import Fleet
from shockrig.files.numbers import counted
from shockrig.given import PathLike, Progress, WithDiagnosis, campaign_given, fleet_given
from shockrig.remedies import as_python

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from shockrig.analysis.design.goals import Place
    from shockrig.analysis.diagnose.diagnosed import ChannelOutcome


@dataclass(frozen=True, repr=False)
class Planned:
    """What `plan` proposes.

    Attributes
    ----------
    runs : tuple of dict
        Runs that would tell tied explanations apart, in the terms of run.json, each with the evidence that is expected
        of it and the reason; empty where nothing is tied.
    advice : tuple of str
        What to record otherwise, so that the rest can be told.
    status, reason : str
        Where goals were given: "continue", "done" or "inconclusive", and why.
    goals : tuple of dict
        Each goal with where it stands (`goal`, `now`, `met`).
    """

    runs: tuple[dict[str, Any], ...]
    advice: tuple[str, ...]
    status: str = ""
    reason: str = ""
    goals: tuple[dict[str, Any], ...] = ()

    def to_frame(self) -> pd.DataFrame:
        """One row for each run."""
        return views.plan_frame(self.runs)

    def to_xarray(self) -> xr.Dataset:
        """The same as labelled arrays over the run's number."""
        return views.plan_dataset(self.runs)

    def plot(self) -> Figure:
        """What each run is expected to bring: to the goals, or to telling tied explanations apart."""
        return views.plot_plan(self.runs, self.reason)

    def __repr__(self) -> str:
        advice = f"; {counted(len(self.advice), 'sentence')} of advice" if self.advice else ""
        return f"<Planned: {counted(len(self.runs), 'run')}; {self._why}{advice}>"

    @property
    def _why(self) -> str:
        """Why there are these runs, or none."""
        if self.status:
            return f"{self.status}: {self.reason}"
        return "they tell tied explanations apart" if self.runs else views.NOTHING_TIED

    def _repr_html_(self) -> str:
        stands = [(f"{self.status}", self.reason)] if self.status else []
        return views.plan_card(self.runs, self.advice, stands)


def plan(
    found: WithDiagnosis | Campaign | PathLike,
    *,
    until: str | None = None,
    runs: int = 6,
    channels: Channels = None,
    fleet: Fleet | PathLike | None = None,
    progress: Progress | None = None,
) -> Planned:
    """Say which runs to record next: for goals, or so that what a diagnosis could not tell can be told.

    Parameters
    ----------
    found : Diagnosed, Campaign or path
        What `diagnose` returned, or a campaign or its folder; a diagnosis that is given, or that lies in or beside the
        folder and is of the campaign as it is, is not made once more.
    until : str, optional
        Goals such as "alpha 0.2 %, D 0.3 %, ties decided"; "minutes 90" limits the bench time. A diagnosis can be
        planned from without any: then the runs are those that would tell its tied explanations apart.
    runs : int
        How many to choose at most, for goals.
    channels : {"temperature", "humidity"} or several of them, optional
        For which sensors; all that were recorded, or diagnosed, where it is left out.
    fleet : Fleet or path, optional
        What other sensors of the type say: fewer runs reach the goals then.
    progress : function of a sentence, optional

    Returns
    -------
    Planned
        The runs, whether the goals are met and why, and advice on what was not recorded.

    Raises
    ------
    InputError
        A campaign without goals, goals that cannot be read or are another sensor's, or a channel that is not there.

    Examples
    --------
    Five ambients, three airflows, both directions and repeats leave nothing tied where nothing is hidden.

    >>> import shockrig
    >>> found = shockrig.diagnose(shockrig.example("plain-rough"), channels="temperature")
    >>> shockrig.plan(found).runs
    ()
    """
    if until is not None:
        return _planned(found, until, runs, channels, fleet, progress or (lambda text: None))
    if isinstance(found, Campaign | str | os.PathLike):
        from shockrig.analysis.design.goals import EXAMPLE

        raise InputError(f"until: is missing; give goals such as {EXAMPLE!r}, or plan from a diagnosis")
    wanted = of_campaign(found.campaign, channels)
    among = [one for one in found.result.channels if one.name in wanted]
    chosen = found.result.next_experiments if channels is None else [r for one in among for r in next_experiments(one)]
    return Planned(tuple(chosen), tuple(next_time([one.problem.channel for one in among])))


def _planned(
    found: WithDiagnosis | Campaign | PathLike,
    until: str,
    runs: int,
    channels: Channels,
    fleet: Fleet | PathLike | None,
    say: Progress,
) -> Planned:
    """The decision that goals lead to, with what is known already."""
    from shockrig.analysis.design.goals import QUANTITY_OF, parse_goals
    from shockrig.analysis.diagnose.diagnosed import outcome_of
    from shockrig.analysis.plan.decide import decide
    from shockrig.analysis.plan.decision import plan_document
    from shockrig.files.campaign_names import sensor_name
    from shockrig.protocols.made_before import outcomes

    with as_python():
        goals = parse_goals(until)
        if not 1 <= runs <= 100:
            raise InputError(f"runs={runs}: expected 1 to 100")
        diagnosed = None if isinstance(found, Campaign | str | os.PathLike) else found
        campaign = campaign_given(found) if isinstance(found, Campaign | str | os.PathLike) else found.campaign
        wanted = of_campaign(campaign, channels)
        for one in goals.precisions:
            of = QUANTITY_OF[one.quantity]
            if channels is not None and not set(of) & set(wanted):
                raise InputError(f"until={until!r}: holds a goal of {of[0]}, which channels={channels!r} leaves out")
        made: dict[Place, ChannelOutcome] = {}
        advice: list[str] = []
        if diagnosed is not None:
            made = {sensor_name(one.name, campaign.probe): outcome_of(one) for one in diagnosed.result.channels}
            advice = next_time([one.problem.channel for one in diagnosed.result.channels if one.name in wanted])
        elif campaign.path.is_dir():
            made = outcomes(campaign.path, [campaign], say)
        made = {place: one for place, one in made.items() if place in {sensor_name(n, campaign.probe) for n in wanted}}
        population = None if fleet is None else fleet_given(fleet).population
        decision = decide([only(campaign, wanted)], goals, count=runs, made=made, population=population, progress=say)
    document = plan_document(decision, goals)
    return Planned(tuple(document["runs"]), tuple(advice), decision.status, decision.reason, tuple(document["goals"]))
