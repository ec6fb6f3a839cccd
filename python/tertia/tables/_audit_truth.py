"""The target of each estimate that is audited, and what the truth says of it at that time."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from tertia._arrays import FloatArray, IntArray
from tertia.metrics import Truth, match_tracks
from tertia.tables._doubts import doubt

# gaps of the truth longer than this are not interpolated, in units of its usual step
_LONGEST_GAP = 10.0
# names of tracks are those of targets if this share of the estimates is near these targets
_MOST_NEAR = 0.5


def targets(
    truth: Truth, names_of: Any, time: FloatArray, place: FloatArray, distance: float
) -> IntArray:
    """Return the target of each estimate: the only one, the one of its name, or the nearest."""
    if len(truth) == 1:
        return np.zeros(len(time), dtype=np.int64)
    index = {name: k for k, name in enumerate(truth.targets.tolist())}
    named = np.array([index.get(name, -1) for name in names_of.tolist()], dtype=np.int64)
    if not np.any(named >= 0):
        return _nearby(truth, names_of, time, place, distance)
    near = _share_near(truth, named, time, place, distance)
    if near >= _MOST_NEAR:
        return named
    # tracks and targets that are both numbered may have the same names by chance
    matched = _nearby(truth, names_of, time, place, distance)
    if _share_near(truth, matched, time, place, distance) < _MOST_NEAR:
        return named
    doubt(
        f"{near:.0%} of the estimates are within {distance:g} m of the target with the name of "
        "their track: names are taken to be unrelated, and tracks are matched by their positions"
    )
    return matched


def _nearby(
    truth: Truth, names_of: Any, time: FloatArray, place: FloatArray, distance: float
) -> IntArray:
    """Return the target nearest to the track of each estimate, -1 where there is none."""
    tracks = SimpleNamespace(time=time, track=names_of, position=place)
    return match_tracks(tracks, truth, max_distance=distance).target


def _share_near(
    truth: Truth, target: IntArray, time: FloatArray, place: FloatArray, distance: float
) -> float:
    """Return the share of the estimates that are within `distance` of their target."""
    off = np.hypot(*(place - truth.at(target, time))[:, :2].T)
    return float(np.mean(off <= distance))


def _usual_step(truth: Truth) -> float:
    steps = np.concatenate([np.diff(times) for _, times, _ in truth])
    return float(np.median(steps)) if len(steps) else 1.0


def bridged(truth: Truth, target: IntArray, time: FloatArray) -> Any:
    """Return for each time whether it is outside the long gaps of the truth."""
    longest = _LONGEST_GAP * _usual_step(truth)
    fine = target >= 0
    for k, (_, times, _) in enumerate(truth):
        own = np.flatnonzero(target == k)
        after = np.clip(np.searchsorted(times, time[own]), 1, max(len(times) - 1, 1))
        if len(times) > 1:
            fine[own] &= times[after] - times[after - 1] <= longest
    return fine


def velocity_of(truth: Truth, target: IntArray, time: FloatArray) -> FloatArray:
    """Return velocities by central differences over two usual steps of the truth."""
    half = _usual_step(truth)
    ahead, behind = (truth.at(target, time + step) for step in (half, -half))
    return np.asarray((ahead - behind) / (2 * half))


def nearest_rows(
    truth: Truth, when: FloatArray, labels: Any, target: IntArray, time: FloatArray
) -> IntArray:
    """Return, for each time, the row of the truth that is nearest in time."""
    found = np.zeros(len(time), dtype=np.int64)
    for k, name in enumerate(truth.targets.tolist()):
        rows = np.flatnonzero(labels == name)
        rows = rows[np.argsort(when[rows], kind="stable")]
        own = np.flatnonzero(target == k)
        middle = (when[rows][1:] + when[rows][:-1]) / 2
        found[own] = rows[np.searchsorted(middle, time[own])]
    return found
