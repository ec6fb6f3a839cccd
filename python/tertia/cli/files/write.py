"""Writing of tables, texts and pictures to files, each completely or not at all."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, TypeVar

import polars as pl
import polars.selectors as cs
import typer

from tertia._result import counted
from tertia.cli.files.read import ARROW, JSON_LINES
from tertia.cli.terminal.say import WRONG_USAGE, fail, note

if TYPE_CHECKING:
    from matplotlib.figure import Figure, FigureBase

# system tracks
ASTERIX = (".ast", ".asterix")
_MAX_GROUPS_DRAWN = 4

T = TypeVar("T")


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


WRITERS: dict[str, Callable[[pl.DataFrame, BinaryIO], object]] = {
    ".csv": pl.DataFrame.write_csv,
    ".json": _write_json,
    ".parquet": pl.DataFrame.write_parquet,
    **dict.fromkeys(ARROW, pl.DataFrame.write_ipc),
    **dict.fromkeys(JSON_LINES, _write_lines),
}


def check_suffixes(
    output: Path | None,
    plot_file: Path | None = None,
    *others: Path | None,
    maps: Sequence[str] = (),
) -> None:
    """Exit with an error, before any processing, if one of the output files could not be written.

    The first file may also have one of the suffixes `maps`.
    """
    tables = [path for path in (output, *others) if path is not None]
    for at, path in enumerate(tables):
        check_suffix(path, [*WRITERS, *(maps if path is output else ())])
        if path in tables[:at]:
            fail(f"two results would be written to {path}", WRONG_USAGE)
    if plot_file is not None:
        if find_spec("matplotlib") is None:
            fail("--plot needs the extra plot: pip install 'tertia[plot]'")
        from matplotlib.backend_bases import FigureCanvasBase  # noqa: PLC0415  # slow to import

        check_suffix(plot_file, [f".{name}" for name in FigureCanvasBase.filetypes])


def check_suffix(path: Path, known: Iterable[str]) -> None:
    """Exit with an error if a result cannot be written because of its name or its folder."""
    if path.suffix.lower() not in known:
        fail(f"cannot write {path}: its name must end in {', '.join(known)}", WRONG_USAGE)
    try:
        target = path.resolve()
        if path.is_symlink() and target.is_symlink():
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
        wrong = errno.EISDIR if path.is_dir() else 0 if target.parent.is_dir() else errno.ENOENT
    except (OSError, RuntimeError) as error:
        # the name is too long, or the file is a link to itself (RuntimeError up to Python 3.12)
        wrong = getattr(error, "errno", errno.ELOOP)
    if wrong:
        fail(f"cannot write {path}: {os.strerror(wrong)}")


def write(table: pl.DataFrame, path: Path | None) -> None:
    """Write a table in the format of the file name, if there is one, and print a note."""
    if path is None:
        return
    with _whole(path) as file:
        WRITERS[path.suffix.lower()](table, file)
    typer.echo(f"wrote {counted(table.height, 'row')} to {path}")


def write_json(document: Mapping[str, object], path: Path) -> None:
    """Write a document as JSON."""
    write_text(json.dumps(document, indent=2, ensure_ascii=False) + "\n", path)


def write_text(text: str, path: Path) -> None:
    """Write a text."""
    with _whole(path) as file:
        file.write(text.encode())


def write_asterix(rows: pl.DataFrame, path: Path) -> None:
    """Write system tracks, and print a note."""
    from tertia.io._asterix_writer import asterix_tracks  # noqa: PLC0415  # rarely used

    try:
        contents = asterix_tracks(rows, (0, 0))
    except ValueError as error:
        fail(f"cannot write {path}: {error}")
    with _whole(path) as file:
        file.write(contents)
    typer.echo(f"wrote {counted(rows.height, 'row')} to {path}")


def make_folder(path: Path) -> None:
    """Create a folder if it does not exist; exit with an error if that fails."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        fail(f"cannot make {path}: {error.strerror or error}")


def save(path: Path | None, size: tuple[float, float], draw: Callable[[Figure], object]) -> None:
    """Write a picture of this size in inches, if a file is given; `draw` fills its figure."""
    if path is None:
        return
    from matplotlib.figure import Figure  # noqa: PLC0415  # slow to import

    figure = Figure(figsize=size, layout="constrained")
    draw(figure)
    with _whole(path) as file:
        figure.savefig(file, dpi=120, format=path.suffix[1:].lower())


def save_groups(
    groups: Sequence[T],
    path: Path | None,
    draw: Callable[[T, FigureBase], None],
    size: tuple[float, float],
    *,
    across: bool = False,
) -> None:
    """Write a picture of the first groups, stacked or side by side (`across`); see `save`."""
    if path is None:
        return
    drawn = groups[:_MAX_GROUPS_DRAWN]
    count = len(drawn)
    if len(groups) > count:
        note(f"only the first {count} of {len(groups)} groups are drawn")
    rows, columns = (1, count) if across else (count, 1)

    def draw_all(figure: Figure) -> None:
        parts = [figure] if count == 1 else figure.subfigures(rows, columns, squeeze=False).flat
        for group, part in zip(drawn, parts, strict=True):
            draw(group, part)

    save(path, (size[0] * columns, size[1] * rows), draw_all)


@contextmanager
def _whole(path: Path) -> Iterator[BinaryIO]:
    """Open a temporary file that replaces the given one when it is complete."""
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
