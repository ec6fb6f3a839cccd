"""Options that several commands have.

Files have `readable=False`: what cannot be read is told where it is read, in one line.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, TypeAlias, TypeVar

import typer

from tertia.cli._terminal import WRONG_USAGE, fail

Number = TypeVar("Number", int, float)

By: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(metavar="COLUMN", help="One estimate per value of this; may be repeated."),
]
Period: TypeAlias = Annotated[
    float, typer.Option(help="Period of the measurements; 0: they do not wrap.")
]
PlotFile: TypeAlias = Annotated[
    Path | None,
    typer.Option("--plot", metavar="FILE", help="Draw the record (.png, .svg, .pdf, ...)."),
]

Measured: TypeAlias = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILES...",
        readable=False,
        help="Measurements: .csv with a header, .parquet, .arrow, .jsonl; stacked.",
    ),
]
StationFile: TypeAlias = Annotated[
    Path,
    typer.Option(
        "--stations", metavar="FILE", readable=False, help="Stations: .toml, or a table as .csv."
    ),
]
TimeColumn: TypeAlias = Annotated[
    str, typer.Option(help="Column of the time: seconds, or dates with time.")
]
StationColumn: TypeAlias = Annotated[str, typer.Option(help="Column of the station's name.")]
PositionFile: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Write positions as .csv, .parquet, .arrow, .jsonl, .json, .geojson or .kml.",
    ),
]
MeasurementFile: TypeAlias = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Write one row per measurement: its residual, if a fault."),
]


def pair(text: str, option: str, kind: Callable[[str], Number]) -> tuple[Number, Number]:
    """Return two numbers with a comma between them."""
    try:
        first, second = map(kind, text.split(","))
    except ValueError:
        fail(f"{option} is {text!r}; it must be two numbers with a comma between them", WRONG_USAGE)
    return first, second
