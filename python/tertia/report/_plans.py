"""Conformance of tracks to their flight plans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tertia._arrays import BoolArray, FloatArray
from tertia.flightplan import FlightPlan
from tertia.tables._track import plan_names
from tertia.tracker import TrackTable

# least number of successive plots off the plan, and least duration in scans of the slowest radar,
# after which the plan counts as left
_ROW, _SCANS = 5, 3
# distance in metres from the end of a plan at which monitoring ends
_ENDS = 3000.0


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """A track and its plan, with the times of conformance and the cross-track distance in metres.

    `left` is the time in seconds at which the aircraft left the plan, for the longest time if it
    did so repeatedly, and `back` the time at which it followed the plan again; nan if this did not
    happen.
    """

    track: int
    plan: int
    name: str
    time: FloatArray
    cross_track: FloatArray
    conforms: BoolArray
    left: float
    back: float


def followed(table: TrackTable, plans: Sequence[FlightPlan], scan_period: float) -> list[Followed]:
    """Return the confirmed tracks that have or had plans, in the order of the plans.

    `scan_period` is the scan period of the slowest radar.
    """
    found, names = [], plan_names(plans)
    updated = (table.plot >= 0) & table.confirmed
    for number in np.unique(table.track[updated & (table.plan >= 0)]):
        own = np.flatnonzero(updated & (table.track == number))
        own = own[np.argsort(table.time[own], kind="stable")]
        known = table.plan[own]
        plan = int(np.argmax(np.bincount(known[known >= 0])))
        # rows before the track was correlated with the plan do not count
        own = own[int(np.argmax(known == plan)) :]
        on = (table.plan[own] == plan) & table.conforms[own]
        path = plans[plan].project(table.position[own])
        along_track, cross_track = np.asarray(path.along_track), np.asarray(path.cross_track)
        # at the end of its plan a flight is no longer monitored
        ended = np.flatnonzero(on & (along_track > plans[plan].length - _ENDS))
        kept = slice(None, int(ended[0]) if len(ended) else None)
        time, cross_track, on = table.time[own][kept], cross_track[kept], on[kept]
        if len(time) < _ROW:
            continue
        left, back = _departure(time, on, _SCANS * scan_period)
        found.append(Followed(int(number), plan, names[plan], time, cross_track, on, left, back))
    return sorted(_flights(found), key=lambda one: (one.plan, one.time[0]))


def _flights(found: Sequence[Followed]) -> list[Followed]:
    """Remove tracks that overlap in time with a longer track that has the same plan."""
    kept: list[Followed] = []
    for one in sorted(found, key=lambda one: -len(one.time)):
        middle = float(np.median(one.time))
        beside = (o for o in kept if o.plan == one.plan and o.time[0] < middle < o.time[-1])
        if next(beside, None) is None:
            kept.append(one)
    return kept


def _departure(time: FloatArray, on: BoolArray, lasting: float) -> tuple[float, float]:
    """Return the times of the longest departure, if it lasted long enough, and of the return."""
    longest, times = lasting, (np.nan, np.nan)
    edges = np.flatnonzero(np.diff(on, prepend=True, append=True))
    for begin, end in edges.reshape(-1, 2):
        duration = time[end - 1] - time[begin]
        if end - begin >= _ROW and duration >= longest:
            back = float(time[end]) if end < len(time) else np.nan
            longest, times = duration, (float(time[begin]), back)
    return times
