"""Plots of several sensors: read from files, and laid out by target, sensor and time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from tertia._arrays import FloatArray
from tertia.cli import _tables
from tertia.cli._terminal import WRONG_USAGE, fail, group_name

# columns of the rows before those of `by`
_FIXED = 6


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns of the input."""

    angle: str
    time: str
    sensor: str | None
    sigma: str | None
    by: list[str]

    def needed(self) -> list[str]:
        """Return all that must be there."""
        optional = [name for name in (self.sensor, self.sigma) if name is not None]
        return [self.angle, self.time, *optional, *self.by]


@dataclass(frozen=True, slots=True)
class Group:
    """The plots of one target: nan where a sensor has none at a time."""

    name: str
    keys: pl.DataFrame
    sensors: list[str]
    moments: pl.Series
    times: FloatArray
    z: FloatArray
    sigma: FloatArray
    missing: list[int]


def require_distinct(names: Sequence[str], message: str) -> None:
    """Fail with the first name that is there twice."""
    for at, name in enumerate(names):
        if name in names[:at]:
            fail(message.format(name), WRONG_USAGE)


def read_plots(files: Sequence[Path], columns: Columns) -> pl.DataFrame:
    """Return the rows of all files: sensor, time, angle, sigma, where they are, and `by`."""
    if columns.sensor is None:
        require_distinct(
            [path.stem for path in files], "two files are named {}: give --sensor-column"
        )
    frames = [_read_file(number, path, columns) for number, path in enumerate(files)]
    rows = _tables.stacked(files, frames, columns.time, frames[0].columns[_FIXED:])
    _refuse_seconds(rows, files, columns)
    if rows["angle"].is_nan().all():
        fail(f"there are no plots: {columns.angle} is missing everywhere")
    return rows


def _read_file(number: int, path: Path, columns: Columns) -> pl.DataFrame:
    frame = _tables.read(path, columns.needed())
    angle = _tables.numbers(frame[columns.angle], path)
    if columns.sensor is None:
        sensor = pl.repeat(path.stem, frame.height, eager=True, dtype=pl.String)
    else:
        sensor = _tables.without_marks(frame[columns.sensor].cast(pl.String))
    if columns.sigma is None:
        sigma = pl.repeat(math.nan, frame.height, eager=True, dtype=pl.Float64)
    else:
        sigma = _tables.numbers(frame[columns.sigma], path)
    time = _tables.times(frame[columns.time], path)
    rows = pl.DataFrame(
        {
            "sensor": sensor,
            "time": time,
            "angle": angle,
            "sigma": sigma,
            "file": pl.repeat(number, frame.height, eager=True),
            "row": pl.int_range(frame.height, eager=True),
            **{f"by {name}": frame[name] for name in columns.by},
        }
    ).filter(_tables.is_row(frame, path))
    present = ~pl.col("angle").is_nan()
    for name, wrong, requirement in [
        (columns.time, pl.col("time").is_null(), "missing"),
        (columns.sensor, pl.col("sensor").is_null(), "missing"),
        (columns.sigma, present & pl.col("sigma").is_nan(), "missing"),
        (columns.sigma, present & (pl.col("sigma") <= 0), "not positive"),
    ]:
        bad = rows.filter(wrong)
        if name is not None and not bad.is_empty():
            fail(f"{_tables.place(path, bad['row'][0])}: {name} is {requirement}")
    return rows


def _refuse_seconds(rows: pl.DataFrame, files: Sequence[Path], columns: Columns) -> None:
    """Fail if a sensor has two plots of one target at one time."""
    plots = rows.filter(~pl.col("angle").is_nan())
    one = pl.struct("sensor", "time", *rows.columns[_FIXED:])
    again = plots.filter(~one.is_first_distinct())
    if not again.is_empty():
        second = again.row(0, named=True)
        fail(
            f"{_tables.place(files[second['file']], second['row'])}: {second['sensor']} has a "
            f"second plot at {columns.time} {second['time']}; several targets need --by"
        )


def by_group(rows: pl.DataFrame, columns: Columns) -> list[Group]:
    """Return the plots of each target, sorted by time."""
    by = rows.columns[_FIXED:]
    # seconds from one origin, the earliest of all
    rows = rows.with_columns(pl.Series("seconds", _tables.seconds(rows["time"])))
    parts = rows.partition_by(by, maintain_order=True) if by else [rows]
    return [_group(part, part.select(by).head(1), columns) for part in parts]


def _group(rows: pl.DataFrame, keys: pl.DataFrame, columns: Columns) -> Group:
    times, first, step = np.unique(
        rows["seconds"].to_numpy(), return_index=True, return_inverse=True
    )
    sensors = rows["sensor"].unique(maintain_order=True)
    sensor = np.array([sensors.to_list().index(name) for name in rows["sensor"]])
    angle = rows["angle"].to_numpy()
    has = ~np.isnan(angle)
    z, sigma = np.full((2, len(sensors), times.size), np.nan)
    z[sensor[has], step[has]] = angle[has]
    sigma[sensor[has], step[has]] = rows["sigma"].to_numpy()[has]
    return Group(
        group_name(columns.by, keys.row(0)) if columns.by else "",
        keys.rename(dict(zip(keys.columns, columns.by, strict=True))),
        sensors.to_list(),
        rows["time"][first],
        times,
        z,
        sigma,
        np.bincount(sensor[~has], minlength=len(sensors)).tolist(),
    )
