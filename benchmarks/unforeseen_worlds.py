"""Worlds with an effect that a random program wrote: links of the chain, kernels, nonlinearities, what they depend on.

The chain is its own, apart from `rig` (which lends the sensors, the noise and the plans) and from `analysis`: air ->
exchange -> body -> readout -> logger. A body is its modes (a sphere's core, a film's mean), driven by any air:

    z_k' = r_k (a(t) - z_k), y = sum_k w_k z_k; exact for an air that is linear between instants

A world is all that its seed draws; the same seed draws the same world for ever.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfcx

if TYPE_CHECKING:
    from shockrig.rig.virtual.plans import Shock
    from shockrig.rig.virtual.truth import Truth

Array = NDArray[np.float64]
T, RH = "temperature", "humidity"
MODES = 40
PERIOD_S = 0.1
FINE, GROWTH = (
    60.0,
    0.004,
)  # instants in the fastest body's first time constant, and how much further apart later ones are
SECOND = 0.15  # share of worlds with a second effect
STANDARD_ORDER = 0.5  # share of worlds whose campaign has the standard order
TIMES_NOISE = (1.0, 20.0)  # rms of what the effect changes beyond the body's rate, over the noise
FRESH = 1_000_000
SEARCHED = 24  # sizes looked at until an effect is as large as was drawn
FREE = 1e-3  # relative step of a rate, to see what it does


@dataclass(frozen=True)
class Runs:
    """Conditions of a campaign's runs, arrays (R,): airs degC and %RH, airflow m/s, order from 0, draws of each run."""

    source_c: Array
    source_percent: Array
    there_c: Array
    there_percent: Array
    airflow_m_s: Array
    pressure_hpa: Array
    order: Array
    chance: Array  # standard normal, one a run
    phase: Array  # 0 to 2 pi

    def step(self, channel: str) -> Array:
        return self.there_c - self.source_c if channel == T else self.there_percent - self.source_percent


@dataclass(frozen=True)
class Act:
    """One thing that happens: its link, kind and kernel, and by what its size is multiplied in each run."""

    link: str
    kind: str
    kernel: str = "none"
    time_s: float = 0.0
    other_s: float = 0.0
    size: float = 0.0
    depends: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class World:
    """One sensor with what happens to it."""

    seed: int
    channel: str
    truth: Truth
    acts: tuple[Act, ...]
    noise: float
    times_noise: float = 0.0
    shuffled: bool = False

    @property
    def words(self) -> str:
        """The truth as a sentence."""
        return "; ".join(_words(act) for act in self.acts)

    def document(self) -> dict[str, Any]:
        """The truth as JSON."""
        return {
            "seed": self.seed,
            "channel": self.channel,
            "words": self.words,
            "acts": [dataclasses.asdict(act) for act in self.acts],
            "noise": self.noise,
            "times_noise": self.times_noise,
            "shuffled": self.shuffled,
        }


# What a size is multiplied by in each run: name -> (draw of its number, factor from number, runs and channel).
def _drawn(low: float, high: float) -> Callable[[np.random.Generator], float]:
    return lambda rng: float(rng.choice((-1.0, 1.0)) * rng.uniform(low, high))


