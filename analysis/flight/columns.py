"""Which of two columns of a log holds the temperature and which the humidity, row by row.

A log is cut where a column jumps. What the pieces hold is told all at once: each is joined to what its quantity was
last, whatever lies between, and of all chains of pieces each counts by how likely its joins are. How far it went has
Cauchy's distribution, of the width of what the column usually goes in as many rows, jumps apart. A column goes away
from its place, or its unit, seldom; once there it comes back as it likes, so that a part of a log is one cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from shockrig.analysis.estimate.without_model import MAD_TO_SIGMA
from shockrig.analysis.flight.stretches import WINDOW_ROWS, scatter, stuck_rows
from shockrig.analysis.physics.humidity import saturation_pressure_hpa
from shockrig.files.ranges import RANGES

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Mask = NDArray[np.bool_]

CUT = 8.0  # times what a column usually goes, that it jumps by between two pieces
LEVEL_ROWS = 3  # at either end of a piece: single readings may be noise
CHANGE = 7.0  # nats against columns that change place, or unit
NOTHING = 16.0  # nats against a column that holds neither quantity from a jump on: a code, a burst
# nats against all of a log being so, and against a part of it by its share
ALL_NOTHING, ALL_WARM, ALL_ODD = 20.0, 24.0, 6.0  # odd: not in their usual place, exchanged usually, or in degF
EXPLAINED = 0.4  # of a jump of the humidity is left at most, where the temperature of the air explains it
WARM_C = 45.0  # few airs are flown in that are warmer
AIR_C, PERCENT = RANGES["temperature_c"], RANGES["humidity_reading_percent"]
SURE = 0.8  # probability of what is done with a row
CHAINS = 32  # that are followed at once: twice as many change nothing, half as many do

# What a piece may hold: whether the columns are exchanged, and which of both quantities is in degF: a unit goes with
# its quantity, or stays with the column that was converted; and whether exchanged is what they usually are in this log.
_HELD = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 1)]
KINDS = np.array([(*one, usually) for usually in (0, 1) for one in _HELD])
# and which of both quantities is read in it: `KIND` (o,), of each quantity `READ`, `COLUMN` and `DEGF` (2, o)
_OPTIONS = np.array([(kind, t, h) for kind in range(len(KINDS)) for t in (0, 1) for h in (0, 1)])
KIND, READ = _OPTIONS[:, 0], _OPTIONS[:, 1:].T == 1
COLUMN = np.stack([KINDS[KIND, 0], 1 - KINDS[KIND, 0]])
AWAY = KINDS[:, 0] != KINDS[:, 3]
DEGF = KINDS[KIND, 1:3].T == 1


@dataclass(frozen=True)
class _Pieces:
    """Of each piece (p,), its first `row`, and of its columns (2, p) the `count` of readings, the `warm` ones among
    them, and whether it `begins` with a jump and is `stuck`; how many readings are `no_humidity` (2, 2, p), as they
    came and from degF; and of both its ends (2, 2, p) the `level`, the rows `at`
    which it is, and the `noise` of the readings there; `settled` (2, p) is the level that a column comes to so many
    readings behind the piece's first row as lags take, in whatever piece that is."""

    row: Rows
    count: Rows
    warm: Rows
    no_humidity: Rows
    begins: Mask
    stuck: Mask
    level: Array
    at: Rows
    noise: Array
    settled: Array


@dataclass(frozen=True)
class _Chains:
    """Of each chain (c,) its `cost` in nats and its last `kind`; and of both quantities (2, c) the `level`, `row` and
    `noise` where it was last read, and the `source`: that piece and its kind, in one number; -1 before."""

    cost: Array
    kind: Rows
    level: Array
    row: Rows
    noise: Array
    source: Rows

    def at(self, some: Rows) -> _Chains:
        """Some of them."""
        of_both = self.level[:, some], self.row[:, some], self.noise[:, some], self.source[:, some]
        return _Chains(self.cost[some], self.kind[some], *of_both)


