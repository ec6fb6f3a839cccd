"""Tracks of several sensors in one picture: track-to-track association and fusion.

`FusionCentre` works cycle by cycle, `fuse_tracks` on recordings. Tracks come from `Tracker`, one
for each sensor, or from other systems, as `SensorTracks`.
"""

from tertia.tertiary._centre import FusionCentre, SystemTracks, fuse_tracks
from tertia.tertiary._tracks import SensorTracks

__all__ = ["FusionCentre", "SensorTracks", "SystemTracks", "fuse_tracks"]
