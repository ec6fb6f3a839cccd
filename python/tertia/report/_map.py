"""The map of a page, with fixed parts and with parts that move over time."""

from __future__ import annotations

from typing import Any

import numpy as np

from tertia._arrays import FloatArray, IntArray
from tertia.metrics._evaluation import MOST_NEES
from tertia.report._analysis import Analysis
from tertia.report._figures import COLOURS, GREY, joined, line, numbers, plane, triangles
from tertia.report._grid import grid
from tertia.tracker import TrackTable

# largest numbers of rows of tracks, plots and positions of the truth in a page
ROWS, PLOTS, TRUTH = 30_000, 10_000, 15_000
# number of points of the path of a plan
_PATH = 60
# size of the median ellipse as a share of the map; factors by which ellipses are enlarged
_SHARE, _FACTORS = 0.012, (1, 2, 5, 10, 20, 50, 100, 200, 500)
# margin around the map, as a share of its extent
_ROOM = 0.06


def map_of(analysis: Analysis) -> dict[str, Any]:
    """Return the data and the layout of the map, and the data for the player."""
    joint, own = analysis.joint, analysis.joint[analysis.joint.confirmed]
    rows = _thinned(own)
    low, high = _corners(analysis, own)
    data: list[dict[str, Any]] = [*grid(analysis.radars, low, high), _plots(analysis)]
    if analysis.plans:
        data.append(_plans(analysis))
    if analysis.truth is not None:
        data.append(_truth(analysis))
    if len(analysis.radars) > 1:
        for k, (name, table) in enumerate(zip(analysis.names, analysis.single, strict=True)):
            data.append(_lines(f"{name} alone", table, k + 1))
    data += [_lines("tracks", joint, 0, visible=True), _radars(analysis)]
    span = max(np.ptp(own.position, axis=0).max() if len(own) else 1.0, 1.0)
    axes = _axes(own.covariance[:, :2, :2])
    size = float(np.median(axes[:, 0])) if len(own) else 1.0
    wanted = _SHARE * span / max(size, 1e-9)
    factor = _FACTORS[int(np.argmin(np.abs(np.log(np.array(_FACTORS) / max(wanted, 1e-9)))))]
    away = {one.track: (one.left, one.back) for one in analysis.followed if np.isfinite(one.left)}
    tracks = [_track(analysis, own, index, axes, away) for index in rows]
    known = analysis.plots.time[np.isfinite(analysis.plots.time)]
    first, last = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    layout = plane()
    for axis, *ends in zip(("xaxis", "yaxis"), low.tolist(), high.tolist(), strict=True):
        layout[axis]["range"] = ends
    return {
        "data": data,
        "layout": layout,
        "player": {
            "tracks": tracks,
            "truth": _truth_tracks(analysis),
            "plots": _moving_plots(analysis),
            "first": first,
            "last": last,
            "period": max(radar.scan_period for radar in analysis.radars),
            "factors": list(_FACTORS),
            "factor": factor,
        },
    }


def _corners(analysis: Analysis, table: TrackTable) -> tuple[FloatArray, FloatArray]:
    """Return the corners of the map in kilometres; false plots may be outside the map."""
    places = np.array([radar.position[:2] for radar in analysis.radars])
    seen = np.concatenate([table.position, places]) / 1e3
    low, high = seen.min(axis=0), seen.max(axis=0)
    room = _ROOM * max(float(np.max(high - low)), 1.0)
    return low - room, high + room


def _thinned(table: TrackTable) -> list[IntArray]:
    """Return the rows of each track or, if there are too many, every n-th row and the last."""
    step = max(1, int(np.ceil(len(table) / ROWS)))
    order = np.lexsort((table.time, table.track))
    starts = np.flatnonzero(np.diff(table.track[order], prepend=-1) != 0)
    found = []
    for own in np.split(order, starts[1:]) if len(order) else []:
        kept = own[::step]
        found.append(kept if kept[-1] == own[-1] else np.append(kept, own[-1]))
    return found


def _axes(covariance: FloatArray) -> FloatArray:
    """Return the semi-major and semi-minor axes and the orientations of 95 % ellipses, (N, 3)."""
    values, vectors = np.linalg.eigh(covariance)
    half = np.sqrt(MOST_NEES * np.maximum(values, 0.0))
    angle = np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1])
    return np.column_stack([half[:, 1], half[:, 0], angle])


