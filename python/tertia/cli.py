"""Command line: bearings of recordings in files. Needs the extra `cli`.

The numbers come from `tertia.estimate_bearing`; here they are read, laid out and written.
"""

import math
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import numpy as np

import tertia
from tertia import plot
from tertia._arrays import FloatArray
from tertia.bearing import BearingEstimate, Method

try:
    import polars as pl
    import typer
    from rich import box
    from rich.console import Console
    from rich.measure import Measurement
    from rich.progress import track
    from rich.table import Table
    from rich.text import Text
except ModuleNotFoundError:
    # here and not in `main`, because the commands are declared with these libraries
    sys.exit("the command tertia needs the extra cli: pip install 'tertia[cli]'")

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

__all__ = ["main"]

_MISSING = ("", "-", "na", "nan", "null", "none")
_RESULTS = {
    "count": pl.Int64,
    "missing": pl.Int64,
    "value": pl.Float64,
    "sigma": pl.Float64,
    "anomalous": pl.Int64,
    "polarity": pl.Float64,
    "note": pl.String,
}
_WRITERS: dict[str, Callable[[pl.DataFrame, Path], object]] = {
    ".csv": pl.DataFrame.write_csv,
    ".json": pl.DataFrame.write_json,
    ".parquet": pl.DataFrame.write_parquet,
}
_MAX_PANELS = 16
# a person reads no more, and rich takes a millisecond per row
_MAX_ROWS = 1000
_UNLIMITED = 10_000
_FAILED, _WRONG_USAGE = 1, 2

# typer takes a blank line for a line break
_EXAMPLES = "\n\n".join(
    [
        "Examples:",
        "tertia bearing recording.csv",
        "tertia bearing recording.csv --column azimuth --by station --by target",
        "tertia bearing recording.csv --by target --output out.parquet --plot out.png",
        "tertia bearing ranges.csv --column range_m --period 0 --method corrected",
    ]
)

app = typer.Typer(
    name="tertia",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)


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


def main() -> None:
    """Run the command `tertia`."""
    app(prog_name="tertia")


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"tertia {tertia.__version__}")
        raise typer.Exit


@app.callback(epilog=_EXAMPLES)
def _tertia(
    version: Annotated[
        bool,
        typer.Option("--version", help="Print the version.", callback=_show_version, is_eager=True),
    ] = False,
) -> None:
    """One estimate with an error bar from measurements that are sometimes wrong."""


@app.command(epilog=_EXAMPLES)
def bearing(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Recording: CSV with a header, or .parquet.")
    ],
    *,
    column: Annotated[str, typer.Option(help="Column of the measurements.")] = "bearing_deg",
    by: Annotated[
        list[str] | None,
        typer.Option(metavar="COLUMN", help="One estimate per value of this; may be repeated."),
    ] = None,
    method: Annotated[Method, typer.Option(help="How to estimate.")] = "robust",
    period: Annotated[
        float, typer.Option(help="Period of the measurements; 0: they do not wrap.")
    ] = 360.0,
    group_size: Annotated[int, typer.Option(help="Measurements per group.")] = 10,
    k: Annotated[
        float, typer.Option(help="Threshold of the methods corrected, paper and k-sigma.")
    ] = 2.5,
    output: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write .csv, .json or .parquet instead of a table."),
    ] = None,
    plot_file: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Draw the record (.png, .svg, .pdf, ...)."),
    ] = None,
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
    _check_suffixes(output, plot_file)
    keys, samples = _read_samples(file, column, list(dict.fromkeys(by or [])))
    groups = _estimate_all(estimate, keys, samples, column)
    results = pl.DataFrame([group.row() for group in groups], _RESULTS, orient="row")
    table = pl.DataFrame([*keys, *results])
    if output is None:
        _print_table(table, keys.columns)
    else:
        _write(table, output)
    if plot_file is not None:
        _draw(groups, plot_file, column, wrap, group_size)
    _report(table)


def _fail(message: str, code: int = _FAILED) -> NoReturn:
    typer.echo(f"tertia: {message}", err=True)
    raise typer.Exit(code)


def _check_options(estimate: Callable[..., BearingEstimate]) -> None:
    """Let the library judge the options before the work, on a sample that suits every method."""
    try:
        estimate([0.0] * 5)
    except ValueError as error:
        _fail(str(error), _WRONG_USAGE)


def _check_suffixes(output: Path | None, plot_file: Path | None) -> None:
    if output is not None:
        _check_suffix(output, _WRITERS)
    if plot_file is not None:
        if find_spec("matplotlib") is None:
            _fail("--plot needs the extra plot: pip install 'tertia[plot]'")
        from matplotlib.backend_bases import FigureCanvasBase  # noqa: PLC0415  # slow to import

        _check_suffix(plot_file, [f".{name}" for name in FigureCanvasBase.filetypes])


def _check_suffix(path: Path, known: Iterable[str]) -> None:
    if path.suffix.lower() not in known:
        _fail(f"cannot write {path}: its name must end in {', '.join(known)}", _WRONG_USAGE)


