"""Tertiary: association of the tracks of several sensors, and their fusion into one picture.

`FusionCentre` processes live tracks cycle by cycle, and `fuse_tracks` processes recordings. The
tracks are given as `SensorTracks`; they come from one `Tracker` for each sensor or from other
systems.
"""

from tertia.tertiary._centre import FusionCentre, SystemTracks, fuse_tracks
from tertia.tertiary._tracks import SensorTracks

__all__ = ["FusionCentre", "SensorTracks", "SystemTracks", "fuse_tracks"]
