"""What flights can show of a sensor: each law with its equation, its source, and the causes that would give it.

The sensor reads the air a along the flight through a linear response and an offset:

    y(t) = sum_k share_k q_k(t),   tau_k(t) dq_k/dt = a(z(t + shift)) + offset(t) - q_k

Air keeps its vapour pressure e, and a film reads e / es of its own temperature, which is what the bead beside it reads:
what warms both is in both. A law gives the response its lags, the track its shift, the reading its offset, or the film
a temperature other than the bead's. Laws that no flight can tell apart are one law with several causes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtbtrs

from shockrig.analysis.effects.of_flight import LEAST_AIRFLOW_M_S, warmer_k
from shockrig.analysis.learn.bins import REFERENCE_TEMPERATURE_C, SUB_SAMPLES, FlightBins

Array = NDArray[np.float64]
Values = Mapping[str, float]

BESIDE_BEAD = "film_beside_bead"  # the effect of a film whose temperature follows the bead's
FASTEST_M_S = 1e4  # that anything sinks
USUAL_PATH_S = 60.0  # of a stem or a housing
SHIFT = "shift_s"  # of the track, which says when the carrier turned
SECOND = "_2"  # behind the names of a second sensor's parameters


@dataclass(frozen=True)
class LawParameter:
    """One number of a law on the scale that is fitted: the logarithm where `log`, else the number itself.

    `usual` and `spread` are what is known of it before any flight (a normal density on that scale), `low` and `high`
    where it may be, `starts` where a fit begins; all but `spread` in the parameter's own unit. `words` are for readers.
    """

    name: str
    unit: str
    usual: float
    spread: float
    low: float
    high: float
    starts: tuple[float, ...]
    words: str
    log: bool = False

    def encoded(self, value: float) -> float:
        """On the scale that is fitted."""
        return float(np.log(value)) if self.log else value

    def decoded(self, value: float) -> float:
        """In its own unit."""
        return float(np.exp(value)) if self.log else value


@dataclass(frozen=True)
class Law:
    """One thing that flights can show.

    Attributes
    ----------
    key : str
        Its name in files.
    causes : tuple of str
        What would give it; more than one where no flight tells them apart.
    channel : str
        Of which readings it is; empty where it is the position's.
    parameters : tuple of LawParameter
    equation, source : str
    lags : (values, bins) -> ((share (n,), time constant (n,) [s]), ...), or None
        The response; what the shares leave of 1 is read at once.
    offset : (values, bins) -> ndarray (n, SUB_SAMPLES), or None
        What is added to the air that is met, within bins.
    warmer : (values, bins) -> ndarray (n, SUB_SAMPLES or 1), or None
        How much warmer the film is than the bead reads [K].
    activity : (values, bins) -> 1 or ndarray (n, SUB_SAMPLES), or None
        From 0, where the film takes up vapour, to 1, where it takes up relative humidity at its own temperature.
    shift_s : values -> s, or None
        By how much the track's time is behind the sensor's.
    flown_as : str
        The effect of the catalogue that a correction takes off.
    needs : str
        What flights must vary for it to show, for a reader.
    """

    key: str
    causes: tuple[str, ...]
    channel: str
    parameters: tuple[LawParameter, ...]
    equation: str
    source: str
    needs: str
    lags: Callable[[Values, FlightBins], tuple[tuple[Array, Array], ...]] | None = None
    offset: Callable[[Values, FlightBins], Array] | None = None
    warmer: Callable[[Values, FlightBins], Array] | None = None
    activity: Callable[[Values, FlightBins], float | Array] | None = None
    shift_s: Callable[[Values], float] | None = None
    flown_as: str = ""

    @property
    def name(self) -> str:
        """Its key behind what it is a law of."""
        return f"{self.channel or 'position'}.{self.key}"

    @property
    def names(self) -> tuple[str, ...]:
        """Its parameters'."""
        return tuple(one.name for one in self.parameters)


