"""Conversions that all frames on the earth have in common."""

from __future__ import annotations

from typing import ClassVar

import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray
from tertia.geo._arrays import (
    batch,
    columns,
    ecef_of,
    geodetic,
    origin,
    places_of,
    positions,
    set_origin,
)


class Frame:
    """A frame with an origin on the earth: the base class of `LocalFrame` and `SystemPlane`."""

    __slots__ = ()

    latitude: float
    longitude: float
    height: float
    _is_plane: ClassVar[bool]

    def __init__(self, latitude: float, longitude: float, height: float = 0.0) -> None:
        set_origin(self, latitude, longitude, height)

    def to_local(
        self,
        latitude: npt.ArrayLike,
        longitude: npt.ArrayLike,
        height: npt.ArrayLike = 0.0,
    ) -> FloatArray:
        """Convert geodetic coordinates to positions in the frame.

        Parameters
        ----------
        latitude, longitude : array_like of shape (...)
            In degrees; nan where a place is missing.
        height : array_like of shape (...)
            Height in metres above the ellipsoid.

        Returns
        -------
        ndarray of shape (..., 3)
            East, north and up in metres; nan where a place is missing. In a system plane, up is the
            height above the ellipsoid.

        Raises
        ------
        ValueError
            If a latitude is beyond the poles, a number is infinite, or shapes do not fit.

        Examples
        --------
        >>> from tertia.geo import LocalFrame
        >>> LocalFrame(50.0, 14.0).to_local(50.0, 15.0, 0.0).round()
        array([71692.,   479.,  -402.])
        """
        return self.from_ecef(ecef_of(geodetic(latitude, longitude, height)))

    def to_geodetic(
        self, position: npt.ArrayLike
    ) -> tuple[float | FloatArray, float | FloatArray, float | FloatArray]:
        """Convert positions in the frame to latitude, longitude and height.

        Parameters
        ----------
        position : array_like of shape (..., 3)
            East, north and up in metres; nan where one is missing. In a system plane, up is the
            height above the ellipsoid.

        Returns
        -------
        tuple of three float or ndarray of shape (...)
            Latitude in degrees, longitude in degrees from -180 to 180, and height in metres above
            the ellipsoid.

        Raises
        ------
        ValueError
            If positions do not have three components, or a number is infinite.

        Examples
        --------
        >>> from tertia.geo import LocalFrame
        >>> latitude, longitude, height = LocalFrame(50.0, 14.0).to_geodetic([0.0, 0.0, 100.0])
        >>> round(latitude, 9), round(longitude, 9), round(height, 6)
        (50.0, 14.0, 100.0)
        """
        return columns(places_of(self.to_ecef(position)))

    def from_ecef(self, ecef: npt.ArrayLike) -> FloatArray:
        """Convert geocentric positions to positions in the frame.

        Parameters
        ----------
        ecef : array_like of shape (..., 3)
            Earth-centred, earth-fixed x, y and z in metres; nan where one is missing.

        Returns
        -------
        local : ndarray of shape (..., 3)
            As from `to_local`.

        Raises
        ------
        ValueError
            If a shape is wrong or a number is infinite.

        Examples
        --------
        >>> from tertia.geo import LocalFrame
        >>> LocalFrame(0.0, 0.0).from_ecef([6378137.0, 10.0, 20.0])
        array([10., 20.,  0.])
        """
        return batch(self._frame.from_ecef, positions(ecef, "ecef"))

    def to_ecef(self, position: npt.ArrayLike) -> FloatArray:
        """Convert positions in the frame to geocentric positions.

        Parameters
        ----------
        position
            As for `to_geodetic`.

        Returns
        -------
        ecef : ndarray of shape (..., 3)
            Earth-centred, earth-fixed x, y and z in metres; nan where one is missing.

        Raises
        ------
        ValueError
            As for `from_ecef`.

        Examples
        --------
        >>> from tertia.geo import LocalFrame
        >>> LocalFrame(0.0, 0.0).to_ecef([10.0, 20.0, 0.0])
        array([6.378137e+06, 1.000000e+01, 2.000000e+01])
        """
        return batch(self._frame.to_ecef, positions(position, "position"))

    @property
    def _frame(self) -> _core.Frame:
        return _core.Frame(origin(self), is_plane=self._is_plane)
