"""Tracks of each radar alone and of all together, and the former fused at common instants."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tertia import fusion
from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.metrics._evaluation import Rows
from tertia.sensors import Radar
from tertia.tracker import Plots, PlotStatus, TrackTable

Run = Callable[[Plots, Sequence[Radar]], TrackTable]

# so many of its radar's periods after its last plot a track says something: one may be missed
_AGE = 2.5
# metres per second squared: what a target may do since its last plot, straight on and in a turn
_STRAIGHT, _TURN = 0.1, 3.0
# instants of tracks that are fused at most
_INSTANTS = 20_000


def alone(plots: Plots, radars: Sequence[Radar], k: int, run: Run) -> TrackTable:
    """Return the tracks of one radar, numbered as all plots and all radars are."""
    own = np.flatnonzero(plots.sensor == k)
    part = plots[own]
    mine = Plots(part.time, part.range, part.azimuth, height=part.height, identity=part.identity)
    table = run(mine, [radars[k]])
    statuses = np.full(len(plots), int(PlotStatus.INVALID))
    statuses[own] = table.track_of_plot
    return replace(
        table,
        sensor=np.full(len(table), k),
        plot=np.where(table.plot >= 0, own[table.plot], -1) if len(own) else table.plot,
        track_of_plot=statuses,
    )


def confirmed_rows(table: TrackTable) -> Rows:
    """Return the rows of confirmed tracks, as they are judged."""
    own = table[table.confirmed]
    return Rows(
        own.time,
        own.track,
        own.sensor,
        own.position,
        own.velocity,
        own.covariance[:, :2, :2],
        own.plot >= 0,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Common:
    """What the radars' tracks say of targets at common instants.

    M instants of targets, K radars: `state` (M, K, 4) and `covariance` (M, K, 4, 4), nan where a
    radar has no track; `joint_state` and `joint_covariance` are those of the tracks of all radars,
    `track` their numbers.
    """

    time: FloatArray
    track: IntArray
    state: FloatArray
    covariance: FloatArray
    joint_state: FloatArray
    joint_covariance: FloatArray

    @property
    def there(self) -> BoolArray:
        """Which radars have a track, (M, K)."""
        return np.asarray(np.isfinite(self.state[..., 0]))

    def chosen(self, index: BoolArray) -> Common:
        """Return some of the instants."""
        return Common(*(getattr(self, name)[index] for name in self.__slots__))


def common(joint: TrackTable, single: Sequence[TrackTable], radars: Sequence[Radar]) -> Common:
    """Bring the tracks of single radars together, at instants of the slowest radar's period.

    A track of a radar belongs to the joint track that has most of its plots, more than half.
    """
    periods = [radar.scan_period for radar in radars]
    step = max(periods)
    partners = [_partners(table, joint) for table in single]
    targets = np.unique(joint.track[joint.confirmed])
    slowest = _AGE * max(periods)
    rows = {int(j): _rows_of(joint, [int(j)], slowest) for j in targets}
    rows = {j: own for j, own in rows.items() if len(own)}
    spans = [(joint.time[own[0]], joint.time[own[-1]]) for own in rows.values()]
    expected = sum((last - first) / step for first, last in spans)
    step *= max(1.0, expected / _INSTANTS)
    parts: list[tuple[FloatArray, ...]] = []
    for (j, own), (first, last) in zip(rows.items(), spans, strict=True):
        instants = np.arange(np.ceil(first / step), np.floor(last / step) + 1) * step
        told = _at(joint, own, instants, slowest)
        others = [
            _at(table, _rows_of(table, which.get(j, []), _AGE * period), instants, _AGE * period)
            for table, which, period in zip(single, partners, periods, strict=True)
        ]
        state = np.stack([one[0] for one in others], axis=1)
        spread = np.stack([one[1] for one in others], axis=1)
        kept = np.isfinite(told[0][:, 0]) & (np.isfinite(state[..., 0]).sum(axis=1) > 1)
        number = np.full(len(instants), float(j))
        parts.append(tuple(x[kept] for x in (instants, number, state, spread, *told)))
    if not parts:
        empty, k = np.zeros(0), len(radars)
        shapes = (empty.reshape(0, k, 4), empty.reshape(0, k, 4, 4))
        return Common(empty, empty.astype(np.int64), *shapes, shapes[0][:, 0], shapes[1][:, 0])
    time, number, *rest = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Common(time, number.astype(np.int64), *rest)


def _partners(table: TrackTable, joint: TrackTable) -> dict[int, list[int]]:
    """Return the tracks of one radar that belong to each joint track."""
    found: dict[int, list[int]] = {}
    used = table.plot >= 0
    if not np.any(used):
        return found
    theirs = joint.track_of_plot[table.plot[used]]
    mine = table.track[used]
    order = np.argsort(mine, kind="stable")
    names, starts = np.unique(mine[order], return_index=True)
    for name, numbers in zip(names, np.split(theirs[order], starts[1:]), strict=True):
        which, counts = np.unique(numbers, return_counts=True)
        best = int(np.argmax(counts))
        if which[best] >= 0 and 2 * counts[best] > len(numbers):
            found.setdefault(int(which[best]), []).append(int(name))
    return found


def _rows_of(table: TrackTable, tracks: Sequence[int], age: float) -> IntArray:
    """Return the rows of some tracks in order of time: confirmed, and soon after their plots."""
    own = np.flatnonzero(np.isin(table.track, tracks) & table.confirmed)
    own = own[np.argsort(table.time[own], kind="stable")]
    last = np.maximum.accumulate(np.where(table.plot[own] >= 0, table.time[own], -np.inf))
    return own[table.time[own] - last <= age]


def _at(
    table: TrackTable, rows: IntArray, instants: FloatArray, age: float
) -> tuple[FloatArray, FloatArray]:
    """Return states and covariances, straight on from the last row; nan where that is too old."""
    n = len(instants)
    if not len(rows):
        return np.full((n, 4), np.nan), np.full((n, 4, 4), np.nan)
    last = np.searchsorted(table.time[rows], instants, side="right") - 1
    row = rows[np.maximum(last, 0)]
    ahead = instants - table.time[row]
    gone = (last < 0) | (ahead > age)
    state, covariance = extrapolated(table, row, np.where(gone, 0.0, ahead))
    state[gone], covariance[gone] = np.nan, np.nan
    return state, covariance


def extrapolated(
    table: TrackTable, row: IntArray, ahead: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return rows some seconds later: straight on, with what the target may do meanwhile."""
    n = len(row)
    move = np.tile(np.eye(4), (n, 1, 1))
    move[:, [0, 1], [2, 3]] = ahead[:, np.newaxis]
    state = np.hstack([table.position[row], table.velocity[row]])
    turning = table.turn_probability[row]
    variance = (1.0 - turning) * _STRAIGHT**2 + turning * _TURN**2
    push = np.zeros((n, 4, 2))
    push[:, [0, 1], [0, 1]] = (ahead**2 / 2)[:, np.newaxis]
    push[:, [2, 3], [0, 1]] = ahead[:, np.newaxis]
    noise = variance[:, np.newaxis, np.newaxis] * (push @ np.swapaxes(push, 1, 2))
    moved = move @ table.covariance[row] @ np.swapaxes(move, 1, 2) + noise
    return (move @ state[..., np.newaxis])[..., 0], (moved + np.swapaxes(moved, 1, 2)) / 2


@dataclass(frozen=True, slots=True, eq=False)
class Combined:
    """Tracks of single radars fused: state (M, 4), covariance, weights (M, K) in position."""

    state: FloatArray
    covariance: FloatArray
    weight: FloatArray
    p_value: FloatArray


def combine(told: Common, method: fusion.InstantMethod) -> Combined:
    """Fuse what the radars say at each instant; a weight is the mean of those east and north."""
    found = fusion.fuse(told.state, told.covariance, method=method)
    weight = np.trace(found.weights[..., :2, :2], axis1=-2, axis2=-1) / 2
    weight[~told.there] = np.nan
    return Combined(found.mean, found.covariance, weight, np.asarray(found.pvalue))
