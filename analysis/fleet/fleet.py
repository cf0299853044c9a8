"""A fleet from what each campaign says: which sensors there are, the population, each sensor shrunk, what drifts."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from statistics import NormalDist, median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.fleet.population import (
    LEAST_SENSORS,
    NODES_APART_K,
    FleetMember,
    JudgedFleet,
    Members,
    change_along,
    judge,
    nodes,
    table_scatter,
)
from shockrig.analysis.fleet.scatter import scatter_of_benches
from shockrig.analysis.fleet.statistics import CampaignStatistics, Responses
from shockrig.analysis.fleet.whose import causes_of
from shockrig.files.causes import Uncertain
from shockrig.files.errors import InputError
from shockrig.files.fleet_file import (
    CHANNELS,
    Coordinate,
    Fleet,
    FleetChannel,
    FleetFigure,
    FleetSensor,
    FleetTrend,
    Population,
    RunScatter,
    design,
)
from shockrig.files.numbers import counted

Array = NDArray[np.float64]

TREND_FALSE_ALARMS = 0.01  # of fleets in which nothing drifts and no batch differs, those in which something is said
LEAST_IN_BATCH = 3
MOST_PLACES = 100  # at which a batch may begin
LEAST_FOR_TRENDS = 8
YEAR_S = 365.25 * 86400.0
LEAST_SPAN_YEARS = 1.0 / 365.25
COMMON_SHARES = np.linspace(0.0, 0.99, 100)  # of what runs differ by, in all probes alike, that are tried
LEAST_COMMON_RUNS = 4  # of fewer, less than nothing is left beside the means that were fitted
KEPT_OF_COMMON = 0.999  # of the variance that probes have in common, the rest counts as each one's own


def fleet_of(
    statistics: Sequence[CampaignStatistics],
    left_out: Mapping[str, str] | None = None,
    provenance: Mapping[str, Any] | None = None,
) -> Fleet:
    """The fleet of some campaigns; `left_out` (campaign -> why) is what could not be had.

    Raises
    ------
    InputError
        Fewer than three sensors: a spread cannot be told.
    """
    refused = dict(left_out or {})
    kept = _of_one_type(_without_copies(statistics, refused), refused)
    members = members_of(kept)
    taken = {(one.path, one.probe) for sensor in members.sensors for one in sensor.campaigns}
    refused |= {_called(one): _reasons(_lacking(one)) for one in kept if (one.path, one.probe) not in taken}
    if len(members.sensors) < LEAST_SENSORS:
        why = "; ".join(f"{name}: {reason}" for name, reason in list(refused.items())[:3])
        raise InputError(
            f"{counted(len(members.sensors), 'sensor')} that can be characterized, a fleet needs {LEAST_SENSORS}; name "
            f"more campaigns{f' ({why})' if why else ''}"
        )
    judged = judge(members)
    return Fleet(
        population_of(members, judged),
        tuple(_sensor(members, judged, i) for i in range(len(members.sensors))),
        tuple(_trends(members, judged)),
        refused,
        dict(provenance or {}),
        causes_of(members.sensors),
        runs_in_common([one.campaigns[0] for one in members.sensors if len(one.campaigns) == 1]),
    )


def _without_copies(statistics: Sequence[CampaignStatistics], refused: dict[str, str]) -> list[CampaignStatistics]:
    first: dict[tuple[str, str], CampaignStatistics] = {}
    for one in sorted(statistics, key=lambda s: (s.name, s.path, s.probe)):
        known = first.setdefault((one.fingerprint, one.probe), one)
        if known is not one:
            refused[_called(one)] = f"the same readings as {known.path}"
    return list(first.values())


def _called(one: CampaignStatistics) -> str:
    return one.path if one.probe == "1" else f"{one.path}, probe {one.probe}"


def _of_one_type(statistics: Sequence[CampaignStatistics], refused: dict[str, str]) -> list[CampaignStatistics]:
    """Without the channels whose body or stated length is not what most have."""
    kept = []
    usual = {}
    for channel in CHANNELS:
        kinds = Counter(
            (s.channels[channel].body, s.channels[channel].length_m) for s in statistics if channel in s.channels
        )
        if kinds:
            usual[channel] = kinds.most_common(1)[0][0]
    for one in statistics:
        channels, missing = dict(one.channels), dict(one.missing)
        for channel, found in one.channels.items():
            if (found.body, found.length_m) != usual[channel]:
                body, length_m = usual[channel]
                missing[channel] = (
                    f"is a {found.body} of {found.length_m:g} m, most are a {body} of {length_m:g} m; make a fleet "
                    "of each"
                )
                del channels[channel]
        if channels:
            kept.append(CampaignStatistics(**{**vars(one), "channels": channels, "missing": missing}))
        else:
            refused[_called(one)] = _reasons(missing)
    return kept


def _reasons(missing: Mapping[str, str]) -> str:
    return "; ".join(f"{name}: {why}" for name, why in missing.items())


def _lacking(one: CampaignStatistics) -> dict[str, str]:
    """Why a channel of a campaign is none of its sensor's."""
    return dict.fromkeys(one.channels, "no others have its numbers, or not at its temperatures") | dict(one.missing)


