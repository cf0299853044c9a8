"""The functions of `import shockrig` that compute: characterize, diagnose, plan, correct, learn, fleet."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from shockrig.analysis.characterize.characterize import characterize as _characterize
from shockrig.analysis.characterize.extension import Extension, extension_of, read_extension
from shockrig.analysis.characterize.result import to_profile
from shockrig.analysis.diagnose.diagnose import diagnose as _diagnose
from shockrig.analysis.diagnose.diagnose import next_experiments
from shockrig.analysis.diagnose.diagnosed import stated_cause, to_json
from shockrig.analysis.diagnose.remainder import Tolerance
from shockrig.analysis.estimate.quantity import ChannelName
from shockrig.analysis.fleet.prior import with_population
from shockrig.analysis.flight.correct import correct as _correct
from shockrig.analysis.report.next_time import next_time
from shockrig.campaigns import Progress
from shockrig.channels import Channels, of_campaign, of_profile, only
from shockrig.files.campaign import Campaign, read_campaign
from shockrig.files.errors import InputError
from shockrig.files.fleet import Fleet, read_fleet
from shockrig.files.flight import Flight
from shockrig.files.profile import Profile, read_profile
from shockrig.flights import PathLike, with_words
from shockrig.protocols.flight_clock import on_clock
from shockrig.remedies import as_python, in_python
from shockrig.results import Characterized, CorrectedFlight, Diagnosed, LearnedSensor, Planned

if TYPE_CHECKING:
    import pandas as pd

    from shockrig.analysis.diagnose.diagnosed import ChannelOutcome
    from shockrig.analysis.plan.goals import Place


def characterize(
    campaign: Campaign | PathLike,
    *,
    channels: Channels = None,
    seed: int = 0,
    extend: Diagnosed | PathLike | None = None,
    fleet: Fleet | PathLike | None = None,
    progress: Progress | None = None,
) -> Characterized:
    """Find how fast a campaign's sensors are: alpha of a bead, D(T) of a film, tau of what is one lag, response times.

    Parameters
    ----------
    campaign : Campaign or path
        A campaign, or the folder that holds campaign.json.
    channels : {"temperature", "humidity"} or several of them, optional
        Which sensors to look at; all that were recorded where it is left out.
    seed : int
        Of the differential evolution that finds the start of the fit.
    extend : Diagnosed or path, optional
        A diagnosis (or its diagnosis.json) whose causes the model shall carry; alpha and D are then the material's, no
        longer effective numbers.
    fleet : Fleet or path, optional
        What other sensors of the type say, as the prior: a few runs are enough then. Sensors that do not belong to it
        are told in `notes`, and have a profile of their own data alone.
    progress : function of a sentence, optional

    Returns
    -------
    Characterized

    Raises
    ------
    InputError
        The campaign cannot be read, or neither sensor has a run that can be used; the reasons are named.

    See Also
    --------
    diagnose : what the model that is fitted here gets wrong.

    Examples
    --------
    >>> import shockrig
    >>> found = shockrig.characterize(shockrig.example("plain-rough"))
    >>> alpha = found.profile.temperature.thermal_diffusivity_m2_s
    >>> print(f"{alpha.value:.1e} m2/s, known to {100 * alpha.standard_uncertainty / alpha.value:.1f} %")
    8.3e-08 m2/s, known to 0.1 %
    >>> film = found.to_frame().loc["humidity", ["ambient_temperature_c", "t63_s"]]
    >>> film.round(0).head(3).to_numpy().tolist()
    [[0.0, 5.0], [10.0, 4.0], [20.0, 3.0]]
    """
    with as_python():
        recorded = _campaign(campaign)
        wanted = of_campaign(recorded, channels)
        result = _characterize(recorded, seed=seed, extensions=_extensions(extend), progress=progress, channels=wanted)
    profile = to_profile(result, {"software": f"shockrig {_version()}"})
    if fleet is None:
        return Characterized(profile, result)
    with as_python():
        known = with_population(result, _fleet(fleet).population)
    return Characterized(replace(known.profile, provenance=profile.provenance), result, known)


def diagnose(
    campaign: Campaign | PathLike,
    *,
    channels: Channels = None,
    tolerance_k: float = 0.03,
    tolerance_percent: float = 0.2,
    progress: Progress | None = None,
) -> Diagnosed:
    """Say what the plain model of a campaign's sensors gets wrong, which effects cause it, and what is gained by them.

    Parameters
    ----------
    campaign : Campaign or path
        A campaign, or the folder that holds campaign.json.
    channels : {"temperature", "humidity"} or several of them, optional
        Which sensors to look at; all that were recorded where it is left out.
    tolerance_k, tolerance_percent : float
        From which size on what is left spoils a verdict; by default a tenth of the sensors' stated accuracy.
    progress : function of a sentence, optional

    Returns
    -------
    Diagnosed

    Raises
    ------
    InputError
        The campaign cannot be read, or no sensor has enough runs that can be used.

    Examples
    --------
    Sensors in which nothing is hidden; of those of `example("ordinary-bench")` the bead is explained by three effects.

    >>> import shockrig
    >>> found = shockrig.diagnose(shockrig.example("plain-rough"), channels=["temperature"])
    >>> found.verdicts
    {'temperature': 'adequate'}
    >>> found.gain.loc["temperature", ["held_out_rmse_before", "noise_floor"]].astype(float).round(3).to_list()
    [0.023, 0.023]
    """
    tolerance = Tolerance(tolerance_k, tolerance_percent)
    with as_python():
        recorded = _campaign(campaign)
        recorded = only(recorded, of_campaign(recorded, channels))
        result = _diagnose(recorded, progress=progress or (lambda text: None), tolerance=tolerance)
    return Diagnosed(to_json(result), result, recorded)


def plan(
    found: Diagnosed | Campaign | PathLike,
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
    if not isinstance(found, Diagnosed):
        from shockrig.analysis.plan.goals import EXAMPLE

        raise InputError(f"until: is missing; give goals such as {EXAMPLE!r}, or plan from a diagnosis")
    wanted = of_campaign(found.campaign, channels)
    among = [one for one in found.result.channels if one.name in wanted]
    chosen = found.result.next_experiments if channels is None else [r for one in among for r in next_experiments(one)]
    return Planned(tuple(chosen), tuple(next_time([one.problem.channel for one in among])))


def _planned(
    found: Diagnosed | Campaign | PathLike,
    until: str,
    runs: int,
    channels: Channels,
    fleet: Fleet | PathLike | None,
    say: Progress,
) -> Planned:
    """The decision that goals lead to, with what is known already."""
    from shockrig.analysis.diagnose.diagnosed import outcome_of
    from shockrig.analysis.plan.decide import decide
    from shockrig.analysis.plan.decision import plan_document
    from shockrig.analysis.plan.goals import QUANTITY_OF, parse_goals, place_of
    from shockrig.protocols.made_before import outcomes

    with as_python():
        goals = parse_goals(until)
        if not 1 <= runs <= 100:
            raise InputError(f"runs={runs}: expected 1 to 100")
        campaign = found.campaign if isinstance(found, Diagnosed) else _campaign(found)
        wanted = of_campaign(campaign, channels)
        for one in goals.precisions:
            of = QUANTITY_OF[one.quantity]
            if channels is not None and not set(of) & set(wanted):
                raise InputError(f"until={until!r}: holds a goal of {of[0]}, which channels={channels!r} leaves out")
        made: dict[Place, ChannelOutcome] = {}
        advice: list[str] = []
        if isinstance(found, Diagnosed):
            made = {place_of(one.name, campaign.probe): outcome_of(one) for one in found.result.channels}
            advice = next_time([one.problem.channel for one in found.result.channels if one.name in wanted])
        elif campaign.path.is_dir():
            made = outcomes(campaign.path, [campaign], say)
        made = {place: one for place, one in made.items() if place in {place_of(n, campaign.probe) for n in wanted}}
        population = None if fleet is None else _fleet(fleet).population
        decision = decide(only(campaign, wanted), goals, count=runs, made=made, population=population, progress=say)
    document = plan_document(decision, goals)
    return Planned(tuple(document["runs"]), tuple(advice), decision.status, decision.reason, tuple(document["goals"]))


def correct(
    flight: pd.DataFrame | Flight | PathLike,
    profile: Profile | Characterized | Fleet | PathLike,
    *,
    method: str = "smoother",
    columns: Mapping[str, str] | None = None,
    map: PathLike | None = None,
    channels: Channels = None,
    clock_s: float | None = None,
    **settings: float | None,
) -> CorrectedFlight:
    """Correct a flight's temperature and humidity for the lag of the sensors that flew.

    A flight that does not fit into memory is corrected from file to file by the command `shockrig correct`.

    Parameters
    ----------
    flight : DataFrame, Flight or path
        A log as `read_flight` reads it: CSV, netCDF, ArduPilot's .bin, any text file by a map, or a DataFrame, whose
        columns are recognised by their names as a file's are.
    profile : Profile, Characterized, Fleet or path
        Of the sensors that flew; a channel that it lacks is given as it came and flagged `not_corrected`. A fleet
        stands for one of its sensors that nobody has characterized.
    method : {"smoother", "inverse", "paper"}
        The optimal smoother, or the published inverse, corrected or as printed.
    columns : mapping, optional
        Quantity ("time", "temperature", "humidity", "airspeed", "die", "pressure", "altitude", "latitude",
        "longitude") -> the column's name where it is not recognised.
    map : path, optional
        A map (shock-map/1) by which any text log is read, or the name of one that ships.
    channels : {"temperature", "humidity"} or several of them, optional
        What to correct; all that the profile has where it is left out.
    clock_s : float, optional
        Seconds by which the position's times are behind the readings', as `learn` finds them.
    **settings
        `cutoff_hz` of the inverses' low-pass; `temperature_noise_k`, `humidity_noise_percent` where they differ from
        the profile's.

    Returns
    -------
    CorrectedFlight

    Raises
    ------
    InputError
        The log or the profile cannot be read, the method is not known, no row can be used.

    Examples
    --------
    A bead with a time constant of a third of a second, carried through a front of 5 K:

    >>> import numpy as np
    >>> import pandas as pd
    >>> import shockrig
    >>> sensors = shockrig.characterize(shockrig.example("plain-rough"))
    >>> t63_s = sensors.profile.temperature.response_time_s.t63_s
    >>> time_s = np.arange(0.0, 60.0, 0.1)
    >>> late = np.where(time_s < 30.0, 0.0, 1.0 - np.exp(-np.maximum(time_s - 30.0, 0.0) / t63_s))
    >>> noise = 0.02 * np.random.default_rng(0).standard_normal(time_s.size)
    >>> log = pd.DataFrame({"time_s": time_s, "temperature_c": 15.0 + 5.0 * late + noise, "humidity_percent": 50.0})
    >>> done = shockrig.correct(log, sensors).to_frame().set_index("time_s")
    >>> bool(done.temperature_corrected_c[30.3] > done.temperature_c[30.3])
    True
    """
    known = {"cutoff_hz", "temperature_noise_k", "humidity_noise_percent", "lag_s"}
    if unknown := sorted(set(settings) - known):
        raise TypeError(f"correct() has no setting {unknown[0]!r}; known are {', '.join(sorted(known))}")
    if isinstance(profile, Characterized):
        profile = profile.profile
    if isinstance(profile, Fleet):
        profile = profile.typical()
    with as_python():
        sensors = of_profile(profile if isinstance(profile, Profile) else read_profile(profile), channels)
        rows, said = with_words(flight, columns, map)
        rows = rows if clock_s is None else on_clock(rows, clock_s)
        found = _correct(rows, sensors, method, **settings)
    notes = [*said, *(in_python(note) for note in found.notes)]
    for name, values in (("temperature", rows.temperature_c), ("humidity", rows.humidity_percent)):
        if getattr(sensors, name) is not None and not np.isfinite(values).any():
            notes.append(f"{name}: no column of it recognised; if there is one, columns={{{name!r}: ...}}")
    return CorrectedFlight(rows, replace(found, notes=tuple(notes)), sensors)


def learn(
    flights: pd.DataFrame | Flight | PathLike | Sequence[pd.DataFrame | Flight | PathLike],
    *,
    profile: Profile | Characterized | PathLike | None = None,
    columns: Mapping[str, str] | None = None,
    map: PathLike | None = None,
    progress: Progress | None = None,
) -> LearnedSensor:
    """Say from flights of one sensor, up and down through the same air, what it lacks: lags, clock, what is open.

    Parameters
    ----------
    flights : DataFrame, Flight or path, or several of them
        Whole flights, each with altitude or pressure, as `read_flight` reads them.
    profile : Profile, Characterized or path, optional
        A bench's: what is known before the flights.
    columns, map
        As in `correct`, for all flights.
    progress : function of a sentence, optional

    Returns
    -------
    LearnedSensor

    Raises
    ------
    InputError
        A log cannot be read, or no flight passes the same air twice.

    Examples
    --------
    From one flight and no bench; whether a correction helps takes a second flight to see.

    >>> import shockrig
    >>> found = shockrig.learn(shockrig.example("flight.csv"))
    >>> "time_constant_s" in set(found.to_frame().loc[["temperature"], "parameter"])
    True
    >>> after = found.correct(shockrig.example("flight.csv"))
    """
    from shockrig.analysis.learn.profile import learned_profile
    from shockrig.protocols.learning import learned_file, learned_from, with_altitude

    given = list(flights) if isinstance(flights, Sequence) and not isinstance(flights, str) else [flights]
    provenance = {"software": f"shockrig {_version()}"}
    with as_python():
        if isinstance(profile, Characterized):
            profile = profile.profile
        bench = profile if profile is None or isinstance(profile, Profile) else read_profile(profile)
        read: dict[str, Flight] = {}
        said: list[str] = []
        for i, one in enumerate(given):
            name = Path(one).name if isinstance(one, str | os.PathLike) else f"flight {i + 1}"
            name = name if name not in read else f"{name} ({i + 1})"
            rows, words = with_words(one, columns, map)
            read[name], more = with_altitude(rows)
            said += [f"{name}: {note}" for note in (*words, *more)]
        result = learned_from(read, bench, progress or (lambda text: None))
    said += [f"{name} left out: {why}" for name, why in result.left_out.items()]
    document = learned_file(result, read, provenance)
    return LearnedSensor(learned_profile(result, provenance, bench), document, result, tuple(said))


def fleet(
    campaigns: PathLike | Sequence[Campaign | PathLike],
    *,
    channels: Channels = None,
    extend: Diagnosed | PathLike | None = None,
    seed: int = 0,
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
    seed : int
        Of the differential evolution.
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
    from shockrig.analysis.fleet.fleet import fleet_of
    from shockrig.analysis.fleet.statistics import statistics_of
    from shockrig.files.fingerprint import fingerprint
    from shockrig.protocols.fleet_map import FleetTask, causes_in, tasks_of
    from shockrig.protocols.made_before import current

    say = progress or (lambda text: None)
    given = [campaigns] if isinstance(campaigns, str | os.PathLike) else list(campaigns)
    with as_python():
        read = [one for one in given if isinstance(one, Campaign)]
        folders = [Path(one) for one in given if not isinstance(one, Campaign)]
        tasks, failed = tasks_of(folders, seed, None, None)
        found, extensions = [], _extensions(extend)
        sources: list[Campaign | FleetTask] = [*read, *tasks]
        for one in sources:
            name = str(one.path)
            say(f"{name}: characterizing")
            try:
                campaign = one if isinstance(one, Campaign) else read_campaign(Path(one.path), one.probe)
                wanted = of_campaign(campaign, channels)
                result = _characterize(campaign, seed=seed, extensions=extensions, channels=wanted)
                causes = causes_in(current(campaign.path, campaign))
                found.append(replace(statistics_of(result, fingerprint(campaign)), causes=causes))
            except InputError as error:
                failed[name] = str(error)
        return fleet_of(found, failed, {"software": f"shockrig {_version()}"})


def _campaign(campaign: Campaign | PathLike) -> Campaign:
    return campaign if isinstance(campaign, Campaign) else read_campaign(Path(campaign))


def _fleet(fleet: Fleet | PathLike) -> Fleet:
    return fleet if isinstance(fleet, Fleet) else read_fleet(fleet)


def _extensions(extend: Diagnosed | PathLike | None) -> dict[ChannelName, Extension] | None:
    """Models that carry a diagnosis's causes."""
    if extend is None:
        return None
    if not isinstance(extend, Diagnosed):
        return read_extension(Path(extend))
    return {
        found.name: extension_of([stated_cause(cause).as_effect() for cause in found.causes])
        for found in extend.result.channels
    }


def _version() -> str:
    from importlib.metadata import version

    return version("shockrig")
