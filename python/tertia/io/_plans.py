"""Flight plans from CSV, JSON and GeoJSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tertia._arrays import FloatArray, real
from tertia.flightplan import FlightPlan
from tertia.geo import LocalFrame, SystemPlane
from tertia.io._route import read_csv

__all__ = ["read_plans"]

_LOCAL, _GEODETIC = ("east_m", "north_m"), ("longitude_deg", "latitude_deg")
# fields of a plan, and of its waypoints
_OF_PLAN = (
    "name",
    "icao_address",
    "mode_3a",
    "callsign",
    "identity",
    "aircraft_type",
    "bank_deg",
    "turn_radius_m",
    "start_time_s",
)
# columns of text
_TEXT = {"name", "icao_address", "mode_3a", "callsign", "aircraft_type"}
# bases of identities that are text, and how it is spelt
_CODED = {"icao_address": (16, "hexadecimal digits"), "mode_3a": (8, "octal digits")}
_OF_WAYPOINT = ("height_m", "time_s", "speed_m_s")
_PLURAL = {"height_m": "heights_m", "time_s": "times_s", "speed_m_s": "speeds_m_s"}


def read_plans(
    path: str | Path,
    *,
    frame: LocalFrame | SystemPlane | None = None,
    types: Mapping[str, float] | None = None,
    speed: float | None = None,
) -> list[FlightPlan]:
    """Read flight plans from a file.

    Parameters
    ----------
    path : str or Path
        A file whose name ends in `.csv`, `.json` or `.geojson`.
    frame : tertia.geo.LocalFrame or SystemPlane, optional
        Frame of the local coordinates, required if the file has geodetic positions.
    types : mapping of str to float, optional
        Bank angles in radians by aircraft type, for plans with a type and without a bank angle.
    speed : float, optional
        Ground speed in m/s for plans with neither speeds nor times.

    Returns
    -------
    list of FlightPlan
        Plans in the order of the file. A waypoint at the position of the previous waypoint is left
        out.

    Raises
    ------
    ValueError
        If a file or field cannot be understood; the message names the plan.
    ImportError
        If a library is not installed.
    OSError
        If a file cannot be read.

    Notes
    -----
    CSV has a row for each waypoint. Its columns are `name`; `east_m` and `north_m`, or
    `longitude_deg` and `latitude_deg`; and any of `height_m`, `time_s`, `speed_m_s` (of the leg
    that starts there), `icao_address` (hexadecimal digits), `mode_3a` (octal digits), `callsign`,
    `identity` (any other number), `aircraft_type`, `bank_deg`, `turn_radius_m`, `start_time_s`.
    Rows with the same name are one plan; values that belong to the whole plan are taken from its
    first row.

    JSON is a list of objects with the same fields. In these, `waypoints` is a list of pairs `[east,
    north]` or, with `"geodetic": true`, `[longitude, latitude]`; `heights_m`, `times_s` and
    `speeds_m_s` are lists, and heights and speeds may also be single numbers. GeoJSON is a
    FeatureCollection of LineStrings with these fields as properties; a third coordinate is the
    height.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from tertia.io import read_plans
    >>> text = '[{"name": "A", "waypoints": [[0, 0], [0, 5e4], [4e4, 7e4]], "speeds_m_s": 220}]'
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "plans.json")
    ...     _ = path.write_text(text)
    ...     read_plans(path)
    [FlightPlan(A: 3 waypoints, 93.4 km, 424 s)]
    """
    path = Path(path)
    readers = {".csv": _read_csv, ".json": _read_json, ".geojson": _read_json}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise ValueError(f"cannot read {path}: its name must end in {', '.join(readers)}")
    plans = []
    for at, fields in enumerate(reader(path)):
        called = f"plan {fields['name']}" if fields.get("name") else f"plan {at}"
        try:
            plans.append(plan_of(fields, frame, types, speed))
        except (OverflowError, TypeError, ValueError) as error:
            raise ValueError(f"{path}, {called}: {error}") from None
    return plans


def plan_of(
    fields: Mapping[str, Any],
    frame: LocalFrame | SystemPlane | None,
    types: Mapping[str, float] | None = None,
    speed: float | None = None,
) -> FlightPlan:
    """Return the plan described by the fields of a JSON object."""
    if not isinstance(fields.get("waypoints"), Sequence):
        raise ValueError("it has no waypoints")
    places = np.array([pair[:2] for pair in fields["waypoints"]], dtype=np.float64).reshape(-1, 2)
    if fields.get("geodetic"):
        places = _local(places, frame)
    # a repeated position is one waypoint
    kept = np.ones(len(places), dtype=bool)
    kept[1:] = np.any(places[1:] != places[:-1], axis=1)
    bank, kind = fields.get("bank_deg"), fields.get("aircraft_type")
    radius = fields.get("turn_radius_m")
    times, speeds = fields.get("times_s"), fields.get("speeds_m_s")
    if times is None and speeds is None:
        speeds = speed
    if radius is None and bank is None and types and isinstance(kind, str) and kind in types:
        bank = math.degrees(types[kind])
    identity = fields.get("identity")
    return FlightPlan(
        places[kept],
        _chosen(speeds, kept, of_legs=True),
        times=_chosen(times, kept),
        start_time=fields.get("start_time_s"),
        heights=_chosen(fields.get("heights_m"), kept),
        bank=None if bank is None else math.radians(real(bank, "bank_deg")),
        turn_radius=radius,
        icao_address=_coded(fields, "icao_address"),
        mode_3a=_coded(fields, "mode_3a"),
        callsign=fields.get("callsign"),
        identity=None if identity is None else int(identity),
        name=fields.get("name"),
    )


def _coded(fields: Mapping[str, Any], name: str) -> int | None:
    """Return an address or a code from its digits."""
    value, (base, spelling) = fields.get(name), _CODED[name]
    if value is None:
        return None
    try:
        return int(value, base)
    except (TypeError, ValueError):
        raise ValueError(f"{name} is {value!r}; it must be text of {spelling}") from None


def _chosen(value: Any, kept: Any, *, of_legs: bool = False) -> Any:
    """Return the values of the waypoints that are kept, or of the legs that end at them."""
    if value is None or np.ndim(value) == 0 or len(value) != len(kept) - int(of_legs):
        return value
    return np.asarray(value, dtype=np.float64)[kept[1:] if of_legs else kept]


def _local(degrees: FloatArray, frame: LocalFrame | SystemPlane | None) -> FloatArray:
    """Return longitudes and latitudes as east and north."""
    if frame is None:
        raise ValueError("its positions are latitudes and longitudes: give a frame or an origin")
    return frame.to_local(degrees[:, 1], degrees[:, 0])[:, :2]


def _read_json(path: Path) -> Iterable[dict[str, Any]]:
    try:
        # bytes, whose encoding is recognised
        contents = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise ValueError(f"cannot read {path}: {error}") from None
    if not isinstance(contents, (dict, list)):
        raise ValueError(f"{path} is neither a list of plans nor a FeatureCollection")
    if isinstance(contents, dict):
        if contents.get("type") != "FeatureCollection":
            raise ValueError(f"{path} is neither a list of plans nor a FeatureCollection")
        contents = _of_features(contents.get("features", []), path)
    for at, fields in enumerate(contents):
        if not isinstance(fields, dict) or not isinstance(fields.get("waypoints"), list):
            raise ValueError(f"{path}, plan {at} has no waypoints")
    return list(contents)


def _of_features(features: Any, path: Path) -> list[dict[str, Any]]:
    try:
        return [_of_feature(feature, path) for feature in features]
    except (AttributeError, KeyError, TypeError) as error:
        raise ValueError(f"cannot read {path}: it is not GeoJSON: {error}") from None


def _of_feature(feature: Any, path: Path) -> dict[str, Any]:
    if not isinstance(feature, dict):
        raise ValueError(f"{path} has the feature {feature!r}; it must be an object")
    geometry = feature.get("geometry") or {}
    if geometry.get("type") != "LineString":
        raise ValueError(f"{path} has a {geometry.get('type')}; plans must be LineStrings")
    points = geometry["coordinates"]
    fields = {"geodetic": True, "waypoints": points, **(feature.get("properties") or {})}
    if all(len(point) > 2 for point in points):
        fields.setdefault("heights_m", [point[2] for point in points])
    return fields


def _read_csv(path: Path) -> Iterable[dict[str, Any]]:
    table = read_csv(path, infer_schema=False)
    import polars as pl  # noqa: PLC0415  # only here is Polars needed

    axes = next((pair for pair in (_LOCAL, _GEODETIC) if set(pair) <= set(table.columns)), None)
    if axes is None or "name" not in table.columns:
        raise ValueError(
            f"{path} has the columns {', '.join(table.columns)}; it must have name, and "
            f"{' and '.join(_LOCAL)} or {' and '.join(_GEODETIC)}"
        )
    known = [column for column in (*_OF_PLAN, *_OF_WAYPOINT, *axes) if column in table.columns]
    table = table.filter(~pl.all_horizontal(pl.all().is_null()))
    numbers = [column for column in known if column not in _TEXT]
    try:
        table = table.with_columns(pl.col(numbers).str.strip_chars().cast(pl.Float64))
    except pl.exceptions.PolarsError as error:
        raise ValueError(f"cannot read {path}: {str(error).splitlines()[0]}") from None
    groups = table.partition_by("name", maintain_order=True)
    return [_of_rows(group, known, axes) for group in groups]


def _of_rows(table: Any, known: list[str], axes: tuple[str, str]) -> dict[str, Any]:
    fields: dict[str, Any] = {
        "geodetic": axes == _GEODETIC,
        "waypoints": table.select(axes).rows(),
    }
    for column in known:
        if column in _OF_PLAN:
            fields[column] = table[column][0]
        elif column in _OF_WAYPOINT and table[column].null_count() < table.height:
            values = table[column].to_numpy()
            fields[_PLURAL[column]] = values[:-1] if column == "speed_m_s" else values
    return fields
