"""Innovations of each radar's plots, and rates at which it updates tracks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tertia import metrics
from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.registration._register import in_stretches
from tertia.tracker import NO_IDENTITY, Plots, TrackTable

# chi-squared with two degrees of freedom: exceeded with probability 1e-4
_OUTLIER = 18.420681


@dataclass(frozen=True, slots=True, eq=False)
class Innovations:
    """Normalised innovations squared, per axis, of one radar's plots in the tracks of all radars.

    `outlier` marks innovations that would occur once in 10,000 with the stated noise.
    """

    time: FloatArray
    square: FloatArray
    outlier: BoolArray


def innovations(table: TrackTable, k: int) -> Innovations:
    """Return the innovations of one radar."""
    own = (table.sensor == k) & (table.plot >= 0) & table.confirmed
    own &= np.isfinite(table.innovation[:, 0])
    square = np.asarray(metrics.nees(table.innovation[own], table.innovation_covariance[own]))
    return Innovations(table.time[own], square / 2, square > _OUTLIER)


@dataclass(frozen=True, slots=True, eq=False)
class Updates:
    """Counts for one radar, in each of T periods; all have the shape (T,).

    `expected` and `hit`: scans of confirmed tracks, and those of them with a plot. `outlier`:
    updates with an innovation that is too large. `unassociated`: plots with the identity of a track
    that does not use them. `refused`: plots that could not be used. `unused`: plots of no track.
    """

    time: FloatArray
    expected: IntArray
    hit: IntArray
    plots: IntArray
    outlier: IntArray
    unassociated: IntArray
    refused: IntArray
    unused: IntArray


def scans_of(joint: TrackTable, k: int) -> tuple[BoolArray, BoolArray]:
    """Return the rows that are scans of confirmed tracks by a radar, and those with a plot."""
    # after the last plot of a track nothing is missed
    last = np.full(int(joint.track.max(initial=0)) + 1, -np.inf)
    taken = joint.plot >= 0
    np.maximum.at(last, joint.track[taken], joint.time[taken])
    rows = joint.confirmed & (joint.sensor == k) & (joint.time <= last[joint.track])
    return rows, rows & taken


def updates(
    joint: TrackTable, plots: Plots, k: int, found: Innovations, edges: FloatArray
) -> Updates:
    """Count the updates of one radar in each period."""
    rows, hit = scans_of(joint, k)
    own = (plots.sensor == k) & np.isfinite(plots.time)
    used = np.zeros(len(plots), dtype=bool)
    used[joint.plot[joint.plot >= 0]] = True
    refused = joint.track_of_plot < 0
    known = np.unique(joint.identity[joint.confirmed])
    known = known[known != NO_IDENTITY]
    idle = own & ~used & ~refused
    unassociated = idle & np.isin(plots.identity, known)

    def counted(time: FloatArray) -> IntArray:
        which = in_stretches(time, edges)
        return np.bincount(which, minlength=len(edges) - 1).astype(np.int64)

    return Updates(
        (edges[:-1] + edges[1:]) / 2,
        counted(joint.time[rows]),
        counted(joint.time[hit]),
        counted(plots.time[own]),
        counted(found.time[found.outlier]),
        counted(plots.time[unassociated]),
        counted(plots.time[own & refused]),
        counted(plots.time[idle]),
    )
