"""`tertia fuse-series`: one track from the plots of several sensors."""

import math
from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import polars as pl
import typer

from tertia import plot
from tertia._result import counted
from tertia.cli.files import read, write
from tertia.cli.terminal import options as opt
from tertia.cli.terminal.options import option
from tertia.cli.terminal.say import (
    MAX_ROWS,
    WRONG_USAGE,
    as_text,
    fail,
    note,
    print_table,
    working,
)
from tertia.fusion import FusionMethod
from tertia.tables._fuse_series import FusedTarget, fusion_of
from tertia.tables._noise import Fitted

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

EXAMPLES = (
    "tertia fuse-series plots.csv --column sensor=radar",
    "tertia fuse-series north.csv south.csv --sigma north=0.1 --sigma south=0.25",
    "tertia fuse-series plots.csv --by target --output track.csv --plot track.png",
    "tertia fuse-series plots.parquet --value elevation_deg --period 0",
)


def fuse_series(
    files: opt.Recordings,
    *,
    value: opt.Value = "azimuth_deg",
    column: opt.ColumnNames = None,
    by: opt.By = None,
    period: opt.Period = 360.0,
    sigma: Annotated[
        list[str] | None,
        option(
            "Stated sigma of the plots of the sensor NAME, or of all other sensors; may be "
            "repeated. By default the sigma in the files or, without one, an estimate.",
            metavar="[NAME=]VALUE",
        ),
    ] = None,
    bias_sigma: Annotated[
        list[str] | None,
        option(
            "Sigma of the constant error of the sensor NAME, or of all other sensors; may be "
            "repeated. The error itself is estimated. By default there is none.",
            metavar="[NAME=]VALUE",
        ),
    ] = None,
    method: Annotated[FusionMethod, option("Method of fusion.")] = "robust",
    alpha: Annotated[
        float | None,
        option("Inverse of the time constant of the acceleration; by default estimated."),
    ] = None,
    acceleration_sigma: Annotated[
        float | None, option("Sigma of the acceleration; by default estimated.")
    ] = None,
    n_threads: opt.Threads = None,
    output: opt.Output = None,
    plot_file: opt.PlotFile = None,
) -> dict[str, Any]:
    """Fuse the plots of several sensors into one track, and show the weight of each sensor.

    One row per plot, in any order: time_s, sensor (by default the name of each file), azimuth_deg,
    and optionally azimuth_sigma_deg. The track is also estimated at the times of missing plots
    (empty, NA, nan, null, None, -).
    """
    write.check_suffixes(output, plot_file)
    with working("Fusing") as over:
        found = fusion_of(
            read.tables(*files),
            columns=opt.column_names(column),
            values=value,
            by=by or [],
            sigma=_by_sensor("--sigma", sigma or []),
            bias_sigma=_by_sensor("--bias-sigma", bias_sigma or []),
            alpha=alpha,
            acceleration_sigma=acceleration_sigma,
            period=period or None,
            method=method,
            n_threads=n_threads,
            progress=over,
        )
    if found.fitted:
        _print_fitted(found.fitted)
    print_table(found.sensors, text=[*(by or []), "sensor"])
    for one in found.targets[:MAX_ROWS]:
        sigmas = one.result.sigma[:, 0]
        middle = np.median(sigmas[np.isfinite(sigmas)]) if np.any(np.isfinite(sigmas)) else math.nan
        steps = counted(one.target.times.size, "step")
        typer.echo(f"{one.target.name or 'fused'}: {steps}, median sigma of {value} {middle:.3g}")
    write.write(found.rows, output)
    _draw(found.targets, plot_file, value, period or None)
    sensors = found.sensors["sensor"].unique()
    if len(sensors) == 1:
        note(f"{sensors[0]} is the only sensor: its plots are filtered, but not fused")
    return {"sensors": found.sensors.to_dicts()}


def _by_sensor(flag: str, options: Sequence[str]) -> dict[Any, float]:
    """Return the values of an option by sensor; None stands for all other sensors."""
    stated: dict[str | None, float] = {}
    for given in options:
        name, separator, text = given.rpartition("=")
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not 0 < number < math.inf:
            fail(f"{flag} is {given!r}; it must be a positive number, or NAME=NUMBER", WRONG_USAGE)
        stated[name if separator else None] = number
    return stated


def _print_fitted(fitted: Sequence[Fitted]) -> None:
    names = ["fitted", "value", "relative error", "from the plots of", "left out"]
    table = pl.DataFrame([astuple(one) for one in fitted], names, orient="row")

    def cells(row: dict[str, object]) -> dict[str, str]:
        texts = {name: as_text(cell) for name, cell in row.items()}
        number, error = row["value"], row["relative error"]
        if isinstance(number, float) and isinstance(error, float):
            texts["value"] = f"{number:.3g}"
            texts["relative error"] = f"{error:.0%}" if math.isfinite(error) else "unknown"
        return texts

    print_table(table, cells, text=["fitted", "from the plots of"])


def _draw(
    fused: Sequence[FusedTarget], path: Path | None, value: str, period: float | None
) -> None:
    """Draw one column of panels per target."""

    def draw(one: FusedTarget, figure: "FigureBase") -> None:
        target = one.target
        panels = plot.fused_series(
            target.z,
            one.result,
            measurement_variance=one.variance,
            time=target.moments.to_numpy(),
            period=period,
            sensors=target.sensors,
            figure=figure,
        )
        top, _, bottom = panels
        top.set_title(": ".join(filter(None, [target.name, top.get_title()])))
        top.set_ylabel(f"{value}, plot − fused")
        bottom.set_xlabel("time_s")
        if one is not fused[0]:
            for ax in panels:
                ax.set_ylabel("")

    size = (9.0 if len(fused) == 1 else 6.0, 8.0)
    write.save_groups(fused, path, draw, size, across=True)
