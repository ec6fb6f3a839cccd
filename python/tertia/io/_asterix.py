"""Recordings of radars in ASTERIX: plots, service messages of radars, system tracks, ADS-B."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from math import cos, radians
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tertia._units import FOOT, NAUTICAL_MILE
from tertia.io._packets import MAGIC, udp_payloads

if TYPE_CHECKING:
    import polars as pl

_PLOTS, _SERVICE, _TRACKS, _REPORTS = 48, 34, 62, 21
_HEADER = 3
_DAY = 86_400.0
_NORTH_MARKER = 1
# metres of a degree of latitude, of which an accuracy needs three digits
_DEGREE = 1852.0 * 60.0
# of I048/020
_DETECTIONS = (
    "none",
    "psr",
    "ssr",
    "ssr+psr",
    "mode-s-all-call",
    "mode-s-roll-call",
    "mode-s-all-call+psr",
    "mode-s-roll-call+psr",
)
_TEXT, _NUMBER, _FLAG = "String", "Float64", "Boolean"
_COMMON = {"time_s": _NUMBER, "sensor": _TEXT}
_IDENTITY = {"icao_address": _TEXT, "mode_3a": _TEXT, "callsign": _TEXT}
_PLACE = {"latitude_deg": _NUMBER, "longitude_deg": _NUMBER, "height_m": _NUMBER}
_MOTION = {"speed_m_s": _NUMBER, "course_deg": _NUMBER}
# columns of the tables, and what they hold
_COLUMNS = {
    _PLOTS: {
        **_COMMON,
        "range_nm": _NUMBER,
        "azimuth_deg": _NUMBER,
        "flight_level": _NUMBER,
        **_IDENTITY,
        "detection": _TEXT,
        "simulated": _FLAG,
        "field_monitor": _FLAG,
        "track_number": "Int64",
        **_MOTION,
    },
    _TRACKS: {
        **_COMMON,
        "target": _TEXT,
        **_PLACE,
        "flight_level": _NUMBER,
        "east_m": _NUMBER,
        "north_m": _NUMBER,
        "east_sigma_m": _NUMBER,
        "north_sigma_m": _NUMBER,
        "covariance_east_north_m2": _NUMBER,
        **_MOTION,
        **_IDENTITY,
    },
    _REPORTS: {
        **_COMMON,
        "target": _TEXT,
        **_PLACE,
        "flight_level": _NUMBER,
        **_MOTION,
        "icao_address": _TEXT,
        "callsign": _TEXT,
    },
}
_SENSORS = {"sensor": _TEXT, **_PLACE, "scan_period_s": _NUMBER, "plot_count": "Int64"}


@dataclass(frozen=True, slots=True, eq=False)
class AsterixRecording:
    """Contents of an ASTERIX recording, as tables of Polars; missing items are null.

    Attributes
    ----------
    plots : DataFrame
        Target reports of radars (category 48): `time_s`, `sensor`, `range_nm`, `azimuth_deg`,
        `flight_level`, `icao_address`, `mode_3a`, `callsign`, `detection`, `simulated`,
        `field_monitor`, `track_number`, `speed_m_s`, `course_deg`.
    sensors : DataFrame
        One row per radar that sent plots or service messages (category 34): `sensor`,
        `latitude_deg`, `longitude_deg`, `height_m`, `scan_period_s`, `plots`.
    tracks : DataFrame
        System tracks (category 62): `time_s`, `sensor`, `target`, `latitude_deg`, `longitude_deg`,
        `height_m`, `flight_level`, `east_m`, `north_m`, `east_sigma_m`, `north_sigma_m` and
        `covariance_east_north_m2` (I062/500), `speed_m_s`, `course_deg`, `icao_address`,
        `mode_3a`, `callsign`.
    reports : DataFrame
        ADS-B reports (category 21): `time_s`, `sensor`, `target`, `latitude_deg`,
        `longitude_deg`, `height_m`, `flight_level`, `speed_m_s`, `course_deg`, `icao_address`,
        `callsign`.
    skipped : dict of int to int
        Data blocks of other categories, by category.
    repeated : int
        Number of duplicate plots, for example from two network lines; each is in the table once.
    other_packets : int
        Number of UDP packets of a network recording that do not contain ASTERIX.
    """

    plots: pl.DataFrame
    sensors: pl.DataFrame
    tracks: pl.DataFrame
    reports: pl.DataFrame
    skipped: dict[int, int]
    repeated: int
    other_packets: int

    def __repr__(self) -> str:
        """Return the numbers of rows."""
        parts = {
            "plots": self.plots,
            "sensors": self.sensors,
            "tracks": self.tracks,
            "reports": self.reports,
        }
        listed = ", ".join(f"{table.height} {name}" for name, table in parts.items())
        return f"AsterixRecording({listed})"


def read_asterix(path: str | Path) -> AsterixRecording:
    """Read an ASTERIX recording.

    Parameters
    ----------
    path : str or Path
        A file of consecutive data blocks, or a network recording of UDP packets that contain them
        (pcap, pcapng). The first bytes decide which.

    Returns
    -------
    AsterixRecording

    Raises
    ------
    ValueError
        A file that is truncated, damaged or not ASTERIX; the message gives the byte.
    ImportError
        A library that is not installed.
    OSError
        A file that cannot be read.

    Notes
    -----
    Radars are named by their codes, SAC/SIC. Times are seconds of the day (UTC), and continue
    beyond 86400 if a recording passes midnight. Mode 3/A codes and flight levels that are garbled
    or not validated are null. Duplicates, for example from two network lines, are removed.

    Decoded by libasterix, by the newest edition of each category that it knows.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from tertia.io import read_asterix
    >>> block = bytes.fromhex("30 0010 f8 1702 4251e5 a0 4000 2000 04d2")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "plots.ast")
    ...     _ = path.write_bytes(block)
    ...     recording = read_asterix(path)
    >>> recording
    AsterixRecording(1 plots, 1 sensors, 0 tracks, 0 reports)
    >>> recording.plots.select("sensor", "range_nm", "azimuth_deg", "mode_3a").row(0)
    ('23/2', 64.0, 45.0, '2322')
    """
    path = Path(path)
    reader = _Reader(path)
    contents = path.read_bytes()
    if not contents:
        raise ValueError(f"{path} is empty")
    if contents[:4] in MAGIC:
        _read_packets(reader, contents)
    else:
        reader.take(contents, "")
    return reader.recording()


def _libraries() -> tuple[Any, Any]:
    """Return the decoder, in two modules; they are large, and typed by 200 000 lines."""
    try:
        return import_module("asterix.base"), import_module("asterix.generated")
    except ImportError as error:
        raise ImportError(
            "ASTERIX needs libasterix: pip install 'tertia[asterix]'; asterix_decoder, a module of "
            "the same name, must not be there"
        ) from error


def _read_packets(reader: _Reader, contents: bytes) -> None:
    try:
        import_module("dpkt")
    except ImportError as error:
        raise ImportError("packets need dpkt: pip install 'tertia[asterix]'") from error
    number = 0
    for number, payload in udp_payloads(reader.path, contents):
        if reader.is_asterix(payload):
            reader.take(payload, f"packet {number}, ")
        else:
            reader.other_packets += 1
    if number == reader.other_packets or not reader.blocks:
        raise ValueError(f"{reader.path} has no packet with ASTERIX in it")


class _Reader:
    """Converts data blocks to rows."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.base, generated = _libraries()
        self.known = generated.manifest["CATS"]
        self.rows: dict[int, list[dict[str, Any]]] = {category: [] for category in _COLUMNS}
        self.skipped: Counter[int] = Counter()
        self.other_packets = self.blocks = self.records = 0
        self.now: float | None = None
        self.places: dict[str, dict[str, float]] = {}
        self.norths: dict[str, list[float]] = defaultdict(list)
        self.turns: dict[str, list[float]] = defaultdict(list)

    def is_asterix(self, payload: bytes) -> bool:
        """Return whether a packet consists of data blocks of known categories."""
        at = 0
        while at + _HEADER < len(payload) and payload[at] in self.known:
            length = int.from_bytes(payload[at + 1 : at + _HEADER], "big")
            if length <= _HEADER:
                return False
            at += length
        return at == len(payload)

    def take(self, contents: bytes, where: str) -> None:
        """Read data blocks; error messages begin with `where`."""
        at = 0
        while at < len(contents):
            category, left = contents[at], len(contents) - at
            length = int.from_bytes(contents[at + 1 : at + _HEADER], "big")
            place = f"{self.path}, {where}byte {at}"
            if category in self.known and left < max(length, _HEADER):
                raise ValueError(
                    f"{place}: the last data block is cut off; what is before it can be had with "
                    f"head -c {at}"
                )
            if category not in self.known or length <= _HEADER:
                there = contents[at : at + 8].hex()
                raise ValueError(
                    f"{place}: there is no data block of ASTERIX, but {there}; the file is "
                    "damaged, or in another format"
                )
            self.blocks += 1
            if category in _COLUMNS or category == _SERVICE:
                records = contents[at + _HEADER : at + length]
                self._take_block(category, records, (where, at + _HEADER))
            else:
                self.skipped[category] += 1
            at += length

    def _take_block(self, category: int, block: bytes, begin: tuple[str, int]) -> None:
        records = self.known[category][-1].cv_record
        strict = self.base.ParsingMode.StrictParsing
        rest = self.base.Bits.from_bytes(block)
        while len(rest):
            self.records += 1
            at = begin[1] + len(block) - len(rest) // 8
            found = records.parse(strict, rest)
            if isinstance(found, ValueError):
                raise ValueError(
                    f"{self.path}, {begin[0]}byte {at}: record {self.records}, of category "
                    f"{category}, is damaged: {found}"
                )
            record, rest = found
            self._take_record(category, _Items(record))

    def _take_record(self, category: int, items: _Items) -> None:
        times = (items.number(item, "s") for item in _TIMES[category])
        time = next((one for one in times if one is not None), None)
        time = None if time is None else self._since_the_first_day(time)
        source = items.whole("010", "SAC"), items.whole("010", "SIC")
        radar = None if None in source else "{}/{}".format(*source)
        if category == _SERVICE:
            if radar is not None:
                self._take_service(radar, time, items)
            return
        row = {"time_s": time, "sensor": radar, **_ROWS[category](items)}
        self.rows[category].append(row)

    def _since_the_first_day(self, time: float) -> float:
        if self.now is not None:
            time += _DAY * round((self.now - time) / _DAY)
        self.now = time
        return time

    def _take_service(self, radar: str, time: float | None, items: _Items) -> None:
        place = self.places.setdefault(radar, {})
        found = {
            "latitude_deg": items.number("120", "°", "LAT"),
            "longitude_deg": items.number("120", "°", "LON"),
            "height_m": items.number("120", "m", "HGT"),
        }
        place.update({name: value for name, value in found.items() if value is not None})
        turn = items.number("041", "s")
        if turn:
            self.turns[radar].append(turn)
        if items.whole("000") == _NORTH_MARKER and time is not None:
            self.norths[radar].append(time)

    def recording(self) -> AsterixRecording:
        """Return the recording."""
        import polars as pl  # noqa: PLC0415  # only here is Polars needed

        tables = {
            category: pl.DataFrame(self.rows[category], _schema(columns)).unique(
                maintain_order=True
            )
            for category, columns in _COLUMNS.items()
        }
        counts = Counter(tables[_PLOTS]["sensor"].drop_nulls().to_list())
        rows = [
            {
                "sensor": radar,
                **self.places.get(radar, {}),
                "scan_period_s": self._period(radar),
                "plot_count": counts[radar],
            }
            for radar in sorted({*counts, *self.places}, key=_codes)
        ]
        return AsterixRecording(
            plots=tables[_PLOTS],
            sensors=pl.DataFrame(rows, _schema(_SENSORS)),
            tracks=tables[_TRACKS],
            reports=tables[_REPORTS],
            skipped=dict(sorted(self.skipped.items())),
            repeated=len(self.rows[_PLOTS]) - tables[_PLOTS].height,
            other_packets=self.other_packets,
        )

    def _period(self, radar: str) -> float | None:
        if self.turns[radar]:
            return float(np.median(self.turns[radar]))
        gaps = np.diff(np.unique(self.norths[radar]))
        return float(np.median(gaps)) if len(gaps) else None


