"""Flight plans: planned paths of aircraft, and the conformance of tracks to them.

A plan is a route of straight legs with a ground speed on each leg. Turns are fly-by turns along
arcs that are tangent to both legs. Positions are local east and north in metres. Courses are in
radians, clockwise from north. Turn angles and cross-track distances are positive to the right.
`tertia.io.read_plans` reads plans from files.
"""

from tertia.flightplan._conformance import (
    Conformance,
    TimesOver,
    conformance,
    estimate_times_over,
)
from tertia.flightplan._correlation import Correlation, CorrelationStatus, correlate
from tertia.flightplan._plan import FlightPlan, Projection, Turns

__all__ = [
    "Conformance",
    "Correlation",
    "CorrelationStatus",
    "FlightPlan",
    "Projection",
    "TimesOver",
    "Turns",
    "conformance",
    "correlate",
    "estimate_times_over",
]
