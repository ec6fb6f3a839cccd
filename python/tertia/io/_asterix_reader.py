"""Data blocks of ASTERIX, decoded and converted to tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from tertia import _core
from tertia._arrays import FloatArray, IntArray
from tertia.io._asterix_rows import (
    ROWS,
    TIMES,
    Items,
    is_of_target,
    services,
    status,
    surface_plots,
)
from tertia.io._categories import (
    COLUMNS,
    KNOWN,
    MESSAGES,
    MULTILATERATION,
    OLD_PLOTS,
    PLOTS,
    REPORTS,
    SENSOR_STATUS,
    SENSORS,
    SERVICES,
    STATUS,
    SURFACE,
    TRACKS,
)

# number of data blocks of a category from which its edition is chosen
_BLOCKS = 20
_HEADER = 3
_DAY = 86_400.0
_NORTH_MARKER = 1
# value that the decoder returns for an item that a record does not have
_MISSING = np.iinfo(np.int64).min
_PLACE = ("latitude_deg", "longitude_deg", "height_m")


class Reader:
    """Collects data blocks, and converts them to tables."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.payloads: list[bytes] = []
        # for each payload: its first byte in all payloads together, and its name in messages
        self.begins: list[int] = []
        self.places: list[str] = []
        self.size = self.other_packets = self.damaged = self.lost_bytes = 0
        self.first_damage = ""
        self.blocks: list[tuple[IntArray, IntArray, IntArray]] = []
        self.editions: dict[int, str] = {}

    def take_packet(self, payload: bytes, number: int) -> None:
        """Collect the data blocks of a packet; a packet with other contents is only counted."""
        category, *_, stop = found = _core.asterix_blocks(payload)
        if stop == len(payload) > 0 and KNOWN.issuperset(category.tolist()):
            self._collect(payload, f"packet {number}, ", found)
        else:
            self.other_packets += 1

    def take_frame(self, payload: bytes | None, number: int) -> None:
        """Collect the data blocks of a frame; damaged parts are left out and counted."""
        if payload is None:
            self._damage(1, f"{self.path}, frame {number} is cut off or damaged")
            return
        *_, stop = found = _core.asterix_blocks(payload)
        if stop < len(payload):
            self._damage(1, f"{self.path}, frame {number}, byte {stop}: no data block begins here")
        self._collect(payload, f"frame {number}, ", found)

    def take(self, contents: bytes) -> None:
        """Collect the data blocks of a file, including those after damaged parts."""
        *found, gaps = _core.asterix_recording(contents, sorted(KNOWN))
        for at, lost in gaps:
            self.lost_bytes += lost
            length = max(int.from_bytes(contents[at + 1 : at + _HEADER], "big"), _HEADER)
            left = len(contents) - at
            there = contents[at : at + 8].hex()
            if not lost:
                what = f"the length of a data block is damaged: {length}"
            elif lost == left < length and (at or contents[at] in KNOWN):
                what = (
                    f"the data block is cut off, or its length is damaged: only {left} of its "
                    f"{length} bytes are there, which are left out"
                )
            elif len(found[0]):
                what = f"no data block begins here (bytes {there}); {lost} bytes are left out"
            else:
                raise ValueError(
                    f"{self.path}, byte {at}: no ASTERIX data block begins here (bytes {there}); "
                    "the file is damaged, or in another format"
                )
            self._damage(1, f"{self.path}, byte {at}: {what}")
        self._collect(contents, "", found)

    def _collect(self, contents: bytes, where: str, found: Any) -> None:
        category, begin, end, *_ = found
        self.blocks.append((category, begin + self.size, end + self.size))
        self.payloads.append(contents)
        self.begins.append(self.size)
        self.places.append(where)
        self.size += len(contents)

    def _damage(self, count: int, first: str) -> None:
        self.damaged += count
        self.first_damage = self.first_damage or first

    def recording(self) -> dict[str, Any]:
        """Return the contents of the recording, by the names of its fields."""
        category, begin, end = (np.concatenate(each) for each in zip(*self.blocks, strict=True))
        contents = self.payloads[0] if len(self.payloads) == 1 else b"".join(self.payloads)
        records: dict[int, _Records] = {}
        damage: list[tuple[int, int, str]] = []
        for number in sorted({*COLUMNS, *MESSAGES} & set(category.tolist())):
            [own] = np.nonzero(category == number)
            definition = _edition(number, contents, begin[own], end[own])
            block, columns, wrong = _core.asterix_records(
                definition, contents, begin[own], end[own]
            )
            self.editions[number] = _DEFINITIONS[definition][1][0]
            damage += [(int(own[where]), at, reason) for where, at, reason in wrong]
            records[number] = _Records(own[block], definition, columns)
        if OLD_PLOTS in records:
            records[OLD_PLOTS].repeat_sources()
        self._say_damage(damage, category)
        if self.damaged and not any(len(one.block) for one in records.values()):
            raise ValueError(f"{self.first_damage}; no other record can be decoded")
        _set_times(records)
        skipped = Counter(category[~np.isin(category, list(records))].tolist())
        return self._tables(records) | {
            "skipped": dict(sorted(skipped.items())),
            "damaged": self.damaged,
            "lost_bytes": self.lost_bytes,
            "first_damage": self.first_damage,
            "editions": self.editions,
            "truncated_times": _are_truncated(records),
            "other_packets": self.other_packets,
        }

    def _say_damage(self, damage: list[tuple[int, int, str]], category: IntArray) -> None:
        if not damage:
            return
        block, at, reason = min(damage)
        payload = int(np.searchsorted(self.begins, at, side="right")) - 1
        self._damage(
            len(damage),
            f"{self.path}, {self.places[payload]}byte {at - self.begins[payload]}: a record of "
            f"category {category[block]} is damaged: {reason}",
        )

    @staticmethod
    def _tables(records: Mapping[int, _Records]) -> dict[str, Any]:
        tables = {
            number: [records[number].rows(number, ROWS[number])] if number in records else []
            for number in ROWS
        }
        tables[PLOTS] += tables.pop(OLD_PLOTS)
        if SURFACE in records:
            measured = records[SURFACE].rows(SURFACE, surface_plots, PLOTS)
            tables[PLOTS].append(measured.filter(pl.col("range_nm").is_not_null()))
        told = [records[one].rows(one, status, SENSOR_STATUS) for one in MESSAGES if one in records]
        said = pl.any_horizontal(pl.col(*STATUS).is_not_null())
        tables[SENSOR_STATUS] = [one.filter(said) for one in told]
        joined = {number: _joined(number, parts) for number, parts in tables.items()}
        distinct = {
            number: one.unique(maintain_order=True) if one.height else one
            for number, one in joined.items()
        }
        plots = distinct[PLOTS]
        return {
            "plots": plots,
            "sensors": _sensors([records[one] for one in SERVICES if one in records], plots),
            "tracks": distinct[TRACKS],
            "reports": distinct[REPORTS],
            "positions": pl.concat([distinct[SURFACE], distinct[MULTILATERATION]]),
            "messages": distinct[SENSOR_STATUS],
            "repeated": joined[PLOTS].height - plots.height,
        }


