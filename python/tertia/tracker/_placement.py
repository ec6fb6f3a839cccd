"""Positions and covariances of the plots of tracks, also of targets that report no height."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from tertia import _core
from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.sensors import PositionSensor, Radar
from tertia.tracker._earth import LEVEL_SIGMA, plane_of, positions
from tertia.tracker._plots import Plots
from tertia.tracker._sensors import core_sensors, reported

# usual vertical rate, by which a height becomes uncertain, in metres per second
_CLIMB = 5.0
# sine of the steepest elevation at which radars usually see targets
_STEEP = 0.7
# step over which positions are differentiated with respect to the height, in metres
_STEP = 10.0
# rounds in which the height of a target is found
_ROUNDS = 5

_Sensor: TypeAlias = Radar | PositionSensor


def placed(
    plots: Plots,
    sensors: Sequence[_Sensor],
    number: IntArray,
    time: FloatArray,
    velocity: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return positions, (N, 2), their covariances, and what the plots of a track have in common.

    `number`, `time` and `velocity`, (N, 2), are the track of each plot, its time, and the velocity
    of the track. Covariances are those of the noise that the plots show, if it is larger than
    stated. A plot without a height is at the height that follows from the other plots of its track.
    The height of a track without any follows from the mean height of all plots and from the
    differences between its radars; its error is the same for all plots, and is their common
    covariance.
    """
    position, covariance = reported(plots.position, plots.covariance, plots, sensors, "position")
    shared = np.zeros_like(covariance)
    radars = [k for k, one in enumerate(sensors) if isinstance(one, Radar)]
    own = np.isin(plots.sensor, radars)
    if own.any():
        sites = [one for one in sensors if isinstance(one, Radar)]
        polar = plots[own]._replaced(sensor=np.searchsorted(radars, plots.sensor[own]))
        polar, doubt = _levelled(polar, number[own], time[own])
        known = np.isfinite(polar.height)
        if known.any() and np.isfinite(time[own][~known]).any():
            polar, by_height, variance = _assumed(polar, sites, number[own], time[own], doubt)
            outer = by_height[:, :, np.newaxis] * by_height[:, np.newaxis]
            shared[own] = variance[:, np.newaxis, np.newaxis] * outer
        position[own], covariance[own] = _at(polar, sites, doubt)
    covariance, lasting = _shown(
        core_sensors(sensors, "cv"),
        (number, plots.sensor, np.column_stack([time, position])),
        covariance,
        velocity,
    )
    return position, covariance, shared + lasting


