"""Comparison of tracks with the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl

from tertia._arrays import FloatArray, IntArray, positive_number
from tertia.geo import SystemPlane
from tertia.metrics import Truth
from tertia.metrics._evaluation import (
    Judged,
    Rows,
    figures,
    judge,
    requirements,
    rmse,
    usual_periods,
)
from tertia.tables._doubts import doubt
from tertia.tables._frames import Table, result
from tertia.tables._groups import known, symmetric
from tertia.tables._parts import RecordError, Source, source_of
from tertia.tables._records import IDENTITIES, TIME, Field, Records, Schema, number, read
from tertia.tables._sensors import GEODETIC, LOCAL
from tertia.tables._times import Clock, common_clock

# in metres; targets are not tracked at this distance from the origin
_FAR = 1e6
_VELOCITY = ("velocity_east_m_s", "velocity_north_m_s")
_SPREAD = ("east_sigma_m", "north_sigma_m", "covariance_east_north_m2")
_PLACE = {name: number(name, required=True, whole=True) for name in LOCAL[:2]}
_SIGMA = {name: number(name, positive=True) for name in _SPREAD[:2]}
TRACKS: Schema = {
    "time": TIME,
    "track": Field("name", {"track": 1.0}, required=True, whole=True),
    "seen_by": Field("name", {"sensor": 1.0}),
    "plot": number("plot"),
    "confirmed": Field("flag", {"confirmed": 1.0}),
    **_PLACE,
    **{name: number(name) for name in (*_VELOCITY, _SPREAD[2])},
    **_SIGMA,
    "height": number("height_m"),
    "identity": Field("identity", IDENTITIES),
}
_TARGET: Schema = {
    "time": TIME,
    "target": Field("name", {"target": 1.0, "track": 1.0}, required=True, whole=True),
    "identity": Field("identity", IDENTITIES),
}
TRUTH: Schema = {**_TARGET, **_PLACE, **_SIGMA, GEODETIC[2]: number(GEODETIC[2])}
_TRUTH_ON_EARTH: Schema = {
    **_TARGET,
    **_SIGMA,
    **{name: number(name, required=True, whole=True) for name in GEODETIC[:2]},
    GEODETIC[2]: number(GEODETIC[2]),
}


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Figures of all tracks, a table with one row for each target, and the data compared."""

    rows: pl.DataFrame
    targets: pl.DataFrame
    judged: Judged


def evaluate(
    table: Table,
    truth: Any,
    *,
    columns: Mapping[str, str] | None = None,
    origin: tuple[float, float] | None = None,
    max_distance: float = 1000.0,
    update_interval: float | None = None,
    limits: Mapping[str, float] | None = None,
) -> Table:
    """Compare tracks with the truth, as the command `tertia evaluate` does.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        Tracks as returned by `track`, with `time_s`, `track`, `east_m` and `north_m`, and, if
        available, `plot`, `confirmed`, `sensor`, velocities, sigmas and covariances.
    truth : table
        True positions of the targets, with `time_s`, `target` (or `track`), and `east_m` and
        `north_m`, or `latitude_deg` and `longitude_deg`.
    columns : mapping of str to str, optional
        The names that columns have in the table of tracks, keyed by their standard names.
    origin : (float, float), optional
        Latitude and longitude, in degrees, of the origin of the tracks; needed if the truth has
        latitudes and longitudes.
    max_distance : float
        Largest distance in metres between a track and its target.
    update_interval : float, optional
        Required time between updates in seconds; by default the update interval of the fastest
        sensor.
    limits : mapping of str to float, optional
        Limits of indicators, as for `tertia.metrics.indicators`.

    Returns
    -------
    table of the same kind
        One row for each figure, with its name, value and unit. Figures for which limits can be set
        also have a `limit`, a `verdict`, and the bounds `low` and `high` of a 95 % confidence
        interval that treats flights as independent.

    Raises
    ------
    RecordError
        If a column is missing, a cell cannot be understood, or a covariance is not positive
        definite.
    ValueError, TypeError
        If an argument is outside its domain, a required one is missing, or the table is of an
        unsupported kind.

    Examples
    --------
    >>> import polars as pl
    >>> from tertia import tables
    >>> way = pl.DataFrame({"time_s": [0.0, 4.0, 8.0], "east_m": [0.0, 4e2, 8e2], "north_m": 5e3})
    >>> found = tables.evaluate(
    ...     way.with_columns(track=pl.lit(1)), way.with_columns(target=pl.lit("A"))
    ... )
    >>> found.filter(figure="probability of update")["value"].item()
    1.0
    """
    found = evaluation_of(
        source_of(table),
        source_of(truth),
        columns=columns,
        origin=origin,
        max_distance=max_distance,
        update_interval=update_interval,
        limits=limits,
    )
    return result(table, found.rows)


