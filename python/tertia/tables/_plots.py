"""Plots of several sensors, laid out by target, sensor and time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from tertia._arrays import FloatArray
from tertia.tables._columns import seconds

# columns of the rows before those of `by`
FIXED = 6


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

    values: tuple[Any, ...]
    keys: pl.DataFrame
    sensors: list[str]
    moments: pl.Series
    times: FloatArray
    z: FloatArray
    sigma: FloatArray
    missing: list[int]


def require_plots(
    rows: pl.DataFrame, columns: Columns, place: Callable[[Mapping[str, Any]], str]
) -> None:
    """Refuse rows: sensor, time, angle, sigma, where they are (file, row), and `by`.

    `place` tells where a row is. Raises ValueError if a row lacks what it needs.
    """
    present = ~pl.col("angle").is_nan()
    for name, wrong, requirement in [
        (columns.time, pl.col("time").is_null(), "missing"),
        (columns.sensor, pl.col("sensor").is_null(), "missing"),
        (columns.sigma, present & pl.col("sigma").is_nan(), "missing"),
        (columns.sigma, present & (pl.col("sigma") <= 0), "not positive"),
    ]:
        bad = rows.filter(wrong)
        if name is not None and not bad.is_empty():
            raise ValueError(f"{place(bad.row(0, named=True))}: {name} is {requirement}")


def second_plots(rows: pl.DataFrame) -> pl.DataFrame:
    """Return the plots at whose time the sensor has another one of the same target before."""
    plots = rows.filter(~pl.col("angle").is_nan())
    return plots.filter(~pl.struct("sensor", "time", *rows.columns[FIXED:]).is_first_distinct())


def by_group(rows: pl.DataFrame, columns: Columns) -> list[Group]:
    """Return the plots of each target, sorted by time."""
    by = rows.columns[FIXED:]
    # seconds from one origin, the earliest of all
    rows = rows.with_columns(pl.Series("seconds", seconds(rows["time"])))
    parts = rows.partition_by(by, maintain_order=True) if by else [rows]
    return [_group(part, part.select(by).head(1), columns) for part in parts]


def _group(rows: pl.DataFrame, keys: pl.DataFrame, columns: Columns) -> Group:
    times, first, step = np.unique(
        rows["seconds"].to_numpy(), return_index=True, return_inverse=True
    )
    sensors = rows["sensor"].unique(maintain_order=True)
    sensor = rows["sensor"].cast(pl.Enum(sensors)).to_physical().to_numpy()
    angle = rows["angle"].to_numpy()
    has = ~np.isnan(angle)
    z, sigma = np.full((2, len(sensors), times.size), np.nan)
    z[sensor[has], step[has]] = angle[has]
    sigma[sensor[has], step[has]] = rows["sigma"].to_numpy()[has]
    return Group(
        keys.row(0) if columns.by else (),
        keys.rename(dict(zip(keys.columns, columns.by, strict=True))),
        sensors.to_list(),
        rows["time"][first],
        times,
        z,
        sigma,
        np.bincount(sensor[~has], minlength=len(sensors)).tolist(),
    )
