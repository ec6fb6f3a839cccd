"""Fusion: plots of several radars into one track, estimates of several sensors into one.

Source: Panasyuk, Pudovkin, Rogachev 2018, equations (1) to (13), for K radars, misprints mended
(`method="paper"`), the usual rules, and a default that finds out how good each radar really is.

All radars measure one angle in one frame; `common_azimuth` brings those of other sites into it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    finite,
    positive,
    real,
    samples,
    scalar_or_array,
    threads,
)
from tertia.kalman import SingerModel, _full, _initial, _intervals, _require_model, _sigma

__all__ = [
    "Fused",
    "FusionMethod",
    "FusionResult",
    "InstantMethod",
    "TrackFusion",
    "common_azimuth",
    "fuse",
    "fuse_series",
]

FusionMethod: TypeAlias = Literal[
    "robust",
    "adaptive",
    "matrix",
    "central",
    "posterior",
    "nominal-matrix",
    "covariance-intersection",
    "ewma",
    "static",
    "equal",
    "paper",
]
InstantMethod: TypeAlias = Literal[
    "matrix", "posterior", "covariance-intersection", "static", "equal"
]


@dataclass(frozen=True, slots=True, eq=False)
class FusionResult:
    """A fused track, and what was found out about the radars.

    Attributes
    ----------
    mean : ndarray of shape (..., steps, 3)
        Angle, rate and acceleration.
    upper : ndarray of shape (..., steps, 6)
        Upper triangles of the covariances, row by row.
    weights : ndarray of shape (..., K, steps, 3)
        Weights of the radars in angle, rate and acceleration: the diagonals of the weight matrices.
        nan for radars that are not known yet, and for "central". For "robust" the shares of the
        plots in the correction of this step, the same in all components: 0 without a plot.
    noise_variance : ndarray of shape (..., K, steps)
        Variance of each radar's plots as now believed; for "robust" apart from single outliers.
    outlier : ndarray of bool, shape (..., K, steps)
        Plots that were taken for single outliers. With rules other than "robust", the radar's own
        filter needs some steps to recover after one, and its plots of these may be taken for
        outliers, too.
    innovation, innovation_variance : ndarray of shape (..., K, steps)
        Of the radars' own filters, with the noise as given; nan where there is none.
    """

    mean: FloatArray
    upper: FloatArray
    weights: FloatArray
    noise_variance: FloatArray
    outlier: BoolArray
    innovation: FloatArray
    innovation_variance: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """Covariances of `mean`, of shape (..., steps, 3, 3)."""
        return _full(self.upper)

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of `mean`, of shape (..., steps, 3)."""
        return _sigma(self.upper)

    def __repr__(self) -> str:
        """Tell the shape and the outliers."""
        *batch, radars, steps = self.outlier.shape
        counts = {"radar": radars, "step": steps, "outlier": np.count_nonzero(self.outlier)}
        told = [f"{count} {what}{'' if count == 1 else 's'}" for what, count in counts.items()]
        return f"FusionResult({', '.join([f'batch {tuple(batch)}'] * bool(batch) + told)})"


@dataclass(frozen=True, slots=True, eq=False)
class Fused:
    """A fused estimate, and whether what it was made of agrees.

    Attributes
    ----------
    mean : ndarray of shape (..., m)
        The fused estimate; nan where no sensor has one.
    covariance : ndarray of shape (..., m, m)
        Its covariance, if those given are right; from "covariance-intersection" a bound of it.
        Where no sensor has an estimate, infinite variances.
    weights : ndarray of shape (..., K, m, m)
        The weight of each estimate, which sum to the identity; 0 where a sensor has none.
    statistic : float or ndarray of shape (...)
        Sum of the squared differences of the estimates in units of their covariances; nan from
        methods other than "matrix".
    degrees_of_freedom : int or ndarray of shape (...)
        The chi-square distribution that `statistic` has where the covariances are right.
    p_value : float or ndarray of shape (...)
        Probability of a larger statistic then; nan likewise. A small one says that an estimate or
        a covariance is wrong.
    """

    mean: FloatArray
    covariance: FloatArray
    weights: FloatArray
    statistic: float | FloatArray
    degrees_of_freedom: int | IntArray
    p_value: float | FloatArray

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of `mean`, of shape (..., m)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))

    def __repr__(self) -> str:
        """Tell mean and sigma where there is no batch."""
        if self.mean.ndim > 1:
            return f"Fused(batch {self.mean.shape[:-1]}, {self.mean.shape[-1]} components)"
        pairs = zip(self.mean, self.sigma, strict=True)
        listed = ", ".join(f"{mean:.6g} ± {sigma:.3g}" for mean, sigma in pairs)
        agreement = "" if np.isnan(self.p_value) else f", p-value {self.p_value:.3g}"
        return f"Fused([{listed}]{agreement})"


