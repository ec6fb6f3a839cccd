"""Tracks and the truth, read from files."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl

from tertia._arrays import FloatArray, IntArray
from tertia.cli import _asterix, _tables
from tertia.cli._places import GEODETIC
from tertia.cli._terminal import WRONG_USAGE, fail
from tertia.metrics import Truth
from tertia.metrics._evaluation import Rows

_PLACE = ("east_m", "north_m")
_VELOCITY = ("velocity_east_m_s", "velocity_north_m_s")
_SPREAD = ("east_sigma_m", "north_sigma_m", "covariance_east_north_m2")


def read_pair(
    tracks: Path, truth: Path, origin: tuple[float, float] | None = None
) -> tuple[Rows, Truth]:
    """Return tracks and truth, their times from the same origin.

    A truth in latitude and longitude needs the `origin` of east and north.
    """
    shown = _read(tracks, ["time_s", "track", *_PLACE])
    real = _read_truth(truth, origin)
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
    path: Path,
    origin: tuple[float, float] | None,
    dates: pl.DataType | None,
    seconds: Callable[[pl.Series], FloatArray],
) -> Truth:
    """Return the truth; `seconds` turns times into those of the plots, which hold `dates`.

    A truth in latitude and longitude needs the `origin` of east and north.
    """
    real = _read_truth(path, origin)
    times = _times(real, path)
    if isinstance(times.dtype, pl.Datetime) != (dates is not None):
        kinds = ("numbers", "dates")[:: 1 if dates is None else -1]
        fail(f"time_s of the plots holds {kinds[0]}, that of {path} {kinds[1]}")
    return _truth(real, path, seconds(times if dates is None else times.cast(dates)))


def _read(path: Path, columns: list[str]) -> pl.DataFrame:
    frame = _tables.read(path, columns)
    frame = frame.filter(_tables.is_row(frame, path))
    if frame.is_empty():
        fail(f"{path} is empty")
    return frame


def _read_truth(path: Path, origin: tuple[float, float] | None) -> pl.DataFrame:
    if _tables.kind_of(path) in _tables.ASTERIX:
        return _in_the_plane(_asterix.truth(path), path, origin)
    frame = _read(path, ["time_s", "target"])
    if not set(_PLACE) <= set(frame.columns) and set(GEODETIC[:2]) <= set(frame.columns):
        return _in_the_plane(frame, path, origin)
    _tables.require_columns(frame, path, _PLACE)
    return frame


def _in_the_plane(
    frame: pl.DataFrame, path: Path, origin: tuple[float, float] | None
) -> pl.DataFrame:
    """Return a table with east and north in place of latitude and longitude."""
    if origin is None:
        fail(
            f"{path} has latitudes and longitudes: give --origin LATITUDE,LONGITUDE, as tertia "
            "track told it",
            WRONG_USAGE,
        )
    height = np.zeros(frame.height)
    if GEODETIC[2] in frame.columns:
        height = np.nan_to_num(_tables.numbers(frame[GEODETIC[2]], path).to_numpy())
    degrees = [_tables.numbers(frame[name], path).to_numpy() for name in GEODETIC[:2]]
    for name, values in zip(GEODETIC, degrees, strict=False):
        _refuse(pl.Series(np.isnan(values)), path, f"{name} is missing")
    try:
        from tertia.geo import LocalFrame  # noqa: PLC0415  # only here is pyproj needed

        local = LocalFrame(*origin).to_local(degrees[0], degrees[1], height)
    except ImportError:
        fail(f"{path}: {GEODETIC[0]} needs the extra geo: pip install 'tertia[geo]'")
    except ValueError as error:
        fail(f"{path}: {error}")
    return frame.with_columns(pl.Series(name, local[:, axis]) for axis, name in enumerate(_PLACE))


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
    numbers, names = _names(frame["target"], path)
    target = np.asarray(names)[numbers]
    order = np.lexsort((seconds, target))
    again = (target[order][1:] == target[order][:-1]) & (np.diff(seconds[order]) == 0)
    if np.any(again):
        row = int(order[1:][again].min())
        told = f"a second position of target {target[row]} at time_s {frame['time_s'][row]}"
        fail(f"{_tables.place(path, row)}: {told}")
    return Truth(seconds, target, places)
