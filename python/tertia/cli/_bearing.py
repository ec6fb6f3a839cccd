"""`tertia bearing`: bearings with their sigmas."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import polars as pl
import typer

import tertia
from tertia import plot
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
    tracked,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

EXAMPLES = (
    "tertia bearing recording.csv",
    "tertia bearing recording.csv --column azimuth --by station --by target",
    "tertia bearing recording.csv --by target --output out.parquet --plot out.png",
    "tertia bearing ranges.csv --column range_m --period 0 --method corrected",
)
RESULTS = {
    "count": pl.Int64,
    "missing": pl.Int64,
    "value": pl.Float64,
    "sigma": pl.Float64,
    "anomalous": pl.Int64,
    "polarity": pl.Float64,
    "note": pl.String,
}
_MAX_PANELS = 16


@dataclass(frozen=True, slots=True)
class _Group:
    """The measurements of one group (nan: missing), and what came of them."""

    name: str
    theta: FloatArray
    estimate: BearingEstimate | None
    note: str | None

    def row(self) -> tuple[int | float | str | None, ...]:
        """Return the values of the result columns."""
        missing = int(np.isnan(self.theta).sum())
        counts = (self.theta.size - missing, missing)
        if self.estimate is None:
            return (*counts, None, None, None, None, self.note)
        value, sigma, polarity = map(
            float, (self.estimate.value, self.estimate.sigma, self.estimate.polarity)
        )
        return (*counts, value, sigma, int(self.estimate.outlier.sum()), polarity, self.note)


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
    group_size: Annotated[int, typer.Option(help="Measurements per group.")] = 10,
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
) -> None:
    """Estimate a bearing and its sigma per group, and count the anomalous measurements.

    The measurements of a group must be in the order in which they came. Missing ones (empty, NA,
    nan, null, None, -) are left out and counted.
    """
    wrap = period or None
    estimate = partial(
        tertia.estimate_bearing,
        period=wrap,
        method=method,
        group_size=group_size,
        k=k,
        nan_policy="omit",
    )
    _check_options(estimate)
    _tables.check_suffixes(output, plot_file)
    keys, samples = _read_samples(file, column, list(dict.fromkeys(by or [])))
    groups = _estimate_all(estimate, keys, samples, column)
    results = pl.DataFrame([group.row() for group in groups], RESULTS, orient="row")
    table = pl.DataFrame([*keys, *results])
    if output is None:
        _print(table, keys.columns)
    else:
        _tables.write(table, output)
    if plot_file is not None:
        _draw(groups, plot_file, column, wrap, group_size)
    _report(table)


def _check_options(estimate: Callable[..., BearingEstimate]) -> None:
    """Let the library judge the options before the work, on a sample that suits every method."""
    try:
        estimate([0.0] * 5)
    except ValueError as error:
        fail(str(error), WRONG_USAGE)


def _read_samples(path: Path, column: str, by: list[str]) -> tuple[pl.DataFrame, list[FloatArray]]:
    """Return the values of `by` and the measurements of each group, nan where missing."""
    for name in by:
        if name in {column, *RESULTS}:
            fail(f"cannot group by {name}: the results have a column of this name", WRONG_USAGE)
    frame = _tables.read(path, [column, *by])
    is_row = _tables.is_row(frame, path)
    frame = frame.select(*by, _tables.numbers(frame[column], path)).filter(is_row)
    if frame.is_empty():
        fail(f"{path} is empty")
    if by:
        frame = frame.group_by(by, maintain_order=True).agg(column)
    else:
        frame = frame.select(pl.col(column).implode())
    return frame.select(by), [sample.to_numpy() for sample in frame[column]]


def _estimate_all(
    estimate: Callable[[FloatArray], BearingEstimate],
    keys: pl.DataFrame,
    samples: list[FloatArray],
    column: str,
) -> list[_Group]:
    def group(name: str, theta: FloatArray) -> _Group:
        try:
            return _Group(name, theta, estimate(theta), None)
        except ValueError as error:
            return _Group(name, theta, None, str(error).replace("theta", column))

    names = [group_name(keys.columns, values) for values in keys.iter_rows()] or [""]
    pairs = list(zip(names, samples, strict=True))
    return [group(name, theta) for name, theta in tracked(pairs, "Estimating")]


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


def _draw(
    groups: list[_Group], path: Path, column: str, period: float | None, group_size: int
) -> None:
    """Draw one panel per group that could be estimated."""
    drawable = [(g.name, g.theta, g.estimate) for g in groups if g.estimate is not None]
    drawn = drawable[:_MAX_PANELS]
    if not drawn:
        return
    if len(drawable) > len(drawn):
        note(f"only the first {len(drawn)} of {len(drawable)} groups are drawn")
    _tables.save(_figure(drawn, column, period, group_size), path)


def _figure(
    drawn: list[tuple[str, FloatArray, BearingEstimate]],
    column: str,
    period: float | None,
    group_size: int,
) -> "Figure":
    from matplotlib.figure import Figure  # noqa: PLC0415  # slow to import

    columns = math.ceil(math.sqrt(len(drawn)))
    rows = math.ceil(len(drawn) / columns)
    figure = Figure(figsize=(max(8, 4.5 * columns), max(4.5, 3 * rows)), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    legend: dict[str, Artist] = {}
    for i, (name, theta, estimate) in enumerate(drawn):
        ax = plot.bearing(
            theta, estimate, period=period, group_size=group_size, legend=False, ax=axes[i]
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