def evaluation_of(
    tracks: Source,
    truth: Source,
    *,
    columns: Mapping[str, str] | None,
    origin: tuple[float, float] | None,
    max_distance: float,
    update_interval: float | None,
    limits: Mapping[str, float] | None,
) -> Evaluation:
    """Return the figures of all tracks and of each target, as described in `evaluate`."""
    distance = positive_number(max_distance, "max_distance")
    interval = update_interval
    if interval is not None:
        interval = positive_number(interval, "update_interval")
    shown, real_places = read(tracks, TRACKS, columns=columns), _read_truth(truth)
    one, two = tracks[0].called, truth[0].called
    times = shown.rows["time"], real_places.rows["time"]
    clock = common_clock([(one, times[0]), (two, times[1])])
    seconds = [clock.seconds(one) for one in times]
    if all(map(len, seconds)) and max(map(np.min, seconds)) > min(map(np.max, seconds)):
        raise RecordError(f"the times of {one} and those of {two} do not overlap", column="time_s")
    rows = _rows(shown, clock)
    usual = [period for period in usual_periods(rows) if period > 0.0]
    if interval is None and not usual:
        raise ValueError("no track was updated twice by the same sensor: give update_interval")
    required = usual[0] if interval is None else interval
    periods = required, max([required, *usual])
    try:
        places = _truth(real_places, clock, origin, shown.column.get("identity"))
        judged = judge(rows, places, periods, distance, limits)
    except np.linalg.LinAlgError as error:
        raise RecordError("a covariance of the tracks is not positive definite") from error
    schema: Any = {"figure": pl.String, "value": pl.Float64, "unit": pl.String}
    found = pl.DataFrame(figures(judged, required), schema, orient="row", strict=False)
    found = found.join(_verdicts(judged, limits), on="figure", how="left", maintain_order="left")
    return Evaluation(found, _by_target(judged), judged)


def _verdicts(judged: Judged, limits: Mapping[str, float] | None) -> pl.DataFrame:
    """Return the intervals, limits and verdicts of the figures for which limits can be set."""
    rows = [
        (name, one.low, one.high, limit, one.verdict or None)
        for name, one, limit, _ in requirements(judged, limits)
    ]
    numbers = ("low", "high", "limit")
    schema: Any = {"figure": pl.String, **dict.fromkeys(numbers, pl.Float64), "verdict": pl.String}
    found = pl.DataFrame(rows, schema, orient="row", strict=False)
    return found.with_columns(pl.when(pl.col(numbers).is_finite()).then(pl.col(numbers)))


def truth_of(
    source: Source,
    clock: Clock,
    origin: tuple[float, float] | None = None,
    *,
    identity: str,
) -> Truth:
    """Return the truth with times in the time scale of the plots.

    `origin` is the position at which east and north are 0; `identity` is the column by which plots
    identify targets.
    """
    records = _read_truth(source)
    times = records.rows["time"]
    if isinstance(times.dtype, pl.Datetime) != clock.dated:
        kinds = ("dates", "numbers") if clock.dated else ("numbers", "dates")
        raise RecordError(
            f"time_s holds {kinds[0]} in the plots and {kinds[1]} in {source[0].called}; both must "
            "be of one kind",
            column="time_s",
        )
    return _truth(records, clock, origin, identity)


def _read_truth(source: Source) -> Records:
    source = [replace(part, option=None) for part in source]
    local, geodetic = (all(map(source[0].has, form[:2])) for form in (LOCAL, GEODETIC))
    return read(source, TRUTH if local or not geodetic else _TRUTH_ON_EARTH)


def _truth(
    records: Records, clock: Clock, origin: tuple[float, float] | None, identity: str | None
) -> Truth:
    rows = records.rows
    key = ["time", "target"]
    form = LOCAL[:2] if LOCAL[0] in rows.columns else GEODETIC
    places = [name for name in form if name in rows.columns]
    first, new = (
        rows.select(pl.struct(columns).is_first_distinct()).to_series()
        for columns in (key, key + places)
    )
    # a target has one position at a time; the truth may repeat it for several plots
    records.refuse(new & ~first, "target {target} has two positions at time_s {time}", "time_s")
    if LOCAL[0] in rows.columns:
        positions = rows.select(LOCAL[:2]).to_numpy()
    else:
        positions = _in_the_plane(rows, records.source, origin)
    kept, names = new.to_numpy(), rows["target"].to_numpy().astype(str)
    return Truth(
        clock.seconds(rows["time"])[kept],
        names[kept],
        positions[kept],
        covariance=symmetric(np.nan_to_num(rows.select(_SPREAD[:2]).to_numpy()[kept]), {}),
        height=rows[GEODETIC[2]].to_numpy()[kept],
        # addresses of the truth are not compared with codes of the tracks
        identity=rows["identity"].to_numpy()[kept]
        if records.column.get("identity") == identity
        else None,
    )


