"""The part of a page on direction finders: positions of emitters, and their bearings."""

from __future__ import annotations

from typing import Any

import numpy as np

from tertia.report._bearings import Finders, Heard
from tertia.report._figures import (
    COLOURS,
    GREY,
    MARKS,
    POINTS,
    SIDES,
    Panel,
    dots,
    ellipse,
    joined,
    line,
    plane,
    rows_of,
    triangles,
)
from tertia.report._tables import DEGREES, Row, Table, finite_or_none, plus_minus, table, text
from tertia.trajectory import Trajectory

# ellipses along the path of a moving emitter
_ELLIPSES = 12


def emitter_rows(finders: Finders) -> list[Row]:
    """Return rows with the position and the bearings of each emitter."""
    rows = []
    for heard in finders.heard:
        row: Row = {
            "emitter": heard.emitter.name,
            "moves": heard.moves,
            "bearings": [
                {
                    "station": name,
                    "bearing_deg": finite_or_none(heard.bearing[k] * DEGREES),
                    "sigma_deg": finite_or_none(heard.sigma[k] * DEGREES),
                    "count": int(np.sum(~np.isnan(heard.emitter.azimuth[:, k]))),
                    "outliers": int(heard.outlier[:, k].sum()),
                }
                for k, name in enumerate(finders.names)
            ],
        }
        if heard.position is not None:
            place, sigma = heard.position.position[0], heard.position.sigma[0]
            row |= {
                "east_m": float(place[0]),
                "east_sigma_m": float(sigma[0]),
                "north_m": float(place[1]),
                "north_sigma_m": float(sigma[1]),
                "pvalue": finite_or_none(float(np.ravel(heard.position.pvalue)[0])),
            }
        if heard.path is not None:
            sigma = np.sqrt(np.mean(heard.path.sigma**2, axis=1))
            row["path_sigma_m"] = float(np.median(sigma))
        rows.append(row)
    return rows


def finder_findings(finders: Finders) -> list[str]:
    """Return sentences that state the position of each emitter."""
    found = []
    for row in emitter_rows(finders):
        if row["moves"]:
            sigma = row.get("path_sigma_m")
            where = "" if sigma is None else f" along a path with a sigma of {text(sigma)} m"
            found.append(f"{row['emitter']} moves{where}.")
        elif "east_m" in row:
            east = plus_minus(row["east_m"], row["east_sigma_m"])
            north = plus_minus(row["north_m"], row["north_sigma_m"])
            found.append(f"{row['emitter']} is at east {east} m, north {north} m.")
    return found


def finder_tables(finders: Finders) -> list[Table]:
    """Return the tables of emitters and of their bearings."""
    return [_emitter_table(finders), _bearing_table(finders)] if finders.heard else []


def _emitter_table(finders: Finders) -> Table:
    rows = [
        {
            "emitter": row["emitter"],
            "moves": "yes" if row["moves"] else "no",
            "east": plus_minus(row.get("east_m"), row.get("east_sigma_m")),
            "north": plus_minus(row.get("north_m"), row.get("north_sigma_m")),
            "pvalue": row.get("pvalue"),
        }
        for row in emitter_rows(finders)
    ]
    columns = {
        "emitter": "emitter",
        "moves": "moves",
        "east": "east (m)",
        "north": "north (m)",
        "pvalue": "p-value",
    }
    caption = (
        "Positions estimated from the bearings of all direction finders; the sigma of each "
        "bearing is estimated from its record. A small p-value means that a bearing or a sigma is "
        "wrong."
    )
    values = [
        {name: value for name, value in row.items() if name != "bearings"}
        for row in emitter_rows(finders)
    ]
    return table("emitter-table", caption, columns, rows, values)


def _bearing_table(finders: Finders) -> Table:
    values = [
        {"emitter": row["emitter"], **one}
        for row in emitter_rows(finders)
        for one in row["bearings"]
    ]
    rows = [one | {"bearing": plus_minus(one["bearing_deg"], one["sigma_deg"])} for one in values]
    columns = {
        "emitter": "emitter",
        "station": "finder",
        "bearing": "bearing (°)",
        "count": "measured",
        "outliers": "outliers",
    }
    return table(
        "bearing-table",
        "Bearing of each direction finder, estimated by the default, robust method.",
        columns,
        rows,
        values,
    )


def finder_panels(finders: Finders, time: str) -> list[Panel]:
    """Return a map of bearings and positions for each emitter, and panels of bearings over time."""
    panels = []
    for number, heard in enumerate(finders.heard):
        panels += [
            _finder_map(finders, heard, number),
            _finder_bearings(finders, heard, number, time),
        ]
    return panels


