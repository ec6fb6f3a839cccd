"""Fusion of the plots of several sensors into one track for each target."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import polars as pl

from tertia._arrays import FloatArray, IntArray, not_negative, positive, real
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
from tertia.tables._parts import ColumnError, RecordError, Source, source_of
from tertia.tables._records import SENSOR, TIME, Records, number, read
from tertia.tables._times import Clock

# plots that are fused in one call
_MOST_AT_ONCE = 200_000


@dataclass(frozen=True, slots=True)
class FusedTarget:
    """A target, the stated variances of its plots, and its track."""

    target: Target
    variance: FloatArray
    result: FusedSeries

    def of_sensor(self, name: str) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return weights, noise and outlier marks of a sensor; a mark of -1 means 'no plot'."""
        if name not in self.target.sensors:
            count = self.target.times.size
            return np.full(count, np.nan), np.full(count, np.nan), np.full(count, -1)
        k = self.target.sensors.index(name)
        outlier = np.where(np.isnan(self.target.z[k]), -1, self.result.outlier[k])
        return self.result.weights[k, :, 0], self.result.noise_variance[k], outlier

    def of_sensors(self, columns: Sequence[str]) -> pl.DataFrame:
        """Return one row per sensor: number of plots, stated and estimated noise, and weight."""
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
            result.bias,
            result.bias_sigma,
        ]
        return beside(target.keys, pl.DataFrame(dict(zip(columns, cells, strict=True))))


@dataclass(frozen=True, slots=True)
class Fusion:
    """The tracks of all targets, and the estimated parameters."""

    targets: list[FusedTarget]
    rows: pl.DataFrame
    fitted: Sequence[Fitted]
    values: str

    @property
    def sensors(self) -> pl.DataFrame:
        """A table with one row for each target and sensor."""
        if not self.targets:
            return pl.DataFrame()
        columns = _summary(self.values)
        rows = pl.concat([one.of_sensors(columns) for one in self.targets])
        asked = any(one.result.systematic != "not included" for one in self.targets)
        return rows if asked else rows.drop(columns[-2:])