def _schema(columns: Mapping[str, str]) -> Any:
    import polars as pl  # noqa: PLC0415  # only here is Polars needed

    return {name: getattr(pl, kind) for name, kind in columns.items()}


def _codes(radar: str) -> tuple[int, ...]:
    return tuple(map(int, radar.split("/")))


class _Items:
    """A record, and access to its items; missing items are None."""

    def __init__(self, record: Any) -> None:
        self.record = record

    def _content(self, names: tuple[str, ...]) -> Any:
        item = self.record.get_item(names[0])
        for name in names[1:]:
            item = None if item is None else item.variation.get_item(name)
        return None if item is None else item.variation.content

    def whole(self, *names: str) -> int | None:
        """Return an item as a number without a unit."""
        content = self._content(names)
        return None if content is None else int(content.as_uint())

    def number(self, item: str, unit: str, *parts: str) -> float | None:
        """Return an item in a unit."""
        content = self._content((item, *parts))
        return None if content is None else float(content.as_quantity(unit))

    def text(self, *names: str) -> str | None:
        """Return an item as text."""
        content = self._content(names)
        return None if content is None else str(content.as_string()).strip() or None

    def sound(self, item: str, part: str) -> Any:
        """Return a part of an item, None if it is garbled or not validated."""
        return (
            None if self.whole(item, "V") or self.whole(item, "G") else self._content((item, part))
        )

    def address(self, *names: str) -> str | None:
        """Return an address in hexadecimal digits."""
        number = self.whole(*names)
        return None if number is None else f"{number:06X}"

    def code(self, item: str) -> str | None:
        """Return a mode 3/A code."""
        content = self.sound(item, "MODE3A")
        return None if content is None else str(content.as_string())