Depends = Callable[[float, Runs, str], Array]
DEPENDS: dict[str, tuple[Callable[[np.random.Generator], float], Depends]] = {
    "airflow": (_drawn(0.4, 1.2), lambda n, r, c: (r.airflow_m_s / 6.0) ** n),
    "ambient": (_drawn(0.02, 0.06), lambda n, r, c: np.exp(n * (r.there_c - 20.0))),
    "direction": (_drawn(0.6, 1.0), lambda n, r, c: 1.0 + n * np.sign(r.step(c))),
    "step": (_drawn(0.5, 1.0), lambda n, r, c: (np.maximum(np.abs(r.step(c)), 1.0) / 20.0) ** n),
    "humidity": (_drawn(0.01, 0.03), lambda n, r, c: np.exp(n * (r.there_percent - 50.0))),
    "run order": (_drawn(1.0, 1.0), lambda n, r, c: (0.5 + 0.5 * n) - n * r.order / max(r.order.max(), 1.0)),
    "group": (lambda rng: float(rng.uniform(0.25, 0.75)), lambda n, r, c: 1.0 * (r.order >= n * r.order.size)),
    "chance": (lambda rng: float(rng.uniform(0.3, 1.0)), lambda n, r, c: np.maximum(1.0 + n * r.chance, 0.0)),
}
KERNELS: dict[str, Callable[[Array, float, float], Array]] = {  # of time since the transfer; 1 at the beginning or less
    "exponential": lambda t, a, b: np.exp(-t / a),
    "two exponentials": lambda t, a, b: 0.5 * (np.exp(-t / a) + np.exp(-t / b)),
    "square root of time": lambda t, a, b: erfcx(np.sqrt(t / a)),
    "delayed": lambda t, a, b: np.where(t >= b, np.exp(-np.maximum(t - b, 0.0) / a), 0.0),
    "resonant": lambda t, a, b: np.exp(-t / a) * np.sin(2.0 * np.pi * t / b),
}


@dataclass(frozen=True)
class Kind:
    """A kind of act: its link, the sizes that it may have (in the channel's own units where it adds), the kernels, the
    behaviours of a description and the names of the catalogue that say the same, and whether it needs a dependence."""

    link: str
    low: float
    high: float
    kernels: tuple[str, ...] = ("none",)
    says: frozenset[str] = frozenset()
    needs: tuple[str, ...] = ()  # one of these dependences, or none where empty
    channels: tuple[str, ...] = (T, RH)


_ALL, _RATES = tuple(KERNELS), ("run order", "group", "direction", "airflow", "step", "humidity", "chance")
# What comes late or fades away is, with a time constant of its own, exactly `parallel_lag` where it passes beside the
# body, `added_rate` of the reading where it passes through the body, and `added_rate` of nothing where it is added.
_ECHO = frozenset(
    {"added_response", "added_rate", "parallel_lag", "air_relaxation", "slow_relaxation", "stem_conduction", "periodic"}
)
_LAG = frozenset({"lag_in_series", "series_lag", "delay", "dead_time", "finite_transfer", "moving_average"})
_GAIN = frozenset({"gain", "calibration_error", "calibration_temperature", "offset"})
KINDS: dict[str, Kind] = {
    "echo of the old air": Kind("air", 1e-3, 0.5, _ALL, _ECHO | {"chamber_overshoot"}),
    "air of a room": Kind("air", 1e-3, 0.5, _ALL, _ECHO),
    "lag before the body": Kind("exchange", 1e-2, 20.0, ("none",), _LAG | {"convective_film", "vapour_boundary_layer"}),
    "delay before the body": Kind("exchange", 1e-2, 10.0, ("none",), _LAG),
    "a share comes late": Kind("exchange", 1e-3, 0.6, ("exponential", "two exponentials"), _ECHO),
    "rate": Kind(
        "body",
        1e-3,
        1.5,
        ("none",),
        frozenset({"rate_change", "direction_dependent_diffusivity", "convective_film", "vapour_boundary_layer"}),
        _RATES,
    ),
    "rate that moves with the reading": Kind(
        "body", 1e-2, 0.9, ("none",), frozenset({"rate_change", "concentration_dependent_diffusivity"})
    ),
    "rate that drifts within a run": Kind("body", 1e-2, 5.0, ("none",), frozenset({"rate_change", "parallel_lag"})),
    "a share follows late": Kind("body", 1e-3, 0.6, ("exponential", "two exponentials", "square root of time"), _ECHO),
    "added after the transfer": Kind("readout", 1e-3, 20.0, _ALL, _ECHO | {"self_heating", "offset"}),
    "added with the other quantity": Kind("readout", 1e-4, 2.0, _ALL, _ECHO),
    "added with a rate of change": Kind(
        "readout", 1e-3, 20.0, ("none",), frozenset({"added_rate", "added_response", "parallel_lag"}), channels=(RH,)
    ),
    "gain": Kind("readout", 1e-4, 0.3, ("none",), _GAIN, ("ambient", "run order", "group", "direction", "chance")),
    "offset": Kind("readout", 1e-3, 20.0, ("none",), _GAIN | {"hysteresis"}, (*_RATES, "ambient")),
    "bent calibration": Kind("readout", 1e-4, 1.0, ("none",), _GAIN | {"bent_calibration"}),
    "memory of the run before": Kind("readout", 1e-4, 0.3, ("none",), frozenset({"hysteresis", "offset", "gain"})),
    "play": Kind("readout", 1e-2, 10.0, ("none",), frozenset({"hysteresis", "offset"})),
    "hum": Kind("logger", 1e-3, 20.0, ("none",), frozenset({"periodic"})),
    "drift within a run": Kind("logger", 1e-3, 20.0, ("none",), frozenset({"added_response", "offset", "gain"})),
    "exponential mean": Kind("logger", 5e-2, 20.0, ("none",), _LAG),
    "slew limit": Kind("logger", 1e-2, 50.0, ("none",), _LAG | {"rate_change"}),
    "late by chance": Kind("logger", 1e-2, 5.0, ("none",), frozenset({"delay", "dead_time"}), ("chance",)),
    "jumps": Kind("logger", 1e-2, 20.0, ("none",), frozenset({"bursts", "offset", "periodic"})),
}