def fuse_series(
    table: Table,
    *,
    columns: Mapping[str, str] | None = None,
    values: str = "azimuth_deg",
    by: str | Sequence[str] = (),
    sensors: Sequence[str] | None = None,
    sigma: float | Mapping[str, float] | None = None,
    bias_sigma: float | Mapping[str, float] = 0.0,
    alpha: float | None = None,
    acceleration_sigma: float | None = None,
    period: float | None = 360.0,
    method: FusionMethod = "robust",
    **options: Any,
) -> Table:
    """Fuse the plots of several sensors into one track per target, as `tertia fuse-series` does.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per plot, in any order. The columns are `time_s` (seconds or datetimes), `sensor`,
        the angle, and optionally its sigma (`azimuth_sigma_deg`). A row whose plot is missing (null
        or nan) still defines a time at which the track is estimated.
    columns : mapping of str to str, optional
        The names that columns have in this table, keyed by their standard names.
    values : str
        Column of the angle.
    by : str or sequence of str
        Columns whose values identify the targets; by default all rows belong to one target.
    sensors : sequence of str, optional
        The names of all sensors. They are needed if the table may have no plots of some sensors,
        because the result has columns for each sensor. By default they are the sensors in the
        table.
    sigma : float or mapping, optional
        Stated standard deviation of the plots: one for all sensors, or one for each. It replaces
        the sigmas in the table. If there are none in the table either, it is estimated from the
        whole table.
    bias_sigma : float or mapping, optional
        Standard deviation of a constant systematic error: one for all sensors, or one for each. The
        error of a sensor differs from target to target. With 0 there is no such error; this is also
        the value for sensors that are not in the mapping.
    alpha, acceleration_sigma : float, optional
        Inverse of the time constant of the acceleration, and standard deviation of the
        acceleration; by default they are estimated from the whole table, with all its groups.
    period : float or None
        Period of the angle: 360.0 for degrees, 2*pi for radians, or None for data that do not wrap.
    method : str
        As for `tertia.fusion.fuse_series`.
    **options
        Options of `tertia.fusion.fuse_series`.

    Returns
    -------
    table of the same kind
        One row for each target and time. The columns are those of `by` and `time_s`; the angle, its
        rate and its acceleration, each with its sigma (`azimuth_deg`, `azimuth_sigma_deg`,
        `azimuth_rate_deg_s` and so on); and for each sensor its weight, its estimated sigma, and
        whether its plot is an outlier (`weight_A`, `azimuth_sigma_A_deg`, `outlier_A`). Unknown
        values are null. An empty table gives an empty result.

    Raises
    ------
    RecordError
        If a column is missing, does not hold numbers or is given for two purposes; if a plot has
        no time or no sensor; if there are two plots of one target by one sensor at one time; or if
        there are too few plots to estimate the values that are not given.
    ValueError, TypeError
        If an option is outside its domain or has the wrong type, or the table is of an unsupported
        kind.

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
        bias_sigma=bias_sigma,
        alpha=alpha,
        acceleration_sigma=acceleration_sigma,
        period=period,
        method=method,
        **options,
    )
    time = (columns or {}).get("time_s", "time_s")
    rows = found.rows if found.targets else _nothing(table, found.rows, time, as_names(by))
    return result(table, rows, ["time_s", *as_names(by)])


def fusion_of(
    source: Source,
    *,
    columns: Mapping[str, str] | None,
    values: str,
    by: str | Sequence[str],
    sensors: Sequence[str] | None = None,
    sigma: float | Mapping[str, float] | None,
    bias_sigma: float | Mapping[str, float],
    alpha: float | None,
    acceleration_sigma: float | None,
    period: float | None,
    progress: Progress[list[Target]] = iter,
    **options: Any,
) -> Fusion:
    """Return the tracks of all targets with their plots, as described in `fuse_series`."""
    given = Given(_stated(sigma), alpha, acceleration_sigma)
    bias = _of_biases(bias_sigma)
    options["period"] = period
    model = SingerModel(1.0, alpha or 0.0, acceleration_sigma or 0.0, exact=True)
    # an empty batch of series, with which the library checks only the options
    variances = np.array([[one**2] for one in given.sigmas.values()] or [[1.0]])
    fuse_arrays(np.empty((0, len(variances), 1)), variances, model, **options)
    keys = as_names(by)
    records = _plots(source, columns, values, keys, given)
    there = records.rows["sensor"].unique(maintain_order=True).to_list()
    all_sensors = there if sensors is None else list(sensors)
    listed = ", ".join(all_sensors)
    for name in there:
        if name not in all_sensors:
            raise RecordError(f"there are plots of sensor {name}; the sensors are {listed}")
    for what, stated in (("sigma", given.sigmas), ("bias_sigma", bias)):
        for name in stated:
            if name is not None and name not in all_sensors:
                raise ValueError(f"{what} is given for {name}; the sensors are {listed}")
    names_of_columns = _columns(values, all_sensors)
    for at, name in enumerate(every := [*keys, *names_of_columns]):
        if name in every[:at]:
            raise ColumnError(f"the result would have two columns {name}", column=name)
    targets = _targets(records, there)
    noise = settle(targets, all_sensors, given, period) if targets else None
    if noise is None:
        empty = pl.DataFrame(schema=dict.fromkeys(names_of_columns, pl.Float64))
        return Fusion([], empty, (), values)
    batches = _alike(targets, same_sensors=bool(bias))
    fused = [found for batch in progress(batches) for found in _fuse(batch, noise, bias, options)]
    places = {id(one.target): one for one in fused}
    fused = [places[id(target)] for target in targets]
    return Fusion(fused, _rows(fused, all_sensors, names_of_columns), noise.fitted, values)


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


def _of_biases(bias_sigma: float | Mapping[str, float]) -> dict[str | None, float]:
    """Return the given values by sensor; the key None means all sensors. Empty if all are 0."""
    each = bias_sigma if isinstance(bias_sigma, Mapping) else {None: bias_sigma}
    given: dict[str | None, float] = {}
    for name, value in each.items():
        sigma = not_negative(value, "bias_sigma" if name is None else f"bias_sigma of {name}")
        if sigma > 0:
            given[name] = sigma
    return given


def _plots(
    source: Source,
    columns: Mapping[str, str] | None,
    values: str,
    by: Sequence[str],
    given: Given,
) -> Records:
    """Read the plots; raise an error if some of them cannot be fused."""
    sigma = column_name(values, "sigma")
    schema = {
        "time": TIME,
        "sensor": SENSOR,
        "angle": number(values, required=True, standard=values == "azimuth_deg"),
        "sigma": number(sigma, positive=True),
    }
    records = read(source, schema, columns=columns, by=by, results=_summary(values))
    unnamed = [part.name for part in source if "sensor" not in records.column]
    for at, name in enumerate(unnamed):
        if name in unnamed[:at]:
            raise ColumnError(
                f"two files have the name {name}: add a column sensor", column="sensor"
            )
    rows = records.rows
    present = rows["angle"].is_not_nan()
    if rows.height and not present.any():
        raise RecordError(f"there are no plots: {values} is missing in every row", column=values)
    if "sigma" in records.column and None not in given.sigmas:
        own = ~rows["sensor"].is_in([name for name in given.sigmas if name is not None])
        records.refuse(present & own & rows["sigma"].is_nan(), f"{sigma} is missing", sigma)
    return records


def _columns(values: str, sensors: Sequence[str]) -> list[str]:
    """Return the names of the columns of a fused track."""
    found = ["time_s"]
    for quantity, per in (((), ""), (("rate",), "_s"), (("acceleration",), "_s2")):
        found.append(column_name(values, *quantity, per=per))
        found.append(column_name(values, *quantity, "sigma", per=per))
    for sensor in sensors:
        found += [f"weight_{sensor}", column_name(values, "sigma", sensor), f"outlier_{sensor}"]
    return found


def _summary(values: str) -> list[str]:
    """Return the names of the columns of the table of sensors."""
    counts = [f"{what}_count" for what in ("plot", "missing", "outlier")]
    sigmas = [column_name(values, "sigma", *which) for which in (("stated",), (), ("last",))]
    rms = column_name(values, "innovation", "rms")
    bias = column_name(values, "bias"), column_name(values, "bias", "sigma")
    return ["sensor", *counts, *sigmas, rms, "innovation_rms_normalised", "weight_mean", *bias]


def _targets(records: Records, sensors: Sequence[str]) -> list[Target]:
    """Return the plots of each target by time; a sensor may have only one plot at a time."""
    rows = records.rows
    groups = layout(records.by, rows.height)
    # seconds since the earliest time of all targets
    columns = (
        Clock.of(rows["time"]).seconds(rows["time"]),
        rows["sensor"].cast(pl.Enum(sensors)).to_physical().to_numpy(),
        rows["angle"].to_numpy(),
        rows["sigma"].to_numpy(),
    )
    seconds, sensor, angle, sigma = (groups.arranged(column) for column in columns)
    targets, end = [], 0
    for keys, own in groups:
        part = slice(end, end + len(own))
        end = part.stop
        times, first, step = np.unique(seconds[part], return_index=True, return_inverse=True)
        plots = _Plots(sensor[part], step, angle[part], sigma[part])
        target = plots.target(keys, sensors, rows["time"][own[first]], times)
        if np.count_nonzero(~np.isnan(target.z)) < np.count_nonzero(~np.isnan(plots.angle)):
            _refuse_second(records)
        targets.append(target)
    return targets


@dataclass(frozen=True, slots=True)
class _Plots:
    """The plots of a target, with the numbers of their sensors and times, angles and sigmas."""

    sensor: IntArray
    step: IntArray
    angle: FloatArray
    sigma: FloatArray

    def target(
        self, keys: pl.DataFrame, names: Sequence[str], moments: pl.Series, times: FloatArray
    ) -> Target:
        """Return the target, and its sensors in the order of their first plots."""
        counts = np.bincount(self.sensor, minlength=len(names))
        own = sorted(np.flatnonzero(counts), key=lambda k: int(np.argmax(self.sensor == k)))
        row = np.zeros(len(names), dtype=np.int64)
        row[own] = np.arange(len(own))
        sensor, has = row[self.sensor], ~np.isnan(self.angle)
        z, sigma = np.full((2, len(own), len(times)), np.nan)
        z[sensor[has], self.step[has]] = self.angle[has]
        sigma[sensor[has], self.step[has]] = self.sigma[has]
        missing = np.bincount(sensor[~has], minlength=len(own)).tolist()
        known_as = [names[int(k)] for k in own]
        return Target(group_name(keys), keys, known_as, moments, times, z, sigma, missing)


def _refuse_second(records: Records) -> None:
    """Raise an error for the first plot that a sensor repeats for the same target and time."""
    rows = records.rows
    present = rows["angle"].is_not_nan()
    # rows without a plot only define a time, and may be repeated
    place = pl.concat([rows.select("sensor", "time"), records.by], how="horizontal")
    plots = place.with_columns(
        pl.when(present).then(0).otherwise(pl.int_range(pl.len()) + 1).alias("")
    )
    again = present & ~plots.select(pl.struct(pl.all()).is_first_distinct()).to_series()
    reason = (
        "{sensor} has two plots at {time}: if there are several targets, group the rows by a column"
    )
    records.refuse(again, reason, "time_s")


def _alike(targets: Sequence[Target], *, same_sensors: bool) -> list[list[Target]]:
    """Return batches, of limited size, of targets with equal numbers of sensors and of times."""
    batches: list[list[Target]] = []
    begun: dict[tuple[object, ...], list[Target]] = {}
    for target in targets:
        kind = (*target.z.shape, *(target.sensors if same_sensors else ()))
        batch = begun.get(kind)
        if batch is None or (len(batch) + 1) * target.z.size > _MOST_AT_ONCE:
            batch = begun[kind] = []
            batches.append(batch)
        batch.append(target)
    return batches


def _fuse(
    targets: Sequence[Target],
    noise: Noise,
    bias: Mapping[str | None, float],
    options: Mapping[str, Any],
) -> Iterator[FusedTarget]:
    """Fuse targets that have equal numbers of sensors and of times in one call."""
    variances = [noise.variance(one.sensors, one.sigma) for one in targets]
    arrays = ([one.z for one in targets], variances, [one.times for one in targets])
    z, variance, times = arrays[0][0], arrays[1][0], arrays[2][0]
    if len(targets) > 1:
        z, variance, times = map(np.stack, arrays)
    try:
        prior = [bias.get(name, bias.get(None, 0.0)) for name in targets[0].sensors]
        found = fuse_arrays(z, variance, noise.model, bias_sigma=prior, time=times, **options)
    except ValueError as error:
        if len(targets) > 1:  # fused alone, a target gives an error with its name
            for target in targets:
                yield from _fuse([target], noise, bias, options)
            return
        if isinstance(error, np.linalg.LinAlgError):
            name = targets[0].name or "the plots"
            raise RecordError(f"{name}: {error}") from error
        raise
    for k, (target, own) in enumerate(zip(targets, variances, strict=True)):
        yield FusedTarget(target, own, found if len(targets) == 1 else _of_row(found, k))


def _of_row(found: FusedSeries, k: int) -> FusedSeries:
    """Return one series of a batch."""
    arrays = {one.name: getattr(found, one.name) for one in fields(found)}
    return replace(found, **{name: a[k] for name, a in arrays.items() if isinstance(a, np.ndarray)})


def _rows(
    fused: Sequence[FusedTarget], sensors: Sequence[str], columns: Sequence[str]
) -> pl.DataFrame:
    """Return one row per target and time with the columns of all sensors; null where unknown."""
    mean, sigma = (
        np.concatenate([getattr(one.result, name) for one in fused]) for name in ("mean", "sigma")
    )
    cells: list[pl.Series] = [pl.concat([one.target.moments for one in fused])]
    for component in range(3):
        # if its sigma is infinite, a mean is not an estimate
        there = np.isfinite(sigma[:, component])
        cells += [known(mean[:, component], there), known(sigma[:, component], there)]
    for sensor in sensors:
        each = [one.of_sensor(sensor) for one in fused]
        weight, noise, outlier = (np.concatenate(arrays) for arrays in zip(*each, strict=True))
        cells += [
            known(weight, ~np.isnan(weight)),
            known(np.sqrt(noise), ~np.isnan(noise)),
            known(outlier == 1, outlier >= 0),
        ]
    table = pl.DataFrame(dict(zip(columns, cells, strict=True)))
    keys = pl.concat([one.target.keys for one in fused])
    counts = [one.target.times.size for one in fused]
    own = keys[np.repeat(np.arange(len(fused)), counts)] if keys.width else keys
    return pl.concat([own, table], how="horizontal")


def _nothing(table: Any, empty: pl.DataFrame, time: str, by: list[str]) -> pl.DataFrame:
    """Return a fused track without rows, whose columns have the usual types."""
    if isinstance(table, list) or time not in names(table):
        return empty
    kinds: dict[str, Any] = {
        name: pl.Boolean if name.startswith("outlier_") else kind
        for name, kind in empty.schema.items()
    }
    keys = {name: series(table, name).dtype for name in by}
    return pl.DataFrame(schema=keys | kinds | {"time_s": series(table, time).dtype})
