"""Other meanings of the numbers of a kind of measurement, such as another zero or unit."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from tertia._arrays import FloatArray
from tertia.sensors import Kind

CONTRADICTION = "contradict each other at most instants, and would agree"

Change = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class Convention:
    """Another meaning of the numbers of one kind, and how to get from it to the usual one."""

    kind: Kind
    said: str
    usual: Change

    @property
    def message(self) -> str:
        """What is said of measurements that follow this convention."""
        names = "range differences" if self.kind == "range_difference" else f"{self.kind}s"
        return f"the {names} {CONTRADICTION} if they were {self.said}"


_QUARTER = math.pi / 2
CONVENTIONS = (
    Convention(
        "azimuth",
        "anticlockwise from east, or if east and north of the sensors were exchanged",
        lambda angle: _QUARTER - angle,
    ),
    Convention("azimuth", "anticlockwise from north", lambda angle: -angle),
    Convention(
        "azimuth",
        "clockwise from south, or if they were directions from the target to the sensor",
        lambda angle: angle + math.pi,
    ),
    Convention("azimuth", "in gradians, 400 to a turn", lambda angle: 0.9 * angle),
    Convention("elevation", "measured from the zenith", lambda angle: _QUARTER - angle),
    Convention("elevation", "positive downwards", lambda angle: -angle),
    Convention("range", "there and back", lambda metres: metres / 2),
    Convention("range", "in feet", lambda feet: 0.3048 * feet),
    Convention("range", "in millimetres", lambda millimetres: millimetres / 1000.0),
    Convention("range", "in centimetres", lambda centimetres: centimetres / 100.0),
    Convention("range", "in kilometres", lambda kilometres: 1000.0 * kilometres),
    Convention("range", "in nautical miles", lambda miles: 1852.0 * miles),
    Convention(
        "range_difference",
        "the range of the first sensor minus that of the other one",
        lambda metres: -metres,
    ),
)
