"""Sensors: positions, measurements and errors of stations and radars.

Positions are local east, north and up in metres. Azimuths and elevations are in radians; azimuths
are clockwise from north.
"""

from tertia.sensors._bias import RADAR_LIMITS, Bias
from tertia.sensors._channels import Channel
from tertia.sensors._kinds import Kind
from tertia.sensors._positions import PositionSensor
from tertia.sensors._sensors import ByKind, Radar, Station

__all__ = [
    "RADAR_LIMITS",
    "Bias",
    "ByKind",
    "Channel",
    "Kind",
    "PositionSensor",
    "Radar",
    "Station",
]
