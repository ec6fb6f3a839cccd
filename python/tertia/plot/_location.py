"""Pictures of positions: stations, measurements, error ellipses and maps of accuracy."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, finite, flag
from tertia._result import AXES
from tertia.location import Accuracy, Location
from tertia.location._readers import checked
from tertia.plot._axes import (
    FLAGGED,
    KEPT,
    RESULT,
    add_names,
    draw_sites,
    ellipse_radius,
    names_of,
    new_axes,
    view_from_above,
    with_sigmas,
)
from tertia.sensors import Station
from tertia.sensors._sensors import stack_stations

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_CIRCLE_POINTS = 361
_LEVELS = 12


def location(
    stations: Sequence[Station] | npt.ArrayLike,
    result: Location,
    *,
    azimuth: npt.ArrayLike | None = None,
    range: npt.ArrayLike | None = None,  # noqa: A002  # as in `locate`
    probability: float = 0.95,
    legend: bool = True,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw stations, measurements, and a position with its error ellipse, as seen from above.

    Parameters
    ----------
    stations : sequence of K Station, or array_like of shape (K, D)
        The stations, as given to `tertia.location.locate`.
    result : Location
        The position at one instant.
    azimuth : array_like of shape (K,), optional
        The azimuths in radians; they are drawn as rays.
    range : array_like of shape (K,), optional
        The ranges in metres; they are drawn as arcs about the stations. If D = 3, they are
        converted to horizontal ranges at the height of the target.
    probability : float
        Probability that the ellipse contains the true position if the errors are normally
        distributed.
    legend : bool
        Whether to draw a legend.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default the axes of a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes. They show north against east in metres. Outliers are drawn as dashed lines in
        another colour.

    Raises
    ------
    ValueError
        If `result` is a batch, shapes do not fit, or the probability is not between 0 and 1.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> from tertia import plot
    >>> from tertia.location import locate
    >>> places, bearings = [[0, 0], [1000, 0], [500, -500]], [0.79, 5.5, 0.01]
    >>> fix = locate(places, azimuth=bearings, azimuth_sigma=0.01)
    >>> plot.location(places, fix, azimuth=bearings, ax=Figure().subplots()).get_title()
    'east 505.6 ± 5.8 m, north 498.8 ± 7.1 m'
    """
    places, axes, _ = stack_stations(stations)
    if places.ndim != 2 or result.position.ndim != 1:
        raise ValueError("stations and result have a batch; only one instant can be drawn")
    if places.shape[-1] != result.position.size:
        raise ValueError(
            f"stations has shape {places.shape} and result {result.position.size} coordinates"
        )
    ellipse_radius(probability)
    rays = None if azimuth is None else _row(azimuth, "azimuth", len(places))
    ranges = None if range is None else _row(range, "range", len(places))
    covariance = result.covariance[:2, :2]
    known = bool(np.all(np.isfinite(covariance)))
    legend = flag(legend, "legend")
    ax = new_axes() if ax is None else ax

    if rays is not None:
        toward = _toward(rays, axes)
        _draw_rays(ax, places, toward, _marks(result.outlier.azimuth, rays), result.position)
    if ranges is not None:
        _draw_ranges(ax, places, ranges, _marks(result.outlier.range, ranges), result.position)
    draw_sites(ax, places[:, np.newaxis, :2], "station")
    add_names(ax, names_of(stations, len(places)), places)
    label = f"position, {100 * probability:.10g} %" if known else "position"
    ax.plot(*result.position[:2], color=RESULT, marker="*", markersize=10, label=label)
    for ring in result.region(probability).polygon if known else ():
        ax.plot(*np.concatenate([ring, ring[:1]]).T, color=RESULT)
    each = zip(AXES, result.position, result.sigma, strict=False)
    # heights that azimuths alone do not determine are nan
    parts = [f"{name} {with_sigmas([x], [s])} m" for name, x, s in each if not np.isnan(x)]
    ax.set_title(", ".join(parts))
    view_from_above(ax)
    if legend:
        ax.legend(fontsize="small")
    return ax