def fuse(
    estimates: npt.ArrayLike,
    covariances: npt.ArrayLike,
    *,
    method: InstantMethod = "matrix",
    cross_covariances: npt.ArrayLike | None = None,
    weights: npt.ArrayLike | None = None,
    period: float | None = None,
    n_threads: int | None = None,
) -> Fused:
    """Fuse the estimates that several sensors have of the same vector at one instant.

    Parameters
    ----------
    estimates : array_like of shape (..., K, m)
        Estimates of K >= 1 sensors. nan in all components: the sensor has none, and what else is
        given of it is not read.
    covariances : array_like of shape (..., K, m, m)
        Their covariances. Leading axes of all arrays are broadcast against each other. For
        "matrix" a covariance may be singular if the others are not so in the same direction.
    method : str
        "matrix": the linear unbiased combination with the least covariance.
        "posterior": component by component by the inverse variances.
        "covariance-intersection": for errors that are correlated nobody knows how; all sensors at
        once, with the bound of the covariance that has the least determinant.
        "static": by `weights`. "equal": equal weights.
    cross_covariances : array_like of shape (..., K, K, m, m), optional
        Covariances of the errors of two sensors: block [i, j] is that of the errors of i (rows) and
        of j (columns), and the transpose of [j, i]. Blocks [i, i] are not read. By default the
        errors are independent. Covariance intersection does not use them: its bound holds for any.
    weights : array_like of shape (K,), optional
        For "static", and only there: what the weights are proportional to.
    period : float, optional
        Of the first component, if that is an angle: 360.0 for degrees, 2*pi for radians. It comes
        back in [0, period).
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    Fused
        Mean, covariance, weights, and for "matrix" the statistic of consistency.

    Raises
    ------
    numpy.linalg.LinAlgError
        A covariance, or the joint one of all sensors, that is indefinite. With "matrix" and
        "covariance-intersection" also one that is singular in such a way that the weights are not
        defined, or lost to rounding.
    ValueError
        Shapes that do not fit, a matrix that is not symmetric, an estimate that is infinite, above
        1e150 in size, or nan in some components alone, a variance that is not positive, an unknown
        method, or weights that are missing, negative, all zero or not asked for.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    Whatever the weights W, the covariance is that of the combination,
    `sum of W_i S_ij W_j'` over all i and j. "matrix" inverts covariances of differences of
    estimates alone. Without `cross_covariances` it is `weights.combine`, cost O(K m³); with them
    O(K³ m³).

    "covariance-intersection": `(sum of ω_k C_k)^-1` with C_k the inverse covariances and shares
    ω_k of sum 1 is a bound of the covariance whatever the correlation. A least determinant, unlike
    a least trace, does not depend on the units. The problem is convex and treats all sensors alike.

    With a period, angles are turned to within half of it of the angle with the least variance.

    Examples
    --------
    Two tracks whose errors have something in common:

    >>> from tertia.fusion import fuse
    >>> S = [[[4, 1], [1, 2]], [[1, -0.5], [-0.5, 3]]]
    >>> common = [[0.5, 0.2], [0.2, 0.5]]
    >>> joint = [[S[0], common], [common, S[1]]]
    >>> fuse([[359, 20], [2, 21]], S, cross_covariances=joint, period=360)
    Fused([1.78987 ± 0.9, 20.9425 ± 1.14], p-value 0.292)
    >>> fuse([[359, 20], [2, 21]], S, method="covariance-intersection", period=360)
    Fused([1.93436 ± 1.02, 20.9903 ± 1.66])
    """
    x, s = samples(estimates, "estimates"), samples(covariances, "covariances")
    if x.ndim < 2 or 0 in x.shape[-2:]:
        raise ValueError(f"estimates has shape {x.shape}; it must be (..., K, m)")
    sensors, m = x.shape[-2:]
    arrays, tails = {"estimates": x, "covariances": s}, [(sensors, m), (sensors, m, m)]
    if cross_covariances is not None:
        arrays["cross_covariances"] = samples(cross_covariances, "cross_covariances")
        tails.append((sensors, sensors, m, m))
    arguments: dict[str, object] = {
        "cross_covariances": None,
        **_of_one_batch(arrays, tails),
        "weights": _proportions(weights, method, sensors),
        "method": str(method),
        "period": None if period is None else real(period, "period"),
    }
    found, present = _core.fuse(arguments, threads(n_threads))
    mean, covariance, matrices, statistic, p_value = found
    return Fused(
        mean,
        covariance,
        matrices,
        scalar_or_array(statistic),
        scalar_or_array(np.asarray(np.maximum(present - 1, 0) * m)),
        scalar_or_array(p_value),
    )


