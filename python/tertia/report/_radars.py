"""How good each radar really is: noise, bias, updates, faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tertia import metrics
from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.report._tracks import Common, Run, alone
from tertia.sensors import Radar
from tertia.tracker import NO_IDENTITY, Plots, TrackTable

# rounds of tracking with the noise found in the last one
_ROUNDS = 3
# plots on a line, and how many are free of it in each axis; how much longer it may last
_LINE, _FREE, _GAPS = 6, 4, 1.5
_STRAIGHT = 0.5
# of chi-squared with so many degrees of freedom, over them: median, and 99.9 %
_MEDIAN, _MOST = 0.839174, 4.616710
# lines that are needed for a standard deviation
_FEWEST = 4
# chi-squared with two degrees of freedom: beyond (1e-4), an innovation is a fault
_FAULT = 18.420681
# stretches of time, at most, and scans in each, at least
_STRETCHES, _SCANS = 24, 8
# standard deviations of the noise that a bias may have before anything is known
_PRIOR = 10.0
# share of the prior at which the plots tell nothing of a bias
_UNKNOWN = 0.5
# beyond, differences count less
_HUBER, _REWEIGHTED = 2.5, 10


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """The noise of a radar, and its tracks as they are with it.

    Standard deviations of range and azimuth, (2,), with their errors; the same in stretches of
    time, (T, 2); metres and radians, nan where too little is known.
    """

    sigma: FloatArray
    error: FloatArray
    edges: FloatArray
    sigma_along: FloatArray
    error_along: FloatArray
    radar: Radar
    table: TrackTable


def noise(plots: Plots, radars: Sequence[Radar], k: int, run: Run, edges: FloatArray) -> Noise:
    """Find the noise of one radar from plots about short straight lines, in its own tracks.

    Six plots of a track in a row make a line; where they turn or one is a fault, they are left out.
    The tracks are made again with the noise that was found: gates that are too narrow would keep
    the worst plots out.
    """
    radar = radars[k]
    for _ in range(_ROUNDS):
        table = alone(plots, [*radars[:k], radar, *radars[k + 1 :]], k, run)
        time, mean_square = _lines(table, plots, radar)
        sigma, error, along, error_along = _deviations(time, mean_square, edges)
        stated = np.array([radar.range_sigma, radar.azimuth_sigma])
        radar = with_noise(radar, np.where(np.isfinite(sigma), sigma, stated))
    return Noise(sigma, error, edges, along, error_along, radar, table)


def _lines(table: TrackTable, plots: Plots, radar: Radar) -> tuple[FloatArray, FloatArray]:
    """Return the times of short lines, and mean squares about them in range and azimuth, (L, 2)."""
    used = np.flatnonzero(table.plot >= 0)
    used = used[np.lexsort((table.time[used], table.track[used]))]
    height = plots.height[table.plot[used]]
    if np.any(np.isfinite(height)):
        # without its height a plot is elsewhere
        used = used[np.isfinite(height)]
    starts = np.flatnonzero(np.diff(table.track[used], prepend=-1) != 0)
    place = np.arange(len(used)) - np.repeat(starts, np.diff(np.append(starts, len(used))))
    begin = np.flatnonzero(place % _LINE == 0)
    begin = begin[begin + _LINE <= len(used)]
    begin = begin[table.track[used[begin]] == table.track[used[begin + _LINE - 1]]]
    rows = used[begin[:, np.newaxis] + np.arange(_LINE)]
    own = plots[table.plot[rows.reshape(-1)]]
    seen = Plots(own.time, own.range, own.azimuth, height=own.height)
    point = (seen.to_cartesian([radar])[0] - radar.position[:2]).reshape(-1, _LINE, 2)
    time = own.time.reshape(-1, _LINE)
    since = time - time.mean(axis=1, keepdims=True)
    near = np.ptp(time, axis=1) < _GAPS * _LINE * radar.scan_period
    near &= np.max(table.turn_probability[rows], axis=1) < _STRAIGHT
    since, point, time = since[near], point[near], time[near]
    centre = point.mean(axis=1, keepdims=True)
    slope = (
        np.sum(since[..., np.newaxis] * point, axis=1)
        / np.maximum(np.sum(since**2, axis=1), 1e-9)[:, np.newaxis]
    )
    fitted = centre + since[..., np.newaxis] * slope[:, np.newaxis]
    distance = np.maximum(np.hypot(fitted[..., 0], fitted[..., 1]), 1.0)
    toward, off = fitted / distance[..., np.newaxis], point - fitted
    along = np.sum(toward * off, axis=-1)
    across = (toward[..., 1] * off[..., 0] - toward[..., 0] * off[..., 1]) / distance
    squares = np.stack([np.sum(along**2, axis=1), np.sum(across**2, axis=1)], axis=-1)
    return time.mean(axis=1), squares / _FREE


def _deviations(
    time: FloatArray, mean_square: FloatArray, edges: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return standard deviations of all and in stretches of time, each with its errors."""
    count = len(edges) - 1
    variance, lines = np.full((count, 2), np.nan), np.zeros((count, 2))
    which = in_stretches(time, edges)
    for i in range(count):
        for axis in range(2):
            own = mean_square[which == i, axis]
            if len(own) < _FEWEST:
                continue
            level = float(np.median(own)) / _MEDIAN
            for _ in range(_ROUNDS):
                kept = own[own <= _MOST * level]
                level = float(np.mean(kept))
            variance[i, axis], lines[i, axis] = level, len(kept)
    with np.errstate(invalid="ignore", divide="ignore"):
        total = np.sum(lines, axis=0)
        whole = np.sqrt(np.nansum(lines * variance, axis=0) / total)
        along = np.sqrt(variance)
        # mean squares of normal numbers
        error_along = along / np.sqrt(2 * _FREE * lines)
        spread = 2 * np.nansum(lines * variance**2, axis=0) / (_FREE * total**2)
        error = np.sqrt(spread) / (2 * whole)
    return whole, error, along, error_along


