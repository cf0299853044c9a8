"""What a fleet needs of one campaign: estimates and covariances in logarithms, and what its bench's errors do to them.

Given the population, sensors are independent: these few numbers are all that it takes of each of them.
    ln x = truth + own error (covariance R) + sum over inputs k that all runs share of C_k eps_k,     eps_k ~ N(0, 1)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from shockrig.analysis.characterize.budget import sources
from shockrig.analysis.characterize.history import began_at, bench_of
from shockrig.analysis.characterize.response_times import response_slopes
from shockrig.analysis.characterize.result import ChannelResult, Characterization, Part
from shockrig.analysis.estimate.noise import Noise
from shockrig.analysis.estimate.quantity import RunEffect
from shockrig.analysis.fleet.scatter import scatter_cost
from shockrig.files.campaign_names import serial_numbers
from shockrig.files.causes import StatedEffect
from shockrig.files.fleet_file import ALPHA, SENSOR_OF, Coordinate, D

Array = NDArray[np.float64]

LEAST_VARIANCE = 1e-12  # of a logarithm: a millionth


@dataclass(frozen=True)
class Responses:
    """Times to 63 % of a step, as a characterization states them.

    Attributes
    ----------
    of : ndarray (r,)
        Which coordinate (alpha, or D at an ambient) each belongs to.
    log_t63 : ndarray (r,)
        Of seconds.
    variance : ndarray (r,)
        Of that, what benches share included.
    slopes : ndarray (r, m)
        By how much it moves with each coordinate.
    """

    of: NDArray[np.int64]
    log_t63: Array
    variance: Array
    slopes: Array

    @classmethod
    def joined(cls, parts: Sequence[Responses]) -> Responses:
        """Those of several campaigns, whose coordinates stand one below the other."""
        sizes = [part.slopes.shape[1] for part in parts]
        first = np.cumsum([0, *sizes[:-1]])
        return cls(
            np.concatenate([part.of + start for part, start in zip(parts, first, strict=True)]),
            np.concatenate([part.log_t63 for part in parts]),
            np.concatenate([part.variance for part in parts]),
            block_diag(*(part.slopes for part in parts)),
        )

    def knowing(self, keep: NDArray[np.bool_], whole: Array) -> Responses:
        """Without the coordinates that are not kept: these follow from the others by the covariance `whole`."""
        there = keep[self.of]
        follow = np.linalg.solve(whole[np.ix_(keep, keep)], whole[np.ix_(keep, ~keep)])
        slopes = self.slopes[there]
        of = (np.cumsum(keep) - 1)[self.of[there]]
        moved = slopes[:, keep] + slopes[:, ~keep] @ follow.T
        return Responses(of, self.log_t63[there], self.variance[there], moved)

    def moved(self, by: Array, before: Array, after: Array) -> tuple[Array, Array]:
        """ln t63 (r,) and its variance (r,) where the coordinates are `by` further and their covariance is another."""
        linear, now = (np.einsum("rm,mn,rn->r", self.slopes, V, self.slopes) for V in (before, after))
        return self.log_t63 + self.slopes @ by, np.maximum(self.variance - linear, 0.0) + now


@dataclass(frozen=True)
class RunRates:
    """How far off the rates of a campaign's runs are: what probes side by side may have in common.

    Attributes
    ----------
    runs : tuple of str
    deviations : ndarray (R,)
        In standard deviations of what runs differ by.
    moves : ndarray (m, R)
        By how much each number is off where a run is off by one of them.
    """

    runs: tuple[str, ...]
    deviations: Array
    moves: Array


@dataclass(frozen=True)
class ChannelStatistics:
    """One channel of one campaign.

    Attributes
    ----------
    coordinates : tuple of Coordinate
        ln alpha, or ln D at each ambient; then parameters of the model that fly with the sensor.
    value : ndarray (m,)
    responses : Responses
        To a step of the air, and how they move with these.
    covariance : ndarray (m, m)
        Of its own errors.
    shared : mapping
        Input that all runs share -> what one standard uncertainty of it does (m,).
    rates : RunRates
        Its runs' own rates, part of `covariance`.
    """

    coordinates: tuple[Coordinate, ...]
    value: Array
    covariance: Array
    shared: Mapping[str, Array]
    responses: Responses
    runs: int
    explained: bool
    body: str
    length_m: float
    noise: float
    sampling_period_s: float
    rates: RunRates


@dataclass(frozen=True)
class CampaignStatistics:
    """One probe of one campaign; a channel that could not be had is in `missing`, with the reason. `causes` are those
    that a diagnosis names, by channel; a channel that was not diagnosed is not there. `scatter_cost` is what its runs
    say of how much they differ in rate (`scatter.scatter_cost`)."""

    name: str
    path: str
    probe: str
    fingerprint: str
    began_at: str
    bench: str
    serials: Mapping[str, str]
    channels: Mapping[str, ChannelStatistics]
    missing: Mapping[str, str] = field(default_factory=dict)
    emulated: bool = False
    causes: Mapping[str, tuple[StatedEffect, ...]] = field(default_factory=dict)
    scatter_cost: tuple[float, ...] = ()


def statistics_of(result: Characterization, fingerprint: str) -> CampaignStatistics:
    """What a fleet needs of a characterization."""
    campaign = result.campaign
    serials = serial_numbers(campaign.sensors, campaign.emulated)
    return CampaignStatistics(
        name=campaign.name,
        path=str(campaign.path),
        probe=campaign.probe,
        fingerprint=fingerprint,
        began_at=began_at(campaign),
        bench=bench_of(campaign),
        serials={channel: serials[name] for channel, name in SENSOR_OF.items() if name in serials},
        channels={str(name): _channel(found) for name, found in result.channels().items()},
        missing={str(name): reason for name, reason in result.missing.items()},
        emulated=campaign.emulated,
        scatter_cost=scatter_cost(result),
    )


def _channel(found: ChannelResult) -> ChannelStatistics:
    coordinates: list[Coordinate] = []
    values: list[float] = []
    blocks: list[Array] = []
    columns: list[dict[str, Array]] = []
    responses: list[Responses] = []
    rates: list[RunRates] = []
    for part in found.parts:
        places, names = stated(found, part, effects=part is found.parts[0])
        if not places:
            continue
        coordinates += names
        lengths = [2.0 * np.log(part.channel.length_m) if one.figure in (ALPHA, D) else 0.0 for one in names]
        values += list(part.fit.theta[places] + lengths)
        own, shared = _errors(found, part, found.noise, places)
        blocks.append(own)
        columns.append(shared)
        responses.append(_responses(found, part, places))
        rates.append(_rates(part, places))
    size, first = len(values), 0
    covariance = np.zeros((size, size))
    moves: dict[str, Array] = {}
    for own, shared in zip(blocks, columns, strict=True):
        here = slice(first, first + own.shape[0])
        covariance[here, here] = own
        for key, column in shared.items():
            moves.setdefault(key, np.zeros(size))[here] = column
        first = here.stop
    return ChannelStatistics(
        coordinates=tuple(coordinates),
        value=np.array(values),
        covariance=covariance,
        shared=moves,
        responses=Responses.joined(responses),
        runs=len(found.runs),
        explained=found.explained,
        body=found.channel.body,
        length_m=found.channel.length_m,
        noise=found.noise.standard_deviation,
        sampling_period_s=found.channel.sampling_period_s,
        rates=RunRates(
            tuple(run for one in rates for run in one.runs),
            np.concatenate([one.deviations for one in rates]),
            block_diag(*(one.moves for one in rates)),
        ),
    )


def stated(found: ChannelResult, part: Part, *, effects: bool) -> tuple[list[int], list[Coordinate]]:
    """Where in a part's theta stands what its rows state, and the parameters of effects that fly; and what it is."""
    channel, model = part.channel, part.fit.model
    places, names = [], []
    for row in found.rows:
        if row.runs[0] in channel.run_ids:
            g = int(np.argmin(np.abs(channel.ambients_c - row.ambient_c)))
            places.append(g)
            names.append(Coordinate(channel.name, ALPHA) if channel.quantity.pooled else film(row.ambient_c))
    for k, (effect, parameter) in enumerate(model.structure.parameters, start=channel.rates):
        if effects and effect.of_sensor and not effect.of_surroundings and places:
            places.append(k)
            names.append(Coordinate(channel.name, f"{effect.id}.{parameter.name}", log=parameter.log))
    return places, names


