"""Smoothing of the positions of one target, or of any measured series, over time.

`local_polynomial` fits a polynomial around each instant. `smooth` estimates position, velocity and
acceleration at every instant from all plots; its model is a target whose acceleration is driven by
white jerk. The results are in the units of the arguments.

`smooth` detects outliers, jumps of the position, noise that is larger than stated, and
time-correlated noise. `local_polynomial` assumes that the noise is white and that there are no
outliers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    Systematic,
    finite,
    flag,
    integer,
    not_negative,
    real,
    samples,
    scalar_or_array,
    threads,
)
from tertia._oscillations import warn_of_oscillations
from tertia._result import Result, counted
from tertia.kalman._batch import _initial

_MOST_AXES = 3  # of tracks with time-correlated noise

__all__ = ["LocalPolynomial", "SmoothedPositions", "local_polynomial", "smooth"]


@dataclass(frozen=True, slots=True, eq=False)
class LocalPolynomial(Result):
    """A series smoothed by local polynomials, or its derivative.

    Attributes
    ----------
    value : ndarray of shape (..., N)
        Value of the polynomial fitted around each instant, or of its derivative; nan where the
        window has too few measurements.
    sigma : ndarray of shape (..., N)
        Standard error of `value`; inf where `value` is nan or the noise cannot be estimated.
    degree : ndarray of int, of shape (..., N)
        Degree of each polynomial; -1 where no polynomial was fitted.
    residual_variance : float or ndarray of shape (...), or None
        Variance of the noise, estimated from the whole record; None if variances were given.
    degrees_of_freedom : float or ndarray of shape (...), or None
        Degrees of freedom of `residual_variance`. To obtain confidence intervals from a short
        record, multiply `sigma` by a quantile of Student's distribution with these degrees of
        freedom. None if variances were given.
    systematic : {"not included"}
        `sigma` accounts for white noise only; it does not include systematic errors.
    """

    _rows: ClassVar = "value", 0

    value: FloatArray
    sigma: FloatArray
    degree: IntArray
    residual_variance: float | FloatArray | None
    degrees_of_freedom: float | FloatArray | None
    systematic: Systematic = "not included"

    def __repr__(self) -> str:
        """Return the shape and the degrees."""
        used, counts = np.unique(self.degree[self.degree >= 0], return_counts=True)
        degrees = ", ".join(
            f"{count / counts.sum():.0%} of degree {degree}"
            for degree, count in zip(used, counts, strict=True)
        )
        shape = f"LocalPolynomial(value of shape {self.value.shape}"
        return f"{shape}, {degrees or 'no polynomial'}, systematic error not included)"


@dataclass(frozen=True, slots=True, eq=False)
class SmoothedPositions(Result):
    """Positions, velocities and accelerations of a target from all its plots.

    Attributes
    ----------
    mean : ndarray of shape (..., N, 3 D)
        Positions, velocities and accelerations, in this order; nan where unknown.
    covariance : ndarray of shape (..., N, 3 D, 3 D)
        Covariance of `mean`, given the estimated noise. Where a component of the state is unknown,
        its variance is inf and its covariances are 0. An error that all plots share is not
        included.
    innovation : ndarray of shape (..., N, D) or (..., N, 2 D)
        Whitened differences between the plots and their predictions from earlier plots: first those
        of the positions, then those of the velocities if these are measured. If the most
        likely model of the noise is true, the innovations are uncorrelated and have unit variance.
        Each innovation is conditioned on the innovations before it at the same instant. It is nan
        where there is no plot, where the plot is an outlier, and where no prediction is
        possible yet.
    log_likelihood : float or ndarray of shape (...)
        Log-likelihood of all plots if the noise is white and as stated and the initial state is
        unknown, up to a constant that depends on units and times.
    count : int or ndarray of shape (...)
        Number of measured components minus the number that is needed to determine the state.
    jerk : float or ndarray of shape (...)
        Intensity of the white jerk, in position² / time⁵: the rate at which the variance of the
        acceleration grows.
    jerk_sigma : float or ndarray of shape (...)
        Standard uncertainty of `jerk`, to first order: `jerk` times the standard uncertainty of its
        logarithm. 0 if the jerk was given, inf if the plots do not determine it.
    acceleration_noise : float or ndarray of shape (...)
        Intensity of the white acceleration, in position² / time³. If it is positive, the velocity
        is a random walk, and the plots contain little information about the jerk.
    outlier : ndarray of bool, of shape (..., N)
        Measured positions that were left out.
    correlation_time : float or ndarray of shape (...)
        Correlation time of the noise in the most likely model: plots a time T apart have the
        correlation `exp(-T / correlation_time)`. 0 for white noise.
    noise_factor : float or ndarray of shape (...)
        Factor, at least 1, by which the stated standard deviations of the positions are multiplied.
    velocity_outlier : ndarray of bool, of shape (..., N), or None
        Measured velocities that were left out; None without velocities.
    velocity_noise_factor : float or ndarray of shape (...)
        Factor, at least 1, by which the stated standard deviations of the velocities are
        multiplied.
    velocity_time_offset : float or ndarray of shape (...)
        Time by which the measured velocities lag behind the positions; 0 if the plots show no lag.
    diffusion : float or ndarray of shape (...)
        Intensity of the white velocity, in position² / time. If it is positive, the position is a
        random walk, or wanders about a path, and the velocity is that of the drift. Its covariance
        then includes the velocity about the drift: twice the diffusion over the median interval of
        the plots.
    systematic : {"not included"}
        The covariance does not include an error that is common to all plots, because such an error
        cannot be detected from one track.
    """

    _rows: ClassVar = "mean", 1
    _omitted: ClassVar = ("covariance",)

    mean: FloatArray
    covariance: FloatArray
    innovation: FloatArray
    log_likelihood: float | FloatArray
    count: int | IntArray
    jerk: float | FloatArray
    jerk_sigma: float | FloatArray
    acceleration_noise: float | FloatArray
    outlier: BoolArray
    correlation_time: float | FloatArray
    noise_factor: float | FloatArray
    velocity_outlier: BoolArray | None = None
    velocity_noise_factor: float | FloatArray = 1.0
    velocity_time_offset: float | FloatArray = 0.0
    diffusion: float | FloatArray = 0.0
    systematic: Systematic = "not included"

    @property
    def position(self) -> FloatArray:
        """Positions, of shape (..., N, D)."""
        return self.mean[..., self._axes(0)]

    @property
    def velocity(self) -> FloatArray:
        """Velocities, of shape (..., N, D)."""
        return self.mean[..., self._axes(1)]

    @property
    def acceleration(self) -> FloatArray:
        """Accelerations, of shape (..., N, D)."""
        return self.mean[..., self._axes(2)]

    @property
    def position_covariance(self) -> FloatArray:
        """Covariances of the positions, of shape (..., N, D, D)."""
        return self.covariance[..., self._axes(0), self._axes(0)]

    @property
    def velocity_covariance(self) -> FloatArray:
        """Covariances of the velocities, of shape (..., N, D, D)."""
        return self.covariance[..., self._axes(1), self._axes(1)]

    @property
    def acceleration_covariance(self) -> FloatArray:
        """Covariances of the accelerations, of shape (..., N, D, D)."""
        return self.covariance[..., self._axes(2), self._axes(2)]

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of `mean`, of shape (..., N, 3 D)."""
        sigma: FloatArray = np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))
        return sigma

    @property
    def nis(self) -> FloatArray:
        """Normalised innovations squared, of shape (..., N); nan where there is no innovation."""
        known = ~np.isnan(self.innovation)
        squares = np.sum(np.where(known, self.innovation, 0.0) ** 2, axis=-1)
        return np.where(known.any(axis=-1), squares, np.nan)

    def _axes(self, derivative: int) -> slice:
        dimension = self.mean.shape[-1] // 3
        return slice(derivative * dimension, (derivative + 1) * dimension)

    def __repr__(self) -> str:
        """Return the shape, the jerk, and how the noise differs from the stated noise, as text."""
        parts = [f"SmoothedPositions(position of shape {self.position.shape}"]
        if not isinstance(self.jerk, np.ndarray):
            if self.diffusion > 0:
                parts.append(f"diffusion {self.diffusion:.3g}")
            elif self.acceleration_noise > 0:
                parts.append(f"acceleration noise {self.acceleration_noise:.3g}")
            else:
                relative = self.jerk_sigma / self.jerk if self.jerk > 0 else np.inf
                parts.append(f"jerk {self.jerk:.3g} ± {relative:.0%}")
            if self.noise_factor > 1:
                parts.append(f"noise factor {self.noise_factor:.2f}")
            if self.correlation_time > 0:
                parts.append(f"correlation time {self.correlation_time:.3g}")
        if count := np.count_nonzero(self.outlier):
            parts.append(counted(count, "outlier"))
        return ", ".join([*parts, "systematic error not included)"])