def members_of(statistics: Sequence[CampaignStatistics]) -> Members:
    """The sensors: campaigns of the same serial numbers are one sensor's."""
    groups: dict[Any, list[CampaignStatistics]] = {}
    for one in statistics:
        key = tuple(sorted(one.serials.items())) if one.serials else (one.path, one.probe)
        groups.setdefault(key, []).append(one)
    keys = tuple(sorted({k for one in statistics for c in one.channels.values() for k in c.shared}))
    names = _names(list(groups.values()))
    on_bench = Counter(bench for group in groups.values() if (bench := _one_bench(group)))
    alone = [group[0] for group in groups.values() if len(group) == 1]
    carried = carriage_errors(alone, runs_in_common(alone))
    widest = max((columns.shape[1] for columns in carried.values()), default=0)
    sensors: list[FleetMember] = []
    for name, group in zip(names, groups.values(), strict=True):
        bench = _one_bench(group)
        member = _member(name, group, keys, bench if on_bench[bench] > 1 else "")
        columns = carried.get((group[0].path, group[0].probe)) if len(group) == 1 else None
        sensors.append(_beside_others(member, columns, widest))
    coordinates = nodes(sensors)
    sensors = [_knowing(one, coordinates) for one in sensors]
    sensors = [one for one in sensors if one.value.size]
    return Members(tuple(sensors), coordinates, keys, table_scatter(sensors, coordinates))


def _beside_others(one: FleetMember, columns: Array | None, widest: int) -> FleetMember:
    """The sensor with what its carriage does as columns of its own, which its own errors are then without."""
    if columns is None:
        return replace(one, common=np.pad(one.common, ((0, 0), (0, widest))))
    return replace(
        one,
        carriage=one.campaigns[0].path,
        covariance=one.covariance - columns @ columns.T,
        common=np.hstack([one.common, np.pad(columns, ((0, 0), (0, widest - columns.shape[1])))]),
    )


def runs_in_common(probes: Sequence[CampaignStatistics]) -> dict[str, dict[str, float]]:
    """How much of what runs differ by is the same in all probes, by path and channel of campaigns with several; of too
    few runs nothing can be said.

    Where their rates differ from run to run by the same, the airflow was another one, or the air.
    """
    found: dict[str, dict[str, float]] = {}
    for path, beside in _side_by_side(probes).items():
        for channel in sorted({name for one in beside for name in one.channels}, key=CHANNELS.index):
            if (share := common_share(_rates_beside(beside, channel))) is not None:
                found.setdefault(path, {})[channel] = share
    return found


