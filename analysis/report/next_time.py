"""What to record next time, so that what a campaign leaves open can be told: plain sentences with numbers in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from shockrig.analysis.estimate.channel import Channel
from shockrig.analysis.estimate.driven_air import follow
from shockrig.analysis.estimate.seen import FEW_RUNS, little_known, seen

ENOUGH_READINGS = 8.0  # in the time to 63 %
REST_T63, RECORD_T63 = 3.0, 8.0  # times to 63 % to wait before a transfer, and to record after it
TRIGGER_SHARE = 0.03  # of the time to 63 %: how well a start should be known
AIRS_OFF = 2.0  # times what is promised of stated airs


def next_time(channels: Sequence[Channel]) -> list[str]:
    """Sentences on what the next campaign should record, the most telling first; none where little is open."""
    told = [channel for channel in channels if little_known(channel)]
    return [sentence for sentence in (say(told) for say in _SENTENCES) if sentence] if told else []


def _more_runs(channels: Sequence[Channel]) -> str:
    fewest = min(channel.runs for channel in channels)
    if fewest >= FEW_RUNS:
        return ""
    return (
        f"Record at least {FEW_RUNS} transfers, three of them alike (now {fewest}): only a run that was not fitted "
        "shows whether an explanation holds, and only repeats show by how much runs differ."
    )


def _both_ways(channels: Sequence[Channel]) -> str:
    one_way = [
        channel
        for channel in channels
        if not channel.measured.all() and abs(np.sign(channel.quantity.step(channel.conditions)).sum()) == channel.runs
    ]
    return "Carry the probes both ways: what depends on the direction is then told from what does not." * bool(one_way)


def _airs(channels: Sequence[Channel]) -> str:
    if not all(channel.conditions.airs_known.all() for channel in channels):
        return (
            "Log the air beside the probes with a faster sensor (air.csv, or reference = in the map), or write down "
            "both airs once they stand still: the sensor's own plateau hides its calibration and an air that moves."
        )
    off = [
        float(channel.conditions.source_c_scatter.max())
        for channel in channels
        if channel.quantity.pooled and not channel.measured.any()
    ]
    if off and max(off) > AIRS_OFF * channels[0].quantity.air_scatter:
        return (
            f"Read the reference when the probes have settled: the airs written down scatter by {_about(max(off))} K."
        )
    return ""


def _starts(channels: Sequence[Channel]) -> str:
    if all(channel.conditions.start_known.all() for channel in channels):
        return ""
    times = [t for channel in channels if (t := _t63_s(channel)) is not None]
    within = f", to {_about(TRIGGER_SHARE * min(times))} s or better" if times else ""
    return f"Mark when each transfer begins (a switch, a key, a column of the log){within}."


def _airflow(channels: Sequence[Channel]) -> str:
    if all(channel.conditions.airflow_known.all() for channel in channels):
        return ""
    return "Measure the airflow, and record some transfers at half and at twice of it."


def _sampling(channels: Sequence[Channel]) -> str:
    for channel in channels:
        t63_s = _t63_s(channel)
        if t63_s is not None and t63_s < ENOUGH_READINGS * channel.sampling_period_s:
            # What passes between two readings is not known any better than to the time between them.
            t63_s = max(t63_s, channel.sampling_period_s)
            wanted, now = _about(t63_s / ENOUGH_READINGS), _about(channel.sampling_period_s)
            if wanted == now:
                continue
            within = f"63 % of the way takes {_about(t63_s)} s or less"
            return f"Log every {wanted} s or faster, not every {now} s: {within}."
    return ""


def _length(channels: Sequence[Channel]) -> str:
    short = []
    for channel in channels:
        t63_s = _t63_s(channel)
        if t63_s is not None and any(
            t[0] > -REST_T63 * t63_s or t[-1] < RECORD_T63 * t63_s for t, _ in channel.samples
        ):
            short.append(t63_s)
    if not short:
        return ""
    rest, whole = _about(REST_T63 * max(short)), _about(RECORD_T63 * max(short))
    return (
        f"Begin each record {rest} s before the transfer, with the sensor at rest in an air that stands still, and go "
        f"on for {whole} s after it."
    )


def _settled(channels: Sequence[Channel]) -> str:
    for channel in channels:
        for (time, value), air in zip(channel.samples, channel.air, strict=True):
            if air is None:
                continue
            trace = channel.trace_of(air)
            if follow(time, value, air.time_s, trace, channel.quantity.resolution).excess:
                return "Let the sensor settle before the record begins: it was still on its way from another air."
    return ""


_SENTENCES = (_more_runs, _airs, _starts, _airflow, _both_ways, _sampling, _length, _settled)


def _t63_s(channel: Channel) -> float | None:
    """Shortest time to 63 % that a channel's runs show, or lag behind a measured air [s]; None without a step."""
    runs = seen(channel)
    times = [one.times_s[0] for one in runs if one.times_s] + [one.behind_s for one in runs if one.behind_s]
    return min(times, default=None)


def _about(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"
