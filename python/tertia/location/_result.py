"""The result of `locate`."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal, TypeAlias

import numpy as np

from tertia._arrays import BoolArray, FloatArray, IntArray, Systematic, scalar_or_array
from tertia.location._arrivals import Arrivals
from tertia.sensors import Bias, ByKind, Kind, by_kind

LocationMethod: TypeAlias = Literal[
    "robust", "least-squares", "lenth-mle", "lenth-huber", "lenth-andrews"
]


class LocationStatus(enum.IntEnum):
    """Whether an instant was located: OK, which is 0 and false, or why not."""

    OK = 0
    TOO_FEW = 1
    NO_INTERSECTION = 2
    SINGULAR = 3
    AMBIGUOUS = 4
    AT_STATION = 5
    NOT_CONVERGED = 6
    ILL_CONDITIONED = 7

    @property
    def message(self) -> str:
        """What happened, as a sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    LocationStatus.OK: "the target was located",
    LocationStatus.TOO_FEW: "there are fewer measurements than coordinates",
    LocationStatus.NO_INTERSECTION: (
        "the measurements do not meet: bearings are parallel, diverge or meet behind a station, "
        "or ranges are too short or too long"
    ),
    LocationStatus.SINGULAR: (
        "the geometry leaves a direction undetermined: stations and target are in line, or all "
        "measurements change alike"
    ),
    LocationStatus.AMBIGUOUS: (
        "two positions explain the measurements (almost) equally well; give initial, or measure "
        "something else"
    ),
    LocationStatus.AT_STATION: (
        "the position is at a station, or straight above one that measures angles"
    ),
    LocationStatus.NOT_CONVERGED: "no minimum was reached",
    LocationStatus.ILL_CONDITIONED: (
        "the geometry is too poor: the region that holds the target with 95 % has no end; add a "
        "station, or measure something else"
    ),
}


@dataclass(frozen=True, slots=True, eq=False)
class Location:
    """A position, with the residuals and outliers of the measurements.

    Attributes
    ----------
    position : ndarray of shape (..., D)
        The position in metres; nan where there is none.
    covariance : ndarray of shape (..., D, D)
        Covariance of the position; variances are infinite if sigma is unknown and there is no
        redundancy.
    residual : ByKind
        Whitened residuals of all measurements.
    outlier : ByKind
        Measurements that were treated as faults; none for least squares.
    degrees_of_freedom : int or ndarray of shape (...)
        Number of measurements minus number of coordinates, and minus one for the emission of times
        of arrival.
    statistic : float or ndarray of shape (...)
        Sum of all squared residuals, faults included.
    pvalue : float or ndarray of shape (...)
        Probability of a larger sum of squares if there are no faults; nan if sigma was estimated. A
        small p-value means that a measurement or a sigma is wrong.
    dop : float or ndarray of shape (...)
        Dilution of precision: the square root of the trace of the covariance for measurements with
        sigma 1. In metres per metre, or metres per radian; nan for mixtures of both.
    measurement_sigma : float, ndarray of shape (...) or None
        The common standard deviation of the measurements where it was estimated.
    emission_time : float, datetime64, ndarray of shape (...) or None
        When the signal was emitted, in the units of the times of arrival; None if there are none.
    emission_time_sigma : float, ndarray of shape (...) or None
        Its standard deviation in seconds.
    status : LocationStatus or ndarray of int, shape (...)
        OK, which is 0, or why there is no position.
    systematic : {"given", "estimated", "not included"}
        Whether the covariance has the systematic errors: as given, as found from contradictions
        between the stations, or not, because nothing can tell.
    bias : Bias or None
        Systematic errors of the K stations, given or found.
    """

    position: FloatArray
    covariance: FloatArray
    residual: ByKind
    outlier: ByKind
    degrees_of_freedom: int | IntArray
    statistic: float | FloatArray
    pvalue: float | FloatArray
    dop: float | FloatArray
    measurement_sigma: float | FloatArray | None
    emission_time: Any
    emission_time_sigma: float | FloatArray | None
    status: LocationStatus | IntArray
    systematic: Systematic = "not included"
    bias: Bias | None = None

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of the coordinates, of shape (..., D)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))

    @property
    def success(self) -> bool | BoolArray:
        """Whether there is a position, of shape (...)."""
        known: bool | BoolArray = scalar_or_array(np.asarray(self.status) == 0)
        return known

    def __repr__(self) -> str:
        """Show position and sigma where there is no batch."""
        if self.position.ndim > 1:
            found, count = np.count_nonzero(self.success), np.size(self.success)
            batch = self.position.shape[:-1]
            return f"Location(batch {batch}, {found} of {count} located{self._note})"
        pairs = zip(self.position, self.sigma, strict=True)
        listed = ", ".join(f"{value:.6g} ± {sigma:.3g}" for value, sigma in pairs)
        each = (getattr(self.residual, field.name) for field in fields(self.residual))
        count = sum(int(np.sum(~np.isnan(own))) for own in each if own is not None)
        return f"Location([{listed}], {self.outlier.count} of {count} faulty{self._note})"

    @property
    def _note(self) -> str:
        missing = self.systematic == "not included"
        return ", systematic error not included" if missing else ""


def location_of(
    result: tuple[FloatArray, FloatArray, FloatArray, BoolArray, list[FloatArray]],
    kinds: Sequence[Kind],
    *,
    estimated: bool,
    arrivals: Arrivals | None = None,
    systematic: Systematic = "not included",
    bias: Bias | None = None,
) -> Location:
    position, covariance, residual, outlier, columns = result
    statuses, degrees, statistic, pvalue, dop, sigma, emission, emission_sigma = columns
    status: LocationStatus | IntArray = statuses.astype(np.int64)
    if position.ndim == 1:
        status = LocationStatus(int(statuses))
    if arrivals is not None and "arrival_time" in kinds and len(kinds) == 1:
        sigma = sigma / arrivals.speed
    return Location(
        position,
        covariance,
        by_kind(residual, kinds),
        by_kind(outlier, kinds),
        scalar_or_array(degrees.astype(np.int64)),
        scalar_or_array(statistic),
        scalar_or_array(pvalue),
        scalar_or_array(dop),
        scalar_or_array(sigma) if estimated else None,
        None if arrivals is None else arrivals.emission(emission),
        None if arrivals is None else scalar_or_array(emission_sigma / arrivals.speed),
        status,
        systematic,
        bias,
    )
