"""Positions of targets in tables: coordinates, residuals, outliers, and reasons of failure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
import polars as pl

from tertia._arrays import BoolArray, FloatArray
from tertia._result import AXES, covariance_names
from tertia.location import Location, LocationStatus
from tertia.sensors import ByKind, Station
from tertia.tables._combined import PERIODS, stated_sigmas
from tertia.tables._conventions import doubt_conventions
from tertia.tables._groups import Progress, beside, known, prefixed
from tertia.tables._measurements import UNITS, Target, each_of
from tertia.tables._parts import RecordError
from tertia.tables._sensors import GEODETIC, Sensors
from tertia.tables._station_clocks import doubt_station_clocks
from tertia.tables._station_times import doubt_station_times

_SUMMARY = (
    "sensor",
    "kind",
    "measurement_count",
    "outlier_count",
    "residual_mean",
    "residual_rms",
)
_OF_INSTANTS = (
    "measurement_count",
    "degrees_of_freedom",
    "pvalue",
    "outlier_count",
    "outlier_measurement",
    "status",
)

EMISSION = "emission_time_s", "emission_time_sigma_s"
REGION = (
    "region_area_m2",
    "region_semi_major_m",
    "region_semi_minor_m",
    "region_orientation_deg",
    "cep_m",
)
PROTECTION_LEVEL = "protection_level_m"

R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class Located(Generic[R]):
    """A target, its estimates, the results of locating it at each instant, and its measurements.

    `measurements` has whitened residuals and outlier flags, which are null if they are unknown; its
    column `step` is the index of the time. `rows` has one row per time, and `sensors` has one row
    per sensor and kind.
    """

    target: Target
    result: R
    fixes: Location
    measurements: pl.DataFrame
    rows: pl.DataFrame
    sensors: pl.DataFrame


@dataclass(frozen=True, slots=True)
class Positions(Generic[R]):
    """The results for all targets."""

    targets: list[Located[R]]
    stations: Sensors[Station]

    @property
    def rows(self) -> pl.DataFrame:
        """A table with one row for each target and time."""
        # only targets with heights have columns for them
        return pl.concat([one.rows for one in self.targets], how="diagonal")

    @property
    def sensors(self) -> pl.DataFrame:
        """A table with one row for each target, sensor and kind."""
        # only targets with systematic errors have columns for them
        return pl.concat([one.sensors for one in self.targets], how="diagonal")

    @property
    def measurements(self) -> pl.DataFrame:
        """A table with one row for each measurement."""
        names = ("time_s", "sensor", "kind", "value", "residual", "outlier")
        return pl.concat(
            [beside(one.target.keys, one.measurements.select(names)) for one in self.targets]
        )


def positions_of(
    targets: Sequence[Target],
    stations: Sensors[Station],
    options: Mapping[str, Any],
    estimate: Callable[[Target], Located[R]],
    progress: Progress[Target],
) -> Positions[R]:
    """Return the positions of all targets, after warnings about their measurements.

    `options` are those of `locate` or `reconstruct`.
    """
    doubt_conventions(targets, options)
    doubt_station_times(targets)
    doubt_station_clocks(targets, options.get("bias"))
    return Positions(each_of(progress(targets), estimate), stations)


@contextmanager
def errors_of(target: Target) -> Iterator[None]:
    """Raise errors about the measurements of a target, or that there are none, with its name."""
    if not target.values:
        raise RecordError(f"{target.name}: there are no measurements")
    try:
        yield
    except ValueError as error:
        raise RecordError(prefixed(target.name, error)) from error


def result_names(motion: Sequence[tuple[str, str]] = ()) -> list[str]:
    """Return the names of result columns, including those of additional vectors (prefix, unit)."""
    space = np.zeros((0, 3, 3))
    vectors = [coordinates(space[..., 0], space, *form) for form in [("", "m"), *motion]]
    return [
        *(name for vector in vectors for name in vector),
        *covariances(space),
        *GEODETIC,
        *EMISSION,
        *REGION,
        PROTECTION_LEVEL,
        *_OF_INSTANTS,
        *_SUMMARY,
        *("value", "residual", "outlier", "time_s", "bias"),
    ]


def coordinates(
    values: FloatArray, covariance: FloatArray, prefix: str = "", unit: str = "m"
) -> dict[str, pl.Series]:
    """Return the columns of vectors, (N, D), and of their sigmas; unknown values are null."""
    columns = {}
    for i, axis in enumerate(AXES[: values.shape[1]]):
        columns[f"{prefix}{axis}_{unit}"] = known(values[:, i])
        columns[f"{prefix}{axis}_sigma_{unit}"] = known(np.sqrt(covariance[:, i, i]))
    return columns


def covariances(covariance: FloatArray) -> dict[str, pl.Series]:
    """Return columns of the covariances between the coordinates (N, D, D)."""
    d = covariance.shape[-1]
    there = np.isfinite(np.diagonal(covariance, axis1=-2, axis2=-1))
    return {
        name: known(covariance[:, i, j], there[:, i] & there[:, j])
        for (i, j), name in covariance_names(d, d).items()
    }


def of_measurements(
    target: Target,
    residuals: ByKind,
    outliers: ByKind,
    judged: BoolArray,
) -> pl.DataFrame:
    """Return the measurements with residuals, and with outlier flags at `judged` instants (N,)."""
    residual = np.full(target.rows.height, np.nan)
    outlier = np.zeros(target.rows.height, dtype=bool)
    for kind, step, site, own in target.by_kind():
        first = int(kind == "range_difference")
        residual[own] = getattr(residuals, kind)[step, site - first]
        outlier[own] = getattr(outliers, kind)[step, site - first]
    decided = judged[target.rows["step"].to_numpy()]
    marks = pl.Series(outlier).set(pl.Series(~decided), None)
    return _judged(target.rows.with_columns(outlier=marks), target, residual)


def of_singles(target: Target, measurements: pl.DataFrame) -> pl.DataFrame:
    """Return all single measurements of a position that was estimated from combined measurements.

    A measurement is an outlier if it was left out when the measurements of its sensor were
    combined, or if the combined measurement was left out.
    """
    assert target.singles is not None
    sums = target.rows.select("site", "kind", mean="value").with_columns(
        away=pl.Series(stated_sigmas(target.rows, target.sensors))
        * measurements["residual"].fill_null(np.nan),
        whole=measurements["outlier"],
    )
    rows = target.singles.sort("seconds", maintain_order=True)
    rows = rows.join(sums, on=("site", "kind"), how="left", maintain_order="left")
    apart = (rows["value"] - rows["mean"]).to_numpy()
    for kind, period in PERIODS.items():
        turns = (rows["kind"] == kind).to_numpy()
        apart = np.where(turns, (apart + period / 2) % period - period / 2, apart)
    residual = (apart + rows["away"].to_numpy()) / stated_sigmas(rows, target.sensors)
    marked = rows.with_columns(pl.col("outlier") | pl.col("whole"), step=pl.lit(0))
    return _judged(marked, target, residual)


def _judged(rows: pl.DataFrame, target: Target, residual: FloatArray) -> pl.DataFrame:
    """Return the columns of measurements, from rows that have the others, and their residuals."""
    return rows.select(
        "step",
        "site",
        pl.col("site").replace_strict(dict(enumerate(target.sensors.names))).alias("sensor"),
        pl.col("time").alias("time_s"),
        "kind",
        "value",
        known(residual).alias("residual"),
        "outlier",
    )


def of_instants(
    target: Target, measurements: pl.DataFrame, fixes: Location, judged: BoolArray
) -> dict[str, Any]:
    """Return columns that describe the location at each instant; null if there was none."""
    located = pl.Series(np.asarray(fixes.success))
    outliers = measurements.filter("outlier")
    listed = outliers.group_by("step").agg(
        pl.format("{} {}", "sensor", "kind").str.join("; ").alias("which")
    )
    steps = pl.DataFrame({"step": pl.int_range(target.times.size, eager=True)})
    which = steps.join(listed, on="step", how="left").sort("step")["which"]
    counts = [
        pl.Series(np.bincount(table["step"], minlength=target.times.size), dtype=pl.Int64)
        for table in (measurements, outliers)
    ]
    degrees = pl.Series(np.asarray(fixes.degrees_of_freedom))
    status = [reason(one) for one in np.asarray(fixes.status).tolist()]
    cells = (
        counts[0],
        degrees.set(~located, None),
        known(np.asarray(fixes.pvalue)),
        counts[1].set(~pl.Series(judged), None),
        which,
        pl.Series(status, dtype=pl.String),
    )
    return dict(zip(_OF_INSTANTS, cells, strict=True))


def reason(status: int) -> str | None:
    """Return the reason why there is no position at an instant; None if there is a position."""
    return LocationStatus(status).message if status else None


def of_sensors(target: Target, measurements: pl.DataFrame) -> pl.DataFrame:
    """Return one row per sensor and kind; its mean and rms are computed without outliers."""
    kept = pl.col("residual").filter(~pl.col("outlier").fill_null(False))
    order = {kind: number for number, kind in enumerate(UNITS)}
    found = (
        measurements.group_by("sensor", "kind")
        .agg(
            pl.col("site").min(),
            pl.len().cast(pl.Int64).alias("measurement_count"),
            pl.col("outlier").sum().cast(pl.Int64).alias("outlier_count"),
            kept.mean().alias("residual_mean"),
            (kept**2).mean().sqrt().alias("residual_rms"),
        )
        .sort("site", pl.col("kind").replace_strict(order))
    )
    return beside(target.keys, found.select(_SUMMARY))
