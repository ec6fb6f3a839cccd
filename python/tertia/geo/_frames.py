"""Local frames of east, north and up, and the system plane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, finite, radians, scalar_or_array
from tertia.geo._arrays import (
    axes_of,
    batch,
    columns,
    degrees_of,
    geodetic,
    numbers,
    positions,
    stacked,
)
from tertia.geo._frame import Frame
from tertia.sensors import Bias, Radar, Station


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
            Slant range in metres, azimuth in radians in [0, 2π), and elevation in radians.

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
        arrival_time_sigma: float | None = None,
        position_sigma: float = 0.0,
        bias: Bias | None = None,
        name: str | None = None,
    ) -> Station:
        """Return a station at a place, with its own axes.

        Parameters
        ----------
        latitude, longitude : array_like of shape (...)
            Latitudes and longitudes in degrees; arrays if the station moves.
        height : array_like of shape (...)
            Height in metres above the ellipsoid.
        range_sigma, azimuth_sigma, elevation_sigma, arrival_time_sigma, position_sigma, bias
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
            arrival_time_sigma=arrival_time_sigma,
            position_sigma=position_sigma,
            bias=bias,
            name=name,
            axes=np.broadcast_to(axes, (*position.shape, 3)),
        )

    def radar(
        self, latitude: float, longitude: float, height: float = 0.0, **properties: Any
    ) -> Radar:
        """Return a radar whose tracks are in the system plane about the origin of this frame.

        Use `SystemPlane(frame.latitude, frame.longitude)` to convert the positions of tracks.
        Unlike the tangent plane of the frame, the system plane has a scale of nearly 1 far from the
        origin, and its heights are above the ellipsoid.

        Parameters
        ----------
        latitude, longitude, height, **properties
            As for `SystemPlane.radar`.

        Returns
        -------
        Radar
            The radar, as returned by `SystemPlane.radar`.

        Raises
        ------
        ValueError, TypeError
            As for `SystemPlane.radar`.

        Examples
        --------
        >>> from tertia.geo import LocalFrame
        >>> LocalFrame(50.0, 14.0).radar(
        ...     50.1, 14.26, 380.0, range_sigma=50.0, azimuth_sigma=1e-3, scan_period=4.0
        ... ).position.round()
        array([18602., 11155.,   380.])
        """
        plane = SystemPlane(self.latitude, self.longitude)
        return plane.radar(latitude, longitude, height, **properties)


