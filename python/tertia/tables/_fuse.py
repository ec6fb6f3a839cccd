"""One track per target from the plots of several sensors."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import polars as pl

from tertia._arrays import FloatArray, positive, real
from tertia.fusion import FusedSeries, FusionMethod, fuse_series
from tertia.kalman import SingerModel
from tertia.tables._columns import as_names, beside, known, numbers, times
from tertia.tables._kinds import Table, take
from tertia.tables._noise import Given, Noise, settle
from tertia.tables._plots import Columns, Group, by_group, require_plots, second_plots

Fuse = Callable[..., FusedSeries]


@dataclass(frozen=True, slots=True)
class Fused:
    """A group, its variances as stated, and what came of it."""

    group: Group
    variance: FloatArray
    result: FusedSeries


def fuse(
    table: Table,
    column: str = "azimuth_deg",
    *,
    time: str = "time_s",
    sensor: str = "sensor",
    by: str | Sequence[str] = (),
    sigma: float | str | Mapping[str, float] | None = None,
    alpha: float | None = None,
    acceleration_sigma: float | None = None,
    sensors: Sequence[str] | None = None,
    period: float | None = 360.0,
    method: FusionMethod = "robust",
    **options: Any,
) -> Table:
    """Fuse the plots of several sensors into one track per target, as the command `tertia fuse`.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per plot, in any order. A missing plot (null, nan) leaves a time at which the track
        is told all the same.
    column, time, sensor : str
        Columns of the angle, of its time (seconds, or dates with time), and of who measured it.
    by : str or sequence of str
        Columns whose values tell the targets; by default all plots are of one.
    sigma : float, str or mapping, optional
        Stated standard deviation of the plots: one for all, the column that has it, or one per
        sensor. What is not given is fitted from the whole table.
    alpha, acceleration_sigma : float, optional
        One over the time in which accelerations fade, and their standard deviation; by default
        fitted.
    sensors : sequence of str, optional
        All sensors, where the table may hold plots of some of them alone: the result has columns
        for each. By default those of the table.
    period : float or None
        360.0 for degrees, 2*pi for radians, None for data that do not wrap.
    method : str
        As of `tertia.fusion.fuse_series`.
    **options
        As of `tertia.fusion.fuse_series`: `change_probability`, `forgetting_factor`,
        `threshold`, `outlier_gate`, `n_threads`.

    Returns
    -------
    table of the same kind
        One row per target and time: `by`, `time`, the angle with its sigma, `rate` and
        `acceleration` with theirs, and for each sensor `weight_`, `sigma_` (as believed) and
        `outlier_`; null where nothing is known. Without rows where there were none.

    Raises
    ------
    ValueError
        A column that is not there or given for two purposes, a plot without a time or sensor, two
        plots of one target by one sensor at one time, an option outside its domain, or too little
        to fit what is not given.
    TypeError
        A table of another kind, a column without numbers, or an option of the wrong type.

    Examples
    --------
    >>> import numpy as np, polars as pl
    >>> from tertia.tables import fuse
    >>> rng, time = np.random.default_rng(1), np.arange(40.0)
    >>> plots = [0.2 * time + sigma * rng.standard_normal(40) for sigma in (0.1, 0.2)]
    >>> table = pl.DataFrame({
    ...     "time_s": [*time, *time], "sensor": ["A"] * 40 + ["B"] * 40,
    ...     "azimuth_deg": [*plots[0], *plots[1]],
    ... })
    >>> track = fuse(table, sigma={"A": 0.1, "B": 0.2}, alpha=0.05, acceleration_sigma=0.003)
    >>> track.columns[:4]
    ['time_s', 'azimuth_deg', 'azimuth_deg_sigma', 'rate']
    >>> track.height, bool(track["weight_A"][-1] > 0.7)
    (40, True)
    """
    by_column = sigma if isinstance(sigma, str) else None
    columns = Columns(column, time, sensor, by_column, as_names(by))
    require_distinct(columns.needed(), "the column {} is given for two purposes")
    given = Given(_stated(sigma), by_column, alpha, acceleration_sigma)
    fuse_one = partial(fuse_series, method=method, period=period, **options)
    check_options(fuse_one, given)
    taken = take(table, columns.needed(), [time, *columns.by])
    rows = _rows(taken.frame, columns)
    _check(rows, columns)
    all_sensors = _sensors(rows["sensor"], sensors)
    track_columns = output_columns(columns, all_sensors)
    groups = by_group(rows, columns) if rows.height else []
    noise = settle(groups, all_sensors, given, column, period) if groups else None
    tracks = [
        track(fuse_group(fuse_one, group, noise), all_sensors, track_columns)
        for group in groups
        if noise is not None
    ]
    found = pl.concat(tracks) if tracks else _nothing(taken.frame, columns, track_columns)
    return taken.result(found)  # type: ignore[no-any-return]


def _stated(sigma: float | str | Mapping[str, float] | None) -> dict[str | None, float]:
    if sigma is None or isinstance(sigma, str):
        return {}
    told: dict[str | None, float] = dict(
        sigma.items() if isinstance(sigma, Mapping) else [(None, sigma)]
    )
    for name, value in told.items():
        positive(real(value, "sigma"), "sigma" if name is None else f"sigma of {name}")
    return told


def _rows(frame: pl.DataFrame, columns: Columns) -> pl.DataFrame:
    sigma = (
        np.full(frame.height, math.nan) if columns.sigma is None else numbers(frame[columns.sigma])
    )
    return pl.DataFrame(
        {
            "sensor": frame[columns.sensor or ""].cast(pl.String),
            "time": times(frame[columns.time]),
            "angle": numbers(frame[columns.angle]),
            "sigma": sigma,
            "file": pl.repeat(0, frame.height, eager=True),
            "row": pl.int_range(frame.height, eager=True),
            **{f"by {name}": frame[name] for name in columns.by},
        }
    )


def _check(rows: pl.DataFrame, columns: Columns) -> None:
    require_plots(rows, columns, lambda row: f"row {row['row']}")
    again = second_plots(rows)
    if not again.is_empty():
        second = again.row(0, named=True)
        raise ValueError(
            f"row {second['row']}: {second['sensor']} has a second plot at {columns.time} "
            f"{second['time']}; several targets need `by`"
        )


def _sensors(column: pl.Series, sensors: Sequence[str] | None) -> list[str]:
    there: list[str] = column.unique(maintain_order=True).to_list()
    if sensors is None:
        return there
    for name in there:
        if name not in sensors:
            raise ValueError(f"there are plots of {name}; sensors are {', '.join(sensors)}")
    return list(sensors)


def require_distinct(names: Sequence[str], message: str) -> None:
    """Refuse the first name that is there twice."""
    for at, name in enumerate(names):
        if name in names[:at]:
            raise ValueError(message.format(name))


def check_options(fuse_one: Fuse, given: Given) -> None:
    """Let the library judge the options before the work."""
    model = SingerModel(1.0, given.alpha or 0.0, given.acceleration_sigma or 0.0, exact=True)
    for sigma in given.sigmas.values() or [1.0]:
        fuse_one(np.zeros((1, 1)), sigma**2, model)


def output_columns(columns: Columns, sensors: list[str]) -> list[str]:
    """Return the names of the columns of the track, without those of `by`."""
    names = [columns.time]
    for quantity in (columns.angle, "rate", "acceleration"):
        names += [quantity, f"{quantity}_sigma"]
    for sensor in sensors:
        names += [f"weight_{sensor}", f"sigma_{sensor}", f"outlier_{sensor}"]
    require_distinct([*columns.by, *names], "the track would have two columns {}")
    return names


def fuse_group(fuse_one: Fuse, group: Group, noise: Noise) -> Fused:
    """Fuse the plots of one target."""
    variance = noise.variance(group)
    return Fused(group, variance, fuse_one(group.z, variance, noise.model, time=group.times))


def track(one: Fused, sensors: list[str], names: list[str]) -> pl.DataFrame:
    """Return one row per time, null for what is not known, with the columns of all sensors."""
    group, result = one.group, one.result
    values: list[pl.Series] = [group.moments]
    for component in range(3):
        sigma = result.sigma[:, component]
        told = np.isfinite(sigma)
        # with an infinite sigma the mean is no estimate
        values += [known(result.mean[:, component], told), known(sigma, told)]
    for sensor in sensors:
        if sensor in group.sensors:
            k = group.sensors.index(sensor)
            weight, noise = result.weights[k, :, 0], np.sqrt(result.noise_variance[k])
            rejected = pl.Series(result.outlier[k]).set(pl.Series(np.isnan(group.z[k])), None)
            values += [known(weight, ~np.isnan(weight)), pl.Series(noise), rejected]
        else:
            values += [pl.repeat(None, group.times.size, dtype=d, eager=True) for d in _OF_SENSOR]
    return beside(group.keys, pl.DataFrame(dict(zip(names, values, strict=True))))


_OF_SENSOR = (pl.Float64, pl.Float64, pl.Boolean)


def _nothing(frame: pl.DataFrame, columns: Columns, names: list[str]) -> pl.DataFrame:
    """Return a track without rows."""
    kinds: list[Any] = [frame.schema[columns.time], *[pl.Float64] * 6]
    kinds += _OF_SENSOR * ((len(names) - len(kinds)) // len(_OF_SENSOR))
    keys: dict[str, Any] = {name: frame.schema[name] for name in columns.by}
    return pl.DataFrame(schema=keys | dict(zip(names, kinds, strict=True)))
