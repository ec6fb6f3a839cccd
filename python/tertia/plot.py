"""Pictures: what was measured, what was flagged, and what came of it.

Needs the extra `plot` (Matplotlib). Nothing is shown or saved: the functions return the axes.
Flagged measurements differ in shape as well as in colour; the colours are those of Okabe and Ito,
which remain distinct for colour-blind readers.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, finite, flag, integer, real, samples
from tertia.bearing import BearingEstimate
from tertia.screening import Screening
from tertia.weights import Combination

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["bearing", "combination", "screening"]

_KEPT, _FLAGGED, _REPLACED = "#56B4E9", "#D55E00", "#CC79A7"
_RESULT, _BAND = "#000000", "#009E73"
# one for each estimate; black and thick is what they are fused into
_ESTIMATES = (
    ("#56B4E9", "o", "-"),
    ("#D55E00", "s", "--"),
    ("#009E73", "^", "-."),
    ("#CC79A7", "D", ":"),
    ("#E69F00", "v", "-"),
    ("#0072B2", "P", "--"),
)
_ELLIPSE_POINTS = 181
# by so much rounding may leave a correlation above 1
_ROUNDING = 1e-12
# the lightest group must still be seen
_FAINTEST = 0.25
# share of the height that is kept free for the legend
_HEADROOM = 0.2


def bearing(
    theta: npt.ArrayLike,
    estimate: BearingEstimate,
    *,
    period: float | None = 360.0,
    group_size: int = 10,
    legend: bool = True,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw a record of bearings, the anomalous ones, the groups, the estimate and its 2-sigma band.

    The record is drawn continuously about the estimate, across north too; the labels of the axis
    are wrapped back to [0, period).

    Parameters
    ----------
    theta : array_like of shape (N,)
        The measurements, as given to `tertia.estimate_bearing`; nan is not drawn.
    estimate : BearingEstimate
        What came of them.
    period : float or None
        As given to `tertia.estimate_bearing`, in the unit of `theta`.
    group_size : int
        As given to `tertia.estimate_bearing`; the estimate does not remember it.
    legend : bool
        Whether to draw one.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default on a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        Bearings over the number of the measurement, from 0; in the unit of `theta`. The groups are
        darker the more weight they have.

    Raises
    ------
    ValueError
        `theta` is not one sample, or not what `estimate` was made of, or `group_size` is not.
    TypeError
        An argument of the wrong type.
    ImportError
        Matplotlib is missing.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> import tertia
    >>> from tertia import plot
    >>> record = tertia.simulate.direction_finder(100, bearing=359.0, rng=7)
    >>> estimate = tertia.estimate_bearing(record.theta)
    >>> plot.bearing(record.theta, estimate, ax=Figure().subplots()).get_title()
    '358.48 ± 0.31'
    """
    period = None if period is None else real(period, "period")
    angles = _sample(theta, "theta", estimate.outlier, "estimate")
    value, sigma = real(estimate.value, "estimate.value"), real(estimate.sigma, "estimate.sigma")
    extents = _extents(angles, estimate, integer(group_size, "group_size", 2))
    ax = _new_axes() if ax is None else ax

    _draw_band(ax, value, 2 * sigma, "± 2 sigma")
    _draw_measurements(ax, _near(angles, value, period), estimate.outlier)
    if estimate.group_means is not None and estimate.group_weights is not None:
        means = _near(estimate.group_means, value, period)
        _draw_groups(ax, means, estimate.group_weights, extents)
    ax.axhline(value, color=_RESULT, linewidth=1.5, label="bearing")
    ax.set(title=" ± ".join(rounded(value, sigma)), ylabel=_angle_label(period))
    if period is not None:
        ax.yaxis.set_major_formatter(lambda angle, _: _wrapped_label(angle, period))
    return _finish(ax, legend)