def _in_the_plane(
    rows: pl.DataFrame, source: Source, origin: tuple[float, float] | None
) -> FloatArray:
    """Convert positions from latitude and longitude to east and north, and return them."""
    if origin is None:
        raise ValueError(
            f"{source[0].called} has latitudes and longitudes: give origin, the point where east "
            "and north of the tracks are zero"
        )
    latitude, longitude, height = (rows[name].to_numpy() for name in GEODETIC)
    frame = SystemPlane(*origin)
    local = frame.to_local(latitude, longitude, np.nan_to_num(height))
    _doubt_swapped(frame, latitude, longitude, local)
    return local[:, :2]


def _doubt_swapped(
    frame: SystemPlane, latitude: FloatArray, longitude: FloatArray, local: FloatArray
) -> None:
    """Warn if positions are near the origin only with latitude and longitude swapped."""
    away = float(np.median(np.linalg.norm(local, axis=-1)))
    if away < _FAR or np.any(np.abs(longitude) > 90):
        return
    if np.median(np.linalg.norm(frame.to_local(longitude, latitude), axis=-1)) < _FAR:
        doubt(
            f"the truth is {away / 1e3:.0f} km from the origin: are latitude_deg and longitude_deg "
            "swapped?"
        )


def _numbers(column: pl.Series) -> IntArray:
    """Return a number for each name; the numbers follow the sorted order of the names."""
    _, numbers = np.unique(column.fill_null("").to_numpy().astype(str), return_inverse=True)
    return numbers.astype(np.int64)


def _rows(records: Records, clock: Clock) -> Rows:
    """Return the rows of confirmed tracks."""
    rows, there = records.rows, records.column
    sure, updated = (np.ones(rows.height, dtype=bool) for _ in range(2))
    if "confirmed" in there:
        sure = rows["confirmed"].fill_null(False).to_numpy()
    if "plot" in there:
        updated = rows["plot"].is_not_nan().to_numpy()
    if not np.any(sure & updated):
        raise RecordError("no confirmed track was updated by a plot", file=records.source[0].file)
    velocity = np.zeros((rows.height, 2))
    if set(_VELOCITY) <= set(there):
        velocity = np.nan_to_num(rows.select(_VELOCITY).to_numpy())
    covariance = None
    if set(_SPREAD) <= set(there):
        between = {(0, 1): rows[_SPREAD[2]].to_numpy()}
        covariance = symmetric(rows.select(_SPREAD[:2]).to_numpy(), between)[sure]
    return Rows(
        clock.seconds(rows["time"])[sure],
        _numbers(rows["track"])[sure],
        _numbers(rows["seen_by"])[sure],
        rows.select(LOCAL[:2]).to_numpy()[sure],
        velocity[sure],
        covariance,
        updated[sure],
        rows["height"].to_numpy()[sure],
        rows["identity"].to_numpy()[sure],
    )


def _by_target(judged: Judged) -> pl.DataFrame:
    figures_of, matching = judged.indicators, judged.indicators.matching
    track = judged.rows.track[judged.rows.updated]
    rows = []
    for k, name in enumerate(judged.truth.targets.tolist()):
        own = matching.target == k
        expected, missed = int(figures_of.expected_updates[k]), int(figures_of.missed_updates[k])
        rows.append(
            {
                "target": name,
                "update_count": int(np.sum(own)),
                "track_count": len(np.unique(track[own])),
                "switch_count": int(matching.switches[k]),
                "update_probability": (expected - missed) / expected if expected else None,
                "latency_s": float(figures_of.latency[k]),
                "rmse_m": rmse(np.hypot(*matching.error[own].T)),
                "rmse_along_track_m": rmse(judged.along[own]),
                "rmse_cross_track_m": rmse(judged.across[own]),
            }
        )
    found = pl.DataFrame(rows)
    return found.with_columns(known(found["latency_s"].to_numpy()).alias("latency_s"))
