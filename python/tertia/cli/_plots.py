"""Plots of several sensors, read from files."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import polars as pl

from tertia.cli import _tables
from tertia.cli._terminal import WRONG_USAGE, fail
from tertia.tables._plots import FIXED, Columns, require_plots, second_plots


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
    rows = _tables.stacked(files, frames, columns.time, frames[0].columns[FIXED:])
    _check(rows, files, columns)
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
    return pl.DataFrame(
        {
            "sensor": sensor,
            "time": _tables.times(frame[columns.time], path),
            "angle": angle,
            "sigma": sigma,
            "file": pl.repeat(number, frame.height, eager=True),
            "row": pl.int_range(frame.height, eager=True),
            **{f"by {name}": frame[name] for name in columns.by},
        }
    ).filter(_tables.is_row(frame, path))


def _check(rows: pl.DataFrame, files: Sequence[Path], columns: Columns) -> None:
    def place(row: Mapping[str, Any]) -> str:
        return _tables.place(files[row["file"]], row["row"])

    try:
        require_plots(rows, columns, place)
    except ValueError as error:
        fail(str(error))
    again = second_plots(rows)
    if not again.is_empty():
        second = again.row(0, named=True)
        fail(
            f"{place(second)}: {second['sensor']} has a second plot at {columns.time} "
            f"{second['time']}; several targets need --by"
        )