def response(lags: tuple[tuple[Array, Array], ...], bins: FlightBins, air: Array) -> Array:
    """What a mix of lags reads of columns of air, as means over bins: (n, m).

    `air` (n, SUB_SAMPLES, m) is held over each part of a bin. A lag's state at the end of a bin is
    q = e q' + sum_k w_k u_k, w_k = exp(-(h - t_k)/tau) between the parts' ends, and its mean over the bin is
    that of the air less tau (q - q')/h, both exact; it begins settled to the first air, each sensor to its own.
    """
    seen: Array = np.add.reduce(air, axis=1)
    seen /= air.shape[1]  # what is read at once and what each lag reads of the mean: their shares are 1 together
    parts, begins = np.arange(air.shape[1] + 1) / air.shape[1], list(bins.begins)
    for share, tau in lags:
        x = bins.length_s / np.maximum(tau, 1e-6)
        left = np.exp(-np.minimum(x[:, None] * (1.0 - parts), 700.0))  # of what came by the end of each part
        state = np.einsum("ik,ikm->im", left[:, 1:] - left[:, :-1], air)
        state[begins] += left[begins, 0, None] * air[begins, 0]
        band = np.ones((2, x.size))
        band[1, :-1] = -left[1:, 0]
        band[1, [b - 1 for b in begins[1:]]] = 0.0
        state = dtbtrs(band, state, uplo="L", overwrite_b=1)[0]
        change = state.copy()
        change[1:] -= state[:-1]
        change[begins] = state[begins] - air[begins, 0]
        change *= (share / x)[:, None]
        seen -= change
    return seen


def drawn_back(lags: tuple[tuple[Array, Array], ...], bins: FlightBins, weights: Array) -> Array:
    """The adjoint of `response`: what weights of the bins (n, q) are as weights of the air (n, SUB_SAMPLES, q)."""
    n, parts = bins.time_s.size, np.arange(SUB_SAMPLES + 1) / SUB_SAMPLES
    found = np.repeat((weights / SUB_SAMPLES)[:, None], SUB_SAMPLES, axis=1)
    for share, tau in lags:
        x = bins.length_s / np.maximum(tau, 1e-6)
        left = np.exp(-np.minimum(x[:, None] * (1.0 - parts), 700.0))
        through = (share / x)[:, None] * weights
        band = np.ones((2, n))
        begins = list(bins.begins)
        band[0, 1:] = -left[1:, 0]
        band[0, begins[1:]] = 0.0
        state, before = through.copy(), through.copy()
        before[begins] = 0.0
        state[:-1] -= before[1:]
        state = dtbtrs(band, state, uplo="U", overwrite_b=1)[0]
        found -= np.diff(left, axis=1)[..., None] * state[:, None]
        found[begins, 0] += through[begins] - left[begins, 0, None] * state[begins]
    return found


def _time_constant(usual: float, name: str = "time_constant_s") -> LawParameter:
    return LawParameter(name, "s", usual, 1.5, 0.1, 400.0, tuple(np.geomspace(0.7, 90.0, 7)), "time constant", True)


def _one_lag(values: Values, bins: FlightBins) -> tuple[tuple[Array, Array], ...]:
    n = bins.time_s.size
    return ((np.ones(n), np.full(n, values["time_constant_s"])),)


def _lag_in_the_cold(values: Values, bins: FlightBins) -> tuple[tuple[Array, Array], ...]:
    cold = REFERENCE_TEMPERATURE_C - bins.bead_c
    tau = values["time_constant_s"] * np.exp(np.clip(values["growth_per_k"] * cold, -6.0, 6.0))
    return ((np.ones(tau.size), tau),)


def _two_paths(values: Values, bins: FlightBins) -> tuple[tuple[Array, Array], ...]:
    n, share = bins.time_s.size, values["fraction"]
    return (
        (np.full(n, 1.0 - share), np.full(n, values["time_constant_s"])),
        (np.full(n, share), np.full(n, values["second_time_constant_s"])),
    )


def _behind(values: Values, bins: FlightBins) -> Array:
    """Nobody knows how fast the film's temperature is: to first order, it is what the bead read so much earlier."""
    return np.asarray(-values["film_behind_bead_s"] * bins.bead_k_s)[:, None]


def _ventilated(values: Values, bins: FlightBins) -> Array:
    return warmer_k(values["rise_k_at_5_m_s"], bins.airflow_within_m_s(values.get(SHIFT, 0.0)))


def descent_from_m_s(bins: FlightBins) -> float:
    """Sinking faster than this is a descent: half of the usual, since a track's speed is smoothed; endless for none."""
    climb = bins.climb_within_m_s().mean(axis=1)
    sinks = -climb[climb < -LEAST_AIRFLOW_M_S]
    return 0.5 * float(sinks.mean()) if sinks.size else np.inf


