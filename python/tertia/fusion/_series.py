"""The plots of several radars over time, fused into one track."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    BoolArray,
    FloatArray,
    Systematic,
    choice,
    finite,
    real,
    require_between,
    samples,
    spread,
    threads,
)
from tertia._result import counted
from tertia.fusion._biases import prior_of, registered, trusted
from tertia.fusion._doubts import doubt_copies, doubt_errors, doubt_radars
from tertia.fusion._lasting import correlation_times, growth
from tertia.kalman import filter_series
from tertia.kalman._batch import _initial, _intervals
from tertia.kalman._model import SingerModel, States, _require_model

FusionMethod: TypeAlias = Literal[
    "robust",
    "adaptive",
    "adaptive-matrix",
    "central",
    "posterior",
    "matrix",
    "covariance-intersection",
    "ewma",
    "static",
    "equal",
    "paper",
]

Outage: TypeAlias = Literal["excluded", "printed"]


@dataclass(frozen=True, slots=True, eq=False)
class FusedSeries(States):
    """A fused track, and the estimated noise of the radars.

    Attributes
    ----------
    mean : ndarray of shape (..., steps, 3)
        Fused angle, rate and acceleration.
    upper : ndarray of shape (..., steps, 6)
        Upper triangles of the covariances of `mean`, row by row.
    weights : ndarray of shape (..., K, steps, 3)
        Weights of the radars in angle, rate and acceleration, which are the diagonals of the weight
        matrices; nan for a radar whose state is still unknown, and for "central". For "robust", it
        is the relative weight of each plot in the correction of its step, which is the same in all
        components; 0 where a radar has no plot.
    noise_variance : ndarray of shape (..., K, steps)
        Estimated variance of the plots of each radar; for "robust", single outliers do not
        contribute to it.
    outlier : ndarray of bool, shape (..., K, steps)
        True for plots that were treated as single outliers. With methods other than "robust", the
        radar's own filter needs some steps to recover from an outlier, and the next plots may be
        marked as outliers, too.
    repeated : ndarray of bool, shape (..., K, steps)
        True for those outliers that repeat the plot before, as from a radar that is stuck (see
        `fuse_series`).
    innovation, innovation_variance : ndarray of shape (..., K, steps)
        Innovation of each radar's own filter at each step, computed with the stated noise, and its
        variance; nan where there is no innovation.
    correlation_time : ndarray of shape (..., K)
        Correlation time of the noise of each radar, given or estimated; 0 for white noise.
    bias, bias_sigma : ndarray of shape (..., K)
        Systematic error of each radar, which was subtracted from its plots, and its standard
        deviation; both are zero if no `bias_sigma` was given.
    systematic : {"given", "not included"}
        Whether the covariance includes the uncertainty of the systematic errors.
    unfiltered : ndarray of shape (..., steps, 3) or None
        The fused states before the third filter; None if `third_filter` was not given.
    """

    mean: FloatArray
    upper: FloatArray
    weights: FloatArray
    noise_variance: FloatArray
    outlier: BoolArray
    repeated: BoolArray
    innovation: FloatArray
    innovation_variance: FloatArray
    correlation_time: FloatArray
    bias: FloatArray
    bias_sigma: FloatArray
    systematic: Systematic = "not included"
    unfiltered: FloatArray | None = None

    def __repr__(self) -> str:
        """Show the shape, the number of outliers, and which radars repeat their plots."""
        *batch, radars, steps = self.outlier.shape
        counts = {"radar": radars, "step": steps, "outlier": np.count_nonzero(self.outlier)}
        parts = [f"batch {tuple(batch)}"] if batch else []
        parts += [counted(count, what) for what, count in counts.items()]
        if self.repeated.any():
            stuck = np.flatnonzero(
                np.moveaxis(self.repeated, -2, 0).reshape(radars, -1).any(axis=1)
            )
            parts.append(f"repeated plots of radar {', '.join(map(str, stuck + 1))}")
        if self.systematic == "not included":
            parts.append("systematic error not included")
        return f"FusedSeries({', '.join(parts)})"


def fuse_series(
    z: npt.ArrayLike,
    measurement_variance: npt.ArrayLike,
    model: SingerModel,
    *,
    bias_sigma: npt.ArrayLike = 0.0,
    method: FusionMethod = "robust",
    initial: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    time: npt.ArrayLike | None = None,
    period: float | None = None,
    change_probability: float = 0.005,
    forgetting_factor: float = 0.9,
    threshold: float = 1.6,
    outlier_gate: float = 16.0,
    correlation_time: npt.ArrayLike | None = 0.0,
    outage: Outage = "excluded",
    third_filter: SingerModel | None = None,
    n_threads: int | None = None,
) -> FusedSeries:
    """Fuse the plots of several radars into one track.

    Parameters
    ----------
    z : array_like of shape (..., K, steps)
        Plots of the angle from K >= 1 radars at common times; nan where a radar has none. If the
        radars scan at different times, use the times of all radars as steps, with nan where a radar
        has no plot.
    measurement_variance : array_like of shape (), (K, 1) or (..., K, steps)
        Stated variance of the noise of the plots.
    model : SingerModel
        Model of the target's motion.
    bias_sigma : float or array_like of shape (K,)
        Standard deviation of a constant systematic error of each radar. 0: the radar has none. inf:
        nothing is known about it; this is not allowed for all radars at once. The errors are
        estimated from the plots of all steps and subtracted, and their remaining uncertainty is
        part of the covariance. Unless one radar has a `bias_sigma` of 0, most of the error common
        to all radars remains unknown.
    method : str
        "robust": one filter uses all plots, and detects wrongly stated noise, outliers and
        manoeuvres.
        "adaptive": each component is weighted by the inverses of the actual variances of the
        radars' tracks, which are estimated from the innovations.
        "adaptive-matrix": like "adaptive", but with full covariance matrices and the correlation
        between the radars' tracks.
        "central": one filter uses all plots, with the noise as stated.
        "posterior": each component is weighted by the inverses of the variances of the radars' own
        filters.
        "matrix": like "posterior", but with full covariance matrices and the correlation between
        the radars' tracks (Bar-Shalom, Campo 1986).
        "covariance-intersection": like "matrix", but for unknown correlation; the covariance is an
        upper bound.
        "ewma": weights are the inverses of running means of the squared innovations.
        "static": weights are the inverses of the stated variances. "equal": all weights are equal.
        "paper": each component is weighted by the inverses of its squared corrections in this step.
    initial : (mean, covariance), optional
        Mean and covariance of the radars' filters at the first step before its plots, of shapes
        (..., K, 3) and (..., K, 3, 3). By default the states are unknown. If a `bias_sigma` is
        given, `initial` is not allowed.
    time : array_like of shape (steps,) or (..., steps), optional
        Times of the steps, in non-decreasing order; by default they are `model.dt` apart.
    period : float, optional
        Period of the angle: 360.0 for degrees, 2*pi for radians, None for data that do not wrap.
        Fused angles are in [0, period).
    change_probability : float
        For "robust": probability that the noise of a radar changes between two of its plots; also
        the probability that a plot is a single outlier.
    forgetting_factor : float
        For "adaptive", "adaptive-matrix" and "ewma": factor by which the weight of past innovations
        of a radar in the running means decreases with each plot.
    threshold : float
        For "adaptive" and "adaptive-matrix": a radar is treated as noisier than stated if the ratio
        of the mean of its normalised innovations squared to that of the other radars exceeds this
        threshold.
    outlier_gate : float
        A plot is an outlier if the ratio of its normalised innovation squared to those of the other
        radars exceeds this gate.
    correlation_time : float, array_like of shape (K,), or None
        Correlation time of the noise, one for all radars or one for each. The noise of two plots of
        a radar that are a time T apart has the correlation `exp(-T / correlation_time)`. None: it
        is estimated for each radar, as in `tertia.smoothing.smooth`. Correlation increases the
        covariance but does not change the track.
    outage : {"excluded", "printed"}
        Only for "paper": how to treat a radar without a plot. "excluded": it has no weight.
        "printed": its correction is zero, as in the source, which gives it all the weight.
    third_filter : SingerModel, optional
        Only for "paper": a motion model with which the fused angle is filtered again, as in the
        source. Its noise variance is the mean of the stated variances of the K radars, divided by
        K. The covariance is then that of the third filter, which treats correlated errors as white
        noise.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    FusedSeries
        The fused track with its covariance, weights, estimated noise and outliers.

    Raises
    ------
    ValueError
        If shapes do not fit, a plot is infinite, a variance is not positive, times decrease, a
        correlation time is negative, the method is unknown, or a parameter is outside its domain.
    numpy.linalg.LinAlgError
        If an initial covariance is indefinite.
    TypeError
        If an argument has the wrong type.

    Warns
    -----
    UserWarning
        For "robust". If most plots of a radar are outliers: they contradict the other radars, as if
        they had another unit, another north or other times. If nearly all plots of two radars
        are the same. If errors last that are as large as the noise, as of a radar that drifts, and
        at most half of the radars agree; not if `bias_sigma` is given or the noise is correlated.

    Notes
    -----
    "robust": the noise variance of a plot is the stated variance times an unknown level (1/4 to 64,
    or 256 or 65,536 for a single outlier), and the variance of the prediction is that of the filter
    times 1 or 64. Every combination of levels is a hypothesis, weighted by the likelihood of the
    plots of the step. The mixture of the hypotheses gives the state, its covariance, and the
    probabilities of the levels of each radar for the next step. The cost is O(K steps), plus that
    of the radars' own filters.

    Repeated plots ("robust", "adaptive", "adaptive-matrix"): a radar that is stuck gives the same
    number again. A radar that works, with noise of standard deviation s that is recorded in steps
    of d, repeats a number with a probability of at most `d / (2 sqrt(pi) s)`; s is taken as half of
    the stated value, and d as the smallest difference of two successive plots of the radar so far.
    Whether the radar is stuck is modelled as a Markov chain: it gets stuck with the probability
    `change_probability`, and a plot that differs shows that it works. Plots that are more probably
    repetitions than measurements are left out. If the probability above exceeds 1/4, repetitions
    are attributed to rounding, unless the other radars see the target move.

    "adaptive": the filter of each radar uses the noise as stated. If the innovations of a radar are
    larger than expected and larger than the median of the other radars, its noise and the
    covariance of its track are increased. Because of the comparison with the other radars, a
    manoeuvre of the target is not attributed to the noise of a radar. The errors of two tracks are
    correlated because both tracks are of the same motion. The cost is O(K² steps).

    `bias_sigma`: the initial state of the target and the systematic errors are unknown coefficients
    of one filter for all plots (de Jong 1991). They are estimated by a regression of the
    innovations, which is exact for the model. The noise variances and outliers in this filter are
    those that the method finds. The errors are estimated from the whole series; `AngleFusion`
    requires plots that are already corrected. If no `bias_sigma` is given, systematic errors of
    radars are not detected. The cost is O(K² steps).

    Time-correlated noise is treated as if the filter had a constant gain K: the part of the
    variance that comes from white noise, K / (2 - K), is multiplied by (1 + φ (1 - K)) / (1 - φ (1
    - K)), where φ is the correlation of successive plots of a radar. The part that comes from the
    motion is not changed. If the noise is correlated, it is not assumed to be smaller than stated.

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
    FusedSeries(2 radars, 60 steps, 2 outliers, systematic error not included)
    """
    plots = samples(z, "z")
    if plots.ndim < 2 or plots.shape[-2] < 1 or plots.shape[-1] < 1:
        raise ValueError(f"z has shape {plots.shape}; it must be (..., K, steps)")
    _require_model(model)
    *batch, radars, steps = plots.shape
    stated = _variances(measurement_variance, tuple(batch), radars, steps)
    wrap = None if period is None else real(period, "period")
    _require_paper(str(method), outage, third_filter)
    arguments = {
        "z": plots,
        "variance": stated,
        "dt": _intervals(time, model, steps, tuple(batch)),
        "initial": None if initial is None else _states(initial, tuple(batch), radars),
        "model": model,
        "period": wrap,
        "method": str(method),
        "printed": outage == "printed",
        "change_probability": real(change_probability, "change_probability"),
        "forgetting_factor": real(forgetting_factor, "forgetting_factor"),
        "threshold": real(threshold, "threshold"),
        "outlier_gate": real(outlier_gate, "outlier_gate"),
    }
    prior = prior_of(bias_sigma, radars)
    if initial is not None and prior is not None:
        raise ValueError("initial contains the systematic errors; leave it out with a bias_sigma")
    fused = _core.fuse_series(arguments, threads(n_threads))
    lasting, phi = _lasting(correlation_time, plots, stated, (time, model.dt), wrap)
    if prior is None:
        one = trusted(fused, phi.shape)
    else:
        angle = fused[0][0][..., 0]
        one = registered(arguments, angle, prior, (1 + phi) / (1 - phi), threads(n_threads))
    (mean, upper, weights, noise, innovation, innovation_variance), (outlier, repeated) = one.fused
    if method == "robust":
        if np.count_nonzero(outlier):
            doubt_radars(outlier & ~repeated, ~np.isnan(plots) & ~repeated)
        doubt_copies(plots)
        if prior is None and not np.count_nonzero(lasting):
            doubt_errors(plots, outlier, mean[..., 0], stated, wrap)
    if np.count_nonzero(lasting):
        variance = spread(stated, plots.shape)
        is_bound = method == "covariance-intersection"
        there = ~np.isnan(plots)
        factor = growth(upper[..., 0], variance, noise, there, phi, is_bound=is_bound)
        upper = upper * factor[..., np.newaxis]
    found = FusedSeries(
        mean,
        upper if one.added is None else upper + one.added,
        weights,
        noise,
        outlier,
        repeated,
        innovation,
        innovation_variance,
        lasting,
        one.value,
        one.sigma,
        "not included" if one.added is None else "given",
    )
    if third_filter is None:
        return found
    noise_of_mean = np.mean(spread(stated, plots.shape), axis=-2) / radars
    again = filter_series(
        mean[..., 0], noise_of_mean, third_filter, time=time, period=wrap, n_threads=n_threads
    )
    upper = again.upper if one.added is None else again.upper + one.added
    return replace(found, mean=again.mean, upper=upper, unfiltered=mean)


def _require_paper(method: str, outage: str, third_filter: SingerModel | None) -> None:
    """Raise an error if options of "paper" are wrong, or given with another method."""
    choice(outage, "outage", get_args(Outage))
    if third_filter is not None:
        _require_model(third_filter)
    if method != "paper" and (outage != "excluded" or third_filter is not None):
        raise ValueError(f"outage and third_filter are for 'paper', method is {method!r}")


def _lasting(
    correlation_time: npt.ArrayLike | None,
    plots: FloatArray,
    variance: FloatArray,
    when: tuple[npt.ArrayLike | None, float],
    period: float | None,
) -> tuple[FloatArray, FloatArray]:
    """Return the correlation times and the correlations of successive plots, both (..., K).

    `when` is the time of each step; if it is missing, steps have equal intervals.
    """
    *batch, radars, steps = plots.shape
    phi = np.zeros((*batch, radars))
    given = None if correlation_time is None else _correlation_times(correlation_time, radars)
    if given is not None and not np.count_nonzero(given):
        return phi, phi
    time, step = when
    own = step * np.arange(steps, dtype=np.float64) if time is None else finite(time, "time")
    instants = np.broadcast_to(own, (*batch, steps))
    if given is None:
        lasting = correlation_times(plots, variance, instants, period)
    else:
        lasting = np.broadcast_to(given, phi.shape).copy()
    for place in np.ndindex(*phi.shape):
        seen = instants[place[:-1]][~np.isnan(plots[place])]
        if lasting[place] > 0 and seen.size > 1:
            phi[place] = np.exp(-np.median(np.diff(seen)) / lasting[place])
    return lasting, phi


def _correlation_times(value: npt.ArrayLike, radars: int) -> FloatArray:
    """Return the given correlation times, one for all radars or one for each."""
    given = samples(value, "correlation_time")
    require_between(given, "correlation_time", "a number that is not negative", 0.0)
    if given.shape not in {(), (radars,)}:
        raise ValueError(f"correlation_time has shape {given.shape}; it must be () or ({radars},)")
    return given


def _variances(
    measurement_variance: npt.ArrayLike, batch: tuple[int, ...], radars: int, steps: int
) -> FloatArray:
    """Return variances of shape (1 or K, 1 or steps): one array for all series or one for each."""
    array = samples(measurement_variance, "measurement_variance")
    if array.ndim < 2:
        array = array.reshape(1, -1)
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
