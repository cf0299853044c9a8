"""The classes of benches that `foreign_benches.py` tries, each drawn from its seed alone, and what may rightly be
named of them.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import numpy as np
from foreign_lab import KINDS, Arrival, Lab, LabLogger, LabReference, LabRun, Written, make_body

DEFAULT_BODY = {"temperature": "sphere", "humidity": "film"}
NORMAL_STEP = {"temperature": 0.01, "humidity": 100.0 / 16383.0}  # roundings that nobody calls coarse
FRESH_RUNS = 4
BARE = Written(start=False, airs=False, airflow=False)

CLASSES = (
    *("everything", "no_trigger", "no_airs", "no_airflow", "nothing"),
    *("runs_1", "runs_2", "runs_3", "runs_6"),
    *("hz_1", "hz_100", "lags"),
    *("bodies_right", "bodies_wrong", "sheath", "slow_share"),
    *("chamber_air", "chamber_60", "steps_60"),
    *("two_places", "two_media"),
)
PAIRED = {"steps_60": "chamber_60"}  # the same sensors, loggers and seeds, with ideal steps of known airs


@dataclass(frozen=True)
class World:
    """A drawn bench, the same bench with fresh runs, and what may be named of it.

    `allowed` are texts of which a rightly named cause contains one; `deviates` says that the sensor is not the plain
    model of what its campaign declares, so that an effect may rightly be discovered.
    """

    name: str
    seed: int
    bench: Lab
    fresh: Lab
    allowed: tuple[str, ...]
    deviates: bool
    words: str

    def is_false(self, cause: dict) -> bool:
        """Whether a cause was not in this world, nor anything that it is said to be indistinguishable from."""
        effect = cause["effect"]
        if effect == "quantization":
            step = cause["parameters"]["step"]["value"]
            return abs(step - self.bench.logger.rounding) > 0.1 * self.bench.logger.rounding
        told = (effect, *cause.get("indistinguishable_from", ()))
        return not any(text in name for name in told for text in self.allowed)


def draw(name: str, seed: int) -> World:
    """The world of a class and a seed; thermometers have even seeds, hygrometers odd ones."""
    if name in PAIRED:
        slow = draw(PAIRED[name], seed)
        written = replace(slow.bench.written, start=True, airs=True, airflow=True)
        bench, fresh = (
            replace(b, name=name, approach=Arrival(), reference=None, written=written) for b in (slow.bench, slow.fresh)
        )
        return replace(slow, name=name, bench=bench, fresh=fresh, words=slow.words.split(", air ")[0] + ", steps")
    rng = np.random.default_rng([zlib.crc32(name.encode()), seed])
    channel = "temperature" if seed % 2 == 0 or name == "two_media" else "humidity"
    default = DEFAULT_BODY[channel]
    plain = (seed // 2) % 2 == 0
    kind = default if plain else str(rng.choice(KINDS))
    declared: str | None = None if plain else kind
    t63 = _log_uniform(rng, 0.5, 60.0)
    period = float(np.clip(t63 / rng.uniform(8.0, 60.0), 0.01, 1.0))
    runs, known, sheath, slow, pace = 6, Written(), None, None, 1.0
    approach, allowed, reference = Arrival(), (), None
    if name in ("no_trigger", "no_airs", "no_airflow"):
        known = replace(known, **{{"no_trigger": "start", "no_airs": "airs", "no_airflow": "airflow"}[name]: False})
    elif name == "nothing":
        known = BARE
    elif name.startswith("runs_"):
        runs = int(name[5:])
        start, airs, airflow = (bool(x) for x in rng.random(3) < 0.5)
        known = Written(start=start, airs=airs, airflow=airflow)
    elif name == "hz_1":
        period, t63 = 1.0, _log_uniform(rng, 2.0, 300.0)
    elif name == "hz_100":
        period, t63 = 0.01, _log_uniform(rng, 0.05, 5.0)
    elif name == "lags":
        t63 = _log_uniform(rng, 0.05, 500.0)
        period = float(np.clip(t63 / rng.uniform(5.0, 60.0), 0.01, 1.0))
    elif name in ("bodies_right", "bodies_wrong"):
        kind = KINDS[(seed // 2) % len(KINDS)]
        declared = kind
        if name == "bodies_wrong":
            declared = str(rng.choice([k for k in KINDS if k != kind]))
            allowed = ("body", kind, *_the_same_as(kind, declared))
    elif name == "sheath":
        kind = declared = ("lumped", default)[(seed // 2) % 2]
        sheath = (float(rng.uniform(0.2, 1.0)), float(rng.uniform(0.2, 1.5)))
        allowed = ("body", "sheath", "series", "housing")
    elif name == "slow_share":
        kind = declared = ("lumped", default)[(seed // 2) % 2]
        slow = (float(rng.uniform(0.08, 0.35)), _log_uniform(rng, 3.0, 12.0))
        allowed = ("stem_conduction", "slow_relaxation", "parallel", "share", "body")
    elif name in ("chamber_air", "chamber_60"):
        known, tau = BARE, 60.0 if name == "chamber_60" else _log_uniform(rng, 5.0, 120.0)
        how = "one" if name == "chamber_60" else str(rng.choice(["one", "ramp", "two"]))
        approach = Arrival(how, tau, tau * float(rng.uniform(3.0, 8.0)), float(rng.uniform(0.1, 0.4)))
        reference = _reference(rng, channel, min(t63, tau))
    elif name == "two_places":
        known, pace = BARE, float(rng.uniform(1.2, 2.5)) ** float(rng.choice([-1.0, 1.0]))
        allowed = ("direction_dependent",)
    elif name == "two_media":
        known, runs, pace = BARE, 8, _log_uniform(rng, 5.0, 50.0)
        allowed = ("other_medium",)
    body = make_body(kind, t63, sheath=sheath, slow=slow)
    late_s = max(approach.first_s, approach.second_s * (approach.kind == "two"))
    slowest = max(body.time_to_s(0.98) / min(pace, 1.0), 4.0 * late_s)
    if approach.kind != "step":
        period = max(period, slowest / 1500.0)  # nobody logs an hour's approach at the pace of a fast sensor
    logger = _logger(rng, channel, period, t63)
    plan = _plan(rng, channel, runs + FRESH_RUNS, slowest, logger.period_s)
    if name == "two_places":  # cooling, or drying, is in the other place
        plan = tuple(replace(t, pace=pace) if t.destination < t.source else t for t in plan)
        words_of_pace = f", {pace:.2f} times as fast down"
    elif name == "two_media":  # two of four transfers end in water, one up and one down
        plan = tuple(replace(t, pace=pace) if i % 4 in (0, 3) else t for i, t in enumerate(plan))
        words_of_pace = f", {pace:.1f} times as fast in water"
    else:
        words_of_pace = ""
    bench = Lab(channel, body, approach, logger, plan[:runs], replace(known, body=declared), reference, name=name)
    wrong = "" if declared in (None, kind) else f" called {declared}"
    extra = (" in a sheath" if sheath else "") + (" with a slow share" if slow else "")
    words = (
        f"{kind}{wrong}{extra} t63 {t63:.3g} s at {period:.3g} s, {runs} runs, rounding {logger.rounding:g}, noise "
        f"{np.hypot(logger.white, logger.correlated):.2g}, "
        f"{'+'.join(w for w, k in (('start', known.start), ('airs', known.airs), ('flow', known.airflow)) if k) or '-'}"
    )
    if approach.kind != "step":
        words += f", air {approach.kind} {approach.first_s:.3g} s"
    words += words_of_pace
    deviates = bool(allowed)
    return World(name, seed, bench, replace(bench, plan=plan[runs:]), allowed, deviates, words)


def _the_same_as(kind: str, declared: str) -> tuple[str, ...]:
    """Effects of the catalogue that turn the declared body into the true one: a lump is a body behind a thick film."""
    if kind != "lumped":
        return ()
    return {"sphere": ("convective_film",), "film": ("vapour_boundary_layer",)}.get(declared, ())


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _logger(rng: np.random.Generator, channel: str, period: float, t63: float) -> LabLogger:
    """Noise as other loggers have it, a fifth of them with a rounding coarser than usual."""
    unit = 1.0 if channel == "temperature" else 4.0
    white = unit * _log_uniform(rng, 0.005, 0.05)
    coarse = rng.random() < 0.2
    rounding = float(rng.choice([0.0625, 0.1] if coarse else [0.001, 0.01]))
    correlated = white * float(rng.uniform(0.0, 1.0)) * (rng.random() < 0.6)
    return LabLogger(period, rounding, white, correlated, period * float(rng.uniform(1.0, 10.0)), 0.02 * rng.random())


def _reference(rng: np.random.Generator, channel: str, shortest_s: float) -> LabReference:
    """An instrument beside the sensor: faster than it, with an uncertainty of its own, and stated."""
    unit = 1.0 if channel == "temperature" else 5.0
    lag = shortest_s * float(rng.choice([0.0, 0.02, 0.1, 0.3]))
    period = float(np.clip(shortest_s / rng.uniform(10.0, 40.0), 0.05, 2.0))
    noise = unit * _log_uniform(rng, 0.003, 0.02)
    return LabReference(lag, unit * float(rng.choice([0.01, 0.02, 0.05])), LabLogger(period, 0.001, noise))


def _plan(rng: np.random.Generator, channel: str, runs: int, slowest_s: float, period_s: float) -> tuple[LabRun, ...]:
    """There and back, steps of some sizes, the transfer anywhere in the record."""
    low, high = (0.0, 45.0) if channel == "temperature" else (10.0, 85.0)
    least, most = (5.0, 30.0) if channel == "temperature" else (15.0, 60.0)
    size = float(rng.uniform(least, most))
    middle = float(rng.uniform(low + 0.5 * size, high - 0.5 * size))
    plan = []
    up = bool(rng.random() < 0.5)
    for _ in range(runs):
        half = 0.5 * size * float(rng.choice([1.0, 1.0, 0.6]))
        ends = (middle - half, middle + half) if up else (middle + half, middle - half)
        tail = slowest_s * float(rng.uniform(1.3, 3.0)) + 10.0 * period_s
        start = float(rng.uniform(0.05, 2.0)) * tail * 0.5 + 8.0 * period_s
        plan.append(LabRun(*ends, start_s=start, length_s=start + tail))
        up = not up
    return tuple(plan)