@dataclass(frozen=True, slots=True, eq=False)
class Innovations:
    """Normalised squares of innovations of a radar's plots in the tracks of all, one per axis.

    `faulty` are those far beyond what is stated.
    """

    time: FloatArray
    square: FloatArray
    faulty: BoolArray


def innovations(table: TrackTable, k: int) -> Innovations:
    """Return those of one radar."""
    own = (table.sensor == k) & (table.plot >= 0) & table.confirmed
    own &= np.isfinite(table.innovation[:, 0])
    square = np.asarray(metrics.nees(table.innovation[own], table.innovation_covariance[own]))
    return Innovations(table.time[own], square / 2, square > _FAULT)


def with_noise(radar: Radar, sigma: FloatArray) -> Radar:
    """Return the radar with other standard deviations of range and azimuth."""
    return Radar(
        radar.position,
        range_sigma=float(sigma[0]),
        azimuth_sigma=float(sigma[1]),
        scan_period=radar.scan_period,
        max_range=radar.max_range,
        detection_probability=radar.detection_probability,
        name=radar.name,
    )


def stretches(time: FloatArray, period: float) -> FloatArray:
    """Return the edges of stretches of time, each of some scans."""
    first, last = float(np.min(time)), float(np.max(time))
    count = int(np.clip((last - first) // (_SCANS * period), 1, _STRETCHES))
    return np.linspace(first, last, count + 1)


def in_stretches(time: FloatArray, edges: FloatArray) -> IntArray:
    """Return in which stretch each time is."""
    return np.clip(np.searchsorted(edges, time, side="right") - 1, 0, len(edges) - 2)


@dataclass(frozen=True, slots=True, eq=False)
class Updates:
    """How often a radar updates tracks, and what is wrong with its plots, along time.

    `expected` and `hit` count scans of confirmed tracks, `faulty` updates far off the prediction,
    `astray` plots with the identity of a track that does not take them, `refused` plots that could
    not be used, `unused` those of no track; each (T,).
    """

    time: FloatArray
    expected: IntArray
    hit: IntArray
    plots: IntArray
    faulty: IntArray
    astray: IntArray
    refused: IntArray
    unused: IntArray


def updates(
    joint: TrackTable, plots: Plots, k: int, found: Innovations, edges: FloatArray
) -> Updates:
    """Count them by stretches of time."""
    # behind the last plot of a track nothing is missed
    last = np.full(int(joint.track.max(initial=0)) + 1, -np.inf)
    taken = joint.plot >= 0
    np.maximum.at(last, joint.track[taken], joint.time[taken])
    rows = joint.confirmed & (joint.sensor == k) & (joint.time <= last[joint.track])
    hit = rows & (joint.plot >= 0)
    own = (plots.sensor == k) & np.isfinite(plots.time)
    used = np.zeros(len(plots), dtype=bool)
    used[joint.plot[joint.plot >= 0]] = True
    refused = joint.track_of_plot < 0
    known = np.unique(joint.identity[joint.confirmed])
    known = known[known != NO_IDENTITY]
    idle = own & ~used & ~refused
    astray = idle & np.isin(plots.identity, known)

    def counted(time: FloatArray) -> IntArray:
        which = in_stretches(time, edges)
        return np.bincount(which, minlength=len(edges) - 1).astype(np.int64)

    return Updates(
        (edges[:-1] + edges[1:]) / 2,
        counted(joint.time[rows]),
        counted(joint.time[hit]),
        counted(plots.time[own]),
        counted(found.time[found.faulty]),
        counted(plots.time[astray]),
        counted(plots.time[own & refused]),
        counted(plots.time[idle]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Biases:
    """Biases of range (metres) and azimuth (radians), (K, 2), with errors; nan where unknown."""

    value: FloatArray
    error: FloatArray


def biases(told: Common, radars: Sequence[Radar]) -> Biases:
    """Find constant biases of all radars from the differences of their tracks.

    Weighted least squares over all pairs, reweighted by Huber's rule, with a wide prior; what the
    geometry does not tell remains as wide as that and is unknown. Errors are those of tracks that
    are independent of each other, not of instants.
    """
    count = len(radars)
    nothing = np.full((count, 2), np.nan)
    if not len(told.time):
        return Biases(nothing, nothing)
    rows = [_pair(told, radars, i, j) for i in range(count) for j in range(i + 1, count)]
    design, off, track = (np.concatenate(column) for column in zip(*rows, strict=True))
    prior = _PRIOR * np.array([[r.range_sigma, r.azimuth_sigma] for r in radars]).reshape(-1)
    scale = design * prior
    share, found = np.ones(len(off)), np.zeros(2 * count)
    for _ in range(_REWEIGHTED):
        information = np.einsum("nai,n,naj->ij", scale, share, scale) + np.eye(2 * count)
        found = np.linalg.solve(information, np.einsum("nai,n,na->i", scale, share, off))
        rest = off - scale @ found
        size = np.sqrt(np.sum(rest**2, axis=1))
        share = np.minimum(1.0, _HUBER / np.maximum(size, 1e-12))
    score = np.einsum("nai,n,na->ni", scale, share, rest)
    _, group = np.unique(track, return_inverse=True)
    by_track = np.zeros((group.max() + 1, 2 * count))
    np.add.at(by_track, group, score)
    inverse = np.linalg.inv(information)
    # as many of the tracks' differences as there are biases are used up
    groups = len(by_track)
    meat = by_track.T @ by_track * (groups / max(groups - 2 * count, 1))
    spread = inverse @ (meat + np.eye(2 * count)) @ inverse
    # what the prior holds, the sum of scores does not see
    error = np.sqrt(np.maximum(np.diagonal(spread), np.diagonal(inverse)))
    unknown = error > _UNKNOWN
    value = np.where(unknown, np.nan, found) * prior
    return Biases(
        value.reshape(count, 2), np.where(unknown, np.nan, error * prior).reshape(count, 2)
    )


def _pair(
    told: Common, radars: Sequence[Radar], i: int, j: int
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the whitened design (N, 2, 2K) and differences (N, 2) of two radars' tracks."""
    both = told.there[:, i] & told.there[:, j]
    state, spread = told.state[both], told.covariance[both]
    root = np.linalg.inv(np.linalg.cholesky(spread[:, i, :2, :2] + spread[:, j, :2, :2]))
    design = np.zeros((len(state), 2, 2 * len(radars)))
    for k, sign in ((i, 1.0), (j, -1.0)):
        offset = state[:, k, :2] - radars[k].position[:2]
        distance = np.hypot(*offset.T)[:, np.newaxis]
        design[:, :, 2 * k] = sign * offset / np.maximum(distance, 1.0)
        design[:, :, 2 * k + 1] = sign * np.stack([offset[:, 1], -offset[:, 0]], axis=-1)
    off = state[:, i, :2] - state[:, j, :2]
    return root @ design, (root @ off[..., np.newaxis])[..., 0], told.track[both]


def corrected(told: Common, found: Sequence[Noise], shift: Biases) -> Common:
    """Return tracks without biases, and with covariances as they are in each stretch of time.

    The tracks are those with the noise of all time; along the range and across it, their standard
    deviations grow or shrink as that of the noise. A bias that is unknown remains.
    """
    state, spread = told.state.copy(), told.covariance.copy()
    bias = np.nan_to_num(shift.value)
    for k, one in enumerate(found):
        with np.errstate(invalid="ignore"):
            factor = one.sigma_along / one.sigma
        factor[~np.isfinite(factor)] = 1.0
        own = factor[in_stretches(told.time, one.edges)]
        offset = told.state[:, k, :2] - one.radar.position[:2]
        distance = np.maximum(np.hypot(*offset.T), 1.0)[:, np.newaxis]
        toward = offset / distance
        axes = np.stack([toward, np.stack([toward[:, 1], -toward[:, 0]], axis=-1)], axis=1)
        state[:, k, :2] -= bias[k, 0] * axes[:, 0] + bias[k, 1] * distance * axes[:, 1]
        scale = np.zeros((len(own), 4, 4))
        scale[:, :2, :2] = np.einsum("nia,ni,nib->nab", axes, own, axes)
        scale[:, 2:, 2:] = scale[:, :2, :2]
        spread[:, k] = scale @ spread[:, k] @ scale
    return replace(told, state=state, covariance=(spread + np.swapaxes(spread, -1, -2)) / 2)