@dataclass(frozen=True, slots=True, init=False)
class SystemPlane(Frame):
    """The stereographic plane in which the tracks of several radars are given.

    It is the oblique stereographic projection of a sphere that has the radius of curvature of the
    meridian, as is usual in air traffic control (TransLib, ARTAS) and in item 100 of ASTERIX
    category 62. It differs from the projection `sterea` of PROJ (EPSG 9809) by up to 1 m within 450
    km of the centre, and from `stere` by 9 to 51 m. Files of other systems may use one of these two
    projections.

    For targets at a height of 10 km, lengths in the plane are 0.15 % too short at 100 km from the
    centre, and 0.06 % too short at 400 km: see `scale_and_convergence`.

    Attributes
    ----------
    latitude, longitude : float
        Latitude and longitude of the centre in degrees.
    height : float
        Height of the centre above the ellipsoid in metres.

    Raises
    ------
    ValueError, TypeError
        If a latitude is beyond the poles, or a number is not finite.

    Examples
    --------
    Two radars detect the same aircraft, and their plots have the same position in the plane:

    >>> import numpy as np
    >>> from tertia.geo import SystemPlane
    >>> from tertia.tracker import Plots
    >>> plane = SystemPlane(50.0, 14.0)
    >>> kind = {"range_sigma": 50.0, "azimuth_sigma": 1e-4, "scan_period": 4.0}
    >>> radars = [plane.radar(50.1, 14.26, 380.0, **kind), plane.radar(51.2, 15.0, 600.0, **kind)]
    >>> seen = [radar.site.geodetic_to_polar(50.5, 15.0, 10e3) for radar in radars]
    >>> plots = Plots(0.0 * np.arange(2), *np.transpose(seen)[:2], sensor=[0, 1], height=10e3)
    >>> position, covariance = plots.to_cartesian(radars)
    >>> position.round(2)
    array([[70949.09, 56093.33],
           [70949.09, 56093.33]])
    """

    latitude: float
    longitude: float
    height: float

    _is_plane: ClassVar = True

    def scale_and_convergence(
        self, position: npt.ArrayLike
    ) -> tuple[float | FloatArray, float | FloatArray]:
        """Return the scale and the convergence of the plane at given positions.

        Parameters
        ----------
        position : array_like of shape (..., 3)
            East and north in the plane, and the height above the ellipsoid, in metres.

        Returns
        -------
        scale : float or ndarray of shape (...)
            Ratio of lengths in the plane to true lengths. A true speed is the speed in the plane
            divided by this scale.
        convergence : float or ndarray of shape (...)
            Direction of true north in the plane in radians. A true course is the course in the
            plane minus this angle.

        Raises
        ------
        ValueError
            If positions do not have a height, or a number is infinite.

        Examples
        --------
        >>> from tertia.geo import SystemPlane
        >>> scale, convergence = SystemPlane(50.0, 14.0).scale_and_convergence([200e3, 0.0, 10e3])
        >>> round(scale, 5), round(convergence, 5)
        (0.99868, -0.03727)
        """
        found = batch(self._frame.scale_and_convergence, positions(position, "position"))
        scale, convergence = (scalar_or_array(found[..., i].copy()) for i in (0, 1))
        return scale, convergence

    def radar(
        self, latitude: float, longitude: float, height: float = 0.0, **properties: Any
    ) -> Radar:
        """Return a radar at a place.

        Parameters
        ----------
        latitude, longitude : float
            In degrees.
        height : float
            Height in metres above the ellipsoid, which in Central Europe is about 45 m larger than
            the height above sea level.
        **properties
            As for `tertia.sensors.Radar`.

        Returns
        -------
        Radar
            The radar. Its azimuths are relative to true north. The tracks of a tracker with this
            radar are in this plane.

        Raises
        ------
        ValueError, TypeError
            As for `Radar`.

        Examples
        --------
        >>> from tertia.geo import SystemPlane
        >>> SystemPlane(50.0, 14.0).radar(
        ...     50.1, 14.26, 380.0, range_sigma=50.0, azimuth_sigma=1e-3, scan_period=4.0
        ... ).position.round()
        array([18602., 11155.,   380.])
        """
        return Radar(self.to_local(latitude, longitude, height), frame=self, **properties)

    def station(
        self,
        latitude: float,
        longitude: float,
        height: float = 0.0,
        *,
        azimuth_sigma: float | None = None,
        name: str | None = None,
    ) -> Station:
        """Return a station at a place, whose azimuths update tracks in this plane.

        Parameters
        ----------
        latitude, longitude, height, azimuth_sigma, name
            As for `LocalFrame.station`, for one place.

        Returns
        -------
        Station
            The station. Its azimuths are relative to true north. Lines of sight are treated as
            straight lines in the plane. For a station 250 km from the centre, the resulting error
            of the azimuth is 0.01 degrees at a range of 100 km.

        Raises
        ------
        ValueError, TypeError
            As for `Station`; also if there is more than one place.

        Examples
        --------
        >>> from tertia.geo import SystemPlane
        >>> camera = SystemPlane(50.0, 14.0).station(50.1, 14.26, 380.0, azimuth_sigma=1e-3)
        >>> camera.position.round()
        array([18602., 11155.,   380.])
        """
        place = finite(self.to_local(latitude, longitude, height), "position")
        if place.shape != (3,):
            raise ValueError(
                f"latitude, longitude and height have shape {place.shape[:-1]}; "
                "each must be a number"
            )
        _, convergence = self.scale_and_convergence(place)
        cosine, sine = np.cos(convergence), np.sin(convergence)
        axes = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return Station(place, azimuth_sigma=azimuth_sigma, axes=axes, name=name)

    def site(self, position: npt.ArrayLike) -> LocalFrame:
        """Return the local frame at a position in the plane, such as the position of a radar.

        Parameters
        ----------
        position : array_like of shape (3,) or (2,)
            East and north in the plane, and the height above the ellipsoid, in metres; by default
            the height is 0.

        Returns
        -------
        LocalFrame
            The local frame with its origin at this position.

        Raises
        ------
        ValueError
            If a shape is wrong or a number is not finite.

        Examples
        --------
        >>> from tertia.geo import SystemPlane
        >>> site = SystemPlane(50.0, 14.0).site([0.0, 0.0, 300.0])
        >>> round(site.latitude, 9), round(site.longitude, 9), round(site.height, 6)
        (50.0, 14.0, 300.0)
        """
        place = finite(position, "position")
        if place.shape not in {(2,), (3,)}:
            raise ValueError(f"position has shape {place.shape}; it must be (2,) or (3,)")
        return LocalFrame(*self.to_geodetic(np.append(place, 0.0)[:3]))  # type: ignore[arg-type]
