"""Pictures of one series: its smoothed values, and the consistency of its errors."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tertia._arrays import integer, real, samples
from tertia.metrics import consistency_bounds
from tertia.plot._axes import (
    FLAGGED,
    KEPT,
    RESULT,
    add_legend,
    bounds,
    draw_band,
    label_time,
    new_axes,
    time_axis,
)
from tertia.smoothing import LocalPolynomial, SmoothedPositions

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def smoothing(
    y: npt.ArrayLike,
    result: LocalPolynomial | SmoothedPositions,
    *,
    time: npt.ArrayLike | None = None,
    axis: int = 0,
    width: float = 2.0,
    legend: bool = True,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw a series, and its smoothed values with an error band.

    Parameters
    ----------
    y : array_like of shape (N,), or (N, D) of positions
        The series, as given to the function of `tertia.smoothing`; values that are nan are not
        drawn.
    result : LocalPolynomial or SmoothedPositions
        The smoothed values or positions.
    time : array_like of shape (N,), optional
        Times of the rows, as numbers or datetime64; by default the rows are numbered from 0.
    axis : int
        Index of the component that is drawn if the rows are positions.
    width : float
        Half the width of the band, in standard deviations.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default the axes of a new figure.
    legend : bool
        Whether to draw a legend.

    Returns
    -------
    matplotlib.axes.Axes
        The axes. They show the values against time.

    Raises
    ------
    ValueError
        If `result` is a batch, or an argument does not fit it.

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from tertia import plot
    >>> from tertia.smoothing import local_polynomial
    >>> y = np.sin(np.arange(60) / 10) + 0.3 * np.random.default_rng(1).standard_normal(60)
    >>> plot.smoothing(y, local_polynomial(y), ax=Figure().subplots()).get_title()
    '60 of 60 instants'
    """
    series = samples(y, "y")
    if isinstance(result, SmoothedPositions):
        number = integer(axis, "axis", 0)
        shape = result.position.shape
        dimension = shape[-1]
        if number >= dimension:
            raise ValueError(f"axis is {number}; result has {dimension} axes")
        value, sigma = result.mean[..., number], result.sigma[..., number]
    elif isinstance(result, LocalPolynomial):
        number, shape = None, result.value.shape
        value, sigma = result.value, result.sigma
    else:
        message = "it must be a LocalPolynomial or a SmoothedPositions"
        raise TypeError(f"result is {result!r}; {message}")
    if value.ndim != 1:
        raise ValueError(
            f"result has a batch of shape {value.shape[:-1]}; only one series can be drawn"
        )
    if series.shape != shape:
        raise ValueError(f"y has shape {series.shape}, but result was made of shape {shape}")
    points = series if number is None else series[:, number]
    half = real(width, "width") * sigma
    times = time_axis(time, len(value))
    ax = new_axes() if ax is None else ax

    # cut where nothing is known
    draw_band(ax, times, *bounds(value, half), f"± {width:g} sigma")
    there = ~np.isnan(points)
    ax.plot(times[there], points[there], ".", color=KEPT, markersize=4, label="measured")
    ax.plot(times, value, color=RESULT, linewidth=1, label="smoothed")
    ax.set(title=f"{np.count_nonzero(there)} of {len(points)} instants")
    label_time(ax, times, "instant" if time is None else "time")
    if legend:
        add_legend(ax)
    return ax


def consistency(
    normalised: npt.ArrayLike,
    *,
    dimension: int = 1,
    probability: float = 0.99,
    time: npt.ArrayLike | None = None,
    legend: bool = True,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw normalised squared errors over time, with bounds for the case of correct covariances.

    Parameters
    ----------
    normalised : array_like of shape (..., steps)
        Normalised squared errors, as returned by `tertia.metrics.nees` or `tertia.metrics.nis`; nan
        if there is none. They are averaged over independent runs, which are the leading axes.
    dimension : int
        Number of components of each error: 3 for the state of a track, 1 for innovations.
    probability : float
        Probability that the mean at a step lies within the bounds if the covariances are correct.
    time : array_like of shape (steps,), optional
        Times of the steps, as numbers or datetime64; by default the steps are numbered from 0.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default the axes of a new figure.
    legend : bool
        Whether to draw a legend.

    Returns
    -------
    matplotlib.axes.Axes
        The axes. They show the mean at each step against time, and the bounds for the number of
        runs that have a value at that step.

    Raises
    ------
    ValueError
        If there are no steps or all values are nan, times do not fit, or a number is outside its
        domain.

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from tertia import metrics, plot
    >>> innovation = np.random.default_rng(1).standard_normal((50, 100))
    >>> nis = metrics.nis(innovation, 1.0)
    >>> plot.consistency(nis, ax=Figure().subplots()).get_title()
    '99 of 100 within the bounds of 99 %; mean 1'
    """
    values = samples(normalised, "normalised")
    if values.ndim == 0 or np.isnan(values).all():
        raise ValueError(f"normalised of shape {values.shape} has no steps that can be drawn")
    runs = values.reshape(-1, values.shape[-1])
    counts = np.count_nonzero(~np.isnan(runs), axis=0)
    drawn = counts > 0
    means = np.nansum(runs, axis=0)[drawn] / counts[drawn]
    # the quantiles are computed once per number of runs
    numbers, place = np.unique(counts[drawn], return_inverse=True)
    bounds = [consistency_bounds(int(n), dimension, probability) for n in numbers]
    low, high = np.array(bounds)[place].T
    times = time_axis(time, runs.shape[1])[drawn]
    ax = new_axes() if ax is None else ax

    inside = (low <= means) & (means <= high)
    draw_band(ax, times, low, high, f"{100 * probability:.10g} % of means", alpha=0.2, step="mid")
    ax.axhline(dimension, color=RESULT, linewidth=1, label="expected")
    ax.plot(times[inside], means[inside], ".", color=KEPT, label="within")
    if not inside.all():
        ax.plot(times[~inside], means[~inside], "x", color=FLAGGED, label="outside")
    ax.set(
        title=f"{np.count_nonzero(inside)} of {means.size} within the bounds of "
        f"{100 * probability:.10g} %; mean {np.nanmean(runs):.3g}",
        ylabel="normalised squared error",
    )
    label_time(ax, times, "step" if time is None else "time")
    if legend:
        add_legend(ax)
    return ax