def _words(act: Act) -> str:
    times = "" if act.kernel == "none" else f", {act.kernel} ({act.time_s:.3g} s, {act.other_s:.3g} s)"
    if act.kind == "hum":
        times = f", {1.0 / act.time_s:.3g} Hz"
    by = "".join(f", by {name} ({number:.3g})" for name, number in act.depends)
    return f"{act.link}: {act.kind} {act.size:.3g}{times}{by}"


def draw(seed: int) -> World:
    """The world of a seed. Kinds of effects take turns with the seeds; all else is drawn."""
    from shockrig.rig.virtual.plans import standard_plan
    from shockrig.rig.virtual.truth import draw_truth

    rng, names = np.random.default_rng([26, seed]), list(KINDS)
    first = names[seed % len(names)]
    while True:
        channel = str(rng.choice(KINDS[first].channels))
        truth = draw_truth(rng, "rough")
        noise = truth.temperature_noise if channel == T else truth.humidity_noise
        spread = float(np.hypot(noise.white, noise.correlated))
        others = [name for name, kind in KINDS.items() if channel in kind.channels]
        chosen = [first, str(rng.choice(others))] if rng.random() < SECOND else [first]
        acts = tuple(_draw_act(rng, name) for name in chosen)
        wanted = float(np.exp(rng.uniform(*np.log(TIMES_NOISE))))
        shuffled = bool(rng.random() > STANDARD_ORDER)
        world = World(seed, channel, truth, acts, spread, shuffled=shuffled)
        plan = _planned(standard_plan(), world, np.random.default_rng([seed, 1]), fresh=False)
        runs = runs_of(plan, np.random.default_rng([seed, 2]))
        sized = _sized(world, runs, wanted)
        if sized is not None:
            return sized


def _draw_act(rng: np.random.Generator, name: str) -> Act:
    kind = KINDS[name]
    kernel = str(rng.choice(kind.kernels))
    time_s, other_s = (float(x) for x in np.exp(rng.uniform(np.log(1.5), np.log(40.0), 2)))
    if name == "hum":
        time_s = float(np.exp(rng.uniform(np.log(0.25), np.log(15.0))))
    if kernel == "delayed":
        other_s = float(rng.uniform(2.0, 15.0))
    depends: list[str] = []
    if kind.needs:
        depends = [str(rng.choice(kind.needs))]
    elif rng.random() < 0.5 and name not in ("hum", "jumps", "slew limit", "play"):
        depends = [str(rng.choice(list(DEPENDS)))]
    drawn = tuple((one, DEPENDS[one][0](rng)) for one in depends)
    return Act(kind.link, name, kernel, time_s, other_s, float(rng.choice((-1.0, 1.0))), drawn)