class _Usual:
    """How far a column's readings (n,) usually go within so many rows: no less than a step of the log, and without the
    jumps, which are what is to be told. It may have been read in every tenth row: what lies between two readings is
    told by how many readings on the second one is.

    Attributes: the `rows` (m,) that were read, the `noise` (m,) of the steps around each, and which of them `jumped`
    (m,): over a gap it may have gone anywhere, and changed its unit as well.
    """

    def __init__(self, values: Array, resolution: float) -> None:
        self.rows = rows = np.flatnonzero(np.isfinite(values))
        step = np.diff(values[rows], prepend=values[rows[0]])
        self.noise = MAD_TO_SIGMA * median_filter(np.abs(step), WINDOW_ROWS, mode="mirror")
        least = resolution or np.finfo(float).eps
        at_once = max(MAD_TO_SIGMA * float(np.median(np.abs(step[1:]))), least)
        # of noise whose scale so many readings tell, by Student's t: a part has two ends, each at half of its price
        in_noise = np.sqrt(WINDOW_ROWS * np.expm1(CHANGE / WINDOW_ROWS))
        self.jumped = np.abs(step) > np.maximum(CUT * at_once, in_noise * self.noise)
        going = np.cumsum(np.where(self.jumped, 0.0, step))
        self.lags, usual = [], []
        for on in 2 ** np.arange(int(np.log2(rows.size))):
            self.lags.append(float(np.median(rows[on:] - rows[:-on])))
            usual.append(MAD_TO_SIGMA * float(np.median(np.abs(going[on:] - going[:-on]))))
        self.usual = np.maximum.accumulate(np.maximum(usual, least))

    def __call__(self, rows: Rows) -> Array:
        return np.interp(rows, self.lags, self.usual)


@dataclass(frozen=True)
class ColumnsHold:
    """Rows (n,) in which columns are `exchanged`, and rows of which that is `unsure`; and rows (2, n) in which
    temperature and humidity, wherever they stand, are surely in `degf`, or a column surely holds `nothing`."""

    exchanged: Mask
    unsure: Mask
    degf: Mask
    nothing: Mask


def held(columns: Array, resolutions: Sequence[float]) -> ColumnsHold:
    """What the columns (2, n) for temperature and humidity hold. A log that is exchanged, or in degF, from its first
    row to its last is taken as it is: nothing tells."""
    none = np.zeros(columns.shape, dtype=bool)
    as_it_is = ColumnsHold(none[0], none[0], none, none)
    # of what either can be
    columns = np.where((columns >= AIR_C.low) & (columns <= 1.8 * AIR_C.high + 32.0), columns, np.nan)
    known = np.isfinite(columns)
    if np.count_nonzero(known, axis=1).min() < 2 * WINDOW_ROWS:
        return as_it_is
    usual = [_Usual(values, resolution) for values, resolution in zip(columns, resolutions, strict=True)]
    stuck = [_stuck(values, resolution) for values, resolution in zip(columns, resolutions, strict=True)]
    pieces = _pieces(columns, usual, np.stack(stuck))
    read = known.any(axis=0)
    lasting = np.diff(np.append(pieces.row, read.size))
    shares, nothing = (np.repeat(one, lasting, axis=1) for one in _shares(pieces, usual))
    share, in_degf = shares[KINDS[:, 0] == 1].sum(axis=0), KINDS[:, 1:3].T @ shares
    as_came = shares[~KINDS[:, :3].any(axis=1)].sum(axis=0)
    if not (as_came[read] > SURE).any():
        # the places are told but for which are which, and fewer are rather exchanged; or nothing is
        return as_it_is if (share[read] > 0.5).all() else ColumnsHold(share > 0.5, none[0], none, none)
    # where they are as near as that, either will do
    alike = np.abs(columns[1] - columns[0]) < CUT * max(one.usual[0] for one in usual)
    unsure = (np.abs(share - 0.5) < SURE - 0.5) & read & ~alike
    degf = in_degf > SURE
    # of columns that stay what they are, and were both read, what goes on from reading to reading tells more
    odd = (share > 0.5).any() | degf.any() | ~known.all(axis=0)
    return ColumnsHold(share > 0.5, unsure, degf, (nothing > SURE) & odd)


def _stuck(values: Array, resolution: float) -> Mask:
    """Rows (n,) at which a column stays as no sensor does that is alive."""
    rows = np.flatnonzero(np.isfinite(values))
    noise = scatter(values[rows])
    stuck = np.zeros(values.shape, dtype=bool)
    stuck[rows] = stuck_rows(values[rows], resolution, float(np.median(noise)), noise)
    return stuck