def _shown(
    sensors: tuple[list[_core.Radar], list[_core.Geometry]],
    plots: tuple[IntArray, IntArray, FloatArray],
    covariance: FloatArray,
    velocity: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the covariances by the noise that the plots show, and what plots have in common."""
    upper = covariance[:, [0, 0, 1], [0, 1, 1]]
    columns = np.column_stack([plots[2], upper, velocity])
    order = np.argsort(columns[:, 0], kind="stable")
    order = order[np.isfinite(columns[order]).all(axis=1)]
    number, sensor = (one[order] for one in plots[:2])
    found = np.column_stack([upper, np.zeros_like(upper)])
    found[order] = _core.shown_covariances(sensors, number, sensor, columns[order])
    full = found[:, [0, 1, 1, 2, 3, 4, 4, 5]].reshape(-1, 2, 2, 2)
    return full[:, 0], full[:, 1]


def _levelled(plots: Plots, number: IntArray, time: FloatArray) -> tuple[Plots, FloatArray]:
    """Return plots with heights between those of their track, and the sigmas of these heights.

    The sigma grows with the time to the nearest height.
    """
    height, doubt = plots.height.copy(), np.zeros(len(plots))
    for own in _parts(number, time):
        known = np.isfinite(height[own])
        if not known.any() or known.all():
            continue
        there, missing = own[known], own[~known]
        after = np.searchsorted(time[there], time[missing])
        near = [there[np.clip(after - k, 0, len(there) - 1)] for k in (0, 1)]
        gap = np.min([np.abs(time[missing] - time[one]) for one in near], axis=0)
        height[missing] = np.interp(time[missing], time[there], height[there])
        doubt[missing] = _CLIMB * gap
    return plots._replaced(height=height), doubt


def _parts(number: IntArray, time: FloatArray) -> list[IntArray]:
    """Return the plots of each track, in the order of time."""
    order = np.lexsort((time, number))
    order = order[np.isfinite(time[order])]
    return np.split(order, np.flatnonzero(np.diff(number[order])) + 1)


def _at(
    plots: Plots, sites: Sequence[Radar], doubt: FloatArray | float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return positions and covariances of plots of radars."""
    plane = plane_of(sites)
    return plots.to_cartesian(sites) if plane is None else positions(plots, sites, plane, doubt)


def _assumed(
    plots: Plots, sites: Sequence[Radar], number: IntArray, time: FloatArray, doubt: FloatArray
) -> tuple[Plots, FloatArray, FloatArray]:
    """Return plots of which all have heights, and the derivatives of their positions.

    The derivatives are those with respect to the height; the variance of the height is returned,
    too. Both are 0 where heights are known.
    """
    tracks = [own for own in _parts(number, time) if np.isnan(plots.height[own]).any()]
    rows = np.concatenate(tracks)
    first = np.cumsum([0, *map(len, tracks)])
    of_track = np.repeat(np.arange(len(tracks)), np.diff(first))
    some = plots[rows]
    mean, variance, top = _prior(plots, some, sites, first)
    height, found = mean, variance
    lifts = np.zeros((len(rows), 2))
    for _ in range(_ROUNDS):
        level = some._replaced(height=height[of_track])
        position, covariance = _at(level, sites)
        higher = _at(level._replaced(height=level.height + _STEP), sites)[0]
        lifts = (higher - position) / _STEP
        used = np.isfinite(position + lifts).min(axis=1)
        offset = _offsets(first, time[rows], (position, covariance, lifts), used)
        weight = 1.0 / offset[:, 1]
        found = 1.0 / (1.0 / variance + weight)
        height = np.clip(found * (mean / variance + weight * (height - offset[:, 0])), 0.0, top)
    heights, by_height, doubts = plots.height.copy(), np.zeros((len(plots), 2)), doubt * 0.0
    heights[rows], by_height[rows], doubts[rows] = height[of_track], lifts, found[of_track]
    return plots._replaced(height=heights), np.nan_to_num(by_height), doubts


def _prior(
    plots: Plots, some: Plots, sites: Sequence[Radar], first: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the mean and the variance of the height of targets, and the largest height."""
    heights = plots.height[np.isfinite(plots.height)]
    mean = np.mean(heights)
    variance = (LEVEL_SIGMA**2 + np.sum((heights - mean) ** 2)) / (1 + len(heights))
    site = np.array([_height(one) for one in sites])[some.sensor]
    # the steepest elevation at which the target was seen bounds its height
    top = np.minimum.reduceat(site + _STEEP * some.range, first[:-1])
    low = np.minimum.reduceat(site, first[:-1])
    is_below = mean > top
    return (
        np.where(is_below, 0.5 * (low + top), mean),
        np.where(is_below, (top - low) ** 2 / 12.0, variance),
        np.minimum.reduceat(site + 0.95 * some.range, first[:-1]),
    )


def _height(radar: Radar) -> float:
    """Return the height of a radar, in metres."""
    if radar.site is not None:
        return radar.site.height
    return float(radar.position[2]) if len(radar.position) > 2 else 0.0


def _offsets(
    first: IntArray,
    time: FloatArray,
    placed: tuple[FloatArray, FloatArray, FloatArray],
    used: BoolArray,
) -> FloatArray:
    """Return by how much targets are lower than assumed, and the variance of this, (tracks, 2)."""
    position, covariance, lifts = placed
    upper = covariance[:, [0, 0, 1], [0, 1, 1]]
    columns = np.column_stack([time, position, upper, lifts])
    before = np.concatenate([[0], np.cumsum(used)])
    return _core.height_offsets(before[first].tolist(), np.ascontiguousarray(columns[used]))
