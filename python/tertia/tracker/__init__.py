"""Tracker: makes tracks from radar plots, scan by scan or for a whole recording.

Plots are polar, from one radar or from several that rotate independently. Targets fly straight,
turn, or change their speed; interacting multiple models estimate which of these motions is
present. Other sensors may report positions, or azimuths without ranges. Azimuths are in radians,
clockwise from north; positions are given as local east and north coordinates in metres.
"""

from tertia.kalman import SingerModel
from tertia.sensors import Channel, PositionSensor, Radar
from tertia.sensors._identities import NO_IDENTITY
from tertia.tracker._models import (
    Association,
    AssociationName,
    CvModel,
    ImmModel,
    Mht,
    Motion,
    MotionName,
    PaperScore,
    PlanModel,
    ProfileName,
    WindowModel,
)
from tertia.tracker._plots import Plots, PlotStatus
from tertia.tracker._recording import track
from tertia.tracker._smooth import (
    Longitudinal,
    SmoothedTracks,
    Transversal,
    Vertical,
    smooth_tracks,
)
from tertia.tracker._table import COLUMNS, Column, TrackTable
from tertia.tracker._tracker import Tracker

__all__ = [
    "COLUMNS",
    "NO_IDENTITY",
    "Association",
    "AssociationName",
    "Channel",
    "Column",
    "CvModel",
    "ImmModel",
    "Longitudinal",
    "Mht",
    "Motion",
    "MotionName",
    "PaperScore",
    "PlanModel",
    "PlotStatus",
    "Plots",
    "PositionSensor",
    "ProfileName",
    "Radar",
    "SingerModel",
    "SmoothedTracks",
    "TrackTable",
    "Tracker",
    "Transversal",
    "Vertical",
    "WindowModel",
    "smooth_tracks",
    "track",
]
