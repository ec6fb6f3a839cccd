"""Tables and pictures in files: reading with clear errors, and writing."""

import errno
import json
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NoReturn

import polars as pl
import polars.selectors as cs
import typer

from tertia.cli._terminal import WRONG_USAGE, counted, fail
from tertia.tables import _columns

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _with_iso_dates(table: pl.DataFrame) -> pl.DataFrame:
    """Return dates as text with a T between date and time, as in CSV."""
    return table.with_columns(cs.datetime().dt.to_string("iso:strict"))


def _write_json(table: pl.DataFrame, file: BinaryIO) -> None:
    file.write(_with_iso_dates(table).write_json().encode())


def as_lines(table: pl.DataFrame) -> bytes:
    """Return one JSON object per row and line."""
    return _with_iso_dates(table).write_ndjson().encode()


def _write_lines(table: pl.DataFrame, file: BinaryIO) -> None:
    file.write(as_lines(table))


_MISSING = ("", "-", "na", "nan", "null", "none")
_JSON_LINES = (".jsonl", ".ndjson")
_ARROW = (".arrow", ".feather")
_WRITERS: dict[str, Callable[[pl.DataFrame, BinaryIO], object]] = {
    ".csv": pl.DataFrame.write_csv,
    ".json": _write_json,
    ".parquet": pl.DataFrame.write_parquet,
    **dict.fromkeys(_ARROW, pl.DataFrame.write_ipc),
    **dict.fromkeys(_JSON_LINES, _write_lines),
}
# recordings of radars, not tables
ASTERIX = (".ast", ".asterix", ".raw", ".pcap", ".pcapng")
# what Polars unpacks while it reads
_PACKED = (".gz", ".zst")
# what holds types, so that no row is blank
_BINARY = {".parquet": "Parquet", **dict.fromkeys(_ARROW, "Arrow IPC")}
# %.f is a fraction of a second or nothing, %#z an offset or Z
_LOCAL_TIMES = ("%Y-%m-%dT%H:%M:%S%.f", "%Y-%m-%dT%H:%M", "%Y-%m-%d")
_ZONED_TIMES = ("%Y-%m-%dT%H:%M:%S%.f%#z", "%Y-%m-%dT%H:%M%#z")
PER_SECOND = _columns.PER_SECOND
beside, known, seconds = _columns.beside, _columns.known, _columns.seconds
_OFFSET = r"T.*(Z|[+-]\d\d(:?\d\d)?)$"


def check_suffixes(
    output: Path | None,
    plot_file: Path | None,
    *others: Path | None,
    maps: Sequence[str] = (),
) -> None:
    """Fail before the work if a result, of which each is a file, could not be written after it.

    The first may be one of the `maps`, too.
    """
    tables = [path for path in (output, *others) if path is not None]
    for at, path in enumerate(tables):
        _check_suffix(path, [*_WRITERS, *(maps if path is output else ())])
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
    wrong = errno.EISDIR if path.is_dir() else 0 if path.parent.is_dir() else errno.ENOENT
    if wrong:
        fail(f"cannot write {path}: {os.strerror(wrong)}")


def kind_of(path: Path) -> str:
    """Return how the name of a file ends, in small letters, without what tells its packing."""
    suffix = path.suffix.lower()
    return path.with_suffix("").suffix.lower() if suffix in _PACKED else suffix


def has_lines(path: Path) -> bool:
    """Return whether a file has lines of CSV or JSON, not packed, as far as its name tells."""
    packed = path.suffix.lower() in _PACKED
    return not packed and kind_of(path) not in {*_BINARY, *ASTERIX, ".json"}


def read(path: Path, columns: Iterable[str]) -> pl.DataFrame:
    """Return the table in a file, which has `columns`; those of CSV are text: 007 remains 007."""
    frame = read_any(path)
    require_columns(frame, path, columns)
    return frame


def require_columns(frame: pl.DataFrame, path: Path, columns: Iterable[str]) -> None:
    """Fail if a table of a file has not all of the columns."""
    for name in columns:
        if name not in frame.columns:
            fail(f"{path} has no column {name}; {told_columns(frame)}", WRONG_USAGE)


def told_columns(frame: pl.DataFrame) -> str:
    """Return which columns there are, in words."""
    told = f"it has {', '.join(frame.columns)}"
    for separator, name in ((";", "semicolons"), ("\t", "tabs")):
        if frame.width == 1 and separator in frame.columns[0]:
            told += f": put commas between columns, not {name}"
    return told


def read_any(path: Path) -> pl.DataFrame:
    """Return the table in a file, whatever its columns."""
    kind = kind_of(path)
    if path.is_dir():
        fail(f"cannot read {path}: it is a folder")
    if kind in ASTERIX:
        told = "ASTERIX is for tertia track and report, and for the truth of evaluate"
        fail(f"cannot read {path}: {told}")
    if kind == ".json":
        fail(f"cannot read {path}: tables are read from CSV, Parquet, Arrow or JSON lines")
    try:
        if kind in _JSON_LINES:
            with path.open("rb") as file:
                return pl.read_ndjson(file, infer_schema_length=None)
        if kind in _ARROW:
            with path.open("rb") as file:
                return pl.read_ipc(file)
        if kind in _BINARY:
            return pl.read_parquet(path, glob=False)
        return pl.read_csv(path, infer_schema=False, glob=False)
    except FileNotFoundError:
        fail(f"there is no file {path}", WRONG_USAGE)
    except OSError as error:
        if path.exists() and path.stat().st_size == 0:
            fail(f"{path} is empty")
        fail(f"cannot read {path}: {error.strerror or str(error).splitlines()[0]}")
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
        _say_why(path, str(error).partition("\n")[0])


def _say_why(path: Path, error: str) -> NoReturn:
    """Fail, and tell what is wrong with a file that Polars does not understand."""
    if path.stat().st_size == 0:
        fail(f"{path} is empty")
    kind = kind_of(path)
    if kind in _BINARY:
        fail(f"cannot read {path}: it is no {_BINARY[kind]} file, or cut off: {error}")
    if kind in _JSON_LINES and path.suffix.lower() not in _PACKED:
        for number, line in enumerate(path.read_bytes().splitlines(), start=1):
            if line.strip() and not _is_object(line):
                fail(f"{path}, line {number}: each line must be a JSON object with the columns")
    fail(f"cannot read {path}: {error}")


def _is_object(line: bytes) -> bool:
    try:
        return isinstance(json.loads(line), dict)
    except ValueError:
        return False


def is_row(frame: pl.DataFrame, path: Path) -> pl.Series:
    """Return which rows are there: a blank line of a CSV file is none."""
    if kind_of(path) in {*_BINARY, *_JSON_LINES, *ASTERIX}:
        return pl.repeat(True, frame.height, eager=True)
    return frame.select(~pl.all_horizontal(pl.all().is_null())).to_series()


def place(path: Path, row: int) -> str:
    """Return where a row of a file is, as people count."""
    kind = kind_of(path)
    if kind in _BINARY or kind in ASTERIX:
        return f"{path}, row {row + 1}"
    return f"{path}, line {row + 1 if kind in _JSON_LINES else row + 2}"


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
