"""Measurements of several stations: read from files, and laid out by target, time and station."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.cli import _tables
from tertia.cli._plots import require_distinct
from tertia.cli._stations import UNITS, Sites, sigma_column, value_column
from tertia.cli._terminal import WRONG_USAGE, fail, group_name, note
from tertia.sensors import Kind

# columns of a file with one row per measurement
_KIND, _VALUE, _SIGMA = "kind", "value", "sigma"
# columns of the rows before those of `by`
_FIXED = 7
# as many azimuths within one turn in radians, so far apart, are hardly degrees
_DOUBTFUL_COUNT, _DOUBTFUL_SPREAD = 20, 1.0


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns of the input."""

    time: str
    station: str
    by: list[str]

    def needed(self) -> list[str]:
        """Return all that must be there."""
        return [self.time, self.station, *self.by]


def check_columns(columns: Columns, results: set[str]) -> None:
    """Fail if one is given for two purposes, or is one of the results, too."""
    require_distinct(columns.needed(), "the column {} is given for two purposes")
    taken_names = results | {"station"} - {columns.station}
    for name in columns.needed():
        if name in taken_names:
            fail(f"the results have a column {name}, too: rename that of the file", WRONG_USAGE)


@dataclass(frozen=True, slots=True)
class Record:
    """What was measured of one target at N times by K stations, in metres and radians.

    `rows` holds the measurements one by one, `values` and `sigmas` as arrays (N, K) for each kind,
    nan where there is none, or where the file states none.
    """

    name: str
    keys: pl.DataFrame
    moments: pl.Series
    times: FloatArray
    rows: pl.DataFrame
    values: dict[Kind, FloatArray]
    sigmas: dict[Kind, FloatArray]

    def by_kind(self) -> Iterator[tuple[Kind, IntArray, IntArray, BoolArray]]:
        """Yield each kind with the times and stations of its measurements, and which rows."""
        for kind in self.values:
            own = (self.rows["kind"] == kind).to_numpy()
            rows = self.rows.filter(own)
            yield kind, rows["step"].to_numpy(), rows["site"].to_numpy(), own

    def measured(self) -> dict[Kind, FloatArray]:
        """Return the measurements as the library takes them."""
        return {kind: taken(kind, values) for kind, values in self.values.items()}


def taken(kind: Kind, array: FloatArray) -> FloatArray:
    """Return the columns that the library takes: differences are those to the first station."""
    return array[:, 1:] if kind == "range_difference" else array


def read_measurements(files: Sequence[Path], columns: Columns, sites: Sites) -> pl.DataFrame:
    """Return the measurements in all files: time, kind, station, value, sigma, where, and `by`.

    A row of a file in which nothing was measured remains, without a kind, for its time.
    """
    frames = [_read_file(number, path, columns, sites) for number, path in enumerate(files)]
    rows = _tables.stacked(files, frames, columns.time, frames[0].columns[_FIXED:])
    rows = rows.sort("file", "row", maintain_order=True)
    measured = rows.filter(pl.col("kind").is_not_null())
    if measured.is_empty():
        fail("nothing was measured: all values are missing")
    if sites.places.positions.shape[1] == 2 and (measured["kind"] == "elevation").any():
        column = sites.places.height_column
        fail(f"an elevation needs heights: give {column} of the stations in {sites.path}")
    _refuse_impossible(measured, files, columns)
    doubt_degrees(measured.filter(pl.col("kind") == "azimuth")["value"].to_numpy())
    return rows


def _read_file(number: int, path: Path, columns: Columns, sites: Sites) -> pl.DataFrame:
    frame = _tables.read(path, columns.needed())
    base = pl.DataFrame(
        {
            "time": _tables.times(frame[columns.time], path),
            "site": numbers_of_names(
                frame, path, columns.station, sites.names, f"the stations of {sites.path} are"
            ),
            "file": pl.repeat(number, frame.height, eager=True),
            "row": pl.int_range(frame.height, eager=True),
            **{f"by {name}": frame[name] for name in columns.by},
        }
    )
    there = _tables.is_row(frame, path)
    nowhere = base.filter(there & base["time"].is_null())
    if not nowhere.is_empty():
        fail(f"{_tables.place(path, nowhere['row'][0])}: {columns.time} is missing")
    parts = [
        base.with_columns(kind=kind, value=value, sigma=sigma)
        for kind, value, sigma in (
            _long(frame, path) if {_KIND, _VALUE} <= set(frame.columns) else _wide(frame, path)
        )
    ]
    fixed = ["time", "site", "kind", "value", "sigma", "file", "row"]
    rows = pl.concat(parts).select(*fixed, *base.columns[4:])
    measured = rows.filter(~pl.col("value").is_nan())
    empty = base.filter(there).join(measured, on="row", how="anti")
    empty = empty.with_columns(
        kind=pl.lit(None, pl.String), value=pl.lit(math.nan), sigma=pl.lit(math.nan)
    )
    return pl.concat([measured, empty.select(rows.columns)])


def numbers_of_names(
    frame: pl.DataFrame, path: Path, column: str, names: Sequence[str], told: str
) -> pl.Series:
    """Return which of the names a column has, by number; `told` begins the list of them."""
    found = _tables.without_marks(frame[column].cast(pl.String))
    unknown = _tables.is_row(frame, path) & ~found.is_in(list(names)).fill_null(False)
    if unknown.any():
        row = unknown.arg_true()[0]
        place, name = _tables.place(path, row), found[row]
        if name is None:
            fail(f"{place}: {column} is missing")
        fail(f"{place}: {column} is {name!r}; {told} {', '.join(names)}")
    numbers = {name: number for number, name in enumerate(names)}
    known: pl.Series = found.replace_strict(numbers, default=None, return_dtype=pl.Int64)
    return known


