"""`tertia fuse`: one track from the plots of several sensors."""

import math
from collections.abc import Sequence
from dataclasses import astuple
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import polars as pl
import typer

from tertia import metrics, plot
from tertia._arrays import FloatArray
from tertia.cli import _tables
from tertia.cli._options import By, Period, PlotFile
from tertia.cli._plots import read_plots, require_distinct
from tertia.cli._terminal import (
    MAX_ROWS,
    WRONG_USAGE,
    as_text,
    counted,
    fail,
    group_name,
    note,
    print_table,
    shown,
    tracked,
    working,
)
from tertia.fusion import FusionMethod, fuse_series
from tertia.tables import _fuse as fusing
from tertia.tables._columns import beside
from tertia.tables._fuse import Fuse, Fused
from tertia.tables._noise import Fitted, Given, Noise, NotFittedError, settle
from tertia.tables._plots import Columns, Group, by_group

if TYPE_CHECKING:
    from matplotlib.figure import Figure, FigureBase

EXAMPLES = (
    "tertia fuse plots.csv --sensor-column radar",
    "tertia fuse north.csv south.csv --sigma north=0.1 --sigma south=0.25",
    "tertia fuse plots.csv --sensor-column radar --by target --output track.csv --plot track.png",
    "tertia fuse plots.parquet --sensor-column radar --column elevation_deg --period 0",
)
_SUMMARY = (
    "sensor",
    "plots",
    "missing",
    "outliers",
    "stated sigma",
    "believed sigma",
    "at the end",
    "rms innovation",
    "normalised",
    "mean weight",
)
_MAX_GROUPS_DRAWN = 4


def fuse(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILES...",
            readable=False,
            help="Plots: .csv with a header, .parquet, .arrow, .jsonl; stacked.",
        ),
    ],
    *,
    sensor_column: Annotated[
        str | None,
        typer.Option(help="Column of the sensor; by default each file is one, of its name."),
    ] = None,
    column: Annotated[str, typer.Option(help="Column of the angle.")] = "azimuth_deg",
    time_column: Annotated[
        str, typer.Option(help="Column of the time: seconds, or dates with time.")
    ] = "time_s",
    by: By = None,
    period: Period = 360.0,
    sigma: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[NAME=]VALUE",
            help="Stated sigma of the plots of a sensor, or of all others; may be repeated. "
            "What is not given is fitted.",
        ),
    ] = None,
    sigma_column: Annotated[
        str | None, typer.Option(help="Column of the stated sigma of each plot.")
    ] = None,
    method: Annotated[FusionMethod, typer.Option(help="How to fuse.")] = "robust",
    alpha: Annotated[
        float | None,
        typer.Option(help="One over the time in which accelerations fade; by default fitted."),
    ] = None,
    acceleration_sigma: Annotated[
        float | None, typer.Option(help="Sigma of the acceleration; by default fitted.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write the track as .csv, .parquet, .arrow, .jsonl or .json."
        ),
    ] = None,
    plot_file: PlotFile = None,
) -> dict[str, Any]:
    """Fuse the plots of several sensors into one track, and tell what each sensor is worth.

    One row per plot; rows may come in any order. A missing plot (empty, NA, nan, null, None, -)
    leaves a time at which the track is told all the same.
    """
    columns = Columns(
        column, time_column, sensor_column, sigma_column, list(dict.fromkeys(by or []))
    )
    given = Given(_stated(sigma or []), sigma_column, alpha, acceleration_sigma)
    wrap = period or None
    fuse_one = partial(fuse_series, method=method, period=wrap)
    if given.sigmas and sigma_column is not None:
        fail("give either --sigma or --sigma-column", WRONG_USAGE)
    require_distinct(columns.needed(), "the column {} is given for two purposes")
    for name in columns.by:
        if name in _SUMMARY:
            fail(f"cannot group by {name}: the results have a column of this name", WRONG_USAGE)
    try:
        fusing.check_options(fuse_one, given)
    except ValueError as error:
        fail(str(error), WRONG_USAGE)
    _tables.check_suffixes(output, plot_file)

    rows = read_plots(files, columns)
    sensors = rows["sensor"].unique(maintain_order=True).to_list()
    try:
        names = fusing.output_columns(columns, sensors)
    except ValueError as error:
        fail(str(error), WRONG_USAGE)
    groups = by_group(rows, columns)
    noise = _settle(groups, sensors, given, columns, wrap)
    fused = [_fuse(fuse_one, group, noise, columns) for group in tracked(groups, "Fusing")]

    _print_summary(fused, columns)
    if output is not None:
        _tables.write(pl.concat([fusing.track(one, sensors, names) for one in fused]), output)
    if plot_file is not None:
        _draw(fused, plot_file, columns, wrap)
    if len(sensors) == 1:
        note(f"{sensors[0]} is the only sensor: its filtered track, nothing to fuse")
    return {"sensors": _summary(fused).to_dicts()}


