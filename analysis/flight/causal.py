"""The method causal of `correct`: a flight's rows through the causal corrector one by one, as on board."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from shockrig.analysis.flight.causal_bank import Bank, MixtureEstimate, surely
from shockrig.analysis.flight.causal_design import ChannelDesign, Design, design_of
from shockrig.analysis.flight.causal_guard import CODES_WITHIN, Guard, Judged
from shockrig.analysis.flight.doubts import profile_doubts
from shockrig.analysis.flight.flight_channel import LONGEST_FILL_S, LONGEST_REPEAT_S
from shockrig.analysis.flight.screen import FEWEST_ROWS, GAP_PERIODS, LONGEST_GAP_S
from shockrig.analysis.flight.smooth_channel import typical_period
from shockrig.analysis.flight.undo_readout import not_causal, not_undone
from shockrig.analysis.physics.air_exchange import REFERENCE_AIRFLOW_M_S
from shockrig.analysis.physics.humidity import STANDARD_PRESSURE_HPA, saturation_pressure_hpa, saturation_slope
from shockrig.files.errors import InputError
from shockrig.files.flight import FLAGS, Corrected, Flight
from shockrig.files.numbers import counted
from shockrig.files.profile import Profile
from shockrig.files.ranges import RANGES

Array = NDArray[np.float64]

# A flight corrected while it is flown: each row when it comes, or after a fixed wait.
#
# Per row: the clock, the guards of both readings (`causal_guard`), temperature through its filters (`causal_bank`),
# then humidity, as vapour at the corrected temperature, through its own. What a generated program does is this, row
# by row.

START_K, START_PERCENT = 2.0, 10.0  # within which a sensor is of the air at a start, and the slope [1/s] of nothing
REFERENCE_C = 20.0  # vapour is carried as relative humidity at this temperature
FAR_C = 25.0  # beyond its table, where humidity is the reading, vapour is reckoned so far and no farther
UNREAD_S = 3.0  # without a thermometer for so long, or so many periods if that is longer,
UNREAD_PERIODS = 5.0  # a hygrometer's reading is none of vapour
AIR_PERCENT = RANGES["humidity_set_percent"]
VAPOUR_PER_K = 0.1  # of the vapour, that eddies carry with a kelvin: within a factor of two in most kinds of air
TEMPERATURE_C = RANGES["temperature_c"]
NOTHING = Judged(usable=False, missing=True)
STRAY = Judged(usable=False, implausible=True)


@dataclass(frozen=True)
class Row:
    """One row of a log; NaN where a value is missing."""

    time_s: float
    temperature_c: float
    humidity_percent: float
    airspeed_m_s: float = np.nan
    pressure_hpa: float = np.nan
    die_temperature_c: float = np.nan


@dataclass(frozen=True)
class Value:
    """One channel of one row: the air, its standard uncertainty and the part of it that is common to the flight, NaN
    where nothing can be given; what was found of the reading; `as_read`: the reading itself is given."""

    value: float
    uncertainty: float
    common: float
    judged: Judged
    outside: bool = False
    as_read: bool = False


@dataclass
class _Told:
    """One channel of a row on its way: what was found of its reading, and what the filters knew when it came."""

    judged: Judged = STRAY
    kept: int = -1
    air: MixtureEstimate | None = None
    clean: float = np.nan
    slow: tuple[float, ...] = ()
    relative: float = 0.0
    readout: float = 0.0
    since_used_s: float = np.inf
    since_read_s: float = np.inf
    step: float = 0.0


@dataclass
class _Seen:
    """A row on its way."""

    row: Row
    time_s: float = np.nan
    step_s: float = 0.0
    begins: bool = False
    airspeed: float = REFERENCE_AIRFLOW_M_S
    pressure: float = STANDARD_PRESSURE_HPA
    unsure: bool = False
    bead: _Told = field(default_factory=_Told)
    film: _Told = field(default_factory=_Told)
    now: MixtureEstimate = field(default_factory=lambda: surely(np.nan))  # temperature that humidity was reckoned with,
    now_c: float = np.nan  # within the profile's table
    back: float = np.nan  # from what the film holds to humidity
    at_die: bool = False


class CausalChannel:
    """One sensor on its way: its guard, its filters, and when it was last read."""

    def __init__(
        self, design: ChannelDesign, quantity: str, passing: bool, wait: int, spread: float, period_s: float
    ) -> None:
        self.design, self.spread, self.period_s = design, spread, period_s
        self.guard = Guard(design, CODES_WITHIN[quantity])
        self.bank = Bank(design.ladder, design.modes, passing, wait)
        self.forget()

    def forget(self) -> None:
        """Before a start."""
        self.started = False
        self.guard.reset()
        self.used_s = self.read_s = self.time_s = -np.inf

    def take(
        self,
        told: _Told,
        seen: _Seen,
        reading: float,
        air_c: float,
        own_c: float,
        unit: float,
        passing: float = 0.0,
        speed: float = 1.0,
        alike: float = 0.0,
        strength: float | None = None,
        usable: bool = True,
    ) -> None:
        """Step to a row and take its reading in.

        Parameters
        ----------
        air_c, own_c : float
            Temperatures that the lags, and the readout, are of.
        unit : float
            Of the filters over the reading's.
        passing : float
            Standard deviation of what passes sensor and air alike, in the filters' unit.
        alike : float
            Standard deviation of what goes through readings from row to row as noise would, and is none.
        usable : bool
            Whether a reading can say anything.
        """
        d, bank = self.design, self.bank
        table = d.response.at(air_c, seen.airspeed, seen.pressure)
        weight, rate = table[: d.modes], np.exp(table[d.modes : 2 * d.modes])
        offset, gain, told.readout = (float(v) for v in d.readout.at(own_c, seen.airspeed, seen.pressure))
        told.relative = float(np.hypot(table[-1], d.unsure_of_airspeed if seen.unsure else 0.0))
        shown, open_to, bank.unit = reading, 0.0, unit
        if self.started:
            step_s = seen.time_s - self.time_s
            bank.predict(step_s, weight, rate, passing, speed, d.parts(step_s), strength)
            expected, variance = bank.expected()
            shown, open_to = (expected / unit - offset) / gain, float(np.sqrt(variance)) / (gain * unit)
        self.time_s = seen.time_s
        told.judged = judged = self.guard.judge(reading if usable else np.nan, shown, open_to, alike)
        if judged.usable or judged.repeated:
            self.read_s = seen.time_s
        if judged.usable:
            self.used_s = seen.time_s
            level = (offset + gain * reading) * unit
            if judged.restart or not self.started:
                bank.start(level, self.spread, weight, passing, speed, strength)
                self.started = True
            bank.update(level, judged.variance * (gain * unit) ** 2)
        told.since_used_s, told.since_read_s = seen.time_s - self.used_s, seen.time_s - self.read_s
        told.step = self.guard.resolution * gain * unit if self.guard.coarse else 0.0
        if self.started:
            told.kept = bank.keep()
            told.clean, lags = bank.lagging()
            told.slow = tuple(lags[d.modes - d.slow :].tolist())
            told.air = self.air(told.kept)

    def resolved_rate(self) -> float:
        """Angular frequency above which the air is not resolved now [1/s]."""
        rates, ladder = np.log(self.design.resolved_rate), self.design.ladder
        nodes = np.linspace(np.log(ladder.lowest), np.log(ladder.highest), rates.size)
        return float(np.exp(np.interp(np.log(self.bank.middle), nodes, rates)))

    def air(self, kept: int, late_s: float = 0.0) -> MixtureEstimate | None:
        """The air `late_s` before the row that was `kept` under that number; None where that is of before a start."""
        bank = self.bank
        if not self.started or kept < bank.first:
            return None
        rows = bank.count - 1 - kept
        behind_s = rows * self.period_s + late_s - self.design.delay_s
        return bank.ahead(-behind_s) if behind_s < 0.0 else bank.ago(round(behind_s / self.period_s))

    def common(self, told: _Told, air: float) -> float:
        """What the sensor's time scale and slow shares leave of the air, standard uncertainty."""
        left = (told.relative * (air - told.clean)) ** 2
        for share, lag in zip(self.design.slow_uncertainty, told.slow, strict=True):
            left += (share * (air - lag)) ** 2
        return float(np.sqrt(left))


