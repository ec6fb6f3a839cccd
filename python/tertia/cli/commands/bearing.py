"""`tertia bearing`: bearings with their sigmas."""

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import polars as pl
import typer

from tertia import plot, tables
from tertia._arrays import FloatArray
from tertia._result import counted
from tertia.bearing import BearingEstimate, Method
from tertia.cli.files import read, write
from tertia.cli.terminal import options as opt
from tertia.cli.terminal.options import option
from tertia.cli.terminal.say import FAILED, as_text, note, print_table, working
from tertia.tables import RecordWarning
from tertia.tables._bearing import bearings_of
from tertia.tables._groups import column_name, usual_period
from tertia.tables._parts import Part
from tertia.tables._records import Reader

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

EXAMPLES = (
    "tertia bearing recording.csv",
    "tertia bearing recording.csv --column azimuth_deg=az --by sensor --by target",
    "tertia bearing recording.csv --by sensor --groups stop",
    "tertia bearing recording.csv --by target --output out.parquet --plot out.png",
    "tertia bearing ranges.csv --value range_m --method corrected",
)
_MAX_PANELS = 16


def bearing(
    file: opt.Recording,
    *,
    value: opt.Value = "azimuth_deg",
    column: opt.ColumnNames = None,
    by: opt.By = None,
    groups: Annotated[
        str | None,
        option(
            "Column of labels; rows with the same label share a systematic error.", metavar="COLUMN"
        ),
    ] = None,
    bias_sigma: Annotated[
        float | None, option("Sigma of the systematic error; by default estimated from --groups.")
    ] = None,
    sigma: Annotated[
        float | None, option("Stated sigma of the measurements; by default from azimuth_sigma_deg.")
    ] = None,
    method: Annotated[Method, option("Method of estimation.")] = "robust",
    period: Annotated[
        float | None,
        option(
            "Period of the measurements; 0: none. By default 360 for degrees, 2 pi for "
            "columns that end in _rad, none for other units."
        ),
    ] = None,
    block_size: Annotated[int, option("Number of measurements per block.")] = 10,
    k: Annotated[float, option("Threshold of the methods corrected, paper and k-sigma.")] = 2.5,
    n_threads: opt.Threads = None,
    output: opt.Output = None,
    plot_file: opt.PlotFile = None,
) -> dict[str, Any]:
    """Estimate a bearing and its sigma per group, and count the outliers.

    The measurements of a group must be in time order. Missing ones (empty, NA, nan, null, None,
    -) are left out and counted.
    """
    write.check_suffixes(output, plot_file)
    wrap = usual_period(value) if period is None else period or None
    options: dict[str, Any] = {
        "columns": opt.column_names(column),
        "values": value,
        "by": by or [],
        "groups": groups,
        "bias_sigma": bias_sigma,
        "sigma": sigma,
        "method": method,
        "block_size": block_size,
        "k": k,
        "n_threads": n_threads,
    }
    if period is not None:
        options["period"] = wrap
    with working("Estimating"):
        # a picture needs all measurements in memory
        rows = None if plot_file else _in_batches(file, **options)
        if rows is None:
            found = bearings_of(read.tables(file), **options)
            rows = found.rows
    failed = rows["note"].count()
    if output is None:
        shown = rows if failed else rows.drop("note")
        limited = "groups are shown: --output writes all"
        print_table(shown, _cells(value), text=[*(by or []), "note"], limited=limited)
        if failed < rows.height and bias_sigma is None and groups is None:
            typer.echo("  systematic errors are not included: see --groups and --bias-sigma")
    else:
        write.write(rows, output)
    if plot_file is not None and failed < rows.height:
        if rows.height - failed > _MAX_PANELS:
            note(f"only the first {_MAX_PANELS} of {rows.height - failed} groups are drawn")
        drawn = list(found.estimates(_MAX_PANELS))
        down, across = _panels(len(drawn))
        size = max(8, 4.5 * across), max(4.5, 3 * down)
        write.save(plot_file, size, partial(_draw, drawn, value, wrap, block_size))
    missing, present = (sum(rows[name]) for name in ("missing", "count"))
    if missing:
        note(f"{missing} of {counted(missing + present, 'measurement')} missing")
    if failed:
        all_groups = counted(rows.height, "group")
        note(f"{failed} of {all_groups} could not be estimated: see the column note")
    if failed == rows.height:
        raise typer.Exit(FAILED)
    return {"groups": rows}


def _in_batches(
    file: Path,
    *,
    columns: Mapping[str, str],
    values: str,
    by: Sequence[str],
    groups: str | None,
    **options: Any,
) -> pl.DataFrame | None:
    """Return one row per group of a recording without holding all of it in memory.

    Return None if the groups are not consecutive, or if there is an error; the error is reported
    when the file is then read as a whole.
    """
    needed = [columns.get(name, name) for name in (*by, *([groups] if groups else []), values)]
    stated = column_name(values, "sigma")
    sigma = columns.get(stated, stated)
    options |= {"columns": columns, "values": values, "groups": groups}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RecordWarning)
            batches = map(_with_numbers(needed[-1], sigma), read.batches(file, needed, [sigma]))
            found = list(tables.stream(tables.bearing, batches, by=by, **options))
            return pl.concat(found) if found else None
    except (OSError, ValueError, RecordWarning, pl.exceptions.PolarsError):
        return None


def _with_numbers(*columns: str) -> Callable[[pl.DataFrame], pl.DataFrame]:
    """Return a function that converts columns of text to numbers, which need less memory."""

    def read_numbers(batch: pl.DataFrame) -> pl.DataFrame:
        reader = Reader(Part(batch), {}, {})
        there = [name for name in columns if name in batch.columns]
        return batch.with_columns(reader.numbers(batch[name]) for name in there)

    return read_numbers


def _cells(value: str) -> Any:
    """Return a function that formats a row, with as many digits as are significant."""
    sigma, bias_sigma = (column_name(value, what) for what in ("sigma", "bias_sigma"))

    def cells(row: dict[str, object]) -> dict[str, str]:
        found = {name: as_text(cell) for name, cell in row.items()}
        estimate, error = row[value], row[sigma]
        if isinstance(estimate, float) and isinstance(error, float):
            found[value], found[sigma] = plot.rounded(estimate, error)
            found["polarity"] = f"{row['polarity']:+.3f}"
            bias = row.get(bias_sigma)
            if isinstance(bias, float):
                found[bias_sigma] = plot.rounded(bias, bias / 10)[0] if bias > 0 else "0"
        return found

    return cells


def _panels(count: int) -> tuple[int, int]:
    """Return rows and columns of panels."""
    columns = math.ceil(math.sqrt(count))
    return math.ceil(count / columns), columns


def _draw(
    drawn: list[tuple[str, FloatArray, BearingEstimate]],
    column: str,
    period: float | None,
    block_size: int,
    figure: "Figure",
) -> None:
    rows, columns = _panels(len(drawn))
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