def screening(
    y: npt.ArrayLike, screening: Screening, *, legend: bool = True, ax: "Axes | None" = None
) -> "Axes":
    """Draw a sample, what a screening flagged and replaced, and the band of what passes.

    Parameters
    ----------
    y : array_like of shape (N,)
        The measurements, as given to the screening; nan is not drawn.
    screening : Screening
        What was found in them.
    legend : bool
        Whether to draw one.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default on a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        Measurements over their number, from 0; in the unit of `y`. The band is mean ± threshold; in
        a sequential screening it is the final one, so an earlier measurement outside may have
        passed.

    Raises
    ------
    ValueError
        `y` is not one sample, or not what `screening` was made of.
    TypeError
        `y` does not hold real numbers.
    ImportError
        Matplotlib is missing.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from tertia import plot
    >>> from tertia.screening import leave_one_out
    >>> y = [12.4, 11.8, 40.0, 12.1, 12.9, 11.5, 20.0, 12.2, 12.0, 11.9]
    >>> plot.screening(y, leave_one_out(y), ax=Figure().subplots()).get_title()
    '2 of 10 anomalous'
    """
    values = _sample(y, "y", screening.outlier, "screening")
    mean = real(screening.mean, "screening.mean")
    threshold = real(screening.threshold, "screening.threshold")
    ax = _new_axes() if ax is None else ax

    _draw_band(ax, mean, threshold, "mean ± threshold")
    _draw_measurements(ax, values, screening.outlier)
    replaced = np.flatnonzero(screening.outlier & ~np.isnan(screening.cleaned))
    if replaced.size:
        ax.plot(
            replaced,
            screening.cleaned[replaced],
            "D",
            color=_REPLACED,
            markersize=4,
            label="replacement",
        )
    ax.axhline(mean, color=_RESULT, linewidth=1.5, label="mean")
    found, present = np.count_nonzero(screening.outlier), np.count_nonzero(~np.isnan(values))
    ax.set(title=f"{found} of {present} anomalous", ylabel="value")
    return _finish(ax, legend)


