"""A series with its smooth curve and the band of its error."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tertia._arrays import integer, real, samples
from tertia.plot._axes import BAND, KEPT, RESULT, add_legend, new_axes
from tertia.plot._tracks import _instants, _shorten_dates
from tertia.smoothing import LocalPolynomial, SmoothedPositions

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def smoothing(
    y: npt.ArrayLike,
    result: LocalPolynomial | SmoothedPositions,
    *,
    times: npt.ArrayLike | None = None,
    axis: int = 0,
    width: float = 2.0,
    legend: bool = True,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw a series, the curve through it, and the band of its error.

    Parameters
    ----------
    y : array_like of shape (N,), or (N, D) for a track
        As given to `tertia.smoothing`; nan is not drawn.
    result : LocalPolynomial or SmoothedPositions
        What came of it: values, or positions.
    times : array_like of shape (N,), optional
        Times of the instants, numbers or datetime64; by default they are numbered from 0.
    axis : int
        Which axis of a track.
    width : float
        Half the width of the band, in standard errors.
    legend : bool
        Whether to draw one.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    ValueError
        A batch, or arguments that are not what `result` was made of.
    TypeError
        An argument of the wrong type.
    ImportError
        Matplotlib is missing.

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
        dimension = result.innovation.shape[-1]
        if number >= dimension:
            raise ValueError(f"axis is {number}; result has {dimension} axes")
        shape = result.innovation.shape
        value, sigma = result.mean[..., number], result.sigma[..., number]
    elif isinstance(result, LocalPolynomial):
        number, shape = None, result.value.shape
        value, sigma = result.value, result.sigma
    else:
        message = "it must be a LocalPolynomial or a SmoothedPositions"
        raise TypeError(f"result is {result!r}; {message}")
    if value.ndim != 1:
        raise ValueError(f"result has a batch of shape {value.shape[:-1]}; one series can be drawn")
    if series.shape != shape:
        raise ValueError(f"y has shape {series.shape}, but result was made of shape {shape}")
    points = series if number is None else series[:, number]
    half = real(width, "width") * sigma
    instants = _instants(times, len(value))
    ax = new_axes() if ax is None else ax

    known = np.isfinite(half)
    # cut where nothing is known
    low, high = (
        np.where(known, value + sign * np.where(known, half, 0), np.nan) for sign in (-1, 1)
    )
    ax.fill_between(
        instants,
        low,
        high,
        where=known.tolist(),
        facecolor=BAND,
        edgecolor="none",
        alpha=0.3,
        label=f"± {width:g} sigma",
    )
    there = ~np.isnan(points)
    ax.plot(instants[there], points[there], ".", color=KEPT, markersize=4, label="measured")
    ax.plot(instants, value, color=RESULT, linewidth=1, label="smoothed")
    ax.set(
        title=f"{np.count_nonzero(there)} of {len(points)} instants",
        xlabel="instant" if times is None else "time",
    )
    _shorten_dates(ax, instants)
    if legend:
        add_legend(ax)
    return ax
