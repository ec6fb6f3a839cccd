"""Pictures of single samples of measurements."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, integer, real, samples
from tertia.bearing import BearingEstimate
from tertia.plot._axes import (
    BAND,
    FLAGGED,
    KEPT,
    RESULT,
    add_legend,
    angle_unit,
    near,
    new_axes,
    with_sigmas,
    wrapped_label,
)
from tertia.screening import Screening

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_REPLACED = "#CC79A7"
# the lightest block must still be seen
_FAINTEST = 0.25


def bearing(
    theta: npt.ArrayLike,
    estimate: BearingEstimate,
    *,
    period: float | None = 360.0,
    block_size: int = 10,
    legend: bool = True,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw a record of bearings, its outliers and blocks, and the estimate with its 2-sigma band.

    Bearings are drawn within half a period of the estimate, so that there is no jump at north. The
    labels of the axis are wrapped to [0, period).

    Parameters
    ----------
    theta : array_like of shape (N,)
        The measurements, as given to `tertia.estimate_bearing`; values that are nan are not drawn.
    estimate : BearingEstimate
        The bearing.
    period : float or None
        Period that was given to `tertia.estimate_bearing`, in the unit of `theta`.
    block_size : int
        Block size that was given to `tertia.estimate_bearing`; the estimate does not contain it.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default the axes of a new figure.
    legend : bool
        Whether to draw a legend.

    Returns
    -------
    matplotlib.axes.Axes
        The axes. They show the bearings, in the unit of `theta`, against the index of the
        measurement. Blocks with larger weights are darker.

    Raises
    ------
    ValueError
        If `theta` is not one sample, or `theta` or `block_size` does not fit `estimate`.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> import tertia
    >>> from tertia import plot
    >>> record = tertia.simulate.direction_finder(100, bearing=359.0, rng=7)
    >>> estimate = tertia.estimate_bearing(record.theta)
    >>> plot.bearing(record.theta, estimate, ax=Figure().subplots()).get_title()
    '358.48 ± 0.36'
    """
    period = None if period is None else real(period, "period")
    angles = _sample(theta, "theta", estimate.outlier, "estimate")
    value, sigma = real(estimate.value, "estimate.value"), real(estimate.sigma, "estimate.sigma")
    extents = _extents(angles, estimate, integer(block_size, "block_size", 2))
    ax = new_axes() if ax is None else ax

    _draw_band(ax, value, 2 * sigma, "± 2 sigma")
    _draw_measurements(ax, near(angles, value, period), estimate.outlier)
    if estimate.block_means is not None and estimate.block_weights is not None:
        means = near(estimate.block_means, value, period)
        _draw_blocks(ax, means, estimate.block_weights, extents)
    ax.axhline(value, color=RESULT, linewidth=1.5, label="bearing")
    ax.set(title=with_sigmas([value], [sigma]), ylabel="bearing" + angle_unit(period))
    if period is not None:
        ax.yaxis.set_major_formatter(lambda angle, _: wrapped_label(angle, period))
    return _finish(ax, legend)


