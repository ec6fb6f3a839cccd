"""Filter and smoother for whole series of plots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import FloatArray, IntArray, Systematic, scalar_or_array, threads
from tertia.kalman._batch import _batch
from tertia.kalman._model import SingerModel, States

Store: TypeAlias = Literal["all", "mean", "final"]


@dataclass(frozen=True, slots=True, eq=False)
class FilteredSeries(States):
    """A filtered series.

    Attributes
    ----------
    mean : ndarray of shape (..., steps, 3)
        Angle, rate and acceleration after each plot; with `store="final"`, of shape (..., 3).
    innovation : ndarray of shape (..., steps)
        Plot minus predicted angle; nan where there is no plot or no prediction yet. Empty unless
        `store="all"`.
    innovation_variance : ndarray of shape (..., steps)
        Predicted variance of `innovation`; nan where `innovation` is nan.
    log_likelihood : float or ndarray of shape (...)
        Log-likelihood of all plots that have an innovation.
    count : int or ndarray of shape (...)
        Number of innovations.
    upper : ndarray of shape (..., steps, 6)
        Upper triangles of the covariances of `mean`, row by row. Empty with `store="mean"`; of
        shape (..., 6) with `store="final"`.
    measurement_variance : ndarray of shape (..., steps)
        Variance of the plots as given; read-only.
    systematic : {"not included"}
        The covariance is computed for white noise with the given variance. It does not include
        systematic errors.
    """

    mean: FloatArray
    innovation: FloatArray
    innovation_variance: FloatArray
    log_likelihood: float | FloatArray
    count: int | IntArray
    upper: FloatArray
    measurement_variance: FloatArray
    systematic: Systematic = "not included"

    @property
    def gain(self) -> FloatArray:
        """Gains of the plots, of shape (..., steps, 3); nan where there is no innovation."""
        if self.innovation.shape != self.measurement_variance.shape:
            raise ValueError('gain needs all steps: filter with store="all"')
        row = self.upper[..., :3] / self.measurement_variance[..., np.newaxis]
        return np.where(np.isnan(self.innovation)[..., np.newaxis], np.nan, row)

    def __repr__(self) -> str:
        """Return the shape and the likelihood."""
        shape = f"FilteredSeries(mean of shape {self.mean.shape}"
        if not isinstance(self.count, np.ndarray):
            likelihood = f"log-likelihood {self.log_likelihood:.6g}"
            shape = f"{shape}, {self.count} innovations, {likelihood}"
        return f"{shape}, systematic error not included)"


@dataclass(frozen=True, slots=True, eq=False)
class SmoothedSeries(States):
    """A smoothed series.

    Attributes
    ----------
    mean : ndarray of shape (..., steps, 3)
        Angle, rate and acceleration at each step, estimated from all plots.
    upper : ndarray of shape (..., steps, 6)
        Upper triangles of the covariances of `mean`, row by row.
    systematic : {"not included"}
        The covariance is computed for white noise with the given variance. It does not include
        systematic errors.
    """

    mean: FloatArray
    upper: FloatArray
    systematic: Systematic = "not included"

    def __repr__(self) -> str:
        """Return the shape."""
        return f"SmoothedSeries(mean of shape {self.mean.shape}, systematic error not included)"


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
    """Filter series of plots of an angle; the state is angle, rate and acceleration.

    Parameters
    ----------
    z : array_like of shape (..., steps)
        Measured angles (plots); nan where there is none.
    measurement_variance : array_like of shape (), (..., 1) or (..., steps)
        Variance of the noise of the plots.
    model : SingerModel
        Model of the motion of the target.
    initial : (mean, covariance), optional
        Mean and covariance of the state at the first step, before its plot, of shapes (..., 3) and
        (..., 3, 3). By default only the variance of the acceleration is known.
    time : array_like of shape (steps,) or (..., steps), optional
        Times of the steps, in non-decreasing order; by default they are `model.dt` apart.
    period : float, optional
        Period of the angle: 360.0 for degrees, 2*pi for radians, None for data that do not wrap.
        Estimated angles lie in [0, period).
    store : {"all", "mean", "final"}
        What to keep: with "all", all results; with "mean", the means of all steps; with "final",
        the mean and covariance of the last step.
    out : FilteredSeries, optional
        Result of an earlier call with the same shapes and the same `store`. Its arrays are
        overwritten and returned again, so that no memory is allocated. After an error, their
        content is undefined.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    FilteredSeries
        States, innovations and the likelihood.

    Raises
    ------
    ValueError
        If a plot is infinite, a variance is not positive, times decrease, shapes do not fit, or
        `alpha T >= 1` and the model is not exact.
    numpy.linalg.LinAlgError
        If an initial covariance is indefinite.
    TypeError
        If an argument has the wrong type.

    Notes
    -----
    These are equations (14) to (20) of the source. If the prior variance exceeds 1e4 times that of
    the noise, the covariance is kept in factors `U D U'`, which rounding cannot make negative. When
    the gain has converged, it is not computed again. The cost is O(steps).

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
        np.broadcast_to(variance.copy(), batch["z"].shape),
    )


def _filled(shape: tuple[int, ...], store: Store, out: FilteredSeries | None) -> list[FloatArray]:
    """Return arrays for the means, upper triangles, innovations and innovation variances."""
    none = (*shape[:-1], 0)
    many, every = (shape if store != "final" else none), (shape if store == "all" else none)
    shapes = (*many, 3), (*every, 6), every, every
    if out is None:
        return [np.empty(size) for size in shapes]
    if not isinstance(out, FilteredSeries):
        raise TypeError(f"out is of type {type(out).__name__}; it must be a FilteredSeries")
    if store == "final":
        raise ValueError('out has no use with store="final", which keeps no steps')
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
    """Estimate the state at every step from all plots, including later ones.

    Parameters
    ----------
    z, measurement_variance, model, initial, time, period, n_threads
        As for `filter_series`.

    Returns
    -------
    SmoothedSeries
        Means and covariances. Before the first plot, unknown components have the mean nan and the
        variance inf if no initial state is given.

    Raises
    ------
    ValueError, numpy.linalg.LinAlgError, TypeError
        As for `filter_series`.

    Notes
    -----
    This is the smoother of Rauch, Tung and Striebel in Joseph form, applied to the factors `U D U'`
    of the covariances. If the initial variance is w times the variance of the noise, log10(w)
    digits are lost; without an initial state, no digits are lost. If the initial variance is 1/w of
    the variance of the noise, and process noise enters only the acceleration because the model is
    not exact, the relative error is 1e-15 sqrt(w). The cost is O(steps).

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
