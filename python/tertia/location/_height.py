"""The height of a target, which is given or remains undetermined."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, common_batch, finite, positive
from tertia.location._result import Location
from tertia.sensors import Kind

# in metres; what stations with verticals of their own see of a height is small
ANYWHERE = 10_000.0
# cosine of 10 degrees; the verticals of stations 1000 km apart differ by 9 degrees
_LEVEL = 0.985


def given_height(
    height: npt.ArrayLike | None, sigma: npt.ArrayLike | None, d: int
) -> tuple[npt.ArrayLike, npt.ArrayLike] | None:
    """Return heights and their standard deviations as they are given; None if they are not."""
    if height is None and sigma is None:
        return None
    if height is None or sigma is None:
        missing = "height" if height is None else "height_sigma"
        raise ValueError(f"{missing} is missing; height and height_sigma belong together")
    if d == 2:
        raise ValueError("height needs stations with three coordinates")
    return height, sigma


def read_height(
    height: npt.ArrayLike | None, sigma: npt.ArrayLike | None, d: int
) -> FloatArray | None:
    """Return heights and their standard deviations, (..., 2); None if they are not given."""
    given = given_height(height, sigma, d)
    if given is None:
        return None
    value, spread = finite(given[0], "height"), positive(given[1], "height_sigma")
    if not np.all(np.isfinite(spread)):
        raise ValueError("height_sigma must be finite")
    batch = common_batch(height=value.shape, height_sigma=spread.shape)
    return np.stack([np.broadcast_to(value, batch), np.broadcast_to(spread, batch)], axis=-1)


def azimuths_alone(measured: Mapping[Kind, FloatArray]) -> BoolArray:
    """Return at which instants azimuths were measured and nothing else, (...)."""
    if "azimuth" not in measured:
        return np.zeros((), dtype=bool)
    alone = np.asarray(~np.isnan(measured["azimuth"]).all(axis=-1))
    for kind, values in measured.items():
        if kind != "azimuth":
            alone = np.asarray(alone & np.isnan(values).all(axis=-1))
    return alone


def without_heights(
    places: FloatArray, axes: FloatArray | None, measured: Mapping[Kind, FloatArray]
) -> tuple[FloatArray, FloatArray | None, bool]:
    """Return stations (..., K, 2) in the plane, their axes, and True if no height is measured.

    Otherwise the stations are returned as they are, with False. Azimuths tell a height if verticals
    of stations are far from that of the frame.
    """
    others = (values for kind, values in measured.items() if kind != "azimuth")
    flat = places.shape[-1] > 2 and all(np.isnan(values).all() for values in others)
    if not flat or not (axes is None or np.all(axes[..., 2, 2] > _LEVEL)):
        return places, axes, False
    plane = np.ascontiguousarray(places[..., :2])
    return plane, None if axes is None else in_the_plane(axes), True


def in_the_plane(axes: FloatArray) -> FloatArray:
    """Return the rotations about the vertical, (..., 2, 2), that are nearest to axes in space."""
    angle = np.arctan2(axes[..., 0, 1] - axes[..., 1, 0], axes[..., 0, 0] + axes[..., 1, 1])
    cosine, sine = np.cos(angle), np.sin(angle)
    rotations = np.stack([cosine, sine, -sine, cosine], axis=-1)
    return rotations.reshape(*angle.shape, 2, 2)


def lifted(values: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return vectors of the plane, (..., 2 M), and their covariance in space, (..., 3 M).

    The height of each of the M vectors is nan, with an infinite variance; where a variance is nan,
    all are.
    """
    size = values.shape[-1] // 2 * 3
    plane, up = np.flatnonzero(np.arange(size) % 3 < 2), np.arange(2, size, 3)
    raised = np.full((*values.shape[:-1], size), np.nan)
    raised[..., plane] = values
    spread = np.zeros((*covariance.shape[:-2], size, size))
    spread[..., plane[:, np.newaxis], plane] = covariance
    spread[..., up, up] = np.inf
    spread[np.isnan(np.diagonal(covariance, axis1=-2, axis2=-1)).any(axis=-1)] = np.nan
    return raised, spread


def anywhere(places: FloatArray, lacks: BoolArray) -> FloatArray:
    """Return heights with a very large sigma, near those of the stations (..., K, 3).

    Both are nan at instants that need no height.
    """
    level = np.where(lacks, np.mean(places[..., 2], axis=-1), np.nan)
    return np.stack([level, np.where(lacks, ANYWHERE, np.nan)], axis=-1)


def without_height(location: Location, lacks: BoolArray) -> Location:
    """Return the location with its height marked as undetermined at some instants."""
    position, covariance = location.position.copy(), location.covariance.copy()
    own = np.broadcast_to(lacks, position.shape[:-1]) & np.asarray(location.success)
    position[own, 2] = np.nan
    covariance[own, 2, :] = covariance[own, :, 2] = 0.0
    covariance[own, 2, 2] = np.inf
    return replace(location, position=position, covariance=covariance)