def local_polynomial(
    y: npt.ArrayLike,
    window: int = 13,
    degree: int | Literal["adaptive"] = "adaptive",
    *,
    time: npt.ArrayLike | None = None,
    variance: npt.ArrayLike | None = None,
    derivative: int = 0,
    max_degree: int = 3,
    significance: float = 0.05,
    n_threads: int | None = None,
) -> LocalPolynomial:
    """Smooth a series by polynomials fitted around each instant.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Measurements; nan where one is missing.
    window : int
        Number of instants in a window; it must be odd. Each instant is in the middle of its window,
        except near the ends of the series, where the polynomial of the first or last full window is
        evaluated away from its middle.
    degree : {"adaptive"} or int
        Degree of the polynomials, at most 9 and less than `window`. "adaptive" takes, in each
        window, the highest degree up to `max_degree` whose coefficient is significant.
    time : array_like of shape (N,) or (..., N), optional
        Times of the instants, in non-decreasing order; by default 0, 1, 2, ...
    variance : array_like of shape (), (N,) or (..., N), optional
        Variance of the measurements. By default it is constant and unknown.
    derivative : int
        Order of the derivative: 0 for the value, 1 for its rate, and so on. It must not exceed the
        degree. An adaptive degree is at least as high as this order.
    max_degree : int
        Highest adaptive degree, less than `window` - 1.
    significance : float
        False-alarm rate of each test: the probability of keeping a coefficient that is truly 0.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    LocalPolynomial
        Values, or derivatives, with standard errors and degrees.

    Raises
    ------
    ValueError, TypeError
        If a measurement is infinite, a variance is not positive, times decrease, shapes do not fit,
        an option is outside its domain, or an argument has the wrong type.

    Notes
    -----
    Adaptive degrees are tested one after the other, starting with the highest. The test of degree p
    is whether the coefficient of the orthogonal polynomial of this degree is zero. Without
    `variance` it is an F test with 1 and ν degrees of freedom, where ν = n - p - 1 is the number of
    degrees of freedom that remain in a window of n measurements. With `variance` it is a chi-square
    test with one degree of freedom. The value is nan if a window has too few measurements to test
    the highest degree or to fit a fixed degree.

    Without `variance`, `sigma` assumes that all measurements have the same variance. This variance
    is estimated from the whole record with polynomials of the highest degree, so that the choice of
    the degree does not reduce it. `sigma` accounts for the noise alone, as if the degree were
    known. If the test does not detect a curvature, the resulting bias is not part of `sigma`.

    The cost is O(N window). With equal steps and without `variance`, the fit is a convolution
    (Savitzky and Golay 1964).

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.smoothing import local_polynomial
    >>> t = np.arange(40)
    >>> y = t + np.random.default_rng(1).standard_normal(40)
    >>> smooth = local_polynomial(y)
    >>> print(f"{smooth.value[20]:.1f} ± {smooth.sigma[20]:.1f}")
    19.7 ± 0.3
    >>> rate = local_polynomial(y, derivative=1)
    >>> print(f"{rate.value[20]:.2f} ± {rate.sigma[20]:.2f}")
    0.93 ± 0.07
    """
    series = _series(y, 1, "(..., N)")
    adaptive = isinstance(degree, str)
    if adaptive and degree != "adaptive":
        raise ValueError(f"degree is {degree!r}; it must be 'adaptive' or an integer")
    top = integer(max_degree, "max_degree", 0) if adaptive else integer(degree, "degree", 0)
    batch, n = series.shape[:-1], series.shape[-1]
    noise = None if variance is None else np.atleast_1d(samples(variance, "variance"))
    value, sigma, used, variance, freedom = _core.local_polynomial(
        series,
        None if time is None else _shared(finite(time, "time"), (n,), batch, "time", "N"),
        None if noise is None else _variance(noise, batch, n),
        integer(window, "window", 1),
        top,
        adaptive,
        integer(derivative, "derivative", 0),
        real(significance, "significance"),
        threads(n_threads),
    )
    if noise is not None:
        return LocalPolynomial(value, sigma, used, None, None)
    return LocalPolynomial(value, sigma, used, scalar_or_array(variance), scalar_or_array(freedom))