def _responses(found: ChannelResult, part: Part, places: list[int]) -> Responses:
    """Of a part's rows, in the order in which `stated` has them."""
    rows = [row.response for row in found.rows if row.runs[0] in part.channel.run_ids]
    t63 = np.array([one.t63_s for one in rows])
    spread = np.array([(one.standard_uncertainties_s or (0.0,))[0] for one in rows])
    slopes = [response_slopes(part.channel, part.fit, place)[1][0, places] for place in places[: len(rows)]]
    return Responses(np.arange(len(rows)), np.log(t63), (spread / t63) ** 2, np.array(slopes) / t63[:, None])


def film(temperature_c: float) -> Coordinate:
    """ln D of the film at a temperature."""
    return Coordinate("humidity", D, float(temperature_c))


def _errors(found: ChannelResult, part: Part, noise: Noise, places: list[int]) -> tuple[Array, dict[str, Array]]:
    """Covariance of a part's own errors, with what its rows are uncertain by beyond the fit; and its shared ones."""
    whole = part.fit.covariance[np.ix_(places, places)]
    shared = {one.of.key: one.moves[places, 0] for one in sources(part, noise) if one.of.key}
    own = whole - sum((np.outer(c, c) for c in shared.values()), np.zeros_like(whole))
    values, vectors = np.linalg.eigh(0.5 * (own + own.T))
    own = (vectors * np.maximum(values, LEAST_VARIANCE)) @ vectors.T
    rows = [row for row in found.rows if row.runs[0] in part.channel.run_ids]
    for place, row in enumerate(rows):
        beyond = (row.standard_uncertainty / row.diffusivity_m2_s) ** 2 - whole[place, place]
        own[place, place] += max(beyond, 0.0)  # as far as runs by themselves are from the model
    return own, shared


