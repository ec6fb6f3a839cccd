"""Tables and pictures in files: reading with clear errors, and writing."""

import json
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import polars as pl
import polars.selectors as cs
import typer

from tertia.cli._terminal import WRONG_USAGE, counted, fail
from tertia.tables import _columns

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _write_json(table: pl.DataFrame, file: BinaryIO) -> None:
    # with a T between date and time, as in CSV
    told = table.with_columns(cs.datetime().dt.to_string("iso:strict"))
    file.write(told.write_json().encode())


_MISSING = ("", "-", "na", "nan", "null", "none")
_WRITERS: dict[str, Callable[[pl.DataFrame, BinaryIO], object]] = {
    ".csv": pl.DataFrame.write_csv,
    ".json": _write_json,
    ".parquet": pl.DataFrame.write_parquet,
}
# %.f is a fraction of a second or nothing, %#z an offset or Z
_LOCAL_TIMES = ("%Y-%m-%dT%H:%M:%S%.f", "%Y-%m-%dT%H:%M", "%Y-%m-%d")
_ZONED_TIMES = ("%Y-%m-%dT%H:%M:%S%.f%#z", "%Y-%m-%dT%H:%M%#z")
PER_SECOND = _columns.PER_SECOND
beside, known, seconds = _columns.beside, _columns.known, _columns.seconds
_OFFSET = r"T.*(Z|[+-]\d\d(:?\d\d)?)$"


def check_suffixes(output: Path | None, plot_file: Path | None, *others: Path | None) -> None:
    """Fail before the work if a result, of which each is a file, could not be written after it."""
    tables = [path for path in (output, *others) if path is not None]
    for at, path in enumerate(tables):
        _check_suffix(path, _WRITERS)
        if path in tables[:at]:
            fail(f"two results would be written to {path}", WRONG_USAGE)
    if plot_file is not None:
        if find_spec("matplotlib") is None:
            fail("--plot needs the extra plot: pip install 'tertia[plot]'")
        from matplotlib.backend_bases import FigureCanvasBase  # noqa: PLC0415  # slow to import

        _check_suffix(plot_file, [f".{name}" for name in FigureCanvasBase.filetypes])


def _check_suffix(path: Path, known: Iterable[str]) -> None:
    if path.suffix.lower() not in known:
        fail(f"cannot write {path}: its name must end in {', '.join(known)}", WRONG_USAGE)


def read(path: Path, columns: Iterable[str]) -> pl.DataFrame:
    """Return the table in a file, which has `columns`; those of CSV are text: 007 remains 007."""
    frame = _read(path)
    for name in columns:
        if name not in frame.columns:
            fail(f"{path} has no column {name}; it has {', '.join(frame.columns)}", WRONG_USAGE)
    return frame


def _read(path: Path) -> pl.DataFrame:
    try:
        if _is_parquet(path):
            return pl.read_parquet(path, glob=False)
        return pl.read_csv(path, infer_schema=False, glob=False)
    except FileNotFoundError:
        fail(f"there is no file {path}", WRONG_USAGE)
    except pl.exceptions.NoDataError:
        fail(f"{path} is empty")
    except (OSError, pl.exceptions.PolarsError) as error:
        fail(f"cannot read {path}: {str(error).splitlines()[0]}")


def _is_parquet(path: Path) -> bool:
    return path.suffix.lower() == ".parquet"


def is_row(frame: pl.DataFrame, path: Path) -> pl.Series:
    """Return which rows are there: a blank line of a CSV file is none."""
    if _is_parquet(path):
        return pl.repeat(True, frame.height, eager=True)
    return frame.select(~pl.all_horizontal(pl.all().is_null())).to_series()


def place(path: Path, row: int) -> str:
    """Return where a row of a file is, as people count."""
    return f"{path}, row {row + 1}" if _is_parquet(path) else f"{path}, line {row + 2}"


def numbers(column: pl.Series, path: Path) -> pl.Series:
    """Return the measurements as numbers, nan where missing."""
    if column.dtype == pl.String:
        column = without_marks(column)
    elif not column.dtype.is_numeric():
        fail(f"{path}: {column.name} holds {column.dtype}, not numbers")
    found: pl.Series = column.cast(pl.Float64, strict=False)
    if column.dtype.is_float():
        column = column.fill_nan(None)
    _require(column, found.is_finite(), path, "a finite number")
    return found.fill_null(math.nan)


