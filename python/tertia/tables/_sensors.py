"""Sensors described in rows: positions, accuracies and scan periods."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

import numpy as np

from tertia._arrays import FloatArray
from tertia.geo import LocalFrame, SystemPlane
from tertia.location._height import in_the_plane
from tertia.sensors import Bias, Channel, PositionSensor, Radar, Station
from tertia.tables._doubts import doubt, doubt_names
from tertia.tables._earth import at_heights, on_the_ellipsoid
from tertia.tables._groups import known
from tertia.tables._marks import is_mark
from tertia.tables._names import NEAR, VERY_NEAR, hint, plain_name
from tertia.tables._parts import RecordError
from tertia.tables._sexagesimal import angle_of_text

if TYPE_CHECKING:
    import polars as pl

# the cells of one sensor, by column
Row: TypeAlias = Mapping[str, Any]
S = TypeVar("S", Radar, Station)
Made = TypeVar("Made", Radar, Station, PositionSensor)

LOCAL = ("east_m", "north_m", "up_m")
GEODETIC = ("latitude_deg", "longitude_deg", "height_m")
_DOMAINS = {"latitude_deg": (-90, 90), "longitude_deg": (-180, 360)}
# in metres; at this distance from the origin, azimuths in the plane are wrong by 0.4 degrees
REACH_OF_A_PLANE = 1e6
# properties of a radar, their columns, and factors to the units of the library
_RADAR = {
    "range_sigma": ("range_sigma_m", 1.0),
    "azimuth_sigma": ("azimuth_sigma_deg", math.pi / 180),
    "scan_period": ("scan_period_s", 1.0),
}
_DETECTION = "detection_probability"
_OPTIONAL = {
    "max_range": ("max_range_m", 1.0),
    "detection_probability": (_DETECTION, 1.0),
}
# channels of a radar, their names in columns, and their properties
_CHANNELS = {"psr": "psr", "ssr": "ssr", "mode-s": "mode_s"}
_CHANNEL = {
    "detection_probability": ("detection_probability", 1.0),
    "range_sigma": ("range_sigma_m", 1.0),
    "azimuth_sigma": ("azimuth_sigma_deg", math.pi / 180),
    "clutter_per_scan": ("clutter_per_scan", 1.0),
}
_RESOLUTION = {
    "range_resolution": ("range_resolution_m", 1.0),
    "azimuth_resolution": ("azimuth_resolution_deg", math.pi / 180),
    "target_extent": ("target_extent_m", 1.0),
}
_STATION = {
    "range_sigma": ("range_sigma_m", 1.0),
    "azimuth_sigma": ("azimuth_sigma_deg", math.pi / 180),
    "elevation_sigma": ("elevation_sigma_deg", math.pi / 180),
    "arrival_time_sigma": ("arrival_time_sigma_s", 1.0),
}
_POSITION_SIGMA = "position_sigma_m"
_POSITION_SENSOR = {
    "position_sigma": (_POSITION_SIGMA, 1.0),
    "velocity_sigma": ("velocity_sigma_m_s", 1.0),
    "update_interval": ("update_interval_s", 1.0),
    "detection_probability": (_DETECTION, 1.0),
    "target_extent": ("target_extent_m", 1.0),
}
# systematic errors of radars: their columns, the columns of their sigmas, and factors
RADAR_BIAS = {
    "range": ("range_bias_m", "range_bias_sigma_m", 1.0),
    "range_gain": ("range_gain", "range_gain_sigma", 1.0),
    "azimuth": ("azimuth_bias_deg", "azimuth_bias_sigma_deg", math.pi / 180),
    "time": ("time_bias_s", "time_bias_sigma_s", 1.0),
}
# those of all sensors
_BIAS = RADAR_BIAS | {
    "elevation": ("elevation_bias_deg", "elevation_bias_sigma_deg", math.pi / 180)
}
# those of positions, which are 0 unless they are stated
_PLACE_BIAS = {
    "east": ("east_bias_m", "east_bias_sigma_m", 1.0),
    "north": ("north_bias_m", "north_bias_sigma_m", 1.0),
}
_TRUSTED = "trusted"
_RANGE_DIFFERENCE_SIGMA = "range_difference_sigma_m"
# all columns that are read
_KNOWN = (
    *("name", *LOCAL, *GEODETIC, _TRUSTED, _POSITION_SIGMA, _RANGE_DIFFERENCE_SIGMA),
    *(
        column
        for table in (_RADAR, _STATION, _RESOLUTION, _OPTIONAL, _POSITION_SENSOR)
        for column, _ in table.values()
    ),
    *(column for one in (*_BIAS.values(), *_PLACE_BIAS.values()) for column in one[:2]),
    *(f"{name}_{column}" for name in _CHANNELS.values() for column, _ in _CHANNEL.values()),
)
# a sensor of which nothing else is given may be one whose positions are in the rows of measurements
_OF_MOVING = {"name", _TRUSTED, *(column for column, _ in _STATION.values())}
_UNPLACED = f": give {GEODETIC[0]} and {GEODETIC[1]}, or {LOCAL[0]} and {LOCAL[1]}"
_MOVING = "; a sensor that moves needs a position here, too, such as its first"
# in degrees; surveillance radars have larger azimuth sigmas
_DOUBTFUL_SIGMA = 0.005


@dataclass(frozen=True, slots=True)
class Sensors(Generic[S]):
    """Radars or stations, with further properties that their classes do not have.

    `norths` are angles in radians to be added to azimuths, for radars in a flat plane whose north
    differs from that of the plane. `range_difference_sigma` is in metres, nan if none is stated.
    `frame` converts latitudes and longitudes. `file` is the source.
    """

    items: Sequence[S]
    norths: FloatArray
    range_difference_sigma: FloatArray
    frame: LocalFrame | SystemPlane | None = None
    file: str | None = None

    @property
    def names(self) -> list[str]:
        """The names of the sensors; the name of a sensor without a name is its index."""
        return [str(k) if one.name is None else one.name for k, one in enumerate(self.items)]

    @property
    def dimension(self) -> int:
        """The number of coordinates."""
        # position sensors have no position of their own
        places = (getattr(one, "position", None) for one in self.items)
        return next((len(place) for place in places if place is not None), 2)

    def error(self, reason: str) -> RecordError:
        """Return an error in the description of the sensors."""
        return RecordError(reason, file=self.file)

    def geodetic(
        self, position: FloatArray, height: FloatArray | None = None
    ) -> dict[str, pl.Series]:
        """Return the columns of latitudes, longitudes and, if D = 3, heights of positions (N, D).

        Positions in a system plane are converted at their height. Positions without a height, and
        positions in a tangent plane, are taken on the ellipsoid. If stations have heights, a
        position without a height is taken at their mean height, and its height is null. Positions
        that are not on the earth give null. Without a frame there are no columns.
        """
        if self.frame is None:
            return {}
        if isinstance(self.frame, SystemPlane):
            found: Iterable[Any] = self.frame.to_geodetic(lifted(position, height))[:2]
        elif position.shape[1] == len(LOCAL):
            found = at_heights(self.frame, position, [one.position for one in self.items])
        else:
            found = on_the_ellipsoid(self.frame, position)
        return {name: known(cells) for name, cells in zip(GEODETIC, found, strict=False)}

    def origin(self) -> str | None:
        """Return the position of the origin as text; None if it is unknown."""
        if self.frame is None:
            return None
        place = f"latitude {self.frame.latitude:.10g}, longitude {self.frame.longitude:.10g}"
        if self.dimension < len(LOCAL) or isinstance(self.frame, SystemPlane):
            return f"origin of east and north: {place}"
        return f"origin of east, north and up: {place}, height {self.frame.height:.10g} m"

    def flat(self) -> Sensors[Station]:
        """Return stations without heights, which bearings do not need."""
        if self.dimension == 2:
            return self  # type: ignore[return-value]
        if self.frame is not None:
            raise self.error("bearings need stations without heights: leave out height_m")
        stations = [
            Station(one.position[:2], name=one.name, azimuth_sigma=one.azimuth_sigma)
            for one in self.items
        ]
        return Sensors(stations, self.norths, self.range_difference_sigma, None, self.file)


def lifted(position: FloatArray, height: FloatArray | None) -> FloatArray:
    """Return positions in a system plane, (N, 3); those without a height are on the ellipsoid."""
    up = np.zeros(len(position)) if height is None else np.nan_to_num(height)
    return np.column_stack([position[:, :2], up])


def radars(
    rows: Sequence[Row],
    *,
    origin: Row | None = None,
    file: str = "the table",
    found: Mapping[str, Row] | None = None,
    flat: bool = False,
) -> Sensors[Radar]:
    """Return the radars that rows describe.

    `origin` is the place where east and north are zero. Positions and scan periods from recordings
    (`found`) are used if the rows do not give them. Radars with latitudes and longitudes are on the
    earth or, if `flat`, in the plane that is tangent to it.
    """
    described = _named(rows, "radar", file)
    if found is not None:
        described = {
            name: _completed(_Cells(row, name, file), found.get(name, {}))
            for name, row in described.items()
        }
    cells = [_Cells(row, name, file) for name, row in described.items()]
    if not flat and _are_geodetic(cells, origin, file):
        return _in_a_system_plane(cells, origin, file)
    positions, axes, frame = _places(cells, origin, file)
    norths = np.zeros(len(cells))
    if axes is not None:
        norths = np.arctan2(axes[:, 1, 0], axes[:, 1, 1])
        # heights are above the ellipsoid, like those of plots, and not above the plane
        positions[:, 2:] = [[one.number(GEODETIC[2]) or 0.0] for one in cells]
    items = [_radar(one, place) for one, place in zip(cells, positions, strict=True)]
    return Sensors(items, norths, np.full(len(items), np.nan), frame, file)


def with_others(
    found: Sensors[Any] | None,
    position_sensors: Sequence[Row],
    stations: Sequence[Row],
    *,
    origin: Row | None,
    file: str,
) -> Sensors[Any]:
    """Return radars, if there are any, and other sensors that rows describe.

    If there are no radars, latitudes and longitudes need the `origin`. Only the azimuths of
    stations are used; stations without an `azimuth_sigma_deg` are left out.
    """
    if found is None:
        frame = None
        if origin is not None:
            centre = _Cells(origin, "the origin", file)
            frame = SystemPlane(*(centre.required(column) for column in GEODETIC[:2]))
        found = Sensors([], np.zeros(0), np.zeros(0), frame, file)
    others: list[PositionSensor | Station] = []
    rows = _named(position_sensors, "position sensor", file) if position_sensors else {}
    for name, row in rows.items():
        cells = _Cells(row, name, file)
        options = cells.given(_POSITION_SENSOR)
        others.append(cells.made(PositionSensor, bias=_bias(cells), **options))
    for name, row in (_named(stations, "station", file) if stations else {}).items():
        cells = _Cells(row, name, file)
        if cells.sigma(_STATION["azimuth_sigma"][0]) is not None:
            others.append(_for_azimuths(cells, found.frame))
    items = [*found.items, *others]
    if twice := {one.name for one in others if [other.name for other in items].count(one.name) > 1}:
        raise RecordError(f"there are two sensors {min(map(str, twice))}", file=file)
    north, none = np.zeros(len(others)), np.full(len(items), np.nan)
    return Sensors(items, np.concatenate([found.norths, north]), none, found.frame, file)


def _for_azimuths(cells: _Cells, frame: LocalFrame | SystemPlane | None) -> Station:
    """Return a station with its position in the plane of the radars, for azimuths alone."""
    column, unit = _STATION["azimuth_sigma"]
    options: dict[str, Any] = {"azimuth_sigma": cells.required(column) * unit}
    bias = _bias(cells)
    if bias is not None:
        # errors that are not stated are zero, because the tracker does not estimate errors of
        # stations
        kinds = ("azimuth", "time")
        options["bias"] = Bias(**{kind: getattr(bias, kind) for kind in kinds})
    if not _are_geodetic([cells], None, cells.file):
        return cells.made(Station, _coordinates([cells], LOCAL)[0][:2], **options)
    place = [cells.required(column) for column in GEODETIC[:2]]
    place.append(cells.number(GEODETIC[2]) or 0.0)
    if frame is None:
        raise cells.error(f"{cells.name} has {GEODETIC[0]}, but the radars have none")
    station = frame.station(*place)
    options["axes"] = in_the_plane(np.asarray(station.axes)[np.newaxis])[0]
    return cells.made(Station, station.position[:2], **options)


def radar_rows(sensors: Sensors[Radar]) -> pl.DataFrame:
    """Return rows that describe the radars, from which `radars` can create them again."""
    import polars as pl  # noqa: PLC0415  # slow to import

    position = np.array([np.pad(one.position, (0, 3 - len(one.position))) for one in sensors.items])
    if sensors.frame is None:
        places = dict(zip(LOCAL, position.T, strict=True))
    elif isinstance(sensors.frame, SystemPlane):
        places = dict(zip(GEODETIC, sensors.frame.to_geodetic(position), strict=True))
    else:
        # heights are above the ellipsoid, not above the plane
        latitude, longitude = on_the_ellipsoid(sensors.frame, position[:, :2])
        places = dict(zip(GEODETIC, (latitude, longitude, position[:, 2]), strict=True))
    columns: dict[str, Any] = {"name": sensors.names} | places
    for key, (column, unit) in _RADAR.items():
        columns[column] = [getattr(one, key) / unit for one in sensors.items]
    for key, (column, _) in _OPTIONAL.items():
        columns[column] = known(np.array([getattr(one, key) for one in sensors.items]))
    # if there are channels, only they have detection probabilities
    columns[_DETECTION] = [
        None if one.channels else one.detection_probability for one in sensors.items
    ]
    columns |= _channel_columns([one.channels or {} for one in sensors.items])
    for key, (column, unit) in _RESOLUTION.items():
        sizes = [getattr(one, key) for one in sensors.items]
        columns[column] = [None if size is None else size / unit for size in sizes]
    for kind, (*pair, unit) in RADAR_BIAS.items():
        for column, name in zip(pair, (kind, f"{kind}_sigma"), strict=True):
            values = [getattr(one.bias, name, None) for one in sensors.items]
            columns[column] = [None if one is None else one / unit for one in values]
    return pl.DataFrame(columns)


def _channel_columns(channels: Sequence[Mapping[str, Channel]]) -> dict[str, list[float | None]]:
    """Return the columns of the channels of radars."""
    columns: dict[str, list[float | None]] = {}
    for name, prefix in _CHANNELS.items():
        if any(name in own for own in channels):
            for key, (column, unit) in _CHANNEL.items():
                cells = [getattr(own.get(name), key, None) for own in channels]
                columns[f"{prefix}_{column}"] = [None if x is None else x / unit for x in cells]
    return columns


def stations(
    rows: Sequence[Row], *, origin: Row | None = None, file: str = "the table"
) -> Sensors[Station]:
    """Return the stations that rows describe, with arguments as for `radars`."""
    cells = [_Cells(row, name, file) for name, row in _named(rows, "station", file).items()]
    positions, axes, frame = _places(cells, origin, file)
    items = []
    for k, one in enumerate(cells):
        options = one.given(_STATION, positive=True)
        options["position_sigma"] = one.number(_POSITION_SIGMA) or 0.0
        options["axes"] = None if axes is None else axes[k]
        options["bias"] = _bias(one)
        items.append(one.made(Station, positions[k], **options))
    differences = [one.sigma(_RANGE_DIFFERENCE_SIGMA) for one in cells]
    stated = np.array([np.nan if one is None else one for one in differences])
    return Sensors(items, np.zeros(len(items)), stated, frame, file)


@dataclass(frozen=True, slots=True)
class _Cells:
    """The cells that describe one sensor."""

    row: Row
    name: str
    file: str

    def error(self, reason: str) -> RecordError:
        return RecordError(reason, file=self.file)

    def number(self, column: str) -> float | None:
        """Return a number; None if it is missing."""
        value = self.row.get(column)
        if value is None or is_mark(str(value)):
            return None
        try:
            found = math.nan if isinstance(value, bool) else float(value)
        except (TypeError, ValueError):
            angle = column.endswith("_deg") and isinstance(value, str)
            found = angle_of_text(value) if angle else math.nan
        if not math.isfinite(found):
            raise self.error(f"{column} of {self.name} is {value!r}; it must be a finite number")
        low, high = _DOMAINS.get(column, (-math.inf, math.inf))
        if not low <= found <= high:
            said = "; are latitude and longitude swapped?" if column == GEODETIC[0] else ""
            raise self.error(
                f"{column} of {self.name} is {found:g}; it must be between {low} and {high}{said}"
            )
        return found

    def required(self, column: str, note: str = "") -> float:
        """Return a number; an error, which may end in a note, if it is missing."""
        found = self.number(column)
        if found is None:
            others = [name for name in self.row if name != column]
            # usual names are suggested only if the row has no position at all
            placed = not {*LOCAL, *GEODETIC}.isdisjoint(self.row)
            said = hint([column], others, VERY_NEAR if placed else NEAR) or ("" if placed else note)
            raise self.error(f"{column} of {self.name} is missing{said}")
        return found

    def place(self, columns: Iterable[str]) -> list[float]:
        """Return the coordinates in these columns; an error if one is missing."""
        note = _MOVING if self.row.keys() <= _OF_MOVING else _UNPLACED
        return [self.required(column, note) for column in columns]

    def sigma(self, column: str) -> float | None:
        """Return a positive number; None if it is missing."""
        found = self.number(column)
        if found is not None and found <= 0:
            raise self.error(f"{column} of {self.name} is {found:g}; it must be positive")
        return found

    def given(
        self, columns: Mapping[str, tuple[str, float]], *, positive: bool = False
    ) -> dict[str, Any]:
        """Return properties with their columns and units; those that are missing are left out."""
        read = self.sigma if positive else self.number
        found = ((key, read(column), unit) for key, (column, unit) in columns.items())
        return {key: value * unit for key, value, unit in found if value is not None}

    def made(self, kind: type[Made], *place: FloatArray, **options: Any) -> Made:
        """Return the sensor, created from the cells."""
        try:
            return kind(*place, name=self.name, **options)
        except ValueError as error:
            raise self.error(f"{self.name}: {error}") from None


def _named(rows: Sequence[Row], noun: str, file: str) -> dict[str, Row]:
    """Return the rows by their names."""
    if not rows:
        raise RecordError(f"there are no {noun}s", file=file)
    found: dict[str, Row] = {}
    for at, cells in enumerate(rows, start=1):
        row = {plain_name(key): value for key, value in cells.items()}
        name = "" if (given := row.get("name")) is None else str(given).strip()
        if not name:
            raise RecordError(f"{noun} {at} has no name", file=file)
        if name in found:
            raise RecordError(f"there are two {noun}s {name}", file=file)
        found[name] = row
    doubt_names(found, _KNOWN, file)
    return found


def _completed(cells: _Cells, found: Row) -> Row:
    """Return the properties of a radar from its row, completed from a recording."""

    def has(*columns: str) -> bool:
        return any(cells.number(column) is not None for column in columns)

    period = _RADAR["scan_period"][0]
    added = {} if has(period) or period not in found else {period: found[period]}
    if not has(*LOCAL, *GEODETIC):
        if GEODETIC[0] not in found:
            said = f"{cells.name} has no position, and its recording has none (I034/120)"
            raise cells.error(said + _UNPLACED)
        added |= {column: found[column] for column in GEODETIC if column in found}
    if period not in {*cells.row, *added}:
        raise cells.error(f"give {period} of {cells.name}: its recording has none (I034/041)")
    return {**cells.row, **added}


def _in_a_system_plane(cells: Sequence[_Cells], origin: Row | None, file: str) -> Sensors[Radar]:
    """Return radars on the earth; the centre is the origin, by default the first radar."""
    centre = cells[0] if origin is None else _Cells(origin, "the origin", file)
    plane = SystemPlane(*(centre.required(column) for column in GEODETIC[:2]))
    positions = [plane.to_local(*place) for place in _coordinates(cells, GEODETIC)]
    for one, place in zip(cells, positions, strict=True):
        distance = float(np.hypot(*place[:2]))
        if distance > REACH_OF_A_PLANE:
            doubt(
                f"{one.name} is {distance / 1e3:.0f} km from the origin: are latitude and "
                "longitude swapped?"
            )
    items = [_radar(one, place, plane) for one, place in zip(cells, positions, strict=True)]
    return Sensors(items, np.zeros(len(items)), np.full(len(items), np.nan), plane, file)


def _radar(cells: _Cells, place: FloatArray, frame: SystemPlane | None = None) -> Radar:
    options: dict[str, Any] = {"frame": frame}
    for key, (column, unit) in _RADAR.items():
        cells.required(column)
        options[key] = (cells.sigma(column) or 0.0) * unit
    options |= cells.given(_OPTIONAL | _RESOLUTION)
    options["bias"] = _bias(cells)
    options["channels"] = _channels(cells)
    sigma = math.degrees(options["azimuth_sigma"])
    if sigma < _DOUBTFUL_SIGMA:
        doubt(f"azimuth_sigma_deg of {cells.name} is {sigma:.3g} degrees: is it in radians?")
    return cells.made(Radar, place, **options)


def _channels(cells: _Cells) -> dict[str, Channel] | None:
    """Return the channels of a radar; None if none are described."""
    found = {}
    for name, prefix in _CHANNELS.items():
        columns = {key: (f"{prefix}_{own}", unit) for key, (own, unit) in _CHANNEL.items()}
        options = cells.given(columns)
        if not options:
            continue
        cells.required(columns["detection_probability"][0])
        try:
            found[name] = Channel(**options)
        except ValueError as error:
            raise cells.error(f"{cells.name}, {prefix}: {error}") from None
    return found or None


def _bias(cells: _Cells) -> Bias | None:
    """Return the systematic errors of a sensor; None if nothing is known about them.

    Kinds of errors without a cell are to be estimated, except for those of positions.
    """
    found: dict[str, Any] = {}
    for kind, (column, sigma_column, unit) in (_BIAS | _PLACE_BIAS).items():
        value, sigma = cells.number(column), cells.number(sigma_column)
        if sigma is not None and sigma < 0:
            raise cells.error(
                f"{sigma_column} of {cells.name} is {sigma:g}; it must be 0 or positive"
            )
        if value is None and sigma is None:
            found[f"{kind}_sigma"] = 0.0 if kind in _PLACE_BIAS else None
        else:
            found |= {kind: (value or 0.0) * unit, f"{kind}_sigma": (sigma or 0.0) * unit}
    is_known = any(kind in found for kind in (*_BIAS, *_PLACE_BIAS))
    trusted = cells.row.get(_TRUSTED)
    if trusted is None or is_mark(str(trusted)) or str(trusted).lower() == "false":
        return Bias(**found) if is_known else None
    if str(trusted).lower() != "true":
        raise cells.error(f"{_TRUSTED} of {cells.name} is {trusted!r}; it must be true or false")
    if is_known:
        raise cells.error(f"{cells.name} is trusted, but has a bias: leave out one of them")
    return Bias()


def _places(
    cells: Sequence[_Cells], origin: Row | None, file: str
) -> tuple[FloatArray, FloatArray | None, LocalFrame | None]:
    """Return positions, (K, D), in the plane, or in space if any sensor has a height.

    With latitudes and longitudes, the frame is at the origin, by default at the first sensor, and
    `axes`, (K, D, D), are the axes east, north and up of each sensor as rows; otherwise there are
    no axes.
    """
    if _are_geodetic(cells, origin, file):
        return _on_the_earth(cells, origin, file)
    return _coordinates(cells, LOCAL), None, None


def _are_geodetic(cells: Sequence[_Cells], origin: Row | None, file: str) -> bool:
    """Return whether positions are given as latitudes and longitudes."""
    local, geodetic = (_first_given(cells, form) for form in (LOCAL, GEODETIC))
    if local and geodetic:
        raise RecordError(
            f"there are {local} and {geodetic}; all positions must be given in the same form",
            file=file,
        )
    if local and origin is not None:
        both = f"{GEODETIC[0]} and {GEODETIC[1]}"
        reason = f"an origin is for sensors with {both}, not with {local}: leave out one of them"
        raise RecordError(reason, file=file)
    if local is None and geodetic is None and origin is None:
        # other names of the columns
        there = [name for one in cells for name in one.row]
        return bool(hint([GEODETIC[0]], there)) and not hint([LOCAL[0]], there)
    return local is None


def _first_given(cells: Sequence[_Cells], form: Iterable[str]) -> str | None:
    """Return the first given coordinate of this form, with the name of its sensor."""
    given = (
        f"{column} of {one.name}"
        for one in cells
        for column in form
        if one.number(column) is not None
    )
    return next(given, None)


def _coordinates(cells: Sequence[_Cells], form: tuple[str, str, str]) -> FloatArray:
    """Return the coordinates, (K, 2), or (K, 3) if any sensor has a height."""
    in_space = any(one.number(form[2]) is not None for one in cells)
    columns = form if in_space else form[:2]
    return np.array([one.place(columns) for one in cells])


def _on_the_earth(
    cells: Sequence[_Cells], origin: Row | None, file: str
) -> tuple[FloatArray, FloatArray, LocalFrame]:
    if find_spec("pyproj") is None:
        raise ImportError(f"{file}: {GEODETIC[0]} needs the extra geo: pip install 'tertia[geo]'")
    given = _coordinates(cells, GEODETIC)
    at = given[0]
    if origin is not None:
        at = _coordinates([_Cells(origin, "the origin", file)], GEODETIC)[0]
    if at.size > given.shape[1]:
        raise RecordError(f"the origin has {GEODETIC[2]}, but no sensor has one", file=file)
    frame = LocalFrame(*at)
    sites = [frame.station(*place) for place in given]
    positions = np.array([site.position for site in sites])
    axes = np.array([site.axes for site in sites])
    if given.shape[1] == len(GEODETIC):
        return positions, axes, frame
    for one, distance in zip(cells, np.linalg.norm(positions, axis=1), strict=True):
        if distance > REACH_OF_A_PLANE:
            raise one.error(
                f"{one.name} is {distance / 1e3:.0f} km from the origin; sensors without "
                f"{GEODETIC[2]} are placed in a plane and must be within "
                f"{REACH_OF_A_PLANE / 1e3:.0f} km; are latitude and longitude swapped?"
            )
    return positions[:, :2], in_the_plane(axes), frame