def _rates(part: Part, places: list[int]) -> RunRates:
    arrow = part.fit.arrow
    deviations = part.fit.deviations[:, RunEffect.RATE] * np.sqrt(arrow.weight[:, RunEffect.RATE])
    moves = arrow.shares()[0][RunEffect.RATE][places]
    return RunRates(tuple(part.channel.run_ids), deviations, moves)


def statistics_document(one: CampaignStatistics) -> dict[str, Any]:
    """As JSON, every digit kept: what was computed once is the same when it is read again."""
    return {
        **{name: getattr(one, name) for name in _PLAIN},
        "serials": dict(one.serials),
        "missing": dict(one.missing),
        "scatter_cost": list(one.scatter_cost),
        "channels": {
            name: {
                **{key: getattr(c, key) for key in _OF_CHANNEL},
                "coordinates": [[x.channel, x.figure, x.temperature_c, x.log] for x in c.coordinates],
                "value": c.value.tolist(),
                "covariance": c.covariance.tolist(),
                "shared": {key: column.tolist() for key, column in c.shared.items()},
                "responses": {key: column.tolist() for key, column in vars(c.responses).items()},
                "rates": {
                    key: list(column) if key == "runs" else column.tolist() for key, column in vars(c.rates).items()
                },
            }
            for name, c in one.channels.items()
        },
    }


_PLAIN = ("name", "path", "probe", "fingerprint", "began_at", "bench", "emulated")
_OF_CHANNEL = ("runs", "explained", "body", "length_m", "noise", "sampling_period_s")


def statistics_from(document: Mapping[str, Any]) -> CampaignStatistics:
    """What `statistics_document` wrote."""
    return CampaignStatistics(
        **{name: document[name] for name in _PLAIN},
        serials=document["serials"],
        missing=document["missing"],
        scatter_cost=tuple(document["scatter_cost"]),
        channels={
            name: ChannelStatistics(
                **{key: c[key] for key in _OF_CHANNEL},
                coordinates=tuple(Coordinate(*x) for x in c["coordinates"]),
                value=np.array(c["value"], dtype=float),
                covariance=np.array(c["covariance"], dtype=float).reshape(len(c["value"]), -1),
                shared={key: np.array(column, dtype=float) for key, column in c["shared"].items()},
                responses=Responses(**{key: np.array(column) for key, column in c["responses"].items()}),
                rates=RunRates(tuple(c["rates"]["runs"]), *(np.array(c["rates"][k]) for k in ("deviations", "moves"))),
            )
            for name, c in document["channels"].items()
        },
    )