def _sized(world: World, runs: Runs, wanted: float) -> World | None:
    """The world with its acts as large as wanted, in multiples of the noise; None where they cannot be."""
    lasts = np.full(runs.order.size, 70.0)
    plain = dataclasses.replace(world, acts=())
    base, columns = responded(plain, runs, lasts), []
    for group in np.unique(runs.there_c) if world.channel == RH else [None]:
        faster = np.where(runs.there_c == group, 1.0 + FREE, 1.0) if group is not None else 1.0 + FREE
        columns.append((responded(plain, runs, lasts, faster)[1] - base[1]).ravel())
    at = np.stack(columns, axis=1)

    def rms(share: float) -> tuple[float, World]:
        acts = tuple(dataclasses.replace(act, size=_size(act, share)) for act in world.acts)
        trial = dataclasses.replace(world, acts=acts)
        time_s, changed = responded(trial, runs, lasts)
        even = np.arange(0.05, lasts[0], PERIOD_S)
        change = (changed - base[1]).reshape(runs.order.size, -1)
        there = np.stack([np.interp(even, time_s, row) for row in change])
        free = np.stack([[np.interp(even, time_s, r) for r in c.reshape(change.shape)] for c in at.T]).reshape(
            at.shape[1], -1
        )
        flat = there.ravel()
        left = flat - free.T @ np.linalg.lstsq(free.T, flat, rcond=None)[0]
        return float(np.sqrt((left**2).mean())) / world.noise, trial

    low, high = 0.0, 1.0
    if rms(high)[0] < wanted or rms(low)[0] > wanted:
        return None
    for _ in range(SEARCHED):
        middle = 0.5 * (low + high)
        reached, trial = rms(middle)
        if abs(np.log(max(reached, 1e-9) / wanted)) < 0.02:
            return dataclasses.replace(trial, times_noise=reached)
        low, high = (middle, high) if reached < wanted else (low, middle)
    return None


def _size(act: Act, share: float) -> float:
    """Size at a share (0 to 1) of its kind's range, evenly in ratio; the larger a slew limit the less it does."""
    kind = KINDS[act.kind]
    if act.kind == "slew limit":
        share = 1.0 - share
    size = kind.low * (kind.high / kind.low) ** share
    signed = act.kind in ("echo of the old air", "air of a room", "rate", "rate that moves with the reading", "gain")
    signed |= act.kind.startswith("added") or act.kind in ("offset", "bent calibration", "drift within a run")
    return float(np.sign(act.size) * size) if signed else float(size)


def runs_of(plan: Sequence[Shock], rng: np.random.Generator) -> Runs:
    """The conditions of a plan, with each run's own draws."""
    airs = np.array([[(a.temperature_c, a.humidity_percent) for a in (run.source, run.destination)] for run in plan])
    return Runs(
        *(airs[:, i, j].astype(float) for i in (0, 1) for j in (0, 1)),
        np.array([run.airflow_m_s for run in plan], dtype=float),
        np.array([run.pressure_hpa for run in plan], dtype=float),
        np.arange(len(plan), dtype=float),
        rng.standard_normal(len(plan)),
        rng.uniform(0.0, 2.0 * np.pi, len(plan)),
    )


def responded(world: World, runs: Runs, lasts_s: Array, faster: Array | float = 1.0) -> tuple[Array, Array]:
    """Instants since the transfer (n,) and what the converter would read without noise (R, n)."""
    return _Chain(world, runs, lasts_s, faster).read()


