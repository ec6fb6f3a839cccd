"""Tertiary: tracks of several sensors, associated track to track and fused into one picture.

`FusionCentre` works cycle by cycle, `fuse_tracks` on recordings. The tracks come, as
`SensorTracks`, from one `Tracker` for each sensor or from other systems.
"""

from tertia.tertiary._centre import FusionCentre, SystemTracks, fuse_tracks
from tertia.tertiary._tracks import SensorTracks

__all__ = ["FusionCentre", "SensorTracks", "SystemTracks", "fuse_tracks"]