class Corrector:
    """Corrects rows one by one: a life from the first row of a flight to the last.

    Parameters
    ----------
    design : Design
    lag_s : float
        How long an estimate waits for readings behind it.
    share : float
        Of that, the temperature has so much before humidity is reckoned with it, humidity the rest.
    """

    def __init__(self, design: Design, lag_s: float = 0.0, share: float = 0.5) -> None:
        self.design = design
        self.wait = round(lag_s / design.period_s)
        t, h = design.temperature, design.humidity
        self.after = round(share * self.wait) if t is not None and h is not None else 0
        late = 0 if h is None else round(h.delay_s / design.period_s)
        self.bead = (
            None if t is None else CausalChannel(t, "temperature", False, self.wait + late, START_K, design.period_s)
        )
        rest = self.wait - self.after
        self.film = None
        if h is not None:
            self.film = CausalChannel(h, "humidity", not design.by_activity, rest, START_PERCENT, design.period_s)
        self.on_the_way: deque[_Seen] = deque()
        self.unreckoned: deque[_Seen] = deque()
        self.time_s = self.stray_s = -np.inf
        self.strays = 0
        self.airspeed = self.pressure = self.reading_c = np.nan
        self.before_c = self.last_c = np.nan

    def step(self, row: Row) -> list[tuple[Value, Value]]:
        """Take a row in; temperature and humidity of the rows that are given now, oldest first: with a wait of N rows
        that is the one N before."""
        seen, given = _Seen(row), []
        if self._in_order(seen):
            if seen.begins:
                given = self.flush()
                for channel in (self.bead, self.film):
                    if channel is not None:
                        channel.forget()
                self.before_c = self.last_c = np.nan
            self._surroundings(seen)
            self._warm(seen)
            self.unreckoned.append(seen)
        self.on_the_way.append(seen)
        while len(self.unreckoned) > self.after:
            self._humid(self.unreckoned.popleft())
        while len(self.on_the_way) > self.wait:
            given.append(self._oldest())
        return given

    def flush(self) -> list[tuple[Value, Value]]:
        """The rows that are still on their way, at a flight's end or before a gap: each before the hygrometer's filters
        have gone past it, which remember their own part of the wait."""
        given, remembered = [], self.wait - self.after
        while self.on_the_way:
            if self.unreckoned and len(self.on_the_way) - len(self.unreckoned) <= remembered:
                self._humid(self.unreckoned.popleft())
            else:
                given.append(self._oldest())
        return given

    def _oldest(self) -> tuple[Value, Value]:
        seen = self.on_the_way.popleft()
        if self.unreckoned and self.unreckoned[0] is seen:  # rows out of time were on their way behind it
            self._humid(self.unreckoned.popleft())
        return self._given(seen)

    def _in_order(self, seen: _Seen) -> bool:
        """The clock: whether a row follows the ones before. One that does not is out of place, unless more follow it;
        beyond a long gap nothing is known of before."""
        time_s = seen.row.time_s
        if not np.isfinite(time_s):
            return False
        longest = max(LONGEST_GAP_S, GAP_PERIODS * self.design.period_s)
        ahead = time_s - self.time_s
        if ahead <= 0.0:
            self.strays = self.strays + 1 if 0.0 < time_s - self.stray_s <= longest else 1
            self.stray_s = time_s
            if self.strays < FEWEST_ROWS:
                return False
        seen.begins = not 0.0 < ahead <= longest
        self.strays, self.stray_s = 0, -np.inf
        self.time_s = seen.time_s = time_s
        return True

    def _surroundings(self, seen: _Seen) -> None:
        """Airspeed and pressure, held where a row has none."""
        row = seen.row
        if RANGES["airflow_m_s"].holds(row.airspeed_m_s):
            self.airspeed = row.airspeed_m_s
        if RANGES["pressure_hpa"].holds(row.pressure_hpa):
            self.pressure = row.pressure_hpa
        if TEMPERATURE_C.holds(row.temperature_c):
            self.reading_c = row.temperature_c
        seen.unsure = not np.isfinite(self.airspeed)
        seen.airspeed = REFERENCE_AIRFLOW_M_S if seen.unsure else self.airspeed
        seen.pressure = self.pressure if np.isfinite(self.pressure) else STANDARD_PRESSURE_HPA

    def _warm(self, seen: _Seen) -> None:
        """The thermometer's part of a row."""
        raw, told = seen.row.temperature_c, seen.bead
        if self.bead is not None:
            # the reading itself, which may be absurd, is no place in a table
            shown = self.bead.bank.lagging()[0] if self.bead.started else self.reading_c
            shown = shown if np.isfinite(shown) else REFERENCE_C
            self.bead.take(told, seen, raw, shown, shown, 1.0)
            return
        held = TEMPERATURE_C.holds(raw)
        told.judged = Judged(usable=held, missing=not np.isfinite(raw), implausible=bool(np.isfinite(raw)) and not held)
        if held:
            told.air, told.since_used_s, told.since_read_s = surely(raw), 0.0, 0.0

    def _humid(self, seen: _Seen) -> None:
        """The hygrometer's part of a row, at the temperature that is known by now."""
        film, row = self.film, seen.row
        if film is None:
            return
        now, then = seen.bead.air, seen.bead.air
        if self.bead is not None and now is not None:
            now = self.bead.air(seen.bead.kept) or now
            then = self.bead.air(seen.bead.kept, film.design.delay_s) or now
        if now is None or then is None:
            seen.film.judged = NOTHING
            return
        coldest, warmest = film.design.covers_c[0] - FAR_C, film.design.covers_c[1] + FAR_C
        die_c = row.die_temperature_c
        if self.design.beside_bead and self.bead is not None:
            die_c = self.bead.bank.expected()[0]  # without the noise
        read = TEMPERATURE_C.holds(die_c)
        now_c, then_c, die_c = (
            min(max(one, coldest), warmest) for one in (now.value, then.value, die_c if read else now.value)
        )
        share = self.design.die_share
        seen.at_die = share > 0.0 and read
        own = _saturation(then_c + share * (die_c - then_c) if seen.at_die else then_c)
        held = own if self.design.by_activity else _saturation(REFERENCE_C)
        seen.now, seen.now_c, seen.back = now, now_c, held / _saturation(now_c)
        bend = abs(now_c - 2.0 * self.last_c + self.before_c) / 2.0
        self.before_c, self.last_c = self.last_c, now_c
        passing, alike, strength = 0.0, 0.0, None
        level = film.bank.expected()[0] if film.started else row.humidity_percent * own / held
        if self.bead is not None and np.isfinite(level):
            strength = VAPOUR_PER_K * abs(level) * self.bead.bank.middle
        if not seen.at_die and not self.design.by_activity:
            error = float(np.hypot(np.sqrt(now.variance), bend if np.isfinite(bend) else 0.0))
            steep = float(saturation_slope(now_c))
            passing = abs(level) * steep * error if np.isfinite(level) else 0.0
            if self.bead is not None and np.isfinite(level):
                alike = abs(level) * held / own * steep * self.bead.bank.wobble(self.design.period_s)
        read_lately = seen.bead.since_read_s <= max(UNREAD_S, UNREAD_PERIODS * self.design.period_s)
        film.take(
            seen.film,
            seen,
            row.humidity_percent,
            now_c,
            die_c if read else now_c,
            own / held,
            passing,
            1.0 if self.bead is None else self.bead.resolved_rate(),
            alike,
            strength,
            read_lately,
        )

    def _given(self, seen: _Seen) -> tuple[Value, Value]:
        return self._temperature(seen), self._humidity(seen)

    def _temperature(self, seen: _Seen) -> Value:
        told, raw = seen.bead, seen.row.temperature_c
        if self.bead is None:
            return Value(raw if told.judged.usable else np.nan, np.nan, np.nan, told.judged, as_read=True)
        found = self.bead.air(told.kept) or told.air
        if found is None or _stale(told):
            return Value(np.nan, np.nan, np.nan, told.judged)
        left = self.bead.design.left
        common = float(np.hypot(self.bead.common(told, found.value), np.hypot(told.readout, left)))
        own = max(found.stated, told.step**2 / 12.0)
        value = float(np.clip(found.value, TEMPERATURE_C.low, TEMPERATURE_C.high))
        farthest = TEMPERATURE_C.farthest(value)
        total = float(np.hypot(np.sqrt(own), common))
        return Value(value, min(total, farthest), min(common, farthest), told.judged)

    def _humidity(self, seen: _Seen) -> Value:
        told, raw, film = seen.film, seen.row.humidity_percent, self.film
        if film is None:
            held = RANGES["humidity_reading_percent"].holds(raw)
            judged = Judged(usable=held, missing=not np.isfinite(raw), implausible=bool(np.isfinite(raw)) and not held)
            return Value(raw if held else np.nan, np.nan, np.nan, judged, as_read=True)
        found = film.air(told.kept) or told.air
        if found is None or _stale(told):
            return Value(np.nan, np.nan, np.nan, told.judged)
        value = found.value * seen.back
        of_readout = float(np.hypot(told.readout, film.design.left))
        shared = film.common(told, found.value) * seen.back
        own = max(found.stated, told.step**2 / 12.0) * seen.back**2 + shared**2
        if seen.at_die or self.design.by_activity:
            own += (value * float(saturation_slope(seen.now_c))) ** 2 * seen.now.stated
        low, high = film.design.covers_c
        if not low <= seen.now_c <= high:
            # the profile does not speak for such air: the reading, as unsure as what the correction would have made
            if not (told.judged.usable or told.judged.repeated):
                return Value(np.nan, np.nan, np.nan, told.judged, outside=True)
            away, farthest = raw - value, AIR_PERCENT.farthest(raw)
            total, common = (float(np.sqrt(one + of_readout**2 + away**2)) for one in (own, shared**2))
            return Value(raw, min(total, farthest), min(common, farthest), told.judged, True, True)
        value = float(np.clip(value, AIR_PERCENT.low, AIR_PERCENT.high))
        sigma = float(np.hypot(min(float(np.sqrt(own)), AIR_PERCENT.farthest(value)), of_readout))
        return Value(value, sigma, float(np.hypot(shared, of_readout)), told.judged)


