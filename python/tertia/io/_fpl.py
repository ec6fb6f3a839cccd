"""Flight plans from ICAO messages (FPL)."""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, finite, real
from tertia.flightplan import FlightPlan
from tertia.geo import LocalFrame, SystemPlane
from tertia.io._route import Place, Point, Tables, route_of, table_columns

__all__ = ["FiledPlan", "read_fpl"]

_MESSAGE = re.compile(r"\(([^()]*)\)")
_CALLSIGN = re.compile(r"([A-Z0-9]{1,7})(?:/A([0-7]{4}))?", re.ASCII)
_TYPE = re.compile(r"\d{0,2}([A-Z][A-Z0-9]{1,3})/[A-Z]", re.ASCII)
_PLACE_AND_TIME = re.compile(r"([A-Z0-9]{4})(\d\d)(\d\d)", re.ASCII)
_ELAPSED = re.compile(r"([A-Z0-9]{4})(\d\d)(\d\d)((?: [A-Z0-9]{4}){0,2})", re.ASCII)
_KEY = re.compile(r"(?:^| )([A-Z]{3,4}|STAYINFO\d)/", re.ASCII)
_SUPPLEMENT = re.compile(r"-\s*[A-Z]/.*$", re.DOTALL)
_FIELDS = ("3", "7", "8", "9", "10", "13", "15", "16")
# rate of climb for aircraft of unknown type in m/s: the rate of a slow airliner
_CLIMB = 5.0
# the largest rate of turn, degrees a second, as in `FlightPlan`
_TURN_RATE = 3.0
_TYPE_COLUMNS = ("bank_deg", "turn_rate_deg_s", "climb_m_s")


@dataclass(frozen=True, slots=True, eq=False, init=False, repr=False)
class FiledPlan(FlightPlan):
    """A flight plan, with the other information in its message.

    Attributes
    ----------
    names : tuple of str
        Names of the waypoints, as in the message or the airway.
    levels : ndarray of shape (N,)
        Filed level from each waypoint on, as pressure altitude in metres; nan for VFR.
    airspeeds : ndarray of shape (N - 1,)
        True airspeed on each leg in m/s.
    aircraft_type, departure, destination : str
        As filed.
    off_block_time, elapsed_time : float
        Off-block time in seconds after midnight of the day of flight, and time from take-off to the
        destination in seconds.
    date : datetime.date or None
        The day of flight.
    unknown_procedures : tuple of str
        Departure and arrival procedures that are unknown and therefore not part of the plan.
    fields : dict of str to str
        Other information (field 18) by its keys.
    """

    names: tuple[str, ...]
    levels: FloatArray
    airspeeds: FloatArray
    aircraft_type: str
    departure: str
    destination: str
    off_block_time: float
    elapsed_time: float
    date: datetime.date | None
    unknown_procedures: tuple[str, ...]
    fields: dict[str, str]


@dataclass(frozen=True, slots=True)
class _Options:
    tables: Tables
    frame: LocalFrame | SystemPlane
    types: dict[str, dict[str, float]]
    winds: FloatArray
    taxi_time: float


