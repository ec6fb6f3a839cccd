"""Places in a file: in metres east, north and up, or in latitude and longitude."""

import math
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tertia._arrays import FloatArray
from tertia.cli import _tables
from tertia.cli._terminal import WRONG_USAGE, fail

if TYPE_CHECKING:
    from tertia.geo import LocalFrame

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

Row: TypeAlias = Mapping[str, Any]

LOCAL = ("east_m", "north_m", "up_m")
GEODETIC = ("latitude_deg", "longitude_deg", "height_m")
_DOMAINS = {"latitude_deg": (-90, 90), "longitude_deg": (-180, 360)}
_ORIGIN = "origin"
# in metres; so far from the origin azimuths in the plane are 0.4 degrees wrong
_REACH_OF_A_PLANE = 1e6


@dataclass(frozen=True, slots=True)
class Places:
    """Where the stations or radars of a file are, in metres.

    Positions are (K, D). Those given in latitude and longitude have a frame, and in `axes`,
    (K, D, D), the east, north and up of each place; otherwise both are None.
    """

    positions: FloatArray
    axes: FloatArray | None = None
    frame: "LocalFrame | None" = None

    @property
    def height_column(self) -> str:
        """The column of heights in files of this form."""
        return LOCAL[2] if self.frame is None else GEODETIC[2]

    def geodetic(self, position: FloatArray) -> dict[str, FloatArray]:
        """Return latitude, longitude and in space height of positions, (N, D), by column.

        Positions in the plane are on the ellipsoid; nan where a position is none on the earth.
        Without a frame there are no columns.
        """
        if self.frame is None:
            return {}
        if position.shape[1] == len(LOCAL):
            told = map(np.asarray, self.frame.to_geodetic(position))
            return dict(zip(GEODETIC, told, strict=True))
        return dict(zip(GEODETIC, _on_the_ellipsoid(self.frame, position), strict=False))

    def origin(self) -> str | None:
        """Return where the origin is, in words; None where nobody knows."""
        if self.frame is None:
            return None
        told = f"latitude {self.frame.latitude:.10g}, longitude {self.frame.longitude:.10g}"
        if self.positions.shape[1] < len(LOCAL):
            return f"origin of east and north: {told}"
        return f"origin of east, north and up: {told}, height {self.frame.height:.10g} m"


def named_rows(path: Path, noun: str) -> tuple[dict[str, Row], Row | None]:
    """Return the tables `[[noun]]` of TOML, or the rows of a table, by their names.

    Beside them stands the table `[origin]` of TOML.
    """
    rows, origin = (
        _rows_of_toml(path, noun)
        if path.suffix.lower() == ".toml"
        else (_rows_of_table(path), None)
    )
    if not rows:
        fail(f"{path} has no {noun}s")
    names = [_name(row, f"{noun} {at}", path) for at, row in enumerate(rows, start=1)]
    for at, name in enumerate(names):
        if name in names[:at]:
            fail(f"{path} has two {noun}s {name}")
    return dict(zip(names, rows, strict=True)), origin


def _rows_of_toml(path: Path, noun: str) -> tuple[list[Row], Row | None]:
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        fail(f"there is no file {path}", WRONG_USAGE)
    except OSError as error:
        fail(f"cannot read {path}: {error.strerror}")
    except ValueError as error:
        # also what is no UTF-8
        fail(f"cannot read {path}: {error}")
    rows, origin = document.get(noun, []), document.get(_ORIGIN)
    if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
        fail(f"{path}: {noun} is no list of tables; each must begin with [[{noun}]]")
    if origin is not None and not isinstance(origin, Mapping):
        fail(f"{path}: {_ORIGIN} is no table; it must begin with [{_ORIGIN}]")
    return rows, origin


def _rows_of_table(path: Path) -> list[Row]:
    frame = _tables.read(path, ["name"])
    return list(frame.filter(_tables.is_row(frame, path)).iter_rows(named=True))


def _name(row: Row, which: str, path: Path) -> str:
    name = row.get("name")
    if name is None or not str(name).strip():
        fail(f"{path}: {which} has no name")
    return str(name).strip()