def fuse_series(
    z: npt.ArrayLike,
    measurement_variance: npt.ArrayLike,
    model: SingerModel,
    *,
    method: FusionMethod = "robust",
    initial: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    times: npt.ArrayLike | None = None,
    period: float | None = None,
    change: float = 0.005,
    memory: float = 0.1,
    threshold: float = 1.6,
    outlier_gate: float = 16.0,
    n_threads: int | None = None,
) -> FusionResult:
    """Fuse the plots of several radars into one track.

    Parameters
    ----------
    z : array_like of shape (..., K, steps)
        Plots of the angle by K >= 1 radars at common times; nan where a radar has none. Radars that
        scan at different times share the times of all, with nan between their own.
    measurement_variance : array_like of shape (), (K, 1) or (..., K, steps)
        Variance of their noise, as they state it.
    model : SingerModel
        How the target moves.
    method : str
        "robust": one filter for all plots, whose noise, outliers and manoeuvres are found out.
        "adaptive": component by component by the inverse variances that the radars' tracks really
        have, as now believed.
        "matrix": the same believed covariances with the correlation between the radars, as full
        matrices.
        "central": one filter for all plots, with the noise as stated.
        "posterior": component by component by the inverse variances of the radars' own filters.
        "nominal-matrix": their full matrices and the correlation (Bar-Shalom, Campo 1986).
        "covariance-intersection": without the correlation; the covariance is an upper bound.
        "ewma": by the inverse running mean of the squared innovations.
        "static": by the inverse variances as stated. "equal": equal weights.
        "paper": component by component by the inverse squares of this step's corrections; radars
        without a plot are left out.
    initial : (mean, covariance), optional
        States of the radars' filters at the first step before their plots, of shapes (..., K, 3)
        and (..., K, 3, 3). By default nothing is known.
    times : array_like of shape (steps,) or (..., steps), optional
        Times of the steps, not decreasing; by default `model.dt` apart.
    period : float, optional
        360.0 for degrees, 2*pi for radians; None for data that do not wrap. Angles come back in
        [0, period).
    change : float
        For "robust": chance that a radar's noise changes from one of its plots to the next, and
        that a plot is a single outlier.
    memory : float
        For "adaptive", "matrix" and "ewma": share of the newest innovation in what is believed of a
        radar.
    threshold : float
        For "adaptive" and "matrix": mean normalised innovation, over that of the others, above
        which a radar is believed to be noisier than it says.
    outlier_gate : float
        Square of a single normalised innovation, likewise, above which a plot is an outlier.
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    FusionResult
        The track with its covariance, weights, believed noise and outliers.

    Raises
    ------
    ValueError
        Shapes that do not fit, a plot that is infinite, a variance that is not positive, times that
        decrease, an unknown method, or a parameter outside its domain.
    numpy.linalg.LinAlgError
        An initial covariance that is indefinite.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    "robust": a plot's noise variance is that stated times an unknown level (1/4 to 64; 256 for a
    single outlier), and the prediction's variance is that of the filter times 1 or 64. Every
    combination of levels is a hypothesis, as probable as it makes the plots of the step. Their
    mixture gives the state and its covariance, and the probabilities of each radar's levels, from
    which the next step starts. Cost O(K steps) besides the radars' own filters.

    "adaptive": each radar's filter runs with the noise as stated. A radar whose innovations are
    larger than expected and than those of the others (the median of them, so that a manoeuvre
    accuses nobody) is believed to have more noise, and its track the covariance that follows from
    that; the errors of two tracks are correlated through the motion that both follow. Cost
    O(K² steps).

    A bias of a radar is not noise, and not seen.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.fusion import fuse_series
    >>> from tertia.kalman import SingerModel
    >>> rng = np.random.default_rng(1)
    >>> z = 359.0 + 0.2 * np.arange(60) + 0.1 * rng.standard_normal((2, 60))
    >>> z[0, 20] -= 2.0
    >>> z[1, 40] += 3.0
    >>> result = fuse_series(z % 360, 0.01, SingerModel(5.0, 0.05, 0.003), period=360.0)
    >>> result
    FusionResult(2 radars, 60 steps, 2 outliers)
    """
    plots = samples(z, "z")
    if plots.ndim < 2 or plots.shape[-2] < 1 or plots.shape[-1] < 1:
        raise ValueError(f"z has shape {plots.shape}; it must be (..., K, steps)")
    _require_model(model)
    *batch, radars, steps = plots.shape
    arguments = {
        "z": plots,
        "variance": _variances(measurement_variance, tuple(batch), radars, steps),
        "dt": _intervals(times, model, steps, tuple(batch)),
        "initial": None if initial is None else _states(initial, tuple(batch), radars),
        "model": model._core,
        "period": None if period is None else real(period, "period"),
        "method": str(method),
        "change": real(change, "change"),
        "memory": real(memory, "memory"),
        "threshold": real(threshold, "threshold"),
        "outlier_gate": real(outlier_gate, "outlier_gate"),
    }
    arrays, outlier = _core.fuse_series(arguments, threads(n_threads))
    mean, upper, weights, noise, innovation, innovation_variance = arrays
    return FusionResult(mean, upper, weights, noise, outlier, innovation, innovation_variance)