def _side_by_side(probes: Sequence[CampaignStatistics]) -> dict[str, list[CampaignStatistics]]:
    """The probes of each campaign that has several."""
    found: dict[str, list[CampaignStatistics]] = {}
    for one in probes:
        found.setdefault(one.path, []).append(one)
    return {path: beside for path, beside in found.items() if len(beside) > 1}


def carriage_errors(
    probes: Sequence[CampaignStatistics], in_common: Mapping[str, Mapping[str, float]]
) -> dict[tuple[str, str], Array]:
    """What runs that are off in all probes of a campaign alike do to the numbers of each (path, probe): columns (m, k)
    for independent errors of unit variance; only of campaigns whose probes have something in common."""
    found: dict[tuple[str, str], Array] = {}
    for path, beside in _side_by_side(probes).items():
        shares = in_common.get(path, {})
        places = {run: k for k, run in enumerate(_runs_of(beside))}
        stacked = []
        for probe in beside:
            moved = np.zeros((sum(c.value.size for c in probe.channels.values()), len(places)))
            first = 0
            for name, c in probe.channels.items():
                here = slice(first, first := first + c.value.size)
                at = [places[name, run] for run in c.rates.runs]
                moved[here, at] = math.sqrt(shares.get(name, 0.0)) * c.rates.moves
            stacked.append(moved)
        if not np.any(np.vstack(stacked)):
            continue
        # Probes with the same runs are moved alike, so that a few directions are nearly all of it.
        U, size, _ = np.linalg.svd(np.vstack(stacked), full_matrices=False)
        kept = 1 + int(np.searchsorted(np.cumsum(size**2), KEPT_OF_COMMON * (size**2).sum()))
        ends = np.cumsum([block.shape[0] for block in stacked])[:-1]
        for probe, columns in zip(beside, np.split(U[:, :kept] * size[:kept], ends), strict=True):
            found[path, probe.probe] = columns
    return found


def _runs_of(beside: Sequence[CampaignStatistics]) -> list[tuple[str, str]]:
    """Channel and run of every rate that some probe of a campaign has."""
    every = ((name, run) for one in beside for name, c in one.channels.items() for run in c.rates.runs)
    return list(dict.fromkeys(every))


def _rates_beside(beside: Sequence[CampaignStatistics], channel: str) -> Array:
    """How far runs are off in the rates of the probes of a campaign (n, R), in standard deviations; NaN where one has
    no such run."""
    runs = [run for name, run in _runs_of(beside) if name == channel]
    off = np.full((len(beside), len(runs)), np.nan)
    for k, one in enumerate(beside):
        if channel in one.channels:
            rates = one.channels[channel].rates
            off[k, [runs.index(run) for run in rates.runs]] = rates.deviations
    return off


def common_share(off: Array) -> float | None:
    """How much of the variance of deviations (n, R) is the same in all probes: its mean under what they say; None where
    too few runs say it.

    Half of the prior is that nothing is, the other half any share alike; the likelihood is that of normal numbers, of
    which those of one run correlate by the share.
    """
    there = np.isfinite(off).sum(axis=0)
    off, there = off[:, there > 1], there[there > 1]
    if there.size < LEAST_COMMON_RUNS:
        return None
    middle = np.nanmean(off, axis=0)
    between, within = there * middle**2, np.nansum((off - middle) ** 2, axis=0)
    share = COMMON_SHARES[:, None]
    first = 1.0 + (there - 1) * share
    variance = ((between / first + within / (1.0 - share)).sum(axis=1) / there.sum()).clip(1e-12)
    logs = -0.5 * there.sum() * np.log(variance) - 0.5 * (np.log(first) + (there - 1) * np.log(1.0 - share)).sum(axis=1)
    prior = np.full(COMMON_SHARES.size, 0.5 / (COMMON_SHARES.size - 1))
    prior[0] = 0.5
    weight = prior * np.exp(logs - logs.max())
    return float(weight @ COMMON_SHARES / weight.sum())


def _one_bench(group: Sequence[CampaignStatistics]) -> str:
    """The bench that all campaigns of a sensor were recorded on; empty where there were several."""
    benches = {one.bench for one in group}
    return benches.pop() if len(benches) == 1 else ""


