"""Geo: conversion between latitude and longitude and the east, north and up of a local frame.

A frame is tangent to the WGS 84 ellipsoid at its origin. Far from the origin, the local vertical
and north differ from the axes of the frame: the vertical by one degree per 111 km, and north by the
convergence of the meridians. The azimuths and elevations of a station therefore refer to its own
axes.

Latitudes and longitudes are in degrees, as in receivers and maps; heights are in metres above the
ellipsoid. All other quantities are in metres and radians, as elsewhere. Needs the extra `geo`
(pyproj).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, finite, real, require_each, samples, scalar_or_array
from tertia.sensors import Station

if TYPE_CHECKING:
    from pyproj import Transformer

__all__ = ["LocalFrame"]

# latitude, longitude, height on WGS 84, and its geocentric x, y, z
_GEODETIC, _GEOCENTRIC = "EPSG:4979", "EPSG:4978"
# equatorial radius in metres, and flattening f as f (2 - f)
_RADIUS, _FLATTENING = 6378137.0, 1 / 298.257223563
_ECCENTRICITY_SQUARED = _FLATTENING * (2 - _FLATTENING)
_POLE = 90.0
_LARGEST = np.finfo(np.float64).max


@dataclass(frozen=True, slots=True, init=False)
class LocalFrame:
    """A local frame of east, north and up at a place on the earth.

    Attributes
    ----------
    latitude, longitude : float
        Origin in degrees.
    height : float
        Height of the origin above the ellipsoid in metres.

    Examples
    --------
    Two cameras 60 km apart observe an object at a height of 30 km:

    >>> from tertia import simulate
    >>> from tertia.geo import LocalFrame
    >>> from tertia.location import locate
    >>> frame = LocalFrame(-30.7, 135.1)
    >>> cameras = [
    ...     frame.station(-30.66, 134.2, 150.0, azimuth_sigma=1e-3, elevation_sigma=1e-3),
    ...     frame.station(-30.9, 134.8, 120.0, azimuth_sigma=1e-3, elevation_sigma=1e-3),
    ... ]
    >>> record = simulate.stations(cameras, frame.to_local(-30.4, 134.6, 30e3), rng=1)
    >>> fix = locate(cameras, **record.measurements)
    >>> latitude, longitude, height = frame.to_geodetic(fix.position)
    >>> round(latitude, 2), round(longitude, 2), round(height, -2)
    (-30.4, 134.6, 30000.0)
    """

    latitude: float
    longitude: float
    height: float

    def __init__(self, latitude: float, longitude: float, height: float = 0.0) -> None:
        values = {"latitude": latitude, "longitude": longitude, "height": height}
        for name, value in values.items():
            object.__setattr__(self, name, float(finite(real(value, name), name)))
        _numbers(self.latitude, "latitude")
        # fails here where pyproj is missing
        _transformer()

    def to_local(
        self,
        latitude: npt.ArrayLike,
        longitude: npt.ArrayLike,
        height: npt.ArrayLike = 0.0,
    ) -> FloatArray:
        """Return east, north and up of places.

        Parameters
        ----------
        latitude, longitude : array_like of shape (...)
            Degrees; nan where there is no place.
        height : array_like of shape (...)
            Metres above the ellipsoid.

        Returns
        -------
        ndarray of shape (..., 3)
            Metres; nan where there is no place.

        Raises
        ------
        ValueError
            A latitude beyond the poles, an infinite number, or shapes that do not fit.

        Examples
        --------
        >>> from tertia.geo import LocalFrame
        >>> LocalFrame(50.0, 14.0).to_local(50.0, 15.0, 0.0).round()
        array([71692.,   479.,  -402.])
        """
        return self.from_ecef(_to_ecef(latitude, longitude, height))

    def to_geodetic(
        self, position: npt.ArrayLike
    ) -> tuple[float | FloatArray, float | FloatArray, float | FloatArray]:
        """Return latitude, longitude and height of positions.

        Parameters
        ----------
        position : array_like of shape (..., 3)
            East, north and up in metres; nan where there is none.

        Returns
        -------
        tuple of three float or ndarray of shape (...)
            Degrees, degrees from -180 to 180, and metres above the ellipsoid.

        Raises
        ------
        ValueError
            Positions that are not in space, or an infinite number.

        Examples
        --------
        >>> from tertia.geo import LocalFrame
        >>> latitude, longitude, height = LocalFrame(50.0, 14.0).to_geodetic([0.0, 0.0, 100.0])
        >>> round(latitude, 9), round(longitude, 9), round(height, 6)
        (50.0, 14.0, 100.0)
        """
        found = _to_geodetic(self.to_ecef(position))
        latitude, longitude, height = (scalar_or_array(found[..., i].copy()) for i in (0, 1, 2))
        return latitude, longitude, height

    def from_ecef(self, ecef: npt.ArrayLike) -> FloatArray:
        """Return east, north and up of geocentric positions.

        Parameters
        ----------
        ecef : array_like of shape (..., 3)
            Earth-centred, earth-fixed x, y and z in metres; nan where there is no position.

        Returns
        -------
        local : ndarray of shape (..., 3)
            Metres; nan where there is none.

        Raises
        ------
        ValueError
            A wrong shape or an infinite number.

        Examples
        --------
        >>> from tertia.geo import LocalFrame
        >>> LocalFrame(0.0, 0.0).from_ecef([6378137.0, 10.0, 20.0])
        array([10., 20.,  0.])
        """
        local: FloatArray = (_points(ecef, "ecef") - self._origin()) @ self._rotation().T
        return local

    def to_ecef(self, position: npt.ArrayLike) -> FloatArray:
        """Return geocentric positions.

        Parameters
        ----------
        position : array_like of shape (..., 3)
            East, north and up in metres; nan where there is no position.

        Returns
        -------
        ecef : ndarray of shape (..., 3)
            Earth-centred, earth-fixed x, y and z in metres; nan where there is none.

        Raises
        ------
        ValueError
            As `from_ecef`.

        Examples
        --------
        >>> from tertia.geo import LocalFrame
        >>> LocalFrame(0.0, 0.0).to_ecef([10.0, 20.0, 0.0])
        array([6.378137e+06, 1.000000e+01, 2.000000e+01])
        """
        return self._origin() + _points(position, "position") @ self._rotation()

    def axes(self, latitude: npt.ArrayLike, longitude: npt.ArrayLike) -> FloatArray:
        """Return the east, north and up axes of other places, as rows, in this frame.

        Parameters
        ----------
        latitude, longitude : array_like of shape (...)
            Degrees.

        Returns
        -------
        ndarray of shape (..., 3, 3)
            Rotations: `axes @ v` is a vector `v` of this frame in the axes of the place.

        Raises
        ------
        ValueError
            A latitude beyond the poles or an infinite number.

        Examples
        --------
        The vertical half a degree further north:

        >>> from tertia.geo import LocalFrame
        >>> LocalFrame(50.0, 14.0).axes(50.5, 14.0)[2, 1:].round(5)
        array([0.00873, 0.99996])
        """
        axes: FloatArray = _rotation(latitude, longitude) @ self._rotation().T
        return axes

    def station(
        self,
        latitude: npt.ArrayLike,
        longitude: npt.ArrayLike,
        height: npt.ArrayLike = 0.0,
        *,
        range_sigma: float | None = None,
        azimuth_sigma: float | None = None,
        elevation_sigma: float | None = None,
        name: str | None = None,
    ) -> Station:
        """Return a station at a place, with its own axes.

        Parameters
        ----------
        latitude, longitude : array_like of shape (...)
            Degrees; arrays if the station moves.
        height : array_like of shape (...)
            Metres above the ellipsoid.
        range_sigma, azimuth_sigma, elevation_sigma : float, optional
            See `tertia.sensors.Station`.
        name : str, optional
            Label in pictures.

        Returns
        -------
        Station
            Its azimuths are relative to true north, its elevations to the plane tangent to the
            ellipsoid.

        Raises
        ------
        ValueError
            A number outside its domain.

        Examples
        --------
        >>> from tertia.geo import LocalFrame
        >>> LocalFrame(50.0, 14.0).station(50.1, 14.1, 300.0).position.round()
        array([ 7155., 11128.,   286.])
        """
        position = self.to_local(latitude, longitude, height)
        axes = self.axes(latitude, longitude)
        return Station(
            position,
            range_sigma=range_sigma,
            azimuth_sigma=azimuth_sigma,
            elevation_sigma=elevation_sigma,
            name=name,
            axes=np.broadcast_to(axes, (*position.shape, 3)),
        )

    def _origin(self) -> FloatArray:
        return _to_ecef(self.latitude, self.longitude, self.height)

    def _rotation(self) -> FloatArray:
        return _rotation(self.latitude, self.longitude)


@cache
def _transformer() -> Transformer:
    """Return the transformation from latitude, longitude and height to geocentric coordinates."""
    try:
        from pyproj import Transformer  # noqa: PLC0415  # only here is pyproj needed
    except ImportError as error:
        raise ImportError("tertia.geo needs pyproj: pip install 'tertia[geo]'") from error
    return Transformer.from_crs(_GEODETIC, _GEOCENTRIC)


def _to_ecef(
    latitude: npt.ArrayLike, longitude: npt.ArrayLike, height: npt.ArrayLike
) -> FloatArray:
    given = {"latitude": latitude, "longitude": longitude, "height": height}
    arrays = {name: _numbers(value, name) for name, value in given.items()}
    try:
        places = np.stack(np.broadcast_arrays(*arrays.values()), axis=-1)
    except ValueError:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise ValueError(f"the shapes do not fit together: {shapes}") from None
    known = ~np.isnan(places).any(axis=-1)
    ecef = np.full(places.shape, np.nan)
    ecef[known] = np.stack(_transformer().transform(*places[known].T), axis=-1)
    return ecef


def _to_geodetic(ecef: FloatArray) -> FloatArray:
    """Return latitude, longitude and height as columns."""
    known = ~np.isnan(ecef).any(axis=-1)
    x, y, z = ecef[known].T
    latitude, longitude, height = _transformer().transform(x, y, z, direction="INVERSE")
    # pyproj takes one step of an iteration: .4 m are left 36,000 km high
    missed = ecef[known] - _to_ecef(latitude, longitude, height)
    _, north, up = np.moveaxis(_rotation(latitude, longitude) @ missed[..., np.newaxis], 1, 0)
    squeezed = 1 - _ECCENTRICITY_SQUARED * np.sin(np.radians(latitude)) ** 2
    radius = _RADIUS * (1 - _ECCENTRICITY_SQUARED) / squeezed**1.5
    latitude = np.clip(latitude + np.degrees(north[:, 0] / (radius + height)), -_POLE, _POLE)
    found = np.full(ecef.shape, np.nan)
    found[known] = np.stack([latitude, longitude, height + up[:, 0]], axis=-1)
    return found


def _rotation(latitude: npt.ArrayLike, longitude: npt.ArrayLike) -> FloatArray:
    """Return east, north and up of places as rows, in geocentric coordinates."""
    angles = np.broadcast_arrays(_numbers(latitude, "latitude"), _numbers(longitude, "longitude"))
    phi, theta = np.radians(angles)
    zero = np.zeros(phi.shape)
    rows = [
        [-np.sin(theta), np.cos(theta), zero],
        [-np.sin(phi) * np.cos(theta), -np.sin(phi) * np.sin(theta), np.cos(phi)],
        [np.cos(phi) * np.cos(theta), np.cos(phi) * np.sin(theta), np.sin(phi)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _points(value: npt.ArrayLike, name: str) -> FloatArray:
    array = _numbers(value, name)
    if array.shape[-1:] != (3,):
        raise ValueError(f"{name} has shape {array.shape}; it must be (..., 3)")
    return array


def _numbers(value: npt.ArrayLike, name: str) -> FloatArray:
    """Return numbers after checking that they are within their domain; nan means missing."""
    array = samples(value, name)
    most = _POLE if name == "latitude" else _LARGEST
    domain = "between -90 and 90 degrees" if name == "latitude" else "a finite number"
    require_each(array, ~(np.abs(array) > most), name, domain)
    return array