def _stale(told: _Told) -> bool:
    """Whether the last reading that was used is so long ago that no value is given."""
    return told.since_used_s > LONGEST_FILL_S and not (told.judged.repeated and told.since_used_s <= LONGEST_REPEAT_S)


def _saturation(temperature_c: float) -> float:
    return float(saturation_pressure_hpa(temperature_c))


LONGEST_LAG_S = 60.0  # longer is what the smoother is for
MOST_WAITING = 600  # rows


def causal(
    flight: Flight,
    profile: Profile,
    lag_s: float = 0.0,
    temperature_noise_k: float | None = None,
    humidity_noise_percent: float | None = None,
) -> Corrected:
    """Correct a flight row by row, each with what came before and in the `lag_s` after it.

    Raises
    ------
    InputError
        Fewer than two rows with times that run forward, a wait that is too long, or a readout that cannot be tabulated.
    """
    time_s = flight.time_s
    known = time_s[np.isfinite(time_s)]
    if known.size < 2 or not np.any(np.diff(known) > 0):
        raise InputError("time_s: fewer than two rows with times that run forward; give a log with a clock in seconds")
    period = typical_period(known)
    if not 0.0 <= lag_s <= LONGEST_LAG_S or lag_s > MOST_WAITING * period:
        longest = min(LONGEST_LAG_S, MOST_WAITING * period)
        raise InputError(f"a lag of {lag_s:g} s: expected 0 to {longest:g} s; more is what the smoother is for")
    design = design_of(profile, period, temperature_noise_k, humidity_noise_percent)
    if not np.isfinite(flight.temperature_c).any():
        design = replace(design, humidity=None)  # what is not known to be vapour is given as it came
    corrector = Corrector(design, lag_s)
    given: list[tuple[Value, Value]] = []
    for row in rows_of(flight):
        given += corrector.step(row)
    given += corrector.flush()
    return gathered(given, design, lag_s, _notes(profile, design, given, flight))


