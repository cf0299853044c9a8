"""Hiding effects in the virtual world, and sealing the answer: a blind trial for people and for tests.

A sealed file is JSON with the truth packed (zlib, base64) so that nobody reads it by accident, and a SHA-256 so that a
damaged one is known.
"""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from shockrig.files.disk import read_text, real_path
from shockrig.files.json_files import write_json
from shockrig.files.spelling import did_you_mean
from shockrig.rig.bench_errors import BenchError, as_bench_errors
from shockrig.rig.virtual.effects import CATALOGUED, KINDS, OUTSIDE, T
from shockrig.rig.virtual.realistic import draw_real, drawable
from shockrig.rig.virtual.truth import HUMIDITY_STEP_PERCENT, Hidden, Truth

FORMAT = "sealed-truth/1"
LARGEST_CONTENT = 1 << 20  # bytes of a truth as text, some hundred times what one takes
REMEDY = "give the sealed file that hiding wrote"
COMFORTABLE, LIMIT, REALISTIC = "comfortable", "limit", "realistic"
STRENGTHS = (COMFORTABLE, LIMIT, REALISTIC)
LIMIT_SHARES = (0.1, 1.0 / 3.0)

Draw = Callable[[np.random.Generator, str, float], dict[str, float]]


def _between(low: float, high: float) -> Callable[[np.random.Generator], float]:
    return lambda rng: float(rng.uniform(low, high))


def _either_sign(low: float, high: float) -> Callable[[np.random.Generator], float]:
    return lambda rng: float(rng.choice((-1.0, 1.0)) * rng.uniform(low, high))


def _room(rng: np.random.Generator) -> dict[str, float]:
    return {
        "room_temperature_c": float(rng.uniform(18.0, 28.0)),
        "room_humidity_percent": float(rng.uniform(30.0, 60.0)),
    }


def _calibration(rng: np.random.Generator, channel: str, weaker: float) -> dict[str, float]:
    gain, offset = _either_sign(0.005, 0.02)(rng), _either_sign(0.1, 0.5)(rng) * (1.0 if channel == T else 4.0)
    return {"gain": weaker * gain, "offset": weaker * offset}


def _biot(low: float, high: float) -> Draw:
    """Resistance is the strength: the weaker the effect, the larger the Biot number."""
    logarithm = _between(np.log(low), np.log(high))
    return lambda rng, channel, weaker: {"biot_at_5_m_s": float(np.exp(logarithm(rng))) / weaker}


def _clipping(rng: np.random.Generator, channel: str, weaker: float) -> dict[str, float]:
    return {"limit_percent": 80.0 - weaker * float(rng.uniform(3.0, 10.0))}  # the highest plateau is 80 %RH


def _ratio(rng: np.random.Generator, channel: str, weaker: float) -> dict[str, float]:
    ratio = rng.uniform(0.7, 0.9) if rng.random() < 0.5 else rng.uniform(1.1, 1.4)
    return {"ratio_drying_to_wetting": float(ratio**weaker)}


def _whole(name: str, low: int, high: int) -> Draw:
    """A whole number; near the limit it is a small one."""
    return lambda rng, channel, weaker: {
        name: float(rng.integers(low, high + 1))
        if weaker == 1.0
        else float(max(2, round(round(weaker * rng.integers(low, high + 1), 9))))  # a half is one in every last bit
    }


def _resolution(rng: np.random.Generator, channel: str, weaker: float) -> dict[str, float]:
    normal, drawn = (0.01, rng.uniform(0.05, 0.2)) if channel == T else (HUMIDITY_STEP_PERCENT, rng.uniform(0.3, 1.0))
    return {"step": max(float(weaker * drawn), 2.0 * normal)}


def _scaled(
    strength: str, draw: Callable[[np.random.Generator], float], **others: Callable[[np.random.Generator], float]
) -> Draw:
    """The parameter that is the strength gets weaker near the limit, the others are drawn alike."""
    return lambda rng, channel, weaker: {strength: weaker * draw(rng), **{k: other(rng) for k, other in others.items()}}


def _per_channel(
    strength: str,
    kelvin: tuple[float, float],
    percent: tuple[float, float],
    **others: Callable[[np.random.Generator], float],
) -> Draw:
    return lambda rng, channel, weaker: {
        strength: weaker * _either_sign(*(kelvin if channel == T else percent))(rng),
        **{k: other(rng) for k, other in others.items()},
    }


