"""Covariance of positions that the systematic errors of the sensors cause."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from tertia._arrays import FloatArray, IntArray
from tertia.sensors import PositionSensor, Radar
from tertia.tracker._sensors import interval

# a sensor contributes to a position if it has plots within about this time, in seconds
_NEAR = 30.0
# plots that are processed at once
_CHUNK = 100_000

_Sensor: TypeAlias = Radar | PositionSensor


@dataclass(frozen=True, slots=True)
class Placed:
    """Plots, in the order of their tracks and in these in the order of time."""

    sensor: IntArray
    track: IntArray
    time: FloatArray
    position: FloatArray
    covariance: FloatArray
    velocity: FloatArray


def systematic(
    plots: Placed, sensors: Sequence[_Sensor], covariance: FloatArray, excluded: int | None
) -> FloatArray:
    """Return the covariance of each position from systematic errors, (N, 2, 2).

    `covariance` (4 K, 4 K) is that of the errors of the K sensors; with deviations, (8 K, 8 K),
    their coefficients follow the time. A position is taken as the mean of the sensors that see the
    target at about this time, weighted by their information, without the sensor that is excluded.
    """
    effects = _effects(plots, sensors)[..., : covariance.shape[0] // len(sensors)]
    near = [_nearest(plots, k, interval(one)) for k, one in enumerate(sensors)]
    near = [(at, weight * (k != excluded)) for k, (at, weight) in enumerate(near)]
    total = np.maximum(sum(weight for _, weight in near), np.finfo(float).tiny)
    found = np.zeros_like(plots.covariance)
    for begin in range(0, len(plots.time), _CHUNK):
        part = slice(begin, begin + _CHUNK)
        shares = ((at[part], (weight / total)[part, np.newaxis, np.newaxis]) for at, weight in near)
        lift = np.concatenate([share * effects[at] for at, share in shares], axis=2)
        own = lift @ covariance @ lift.swapaxes(1, 2)
        found[part] = 0.5 * (own + own.swapaxes(1, 2))
    return found


def _effects(plots: Placed, sensors: Sequence[_Sensor]) -> FloatArray:
    """Return the derivatives of positions with respect to the errors of their sensor, (N, 2, 8).

    The errors are those of range, gain, azimuth and time, or of east, none, north and time, and the
    coefficients of the deviation of the azimuth.
    """
    places = [one.position[:2] if isinstance(one, Radar) else [0.0, 0.0] for one in sensors]
    place = np.array(places)
    is_radar = np.array([isinstance(one, Radar) for one in sensors])[plots.sensor, np.newaxis]
    away = plots.position - place[plots.sensor]
    distance = np.maximum(np.hypot(*away.T), 1.0)[:, np.newaxis]
    east, north = np.eye(2)
    across = np.where(is_radar, away[:, ::-1] * [1.0, -1.0], 0.0)
    sine, cosine = (away / distance).T[..., np.newaxis]
    harmonics = (sine, cosine, 2.0 * sine * cosine, cosine**2 - sine**2)
    return np.stack(
        [
            np.where(is_radar, away / distance, east),
            np.where(is_radar, away, 0.0),
            np.where(is_radar, across, north),
            -plots.velocity,
            *(across * harmonic for harmonic in harmonics),
        ],
        axis=2,
    )


def _nearest(plots: Placed, sensor: int, interval: float) -> tuple[IntArray, FloatArray]:
    """Return the plot of a sensor nearest in time to each plot, and the weight of this sensor."""
    index, count = np.arange(len(plots.time)), len(plots.time)
    own = plots.sensor == sensor
    before = np.maximum.accumulate(np.where(own, index, -1))
    after = np.minimum.accumulate(np.where(own, index, count)[::-1])[::-1]
    found, gap = np.zeros(count, np.int64), np.full(count, np.inf)
    for at in (before, after):
        there = np.clip(at, 0, count - 1)
        apart = np.abs(plots.time[there] - plots.time)
        is_nearer = (at == there) & (plots.track[there] == plots.track) & (apart < gap)
        found, gap = np.where(is_nearer, there, found), np.where(is_nearer, apart, gap)
    variance = np.trace(plots.covariance[found], axis1=1, axis2=2)
    return found, np.exp(-gap / _NEAR) / (variance * interval)
