"""Pictures of fused series: plots relative to the track, weights and noise."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, real, samples
from tertia._result import counted
from tertia.fusion import FusedSeries
from tertia.fusion._series import _variances
from tertia.plot._axes import (
    MARGIN,
    RESULT,
    Times,
    add_shared_legend,
    angle_unit,
    draw_band,
    draw_deviations,
    label_time,
    largest,
    near,
    new_figure,
    sensor_looks,
    time_axis,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

# largest over smallest from which a scale is logarithmic
_WIDE = 5.0
# markers along a line
_MARKS = 12


def fused_series(
    z: npt.ArrayLike,
    result: FusedSeries,
    *,
    measurement_variance: npt.ArrayLike | None = None,
    time: npt.ArrayLike | None = None,
    period: float | None = None,
    sensors: Sequence[str] | None = None,
    legend: bool = True,
    figure: "FigureBase | None" = None,
) -> tuple["Axes", "Axes", "Axes"]:
    """Draw the plots of several sensors relative to the fused angle, their weights and their noise.

    Parameters
    ----------
    z : array_like of shape (K, steps)
        The plots, as given to `tertia.fusion.fuse_series`; values that are nan are not drawn.
    result : FusedSeries
        The fused track of these plots.
    measurement_variance : array_like of shape (), (K, 1) or (K, steps), optional
        Variances that were given to `fuse_series`; if given here, the stated standard deviations
        are drawn.
    time : array_like of shape (steps,), optional
        Times of the steps, as numbers or datetime64; by default the steps are numbered from 0.
    period : float, optional
        Period that was given to `fuse_series`.
    sensors : sequence of str, optional
        Names of the sensors; by default they are numbered from 0.
    legend : bool
        Whether to draw a legend, below the panels.
    figure : matplotlib.figure.Figure or SubFigure, optional
        Figure to draw on; by default a new figure.

    Returns
    -------
    plots, weights, noise : matplotlib.axes.Axes
        Three panels with a common time axis. The first shows plots minus the fused angle, with the
        2-sigma band of the fused angle; outliers are marked by crosses, and outliers outside the
        panel are drawn at its edge. The second shows the weights of the sensors in the fused angle.
        The third shows the estimated (solid) and stated (dashed) standard deviations of the plots.

    Raises
    ------
    ValueError
        If `result` is a batch, or does not fit the other arguments.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from tertia import plot, simulate
    >>> from tertia.fusion import fuse_series
    >>> from tertia.kalman import SingerModel
    >>> model = SingerModel(5.0, 0.05, 0.003)
    >>> z = simulate.radars(model, 120, outlier_probability=0.05, outlier_size=20, rng=1).z
    >>> panels = plot.fused_series(z, fuse_series(z, 0.01, model), figure=Figure())
    >>> panels[0].get_title()
    '120 steps of 2 sensors, 3 outliers'
    """
    period = None if period is None else real(period, "period")
    plots = _plots(z, result)
    names = _names(sensors, len(plots))
    times = time_axis(time, plots.shape[1])
    stated = None if measurement_variance is None else _stated(measurement_variance, plots)
    figure = new_figure(8, 8) if figure is None else figure
    top, middle, bottom = figure.subplots(3, sharex=True, height_ratios=(2, 1, 1))

    deviations = near(plots - result.mean[:, 0], 0.0, period)
    _draw_plots(top, times, deviations, result, names)
    _draw_weights(middle, times, result.weights[..., 0], ~np.isnan(plots))
    _draw_noise(bottom, times, np.sqrt(result.noise_variance), stated)
    top.set(
        title=f"{counted(plots.shape[1], 'step')} of {counted(len(plots), 'sensor')}, "
        f"{counted(np.count_nonzero(result.outlier), 'outlier')}",
        ylabel="plot − fused" + angle_unit(period),
    )
    middle.set(ylabel="weight", ylim=(-0.05, 1.05))
    bottom.set(ylabel="sigma of plots" + angle_unit(period))
    label_time(bottom, times, "step" if time is None else "time")
    if legend:
        add_shared_legend(figure, (top, bottom), 4)
    return top, middle, bottom


def _plots(z: npt.ArrayLike, result: FusedSeries) -> FloatArray:
    plots = samples(z, "z")
    if plots.ndim != 2:
        raise ValueError(
            f"z has shape {plots.shape}; only one record of shape (K, steps) can be drawn"
        )
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


def _stated(measurement_variance: npt.ArrayLike, plots: FloatArray) -> FloatArray:
    sensors, steps = plots.shape
    return np.sqrt(
        np.broadcast_to(_variances(measurement_variance, (), sensors, steps), plots.shape)
    )


def _draw_plots(
    ax: "Axes", times: Times, deviations: FloatArray, result: FusedSeries, names: list[str]
) -> None:
    """Draw the deviations from the fused angle; outliers do not affect the scale of the axis."""
    width = 2 * result.sigma[:, 0]
    known = np.isfinite(width)
    edge = MARGIN * largest(np.where(result.outlier, np.nan, deviations), width[known])
    ax.set_ylim(-edge, edge)
    draw_band(ax, times[known], -width[known], width[known], "fused ± 2 sigma")
    ax.axhline(0.0, color=RESULT, linewidth=1)
    # an outlier at the edge is not cut in half
    draw_deviations(ax, times, deviations, result.outlier, names, inner=0.97 * edge)


def _draw_weights(ax: "Axes", times: Times, weights: FloatArray, has_plot: BoolArray) -> None:
    """Draw the weights at all steps, with bold lines at those steps at which the sensor has a plot.

    If sensors measure alternately, the weights change at every step.
    """
    if np.isnan(weights).all():
        ax.text(0.5, 0.5, "no weights", transform=ax.transAxes, ha="center", va="center")
    for k, row in enumerate(weights):
        line, marker = sensor_looks(k)
        ax.plot(times, row, **line, linewidth=0.8, alpha=0.4, label="_weight")
        own = has_plot[k] & ~np.isnan(row)
        ax.plot(times[own], row[own], **marker, markersize=3, linestyle="", label="_own")


def _draw_noise(ax: "Axes", times: Times, estimated: FloatArray, stated: FloatArray | None) -> None:
    marks = max(1, len(times) // _MARKS)
    for k, row in enumerate(estimated):
        line, marker = sensor_looks(k)
        # staggered, so that equal ones can be distinguished
        every = (k * marks // len(estimated), marks)
        ax.plot(times, row, **line | marker, markersize=5, markevery=every, label="_estimated")
    if stated is not None:
        ax.plot([], [], "--", color="0.4", linewidth=1, label="sigma as stated")
        for k, row in enumerate(stated):
            colour = sensor_looks(k)[0]["color"]
            ax.plot(times, row, "--", color=colour, linewidth=1, label="_stated")
    if estimated.max() > _WIDE * estimated.min():
        _make_logarithmic(ax)
    else:
        ax.set_ylim(bottom=0.0)


def _make_logarithmic(ax: "Axes") -> None:
    from matplotlib.ticker import LogLocator, NullFormatter  # noqa: PLC0415  # slow to import

    ax.set_yscale("log")
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter(lambda sigma, _: f"{sigma:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())