@dataclass
class _Chain:
    """One campaign of a world on its way from the air to the reading."""

    world: World
    runs: Runs
    lasts_s: Array
    faster: Array | float = 1.0
    time_s: Array = field(init=False)

    def __post_init__(self) -> None:
        fastest_s = float((1.0 / (self._rates() / self.faster * np.pi**2)).min())
        steps, at = [0.0], 0.0
        while at < self.lasts_s.max():
            at += min(max(fastest_s / FINE, GROWTH * at), PERIOD_S)
            steps.append(at)
        self.time_s = np.array(steps)

    def _rates(self) -> Array:
        """Diffusivity over the body's square length in each run [1/s]."""
        truth, runs = self.world.truth, self.runs
        if self.world.channel == T:
            return np.full(runs.order.size, truth.thermal_diffusivity_m2_s / truth.bead_radius_m**2) * self.faster
        return truth.diffusivity_m2_s(runs.there_c) / truth.film_thickness_m**2 * self.faster

    def _by(self, act: Act) -> Array:
        """What the act's size comes to in each run (R, 1)."""
        scale = np.full(self.runs.order.size, act.size)
        for name, number in act.depends:
            scale = scale * DEPENDS[name][1](number, self.runs, self.world.channel)
        return scale[:, None]

    def _kernel(self, act: Act) -> Array:
        return KERNELS[act.kernel](self.time_s, act.time_s, act.other_s)

    def _of(self, link: str) -> list[Act]:
        return [act for act in self.world.acts if act.link == link]

    def _ends(self) -> tuple[Array, Array, Array]:
        """Source, destination (R, 1), and a room's air, in what the body takes up: degC or ppmv."""
        from shockrig.rig.virtual.physics.moist import concentration_ppmv

        r = self.runs
        if self.world.channel == T:
            return r.source_c[:, None], r.there_c[:, None], np.full((r.order.size, 1), 22.0)
        ends = (concentration_ppmv(p, c, r.pressure_hpa) for p, c in _pairs(r))
        source, there = (np.asarray(end)[:, None] for end in ends)
        return source, there, np.asarray(concentration_ppmv(45.0, 22.0, r.pressure_hpa))[:, None]

    def read(self) -> tuple[Array, Array]:
        source, there, room = self._ends()
        air = np.broadcast_to(there, (self.runs.order.size, self.time_s.size)).copy()
        for act in self._of("air"):
            from_ = source if act.kind.startswith("echo") else room
            air += self._by(act) * (from_ - there) * self._kernel(act)
        for act in self._of("exchange"):
            air = self._exchanged(act, air, source)
        body = self._body(air, source)
        for act in self._of("body"):
            if act.kind == "a share follows late":
                share = np.clip(self._by(act), -0.9, 0.9)
                body = body + share * (self._late(act, body, source) - body)
        reading = self._as_read(body)
        for act in self._of("readout"):
            reading = self._read_out(act, reading)
        for act in self._of("logger"):
            reading = self._logged(act, reading)
        return self.time_s, reading

    def _exchanged(self, act: Act, air: Array, source: Array) -> Array:
        size = self._by(act)
        if act.kind == "lag before the body":
            return _lagged(self.time_s, air, source, np.maximum(size, 1e-3))
        if act.kind == "delay before the body":
            late = [
                np.where(self.time_s < d, s, np.interp(self.time_s - d, self.time_s, a))
                for a, s, d in zip(air, source[:, 0], np.maximum(size[:, 0], 0.0), strict=True)
            ]
            return np.array(late)
        share = np.clip(size, -0.9, 0.9)
        return air + share * (self._late(act, air, source) - air)

    def _late(self, act: Act, signal: Array, source: Array) -> Array:
        """A signal behind a kernel; by the square root of time as a row of lags."""
        n = signal.shape[0]
        taus = {"exponential": [act.time_s], "two exponentials": [act.time_s, act.other_s]}.get(
            act.kernel, list(act.time_s * np.geomspace(0.05, 20.0, 7))
        )
        return np.mean([_lagged(self.time_s, signal, source, np.full((n, 1), tau)) for tau in taus], axis=0)

    def _body(self, air: Array, source: Array) -> Array:
        """The body behind its modes; a rate that moves within a run is a clock that goes at another speed."""
        rates = self._rates()
        clock: Array | None = None
        for act in self._of("body"):
            size = self._by(act)
            if act.kind == "rate":
                rates = rates * np.exp(np.clip(size[:, 0], -2.0, 2.0))
            elif act.kind == "rate that drifts within a run":
                clock = 1.0 + size * self.time_s / 60.0
            elif act.kind == "rate that moves with the reading":
                plain = _through(self.time_s, air, source, rates, self.world.channel)
                progress = (plain - source) / np.where(np.abs(air[:, -1:] - source) > 1e-9, air[:, -1:] - source, 1.0)
                up = np.sign(self.runs.step(self.world.channel))[:, None]
                clock = np.maximum(1.0 + size * up * (progress - 0.5), 0.1)
        return _through(self.time_s, air, source, rates, self.world.channel, clock)

    def _as_read(self, body: Array) -> Array:
        from shockrig.rig.virtual.physics.moist import humidity_percent

        if self.world.channel == T:
            return body
        return np.asarray(humidity_percent(body, self.runs.there_c[:, None], self.runs.pressure_hpa[:, None]))

    def _read_out(self, act: Act, reading: Array) -> Array:
        r, size, t = self.runs, self._by(act), self.time_s
        own = r.step(self.world.channel)[:, None]
        if act.kind == "added after the transfer":
            return reading + size * self._kernel(act)
        if act.kind == "added with the other quantity":
            return reading + size * r.step(RH if self.world.channel == T else T)[:, None] * self._kernel(act)
        if act.kind == "added with a rate of change":
            tau = self.world.truth.die_time_constant_s
            return reading + size * (r.there_c - r.source_c)[:, None] / tau * np.exp(-t / tau)
        if act.kind == "gain":
            return reading * (1.0 + size)
        if act.kind == "offset":
            return reading + size
        if act.kind == "bent calibration":
            middle, scale = (20.0, 20.0) if self.world.channel == T else (50.0, 30.0)
            return reading + size * (((reading - middle) / scale) ** 2 - 0.5) * 2.0
        if act.kind == "memory of the run before":
            before = r.there_c if self.world.channel == T else r.there_percent
            return reading + size * (np.concatenate([before[:1], before[:-1]])[:, None] - reading[:, -1:])
        # Play: what is shown follows only once the reading has gone so far.
        return reading - np.clip(own, -1.0, 1.0) * np.minimum(np.abs(size), np.abs(reading - reading[:, :1]))

    def _logged(self, act: Act, reading: Array) -> Array:
        size, t = self._by(act), self.time_s
        if act.kind == "hum":
            return reading + size * np.sin(2.0 * np.pi * t / act.time_s + self.runs.phase[:, None])
        if act.kind == "drift within a run":
            return reading + size * np.sqrt(t / 60.0)
        if act.kind == "exponential mean":
            return _lagged(t, reading, reading[:, :1], np.maximum(size, 1e-3))
        if act.kind == "slew limit":
            out = reading.copy()
            for k in range(1, t.size):
                most = np.abs(size[:, 0]) * (t[k] - t[k - 1])
                out[:, k] = out[:, k - 1] + np.clip(reading[:, k] - out[:, k - 1], -most, most)
            return out
        if act.kind == "late by chance":
            late = [np.interp(t - d, t, y) for y, d in zip(reading, np.abs(size[:, 0]), strict=True)]
            return np.array(late)
        jumps = np.floor(2.0 * t / act.time_s + self.runs.phase[:, None]) % 2.0
        return reading + size * (jumps - 0.5)


