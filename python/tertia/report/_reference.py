"""Comparison of the tracks of each radar with those of the other radars, without a truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tertia import metrics, tracker
from tertia.registration import Registration
from tertia.tracker import CvModel, ImmModel, Motion, Plots, TrackTable

# longest time in seconds without plots of other radars for which there is a reference
_MOST_GAP = 15.0


@dataclass(frozen=True, slots=True)
class Referenced:
    """Distances of a radar's tracks from the smoothed tracks of all other radars, in metres.

    `distance` is the root mean square of the distances per axis, and `sigma` is the root mean
    square of the standard deviations of the smoothed tracks. `nees` is the mean normalised squared
    distance per axis; its covariance is the sum of the covariances of the two tracks.
    """

    radar: str
    count: int
    distance: float
    sigma: float
    nees: float


def versus_others(
    plots: Plots,
    radars: Sequence[str],
    registration: Registration,
    joint: TrackTable,
    single: Sequence[TrackTable],
    *,
    motion: Motion,
) -> list[Referenced]:
    """Compare the tracks of each radar with the plots of the same targets by other radars."""
    if len(radars) < 2:
        return []
    smooth: Motion = "imm"
    if motion == "cv" or isinstance(motion, ImmModel | CvModel):
        smooth = motion
    plots, sensors = registration._removed(plots)
    found = []
    for k, name in enumerate(radars):
        others = tracker.smooth_tracks(
            plots, sensors, joint, motion=smooth, registration=False, exclude=k
        )
        others = others[(others.sensor == k) & (others.gap <= _MOST_GAP)]
        own = single[k][(single[k].plot >= 0) & single[k].confirmed]
        _, here, there = np.intersect1d(own.plot, others.plot, return_indices=True)
        if not len(here):
            continue
        error = own.position[here] - others.position[there]
        reference = others.covariance[there, :2, :2]
        nees = metrics.nees(error, own.covariance[here, :2, :2] + reference)
        found.append(
            Referenced(
                name,
                len(here),
                float(np.sqrt(np.mean(error**2))),
                float(np.sqrt(np.mean(np.trace(reference, axis1=1, axis2=2)) / 2)),
                float(np.mean(nees)) / 2,
            )
        )
    return found