def accuracy_map(
    stations: Sequence[Station] | npt.ArrayLike,
    grid: npt.ArrayLike,
    result: Accuracy,
    *,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw the accuracy of positions over an area.

    Parameters
    ----------
    stations : sequence of K Station, or array_like of shape (K, D)
        The stations, as given to `tertia.location.accuracy_map`.
    grid : array_like of shape (rows, columns, D)
        The positions; the rows of the grid follow each other to the north, and its columns to the
        east.
    result : Accuracy
        The accuracy at these positions.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default the axes of a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes. They show the square root of the sum of the variances of a position, in metres, on
        a logarithmic scale.

    Raises
    ------
    ValueError
        If shapes do not fit, the grid has fewer than two rows or columns, or the stations determine
        no position of it.

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from tertia import location, plot
    >>> radars = [[0, 0], [3000, 0]]
    >>> grid = np.stack(np.meshgrid(np.linspace(0, 3e3, 9), np.linspace(100, 3e3, 9)), axis=-1)
    >>> accuracy = location.accuracy_map(radars, grid, range_sigma=10)
    >>> plot.accuracy_map(radars, grid, accuracy, ax=Figure().subplots()).get_xlabel()
    'east (m)'
    """
    places, _, _ = stack_stations(stations)
    points, sigma = finite(grid, "grid"), np.asarray(result.drms)
    if points.ndim != 3 or points.shape[:2] != sigma.shape:
        raise ValueError(
            f"grid has shape {points.shape} and result {sigma.shape}; they must be "
            "(rows, columns, D) and (rows, columns)"
        )
    if min(sigma.shape) < 2:
        raise ValueError(
            f"grid has {sigma.shape[0]} x {sigma.shape[1]} positions; a map needs at least 2 x 2"
        )
    known = sigma[np.isfinite(sigma)]
    if known.size == 0:
        raise ValueError("result has no position that the stations can determine")
    ax = new_axes() if ax is None else ax
    low, high = np.log10(np.quantile(known, [0.0, 0.98]))
    levels = 10 ** np.linspace(low, max(high, low + 1e-3), _LEVELS)
    shown = np.ma.masked_invalid(sigma)
    filled = ax.contourf(*np.moveaxis(points[..., :2], -1, 0), shown, levels, extend="max")
    bar = ax.get_figure(root=True).colorbar(filled, ax=ax, label="position error (m)")  # type: ignore[union-attr]
    bar.set_ticks(list(levels[::2]), labels=[f"{level:.3g}" for level in levels[::2]])
    ax.plot(*places[:, :2].T, "^", color="white", markeredgecolor=RESULT)
    add_names(ax, names_of(stations, len(places)), places)
    view_from_above(ax, adjustable="box")
    return ax


def _row(values: npt.ArrayLike, name: str, k: int) -> FloatArray:
    row = checked(values, name, k)
    if row.ndim != 1:
        raise ValueError(f"{name} has shape {row.shape}; only one instant can be drawn")
    return row


def _marks(outliers: BoolArray | None, values: FloatArray) -> BoolArray:
    return np.zeros(values.shape, dtype=bool) if outliers is None else outliers


def _draw_lines(ax: "Axes", lines: list[FloatArray], outlier: BoolArray, name: str) -> None:
    """Draw the lines that exist; the legend has one entry for outliers and one for the others."""
    named = set()
    for line, wrong in zip(lines, outlier, strict=True):
        if np.isnan(line).all():
            continue
        label = f"{name}, outlier" if wrong else name
        ax.plot(
            *line.T,
            color=FLAGGED if wrong else KEPT,
            linestyle="--" if wrong else "-",
            linewidth=1,
            # an underscore hides it from the legend
            label=f"_{label}" if label in named else label,
        )
        named.add(label)


def _toward(azimuth: FloatArray, axes: FloatArray | None) -> FloatArray:
    """Return the direction of each azimuth in the horizontal plane of its station, (K, 2)."""
    level = np.stack([np.sin(azimuth), np.cos(azimuth)], axis=-1)
    if axes is None:
        return level
    toward: FloatArray = np.einsum("ki,kij->kj", level, axes[:, :2, :2])
    return toward


def _draw_rays(
    ax: "Axes", places: FloatArray, toward: FloatArray, outlier: BoolArray, position: FloatArray
) -> None:
    length = 1.2 * np.max(np.linalg.norm(position[:2] - places[:, :2], axis=-1))
    lines = [
        np.stack([place + 0 * way, place + length * way])
        for place, way in zip(places[:, :2], toward, strict=True)
    ]
    _draw_lines(ax, lines, outlier, "bearing")


def _draw_ranges(
    ax: "Axes", places: FloatArray, ranges: FloatArray, outlier: BoolArray, position: FloatArray
) -> None:
    angle = np.linspace(0, 2 * np.pi, _CIRCLE_POINTS)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    height = position[2:] - places[:, 2:]
    ground = np.sqrt(np.maximum(ranges**2 - np.sum(height**2, axis=-1), 0.0))
    lines = [place + r * circle for place, r in zip(places[:, :2], ground, strict=True)]
    _draw_lines(ax, lines, outlier, "range")
