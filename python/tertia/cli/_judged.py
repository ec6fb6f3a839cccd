"""Tracks and the truth, read from files."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl

from tertia._arrays import FloatArray, IntArray
from tertia.cli import _tables
from tertia.cli._terminal import fail
from tertia.report._evaluation import Rows, Truth

_PLACE = ("east_m", "north_m")
_VELOCITY = ("velocity_east_m_s", "velocity_north_m_s")
_SPREAD = ("east_sigma_m", "north_sigma_m", "covariance_east_north_m2")


def read_pair(tracks: Path, truth: Path) -> tuple[Rows, Truth]:
    """Return tracks and truth, their times from the same origin."""
    shown = _read(tracks, ["time_s", "track", *_PLACE])
    real = _read(truth, ["time_s", "target", *_PLACE])
    times = [_times(frame, path) for frame, path in ((shown, tracks), (real, truth))]
    merged = _tables.stacked(
        [tracks, truth], [pl.DataFrame({"time": t}) for t in times], "time_s", []
    )
    seconds = _tables.seconds(merged["time"])
    return (
        _rows(shown, tracks, seconds[: shown.height]),
        _truth(real, truth, seconds[shown.height :]),
    )


def read_truth(
    path: Path, dates: pl.DataType | None, seconds: Callable[[pl.Series], FloatArray]
) -> Truth:
    """Return the truth; `seconds` turns times into those of the plots, which hold `dates`."""
    real = _read(path, ["time_s", "target", *_PLACE])
    times = _times(real, path)
    if isinstance(times.dtype, pl.Datetime) != (dates is not None):
        kinds = ("numbers", "dates")[:: 1 if dates is None else -1]
        fail(f"time_s of the plots holds {kinds[0]}, that of {path} {kinds[1]}")
    return _truth(real, path, seconds(times if dates is None else times.cast(dates)))


def _read(path: Path, columns: list[str]) -> pl.DataFrame:
    if path.suffix.lower() == ".json":
        fail(f"cannot read {path}: tables are read from CSV or Parquet")
    frame = _tables.read(path, columns)
    frame = frame.filter(_tables.is_row(frame, path))
    if frame.is_empty():
        fail(f"{path} is empty")
    return frame


def _times(frame: pl.DataFrame, path: Path) -> pl.Series:
    times = _tables.times(frame["time_s"], path)
    _refuse(times.is_null(), path, "time_s is missing")
    return times


def _refuse(wrong: pl.Series, path: Path, message: str) -> None:
    rows = wrong.arg_true()
    if len(rows):
        fail(f"{_tables.place(path, rows[0])}: {message}")


def _vectors(frame: pl.DataFrame, path: Path, columns: tuple[str, ...]) -> FloatArray | None:
    if not set(columns) <= set(frame.columns):
        return None
    return np.column_stack([_tables.numbers(frame[name], path).to_numpy() for name in columns])


def _places(frame: pl.DataFrame, path: Path) -> FloatArray:
    places = np.column_stack([_tables.numbers(frame[name], path).to_numpy() for name in _PLACE])
    for name, values in zip(_PLACE, places.T, strict=True):
        _refuse(pl.Series(np.isnan(values)), path, f"{name} is missing")
    return places


def _names(column: pl.Series, path: Path) -> tuple[IntArray, list[str]]:
    """Return numbers of what a column names, and the names."""
    text = _tables.without_marks(column.cast(pl.String))
    _refuse(text.is_null(), path, f"{column.name} is missing")
    names, numbers = np.unique(text.to_numpy().astype(str), return_inverse=True)
    return numbers.astype(np.int64), names.tolist()


def _rows(frame: pl.DataFrame, path: Path, seconds: FloatArray) -> Rows:
    """Return the rows of confirmed tracks."""
    places = _places(frame, path)
    velocity = _vectors(frame, path, _VELOCITY)
    spread = _vectors(frame, path, _SPREAD)
    sure, updated = (np.ones(frame.height, dtype=bool) for _ in range(2))
    if "confirmed" in frame.columns:
        sure = (frame["confirmed"].cast(pl.String).str.to_lowercase() == "true").to_numpy()
    if "plot" in frame.columns:
        updated = ~np.isnan(_tables.numbers(frame["plot"], path).to_numpy())
    if not np.any(sure & updated):
        fail(f"{path} has no update of a confirmed track")
    track, _ = _names(frame["track"], path)
    radar = np.zeros_like(track)
    if "radar" in frame.columns:
        radar, _ = _names(frame["radar"], path)
    covariance = None
    if spread is not None:
        east, north, both = spread.T
        covariance = np.stack([east**2, both, both, north**2], axis=-1).reshape(-1, 2, 2)[sure]
    moving = np.zeros_like(places) if velocity is None else np.nan_to_num(velocity)
    return Rows(
        seconds[sure],
        track[sure],
        radar[sure],
        places[sure],
        moving[sure],
        covariance,
        updated[sure],
    )


def _truth(frame: pl.DataFrame, path: Path, seconds: FloatArray) -> Truth:
    places = _places(frame, path)
    target, names = _names(frame["target"], path)
    order = np.lexsort((seconds, target))
    again = (np.diff(target[order]) == 0) & (np.diff(seconds[order]) == 0)
    if np.any(again):
        row = int(order[1:][again].min())
        told = f"a second position of target {names[target[row]]} at time_s {frame['time_s'][row]}"
        fail(f"{_tables.place(path, row)}: {told}")
    return Truth(seconds, target, places, names)