# where the time of day is; that of the position comes first
_TIMES = {_PLOTS: ("140",), _SERVICE: ("030",), _TRACKS: ("070",), _REPORTS: ("071", "073", "077")}


def _plot(items: _Items) -> dict[str, Any]:
    level = items.sound("090", "FL")
    kind = items.whole("020", "TYP")
    speed = items.number("200", "NM/s", "GSP")
    return {
        "range_nm": items.number("040", "NM", "RHO"),
        "azimuth_deg": items.number("040", "°", "THETA"),
        "flight_level": None if level is None else float(level.as_quantity("FL")),
        "icao_address": items.address("220"),
        "mode_3a": items.code("070"),
        "callsign": items.text("240"),
        "detection": None if kind is None else _DETECTIONS[kind],
        "simulated": bool(items.whole("020", "SIM") or items.whole("020", "TST")),
        "field_monitor": bool(items.whole("020", "RAB")),
        "track_number": items.whole("161", "TRN"),
        "speed_m_s": _times(speed, NAUTICAL_MILE),
        "course_deg": items.number("200", "°", "HDG"),
    }


def _track(items: _Items) -> dict[str, Any]:
    number = items.whole("040")
    velocity = items.number("185", "m/s", "VX"), items.number("185", "m/s", "VY")
    speed, course = _polar(*velocity)
    return {
        "target": None if number is None else str(number),
        "latitude_deg": items.number("105", "°", "LAT"),
        "longitude_deg": items.number("105", "°", "LON"),
        "height_m": _times(items.number("130", "ft"), FOOT),
        "flight_level": items.number("136", "FL"),
        "east_m": items.number("100", "m", "X"),
        "north_m": items.number("100", "m", "Y"),
        **_accuracy(items),
        "speed_m_s": speed,
        "course_deg": course,
        "icao_address": items.address("380", "ADR"),
        "mode_3a": items.code("060"),
        "callsign": items.text("380", "ID") or items.text("245", "CHR"),
    }


