"""Pictures of audits."""

from typing import TYPE_CHECKING

from tertia._arrays import instance
from tertia.metrics import Audit
from tertia.plot._axes import RESULT, new_axes, sensor_looks

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def audit(result: Audit, *, ax: "Axes | None" = None, legend: bool = True) -> "Axes":
    """Draw the proportion of true values inside regions against the probability of the regions.

    Parameters
    ----------
    result : tertia.metrics.Audit
        The audit, as returned by `tertia.audit`.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default the axes of a new figure.
    legend : bool
        Whether to draw a legend.

    Returns
    -------
    matplotlib.axes.Axes
        The axes. They show the proportions with their intervals, the proportions for each stratum,
        and the line on which the proportions lie if the covariances are correct.

    Raises
    ------
    TypeError
        If an argument has the wrong type.

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from tertia import audit, plot
    >>> found = audit(np.random.default_rng(1).normal(0.0, 2.0, (300, 2)), 1.0)
    >>> plot.audit(found, ax=Figure().subplots()).get_title()
    'sigmas too small by a factor of 2.0 (1.8 to 2.2)'
    """
    instance(result, "result", Audit)
    ax = new_axes() if ax is None else ax
    ax.plot([0, 1], [0, 1], color=RESULT, linewidth=1, linestyle=":", label="honest")
    for k, (name, part) in enumerate(result.strata.items()):
        shares = [one.value for one in part.coverage.values()]
        ax.plot(list(part.coverage), shares, linestyle="", label=name, **sensor_looks(k)[1])
    levels, figures = list(result.coverage), list(result.coverage.values())
    shares = [one.value for one in figures]
    below = [one.value - one.low for one in figures]
    above = [one.high - one.value for one in figures]
    ax.errorbar(levels, shares, [below, above], fmt="o", color=RESULT, capsize=3, label="all")
    ax.set(
        title=f"sigmas {result.verdict}",
        xlabel="probability of the region",
        ylabel="share of truths inside",
        xlim=(0.0, 1.02),
        ylim=(0.0, 1.02),
    )
    if legend:
        ax.legend(fontsize="small")
    return ax
