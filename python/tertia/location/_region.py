"""Regions that contain the target with a given probability."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import BoolArray, FloatArray, probability, samples, scalar_or_array
from tertia._result import Result
from tertia.location._scene import Scene

Polygon: TypeAlias = tuple[FloatArray, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Region(Result):
    """A region of the plane that contains the target with a given probability.

    Attributes
    ----------
    polygon : tuple of ndarray of shape (N, 2)
        Corners of the outlines in metres, anticlockwise around a part of the region and clockwise
        around a hole. For a batch, it is an array of such tuples. The tuple is empty if there is no
        position.
    area : float or ndarray of shape (...)
        Area in square metres; inf if the region is unbounded.
    semi_major, semi_minor : float or ndarray of shape (...)
        Semi-axes in metres of the ellipse that has the same second moments as the region.
    orientation : float or ndarray of shape (...)
        Azimuth of the longer semi-axis of that ellipse in radians, from 0 to pi.
    """

    _rows: ClassVar = "area", 0
    _omitted: ClassVar = ("polygon",)

    polygon: Polygon | npt.NDArray[np.object_]
    area: float | FloatArray
    semi_major: float | FloatArray
    semi_minor: float | FloatArray
    orientation: float | FloatArray

    def contains(self, position: npt.ArrayLike) -> bool | BoolArray:
        """Return whether the region contains a position.

        Parameters
        ----------
        position : array_like of shape (..., 2)
            East and north in metres: one position for each region, or one for all.

        Returns
        -------
        bool or ndarray of shape (...)
            True if the position is inside; False if it is outside, or if there is no region.
        """
        points = samples(position, "position")
        if points.shape[-1:] not in {(2,), (3,)}:
            raise ValueError(f"position has shape {points.shape}; it must be (..., 2)")
        regions = np.empty((), dtype=object)
        if isinstance(self.polygon, tuple):
            regions[()] = self.polygon
        else:
            regions = self.polygon
        batch = np.broadcast_shapes(regions.shape, points.shape[:-1])
        points = np.broadcast_to(points, (*batch, points.shape[-1]))
        regions = np.broadcast_to(regions, batch)
        inside = np.empty(batch, dtype=bool)
        for index in np.ndindex(batch):
            inside[index] = sum(crossings(ring, points[index]) for ring in regions[index]) % 2
        found: bool | BoolArray = scalar_or_array(inside)
        return found

    def __repr__(self) -> str:
        """Show the area and the ellipse, or the shape of the batch."""
        if not isinstance(self.polygon, tuple):
            return f"Region(batch {self.polygon.shape})"
        return (
            f"Region({self.area:.4g} m², {self.semi_major:.4g} by {self.semi_minor:.4g} m towards "
            f"{np.degrees(self.orientation):.1f}°)"
        )


def crossings(ring: FloatArray, point: FloatArray) -> int:
    """Count the sides of a ring that are crossed by a ray from the point to the east."""
    (x, y), (u, v) = ring.T, np.roll(ring, -1, axis=0).T
    crosses = (y > point[1]) != (v > point[1])
    east = x[crosses] + (point[1] - y[crosses]) * (u - x)[crosses] / (v - y)[crosses]
    return int(np.count_nonzero(east > point[0]))


@dataclass(frozen=True, slots=True, eq=False)
class Accuracy:
    """Covariances of positions, with the sigmas and degrees of freedom if sigmas were estimated."""

    covariance: FloatArray
    estimated: tuple[FloatArray, FloatArray] | None

    @property
    def arrays(self) -> tuple[FloatArray, tuple[FloatArray, FloatArray] | None]:
        """Return the arguments of the kernel."""
        covariance = np.ascontiguousarray(self.covariance)
        if self.estimated is None:
            return covariance, None
        sigma, freedom = self.estimated
        return covariance, (np.ravel(sigma), np.ravel(freedom))


def region_of(scene: Scene, position: FloatArray, accuracy: Accuracy, content: float) -> Region:
    """Return the regions of positions."""
    share = probability(content, "probability")
    if scene.weights is not None and scene.max_range is not None:
        columns, rings = _core.posterior_regions(
            scene.rows, scene.max_range, scene.weights, share, None
        )
    else:
        columns, rings = _core.location_regions(scene.at(position), accuracy.arrays, share, None)
    area, semi_major, semi_minor, orientation = (scalar_or_array(column) for column in columns)
    polygon = np.empty(len(rings), dtype=object)
    for at, lines in enumerate(rings):
        polygon[at] = tuple(lines)
    batch = position.shape[:-1]
    shaped = polygon.reshape(batch) if batch else polygon[0]
    return Region(shaped, area, semi_major, semi_minor, orientation)


def radius_of(
    scene: Scene, position: FloatArray, accuracy: Accuracy, content: float
) -> float | FloatArray:
    """Return the radii about positions that contain the target with a probability."""
    share = probability(content, "probability")
    if scene.weights is not None and scene.max_range is not None:
        radius = _core.posterior_radii(
            scene.rows, scene.max_range, scene.weights, position, share, None
        )
    else:
        radius = _core.location_radii(scene.at(position), accuracy.arrays, share, None)
    found: float | FloatArray = scalar_or_array(radius)
    return found
