"""Pictures along a series: what was fused of several sensors, and whether errors are as claimed."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, real, samples
from tertia.fusion import FusedSeries
from tertia.fusion._series import _variances
from tertia.metrics import consistency_bounds
from tertia.plot._axes import (
    BAND,
    FLAGGED,
    KEPT,
    RESULT,
    add_legend,
    angle_unit,
    near,
    new_axes,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

Times: TypeAlias = npt.NDArray[Any]

# vermilion is for outliers, green for the band
_COLOURS = ("#0072B2", "#E69F00", "#CC79A7", "#56B4E9")
_MARKERS = ("o", "s", "D", "^", "v", "P", "*")
_LINES = ("-", "-.", ":")
# of what is drawn within the edges of a panel
_MARGIN = 1.15
# largest over smallest from which a scale is logarithmic
_WIDE = 5.0
# markers along a line
_MARKS = 12


def fusion(
    z: npt.ArrayLike,
    result: FusedSeries,
    *,
    measurement_variance: npt.ArrayLike | None = None,
    times: npt.ArrayLike | None = None,
    period: float | None = None,
    sensors: Sequence[str] | None = None,
    legend: bool = True,
    figure: "FigureBase | None" = None,
) -> tuple["Axes", "Axes", "Axes"]:
    """Draw the plots of several sensors about their fused track, the weights and the noise.

    Parameters
    ----------
    z : array_like of shape (K, steps)
        The plots, as given to `tertia.fusion.fuse_series`; nan is not drawn.
    result : FusedSeries
        What came of them.
    measurement_variance : array_like of shape (), (K, 1) or (K, steps), optional
        As given to `fuse_series`, to draw the standard deviations that were stated.
    times : array_like of shape (steps,), optional
        Times of the steps, numbers or datetime64; by default they are numbered from 0.
    period : float, optional
        As given to `fuse_series`.
    sensors : sequence of str, optional
        Names of the sensors; by default they are numbered from 0.
    legend : bool
        Whether to draw one, below the panels.
    figure : matplotlib.figure.Figure or SubFigure, optional
        Where to draw; by default a new figure.

    Returns
    -------
    plots, weights, noise : matplotlib.axes.Axes
        Three panels over the same time. Plots less the fused angle, with its 2-sigma band; outliers
        are crossed, and those far outside drawn at the edge. Weights in the fused angle. Standard
        deviations of the plots as believed (solid) and as stated (dashed).

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
    >>> from matplotlib.figure import Figure
    >>> from tertia import plot, simulate
    >>> from tertia.fusion import fuse_series
    >>> from tertia.kalman import SingerModel
    >>> model = SingerModel(5.0, 0.05, 0.003)
    >>> z = simulate.radars(model, 120, outlier_probability=0.05, outlier_size=20, rng=1).z
    >>> panels = plot.fusion(z, fuse_series(z, 0.01, model), figure=Figure())
    >>> panels[0].get_title()
    '120 steps of 2 sensors, 3 outliers'
    """
    period = None if period is None else real(period, "period")
    plots = _plots(z, result)
    names = _names(sensors, len(plots))
    instants = _instants(times, plots.shape[1])
    stated = None if measurement_variance is None else _stated(measurement_variance, plots)
    figure = new_figure(8, 8) if figure is None else figure
    top, middle, bottom = figure.subplots(3, sharex=True, height_ratios=(2, 1, 1))

    deviations = near(plots - result.mean[:, 0], 0.0, period)
    _draw_plots(top, instants, deviations, result, names)
    _draw_weights(middle, instants, result.weights[..., 0], ~np.isnan(plots))
    _draw_noise(bottom, instants, np.sqrt(result.noise_variance), stated)
    top.set(
        title=f"{_counted(plots.shape[1], 'step')} of {_counted(len(plots), 'sensor')}, "
        f"{_counted(np.count_nonzero(result.outlier), 'outlier')}",
        ylabel="plot − fused" + angle_unit(period),
    )
    middle.set(ylabel="weight", ylim=(-0.05, 1.05))
    bottom.set(ylabel="sigma of plots" + angle_unit(period))
    bottom.set_xlabel("step" if times is None else "time")
    _shorten_dates(bottom, instants)
    if legend:
        entries = [ax.get_legend_handles_labels() for ax in (top, bottom)]
        handles, labels = (first + second for first, second in zip(*entries, strict=True))
        figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize="small")
    return top, middle, bottom


def consistency(
    normalised: npt.ArrayLike,
    *,
    dimension: int = 1,
    probability: float = 0.99,
    times: npt.ArrayLike | None = None,
    legend: bool = True,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw normalised squared errors along a series with the bounds of what is consistent.

    Parameters
    ----------
    normalised : array_like of shape (..., steps)
        From `tertia.metrics.nees` or `tertia.metrics.nis`; independent runs are averaged. nan where
        there is none.
    dimension : int
        Components of each error: 3 for the state of a track, 1 for innovations.
    probability : float
        That the mean of a step lies within the bounds, where the covariances are right.
    times : array_like of shape (steps,), optional
        Times of the steps, numbers or datetime64; by default they are numbered from 0.
    legend : bool
        Whether to draw one.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default on a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The mean of each step over time, and the bounds for the number of runs that it was taken of.

    Raises
    ------
    ValueError
        No steps, only nan, times that do not fit, or a number outside its domain.
    TypeError
        An argument of the wrong type.
    ImportError
        Matplotlib is missing.

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
    # the quantiles are sought once per number of runs
    numbers, place = np.unique(counts[drawn], return_inverse=True)
    bounds = [consistency_bounds(int(n), dimension, probability) for n in numbers]
    low, high = np.array(bounds)[place].T
    instants = _instants(times, runs.shape[1])[drawn]
    ax = new_axes() if ax is None else ax

    inside = (low <= means) & (means <= high)
    ax.fill_between(
        instants,
        low,
        high,
        facecolor=BAND,
        edgecolor="none",
        alpha=0.2,
        step="mid",
        label=f"{100 * probability:.10g} % of means",
    )
    ax.axhline(dimension, color=RESULT, linewidth=1, label="expected")
    ax.plot(instants[inside], means[inside], ".", color=KEPT, label="within")
    if not inside.all():
        ax.plot(instants[~inside], means[~inside], "x", color=FLAGGED, label="outside")
    ax.set(
        title=f"{np.count_nonzero(inside)} of {means.size} within the bounds of "
        f"{100 * probability:.10g} %; mean {np.nanmean(runs):.3g}",
        xlabel="step" if times is None else "time",
        ylabel="normalised squared error",
    )
    _shorten_dates(ax, instants)
    if legend:
        add_legend(ax)
    return ax


def _plots(z: npt.ArrayLike, result: FusedSeries) -> FloatArray:
    plots = samples(z, "z")
    if plots.ndim != 2:
        raise ValueError(f"z has shape {plots.shape}; one record of shape (K, steps) can be drawn")
    if plots.shape != result.outlier.shape:
        raise ValueError(
            f"z has shape {plots.shape}, but result was made of shape {result.outlier.shape}"
        )
    return plots


def _names(sensors: Sequence[str] | None, count: int) -> list[str]:
    if sensors is None:
        return [f"sensor {k}" for k in range(count)]
    if len(sensors) != count:
        raise ValueError(f"sensors has {len(sensors)} names; z has {count} sensors")
    return [str(name) for name in sensors]


def _instants(times: npt.ArrayLike | None, steps: int) -> Times:
    if times is None:
        return np.arange(steps)
    instants = np.asarray(times)
    if instants.dtype.kind != "M":
        instants = samples(times, "times")
    if instants.shape != (steps,):
        raise ValueError(f"times has shape {instants.shape}; it must be ({steps},)")
    return instants


def _stated(measurement_variance: npt.ArrayLike, plots: FloatArray) -> FloatArray:
    sensors, steps = plots.shape
    return np.sqrt(
        np.broadcast_to(_variances(measurement_variance, (), sensors, steps), plots.shape)
    )


def _draw_plots(
    ax: "Axes", instants: Times, deviations: FloatArray, result: FusedSeries, names: list[str]
) -> None:
    """Draw the deviations from the fused angle; outliers do not set the scale."""
    width = 2 * result.sigma[:, 0]
    known = np.isfinite(width)
    edge = _MARGIN * _largest(np.where(result.outlier, np.nan, deviations), width[known])
    ax.set_ylim(-edge, edge)
    ax.fill_between(
        instants[known],
        -width[known],
        width[known],
        facecolor=BAND,
        edgecolor="none",
        alpha=0.3,
        label="fused ± 2 sigma",
    )
    ax.axhline(0.0, color=RESULT, linewidth=1)
    # an outlier at the edge is not cut in half
    _draw_deviations(ax, instants, deviations, result.outlier, names, inner=0.97 * edge)


def _draw_deviations(
    ax: "Axes",
    instants: Times,
    deviations: FloatArray,
    outlier: BoolArray,
    names: list[str],
    *,
    inner: float,
) -> None:
    """Draw deviations, (K, steps), and flag outliers; those beyond `inner` are drawn there."""
    for k, name in enumerate(names):
        has = np.isfinite(deviations[k])
        shown = np.clip(deviations[k, has], -inner, inner)
        ax.plot(instants[has], shown, linestyle="", label=name, markersize=4, **_look(k)[1])
    flagged = outlier & np.isfinite(deviations)
    far = np.abs(deviations) > inner
    where = np.broadcast_to(instants, deviations.shape)
    for marker, chosen, label in [
        ("x", flagged & ~far, "outlier"),
        ("^", flagged & far & (deviations > 0), "outlier, above"),
        ("v", flagged & far & (deviations < 0), "outlier, below"),
    ]:
        _draw_flagged(ax, where[chosen], np.clip(deviations[chosen], -inner, inner), marker, label)


def _largest(*arrays: FloatArray) -> float:
    return max(float(np.max(np.abs(a[np.isfinite(a)]), initial=0.0)) for a in arrays) or 1.0


def _draw_flagged(ax: "Axes", x: Times, y: FloatArray, marker: str, label: str) -> None:
    if x.size:
        ax.plot(x, y, marker, color=FLAGGED, markersize=8, zorder=3, label=label)


def _draw_weights(ax: "Axes", instants: Times, weights: FloatArray, has_plot: BoolArray) -> None:
    """Draw the weights of all steps, and stronger those of each sensor's own plots.

    Of sensors that take turns the weights go up and down with every step.
    """
    if np.isnan(weights).all():
        ax.text(0.5, 0.5, "no weights", transform=ax.transAxes, ha="center", va="center")
    for k, row in enumerate(weights):
        line, marker = _look(k)
        ax.plot(instants, row, **line, linewidth=0.8, alpha=0.4, label="_weight")
        own = has_plot[k] & ~np.isnan(row)
        ax.plot(instants[own], row[own], **marker, markersize=3, linestyle="", label="_own")


def _draw_noise(
    ax: "Axes", instants: Times, believed: FloatArray, stated: FloatArray | None
) -> None:
    marks = max(1, len(instants) // _MARKS)
    for k, row in enumerate(believed):
        line, marker = _look(k)
        # staggered, so that equal ones can be told apart
        every = (k * marks // len(believed), marks)
        ax.plot(instants, row, **line | marker, markersize=5, markevery=every, label="_believed")
    if stated is not None:
        ax.plot([], [], "--", color="0.4", linewidth=1, label="sigma as stated")
        for k, row in enumerate(stated):
            colour = _look(k)[0]["color"]
            ax.plot(instants, row, "--", color=colour, linewidth=1, label="_stated")
    if believed.max() > _WIDE * believed.min():
        _make_logarithmic(ax)
    else:
        ax.set_ylim(bottom=0.0)


def _make_logarithmic(ax: "Axes") -> None:
    from matplotlib.ticker import LogLocator, NullFormatter  # noqa: PLC0415  # slow to import

    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter(lambda sigma, _: f"{sigma:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())


def _shorten_dates(ax: "Axes", instants: Times) -> None:
    from matplotlib.dates import ConciseDateFormatter  # noqa: PLC0415  # slow to import

    if instants.dtype.kind == "M":
        locator = ax.xaxis.get_major_locator()
        ax.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]


def _look(k: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the looks of the line and of the markers of a sensor."""
    colour = {"color": _COLOURS[k % len(_COLOURS)]}
    line = _LINES[k // len(_COLOURS) % len(_LINES)]
    marker = _MARKERS[k % len(_MARKERS)]
    return colour | {"linestyle": line, "drawstyle": "steps-post"}, colour | {"marker": marker}


def _counted(number: int | np.signedinteger[Any], noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
