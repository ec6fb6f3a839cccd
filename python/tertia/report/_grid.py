"""Lines of latitude and longitude on a map, and range rings about radars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tertia._arrays import FloatArray
from tertia.geo import SystemPlane
from tertia.report._figures import GREY, joined, line, numbers
from tertia.sensors import Radar

# possible spacings of lines in degrees, and of rings in kilometres
_DEGREES = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
_KILOMETRES = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
_LINES, _POINTS = 6, 61
# position of the labels in degrees, as a share of the map
_INSIDE = 0.01
# number of radars whose rings are shown initially
_RINGED = 2
_LOOK = {"color": GREY, "dash": "dot", "width": 1}


def grid(radars: Sequence[Radar], low: FloatArray, high: FloatArray) -> list[dict[str, Any]]:
    """Return the grid and the range rings of a map whose corners are given in kilometres."""
    frame = radars[0].frame
    return [*([] if frame is None else _graticule(frame, low, high)), *_rings(radars, low, high)]


def _graticule(frame: SystemPlane, low: FloatArray, high: FloatArray) -> list[dict[str, Any]]:
    """Return lines of latitude and longitude, with labels at the left and the bottom of the map."""
    # the grid is larger than the map, because windows of other shapes show more
    edge = np.linspace(2.0 * low - high, 2.0 * high - low, _POINTS)
    inside = low + _INSIDE * (high - low)
    east, north = (one.ravel() * 1e3 for one in np.meshgrid(*edge.T))
    places = np.column_stack([east, north, 0.0 * east])
    latitude, longitude, _ = frame.to_geodetic(places)
    # longitudes without a jump at 180 degrees
    turned = (longitude - frame.longitude + 180.0) % 360.0 - 180.0 + frame.longitude
    spans = [(float(np.min(one)), float(np.max(one))) for one in (latitude, turned)]
    lines, labels, words, sides = [], [], [], []
    for axis, (first, last) in enumerate(spans):
        step = _step((last - first) / 3.0, _DEGREES)
        along = np.linspace(*spans[1 - axis], _POINTS)
        for value in step * np.arange(np.ceil(first / step), np.floor(last / step) + 1):
            across = np.full(_POINTS, value)
            where = frame.to_local(*((across, along) if axis == 0 else (along, across)))
            own = where[:, :2] / 1e3
            lines.append(own)
            # point at which the line meets the left or the lower side
            meets = float(np.interp(inside[axis], own[:, axis], own[:, 1 - axis]))
            if inside[1 - axis] < meets < high[1 - axis]:
                labels.append((inside[0], meets) if axis == 0 else (meets, inside[1]))
                words.append(_degrees(value, ("N", "S") if axis == 0 else ("E", "W")))
                sides.append("middle right" if axis == 0 else "top center")
    return [
        _lines("graticule", lines),
        _words("graticule", np.array(labels).reshape(-1, 2), words, sides),
    ]


def _rings(radars: Sequence[Radar], low: FloatArray, high: FloatArray) -> list[dict[str, Any]]:
    """Return range rings about the radars, up to their maximum ranges or the edges of the map."""
    angle = np.linspace(0.0, 2.0 * np.pi, 2 * _POINTS)
    circle = np.column_stack([np.sin(angle), np.cos(angle)])
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
    rings, labels, words = [], [], []
    for radar in radars:
        centre = radar.position[:2] / 1e3
        far = float(np.max(np.linalg.norm(corners - centre, axis=1)))
        most = min(radar.max_range / 1e3, far)
        step = _step(most, _KILOMETRES)
        for radius in step * np.arange(1, np.floor(most / step) + 1):
            rings.append(centre + radius * circle)
            labels.append(centre + radius * circle[0])
            words.append(f"{radius:g} km")
    inside = [bool(np.all((low < one) & (one < high))) for one in labels]
    labels = [one for one, kept in zip(labels, inside, strict=True) if kept]
    words = [one for one, kept in zip(words, inside, strict=True) if kept]
    shown = {} if len(radars) <= _RINGED else {"visible": "legendonly"}
    return [
        _lines("range rings", rings) | shown,
        _words("range rings", np.array(labels).reshape(-1, 2), words, "top center") | shown,
    ]


def _lines(name: str, lines: Sequence[FloatArray]) -> dict[str, Any]:
    east, north = joined(lines).T
    look: dict[str, Any] = {"legendgroup": name, "hoverinfo": "skip", "opacity": 0.6}
    return line(name, east, north, line=_LOOK, **look)


def _words(
    name: str, places: FloatArray, words: list[str], sides: str | list[str]
) -> dict[str, Any]:
    """Return texts on a map; they are shown or hidden together with the lines of that name."""
    return {
        "type": "scatter",
        "mode": "text",
        "name": name,
        "x": numbers(places[:, 0]),
        "y": numbers(places[:, 1]),
        "text": words,
        "textposition": sides,
        "textfont": {"color": GREY, "size": 10},
        "legendgroup": name,
        "showlegend": False,
        "hoverinfo": "skip",
    }


def _step(span: float, steps: Sequence[float]) -> float:
    """Return the smallest of the steps with which there are only a few lines."""
    return next((step for step in steps if span <= _LINES * step), steps[-1])


def _degrees(value: float, sides: tuple[str, str]) -> str:
    turned = round(float(value + 180.0) % 360.0 - 180.0, 2)
    return f"{abs(turned):g}° {sides[turned < 0] if turned else ''}".strip()