def read_fpl(
    text: str | Path,
    *,
    fixes: Any,
    airways: Any,
    frame: LocalFrame | SystemPlane,
    types: Any = None,
    winds: npt.ArrayLike | None = None,
    taxi_time: float = 900.0,
) -> list[FiledPlan]:
    """Read flight plans from ICAO FPL messages.

    Parameters
    ----------
    text : str or Path
        The messages, or the path of a file that contains them. Text outside parentheses is ignored.
    fixes : mapping, table or path of a CSV or GeoJSON file
        Aerodromes, navigation aids and waypoints. Either a mapping from names to (latitude,
        longitude) or (latitude, longitude, declination) in degrees, or to a list of these; or a
        table with the columns `name`, `latitude_deg`, `longitude_deg`, and optionally
        `declination_deg`; or GeoJSON Points with the properties `name` and `declination_deg`. If a
        name has several places, the one nearest to the previous point is taken. Radials are
        magnetic: the declination is added to them.
    airways : mapping, table or path of a CSV file
        A mapping from names to the names of fixes in order, or a table with the columns `airway`,
        `sequence`, `fix`. Airways can be flown in both directions.
    frame : tertia.geo.LocalFrame or SystemPlane
        Local coordinates of the plans.
    types : mapping, table or path of a CSV file, optional
        Properties of aircraft types: a mapping from types to bank angles in radians, or a table
        with the column `aircraft_type` and any of `bank_deg`, `turn_rate_deg_s`, `climb_m_s`. The
        library contains no such table.
    winds : array_like of shape (2,) or (L, 3), optional
        Velocity of the air, east and north in m/s, of shape (2,); or rows of height in metres, east
        and north, with increasing heights, of shape (L, 3). Without winds, ground speeds are equal
        to the filed true airspeeds.
    taxi_time : float
        Time from off-block to departure in seconds.

    Returns
    -------
    list of FiledPlan
        Flight plans in the order of the messages, with the callsigns (also as their names), codes
        (field 7) and addresses (`CODE`) of the messages. Times are in seconds from midnight of the
        day of flight. Heights are the filed levels. They are nan where the aircraft may be climbing
        or descending, which is assumed to take place at 5 m/s or at the rate of its type.

    Raises
    ------
    ValueError
        If a message cannot be understood, for example because of an unknown fix, an airway that
        does not connect two points of the route, or a wrong speed or level. The error message has
        one line, which states the number of the FPL message and the token.
    TypeError
        If an argument has the wrong type.
    OSError
        If a file cannot be read.

    Notes
    -----
    The following fields are used: 7 (callsign and code), 9 (type), 13 (departure), 15 (route), 16
    (destination), and `DOF`, `CODE`, `DEP`, `DEST`, `TYP` of field 18. A Mach number is converted
    with the standard atmosphere at the filed level. The first and the last token of a route may be
    unknown; they are taken as departure and arrival procedures. A stay adds its duration to the
    following leg. If two airways follow each other, the route changes from one to the other at
    their first common fix. A flight may also join or leave an airway between two of its fixes, at a
    point within 5 NM of the airway that is given by coordinates or by radial and distance.

    Source: ICAO Doc 4444, appendix 3.

    Examples
    --------
    >>> from tertia.geo import LocalFrame
    >>> from tertia.io import read_fpl
    >>> fixes = {"LKPR": (50.10, 14.26), "OKG": (50.06, 12.40), "EDDF": (50.03, 8.57)}
    >>> text = "(FPL-CSA123-IS-A320/M-S/S-LKPR0930-N0440F330 OKG DCT-EDDF0055-DOF/261122)"
    >>> frame = LocalFrame(50.0, 12.0)
    >>> (plan,) = read_fpl(text, fixes=fixes, airways={}, frame=frame)
    >>> plan
    FlightPlan(CSA123: 3 waypoints, 407.5 km, 1800 s)
    >>> plan.names, plan.start_time
    (('LKPR', 'OKG', 'EDDF'), 35100.0)
    """
    if isinstance(text, Path):
        text = text.read_text("utf-8", "replace")
    if not isinstance(text, str):
        raise TypeError(f"text is {text!r}; it must be text, or the Path of a file")
    if not isinstance(frame, (LocalFrame, SystemPlane)):
        raise TypeError(f"frame is {frame!r}; it must be a LocalFrame or a SystemPlane")
    taxi = float(finite(real(taxi_time, "taxi_time"), "taxi_time"))
    options = _Options(Tables(fixes, airways), frame, _types(types), _winds(winds), taxi)
    messages = _MESSAGE.findall(text)
    if not messages or len(messages) != text.count("("):
        raise ValueError(
            "text has no message, or a message without parentheses; each must have the form "
            "(FPL-...)"
        )
    plans = []
    for at, message in enumerate(messages):
        fields = [" ".join(part.split()) for part in message.split("-", len(_FIELDS))]
        called = f" ({fields[1][:20]!r})" if len(fields) > 1 else ""
        try:
            plans.append(_plan(fields, message, options))
        except ValueError as error:
            raise ValueError(f"message {at}{called}: {error}") from None
    return plans


