"""A trajectory with its residuals and outliers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tertia._arrays import BoolArray, FloatArray, Systematic
from tertia._result import Result
from tertia.location import Location
from tertia.sensors import Bias, ByKind, Kind
from tertia.sensors._kinds import KINDS
from tertia.smoothing import SmoothedPositions


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory(Result):
    """A trajectory, with the residuals and outliers of its measurements.

    Attributes
    ----------
    time : ndarray of shape (N,)
        Times of the instants, as given.
    position, velocity, acceleration : ndarray of shape (N, D)
        Coordinates in metres, and their first and second derivatives with respect to `time`; nan
        where unknown, as is the height if D = 3 and only azimuths were measured.
    covariance : ndarray of shape (N, 3 D, 3 D)
        Covariance of position, velocity and acceleration, in this order, including the uncertainty
        of estimated biases; inf where unknown. The cross-covariances between position, velocity and
        acceleration are 0, except with the smoother "rts" and the order "spatial-first".
    fixes : Location
        Positions of the single instants, from the measurements or, with "temporal-first", from the
        smoothed series. With "rts", "robust" and "spatial-first", measurements that contradict the
        track are left out. At instants with one or two degrees of freedom, standard deviations are
        divided by the square roots of Tukey's weights, which are computed from the residuals about
        the track.
    outlier : ByKind
        True for measurements that were left out because they contradict other stations or the
        track.
    residual : ByKind
        Measured minus predicted values, divided by their standard deviations.
    systematic : {"given", "estimated", "not included"}
        How the covariance treats systematic errors: it includes them as given; it includes them as
        estimated from inconsistencies between the stations; or it does not include them, because no
        inconsistency was possible, or because only one was possible and it did not occur.
    bias : Bias or None
        Given or estimated systematic errors of the K stations: the values that were subtracted, the
        standard deviations of the remaining errors, and the fraction of their variance that drifts.
        `time` is the amount by which the clock of the station is fast. A sigma of 0 means that no
        error was found and that none is likely. `bias` is None with "temporal-first" and with local
        polynomials.
    smoothed : SmoothedPositions or None
        Further results of the smoother: likelihood, innovations, and the jerk, which in space is
        that of the horizontal motion if the vertical one differs. It is None with local polynomials
        and with "temporal-first".
    mirror_image : ndarray of shape (N, D) or None
        Mirror image of the path on the other side of the stations, if it explains the measurements
        (almost) equally well; None if it does not, or if `initial` gives the side.
    propagation_speed, propagation_speed_sigma : float, ndarray of shape (N,) or None
        Estimated speed of the signals in m/s and its standard deviation; None if no
        `propagation_speed_sigma` was given.
    wind, wind_covariance : ndarray of shape (2,) and (2, 2), or None
        Estimated wind in m/s, east and north, and its covariance; None if no `wind_sigma` was
        given.
    height_residual, height_outlier : ndarray of shape (N,), or None
        As `residual` and `outlier`, for the given heights; None if no `height` was given.
    height_bias, height_bias_sigma : float or None
        Estimated constant error of the heights in metres, which was subtracted, and the standard
        deviation of their remaining lasting error; nan if there is only one position, and None if
        no `height` was given.
    relative_range_sigma : float or None
        Standard deviation of large ranges, relative to the range, if the errors of ranges were
        found to grow with the range, as those of ranges from signal strengths do. The trajectory
        then follows from standard deviations that grow in this way and, where they fit better,
        from errors of the logarithms of the ranges. None if the errors do not grow.
    """

    _rows: ClassVar = "time", 0
    _omitted: ClassVar = (
        *("bias", "smoothed", "fixes", "mirror_image"),
        *("propagation_speed", "propagation_speed_sigma", "wind", "wind_covariance"),
        *("height_bias", "height_bias_sigma", "relative_range_sigma"),
    )

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    covariance: FloatArray
    fixes: Location
    outlier: ByKind
    residual: ByKind
    systematic: Systematic
    bias: Bias | None
    smoothed: SmoothedPositions | None
    mirror_image: FloatArray | None = None
    propagation_speed: float | FloatArray | None = None
    propagation_speed_sigma: float | FloatArray | None = None
    wind: FloatArray | None = None
    wind_covariance: FloatArray | None = None
    height_residual: FloatArray | None = None
    height_outlier: BoolArray | None = None
    height_bias: float | None = None
    height_bias_sigma: float | None = None
    relative_range_sigma: float | None = None

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of the coordinates, of shape (N, D)."""
        d = self.position.shape[-1]
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)[:, :d])

    @property
    def statistics(self) -> dict[Kind, FloatArray]:
        """Number, mean and root mean square of the residuals of each station, as an array (K, 3).

        Residuals are in standard deviations. Measurements that were left out are not counted.
        """
        return {
            kind: _statistics(residual, getattr(self.outlier, kind))
            for kind in KINDS
            if (residual := getattr(self.residual, kind)) is not None
        }

    def __repr__(self) -> str:
        """Return the number of located instants and the median sigma."""
        # without the height, if azimuths alone do not determine it
        seen = ~np.isnan(self.position).all(axis=0)
        n, d = len(self.position), np.count_nonzero(seen)
        known = np.count_nonzero(~np.isnan(self.position[:, seen]).any(axis=-1))
        left = int(np.sum(self.outlier.count))
        left += 0 if self.height_outlier is None else np.count_nonzero(self.height_outlier)
        sigma = float(np.median(np.sqrt(np.sum(self.sigma[:, seen] ** 2, axis=-1))))
        missing = self.systematic == "not included"
        note = ", systematic error not included" if missing else ""
        note += "" if self.mirror_image is None else ", mirror image possible"
        return (
            f"Trajectory({known} of {n} instants in {d} axes, {left} measurements left out, "
            f"median sigma {sigma:.3g}{note})"
        )


def _statistics(residual: FloatArray, outlier: BoolArray) -> FloatArray:
    kept = ~(np.isnan(residual) | outlier)
    count = np.sum(kept, axis=0)
    values = np.where(kept, residual, 0.0)
    with np.errstate(invalid="ignore"):
        mean = np.sum(values, axis=0) / count
        rms = np.sqrt(np.sum(values**2, axis=0) / count)
    return np.column_stack([count, mean, rms])
