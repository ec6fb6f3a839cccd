"""Recordings of radars in ASTERIX: plots, service messages of radars, system tracks, ADS-B."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tertia.io._asterix_rows import (
    MULTILATERATION,
    PLOTS,
    REPORTS,
    ROWS,
    SERVICES,
    SURFACE,
    TIMES,
    TRACKS,
    Items,
    is_of_target,
    surface_plot,
)
from tertia.io._packets import MAGIC, udp_payloads

if TYPE_CHECKING:
    import polars as pl

# so many data blocks of a category choose the edition by which it is decoded
_BLOCKS = 20
# titles of what is not read
_TITLES = {
    1: "radar plots, old",
    2: "radar service, old",
    4: "safety nets",
    8: "weather of a radar",
    11: "surface movement, fused",
    23: "ADS-B service",
    25: "ground system status",
    63: "sensor status",
    65: "tracker service",
    240: "radar video",
    247: "versions",
}
_HEADER = 3
_DAY = 86_400.0
_NORTH_MARKER = 1
_TEXT, _NUMBER, _FLAG = "String", "Float64", "Boolean"
_COMMON = {"time_s": _NUMBER, "sensor": _TEXT}
_IDENTITY = {"icao_address": _TEXT, "mode_3a": _TEXT, "callsign": _TEXT}
_PLACE = {"latitude_deg": _NUMBER, "longitude_deg": _NUMBER, "height_m": _NUMBER}
_MOTION = {"speed_m_s": _NUMBER, "course_deg": _NUMBER}
# columns of the tables, and what they hold
_COLUMNS = {
    PLOTS: {
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
    TRACKS: {
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
    REPORTS: {
        **_COMMON,
        "target": _TEXT,
        **_PLACE,
        "flight_level": _NUMBER,
        **_MOTION,
        "icao_address": _TEXT,
        "callsign": _TEXT,
    },
}
for _category in (SURFACE, MULTILATERATION):
    _COLUMNS[_category] = _COLUMNS[TRACKS]
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
    positions : DataFrame
        Target reports of surface movement and multilateration systems (categories 10 and 20), with
        the columns of `tracks`; `target` is the track number.
    skipped : dict of int to int
        Data blocks of other categories, by category.
    damaged : int
        Number of data blocks that are cut off or have a record that cannot be decoded: this and
        what follows it in the block are left out.
    first_damage : str
        Where the first of these is, and what is wrong; empty without.
    editions : dict of int to str
        The edition by which each category was decoded.
    repeated : int
        Number of duplicate plots, for example from two network lines; each is in the table once.
    other_packets : int
        Number of UDP packets of a network recording that do not contain ASTERIX.
    """

    plots: pl.DataFrame
    sensors: pl.DataFrame
    tracks: pl.DataFrame
    reports: pl.DataFrame
    positions: pl.DataFrame
    skipped: dict[int, int]
    damaged: int
    first_damage: str
    editions: dict[int, str]
    repeated: int
    other_packets: int

    def skipped_text(self) -> str:
        """Return which categories were not read, in words."""
        return ", ".join(
            f"{count} blocks of category {number} ({_TITLES.get(number, 'unknown')})"
            for number, count in self.skipped.items()
        )

    def __repr__(self) -> str:
        """Return the numbers of rows."""
        parts = {
            "plots": self.plots,
            "sensors": self.sensors,
            "tracks": self.tracks,
            "reports": self.reports,
            "positions": self.positions,
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
        A file that is not ASTERIX, of which no record can be decoded, or that is damaged between
        data blocks; the message gives the byte.
    ImportError
        A library that is not installed.
    OSError
        A file that cannot be read.

    Notes
    -----
    Radars are named by their codes, SAC/SIC. Times are seconds of the day (UTC), and continue
    beyond 86400 if a recording passes midnight. Mode 3/A codes and flight levels that are garbled
    or not validated are null. Duplicates, for example from two network lines, are removed.

    Decoded by libasterix, each category by the edition that decodes most of its first twenty data
    blocks; of equal ones by the newest.

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
    AsterixRecording(1 plots, 1 sensors, 0 tracks, 0 reports, 0 positions)
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
        self.other_packets = self.blocks = self.records = self.damaged = 0
        self.first_damage = ""
        self.editions: dict[int, Any] = {}
        # data blocks with their places, which wait for the choice of editions
        self.waiting: list[tuple[int, bytes, tuple[str, int]]] = []
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
            # other categories count only among those that are known
            known = category in self.known or self.blocks > 0
            if known and left < max(length, _HEADER):
                self._damage(f"{place}: the last data block is cut off")
                return
            if not known or length <= _HEADER:
                there = contents[at : at + 8].hex()
                raise ValueError(
                    f"{place}: there is no data block of ASTERIX, but {there}; the file is "
                    "damaged, or in another format"
                )
            self.blocks += 1
            if category in _COLUMNS or category in SERVICES:
                records = contents[at + _HEADER : at + length]
                self.waiting.append((category, records, (where, at + _HEADER)))
            else:
                self.skipped[category] += 1
            at += length

    def _damage(self, what: str) -> None:
        self.damaged += 1
        self.first_damage = self.first_damage or what

    def _decode(self) -> None:
        """Take the records of all data blocks."""
        for category in {block[0] for block in self.waiting}:
            sample = [block[1] for block in self.waiting if block[0] == category][:_BLOCKS]
            self.editions[category] = self._edition(category, sample)
        for category, block, begin in self.waiting:
            self._take_block(category, block, begin)
        if self.damaged and not self.records:
            raise ValueError(f"{self.first_damage}; no other record can be decoded")

    def _edition(self, category: int, blocks: list[bytes]) -> Any:
        """Return the edition that decodes most data blocks, of equal ones the newest."""
        best, most = None, -1
        for edition in reversed(self.known[category]):
            count = self._decodable(edition, blocks)
            if count > most:
                best, most = edition, count
            if most == len(blocks):
                break
        return best

    def _decodable(self, edition: Any, blocks: list[bytes]) -> int:
        """Return how many data blocks can be decoded by an edition."""
        return sum(self._parsed(edition, block)[1] == len(block) for block in blocks)

    def _parsed(self, edition: Any, block: bytes) -> tuple[list[Any], int, str]:
        """Return the records of a data block, where they end, and why they do not go on."""
        strict = self.base.ParsingMode.StrictParsing
        rest = self.base.Bits.from_bytes(block)
        records: list[Any] = []
        while len(rest):
            found = edition.cv_record.parse(strict, rest)
            if isinstance(found, ValueError):
                return records, len(block) - len(rest) // 8, str(found)
            record, rest = found
            records.append(record)
        return records, len(block), ""

    def _take_block(self, category: int, block: bytes, begin: tuple[str, int]) -> None:
        records, end, reason = self._parsed(self.editions[category], block)
        for record in records:
            self._take_record(category, Items(record))
        self.records += len(records)
        if reason:
            self._damage(
                f"{self.path}, {begin[0]}byte {begin[1] + end}: a record of category {category} is "
                f"damaged: {reason}"
            )

    def _take_record(self, category: int, items: Items) -> None:
        times = (items.number(item, "s") for item in TIMES[category])
        time = next((one for one in times if one is not None), None)
        time = None if time is None else self._since_the_first_day(time)
        source = items.whole("010", "SAC"), items.whole("010", "SIC")
        radar = None if None in source else "{}/{}".format(*source)
        if category in SERVICES:
            if radar is not None:
                self._take_service(radar, time, items)
            return
        if not is_of_target(category, items):
            return
        common = {"time_s": time, "sensor": radar}
        self.rows[category].append(common | ROWS[category](items))
        plot = surface_plot(items) if category == SURFACE else None
        if plot is not None:
            self.rows[PLOTS].append(common | plot)

    def _since_the_first_day(self, time: float) -> float:
        if self.now is not None:
            time += _DAY * round((self.now - time) / _DAY)
        self.now = time
        return time

    def _take_service(self, radar: str, time: float | None, items: Items) -> None:
        place = self.places.setdefault(radar, {})
        found = {
            "latitude_deg": items.number("120", "°", "LAT"),
            "longitude_deg": items.number("120", "°", "LON"),
            "height_m": items.number("120", "m", "HGT"),
        }
        if found["latitude_deg"] is None:
            # of a multilateration system
            found = {
                "latitude_deg": items.number("600", "°", "LAT"),
                "longitude_deg": items.number("600", "°", "LON"),
                "height_m": items.number("610", "m"),
            }
        place.update({name: value for name, value in found.items() if value is not None})
        turn = items.number("041", "s")
        if turn:
            self.turns[radar].append(turn)
        if items.whole("000") == _NORTH_MARKER and time is not None:
            self.norths[radar].append(time)

    def recording(self) -> AsterixRecording:
        """Return the recording."""
        self._decode()
        import polars as pl  # noqa: PLC0415  # only here is Polars needed

        tables = {
            category: pl.DataFrame(self.rows[category], _schema(columns)).unique(
                maintain_order=True
            )
            for category, columns in _COLUMNS.items()
        }
        positions = pl.concat([tables[SURFACE], tables[MULTILATERATION]])
        counts = Counter(tables[PLOTS]["sensor"].drop_nulls().to_list())
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
            plots=tables[PLOTS],
            sensors=pl.DataFrame(rows, _schema(_SENSORS)),
            tracks=tables[TRACKS],
            reports=tables[REPORTS],
            positions=positions,
            skipped=dict(sorted(self.skipped.items())),
            damaged=self.damaged,
            first_damage=self.first_damage,
            editions={
                category: ".".join(map(str, one.cv_edition))
                for category, one in sorted(self.editions.items())
            },
            repeated=len(self.rows[PLOTS]) - tables[PLOTS].height,
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