DRAWS: dict[str, Draw] = {
    "finite_transfer": _scaled("duration_s", _between(0.2, 0.6)),
    "air_relaxation": lambda rng, channel, weaker: {
        "fraction": weaker * float(rng.uniform(0.02, 0.08)),
        "time_constant_s": float(rng.uniform(3.0, 15.0)),
        **_room(rng),
    },
    "convective_film": _biot(0.08, 0.2),
    "vapour_boundary_layer": _biot(3.0, 15.0),
    "direction_dependent_diffusivity": _ratio,
    "concentration_dependent_diffusivity": _scaled("slope_per_unit_activity", _either_sign(0.2, 0.6)),
    "slow_relaxation": _scaled("fraction", _between(0.03, 0.12), time_constant_s=_between(15.0, 40.0)),
    "stem_conduction": _scaled("fraction", _between(0.02, 0.08), time_constant_s=_between(5.0, 15.0)),
    "self_heating": _scaled("rise_k_at_5_m_s", _between(0.1, 0.5)),
    "die_thermal_lag": lambda rng, channel, weaker: {},
    "hysteresis": _scaled("rh_percent", _between(0.5, 2.0)),
    "calibration_error": _calibration,
    "saturation_clipping": _clipping,
    "dead_time": _scaled("delay_s", _between(0.15, 0.6)),
    "moving_average": _whole("samples", 4, 15),
    "stale_samples": _whole("hold_samples", 3, 8),
    "quantization": _resolution,
    "radiative_heating": _scaled("kelvin_per_w_m2_at_5_m_s", _between(2e-4, 1e-3)),
    "evaporative_cooling": _scaled("depression_k", _between(0.2, 0.5), time_constant_s=_between(10.0, 40.0)),
    "clock_drift": _scaled("ppm", _between(5000.0, 20000.0)),
    "condensation": _scaled("drying_time_s", _between(3.0, 12.0)),
    "exchange_temperature": lambda rng, channel, weaker: {},
    "wall_radiation": _scaled("rise_k_at_10_k", _between(0.1, 0.3), wall_temperature_c=_between(18.0, 26.0)),
    "calibration_temperature": _scaled("percent_per_k", _either_sign(0.03, 0.1)),
    "series_lag": _scaled("time_constant_s", _between(1.0, 6.0)),
    "unknown_air_cycling": _scaled("amplitude_k", _between(0.1, 0.4), period_s=_between(6.0, 25.0)),
    "unknown_chamber_overshoot": _scaled(
        "fraction", _between(0.02, 0.08), decay_s=_between(3.0, 10.0), period_s=_between(5.0, 15.0)
    ),
    "unknown_rate_with_temperature": _scaled("per_kelvin", _either_sign(0.004, 0.012)),
    "unknown_log_creep": _per_channel("fraction", (0.005, 0.02), (0.005, 0.02), onset_s=_between(1.0, 5.0)),
    "unknown_sorption_heat": _scaled("kelvin_s_per_percent", _between(0.01, 0.04)),
    "unknown_run_drift": _per_channel("per_run", (0.01, 0.03), (0.03, 0.1)),
    "unknown_gain_drift": _per_channel("per_minute", (0.005, 0.02), (0.01, 0.04)),
    "unknown_interference": lambda rng, channel, weaker: {
        "amplitude": weaker * float(rng.uniform(0.02, 0.06) if channel == T else rng.uniform(0.1, 0.3)),
        "hum_hz": float(rng.uniform(0.2, 3.0)),
        "burst_share": float(rng.uniform(0.02, 0.1)),
    },
}


def draw_effect(
    rng: np.random.Generator, effect: str, strength: str | float = COMFORTABLE, channel: str | None = None
) -> Hidden:
    """One effect at random strength.

    "comfortable" is plain to see; "limit" is a tenth to a third of it (of the logarithm of a ratio, of 1 /
    Biot), a number from 0 to 1 that share of it; "realistic" is what real sensors show (realistic.py). An effect
    without a strength (`die_thermal_lag`) is what it is.
    Faults of one channel's electronics draw their channel unless it is given.
    """
    if effect not in KINDS:
        raise BenchError(f"effect {effect!r} is not known to the virtual world{did_you_mean(effect, sorted(KINDS))}")
    if strength not in STRENGTHS and not (isinstance(strength, float) and 0.0 < strength <= 1.0):
        raise BenchError(f"strength must be one of {', '.join(STRENGTHS)} or a share from 0 to 1, not {strength!r}")
    kind = KINDS[effect]
    if channel is not None and channel not in kind.channels:
        raise BenchError(f"effect {effect} acts in {' and '.join(kind.channels)}, not in {channel}")
    if isinstance(strength, float):
        weaker = strength
    else:
        weaker = float(np.exp(rng.uniform(*np.log(LIMIT_SHARES)))) if strength == LIMIT else 1.0
    channels = kind.channels
    if kind.single:
        channels = (channel or str(rng.choice(kind.channels)),)
    if strength == REALISTIC:
        return Hidden(effect, draw_real(rng, effect, channels[0] if kind.single else None), channels)
    return Hidden(effect, DRAWS[effect](rng, channels[0], weaker), channels)