def _pieces(columns: Array, usual: list[_Usual], stuck: Mask) -> _Pieces:
    """The pieces between jumps of either column (2, n), and where the columns meet."""
    size = columns.shape[1]
    known, noises = [one.rows for one in usual], [one.noise for one in usual]
    jumps = [one.rows[one.jumped] for one in usual]
    cuts = [np.zeros(1, dtype=np.int64), *jumps, *(end for one in known for end in (one[:1], one[-1:] + 1))]
    # where they are as near as that, they may change place without a jump
    rows = np.intersect1d(known[0], known[1])
    apart = np.abs(columns[0, rows] - columns[1, rows])
    usually = max(most.usual[0] for most in usual)
    ends = np.flatnonzero(np.diff(apart < CUT * usually, prepend=False, append=False)).reshape(-1, 2)
    for near in (slice(*one) for one in ends.tolist()):
        met = np.flatnonzero(apart[near] <= usually)
        # or jump, each to where the other was
        here = columns[:, rows[near]]
        gone = (one[:, 1:] - here[:, :-1] for one in (here, here[::-1]))
        stays, passes = (np.log(one**2 + usually**2).sum(axis=0) for one in gone)
        jump = [int(np.argmax(stays - passes)) + 1] if (stays > passes).any() else []
        cuts.append(rows[near][[*met[:1], *met[-1:], *jump]])
    row = np.unique(np.concatenate(cuts))
    row = row[row < size]
    count, at = np.zeros((2, row.size), dtype=np.int64), np.zeros((2, 2, row.size), dtype=np.int64)
    level, noise, settled = np.zeros(at.shape), np.zeros(at.shape), np.zeros(count.shape)
    for q, (values, rows) in enumerate(zip(columns, known, strict=True)):
        start = np.searchsorted(rows, np.append(row, size))
        count[q] = np.diff(start)
        # of a shorter piece some count twice
        inside = np.minimum(np.arange(LEVEL_ROWS), np.maximum(count[q] - 1, 0)[:, None])
        for end, place in enumerate((start[:-1, None] + inside, start[1:, None] - 1 - inside)):
            some = np.clip(place, 0, rows.size - 1)
            level[end, q] = np.median(values[rows[some]], axis=1)
            at[end, q], noise[end, q] = rows[some[:, 0]], noises[q][some[:, 0]]
        late = np.minimum(start[:-1] + WINDOW_ROWS, rows.size)[:, None] - 1 - inside
        settled[q] = np.median(values[rows[np.maximum(late, 0)]], axis=1)
    none = ((one < PERCENT.low) | (one > PERCENT.high) for one in (columns, (columns - 32.0) / 1.8))
    marks = (columns > WARM_C, stuck, *none)
    warm, dead, *no_humidity = (np.add.reduceat(one, row, axis=1, dtype=np.int64) for one in marks)
    begins = np.stack([np.isin(row, one) for one in jumps])
    stays = (count > 0) & (dead == count)
    return _Pieces(row, count, warm, np.stack(no_humidity), begins, stays, level, at, noise, settled)


def _changes() -> Array:
    """Nats (kinds, o) against each option behind each kind."""
    in_column = np.where(KINDS[:, :1] == 1, KINDS[:, 2:0:-1], KINDS[:, 1:3])
    unit = [(one[:, None] < one[None]).any(axis=2) for one in (KINDS[:, 1:3], in_column)]
    nats = CHANGE * (1.0 * (AWAY & ~AWAY[:, None]) + (unit[0] & unit[1]))
    return np.where(KINDS[:, 3:] == KINDS[:, 3], nats, np.inf)[:, KIND]