def _descending(values: Values, bins: FlightBins) -> Array:
    """The share of each part of a bin in which the flight descends (n, SUB_SAMPLES)."""
    faster = -bins.speed_m_s - min(descent_from_m_s(bins), FASTEST_M_S)
    over, size = np.maximum(faster, 0.0), np.abs(faster)
    share = (over[1:] + over[:-1]) / np.maximum(size[1:] + size[:-1], 1e-12)  # of each step, along a straight line
    descended_s = np.r_[0.0, np.cumsum(share * np.diff(bins.speed_s))]
    middle, half = bins.within_s + values.get(SHIFT, 0.0), 0.5 * bins.length_s[:, None] / SUB_SAMPLES
    begun, ended = (np.interp(middle + by, bins.speed_s, descended_s) for by in (-half, half))
    return np.asarray((ended - begun) / (2.0 * half))


def _late(values: Values, bins: FlightBins) -> Array:
    read = bins.bead_c
    held = np.repeat(read[:, None, None], SUB_SAMPLES, axis=1)
    tau = np.full(read.size, values["die_time_constant_s"])
    return np.asarray(response(((np.ones(read.size), tau),), bins, held)[:, 0] - read)[:, None]


CAUSE_WORDS = {  # causes of laws, for readers
    "clock_offset": "a clock offset between logger and position",
    "pressure_lag": "a pressure that lags",
    "stem_conduction": "heat along the stem",
    "housing": "a housing that follows slowly",
    "rotor_wash": "the rotors' wash",
    "wake": "the carrier's wake",
    "hysteresis": "hysteresis of the film",
    "radiative_heating": "radiation",
    "self_heating": "the sensor's own warmth",
    "die_thermal_lag": "the chip's thermal lag",
}

_AIRFLOW = "two airspeeds or climb rates"
_STRUCTURE = "layers or inversions, passed upwards and downwards"


# What nobody knows of a film beside its lag.
_FILM = (
    LawParameter("film_behind_bead_s", "s", 0.0, 4.0, -15.0, 15.0, (0.0,), "film's temperature behind the bead's"),
    LawParameter("activity", "1", 0.5, 0.5, 0.0, 1.0, (0.5,), "uptake by activity, not vapour"),
)

_SLOW_PATH = (
    LawParameter("fraction", "1", 0.1, 0.15, 0.005, 0.7, (0.1, 0.3), "share"),
    LawParameter(
        "second_time_constant_s",
        "s",
        USUAL_PATH_S,
        0.8,
        10.0,
        900.0,
        (40.0, 120.0),
        "time constant of the slow path",
        True,
    ),
)
_CLOCK = Law(
    "clock_offset",
    ("clock_offset", "pressure_lag"),
    "",
    (LawParameter(SHIFT, "s", 0.0, 15.0, -120.0, 120.0, (-30.0, -12.0, -5.0, 5.0, 12.0, 30.0), "shift"),),
    "y(t) = a(z(t + shift)); a pressure that lags by tau moves every level by tau w, the same shift",
    "WMO-No. 8 (2021), I.12 (time stamps of merged records); Rodi and Leon 2012, doi 10.5194/amt-5-2569-2012",
    _STRUCTURE,
    shift_s=lambda p: p[SHIFT],
)