def _read_samples(path: Path, column: str, by: list[str]) -> tuple[pl.DataFrame, list[FloatArray]]:
    """Return the values of `by` and the measurements of each group, nan where missing."""
    for name in by:
        if name in {column, *_RESULTS}:
            _fail(f"cannot group by {name}: the results have a column of this name", _WRONG_USAGE)
    frame = _read(path)
    for name in (column, *by):
        if name not in frame.columns:
            _fail(f"{path} has no column {name}; it has {', '.join(frame.columns)}", _WRONG_USAGE)
    blank = frame.select(pl.all_horizontal(pl.all().is_null())).to_series()
    frame = frame.select(*by, _numbers(frame[column], path))
    if not _is_parquet(path):
        frame = frame.filter(~blank)  # a blank line is no row
    if frame.is_empty():
        _fail(f"{path} is empty")
    if by:
        frame = frame.group_by(by, maintain_order=True).agg(column)
    else:
        frame = frame.select(pl.col(column).implode())
    return frame.select(by), [sample.to_numpy() for sample in frame[column]]


def _read(path: Path) -> pl.DataFrame:
    """Return the table in a file, all columns of a CSV file as text: 007 remains 007."""
    try:
        if _is_parquet(path):
            return pl.read_parquet(path, glob=False)
        return pl.read_csv(path, infer_schema=False, glob=False)
    except FileNotFoundError:
        _fail(f"there is no file {path}", _WRONG_USAGE)
    except pl.exceptions.NoDataError:
        _fail(f"{path} is empty")
    except (OSError, pl.exceptions.PolarsError) as error:
        _fail(f"cannot read {path}: {str(error).splitlines()[0]}")


def _is_parquet(path: Path) -> bool:
    return path.suffix.lower() == ".parquet"


def _numbers(column: pl.Series, path: Path) -> pl.Series:
    """Return the measurements as numbers, nan where missing."""
    if column.dtype == pl.String:
        column = column.str.strip_chars()
        column = column.set(column.str.to_lowercase().is_in(_MISSING), None)
    elif not column.dtype.is_numeric():
        _fail(f"{path}: {column.name} holds {column.dtype}, not numbers")
    numbers: pl.Series = column.cast(pl.Float64, strict=False)
    if column.dtype.is_float():
        column = column.fill_nan(None)
    wrong = (column.is_not_null() & ~numbers.is_finite().fill_null(False)).arg_true()
    if len(wrong):
        row = wrong[0]
        place = f"row {row + 1}" if _is_parquet(path) else f"line {row + 2}"
        _fail(
            f"{path}, {place}: {column.name} is {column[row]!r}; it must be a finite number"
            + (f" ({len(wrong)} such lines)" if len(wrong) > 1 else "")
        )
    return numbers.fill_null(math.nan)


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

    names = [_name(keys.columns, values) for values in keys.iter_rows()] or [""]
    console = Console(stderr=True)
    progress = track(
        zip(names, samples, strict=True),
        "Estimating",
        total=len(samples),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
    return [group(name, theta) for name, theta in progress]


def _name(columns: list[str], values: tuple[object, ...]) -> str:
    return ", ".join(f"{column} {_text(v)}" for column, v in zip(columns, values, strict=True))


def _text(value: object) -> str:
    return "" if value is None else str(value)


def _print_table(table: pl.DataFrame, by: list[str]) -> None:
    if not table["note"].count():
        table = table.drop("note")
    out = Table(box=box.SIMPLE_HEAD)
    for name in table.columns:
        is_text = name in by or name == "note"
        out.add_column(Text(name), justify="left" if is_text else "right", no_wrap=not is_text)
    for row in table.head(_MAX_ROWS).iter_rows(named=True):
        out.add_row(*map(Text, _cells(row).values()))
    console = Console()
    width = Measurement.get(console, console.options.update(width=_UNLIMITED), out)
    # wrap on a terminal, never in a pipe, and truncate nowhere
    console.width = max(console.width, width.minimum) if console.is_terminal else width.maximum
    console.print(out)
    if table.height > _MAX_ROWS:
        shown = f"only the first {_MAX_ROWS} of {table.height} groups are shown"
        typer.echo(f"{shown}: --output writes all", err=True)


def _cells(row: dict[str, object]) -> dict[str, str]:
    cells = {name: _text(value) for name, value in row.items()}
    value, sigma, polarity = row["value"], row["sigma"], row["polarity"]
    if isinstance(value, float) and isinstance(sigma, float):
        cells["value"], cells["sigma"] = plot.rounded(value, sigma)
        cells["polarity"] = f"{polarity:+.3f}"
    return cells


def _write(table: pl.DataFrame, path: Path) -> None:
    try:
        _WRITERS[path.suffix.lower()](table, path)
    except (OSError, pl.exceptions.PolarsError) as error:
        _fail(f"cannot write {path}: {error}")
    typer.echo(f"wrote {_counted(table.height, 'row')} to {path}")


def _draw(
    groups: list[_Group], path: Path, column: str, period: float | None, group_size: int
) -> None:
    """Draw one panel per group that could be estimated."""
    drawable = [(g.name, g.theta, g.estimate) for g in groups if g.estimate is not None]
    drawn = drawable[:_MAX_PANELS]
    if not drawn:
        return
    if len(drawable) > len(drawn):
        typer.echo(f"only the first {len(drawn)} of {len(drawable)} groups are drawn", err=True)
    figure = _figure(drawn, column, period, group_size)
    try:
        figure.savefig(path, dpi=120)
    except OSError as error:
        _fail(f"cannot write {path}: {error}")


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
        typer.echo(f"{missing} of {_counted(missing + present, 'measurement')} missing", err=True)
    if failed:
        groups = _counted(table.height, "group")
        typer.echo(f"{failed} of {groups} could not be estimated: see the column note", err=True)
    if failed == table.height:
        raise typer.Exit(_FAILED)


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