def smooth(
    y: npt.ArrayLike,
    covariance: npt.ArrayLike,
    *,
    time: npt.ArrayLike | None = None,
    dt: float | None = None,
    velocity: npt.ArrayLike | None = None,
    velocity_covariance: npt.ArrayLike | None = None,
    correlation_time: float | None = None,
    robust: bool = True,
    jerk: npt.ArrayLike | None = None,
    initial: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    n_threads: int | None = None,
) -> SmoothedPositions:
    """Estimate position, velocity and acceleration at every instant from all plots.

    Parameters
    ----------
    y : array_like of shape (..., N, D)
        Measured positions (plots) at N instants in D axes; nan for a missing component.
    covariance : array_like of shape (), (D,), (D, D), (..., N, D) or (..., N, D, D)
        Covariances of the plots: one matrix for all instants or one for each, or the variances of
        independent axes. An array of shape (D, D) is always one matrix. Elements of a missing
        component are ignored.
    time : array_like of shape (N,) or (..., N), optional
        Times of the instants, in non-decreasing order. Plots with equal times belong to the same
        instant.
    dt : float, optional
        Time between instants, instead of `time`. By default 1.
    velocity : array_like of shape (..., N, D), optional
        Measured velocities, in the unit of `y` per unit of `time`; nan for a missing component.
        Their errors are assumed to be independent of those of the positions.
    velocity_covariance : array_like, optional
        Covariances of the velocities, in one of the forms of `covariance`; required with
        `velocity`.
    correlation_time : float, optional
        Correlation time of the noise of the positions: plots a time T apart have the correlation
        `exp(-T / correlation_time)`. 0 means white noise. By default it is estimated from the
        plots, and it is 0 unless the plots contradict white noise. If `covariance` shows that the
        plots are those of several sensors in turn, it is 0, and what the residuals of a sensor have
        in common is added to the covariance of the position.
    robust : bool
        Whether to allow for noise that is larger than stated, for outliers, and for jumps of the
        position. Outliers are left out, and positions before and after a jump are not averaged. If
        it is False and `correlation_time` is 0, the noise is assumed to be as stated.
    jerk : array_like of shape () or (...), optional
        Intensity of the white jerk of every axis, in position² / time⁵; 0 means constant
        acceleration. By default the motion of each target is estimated: it is driven by white jerk,
        or by white acceleration if the plots make this significantly more likely.
    initial : (mean, covariance), optional
        Mean and covariance of the prior of the state at the first instant, of shapes (..., 3 D) and
        (..., 3 D, 3 D). The state is positions, velocities and accelerations, in this order. By
        default it is unknown.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    SmoothedPositions
        States with their covariances, the likelihood and the innovations.

    Raises
    ------
    ValueError
        If a plot is infinite, a variance is not positive, times decrease, the jerk or the
        correlation time is negative, the correlation time is positive and there are more than three
        axes, `velocity` or `velocity_covariance` is given without the other, or shapes do not fit.
    numpy.linalg.LinAlgError
        If a covariance is indefinite or singular.
    TypeError
        If an argument has the wrong type.

    Notes
    -----
    Over a time T the state [x, v, a] of an axis becomes [x + v T + a T²/2, v + a T, a], with noise
    of covariance q [[T⁵/20, T⁴/8, T³/6], [., T³/3, T²/2], [., ., T]]. The estimate is that of
    Rauch, Tung and Striebel (1965), except that an unknown initial state is treated exactly, not
    by large variances: a forward and a backward square root information filter are combined at
    each instant. Three instants determine the state of an axis. With fewer, the variance of each
    component that is not determined is inf.

    The noise is assumed to be white and as large as stated unless the innovations contradict this.
    If they do, the results of several models of the noise, each with its own jerk, are averaged,
    weighted by the likelihoods of the models; the spread between the results is part of the
    covariance. In one model the noise is white and larger than stated. In the others, a fraction of
    0.6 or 0.95 of its variance is that of a Gauss-Markov process with one of seven correlation
    times. Where such noise is likely and larger than stated, the process may as well be a motion
    about the path with the noise as stated: these models are averaged, too. So are models in which
    the position oscillates about the path, as in waves; a warning says if one of them is the
    likeliest. If innovations are larger for some time, the noise or the motion has two levels, and
    the lower one is reported. If velocities are measured, outliers are searched for among the
    positions first; those that contradict the rest are left out, and others may be late.

    If residuals are small or smooth, the stated noise is not reduced, because time-correlated noise
    can also be the cause. An outlier or a jump is detected if it significantly increases the
    likelihood (de Jong and Penzer 1998). A run of four or more outliers is kept as a turn if this
    is more likely. These tests require at most three axes and at least three instants per axis;
    other tracks are smoothed with the noise as stated.

    If the velocity is a random walk, the motion is driven by white acceleration instead of white
    jerk. The estimate is that for the more likely of these two motions. If the other motion is also
    likely, `covariance` is that of a mixture of both, weighted by their likelihoods. The intensity
    is treated as known: its uncertainty is not part of `covariance`. If the plots show no jerk,
    `jerk` is 0 with a `jerk_sigma` of inf; with about ten plots this is common, and does not mean
    that there is no jerk. The cost is O(N D³). It is about 30 times as high if the motion is
    estimated, 90 times if the innovations also contradict the noise, and 350 times with two levels.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.smoothing import smooth
    >>> t = 5.0 * np.arange(60)
    >>> truth = np.column_stack([2000 * np.cos(t / 60), 2000 * np.sin(t / 60)])
    >>> y = truth + 20.0 * np.random.default_rng(1).standard_normal((60, 2))
    >>> track = smooth(y, 20.0**2, time=t)
    >>> track
    SmoothedPositions(position of shape (60, 2), jerk 0.00151 ± 35%, systematic error not included)
    >>> print(f"{np.std(y - truth):.0f} m, {np.std(track.position - truth):.0f} m")
    17 m, 4 m

    With measured velocities:

    >>> v = np.column_stack([-2000 / 60 * np.sin(t / 60), 2000 / 60 * np.cos(t / 60)])
    >>> v += 0.2 * np.random.default_rng(2).standard_normal((60, 2))
    >>> track = smooth(y, 20.0**2, time=t, velocity=v, velocity_covariance=0.2**2)
    >>> print(f"{np.std(track.position - truth):.0f} m")
    1 m
    """
    plots = _series(y, 2, "(..., N, D)")
    *leading, n, dimension = plots.shape
    if dimension == 0:
        raise ValueError(f"y has shape {plots.shape}; it must have at least one axis")
    batch = tuple(leading)
    matrices, each = _covariances(covariance, "covariance", batch, n, dimension)
    intensity = None
    if jerk is not None:
        intensity = finite(jerk, "jerk")
        if (intensity < 0).any():
            place = tuple(np.argwhere(intensity < 0)[0])
            where = f"[{', '.join(map(str, place))}]" if place else ""
            raise ValueError(f"jerk{where} is {intensity[place]}; it must not be negative")
        intensity = _shared(intensity[..., np.newaxis], (1,), batch, "jerk", "")
    instants = _instants(time, dt, batch, n)
    tracks = {
        "y": plots,
        "time": instants,
        "covariance": matrices,
        "each": each,
        "velocity": _velocities(velocity, velocity_covariance, plots.shape),
        "jerk": intensity,
        "initial": None if initial is None else _initial(initial, batch, 3 * dimension),
        "correlation_time": _correlation_time(correlation_time, dimension),
        "robust": flag(robust, "robust"),
    }
    (mean, matrix, innovation, outlier), scalars = _core.smooth(tracks, threads(n_threads))
    likelihood, count, found = scalars
    warn_of_oscillations(found[-1])
    intensity, error, wandering, lasting, factor, *rest = map(scalar_or_array, found[:-1])
    return SmoothedPositions(
        mean,
        matrix,
        innovation,
        scalar_or_array(likelihood),
        scalar_or_array(count),
        intensity,
        error,
        wandering,
        outlier[..., 0],
        lasting,
        factor,
        None if velocity is None else outlier[..., 1],
        *rest,
    )