class _Records:
    """Records of a category: their data blocks and columns."""

    def __init__(self, block: IntArray, definition: int, columns: list[IntArray]) -> None:
        self.block, self.definition = block, definition
        names = [name for name, *_ in _DEFINITIONS[definition][2]]
        raw = pl.DataFrame(dict(zip(names, columns, strict=True)))
        self.frame = raw.select(pl.when(pl.all() != _MISSING).then(pl.all()))
        self.time: FloatArray = np.empty(0)

    def times(self, number: int) -> FloatArray:
        """Return the times of day; nan where one is missing."""
        items = _items(self.definition)
        each = pl.coalesce([items.number(item, "s") for item in TIMES[number]])
        # nan where null
        return self.frame.select(each)[:, 0].to_numpy()

    def repeat_sources(self) -> None:
        """Give a record without a source the source of the previous record in the same block."""
        codes = pl.col("010/SAC", "010/SIC")
        if self.frame["010/SAC"].null_count():
            self.frame = self.frame.with_columns(
                codes.forward_fill().over(pl.Series("block", self.block))
            )

    def sources(self) -> IntArray:
        """Return the sources of the records, each as one number."""
        both = pl.col("010/SAC") * 256 + pl.col("010/SIC")
        return self.frame.select(both.fill_null(_MISSING))[:, 0].to_numpy()

    def rows(self, number: int, convert: Any, table: int | None = None) -> pl.DataFrame:
        """Return the rows of a table, with the data blocks of the records."""
        found = self.frame.select(
            pl.Series("block", self.block),
            pl.Series("time_s", self.time, nan_to_null=True),
            *_columns(self.definition, convert, table or number),
        )
        if number == SURFACE:
            found = found.filter("of_target")
        return found.drop("of_target")


@cache
def _items(definition: int) -> Items:
    return Items(_DEFINITIONS[definition][2])