def screening(
    y: npt.ArrayLike, screening: Screening, *, legend: bool = True, ax: "Axes | None" = None
) -> "Axes":
    """Draw a sample, its outliers and their replacements, and the band of accepted values.

    Parameters
    ----------
    y : array_like of shape (N,)
        The measurements, as given to the screening function; values that are nan are not drawn.
    screening : Screening
        The result of the screening.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default the axes of a new figure.
    legend : bool
        Whether to draw a legend.

    Returns
    -------
    matplotlib.axes.Axes
        The axes. They show the measurements, in the unit of `y`, against their index. The band is
        mean ± threshold. For a sequential screening, the band is that after the last measurement,
        so an earlier measurement outside it may have been accepted.

    Raises
    ------
    TypeError
        If `y` does not hold real numbers.
    ValueError
        If `y` is not one sample, or does not fit `screening`.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from tertia import plot
    >>> from tertia.screening import leave_one_out
    >>> y = [12.4, 11.8, 40.0, 12.1, 12.9, 11.5, 20.0, 12.2, 12.0, 11.9]
    >>> plot.screening(y, leave_one_out(y), ax=Figure().subplots()).get_title()
    '2 of 10 outliers'
    """
    values = _sample(y, "y", screening.outlier, "screening")
    mean = real(screening.mean, "screening.mean")
    threshold = real(screening.threshold, "screening.threshold")
    ax = new_axes() if ax is None else ax

    _draw_band(ax, mean, threshold, "mean ± threshold")
    _draw_measurements(ax, values, screening.outlier)
    replaced = np.flatnonzero(screening.outlier & ~np.isnan(screening.cleaned))
    if replaced.size:
        looks: dict[str, Any] = {"color": _REPLACED, "markersize": 4, "label": "replacement"}
        ax.plot(replaced, screening.cleaned[replaced], "D", **looks)
    ax.axhline(mean, color=RESULT, linewidth=1.5, label="mean")
    found, present = np.count_nonzero(screening.outlier), np.count_nonzero(~np.isnan(values))
    ax.set(title=f"{found} of {present} outliers", ylabel="value")
    return _finish(ax, legend)


def _sample(value: npt.ArrayLike, name: str, outlier: BoolArray, result: str) -> FloatArray:
    array = samples(value, name)
    if array.ndim != 1:
        raise ValueError(
            f"{name} has shape {array.shape}; only one sample of shape (N,) can be drawn"
        )
    if array.shape != outlier.shape:
        raise ValueError(
            f"{name} has shape {array.shape}, but {result} was made of shape {outlier.shape}"
        )
    return array


def _extents(theta: FloatArray, estimate: BearingEstimate, block_size: int) -> FloatArray:
    """Return the first and last measurement of each block, (blocks, 2), ignoring missing ones."""
    if estimate.block_means is None:
        return np.empty((0, 2))
    present = np.flatnonzero(~np.isnan(theta))
    # with gaps there are fewer blocks than the estimate has room for
    room, count = (max(1, size // block_size) for size in (theta.size, present.size))
    if room != estimate.block_means.size:
        raise ValueError(
            f"block_size is {block_size}, which makes {room} blocks of {theta.size} measurements; "
            f"estimate has {estimate.block_means.size}"
        )
    first = np.arange(count) * block_size
    last = np.append(first[1:], present.size) - 1
    return np.column_stack([present[first], present[last]]).astype(np.float64)


def _draw_band(ax: "Axes", centre: float, half_width: float, label: str) -> None:
    low, high = centre - half_width, centre + half_width
    ax.axhspan(low, high, facecolor=BAND, edgecolor="none", alpha=0.2, label=label)


def _draw_measurements(ax: "Axes", values: FloatArray, outlier: BoolArray) -> None:
    kept, flagged = np.flatnonzero(~outlier), np.flatnonzero(outlier)
    ax.plot(kept, values[kept], ".", color=KEPT, markersize=5, label="measurement")
    if flagged.size:
        ax.plot(flagged, values[flagged], "x", color=FLAGGED, markersize=6, label="outlier")


def _draw_blocks(ax: "Axes", means: FloatArray, weights: FloatArray, extents: FloatArray) -> None:
    # no mean where a whole block is outliers, no extent where gaps leave fewer blocks
    means, weights = means[: len(extents)], weights[: len(extents)]
    drawn = ~np.isnan(means)
    first, last = extents[drawn].T
    opacity = _FAINTEST + (1 - _FAINTEST) * weights[drawn] / weights.max()
    colours = [(0.3, 0.3, 0.3, alpha) for alpha in opacity]
    looks: dict[str, Any] = {"linewidth": 3, "zorder": 3, "label": "block mean"}
    ax.hlines(means[drawn], first - 0.5, last + 0.5, colors=colours, **looks)


def _finish(ax: "Axes", legend: bool) -> "Axes":
    ax.set_xlabel("measurement")
    if legend:
        add_legend(ax)
    return ax
