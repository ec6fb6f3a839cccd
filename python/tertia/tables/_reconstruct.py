"""Reconstruction of the paths of targets from the measurements of several stations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl

from tertia._arrays import BoolArray, FloatArray
from tertia.location._arrivals import LIGHT
from tertia.sensors import Kind, Station
from tertia.tables._described import SensorsLike, stations_of
from tertia.tables._ellipsoid import on_the_earth
from tertia.tables._frames import Table, result
from tertia.tables._groups import Progress, as_names, beside, known
from tertia.tables._heights import at_heights, given_heights
from tertia.tables._measurements import UNITS, Target, check_tolerance, read_targets
from tertia.tables._parts import RecordError, Source, source_of
from tertia.tables._positions import (
    Located,
    Positions,
    coordinates,
    covariances,
    errors_of,
    of_instants,
    of_measurements,
    of_sensors,
    positions_of,
    result_names,
)
from tertia.tables._sensors import Sensors
from tertia.trajectory import Trajectory
from tertia.trajectory import reconstruct as reconstruct_path
from tertia.trajectory._reconstruct import require_options

# kinds of measurements, and the names of their biases
_BIASED: dict[Kind, str] = {
    "range": "range",
    "azimuth": "azimuth",
    "elevation": "elevation",
    "arrival_time": "time",
}
# prefixes of the columns of velocity and acceleration, and their units
_MOTION = (("velocity_", "m_s"), ("acceleration_", "m_s2"))

_OF_HEIGHTS = "height_residual", "height_outlier"

# options that do not depend on each other
_OF_THE_CALL = (
    *("initial", "n_threads", "range_difference_correlation"),
    *("propagation_speed", "propagation_speed_sigma", "wind_sigma"),
    *("height", "height_sigma"),
)


def reconstruct(
    table: Table,
    *,
    sensors: SensorsLike,
    columns: Mapping[str, str] | None = None,
    by: str | Sequence[str] = (),
    tolerance: float = 0.0,
    **options: Any,
) -> Table:
    """Reconstruct the paths of targets, as the command `tertia reconstruct` does.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per sensor and time, or one row per measurement, as for `locate`. All arrival times
        (`arrival_time_s`) with the same `time_s` belong to one emission. Heights of the target,
        as from a barometer, are in `target_height_m` and `target_height_sigma_m`; those of an
        instant are averaged.
    sensors : sequence of Station, DataFrame, or str or Path
        The stations, with the names that the table uses: objects, a table with one row per station
        and the columns of sensors files, or the path of a sensors file in TOML. Their systematic
        errors are used unless `bias` is given; the uncertainties of their positions are always
        used.
    columns : mapping of str to str, optional
        The names that columns have in this table, keyed by their standard names.
    by : str or sequence of str
        Columns whose values identify the targets; by default all rows belong to one target.
    tolerance : float
        Length of time in seconds within which measurements belong to one instant; the time of the
        instant is the mean of their times.
    **options
        Options of `tertia.trajectory.reconstruct`; `propagation_speed` must be a single
        number. So must `height`, which is for all targets, and `height_sigma`, which is also that
        of rows without one. If the sensors have latitudes and longitudes, heights are above the
        ellipsoid.

    Returns
    -------
    table of the same kind
        One row for each target and time, with the columns of `locate`, and with
        `velocity_east_m_s`, `velocity_east_sigma_m_s`, `acceleration_east_m_s2` and so on. With
        heights, also `height_residual` and `height_outlier`.

    Raises
    ------
    RecordError, ValueError, TypeError
        As for `locate`; also if there are too few measurements to reconstruct a path.

    Examples
    --------
    >>> import numpy as np, polars as pl
    >>> from tertia import tables
    >>> from tertia.sensors import Station
    >>> places = {"A": (0.0, 0.0), "B": (4e3, 0.0), "C": (0.0, 3e3)}
    >>> stations = [Station(p, name=name, range_sigma=1.0) for name, p in places.items()]
    >>> way = np.array([0.0, 1e3]) + np.arange(9)[:, np.newaxis] * [10.0, 5.0]
    >>> table = pl.concat(
    ...     pl.DataFrame({"time_s": np.arange(9.0), "range_m": np.linalg.norm(way - p, axis=1)})
    ...     .with_columns(sensor=pl.lit(name))
    ...     for name, p in places.items()
    ... )
    >>> path = tables.reconstruct(table, sensors=stations, jerk=0.0)
    >>> [round(v, 3) for v in path.select("velocity_east_m_s", "velocity_north_m_s").row(4)]
    [10.0, 5.0]
    """
    found = paths_of(
        source_of(table), sensors=sensors, columns=columns, by=by, tolerance=tolerance, **options
    )
    return result(table, found.rows, as_names(by))


def paths_of(
    source: Source,
    *,
    sensors: SensorsLike,
    columns: Mapping[str, str] | None,
    by: str | Sequence[str],
    tolerance: float,
    progress: Progress[Target] = iter,
    **options: Any,
) -> Positions[Trajectory]:
    """Return the paths of all targets with their measurements, as described in `reconstruct`."""
    require_options(**{name: one for name, one in options.items() if name not in _OF_THE_CALL})
    stations = stations_of(sensors)
    results = [*result_names(_MOTION), *_OF_HEIGHTS]
    if not math.isfinite(check_tolerance(tolerance)):
        raise ValueError(
            "tolerance is inf; it must be finite, because a path needs several instants"
        )
    targets = read_targets(
        source,
        stations,
        columns=columns,
        by=by,
        results=results,
        tolerance=tolerance,
        heights=True,
    )
    alone = options.get("height_sigma") is not None and options.get("height") is None
    if alone and all(one.heights is None for one in targets):
        raise ValueError("height is missing; height and height_sigma belong together")

    def estimate(target: Target) -> Located[Trajectory]:
        return _path(target, stations, options)

    return positions_of(targets, stations, options, estimate, progress)


def _path(
    target: Target, sensors: Sensors[Station], options: Mapping[str, Any]
) -> Located[Trajectory]:
    stations, stated = target.sensors.items, target.all_sigmas()

    def solve(measured: dict[str, Any], sigmas: dict[str, Any]) -> Trajectory:
        own = {f"{kind}_sigma": _of_stations(target, kind, one) for kind, one in sigmas.items()}
        every = {**options, **measured, **own}
        given = given_heights(target.heights, options.get("height"), options.get("height_sigma"))

        def path(**heights: Any) -> Trajectory:
            return reconstruct_path(stations, target.times, **{**every, **heights})

        return at_heights(path, *given, target.sensors)

    with errors_of(target):
        speed = options.get("propagation_speed", LIGHT)
        found = on_the_earth(solve, target.measured(), stated, target.sensors, speed)
    judged = of_measurements(target, found.residual, found.outlier, _has_position(found))
    by_sensor = _with_bias(of_sensors(target, judged), found, sensors.names)
    rows = _rows(target, found, judged)
    return Located(target, found, found.fixes, judged, rows, by_sensor)


def _has_position(found: Trajectory) -> BoolArray:
    return np.asarray(np.isfinite(found.position[:, :2]).all(axis=1))


def _of_stations(target: Target, kind: str, sigma: FloatArray) -> FloatArray:
    """Return the sigma of each station, (K,); (N, K) if measurements of a station differ in it."""
    own = np.where(np.isnan(target.measured()[kind]), np.nan, sigma)
    least, largest = np.fmin.reduce(own), np.fmax.reduce(own)
    if not np.any(largest > least):
        return np.asarray(np.where(np.isnan(least), sigma[0], least))
    if kind == "range_difference":
        raise RecordError(
            f"{target.name}: the sigmas of range differences must not change over time: "
            "give one value for each sensor"
        )
    return sigma


def _rows(target: Target, found: Trajectory, measured: pl.DataFrame) -> pl.DataFrame:
    """Return one row per time; unknown values are null."""
    d = found.position.shape[1]
    parts = [found.covariance[:, i * d : (i + 1) * d, i * d : (i + 1) * d] for i in range(3)]
    rows = {
        "time_s": target.moments,
        **coordinates(found.position, parts[0]),
        **target.sensors.geodetic(found.position),
        **coordinates(found.velocity, parts[1], *_MOTION[0]),
        **coordinates(found.acceleration, parts[2], *_MOTION[1]),
        **covariances(parts[0]),
        **of_instants(target, measured, found.fixes, _has_position(found)),
    }
    if found.height_residual is not None:
        residual, outlier = known(found.height_residual), pl.Series(found.height_outlier)
        rows |= zip(_OF_HEIGHTS, (residual, outlier.set(residual.is_null(), None)), strict=True)
    return beside(target.keys, pl.DataFrame(rows))


def _with_bias(table: pl.DataFrame, found: Trajectory, names: Sequence[str]) -> pl.DataFrame:
    """Return one row per sensor with its biases, if there are any, in the units of the columns."""
    if found.bias is None:
        return table
    cells: dict[tuple[str, str], tuple[float, float]] = {}
    for kind, error in _BIASED.items():
        values, sigmas = (getattr(found.bias, name) for name in (error, f"{error}_sigma"))
        if np.any(sigmas):
            factor = UNITS[kind][1]
            for name, value, sigma in zip(names, values / factor, sigmas / factor, strict=True):
                if np.isfinite(sigma):
                    cells[name, kind] = float(value), float(sigma)
    keys = list(table.select("sensor", "kind").iter_rows())
    # the clock of a sensor shifts all its measurements, whatever their kind
    clocks = [(name, "arrival_time") for name, _ in keys]
    if set(clocks) & set(cells) - set(keys):
        table = _beside(table, cells, clocks, ("time_bias_s", "time_bias_sigma_s"))
    return _beside(table, cells, keys, ("bias", "bias_sigma")) if set(keys) & set(cells) else table


def _beside(
    table: pl.DataFrame,
    cells: Mapping[tuple[str, str], tuple[float, float]],
    keys: Sequence[tuple[str, str]],
    names: tuple[str, str],
) -> pl.DataFrame:
    """Return the table with columns for the cells of these keys, one per row."""
    pairs = [cells.get(key, (None, None)) for key in keys]
    return table.with_columns(
        pl.Series(name, [pair[i] for pair in pairs], dtype=pl.Float64)
        for i, name in enumerate(names)
    )
