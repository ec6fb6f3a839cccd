"""The figures of a page, as dictionaries for Plotly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia import metrics
from tertia._arrays import FloatArray
from tertia.metrics._evaluation import MOST_NEES, PARTS
from tertia.report._analysis import (
    INTERSECTION,
    OPTIMAL_FOUND,
    TOGETHER,
    Analysis,
    means,
)

# colours of Okabe and Ito, neither very light nor very dark: for light and dark pages, and for
# colour-blind readers
COLOURS = ("#2a7fc1", "#d5651a", "#149174", "#b5689e", "#a17a00", "#3d8ea8", "#8a6d5a", "#7a7a7a")
DASHES = ("solid", "dash", "dashdot", "longdash", "dot", "longdashdot", "solid", "dash")
MARKS = ("circle", "square", "diamond", "triangle-up", "x", "cross", "star", "triangle-down")
GREY = "#8a8f98"
# half width of a 95 % interval in standard deviations
SIDES = 1.959964
_DIGITS = 5
# largest number of tracks with their own colour in the picture of plans
_COLOURED = 8
# kinds of biases, their scales and the titles of their axes
_BIASES = (
    ("range", 1.0, "range bias (m)"),
    ("range_gain", 1e4, "range gain (10⁻⁴)"),
    ("azimuth", 180.0 / np.pi, "azimuth bias (°)"),
    ("time", 1.0, "time bias (s)"),
)
# numbers of points of an ellipse, and of a line over time
_CORNERS, POINTS = 41, 2000

Figure = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Panel:
    """A figure with its name, title and caption."""

    name: str
    title: str
    caption: str
    figure: Figure


def numbers(values: npt.ArrayLike, digits: int = _DIGITS) -> list[float | None]:
    """Return numbers rounded for JSON; unknown numbers are None."""
    array = np.asarray(values, dtype=np.float64)
    return [float(f"{x:.{digits}g}") if np.isfinite(x) else None for x in array.tolist()]


def line(name: str, x: npt.ArrayLike, y: npt.ArrayLike, k: int = 0, **more: Any) -> dict[str, Any]:
    """Return a line with the colour and the dash pattern for number k."""
    look = {"color": COLOURS[k % len(COLOURS)], "dash": DASHES[k % len(DASHES)], "width": 2}
    look |= more.pop("line", {})
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": numbers(x),
        "y": numbers(y),
        "line": look,
        **more,
    }


def joined(lines: Sequence[FloatArray]) -> FloatArray:
    """Return several lines, each of shape (N, 2), as one line with a gap after each of them."""
    gap = np.full((1, 2), np.nan)
    return np.concatenate([np.zeros((0, 2)), *(part for one in lines for part in (one, gap))])


def rows_of(count: int, x_title: str, y_titles: Sequence[str]) -> dict[str, Any]:
    """Return the layout of panels that are one below the other and have a common x axis."""
    gap = 0.1 if count > 1 else 0.0
    size = (1.0 - gap * (count - 1)) / count
    layout: dict[str, Any] = {"xaxis": {"title": {"text": x_title}, "anchor": f"y{count}"}}
    if count == 1:
        layout["xaxis"]["anchor"] = "y"
    for i, title in enumerate(y_titles):
        top = 1.0 - i * (size + gap)
        layout[_axis(i, "yaxis")] = {
            "title": {"text": title},
            "domain": [max(top - size, 0.0), top],
            "anchor": "x",
            "rangemode": "tozero",
        }
    return layout


def _axis(i: int, stem: str = "y") -> str:
    return stem if i == 0 else f"{stem}{i + 1}"


def radar_panels(analysis: Analysis, time: str) -> list[Panel]:
    """Return panels that show errors, updates and outliers of the radars over time."""
    return [
        _noise(analysis, time),
        *_biases(analysis, time),
        _update_probability(analysis, time),
        _outliers(analysis, time),
    ]


def _noise(analysis: Analysis, time: str) -> Panel:
    data = []
    history = analysis.registration.noise_history
    for i, (kind, unit) in enumerate((("range", 1.0), ("azimuth", 180.0 / np.pi))):
        for k, (name, radar) in enumerate(zip(analysis.names, analysis.radars, strict=True)):
            stated = getattr(radar, f"{kind}_sigma") * unit
            factor, sigma = (getattr(one, kind)[k] for one in (history.factor, history.sigma))
            more = {**_bars(sigma * stated), **_panel(name, i)}
            data.append(_marked(name, analysis.middle, factor * stated, k, **more))
            more = {"line": {"dash": "dot", "width": 1.5}, **_panel(name, i), "hoverinfo": "skip"}
            ends = analysis.edges[[0, -1]]
            data.append(line(f"{name}, stated", ends, [stated, stated], k, **more))
    layout = rows_of(2, time, ["sigma of range (m)", "sigma of azimuth (°)"])
    caption = (
        "Standard deviation of plots about short straight lines through the radar's own tracks, "
        "with 95 % error bars. Dotted: sigma as stated."
    )
    return Panel("noise", "Noise over time", caption, {"data": data, "layout": layout})


def _biases(analysis: Analysis, time: str) -> list[Panel]:
    """Return a panel that shows those biases of the radars that the plots determine."""
    history, seen = analysis.registration.bias_history, analysis.registration.observable
    middle = (history.edges[:-1] + history.edges[1:]) / 2
    data: list[Figure] = []
    titles: list[str] = []
    for kind, scale, title in _BIASES:
        if not np.any(seen[kind]):
            continue
        for k in np.flatnonzero(seen[kind]).tolist():
            value, sigma = (
                np.array([np.asarray(getattr(bias, name))[k] for bias in history.bias])
                for name in (kind, f"{kind}_sigma")
            )
            name = analysis.names[k]
            more = {**_bars(sigma * scale), **_panel(name, len(titles))}
            data.append(_marked(name, middle, value * scale, k, **more))
        titles.append(title)
    if not titles:
        return []
    layout = rows_of(len(titles), time, titles)
    for i in range(len(titles)):
        layout[_axis(i, "yaxis")]["rangemode"] = "normal"
    caption = (
        "Systematic errors of the radars that the plots of targets seen by several radars "
        "determine, with 95 % error bars."
    )
    return [Panel("bias", "Bias over time", caption, {"data": data, "layout": layout})]


def _update_probability(analysis: Analysis, time: str) -> Panel:
    data = []
    for k, (name, one) in enumerate(zip(analysis.names, analysis.updates, strict=True)):
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where(one.expected > 0, one.hit / one.expected, np.nan)
        data.append(_marked(name, one.time, share, k))
    layout = rows_of(1, time, ["updated scans"])
    layout["yaxis"]["range"] = [0.0, 1.02]
    caption = "Share of scans in which a confirmed track within the radar's range was updated."
    return Panel("updates", "Updates over time", caption, {"data": data, "layout": layout})


def _outliers(analysis: Analysis, time: str) -> Panel:
    data = []
    for i, kind in enumerate(("outlier", "unassociated", "refused")):
        for k, (name, one) in enumerate(zip(analysis.names, analysis.updates, strict=True)):
            with np.errstate(invalid="ignore", divide="ignore"):
                share = np.where(one.plots > 0, 100.0 * getattr(one, kind) / one.plots, np.nan)
            data.append(_marked(name, one.time, share, k, **_panel(name, i)))
    layout = rows_of(3, time, ["outliers (%)", "unassociated (%)", "refused (%)"])
    caption = (
        "Shares of a radar's plots. An outlier updates a track, but with an innovation so large "
        "that the stated noise exceeds it once in 10,000 plots. An unassociated plot has the "
        "identity of a track that does not use it, for example an extreme outlier or a duplicate. "
        "A refused plot has no range, or arrived too late."
    )
    return Panel("outliers", "Outliers over time", caption, {"data": data, "layout": layout})


def fusion_panels(analysis: Analysis, time: str) -> list[Panel]:
    """Return panels that show the weights of the tracks of each radar over time."""
    if analysis.fusion is None:
        return []
    data, titles = [], []
    for i, one in enumerate(analysis.fusion.ways.values()):
        titles.append(("stated noise", "estimated noise", "intersection")[i])
        for k, name in enumerate(analysis.names):
            mean, _ = means(analysis.fusion.stated.time, one.weight[:, k], analysis.edges)
            data.append(_marked(name, analysis.middle, mean, k, **_panel(name, i)))
    layout = rows_of(3, time, titles)
    for i in range(3):
        layout[_axis(i, "yaxis")]["range"] = [0.0, 1.0]
    caption = (
        "Mean weight of a radar's track in the fused position, at instants at which the radar has "
        "a track. Top: optimal weights for the stated noise. Middle: optimal weights for the "
        "noise estimated in each period. Bottom: covariance intersection with the estimated "
        "noise, which is valid for any correlation of the errors."
    )
    return [Panel("weights", "Weights over time", caption, {"data": data, "layout": layout})]


def truth_panels(analysis: Analysis, time: str) -> list[Panel]:
    """Return panels that show GOSPA and the normalised errors over time."""
    if TOGETHER not in analysis.judged:
        return []
    judged = analysis.judged[TOGETHER]
    step = max(1, len(judged.instants) // POINTS)
    data = [
        line(name, judged.instants[::step], values[::step], k)
        for k, (name, values) in enumerate(zip(PARTS, judged.gospa.T, strict=True))
    ]
    layout = rows_of(1, time, ["GOSPA (m)"])
    caption = (
        "All radars together: GOSPA once per update interval, and the square roots of its parts."
    )
    panels = [Panel("gospa", "GOSPA over time", caption, {"data": data, "layout": layout})]
    if judged.nees is not None:
        panels.append(_nees(analysis, time))
    return panels


def _nees(analysis: Analysis, time: str) -> Panel:
    judged = analysis.judged[TOGETHER]
    assert judged.nees is not None
    middle = analysis.middle
    mean, count = means(judged.time, judged.nees / 2, analysis.edges)
    bounds = np.array([_bounds(int(n)) for n in count])
    look: Figure = {"line": {"color": GREY, "width": 1, "dash": "dot"}, "legendgroup": "bounds"}
    fill: Figure = {"fill": "tonexty", "fillcolor": "rgba(138,143,152,0.2)"}
    data = [
        line("95 % bounds", middle, bounds[:, 1], **look),
        line("lower bound", middle, bounds[:, 0], **look, **fill, showlegend=False),
        _marked(TOGETHER, middle, mean, 0),
    ]
    if analysis.fusion is not None:
        for k, name in enumerate((OPTIMAL_FOUND, INTERSECTION), start=1):
            nees = analysis.fusion.nees[name] / 2
            mean, _ = means(analysis.fusion.stated.time, nees, analysis.edges)
            data.append(_marked(name, middle, mean, k))
    layout = rows_of(1, time, ["NEES per axis"])
    caption = (
        "Mean normalised squared error of position: 1 if the covariances are correct, larger if "
        "they are too small. The bounds assume that all errors in a period are independent; in "
        "fact, errors of one track are correlated."
    )
    return Panel("nees", "NEES over time", caption, {"data": data, "layout": layout})


def _marked(name: str, x: FloatArray, y: FloatArray, k: int, **more: Any) -> dict[str, Any]:
    """Return the line for number k, with markers at its points."""
    marker = {"symbol": MARKS[k % len(MARKS)], "size": 7}
    return line(name, x, y, k, mode="lines+markers", marker=marker, **more)


def dots(name: str, places: FloatArray, marker: dict[str, Any]) -> dict[str, Any]:
    """Return positions on a map as points that are not joined by a line."""
    return line(name, places[:, 0] / 1e3, places[:, 1] / 1e3, mode="markers", marker=marker)


def _bars(sigma: FloatArray) -> dict[str, Any]:
    """Return the settings of a solid line with error bars of 95 %."""
    bars = {"type": "data", "array": numbers(sigma * SIDES, 3), "thickness": 1, "width": 2}
    return {"error_y": bars, "line": {"dash": "solid"}}


def _panel(name: str, i: int) -> dict[str, Any]:
    """Return the settings of a line in panel i; all panels have one common legend entry."""
    return {"legendgroup": name, "showlegend": i == 0, "yaxis": _axis(i)}


def _bounds(count: int) -> tuple[float, float]:
    if count == 0:
        return np.nan, np.nan
    low, high = metrics.consistency_bounds(count, 2, 0.95)
    return low / 2, high / 2


def plan_panels(analysis: Analysis, time: str) -> list[Panel]:
    """Return a panel that shows the cross-track distances of tracks from their plans."""
    if not analysis.followed:
        return []
    leaving = [one for one in analysis.followed if np.isfinite(one.left)]
    coloured = leaving[:_COLOURED]
    on = [one for one in analysis.followed if one not in coloured]
    step = max(1, sum(len(one.time) for one in on) // (10 * POINTS))
    data = []
    if on:
        rows = [np.column_stack([one.time, one.cross_track / 1e3])[::step] for one in on]
        look = {"color": GREY, "width": 1, "dash": "solid"}
        data.append(line("others", *joined(rows).T, line=look))
    for k, one in enumerate(coloured):
        data.append(line(f"{one.name}, track {one.track}", one.time, one.cross_track / 1e3, k))
    layout = rows_of(1, time, ["cross-track distance, right positive (km)"])
    layout["yaxis"]["rangemode"] = "normal"
    caption = (
        "Cross-track distance of tracks from the paths of their plans. Tracks that left their "
        "plans are in colour."
    )
    return [
        Panel("cross-track", "Distance from the plan", caption, {"data": data, "layout": layout})
    ]


def ellipse(place: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the points of the 95 % error ellipse about a position, (N, 2)."""
    root = np.linalg.cholesky(covariance[:2, :2])
    angle = np.linspace(0.0, 2 * np.pi, _CORNERS)
    ring = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(place[:2] + np.sqrt(MOST_NEES) * (root @ ring).T)


def triangles(
    name: str, places: FloatArray, names: list[str], marker: dict[str, Any], position: str
) -> dict[str, Any]:
    """Return the sensors as triangles on a map, with their names."""
    return {
        "type": "scatter",
        "mode": "markers+text",
        "name": name,
        "x": numbers(places[:, 0] / 1e3),
        "y": numbers(places[:, 1] / 1e3),
        "text": names,
        "textposition": position,
        "cliponaxis": False,
        "marker": {"symbol": "triangle-up", **marker},
    }


def plane() -> dict[str, Any]:
    """Return the layout of a map."""
    return {
        "xaxis": {"title": {"text": "east (km)"}},
        "yaxis": {"title": {"text": "north (km)"}, "scaleanchor": "x"},
        "hovermode": "closest",
    }
