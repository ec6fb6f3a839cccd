"""Pictures of one target over time: its path as seen from above, its height, and the residuals."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, flag, instance
from tertia._result import counted
from tertia.location import Location
from tertia.plot._axes import (
    BAND,
    FLAGGED,
    KEPT,
    MARGIN,
    RESULT,
    Times,
    add_names,
    add_shared_legend,
    bounds,
    draw_band,
    draw_deviations,
    draw_sites,
    ellipse_radius,
    ellipses,
    label_time,
    largest,
    names_of,
    new_figure,
    time_axis,
    view_from_above,
)
from tertia.sensors import ByKind, Kind, Station
from tertia.sensors._kinds import KINDS
from tertia.sensors._sensors import stack_stations
from tertia.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

_ELLIPSES = 10
# share of the single positions at either end that may lie outside
_TAIL = 0.01
# standard deviations within which residuals are drawn at least
_LEAST_EDGE = 3.0


def trajectory(
    stations: Sequence[Station] | npt.ArrayLike,
    result: Trajectory | Location,
    *,
    time: npt.ArrayLike | None = None,
    figure: "FigureBase | None" = None,
    legend: bool = True,
    probability: float = 0.95,
) -> "dict[str, Axes]":
    """Draw positions as seen from above, their heights, and the residuals of the stations.

    Parameters
    ----------
    stations : sequence of K Station, or array_like of shape (..., K, D)
        The stations, as given to `tertia.trajectory.reconstruct` or `tertia.location.locate`.
    result : Trajectory or Location
        The positions; a result of `locate` must be a batch of shape (N,).
    time : array_like of shape (N,), optional
        Times of the rows, as numbers or datetime64; by default they are the times of a
        `Trajectory`, or numbers from 0 for a `Location`.
    probability : float
        Probability that an ellipse contains the true position if the errors are normally
        distributed. About ten ellipses are drawn.
    legend : bool
        Whether to draw a common legend for all panels.
    figure : matplotlib.figure.Figure or SubFigure, optional
        Figure to draw on; by default a new one.

    Returns
    -------
    dict of str to matplotlib.axes.Axes
        The panel "plan" shows north against east in metres, with crosses on positions that have an
        outlier. If D = 3, the panel "height" shows the height with its 2-sigma band, unless all
        positions are without a height. The panel of each kind of measurement, such as "range",
        shows the residuals in standard deviations; outliers are marked by crosses, and outliers
        outside the panel are drawn at its edge.

    Raises
    ------
    ValueError
        If `result` is not a batch of shape (N,), an argument does not fit it, or the probability is
        not between 0 and 1.

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from tertia import plot, simulate
    >>> from tertia.sensors import Station
    >>> from tertia.trajectory import reconstruct
    >>> places = [[0, 0], [2000, 300], [400, 2600]]
    >>> radars = [Station(place, range_sigma=10.0, azimuth_sigma=0.005) for place in places]
    >>> t = np.arange(40.0)
    >>> record = simulate.stations(radars, np.column_stack([20 * t, 1500 + 5 * t]), rng=1)
    >>> track = reconstruct(radars, t, **record.measurements)
    >>> panels = plot.trajectory(radars, track, figure=Figure())
    >>> list(panels)
    ['plan', 'range', 'azimuth']
    >>> panels["plan"].get_title()
    '40 of 40 instants located, 0 outliers'
    """
    instance(result, "result", Trajectory, Location)
    if result.position.ndim != 2:
        raise ValueError(
            f"result has positions of shape {result.position.shape}; (N, D) can be drawn"
        )
    n, d = result.position.shape
    places, _, _ = stack_stations(stations)
    if places.shape[-1] != d or places.ndim > 3 or (places.ndim == 3 and len(places) != n):
        raise ValueError(f"stations has shape {places.shape} and result {result.position.shape}")
    given = result.time if time is None and isinstance(result, Trajectory) else time
    times = time_axis(given, n)
    radius = ellipse_radius(probability)
    legend = flag(legend, "legend")
    residuals = _by_station(result.residual, result.outlier, places.shape[-2])
    up = result.position[np.isfinite(result.position[:, :2]).all(axis=1), 2:]
    has_heights = d == 3 and not (up.size and np.isnan(up).all())
    rows = [*(["height"] if has_heights else []), *residuals]
    figure = new_figure(11, max(5.0, 2 + 1.5 * len(rows))) if figure is None else figure
    panels = figure.subplot_mosaic([["plan", name] for name in rows], width_ratios=(5, 4))

    plan = panels["plan"]
    _draw_plan(plan, places, result, radius, f"{100 * probability:.10g} % ellipse")
    add_names(
        plan, names_of(stations, places.shape[-2]), places if places.ndim == 2 else places[-1]
    )
    fixes = result.fixes if isinstance(result, Trajectory) else result
    outliers = sum(int(np.sum(mark)) for _, mark in residuals.values())
    plan.set_title(
        f"{np.count_nonzero(fixes.success)} of {counted(n, 'instant')} located, "
        f"{counted(outliers, 'outlier')}"
    )
    view_from_above(plan)
    if has_heights:
        _draw_height(panels["height"], times, result)
    for kind, (values, outlier) in residuals.items():
        _draw_residuals(panels[kind], times, values, outlier, _called(stations, len(values)))
        panels[kind].set_ylabel(f"{kind.replace('_', ' ')} / sigma")
    _join_times([panels[name] for name in rows], times, "instant" if given is None else "time")
    if legend:
        add_shared_legend(figure, panels.values(), 6)
    return panels


def _by_station(
    residual: ByKind, outlier: ByKind, k: int
) -> dict[Kind, tuple[FloatArray, BoolArray]]:
    """Return residuals and outlier marks, (K, N), for each kind that was measured."""
    found: dict[Kind, tuple[FloatArray, BoolArray]] = {}
    for kind in KINDS:
        values, marks = getattr(residual, kind), getattr(outlier, kind)
        if values is None:
            continue
        # the first station has no range difference
        first = int(kind == "range_difference")
        if values.shape[1] != k - first:
            made = values.shape[1] + first
            raise ValueError(f"stations has {k} stations, but result was made of {made}")
        pad = [(first, 0), (0, 0)]
        found[kind] = (
            np.pad(values.T, pad, constant_values=np.nan),
            np.pad(marks.T, pad, constant_values=False),
        )
    return found


def _called(stations: Sequence[Station] | npt.ArrayLike, k: int) -> list[str]:
    """Return the names of the stations, or the number of each station that has no name."""
    names = names_of(stations, k)
    return [f"station {at}" if name is None else str(name) for at, name in enumerate(names)]


def _draw_plan(
    ax: "Axes", places: FloatArray, result: Trajectory | Location, radius: float, label: str
) -> None:
    # the paths of stations that move
    draw_sites(ax, [places[..., k, :2].reshape(-1, 2) for k in range(places.shape[-2])], "station")
    position = result.position[:, :2]
    whole = np.isfinite(result.covariance[:, :2, :2]).all(axis=(1, 2))
    there = np.flatnonzero(whole & np.isfinite(position).all(axis=1))
    some = np.linspace(0, there.size - 1, min(there.size, _ELLIPSES)).round().astype(int)
    drawn = ellipses(position, result.covariance, radius, there[some], "result.covariance")
    ax.plot(*drawn.T, color=BAND, linewidth=1.5, zorder=2.5, label=label)
    if isinstance(result, Trajectory):
        ax.plot(*position.T, color=RESULT, linewidth=1, label="trajectory")
        fixes = result.fixes.position[:, :2]
    else:
        fixes = position
    # single instants far off do not set the scale
    ax.update_datalim(_most(fixes))
    limits = ax.dataLim.frozen()
    ax.plot(*fixes.T, ".", color=KEPT, markersize=4, zorder=1, label="single instant")
    ax.dataLim.set(limits)
    wrong = position[np.asarray(result.outlier.count) > 0]
    if len(wrong):
        ax.plot(*wrong.T, "x", color=FLAGGED, markersize=6, zorder=3, label="with an outlier")
    # room for the names of the stations
    ax.margins(0.12)


def _most(points: FloatArray) -> FloatArray:
    """Return bounds that contain almost all points; their shape is (2, ...)."""
    known = points[np.isfinite(points).all(axis=tuple(range(1, points.ndim)))]
    bounds: FloatArray = np.quantile(known, [_TAIL, 1 - _TAIL], axis=0) if len(known) else known
    return bounds


def _draw_height(ax: "Axes", times: Times, result: Trajectory | Location) -> None:
    height = result.position[:, 2]
    low, high = bounds(height, 2 * np.sqrt(result.covariance[:, 2, 2]))
    draw_band(ax, times, low, high, "± 2 sigma")
    fixes = height
    if isinstance(result, Trajectory):
        ax.plot(times, height, color=RESULT, linewidth=1)
        fixes = result.fixes.position[:, 2]
    ax.plot(times, fixes, ".", color=KEPT, markersize=4, zorder=1)
    known = np.isfinite(low)
    seen = np.concatenate([low[known], high[known], _most(fixes)])
    if seen.size:
        middle, reach = (seen.max() + seen.min()) / 2, MARGIN * np.ptp(seen) / 2
        ax.set_ylim(middle - reach, middle + reach)
    ax.set_ylabel("up (m)")


def _draw_residuals(
    ax: "Axes", times: Times, values: FloatArray, outlier: BoolArray, names: list[str]
) -> None:
    inner = max(largest(np.where(outlier, np.nan, values)), _LEAST_EDGE)
    ax.set_ylim(-MARGIN * inner, MARGIN * inner)
    ax.axhline(0.0, color=RESULT, linewidth=1)
    draw_deviations(ax, times, values, outlier, names, inner=inner)


def _join_times(panels: "list[Axes]", times: Times, label: str) -> None:
    """Give panels that are above one another the same time axis."""
    *above, last = panels
    for ax in above:
        ax.sharex(last)
        ax.tick_params(labelbottom=False)
    label_time(last, times, label)
