"""Flight plans: where an aircraft has said it will fly, and how fast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, finite, positive, real

__all__ = ["FlightPlan"]


@dataclass(frozen=True, slots=True, eq=False, init=False)
class FlightPlan:
    """A route of straight legs whose turns are flown by the waypoints, and its speeds.

    Attributes
    ----------
    waypoints : ndarray of shape (N, 2)
        East and north in metres.
    speeds : ndarray of shape (N - 1,)
        Ground speed on each leg in metres per second.
    start_time : float
        Seconds at the first waypoint.
    heights : ndarray of shape (N,) or None
        Metres at the waypoints; None where the plan has no levels.
    bank : float
        Bank angle of its turns in radians.
    turn_rate : float
        Largest rate of turn in radians per second.
    identity : int or None
        What the transponder answers.
    name : str or None
        How pictures and reports call it.
    """

    waypoints: FloatArray
    speeds: FloatArray
    start_time: float
    heights: FloatArray | None
    bank: float
    turn_rate: float
    identity: int | None
    name: str | None

    def __init__(
        self,
        waypoints: npt.ArrayLike,
        speeds: npt.ArrayLike,
        *,
        start_time: float = 0.0,
        heights: npt.ArrayLike | None = None,
        bank: float = float(np.radians(25.0)),
        turn_rate: float = float(np.radians(3.0)),
        identity: int | None = None,
        name: str | None = None,
    ) -> None:
        places = finite(waypoints, "waypoints")
        if places.ndim != 2 or places.shape[1] != 2 or len(places) < 2:
            raise ValueError(
                f"waypoints has shape {places.shape}; it must be (N, 2) with two or more waypoints"
            )
        legs = np.broadcast_to(positive(speeds, "speeds"), len(places) - 1).copy()
        object.__setattr__(self, "waypoints", places)
        object.__setattr__(self, "speeds", legs)
        object.__setattr__(self, "start_time", real(start_time, "start_time"))
        levels = (
            None if heights is None else np.broadcast_to(finite(heights, "heights"), len(places))
        )
        object.__setattr__(self, "heights", levels)
        object.__setattr__(self, "bank", float(positive(real(bank, "bank"), "bank")))
        object.__setattr__(
            self, "turn_rate", float(positive(real(turn_rate, "turn_rate"), "turn_rate"))
        )
        object.__setattr__(self, "identity", identity)
        object.__setattr__(self, "name", name)