TrackFusion = _core.TrackFusion


def common_azimuth(
    distance: npt.ArrayLike,
    azimuth: npt.ArrayLike,
    site: npt.ArrayLike,
    *,
    distance_sigma: npt.ArrayLike,
    azimuth_sigma: npt.ArrayLike,
    origin: npt.ArrayLike = (0.0, 0.0),
) -> tuple[FloatArray, FloatArray]:
    """Turn range and azimuth of a site into those seen from a common origin.

    Parameters
    ----------
    distance, azimuth : array_like of shape (...)
        Range in metres and azimuth in radians, clockwise from north, as the site measures them.
    site : array_like of shape (2,)
        The site, east and north in metres.
    distance_sigma, azimuth_sigma : array_like of shape (...)
        Their standard deviations.
    origin : array_like of shape (2,)
        The common origin, likewise.

    Returns
    -------
    polar : ndarray of shape (..., 2)
        Azimuth in [0, 2 pi), in radians, and range in metres, seen from the origin.
    covariance : ndarray of shape (..., 2, 2)
        Their covariance, to first order.

    Raises
    ------
    ValueError
        Shapes that do not fit, a number that is not finite or not positive where it must be, or a
        target at the origin.
    TypeError
        An argument of the wrong type.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.fusion import common_azimuth
    >>> polar, covariance = common_azimuth(
    ...     50e3, np.pi / 2, [-30e3, 20e3], distance_sigma=50.0, azimuth_sigma=0.002
    ... )
    >>> polar.round(4)
    array([7.85400000e-01, 2.82842712e+04])
    >>> (np.diagonal(covariance) ** 0.5).round(4)
    array([2.80000e-03, 7.90569e+01])
    """
    r, a = positive(distance, "distance"), finite(azimuth, "azimuth")
    sr, sa = positive(distance_sigma, "distance_sigma"), positive(azimuth_sigma, "azimuth_sigma")
    places = [finite(site, "site"), finite(origin, "origin")]
    for name, place in zip(("site", "origin"), places, strict=True):
        if place.shape != (2,):
            raise ValueError(f"{name} has shape {place.shape}; it must be (2,)")
    try:
        r, a, sr, sa = np.broadcast_arrays(r, a, sr, sa)
    except ValueError:
        raise ValueError(
            f"distance {r.shape}, azimuth {a.shape}, distance_sigma {sr.shape} and azimuth_sigma "
            f"{sa.shape} do not fit together"
        ) from None
    toward = np.stack([np.sin(a), np.cos(a)], axis=-1)
    offset = r[..., np.newaxis] * toward + (places[0] - places[1])
    rho = np.sqrt(np.sum(offset**2, axis=-1))
    if np.any(rho == 0):
        raise ValueError("distance and azimuth lead to the origin, where no azimuth is defined")
    # errors east and north, along the line of sight and across
    across = np.stack([toward[..., 1], -toward[..., 0]], axis=-1)
    errors = np.stack([sr[..., np.newaxis] * toward, (r * sa)[..., np.newaxis] * across], axis=-1)
    seen = offset / rho[..., np.newaxis]
    rows = np.stack([np.stack([seen[..., 1], -seen[..., 0]], -1) / rho[..., np.newaxis], seen], -2)
    roots = rows @ errors
    turned = np.asarray(np.arctan2(offset[..., 0], offset[..., 1]) % (2 * np.pi))
    turned[turned >= 2 * np.pi] = 0.0
    polar = np.stack([turned, rho], axis=-1)
    return polar, roots @ np.swapaxes(roots, -1, -2)