def _track(
    analysis: Analysis,
    table: TrackTable,
    index: IntArray,
    axes: FloatArray,
    away: dict[int, tuple[float, float]],
) -> dict[str, Any]:
    rows = table[index]
    left, back = away.get(int(rows.track[0]), (np.inf, np.inf))
    followed = rows.plan[rows.plan >= 0]
    name = f"track {rows.track[0]}"
    if len(followed):
        plan = analysis.plans[int(followed[-1])]
        name = str(plan.name or f"plan {followed[-1] + 1}")
    return {
        "name": name,
        "track": int(rows.track[0]),
        "t": numbers(rows.time, 8),
        "x": numbers(rows.position[:, 0] / 1e3, 6),
        "y": numbers(rows.position[:, 1] / 1e3, 6),
        "v": numbers(np.hypot(*rows.velocity.T), 3),
        "e": [numbers(column, 3) for column in (axes[index].T / [[1e3], [1e3], [1.0]])],
        "off": [bool(x) for x in (rows.time >= left) & ~(rows.time >= back)],
    }


def _lines(name: str, table: TrackTable, k: int, *, visible: bool = False) -> dict[str, Any]:
    own = table[table.confirmed]
    place = joined([own.position[index] / 1e3 for index in _thinned(own)])
    look = {"width": 1.6} if visible else {"width": 1.2}
    east, north = place.T
    trace = line(name, east, north, k, line=look, hoverinfo="skip")
    return trace if visible else trace | {"visible": "legendonly"}


def _chosen_plots(analysis: Analysis) -> tuple[FloatArray, FloatArray]:
    """Return the times and positions of the plots or, if there are too many, of every n-th."""
    plots = analysis.plots
    valid = np.isfinite(plots.time) & np.isfinite(plots.range) & np.isfinite(plots.azimuth)
    own = plots[np.flatnonzero(valid)]
    own = own[np.argsort(own.time, kind="stable")]
    own = own[:: max(1, int(np.ceil(len(own) / PLOTS)))]
    return own.time, own.to_cartesian(analysis.radars)[0] / 1e3


def _plots(analysis: Analysis) -> dict[str, Any]:
    _, place = _chosen_plots(analysis)
    return {
        **line("plots", place[:, 0], place[:, 1]),
        "mode": "markers",
        "marker": {"color": GREY, "size": 3, "opacity": 0.45},
        "hoverinfo": "skip",
        "visible": "legendonly",
    }


def _moving_plots(analysis: Analysis) -> dict[str, Any]:
    time, place = _chosen_plots(analysis)
    return {"t": numbers(time, 8), "x": numbers(place[:, 0]), "y": numbers(place[:, 1])}


def _plans(analysis: Analysis) -> dict[str, Any]:
    ways = [plan.path(np.linspace(0.0, plan.length, _PATH))[0] / 1e3 for plan in analysis.plans]
    look = {"color": COLOURS[2], "dash": "dash", "width": 1.2}
    return line("plans", *joined(ways).T, line=look, hoverinfo="skip")


def _truth_step(analysis: Analysis) -> int:
    assert analysis.truth is not None
    return max(1, int(np.ceil(len(analysis.truth.time) / TRUTH)))


def _truth(analysis: Analysis) -> dict[str, Any]:
    assert analysis.truth is not None
    step = _truth_step(analysis)
    ways = [place[::step] / 1e3 for _, _, place in analysis.truth]
    look = {"color": GREY, "width": 5}
    return line("truth", *joined(ways).T, line=look, hoverinfo="skip", opacity=0.45)


def _truth_tracks(analysis: Analysis) -> list[dict[str, Any]]:
    if analysis.truth is None:
        return []
    step = _truth_step(analysis)
    return [
        {
            "name": str(name),
            "t": numbers(time[::step], 8),
            "x": numbers(place[::step, 0] / 1e3, 6),
            "y": numbers(place[::step, 1] / 1e3, 6),
        }
        for name, time, place in analysis.truth
    ]


def _radars(analysis: Analysis) -> dict[str, Any]:
    places = np.array([radar.position[:2] for radar in analysis.radars])
    colours = [COLOURS[k % len(COLOURS)] for k in range(len(places))]
    marker = {"size": 14, "color": colours, "line": {"width": 1, "color": GREY}}
    sites = triangles("radars", places, list(analysis.names), marker, "bottom center")
    return sites | {"hoverinfo": "text"}