def rows_of(flight: Flight) -> list[Row]:
    """A flight's rows as the corrector takes them."""
    columns = (
        flight.time_s,
        flight.temperature_c,
        flight.humidity_percent,
        flight.airspeed_m_s,
        flight.pressure_hpa,
        flight.die_temperature_c,
    )
    return [Row(*values) for values in zip(*(column.tolist() for column in columns), strict=True)]


def gathered(given: list[tuple[Value, Value]], design: Design, lag_s: float, notes: list[str]) -> Corrected:
    """Values row by row as a corrected flight."""
    bead, film = ([pair[place] for pair in given] for place in (0, 1))

    def of(values: list[Value], one: Callable[[Value], float]) -> Array:
        return np.array([one(value) for value in values], dtype=float)

    def said(one: Callable[[Value], bool]) -> NDArray[np.bool_]:
        return np.array([any(one(value) for value in pair) for pair in given], dtype=bool)

    flags = {name: np.zeros(len(given), dtype=bool) for name in FLAGS}
    present = [i for i, values in enumerate((bead, film)) if any(not v.judged.missing for v in values)]
    given = [tuple(pair[i] for i in present) for pair in given]  # type: ignore[misc]
    flags["gap"] = said(lambda v: v.judged.missing)
    flags["repeated"] = said(lambda v: v.judged.repeated)
    flags["implausible"] = said(lambda v: v.judged.implausible)
    flags["outside_profile"] = said(lambda v: v.outside)
    as_read = [np.array([v.as_read and np.isfinite(v.value) for v in values], dtype=bool) for values in (bead, film)]
    corrected = [
        np.array([not v.as_read and np.isfinite(v.value) for v in values], dtype=bool) for values in (bead, film)
    ]
    all_read = np.logical_or(*as_read) & ~np.logical_or(*corrected)
    flags["not_corrected"] = all_read
    for name, read in zip(("temperature", "humidity"), as_read, strict=True):
        flags[f"{name}_not_corrected"] = read & ~all_read
    channels: tuple[tuple[str, ChannelDesign | None], ...] = (
        ("temperature", design.temperature),
        ("humidity", design.humidity),
    )
    return Corrected(
        of(bead, lambda v: v.value),
        of(bead, lambda v: v.uncertainty),
        of(film, lambda v: v.value),
        of(film, lambda v: v.uncertainty),
        flags,
        tuple(notes),
        {name: None for name, _ in channels},
        {"temperature": of(bead, lambda v: v.common), "humidity": of(film, lambda v: v.common)},
        {name: float(np.pi / one.resolved_rate[0]) for name, one in channels if one is not None},
    )


def _notes(profile: Profile, design: Design, given: list[tuple[Value, Value]], flight: Flight) -> list[str]:
    notes = profile_doubts(profile)
    for name, part in (("temperature", profile.temperature), ("humidity", profile.humidity)):
        if part is None:
            notes.append(f"{name}: given as it came: the profile has no {name} part")
        else:
            notes += not_undone(part.effects, name, part.discovered, not_causal)
    if profile.humidity is not None and design.humidity is None and np.isfinite(flight.humidity_percent).any():
        notes.append("humidity: given as it came: no temperature of the air in the log")
    for one, name in ((design.temperature, "temperature"), (design.humidity, "humidity")):
        if one is not None and one.unsure_of_airspeed and not np.isfinite(flight.airspeed_m_s).any():
            notes.append(f"no airspeed in the log: {name} taken at 5 m/s")
    if design.die_share and not design.beside_bead and not np.isfinite(flight.die_temperature_c).any():
        notes.append("humidity: the profile asks for the die's temperature and the log has none; the air's is taken")
    for place, name in ((0, "temperature"), (1, "humidity")):
        count = sum(pair[place].outside for pair in given)
        if count:
            notes.append(f"{name}: {counted(count, 'row')} outside the profile's table, given as they came")
    return notes
