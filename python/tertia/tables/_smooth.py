"""Smoothing of the positions of targets over time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from types import MappingProxyType
from typing import Any

import numpy as np
import polars as pl

from tertia import smoothing
from tertia._arrays import BoolArray, FloatArray, IntArray, positive_number, real
from tertia.geo import SystemPlane
from tertia.tables._doubts import doubt
from tertia.tables._frames import Table, extended, names
from tertia.tables._groups import (
    as_names,
    by_length,
    column_name,
    known,
    layout,
    split_unit,
    symmetric,
)
from tertia.tables._names import hint
from tertia.tables._parts import RecordError, Source, source_of
from tertia.tables._records import TIME, Field, Records, Schema, number, read
from tertia.tables._sensors import GEODETIC, LOCAL
from tertia.tables._times import Clock
from tertia.tables._velocities import (
    doubt_velocities,
    fields,
    to_plane,
    true_rates,
    turned,
    velocities_of,
)

# noise in stated sigmas that few sensors have
_MUCH = 10.0
# distance from latitude 0 and longitude 0 at which others are far from it, and limits, in degrees
_FAR = 1.0
_LARGEST = dict(zip(GEODETIC[:2], (90.0, 360.0), strict=True))
# results for each quantity, and suffixes of their units
_QUANTITIES = {"smoothed": "", "rate": "_s", "acceleration": "_s2"}


def smooth(
    table: Table,
    *,
    columns: Mapping[str, str] | None = None,
    values: str | Sequence[str] = LOCAL[:2],
    sigma: float | str | Sequence[float | str],
    velocities: str | Sequence[str] | None = None,
    velocity_sigma: float | str | Sequence[float | str] | None = None,
    by: str | Sequence[str] = (),
    correlation_time: float | None = None,
    robust: bool = True,
    jerk: float | None = None,
    n_threads: int | None = None,
) -> Table:
    """Smooth positions, or any series, with `tertia.smoothing.smooth`.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per plot, in any order; null and nan are missing.
    columns : mapping of str to str, optional
        The names that columns have in this table, keyed by `time_s` (seconds or datetimes) and by
        the column names in the other arguments.
    values : str or sequence of str
        Columns of the axes. By default `east_m` and `north_m` or, if these are missing,
        `latitude_deg` and `longitude_deg`, which are smoothed in the system plane about the first
        position.
    sigma : float, str or sequence of these
        Standard deviation of the plots, or the column that contains it: one for all axes, or one
        for each. If they are the columns `east_sigma_m` and `north_sigma_m`, as other functions
        write them, the covariances in a column `covariance_east_north_m2` are also used; those of
        other axes have corresponding names.
    velocities : str or sequence of str, optional
        Columns of measured velocities, one for each axis. By default `velocity_east_m_s` and
        `velocity_north_m_s` or, if these are missing, `speed_m_s` (or `speed_kt`) and `course_deg`.
        They are used only if `velocity_sigma` is given.
    velocity_sigma : float, str or sequence of these, optional
        Standard deviation of the velocities, in the form of `sigma`.
    by : str or sequence of str
        Columns whose values identify the targets; by default all rows belong to one target.
    correlation_time : float, optional
        Correlation time of the noise; by default it is estimated for each track.
    robust : bool
        Whether to allow for noise that is larger than stated, outliers, and jumps of the position.
    jerk : float, optional
        Intensity of the white jerk; by default the motion of each track is estimated.
    n_threads : int, optional
        As for `tertia.smoothing.smooth`.

    Returns
    -------
    table of the same kind
        The same rows with additional columns for each axis: the smoothed value, rate and
        acceleration, each followed by its sigma, for example `east_smoothed_m`,
        `east_smoothed_sigma_m`, `east_rate_m_s` and `east_acceleration_m_s2`. Unknown values are
        null. If positions are latitudes and longitudes, there are also `latitude_smoothed_deg` and
        `longitude_smoothed_deg`; `east_smoothed_m` and `north_smoothed_m` are coordinates in the
        system plane, but rates and accelerations are relative to true north at the position.
        `smoothing_outlier` marks the positions that were left out, and
        `smoothing_velocity_outlier` the velocities, if there are any.

    Raises
    ------
    RecordError
        If a column is missing or does not hold numbers, a measurement is infinite, or a time is
        missing.
    ValueError
        If a result column already exists, a sigma is not positive, or the jerk is negative.
    numpy.linalg.LinAlgError
        If sigmas differ so much that the smaller ones are lost to rounding.
    TypeError
        If the table is of an unsupported kind, or an option has the wrong type.

    Examples
    --------
    >>> import numpy as np, polars as pl
    >>> from tertia.tables import smooth
    >>> time = np.arange(20.0)
    >>> table = pl.DataFrame({"time_s": time, "east_m": 100 * time + 10 * (-1) ** np.arange(20)})
    >>> track = smooth(table, values="east_m", sigma=10.0, jerk=0.0)
    >>> [round(v, 1) for v in track.select("east_rate_m_s", "east_rate_sigma_m_s").row(9)]
    [99.8, 0.4]
    """
    found = smoothing_of(
        source_of(table),
        columns=columns,
        values=values,
        sigma=sigma,
        velocities=velocities,
        velocity_sigma=velocity_sigma,
        by=by,
        correlation_time=correlation_time,
        robust=robust,
        jerk=jerk,
        n_threads=n_threads,
    )
    return extended(table, found.added)


@dataclass(frozen=True, slots=True)
class SmoothedRows:
    """The groups, times and values of the rows, and the columns that smoothing adds."""

    rows: pl.DataFrame
    added: pl.DataFrame
    targets: int


def smoothing_of(
    source: Source,
    *,
    columns: Mapping[str, str] | None,
    values: str | Sequence[str],
    sigma: float | str | Sequence[float | str],
    velocities: str | Sequence[str] | None,
    velocity_sigma: float | str | Sequence[float | str] | None,
    by: str | Sequence[str],
    correlation_time: float | None,
    robust: bool,
    jerk: float | None,
    n_threads: int | None,
) -> SmoothedRows:
    """Smooth the rows of all parts, and return the parts in the same order."""
    axes = as_names(values)
    geodetic = axes == list(LOCAL[:2]) and _are_geodetic(source, columns or {})
    sigmas = _of_each_axis(sigma, "sigma", axes)
    spreads = (
        [] if velocity_sigma is None else _of_each_axis(velocity_sigma, "velocity_sigma", axes)
    )
    moving = _names_of_velocities(velocities, axes) if spreads else None
    options = {
        "correlation_time": correlation_time,
        "robust": robust,
        "jerk": None if jerk is None else real(jerk, "jerk"),
        "n_threads": n_threads,
    }
    covariances = _names_of_covariances(LOCAL[:2] if geodetic else axes, sigmas)
    given = list(GEODETIC[:2]) if geodetic else axes
    schema = _schema(given, [*sigmas, *spreads], covariances.values(), geodetic=geodetic)
    if spreads:
        schema = {**schema, **fields(moving)}
    records = read(source, schema, columns=columns, by=as_names(by))
    _refuse(records, given, sigmas, covariances)
    frame = _with_fixes(records.rows) if geodetic else records.rows
    plane = _plane_of(frame) if geodetic else None
    if plane is not None:
        local = plane.to_local(*frame.select(GEODETIC[:2]).to_numpy().T)
        frame = frame.with_columns(pl.Series(name, local[:, k]) for k, name in enumerate(LOCAL[:2]))
    groups = layout(records.by, frame.height)
    t = Clock.of(frame["time"]).seconds(frame["time"])
    rows = groups.order[np.lexsort((groups.arranged(t), groups.group))]
    y = frame.select(axes).to_numpy()[rows]
    turn = None
    if plane is not None:
        turn = to_plane(plane, np.nan_to_num(frame.select(axes).to_numpy()))
    own = _covariances(frame, "sigma", sigmas, covariances, turn=turn)
    series = [y, own[rows], t[rows], rows]
    if spreads:
        own = _covariances(frame, "velocity_sigma", spreads, turn=turn if moving is None else None)
        series += [velocities_of(frame, moving, plane)[rows], own[rows]]
        if axes == list(LOCAL[:2]):
            track = np.repeat(np.arange(len(groups.lengths)), groups.lengths)
            doubt_velocities("the tracks", track, t[rows], y, series[-2])
    found, spread, marks = _smoothed(groups.lengths, series, plane, options)
    added = _added(found, spread, axes)
    shown = axes
    if plane is not None:
        added, shown = added.with_columns(**_geodetic(plane, found[:, :2])), list(GEODETIC[:2])
    added = added.with_columns(**marks)
    times = frame.select(pl.col("time").alias("time_s"), pl.col(shown).fill_nan(None))
    return SmoothedRows(
        pl.concat([records.by, times], how="horizontal"), added, len(groups.lengths)
    )


def _schema(
    axes: Sequence[str],
    sigmas: Sequence[float | str],
    covariances: Iterable[str],
    *,
    geodetic: bool,
) -> Schema:
    """Return the columns of times, positions, and sigmas and covariances that are columns."""
    stated = [one for one in sigmas if isinstance(one, str)]
    numbers = {
        name: Field(
            "number",
            {name: 1.0},
            required=True,
            most=_LARGEST.get(name, math.inf) if geodetic else math.inf,
            positive=name in stated,
        )
        for name in [*axes, *stated]
    }
    return {"time": TIME, **numbers, **{name: number(name) for name in covariances}}


def _refuse(
    records: Records,
    axes: Sequence[str],
    sigmas: Sequence[float | str],
    covariances: Mapping[tuple[int, int], str],
) -> None:
    """Refuse positions without a sigma, and covariances that are none."""
    for axis, one in zip(axes, sigmas, strict=False):
        if isinstance(one, str):
            lacks = pl.col(axis).is_not_nan() & pl.col(one).is_nan()
            records.refuse(lacks, f"{one} is missing", one)
    for (i, j), name in covariances.items():
        most = pl.col(str(sigmas[i])) * pl.col(str(sigmas[j]))
        larger = pl.col(name).abs().fill_nan(0.0) > most
        records.refuse(larger, f"{name} is larger than the product of the sigmas", name)


def _smoothed(
    lengths: IntArray,
    series: Sequence[FloatArray],
    plane: SystemPlane | None,
    options: Mapping[str, Any],
) -> tuple[FloatArray, FloatArray, dict[str, BoolArray]]:
    """Return means, sigmas and columns of outliers, in the order in which the rows were read.

    `series` has positions, covariances, times, numbers of rows, and velocities with covariances.
    """

    def track(
        plots: FloatArray,
        covariances: FloatArray,
        instants: FloatArray,
        places: IntArray,
        *velocity: FloatArray,
    ) -> tuple[IntArray, Any]:
        names = "velocity", "velocity_covariance"
        moving: dict[str, Any] = dict(zip(names, velocity, strict=False))
        return places, smoothing.smooth(plots, covariances, time=instants, **moving, **options)

    (height, axes), factors = series[0].shape, [np.ones(0)]
    found, spread = np.full((2, height, len(_QUANTITIES) * axes), np.nan)
    marked = ["outlier"] if len(series) == 4 else ["outlier", "velocity_outlier"]
    marks = {name: np.zeros(height, dtype=bool) for name in marked}
    for _, one in by_length(lengths, series, track):
        if isinstance(one, ValueError):
            raise one
        places, smoothed = one
        found[places], spread[places] = smoothed.mean, smoothed.sigma
        factors.append(smoothed.noise_factor)
        if plane is not None:
            flat = smoothed.mean.reshape(-1, 6), smoothed.covariance.reshape(-1, 6, 6)
            found[places], spread[places] = (
                part.reshape(smoothed.mean.shape) for part in true_rates(*flat, plane)
            )
        for name, mark in marks.items():
            mark[places] = getattr(smoothed, name)
    _doubt_noise(np.concatenate(factors))
    return found, spread, {f"smoothing_{name}": mark for name, mark in marks.items()}


def _doubt_noise(factor: FloatArray) -> None:
    """Warn if positions scatter as those of several targets do."""
    large = factor > _MUCH
    if large.any():
        tracks = "the track" if len(factor) == 1 else f"{large.sum()} of {len(factor)} tracks"
        doubt(
            f"the measurements of {tracks} scatter {np.max(factor):.3g} times as much as sigma "
            "says: are there several targets? Group their rows by a column; or is sigma wrong?"
        )


def _of_each_axis(
    sigma: float | str | Sequence[float | str], name: str, axes: Sequence[str]
) -> list[float | str]:
    """Return the standard deviation of each axis, as a number or as the name of a column."""
    found = [sigma] * len(axes) if isinstance(sigma, (str, int, float)) else list(sigma)
    if len(found) != len(axes):
        raise ValueError(f"{name} has {len(found)} elements; there are {len(axes)} columns")
    return found


def _names_of_velocities(
    velocities: str | Sequence[str] | None, axes: Sequence[str]
) -> list[str] | None:
    """Return the columns of velocities, None for those of the plane by default."""
    if velocities is None:
        if list(axes) != list(LOCAL[:2]):
            raise ValueError(f"velocities must name the columns of the velocities of {axes}")
        return None
    names = as_names(velocities)
    if len(names) != len(axes):
        raise ValueError(f"velocities has {len(names)} elements; there are {len(axes)} columns")
    return names


def _are_geodetic(source: Source, columns: Mapping[str, str]) -> bool:
    """Return whether positions are latitudes and longitudes."""

    def has(name: str) -> bool:
        return all(part.has(columns.get(name, name)) for part in source)

    if any(map(has, LOCAL[:2])):
        return False
    # a latitude without a longitude, or the reverse, is a mistake, as are other names
    there = [name for part in source for name in names(part.table)]
    usual = [bool(hint([name], there)) for name in (GEODETIC[0], LOCAL[0])]
    return any(map(has, GEODETIC[:2])) or usual == [True, False]


def _with_fixes(frame: pl.DataFrame) -> pl.DataFrame:
    """Return the rows without positions that receivers write as long as they have no fix."""
    zero = pl.all_horizontal(pl.col(GEODETIC[:2]) == 0.0)
    others = frame.filter(~zero).select(pl.col(GEODETIC[:2]).fill_nan(None).abs().median())
    count = frame.select(zero.sum()).item()
    if not count or max(one or 0.0 for one in others.row(0)) < _FAR:
        return frame
    doubt(f"{count} rows have the latitude 0 and the longitude 0: they are read as missing values")
    return frame.with_columns(pl.when(~zero).then(pl.col(GEODETIC[:2])).otherwise(math.nan))


def _plane_of(frame: pl.DataFrame) -> SystemPlane:
    """Return the system plane about the first position."""
    places = frame.select(GEODETIC[:2]).filter(pl.all_horizontal(pl.all().is_finite()))
    if places.is_empty():
        raise RecordError("there are no positions: every row lacks a latitude or a longitude")
    return SystemPlane(*places.row(0))


def _geodetic(plane: SystemPlane, position: FloatArray) -> dict[str, pl.Series]:
    """Return the columns of smoothed latitudes and longitudes."""
    places = plane.to_geodetic(np.column_stack([position, np.zeros(len(position))]))
    return {
        column_name(name, "smoothed"): known(np.asarray(cells))
        for name, cells in zip(GEODETIC[:2], places, strict=False)
    }


def _names_of_covariances(
    axes: Sequence[str], sigmas: Sequence[float | str]
) -> dict[tuple[int, int], str]:
    """Return the columns of the covariances of pairs of axes whose sigmas have the usual names."""
    own = [k for k, axis in enumerate(axes) if sigmas[k] == column_name(axis, "sigma")]
    parts = [split_unit(axis) for axis in axes]
    return {
        (i, j): f"covariance_{parts[i][0]}_{parts[j][0]}_{parts[i][1]}2"
        for i, j in combinations(own, 2)
        if parts[i][1] == parts[j][1] != ""
    }


def _covariances(
    frame: pl.DataFrame,
    argument: str,
    sigmas: Sequence[float | str],
    names: Mapping[tuple[int, int], str] = MappingProxyType({}),
    *,
    turn: FloatArray | None,
) -> FloatArray:
    """Return the covariances (N, axes, axes); those that are missing are 0.

    The matrices `turn` are those from true north to the plane, if sigmas are of true north.
    """
    own = np.empty((frame.height, len(sigmas)))
    for k, one in enumerate(sigmas):
        own[:, k] = (
            frame[one].to_numpy() if isinstance(one, str) else positive_number(one, argument)
        )
    between = {pair: np.nan_to_num(frame[name].to_numpy()) for pair, name in names.items()}
    found = symmetric(own, between)
    return found if turn is None else turned(turn, found)


def _added(found: FloatArray, spread: FloatArray, axes: Sequence[str]) -> pl.DataFrame:
    added = {}
    for d, axis in enumerate(axes):
        for q, (quantity, per) in enumerate(_QUANTITIES.items()):
            column = q * len(axes) + d
            there = np.isfinite(spread[:, column])
            added[column_name(axis, quantity, per=per)] = known(found[:, column], there)
            sigma = column_name(axis, quantity, "sigma", per=per)
            added[sigma] = known(spread[:, column], there)
    return pl.DataFrame(added)