def _names(groups: Sequence[Sequence[CampaignStatistics]]) -> list[str]:
    """What each sensor is called: its serial numbers, else its campaign's name, each once."""
    names = []
    for group in groups:
        serials = list(dict.fromkeys(group[0].serials.values()))
        probe = "" if group[0].probe == "1" else f", probe {group[0].probe}"
        names.append(" / ".join(serials) if serials else group[0].name + probe)
    taken = Counter(names)
    return [name if taken[name] == 1 else _called(group[0]) for name, group in zip(names, groups, strict=True)]


def _member(name: str, group: Sequence[CampaignStatistics], keys: tuple[str, ...], bench: str) -> FleetMember:
    """A sensor's numbers one below the other; what nobody shares with it is its own error."""
    parts = [c for one in group for c in one.channels.values()]
    sizes = [c.value.size for c in parts]
    size = sum(sizes)
    covariance, common = np.zeros((size, size)), np.zeros((size, len(keys)))
    for c, end in zip(parts, np.cumsum(sizes), strict=True):
        here = slice(end - c.value.size, end)
        covariance[here, here] = c.covariance
        for key, column in c.shared.items():
            common[here, keys.index(key)] = column
    if not bench:
        covariance, common = covariance + common @ common.T, np.zeros_like(common)
    coordinates = tuple(x for c in parts for x in c.coordinates)
    return FleetMember(
        name=name,
        campaigns=tuple(group),
        coordinates=coordinates,
        channel=np.array([x.channel for x in coordinates]),
        film=np.array([x.temperature_c is not None for x in coordinates]),
        value=np.concatenate([c.value for c in parts]),
        covariance=covariance,
        common=common,
        bench=bench,
        responses=Responses.joined([c.responses for c in parts]),
    )


def _knowing(one: FleetMember, coordinates: Sequence[Coordinate]) -> FleetMember:
    """Without numbers that too few sensors have for a population of them."""
    keep = (design(coordinates, one.coordinates) != 0).any(axis=1)
    at = [c.temperature_c for c in coordinates if c.temperature_c is not None]
    if len(at) == 1:
        # One temperature says nothing of how D changes with it.
        keep &= [c.temperature_c is None or abs(c.temperature_c - at[0]) <= NODES_APART_K for c in one.coordinates]
    return FleetMember(
        one.name,
        one.campaigns,
        tuple(c for c, k in zip(one.coordinates, keep, strict=True) if k),
        one.channel[keep],
        one.film[keep],
        one.value[keep],
        one.covariance[np.ix_(keep, keep)],
        one.common[keep],
        one.bench,
        one.responses.knowing(keep, one.covariance + one.common @ one.common.T),
        one.carriage,
    )


def population_of(members: Members, judged: JudgedFleet) -> Population:
    """The population of those that belong."""
    found = judged.estimate
    channels: dict[str, list[Any]] = {}
    for one in members.sensors:
        for statistics in one.campaigns:
            for name, channel in statistics.channels.items():
                channels.setdefault(name, []).append(channel)
    return Population(
        coordinates=members.coordinates,
        mean=found.at.mean,
        mean_covariance=found.at.mean_covariance,
        covariance=found.sigma,
        degrees=found.degrees,
        table_scatter=members.table_scatter,
        sensors={
            name: int(sum(judged.belongs[name][i] and name in s.channel for i, s in enumerate(members.sensors)))
            for name in channels
        },
        bodies={name: found[0].body for name, found in channels.items()},
        lengths_m={name: found[0].length_m for name, found in channels.items()},
        noise={name: median(c.noise for c in found) for name, found in channels.items()},
        sampling_period_s={name: median(c.sampling_period_s for c in found) for name, found in channels.items()},
        run_scatter=_run_scatter([campaign for one in members.sensors for campaign in one.campaigns]),
    )


