"""Geo: local frames on the earth, the system plane of several radars, and states of targets.

A `LocalFrame` is tangent to the WGS 84 ellipsoid at its origin. Far from the origin, the local
directions differ from the axes of the frame: the vertical differs by one degree per 111 km, and
north by the convergence of the meridians. The azimuths and elevations of a station therefore refer
to its own axes. A `SystemPlane` is the stereographic plane in which systems exchange tracks of
several radars.

Latitudes and longitudes are in degrees, as in satellite receivers and on maps. Heights are in
metres above the ellipsoid, not above sea level, and are not pressure altitudes (see `Atmosphere`).
All other lengths are in metres, and all other angles in radians, as elsewhere in Tertia.
"""

from tertia.geo._atmosphere import Atmosphere
from tertia.geo._frames import LocalFrame, SystemPlane
from tertia.geo._states import cartesian_to_polar, polar_to_cartesian, transform

__all__ = [
    "Atmosphere",
    "LocalFrame",
    "SystemPlane",
    "cartesian_to_polar",
    "polar_to_cartesian",
    "transform",
]
