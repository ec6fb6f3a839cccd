"""`tertia fuse`: one track from the plots of several sensors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import polars as pl
import typer

from tertia import metrics, plot
from tertia._arrays import FloatArray
from tertia.cli import _tables
from tertia.cli._noise import Given, Noise, settle
from tertia.cli._options import By, Period, PlotFile
from tertia.cli._plots import Columns, Group, by_group, read_plots, require_distinct
from tertia.cli._terminal import (
    MAX_ROWS,
    WRONG_USAGE,
    counted,
    fail,
    note,
    print_table,
    shown,
    tracked,
)
from tertia.fusion import FusionMethod, FusionResult, fuse_series
from tertia.kalman import SingerModel

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


@dataclass(frozen=True, slots=True)
class _Fused:
    """A group, its variances as stated, and what came of it."""

    group: Group
    variance: FloatArray
    result: FusionResult


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
) -> None:
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
    _check_options(fuse_one, given)
    _tables.check_suffixes(output, plot_file)

    rows = read_plots(files, columns)
    sensors = rows["sensor"].unique(maintain_order=True).to_list()
    names = _output_columns(columns, sensors)
    groups = by_group(rows, columns)
    noise = settle(groups, sensors, given, column, wrap)
    fused = [_fuse(fuse_one, group, noise) for group in tracked(groups, "Fusing")]

    _print_summary(fused, columns)
    if output is not None:
        _tables.write(pl.concat([_track(one, sensors, names) for one in fused]), output)
    if plot_file is not None:
        _draw(fused, plot_file, columns, wrap)
    if len(sensors) == 1:
        note(f"{sensors[0]} is the only sensor: its filtered track, nothing to fuse")


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


def _check_options(fuse_one: "partial[FusionResult]", given: Given) -> None:
    """Let the library judge the options before the work."""
    try:
        model = SingerModel(1.0, given.alpha or 0.0, given.acceleration_sigma or 0.0, exact=True)
        for sigma in given.sigmas.values() or [1.0]:
            fuse_one(np.zeros((1, 1)), sigma**2, model)
    except ValueError as error:
        fail(str(error), WRONG_USAGE)


def _output_columns(columns: Columns, sensors: list[str]) -> list[str]:
    """Return the names of the columns of the track, without those of `by`."""
    names = [columns.time]
    for quantity in (columns.angle, "rate", "acceleration"):
        names += [quantity, f"{quantity}_sigma"]
    for sensor in sensors:
        names += [f"weight_{sensor}", f"sigma_{sensor}", f"outlier_{sensor}"]
    require_distinct([*columns.by, *names], "the track would have two columns {}")
    return names


def _fuse(fuse_one: "partial[FusionResult]", group: Group, noise: Noise) -> _Fused:
    variance = noise.variance(group)
    try:
        result = fuse_one(group.z, variance, noise.model, times=group.times)
    except (ValueError, np.linalg.LinAlgError) as error:
        fail(": ".join(filter(None, [group.name, str(error)])))
    return _Fused(group, variance, result)


def _summary(fused: list[_Fused]) -> pl.DataFrame:
    """Return what is told of each sensor of each group."""
    return pl.concat([_tables.beside(one.group.keys, _told_of_sensors(one)) for one in fused])


def _told_of_sensors(one: _Fused) -> pl.DataFrame:
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


def _print_summary(fused: list[_Fused], columns: Columns) -> None:
    table = _summary(fused)
    print_table(table, shown, text=[*columns.by, "sensor"], limited="rows are shown")
    for one in fused[:MAX_ROWS]:
        group = one.group
        told = f"{counted(group.times.size, 'step')}, median sigma of {columns.angle} "
        sigma = _median(one.result.sigma[:, 0])
        typer.echo(f"{group.name or 'fused'}: {told}{sigma:.3g}")


def _track(one: _Fused, sensors: list[str], names: list[str]) -> pl.DataFrame:
    """Return one row per time, null for what is not known, with the columns of all sensors."""
    group, result = one.group, one.result
    values: list[pl.Series] = [group.moments]
    for component in range(3):
        sigma = result.sigma[:, component]
        known = np.isfinite(sigma)
        # with an infinite sigma the mean is no estimate
        values += [_tables.known(result.mean[:, component], known), _tables.known(sigma, known)]
    for sensor in sensors:
        if sensor in group.sensors:
            k = group.sensors.index(sensor)
            weight, noise = result.weights[k, :, 0], np.sqrt(result.noise_variance[k])
            rejected = pl.Series(result.outlier[k]).set(pl.Series(np.isnan(group.z[k])), None)
            values += [_tables.known(weight, ~np.isnan(weight)), pl.Series(noise), rejected]
        else:
            kinds = (pl.Float64, pl.Float64, pl.Boolean)
            values += [pl.repeat(None, group.times.size, dtype=d, eager=True) for d in kinds]
    return _tables.beside(group.keys, pl.DataFrame(dict(zip(names, values, strict=True))))


def _draw(fused: list[_Fused], path: Path, columns: Columns, period: float | None) -> None:
    drawn = fused[:_MAX_GROUPS_DRAWN]
    if len(fused) > len(drawn):
        note(f"only the first {len(drawn)} of {len(fused)} groups are drawn")
    _tables.save(_figure(drawn, columns, period), path)


def _figure(drawn: list[_Fused], columns: Columns, period: float | None) -> "Figure":
    """Draw one column of panels per group."""
    from matplotlib.figure import Figure  # noqa: PLC0415  # slow to import

    count = len(drawn)
    figure = Figure(figsize=(9.0 if count == 1 else 6.0 * count, 8.0), layout="constrained")
    parts: Sequence[FigureBase] = (
        [figure] if count == 1 else figure.subfigures(1, count, squeeze=False)[0].tolist()
    )
    for at, (part, one) in enumerate(zip(parts, drawn, strict=True)):
        group = one.group
        top, middle, bottom = plot.fusion(
            group.z,
            one.result,
            measurement_variance=one.variance,
            times=group.moments.to_numpy(),
            period=period,
            sensors=group.sensors,
            figure=part,
        )
        top.set_title(": ".join(filter(None, [group.name, top.get_title()])))
        top.set_ylabel(f"{columns.angle}, plot − fused")
        bottom.set_xlabel(columns.time)
        if at:
            for ax in (top, middle, bottom):
                ax.set_ylabel("")
    return figure