def _run_scatter(campaigns: Sequence[CampaignStatistics]) -> RunScatter | None:
    """By bench; probes side by side may be off together, and count as one."""
    by_path: dict[tuple[str, str], list[Array]] = {}
    for one in campaigns:
        if one.scatter_cost:
            by_path.setdefault((one.bench, one.path), []).append(np.array(one.scatter_cost))
    benches: dict[str, Array] = {}
    for (bench, _), costs in by_path.items():
        benches[bench] = benches.get(bench, 0.0) + np.mean(costs, axis=0)
    return scatter_of_benches(list(benches.values()))


def _sensor(members: Members, judged: JudgedFleet, i: int) -> FleetSensor:
    one = members.sensors[i]
    value, covariance = _shrunk(members, judged, i)
    whole = one.covariance + one.common @ one.common.T
    t63 = _times(one.responses, one.responses.log_t63, one.responses.variance)
    shrunk_t63 = _times(one.responses, *one.responses.moved(value - one.value, whole, covariance))
    channels, missing = {}, {}
    for name in dict.fromkeys(one.channel):
        belongs = bool(judged.belongs[name][i])
        figures = []
        for place in np.flatnonzero(one.channel == name):
            c = one.coordinates[place]
            own = c.natural(float(one.value[place]), math.sqrt(whole[place, place]))
            variance = float((covariance if belongs else whole)[place, place])
            H = design(members.coordinates, [c])[0]
            prior = float(H @ (judged.estimate.sigma + judged.estimate.at.mean_covariance) @ H)
            figures.append(
                FleetFigure(
                    c,
                    own,
                    c.natural(float(value[place]), math.sqrt(variance)) if belongs else own,
                    min(max(1.0 - variance / prior, 0.0), 1.0) if belongs else 1.0,
                    t63.get(int(place)),
                    (shrunk_t63 if belongs else t63).get(int(place)),
                )
            )
        found = [s.channels[name] for s in one.campaigns if name in s.channels]
        channels[str(name)] = FleetChannel(
            belongs,
            float(judged.probability[name][i]),
            float(judged.adjusted[name][i]),
            sum(c.runs for c in found),
            all(c.explained for c in found),
            tuple(
                sorted(figures, key=lambda f: (f.coordinate.temperature_c is None, f.coordinate.temperature_c or 0.0))
            ),
        )
    for statistics in one.campaigns:
        missing.update({k: v for k, v in _lacking(statistics).items() if k not in channels})
    return FleetSensor(
        one.name,
        tuple(_called(s) for s in one.campaigns),
        min((s.began_at for s in one.campaigns if s.began_at), default=""),
        {k: v for s in one.campaigns for k, v in s.serials.items()},
        channels,
        missing,
    )


def _times(of: Responses, log_t63: Array, variance: Array) -> dict[int, Uncertain]:
    """Times to 63 % [s] by the number that each belongs to."""
    found = zip(of.of, np.exp(log_t63), np.sqrt(variance), strict=True)
    return {int(place): Uncertain(float(t), float(t * u)) for place, t, u in found}


def _shrunk(members: Members, judged: JudgedFleet, i: int) -> tuple[Array, Array]:
    """A sensor's numbers with what the others say (m,), and their covariance (m, m).

    t = H (mu + b) + l, where l is what its table scatters by: of what is left of x, l takes W = lambda^2 R^-1.
    """
    one, r, sigma, at = members.sensors[i], judged.reduced, judged.estimate.sigma, judged.estimate.at
    size, H, C = sigma.shape[0], design(members.coordinates, one.coordinates), one.common
    M = np.linalg.inv(np.eye(size) + r.A[i] @ sigma)
    gain = sigma @ M
    T = np.concatenate([r.A[i], r.F[i]], axis=1)
    beta, known = at.beta[i], at.covariance[i]
    mean = np.zeros((size, beta.size))
    mean[:, :size] = np.eye(size)
    z = beta[:size] + gain @ (r.a[i] - T @ beta)
    J = mean - gain @ T
    scatter = members.table_scatter**2 * one.film
    W = scatter[:, None] * np.linalg.inv(one.errors(members.table_scatter))
    keep = (np.eye(one.value.size) - W) @ H
    value = H @ z + W @ (one.value - H @ z - C @ beta[size:])
    moved = keep @ J
    moved[:, size:] -= W @ C
    covariance = keep @ gain @ keep.T + np.diag(scatter) - W * scatter[None, :] + moved @ known @ moved.T
    return value, covariance


