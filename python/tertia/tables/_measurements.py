"""Measurements of several stations, arranged by target, time and station."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import polars as pl

from tertia._arrays import BoolArray, FloatArray, IntArray, real
from tertia.location._conventions import CONTRADICTION
from tertia.location._readers import NOISE
from tertia.sensors import Kind, Station
from tertia.tables._combined import combined
from tertia.tables._doubts import doubt, doubt_differences, doubt_ranges, doubt_unit
from tertia.tables._groups import as_names, column_name, group_name, layout
from tertia.tables._heights import SCHEMA as HEIGHTS
from tertia.tables._heights import heights_of
from tertia.tables._moving import PLACES, apart, local_places, names_of_places, stations_of
from tertia.tables._names import own_names
from tertia.tables._parts import ColumnError, Part, RecordError, Source
from tertia.tables._records import SENSOR, TIME, Field, Records, Schema, number, read
from tertia.tables._sensors import Sensors
from tertia.tables._times import Clock

# units of the columns, and factors from them to the units of the library
UNITS: dict[Kind, tuple[str, float]] = {
    "range": ("m", 1.0),
    "azimuth": ("deg", math.pi / 180),
    "elevation": ("deg", math.pi / 180),
    "range_difference": ("m", 1.0),
    "arrival_time": ("s", 1.0),
}
VALUES: dict[Kind, str] = {kind: f"{kind}_{unit}" for kind, (unit, _) in UNITS.items()}
SIGMAS: dict[Kind, str] = {kind: column_name(name, "sigma") for kind, name in VALUES.items()}
# a row has one column for each kind of measurement, or the columns `kind` and `value`
SCHEMA: Schema = {
    "time": TIME,
    "sensor": SENSOR,
    # whether ranges are in metres is judged by the distances between the sensors
    **{str(kind): number(name, judged=kind != "range") for kind, name in VALUES.items()},
    "arrival_time": Field("arrival", {VALUES["arrival_time"]: 1.0}),
    **{f"{kind}_sigma": number(name, positive=True) for kind, name in SIGMAS.items()},
    "kind": Field("name", {"kind": 1.0}),
    "value": number("value"),
    "sigma": number("sigma", positive=True),
    **PLACES,
}

T = TypeVar("T")
# groups without an estimate that are named
_SAID = 5


@dataclass(frozen=True, slots=True)
class Target:
    """Measurements of one target at N times by K stations, in metres, radians and seconds.

    `rows` has one measurement per row, in the units of the columns, with `step` and `site`.
    `values` and `sigmas` are (N, K) for each kind, nan where there is no measurement. `sensors` are
    the stations; moving stations have their positions at the N times. `arrivals` is the clock of
    the times of arrival. If the measurements of each sensor are combined, `singles` has all of
    them, with `outlier`. `heights` are those of the target and their sigmas,
    (N, 2), if they are known.
    """

    name: str
    keys: pl.DataFrame
    moments: pl.Series
    times: FloatArray
    rows: pl.DataFrame
    values: dict[Kind, FloatArray]
    sigmas: dict[Kind, FloatArray]
    sensors: Sensors[Station]
    arrivals: Clock
    singles: pl.DataFrame | None = None
    heights: FloatArray | None = None

    @property
    def has_places(self) -> bool:
        """Whether the rows have positions of sensors, which move."""
        return "place_0" in self.rows.columns

    def by_kind(self) -> Iterator[tuple[Kind, IntArray, IntArray, BoolArray]]:
        """Yield each kind of measurement with the times, stations and rows of its measurements."""
        for kind in self.values:
            own = (self.rows["kind"] == kind).to_numpy()
            rows = self.rows.filter(own)
            yield kind, rows["step"].to_numpy(), rows["site"].to_numpy(), own

    def measured(self) -> dict[str, FloatArray]:
        """Return the measurements in the form of arguments of `locate` and `reconstruct`."""
        return {str(kind): _taken(kind, values) for kind, values in self.values.items()}

    def all_sigmas(self, *, optional: bool = False) -> dict[str, FloatArray]:
        """Return the sigmas of the measurements in this form; those of stations if rows have none.

        If `optional` is true, return none if only one kind was measured and no sigma is stated for
        it.
        """
        found, sensors = {}, self.sensors
        for kind, values in self.values.items():
            own = self.sigmas[kind]
            stated = np.where(np.isnan(own), _stated(sensors, kind), own)
            missing = ~np.isnan(values) & np.isnan(stated)
            if optional and len(self.values) == 1 and not np.any(~np.isnan(values) & ~missing):
                return {}
            if np.any(missing):
                name = sensors.names[int(np.flatnonzero(missing.any(axis=0))[0])]
                raise sensors.error(f"{name} has no {SIGMAS[kind]}, but measures {kind}")
            # any positive number is accepted where there is no measurement
            every = np.where(np.isnan(stated), np.nanmin(stated), stated)
            found[str(kind)] = _taken(kind, every)
        return found


def _taken(kind: Kind, array: FloatArray) -> FloatArray:
    """Return the columns of the stations; the first station has no range difference."""
    return array[:, 1:] if kind == "range_difference" else array


def _stated(sensors: Sensors[Station], kind: Kind) -> FloatArray:
    """Return the sigma that is stated for each station; nan if none is stated."""
    if kind == "range_difference":
        return sensors.range_difference_sigma
    each = [getattr(one, f"{kind}_sigma") for one in sensors.items]
    return np.array([np.nan if one is None else one for one in each], dtype=np.float64)


def read_targets(
    source: Source,
    sensors: Sensors[Station],
    *,
    columns: Mapping[str, str] | None = None,
    by: str | Sequence[str],
    results: Sequence[str] = (),
    timed: bool = True,
    tolerance: float = 0.0,
    heights: bool = False,
) -> list[Target]:
    """Return the measurements of each target, sorted by time.

    The time of a row is kept even if the row has no measurements. Unless times are required
    (`timed`), all rows of a table without times belong to one instant. Measurements within
    `tolerance` seconds also belong to one instant. If `tolerance` is inf, all measurements of a
    target belong to one instant, and the measurements of each sensor are combined. Without times,
    times of arrival within a finite `tolerance` belong to one instant. Heights of the targets are
    read if that is asked (`heights`).
    """
    near = 0.0 < tolerance < np.inf
    heard = (columns or {}).get("arrival_time_s", "arrival_time_s")
    timed = timed and not (near and all(part.has(heard) for part in source))
    schema = SCHEMA if timed else {**SCHEMA, "time": replace(TIME, required=False)}
    schema = {**schema, **HEIGHTS} if heights else schema
    for part in source:
        _require_kinds(part, own_names(part, source, columns or {}))
    records = read(
        source, schema, columns=columns, by=as_names(by), sensors=sensors.names, results=results
    )
    if "time" not in records.column:
        # otherwise all rows belong to one instant
        grouped = near and "arrival_time" in records.column
        time = pl.col("arrival_time") if grouped else pl.lit(0.0)
        records = replace(records, rows=records.rows.with_columns(time=time))
    records, arrivals = _with_arrivals(records)
    placed = names_of_places(records, sensors)
    measured = _one_by_one(records, [*placed, *(HEIGHTS if heights else ())])
    if not measured["kind"].count():
        raise RecordError("there are no measurements: all values are missing")
    if sensors.dimension == 2 and (measured["kind"] == "elevation").any():
        column = "up_m" if sensors.frame is None else "height_m"
        where = f" in {sensors.file}" if sensors.file else ""
        raise RecordError(
            f"elevations need the heights of the sensors: give {column} of the sensors{where}"
        )
    noise = _stated(sensors, "range")
    _refuse_impossible(measured, records, noise, repeated=tolerance == np.inf)
    if not placed:
        places = np.array([one.position for one in sensors.items])
        for kind, judge in (("range", doubt_ranges), ("range_difference", doubt_differences)):
            judge(measured.filter(pl.col("kind") == kind)["value"].to_numpy(), places)
    # seconds since the earliest time of all targets
    clock = Clock.of(records.rows["time"])
    measured = measured.with_columns(pl.Series("seconds", clock.seconds(measured["time"])))
    groups = layout(records.by, records.rows.height)
    group = np.empty(records.rows.height, dtype=np.int64)
    group[groups.order] = groups.group
    measured = measured.with_columns(group=group[measured["record"].to_numpy()])
    return [
        _target(rows, groups.keys[k : k + 1], sensors, (clock, arrivals), tolerance, records)
        for k, rows in enumerate(measured.partition_by("group", maintain_order=True))
    ]


def _with_arrivals(records: Records) -> tuple[Records, Clock]:
    """Return the records with times of arrival in seconds, nan where missing, and their clock."""
    heard = records.rows["arrival_time"]
    clock = Clock.of(heard, midnight=True)
    seconds = pl.Series("arrival_time", clock.seconds(heard)).fill_null(math.nan)
    return replace(records, rows=records.rows.with_columns(seconds)), clock


def each_of(targets: Iterable[Target], estimate: Callable[[Target], T]) -> list[T]:
    """Return the estimates of all targets; leave out, with a warning, those that have none."""
    found: list[T] = []
    failed: list[RecordError] = []
    with warnings.catch_warnings():
        # it is said once, of all targets
        warnings.filterwarnings("ignore", f".*{CONTRADICTION}")
        for target in targets:
            try:
                found.append(estimate(target))
            except RecordError as error:
                failed.append(error)
    if failed and not found:
        raise failed[0]
    for reason in failed[:_SAID]:
        doubt(f"{reason}; it is left out")
    if len(failed) > _SAID:
        doubt(f"{len(failed) - _SAID} more groups are left out")
    return found


def doubt_instants(target: Target) -> None:
    """Warn if sensors never measure at the same time, so that no instant can be located."""
    sites = target.rows.group_by("step").agg(pl.col("site").n_unique())["site"]
    if len(sites) > 1 and sites.max() == 1 and target.rows["site"].n_unique() > 1:
        apart = float(np.median(np.diff(target.times)))
        doubt(
            f"{target.name + ': ' if target.name else ''}no two sensors measured at the same time, "
            f"and the times differ by {apart:.3g} s: give a tolerance"
        )


def _require_kinds(part: Part, columns: Mapping[str, str]) -> None:
    """Raise an error for a table that has no columns of measurements."""

    def has(name: str) -> bool:
        return part.has(columns.get(name, name))

    if not any(has(name) for name in VALUES.values()) and not (has("kind") and has("value")):
        listed = ", ".join(VALUES.values())
        raise part.lacks(f"column of measurements: {listed}, or kind and value", [*VALUES.values()])


def _one_by_one(records: Records, placed: Sequence[str]) -> pl.DataFrame:
    """Return one row per measurement; a row without measurements is kept without a kind."""
    rows = records.rows.with_row_index("record").rename({"sensor": "site"})
    place = ["record", "part", "row", "time", "site", *placed]
    long = rows.filter(pl.col("kind").is_not_null() | pl.col("value").is_not_nan())
    wrong = pl.col("value").is_not_nan() & ~pl.col("kind").is_in(list(UNITS)).fill_null(False)
    kinds = ", ".join(UNITS)
    records.refuse(wrong, f"kind is {{kind!r}}; it must be one of {kinds}", "kind")
    doubt_unit("azimuth_deg", long.filter(pl.col("kind") == "azimuth")["value"])
    parts, one_each = [], rows
    if "kind" in records.column and "value" in records.column:
        parts = [long.select(*place, "kind", "value", "sigma")]
        one_each = rows.filter(pl.col("kind").is_null())
    for kind in UNITS:
        cells = pl.lit(str(kind)).alias("kind"), pl.col(kind).alias("value")
        parts.append(one_each.select(*place, *cells, pl.col(f"{kind}_sigma").alias("sigma")))
    measured = pl.concat(parts).filter(pl.col("value").is_not_nan())
    empty = (
        rows.select(place)
        .join(measured, on="record", how="anti")
        .with_columns(kind=pl.lit(None, pl.String), value=pl.lit(math.nan), sigma=pl.lit(math.nan))
    )
    return pl.concat([measured, empty]).sort("record", maintain_order=True)


def _below_noise(rows: pl.DataFrame, noise: FloatArray) -> BoolArray:
    """Return which rows have ranges that are not positive, and not because of noise near a sensor.

    Zeros count only if the sensor has other ranges near to 0: alone, they more often mean that
    nothing was measured.
    """
    value, own = (rows[name].to_numpy() for name in ("value", "sigma"))
    site, is_range = rows["site"].to_numpy(), (rows["kind"] == "range").to_numpy()
    sigma = np.where(np.isnan(own), noise[site], own)
    near = is_range & (np.abs(value) <= NOISE * sigma) & (value != 0.0)
    beside = np.bincount(site[near], minlength=len(noise)) > 0
    found: BoolArray = is_range & (value <= 0.0) & ~np.where(value < 0.0, near, beside[site])
    return found


def _refuse_impossible(
    measured: pl.DataFrame, records: Records, noise: FloatArray, *, repeated: bool
) -> None:
    """Refuse values outside their domain, duplicates, and range differences of the first sensor.

    `noise` has the sigmas of the ranges of the sensors, (K,), for rows without one.
    """
    rows = measured.filter(pl.col("kind").is_not_null())
    rows = rows.with_columns(low=_below_noise(rows, noise))
    one = replace(records, rows=rows)
    kind, value = pl.col("kind"), pl.col("value")
    one.refuse(pl.col("low"), "range is {value:g}; it must be positive", "range")
    one.refuse(
        (kind == "azimuth") & (value.abs() > 720),
        "azimuth is {value:g}; it must be between -720 and 720 degrees",
        "azimuth",
    )
    one.refuse(
        (kind == "elevation") & (value.abs() > 180),
        "elevation is {value:g}; it must be between -180 and 180 degrees",
    )
    one.refuse(
        (kind == "range_difference") & (pl.col("site") == 0),
        "the first sensor has a range difference; only the other sensors have one",
    )
    if repeated:
        return
    keys = pl.concat(
        [
            rows.select("site", "time", "kind"),
            records.by[rows["record"]] if records.by.width else records.by,
        ],
        how="horizontal",
    )
    again = ~keys.select(pl.struct(pl.all()).is_first_distinct()).to_series()
    if "time" not in records.column and again.any():
        # repeated measurements mean that there are several instants, so times are required
        if keys.filter(again)["kind"].eq("arrival_time").all():
            raise records.source[0].error(
                "a sensor has several times of arrival: give a tolerance in seconds that joins the "
                "arrivals of one emission, or a column time_s that is equal for them"
            )
        lacks = records.source[0].lacks("column time_s", ["time_s"])
        still = (
            "if targets do not move, a tolerance of inf combines the measurements of each sensor"
        )
        raise ColumnError(f"{lacks.reason}; {still}", column="time_s")
    reason = (
        "{kind} is given twice for this sensor and time_s {time}: if there are several targets, "
        "group the rows by a column"
    )
    one.refuse(again, reason)


def _target(  # noqa: PLR0917
    rows: pl.DataFrame,
    keys: pl.DataFrame,
    sensors: Sensors[Station],
    clocks: tuple[Clock, Clock],
    tolerance: float,
    records: Records,
) -> Target:
    clock, arrivals = clocks
    moves = "place_0" in rows.columns
    like = np.zeros(0, dtype=np.int64)
    singles = None
    if tolerance > 0:
        rows = rows.sort("seconds", maintain_order=True)
        if tolerance == np.inf:
            rows = rows.filter(pl.col("kind").is_not_null())
            if moves:
                places = local_places(records, rows, sensors)
                rows, like = apart(rows, places, len(sensors.items))
            rows, singles = combined(rows, group_name(keys), None if moves else sensors)
        step, times = _instants(rows, tolerance)
        moments = clock.moments(times)
    else:
        times, first, step = np.unique(
            rows["seconds"].to_numpy(), return_index=True, return_inverse=True
        )
        moments = rows["time"][first]
    rows = rows.with_columns(step=pl.Series(step, dtype=pl.Int64))
    heights = heights_of(rows, times.size)
    rows = rows.filter(pl.col("kind").is_not_null())
    if moves:
        places = local_places(records, rows, sensors)
        sensors = stations_of(sensors, rows, places, like, times.size)
    count = len(sensors.items)
    values: dict[Kind, FloatArray] = {}
    sigmas: dict[Kind, FloatArray] = {}
    for kind, (_, unit) in UNITS.items():
        own = rows.filter(pl.col("kind") == kind)
        if own.is_empty():
            continue
        at = own["step"].to_numpy(), own["site"].to_numpy()
        for found, name in ((values, "value"), (sigmas, "sigma")):
            found[kind] = np.full((times.size, count), np.nan)
            found[kind][at] = own[name].to_numpy() * unit
    measured = rows, values, sigmas
    return Target(
        group_name(keys), keys, moments, times, *measured, sensors, arrivals, singles, heights
    )


def check_tolerance(tolerance: float) -> float:
    """Return the tolerance in seconds; raise an error if it is below 0."""
    seconds = real(tolerance, "tolerance")
    if not seconds >= 0:
        raise ValueError(f"tolerance is {seconds:g}; it must be at least 0 seconds")
    return seconds


def _instants(rows: pl.DataFrame, tolerance: float) -> tuple[IntArray, FloatArray]:
    """Return the instant of each row and the time of each instant; rows are sorted by time.

    An instant ends if the next measurement is later than its first one by more than `tolerance`, or
    if a sensor measures the same kind again.
    """
    time = rows["seconds"].to_numpy()
    keys = list(zip(rows["site"], rows["kind"], strict=True))
    step = np.empty(len(time), dtype=np.int64)
    seen: set[tuple[int, str]] = set()
    at, first = -1, -np.inf
    for row, (now, key) in enumerate(zip(time.tolist(), keys, strict=True)):
        if at < 0 or now - first > tolerance or key in seen:
            at, first, seen = at + 1, now, set()
        seen.add(key)
        step[row] = at
    return step, np.bincount(step, weights=time) / np.bincount(step)