@cache
def _columns(definition: int, convert: Any, table: int) -> list[pl.Expr]:
    """Return the columns of a table of records, and whether each record is of a target."""
    items = _items(definition)
    kinds = _schema(COLUMNS.get(table, {}))
    columns = {"sensor": items.sensor(), **convert(items)}
    return [
        *(
            (value.cast(kinds[name]) if name in kinds else value).alias(name)
            for name, value in columns.items()
        ),
        is_of_target(_DEFINITIONS[definition][0], items).alias("of_target"),
    ]


def _edition(number: int, contents: bytes, begin: IntArray, end: IntArray) -> int:
    """Return the definition that decodes most data blocks; the newest of several equal ones."""
    best, least = -1, _BLOCKS + 1
    for at, (category, *_) in enumerate(_DEFINITIONS):
        if category == number:
            found = _core.asterix_records(at, contents, begin[:_BLOCKS], end[:_BLOCKS])
            damaged = len(found[2])
            if damaged < least:
                best, least = at, damaged
    return best


def _set_times(records: Mapping[int, _Records]) -> None:
    """Complete truncated times, and continue all times past midnight, in the order of records."""
    every = list(records.values())
    if not every:
        return
    for number, one in records.items():
        one.time = one.times(number)
    order = np.argsort(np.concatenate([one.block for one in every]), kind="stable")
    time = np.concatenate([one.time for one in every])[order]
    if OLD_PLOTS in records:
        old = np.concatenate([np.full(len(one.block), one is records[OLD_PLOTS]) for one in every])
        source = np.concatenate([one.sources() for one in every])[order]
        old = old[order]
        time = _core.asterix_times(np.where(old, np.nan, time), np.where(old, time, np.nan), source)
    there = np.flatnonzero(~np.isnan(time))
    time[there] += _DAY * np.cumsum(np.rint(-np.diff(time[there], prepend=time[there[:1]]) / _DAY))
    unsorted = np.empty_like(time)
    unsorted[order] = time
    counts = np.cumsum([len(one.block) for one in every])
    for one, its in zip(every, np.split(unsorted, counts[:-1]), strict=True):
        one.time = its


def _are_truncated(records: Mapping[int, _Records]) -> bool:
    """Return whether only old plots have times, which are truncated."""
    times = {number for number, one in records.items() if np.isfinite(one.time).any()}
    return times == {OLD_PLOTS}


@cache
def _empty(number: int) -> pl.DataFrame:
    return pl.DataFrame(schema=_schema(COLUMNS[number]))


def _joined(number: int, parts: list[pl.DataFrame]) -> pl.DataFrame:
    """Return rows in the order of their records."""
    if not parts:
        return _empty(number)
    rows = parts[0] if len(parts) == 1 else pl.concat(parts).sort("block", maintain_order=True)
    return rows.drop("block")


def _sensors(messages: list[_Records], plots: pl.DataFrame) -> pl.DataFrame:
    """Return one row per sensor that sent plots or service messages."""
    own = plots.lazy().drop_nulls("sensor")
    counts = own.group_by("sensor").agg(plot_count=pl.len().cast(pl.Int64))
    told = [one.rows(0, services) for one in messages]
    if told:
        every = pl.concat(told).lazy().drop_nulls("sensor").sort("block", maintain_order=True)
        norths = pl.col("time_s").filter(pl.col("kind") == _NORTH_MARKER)
        turns = pl.col("scan_period_s").filter(pl.col("scan_period_s") > 0)
        said = every.group_by("sensor").agg(
            *(pl.col(name).drop_nulls().last() for name in _PLACE),
            scan_period_s=pl.coalesce(
                turns.median(), norths.drop_nulls().unique().sort().diff().median()
            ),
        )
        counts = said.join(counts, on="sensor", how="full", coalesce=True)
    else:
        counts = counts.with_columns(
            pl.lit(None).alias(name) for name in (*_PLACE, "scan_period_s")
        )
    codes = pl.col("sensor").str.split("/").list.eval(pl.element().cast(pl.Int64))
    return (
        counts.select(pl.col(name).cast(kind) for name, kind in _schema(SENSORS).items())
        .with_columns(pl.col("plot_count").fill_null(0))
        .sort(codes.list.get(0), codes.list.get(1))
        .collect()
    )


def _schema(columns: Mapping[str, str]) -> Any:
    return {name: getattr(pl, kind) for name, kind in columns.items()}


_DEFINITIONS = _core.asterix_definitions()
