"""Trajectory: positions over time from measurements of several stations, outliers excluded.

The measurements are redundant in space (several stations at one instant) and in time (many
instants). The source describes two orders of processing: each instant is located, and the positions
are then smoothed over time; or each series of measurements is smoothed over time, and the positions
are then computed. Faults are detected by comparison with other stations, not with other instants,
because a run of faults at one station can look like motion of the target.

Positions are local east, north and up in metres; azimuths and elevations are in radians, azimuths
clockwise from north.
"""

from tertia.sensors import Bias, ByKind, Station
from tertia.trajectory._arrivals import group_arrivals, reconstruct_arrivals
from tertia.trajectory._arrivals_result import Arrivals, ArrivalTrajectory
from tertia.trajectory._clocks import ClockBias
from tertia.trajectory._reconstruct import Order, Smoother, Spatial, reconstruct
from tertia.trajectory._result import Trajectory

__all__ = [
    "ArrivalTrajectory",
    "Arrivals",
    "Bias",
    "ByKind",
    "ClockBias",
    "Order",
    "Smoother",
    "Spatial",
    "Station",
    "Trajectory",
    "group_arrivals",
    "reconstruct",
    "reconstruct_arrivals",
]
