"""Kalman filter of an angle with its rate and acceleration: along a series, back, and streaming.

Source: Panasyuk, Pudovkin, Rogachev 2018, equations (14) to (20), misprints mended. The state is
`[angle, rate, acceleration]`; the acceleration fades (Singer 1970); plots are of the angle alone.
Units are the caller's: any angle, with any unit of time.

Without an initial state the start is exact: angle and rate are unknown, and the acceleration has
the variance of its model. What is unknown has the variance inf and, before the first plot, the
mean nan.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    finite,
    flag,
    real,
    samples,
    scalar_or_array,
    threads,
)

__all__ = [
    "AngleFilter",
    "FilteredSeries",
    "NoiseFit",
    "SingerModel",
    "SmoothedSeries",
    "Store",
    "filter_series",
    "fit_noise",
    "smooth_series",
    "steady_state",
]

Store: TypeAlias = Literal["all", "mean", "final"]
Limit: TypeAlias = Literal[
    "white acceleration", "constant acceleration", "constant rate", "no noise"
]
# the place of every element of a covariance in its upper triangle
_FULL = np.array([0, 1, 2, 1, 3, 4, 2, 4, 5])


@dataclass(frozen=True, slots=True)
class SingerModel:
    """A target whose acceleration fades: correlation `exp(-alpha |t|)`, constant variance.

    `alpha=0` is constant acceleration, `acceleration_sigma=0` constant rate.

    Attributes
    ----------
    dt : float
        Time from plot to plot, where no time is given.
    alpha : float
        Manoeuvre frequency, one over the time in which an acceleration fades.
    acceleration_sigma : float
        Standard deviation of the acceleration.
    exact : bool
        False: as printed, `1 - alpha T` for `exp(-alpha T)` and noise in the acceleration alone;
        only for `alpha T < 1`. True: the model of continuous time, exactly.

    Examples
    --------
    >>> from tertia.kalman import SingerModel
    >>> model = SingerModel(4.0, 0.05, 1.0)
    >>> model.transition()
    array([[1. , 4. , 8. ],
           [0. , 1. , 4. ],
           [0. , 0. , 0.8]])
    >>> model.process_noise()[2, 2].round(2)
    np.float64(0.36)
    """

    dt: float
    alpha: float
    acceleration_sigma: float
    exact: bool = False

    def __post_init__(self) -> None:
        """Check the parameters."""
        for name in ("dt", "alpha", "acceleration_sigma"):
            object.__setattr__(self, name, real(getattr(self, name), name))
        object.__setattr__(self, "exact", flag(self.exact, "exact"))
        _core.singer_transition(self._core, self.dt)

    @property
    def _core(self) -> tuple[float, float, bool]:
        return self.alpha, self.acceleration_sigma, self.exact

    def transition(self, dt: float | None = None) -> FloatArray:
        """Return F over the time `dt`, by default that of the model: shape (3, 3)."""
        (f01, f02, f12, f22), _ = self._over(dt)
        return np.array([[1.0, f01, f02], [0.0, 1.0, f12], [0.0, 0.0, f22]])

    def process_noise(self, dt: float | None = None) -> FloatArray:
        """Return Q over the time `dt`, by default that of the model: shape (3, 3)."""
        return _full(np.array(self._over(dt)[1]))

    def _over(self, dt: float | None) -> tuple[list[float], list[float]]:
        return _core.singer_transition(self._core, self.dt if dt is None else real(dt, "dt"))


@dataclass(frozen=True, slots=True, eq=False)
class FilteredSeries:
    """A filtered series.

    Attributes
    ----------
    mean : ndarray of shape (..., steps, 3)
        Angle, rate and acceleration after each plot; (..., 3) with `store="final"`.
    innovation : ndarray of shape (..., steps)
        Plot less predicted angle; nan where there is no plot, or nothing to predict from. Empty
        unless `store="all"`.
    innovation_variance : ndarray of shape (..., steps)
        Its variance, likewise.
    log_likelihood : float or ndarray of shape (...)
        Of all plots that have an innovation.
    count : int or ndarray of shape (...)
        Their number.
    upper : ndarray of shape (..., steps, 6)
        Upper triangles of the covariances, row by row. Empty with `store="mean"`, (..., 6) with
        `store="final"`.
    measurement_variance : ndarray of shape (..., steps)
        As given, read-only.
    """

    mean: FloatArray
    innovation: FloatArray
    innovation_variance: FloatArray
    log_likelihood: float | FloatArray
    count: int | IntArray
    upper: FloatArray
    measurement_variance: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """Covariances of `mean`, of shape (..., steps, 3, 3)."""
        return _full(self.upper)

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of `mean`, of shape (..., steps, 3)."""
        return _sigma(self.upper)

    @property
    def gain(self) -> FloatArray:
        """Gains of the plots, of shape (..., steps, 3); nan where there is no innovation."""
        if self.innovation.shape != self.measurement_variance.shape:
            raise ValueError('gain needs all steps: filter with store="all"')
        row = self.upper[..., :3] / self.measurement_variance[..., np.newaxis]
        return np.where(np.isnan(self.innovation)[..., np.newaxis], np.nan, row)

    def __repr__(self) -> str:
        """Tell the shape and the likelihood."""
        told = f"FilteredSeries(mean of shape {self.mean.shape}"
        if isinstance(self.count, np.ndarray):
            return f"{told})"
        return f"{told}, {self.count} innovations, log-likelihood {self.log_likelihood:.6g})"


