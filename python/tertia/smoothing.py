"""One target along time: from positions, or any measured series, with their covariances.

`local_polynomial` fits a polynomial to the instants around each. `smooth` estimates position,
velocity and acceleration at every instant from all plots, for a target whose acceleration is
changed by white jerk. Units are the caller's.

Neither looks for outliers: they must be gone before (`tertia.screening`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    FloatArray,
    IntArray,
    finite,
    integer,
    real,
    samples,
    scalar_or_array,
    threads,
)

__all__ = ["LocalPolynomial", "SmoothedPositions", "local_polynomial", "smooth"]


@dataclass(frozen=True, slots=True, eq=False)
class LocalPolynomial:
    """A series smoothed by local polynomials, or a derivative of it.

    Attributes
    ----------
    value : ndarray of shape (..., N)
        The polynomial around each instant, there; nan where its window has too few measurements.
    sigma : ndarray of shape (..., N)
        Standard error of `value`; inf where it is nan, or where nothing tells the noise.
    degree : ndarray of int, of shape (..., N)
        Of each polynomial; -1 where there is none.
    residual_variance : float or ndarray of shape (...), or None
        Variance of the noise, estimated from the whole record; None if variances were given.
    degrees_of_freedom : float or ndarray of shape (...), or None
        Of `residual_variance`: for short records quantiles of Student's distribution belong to
        `sigma`.
    """

    value: FloatArray
    sigma: FloatArray
    degree: IntArray
    residual_variance: float | FloatArray | None
    degrees_of_freedom: float | FloatArray | None

    def __repr__(self) -> str:
        """Tell the shape and the degrees."""
        used, counts = np.unique(self.degree[self.degree >= 0], return_counts=True)
        told = ", ".join(
            f"{count / counts.sum():.0%} of degree {degree}"
            for degree, count in zip(used, counts, strict=True)
        )
        return f"LocalPolynomial(value of shape {self.value.shape}, {told or 'no polynomial'})"


@dataclass(frozen=True, slots=True, eq=False)
class SmoothedPositions:
    """A smoothed track.

    Attributes
    ----------
    mean : ndarray of shape (..., N, 3 D)
        Positions, velocities and accelerations, in this order; nan where unknown.
    covariance : ndarray of shape (..., N, 3 D, 3 D)
        Of `mean`; a variance is inf and its covariances are 0 where unknown.
    innovation : ndarray of shape (..., N, D)
        Differences of the plots from what those before them predict, uncorrelated and of unit
        variance if the model holds: the first axis first, the others given those before. nan where
        there is no plot, or nothing to predict it from.
    log_likelihood : float or ndarray of shape (...)
        Of all plots, for an unknown first state; but for a constant that depends on units and
        times.
    count : int or ndarray of shape (...)
        Measured numbers beyond those that are needed to know the state.
    jerk : float or ndarray of shape (...)
        Intensity of the white jerk: the variance of the acceleration grows by it per unit of time.
    jerk_sigma : float or ndarray of shape (...)
        Standard uncertainty of `jerk`, to first order; 0 if the jerk was given, inf if the plots do
        not determine it.
    """

    mean: FloatArray
    covariance: FloatArray
    innovation: FloatArray
    log_likelihood: float | FloatArray
    count: int | IntArray
    jerk: float | FloatArray
    jerk_sigma: float | FloatArray

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
        """Sums of squared innovations, of shape (..., N); nan where there are none."""
        known = ~np.isnan(self.innovation)
        squares = np.sum(np.where(known, self.innovation, 0.0) ** 2, axis=-1)
        return np.where(known.any(axis=-1), squares, np.nan)

    def _axes(self, derivative: int) -> slice:
        dimension = self.innovation.shape[-1]
        return slice(derivative * dimension, (derivative + 1) * dimension)

    def __repr__(self) -> str:
        """Tell the shape and the jerk."""
        told = f"SmoothedPositions(position of shape {self.innovation.shape}"
        if isinstance(self.jerk, np.ndarray):
            return f"{told})"
        return f"{told}, jerk {self.jerk:.3g} ± {_relative(self.jerk, self.jerk_sigma):.0%})"


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
    """Smooth a series by the polynomial that fits the instants around each one best.

    Parameters
    ----------
    y : array_like of shape (..., N)
        Measurements; nan where there is none.
    window : int
        Instants in a window, an odd number. The instant is in the middle; at the ends the first
        and last windows are evaluated off-centre.
    degree : {"adaptive"} or int
        Degree of the polynomials, at most 9 and less than `window`. "adaptive": in each window the
        highest one up to `max_degree` whose coefficient is significant.
    time : array_like of shape (N,) or (..., N), optional
        Times of the instants, not decreasing; by default 0, 1, 2, ...
    variance : array_like of shape (), (N,) or (..., N), optional
        Variances of the measurements. By default they are equal and unknown.
    derivative : int
        0 for the value, 1 for its rate, ..., at most the degree. Adaptive degrees are not lower.
    max_degree : int
        Highest adaptive degree, less than `window` - 1.
    significance : float
        Chance of a test to keep a coefficient that is 0.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    LocalPolynomial
        Values, or derivatives, with standard errors and degrees.

    Raises
    ------
    ValueError
        A measurement that is infinite, a variance that is not positive where there is one, times
        that decrease, shapes that do not fit, or options outside their domain.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    A degree is tested from the highest down: coefficient p of orthogonal polynomials, by F(1, ν)
    with ν = n - p - 1 from what the window of n measurements leaves; with `variance` by chi-square
    of one degree of freedom. Each test has the level `significance`. A window with too few
    measurements to test the highest degree has no value, nor has one with too few for a fixed
    degree.

    Without variances `sigma` is that of equal noise, whose variance is estimated from the whole
    record, about polynomials of the highest degree: so choosing a degree does not make it smaller.
    `sigma` is the error by noise alone, as if the degree were known. A curvature that the test does
    not see is a bias besides.

    Cost O(N window). Equal steps without variances are a convolution (Savitzky and Golay 1964).

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.smoothing import local_polynomial
    >>> t = np.arange(40)
    >>> y = t + np.random.default_rng(1).standard_normal(40)
    >>> smooth = local_polynomial(y)
    >>> smooth
    LocalPolynomial(value of shape (40,), 95% of degree 1, 5% of degree 2)
    >>> rate = local_polynomial(y, derivative=1)
    >>> print(f"{rate.value[20]:.2f} ± {rate.sigma[20]:.2f}")
    0.93 ± 0.07
    """
    series = _series(y, "y", 1, "(..., N)")
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
    jerk: npt.ArrayLike | None = None,
    initial: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    n_threads: int | None = None,
) -> SmoothedPositions:
    """Estimate position, velocity and acceleration at every instant from all plots.

    Parameters
    ----------
    y : array_like of shape (..., N, D)
        Plots of N instants in D axes; nan where a component is missing.
    covariance : array_like of shape (), (D,), (D, D), (..., N, D) or (..., N, D, D)
        Their covariances: one matrix for all instants, or one for each; or variances of independent
        axes. A shape (D, D) is always one matrix. What belongs to a missing component is not looked
        at.
    time : array_like of shape (N,) or (..., N), optional
        Times of the instants, not decreasing; equal ones are plots of one instant.
    dt : float, optional
        Time between instants, instead of `time`. By default 1.
    jerk : array_like of shape () or (...), optional
        Intensity of the white jerk of every axis, in position² / time⁵; 0 is constant acceleration.
        By default that which makes each track most likely.
    initial : (mean, covariance), optional
        What is known of the state at the first instant besides the plots, of shapes (..., 3 D) and
        (..., 3 D, 3 D): positions, velocities, accelerations. By default nothing.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    SmoothedPositions
        States with their covariances, the likelihood and innovations.

    Raises
    ------
    ValueError
        A plot that is infinite, a variance that is not positive, times that decrease, a negative
        jerk, or shapes that do not fit.
    numpy.linalg.LinAlgError
        A covariance that is indefinite or singular.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    Over a time T the state [x, v, a] of an axis becomes [x + v T + a T²/2, v + a T, a], with noise
    of the covariance q [[T⁵/20, T⁴/8, T³/6], [., T³/3, T²/2], [., ., T]]. The estimate is that of
    Rauch, Tung and Striebel (1965) for an unknown first state: exactly, not by large variances. Two
    square root information filters, forwards and backwards, are solved together at each instant.
    Three instants determine the state of an axis. Where there are fewer, the variance of what they
    do not determine is inf.

    The fitted jerk is taken as known: its own error is not in `covariance`. It is 0, with the error
    inf, where the track shows none; of ten plots or so this is usual, and does not mean that there
    is none. Cost O(N D³), some 30 times as much with the fit.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.smoothing import smooth
    >>> t = 5.0 * np.arange(60)
    >>> truth = np.column_stack([2000 * np.cos(t / 60), 2000 * np.sin(t / 60)])
    >>> y = truth + 20.0 * np.random.default_rng(1).standard_normal((60, 2))
    >>> track = smooth(y, 20.0**2, time=t)
    >>> track
    SmoothedPositions(position of shape (60, 2), jerk 0.00151 ± 35%)
    >>> print(f"{np.std(y - truth):.0f} m, {np.std(track.position - truth):.0f} m")
    17 m, 4 m
    """
    plots = _series(y, "y", 2, "(..., N, D)")
    *leading, n, dimension = plots.shape
    if dimension == 0:
        raise ValueError(f"y has shape {plots.shape}; it must have at least one axis")
    batch = tuple(leading)
    matrices, each = _covariances(covariance, batch, n, dimension)
    intensity = None
    if jerk is not None:
        intensity = finite(jerk, "jerk")
        if np.any(intensity < 0):
            place = tuple(np.argwhere(intensity < 0)[0])
            where = f"[{', '.join(map(str, place))}]" if place else ""
            raise ValueError(f"jerk{where} is {intensity[place]}; it must not be negative")
        intensity = _shared(intensity[..., np.newaxis], (1,), batch, "jerk", "")
    tracks = {
        "y": plots,
        "time": _instants(time, dt, batch, n),
        "covariance": matrices,
        "each": each,
        "jerk": intensity,
        "initial": None if initial is None else _prior(initial, batch, 3 * dimension),
    }
    mean, matrix, innovation, *told = _core.smooth(tracks, threads(n_threads))
    return SmoothedPositions(mean, matrix, innovation, *map(scalar_or_array, told))


def _relative(value: float, sigma: float) -> float:
    return sigma / value if value > 0 else np.inf


def _series(value: npt.ArrayLike, name: str, axes: int, shape: str) -> FloatArray:
    array = samples(value, name)
    if array.ndim < axes:
        raise ValueError(f"{name} has shape {array.shape}; it must be {shape}")
    return array


def _shared(
    array: FloatArray, shape: tuple[int, ...], batch: tuple[int, ...], name: str, told: str
) -> FloatArray:
    """Return one block of this shape for the whole batch, or one for each."""
    axes = len(shape)
    if array.shape[array.ndim - axes :] == shape and array.ndim >= axes:
        if array.size == int(np.prod(shape)):
            return array.reshape(shape)
        try:
            return np.broadcast_to(array, (*batch, *shape))
        except ValueError:
            pass
    own = array.shape if told else array.shape[:-1]
    expected = f"(..., {', '.join(map(str, shape))})" if told else f"{batch} or ()"
    raise ValueError(f"{name} has shape {own}; for a batch {batch} it must be {expected}")


def _variance(variance: FloatArray, batch: tuple[int, ...], n: int) -> FloatArray:
    if variance.size == 1:
        return variance.reshape(1)
    return _shared(variance, (n,), batch, "variance", "N")


def _covariances(
    value: npt.ArrayLike, batch: tuple[int, ...], n: int, dimension: int
) -> tuple[FloatArray, bool]:
    """Return matrices, and whether every instant has its own."""
    array = samples(value, "covariance")
    square = (dimension, dimension)
    if array.shape in {(), (dimension,)}:
        return np.diag(np.broadcast_to(array, dimension)), False
    if array.shape == square:
        return array, False
    if array.shape[-3:] == (n, *square):
        return _shared(array, (n, *square), batch, "covariance", "N, D, D"), True
    if array.shape[-2:] == (n, dimension):
        diagonal = array[..., np.newaxis] * np.eye(dimension)
        # 0 · nan: what belongs to a missing component
        diagonal[..., ~np.eye(dimension, dtype=bool)] = 0.0
        return _shared(diagonal, (n, *square), batch, "covariance", "N, D, D"), True
    raise ValueError(
        f"covariance has shape {array.shape}; for y of shape {(*batch, n, dimension)} it must be "
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


def _prior(
    initial: tuple[npt.ArrayLike, npt.ArrayLike], batch: tuple[int, ...], states: int
) -> FloatArray:
    try:
        mean, covariance = initial
    except (TypeError, ValueError):
        raise TypeError("initial must be a pair (mean, covariance)") from None
    x, p = finite(mean, "initial mean"), finite(covariance, "initial covariance")
    if x.shape[-1:] != (states,) or p.shape[-2:] != (states, states):
        raise ValueError(
            f"initial has shapes {x.shape} and {p.shape}; they must be (..., {states}) and "
            f"(..., {states}, {states})"
        )
    flat = p.reshape(*p.shape[:-2], states * states)
    try:
        common = np.broadcast_shapes(x.shape[:-1], flat.shape[:-1])
    except ValueError:
        raise ValueError(
            f"initial has shapes {x.shape} and {p.shape}; their batches do not fit together"
        ) from None
    both = [np.broadcast_to(array, (*common, array.shape[-1])) for array in (x, flat)]
    whole = np.concatenate(both, axis=-1)
    return _shared(whole, (states + states**2,), batch, "initial", "3 D + 9 D²")
