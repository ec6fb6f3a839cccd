"""Tracks and the truth, read from files, and what one says of the other."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from tertia import metrics
from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.cli import _asterix, _tables
from tertia.cli._places import GEODETIC
from tertia.cli._terminal import WRONG_USAGE, fail

# a track that ends is in the picture for so many of its radars' periods
_AGE = 1.5
# of a period: times in files are rounded
_ROUNDING = 1e-6
_PLACE = ("east_m", "north_m")
_VELOCITY = ("velocity_east_m_s", "velocity_north_m_s")
_SPREAD = ("east_sigma_m", "north_sigma_m", "covariance_east_north_m2")


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of tracks: seconds, metres; nan where unknown. Tracks and radars have numbers."""

    time: FloatArray
    track: IntArray
    radar: IntArray
    position: FloatArray
    velocity: FloatArray
    covariance: FloatArray | None
    updated: BoolArray


@dataclass(frozen=True, slots=True)
class Truth:
    """Where targets were: seconds, metres; `target` numbers the names."""

    time: FloatArray
    target: IntArray
    position: FloatArray
    names: list[str]

    def along(self) -> Iterator[tuple[int, FloatArray, FloatArray]]:
        """Yield each target with its times and positions, in order."""
        order = np.lexsort((self.time, self.target))
        starts = np.searchsorted(self.target[order], np.arange(1, len(self.names)))
        for k, rows in enumerate(np.split(order, starts)):
            yield k, self.time[rows], self.position[rows]

    def at(self, instants: FloatArray) -> FloatArray:
        """Return where all targets are, (K, T, 2), nan while they are not there."""
        found = np.full((len(self.names), len(instants), 2), np.nan)
        for k, time, position in self.along():
            for axis in range(2):
                found[k, :, axis] = np.interp(
                    instants, time, position[:, axis], left=np.nan, right=np.nan
                )
        return found

    def course(self, target: IntArray, time: FloatArray) -> FloatArray:
        """Return courses of targets, (N,), nan for target -1."""
        found = np.full(len(time), np.nan)
        for k, moments, position in self.along():
            own = target == k
            if len(moments) > 1 and np.any(own):
                velocity = np.gradient(position, moments, axis=0)
                found[own] = np.arctan2(*(np.interp(time[own], moments, v) for v in velocity.T))
        return found


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
    target, names = _names(frame["target"], path)
    order = np.lexsort((seconds, target))
    again = (np.diff(target[order]) == 0) & (np.diff(seconds[order]) == 0)
    if np.any(again):
        row = int(order[1:][again].min())
        told = f"a second position of target {names[target[row]]} at time_s {frame['time_s'][row]}"
        fail(f"{_tables.place(path, row)}: {told}")
    return Truth(seconds, target, places, names)


def usual_periods(rows: Rows) -> list[float]:
    """Return the median time between updates of a track by the same radar, in order of time."""
    time, track, radar = (x[rows.updated] for x in (rows.time, rows.track, rows.radar))
    periods = []
    for one in np.unique(radar):
        own = radar == one
        order = np.lexsort((time[own], track[own]))
        gaps = np.diff(time[own][order])[np.diff(track[own][order]) == 0]
        if len(gaps):
            periods.append(float(np.median(gaps)))
    return sorted(periods)


def pictures(rows: Rows, instants: FloatArray, lasting: float) -> FloatArray:
    """Return where tracks are shown, (M, T, 2): straight on from their last rows.

    A track is shown from its first row until some time after its last; nan otherwise.
    """
    order = np.lexsort((rows.time, rows.track))
    _, starts = np.unique(rows.track[order], return_index=True)
    found = []
    for own in np.split(order, starts[1:]):
        last = np.searchsorted(rows.time[own], instants, side="right") - 1
        row = own[np.maximum(last, 0)]
        age = instants - rows.time[row]
        shown = rows.position[row] + age[:, np.newaxis] * rows.velocity[row]
        ended = instants > rows.time[own[-1]] + lasting
        shown[(last < 0) | ended] = np.nan
        found.append(shown)
    return np.array(found)


def gospa(
    rows: Rows, truth: Truth, periods: tuple[float, float], cutoff: float
) -> tuple[FloatArray, FloatArray]:
    """Return instants, one per required period, and GOSPA and its three parts there, (T, 4).

    `periods` has the required one and that of the slowest radar. The parts are roots: their
    squares add up to that of GOSPA.
    """
    required, slowest = periods
    first, last = truth.time.min(), truth.time.max()
    instants = first + required * np.arange(np.floor((last - first) / required + _ROUNDING) + 1)
    shown, there = pictures(rows, instants, _AGE * slowest), truth.at(instants)
    told = np.empty((len(instants), 4))
    for t in range(len(instants)):
        estimates, places = (x[:, t][np.isfinite(x[:, t, 0])] for x in (shown, there))
        one = metrics.gospa(estimates, places, cutoff)
        told[t] = one.distance**2, one.localisation, one.missed, one.false
    return instants, np.sqrt(told)
