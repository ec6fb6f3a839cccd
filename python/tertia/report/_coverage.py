"""Maps for each radar of scans that updated tracks, and of plots that belong to no track."""

from __future__ import annotations

from typing import Any

import numpy as np

from tertia._arrays import FloatArray
from tertia._units import FLIGHT_LEVEL
from tertia.report._analysis import Analysis
from tertia.report._figures import Panel, numbers, rows_of
from tertia.report._radars import scans_of

# least number of scans in a cell whose share is shown
_FEWEST = 10
_SECTORS, _RINGS, _LEVELS = 24, 12, 10
# colours from small to large values, for light and dark pages
_SCALE = [[0.0, "#f2e6c9"], [0.5, "#d5651a"], [1.0, "#5a3a9e"]]


def coverage_panels(analysis: Analysis) -> list[Panel]:
    """Return panels of updated scans by azimuth and flight level, and of plots without a track."""
    panels = [
        _panel(
            "coverage",
            "Updated scans by azimuth",
            "Share of scans in which a track was updated, by azimuth and distance. Cells with "
            f"fewer than {_FEWEST} scans have no colour.",
            [_shares(analysis, k, by_level=False) for k in range(len(analysis.radars))],
            ("azimuth (°)", analysis.names),
        )
    ]
    levels = [_shares(analysis, k, by_level=True) for k in range(len(analysis.radars))]
    if any(one["x"] for one in levels):
        panels.append(
            _panel(
                "levels",
                "Updated scans by level",
                "The same by flight level and distance, for tracks with a height. Distant targets "
                "at low levels are below the radar horizon.",
                levels,
                ("flight level (100 ft)", analysis.names),
            )
        )
    panels.append(
        _panel(
            "no-track",
            "Plots without a track",
            "Number of plots that belong to no track, by azimuth and distance: false plots, and "
            "plots of targets that are not tracked.",
            [_idle(analysis, k) for k in range(len(analysis.radars))],
            ("azimuth (°)", analysis.names),
        )
    )
    return panels


def _panel(
    name: str,
    title: str,
    caption: str,
    cells: list[dict[str, Any]],
    titles: tuple[str, list[str]],
) -> Panel:
    layout = rows_of(len(cells), titles[0], [f"{one} (km)" for one in titles[1]])
    data = [
        {
            "type": "heatmap",
            "name": radar,
            "coloraxis": "coloraxis",
            "yaxis": "y" if k == 0 else f"y{k + 1}",
            **one,
        }
        for k, (radar, one) in enumerate(zip(titles[1], cells, strict=True))
    ]
    most = max([1.0, *(x for one in cells for row in one["z"] for x in row if x is not None)])
    bounds = {"cmin": 0.0, "cmax": most}
    layout["coloraxis"] = {"colorscale": _SCALE, "colorbar": {"thickness": 12}, **bounds}
    return Panel(name, title, caption, {"data": data, "layout": layout})


def _shares(analysis: Analysis, k: int, *, by_level: bool) -> dict[str, Any]:
    """Return the proportion of updated scans in each cell; empty if no height is known."""
    rows, hit = scans_of(analysis.joint, k)
    azimuth, distance = _polar(analysis, k, analysis.joint.position[rows])
    across, edges = azimuth, np.linspace(0.0, 360.0, _SECTORS + 1)
    if by_level:
        across = analysis.joint.height[rows] / FLIGHT_LEVEL
        highest = max(float(np.nanmax(across, initial=0.0)), 1.0)
        edges = np.linspace(0.0, 50.0 * np.ceil(highest / 50.0), _LEVELS + 1)
        if not np.any(np.isfinite(across)):
            return {"x": [], "y": [], "z": []}
    rings = _rings(distance)
    updated = hit[rows]
    there = np.isfinite(across)
    expected, _, _ = np.histogram2d(distance[there], across[there], (rings, edges))
    took, _, _ = np.histogram2d(distance[there & updated], across[there & updated], (rings, edges))
    share = np.where(expected >= _FEWEST, took / np.maximum(expected, 1.0), np.nan)
    return _cells(share, rings, edges)


def _idle(analysis: Analysis, k: int) -> dict[str, Any]:
    """Return the number of plots without a track in each cell."""
    plots = analysis.plots
    used = np.zeros(len(plots), dtype=bool)
    used[analysis.joint.plot[analysis.joint.plot >= 0]] = True
    idle = (plots.sensor == k) & ~used & (analysis.joint.track_of_plot >= 0)
    rings = _rings(plots.range[idle])
    edges = np.linspace(0.0, 360.0, _SECTORS + 1)
    azimuth = np.degrees(plots.azimuth[idle]) % 360.0
    count, _, _ = np.histogram2d(plots.range[idle], azimuth, (rings, edges))
    return _cells(np.where(count > 0, count, np.nan), rings, edges)


def _polar(analysis: Analysis, k: int, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return azimuths in degrees, and distances, as measured from a radar."""
    away = places - analysis.radars[k].position[:2]
    return np.degrees(np.arctan2(*away.T)) % 360.0, np.hypot(*away.T)


def _rings(distance: FloatArray) -> FloatArray:
    most = max(float(np.max(distance, initial=0.0)), 1e3)
    return np.linspace(0.0, 1e4 * np.ceil(most / 1e4), _RINGS + 1)


def _cells(values: FloatArray, rings: FloatArray, edges: FloatArray) -> dict[str, Any]:
    return {
        "x": numbers((edges[:-1] + edges[1:]) / 2),
        "y": numbers((rings[:-1] + rings[1:]) / 2e3),
        "z": [numbers(row, 3) for row in values],
    }
