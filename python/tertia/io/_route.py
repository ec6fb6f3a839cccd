"""Filed routes (field 15 of ICAO messages), and the tables of fixes and airways."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tertia._units import FLIGHT_LEVEL, KNOT, NAUTICAL_MILE
from tertia.geo import LocalFrame

# speeds: digits after the letter, and m/s per unit; a Mach number is converted at its level
_SPEEDS = {"K": (4, 1 / 3.6), "N": (4, KNOT)}
# levels: digits after the letter, and metres per unit: hundreds of feet, or tens of metres
_LEVELS = {"F": (3, FLIGHT_LEVEL), "A": (3, FLIGHT_LEVEL), "S": (4, 10.0), "M": (4, 10.0)}
_LEVEL = r"[FA]\d{3}|[SM]\d{4}|VFR"
_CRUISE = re.compile(rf"([KN]\d{{4}}|M\d{{3}})({_LEVEL})", re.ASCII)
# a cruise climb between two levels, or above a level
_CLIMB = re.compile(rf"C/([A-Z0-9]+)/([KN]\d{{4}}|M\d{{3}})({_LEVEL})(?:{_LEVEL}|PLUS)", re.ASCII)
_STAY = re.compile(r"STAY\d/(\d\d)(\d\d)", re.ASCII)
_PLACE = re.compile(r"(\d\d)(\d\d)?([NS])(\d{3})(\d\d)?([EW])", re.ASCII)
_FROM_FIX = re.compile(r"([A-Z0-9]{2,5}?)(\d{3})(\d{3})", re.ASCII)
_NAME = re.compile(r"[A-Z0-9]+", re.ASCII)
# changes of flight rules and of the type of traffic, a direct leg, a truncated route
_WORDS = {"VFR", "IFR", "GAT", "OAT", "DCT", "T"}
# speed of sound: sqrt(1.4 · 287.05287 T) in the standard atmosphere
_GAS, _SEA, _LAPSE, _TROPOPAUSE = 1.4 * 287.05287, 288.15, 0.0065, 11_000.0
_EARTH = 6_371_000.0
# largest distance in metres of a point that counts as on an airway; radials are in whole degrees,
# so points given by them are not exact
_ON_AIRWAY = 5 * NAUTICAL_MILE

# name, latitude, longitude, declination in degrees
_FIXES = ("name", "latitude_deg", "longitude_deg")
_AIRWAYS = ("airway", "sequence", "fix")


@dataclass(frozen=True, slots=True)
class Place:
    """A point of a route, in degrees; `declination` is the declination of radials from it."""

    name: str
    latitude: float
    longitude: float
    declination: float = 0.0

    @property
    def direction(self) -> tuple[float, float, float]:
        """The unit vector from the centre of the earth."""
        phi, lam = math.radians(self.latitude), math.radians(self.longitude)
        return math.cos(phi) * math.cos(lam), math.cos(phi) * math.sin(lam), math.sin(phi)

    def is_at(self, other: Place) -> bool:
        """Return whether another place is the same point."""
        return (self.latitude, self.longitude) == (other.latitude, other.longitude)


@dataclass(slots=True)
class Point:
    """A waypoint; from here on, the speed (m/s), level (m, nan for VFR) and delay (s) hold."""

    place: Place
    speed: float
    level: float
    delay: float = 0.0


class Tables:
    """Fixes and airways."""

    def __init__(self, fixes: Any, airways: Any) -> None:
        self.fixes = _fixes(fixes)
        self.airways = _airways(airways)

    def is_airway(self, name: str) -> bool:
        """Return whether a name is that of an airway and not that of a fix."""
        return name in self.airways and name not in self.fixes

    def place(self, token: str, near: Place | None) -> Place | None:
        """Return the point that a token denotes; of several fixes, the one nearest to `near`."""
        if token in self.fixes:
            return _nearest(self.fixes[token], near)
        if found := _PLACE.fullmatch(token):
            return _of_degrees(token, found)
        found = _FROM_FIX.fullmatch(token)
        if found is None or found[1] not in self.fixes:
            return None
        radial, distance = int(found[2]), int(found[3])
        if radial > 360:
            raise ValueError(f"{token!r} has the radial {radial}; it must be at most 360")
        return _from(_nearest(self.fixes[found[1]], near), radial, distance * NAUTICAL_MILE, token)

    def along(self, airway: str, start: Place, end: str) -> list[Place]:
        """Return the points of an airway after one place, up to another."""
        names, goal = self.airways[airway], self.place(end, start)
        first, last = self._on(airway, start), self._on(airway, goal)
        if goal is None or first is None or last is None:
            raise ValueError(f"airway {airway!r} does not connect {start.name!r} and {end!r}")
        between = (
            range(math.floor(first) + 1, math.floor(last) + 1)
            if last >= first
            else range(math.ceil(first) - 1, math.ceil(last) - 1, -1)
        )
        places: list[Place] = []
        for name in (names[at] for at in between):
            place = self.place(name, places[-1] if places else start)
            if place is None:
                raise ValueError(f"airway {airway!r} has {name!r}, which is not a fix")
            places.append(place)
        return places if end in names else [*places, goal]

    def crossing(self, airway: str, other: str, here: Place) -> str:
        """Return the first fix after a place that two airways have in common."""
        common = [name for name in self.airways[airway] if name in self.airways[other]]
        first = self._on(airway, here)
        if first is None or not common:
            raise ValueError(f"airway {airway!r} does not connect {here.name!r} and {other!r}")
        return min(common, key=lambda name: abs(self.airways[airway].index(name) - first))

    def _on(self, airway: str, place: Place | None) -> float | None:
        """Return the index of a place on an airway, plus a half if it is between two fixes."""
        names = self.airways[airway]
        if place is None or place.name in names:
            return None if place is None else names.index(place.name)
        known = [self.place(name, place) for name in names]
        found = [
            (_EARTH * _from_line(place, a, b), at + 0.5)
            for at, (a, b) in enumerate(pairwise(known))
            if a is not None and b is not None
        ]
        distance, at = min(found, default=(math.inf, 0.0))
        return at if distance < _ON_AIRWAY and place.name not in self.fixes else None


def cruise_of(token: str) -> tuple[float, float]:
    """Return true airspeed (m/s) and level (m, nan for VFR) of a token like N0450F350."""
    found = _CRUISE.fullmatch(token)
    if found is None:
        raise ValueError(f"{token!r} is not a speed and level, such as N0450F350")
    level = math.nan
    if found[2] != "VFR":
        level = int(found[2][1:]) * _LEVELS[found[2][0]][1]
    kind, number = found[1][0], int(found[1][1:])
    if kind != "M":
        speed = number * _SPEEDS[kind][1]
    elif math.isnan(level):
        raise ValueError(f"{token!r} has a Mach number, but no level")
    else:
        temperature = _SEA - _LAPSE * min(level, _TROPOPAUSE)
        speed = number / 100 * math.sqrt(_GAS * temperature)
    if speed == 0.0:
        raise ValueError(f"{token!r} has no speed")
    return speed, level


class Route:
    """A route as far as it has been read: its points, and the unknown procedures."""

    def __init__(self, start: Place, cruise: tuple[float, float], tables: Tables) -> None:
        self.cruise = cruise
        self.points = [Point(start, *cruise)]
        self.unknown: list[str] = []
        self._tables = tables
        self._airway: str | None = None

    def read(self, token: str, *, is_outer: bool) -> None:
        """Read one more token; the first and the last token may be unknown."""
        if stay := _STAY.fullmatch(token):
            self.points[-1].delay += 3600.0 * int(stay[1]) + 60.0 * int(stay[2])
            return
        name, cruise = _changed(token)
        if self._tables.is_airway(name) and cruise is None:
            if self._airway is not None:
                # two airways in succession have a common fix
                there = self._tables.crossing(self._airway, name, self.points[-1].place)
                self._go(self._places(there))
            self._airway = name
            return
        places = self._places(name)
        if not places:
            if cruise is not None or not is_outer or not _NAME.fullmatch(token):
                raise ValueError(f"{token!r} is neither a fix nor an airway nor a place")
            self.unknown.append(token)
        self._go(places)
        if cruise is not None:
            self.cruise = self.points[-1].speed, self.points[-1].level = cruise

    def end(self) -> None:
        """Raise an error if the route ends on an airway instead of at a fix."""
        if self._airway is not None:
            raise ValueError(
                f"airway {self._airway!r} is at the end of the route; it must lead to a fix"
            )

    def _go(self, places: Sequence[Place]) -> None:
        self.points += [Point(place, *self.cruise) for place in places]

    def _places(self, name: str) -> list[Place]:
        here, airway = self.points[-1].place, self._airway
        if airway is not None:
            self._airway = None
            return self._tables.along(airway, here, name)
        place = self._tables.place(name, here)
        return [] if place is None else [place]


def route_of(text: str, start: Place, tables: Tables) -> Route:
    """Return the route given in field 15."""
    tokens = text.split()
    if not tokens:
        raise ValueError("there is no route")
    if "T" in tokens[:-1]:
        raise ValueError("'T' is not at the end of the route")
    route = Route(start, cruise_of(tokens[0]), tables)
    for at, token in enumerate(tokens[1:], start=1):
        if token not in _WORDS:
            route.read(token, is_outer=at in {1, len(tokens) - 1})
    route.end()
    return route


def _changed(token: str) -> tuple[str, tuple[float, float] | None]:
    """Return the name in a token, and the speed and level if they change there."""
    if climb := _CLIMB.fullmatch(token):
        return climb[1], cruise_of(climb[2] + climb[3])
    name, slash, cruise = token.partition("/")
    return name, (cruise_of(cruise) if slash else None)


def _of_degrees(token: str, found: re.Match[str]) -> Place:
    """Return the place given by a token like 4620N07805W or 46N078W."""
    if (found[2] is None) != (found[5] is None):
        raise ValueError(f"{token!r} has minutes in only one of its coordinates")
    minutes = [int(found[2] or 0), int(found[5] or 0)]
    latitude = int(found[1]) + minutes[0] / 60
    longitude = int(found[4]) + minutes[1] / 60
    if max(minutes) >= 60 or latitude > 90 or longitude > 180:
        raise ValueError(f"{token!r} is not a place on the earth")
    south, west = found[3] == "S", found[6] == "W"
    return Place(token, -latitude if south else latitude, -longitude if west else longitude)


def _from(fix: Place, radial: float, distance: float, name: str) -> Place:
    """Return the place at a distance in metres on a radial of a fix, along the ellipsoid."""
    if distance == 0.0:
        return fix
    chord = 2.0 * _EARTH * math.sin(0.5 * distance / _EARTH)
    azimuth = math.radians(radial + fix.declination)
    frame = LocalFrame(fix.latitude, fix.longitude)
    latitude, longitude, _ = frame.polar_to_geodetic(chord, azimuth, 0.0)
    return Place(name, float(latitude), float(longitude))


def _from_line(place: Place, start: Place, end: Place) -> float:
    """Return the approximate angle between a place and the arc between two other places."""
    p, a, b = (np.array(one.direction) for one in (place, start, end))
    along = b - a
    share = float(np.clip((p - a) @ along / max(along @ along, 1e-30), 0.0, 1.0))
    foot = a + share * along
    return float(np.linalg.norm(p - foot / np.linalg.norm(foot)))


def _nearest(places: Sequence[Place], near: Place | None) -> Place:
    """Return the place nearest to another place; the first one if that is missing."""
    if near is None:
        return places[0]
    there = near.direction
    return min(places, key=lambda place: math.dist(place.direction, there))


def _fixes(fixes: Any) -> dict[str, list[Place]]:
    """Return the places with each name."""
    known: dict[str, list[Place]] = {}
    for name, *numbers in _fix_rows(fixes):
        try:
            latitude, longitude, *more = map(float, numbers)
        except (TypeError, ValueError):
            raise ValueError(f"fix {name!r} is at {numbers!r}; it must be in degrees") from None
        declination = more[0] if more else 0.0
        if not (abs(latitude) <= 90 and abs(longitude) <= 180 and abs(declination) <= 180):
            raise ValueError(f"fix {name!r} is at {latitude:g}, {longitude:g}; is that in degrees?")
        known.setdefault(str(name), []).append(Place(str(name), latitude, longitude, declination))
    return known


def _fix_rows(fixes: Any) -> Iterator[Sequence[Any]]:
    if isinstance(fixes, (str, Path)) and Path(fixes).suffix.lower() in {".json", ".geojson"}:
        yield from _geojson(Path(fixes))
        return
    columns = table_columns(fixes, _FIXES, "fixes", ("declination_deg",))
    if columns is not None:
        yield from zip(*columns.values(), strict=True)
        return
    for name, value in fixes.items():
        several = len(value) > 0 and not isinstance(value[0], (int, float))
        for place in value if several else [value]:
            yield name, *place


def _airways(airways: Any) -> dict[str, list[str]]:
    """Return the names of the fixes of each airway, in order."""
    columns = table_columns(airways, _AIRWAYS, "airways")
    if columns is None:
        return {str(name): [str(fix) for fix in along] for name, along in airways.items()}
    rows: dict[str, list[tuple[float, str]]] = {}
    for airway, sequence, fix in zip(*columns.values(), strict=True):
        rows.setdefault(str(airway), []).append((float(sequence), str(fix)))
    return {name: [fix for _, fix in sorted(along)] for name, along in rows.items()}


def table_columns(
    table: Any, required: Sequence[str], what: str, optional: Sequence[str] = ()
) -> dict[str, list[Any]] | None:
    """Return the columns of a table or CSV file by their names; None for another mapping."""
    if isinstance(table, (str, Path)):
        table = read_csv(table)
    there = getattr(table, "columns", None)
    if there is None:
        if isinstance(table, Mapping):
            return None
        raise TypeError(f"{what} is {table!r}; it must be a mapping, a table or a CSV file")
    if missing := [name for name in required if name not in there]:
        raise ValueError(f"{what} has no column {missing[0]}")
    names = [*required, *(name for name in optional if name in there)]
    return {name: np.asarray(table[name]).tolist() for name in names}


def _geojson(path: Path) -> Iterator[Sequence[Any]]:
    """Yield name, latitude, longitude and declination of the points of a FeatureCollection."""
    try:
        for feature in json.loads(path.read_bytes())["features"]:
            properties, geometry = feature["properties"], feature["geometry"]
            if geometry["type"] != "Point":
                raise ValueError(f"it has a {geometry['type']}; fixes must be Points")
            longitude, latitude, *_ = geometry["coordinates"]
            yield properties["name"], latitude, longitude, properties.get("declination_deg", 0.0)
    except (KeyError, RecursionError, TypeError, ValueError) as error:
        raise ValueError(f"cannot read {path}: {error}") from None


def read_csv(path: str | Path, **options: Any) -> Any:
    """Return a CSV file as a table of Polars."""
    try:
        import polars as pl  # noqa: PLC0415  # only here is Polars needed
    except ImportError as error:
        raise ImportError("CSV needs Polars: pip install 'tertia[io]'") from error
    try:
        return pl.read_csv(path, glob=False, **options)
    except pl.exceptions.PolarsError as error:
        raise ValueError(f"cannot read {path}: {str(error).splitlines()[0]}") from None