def _accuracy(items: _Items) -> dict[str, float | None]:
    """Return the estimated accuracy of a position: Cartesian or, without that, of WGS 84."""
    east, north = items.number("500", "m", "APC", "X"), items.number("500", "m", "APC", "Y")
    root = items.number("500", "m", "COV")
    latitude = items.number("105", "°", "LAT")
    if east is None and latitude is not None:
        east = _times(items.number("500", "°", "APW", "LON"), _DEGREE * cos(radians(latitude)))
        north = _times(items.number("500", "°", "APW", "LAT"), _DEGREE)
    return {
        "east_sigma_m": east,
        "north_sigma_m": north,
        # transmitted as the root of its size, with its sign
        "covariance_east_north_m2": None if root is None else root * abs(root),
    }


def _report(items: _Items) -> dict[str, Any]:
    address = items.address("080")
    # the finer one first
    place = next((item for item in ("131", "130") if items.whole(item, "LAT") is not None), "130")
    return {
        "target": address,
        "latitude_deg": items.number(place, "°", "LAT"),
        "longitude_deg": items.number(place, "°", "LON"),
        "height_m": _times(items.number("140", "ft"), FOOT),
        "flight_level": items.number("145", "FL"),
        "speed_m_s": _times(items.number("160", "NM/s", "GS"), NAUTICAL_MILE),
        "course_deg": items.number("160", "°", "TA"),
        "icao_address": address,
        "callsign": items.text("170"),
    }


_ROWS = {_PLOTS: _plot, _TRACKS: _track, _REPORTS: _report}


def _times(value: float | None, unit: float) -> float | None:
    return None if value is None else value * unit


def _polar(east: float | None, north: float | None) -> tuple[float | None, float | None]:
    if east is None or north is None:
        return None, None
    return float(np.hypot(east, north)), float(np.degrees(np.arctan2(east, north)) % 360.0)
