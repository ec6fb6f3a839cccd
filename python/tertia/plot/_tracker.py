"""Pictures of a tracker's tracks: from above, and how often radars see them."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tertia._arrays import BoolArray, FloatArray, IntArray, flag
from tertia.flightplan import FlightPlan
from tertia.plot._axes import BAND, FLAGGED, RESULT, new_axes
from tertia.plot._combination import _ellipse, _share
from tertia.plot._tracks import _counted, _look
from tertia.sensors import Radar
from tertia.tracker import Plots, TrackTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# vermilion is for manoeuvres, green for ellipses, grey for what is no result
_COLOURS = ("#0072B2", "#E69F00", "#CC79A7", "#56B4E9", "#8C564B", "#999933")
_GREY = "0.6"
# more numbers than these cannot be read, nor more ellipses
_MOST_NUMBERS = 60
_ELLIPSES = 3
# intervals of range, and the fewest scans of which a share is drawn
_BINS, _FEWEST = 12, 5


def tracks(
    table: TrackTable,
    radars: Sequence[Radar] = (),
    *,
    plots: Plots | None = None,
    plans: Sequence[FlightPlan] = (),
    probability: float = 0.95,
    legend: bool = True,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw tracks from above, with their numbers, manoeuvres and some error ellipses.

    Parameters
    ----------
    table : TrackTable
        The tracks, from `tertia.tracker.track` or `Tracker.update`.
    radars : sequence of Radar
        The radars.
    plots : Plots, optional
        The plots, drawn as dots; they need the radars.
    plans : sequence of FlightPlan
        Flight plans, dashed.
    probability : float
        With which normal errors put the true position inside an ellipse. Three are drawn per track.
    legend : bool
        Whether to draw one.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default on a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        North over east in kilometres. The 60 longest tracks have their numbers at their ends.

    Raises
    ------
    ValueError
        Plots of radars that are not given, or a probability that is not between 0 and 1.
    TypeError
        An argument of the wrong type.
    ImportError
        Matplotlib is missing.

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from tertia import plot
    >>> from tertia.tracker import Plots, Radar, track
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    >>> time = np.arange(0.0, 100.0, 4.0)
    >>> table = track(Plots(time, 50e3 + 200 * time, 0.5), [radar])
    >>> plot.tracks(table, [radar], ax=Figure().subplots()).get_title()
    '1 track'
    """
    if not isinstance(table, TrackTable):
        raise TypeError(f"table is {table!r}; it must be a TrackTable")
    radius = math.sqrt(-2 * math.log1p(-_share(probability)))
    legend = flag(legend, "legend")
    seen = np.empty((0, 2))
    if plots is not None and len(plots):
        _check_radars(plots.sensor, radars, "plots")
        seen, _ = plots.to_cartesian(radars)
    ax = new_axes() if ax is None else ax

    lines = _lines(table)
    _draw_tracks(ax, table, lines)
    _draw_ellipses(ax, table, lines, radius, f"{100 * probability:.10g} % ellipse")
    _draw_radars(ax, radars)
    # clutter, and plans that go on elsewhere, do not set the scale
    limits = ax.dataLim.frozen()
    _draw_plans(ax, plans)
    if len(seen):
        ax.plot(*_km(seen), ".", color=_GREY, markersize=2, zorder=1, label="plot")
    if lines:
        ax.dataLim.set(limits)
    for name, rows in _longest(lines).items():
        end = _km(table.position[rows[-1]])
        ax.annotate(str(name), tuple(end), xytext=(4, 4), textcoords="offset points", zorder=4)
    ax.set(title=_counted(len(lines), "track"), xlabel="east (km)", ylabel="north (km)")
    ax.margins(0.05)
    ax.set_aspect("equal", adjustable="datalim")
    if legend:
        ax.legend(fontsize="small", loc="best")
    return ax


