"""Search for systematic errors that are far larger than expected, by tracks of single radars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray, IntArray
from tertia.sensors import Bias
from tertia.sensors._identities import COLUMNS as IDENTITIES
from tertia.sensors._sensors import own_biases
from tertia.tracker._biases import are_placed, bias_of, columns_of
from tertia.tracker._sensors import Sensor, core_sensors, interval
from tertia.tracker._table import TrackTable

# a track says something for so many scan periods after its last plot
_AGE = 2.5
# acceleration of a target since its last plot, straight on and in a turn, m/s2
_STRAIGHT, _TURN = 0.1, 3.0


def start(
    alone: Sequence[TrackTable], sensors: Sequence[Sensor]
) -> tuple[Bias, FloatArray, IntArray]:
    """Return initial values of the errors, and the sigmas of their prior distribution.

    The tracks of the single sensors are compared at the time at which the largest number of pairs
    can be compared. The function also returns the sigmas after the comparison, (K, 4), and the
    number of targets that each sensor has in common with other sensors, (K,).
    """
    prior, placed = own_biases(sensors), are_placed(sensors)
    sigma = columns_of(prior, "_sigma")
    # far too large are only the errors of radars
    searched = sigma.copy()
    searched[placed, :3] = 0.0
    tables = [table[table.confirmed] for table in alone]
    ages = [_AGE * interval(one) for one in sensors]
    time = _time_of_most_pairs(tables, ages)
    if time is None:
        return prior, sigma, np.zeros(len(sensors), dtype=np.int64)
    tracks = [
        _at(table, time, k, age) for k, (table, age) in enumerate(zip(tables, ages, strict=True))
    ]
    joined: dict[str, Any] = {
        name: np.concatenate([one[name] for one in tracks]) for name in tracks[0]
    }
    joined["identities"] = tuple(joined.pop(name) for name in IDENTITIES)
    (value, wide, after), paired = _core.register_start(
        joined, core_sensors(sensors, "cv")[0], searched
    )
    wide[placed, :3], after[placed, :3] = sigma[placed, :3], sigma[placed, :3]
    bias = bias_of(columns_of(prior) + value, wide, placed)
    return bias, after, np.array(paired, dtype=np.int64)


def _time_of_most_pairs(tables: Sequence[TrackTable], ages: Sequence[float]) -> float | None:
    """Return the time at which most tracks of a radar coincide with a track of another radar."""
    known = [table.time for table in tables if len(table)]
    if len(known) < 2:
        return None
    first, last = min(map(np.min, known)), max(map(np.max, known))
    if first == last:
        # tracks of one instant lead nowhere
        return None
    times = np.arange(first + max(ages), last + max(ages), max(ages))[:10_000]
    counts = np.zeros((len(tables), len(times)), dtype=np.int64)
    for k, (table, age) in enumerate(zip(tables, ages, strict=True)):
        # a track is there from its first row until some time after its last one
        order = np.argsort(table.track, kind="stable")
        track, time = table.track[order], table.time[order]
        first_row = np.flatnonzero(np.diff(track, prepend=-1))
        if len(first_row):
            begin = np.minimum.reduceat(time, first_row)
            end = np.maximum.reduceat(time, first_row) + age
            counts[k] = np.searchsorted(np.sort(begin), times, side="right")
            counts[k] -= np.searchsorted(np.sort(end), times, side="left")
    pairs = counts.sum(axis=0) - counts.max(axis=0)
    best = int(np.argmax(pairs))
    return float(times[best]) if pairs[best] > 0 else None


def _at(table: TrackTable, time: float, sensor: int, age: float) -> dict[str, Any]:
    """Return the tracks of a radar at a time, extrapolated in straight lines from the last rows."""
    rows = np.flatnonzero((table.time <= time) & (table.time > time - age))
    rows = rows[np.argsort(table.time[rows], kind="stable")]
    _, newest = np.unique(table.track[rows][::-1], return_index=True)
    rows = rows[::-1][newest]
    ahead = (time - table.time[rows])[:, np.newaxis]
    position = table.position[rows] + ahead * table.velocity[rows]
    turning = table.turn_probability[rows]
    variance = (1 - turning) * _STRAIGHT**2 + turning * _TURN**2
    move = np.tile(np.eye(4), (len(rows), 1, 1))
    move[:, 0, 2] = move[:, 1, 3] = ahead[:, 0]
    push = np.stack([ahead[:, 0] ** 2 / 2, ahead[:, 0]], axis=-1)
    noise = np.einsum("n,ni,nj,ab->niajb", variance, push, push, np.eye(2)).reshape(-1, 4, 4)
    covariance = move @ table.covariance[rows] @ np.swapaxes(move, 1, 2) + noise
    return {
        "sensor": np.full(len(rows), sensor),
        **{name: np.ascontiguousarray(getattr(table, name)[rows]) for name in IDENTITIES},
        "state": np.hstack([position, table.velocity[rows]]),
        "covariance": np.ascontiguousarray(covariance),
        "height": np.ascontiguousarray(table.height[rows]),
    }