def _pairs(r: Runs) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    return (r.source_percent, r.source_c), (r.there_percent, r.there_c)


def modes(channel: str) -> tuple[Array, Array]:
    """Weights and rates (times a body's own) of a sphere's core or a film's mean; the fastest ones lumped."""
    n = np.arange(1, MODES + 1)
    if channel == T:
        weights, rates = -2.0 * (-1.0) ** n, (n * np.pi) ** 2
    else:
        weights, rates = 2.0 / ((n - 0.5) * np.pi) ** 2, ((n - 0.5) * np.pi) ** 2
    weights[-1] += 1.0 - weights.sum()
    return weights, rates


def _through(time_s: Array, air: Array, source: Array, rates: Array, channel: str, clock: Array | None = None) -> Array:
    """A body that an air drives (R, n); `clock` is the speed of its own time."""
    weights, of = modes(channel)
    state = np.repeat(source, of.size, axis=1)
    out = np.empty_like(air)
    out[:, 0] = source[:, 0]
    r = rates[:, None] * of
    for k in range(1, time_s.size):
        step = np.broadcast_to(time_s[k] - time_s[k - 1], r.shape[:1])[:, None]
        if clock is not None:
            step = step * 0.5 * (clock[:, k - 1 : k] + clock[:, k : k + 1])
        state = _stepped(state, air[:, k - 1 : k], air[:, k : k + 1], r * step)
        out[:, k] = state @ weights
    return out