def _shares(pieces: _Pieces, usual: list[_Usual]) -> tuple[Array, Array]:
    """Probability (kinds, p) of what each piece holds, and (2, p) that a column holds nothing, over all chains."""
    changes, total = _changes(), pieces.count.max(axis=0).sum()
    start = changes[~AWAY & ~KINDS[:, 1:3].any(axis=1)].min(axis=0) + ALL_ODD * KINDS[KIND, 3]
    unknown = np.full((2, 1), -1)
    chains = _Chains(np.zeros(1), np.full(1, -1), np.zeros((2, 1)), unknown, np.zeros((2, 1)), unknown)
    least = np.array([one.usual[0] for one in usual])
    steps, kinds, costs, reads = [], [], [], []
    for k in range(pieces.row.size):
        count = pieces.count[COLUMN, k]
        ends = (*pieces.level[:, COLUMN, k], pieces.settled[COLUMN, k])
        first, last, settled = (np.where(DEGF, (v - 32.0) / 1.8, v) for v in ends)
        (at_first, at_last), (before, behind) = pieces.at[:, COLUMN, k], pieces.noise[:, COLUMN, k]
        own = ALL_NOTHING * (count * ~READ).sum(axis=0) + ALL_WARM * pieces.warm[COLUMN[0], k] * (READ & ~DEGF)[0]
        own += ALL_ODD * count.max(axis=0) * (1.0 * DEGF.any(axis=0) + AWAY[KIND])
        own = own / total
        own[(READ & (count == 0)).any(axis=0)] = np.inf
        own[READ[1] & (2 * pieces.no_humidity[1 * DEGF[1], COLUMN[1], k] > count[1])] = np.inf
        begun = chains.kind[:, None] >= 0
        cost = chains.cost[:, None] + own + np.where(begun, changes[chains.kind], start)
        # of a column that was not read in the piece before, and does not jump
        unread = chains.source // len(KINDS) < k - 1
        for q, column in enumerate(COLUMN):
            since = np.maximum(at_first[q] - chains.row[q][:, None], 1)
            scale = np.where(column == 0, usual[0](since), usual[1](since))
            scale = np.maximum(scale, np.maximum(before[q], chains.noise[q][:, None]))
            # in the unit of the column's own readings, which have one that stays, or take it here
            was = KINDS[chains.source[q] % len(KINDS), 1 + q][:, None] == 1
            factor = np.where(DEGF[q] & was, 1.8, 1.0)
            gone = np.abs(first[q] - chains.level[q][:, None])
            if q:  # the humidity jumps with the air's temperature, which a thermometer shows a little later
                both = READ[0] & (chains.row[0][:, None] >= 0)
                beside = _beside_the_air(chains.level, first[1], settled[0])
                # what is hardly better is so by chance, and at each of many jumps
                gone = np.where(both & (beside < EXPLAINED * gone), beside, gone)
            size = np.hypot(factor * gone, scale)
            joined = np.log(size**2 / (scale * least[column])) + np.log(1.8) * (DEGF[q] & ~was)
            same = KINDS[chains.kind, 0][:, None] == COLUMN[0]
            jumps = pieces.begins[column, k] | (pieces.count[column, k - 1] == 0)
            # without a jump of its own a column keeps its unit: about -40 degrees only the humidity would tell
            joined = np.where(same & ~unread[q][:, None] & ~jumps & (DEGF[q] != was), np.inf, joined)
            goes_on = np.where(same, unread[q][:, None], unread[1 - q][:, None]) & begun & ~jumps
            # one that goes on has one end here, and not both
            nothing = np.where(goes_on, 0.5 * NOTHING, NOTHING)
            # a sensor that is stuck reads what it did before, or nothing
            nothing = np.where(pieces.stuck[column, k], 2.0 * np.log(CUT), nothing) * (count[q] > 0)
            cost += np.where(READ[q], np.where(chains.row[q][:, None] >= 0, joined, 0.0), nothing)
        i, j = np.nonzero(np.isfinite(cost))
        there = np.tile(len(KINDS) * k + KIND, (2, 1))
        own_last = ((last, chains.level), (at_last, chains.row), (behind, chains.noise), (there, chains.source))
        now = [np.where(READ[:, j], one[:, j], other[:, i]) for one, other in own_last]
        found = _Chains(cost[i, j], KIND[j], *now)
        kept, into = _merged(found)
        steps.append((i, found.cost - chains.cost[i], into))
        chains = kept
        kinds.append(chains.kind)
        reads.append(chains.source // len(KINDS) == k)
        costs.append(chains.cost)
    # and back from the end, from where each chain goes on
    behind_it = np.zeros(chains.cost.size)
    shares, nothing = np.zeros((len(KINDS), pieces.row.size)), np.zeros(pieces.count.shape)
    for k in range(pieces.row.size - 1, -1, -1):
        whole = costs[k] + behind_it
        weight = np.exp(whole.min() - whole)
        shares[:, k] = np.bincount(kinds[k], weight, len(KINDS)) / weight.sum()
        read = np.where(KINDS[kinds[k], 0] == 1, reads[k][::-1], reads[k])  # of the columns
        nothing[:, k] = ~read @ weight / weight.sum()
        i, step, into = steps[k]
        ahead = np.where(into >= 0, step + behind_it[into], np.inf)
        behind_it = _together(ahead, i, int(costs[k - 1].size) if k else 1)
    return shares, nothing


def _beside_the_air(before: Array, humidity: Array, air_c: Array) -> Array:
    """How far (c, o) a humidity (o,) is from what the vapour of `before` (2, c), temperature first, makes of it in air
    of another temperature (o,)."""
    was, now = (saturation_pressure_hpa(np.clip(one, AIR_C.low, AIR_C.high)) for one in (before[0], air_c))
    return np.asarray(np.abs(humidity - (before[1] * was)[:, None] / now))


def _together(cost: Array, group: Rows, count: int) -> Array:
    """Nats (`count`,) against any of those (n,) in each group; infinite where none goes on."""
    least = np.full(count, np.inf)
    np.minimum.at(least, group, cost)
    base = np.where(np.isfinite(least), least, 0.0)
    weight = np.bincount(group, np.exp(base[group] - cost), count)
    return base - np.log(weight, out=np.full(count, -np.inf), where=weight > 0.0)


def _merged(chains: _Chains) -> tuple[_Chains, Rows]:
    """The likeliest of some chains (c,), those that go on alike as one, and into which each went, or -1: into none."""
    base = int(chains.source.max()) + 2
    alike = (chains.kind * base + chains.source[0] + 1) * base + chains.source[1] + 1
    _, first, group = np.unique(alike, return_index=True, return_inverse=True)
    cost = _together(chains.cost, group, first.size)
    order = np.argsort(cost, kind="stable")[:CHAINS]
    into = np.full(first.size, -1)
    into[order] = np.arange(order.size)
    return replace(chains.at(first[order]), cost=cost[order]), into[group]
