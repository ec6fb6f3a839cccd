"""Pictures of the gates of a tracker, around one prediction or over the course of a track."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tertia._arrays import FloatArray, instance, integer, positive_number, sequence_of
from tertia.association import GUARD, INNER, OUTER, GateSector, gate_sectors, gate_threshold
from tertia.plot._axes import (
    BAND,
    FLAGGED,
    KEPT,
    RESULT,
    ellipse,
    ellipse_radius,
    new_axes,
    view_from_above,
)
from tertia.sensors import Radar
from tertia.tracker import Plots, TrackTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_GATES = ((INNER, "inner gate", "-"), (OUTER, "outer gate", "--"), (GUARD, "guard gate", ":"))
# sectors, their names and line styles: changes of speed ahead and behind, changes of course at the
# sides
_SECTORS = (
    ((GateSector.INNER,), "straight on", KEPT, "o"),
    (
        (
            GateSector.AHEAD,
            GateSector.BEHIND,
            GateSector.GUARD_AHEAD,
            GateSector.GUARD_BEHIND,
        ),
        "another speed",
        BAND,
        "s",
    ),
    (
        (GateSector.LEFT, GateSector.RIGHT, GateSector.GUARD_LEFT, GateSector.GUARD_RIGHT),
        "a turn",
        FLAGGED,
        "D",
    ),
    ((GateSector.OUTSIDE,), "outside", "0.6", "x"),
)
# plots of the scan are those within half of it, and this many radii of the widest gate
_SHOWN = 1.5


def gates(
    table: TrackTable,
    row: int,
    plots: Plots,
    radars: Sequence[Radar],
    *,
    guard_acceleration: float = 5.0,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw the gates around a prediction, the sectors of the gates, and the plots of the scan.

    Parameters
    ----------
    table : TrackTable
        The tracks.
    row : int
        Index of a row with a plot. The gates are drawn around the prediction of this row.
    plots : Plots
        All plots that the tracker was given.
    radars : sequence of Radar
        The radars.
    guard_acceleration : float
        Acceleration in m/s² by which the guard gate is widened.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default the axes of a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes, in metres from the prediction. The inner, outer and guard gates contain the plot
        of the target with probabilities of 0.65, 0.95 and 0.998. If the last plot is t seconds old,
        the widened guard gate has the covariance `S + a² t⁴/4`, where S is the covariance of the
        innovation and a is the acceleration. Lines separate the sectors ahead and behind, where a
        plot indicates a change of speed, from the sectors at the sides, where a plot indicates a
        change of course.

    Raises
    ------
    ValueError, TypeError
        If the row does not exist or has no plot, if `table` was made from other plots, if the
        acceleration is not positive, or if an argument has the wrong type.

    Notes
    -----
    Source: Glagovskiy, Lavina, Rudelson 2014. The sectors are those of
    `tertia.association.gate_sectors`.

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from tertia import plot
    >>> from tertia.tracker import Plots, Radar, track
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    >>> time = np.arange(0.0, 100.0, 4.0)
    >>> plots = Plots(time, 50e3 + 200 * time, 0.5)
    >>> table = track(plots, [radar])
    >>> plot.gates(table, 20, plots, [radar], ax=Figure().subplots()).get_title()
    'track 1 at 80 s: straight on'
    """
    instance(table, "table", TrackTable)
    instance(plots, "plots", Plots)
    radars = sequence_of(radars, Radar, "radars")
    a = positive_number(guard_acceleration, "guard_acceleration")
    at = integer(row, "row", 0)
    if at >= len(table) or table.plot[at] < 0:
        raise ValueError(f"row is {at}; it must be a row of the table that has a plot")
    if table.plot[at] >= len(plots):
        raise ValueError(f"plots has {len(plots)} plots; row {at} has plot {table.plot[at]}")
    places, _ = plots.to_cartesian(radars)
    innovation, covariance = table.innovation[at], table.innovation_covariance[at]
    centre = places[table.plot[at]] - innovation
    before = np.flatnonzero(
        (table.track == table.track[at]) & (table.time < table.time[at]) & (table.plot >= 0)
    )
    last = before[np.argmax(table.time[before])] if len(before) else at
    velocity = table.velocity[last]
    gap = table.time[at] - table.time[last]
    wide = covariance + np.eye(2) * (0.5 * a * gap * gap) ** 2

    ax = new_axes() if ax is None else ax
    reach = 0.0
    for probability, name, style in _GATES:
        reach = _draw_gate(ax, covariance, probability, name, style)
    widest = max(reach, _draw_gate(ax, wide, GUARD, f"guard gate, {a:g} m/s²", "-."))
    _draw_sectors(ax, covariance, velocity, reach)
    sensor = table.sensor[at]
    of_scan = (plots.sensor == sensor) & (
        np.abs(plots.time - plots.time[table.plot[at]]) < radars[sensor].scan_period / 2
    )
    errors = places[of_scan] - centre
    errors = errors[np.linalg.norm(errors, axis=1) < _SHOWN * widest]
    sectors = gate_sectors(
        errors,
        np.broadcast_to(covariance, (len(errors), 2, 2)),
        np.broadcast_to(velocity, errors.shape),
    )
    for members, name, colour, marker in _SECTORS:
        those = errors[np.isin(sectors, members)]
        if len(those):
            ax.plot(*those.T, marker, color=colour, markersize=5, label=name)
    ax.plot(*innovation, "o", color=RESULT, markersize=11, fillstyle="none", label="its plot")
    own = int(gate_sectors(innovation, covariance, velocity))
    meaning = next(name for members, name, *_ in _SECTORS if own in members)
    ax.set_title(f"track {table.track[at]} at {table.time[at]:.6g} s: {meaning}")
    view_from_above(ax)
    ax.legend(fontsize="small", loc="best")
    return ax


