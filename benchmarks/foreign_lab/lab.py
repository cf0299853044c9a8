"""What another lab has: a sensor, a chamber, a logger, a reference, a plan of transfers, and the habit of writing down.

Data only; `recording.record` makes campaigns of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from foreign_lab.bodies import ForeignBody

Channel = Literal["temperature", "humidity"]


@dataclass(frozen=True)
class LabLogger:
    """How a channel is logged: period [s], rounding, noise (one sigma, channel's unit) and share of lost samples.

    The noise is white plus first-order autoregressive, `correlated` with the time constant `correlation_time_s`.
    """

    period_s: float
    rounding: float
    white: float
    correlated: float = 0.0
    correlation_time_s: float = 1.0
    lost: float = 0.0


@dataclass(frozen=True)
class Arrival:
    """How the air at the sensor comes to its new state.

    `kind` is "step", "ramp" (over `first_s`), "one" (one time constant, `first_s`) or "two" (`first_s`, and
    `second_share` of the change with `second_s`).
    """

    kind: Literal["step", "ramp", "one", "two"] = "step"
    first_s: float = 0.0
    second_s: float = 0.0
    second_share: float = 0.0


@dataclass(frozen=True)
class LabReference:
    """The instrument beside the sensor that measures the air: lag [s], calibration error (one sigma), own logger.

    `stated`: whether the lab writes lag and uncertainty into run.json.
    """

    time_constant_s: float
    standard_uncertainty: float
    logger: LabLogger
    stated: bool = True


@dataclass(frozen=True)
class LabRun:
    """One run of the plan: from one air to another (degC or %RH), at `start_s` in a record of `length_s`.

    `pace`: how many times as fast the sensor is where it ends up: the air moves otherwise there, or is water.
    """

    source: float
    destination: float
    start_s: float
    length_s: float
    pace: float = 1.0


@dataclass(frozen=True)
class Written:
    """What the lab writes down: the transfer's start, the airs, the airflow, the sensor's body."""

    start: bool = True
    airs: bool = True
    airflow: bool = True
    body: str | None = None
    start_error_s: float = 0.01
    air_error: float | None = None  # one sigma; None: 0.02 degC or 0.1 %RH


@dataclass(frozen=True)
class Lab:
    """A lab's whole bench with one sensor on it.

    `rate_scatter`: relative spread of the sensor's rate from run to run (a hand never plunges twice alike).
    """

    channel: Channel
    body: ForeignBody
    approach: Arrival
    logger: LabLogger
    plan: tuple[LabRun, ...]
    written: Written = Written()
    reference: LabReference | None = None
    airflow_m_s: float = 5.0
    rate_scatter: float = 0.0
    other_c: float = 22.0  # temperature of the air where humidity is what changes
    length_m: float | None = None  # radius or thickness to quote alpha or D for; None: the format's default
    name: str = "foreign"
