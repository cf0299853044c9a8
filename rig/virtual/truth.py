"""What is true of one virtual pair of sensors and its bench: material, noise, scatter and hidden effects; JSON, and
random draws.

Diffusivity of vapour in the film: ln D(T) = ln D(20 degC) - E u - Q u^2, u = 1/T - 1/293.15 K (E activation, Q
curvature).
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from shockrig.files.campaign_names import FIRST_PROBE
from shockrig.rig.bench_errors import BenchError
from shockrig.rig.virtual.effects import AIR, KINDS

SMOOTH, ROUGH, REALISTIC = "smooth", "rough", "realistic"
TIERS = (SMOOTH, ROUGH, REALISTIC)
TYPE_SPREAD = 0.02  # of ln alpha and ln D from sensor to sensor of a virtual type, where nothing else is asked for
TILT = 1.0 / 3.0  # of that, by which ln D at 0 degC differs besides
REAL_BIOT = (0.09, 0.18)  # of a bead of 0.8 mm at 5 m/s
CORE_T98 = 0.46660  # alpha t98 / R^2 of a sphere's core after a step
FILM_T63 = 0.32025  # D t63 / L^2 of a film's mean after a step
HUMIDITY_STEP_PERCENT = 100.0 / 16383.0


@dataclass(frozen=True)
class TrueNoise:
    """Standard deviations of the white part and of the first-order autocorrelated part, in the channel's unit, and the
    latter's time constant.
    """

    white: float
    correlated: float = 0.0
    correlation_time_s: float = 1.0


@dataclass(frozen=True)
class Hidden:
    """One effect at work: its id, its parameters, the channels in which it acts, and the probe that has it; every probe
    of the bench where none is named."""

    effect: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    channels: tuple[str, ...] = ()
    probe: str = ""

    def __post_init__(self) -> None:
        kind = KINDS.get(self.effect)
        if kind is None:
            raise BenchError(
                f"effect {self.effect!r} is not known to the virtual world: known are {', '.join(sorted(KINDS))}"
            )
        if set(self.parameters) != set(kind.parameters):
            raise BenchError(
                f"effect {self.effect}: parameters must be {sorted(kind.parameters)}, not {sorted(self.parameters)}"
            )
        if not self.channels:
            object.__setattr__(self, "channels", kind.channels)
        if not set(self.channels) <= set(kind.channels):
            raise BenchError(f"effect {self.effect}: channels must be among {kind.channels}, not {self.channels}")
        if self.probe and kind.link == AIR:
            raise BenchError(f"effect {self.effect} is of the air that all probes feel; hide it without @{self.probe}")


@dataclass(frozen=True)
class Truth:
    """One virtual pair of sensors. The defaults are a good bench: exact trigger, exact references, white noise,
    nothing hidden. Further probes on the same bench are drawn from `probe_seed`; where `type_spread` is not 0 all are
    of one type, whose rates have that standard deviation of the logarithm.
    """

    thermal_diffusivity_m2_s: float
    diffusivity_20c_m2_s: float
    activation_k: float = 2500.0
    curvature_k2: float = 0.0
    bead_radius_m: float = 4e-4
    film_thickness_m: float = 1e-5
    die_time_constant_s: float = 10.0
    die_noise_k: float = 0.02
    temperature_noise: TrueNoise = TrueNoise(0.015)
    humidity_noise: TrueNoise = TrueNoise(0.07)
    effects: tuple[Hidden, ...] = ()
    trigger_jitter_s: float = 0.0
    reference_scatter_k: float = 0.0
    reference_scatter_percent: float = 0.0
    chamber_scatter_k: float = 0.02
    chamber_scatter_percent: float = 0.1
    rate_scatter: float = 0.0
    missing_fraction: float = 0.0
    temperature_step_k: float = 0.01
    humidity_step_percent: float = HUMIDITY_STEP_PERCENT
    probe_seed: int = 0
    type_spread: float = 0.0

    def diffusivity_m2_s(self, temperature_c: float | np.ndarray) -> np.ndarray:
        """D of the film at `temperature_c` (any shape), m2/s."""
        u = 1.0 / (np.asarray(temperature_c) + 273.15) - 1.0 / 293.15
        return self.diffusivity_20c_m2_s * np.exp(-self.activation_k * u - self.curvature_k2 * u * u)

    def effect(self, name: str, channel: str | None = None) -> Mapping[str, float] | None:
        """Parameters of the hidden effect `name` (acting in `channel`) of all probes, or None where it is not at
        work."""
        for hidden in self.effects:
            if hidden.effect == name and not hidden.probe and (channel is None or channel in hidden.channels):
                return hidden.parameters
        return None

    def to_json(self) -> str:
        """This truth as JSON, with D at whole tens of degrees for people."""
        content = dataclasses.asdict(self)
        content["diffusivity_m2_s"] = {str(t): float(self.diffusivity_m2_s(t)) for t in range(-10, 61, 10)}
        return json.dumps(content, indent=1, allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> Truth:
        """Read what `to_json` wrote; raises BenchError on anything else."""
        try:
            content = json.loads(text)
            content.pop("diffusivity_m2_s", None)
            content["temperature_noise"] = TrueNoise(**content["temperature_noise"])
            content["humidity_noise"] = TrueNoise(**content["humidity_noise"])
            content["effects"] = tuple(
                Hidden(h["effect"], dict(h["parameters"]), tuple(h["channels"]), str(h.get("probe", "")))
                for h in content["effects"]
            )
            noises = content["temperature_noise"], content["humidity_noise"]
            tables = [vars(noise) for noise in noises] + [hidden.parameters for hidden in content["effects"]]
            tables.append({k: v for k, v in content.items() if not isinstance(v, TrueNoise) and k != "effects"})
            for name, value in (item for table in tables for item in table.items()):
                if isinstance(value, bool) or not abs(value) <= sys.float_info.max:
                    raise ValueError(f"{name} is {value!r}, not a number")
            if content.get("type_spread", 0.0) < 0.0:
                raise ValueError(f"type_spread is {content['type_spread']!r}, not a number from 0")
            seed = content.get("probe_seed", 0)
            if not isinstance(seed, int) or seed < 0:
                raise ValueError(f"probe_seed is {seed!r}, not a whole number from 0")
            return cls(**content)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError) as error:
            raise BenchError(f"not a truth of the virtual bench: {error}") from error


def draw_truth(rng: np.random.Generator, tier: str = SMOOTH, effects: Sequence[Hidden] = ()) -> Truth:
    """Random sensors on a random bench.

    `tier` "smooth": white noise, exact trigger and references. "rough": half of the noise's variance correlated over
    0.3 to 3 s, 10 ms of trigger jitter, references good to 0.02 K and 0.1 %RH, missing samples, rates that scatter by
    0.3 to 1 % from run to run. "realistic": rough, and the sensors are as real ones: the film is read at the die's own
    temperature, and the bead stands behind an air film. These two count as hidden.
    Bead: t98 of 0.5 to 2.5 s; film: t63 of 0.5 to 6 s at 20 degC, two to five times slower at 0 than at 40 degC.
    """
    if tier not in TIERS:
        raise BenchError(f"tier must be one of {', '.join(TIERS)}, not {tier!r}")
    bench_is_rough = tier != SMOOTH
    t98_s = np.exp(rng.uniform(np.log(0.5), np.log(2.5)))
    t63_s = np.exp(rng.uniform(np.log(0.5), np.log(6.0)))
    ratio_0_to_40 = rng.uniform(2.0, 5.0)
    curvature = rng.uniform(-1.0, 1.0) * 8e5  # bends ln D by up to 5 % at 0 and 40 degC
    u0, u40 = 1 / 273.15 - 1 / 293.15, 1 / 313.15 - 1 / 293.15
    activation = (np.log(ratio_0_to_40) + curvature * (u40**2 - u0**2)) / (u0 - u40)
    noise_k, noise_percent = rng.uniform(0.010, 0.025), rng.uniform(0.05, 0.10)
    share = 0.5 if bench_is_rough else 0.0
    correlation_s = np.exp(rng.uniform(np.log(0.3), np.log(3.0), 2))
    rough: dict[str, Any] = (
        {
            "trigger_jitter_s": 0.010,
            "reference_scatter_k": 0.02,
            "reference_scatter_percent": 0.1,
            "rate_scatter": float(rng.uniform(0.003, 0.010)),
            "missing_fraction": float(rng.uniform(0.002, 0.02)),
        }
        if bench_is_rough
        else {}
    )
    truth = Truth(
        thermal_diffusivity_m2_s=float(CORE_T98 * 4e-4**2 / t98_s),
        diffusivity_20c_m2_s=float(FILM_T63 * 1e-5**2 / t63_s),
        activation_k=float(activation),
        curvature_k2=float(curvature),
        die_time_constant_s=float(rng.uniform(8.0, 14.0)),
        temperature_noise=TrueNoise(noise_k * (1 - share) ** 0.5, noise_k * share**0.5, float(correlation_s[0])),
        humidity_noise=TrueNoise(
            noise_percent * (1 - share) ** 0.5, noise_percent * share**0.5, float(correlation_s[1])
        ),
        probe_seed=int(rng.bit_generator.seed_seq.generate_state(1)[0]),  # the seed's own: takes nothing from the draws
        **rough,
    )
    if tier == REALISTIC:
        truth = with_effects(truth, standing_effects(rng))
    return with_effects(truth, effects)


def standing_effects(rng: np.random.Generator) -> tuple[Hidden, ...]:
    """What every real pair of sensors shows, whatever else befalls it."""
    biot = float(np.exp(rng.uniform(*np.log(REAL_BIOT))))
    return Hidden("convective_film", {"biot_at_5_m_s": biot}), Hidden("die_thermal_lag")


def of_probe(truth: Truth, probe: str) -> Truth:
    """A probe of the bench, with the effects that it has by itself and with those of all. The first is as the truth
    says; another one is of the same kinds, each of its rates between two thirds and one and a half times the first
    one's; or, where the first one is of a type, of the same type.

    Drawn from the bench's seed and the probe's name alone: a digest of the truth's numbers would make another probe
    where `exp` differs by one last bit, as it does from processor to processor."""
    own = [dataclasses.replace(hidden, probe="") for hidden in truth.effects if hidden.probe == probe]
    of_all = dataclasses.replace(truth, effects=tuple(hidden for hidden in truth.effects if not hidden.probe))
    return with_effects(of_all if probe == FIRST_PROBE else _another(of_all, probe), own)


def _another(truth: Truth, probe: str) -> Truth:
    if truth.type_spread:
        return _moved(truth, _from_type(truth, probe) - _from_type(truth, FIRST_PROBE))
    rng = np.random.default_rng([truth.probe_seed, *probe.encode()])
    alpha, d = np.exp(rng.uniform(-np.log(1.5), np.log(1.5), 2))
    return dataclasses.replace(
        truth,
        thermal_diffusivity_m2_s=float(alpha * truth.thermal_diffusivity_m2_s),
        diffusivity_20c_m2_s=float(d * truth.diffusivity_20c_m2_s),
    )


def of_type(fleet_seed: int, seed: int, tier: str = SMOOTH, spread: float = TYPE_SPREAD) -> Truth:
    """A pair of sensors of the type that `fleet_seed` draws, which one by `seed`: ln alpha and ln D differ from those
    of the type by `spread`, and ln D at 0 degC by a third of that besides."""
    of_both = np.random.SeedSequence([fleet_seed, seed])
    usual = draw_truth(np.random.default_rng(fleet_seed), tier)
    first = dataclasses.replace(usual, probe_seed=int(of_both.generate_state(1)[0]), type_spread=spread)
    return _moved(first, _from_type(first, FIRST_PROBE))


EMULATED_SERIAL = r"[BF][0-9a-f]{6}-\w+"  # as `serial_number` makes them


def serial_number(truth: Truth, name: str) -> str:
    """Of a sensor ("imet", "hyt-2") of a bench of which this is true: it tells sensors apart and says nothing else."""
    sensor, _, probe = name.partition("-")
    digest = hashlib.sha256(str(truth.probe_seed).encode()).hexdigest()
    return f"{'B' if sensor == 'imet' else 'F'}{digest[:6]}-{probe or FIRST_PROBE}"


def _from_type(truth: Truth, probe: str) -> np.ndarray:
    """How far a probe's ln alpha, ln D and activation [K] are from its type's."""
    scale = np.array([1.0, 1.0, TILT / (1.0 / 273.15 - 1.0 / 293.15)])
    rng = np.random.default_rng([truth.probe_seed, *probe.encode()])
    return np.asarray(truth.type_spread * scale * rng.standard_normal(3))


def _moved(truth: Truth, by: np.ndarray) -> Truth:
    return dataclasses.replace(
        truth,
        thermal_diffusivity_m2_s=float(np.exp(by[0]) * truth.thermal_diffusivity_m2_s),
        diffusivity_20c_m2_s=float(np.exp(by[1]) * truth.diffusivity_20c_m2_s),
        activation_k=float(truth.activation_k + by[2]),
    )


def with_effects(truth: Truth, effects: Sequence[Hidden]) -> Truth:
    """The same sensors with `effects` hidden in them, beside those that they have and that are not given anew; one of a
    single probe changes nothing before that probe is made (`of_probe`).

    Behind an air film (`convective_film`) alpha is raised so that the reading is about as fast as before, up to 2.5
    times slower: the lag of a glass bead is the film's, its own diffusion is much faster.
    """
    given = {(hidden.effect, hidden.probe) for hidden in effects}
    kept = [hidden for hidden in truth.effects if (hidden.effect, hidden.probe) not in given]
    changed = dataclasses.replace(truth, effects=(*kept, *effects))
    film = changed.effect("convective_film")
    if film is None or truth.effect("convective_film") is not None:
        return changed
    biot = film["biot_at_5_m_s"]
    effective_s = CORE_T98 * truth.bead_radius_m**2 / truth.thermal_diffusivity_m2_s
    slower = 1.0 + 1.5 * min(1.0, 0.1 / biot) if biot > 0 else 1.0
    lumped_s = 3.912 / (3.0 * biot) + CORE_T98  # t98 alpha / R^2 behind the film, roughly
    return dataclasses.replace(
        changed, thermal_diffusivity_m2_s=float(lumped_s * truth.bead_radius_m**2 / (effective_s * slower))
    )
