"""The result of `locate`."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    Systematic,
    integer,
    probability,
    scalar_or_array,
)
from tertia._result import Result
from tertia.location._arrivals import Arrivals
from tertia.location._region import Accuracy, Region, radius_of, region_of
from tertia.location._scene import Scene
from tertia.location._speed import Speed
from tertia.location._wind import Wind
from tertia.sensors import Bias, ByKind, Kind
from tertia.sensors._sensors import by_kind

LocationMethod: TypeAlias = Literal[
    "robust", "least-squares", "lenth-mle", "lenth-huber", "lenth-andrews", "posterior"
]


class LocationStatus(enum.IntEnum):
    """Status of an instant: OK, which equals 0, or the reason why it was not located."""

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
        """The meaning of the status, as a sentence."""
        return _MESSAGES[self]


_STATUSES = tuple(LocationStatus)
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
        "two positions explain the measurements (almost) equally well; give initial, or height if "
        "the stations have heights, or measure something else"
    ),
    LocationStatus.AT_STATION: (
        "the position is at a station, or straight above one that measures angles; give nan for "
        "the measurements of that station"
    ),
    LocationStatus.NOT_CONVERGED: "no minimum was reached",
    LocationStatus.ILL_CONDITIONED: (
        "the geometry is too poor: the region that holds the target with 95 % has no end; add a "
        "station, or measure something else"
    ),
}


# p-values below this contradict the sigmas
CONTRADICTORY = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Location(Result):
    """A position, with the residuals and outliers of the measurements.

    Attributes
    ----------
    position : ndarray of shape (..., D)
        The position in metres; nan if there is none.
    covariance : ndarray of shape (..., D, D)
        Covariance of the position in m². Its variances are infinite if the sigma of the
        measurements is unknown and there are no redundant measurements from which to estimate it.
    residual : ByKind
        Residuals of all measurements, whitened: measured minus predicted, divided by sigma.
    outlier : ByKind
        True for measurements that were treated as faults; with least squares there are none.
    degrees_of_freedom : int or ndarray of shape (...)
        Number of measurements minus the number of coordinates. If there are times of arrival, it is
        smaller by one more, for the time of emission.
    statistic : float or ndarray of shape (...)
        Sum of the squares of all residuals, faults included.
    pvalue : float or ndarray of shape (...)
        Probability of a larger `statistic` if there are no faults; nan if sigma was estimated. A
        small p-value means that a measurement or a sigma is wrong.
    dop : float or ndarray of shape (...)
        Dilution of precision: the square root of the trace that the covariance would have if every
        measurement had a sigma of 1. It is in metres per metre or in metres per radian; nan if
        there are measurements in both units.
    measurement_sigma : float, ndarray of shape (...) or None
        Common standard deviation of the measurements, in their unit, if it was estimated.
    emission_time : float, datetime64, ndarray of shape (...) or None
        Time at which the signal was emitted, in the units of the times of arrival; None without
        times of arrival.
    emission_time_sigma : float, ndarray of shape (...) or None
        Standard deviation of `emission_time` in seconds.
    status : LocationStatus or ndarray of int, shape (...)
        OK, which equals 0, or the reason why there is no position.
    systematic : {"given", "estimated", "not included"}
        How the covariance treats systematic errors: it includes them as given; it includes them as
        estimated from inconsistencies between the stations; or it does not include those of at
        least one kind of measurement, because they could hardly cause inconsistencies.
    bias : Bias or None
        Systematic errors of the K stations, given or estimated.
    propagation_speed, propagation_speed_sigma : float, ndarray of shape (...) or None
        Speed of the signals in metres per second and its standard deviation, as estimated; None if
        no `propagation_speed_sigma` was given.
    wind, wind_covariance : ndarray of shape (2,) and (2, 2), or None
        Estimated wind in metres per second, east and north, and its covariance; None if no
        `wind_sigma` was given.
    """

    _rows: ClassVar = "position", 1
    _omitted: ClassVar = (
        *("propagation_speed", "propagation_speed_sigma"),
        *("wind", "wind_covariance"),
    )

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
    propagation_speed: float | FloatArray | None = None
    propagation_speed_sigma: float | FloatArray | None = None
    wind: FloatArray | None = None
    wind_covariance: FloatArray | None = None
    _scene: Scene | None = None

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of the coordinates, of shape (..., D)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))

    @property
    def success(self) -> bool | BoolArray:
        """Whether there is a position; for a batch, an array of shape (...)."""
        known: bool | BoolArray = scalar_or_array(np.asarray(self.status) == 0)
        return known

    def region(self, probability: float = 0.95) -> Region:
        """Return the horizontal region that contains the target with a given probability.

        If the errors are small compared with the distances to the stations, the region is the
        ellipse of the covariance. If the sigma of the measurements was estimated, the size of the
        ellipse follows from a quantile of the F distribution. If the errors are not small, the
        region in the plane is bounded by a contour of the likelihood (Wilks 1938), and may be
        curved or unbounded. For the method "posterior", it is the region of highest density, which
        may have several parts.

        Parameters
        ----------
        probability : float
            Probability that the region contains the target.

        Returns
        -------
        Region
            Outlines, area and axes of the region; for a batch, those of the region of each
            position.

        Raises
        ------
        ValueError
            If `probability` is not between 0 and 1, or if the position was not estimated by
            `locate`.

        Examples
        --------
        >>> from tertia.location import locate
        >>> fix = locate([[0, 0], [1000, 0]], azimuth=[0.785, 5.498], azimuth_sigma=0.01)
        >>> fix.region(0.95)
        Region(941.7 m², 17.32 by 17.31 m towards 8.4°)
        """
        return region_of(self._source(), self.position, self._accuracy(), probability)

    def cep(self, probability: float = 0.5) -> float | FloatArray:
        """Return the radius of a circle that contains the target with a given probability.

        Parameters
        ----------
        probability : float
            Probability that the horizontal circle about the position contains the target.

        Returns
        -------
        float or ndarray of shape (...)
            Radius in metres, from the covariance or, for the method "posterior", from the density.

        Raises
        ------
        ValueError
            As for `region`.
        """
        return radius_of(self._source(), self.position, self._accuracy(), probability)

    def protection_level(
        self,
        risk: float = 1e-5,
        *,
        fault_probability: float = 1e-4,
        faults: int = 1,
        false_alarm_probability: float = 1e-3,
    ) -> float | FloatArray:
        """Return the radius that the horizontal error exceeds with a stated risk, even with faults.

        Parameters
        ----------
        risk : float
            Probability that the horizontal error exceeds the protection level.
        fault_probability : float
            Probability that a measurement is faulty. Faults occur independently of each other, and
            a fault may have any size.
        faults : int
            Number of simultaneous faults against which the level protects.
        false_alarm_probability : float
            Probability that the test rejects measurements that contain no faults.

        Returns
        -------
        float or ndarray of shape (...)
            Radius about the position in metres. It is inf if a fault could not be detected, so that
            no radius is large enough; if the probability of more than `faults` simultaneous faults
            exceeds the risk; if the test rejects, that is, if the positions from subsets of the
            measurements contradict each other; or if there is no position.

        Raises
        ------
        ValueError
            If a number is outside its domain, if the position was not estimated by `locate`, if its
            standard deviations were estimated rather than stated, or if there are more than a
            million sets of at most `faults` measurements.

        Notes
        -----
        The method is solution separation (Blanch et al. 2012). Each set of at most `faults`
        measurements is left out in turn, and the resulting position must agree with the position
        from all measurements. Outliers that `locate` left out count as faults. The stated sigmas
        must not be smaller than the true standard deviations.

        Examples
        --------
        >>> from tertia.location import locate
        >>> places = [[0, 0], [4000, 0], [0, 3000], [4200, 3100], [2000, -1500], [-900, 1200]]
        >>> ranges = [1860.1, 2731.3, 2420.7, 3360.0, 2647.6, 2402.1]
        >>> fix = locate(places, range=ranges, range_sigma=10.0)
        >>> round(fix.protection_level(), 1)
        36.3
        """
        if self.measurement_sigma is not None:
            raise ValueError("a protection level needs stated standard deviations")
        scene = self._source()
        guarded = (
            probability(risk, "risk"),
            probability(fault_probability, "fault_probability"),
            integer(faults, "faults", 0),
            probability(false_alarm_probability, "false_alarm_probability"),
        )
        level: float | FloatArray = scalar_or_array(
            _core.protection_levels(scene.at(self.position), guarded, None)
        )
        return level

    def _source(self) -> Scene:
        if self._scene is None:
            raise ValueError("this needs a position that was returned by locate")
        return self._scene

    def _accuracy(self) -> Accuracy:
        if self.measurement_sigma is None:
            return Accuracy(self.covariance, None)
        scene, freedom = self._source(), np.asarray(self.degrees_of_freedom, dtype=np.float64)
        if scene.pooled:
            freedom = np.full(freedom.shape, np.inf)
        sigma = np.broadcast_to(self.measurement_sigma * np.asarray(scene.unit), freedom.shape)
        return Accuracy(self.covariance, (sigma, freedom))

    def __repr__(self) -> str:
        """Show the position and its sigma, or the shape of the batch."""
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
        contradict = np.asarray(self.pvalue) < CONTRADICTORY
        found = int(np.count_nonzero(contradict & (np.asarray(self.outlier.count) == 0)))
        what = f"{found} " if self.position.ndim > 1 else ""
        note = f", {what}inconsistent without a fault found" if found else ""
        return f"{note}, systematic error not included" if missing else note


def location_of(
    result: tuple[FloatArray, FloatArray, FloatArray, BoolArray, list[FloatArray]],
    kinds: Sequence[Kind],
    *,
    estimated: bool,
    arrivals: Arrivals | None = None,
    systematic: Systematic = "not included",
    bias: Bias | None = None,
    scene: Scene | None = None,
    speed: Speed | None = None,
    wind: Wind | None = None,
) -> Location:
    position, covariance, residual, outlier, columns = result
    statuses, degrees, statistic, pvalue, dop, sigma, emission, emission_sigma = columns
    status: LocationStatus | IntArray
    freedom: int | IntArray
    if position.ndim == 1:
        status, freedom = _STATUSES[int(statuses)], int(degrees)
    else:
        status, freedom = statuses.astype(np.int64), degrees.astype(np.int64)
    if arrivals is not None and "arrival_time" in kinds and len(kinds) == 1:
        sigma = sigma / arrivals.speed
    return Location(
        position,
        covariance,
        by_kind(residual, kinds),
        by_kind(outlier, kinds),
        freedom,
        scalar_or_array(statistic),
        scalar_or_array(pvalue),
        scalar_or_array(dop),
        scalar_or_array(sigma) if estimated else None,
        None if arrivals is None else arrivals.emission(emission),
        None if arrivals is None else scalar_or_array(emission_sigma / arrivals.speed),
        status,
        systematic,
        bias,
        None if speed is None or speed.relative == 0 else speed.value,
        None if speed is None or speed.relative == 0 else speed.sigma,
        None if wind is None else wind.mean,
        None if wind is None else wind.covariance,
        _scene=scene,
    )
