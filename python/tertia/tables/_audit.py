"""Comparison of estimates and their covariances with the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl

from tertia._arrays import FloatArray, IntArray, positive_number, real
from tertia._result import AXES, covariance_names
from tertia.geo import LocalFrame
from tertia.metrics import Audit, Indicator, Truth
from tertia.metrics import audit as audit_errors
from tertia.metrics._indicator import share_text
from tertia.tables._audit_truth import bridged, nearest_rows, targets, velocity_of
from tertia.tables._frames import Table, names, result
from tertia.tables._groups import as_names, column_name, layout, split_unit, symmetric
from tertia.tables._parts import ColumnError, RecordError, Source, source_of
from tertia.tables._records import Field, Records, Schema, number, read
from tertia.tables._sensors import GEODETIC, LOCAL
from tertia.tables._times import Clock, common_clock

_TURN = 360.0
# if the truth has no velocity for more than this share of the estimates, no time offset is
# estimated
_MOST_UNKNOWN = 0.5
# tables of other programs, recognised by columns that they always have
_FOREIGN: dict[tuple[str, ...], dict[str, str]] = {
    ("top", "x", "y", "x_sd", "y_sd"): {  # tracks of yaps
        "time_s": "top",
        "east_m": "x",
        "north_m": "y",
        "east_sigma_m": "x_sd",
        "north_sigma_m": "y_sd",
    },
    ("timestamp", "latitude", "longitude"): {  # flights of traffic
        "time_s": "timestamp",
        "latitude_deg": "latitude",
        "longitude_deg": "longitude",
    },
}
_TIME = Field("time", {"time_s": 1.0})
_NAME = Field("name", {"target": 1.0, "track": 1.0, "icao24": 1.0})
_PLACES: Schema = {name: number(name) for name in (*LOCAL, *GEODETIC)}
_SIGMAS: Schema = {
    **{f"{axis}_sigma_m": number(f"{axis}_sigma_m") for axis in AXES},
    **{name: number(name) for name in covariance_names(3, 3).values()},
    "position_sigma_m": number("position_sigma_m"),
}
ESTIMATES: Schema = {
    "time": _TIME,
    "name": _NAME,
    "confirmed": Field("flag", {"confirmed": 1.0}),
    **_PLACES,
    **{name: replace(one, positive="_sigma_" in name) for name, one in _SIGMAS.items()},
    **{f"true_{name}": number(f"true_{name}") for name in (*LOCAL, *GEODETIC)},
}
TRUTH: Schema = {"time": _TIME, "name": _NAME, **_PLACES, **_SIGMAS}


@dataclass(frozen=True, slots=True)
class Audited:
    """An audit, and its figures as a table."""

    audit: Audit
    unit: str

    @property
    def rows(self) -> pl.DataFrame:
        """A table with one row for each part, figure and probability."""
        found = [row for name, one in self._parts() for row in _figures(one, name, self.unit)]
        schema: Any = {
            "part": pl.String,
            "figure": pl.String,
            "probability": pl.Float64,
            "value": pl.Float64,
            "low": pl.Float64,
            "high": pl.Float64,
            "unit": pl.String,
            "effective_number": pl.Float64,
            "verdict": pl.String,
        }
        return pl.DataFrame(found, schema, orient="row")

    @property
    def summary(self) -> pl.DataFrame:
        """A table with one row for each part: NEES and coverage with intervals, and the verdict."""
        return pl.DataFrame(
            [
                {
                    "part": name,
                    "count": one.count,
                    "worth": round(one.effective_number),
                    "nees": str(one.nees).partition(":")[0],
                    **{
                        f"inside {100 * p:g} %": share_text(share)
                        for p, share in one.coverage.items()
                    },
                    "sigmas": one.verdict,
                }
                for name, one in self._parts()
            ]
        )

    def _parts(self) -> list[tuple[str, Audit]]:
        return [("all", self.audit), *self.audit.strata.items()]


def _figures(one: Audit, part: str, unit: str) -> list[tuple[Any, ...]]:
    rows: list[tuple[str, str, float | None, Indicator, str]]
    rows = [(part, "nees", None, one.nees, "")]
    for p in one.coverage:
        rows += [
            (part, "coverage", p, one.coverage[p], ""),
            (part, "scale", p, one.scale[p], ""),
            (part, "radius", p, one.radius[p], unit),
            (part, "region_factor", p, one.region_factor[p], ""),
        ]
    if one.time_offset is not None:
        rows.append((part, "time_offset", None, one.time_offset, "s"))
    return [
        (name, figure, p, *_cells(shown), of, shown.effective_number, shown.verdict or None)
        for name, figure, p, shown, of in rows
    ]


def _cells(shown: Indicator) -> list[float | None]:
    """Return the figure and its bounds; values that are missing are None."""
    return [x if np.isfinite(x) else None for x in (shown.value, shown.low, shown.high)]


def audit(
    table: Table,
    truth: Any = None,
    *,
    columns: Mapping[str, str] | None = None,
    truth_columns: Mapping[str, str] | None = None,
    value: str | None = None,
    by: str | Sequence[str] = (),
    strata: str | Sequence[str] = (),
    origin: tuple[float, float] | None = None,
    truth_sigma: float = 0.0,
    max_distance: float = 1000.0,
) -> Table:
    """Compare estimates and their sigmas with the truth, as the command `tertia audit` does.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        The estimates. Positions are in the columns `east_m`, `north_m` and, if known, `up_m`, or in
        `latitude_deg` and `longitude_deg`. Their sigmas are in `east_sigma_m`, `north_sigma_m` and
        `up_sigma_m`, and their covariances in columns such as `covariance_east_north_m2`; or
        `position_sigma_m` has one sigma for all axes. Beside latitudes and longitudes alone, sigmas
        are relative to true north at each position. The times are in `time_s`. The results of the
        other functions are such tables. Tracks of the package yaps and flights of the package
        traffic are also accepted.
    truth : table, optional
        True positions of the targets, with `time_s`, and with `target` if there are several
        targets. They may have sigmas. By default the true positions are taken from columns of
        `table`: `true_east_m` and so on.
    columns, truth_columns : mapping of str to str, optional
        The names that columns have in the table and in the truth, keyed by their standard names.
    value : str, optional
        Column that is audited instead of positions, such as `azimuth_deg`. Its sigma is then in
        `azimuth_sigma_deg`, and the true value in `true_azimuth_deg`. Values in degrees wrap at
        360.
    by : str or sequence of str
        Columns whose values identify independent parts, such as flights; by default `track` or
        `target`.
    strata : str or sequence of str
        Columns whose values divide the record into parts that are audited separately.
    origin : (float, float), optional
        Latitude and longitude, in degrees, of the origin of east and north. They are needed if only
        one of the tables has latitudes and longitudes.
    truth_sigma : float
        Standard deviation in metres of the errors of the truth in each axis; it is used if the
        truth has no sigmas.
    max_distance : float
        Largest distance in metres between a track and its target.

    Returns
    -------
    table of the same kind
        One row for each figure and each part of the record, with the columns `part`, `figure`,
        `probability`, `value`, `low`, `high`, `unit`, `effective_number` and `verdict`.

    Raises
    ------
    RecordError
        If a column is missing, a cell cannot be understood, a covariance is not positive definite,
        or no estimate has a true value.
    ValueError, TypeError
        If an argument is outside its domain, a required one is missing, or the table is of an
        unsupported kind.

    Notes
    -----
    The truth is interpolated linearly, but not across gaps that are more than ten times as long as
    its usual step. The velocities of the truth are used for `time_offset`.

    Examples
    --------
    >>> import numpy as np
    >>> import polars as pl
    >>> from tertia import tables
    >>> rng = np.random.default_rng(1)
    >>> east, north = rng.normal(0.0, 20.0, (2, 300))
    >>> found = tables.audit(
    ...     pl.DataFrame({"east_m": east, "north_m": north}).with_columns(
    ...         position_sigma_m=pl.lit(10.0), true_east_m=pl.lit(0.0), true_north_m=pl.lit(0.0)
    ...     )
    ... )
    >>> found.filter(figure="nees")["verdict"].item()
    'too small by a factor of 1.90 (1.79 to 2.02)'
    """
    found = audit_of(
        source_of(table),
        None if truth is None else source_of(truth),
        columns=columns,
        truth_columns=truth_columns,
        value=value,
        by=by,
        strata=strata,
        origin=origin,
        truth_sigma=truth_sigma,
        max_distance=max_distance,
    )
    return result(table, found.rows)


def audit_of(
    source: Source,
    truth: Source | None,
    *,
    columns: Mapping[str, str] | None,
    truth_columns: Mapping[str, str] | None,
    value: str | None,
    by: str | Sequence[str],
    strata: str | Sequence[str],
    origin: tuple[float, float] | None,
    truth_sigma: float,
    max_distance: float,
) -> Audited:
    """Return the audit, as described in `audit`."""
    spread = real(truth_sigma, "truth_sigma")
    if not 0.0 <= spread < np.inf:
        raise ValueError(f"truth_sigma is {truth_sigma}; it must be 0 or more")
    distance = positive_number(max_distance, "max_distance")
    groups, parts = as_names(by), as_names(strata)
    schema = ESTIMATES if value is None else _scalar(value)
    called = _called(source, columns)
    records = read(source, schema, columns=_only(called, schema, groups), by=groups)
    rows = _Estimates(records, _labels(records, groups), _strata(source, called, parts))
    if value is not None:
        errors = _scalar_errors(records, value, truth)
    elif truth is None:
        errors = _beside(records)
    else:
        truth = [replace(part, option="truth_column") for part in truth]
        there = read(truth, TRUTH, columns=_only(_called(truth, truth_columns), TRUTH, ()))
        errors = _versus(rows, there, origin, distance)
    error, covariance, true, velocity, kept = errors
    if spread > 0.0:
        own = np.zeros((len(error), *covariance.shape[1:])) if true is None else true
        lacks = ~np.any(own, axis=(1, 2)) | np.isnan(own).any(axis=(1, 2))
        own[lacks] = spread**2 * np.eye(own.shape[-1])
        true = own
    if not np.any(np.isfinite(error).all(axis=-1) & np.isfinite(covariance).all(axis=(1, 2))):
        near = "" if truth is None else ": are the times and the origins of both tables the same?"
        raise RecordError(f"no estimate has both a true value and sigmas{near}")
    clock = records.rows["time"]
    time = None
    if not clock.null_count():
        time = Clock.of(clock).seconds(clock)[kept]
    try:
        found = audit_errors(
            error,
            covariance,
            truth_covariance=true,
            time=time,
            groups=rows.group[kept],
            strata={name: labels[kept] for name, labels in rows.strata.items()} or None,
            velocity=velocity,
        )
    except np.linalg.LinAlgError as failure:
        raise RecordError(f"a covariance of the estimates: {failure}") from failure
    return Audited(found, "m" if value is None else split_unit(value)[1])


@dataclass(frozen=True, slots=True)
class _Estimates:
    records: Records
    group: IntArray
    strata: Mapping[str, Any]


# errors, covariances of estimates and truth, velocities, and the rows that they belong to
_Errors = tuple[FloatArray, FloatArray, FloatArray | None, FloatArray | None, Any]


def _called(source: Source, columns: Mapping[str, str] | None) -> dict[str, str]:
    """Return the names of columns, including the names that other programs use."""
    called = dict(columns or {})
    there = set(names(source[0].table))
    for needed, foreign in _FOREIGN.items():
        if set(needed) <= there:
            called = {k: v for k, v in foreign.items() if k not in there} | called
    return called


def _only(called: Mapping[str, str], schema: Schema, by: Sequence[str]) -> dict[str, str]:
    """Return the names of the columns to be read; raise an error for names that no table has."""
    known_names = {name for one in schema.values() for name in one.columns} | set(by)
    foreign = {name for one in _FOREIGN.values() for name in one}
    return {k: v for k, v in called.items() if k in known_names or k not in foreign}


def _labels(records: Records, by: Sequence[str]) -> IntArray:
    """Return the number of the group of each row, from the columns `by` or from the tracks."""
    rows = records.rows
    frame = records.by if by else rows.select("name")
    groups = layout(frame, rows.height)
    labels = np.empty(rows.height, dtype=np.int64)
    labels[groups.order] = groups.group
    return labels


def _strata(source: Source, called: Mapping[str, str], parts: Sequence[str]) -> dict[str, Any]:
    found = {}
    for name in parts:
        columns = []
        for part in source:
            part.require(called.get(name, name))
            columns.append(part.series(called.get(name, name)))
        frames = [one.to_frame(name) for one in columns]
        whole = pl.concat(frames, how="vertical_relaxed")[name]
        if whole.dtype == pl.String and not whole.cast(pl.Float64, strict=False).is_null().any():
            whole = whole.cast(pl.Float64)
        numeric = whole.dtype.is_numeric()
        found[name] = (
            whole.cast(pl.Float64).fill_null(np.nan).to_numpy()
            if numeric
            else whole.cast(pl.String).fill_null("").to_numpy().astype(str)
        )
    return found


def _scalar(value: str) -> Schema:
    return {
        "time": _TIME,
        "name": Field("name", {**_NAME.columns, "sensor": 1.0}),
        "value": number(value, required=True, standard=False),
        "sigma": number(column_name(value, "sigma"), required=True, positive=True),
        "true": number(f"true_{value}", required=True),
    }


def _scalar_errors(records: Records, value: str, truth: Source | None) -> _Errors:
    if truth is not None:
        raise ValueError(f"the truth of {value} must be in a column true_{value} of the table")
    rows = records.rows
    error = (rows["value"] - rows["true"]).to_numpy().copy()
    if split_unit(value)[1] == "deg":
        error = (error + _TURN / 2) % _TURN - _TURN / 2
    variance = rows["sigma"].to_numpy() ** 2
    return error[:, np.newaxis], variance[:, np.newaxis, np.newaxis], None, None, slice(None)


def _beside(records: Records) -> _Errors:
    """Return the errors of the estimates if each row also has the true values."""
    rows = records.rows
    axes = _axes(records, "true_")
    if axes and _axes(records, ""):
        axes = min(axes, _axes(records, ""))
        there, true = (
            rows.select([f"{prefix}{name}" for name in LOCAL[:axes]]).to_numpy()
            for prefix in ("", "true_")
        )
    elif f"true_{GEODETIC[0]}" in records.column and GEODETIC[0] in records.column:
        frame = _frame(rows, None)
        there, true = (_on_ground(frame, rows, prefix) for prefix in ("", "true_"))
        error = _of_true_north(frame, rows, there - true)
        return error, _covariance(records, 2), None, None, slice(None)
    else:
        raise ColumnError(
            f"{records.source[0].called} has no column true_{LOCAL[0]}: give the truth in columns "
            "true_* of the table, or as a separate table",
            column=f"true_{LOCAL[0]}",
        )
    return there - true, _covariance(records, axes), None, None, slice(None)


def _versus(
    rows: _Estimates, there: Records, origin: tuple[float, float] | None, distance: float
) -> _Errors:
    """Return the errors of the estimates if the truth has rows and times of its own."""
    records = rows.records
    for one, table in ((records, "the estimates"), (there, "the truth")):
        if "time" not in one.column:
            raise ColumnError(f"{table} must have a column time_s", column="time_s")
        if one.rows["time"].null_count():
            raise RecordError(f"{table} must have a time_s in every row", column="time_s")
    clock = common_clock(
        [("the estimates", records.rows["time"]), ("the truth", there.rows["time"])]
    )
    place, true_place, frame = _common_places(records, there, origin)
    axes = place.shape[1] if frame is None else 2
    known_truth = np.isfinite(true_place).all(axis=1)
    labels = there.rows["name"].fill_null("").to_numpy().astype(str)
    when = clock.seconds(there.rows["time"])
    truth = Truth(when[known_truth], labels[known_truth], true_place[known_truth])
    time = clock.seconds(records.rows["time"])
    sure = np.isfinite(place).all(axis=1)
    if "confirmed" in records.column:
        sure &= records.rows["confirmed"].fill_null(False).to_numpy()
    kept = np.flatnonzero(sure)
    own = records.rows["name"].fill_null("").to_numpy().astype(str)[kept]
    target = targets(truth, own, time[kept], place[kept], distance)
    covariance = _covariance(records, axes)[kept]
    error = place[kept] - truth.at(target, time[kept])
    error[~bridged(truth, target, time[kept])] = np.nan
    velocity: FloatArray | None
    speed = velocity_of(truth, target, time[kept])
    if frame is not None:
        own_rows = records.rows[kept]
        error, speed = (_of_true_north(frame, own_rows, one) for one in (error, speed))
    unknown = np.isnan(speed[np.isfinite(error).all(axis=1), 0])
    if np.count_nonzero(unknown) > _MOST_UNKNOWN * len(unknown):
        velocity = None
    else:
        # with a velocity of 0, rows at the ends of the truth do not affect the offset
        velocity = np.nan_to_num(speed)
    own_spread = None
    if _has_sigmas(there, axes):
        matrices = _covariance(there, axes)[known_truth]
        nearest = nearest_rows(truth, when[known_truth], labels[known_truth], target, time[kept])
        own_spread = np.nan_to_num(matrices[nearest])
    return error, covariance, own_spread, velocity, kept


def _common_places(
    records: Records, there: Records, origin: tuple[float, float] | None
) -> tuple[FloatArray, FloatArray, LocalFrame | None]:
    """Return the positions of estimates and truth in the same frame.

    The frame is returned, too, if sigmas are those of east and north at each position.
    """
    axes = min(_axes(records, ""), _axes(there, ""))
    if axes:
        place, true = (one.rows.select(LOCAL[:axes]).to_numpy() for one in (records, there))
        return place, true, None
    degrees = [GEODETIC[0] in one.column for one in (records, there)]
    if not any(degrees) or (not all(degrees) and origin is None):
        raise ValueError(
            "estimates and truth must both have east_m and north_m, or latitude_deg and "
            "longitude_deg; otherwise give origin"
        )
    frame = _frame((records if degrees[0] else there).rows, origin)
    if all(degrees):
        of_plane = _axes(records, "") > 0
        place, true = _on_ground(frame, records.rows), _on_ground(frame, there.rows)
        return (place[:, :2], true[:, :2], None) if of_plane else (place, true, frame)
    found = [
        _local(frame, one.rows)[:, :2] if has else one.rows.select(LOCAL[:2]).to_numpy()
        for one, has in zip((records, there), degrees, strict=True)
    ]
    return found[0], found[1], None


def _of_true_north(frame: LocalFrame, rows: pl.DataFrame, vectors: FloatArray) -> FloatArray:
    """Return vectors (N, 3) at positions in the axes east and north of these, (N, 2)."""
    axes = frame.axes(*rows.select(GEODETIC[:2]).fill_nan(0.0).to_numpy().T)[:, :2]
    return np.asarray(np.einsum("nij,nj->ni", axes, vectors))


def _frame(rows: pl.DataFrame, origin: tuple[float, float] | None) -> LocalFrame:
    """Return the local frame at the origin, which by default is the median of the positions."""
    if origin is None:
        middle = rows.select(pl.col(GEODETIC[:2]).fill_nan(None).median()).row(0)
        if None in middle:
            raise RecordError("all positions lack a latitude or a longitude", column=GEODETIC[0])
        origin = middle[0], middle[1]
    return LocalFrame(*origin)


def _local(frame: Any, rows: pl.DataFrame) -> FloatArray:
    latitude, longitude, height = (rows[name].to_numpy() for name in GEODETIC)
    local: FloatArray = frame.to_local(latitude, longitude, np.nan_to_num(height))
    return local


def _on_ground(frame: LocalFrame, rows: pl.DataFrame, prefix: str = "") -> FloatArray:
    """Return local positions (N, 3) on the ellipsoid: one of two tables may lack heights."""
    latitude, longitude = (rows[f"{prefix}{name}"].to_numpy() for name in GEODETIC[:2])
    local: FloatArray = frame.to_local(latitude, longitude, 0.0)
    return local


def _axes(records: Records, prefix: str) -> int:
    """Return the number of local coordinates: 0, 2 or 3."""
    there = [f"{prefix}{name}" in records.column for name in LOCAL]
    return 3 if all(there) else 2 if all(there[:2]) else 0


def _has_sigmas(records: Records, axes: int) -> bool:
    each = all(f"{axis}_sigma_m" in records.column for axis in AXES[:axes])
    return each or "position_sigma_m" in records.column


def _covariance(records: Records, axes: int) -> FloatArray:
    """Return the covariances (N, axes, axes) of positions."""
    rows = records.rows
    if not _has_sigmas(records, axes):
        raise ColumnError(
            f"{records.source[0].called} has neither {AXES[0]}_sigma_m and {AXES[1]}_sigma_m nor "
            "position_sigma_m",
            column=f"{AXES[0]}_sigma_m",
        )
    names = [f"{axis}_sigma_m" for axis in AXES[:axes]]
    sigmas = [name if name in records.column else "position_sigma_m" for name in names]
    between = {
        pair: rows[both].to_numpy()
        for pair, both in covariance_names(axes, axes).items()
        if both in records.column
    }
    return symmetric(np.column_stack([rows[name].to_numpy() for name in sigmas]), between)