def _stated(options: list[str]) -> dict[str | None, float]:
    """Return what `--sigma` says, by sensor; None is for all others."""
    stated: dict[str | None, float] = {}
    for option in options:
        name, separator, text = option.rpartition("=")
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0 < value < math.inf:
            fail(
                f"--sigma is {option!r}; it must be a positive number, or NAME=NUMBER", WRONG_USAGE
            )
        stated[name if separator else None] = value
    return stated


def _settle(
    groups: list[Group], sensors: list[str], given: Given, columns: Columns, period: float | None
) -> Noise:
    """Fit what is not given, and print it."""
    for name in given.sigmas:
        if name is not None and name not in sensors:
            fail(f"--sigma names {name}; the sensors are {', '.join(sensors)}", WRONG_USAGE)
    try:
        with working("Fitting"):
            noise = settle(groups, sensors, given, columns.angle, period)
    except NotFittedError as error:
        wanted = (
            "--alpha and --acceleration-sigma"
            if error.sensor is None
            else f"--sigma {error.sensor}=VALUE"
        )
        fail(f"{error.problem}: give {wanted}")
    if noise.fitted:
        _print_fitted(noise.fitted)
    return noise


def _print_fitted(fitted: list[Fitted]) -> None:
    names = ["fitted", "value", "relative error", "from the plots of", "left out"]
    table = pl.DataFrame([astuple(one) for one in fitted], names, orient="row")

    def cells(row: dict[str, object]) -> dict[str, str]:
        texts = {name: as_text(value) for name, value in row.items()}
        value, error = row["value"], row["relative error"]
        if isinstance(value, float) and isinstance(error, float):
            texts["value"] = f"{value:.3g}"
            texts["relative error"] = f"{error:.0%}" if math.isfinite(error) else "not told"
        return texts

    print_table(table, cells, text=["fitted", "from the plots of"], limited="rows are shown")


def _fuse(fuse_one: Fuse, group: Group, noise: Noise, columns: Columns) -> Fused:
    try:
        return fusing.fuse_group(fuse_one, group, noise)
    except (ValueError, np.linalg.LinAlgError) as error:
        fail(": ".join(filter(None, [_name(group, columns), str(error)])))


def _name(group: Group, columns: Columns) -> str:
    return group_name(columns.by, group.values)


def _summary(fused: list[Fused]) -> pl.DataFrame:
    """Return what is told of each sensor of each group."""
    return pl.concat([beside(one.group.keys, _told_of_sensors(one)) for one in fused])


def _told_of_sensors(one: Fused) -> pl.DataFrame:
    group, result = one.group, one.result
    believed = np.sqrt(result.noise_variance)
    values = [
        group.sensors,
        np.count_nonzero(~np.isnan(group.z), axis=1),
        group.missing,
        np.count_nonzero(result.outlier, axis=1),
        np.sqrt(np.median(one.variance, axis=1)),
        np.median(believed, axis=1),
        believed[:, -1],
        metrics.rmse(result.innovation, axis=-1),
        metrics.rmse(result.innovation / np.sqrt(result.innovation_variance), axis=-1),
        [_mean(row) for row in result.weights[..., 0]],
    ]
    return pl.DataFrame(dict(zip(_SUMMARY, values, strict=True)))


def _mean(values: FloatArray) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else math.nan


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else math.nan


def _print_summary(fused: list[Fused], columns: Columns) -> None:
    table = _summary(fused)
    print_table(table, shown, text=[*columns.by, "sensor"], limited="rows are shown")
    for one in fused[:MAX_ROWS]:
        group = one.group
        told = f"{counted(group.times.size, 'step')}, median sigma of {columns.angle} "
        sigma = _median(one.result.sigma[:, 0])
        typer.echo(f"{_name(group, columns) or 'fused'}: {told}{sigma:.3g}")


def _draw(fused: list[Fused], path: Path, columns: Columns, period: float | None) -> None:
    drawn = fused[:_MAX_GROUPS_DRAWN]
    if len(fused) > len(drawn):
        note(f"only the first {len(drawn)} of {len(fused)} groups are drawn")
    _tables.save(_figure(drawn, columns, period), path)


def _figure(drawn: list[Fused], columns: Columns, period: float | None) -> "Figure":
    """Draw one column of panels per group."""
    from matplotlib.figure import Figure  # noqa: PLC0415  # slow to import

    count = len(drawn)
    figure = Figure(figsize=(9.0 if count == 1 else 6.0 * count, 8.0), layout="constrained")
    parts: Sequence[FigureBase] = (
        [figure] if count == 1 else figure.subfigures(1, count, squeeze=False)[0].tolist()
    )
    for at, (part, one) in enumerate(zip(parts, drawn, strict=True)):
        group = one.group
        top, middle, bottom = plot.fused_series(
            group.z,
            one.result,
            measurement_variance=one.variance,
            time=group.moments.to_numpy(),
            period=period,
            sensors=group.sensors,
            figure=part,
        )
        top.set_title(": ".join(filter(None, [_name(group, columns), top.get_title()])))
        top.set_ylabel(f"{columns.angle}, plot − fused")
        bottom.set_xlabel(columns.time)
        if at:
            for ax in (top, middle, bottom):
                ax.set_ylabel("")
    return figure