def _plan(fields: Sequence[str], message: str, options: _Options) -> FiledPlan:
    """Return the plan that a message describes."""
    if not fields[0].startswith("FPL"):
        raise ValueError(f"the type is {fields[0][:20]!r}; it must be FPL")
    if len(fields) < len(_FIELDS):
        raise ValueError(f"field {_FIELDS[len(fields)]} is missing")
    found = {
        name: _matched(pattern, field, name)
        for name, pattern, field in (
            ("7", _CALLSIGN, fields[1]),
            ("9", _TYPE, fields[3]),
            ("13", _PLACE_AND_TIME, fields[5]),
            ("16", _ELAPSED, fields[7]),
        )
    }
    others = _others(message.split("-", len(_FIELDS))[len(_FIELDS) :])
    tables = options.tables
    departure, off_block = found["13"][1], _seconds(*found["13"].groups()[1:], day=True)
    start = _aerodrome(departure, others.get("DEP"), None, tables)
    route = route_of(fields[6], start, tables)
    end = _aerodrome(found["16"][1], others.get("DEST"), route.points[-1].place, tables)
    points = _distinct([*route.points, Point(end, *route.cruise)])
    kind = others.get("TYP", found["9"][1]) if found["9"][1] == "ZZZZ" else found["9"][1]
    of_type = options.types.get(kind, {})
    places = _positions([point.place for point in points], options.frame)
    levels = np.array([point.level for point in points])
    airspeeds = np.array([point.speed for point in points[:-1]])
    speeds = _ground_speeds(places, airspeeds, levels, options.winds)
    length = np.hypot(*np.diff(places, axis=0).T)
    speeds = length / (length / speeds + [point.delay for point in points[:-1]])
    code, address = found["7"][2], others.get("CODE")
    heights = _heights(length, speeds, levels, of_type.get("climb_m_s", _CLIMB))
    plan = FiledPlan(
        places,
        speeds,
        start_time=off_block + options.taxi_time,
        heights=None if np.all(np.isnan(heights)) else heights,
        bank=math.radians(of_type["bank_deg"]) if "bank_deg" in of_type else None,
        turn_rate=math.radians(of_type.get("turn_rate_deg_s", _TURN_RATE)),
        icao_address=None if address is None else _address(address),
        mode_3a=None if code is None else int(code, 8),
        callsign=found["7"][1],
        name=found["7"][1],
    )
    values = {
        "names": tuple(point.place.name for point in points),
        "levels": levels,
        "airspeeds": airspeeds,
        "aircraft_type": kind,
        "departure": departure,
        "destination": found["16"][1],
        "off_block_time": off_block,
        "elapsed_time": _seconds(*found["16"].groups()[1:3]),
        "date": _date(others.get("DOF")),
        "unknown_procedures": tuple(route.unknown),
        "fields": others,
    }
    for name, value in values.items():
        object.__setattr__(plan, name, value)
    return plan


def _matched(pattern: re.Pattern[str], field: str, name: str) -> re.Match[str]:
    found = pattern.fullmatch(field)
    if found is None:
        raise ValueError(f"field {name} is {field[:40]!r}, which cannot be understood")
    return found


def _seconds(hours: str, minutes: str, *, day: bool = False) -> float:
    """Return hours and minutes in seconds; `day` if they are a time of day, not a duration."""
    if int(minutes) >= 60 or (day and int(hours) >= 24):
        raise ValueError(f"{hours + minutes!r} is not a time")
    return 3600.0 * int(hours) + 60.0 * int(minutes)


def _others(rest: Sequence[str]) -> dict[str, str]:
    """Return field 18 by its keys; field 19 is ignored."""
    text = " ".join(_SUPPLEMENT.sub("", " ".join(rest)).split())
    if text in {"", "0"}:
        return {}
    keys = list(_KEY.finditer(text))
    if not keys or keys[0].start() > 0:
        raise ValueError(f"field 18 is {text[:40]!r}, which cannot be understood")
    ends = [key.start() for key in keys[1:]] + [len(text)]
    return {key[1]: text[key.end() : end].strip() for key, end in zip(keys, ends, strict=True)}


