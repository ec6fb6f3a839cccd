"""What is told of positions: coordinates, residuals, faults, instants without a position."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import polars as pl
import typer

from tertia._arrays import FloatArray
from tertia.cli import _tables
from tertia.cli._measurements import Columns, Record
from tertia.cli._places import GEODETIC
from tertia.cli._stations import UNITS, Sites, sigma_column
from tertia.cli._terminal import counted, fail, note, print_table, shown
from tertia.location import Location, LocationStatus
from tertia.sensors import ByKind, Kind

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

_AXES = ("east", "north", "up")
SUMMARY = ("station", "kind", "measured", "faults", "mean / sigma", "rms / sigma")
_MAX_GROUPS_DRAWN = 4
# p-value below which measurements contradict each other
_DOUBTFUL = 1e-3
# share of the instants from which on this is told: ten times what chance makes
_MANY = 0.01


def result_columns() -> set[str]:
    """Return the columns of the results beside those of time, station and `by`."""
    space = np.zeros((0, 3, 3))
    told = {"measured", "degrees_of_freedom", "p_value", "outliers", "left_out", "problem"}
    return {
        *told,
        *SUMMARY[1:],
        *("value", "residual", "fault"),
        *coordinates(space[..., 0], space),
        *covariances(space),
        *GEODETIC,
    }


def all_sigmas(record: Record, sites: Sites, *, optional: bool = False) -> dict[Kind, FloatArray]:
    """Return a standard deviation for every measurement, (N, K): its own, or that of its station.

    Where `optional`, nothing is returned if none is stated for the only kind that was measured.
    """
    sigmas = {}
    for kind, values in record.values.items():
        own = record.sigmas[kind]
        sigma = np.where(np.isnan(own), sites.sigmas[kind], own)
        missing = ~np.isnan(values) & np.isnan(sigma)
        if optional and len(record.values) == 1 and not np.any(~np.isnan(values) & ~missing):
            return {}
        if np.any(missing):
            name = sites.names[int(np.flatnonzero(missing.any(axis=0))[0])]
            fail(f"{sites.path}: {name} has no {sigma_column(kind)}, but measures {kind}")
        # where nothing is measured any number will do
        sigmas[kind] = np.where(np.isnan(sigma), np.nanmin(sigma), sigma)
    return sigmas


def coordinates(
    values: FloatArray, covariance: FloatArray, prefix: str = "", unit: str = "m"
) -> dict[str, pl.Series]:
    """Return columns of vectors (N, D) and their standard deviations, null where unknown."""
    columns = {}
    for i, axis in enumerate(_AXES[: values.shape[1]]):
        sigma = np.sqrt(covariance[:, i, i])
        columns[f"{prefix}{axis}_{unit}"] = _tables.known(values[:, i], np.isfinite(values[:, i]))
        columns[f"{prefix}{axis}_sigma_{unit}"] = _tables.known(sigma, np.isfinite(sigma))
    return columns


def geodetic(position: FloatArray, sites: Sites) -> dict[str, pl.Series]:
    """Return columns of latitude, longitude and height, if the stations have them."""
    columns = sites.places.geodetic(position)
    return {name: _tables.known(values, np.isfinite(values)) for name, values in columns.items()}


def covariances(covariance: FloatArray) -> dict[str, pl.Series]:
    """Return columns of the covariances between the coordinates (N, D, D)."""
    d = covariance.shape[-1]
    known = np.asarray(np.isfinite(covariance).all(axis=(1, 2)))
    return {
        f"covariance_{_AXES[i]}_{_AXES[j]}_m2": _tables.known(covariance[:, i, j], known)
        for i in range(d)
        for j in range(i + 1, d)
    }


def judged(
    record: Record, sites: Sites, residuals: ByKind, outliers: ByKind, fixes: Location
) -> pl.DataFrame:
    """Return the measurements with their whitened residuals, and whether they are faults.

    Both are null where they are not known. `step` numbers the times.
    """
    residual = np.full(record.rows.height, np.nan)
    fault = np.zeros(record.rows.height, dtype=bool)
    for kind, step, site, own in record.by_kind():
        first = int(kind == "range_difference")
        residual[own] = getattr(residuals, kind)[step, site - first]
        fault[own] = getattr(outliers, kind)[step, site - first]
    decided = np.asarray(fixes.success)[record.rows["step"].to_numpy()]
    return record.rows.select(
        "step",
        "site",
        pl.col("site").replace_strict(dict(enumerate(sites.names))).alias("station"),
        "time",
        "kind",
        "value",
        _tables.known(residual, np.isfinite(residual)).alias("residual"),
        pl.Series(fault).set(pl.Series(~decided), None).alias("fault"),
    )


def measurement_rows(table: pl.DataFrame, record: Record, columns: Columns) -> pl.DataFrame:
    """Return `judged` measurements with the columns of the input."""
    told = table.select(
        pl.col("time").alias(columns.time),
        pl.col("station").alias(columns.station),
        "kind",
        "value",
        "residual",
        "fault",
    )
    return _tables.beside(record.keys, told)


def instants(record: Record, table: pl.DataFrame, fixes: Location) -> dict[str, pl.Series]:
    """Return columns of how each instant was located, null where it was not."""
    located = np.asarray(fixes.success)
    degrees = pl.Series(np.asarray(fixes.degrees_of_freedom))
    p_value = np.asarray(fixes.pvalue)
    faulty = (
        table.filter("fault")
        .group_by("step")
        .agg(pl.format("{} {}", "station", "kind").str.join("; ").alias("left_out"))
    )
    steps = pl.DataFrame({"step": pl.int_range(record.times.size, eager=True)})
    left_out = steps.join(faulty, on="step", how="left").sort("step")["left_out"]
    count, faults = (_each(record, of) for of in (table, table.filter("fault")))
    return {
        "measured": count,
        "degrees_of_freedom": degrees.set(pl.Series(~located), None),
        "p_value": _tables.known(p_value, np.isfinite(p_value)),
        "outliers": faults.set(pl.Series(~located), None),
        "left_out": left_out,
        "problem": pl.Series([_reason(one) for one in np.asarray(fixes.status)], dtype=pl.String),
    }


def _each(record: Record, table: pl.DataFrame) -> pl.Series:
    """Return how many rows there are of each instant."""
    return pl.Series(np.bincount(table["step"], minlength=record.times.size), dtype=pl.Int64)


def _reason(status: int) -> str | None:
    return LocationStatus(status).message if status else None


def summary(record: Record, table: pl.DataFrame) -> pl.DataFrame:
    """Return what is told of each station and kind: mean and rms are those without faults."""
    kept = pl.col("residual").filter(~pl.col("fault").fill_null(False))
    order = {kind: number for number, kind in enumerate(UNITS)}
    told = (
        table.group_by("site", "station", "kind")
        .agg(
            pl.len().cast(pl.Int64).alias("measured"),
            pl.col("fault").sum().cast(pl.Int64).alias("faults"),
            kept.mean().alias("mean / sigma"),
            (kept**2).mean().sqrt().alias("rms / sigma"),
        )
        .sort("site", pl.col("kind").replace_strict(order))
    )
    return _tables.beside(record.keys, told.select(SUMMARY))


def print_summary(table: pl.DataFrame, by: list[str], *, text: tuple[str, ...] = ()) -> None:
    """Print a table of stations."""
    limited = "rows are shown"
    print_table(table, shown, text=[*by, "station", "kind", *text], limited=limited)


def say_origin(sites: Sites) -> None:
    """Say where the origin of east and north is, if that is known."""
    origin = sites.places.origin()
    if origin is not None:
        typer.echo(origin)


def say_located(record: Record, fixes: Location, position: FloatArray, sigma: FloatArray) -> None:
    """Say how many instants were located, why others were not, and how well."""
    located = np.asarray(fixes.success)
    total = np.sqrt(np.sum(sigma[np.isfinite(sigma).all(axis=1)] ** 2, axis=1))
    error = f", median sigma {np.median(total):.3g} m" if total.size else ""
    known = np.count_nonzero(np.isfinite(position).all(axis=1))
    told = f"{np.count_nonzero(located)} of {counted(located.size, 'instant')} located"
    if known > np.count_nonzero(located):
        told += f", {known} with a position"
    typer.echo(": ".join(filter(None, [record.name, told + error])))
    numbers, counts = np.unique(np.asarray(fixes.status)[~located], return_counts=True)
    for number, count in zip(numbers, counts, strict=True):
        typer.echo(f"  {counted(int(count), 'instant')} not located: {_reason(int(number))}")
    doubtful = (np.asarray(fixes.pvalue) < _DOUBTFUL) & (np.asarray(fixes.outlier.count) == 0)
    if np.sum(doubtful) > _MANY * np.sum(located):
        typer.echo(
            f"  {counted(int(np.sum(doubtful)), 'instant')} with a p-value below {_DOUBTFUL:g} and "
            "no fault found: a measurement or a sigma is wrong"
        )


def name_panels(panels: "dict[str, Axes]", record: Record, columns: Columns) -> None:
    """Name the group and the times of a picture."""
    plan, *others = panels.values()
    plan.set_title(": ".join(filter(None, [record.name, plan.get_title()])))
    others[-1].set_xlabel(columns.time)


def draw(
    path: Path, names: list[str], one: Callable[[int, "FigureBase"], None], height: float
) -> None:
    """Draw groups below each other, of this height; `one` draws a group."""
    from matplotlib.figure import Figure  # noqa: PLC0415  # slow to import

    count = min(len(names), _MAX_GROUPS_DRAWN)
    if len(names) > count:
        note(f"only the first {count} of {len(names)} groups are drawn")
    figure = Figure(figsize=(11.0, height * count), layout="constrained")
    parts = [figure] if count == 1 else figure.subfigures(count, 1, squeeze=False)[:, 0].tolist()
    for at, part in enumerate(parts):
        one(at, part)
    _tables.save(figure, path)