def times(column: pl.Series, path: Path) -> pl.Series:
    """Return times as numbers or as dates, null where missing."""
    if column.dtype.is_numeric():
        # an integer remains one
        column = column.fill_nan(None) if column.dtype.is_float() else column
        _require(column, column.is_finite(), path, "a finite number")
        return column
    if isinstance(column.dtype, (pl.Date, pl.Datetime)):
        moments = column.cast(pl.Datetime("us")) if column.dtype == pl.Date else column
        return moments if _zone(moments) is None else moments.dt.convert_time_zone("UTC")
    if column.dtype != pl.String:
        fail(f"{path}: {column.name} holds {column.dtype}, neither numbers nor dates")
    column = without_marks(column)
    found: pl.Series = column.cast(pl.Float64, strict=False)
    first = column.drop_nulls().head(1)
    if first.cast(pl.Float64, strict=False).null_count():
        found = _moments(column, first.item())
        known = found.is_not_null()
    else:
        known = found.is_finite()
    _require(column, known, path, "a number of seconds or a date with time, as the others are")
    return found


def _moments(column: pl.Series, first: str) -> pl.Series:
    """Return dates with times of ISO 8601, of the kind that the first one is; null elsewhere."""
    column = column.str.replace(" ", "T", literal=True)
    zoned = pl.Series([first.replace(" ", "T")]).str.contains(_OFFSET)[0]
    column = column.set(column.str.contains(_OFFSET) != zoned, None)
    tried = [
        column.str.to_datetime(form, time_unit="us", strict=False)
        for form in (_ZONED_TIMES if zoned else _LOCAL_TIMES)
    ]
    return pl.select(pl.coalesce(tried)).to_series().rename(column.name)


def _zone(column: pl.Series) -> str | None:
    return column.dtype.time_zone if isinstance(column.dtype, pl.Datetime) else None


def without_marks(column: pl.Series) -> pl.Series:
    """Return text without spaces around it, null where it says that there is nothing."""
    column = column.str.strip_chars()
    return column.set(column.str.to_lowercase().is_in(_MISSING), None)


def is_mark(text: str) -> bool:
    """Return whether a text says that there is nothing."""
    return text.strip().lower() in _MISSING


def _require(column: pl.Series, holds: pl.Series, path: Path, requirement: str) -> None:
    wrong = (column.is_not_null() & ~holds.fill_null(False)).arg_true()
    if len(wrong):
        row = wrong[0]
        fail(
            f"{place(path, row)}: {column.name} is {column[row]!r}; it must be {requirement}"
            + (f" ({len(wrong)} such lines)" if len(wrong) > 1 else "")
        )


def write(table: pl.DataFrame, path: Path) -> None:
    """Write a table in the format that the name of the file tells, and say so."""
    with _whole(path) as file:
        _WRITERS[path.suffix.lower()](table, file)
    typer.echo(f"wrote {counted(table.height, 'row')} to {path}")


def write_json(document: Mapping[str, object], path: Path) -> None:
    """Write a document as JSON."""
    with _whole(path) as file:
        file.write((json.dumps(document, indent=2, ensure_ascii=False) + "\n").encode())


def write_text(text: str, path: Path) -> None:
    """Write a text."""
    with _whole(path) as file:
        file.write(text.encode())


def make_folder(path: Path) -> None:
    """Make a folder if it is not there, or fail."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        fail(f"cannot make {path}: {error.strerror or error}")


def save(figure: "Figure", path: Path) -> None:
    """Write a picture."""
    with _whole(path) as file:
        figure.savefig(file, dpi=120, format=path.suffix[1:].lower())


@contextmanager
def _whole(path: Path) -> Iterator[BinaryIO]:
    """Open a file beside this one, which takes its place when it is complete, or fail."""
    target = path.resolve()
    part = target.with_name(f".{target.name}.{os.getpid()}")
    try:
        with part.open("wb") as file:
            yield file
        part.replace(target)
    except OSError as error:
        fail(f"cannot write {path}: {error.strerror or error}")
    except pl.exceptions.PolarsError as error:
        fail(f"cannot write {path}: {error}")
    finally:
        part.unlink(missing_ok=True)


def stacked(
    files: Sequence[Path], frames: list[pl.DataFrame], time: str, by: Sequence[str]
) -> pl.DataFrame:
    """Return the rows of all files, whose column `time` holds the times named so in the files.

    The columns `by` become text where not all files agree on what they are.
    """
    for path, frame in zip(files[1:], frames[1:], strict=True):
        kind, first = _kind(frame["time"]), _kind(frames[0]["time"])
        if kind != first:
            fail(f"{time} of {files[0]} holds {first}, that of {path} {kind}")
    for name in by:
        if len({frame[name].dtype for frame in frames}) > 1:
            frames = [frame.with_columns(pl.col(name).cast(pl.String)) for frame in frames]
    rows = pl.concat(frames, how="vertical_relaxed")
    if rows.is_empty():
        fail(f"{' and '.join(map(str, files))} {'is' if len(files) == 1 else 'are'} empty")
    return rows


def _kind(time: pl.Series) -> str:
    if not isinstance(time.dtype, pl.Datetime):
        return "numbers"
    return "dates" if time.dtype.time_zone is None else "dates with a time zone"
