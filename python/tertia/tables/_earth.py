"""Latitudes and longitudes of positions whose heights are unknown."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tertia._arrays import FloatArray
from tertia.geo import LocalFrame

# each round reduces the error of the coordinate up to 3 % at 1000 km, and to 0.01 % at 50 km
_ROUNDS = 4
# in metres; positions that are farther from the result are not on the earth
_CLOSE = 1.0


def on_the_ellipsoid(frame: LocalFrame, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return latitude and longitude of the points below or above positions in the plane."""
    from pyproj import Proj  # noqa: PLC0415  # only here is pyproj needed

    # east and north of a place on the ellipsoid are its orthographic projection
    plane = Proj(proj="ortho", lat_0=frame.latitude, lon_0=frame.longitude, ellps="WGS84")
    longitude, latitude = plane(position[:, 0], position[:, 1], inverse=True)
    return np.asarray(latitude), np.asarray(longitude)


def up_at(frame: LocalFrame, position: FloatArray, height: FloatArray | float) -> FloatArray:
    """Return the coordinate up that positions, (..., 3), have at a height above the ellipsoid."""
    latitude, longitude, _ = frame.to_geodetic(position)
    return np.asarray(frame.to_local(latitude, longitude, height)[..., 2])


def at_heights(
    frame: LocalFrame, position: FloatArray, places: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return latitudes, longitudes and heights of positions, (N, 3).

    Positions without a height are taken at the mean height above the ellipsoid of stations at
    `places`, (3,) or (N, 3) each; their height is nan.
    """
    found = np.stack(frame.to_geodetic(position))
    lacks = np.isnan(position[:, 2]) & np.isfinite(position[:, :2]).all(axis=1)
    if lacks.any():
        heights = np.stack(np.broadcast_arrays(*(frame.to_geodetic(one)[2] for one in places)))
        level = np.broadcast_to(np.mean(heights, axis=0), len(position))[lacks]
        found[:2, lacks] = _at(frame, position[lacks, :2], level)
    latitude, longitude, height = found
    return latitude, longitude, height


def _at(frame: LocalFrame, position: FloatArray, level: FloatArray) -> FloatArray:
    """Return latitudes and longitudes, (2, N), of positions, (N, 2), at heights, (N,)."""
    up = level - frame.height
    for _ in range(_ROUNDS):
        up = up_at(frame, np.column_stack([position, up]), level)
    places = np.stack(frame.to_geodetic(np.column_stack([position, up]))[:2])
    missed = frame.to_local(places[0], places[1], level)[:, :2] - position
    places[:, np.linalg.norm(missed, axis=1) > _CLOSE] = np.nan
    return places
