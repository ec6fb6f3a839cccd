"""Checks of tracks that are to be compared with flight plans."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, positive_number, samples


def tracks_of(
    time: npt.ArrayLike,
    position: npt.ArrayLike,
    velocity: npt.ArrayLike,
    covariance: npt.ArrayLike | None,
    height: npt.ArrayLike | None = None,
) -> dict[str, Any]:
    """Return tracks as arrays of matching shapes for the core."""
    instants = samples(time, "time")
    if instants.ndim < 1:
        raise ValueError("time is a single number; it must be (..., N)")
    given = {
        "time": (instants, ()),
        "position": (position, (2,)),
        "velocity": (velocity, (2,)),
        "covariance": (covariance, (4, 4)),
        "height": (height, ()),
    }
    tracks: dict[str, Any] = {}
    for name, (value, tail) in given.items():
        if value is None:
            tracks[name] = None
            continue
        array, shape = samples(value, name), (*instants.shape, *tail)
        if array.shape != shape:
            raise ValueError(f"{name} has shape {array.shape}; it must be {shape}, as time")
        if np.isinf(array).any():
            place = tuple(np.argwhere(np.isinf(array))[0].tolist())
            raise ValueError(f"{name}{list(place)} is {array[place]}; it must be finite, or nan")
        tracks[name] = np.ascontiguousarray(array)
    return tracks


def one_track(
    time: npt.ArrayLike,
    position: npt.ArrayLike,
    velocity: npt.ArrayLike,
    covariance: npt.ArrayLike | None,
    update_interval: float | None,
) -> tuple[dict[str, Any], float]:
    """Return a single track, whose times must increase, and the time between its plots."""
    track = tracks_of(time, position, velocity, covariance)
    instants: FloatArray = track["time"]
    if instants.ndim != 1:
        raise ValueError(f"time has shape {instants.shape}; it must be (N,)")
    present = instants[~np.isnan(instants)]
    steps = np.diff(present)
    bad = np.flatnonzero(steps <= 0)
    if bad.size:
        at = bad[0]
        raise ValueError(f"time must increase; {present[at]} is followed by {present[at + 1]}")
    if update_interval is None:
        return track, float(np.median(steps)) if steps.size else 0.0
    return track, positive_number(update_interval, "update_interval")
