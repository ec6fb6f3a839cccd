"""Output on the terminal: errors, progress, tables."""

import math
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn, TypeVar

import polars as pl
import typer
from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.progress import Progress
from rich.table import Table
from rich.text import Text

FAILED, WRONG_USAGE, INTERRUPTED = 1, 2, 130
# users do not read more rows, and rich needs a millisecond per row
MAX_ROWS = 1000
_UNLIMITED = 10_000

T = TypeVar("T")


def fail(message: str, code: int = FAILED) -> NoReturn:
    """Print an error to stderr, and exit with a code."""
    note(f"tertia: {message}")
    raise typer.Exit(code)


def note(message: str) -> None:
    """Print a note to stderr."""
    typer.echo(message, err=True)


def line(text: str | None) -> None:
    """Print a line, if there is one."""
    if text is not None:
        typer.echo(text)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Exit with a message if a file cannot be read."""
    try:
        yield
    except FileNotFoundError:
        fail(f"there is no file {path}", WRONG_USAGE)
    except OSError as error:
        fail(f"cannot read {path}: {error.strerror or error}")


def as_text(value: object) -> str:
    """Return a cell as text."""
    return "" if value is None else str(value)


def shown(row: dict[str, object]) -> dict[str, str]:
    """Return a row as text, numbers to three digits."""
    return {
        name: as_text(value) if not isinstance(value, float) else _number(value)
        for name, value in row.items()
    }


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.3g}"


@contextmanager
def working(what: str) -> Iterator[Callable[[Collection[T]], Iterable[T]]]:
    """Show that processing is under way, if the output is a terminal.

    Yields a function that iterates over items; the bar then shows how many of them are done.
    """
    console = Console(stderr=True)
    with Progress(
        *Progress.get_default_columns(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bar:
        task = bar.add_task(what, total=None)

        def over(items: Collection[T]) -> Iterable[T]:
            # a share of one item says nothing
            return bar.track(items, len(items), task_id=task) if len(items) > 1 else items

        yield over


def print_table(
    table: pl.DataFrame,
    cells: Callable[[dict[str, object]], dict[str, str]] = shown,
    *,
    text: Collection[str],
    limited: str = "rows are shown",
) -> None:
    """Print a table; `cells` converts its rows to text.

    The columns `text` are left-justified; `limited` completes the sentence about rows that are not
    shown.
    """
    out = Table(box=box.SIMPLE_HEAD)
    for name in table.columns:
        is_text = name in text
        out.add_column(Text(name), justify="left" if is_text else "right", no_wrap=not is_text)
    console = Console()
    rows = [[*cells(row).values()] for row in table.head(MAX_ROWS).iter_rows(named=True)]
    if not console.is_terminal and not any("\n" in cell for row in rows for cell in row):
        # where no line is wrapped: one cell of many lines is printed much faster than many cells
        rows = [["\n".join(column) for column in zip(*rows, strict=True)]] if rows else []
    for row in rows:
        out.add_row(*map(Text, row))
    width = Measurement.get(console, console.options.update(width=_UNLIMITED), out)
    # wrap lines on a terminal but not in a pipe, and never truncate them
    console.width = max(console.width, width.minimum) if console.is_terminal else width.maximum
    console.print(out)
    if table.height > MAX_ROWS:
        note(f"only the first {MAX_ROWS} of {table.height} {limited}")