def _correlation_time(correlation_time: float | None, dimension: int) -> float | None:
    if correlation_time is None:
        return None
    value = not_negative(correlation_time, "correlation_time")
    if value > 0 and dimension > _MOST_AXES:
        raise ValueError(f"y has {dimension} axes; with a correlation_time it must have up to 3")
    return value


def _series(y: npt.ArrayLike, axes: int, shape: str) -> FloatArray:
    array = samples(y, "y")
    if array.ndim < axes:
        raise ValueError(f"y has shape {array.shape}; it must be {shape}")
    return array


def _shared(
    array: FloatArray, shape: tuple[int, ...], batch: tuple[int, ...], name: str, axes_names: str
) -> FloatArray:
    """Return one block of this shape for the whole batch, or one block for each element of it."""
    axes = len(shape)
    if array.shape[array.ndim - axes :] == shape and array.ndim >= axes:
        if array.size == math.prod(shape):
            return array.reshape(shape)
        try:
            return np.broadcast_to(array, (*batch, *shape))
        except ValueError:
            pass
    own = array.shape if axes_names else array.shape[:-1]
    expected = f"(..., {', '.join(map(str, shape))})" if axes_names else f"{batch} or ()"
    raise ValueError(f"{name} has shape {own}; for a batch {batch} it must be {expected}")


