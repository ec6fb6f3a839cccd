"""`tertia bearing`: bearings with their sigmas."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import polars as pl
import typer

import tertia
from tertia import plot, tables
from tertia._arrays import FloatArray
from tertia.bearing import BearingEstimate, Method
from tertia.cli import _tables
from tertia.cli._options import By, Period, PlotFile
from tertia.cli._terminal import (
    FAILED,
    WRONG_USAGE,
    as_text,
    counted,
    fail,
    group_name,
    note,
    print_table,
    working,
)
from tertia.tables._bearings import require_options
from tertia.tables._columns import layout

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

EXAMPLES = (
    "tertia bearing recording.csv",
    "tertia bearing recording.csv --column azimuth --by station --by target",
    "tertia bearing recording.csv --by target --output out.parquet --plot out.png",
    "tertia bearing ranges.csv --column range_m --period 0 --method corrected",
)
_MAX_PANELS = 16


def bearing(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            readable=False,
            help="Recording: .csv with a header, .parquet, .arrow, .jsonl.",
        ),
    ],
    *,
    column: Annotated[str, typer.Option(help="Column of the measurements.")] = "bearing_deg",
    by: By = None,
    method: Annotated[Method, typer.Option(help="How to estimate.")] = "robust",
    period: Period = 360.0,
    block_size: Annotated[int, typer.Option(help="Measurements per block.")] = 10,
    k: Annotated[
        float, typer.Option(help="Threshold of the methods corrected, paper and k-sigma.")
    ] = 2.5,
    output: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write .csv, .parquet, .arrow, .jsonl or .json, not a table."
        ),
    ] = None,
    plot_file: PlotFile = None,
) -> dict[str, Any]:
    """Estimate a bearing and its sigma per group, and count the anomalous measurements.

    The measurements of a group must be in the order in which they came. Missing ones (empty, NA,
    nan, null, None, -) are left out and counted.
    """
    wrap, keys = period or None, list(dict.fromkeys(by or []))
    options: dict[str, Any] = {"period": wrap, "method": method, "block_size": block_size, "k": k}
    try:
        require_options(keys, column, options)
    except ValueError as error:
        fail(str(error), WRONG_USAGE)
    _tables.check_suffixes(output, plot_file)
    frame = _read(file, column, keys)
    with working("Estimating"):
        table = tables.bearings(frame, column, by=keys, **options)
    if output is None:
        _print(table, keys)
    else:
        _tables.write(table, output)
    if plot_file is not None:
        drawn = _drawn(frame, table, column, keys, options)
        if drawn:
            _tables.save(_figure(drawn, column, wrap, block_size), plot_file)
    _report(table)
    return {"groups": table.to_dicts()}


def _read(path: Path, column: str, by: list[str]) -> pl.DataFrame:
    """Return the values of `by` and the measurements, nan where missing."""
    frame = _tables.read(path, [column, *by])
    is_row = _tables.is_row(frame, path)
    frame = frame.select(*by, _tables.numbers(frame[column], path)).filter(is_row)
    if frame.is_empty():
        fail(f"{path} is empty")
    return frame


def _print(table: pl.DataFrame, by: list[str]) -> None:
    if not table["note"].count():
        table = table.drop("note")
    shown = "groups are shown: --output writes all"
    print_table(table, _cells, text=[*by, "note"], limited=shown)


def _cells(row: dict[str, object]) -> dict[str, str]:
    cells = {name: as_text(value) for name, value in row.items()}
    value, sigma, polarity = row["value"], row["sigma"], row["polarity"]
    if isinstance(value, float) and isinstance(sigma, float):
        cells["value"], cells["sigma"] = plot.rounded(value, sigma)
        cells["polarity"] = f"{polarity:+.3f}"
    return cells


def _drawn(
    frame: pl.DataFrame, table: pl.DataFrame, column: str, by: list[str], options: dict[str, Any]
) -> list[tuple[str, FloatArray, BearingEstimate]]:
    """Return the names, measurements and estimates of the groups that are drawn."""
    estimated = table["note"].is_null().arg_true()
    if len(estimated) > _MAX_PANELS:
        note(f"only the first {_MAX_PANELS} of {len(estimated)} groups are drawn")
    groups = layout(frame, by)
    samples = np.split(frame[column].to_numpy()[groups.order], np.cumsum(groups.lengths)[:-1])
    return [
        (
            group_name(by, groups.keys.row(k)) if by else "",
            samples[k],
            tertia.estimate_bearing(samples[k], nan_policy="omit", **options),
        )
        for k in estimated[:_MAX_PANELS]
    ]


def _figure(
    drawn: list[tuple[str, FloatArray, BearingEstimate]],
    column: str,
    period: float | None,
    block_size: int,
) -> "Figure":
    from matplotlib.figure import Figure  # noqa: PLC0415  # slow to import

    columns = math.ceil(math.sqrt(len(drawn)))
    rows = math.ceil(len(drawn) / columns)
    figure = Figure(figsize=(max(8, 4.5 * columns), max(4.5, 3 * rows)), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    legend: dict[str, Artist] = {}
    for i, (name, theta, estimate) in enumerate(drawn):
        ax = plot.bearing(
            theta, estimate, period=period, block_size=block_size, legend=False, ax=axes[i]
        )
        ax.set_title(": ".join(filter(None, [name, ax.get_title()])), fontsize="medium")
        ax.set_ylabel("" if i % columns else column)
        if i + columns < len(drawn):
            ax.set_xlabel("")
        handles, labels = ax.get_legend_handles_labels()
        legend |= dict(zip(labels, handles, strict=True))
    for ax in axes[len(drawn) :]:
        ax.set_axis_off()
    figure.legend(legend.values(), legend.keys(), loc="outside lower center", ncols=len(legend))
    return figure


def _report(table: pl.DataFrame) -> None:
    """Say on stderr what is missing; fail if nothing could be estimated."""
    missing, present = (sum(table[name]) for name in ("missing", "count"))
    failed = table["note"].count()
    if missing:
        note(f"{missing} of {counted(missing + present, 'measurement')} missing")
    if failed:
        groups = counted(table.height, "group")
        note(f"{failed} of {groups} could not be estimated: see the column note")
    if failed == table.height:
        raise typer.Exit(FAILED)
