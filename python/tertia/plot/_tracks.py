"""Pictures of tracks of many targets as seen from above, and of how often radars update them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tertia._arrays import BoolArray, FloatArray, IntArray, flag, instance, sequence_of
from tertia._result import counted
from tertia.flightplan import FlightPlan
from tertia.plot._axes import (
    BAND,
    FLAGGED,
    GAP,
    add_names,
    draw_sites,
    ellipse_radius,
    ellipses,
    new_axes,
    sensor_looks,
    view_from_above,
)
from tertia.sensors import Radar
from tertia.tracker import Plots, SmoothedTracks, TrackTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_Tracks: TypeAlias = TrackTable | SmoothedTracks

# vermilion is for manoeuvres, green for ellipses, grey for everything that is not a result
_COLOURS = ("#0072B2", "#E69F00", "#CC79A7", "#56B4E9", "#8C564B", "#999933")
_GREY = "0.6"
# largest numbers of labels and of ellipses that are legible
_MOST_NUMBERS = 60
_ELLIPSES = 3
# intervals of range, and the fewest scans of which a share is drawn
_BINS, _FEWEST = 12, 5


def tracks(
    table: _Tracks,
    radars: Sequence[Radar] = (),
    *,
    plots: Plots | None = None,
    plans: Sequence[FlightPlan] = (),
    legend: bool = True,
    probability: float = 0.95,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw tracks as seen from above, with numbers, manoeuvres and some error ellipses.

    Parameters
    ----------
    table : TrackTable or SmoothedTracks
        The tracks, from `tertia.tracker.track`, `Tracker.update` or `smooth_tracks`.
    radars : sequence of Radar
        The radars.
    plots : Plots, optional
        The plots; they are drawn as dots. If they are given, `radars` is required.
    plans : sequence of FlightPlan
        Flight plans; they are drawn as dashed lines.
    probability : float
        Probability that an ellipse contains the true position if the errors are normally
        distributed. Three ellipses are drawn for each track.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default the axes of a new figure.
    legend : bool
        Whether to draw a legend.

    Returns
    -------
    matplotlib.axes.Axes
        The axes. They show north against east in kilometres. The 60 longest tracks are labelled at
        their ends with their numbers.

    Raises
    ------
    ValueError
        If a plot belongs to a radar that is not given, or the probability is not between 0 and 1.

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
    instance(table, "table", TrackTable, SmoothedTracks)
    radius = ellipse_radius(probability)
    legend = flag(legend, "legend")
    seen = np.empty((0, 2))
    if plots is not None and len(plots):
        _check_radars(plots.sensor, radars, "plots")
        seen, _ = plots.to_cartesian(radars)
    ax = new_axes() if ax is None else ax

    lines = _lines(table)
    _draw_tracks(ax, table, lines)
    _draw_ellipses(ax, table, lines, radius, f"{100 * probability:.10g} % ellipse")
    places = [_km(radar.position[np.newaxis, :2]).T for radar in radars]
    draw_sites(ax, places, "radar")
    add_names(ax, [radar.name for radar in radars], np.reshape(places, (-1, 2)), (5, -10))
    # the scale does not depend on clutter, nor on parts of plans that are far away
    limits = ax.dataLim.frozen()
    if parts := [part for plan in plans for part in (plan.waypoints, GAP)]:
        ax.plot(*_km(np.vstack(parts)), "--", color=_GREY, linewidth=0.8, zorder=1, label="plan")
    if len(seen):
        ax.plot(*_km(seen), ".", color=_GREY, markersize=2, zorder=1, label="plot")
    if lines:
        ax.dataLim.set(limits)
    longest = _longest(lines)
    ends = [table.position[rows[-1]] / 1e3 for rows in longest.values()]
    add_names(ax, longest, np.reshape(ends, (-1, 2)), (4, 4))
    ax.set_title(counted(len(lines), "track"))
    ax.margins(0.05)
    view_from_above(ax, "km")
    if legend:
        ax.legend(fontsize="small", loc="best")
    return ax


def update_probability(
    table: TrackTable, radars: Sequence[Radar], *, ax: "Axes | None" = None, legend: bool = True
) -> "Axes":
    """Draw the update probability of confirmed tracks against range, for each radar.

    Parameters
    ----------
    table : TrackTable
        The tracks, as for the function `tracks`.
    radars : sequence of Radar
        All radars of the table.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default the axes of a new figure.
    legend : bool
        Whether to draw a legend.

    Returns
    -------
    matplotlib.axes.Axes
        The axes. They show the proportion of scans with a plot, with its standard error, for each
        interval of range that has at least five scans. Dashed lines show the stated detection
        probabilities of the radars.

    Raises
    ------
    ValueError
        If the table contains a radar that is not given.

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from tertia import plot, tracker
    >>> radar = tracker.Radar(range_sigma=50, azimuth_sigma=0.08, scan_period=4, degrees=True)
    >>> time = np.delete(np.arange(0.0, 100.0, 4.0), [10, 12])
    >>> table = tracker.track(tracker.Plots(time, 50e3 + 200 * time, 0.5), [radar])
    >>> plot.update_probability(table, [radar], ax=Figure().subplots()).get_title()
    '91.3 % of 23 scans'
    """
    instance(table, "table", TrackTable)
    _check_radars(table.sensor, radars, "table")
    legend = flag(legend, "legend")
    ax = new_axes() if ax is None else ax
    known = table[table.confirmed]
    hit = known.plot >= 0
    edge = 0.0
    for k, radar in enumerate(radars):
        own = known.sensor == k
        distance = np.hypot(*(known.position[own] - radar.position[:2]).T)
        looks = sensor_looks(k)[0] | sensor_looks(k)[1] | {"drawstyle": "default"}
        middle, share, error = _shares(distance, hit[own])
        name = radar.name or f"radar {k}"
        ax.errorbar(middle / 1e3, share, error, markersize=4, capsize=2, label=name, **looks)
        stated = radar.detection_probability
        ax.axhline(stated, color=looks["color"], linestyle="--", linewidth=0.8, label="_stated")
        edge = max(edge, float(np.max(distance, initial=0.0)) / 1e3)
    seen = f"{100 * np.mean(hit):.1f} % of " if len(hit) else ""
    ax.set(
        title=seen + counted(len(hit), "scan"),
        xlabel="distance from the radar (km)",
        ylabel="probability of update",
        xlim=(0.0, 1.05 * edge or 1.0),
        ylim=(0.0, 1.05),
    )
    if legend and len(radars):
        ax.legend(fontsize="small", loc="lower left")
    return ax


def _km(position: FloatArray) -> FloatArray:
    """Return east and north in kilometres; the first axis of the array is the coordinate."""
    return np.asarray(position.T / 1e3)


def _lines(table: _Tracks) -> dict[int, IntArray]:
    """Return the rows of each track in time order."""
    order = np.lexsort((table.time, table.track))
    names, starts = np.unique(table.track[order], return_index=True)
    return dict(zip(names.tolist(), np.split(order, starts[1:]), strict=False))


def _longest(lines: dict[int, IntArray]) -> dict[int, IntArray]:
    """Return the tracks with the most rows."""
    chosen = sorted(lines, key=lambda name: -len(lines[name]))[:_MOST_NUMBERS]
    return {name: lines[name] for name in chosen}


def _draw_tracks(ax: "Axes", table: _Tracks, lines: dict[int, IntArray]) -> None:
    """Draw all tracks of one colour as one line, with their manoeuvres marked behind it."""
    turning = []
    for first, colour in enumerate(_COLOURS[: len(lines)]):
        parts = []
        for rows in list(lines.values())[first :: len(_COLOURS)]:
            parts += [table.position[rows], GAP]
        label = "_track" if first else "track"
        ax.plot(*_km(np.vstack(parts)), color=colour, linewidth=1, zorder=2.5, label=label)
    for rows in lines.values():
        turns = (table.turn_probability > 0.5)[rows, np.newaxis]
        turning += [np.where(turns, table.position[rows], np.nan), GAP]
    if np.any(table.turn_probability > 0.5):
        looks: dict[str, Any] = {
            "color": FLAGGED,
            "linewidth": 5,
            "alpha": 0.4,
            "solid_capstyle": "round",
        }
        ax.plot(*_km(np.vstack(turning)), **looks, zorder=2, label="manoeuvre")


def _draw_ellipses(
    ax: "Axes", table: _Tracks, lines: dict[int, IntArray], radius: float, label: str
) -> None:
    chosen: list[int] = []
    for rows in _longest(lines).values():
        some = np.linspace(0, len(rows) - 1, _ELLIPSES + 2).round().astype(int)[1:-1]
        chosen += np.unique(rows[some]).tolist()
    if chosen:
        points = ellipses(table.position, table.covariance, radius, chosen, "table.covariance")
        ax.plot(*_km(points), color=BAND, linewidth=1, zorder=2.8, label=label)


def _check_radars(numbers: IntArray, radars: Sequence[Radar], name: str) -> None:
    sequence_of(radars, Radar, "radars")
    if np.any((numbers < 0) | (numbers >= len(radars))):
        raise ValueError(f"{name} has a radar that is not among the {len(radars)} given")


def _shares(distance: FloatArray, hit: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return middles of intervals of distance, the proportion of hits in each, and its error."""
    far = float(np.max(distance, initial=0.0)) or 1.0
    place = np.minimum((distance / far * _BINS).astype(int), _BINS - 1)
    count = np.bincount(place, minlength=_BINS)
    enough = count >= _FEWEST
    n = count[enough]
    share = np.bincount(place, hit, minlength=_BINS)[enough] / n
    # as if there were one more of each kind: no share is certain
    likely = (share * n + 1) / (n + 2)
    return (
        far * (np.arange(_BINS)[enough] + 0.5) / _BINS,
        share,
        np.sqrt(likely * (1 - likely) / n),
    )
