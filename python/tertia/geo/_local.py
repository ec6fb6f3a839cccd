"""Local frames of east, north and up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, radians
from tertia.geo._arrays import (
    axes_of,
    batch,
    columns,
    degrees_of,
    geodetic,
    numbers,
    stacked,
)
from tertia.geo._frame import Frame
from tertia.sensors import Station


@dataclass(frozen=True, slots=True, init=False)
class LocalFrame(Frame):
    """A local frame with axes east, north and up at a place on the earth.

    Attributes
    ----------
    latitude, longitude : float
        Latitude and longitude of the origin in degrees.
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

    _is_plane: ClassVar = False

    def polar_to_geodetic(
        self,
        range: npt.ArrayLike,  # noqa: A002  # its name everywhere
        azimuth: npt.ArrayLike,
        height: npt.ArrayLike,
    ) -> tuple[float | FloatArray, float | FloatArray, float | FloatArray]:
        """Convert plots of a radar at the origin to geodetic coordinates.

        The radar does not measure the elevation, which is computed from the range and the height of
        the target.

        Parameters
        ----------
        range : array_like of shape (...)
            Slant ranges in metres, already corrected for refraction.
        azimuth : array_like of shape (...)
            Azimuths in radians, clockwise from true north (not from magnetic or grid north).
        height : array_like of shape (...)
            Heights of the targets above the ellipsoid in metres.

        Returns
        -------
        tuple of three float or ndarray of shape (...)
            Latitude and longitude in degrees, and height in metres. They are nan where no elevation
            gives the height of the target, because the range is shorter than the difference of the
            heights or is too long.

        Raises
        ------
        ValueError
            If azimuths appear to be in degrees, a number is infinite, or shapes do not fit.

        Examples
        --------
        >>> import numpy as np
        >>> from tertia.geo import LocalFrame
        >>> site = LocalFrame(50.1, 14.26, 380.0)
        >>> latitude, longitude, height = site.polar_to_geodetic(100e3, np.radians(60.0), 10_500.0)
        >>> round(latitude, 9), round(longitude, 9)
        (50.540507038, 15.47441808)
        """
        plots = stacked(
            range=numbers(range, "range"),
            azimuth=numbers(radians(azimuth, "azimuth"), "azimuth"),
            height=numbers(height, "height"),
        )
        return columns(degrees_of(batch(self._frame.polar_to_geodetic, plots)))

    def geodetic_to_polar(
        self, latitude: npt.ArrayLike, longitude: npt.ArrayLike, height: npt.ArrayLike
    ) -> tuple[float | FloatArray, float | FloatArray, float | FloatArray]:
        """Convert geodetic coordinates to range, azimuth and elevation from the origin.

        Parameters
        ----------
        latitude, longitude : array_like of shape (...)
            In degrees.
        height : array_like of shape (...)
            Height in metres above the ellipsoid.

        Returns
        -------
        tuple of three float or ndarray of shape (...)
            Slant range in metres, azimuth in radians from 0 to 2π, and elevation in radians.

        Raises
        ------
        ValueError
            If a latitude is beyond the poles, a number is infinite, or shapes do not fit.

        Examples
        --------
        >>> from tertia.geo import LocalFrame
        >>> site = LocalFrame(50.1, 14.26, 380.0)
        >>> seen = site.geodetic_to_polar(50.540507037672, 15.474418080426, 10.5e3)
        >>> [round(value, 6) for value in seen]
        [100000.0, 1.047198, 0.093588]
        """
        places = geodetic(latitude, longitude, height)
        return columns(batch(self._frame.geodetic_to_polar, places))

    def axes(self, latitude: npt.ArrayLike, longitude: npt.ArrayLike) -> FloatArray:
        """Return the unit vectors east, north and up at other places, as rows, in this frame.

        Parameters
        ----------
        latitude, longitude : array_like of shape (...)
            In degrees.

        Returns
        -------
        ndarray of shape (..., 3, 3)
            Rotation matrices: if `v` is a vector in this frame, `axes @ v` is the same vector in
            the axes of the place.

        Raises
        ------
        ValueError
            If a latitude is beyond the poles or a number is infinite.

        Examples
        --------
        The direction of the vertical half a degree north of the origin:

        >>> from tertia.geo import LocalFrame
        >>> LocalFrame(50.0, 14.0).axes(50.5, 14.0)[2, 1:].round(5)
        array([0.00873, 0.99996])
        """
        own = axes_of(self.latitude, self.longitude)
        axes: FloatArray = axes_of(latitude, longitude) @ own.T
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
            Latitudes and longitudes in degrees; arrays if the station moves.
        height : array_like of shape (...)
            Height in metres above the ellipsoid.
        range_sigma, azimuth_sigma, elevation_sigma : float, optional
            As for `tertia.sensors.Station`.
        name : str, optional
            Label of the station in pictures.

        Returns
        -------
        Station
            The station. Its azimuths are relative to true north, and its elevations to the plane
            tangent to the ellipsoid.

        Raises
        ------
        ValueError
            If a number is outside its domain.

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
