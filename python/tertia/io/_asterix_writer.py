"""System tracks as records of ASTERIX, category 62."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import polars as pl

from tertia._arrays import BoolArray, FloatArray
from tertia._units import FOOT
from tertia.io._categories import TRACKS

Octets = npt.NDArray[np.uint8]
# number of records in a data block, which must fit in a packet
_RECORDS = 16
_DAY = 86_400.0
_ANGLE = 180 / 2**25
_TRACKS_THERE = 65_536
_SIX_BITS = {" ": 32, **{chr(64 + code): code for code in range(1, 27)}}
_SIX_BITS |= {str(digit): 48 + digit for digit in range(10)}
# columns of the modes of movement, and the first bit of each
_MODES = {"transversal": 6, "longitudinal": 4, "vertical": 2}


@dataclass(frozen=True, slots=True)
class _Item:
    """An item: octets (N, n), the records that have it, and the octets that are written in each."""

    octets: Octets
    there: BoolArray
    parts: BoolArray | None = None

    @property
    def written(self) -> BoolArray:
        """Whether each octet is written, (N, n)."""
        parts = np.ones(self.octets.shape, bool) if self.parts is None else self.parts
        return parts & self.there[:, None]


def asterix_tracks(tracks: pl.DataFrame, source: tuple[int, int]) -> bytes:
    """Return the contents of the file that `write_asterix` writes."""
    return b"".join(asterix_blocks(tracks, source))


def asterix_blocks(tracks: pl.DataFrame, source: tuple[int, int]) -> list[bytes]:
    """Return the data blocks of tracks, each of which fits in a packet."""
    table = _Table(tracks)
    items = {
        1: table.constant(bytes(source)),
        4: table.time(),
        5: table.item({"latitude_deg": _ANGLE, "longitude_deg": _ANGLE}, 4),
        6: table.item({"east_m": 0.5, "north_m": 0.5}, 3),
        7: table.item({"velocity_east_m_s": 0.25, "velocity_north_m_s": 0.25}, 2),
        9: table.code(),
        11: _compound([table.address(), table.callsign()]),
        12: table.number(),
        13: table.status(),
        15: table.movement(),
        17: table.item({"flight_level": 0.25}, 2),
        18: table.item({"height_m": 6.25 * FOOT}, 2),
        20: table.item({"vertical_rate_m_s": 6.25 * FOOT / 60}, 2),
        27: _compound(
            [
                table.item({"east_sigma_m": 0.5, "north_sigma_m": 0.5}, 2, signed=False),
                table.covariance(),
                *3 * [table.nothing()],
                table.item(
                    {"velocity_east_sigma_m_s": 0.25, "velocity_north_sigma_m_s": 0.25},
                    1,
                    signed=False,
                ),
            ]
        ),
    }
    spec = _field_specification(items, len(tracks))
    parts = [spec, *(items[number] for number in sorted(items))]
    octets = np.hstack([one.octets for one in parts])
    there = np.hstack([one.written for one in parts])
    return _blocks(octets[there].tobytes(), there.sum(axis=1))


class _Table:
    """Columns of tracks, and the items that are made from them."""

    def __init__(self, tracks: pl.DataFrame) -> None:
        self.tracks = _with_velocities(tracks)
        self.count = tracks.height

    def nothing(self) -> _Item:
        return _Item(np.zeros((self.count, 0), np.uint8), np.zeros(self.count, bool))

    def constant(self, octets: bytes) -> _Item:
        row = np.frombuffer(octets, np.uint8)
        return _Item(np.tile(row, (self.count, 1)), np.ones(self.count, bool))

    def values(self, name: str) -> FloatArray:
        """Return a column as numbers; nan where a value is missing."""
        if name not in self.tracks.columns:
            return np.full(self.count, np.nan)
        # nan where null
        values: FloatArray = self.tracks[name].cast(pl.Float64).to_numpy()
        return values

    def item(self, scales: dict[str, float], size: int, *, signed: bool = True) -> _Item:
        """Return an item made from columns with the given steps, each in `size` octets."""
        parts = [
            self._steps(name, self.values(name) / scale, size, signed=signed)
            for name, scale in scales.items()
        ]
        there = np.logical_and.reduce([one.there for one in parts])
        return _Item(np.hstack([one.octets for one in parts]), there)

    def _steps(self, name: str, steps: FloatArray, size: int, *, signed: bool) -> _Item:
        room = 2.0 ** (8 * size - signed)
        # a sigma that is too large for the item is left out, because a smaller one would be wrong
        there = ~np.isnan(steps) & (signed | (steps < room - 0.5))
        whole = np.rint(np.where(there, steps, 0.0))
        wrong = np.flatnonzero((whole >= room) | (whole < (-room if signed else 0)))
        if wrong.size:
            row = int(wrong[0])
            raise ValueError(
                f"row {row}: {name} is {self.values(name)[row]:g}, outside the range of category 62"
            )
        return _Item(_big_endian(whole.astype(np.int64), size), there)

    def time(self) -> _Item:
        if "time_s" not in self.tracks.columns:
            raise ValueError("tracks have no column time_s")
        time = self.tracks["time_s"]
        if time.dtype.is_temporal():
            time = time.dt.timestamp("us") / 1e6
        seconds = time.cast(pl.Float64).to_numpy()
        # times just before midnight may round to midnight
        steps = np.rint(seconds % _DAY * 128) % (_DAY * 128)
        return self._steps("time_s", steps, 3, signed=False)

    def number(self) -> _Item:
        name = next((one for one in ("track", "target") if one in self.tracks.columns), None)
        if name is None:
            raise ValueError("tracks have no column track or target")
        numbers = self.tracks[name].cast(pl.Int64, strict=False)
        if numbers.null_count():
            # names are numbered in alphabetical order
            numbers = self.tracks[name].cast(pl.String).rank("dense").cast(pl.Int64)
        return _Item(_big_endian(numbers.to_numpy() % _TRACKS_THERE, 2), np.ones(self.count, bool))

    def covariance(self) -> _Item:
        """Return the square root of the absolute covariance of east and north, with its sign."""
        name = "covariance_east_north_m2"
        covariance = self.values(name)
        root = np.sign(covariance) * np.sqrt(np.abs(covariance))
        return self._steps(name, root / 0.5, 2, signed=True)

    def status(self) -> _Item:
        """Return whether tracks are confirmed and, in the fourth octet, whether coasted."""
        octets = np.zeros((self.count, 4), np.uint8)
        octets[:, 0] = 2 * ~self._flags("confirmed", default=True)
        plotless = self.tracks["plot"].is_null() if "plot" in self.tracks.columns else False
        coasted = self._flags("coasted", default=False) | np.asarray(plotless)
        octets[coasted] |= np.array([1, 1, 1, 0x80], np.uint8)
        written = coasted[:, None] | (np.arange(4) == 0)
        return _Item(octets, np.ones(self.count, bool), written)

    def _flags(self, name: str, *, default: bool) -> BoolArray:
        if name not in self.tracks.columns:
            return np.full(self.count, default)
        flags: BoolArray = self.tracks[name].cast(pl.Boolean).fill_null(default).to_numpy()
        return flags

    def movement(self) -> _Item:
        """Return the modes of movement; unknown modes are coded as undetermined, 3."""
        if not set(_MODES) & set(self.tracks.columns):
            return self.nothing()
        octets = np.zeros(self.count, np.int64)
        known = np.zeros(self.count, bool)
        for name, at in _MODES.items():
            mode = self.values(name)
            known |= ~np.isnan(mode)
            octets |= np.where(np.isnan(mode), 3, mode).astype(np.int64) % 4 << at
        return _Item(octets.astype(np.uint8)[:, None], known)

    def code(self) -> _Item:
        return self._texts("mode_3a", lambda text: int(text, 8), 2)

    def address(self) -> _Item:
        return self._texts("icao_address", lambda text: int(text, 16), 3)

    def callsign(self) -> _Item:
        return self._texts("callsign", _six_bits, 6)

    def _texts(self, name: str, number: Any, size: int) -> _Item:
        if name not in self.tracks.columns:
            return self.nothing()
        column = self.tracks[name].cast(pl.String)
        if column.null_count() == self.count:
            return self.nothing()
        known = column.unique().drop_nulls()
        try:
            numbers = {text: number(text) for text in known}
        except (KeyError, ValueError):
            raise ValueError(
                f"{name} has values that cannot be encoded, among {known.to_list()[:3]}"
            ) from None
        if any(one >= 2 ** (8 * size) for one in numbers.values()):
            raise ValueError(f"{name} has a number that needs more than {8 * size} bits")
        values = column.replace_strict(numbers, default=None, return_dtype=pl.Int64)
        there = values.is_not_null().to_numpy()
        return _Item(_big_endian(values.fill_null(0).to_numpy(), size), there)


def _with_velocities(tracks: pl.DataFrame) -> pl.DataFrame:
    """Return tracks with velocities, computed from speeds and courses if necessary."""
    columns = set(tracks.columns)
    if "velocity_east_m_s" in columns or not {"speed_m_s", "course_deg"} <= columns:
        return tracks
    course = pl.col("course_deg").radians()
    return tracks.with_columns(
        velocity_east_m_s=pl.col("speed_m_s") * course.sin(),
        velocity_north_m_s=pl.col("speed_m_s") * course.cos(),
    )


def _six_bits(text: str) -> int:
    code = 0
    for letter in text[:8].upper().ljust(8):
        code = code << 6 | _SIX_BITS[letter]
    return code


def _big_endian(values: npt.NDArray[np.int64], size: int) -> Octets:
    """Return whole numbers in two's complement, in the given number of octets."""
    return values.astype(">i8").view(np.uint8).reshape(-1, 8)[:, 8 - size :]