def _stepped(state: Array, before: Array, after: Array, x: Array) -> Array:
    """A first-order lag one step on, x of its time constants, under an input that is linear meanwhile."""
    decay = np.exp(-x)
    slope = (after - before) / np.maximum(x, 1e-12)
    return np.asarray(after - slope * (1.0 - decay) + (state - before) * decay)


def _lagged(time_s: Array, signal: Array, source: Array, tau_s: Array) -> Array:
    """A signal (R, n) behind a lag (R, 1)."""
    out = np.empty_like(signal)
    out[:, :1] = state = source
    for k in range(1, time_s.size):
        state = _stepped(state, signal[:, k - 1 : k], signal[:, k : k + 1], (time_s[k] - time_s[k - 1]) / tau_s)
        out[:, k : k + 1] = state
    return out


def _planned(plan: Sequence[Shock], world: World, rng: np.random.Generator, fresh: bool) -> list[Shock]:
    """A plan in its order; a fresh campaign has other airs, airflows and another order, at the same ambients."""
    runs = list(plan)
    if fresh:
        runs = [_elsewhere(run, rng) for run in runs]
    if fresh or world.shuffled:
        runs = [runs[i] for i in rng.permutation(len(runs))]
    return [dataclasses.replace(run, id=f"{i:04d}") for i, run in enumerate(runs, 1)]


def _elsewhere(run: Shock, rng: np.random.Generator) -> Shock:
    """A run with another source and another level, in another airflow."""

    def moved(air: Any, kelvin: float) -> Any:
        percent = float(np.clip(air.humidity_percent + rng.uniform(-4.0, 4.0), 8.0, 85.0))
        return dataclasses.replace(air, temperature_c=air.temperature_c + kelvin, humidity_percent=percent)

    thermal = run.source.temperature_c != run.destination.temperature_c
    away = float(rng.uniform(0.0, 2.0)) * np.sign(run.source.temperature_c - run.destination.temperature_c)
    flow = run.airflow_m_s * float(np.exp(rng.uniform(-0.2, 0.2)))
    return dataclasses.replace(
        run,
        source=moved(run.source, away if thermal else 0.0),
        destination=moved(run.destination, 0.0),
        airflow_m_s=flow,
    )