def _aerodrome(name: str, described: str | None, near: Place | None, tables: Tables) -> Place:
    """Return the place of an aerodrome; field 18 describes the place of ZZZZ."""
    if name == "ZZZZ" and described:
        name = described.split()[-1]
    place = tables.place(name, near)
    if place is None:
        raise ValueError(f"aerodrome {name!r} is not among the fixes")
    return place


def _distinct(points: Sequence[Point]) -> list[Point]:
    """Return points without repetitions of the same place; the first takes the later values."""
    kept = [points[0]]
    for point in points[1:]:
        if point.place.is_at(kept[-1].place):
            kept[-1].speed, kept[-1].level = point.speed, point.level
            kept[-1].delay += point.delay
        else:
            kept.append(point)
    return kept


def _positions(places: Sequence[Place], frame: LocalFrame | SystemPlane) -> FloatArray:
    local: FloatArray = np.asarray(
        frame.to_local(
            np.array([place.latitude for place in places]),
            np.array([place.longitude for place in places]),
        )
    )
    return np.ascontiguousarray(local[:, :2])


def _ground_speeds(
    places: FloatArray, airspeeds: FloatArray, levels: FloatArray, winds: FloatArray
) -> FloatArray:
    """Return ground speeds `w·u + sqrt(V² − (w×u)²)` in directions u for airspeeds V and wind w."""
    if not len(winds):
        return airspeeds
    heights = np.nan_to_num(levels[:-1])
    east, north = (np.interp(heights, winds[:, 0], winds[:, k]) for k in (1, 2))
    along = np.diff(places, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    with_it = east * along[:, 0] + north * along[:, 1]
    across = east * along[:, 1] - north * along[:, 0]
    speeds: FloatArray = with_it + np.sqrt(np.maximum(airspeeds**2 - across**2, 0.0))
    if np.any(speeds <= 0.0):
        raise ValueError(f"leg {int(np.argmin(speeds))} cannot be flown against this wind")
    return speeds


def _heights(
    length: FloatArray, speeds: FloatArray, levels: FloatArray, climb: float
) -> FloatArray:
    """Return levels where the aircraft is neither climbing nor descending; nan elsewhere."""
    flown = np.concatenate([[0.0], np.cumsum(length / speeds)])
    needed = levels / climb
    level: FloatArray = np.where((flown < needed) | (flown[-1] - flown < needed), np.nan, levels)
    return level


def _date(text: str | None) -> datetime.date | None:
    """Return the date given as YYMMDD."""
    if text is None:
        return None
    if not re.fullmatch(r"\d{6}", text, re.ASCII):
        raise ValueError(f"DOF is {text[:20]!r}; it must be YYMMDD")
    year, month, day = (int(text[at : at + 2]) for at in (0, 2, 4))
    try:
        return datetime.date(2000 + year, month, day)
    except ValueError:
        raise ValueError(f"DOF is {text!r}; there is no such day") from None


def _address(text: str) -> int:
    if not re.fullmatch(r"[0-9A-F]{6}", text, re.ASCII):
        raise ValueError(f"CODE is {text[:20]!r}; it must be six hexadecimal digits")
    return int(text, 16)


def _types(types: Any) -> dict[str, dict[str, float]]:
    """Return the known properties of each aircraft type."""
    if types is None:
        return {}
    columns = table_columns(types, ("aircraft_type",), "types", _TYPE_COLUMNS)
    if columns is None:
        pairs = types.items()
        return {kind: {"bank_deg": math.degrees(real(bank, "types"))} for kind, bank in pairs}
    names, *rest = columns
    return {
        str(kind): {
            name: float(columns[name][at])
            for name in rest
            if columns[name][at] is not None and not math.isnan(columns[name][at])
        }
        for at, kind in enumerate(columns[names])
    }


def _winds(winds: npt.ArrayLike | None) -> FloatArray:
    """Return winds as rows of height, east and north, (L, 3)."""
    if winds is None:
        return np.empty((0, 3))
    values = finite(winds, "winds")
    if values.shape == (2,):
        values = np.array([[0.0, *values]])
    if values.ndim != 2 or values.shape[1] != 3 or np.any(np.diff(values[:, 0]) <= 0.0):
        raise ValueError(
            f"winds has shape {values.shape}; it must be (2,), or (L, 3) with increasing heights"
        )
    return values