def _of_one_batch(
    arrays: dict[str, FloatArray], tails: list[tuple[int, ...]]
) -> dict[str, FloatArray]:
    """Return arrays of these shapes with the same leading axes."""
    batches = []
    for (name, array), tail in zip(arrays.items(), tails, strict=True):
        if array.shape[-len(tail) :] != tail:
            expected = ", ".join(map(str, tail))
            raise ValueError(
                f"{name} has shape {array.shape}; for estimates of shape "
                f"{arrays['estimates'].shape} it must be (..., {expected})"
            )
        batches.append(array.shape[: -len(tail)])
    try:
        batch = np.broadcast_shapes(*batches)
    except ValueError:
        told = ", ".join(f"{name} {shape}" for name, shape in zip(arrays, batches, strict=True))
        raise ValueError(f"the batches do not fit together: {told}") from None
    pairs = zip(arrays.items(), tails, strict=True)
    return {name: np.broadcast_to(array, batch + tail) for (name, array), tail in pairs}


def _proportions(weights: npt.ArrayLike | None, method: str, sensors: int) -> list[float] | None:
    """Return the weights of method "static"."""
    if (weights is None) == (method == "static"):
        needed = "needs weights" if weights is None else "takes no weights"
        raise ValueError(f"method {method!r} {needed}; they are for 'static'")
    if weights is None:
        return None
    array = finite(weights, "weights")
    if array.shape != (sensors,):
        raise ValueError(f"weights has shape {array.shape}; it must be ({sensors},)")
    if np.any(array < 0) or not np.any(array > 0):
        raise ValueError(f"weights are {array}; they must not be negative, and not all zero")
    numbers: list[float] = array.tolist()
    return numbers


def _variances(
    measurement_variance: npt.ArrayLike, batch: tuple[int, ...], radars: int, steps: int
) -> FloatArray:
    """Return variances of shape (1 or K, 1 or steps), of one row for all or one for each."""
    array = np.atleast_2d(samples(measurement_variance, "measurement_variance"))
    lengths = (1, steps)
    if array.shape[-1] in lengths and array.shape[-2] in {1, radars}:
        if array.ndim == 2:
            return array
        try:
            return np.broadcast_to(array, (*batch, *array.shape[-2:]))
        except ValueError:
            pass
    raise ValueError(
        f"measurement_variance has shape {array.shape}; for {radars} radars and series {batch} it "
        f"must be (), ({radars}, 1) or (..., {radars}, {steps})"
    )


def _states(
    initial: tuple[npt.ArrayLike, npt.ArrayLike], batch: tuple[int, ...], radars: int
) -> FloatArray:
    states = _initial(initial, (*batch, radars))
    if states.ndim == 1:
        return states[np.newaxis]
    return states.reshape(*batch, radars, 12)
