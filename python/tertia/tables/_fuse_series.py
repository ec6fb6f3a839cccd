"""One track per target from the plots of several sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from tertia._arrays import FloatArray, positive, real
from tertia.fusion import FusedSeries, FusionMethod
from tertia.fusion import fuse_series as fuse_arrays
from tertia.kalman import SingerModel
from tertia.metrics import rmse
from tertia.tables._frames import Table, names, result, series
from tertia.tables._groups import (
    Progress,
    as_names,
    beside,
    column_name,
    group_name,
    known,
    layout,
)
from tertia.tables._noise import Fitted, Given, Noise, Target, settle
from tertia.tables._records import (
    SENSOR,
    TIME,
    Clock,
    ColumnError,
    Field,
    RecordError,
    Records,
    Source,
    read,
    source_of,
)

_OF_SENSOR = (pl.Float64, pl.Float64, pl.Boolean)


@dataclass(frozen=True, slots=True)
class FusedTarget:
    """A target, the stated variances of its plots, and its track."""

    target: Target
    variance: FloatArray
    result: FusedSeries

    def rows(self, sensors: Sequence[str], columns: Sequence[str]) -> pl.DataFrame:
        """Return one row per time with the columns of all sensors; unknown values are null."""
        target, result = self.target, self.result
        cells: list[pl.Series] = [target.moments]
        for component in range(3):
            # with an infinite sigma the mean is no estimate
            sigma = result.sigma[:, component]
            there = np.isfinite(sigma)
            cells += [known(result.mean[:, component], there), known(sigma, there)]
        for sensor in sensors:
            if sensor in target.sensors:
                k = target.sensors.index(sensor)
                absent = pl.Series(np.isnan(target.z[k]))
                cells += [
                    known(result.weights[k, :, 0], ~np.isnan(result.weights[k, :, 0])),
                    pl.Series(np.sqrt(result.noise_variance[k])),
                    pl.Series(result.outlier[k]).set(absent, None),
                ]
            else:
                count = target.times.size
                cells += [pl.repeat(None, count, dtype=kind, eager=True) for kind in _OF_SENSOR]
        return beside(target.keys, pl.DataFrame(dict(zip(columns, cells, strict=True))))

    def of_sensors(self, columns: Sequence[str]) -> pl.DataFrame:
        """Return one row per sensor: its plots, stated and estimated noise, and weight."""
        target, result = self.target, self.result
        estimated = np.sqrt(result.noise_variance)
        normalised = result.innovation / np.sqrt(result.innovation_variance)
        cells = [
            target.sensors,
            np.count_nonzero(~np.isnan(target.z), axis=1),
            target.missing,
            np.count_nonzero(result.outlier, axis=1),
            np.sqrt(np.median(self.variance, axis=1)),
            np.median(estimated, axis=1),
            estimated[:, -1],
            rmse(result.innovation, axis=-1),
            rmse(normalised, axis=-1),
            [_mean(row) for row in result.weights[..., 0]],
        ]
        return beside(target.keys, pl.DataFrame(dict(zip(columns, cells, strict=True))))


@dataclass(frozen=True, slots=True)
class Fusion:
    """The tracks of all targets, and the fitted parameters."""

    targets: list[FusedTarget]
    rows: pl.DataFrame
    sensors: pl.DataFrame
    fitted: Sequence[Fitted]


def fuse_series(
    table: Table,
    *,
    columns: Mapping[str, str] | None = None,
    values: str = "azimuth_deg",
    by: str | Sequence[str] = (),
    sensors: Sequence[str] | None = None,
    sigma: float | Mapping[str, float] | None = None,
    alpha: float | None = None,
    acceleration_sigma: float | None = None,
    period: float | None = 360.0,
    method: FusionMethod = "robust",
    **options: Any,
) -> Table:
    """Fuse the plots of several sensors into one track per target, as `tertia fuse-series`.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per plot, in any order: `time_s` (seconds, or dates with time), `sensor`, the angle,
        and optionally its sigma (`azimuth_sigma_deg`). At the time of a missing plot (null, nan)
        the track is still estimated.
    columns : mapping of str to str, optional
        Column names in this table, keyed by standard name.
    values : str
        Column of the angle.
    by : str or sequence of str
        Columns whose values group the rows into targets; by default all rows are one target.
    sensors : sequence of str, optional
        All sensors, if the table may contain plots of only some of them: the result has columns for
        each. By default the sensors in the table.
    sigma : float or mapping, optional
        Stated standard deviation of the plots, one for all or one per sensor, instead of the values
        in the table. If neither is given, it is fitted to the whole table.
    alpha, acceleration_sigma : float, optional
        Inverse of the time constant of the acceleration, and standard deviation of the
        acceleration; by default fitted.
    period : float or None
        360.0 for degrees, 2*pi for radians, None for data that do not wrap.
    method : str
        See `tertia.fusion.fuse_series`.
    **options
        See `tertia.fusion.fuse_series`.

    Returns
    -------
    table of the same kind
        One row per target and time: `by`, `time_s`, the angle, its rate and its acceleration, each
        with its sigma (`azimuth_deg`, `azimuth_sigma_deg`, `azimuth_rate_deg_s` ...), and for each
        sensor its weight, its estimated sigma and whether its plot is an outlier (`weight_A`,
        `azimuth_sigma_A_deg`, `outlier_A`); unknown values are null. An empty table gives an empty
        result.

    Raises
    ------
    RecordError
        A column that is missing, holds no numbers or is given for two purposes, a plot without a
        time or sensor, two plots of one target by one sensor at one time, or too few plots to fit
        the values that are not given.
    ValueError
        An option outside its domain.
    TypeError
        A table of an unsupported kind, or an option of the wrong type.

    Examples
    --------
    >>> import numpy as np, polars as pl
    >>> from tertia import tables
    >>> rng, time = np.random.default_rng(1), np.arange(40.0)
    >>> plots = [0.2 * time + sigma * rng.standard_normal(40) for sigma in (0.1, 0.2)]
    >>> table = pl.DataFrame({
    ...     "time_s": [*time, *time], "sensor": ["A"] * 40 + ["B"] * 40,
    ...     "azimuth_deg": [*plots[0], *plots[1]],
    ... })
    >>> track = tables.fuse_series(
    ...     table, sigma={"A": 0.1, "B": 0.2}, alpha=0.05, acceleration_sigma=0.003
    ... )
    >>> track.columns[:4]
    ['time_s', 'azimuth_deg', 'azimuth_sigma_deg', 'azimuth_rate_deg_s']
    >>> track.height, bool(track["weight_A"][-1] > 0.7)
    (40, True)
    """
    found = fusion_of(
        source_of(table),
        columns=columns,
        values=values,
        by=by,
        sensors=sensors,
        sigma=sigma,
        alpha=alpha,
        acceleration_sigma=acceleration_sigma,
        period=period,
        method=method,
        **options,
    )
    time = (columns or {}).get("time_s", "time_s")
    rows = found.rows if found.targets else _nothing(table, found.rows, time, as_names(by))
    return result(table, rows, ["time_s", *as_names(by)])  # type: ignore[no-any-return]


def fusion_of(
    source: Source,
    *,
    columns: Mapping[str, str] | None = None,
    values: str = "azimuth_deg",
    by: str | Sequence[str] = (),
    sensors: Sequence[str] | None = None,
    sigma: float | Mapping[str, float] | None = None,
    alpha: float | None = None,
    acceleration_sigma: float | None = None,
    period: float | None = 360.0,
    progress: Progress[Target] = iter,
    **options: Any,
) -> Fusion:
    """Return the tracks of all targets with their plots; see `fuse_series`."""
    given = Given(_stated(sigma), alpha, acceleration_sigma)
    options["period"] = period
    model = SingerModel(1.0, alpha or 0.0, acceleration_sigma or 0.0, exact=True)
    # a batch without series: the library judges the options alone
    variances = np.array([[one**2] for one in given.sigmas.values()] or [[1.0]])
    fuse_arrays(np.empty((0, len(variances), 1)), variances, model, **options)
    keys = as_names(by)
    records = _plots(source, columns, values, keys, given)
    there = records.rows["sensor"].unique(maintain_order=True).to_list()
    all_sensors = there if sensors is None else list(sensors)
    listed = ", ".join(all_sensors)
    for name in there:
        if name not in all_sensors:
            raise RecordError(f"there are plots of {name}; the sensors are {listed}")
    for stated in given.sigmas:
        if stated is not None and stated not in all_sensors:
            raise ValueError(f"sigma is given for {stated}; the sensors are {listed}")
    names_of_columns = _columns(values, all_sensors)
    for at, name in enumerate(every := [*keys, *names_of_columns]):
        if name in every[:at]:
            raise ColumnError(f"the track would have two columns {name}", column=name)
    targets = _targets(records)
    noise = settle(targets, all_sensors, given, period) if targets else None
    fused = [_fuse(one, noise, options) for one in progress(targets) if noise is not None]
    empty = pl.DataFrame(schema=dict.fromkeys(names_of_columns, pl.Float64))
    rows = [one.rows(all_sensors, names_of_columns) for one in fused]
    of_sensors = [one.of_sensors(_summary(values)) for one in fused]
    return Fusion(
        fused,
        pl.concat(rows) if rows else empty,
        pl.concat(of_sensors) if of_sensors else pl.DataFrame(),
        noise.fitted if noise else (),
    )


def _mean(values: FloatArray) -> float:
    there = values[~np.isnan(values)]
    return float(there.mean()) if there.size else np.nan


def _stated(sigma: float | Mapping[str, float] | None) -> dict[str | None, float]:
    if sigma is None:
        return {}
    stated: dict[str | None, float] = dict(
        sigma.items() if isinstance(sigma, Mapping) else [(None, sigma)]
    )
    for name, value in stated.items():
        positive(real(value, "sigma"), "sigma" if name is None else f"sigma of {name}")
    return stated


def _plots(
    source: Source,
    columns: Mapping[str, str] | None,
    values: str,
    by: Sequence[str],
    given: Given,
) -> Records:
    """Read the plots, and refuse those that cannot be fused."""
    sigma = column_name(values, "sigma")
    schema = {
        "time": TIME,
        "sensor": SENSOR,
        "angle": Field("number", {values: 1.0}, required=True),
        "sigma": Field("number", {sigma: 1.0}, positive=True),
    }
    records = read(source, schema, columns=columns, by=by, results=_summary(values))
    unnamed = [part.name for part in source if "sensor" not in records.column]
    for at, name in enumerate(unnamed):
        if name in unnamed[:at]:
            raise ColumnError(f"two files are named {name}: give a column sensor", column="sensor")
    rows = records.rows
    present = rows["angle"].is_not_nan()
    if rows.height and not present.any():
        raise RecordError(f"there are no plots: {values} is missing everywhere", column=values)
    if "sigma" in records.column and None not in given.sigmas:
        own = ~rows["sensor"].is_in([name for name in given.sigmas if name is not None])
        records.refuse(present & own & rows["sigma"].is_nan(), f"{sigma} is missing", sigma)
    # a missing plot leaves a time, as often as it comes
    place = pl.concat([rows.select("sensor", "time"), records.by], how="horizontal")
    plots = place.with_columns(
        pl.when(present).then(0).otherwise(pl.int_range(pl.len()) + 1).alias("")
    )
    again = present & ~plots.select(pl.struct(pl.all()).is_first_distinct()).to_series()
    reason = "{sensor} has a second plot at {time}: group several targets by a column"
    records.refuse(again, reason, "time_s")
    return records


def _columns(values: str, sensors: Sequence[str]) -> list[str]:
    """Return the column names of a track."""
    found = ["time_s"]
    for quantity, per in (((), ""), (("rate",), "_s"), (("acceleration",), "_s2")):
        found.append(column_name(values, *quantity, per=per))
        found.append(column_name(values, *quantity, "sigma", per=per))
    for sensor in sensors:
        found += [f"weight_{sensor}", column_name(values, "sigma", sensor), f"outlier_{sensor}"]
    return found


def _summary(values: str) -> list[str]:
    """Return the column names of the sensor table."""
    counts = [f"{what}_count" for what in ("plot", "missing", "outlier")]
    sigmas = [column_name(values, "sigma", *which) for which in (("stated",), (), ("last",))]
    rms = column_name(values, "innovation", "rms")
    return ["sensor", *counts, *sigmas, rms, "innovation_rms_normalised", "weight_mean"]


def _targets(records: Records) -> list[Target]:
    """Return the plots of each target, sorted by time."""
    rows = records.rows
    # seconds from one origin, the earliest of all
    rows = rows.with_columns(pl.Series("seconds", Clock.of(rows["time"]).seconds(rows["time"])))
    return [_target(rows[own], keys) for keys, own in layout(records.by, rows.height)]


def _target(rows: pl.DataFrame, keys: pl.DataFrame) -> Target:
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
    return Target(
        group_name(keys),
        keys,
        sensors.to_list(),
        rows["time"][first],
        times,
        z,
        sigma,
        np.bincount(sensor[~has], minlength=len(sensors)).tolist(),
    )


def _fuse(target: Target, noise: Noise, options: Mapping[str, Any]) -> FusedTarget:
    variance = noise.variance(target.sensors, target.sigma)
    try:
        found = fuse_arrays(target.z, variance, noise.model, time=target.times, **options)
    except np.linalg.LinAlgError as error:
        raise RecordError(f"{target.name or 'the plots'}: {error}") from error
    return FusedTarget(target, variance, found)


def _nothing(table: Any, empty: pl.DataFrame, time: str, by: list[str]) -> pl.DataFrame:
    """Return a track without rows, with the usual column types."""
    if isinstance(table, list) or time not in names(table):
        return empty
    kinds: dict[str, Any] = {
        name: pl.Boolean if name.startswith("outlier_") else kind
        for name, kind in empty.schema.items()
    }
    keys = {name: series(table, name).dtype for name in by}
    return pl.DataFrame(schema=keys | kinds | {"time_s": series(table, time).dtype})