@dataclass(frozen=True, slots=True, eq=False)
class SmoothedSeries:
    """A smoothed series.

    Attributes
    ----------
    mean : ndarray of shape (..., steps, 3)
        Angle, rate and acceleration from all plots.
    upper : ndarray of shape (..., steps, 6)
        Upper triangles of the covariances, row by row.
    """

    mean: FloatArray
    upper: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """Covariances of `mean`, of shape (..., steps, 3, 3)."""
        return _full(self.upper)

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of `mean`, of shape (..., steps, 3)."""
        return _sigma(self.upper)

    def __repr__(self) -> str:
        """Tell the shape."""
        return f"SmoothedSeries(mean of shape {self.mean.shape})"


@dataclass(frozen=True, slots=True, eq=False)
class NoiseFit:
    """Noise of plots and motion that explains a recording best.

    The likelihood may be largest where a parameter is 0 or infinite. `limits` names where:

    - "white acceleration": alpha is infinite. Of alpha and `acceleration_sigma` the recording tells
      their combination `density` alone.
    - "constant acceleration": alpha is 0. `acceleration_sigma` is that of the one acceleration of
      each series, and says little of others.
    - "constant rate": there is no acceleration. `density` and `acceleration_sigma` are 0.
    - "no noise": beside the motion the noise is nothing.

    There, an infinite alpha is given as 1e6 over a usual interval, and a noise of 0 as a tiny
    number, so that `model` and the filter can be used.

    Attributes
    ----------
    alpha, acceleration_sigma, measurement_sigma : float
        The estimates.
    sigma : ndarray of shape (3,)
        Their standard uncertainties, in this order, to first order: those of their logarithms times
        the estimates. inf for what the recording does not determine.
    log_likelihood : float
        At the maximum.
    count : int
        Plots that tell something.
    density_sigma : float
        Standard uncertainty of `density`, likewise.
    limits : tuple of str
        Names as above; empty if no parameter is 0 or infinite.
    outlier : ndarray of bool, of the shape of the plots
        Which plots were left out.
    """

    alpha: float
    acceleration_sigma: float
    measurement_sigma: float
    sigma: FloatArray
    log_likelihood: float
    count: int
    density_sigma: float
    limits: tuple[Limit, ...]
    outlier: BoolArray

    @property
    def density(self) -> float:
        """Spectral density of a slowly changing acceleration, `2 acceleration_sigma**2 / alpha`."""
        if self.acceleration_sigma == 0:
            return 0.0
        return 2 * self.acceleration_sigma**2 / self.alpha if self.alpha > 0 else float("inf")

    def model(self, dt: float) -> SingerModel:
        """Return the fitted model of the motion, with plots `dt` apart."""
        return SingerModel(dt, self.alpha, self.acceleration_sigma, exact=True)

    def __repr__(self) -> str:
        """Tell the estimates with their errors; at limits, those that the recording tells."""
        names = ["alpha", "acceleration_sigma", "measurement_sigma"]
        sigmas = dict(zip(names, self.sigma, strict=True))
        if "white acceleration" in self.limits:
            sigmas = {"density": self.density_sigma} | sigmas
        if self.limits:
            sigmas = {name: sigma for name, sigma in sigmas.items() if np.isfinite(sigma)}
        told = ", ".join(
            f"{name} {value:.3g} ± {sigma / value:.0%}"
            for name, sigma in sigmas.items()
            if (value := getattr(self, name))
        )
        limits = ", ".join(self.limits)
        return f"NoiseFit({': '.join(filter(None, (limits, told)))})"


def filter_series(
    z: npt.ArrayLike,
    measurement_variance: npt.ArrayLike,
    model: SingerModel,
    *,
    initial: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    time: npt.ArrayLike | None = None,
    period: float | None = None,
    store: Store = "all",
    out: FilteredSeries | None = None,
    n_threads: int | None = None,
) -> FilteredSeries:
    """Filter series of plots.

    Parameters
    ----------
    z : array_like of shape (..., steps)
        Plots of the angle; nan where there is none.
    measurement_variance : array_like of shape (), (..., 1) or (..., steps)
        Variance of their noise.
    model : SingerModel
        How the target moves.
    initial : (mean, covariance), optional
        State at the first step before its plot, of shapes (..., 3) and (..., 3, 3). By default
        nothing is known but the variance of the acceleration.
    time : array_like of shape (steps,) or (..., steps), optional
        Times of the steps, not decreasing; by default `model.dt` apart.
    period : float, optional
        360.0 for degrees, 2*pi for radians; None for data that do not wrap. Angles come back in
        [0, period).
    store : {"all", "mean", "final"}
        What to keep: everything, the means of all steps, or mean and covariance of the last one.
    out : FilteredSeries, optional
        Result of an earlier call with the same shapes and the same `store`. Its arrays of all steps
        are written over and returned again, which spares fresh memory; after an error they hold
        anything.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    FilteredSeries
        States, innovations and the likelihood.

    Raises
    ------
    ValueError
        A plot that is infinite, a variance that is not positive, times that decrease, shapes that
        do not fit, or `alpha T >= 1` with a model that is not exact.
    numpy.linalg.LinAlgError
        An initial covariance that is indefinite.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    (14) to (20) of the source. Where the prior is more than 1e4 times as wide as the noise, its
    covariance is kept as factors `U D U'`, which no rounding makes negative. A gain that no longer
    changes is not computed again. Cost O(steps).

    Examples
    --------
    >>> from tertia.kalman import SingerModel, filter_series
    >>> model = SingerModel(5.0, 0.05, 0.003)
    >>> result = filter_series([359.1, 359.8, float("nan"), 1.1], 0.01, model, period=360.0)
    >>> result.mean[-1].round(2), result.sigma[-1].round(2)
    (array([ 1.11,  0.13, -0.  ]), array([0.1 , 0.02, 0.  ]))
    """
    batch, variance = _batch(z, measurement_variance, model, initial, time=time, period=period)
    filled = _filled(batch["z"].shape, store, out)
    (last_mean, last_upper, likelihood), count = _core.filter_series(
        batch, store, filled, threads(n_threads)
    )
    mean, upper, innovation, innovation_variance = filled
    return FilteredSeries(
        last_mean if store == "final" else mean,
        innovation,
        innovation_variance,
        scalar_or_array(likelihood),
        scalar_or_array(count),
        last_upper if store == "final" else upper,
        np.broadcast_to(variance, batch["z"].shape),
    )


def _filled(shape: tuple[int, ...], store: Store, out: FilteredSeries | None) -> list[FloatArray]:
    """Return arrays for mean, upper triangle, innovation and its variance of all steps."""
    none = (*shape[:-1], 0)
    many, every = (shape if store != "final" else none), (shape if store == "all" else none)
    shapes = (*many, 3), (*every, 6), every, every
    if out is None:
        return [np.empty(size) for size in shapes]
    if not isinstance(out, FilteredSeries):
        raise TypeError(f"out is of type {type(out).__name__}; it must be a FilteredSeries")
    if store == "final":
        raise ValueError('out is of no use with store="final", which keeps no steps')
    arrays = [out.mean, out.upper, out.innovation, out.innovation_variance]
    for array, size in zip(arrays, shapes, strict=True):
        if array.shape != size or not array.flags.writeable:
            raise ValueError(
                f"out has an array of shape {array.shape}; it must be the result of a call with "
                f'z of shape {shape} and store="{store}"'
            )
    return arrays


def smooth_series(
    z: npt.ArrayLike,
    measurement_variance: npt.ArrayLike,
    model: SingerModel,
    *,
    initial: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    time: npt.ArrayLike | None = None,
    period: float | None = None,
    n_threads: int | None = None,
) -> SmoothedSeries:
    """Estimate the state at every step from all plots, those before and those after.

    Parameters
    ----------
    z, measurement_variance, model, initial, time, period, n_threads
        See `filter_series`.

    Returns
    -------
    SmoothedSeries
        Means and covariances; before the first plot nothing is known.

    Raises
    ------
    ValueError, numpy.linalg.LinAlgError, TypeError
        As for `filter_series`.

    Notes
    -----
    Rauch, Tung and Striebel, in Joseph's form, on the factors `U D U'` of the covariances. An
    initial covariance that is w times as wide as the noise costs log10(w) digits (without one, none
    are lost); one that is w times narrower leaves a relative error of 1e-15 sqrt(w) with a model
    that is not exact, whose noise enters the acceleration alone. Cost O(steps).

    Examples
    --------
    >>> from tertia.kalman import SingerModel, smooth_series
    >>> model = SingerModel(5.0, 0.05, 0.003)
    >>> result = smooth_series([359.1, 359.8, float("nan"), 1.1], 0.01, model, period=360.0)
    >>> result.mean[:, 0].round(2)
    array([359.11, 359.78,   0.45,   1.11])
    """
    batch, _ = _batch(z, measurement_variance, model, initial, time=time, period=period)
    return SmoothedSeries(*_core.smooth_series(batch, threads(n_threads)))


def steady_state(model: SingerModel, measurement_variance: float) -> tuple[FloatArray, FloatArray]:
    """Return the gain and the covariance to which the filter converges.

    Parameters
    ----------
    model : SingerModel
        How the target moves; plots come every `model.dt`.
    measurement_variance : float
        Variance of their noise.

    Returns
    -------
    gain : ndarray of shape (3,)
        Of every plot.
    covariance : ndarray of shape (3, 3)
        After every plot.

    Raises
    ------
    ValueError
        A variance that is not positive, or so far from the noise of the motion that no digits are
        left; or a model without noise: there is no steady state then.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    By doubling (Anderson 1978), with twice the digits of a float.

    Examples
    --------
    >>> from tertia.kalman import SingerModel, steady_state
    >>> steady_state(SingerModel(5.0, 0.05, 0.003), 0.01)[0].round(3)
    array([0.754, 0.102, 0.005])
    """
    variance = real(measurement_variance, "measurement_variance")
    if not 1e-100 <= variance <= 1e100:
        raise ValueError(f"measurement_variance is {variance}; it must be a positive number")
    _require_model(model)
    gain, upper = _core.steady_state(model._core, model.dt, variance)
    return np.array(gain), _full(np.array(upper))


AngleFilter = _core.AngleFilter


def fit_noise(
    z: npt.ArrayLike,
    *,
    dt: float | None = None,
    time: npt.ArrayLike | None = None,
    period: float | None = None,
    outlier_gate: float | None = None,
    n_threads: int | None = None,
) -> NoiseFit:
    """Estimate the noise of plots and the restlessness of the target from a recording.

    Parameters
    ----------
    z : array_like of shape (..., steps)
        Plots of the angle, at least 10; nan where there is none. Several series are taken to have
        the same parameters.
    dt : float, optional
        Time from plot to plot.
    time : array_like of shape (steps,) or (..., steps), optional
        Times of the steps, instead of `dt`.
    period : float, optional
        360.0 for degrees, 2*pi for radians; None for data that do not wrap.
    outlier_gate : float, optional
        Plots that are more than so many standard deviations off the track made by all the others
        are left out, and the rest is fitted again. By default all plots count.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    NoiseFit
        Parameters of an exact `SingerModel` and the standard deviation of the plots, with errors.

    Raises
    ------
    ValueError
        Too few plots, plots that a line or parabola fits exactly, shapes that do not fit, times
        that decrease, or neither or both of `dt` and `time`.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    Maximum likelihood: the scale of the noise in closed form, alpha and the ratio of acceleration
    to noise on a grid and then by Newton's method, some 150 runs of the filter in all. Errors are
    those of the curvature at the maximum. A recording often says little about alpha, and its error
    is large then; where the maximum is at a limit, its error is inf and `limits` says so.

    A batch is one fit, of parameters that its series share. For one fit each, call it for each.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.kalman import fit_noise
    >>> rng = np.random.default_rng(1)
    >>> angle = 30 + 0.2 * np.arange(200) + 2 * np.sin(np.arange(200) / 30)
    >>> fit = fit_noise(angle + 0.1 * rng.standard_normal(200), dt=5.0)
    >>> round(fit.measurement_sigma, 2)
    0.09
    """
    if (dt is None) == (time is None):
        raise ValueError("give either dt or time")
    unit = SingerModel(1.0 if dt is None else dt, 0.0, 0.0, exact=True)
    batch, _ = _batch(z, 1.0, unit, None, time=time, period=period)
    (estimates, sigma, density_sigma, *told, limits), outlier = _core.fit_noise(
        batch["z"],
        batch["dt"],
        batch["period"],
        None if outlier_gate is None else real(outlier_gate, "outlier_gate"),
        threads(n_threads),
    )
    return NoiseFit(*estimates, np.array(sigma), *told, density_sigma, tuple(limits), outlier)


def _full(upper: FloatArray) -> FloatArray:
    covariance: FloatArray = upper[..., _FULL].reshape(*upper.shape[:-1], 3, 3)
    return covariance


def _sigma(upper: FloatArray) -> FloatArray:
    sigma: FloatArray = np.sqrt(upper[..., [0, 3, 5]])
    return sigma


def _require_model(model: Any) -> None:
    if not isinstance(model, SingerModel):
        raise TypeError(f"model is {model!r}; it must be a SingerModel")


def _batch(
    z: npt.ArrayLike,
    measurement_variance: npt.ArrayLike,
    model: SingerModel,
    initial: tuple[npt.ArrayLike, npt.ArrayLike] | None,
    *,
    time: npt.ArrayLike | None,
    period: float | None,
) -> tuple[dict[str, Any], FloatArray]:
    """Return the arguments as the core takes them, and the variances."""
    plots = samples(z, "z")
    if plots.ndim == 0:
        raise ValueError("z is a single number; it must be of shape (..., steps)")
    _require_model(model)
    variance = np.atleast_1d(samples(measurement_variance, "measurement_variance"))
    batch = plots.shape[:-1]
    steps = plots.shape[-1]
    variance = _rows(variance, (1, steps), batch, "measurement_variance")
    return {
        "z": plots,
        "variance": variance,
        "dt": _intervals(time, model, steps, batch),
        "initial": None if initial is None else _initial(initial, batch),
        "model": model._core,
        "period": None if period is None else real(period, "period"),
    }, variance


def _rows(
    array: FloatArray, lengths: tuple[int, ...], batch: tuple[int, ...], name: str
) -> FloatArray:
    """Return one row for all series, or one for each."""
    if array.shape[-1] in lengths:
        if array.size == array.shape[-1]:
            return array.reshape(-1)
        try:
            return np.broadcast_to(array, (*batch, array.shape[-1]))
        except ValueError:
            pass
    told = " or ".join(f"(..., {length})" for length in dict.fromkeys(lengths))
    raise ValueError(f"{name} has shape {array.shape}; for series {batch} it must be {told}")


def _intervals(
    time: npt.ArrayLike | None, model: SingerModel, steps: int, batch: tuple[int, ...]
) -> FloatArray:
    if time is None:
        return np.array([model.dt])
    instants = finite(time, "time")
    if instants.ndim == 0:
        raise ValueError("time is a single number; it must be of shape (..., steps)")
    intervals = np.diff(_rows(instants, (steps,), batch, "time"), axis=-1)
    back = np.argwhere(intervals < 0)
    if len(back):
        place = ", ".join(map(str, (*back[0][:-1], back[0][-1] + 1)))
        raise ValueError(
            f"time[{place}] is before the time of the step before; time must not decrease"
        )
    return intervals


def _initial(initial: tuple[npt.ArrayLike, npt.ArrayLike], batch: tuple[int, ...]) -> FloatArray:
    try:
        mean, covariance = initial
    except (TypeError, ValueError):
        raise TypeError("initial must be a pair (mean, covariance)") from None
    x, p = finite(mean, "initial mean"), finite(covariance, "initial covariance")
    if x.shape[-1:] != (3,) or p.shape[-2:] != (3, 3):
        raise ValueError(
            f"initial has shapes {x.shape} and {p.shape}; they must be (..., 3) and (..., 3, 3)"
        )
    if x.ndim == 1 and p.ndim == 2:
        return np.concatenate([x, p.reshape(9)])
    flat = p.reshape(*p.shape[:-2], 9)
    try:
        common = np.broadcast_shapes(x.shape[:-1], flat.shape[:-1])
    except ValueError:
        raise ValueError(
            f"initial has shapes {x.shape} and {p.shape}; their batches do not fit together"
        ) from None
    try:
        fits = np.broadcast_shapes(common, batch) == batch
    except ValueError:
        fits = False
    if not fits:
        raise ValueError(
            f"initial has shapes {x.shape} and {p.shape}; for series {batch} they must be "
            "(..., 3) and (..., 3, 3)"
        )
    both = [np.broadcast_to(array, (*common, array.shape[-1])) for array in (x, flat)]
    return _rows(np.concatenate(both, axis=-1), (12,), batch, "initial")