def _of_each(channel: str, usual: float, unit: str, size: float) -> tuple[Law, ...]:
    """Laws that both channels have: of a usual time constant [s], and offsets of a size in the channel's unit."""
    lag: tuple[LawParameter, ...] = (_time_constant(usual),)
    film: dict[str, Any] = {}
    if channel == "humidity":
        lag, film = (*lag, *_FILM), {"warmer": _behind, "activity": lambda p, bins: p["activity"]}
    return (
        Law(
            "lag",
            ("lag",),
            channel,
            lag,
            "tau dq/dt = a - q",
            "Miloshevich and others 2004, doi 10.1175/1520-0426(2004)021<1305:DAVOAT>2.0.CO;2",
            _STRUCTURE,
            lags=_one_lag,
            **film,
        ),
        Law(
            "lag_in_the_cold",
            ("lag_in_the_cold",),
            channel,
            (*lag, LawParameter("growth_per_k", "1/K", 0.03, 0.03, -0.02, 0.15, (0.02, 0.06), "growth")),
            "tau(T) = tau(20 degC) exp(growth (20 degC - T))",
            "Miloshevich and others 2004; GRUAN-TD-8 (2022)",
            f"{_STRUCTURE} at temperatures 15 K apart",
            lags=_lag_in_the_cold,
            **film,
        ),
        Law(
            "second_path",
            ("stem_conduction", "housing"),
            channel,
            (*lag, *_SLOW_PATH),
            "y = (1 - f) q(tau) + f q(tau2)",
            "Segales and others 2022, doi 10.5194/amt-15-2607-2022 (housing); Bell and others 2020 (stem)",
            "a hover after a climb, or two climb rates",
            lags=_two_paths,
            **film,
            flown_as="parallel_lag",
        ),
        Law(
            "offset_in_descent",
            ("rotor_wash", "wake", "radiative_heating")
            if channel == "temperature"
            else ("rotor_wash", "wake", "hysteresis"),
            channel,
            (LawParameter("offset_in_descent", unit, 0.0, size, -20 * size, 20 * size, (-size, size), "offset"),),
            "tau dq/dt = a + offset - q while the flight descends",
            "Greene and others 2018, doi 10.5194/amt-11-5519-2018",
            "another speed of descent, a night, and a hover",
            offset=lambda p, bins: _descending(p, bins) * p["offset_in_descent"],
            flown_as="offset_in_descent",
        ),
    )


_OF_BEAD = (
    Law(
        "ventilated_warmth",
        ("radiative_heating", "self_heating"),
        "temperature",
        (LawParameter("rise_k_at_5_m_s", "K", 0.0, 0.5, -10.0, 10.0, (0.5, -0.3), "rise at 5 m/s"),),
        "tau dq/dt = a + rise sqrt(5 m/s / v) - q",
        "WMO-No. 8 (2021), I.2; GRUAN-TD-8 (2022)",
        _AIRFLOW,
        offset=_ventilated,
        flown_as="ventilated_warmth",
    ),
)
_OF_FILM = (
    Law(
        "film_unlike_in_descent",
        ("rotor_wash", "wake", "radiative_heating"),
        "humidity",
        (LawParameter("film_over_bead_k", "K", 0.0, 0.7, -14.0, 14.0, (-0.7, 0.7), "film above bead"),),
        "tau dq/dt = e / es(T + d) - q while the flight descends, T the bead's reading",
        "Greene and others 2018, doi 10.5194/amt-11-5519-2018; WMO-No. 8 (2021), I.4 (vapour pressure)",
        "another speed of descent, a night, and a hover",
        warmer=lambda p, bins: _descending(p, bins) * p["film_over_bead_k"],
    ),
    Law(
        "warm_die",
        ("self_heating", "radiative_heating"),
        "humidity",
        (LawParameter("rise_k_at_5_m_s", "K", 0.0, 0.7, -10.0, 10.0, (0.7, 2.0), "rise at 5 m/s"),),
        "tau dq/dt = e / es(T + rise sqrt(5 m/s / v)) - q, T the bead's reading",
        "IST application note on the HYT-271; Miloshevich and others 2009, doi 10.1029/2008JD011565",
        f"{_AIRFLOW} in air that is not dry",
        warmer=_ventilated,
    ),
    Law(
        "late_die",
        ("die_thermal_lag",),
        "humidity",
        (
            LawParameter(
                "die_time_constant_s",
                "s",
                17.0,
                0.8,
                0.5,
                200.0,
                (5.0, 17.0, 50.0),
                "time constant of the chip",
                True,
            ),
        ),
        "tau dq/dt = e / es(T_die) - q, tau2 dT_die/dt = T - T_die, T the bead's reading",
        "Segales and others 2022; iMet-XQ2 flights, whose chips follow the air by 17 to 19 s",
        "a lapse or an inversion, passed upwards and downwards",
        warmer=_late,
        flown_as=BESIDE_BEAD,
    ),
)
_ALL_LAWS = (
    _CLOCK,
    *_of_each("temperature", 4.0, "K", 0.7),
    *_of_each("humidity", 8.0, "%RH", 3.0),
    *_OF_BEAD,
    *_OF_FILM,
)
LAWS: Mapping[str, Law] = MappingProxyType({law.name: law for law in _ALL_LAWS})
