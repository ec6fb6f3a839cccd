"""The distance between two sets of positions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray, IntArray, points, positive_number, real
from tertia._result import Result


@dataclass(frozen=True, slots=True, eq=False)
class Gospa(Result):
    """The generalised optimal sub-pattern assignment (GOSPA) metric, and its parts.

    Attributes
    ----------
    distance : float
        The metric, in metres: `(localisation + missed + false)^(1/p)`.
    localisation : float
        Sum of the distances of estimates from their targets, with each distance raised to the power
        `p`.
    missed : float
        Cost of the targets without an estimate.
    false : float
        Cost of the estimates without a target.
    """

    _rows: ClassVar = "distance", 0

    distance: float
    localisation: float
    missed: float
    false: float

    def __repr__(self) -> str:
        """Return the metric and its parts as text."""
        return (
            f"Gospa({self.distance:.6g}: localisation {self.localisation:.6g}, "
            f"missed {self.missed:.6g}, false {self.false:.6g})"
        )


def gospa(
    estimates: npt.ArrayLike,
    truth: npt.ArrayLike,
    cutoff: float,
    p: float = 2.0,
    alpha: float = 2.0,
) -> Gospa:
    """Return the distance of a set of estimated positions from the true positions.

    Parameters
    ----------
    estimates : array_like of shape (N, m)
        Estimated positions at one instant, in m = 2 or 3 dimensions.
    truth : array_like of shape (M, m)
        True positions at the same instant.
    cutoff : float
        Distance in metres at and beyond which an estimate counts as false and its target as missed.
    p : float
        Exponent, at least 1. Larger values give more weight to large errors.
    alpha : float
        Divisor, above 0 and at most 2: each missed target and each false estimate costs `cutoff**p`
        divided by it.

    Returns
    -------
    Gospa
        The metric and its parts.

    Raises
    ------
    ValueError, TypeError
        If the shapes of the positions do not fit, `cutoff` or the exponent is outside its domain,
        or an argument has the wrong type.

    Notes
    -----
    The metric is that of Rahmathullah, Garcia-Fernandez and Svensson (2017), definition 1. Each
    element of the smaller set is assigned to another element of the larger set, so that the sum of
    `min(d, cutoff)^p` over all pairs is smallest; each element of the larger set that remains adds
    `cutoff^p / alpha`. A pair whose distance reaches the cutoff counts as one missed target and one
    false estimate, each with half of the cost of the pair. Only with `alpha = 2` do all missed
    targets and false estimates have the same cost.

    Examples
    --------
    One target has an error of 3 m, one is missed, and one estimate is false:

    >>> from tertia import metrics
    >>> metrics.gospa([[3, 0], [500, 0]], [[0, 0], [0, 90]], cutoff=10)
    Gospa(10.4403: localisation 9, missed 50, false 50)
    """
    found, true = points(estimates, "estimates"), points(truth, "truth")
    if found.shape[-1] != true.shape[-1]:
        raise ValueError(f"estimates has shape {found.shape} and truth {true.shape}")
    limit = positive_number(cutoff, "cutoff")
    power, divisor = real(p, "p"), real(alpha, "alpha")
    if not 1.0 <= power < np.inf:
        raise ValueError(f"p is {power}; it must be at least 1")
    if not 0.0 < divisor <= 2.0:
        raise ValueError(f"alpha is {divisor}; it must be above 0 and at most 2")
    try:
        unit = limit**power
    except OverflowError:
        reason = f"cutoff is {limit:g} and p {power:g}; cutoff**p must be a finite number"
        raise ValueError(reason) from None
    n, m = len(found), len(true)
    row, column, distance = pairs_within(found, true, limit)
    # in units of the cutoff, so that no power overflows
    cost = (distance / limit) ** power
    chosen = _core.assign_pairs(row, column, 1.0 - cost, n, m, "gnn")
    mine = chosen[row] == column
    at_cutoff = min(n, m) - np.count_nonzero(mine)
    localisation = float(np.sum(cost[mine]))
    missed = at_cutoff / 2 + max(m - n, 0) / divisor
    false = at_cutoff / 2 + max(n - m, 0) / divisor
    total = localisation + missed + false
    return Gospa(limit * total ** (1 / power), unit * localisation, unit * missed, unit * false)


def pairs_within(
    points: FloatArray, others: FloatArray, limit: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return the indices and distances of all pairs of points that are within a given distance."""
    m = points.shape[-1]
    # in units of the limit, so that squares stay in range
    unit = np.broadcast_to(np.eye(m), (len(points), m, m))
    row, column, square, _ = _core.gate_pairs(points / limit, unit, others / limit, None, 1.0)
    return row, column, limit * np.sqrt(square)