def combination(
    estimates: npt.ArrayLike,
    covariances: npt.ArrayLike,
    result: Combination,
    *,
    components: Sequence[int] = (0, 1),
    probability: float = 0.95,
    equal: bool = True,
    legend: bool = True,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw estimates of a vector and what they were fused into, with their error ellipses.

    Of more than two components the ellipses are those of the two drawn, whatever the others are.

    Parameters
    ----------
    estimates : array_like of shape (K, m)
        The estimates, as given to `tertia.weights.combine`; of one that a scalar was added to by
        `tertia.weights.combine_scalar`, a single row.
    covariances : array_like of shape (K, m, m)
        Their covariances.
    result : Combination
        What came of them.
    components : (int, int)
        The components along the two axes, from 0.
    probability : float
        With which normal errors put the true vector inside an ellipse.
    equal : bool
        Whether a unit is of the same length on both axes.
    legend : bool
        Whether to draw one.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default on a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        One component over the other. Up to six estimates differ in colour, marker and line; more
        are drawn alike.

    Raises
    ------
    ValueError
        A batch, `estimates` or `covariances` that are not what `result` was made of, components
        that are the same or not there, or a probability that is not between 0 and 1.
    TypeError
        An argument of the wrong type.
    ImportError
        Matplotlib is missing.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from tertia import plot, weights
    >>> x = [[10, 20], [13, 21]]
    >>> S = [[[4, 1], [1, 2]], [[1, -0.5], [-0.5, 3]]]
    >>> plot.combination(x, S, weights.combine(x, S), ax=Figure().subplots()).get_title()
    '12.48 ± 0.85, 20.9 ± 1.0; p-value 0.39'
    """
    if result.value.ndim != 1:
        raise ValueError(
            f"result has a batch of shape {result.value.shape[:-1]}; one combination can be drawn"
        )
    centres, shapes = _estimates(estimates, covariances, result.value.size)
    pair = _pair(components, result.value.size)
    radius = math.sqrt(-2 * math.log1p(-_share(probability)))
    ellipses = [
        _ellipse(centre[pair], covariance[np.ix_(pair, pair)], radius, name)
        for centre, covariance, name in [
            *((x, shapes[k], f"covariances[{k}]") for k, x in enumerate(centres)),
            (result.value, result.covariance, "result.covariance"),
        ]
    ]
    equal, p_value = flag(equal, "equal"), real(result.p_value, "result.p_value")
    ax = _new_axes() if ax is None else ax

    _draw_ellipses(ax, ellipses)
    texts = (" ± ".join(rounded(result.value[i], result.sigma[i])) for i in pair)
    ax.set(
        title=f"{', '.join(texts)}; p-value {p_value:.2g}",
        xlabel=f"component {pair[0]}",
        ylabel=f"component {pair[1]}",
    )
    if equal:
        ax.set_aspect("equal", adjustable="datalim")
    if legend:
        ax.legend(title=f"{100 * probability:.10g} % ellipses", fontsize="small")
    return ax


def rounded(value: float, sigma: float) -> tuple[str, str]:
    """Return both as text, to two significant digits of sigma."""
    if sigma < 1e-9:
        return f"{value:.9g}", f"{sigma:.2g}"
    # rounded first: 0.0996 is 0.10, not 0.100
    decimals = max(0, 1 - math.floor(math.log10(float(f"{sigma:.1e}"))))
    return f"{value:.{decimals}f}", f"{sigma:.{decimals}f}"


def _sample(value: npt.ArrayLike, name: str, outlier: BoolArray, result: str) -> FloatArray:
    array = samples(value, name)
    if array.ndim != 1:
        raise ValueError(f"{name} has shape {array.shape}; one sample of shape (N,) can be drawn")
    if array.shape != outlier.shape:
        raise ValueError(
            f"{name} has shape {array.shape}, but {result} was made of shape {outlier.shape}"
        )
    return array


def _estimates(
    estimates: npt.ArrayLike, covariances: npt.ArrayLike, m: int
) -> tuple[FloatArray, FloatArray]:
    x, s = finite(estimates, "estimates"), finite(covariances, "covariances")
    if x.ndim != 2 or x.shape[1] != m or not len(x):
        raise ValueError(
            f"estimates has shape {x.shape}, but result has {m} components; (K, {m}) can be drawn"
        )
    if s.shape != (len(x), m, m):
        raise ValueError(
            f"covariances has shape {s.shape}; for estimates of shape {x.shape} it must be "
            f"{(len(x), m, m)}"
        )
    return x, s


def _pair(components: Sequence[int], m: int) -> list[int]:
    try:
        first, second = components
    except (TypeError, ValueError):
        raise ValueError(f"components is {components!r}; it must be two numbers") from None
    pair = [integer(i, f"components[{at}]", 0) for at, i in enumerate((first, second))]
    for at, i in enumerate(pair):
        if i >= m:
            raise ValueError(f"components[{at}] is {i}; result has {m} components, numbered from 0")
    if pair[0] == pair[1]:
        raise ValueError(f"components are both {pair[0]}; they must be distinct")
    return pair


def _share(probability: float) -> float:
    share = real(probability, "probability")
    if not 0 < share < 1:
        raise ValueError(f"probability is {share}; it must be between 0 and 1")
    return share


def _ellipse(centre: FloatArray, covariance: FloatArray, radius: float, name: str) -> FloatArray:
    """Return the centre, a gap and the ellipse, shape (n, 2)."""
    variances = np.diagonal(covariance)
    if not np.all(variances > 0):
        raise ValueError(f"{name} has a variance that is not positive in the components drawn")
    sigma = np.sqrt(variances)
    correlation = covariance[0, 1] / sigma[0] / sigma[1]
    if abs(correlation) > 1 + _ROUNDING:
        raise ValueError(f"{name} is indefinite in the components drawn")
    # not by eigenvectors: the components may be of very different size
    other = math.sqrt(max(0.0, 1 - correlation**2))
    angle = np.linspace(0, 2 * np.pi, _ELLIPSE_POINTS)
    first, second = np.cos(angle), np.sin(angle)
    unit = np.column_stack([first, correlation * first + other * second])
    return np.vstack([centre, np.full(2, np.nan), centre + radius * sigma * unit])


def _near(angles: FloatArray, origin: float, period: float | None) -> FloatArray:
    """Turn angles by whole periods to within half a period of the origin."""
    if period is None:
        return angles
    return angles - period * np.round((angles - origin) / period)


def _extents(theta: FloatArray, estimate: BearingEstimate, group_size: int) -> FloatArray:
    """First and last measurement of each group, shape (groups, 2): groups of what is there."""
    if estimate.group_means is None:
        return np.empty((0, 2))
    present = np.flatnonzero(~np.isnan(theta))
    # with gaps there are fewer groups than the estimate has room for
    room, count = (max(1, size // group_size) for size in (theta.size, present.size))
    if room != estimate.group_means.size:
        raise ValueError(
            f"group_size is {group_size}, which makes {room} groups of {theta.size} measurements; "
            f"estimate has {estimate.group_means.size}"
        )
    first = np.arange(count) * group_size
    last = np.append(first[1:], present.size) - 1
    return np.column_stack([present[first], present[last]]).astype(np.float64)


def _draw_band(ax: "Axes", centre: float, half_width: float, label: str) -> None:
    low, high = centre - half_width, centre + half_width
    ax.axhspan(low, high, facecolor=_BAND, edgecolor="none", alpha=0.2, label=label)


def _draw_measurements(ax: "Axes", values: FloatArray, outlier: BoolArray) -> None:
    kept, flagged = np.flatnonzero(~outlier), np.flatnonzero(outlier)
    ax.plot(kept, values[kept], ".", color=_KEPT, markersize=5, label="measurement")
    if flagged.size:
        ax.plot(flagged, values[flagged], "x", color=_FLAGGED, markersize=6, label="anomalous")


def _draw_groups(ax: "Axes", means: FloatArray, weights: FloatArray, extents: FloatArray) -> None:
    # no mean where all of a group is anomalous, no extent where gaps leave fewer groups
    means, weights = means[: len(extents)], weights[: len(extents)]
    drawn = ~np.isnan(means)
    first, last = extents[drawn].T
    opacity = _FAINTEST + (1 - _FAINTEST) * weights[drawn] / weights.max()
    colours = [(0.3, 0.3, 0.3, alpha) for alpha in opacity]
    ax.hlines(
        means[drawn],
        first - 0.5,
        last + 0.5,
        colors=colours,
        linewidth=3,
        zorder=3,
        label="group mean",
    )


def _draw_ellipses(ax: "Axes", ellipses: list[FloatArray]) -> None:
    """Draw the estimates and, last, what they were fused into."""
    *estimates, fused = ellipses
    alike = len(estimates) > len(_ESTIMATES)
    for k, points in enumerate(estimates):
        colour, marker, line = _ESTIMATES[0 if alike else k]
        # an underscore hides it from the legend
        alike_label = "_estimate" if k else "estimate"
        ax.plot(
            *points.T,
            color=colour,
            marker=marker,
            linestyle=line,
            linewidth=1.5,
            markersize=6,
            markevery=[0],
            label=alike_label if alike else f"estimate {k}",
        )
    ax.plot(
        *fused.T,
        color=_RESULT,
        marker="*",
        markersize=10,
        linewidth=2.5,
        solid_capstyle="round",  # closed without a notch
        markevery=[0],
        label="fused",
    )


def _angle_label(period: float | None) -> str:
    units = {360.0: " (°)", 2 * math.pi: " (rad)"}
    return "bearing" + units.get(period or 0.0, "")


def _wrapped_label(angle: float, period: float) -> str:
    # rounded first: -1e-16 is 0, not 360
    return f"{round(angle, 9) % period:.10g}"


def _finish(ax: "Axes", legend: bool) -> "Axes":
    ax.set_xlabel("measurement")
    if legend:
        low, high = ax.get_ylim()
        ax.set_ylim(low, high + _HEADROOM * (high - low))
        ax.legend(loc="upper center", ncols=3, fontsize="small")
    return ax


def _new_axes() -> "Axes":
    try:
        from matplotlib import pyplot as plt  # noqa: PLC0415  # only here is Matplotlib needed
    except ImportError as error:
        raise ImportError("tertia.plot needs Matplotlib: pip install 'tertia[plot]'") from error
    return plt.subplots(figsize=(8, 4.5), layout="constrained")[1]
