"""Tracks from the plots of radars."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl

from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia._result import covariance_names, state_names
from tertia._units import FLIGHT_LEVEL, NAUTICAL_MILE
from tertia.flightplan import FlightPlan
from tertia.geo import SystemPlane
from tertia.sensors import Bias, PositionSensor, Radar
from tertia.sensors._sensors import own_biases
from tertia.tables._described import SensorsLike, sensors_of
from tertia.tables._detections import DETECTION, detections_of, refuse_unknown
from tertia.tables._doubts import doubt
from tertia.tables._frames import Table, result
from tertia.tables._groups import known, named
from tertia.tables._identities import (
    IDENTIFIED,
    identities_in,
    identities_of,
    identity_columns,
)
from tertia.tables._parts import RecordError, Source, source_of
from tertia.tables._plot_conventions import doubt_plot_conventions
from tertia.tables._plot_doubts import doubt_plots
from tertia.tables._records import SENSOR, TIME, Field, Records, Schema, number, read
from tertia.tables._reports import MOVING, REPORTED, moving_of, reported_of
from tertia.tables._sensors import GEODETIC, LOCAL, RADAR_BIAS, Sensors, lifted
from tertia.tables._times import Clock
from tertia.tertiary import SystemTracks
from tertia.tracker import Plots, PlotStatus, SmoothedTracks, TrackTable
from tertia.tracker._biases import without_deviation
from tertia.tracker._doubts import Shared, extent_doubts, place_doubts
from tertia.tracker._recording import tracked

PLOTS: Schema = {
    "time": TIME,
    "range": Field("number", {"range_m": 1.0, "range_nm": NAUTICAL_MILE}, required=True),
    "azimuth": Field("number", {"azimuth_deg": 1.0}, required=True, most=720.0),
    "sensor": SENSOR,
    "height": Field("number", {"height_m": 1.0, "flight_level": FLIGHT_LEVEL}),
    **IDENTIFIED,
}
# plots, and reports of positions and velocities with their standard deviations
REPORTS: Schema = {
    **PLOTS,
    "range": replace(PLOTS["range"], required=False),
    "azimuth": replace(PLOTS["azimuth"], required=False),
    **REPORTED,
}
# the number of a plot in the whole recording, if a table is a part of a recording
NUMBERED: Schema = {"plot": number("plot", whole=True)}
# columns of the covariances between position and velocity
COVARIANCES = covariance_names(2, 4)
NO_TRACK = (
    "no track was confirmed: each target has too few plots, never leaves its place, or is faster "
    "than"
)


@dataclass(frozen=True, slots=True)
class Recording:
    """Plots, radars, the kind of times, the columns of identities, and plot numbers."""

    plots: Plots
    sensors: Sensors[Any]
    clock: Clock
    identities: list[str]
    numbers: IntArray

    def numbered(self, plot: IntArray) -> pl.Series:
        """Return the numbers of plots by their rows; null where there is no plot."""
        return known(self.numbers[plot], plot >= 0)


@dataclass(frozen=True, slots=True)
class Tracking:
    """A recording, its tracks, the final errors of the sensors, and the processing time."""

    recording: Recording
    plans: Sequence[FlightPlan]
    table: TrackTable
    bias: Bias
    seconds: float

    @property
    def rows(self) -> pl.DataFrame:
        """The rows of the tracks, with the columns of files."""
        of, table = self.recording, self.table
        rows = track_rows(table, of.clock, of.identities, of.sensors, self.plans)
        return rows.with_columns(plot=of.numbered(table.plot))

    @property
    def refused(self) -> dict[str, int]:
        """Number of plots that could not be used, by reason."""
        statuses, counts = np.unique(self.table.track_of_plot, return_counts=True)
        pairs = zip(statuses.tolist(), counts.tolist(), strict=True)
        return {PlotStatus(status).message: count for status, count in pairs if status < 0}

    @property
    def sensors(self) -> pl.DataFrame:
        """One row per radar; missed scans are counted for confirmed tracks only."""
        table, sensor = self.table, self.recording.plots.sensor
        refused = table.track_of_plot < 0
        used = np.zeros(len(sensor), dtype=bool)
        used[table.plot[table.plot >= 0]] = True
        rows = []
        for k, name in enumerate(self.recording.sensors.names):
            own, seen = sensor == k, (table.sensor == k) & table.confirmed
            updates = int(np.sum(seen & (table.plot >= 0)))
            missed = int(np.sum(seen & (table.plot < 0)))
            parts = (own, own & used, own & ~used & ~refused, own & refused)
            share = updates / (updates + missed) if updates + missed else None
            rows.append((name, *(int(np.sum(one)) for one in parts), missed, share))
        counts = ["plot", "in_track", "in_none", "refused", "missed_scan"]
        schema: dict[str, Any] = {"sensor": pl.String}
        schema |= {f"{name}_count": pl.Int64 for name in counts}
        return pl.DataFrame(rows, schema | {"update_probability": pl.Float64}, orient="row")

    @property
    def errors(self) -> pl.DataFrame:
        """One row per sensor: its systematic errors; null if the plots do not determine them.

        The sigma of the azimuth contains a deviation that changes with the azimuth.
        """
        prior = own_biases(self.recording.sensors.items)
        alike = without_deviation(self.bias, self.recording.sensors.items)
        columns: dict[str, Any] = {"sensor": list(self.recording.sensors.names)}
        for kind, (name, sigma_name, unit) in RADAR_BIAS.items():
            value, sigma = (np.asarray(getattr(self.bias, kind + end)) for end in ("", "_sigma"))
            found = sigma < 0.5 * np.asarray(getattr(prior, f"{kind}_sigma"))
            columns[name] = known(np.where(found, value / unit, np.nan))
            sigma = np.asarray(getattr(alike, f"{kind}_sigma"))
            columns[sigma_name] = known(np.where(found, sigma / unit, np.nan))
        return pl.DataFrame(columns)

    def summary(self) -> dict[str, Any]:
        """Return figures of the whole recording."""
        table, plots = self.table, self.recording.plots
        followed = table.plan >= 0
        moments = plots.time[np.isfinite(plots.time)]
        return {
            "plot_count": len(plots),
            "in_track_count": int(np.sum(table.plot >= 0)),
            "refused_count": self.refused,
            "duration_s": float(np.ptp(moments)),
            "track_count": len(np.unique(table.track)),
            "row_count": len(table),
            "missed_scan_count": int(np.sum(table.plot < 0)),
            "turn_share": float(np.mean(table.turn_probability > 0.5)) if len(table) else 0.0,
            "plan_count": len(self.plans),
            "planned_track_count": len(np.unique(table.track[followed])),
            "left_plan_count": len(np.unique(table.track[followed & ~table.conforms])),
            "tracking_s": self.seconds,
        }

    def tracks(self, rows: pl.DataFrame) -> pl.DataFrame:
        """Return one row per track."""
        hit, sure = pl.col("plot").is_not_null(), pl.col("confirmed")
        return (
            rows.sort("track", "time_s", maintain_order=True)
            .group_by("track", maintain_order=True)
            .agg(
                pl.col("time_s").first().alias("first_time_s"),
                pl.col("time_s").last().alias("last_time_s"),
                hit.sum().cast(pl.Int64).alias("plot_count"),
                (~hit).sum().cast(pl.Int64).alias("missed_scan_count"),
                (hit & sure).sum().truediv(sure.sum()).alias("update_probability"),
                pl.col(self.recording.identities).drop_nulls().last(),
                pl.col("plan").drop_nulls().last(),
                pl.col("conforms", "turn_probability", "speed_m_s", "height_m").mean(),
            )
        )


def track(
    table: Table,
    *,
    sensors: SensorsLike,
    columns: Mapping[str, str] | None = None,
    plans: Sequence[FlightPlan] = (),
    **options: Any,
) -> Table:
    """Track targets from the plots of sensors, as the command `tertia track` does.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per plot, in any order. Required columns are `time_s` (seconds or datetimes),
        `range_m` or `range_nm`, `azimuth_deg`, and, if there are several sensors, `sensor`, the
        name of the sensor. Optional columns are `height_m` or `flight_level`, and any of
        `icao_address` (hexadecimal), `mode_3a` (octal), `callsign` and `identity` (any number of a
        target). If radars have channels, `detection` is psr, ssr, psr+ssr, mode-s or psr+mode-s, or
        a name that `read_asterix` returns. If the table is part of a recording, `plot` is the
        number of the plot in the whole recording (see `stitch`). Reports of a `PositionSensor` have
        `east_m` and `north_m` instead of range and azimuth, or `latitude_deg` and `longitude_deg`
        if the radars are on the earth; and, if known,
        `east_sigma_m`, `north_sigma_m` and `covariance_east_north_m2`. The velocities of reports
        are in `velocity_east_m_s` and `velocity_north_m_s`, or `speed_m_s` (or `speed_kt`) and
        `course_deg`, relative to true north if positions are latitudes and longitudes. They are
        used if there are `velocity_east_sigma_m_s` and `velocity_north_sigma_m_s`, or if the
        sensor has a `velocity_sigma`. A `Station` that moves has `sensor_east_m` and
        `sensor_north_m`, or `sensor_latitude_deg` and `sensor_longitude_deg`, in each of its rows.
        If there is also `sensor_heading_deg`, its azimuths are relative to that heading.
    sensors : sequence of Radar, PositionSensor or Station, DataFrame, or str or Path
        The sensors. A sensor without a name is identified by its index. A table has one row per
        radar, with the columns of sensors files; a path is that of a sensors file in TOML.
    columns : mapping of str to str, optional
        The names that columns have in this table, keyed by their standard names.
    plans : sequence of FlightPlan
        Flight plans of the targets.
    **options
        Options of `tertia.tracker.Tracker`.

    Returns
    -------
    table of the same kind
        One row for every plot of a confirmed track and for every scan that missed it: `time_s`,
        `track`, `sensor`, `plot` (the number of the plot, by default its row), position and
        velocity with their covariance, `course_deg`, `speed_m_s`, `turn_probability`,
        `speed_change_probability`, `association_probability`, `existence_probability`, `height_m`,
        `vertical_rate_m_s`, the identities of the kinds that plots have, `plan`, `conforms`,
        `merged` and `confirmed`. Unknown values are null.

    Raises
    ------
    RecordError
        If a column or a time is missing, a sensor is not among `sensors`, or a cell cannot be
        understood.
    ValueError, TypeError
        If an option is outside its domain or has the wrong type, or the table is of an unsupported
        kind.

    Warns
    -----
    RecordWarning
        If no track was confirmed.

    Examples
    --------
    >>> import numpy as np, polars as pl
    >>> from tertia import tables
    >>> from tertia.sensors import Radar
    >>> radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
    >>> time = np.arange(0.0, 100.0, 4.0)
    >>> plots = pl.DataFrame({"time_s": time, "range_m": 50e3 + 200 * time, "azimuth_deg": 30.0})
    >>> found = tables.track(plots, sensors=[radar])
    >>> found.height, found["track"].unique().to_list()
    (25, [1])
    """
    found = tracks_of(recording_of(source_of(table), sensors, columns), plans, **options)
    if len(found.recording.plots) and not len(found.table):
        doubt(f"{NO_TRACK} max_speed")
    return result(table, found.rows)


def recording_of(
    source: Source,
    sensors: SensorsLike,
    columns: Mapping[str, str] | None,
) -> Recording:
    """Return the plots of a table or of files."""
    radars: Sensors[Any] = sensors_of(sensors)
    schema = {**schema_of(radars), **NUMBERED}
    records = read(source, schema, columns=columns, sensors=radars.names)
    if "range" not in records.column and _is_of_radar(records.rows["sensor"], radars):
        source[0].require(*PLOTS["range"].columns, standard=True)
    _require_positions(records, radars)
    clock = Clock.of(records.rows["time"], midnight=True)
    refuse_unknown(records)
    plots = plots_of(records.rows, clock, radars)
    doubt_plots(plots, radars)
    doubt_plot_conventions(plots, radars)
    return Recording(plots, radars, clock, identities_in(records), _numbers(records))


def _require_positions(records: Records, sensors: Sensors[Any]) -> None:
    """Refuse reports without the columns of their positions."""
    reports = records.rows.filter(pl.Series(reporting(sensors)[records.rows["sensor"].to_numpy()]))
    if reports.is_empty() or {"east", "north"} <= records.column.keys():
        return
    part = records.source[reports["part"][0]]
    there = {"latitude", "longitude"} <= records.column.keys()
    if sensors.frame is None and there:
        raise part.error(
            "positions are latitudes and longitudes, and the sensors have none: add a table "
            "[origin] with latitude_deg and longitude_deg to the file of sensors"
        )
    if not there:
        needed = LOCAL[:2] if sensors.frame is None else GEODETIC[:2]
        raise part.lacks_all([[name] for name in needed if not part.has(name)])


def _is_of_radar(sensor: pl.Series, sensors: Sensors[Any]) -> bool:
    """Return whether any of the rows is from a radar."""
    return any(isinstance(sensors.items[one], Radar) for one in sensor.unique().to_list())


def _numbers(records: Records) -> IntArray:
    """Return the numbers of plots: their rows, or those in a column `plot`."""
    if "plot" not in records.column:
        return np.arange(len(records.rows))
    records.refuse(
        (pl.col("plot") % 1 != 0) | pl.col("plot").is_duplicated(),
        "plot is {plot:g}; it must be a whole number, and different for each plot",
        records.column["plot"],
    )
    return records.rows["plot"].to_numpy().astype(np.int64)


def schema_of(sensors: Sensors[Any]) -> Schema:
    """Return the schema of rows of plots of these sensors."""
    alone = all(isinstance(one, Radar) for one in sensors.items)
    schema = {**PLOTS, **MOVING} if alone else REPORTS
    has_channels = any(getattr(one, "channels", None) is not None for one in sensors.items)
    return {**schema, **DETECTION} if has_channels else schema


def reporting(sensors: Sensors[Any]) -> BoolArray:
    """Return which sensors report positions."""
    return np.array([isinstance(one, PositionSensor) for one in sensors.items], dtype=bool)


def plots_of(rows: pl.DataFrame, clock: Clock, sensors: Sensors[Any]) -> Plots:
    """Return plots from rows that were read by the schema of plots, or of plots and reports."""
    sensor = rows["sensor"].to_numpy()
    reports = reporting(sensors)[sensor]
    reported: dict[str, Any] = reported_of(rows, sensors, reports) if reports.any() else {}
    if "sensor_heading" in rows.columns:
        reported |= moving_of(rows, sensors)
    return Plots(
        clock.seconds(rows["time"]),
        np.where(reports, np.nan, rows["range"].to_numpy()),
        np.where(reports, np.nan, np.radians(rows["azimuth"].to_numpy())) + sensors.norths[sensor],
        sensor=sensor,
        height=rows["height"].to_numpy(),
        **identities_of(rows),
        detection=detections_of(rows),
        **reported,
    )


def refuse_period(clock_period: float | None, clock: Clock) -> None:
    """Refuse a period of clocks if times are dates."""
    if clock_period is not None and clock.dated:
        raise ValueError(
            "clock_period can be used only if times are in seconds; these plots have dates"
        )


def tracks_of(recording: Recording, plans: Sequence[FlightPlan] = (), **options: Any) -> Tracking:
    """Return the tracks of a recording."""
    plots, radars = recording.plots, recording.sensors
    refuse_period(options.get("clock_period"), recording.clock)
    start = time.perf_counter()
    table, bias = tracked(plots, radars.items, plans=plans, **options)
    found = Tracking(recording, plans, table, bias, time.perf_counter() - start)
    said = Shared(radars.items).doubts(table, last=True)
    said += place_doubts(radars.items, bias, radars.names)
    for one in said + extent_doubts(table, plots, radars.items, radars.names):
        doubt(one)
    if len(plots) and np.all(table.track_of_plot < 0):
        raise RecordError(f"no plot can be used: {'; '.join(found.refused)}")
    return found


def plan_names(plans: Sequence[FlightPlan]) -> list[str]:
    """Return the names of plans, or their numbers from 1."""
    return [str(k) if one.name is None else one.name for k, one in enumerate(plans, start=1)]


def track_rows(
    table: TrackTable,
    clock: Clock,
    identities: Sequence[str],
    sensors: Sensors[Radar],
    plans: Sequence[FlightPlan],
) -> pl.DataFrame:
    """Return the rows of a track table with the columns of files; unknown values are null."""
    followed = table.plan >= 0
    return pl.DataFrame(
        {
            "time_s": clock.moments(table.time),
            "track": table.track,
            "sensor": named(table.sensor, sensors.names),
            "plot": known(table.plot, table.plot >= 0),
            **state_columns(table, sensors),
            "turn_probability": table.turn_probability,
            "speed_change_probability": table.speed_change_probability,
            "association_probability": table.association_probability,
            "existence_probability": table.existence_probability,
            "height_m": known(table.height),
            "vertical_rate_m_s": known(table.vertical_rate),
            **identity_columns(table, identities),
            "plan": named(table.plan, plan_names(plans)),
            "conforms": known(table.conforms, followed),
            "merged": table.merged,
            "confirmed": table.confirmed,
        }
    )


def _movement(
    table: TrackTable | SmoothedTracks | SystemTracks, sensors: Sensors[Radar]
) -> tuple[FloatArray, FloatArray]:
    """Return courses and speeds; on the earth, corrected for convergence and scale of the plane."""
    course, speed = np.arctan2(*table.velocity.T), np.hypot(*table.velocity.T)
    if not isinstance(sensors.frame, SystemPlane):
        return course, speed
    places = lifted(table.position, table.height)
    scale, convergence = sensors.frame.scale_and_convergence(places)
    return course - convergence, speed / scale


def state_columns(
    table: TrackTable | SmoothedTracks | SystemTracks, sensors: Sensors[Radar]
) -> dict[str, Any]:
    """Return position and velocity with their covariance, place, course and speed, as columns."""
    values = np.hstack([table.position, table.velocity])
    columns: dict[str, Any] = {}
    for i, (name, unit) in enumerate(state_names(2, 4)):
        columns[f"{name}_{unit}"] = values[:, i]
        # nan if a target is so far away that its variance is lost to rounding
        with np.errstate(invalid="ignore"):
            columns[f"{name}_sigma_{unit}"] = np.sqrt(table.covariance[:, i, i])
    for (i, j), name in COVARIANCES.items():
        columns[name] = table.covariance[:, i, j]
    course, speed = _movement(table, sensors)
    columns |= sensors.geodetic(table.position, table.height)
    return columns | {"course_deg": np.degrees(course) % 360.0, "speed_m_s": speed}
