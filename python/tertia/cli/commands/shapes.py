"""Shapes on a map in addition to positions: their regions, and lines of bearing."""

from collections.abc import Iterator

import numpy as np

from tertia._arrays import FloatArray
from tertia.cli.files.maps import Shape
from tertia.location import Location
from tertia.location._region import Polygon, crossings
from tertia.sensors import Station
from tertia.tables._positions import Located, Positions
from tertia.tables._sensors import GEODETIC, Sensors

# lines are extended beyond the target by this share of its distance
_BEHIND = 0.2


def of(found: Positions[Location], probability: float | None) -> list[Shape]:
    """Return the regions, and for targets with one position the lines of bearing."""
    shapes: list[Shape] = []
    for one in found.targets:
        if one.target.times.size == 1:
            shapes += _bearings(one, found.stations)
        if probability is not None:
            shapes += _regions(one, found.stations, probability)
    return shapes


def _regions(
    one: Located[Location], stations: Sensors[Station], probability: float
) -> Iterator[Shape]:
    polygon = one.result.region(probability).polygon
    polygons = [polygon] if isinstance(polygon, tuple) else list(polygon)
    for moment, rings in zip(one.target.moments, polygons, strict=True):
        parts = [[_on_earth(ring, stations) for ring in part] for part in _parts(rings)]
        if parts:
            name = " ".join(filter(None, [one.target.name, f"{probability:.0%}"]))
            yield Shape(name, parts, {"time": moment, "probability": probability})


def _parts(polygon: Polygon) -> list[list[FloatArray]]:
    """Return outlines, each with its holes."""
    parts = [[ring] for ring in polygon if _area(ring) > 0]
    for hole in polygon:
        if _area(hole) <= 0:
            around = (part for part in parts if crossings(part[0], hole[0]) % 2)
            next(around, []).append(hole)
    return parts


def _area(ring: FloatArray) -> float:
    """Return the area of a ring; negative if it is clockwise."""
    (x, y), (u, v) = ring.T, np.roll(ring, -1, axis=0).T
    return float(np.sum(x * v - u * y)) / 2


def _bearings(one: Located[Location], stations: Sensors[Station]) -> Iterator[Shape]:
    if "azimuth" not in one.target.values:
        return
    azimuths, outliers = one.target.values["azimuth"][0], one.result.outlier.azimuth
    places = one.result.position[..., :2].reshape(-1)
    for k, station in enumerate(one.target.sensors.items):
        if np.isnan(azimuths[k]) or np.isnan(places).any():
            continue
        # a moving station has a position for each instant; here there is one instant
        begin = station.position.reshape(-1, stations.dimension)[0, :2]
        along = np.array([np.sin(azimuths[k]), np.cos(azimuths[k])])
        if station.axes is not None:
            axes = station.axes.reshape(-1, stations.dimension, stations.dimension)[0]
            along = along @ axes[:2, :2]
        end = begin + (1 + _BEHIND) * np.linalg.norm(places - begin) * along
        is_outlier = outliers is not None and bool(np.reshape(outliers, -1)[k])
        properties = {
            "sensor": one.target.sensors.names[k],
            "azimuth_deg": float(np.degrees(azimuths[k]) % 360.0),
            "outlier": is_outlier,
        }
        name = " ".join(filter(None, [one.target.name, one.target.sensors.names[k]]))
        line = _on_earth(np.array([begin, end]), stations)
        yield Shape(name, [[line]], properties, is_line=True)


def _on_earth(places: FloatArray, stations: Sensors[Station]) -> FloatArray:
    """Return longitudes and latitudes of places in the plane."""
    up = np.full((len(places), stations.dimension - 2), np.nan)
    found = stations.geodetic(np.hstack([places, up]))
    return np.column_stack([found[GEODETIC[1]].to_numpy(), found[GEODETIC[0]].to_numpy()])
