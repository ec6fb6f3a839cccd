"""Pictures of fused estimates: error ellipses."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, finite, flag, integer, real
from tertia.fusion import FusedEstimate
from tertia.plot._axes import RESULT, ellipse, ellipse_radius, new_axes, with_sigmas

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# one for each estimate; the fused one is black and thick
_ESTIMATES = (
    ("#56B4E9", "o", "-"),
    ("#D55E00", "s", "--"),
    ("#009E73", "^", "-."),
    ("#CC79A7", "D", ":"),
    ("#E69F00", "v", "-"),
    ("#0072B2", "P", "--"),
)


def fused(
    estimates: npt.ArrayLike,
    covariances: npt.ArrayLike,
    result: FusedEstimate,
    *,
    components: Sequence[int] = (0, 1),
    probability: float = 0.95,
    equal: bool = True,
    legend: bool = True,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw estimates of a vector and the fused estimate, with their error ellipses.

    If the vectors have more than two components, the ellipses are drawn for two of them.

    Parameters
    ----------
    estimates : array_like of shape (K, m)
        The estimates, as given to `tertia.fusion.fuse`, or the single row given to
        `tertia.fusion.fuse_scalar`.
    covariances : array_like of shape (K, m, m)
        Covariances of the estimates.
    result : FusedEstimate
        The fused estimate.
    components : (int, int)
        Indices, counted from 0, of the components on the two axes.
    probability : float
        Probability that an ellipse contains the true vector if the errors are normally distributed.
    equal : bool
        Whether both axes have the same scale.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default the axes of a new figure.
    legend : bool
        Whether to draw a legend.

    Returns
    -------
    matplotlib.axes.Axes
        The axes. They show one component against the other. The first six estimates differ in
        colour, marker and line style.

    Raises
    ------
    ValueError
        If `result` is a batch, `estimates` or `covariances` do not fit it, the two components are
        equal or do not exist, or the probability is not between 0 and 1.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from tertia import fusion, plot
    >>> x = [[10, 20], [13, 21]]
    >>> S = [[[4, 1], [1, 2]], [[1, -0.5], [-0.5, 3]]]
    >>> plot.fused(x, S, fusion.fuse(x, S), ax=Figure().subplots()).get_title()
    '12.48 ± 0.85, 20.9 ± 1.0; p-value 0.39'
    """
    if result.mean.ndim != 1:
        raise ValueError(
            f"result has a batch of shape {result.mean.shape[:-1]}; only one estimate can be drawn"
        )
    centres, shapes = _estimates(estimates, covariances, result.mean.size)
    pair = _pair(components, result.mean.size)
    radius = ellipse_radius(probability)
    ellipses = [
        ellipse(centre[pair], covariance[np.ix_(pair, pair)], radius, name)
        for centre, covariance, name in [
            *((x, shapes[k], f"covariances[{k}]") for k, x in enumerate(centres)),
            (result.mean, result.covariance, "result.covariance"),
        ]
    ]
    equal, pvalue = flag(equal, "equal"), real(result.pvalue, "result.pvalue")
    ax = new_axes() if ax is None else ax

    _draw_ellipses(ax, ellipses)
    first, second = pair
    ax.set(
        title=f"{with_sigmas(result.mean[pair], result.sigma[pair])}; p-value {pvalue:.2g}",
        xlabel=f"component {first}",
        ylabel=f"component {second}",
    )
    if equal:
        ax.set_aspect("equal", adjustable="datalim")
    if legend:
        ax.legend(title=f"{100 * probability:.10g} % ellipses", fontsize="small")
    return ax


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


def _draw_ellipses(ax: "Axes", ellipses: list[FloatArray]) -> None:
    """Draw the ellipses of the estimates, and then the ellipse of the fused estimate."""
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
        color=RESULT,
        marker="*",
        markersize=10,
        linewidth=2.5,
        solid_capstyle="round",  # closed without a notch
        markevery=[0],
        label="fused",
    )