def _finder_map(finders: Finders, heard: Heard, number: int) -> Panel:
    places = np.array([station.position[:2] for station in finders.stations])
    names = finders.names
    data: list[dict[str, Any]] = []
    centre = places.mean(axis=0)
    if heard.instants is not None:
        at = heard.instants.position[np.asarray(heard.instants.success)][:, :2]
        centre = np.median(at, axis=0)
        step = max(1, len(at) // POINTS)
        marker = {"color": GREY, "size": 4, "opacity": 0.6}
        data.append(dots("single instants", at[::step], marker))
    if heard.position is not None:
        centre = heard.position.position[0]
    if heard.path is not None:
        data += _path(heard.path)
    for k, (place, azimuth, sigma) in enumerate(
        zip(places, heard.bearing, heard.sigma, strict=True)
    ):
        if heard.moves or not np.isfinite(azimuth):
            continue
        reach = 1.25 * float(np.hypot(*(centre - place)))
        for off, dash, width in ((0.0, "solid", 1.5), (-1, "dot", 1), (1, "dot", 1)):
            angle = azimuth + off * SIDES * sigma
            end = place + reach * np.array([np.sin(angle), np.cos(angle)])
            more = {"legendgroup": names[k], "showlegend": off == 0.0, "hoverinfo": "skip"}
            east, north = np.array([place, end]).T / 1e3
            look = {"dash": dash, "width": width}
            data.append(line(names[k], east, north, k, line=look, **more))
    marker = {"size": 11, "color": GREY}
    data.append(triangles("direction finders", places, names, marker, "top center"))
    if heard.position is not None:
        place, spread = heard.position.position[0], heard.position.covariance[0]
        ring = ellipse(place, spread) / 1e3
        data.append(line("95 % ellipse", ring[:, 0], ring[:, 1], 7, line={"dash": "solid"}))
        marker = {"symbol": "cross", "size": 9, "color": COLOURS[1]}
        data.append(dots("position", place[np.newaxis], marker))
    layout = plane()
    caption = (
        "The bearings in the two halves of the record differ, so the emitter moves. The map shows "
        "its path with 95 % ellipses, and positions at single instants."
        if heard.moves
        else "Bearing of each direction finder with its 95 % band (dotted), and the position "
        "estimated from the bearings."
    )
    title = f"Position of {heard.emitter.name}"
    return Panel(f"emitter-{number}", title, caption, {"data": data, "layout": layout})


def _path(path: Trajectory) -> list[dict[str, Any]]:
    """Return the path of a moving emitter, and error ellipses along it."""
    known = np.flatnonzero(np.isfinite(path.position).all(axis=1))
    places = path.position[known[:: max(1, len(known) // POINTS)]] / 1e3
    chosen = known[np.unique(np.linspace(0, len(known) - 1, _ELLIPSES).astype(int))]
    rings = joined([ellipse(path.position[k], path.covariance[k]) / 1e3 for k in chosen])
    return [
        line("path", places[:, 0], places[:, 1], 1, line={"dash": "solid"}),
        line("95 % ellipses", rings[:, 0], rings[:, 1], 7, line={"dash": "solid", "width": 1}),
    ]


def _finder_bearings(finders: Finders, heard: Heard, number: int, time: str) -> Panel:
    data = []
    step = max(1, len(heard.emitter.time) // POINTS)
    for k, name in enumerate(finders.names):
        values = np.degrees(heard.emitter.azimuth[:, k])
        centre = np.degrees(heard.bearing[k])
        if not np.isfinite(centre):
            continue
        off = (values - centre + 180.0) % 360.0 - 180.0
        for wrong, mark in ((False, MARKS[k % len(MARKS)]), (True, "x-open")):
            own = (heard.outlier[:, k] == wrong) & np.isfinite(off)
            look = {"color": COLOURS[k % len(COLOURS)], "symbol": mark, "size": 9 if wrong else 5}
            more = {"legendgroup": name, "mode": "markers", "marker": look}
            label, time_of = f"{name}, outliers" if wrong else name, heard.emitter.time[own]
            data.append(line(label, time_of[::step], off[own][::step], k, **more))
    layout = rows_of(1, time, ["deviation from the estimate (°)"])
    layout["yaxis"]["rangemode"] = "normal"
    caption = (
        "Bearings minus the estimate of their direction finder. Crosses are outliers, which are "
        "left out of the estimate."
    )
    title = f"Bearings of {heard.emitter.name}"
    return Panel(f"bearings-{number}", title, caption, {"data": data, "layout": layout})
