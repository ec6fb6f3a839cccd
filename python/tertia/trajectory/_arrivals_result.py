"""Arrivals, and the trajectories reconstructed from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, IntArray, Systematic, array_of, finite
from tertia._result import Result
from tertia.sensors import Station
from tertia.trajectory._clocks import ClockBias

# deviation of the speed from what was given, in sigmas, above which it is not believed
ALARM = 3.0
# correlation of successive residuals above which it is reported
CORRELATED = 0.2


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Arrivals(Result):
    """Times at which emissions arrived at receivers.

    Attributes
    ----------
    time : ndarray of shape (n,)
        Time of arrival in seconds by the clock of the receiver.
    sensor : ndarray of shape (n,)
        Index of the receiver among the stations.
    identity : ndarray of shape (n,)
        Identity of the emitter, as integers or strings.
    emission : ndarray of shape (n,) or None
        Number of the emission to which each arrival belongs; -1 for an arrival that belongs to
        none. It is None if the emission is not known for any arrival.

    Raises
    ------
    ValueError, TypeError
        If columns have different lengths, there are no arrivals, a time is not finite, or the index
        of a sensor or the number of an emission is not an integer.

    Examples
    --------
    >>> from tertia.trajectory import Arrivals
    >>> Arrivals([12.1, 12.3], [0, 1], [77, 77])
    Arrivals(2 arrivals of 1 identity at 2 receivers)
    """

    _rows: ClassVar = "time", 0

    time: FloatArray
    sensor: IntArray
    identity: npt.NDArray[Any]
    emission: IntArray | None

    def __init__(
        self,
        time: npt.ArrayLike,
        sensor: npt.ArrayLike,
        identity: npt.ArrayLike,
        emission: npt.ArrayLike | None = None,
    ) -> None:
        instants = finite(time, "time")
        if instants.ndim != 1 or instants.size == 0:
            raise ValueError(f"time has shape {instants.shape}; it must be (n,) and not empty")
        # copies, so that the caller's arrays may change
        names = np.array(array_of(identity, "identity"))
        columns = {
            "time": np.array(instants),
            "sensor": _numbers(sensor, "sensor"),
            "identity": names,
            "emission": None if emission is None else _numbers(emission, "emission", least=-1),
        }
        if names.dtype.kind not in "iuUST":
            raise TypeError(f"identity has dtype {names.dtype}; it must hold integers or strings")
        for name, column in columns.items():
            if column is not None and column.shape != instants.shape:
                raise ValueError(
                    f"{name} has shape {column.shape}; it must be {instants.shape}, as time"
                )
            object.__setattr__(self, name, column)

    def __len__(self) -> int:
        """Return the number of arrivals."""
        return len(self.time)

    def __repr__(self) -> str:
        """Return the numbers of arrivals, emissions, identities and receivers, as text."""
        identities, receivers = np.unique(self.identity).size, np.unique(self.sensor).size
        grouped = ""
        if self.emission is not None:
            count = np.unique(self.emission[self.emission >= 0]).size
            grouped = f" in {count} emissions"
        return (
            f"Arrivals({len(self)} arrivals{grouped} of {identities} "
            f"{'identity' if identities == 1 else 'identities'} at {receivers} receivers)"
        )


@dataclass(frozen=True, slots=True, eq=False)
class ArrivalTrajectory(Result):
    """Trajectories reconstructed from arrivals, with estimated clocks, positions and speed.

    Attributes
    ----------
    time : ndarray of shape (N,)
        Times of the emissions of moving identities, ascending, in seconds on the time base.
    time_sigma : ndarray of shape (N,)
        Standard deviations of `time` in seconds.
    target : ndarray of shape (N,)
        Identity of the emitter, as in `Arrivals.identity`.
    position, velocity, acceleration : ndarray of shape (N, D)
        In metres, m/s and m/s².
    covariance : ndarray of shape (N, 3 D, 3 D)
        Covariance of position, velocity and acceleration, in this order. It includes the
        uncertainty of the clocks, of the propagation speed, of the stations' positions and of path
        errors.
    systematic : {"given", "estimated", "not included"}
        How the covariance treats path errors: "estimated" if `path_sigma` was None and there are
        beacons; "given" if a `path_sigma` was given or, without beacons, if stations have a
        `position_sigma`; otherwise "not included".
    arrivals : Arrivals
        The arrivals; `emission` is the row of the emission among all emissions, or -1 for arrivals
        that were not used.
    residual : ndarray of shape (n,)
        Measured minus expected time of each arrival, divided by its standard deviation; nan for
        arrivals that were not used.
    outlier : ndarray of shape (n,)
        True where the absolute value of the residual exceeds 4; such arrivals have hardly any
        weight.
    bias : ClockBias
        Errors of the clocks of the K receivers: reading of the clock minus time on the time base.
    stations : tuple of K Station
        The stations with estimated positions and their standard deviations.
    arrival_time_sigma : float
        Standard deviation of a time of arrival in seconds, averaged over the stations.
    noise_factor : float
        Ratio of the estimated standard deviation of arrivals to the stated one; nan if none was
        stated.
    propagation_speed, propagation_speed_sigma : float
        Estimated speed in metres per second and its standard deviation.
    propagation_speed_deviation : float
        Estimated minus given speed, divided by the given sigma; nan if that sigma is 0. If the
        absolute value exceeds 3, the surveyed positions, the motion model or the given speed is
        wrong.
    path_sigma : float
        Standard deviation of path errors in seconds.
    clock_drift : float
        Intensity of the random walk of clock rates in 1/sqrt(s).
    jerk, acceleration_noise : dict
        Intensities of the white jerk, in m²/s⁵, and of the white acceleration, in m²/s³, of each
        moving identity.
    degrees_of_freedom : float
        Number of arrivals minus the number of parameters estimated from them.
    iterations : int
        Number of steps of the solution.
    success : bool
        Whether the solution converged.
    """

    _rows: ClassVar = "time", 0
    _omitted: ClassVar = ("arrivals", "bias", "residual", "outlier", "stations")

    time: FloatArray
    time_sigma: FloatArray
    target: npt.NDArray[Any]
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    covariance: FloatArray
    systematic: Systematic
    arrivals: Arrivals
    residual: FloatArray
    outlier: BoolArray
    bias: ClockBias
    stations: tuple[Station, ...]
    arrival_time_sigma: float
    noise_factor: float
    propagation_speed: float
    propagation_speed_sigma: float
    propagation_speed_deviation: float
    path_sigma: float
    clock_drift: float
    jerk: dict[Any, float]
    acceleration_noise: dict[Any, float]
    degrees_of_freedom: float
    iterations: int
    success: bool

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of the coordinates, of shape (N, D)."""
        d = self.position.shape[-1]
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)[:, :d])

    @property
    def correlation(self) -> float:
        """Correlation of the residuals of successive emissions from a moving emitter at a receiver.

        If a correlation r is significant, N arrivals from one emitter are treated in the covariance
        as N (1 - r) / (1 + r) independent arrivals. Correlated errors that the estimated path
        follows do not contribute to r.
        """
        rows = np.flatnonzero(
            np.isin(self.arrivals.identity, self.target) & ~np.isnan(self.residual)
        )
        _, identity = np.unique(self.arrivals.identity[rows], return_inverse=True)
        sensor, residual = self.arrivals.sensor[rows], self.residual[rows]
        order = np.lexsort((self.arrivals.time[rows], sensor, identity))
        residual = np.clip(residual[order], -ALARM, ALARM)
        same = (np.diff(identity[order]) == 0) & (np.diff(sensor[order]) == 0)
        if not np.any(same):
            return np.nan
        products = residual[1:] * residual[:-1]
        return float(np.mean(products[same]) / np.mean(residual**2))

    def __repr__(self) -> str:
        """Return the number of positions, the median sigma, and warnings, as text."""
        n, d = self.position.shape
        sigma = float(np.median(np.sqrt(np.sum(self.sigma**2, axis=-1)))) if n else np.nan
        text = (
            f"ArrivalTrajectory({n} positions of {len(self.jerk)} in {d} axes, "
            f"{np.count_nonzero(self.outlier)} of {len(self.arrivals)} arrivals are outliers, "
            f"median sigma {sigma:.3g}"
        )
        if abs(self.propagation_speed_deviation) > ALARM:
            text += f", speed {self.propagation_speed_deviation:+.1f} sigmas from the given one"
        if self.correlation > CORRELATED:
            text += f", residuals correlated {self.correlation:.2f}"
        if self.systematic == "not included":
            text += ", systematic error not included"
        return text + ("" if self.success else ", not converged") + ")"


def _numbers(value: npt.ArrayLike, name: str, least: int = 0) -> IntArray:
    array = array_of(value, name)
    if array.dtype.kind not in "iu":
        raise TypeError(f"{name} has dtype {array.dtype}; it must hold integers")
    if array.size and np.min(array) < least:
        raise ValueError(f"{name} is {np.min(array)}; it must be at least {least}")
    return array.astype(np.int64)