def gate_history(table: TrackTable, track: int, *, ax: "Axes | None" = None) -> "Axes":
    """Draw the normalised distances of a track's plots from their predictions over time.

    Parameters
    ----------
    table : TrackTable
        The tracks.
    track : int
        Number of a track.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default the axes of a new figure.

    Returns
    -------
    matplotlib.axes.Axes
        The axes. They show the squared distance `d² = e' S⁻¹ e` of each innovation e, on a
        square-root scale, with the thresholds of the three gates. The background is shaded at times
        at which the target probably turns. A plot beyond the guard gate was accepted because it is
        in the widened guard gate.

    Raises
    ------
    ValueError, TypeError
        If there is no such track, it has no plots, or an argument has the wrong type.

    Examples
    --------
    >>> import numpy as np
    >>> from matplotlib.figure import Figure
    >>> from tertia import plot
    >>> from tertia.tracker import Plots, Radar, track
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    >>> time = np.arange(0.0, 100.0, 4.0)
    >>> table = track(Plots(time, 50e3 + 200 * time, 0.5), [radar])
    >>> plot.gate_history(table, 1, ax=Figure().subplots()).get_title()
    'track 1: 23 of 23 plots in the inner gate'
    """
    instance(table, "table", TrackTable)
    number = integer(track, "track", 1)
    rows = np.flatnonzero((table.track == number) & (table.plot >= 0) & table.confirmed)
    rows = rows[np.argsort(table.time[rows], kind="stable")]
    if not len(rows):
        raise ValueError(f"track is {number}; the table has no confirmed track of this number")
    time, innovation = table.time[rows], table.innovation[rows]
    solved = np.linalg.solve(table.innovation_covariance[rows], innovation[..., np.newaxis])
    squared = np.sum(innovation * solved[..., 0], axis=1)
    ax = new_axes() if ax is None else ax
    for probability, name, style in _GATES:
        threshold = gate_threshold(probability)
        ax.axhline(threshold, color=BAND, linestyle=style, linewidth=1, label=f"{name}, d²")
    ax.plot(time, squared, ".-", color=RESULT, linewidth=0.6, label="plot")
    turning = table.turn_probability[rows] > 0.5
    if turning.any():
        ax.fill_between(
            time,
            0.0,
            1.0,
            where=turning.tolist(),
            step="mid",
            transform=ax.get_xaxis_transform(),
            color=FLAGGED,
            alpha=0.2,
            linewidth=0,
            label="manoeuvre",
        )
    ax.set_yscale("function", functions=(_root, np.square))
    inside = int(np.count_nonzero(squared <= gate_threshold(INNER)))
    ax.set(
        title=f"track {number}: {inside} of {len(rows)} plots in the inner gate",
        xlabel="time (s)",
        ylabel="d²",
        ylim=(0.0, 1.1 * max(float(squared.max()), gate_threshold(GUARD))),
    )
    ax.legend(fontsize="small", loc="best")
    return ax


def _root(values: FloatArray) -> FloatArray:
    root: FloatArray = np.sqrt(np.maximum(values, 0.0))
    return root


def _draw_gate(
    ax: "Axes", covariance: FloatArray, probability: float, name: str, style: str
) -> float:
    """Draw a gate; return its largest radius."""
    points = ellipse(np.zeros(2), covariance, ellipse_radius(probability), "covariance")[2:]
    ax.plot(*points.T, style, color=BAND, linewidth=1, label=name)
    return float(np.linalg.norm(points, axis=1).max())


def _draw_sectors(ax: "Axes", covariance: FloatArray, velocity: FloatArray, reach: float) -> None:
    """Draw the lines at 45° to the course, in coordinates in which the covariance is a circle."""
    root = np.linalg.cholesky(covariance)
    u = np.linalg.solve(root, velocity)
    u /= np.linalg.norm(u)
    aside = np.array([-u[1], u[0]])
    for label, direction in (("_sector", u + aside), ("sectors", u - aside)):
        along = root @ direction
        along *= reach / np.linalg.norm(along)
        ax.plot(*np.array([-along, along]).T, color="0.8", linewidth=0.8, zorder=1, label=label)
    ahead = velocity / np.linalg.norm(velocity) * reach
    ax.annotate("", ahead, (0.0, 0.0), arrowprops={"arrowstyle": "->", "color": RESULT})