def places(rows: Mapping[str, Row], origin: Row | None, path: Path) -> Places:
    """Return where the rows are, in the plane, or in space if any of them has a height.

    Of latitudes and longitudes the frame is at the origin, by default at the first row.
    """
    local, geodetic = (_first_given(rows, form, path) for form in (LOCAL, GEODETIC))
    if local and geodetic:
        fail(f"{path} has {local} and {geodetic}; all places must be given in the same form")
    if geodetic:
        return _on_the_earth(rows, origin, path)
    if origin is not None:
        fail(f"{path}: [{_ORIGIN}] needs places with {GEODETIC[0]} and {GEODETIC[1]}")
    return Places(_coordinates(rows, LOCAL, path))


def _first_given(rows: Mapping[str, Row], form: Iterable[str], path: Path) -> str | None:
    """Return which coordinate of this form is given first, and of whom."""
    given = (
        f"{column} of {name}"
        for name, row in rows.items()
        for column in form
        if number(row, column, name, path) is not None
    )
    return next(given, None)


def _coordinates(rows: Mapping[str, Row], form: tuple[str, str, str], path: Path) -> FloatArray:
    """Return the coordinates, (K, 2), or (K, 3) if any row has a height."""
    in_space = any(number(row, form[2], name, path) is not None for name, row in rows.items())
    columns = form if in_space else form[:2]
    return np.array(
        [[required(row, column, name, path) for column in columns] for name, row in rows.items()]
    )


def _on_the_earth(rows: Mapping[str, Row], origin: Row | None, path: Path) -> Places:
    if find_spec("pyproj") is None:
        fail(f"{path}: {GEODETIC[0]} needs the extra geo: pip install 'tertia[geo]'")
    from tertia.geo import LocalFrame  # noqa: PLC0415  # only here is pyproj needed

    given = _coordinates(rows, GEODETIC, path)
    at = given[0] if origin is None else _coordinates({"the origin": origin}, GEODETIC, path)[0]
    if at.size > given.shape[1]:
        fail(f"{path}: the origin has {GEODETIC[2]}, but no place has")
    frame = LocalFrame(*at)
    stations = [frame.station(*place) for place in given]
    positions = np.array([station.position for station in stations])
    axes = np.array([station.axes for station in stations])
    if given.shape[1] == len(GEODETIC):
        return Places(positions, axes, frame)
    for name, distance in zip(rows, np.linalg.norm(positions, axis=1), strict=True):
        if distance > _REACH_OF_A_PLANE:
            fail(
                f"{path}: {name} is {distance / 1e3:.0f} km from the origin; places in a plane, "
                f"without {GEODETIC[2]}, must be within {_REACH_OF_A_PLANE / 1e3:.0f} km"
            )
    return Places(positions[:, :2], _in_the_plane(axes), frame)


def _in_the_plane(axes: FloatArray) -> FloatArray:
    """Return the rotations about the vertical that are nearest to axes, (K, 2, 2)."""
    angle = np.arctan2(axes[:, 0, 1] - axes[:, 1, 0], axes[:, 0, 0] + axes[:, 1, 1])
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([cosine, sine, -sine, cosine], axis=-1).reshape(-1, 2, 2)


def _on_the_ellipsoid(frame: "LocalFrame", position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return latitude and longitude of what lies below or above positions in the plane."""
    from pyproj import Proj  # noqa: PLC0415  # only here is pyproj needed

    # east and north of a place on the ellipsoid are its orthographic projection
    plane = Proj(proj="ortho", lat_0=frame.latitude, lon_0=frame.longitude, ellps="WGS84")
    longitude, latitude = plane(position[:, 0], position[:, 1], inverse=True)
    there = np.isfinite(longitude)
    return np.where(there, latitude, np.nan), np.where(there, longitude, np.nan)


def required(row: Row, column: str, name: str, path: Path) -> float:
    """Return a number that must be there."""
    found = number(row, column, name, path)
    if found is None:
        fail(f"{path}: {column} of {name} is missing")
    return found


def number(row: Row, column: str, name: str, path: Path) -> float | None:
    """Return a number of a row, None where it is missing."""
    value = row.get(column)
    if value is None or _tables.is_mark(str(value)):
        return None
    try:
        found = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        found = math.nan
    if not math.isfinite(found):
        fail(f"{path}: {column} of {name} is {value!r}; it must be a finite number")
    low, high = _DOMAINS.get(column, (-math.inf, math.inf))
    if not low <= found <= high:
        fail(f"{path}: {column} of {name} is {found:g}; it must be between {low} and {high}")
    return found
