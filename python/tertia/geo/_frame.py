"""What all frames on the earth can do."""

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
    """A frame with an origin on the earth; `LocalFrame` and `SystemPlane` say of what kind."""

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
        """Return places in the frame.

        Parameters
        ----------
        latitude, longitude : array_like of shape (...)
            Degrees; nan where there is no place.
        height : array_like of shape (...)
            Metres above the ellipsoid.

        Returns
        -------
        ndarray of shape (..., 3)
            East, north and up (in a plane, the height) in metres; nan where there is no place.

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
        return self.from_ecef(ecef_of(geodetic(latitude, longitude, height)))

    def to_geodetic(
        self, position: npt.ArrayLike
    ) -> tuple[float | FloatArray, float | FloatArray, float | FloatArray]:
        """Return latitude, longitude and height of positions.

        Parameters
        ----------
        position : array_like of shape (..., 3)
            East, north and up (in a plane, the height) in metres; nan where there is none.

        Returns
        -------
        tuple of three float or ndarray of shape (...)
            Degrees, degrees from -180 to 180, and metres above the ellipsoid.

        Raises
        ------
        ValueError
            Positions that have not three components, or an infinite number.

        Examples
        --------
        >>> from tertia.geo import LocalFrame
        >>> latitude, longitude, height = LocalFrame(50.0, 14.0).to_geodetic([0.0, 0.0, 100.0])
        >>> round(latitude, 9), round(longitude, 9), round(height, 6)
        (50.0, 14.0, 100.0)
        """
        return columns(places_of(self.to_ecef(position)))

    def from_ecef(self, ecef: npt.ArrayLike) -> FloatArray:
        """Return geocentric positions in the frame.

        Parameters
        ----------
        ecef : array_like of shape (..., 3)
            Earth-centred, earth-fixed x, y and z in metres; nan where there is no position.

        Returns
        -------
        local : ndarray of shape (..., 3)
            East, north and up (in a plane, the height) in metres; nan where there is none.

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
        return batch(self._frame.from_ecef, positions(ecef, "ecef"))

    def to_ecef(self, position: npt.ArrayLike) -> FloatArray:
        """Return positions in the frame as geocentric ones.

        Parameters
        ----------
        position : array_like of shape (..., 3)
            East, north and up (in a plane, the height) in metres; nan where there is no position.

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
        return batch(self._frame.to_ecef, positions(position, "position"))

    @property
    def _frame(self) -> _core.Frame:
        return _core.Frame(origin(self), is_plane=self._is_plane)