def record(world: World, out: Path, fresh: bool = False) -> Path:
    """Write a campaign of a world, or a fresh one of the same world: other order, conditions and noise."""
    from shockrig.files.campaign_write import campaign_document, run_document, table_text, write_campaign, write_run
    from shockrig.rig.virtual.logger_link import Logger
    from shockrig.rig.virtual.plans import standard_plan

    place = FRESH if fresh else 0
    # The campaign's own conditions are those by which the effect's size was found.
    plan = _planned(standard_plan(), world, np.random.default_rng([world.seed + place, 1]), fresh)
    runs = runs_of(plan, np.random.default_rng([world.seed + place, 2]))
    rng = np.random.default_rng([world.seed + place, 3])
    truth, channel = world.truth, world.channel
    start_s = 10.0 + rng.random(len(plan))
    lasts = np.array([run.duration_s for run in plan]) - start_s
    factors = np.exp(truth.rate_scatter * rng.standard_normal(len(plan)))
    moved = _scattered(runs, truth, rng)
    since_s, reading = responded(world, moved, lasts, factors)
    (out / "runs").mkdir(parents=True)
    sensor = {"kind": "imet-xf", "serial": "virtual", "bead_radius_m": truth.bead_radius_m}
    if channel == RH:
        sensor = {"kind": "hyt-271", "serial": "virtual", "film_thickness_m": truth.film_thickness_m}
    name = "imet" if channel == T else "hyt"
    write_campaign(out, campaign_document("unforeseen", {name: sensor}, emulated=True))
    hum = [act for act in world.acts if act.kind in ("hum", "jumps")]
    quiet = dataclasses.replace(world, acts=tuple(act for act in world.acts if act not in hum))
    if hum:  # what goes on all along is added at the readings' own instants
        reading = responded(quiet, moved, lasts, factors)[1]
    for i, run in enumerate(plan):
        own = np.random.default_rng([world.seed + place, 4, i])
        time_s = np.round(np.arange(own.uniform(0.0, PERIOD_S), run.duration_s, PERIOD_S), 4)
        since = time_s - start_s[i]
        before = _before(quiet, moved, i)
        exact = np.where(since < 0.0, before, np.interp(since, since_s, reading[i]))
        for act in hum:
            turn = 2.0 * np.pi * time_s / act.time_s + runs.phase[i]
            exact = exact + act.size * (np.sin(turn) if act.kind == "hum" else np.floor(turn / np.pi) % 2.0 - 0.5)
        logged = Logger(truth, channel, own).log(time_s, exact)
        kept = own.random(time_s.size) >= truth.missing_fraction
        if channel == T:
            table = table_text({"time_s": time_s[kept].tolist(), "temperature_c": logged[kept].tolist()})
        else:
            cooled = np.exp(-np.maximum(since, 0.0) / truth.die_time_constant_s)
            die = moved.there_c[i] + (moved.source_c[i] - moved.there_c[i]) * cooled
            die = np.round((die + truth.die_noise_k * own.standard_normal(time_s.size)) / 0.01) * 0.01
            columns = {"time_s": time_s, "humidity_percent": logged, "temperature_c": die}
            table = table_text({k: v[kept].tolist() for k, v in columns.items()}, {"temperature_c": "%.3f"})
        airs = [
            {
                "temperature_c": round(float(c + truth.reference_scatter_k * own.standard_normal()), 4),
                "humidity_percent": round(float(p + truth.reference_scatter_percent * own.standard_normal()), 4),
            }
            for p, c in ((p[i], c[i]) for p, c in _pairs(moved))
        ]
        document = run_document(
            run.id,
            started_at=f"2026-05-{1 + i // 24:02d}T{i % 24:02d}:00:00Z",
            source=airs[0],
            destination=airs[1],
            airflow_m_s=run.airflow_m_s,
            pressure_hpa=run.pressure_hpa,
            start_s=round(float(start_s[i] + truth.trigger_jitter_s * own.standard_normal()), 4),
        )
        (out / "runs" / run.id).mkdir()
        write_run(out / "runs" / run.id, document, {name: table})
    return out


def _scattered(runs: Runs, truth: Truth, rng: np.random.Generator) -> Runs:
    """The airs as chambers reach them."""
    n = runs.order.size
    return dataclasses.replace(
        runs,
        source_c=runs.source_c + truth.chamber_scatter_k * rng.standard_normal(n),
        there_c=runs.there_c + truth.chamber_scatter_k * rng.standard_normal(n),
        source_percent=runs.source_percent + truth.chamber_scatter_percent * rng.standard_normal(n),
        there_percent=runs.there_percent + truth.chamber_scatter_percent * rng.standard_normal(n),
    )


def _before(world: World, runs: Runs, i: int) -> float:
    """What a run shows before its transfer: the source through what the readout does all along."""
    shown = float(runs.source_c[i] if world.channel == T else runs.source_percent[i])
    always = [act for act in world.acts if act.kind in ("gain", "offset", "bent calibration")]
    one = dataclasses.replace(world, acts=tuple(always))
    chain = _Chain(one, runs, np.full(runs.order.size, 0.2))
    for act in always:
        shown = float(chain._read_out(act, np.full((runs.order.size, 1), shown))[i, 0])
    return shown
