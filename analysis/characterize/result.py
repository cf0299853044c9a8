"""What a characterization holds: rows of a table, the fits they come from, channels, the whole, and the profile it
makes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from shockrig.analysis.checks.finding import InputFinding
from shockrig.analysis.estimate.channel import Channel, LeftOut
from shockrig.analysis.estimate.fit import Fit
from shockrig.analysis.estimate.fit_starts import Optimum
from shockrig.analysis.estimate.noise import Noise
from shockrig.analysis.estimate.problem import Problem
from shockrig.analysis.estimate.quantity import QUANTITIES, ChannelName, RunEffect
from shockrig.files.campaign import Campaign
from shockrig.files.diagnosis_data import Discovered
from shockrig.files.profile import (
    DiffusivityRow,
    HumidityProfile,
    Profile,
    ResponseTime,
    StatedEffect,
    TemperatureProfile,
    Uncertain,
)

# What a characterization holds: rows of a table, the fits they come from, channels, and the whole.

FAR_ABOVE_NOISE = 1.15  # residual over noise from which the model is not the whole story
FAR_DEVIATED = 2.0  # likewise, for how far start times and airs are bent


@dataclass(frozen=True)
class TableRow:
    """One ambient of one channel: the diffusivity [m^2/s] with its standard uncertainty, and what it rests on.

    `basis` is "all runs", "isothermal shocks", or how thermal shocks alone were read where there was nothing else.
    `evolution` and `check` are the two optimisers' findings, where they were asked.
    """

    ambient_c: float
    diffusivity_m2_s: float
    standard_uncertainty: float
    response: ResponseTime
    runs: tuple[str, ...]
    basis: str
    evolution: Optimum | None = None
    check: Optimum | None = None


@dataclass(frozen=True)
class Part:
    """Runs fitted together: the least squares problem, its fit, whose covariance takes in what its model is wrong by,
    and the RMSE over their samples [channel's unit]."""

    problem: Problem
    fit: Fit
    rmse: float

    @property
    def channel(self) -> Channel:
        return self.problem.channel

    def misfits(self, noise: Noise) -> bool:
        """Whether the residuals, or the runs' start times and airs, are larger than they should be."""
        return max(self.rmse / noise.while_moving, self.normalised_deviation) > FAR_ABOVE_NOISE

    def explained(self, noise: Noise) -> bool:
        """Whether the residuals are about as small as the noise, with start times and airs as they were recorded."""
        return _explained(self.rmse, self.normalised_deviation, noise)

    @property
    def normalised_deviation(self) -> float:
        """RMS normalised deviation of start times and airs: as fitted, in units of the uncertainty they came with."""
        counted = self.problem.stated
        counted[:, [RunEffect.RATE, RunEffect.STRENGTH]] = False  # their scatters are fitted
        scaled = (self.fit.deviations / self.problem.scatter)[counted]
        return float(np.sqrt(np.mean(scaled**2))) if scaled.size else 0.0


def _explained(rmse: float, normalised_deviation: float, noise: Noise) -> bool:
    return rmse < FAR_ABOVE_NOISE * noise.standard_deviation and normalised_deviation < FAR_DEVIATED


@dataclass(frozen=True)
class ChannelResult:
    """What a channel's runs say.

    Attributes
    ----------
    rows : tuple of Row
        One for each ambient, by rising temperature; one in all for the bead.
    noise : Noise
    effects : tuple of StatedEffect
        What the model carries beside the plain diffusion, with fitted parameters.
    parts : tuple of Part
        All runs; for a plain film the ambients with isothermal shocks, and those with thermal shocks alone.
    set_aside : tuple of LeftOut
        Runs that take no part, and why.
    discovered : tuple of Discovered
        Effects that nobody listed and the model carries too, with fitted numbers.
    """

    rows: tuple[TableRow, ...]
    noise: Noise
    effects: tuple[StatedEffect, ...]
    parts: tuple[Part, ...]
    set_aside: tuple[LeftOut, ...]
    discovered: tuple[Discovered, ...] = ()

    @property
    def channel(self) -> Channel:
        """The first part's channel, for what all parts share (length, sampling period, name)."""
        return self.parts[0].channel

    @property
    def runs(self) -> tuple[str, ...]:
        """Ids of the runs used."""
        return tuple(sorted(run for part in self.parts for run in part.channel.run_ids))

    @property
    def rmse(self) -> float:
        """Over the samples of all parts, each run's own random effects included [channel's unit]."""
        squares = [(part.rmse**2, int(part.channel.count.sum())) for part in self.parts]
        return float(np.sqrt(sum(r * n for r, n in squares) / sum(n for _, n in squares)))

    @property
    def explained(self) -> bool:
        """Whether the residuals are about as small as the noise, with start times and airs as they were recorded."""
        return _explained(self.rmse, self.normalised_deviation, self.noise)

    @property
    def normalised_deviation(self) -> float:
        """Of the part whose start times and airs had to give most."""
        return max(part.normalised_deviation for part in self.parts)

    @property
    def disagreement(self) -> float | None:
        """Largest relative difference between the two optimisers' rates; None where they were not asked."""
        pairs = [(row.evolution, row.check) for row in self.rows if row.evolution and row.check]
        return max((abs(float(np.expm1(b.log_rate - a.log_rate))) for a, b in pairs), default=None)


@dataclass(frozen=True)
class Characterization:
    """Result of `characterize`; a channel that cannot be had is None and `missing` says why."""

    campaign: Campaign
    seed: int
    temperature: ChannelResult | None
    humidity: ChannelResult | None
    missing: Mapping[ChannelName, str]
    findings: tuple[InputFinding, ...] = ()

    def channels(self) -> dict[ChannelName, ChannelResult]:
        """The channels that are there, by name."""
        return {name: found for name in QUANTITIES if (found := getattr(self, name)) is not None}

    @property
    def explained_parts(self) -> list[Part]:
        """Of the channels that the model explains."""
        return [part for found in self.channels().values() if found.explained for part in found.parts]


def channel_result(
    rows: Sequence[TableRow],
    noise: Noise,
    effects: tuple[StatedEffect, ...],
    parts: Sequence[Part],
    set_aside: Sequence[LeftOut],
    discovered: tuple[Discovered, ...] = (),
) -> ChannelResult:
    """A channel's result with its rows by rising ambient and the runs set aside in their order."""
    return ChannelResult(
        rows=tuple(sorted(rows, key=lambda row: row.ambient_c)),
        noise=noise,
        effects=effects,
        parts=tuple(parts),
        set_aside=tuple(sorted(set_aside, key=lambda entry: entry.run)),
        discovered=discovered,
    )


def to_profile(result: Characterization, provenance: Mapping[str, Any] | None = None) -> Profile:
    """The sensor profile of a characterization; `provenance` is added to what the result itself knows."""
    temperature = humidity = None
    if (t := result.temperature) is not None:
        row = t.rows[0]
        temperature = TemperatureProfile(
            thermal_diffusivity_m2_s=Uncertain(row.diffusivity_m2_s, row.standard_uncertainty),
            bead_radius_m=t.channel.length_m,
            response_time_s=row.response,
            noise_k=t.noise.standard_deviation,
            sampling_period_s=t.channel.sampling_period_s,
            effects=t.effects,
            discovered=t.discovered,
        )
    if (h := result.humidity) is not None:
        humidity = HumidityProfile(
            diffusivity_table=tuple(
                DiffusivityRow(r.ambient_c, r.diffusivity_m2_s, r.standard_uncertainty, len(r.runs), r.response)
                for r in h.rows
            ),
            film_thickness_m=h.channel.length_m,
            noise_percent=h.noise.standard_deviation,
            sampling_period_s=h.channel.sampling_period_s,
            effects=h.effects,
            discovered=h.discovered,
        )
    known = {
        "campaign": result.campaign.name,
        "runs_used": {name: list(found.runs) for name, found in result.channels().items()},
        "left_out": [
            {"run": entry.run, "channel": entry.channel, "reason": entry.reason}
            for found in result.channels().values()
            for entry in found.set_aside
        ],
        "missing": dict(result.missing),
        "seed": result.seed,
        "basis": {str(row.ambient_c): row.basis for row in (result.humidity.rows if result.humidity else ())},
        "rmse": {name: found.rmse for name, found in result.channels().items()},
        "optimisers_differ_by": {
            name: found.disagreement for name, found in result.channels().items() if found.disagreement is not None
        },
    }
    return Profile(temperature, humidity, result.campaign.sensors, known | dict(provenance or {}))