def draw_hidden(
    rng: np.random.Generator, which: str | int | Sequence[str] = "random", strength: str | float = COMFORTABLE
) -> list[Hidden]:
    """Effects to hide.

    `which`: "none"; a number of different catalogued effects; "random" (none, one, two or four); "outside" (one from
    outside any catalogue); or effect ids, as a sequence or joined by commas. ID@PROBE hides it in that probe alone.
    """
    if which == "none":
        return []
    if which == "random":
        which = int(rng.choice((0, 1, 2, 4)))
    if isinstance(which, str) and which.isdigit():
        which = int(which)
    if isinstance(which, int):
        if not 0 <= which <= len(CATALOGUED):
            raise BenchError(f"the number of hidden effects must be 0 to {len(CATALOGUED)}, not {which}")
        known = [name for name in CATALOGUED if strength != REALISTIC or name in drawable()]
        names = [str(name) for name in rng.choice(known, which, replace=False)]
    elif which == "outside":
        names = [str(rng.choice(OUTSIDE))]
    else:
        names = [name.strip() for name in (which.split(",") if isinstance(which, str) else which)]
    asked = [name.partition("@") for name in names]
    return [replace(draw_effect(rng, name, strength), probe=probe) for name, _, probe in asked]


def seal(path: Path, truth: Truth, seed: int) -> Path:
    """Write the sealed truth. Raises BenchError where `path` exists or lies in a campaign folder."""
    path = Path(path)
    if path.exists():
        raise BenchError(f"{path}: exists already; name a new file for the sealed truth")
    for parent in real_path(path).parents:
        if (parent / "campaign.json").exists():
            raise BenchError(f"{path}: lies in the campaign {parent}; keep the sealed truth outside it")
    packed = zlib.compress(json.dumps({"seed": seed, "truth": truth.to_json()}).encode(), 9)
    content = {
        "format": FORMAT,
        "note": "open with: shockrig reveal",
        "sha256": hashlib.sha256(packed).hexdigest(),
        "sealed": base64.b64encode(packed).decode(),
    }
    try:
        write_json(path, content)
    except OSError as error:
        raise BenchError(f"{path}: {error.strerror}; name another file for the sealed truth") from None
    return path


def open_seal(path: Path) -> tuple[Truth, int]:
    """Truth and seed of a sealed file; raises BenchError where it is not one or is damaged."""
    with as_bench_errors():
        text = read_text(path, REMEDY)
    try:
        content = json.loads(text)
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            found = content.get("format") if isinstance(content, dict) else type(content).__name__
            raise ValueError(f'key format: expected "{FORMAT}", found {repr(found)[:40]}')
        packed = base64.b64decode(content["sealed"], validate=True)
        if hashlib.sha256(packed).hexdigest() != content["sha256"]:
            raise ValueError("the checksum does not fit: the file was changed after it was sealed")
        inner = json.loads(zlib.decompressobj().decompress(packed, LARGEST_CONTENT))
        seed = inner["seed"]
        if not isinstance(seed, int) or not 0 <= seed < 1 << 64:
            raise ValueError(f"key seed: expected a whole number of 64 bits, found {repr(seed)[:40]}")
        return Truth.from_json(inner["truth"]), seed
    except BenchError as error:
        raise BenchError(f"{path}: {error}") from error
    except (RecursionError, ValueError, zlib.error) as error:
        raise BenchError(f"{path}: not a sealed truth: {error}; {REMEDY}") from error
    except (KeyError, TypeError, AttributeError) as error:
        what = f"key {error} is missing" if isinstance(error, KeyError) else "a value is of another kind"
        raise BenchError(f"{path}: not a sealed truth: {what}; {REMEDY}") from error
