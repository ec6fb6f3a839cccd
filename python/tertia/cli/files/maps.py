"""Writing of tracks and positions for maps, as GeoJSON and KML."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
import polars as pl
import typer

from tertia._arrays import FloatArray
from tertia._result import counted
from tertia.cli.files.write import write_text
from tertia.cli.terminal.say import WRONG_USAGE, fail
from tertia.tables._sensors import GEODETIC, Sensors

GEOJSON, KML = SUFFIXES = (".geojson", ".kml")
# date of time 0 in KML, which has no times without dates
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
# digits after the decimal point of degrees (1 mm) and of heights in metres
_DIGITS, _HEIGHT_DIGITS = 8, 3
# colour of areas: opacity, blue, green, red
_PALE = "60ff9933"


@dataclass(frozen=True, slots=True)
class Feature:
    """A line over time, or the position at an instant, with its properties.

    `times` are dates or seconds; `places` are longitudes, latitudes and optionally heights, (N, 2)
    or (N, 3).
    """

    name: str
    times: Sequence[datetime | float]
    places: FloatArray
    properties: Mapping[str, Any]

    @property
    def has_heights(self) -> bool:
        """Whether the places have heights."""
        return int(self.places.shape[1]) > 2

    def coordinates(self, *, unwrapped: bool) -> list[list[float]]:
        """Return the places in the order of files; `unwrapped` avoids a jump at 180 degrees."""
        places = self.places.copy()
        if unwrapped:
            places[:, 0] = np.unwrap(places[:, 0], period=360.0)
        return [
            [*(round(x, _DIGITS) for x in row[:2]), *(round(x, _HEIGHT_DIGITS) for x in row[2:])]
            for row in places.tolist()
        ]


@dataclass(frozen=True, slots=True)
class Shape:
    """A line, or the parts of a region, each an outline and its holes, with its properties.

    Outlines are longitudes and latitudes, (N, 2); a line is one part with one outline.
    """

    name: str
    parts: Sequence[Sequence[FloatArray]]
    properties: Mapping[str, Any]
    is_line: bool = False

    def coordinates(self) -> list[list[list[list[float]]]]:
        """Return the places of each ring of each part, without a jump at 180 degrees."""
        return [[_unwrapped(ring, closed=not self.is_line) for ring in part] for part in self.parts]


def _unwrapped(ring: FloatArray, *, closed: bool) -> list[list[float]]:
    places = np.vstack([ring, ring[:1]]) if closed else ring.copy()
    places[:, 0] = np.unwrap(places[:, 0], period=360.0)
    return [[round(x, _DIGITS) for x in row] for row in places.tolist()]


def is_map(path: Path | None) -> TypeGuard[Path]:
    """Return whether a result is written for a map."""
    return path is not None and path.suffix.lower() in SUFFIXES


def check(output: Path | None, sensors: Sensors[Any]) -> None:
    """Exit with an error, before any processing, if positions have no latitude and longitude."""
    if not is_map(output):
        return
    if sensors.frame is None:
        fail(
            f"cannot write {output}: positions are only local: give {GEODETIC[0]} and "
            f"{GEODETIC[1]} in {sensors.file}",
            WRONG_USAGE,
        )
    if output.suffix.lower() == KML and find_spec("simplekml") is None:
        fail(f"{output} needs the extra kml: pip install 'tertia[kml]'")


def feature(rows: pl.DataFrame, name: str, properties: Mapping[str, Any]) -> Feature | None:
    """Return the line through the rows in order of time, or None if there is no position.

    Unknown heights are replaced by the nearest known ones in time.
    """
    rows = rows.drop_nulls(list(GEODETIC[:2])).sort("time_s", maintain_order=True)
    if rows.is_empty():
        return None
    columns = [GEODETIC[1], GEODETIC[0]]
    if GEODETIC[2] in rows.columns and rows[GEODETIC[2]].count():
        filled = pl.col(GEODETIC[2]).fill_null(strategy="forward").fill_null(strategy="backward")
        rows = rows.with_columns(filled)
        columns.append(GEODETIC[2])
    return Feature(name, rows["time_s"].to_list(), rows.select(columns).to_numpy(), properties)


def write(
    features: Sequence[Feature | None], path: Path, noun: str, shapes: Sequence[Shape] = ()
) -> None:
    """Write lines, points and regions in the format of the file name, and print a note."""
    there = [one for one in features if one is not None]
    writers: dict[str, Callable[[Sequence[Feature], Sequence[Shape]], str]] = {
        GEOJSON: _geojson,
        KML: _kml,
    }
    text = writers[path.suffix.lower()](there, shapes)
    write_text(text, path)
    typer.echo(f"wrote {counted(len(there), noun)} to {path}")


def _geojson(features: Sequence[Feature], shapes: Sequence[Shape]) -> str:
    document = {
        "type": "FeatureCollection",
        "features": [*map(_geojson_feature, features), *map(_geojson_shape, shapes)],
    }
    return json.dumps(document, ensure_ascii=False, allow_nan=False, indent=1) + "\n"


def _geojson_feature(one: Feature) -> dict[str, Any]:
    coordinates, times = one.coordinates(unwrapped=True), [_plain(time) for time in one.times]
    if len(times) > 1:
        return _geojson_object(one, "LineString", coordinates, times=times)
    return _geojson_object(one, "Point", coordinates[0], times=times)


def _geojson_shape(one: Shape) -> dict[str, Any]:
    coordinates = one.coordinates()
    if one.is_line:
        return _geojson_object(one, "LineString", coordinates[0][0])
    return _geojson_object(one, "MultiPolygon", coordinates)


def _geojson_object(
    one: Feature | Shape, kind: str, coordinates: Sequence[Any], **more: Any
) -> dict[str, Any]:
    properties = {name: _plain(value) for name, value in one.properties.items()}
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": {"name": one.name, **properties, **more},
    }


def _plain(value: Any) -> Any:
    """Convert a value to a JSON type."""
    if isinstance(value, datetime):
        return value.isoformat().replace("+00:00", "Z")
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _kml(features: Sequence[Feature], shapes: Sequence[Shape]) -> str:
    simplekml = import_module("simplekml")
    document = simplekml.Kml()
    modes = simplekml.AltitudeMode
    for one in features:
        mode = modes.absolute if one.has_heights else modes.clamptoground
        moments = [_moment(time) for time in one.times]
        coordinates = one.coordinates(unwrapped=False)
        if len(moments) > 1:
            placemark = document.newgxtrack(name=one.name, altitudemode=mode)
            placemark.newwhen(moments)
            placemark.newgxcoord(coordinates)
        else:
            placemark = document.newpoint(name=one.name, coords=coordinates, altitudemode=mode)
            placemark.timestamp.when = moments[0]
        _say_properties(placemark, one.properties)
    for shape in shapes:
        for outline, *holes in shape.coordinates():
            if shape.is_line:
                placemark = document.newlinestring(name=shape.name, coords=outline, tessellate=1)
            else:
                placemark = document.newpolygon(
                    name=shape.name, outerboundaryis=outline, innerboundaryis=holes
                )
                placemark.style.polystyle.color = _PALE
            _say_properties(placemark, shape.properties)
    return str(document.kml())


def _say_properties(placemark: Any, properties: Mapping[str, Any]) -> None:
    for name, value in properties.items():
        if (cell := _plain(value)) is not None:
            placemark.extendeddata.newdata(name=name, value=str(cell))


def _moment(time: datetime | float) -> str:
    """Return a time in the format of KML."""
    moment = time if isinstance(time, datetime) else _EPOCH + timedelta(seconds=float(time))
    return moment.replace(tzinfo=None).isoformat(timespec="milliseconds") + "Z"
