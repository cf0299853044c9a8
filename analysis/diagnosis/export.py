"""The diagnosis as the file `shock-diagnosis/1` says it, and as an extended sensor profile."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.diagnosis.diagnose import Cause, ChannelDiagnosis, Diagnosis


def to_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """The content of diagnosis.json; every number is finite, unknown ones are left out."""
    return {
        "format": "shock-diagnosis/1",
        "campaign": diagnosis.campaign,
        "channels": {channel.name: _channel(channel) for channel in diagnosis.channels},
        "next_experiments": list(diagnosis.next_experiments),
        "input_findings": list(diagnosis.input_findings),
    }


def _channel(channel: ChannelDiagnosis) -> dict[str, Any]:
    gain = channel.gain
    content: dict[str, Any] = {
        "verdict": channel.verdict,
        "causes": [_cause(cause) for cause in channel.causes],
        "gain": {
            "held_out_rmse_before": _digits(gain.before),
            "held_out_rmse_after": _digits(gain.after),
            "noise_floor": _digits(gain.noise_floor),
            "explained_fraction": _digits(gain.explained_fraction),
            "interval_95": [_digits(x) for x in gain.interval_95],
        },
        "untestable": list(channel.untestable),
    }
    names, matrix = correlations(channel)
    content["correlations"] = {"parameters": names, "matrix": [[round(float(x), 4) for x in row] for row in matrix]}
    left = channel.remainder
    content["remainder"] = _finite(
        {
            "rms": left.rms,
            "peak": left.peak,
            "unit": left.unit,
            "significant": left.significant,
            "material": left.material,
            "tolerance": left.tolerance,
            "from_s": left.from_s,
            "until_s": left.until_s,
            "varies_with": list(left.varies_with),
        }
    )
    content["discovered"] = []
    content["cannot_tell"] = list(channel.cannot_tell)
    content["tried"] = [{"effect": tried.effect, "why_not": tried.why} for tried in channel.tried]
    if channel.verdict == "unexplained":
        content["discrepancy"] = _finite(channel.discrepancy or {})
    return content


def correlations(channel: ChannelDiagnosis) -> tuple[list[str], NDArray[np.float64]]:
    """Names of the final model's parameters (alpha, or D at each ambient; then the effects') and their correlations."""
    data = channel.problem.channel
    of = data.quantity
    ambients = [f"{of.symbol} at {round(float(t), 1) + 0.0:.1f} degC" for t in data.ambients_c]
    names = [*([of.symbol] if of.pooled else ambients), *channel.final.structure.names]
    covariance = channel.final.covariance
    # A parameter that the data do not see has no finite uncertainty, and none of its correlations means anything.
    deviation = np.sqrt(np.clip(np.nan_to_num(np.diag(covariance), posinf=0.0), 0.0, None))
    known = np.outer(deviation > 0, deviation > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        matrix = np.where(known, covariance / np.outer(deviation, deviation), 0.0)
    np.fill_diagonal(matrix, 1.0)
    return names, np.clip(np.nan_to_num(matrix), -1.0, 1.0)


def _finite(value: Any) -> Any:
    """The same for a JSON file: numbers to seven digits, those that are not finite left out."""
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items() if not (isinstance(v, float) and not math.isfinite(v))}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return _digits(value) if isinstance(value, float) else value


def _cause(cause: Cause) -> dict[str, Any]:
    content: dict[str, Any] = {
        "effect": cause.effect,
        "probability": round(cause.probability, 4),
        "parameters": {
            name: {"value": _digits(value), "standard_uncertainty": _digits(sd)}
            for name, (value, sd) in cause.parameters.items()
        },
        "indistinguishable_from": list(cause.indistinguishable_from),
    }
    if cause.at_bound:
        content["at_bound"] = list(cause.at_bound)
    if cause.why:
        content["evidence"] = cause.why
    return content


def _digits(value: float) -> float:
    """A number to seven significant digits: more would claim more than is known."""
    value = float(value)
    return value if value == 0 or not math.isfinite(value) else float(f"{value:.7g}")