_Part = tuple[pl.Series | pl.Expr, pl.Series, pl.Series]


def _long(frame: pl.DataFrame, path: Path) -> Iterator[_Part]:
    """Yield kinds, values and sigmas of one row per measurement."""
    value = _tables.numbers(frame[_VALUE], path)
    kind = _tables.without_marks(frame[_KIND].cast(pl.String))
    wrong = (~value.is_nan() & ~kind.is_in(list(UNITS)).fill_null(False)).arg_true()
    if len(wrong):
        row = wrong[0]
        fail(
            f"{_tables.place(path, row)}: {_KIND} is {kind[row]!r}; it must be one of "
            f"{', '.join(UNITS)}"
        )
    yield kind, value, _sigmas(frame, _SIGMA, path)


def _wide(frame: pl.DataFrame, path: Path) -> Iterator[_Part]:
    """Yield kinds, values and sigmas of one row per station and time."""
    found = [kind for kind in UNITS if value_column(kind) in frame.columns]
    if not found:
        wanted = ", ".join(value_column(kind) for kind in UNITS)
        fail(
            f"{path} has no column of measurements: {wanted}, or {_KIND} and {_VALUE}; "
            f"{_tables.told_columns(frame)}",
            WRONG_USAGE,
        )
    for kind in found:
        value = _tables.numbers(frame[value_column(kind)], path)
        yield pl.lit(kind), value, _sigmas(frame, sigma_column(kind), path)


def _sigmas(frame: pl.DataFrame, column: str, path: Path) -> pl.Series:
    """Return standard deviations, nan where none are stated."""
    if column not in frame.columns:
        return pl.repeat(math.nan, frame.height, eager=True, dtype=pl.Float64)
    sigma = _tables.numbers(frame[column], path)
    wrong = (~sigma.is_nan() & (sigma <= 0)).arg_true()
    if len(wrong):
        row = wrong[0]
        fail(f"{_tables.place(path, row)}: {column} is {sigma[row]:g}; it must be positive")
    return sigma


def _refuse_impossible(rows: pl.DataFrame, files: Sequence[Path], columns: Columns) -> None:
    """Fail with the first row that is outside its domain, a second one, or no difference."""
    kind, value = pl.col("kind"), pl.col("value")
    same = pl.struct("site", "time", "kind", *rows.columns[_FIXED:])
    for wrong, message in [
        ((kind == "range") & (value <= 0), "range is {value:g}; it must be positive"),
        (
            (kind == "elevation") & (value.abs() > 180),
            "elevation is {value:g}; it must be between -180 and 180 degrees",
        ),
        (
            (kind == "range_difference") & (pl.col("site") == 0),
            "the first station has a range difference; they are those of the others to it",
        ),
        (
            ~same.is_first_distinct(),
            "a second {kind} of the same station at {named} {time}; several targets need --by",
        ),
    ]:
        bad = rows.filter(wrong)
        if not bad.is_empty():
            first = bad.row(0, named=True)
            place = _tables.place(files[first["file"]], first["row"])
            fail(f"{place}: {message.format(named=columns.time, **first)}")


def doubt_degrees(azimuth: FloatArray) -> None:
    """Say that azimuths look like radians; nan is left out."""
    azimuth = azimuth[~np.isnan(azimuth)]
    if (
        azimuth.size >= _DOUBTFUL_COUNT
        and np.all(np.abs(azimuth) <= 2 * math.pi)
        and np.ptp(azimuth) > _DOUBTFUL_SPREAD
    ):
        note("all azimuths are within 6.3 degrees: are they radians? Files hold degrees")


def by_target(rows: pl.DataFrame, columns: Columns, sites: Sites) -> list[Record]:
    """Return the measurements of each target, sorted by time."""
    by = rows.columns[_FIXED:]
    # seconds from one origin, the earliest of all
    rows = rows.with_columns(pl.Series("seconds", _tables.seconds(rows["time"])))
    parts = rows.partition_by(by, maintain_order=True) if by else [rows]
    return [_record(part, part.select(by).head(1), columns, sites) for part in parts]


def _record(rows: pl.DataFrame, keys: pl.DataFrame, columns: Columns, sites: Sites) -> Record:
    times, first, step = np.unique(
        rows["seconds"].to_numpy(), return_index=True, return_inverse=True
    )
    moments = rows["time"][first]
    rows = rows.with_columns(step=pl.Series(step, dtype=pl.Int64))
    rows = rows.filter(pl.col("kind").is_not_null())
    values: dict[Kind, FloatArray] = {}
    sigmas: dict[Kind, FloatArray] = {}
    for kind, (_, unit) in UNITS.items():
        own = rows.filter(pl.col("kind") == kind)
        if own.is_empty():
            continue
        at = own["step"].to_numpy(), own["site"].to_numpy()
        for told, name in ((values, "value"), (sigmas, "sigma")):
            told[kind] = np.full((times.size, len(sites.names)), np.nan)
            told[kind][at] = own[name].to_numpy() * unit
    return Record(
        group_name(columns.by, keys.row(0)) if columns.by else "",
        keys.rename(dict(zip(keys.columns, columns.by, strict=True))),
        moments,
        times,
        rows,
        values,
        sigmas,
    )
