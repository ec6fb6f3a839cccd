"""Innovations of the plots of each radar, and rates at which the radar updates tracks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tertia import metrics
from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.sensors._identities import is_known, leading
from tertia.tracker import Plots, TrackTable
from tertia.tracker._errors import in_periods

# quantile of chi-squared with two degrees of freedom that is exceeded with probability 1e-4
_OUTLIER = 18.420681


@dataclass(frozen=True, slots=True, eq=False)
class Innovations:
    """Normalised innovations squared, per axis, of the plots of one radar in the joint tracks.

    `outlier` marks innovations so large that, with the stated noise, one in 10,000 would reach
    them.
    """

    time: FloatArray
    square: FloatArray
    outlier: BoolArray


def innovations(table: TrackTable, k: int) -> Innovations:
    """Return the normalised innovations of the plots of one radar."""
    own = (table.sensor == k) & (table.plot >= 0) & table.confirmed
    own &= np.isfinite(table.innovation[:, 0])
    square = np.asarray(metrics.nees(table.innovation[own], table.innovation_covariance[own]))
    return Innovations(table.time[own], square / 2, square > _OUTLIER)


@dataclass(frozen=True, slots=True, eq=False)
class Updates:
    """Numbers of scans and plots of one radar in each of T periods; all have the shape (T,).

    `expected` counts the scans of confirmed tracks, and `hit` those of these scans that have a
    plot. `outlier` counts updates whose innovation is too large. `unassociated` counts plots that
    have the identity of a track but are not used by it. `refused` counts plots that could not be
    used, and `unused` counts plots that belong to no track.
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
    """Return which rows are scans of confirmed tracks by a radar, and which of them have a plot."""
    # after the last plot of a track, no scan counts as missed
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
    kind = leading(plots)
    known = np.unique(getattr(joint, kind)[joint.confirmed])
    known = known[is_known(known)]
    idle = own & ~used & ~refused
    unassociated = idle & np.isin(getattr(plots, kind), known)

    def counted(time: FloatArray) -> IntArray:
        which = in_periods(time, edges)
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
