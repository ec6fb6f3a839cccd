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

PlotFiles: TypeAlias = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="PLOTS...",
        readable=False,
        help="Plots: .csv with a header, .parquet, .arrow, .jsonl; ASTERIX; stacked.",
    ),
]
RadarFile: TypeAlias = Annotated[
    Path,
    typer.Option(
        "--radars", metavar="FILE", readable=False, help="Radars: .toml, or a table as .csv."
    ),
]
PlanFile: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--plans", metavar="FILE", readable=False, help="Flight plans: .csv, .json, .geojson."
    ),
]
Origin: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="LATITUDE,LONGITUDE",
        help="Where east and north are zero, in degrees, for plans with geodetic positions; "
        "by default as for the radars.",
    ),
]
ColumnNames: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--column",
        metavar="NAME=COLUMN",
        help="How a column is called in the files; may be repeated.",
    ),
]
ClockPeriod: TypeAlias = Annotated[
    float | None,
    typer.Option(help="Seconds after which the times begin again, as 86400."),
]
RequiredPeriod: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--period",
        help="Seconds between updates that are required; by default those of the fastest radar.",
    ),
]
TargetDistance: TypeAlias = Annotated[
    float, typer.Option(help="A track farther from a target does not show it, in metres.")
]


def pair(text: str, option: str, kind: Callable[[str], Number]) -> tuple[Number, Number]:
    """Return two numbers with a comma between them."""
    try:
        first, second = map(kind, text.split(","))
    except ValueError:
        fail(f"{option} is {text!r}; it must be two numbers with a comma between them", WRONG_USAGE)
    return first, second


def check_judging(distance: float, period: float | None) -> None:
    """Refuse distances and periods that are none."""
    for name, value in (("distance", distance), ("period", period)):
        if value is not None and not 0 < value < float("inf"):
            fail(f"--{name} is {value:g}; it must be a positive number", WRONG_USAGE)