def _trends(members: Members, judged: JudgedFleet) -> list[FleetTrend]:
    """What differs with the date, and from a place in the order of serial numbers on."""
    tests: list[tuple[FleetTrend, float]] = []
    for channel in judged.belongs:
        there = np.array([channel in one.channel for one in members.sensors]) & judged.belongs[channel]
        if there.sum() < LEAST_FOR_TRENDS:
            continue
        dates = _years(members)
        if dates is not None and np.isfinite(dates[there]).all() and np.ptp(dates[there]) >= LEAST_SPAN_YEARS:
            along = np.where(there, dates - np.mean(dates[there]), 0.0)
            tests.append((_trend(members, judged, channel, along, "year", ""), 1.0))
        order = _by_serial(members, channel, there)
        places = np.unique(
            np.linspace(LEAST_IN_BATCH, max(len(order) - LEAST_IN_BATCH, LEAST_IN_BATCH), MOST_PLACES).astype(int)
        )
        found = []
        for place in places if len(order) >= LEAST_FOR_TRENDS else ():
            along = np.zeros(len(members.sensors))
            along[order[place:]] = 1.0
            since = members.sensors[order[place]].campaigns[0].serials[channel]
            found.append(_trend(members, judged, channel, along, "batch", since))
        if found:
            tests.append((min(found, key=lambda t: t.probability), float(len(found))))
    level = TREND_FALSE_ALARMS / max(len(tests), 1)
    said = [(trend, min(trend.probability * tried, 1.0)) for trend, tried in tests]
    return [FleetTrend(t.channel, t.per, t.since, t.change, min(p * len(tests), 1.0)) for t, p in said if p < level]


def _trend(members: Members, judged: JudgedFleet, channel: str, along: Array, per: str, since: str) -> FleetTrend:
    change, covariance = change_along(judged.reduced, judged.estimate, along)
    rates = [k for k, c in enumerate(members.coordinates) if c.channel == channel and c.unit]
    # By how well each is known: of one that no sensor that belongs has, nothing is.
    weight = np.zeros(change.size)
    weight[rates] = 1.0 / np.diag(covariance)[rates]
    weight /= weight.sum()
    by, u = float(weight @ change), math.sqrt(float(weight @ covariance @ weight))
    probability = 2.0 * NormalDist().cdf(-abs(by) / u)
    return FleetTrend(channel, per, since, Uncertain(math.expm1(by), math.exp(by) * u), probability)


def _years(members: Members) -> Array | None:
    """When each sensor's first campaign began, in years; None where that is known of none."""
    found = []
    for one in members.sensors:
        try:
            began = min(s.began_at for s in one.campaigns if s.began_at)
            found.append(datetime.fromisoformat(began.replace("Z", "+00:00")).timestamp() / YEAR_S)
        except (ValueError, OverflowError):
            found.append(math.nan)
    return np.array(found) if np.isfinite(found).any() else None


def _by_serial(members: Members, channel: str, there: NDArray[np.bool_]) -> list[int]:
    """Sensors with serial numbers by these: words as words, numbers as numbers."""

    def parts(serial: str) -> list[tuple[bool, int, str]]:
        return [(p.isdigit(), int(p) if p.isdigit() else 0, p) for p in re.findall(r"\d+|\D+", serial)]

    known = [
        (parts(serial), i)
        for i, one in enumerate(members.sensors)
        if there[i] and (serial := one.campaigns[0].serials.get(channel))
    ]
    return [i for _, i in sorted(known)]