def _compound(parts: list[_Item]) -> _Item:
    """Return a compound item of the parts that are present."""
    flags = np.zeros(len(parts[0].there), np.uint8)
    for at, part in enumerate(parts):
        flags |= (part.there << 7 - at).astype(np.uint8)
    every = [_Item(flags[:, None], flags > 0), *parts]
    written = np.hstack([one.written for one in every])
    return _Item(np.hstack([one.octets for one in every]), flags > 0, written)


def _field_specification(items: dict[int, _Item], count: int) -> _Item:
    """Return which items are present, in four octets; the accuracy is in the last."""
    octets = np.zeros((count, 4), np.uint8)
    for number, item in items.items():
        octet, bit = divmod(number - 1, 7)
        octets[:, octet] |= (item.there << 7 - bit).astype(np.uint8)
    octets[:, :-1] |= 1
    return _Item(octets, np.ones(count, bool))


def _blocks(records: bytes, lengths: npt.NDArray[np.int64]) -> list[bytes]:
    ends = np.concatenate([[0], np.cumsum(lengths)])[::_RECORDS].tolist()
    if ends[-1] != len(records):
        ends.append(len(records))
    return [
        bytes([TRACKS]) + (end - begin + 3).to_bytes(2, "big") + records[begin:end]
        for begin, end in pairwise(ends)
    ]
