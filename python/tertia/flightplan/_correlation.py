"""Correlation of tracks with flight plans."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    FloatArray,
    IntArray,
    scalar_or_array,
    sequence_of,
    threads,
)
from tertia._result import Result
from tertia.flightplan._plan import FlightPlan
from tertia.flightplan._tracks import tracks_of
from tertia.sensors._identities import NO_IDENTITY, checked


class CorrelationStatus(enum.IntEnum):
    """How a plan was found (by its score, by its identity or by hand), or why there is none."""

    NONE = 0
    AMBIGUOUS = 1
    ACCEPTED = 2
    LINKED = 3
    MANUAL = 4


@dataclass(frozen=True, slots=True, eq=False)
class Correlation(Result):
    """The flight plans of tracks.

    Attributes
    ----------
    plan : int or ndarray of int, shape (...)
        Index of the plan of each track; -1 if there is none, or if the decision is ambiguous.
    status : CorrelationStatus or ndarray of int, shape (...)
        How the plan was found, or why there is none.
    scores : ndarray of shape (..., M)
        Mean score of each plan over the plots of a track, at most 0; nan if there are no plots.
    """

    _rows: ClassVar = "plan", 0

    plan: int | IntArray
    status: CorrelationStatus | IntArray
    scores: FloatArray

    def __repr__(self) -> str:
        """Return the decision, or the number of decisions of each kind."""
        if isinstance(self.status, CorrelationStatus):
            return f"Correlation({self.status.name.lower()}, plan {self.plan})"
        counts = [
            f"{np.count_nonzero(self.status == status)} {status.name.lower()}"
            for status in CorrelationStatus
            if status is not CorrelationStatus.MANUAL
        ]
        return f"Correlation({', '.join(counts)})"


def correlate(
    plans: Sequence[FlightPlan],
    time: npt.ArrayLike,
    position: npt.ArrayLike,
    velocity: npt.ArrayLike,
    *,
    covariance: npt.ArrayLike | None = None,
    height: npt.ArrayLike | None = None,
    icao_address: npt.ArrayLike | None = None,
    mode_3a: npt.ArrayLike | None = None,
    callsign: npt.ArrayLike | None = None,
    identity: npt.ArrayLike | None = None,
    n_threads: int | None = None,
) -> Correlation:
    """Find the flight plans of tracks.

    Parameters
    ----------
    plans : sequence of M FlightPlan
        The plans.
    time : array_like of shape (..., N)
        Times in seconds of the last N plots of each track; nan where there is no plot.
    position, velocity : array_like of shape (..., N, 2)
        East and north in metres, and their rates in m/s.
    covariance : array_like of shape (..., N, 4, 4), optional
        Covariance of position and velocity; by default zero.
    height : array_like of shape (..., N), optional
        Height in metres; nan where unknown.
    icao_address, mode_3a : array_like of int, shape (...), optional
        Address of 24 bits and mode 3/A code; -1 if they are not known.
    callsign : array_like of str, shape (...), optional
        Aircraft identification; empty if it is not known.
    identity : array_like of int, shape (...), optional
        Any other number by which the target is known; -1 if there is none.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    Correlation
        Plan, status and scores of each track.

    Raises
    ------
    ValueError, TypeError
        If there is no plan, shapes do not match, a number is infinite, or an argument has the wrong
        type.

    Notes
    -----
    The score of a plot is `-1/2 [e²/(700² + P) + dpsi²/((3°)² + s_psi²) + dV²/(12² + s_V²) +
    dt²/120² + dh²/150²]`, where e is the cross-track distance, and the other numerators are the
    squared differences of course, speed, time and height from the plan, on the leg that fits best.
    P, s_psi² and s_V² are the variances of the cross-track distance, the course and the speed of
    the track. A plan with the same identity as the track is linked to it if the mean score of the
    plan is above -25; of several kinds of identities that both have, the address, the `identity`,
    the callsign or the code decides, in this order. Otherwise the plan with the highest mean score
    is accepted if this score is the mean over at least five plots, is above -8, and is at least 3
    above the score of the next best plan. All other cases are left to the controller. The cost is
    O(legs) per plan and plot.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.flightplan import FlightPlan, correlate
    >>> plans = [FlightPlan([[0, y], [90e3, y]], 200.0) for y in (0.0, 20e3)]
    >>> time = np.arange(100.0, 150.0, 10.0)
    >>> position, velocity = plans[1].at(time)
    >>> correlate(plans, time, position + [300.0, -400.0], velocity)
    Correlation(accepted, plan 1)
    """
    known = sequence_of(plans, FlightPlan, "plans")
    if not known:
        raise ValueError("plans is empty; there must be one plan or more")
    tracks = tracks_of(time, position, velocity, covariance, height)
    batch = tracks["time"].shape[:-1]
    number = NO_IDENTITY if identity is None else identity
    columns = checked(icao_address, mode_3a, callsign, number)
    identities: Any = tuple(
        None if values is None else _of_each(values, name, batch)
        for name, values in columns.items()
    )
    scores, plan, status = _core.correlate(
        [plan._route for plan in known], tracks, identities, threads(n_threads)
    )
    reason = status if batch else CorrelationStatus(int(status))
    return Correlation(scalar_or_array(plan), reason, scores)


def _of_each(values: npt.NDArray[Any], name: str, batch: tuple[int, ...]) -> npt.NDArray[Any]:
    """Return the identities of all tracks in one row."""
    if values.shape not in {(), batch}:
        raise ValueError(f"{name} has shape {values.shape}; it must be {batch}")
    return np.ascontiguousarray(np.broadcast_to(values, batch).reshape(-1))