def _variance(variance: FloatArray, batch: tuple[int, ...], n: int) -> FloatArray:
    if variance.size == 1:
        return variance.reshape(1)
    return _shared(variance, (n,), batch, "variance", "N")


def _velocities(
    velocity: npt.ArrayLike | None, covariance: npt.ArrayLike | None, shape: tuple[int, ...]
) -> tuple[FloatArray, FloatArray, bool] | None:
    """Return velocities with their covariances, as `_covariances` does, if there are any."""
    if velocity is None and covariance is None:
        return None
    if velocity is None or covariance is None:
        raise ValueError("velocity and velocity_covariance must be given together")
    array = samples(velocity, "velocity")
    if array.shape != shape:
        raise ValueError(f"velocity has shape {array.shape}; it must be that of y, {shape}")
    *batch, n, dimension = shape
    return array, *_covariances(covariance, "velocity_covariance", tuple(batch), n, dimension)


def _covariances(
    value: npt.ArrayLike, name: str, batch: tuple[int, ...], n: int, dimension: int
) -> tuple[FloatArray, bool]:
    """Return covariance matrices, and whether every instant has a matrix of its own."""
    array = samples(value, name)
    square = (dimension, dimension)
    if array.shape in {(), (dimension,)}:
        matrix = np.zeros(square)
        matrix.flat[:: dimension + 1] = array
        return matrix, False
    if array.shape == square:
        return array, False
    if array.shape[-3:] == (n, *square):
        return _shared(array, (n, *square), batch, name, "N, D, D"), True
    if array.shape[-2:] == (n, dimension):
        diagonal = array[..., np.newaxis] * np.eye(dimension)
        # 0 · nan: what belongs to a missing component
        diagonal[..., ~np.eye(dimension, dtype=bool)] = 0.0
        return _shared(diagonal, (n, *square), batch, name, "N, D, D"), True
    raise ValueError(
        f"{name} has shape {array.shape}; for y of shape {(*batch, n, dimension)} it must be "
        f"(), ({dimension},), {square}, (..., {n}, {dimension}) or "
        f"(..., {n}, {dimension}, {dimension})"
    )


def _instants(
    time: npt.ArrayLike | None, dt: float | None, batch: tuple[int, ...], n: int
) -> FloatArray:
    if time is None:
        step = 1.0 if dt is None else real(dt, "dt")
        if not 0 < step < np.inf:
            raise ValueError(f"dt is {step}; it must be a positive number")
        return step * np.arange(n, dtype=np.float64)
    if dt is not None:
        raise ValueError("give either time or dt")
    return _shared(finite(time, "time"), (n,), batch, "time", "N")