def update_probability(
    table: TrackTable,
    radars: Sequence[Radar],
    *,
    legend: bool = True,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw how often radars see the confirmed tracks, over their range.

    Parameters
    ----------
    table : TrackTable
        The tracks, from `tertia.tracker.track` or `Tracker.update`.
    radars : sequence of Radar
        The radars.
    legend : bool
        Whether to draw one.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default on a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The share of scans with a plot, in intervals of range with five scans or more, with one
        standard error; dashed, what each radar says of itself.

    Raises
    ------
    ValueError
        A table with a radar that is not given.
    TypeError
        An argument of the wrong type.
    ImportError
        Matplotlib is missing.

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from tertia import plot
    >>> from tertia.tracker import Plots, Radar, track
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    >>> time = np.delete(np.arange(0.0, 100.0, 4.0), [10, 12])
    >>> table = track(Plots(time, 50e3 + 200 * time, 0.5), [radar])
    >>> plot.update_probability(table, [radar], ax=Figure().subplots()).get_title()
    '91.3 % of 23 scans'
    """
    if not isinstance(table, TrackTable):
        raise TypeError(f"table is {table!r}; it must be a TrackTable")
    _check_radars(table.sensor, radars, "table")
    legend = flag(legend, "legend")
    ax = new_axes() if ax is None else ax
    known = table[table.confirmed]
    hit = known.plot >= 0
    edge = 0.0
    for k, radar in enumerate(radars):
        own = known.sensor == k
        distance = np.hypot(*(known.position[own] - radar.position[:2]).T)
        looks = _look(k)[0] | _look(k)[1] | {"drawstyle": "default"}
        middle, share, error = _shares(distance, hit[own])
        name = radar.name or f"radar {k}"
        ax.errorbar(middle / 1e3, share, error, markersize=4, capsize=2, label=name, **looks)
        stated = radar.detection_probability
        ax.axhline(stated, color=looks["color"], linestyle="--", linewidth=0.8, label="_stated")
        edge = max(edge, float(np.max(distance, initial=0.0)) / 1e3)
    seen = f"{100 * np.mean(hit):.1f} % of " if len(hit) else ""
    ax.set(
        title=seen + _counted(len(hit), "scan"),
        xlabel="distance from the radar (km)",
        ylabel="probability of update",
        xlim=(0.0, 1.05 * edge or 1.0),
        ylim=(0.0, 1.05),
    )
    if legend and len(radars):
        ax.legend(fontsize="small", loc="lower left")
    return ax


def _km(position: FloatArray) -> FloatArray:
    """Return east and north in kilometres, the coordinates first."""
    return np.asarray(position.T / 1e3)


def _lines(table: TrackTable) -> dict[int, IntArray]:
    """Return the rows of each track by time."""
    order = np.lexsort((table.time, table.track))
    names, starts = np.unique(table.track[order], return_index=True)
    return dict(zip(names.tolist(), np.split(order, starts[1:]), strict=False))


def _longest(lines: dict[int, IntArray]) -> dict[int, IntArray]:
    """Return the tracks with most rows."""
    chosen = sorted(lines, key=lambda name: -len(lines[name]))[:_MOST_NUMBERS]
    return {name: lines[name] for name in chosen}


def _draw_tracks(ax: "Axes", table: TrackTable, lines: dict[int, IntArray]) -> None:
    """Draw all tracks of one colour as one line, and manoeuvres below them."""
    gap = np.full((1, 2), np.nan)
    turning = []
    for first, colour in enumerate(_COLOURS[: len(lines)]):
        parts = []
        for rows in list(lines.values())[first :: len(_COLOURS)]:
            parts += [table.position[rows], gap]
        label = "_track" if first else "track"
        ax.plot(*_km(np.vstack(parts)), color=colour, linewidth=1, zorder=2.5, label=label)
    for rows in lines.values():
        turns = (table.turn_probability > 0.5)[rows, np.newaxis]
        turning += [np.where(turns, table.position[rows], np.nan), gap]
    if np.any(table.turn_probability > 0.5):
        ax.plot(
            *_km(np.vstack(turning)),
            color=FLAGGED,
            linewidth=5,
            alpha=0.4,
            zorder=2,
            solid_capstyle="round",
            label="manoeuvre",
        )


def _draw_ellipses(
    ax: "Axes", table: TrackTable, lines: dict[int, IntArray], radius: float, label: str
) -> None:
    gap = np.full((1, 2), np.nan)
    parts = []
    for rows in _longest(lines).values():
        some = np.linspace(0, len(rows) - 1, _ELLIPSES + 2).round().astype(int)[1:-1]
        for row in np.unique(rows[some]):
            covariance = table.covariance[row, :2, :2]
            ellipse = _ellipse(table.position[row], covariance, radius, f"table.covariance[{row}]")
            # without its centre
            parts += [ellipse[2:], gap]
    if parts:
        ax.plot(*_km(np.vstack(parts)), color=BAND, linewidth=1, zorder=2.8, label=label)


def _draw_radars(ax: "Axes", radars: Sequence[Radar]) -> None:
    for k, radar in enumerate(radars):
        place = _km(radar.position[:2])
        label = "_radar" if k else "radar"
        ax.plot(*place, "^", color=RESULT, markerfacecolor="none", zorder=3, label=label)
        if radar.name is not None:
            ax.annotate(radar.name, tuple(place), xytext=(5, -10), textcoords="offset points")


def _draw_plans(ax: "Axes", plans: Sequence[FlightPlan]) -> None:
    gap = np.full((1, 2), np.nan)
    parts = [part for plan in plans for part in (plan.waypoints, gap)]
    if parts:
        ax.plot(*_km(np.vstack(parts)), "--", color=_GREY, linewidth=0.8, zorder=1, label="plan")


def _check_radars(numbers: IntArray, radars: Sequence[Radar], name: str) -> None:
    for k, radar in enumerate(radars):
        if not isinstance(radar, Radar):
            raise TypeError(f"radars[{k}] is {radar!r}; it must be a Radar")
    if np.any((numbers < 0) | (numbers >= len(radars))):
        raise ValueError(f"{name} has a radar that is not among the {len(radars)} given")


def _shares(distance: FloatArray, hit: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return middles of intervals of distance, the share of hits there, and its error."""
    far = float(np.max(distance, initial=0.0)) or 1.0
    place = np.minimum((distance / far * _BINS).astype(int), _BINS - 1)
    count = np.bincount(place, minlength=_BINS)
    enough = count >= _FEWEST
    n = count[enough]
    share = np.bincount(place, hit, minlength=_BINS)[enough] / n
    # as if one more of each kind was seen: no share is certain
    likely = (share * n + 1) / (n + 2)
    return (
        far * (np.arange(_BINS)[enough] + 0.5) / _BINS,
        share,
        np.sqrt(likely * (1 - likely) / n),
    )
