"""Options of several commands, and their parsing.

Files have `readable=False`: unreadable files are reported when they are read, in one line.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, TypeAlias, TypeVar

import typer

from tertia.cli.terminal.say import WRONG_USAGE, fail

Number = TypeVar("Number", int, float)
_TABLES = ".csv with a header, .parquet, .arrow, .jsonl"
_WRITTEN = ".csv, .parquet, .arrow, .jsonl or .json"

Recording: TypeAlias = Annotated[
    Path, typer.Argument(metavar="FILE", readable=False, help=f"Measurements: {_TABLES}.")
]
Recordings: TypeAlias = Annotated[
    list[Path],
    typer.Argument(metavar="FILES...", readable=False, help=f"Measurements: {_TABLES}; stacked."),
]
PlotFiles: TypeAlias = Annotated[
    list[Path] | None,
    typer.Argument(metavar="PLOTS...", readable=False, help=f"Plots: {_TABLES}; ASTERIX; stacked."),
]
SensorFile: TypeAlias = Annotated[
    Path,
    typer.Option(
        "--sensors", metavar="FILE", readable=False, help="Sensors: .toml, or a table as .csv."
    ),
]
PlanFile: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--plans",
        metavar="FILE",
        readable=False,
        help="Flight plans: .csv, .json, .geojson; messages of ICAO, .fpl, .txt.",
    ),
]
FixFile: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--fixes",
        metavar="FILE",
        readable=False,
        help="Aerodromes and fixes of messages: name, latitude_deg, longitude_deg; GeoJSON.",
    ),
]
AirwayFile: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--airways",
        metavar="FILE",
        readable=False,
        help="Airways of messages: airway, sequence, fix.",
    ),
]
TRUTH = "The truth: time_s, target, east_m, north_m; ASTERIX."
By: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(metavar="COLUMN", help="One estimate per value of this; may be repeated."),
]
ColumnNames: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--column",
        metavar="NAME=COLUMN",
        help="How a column is called in the files; may be repeated.",
    ),
]
Value: TypeAlias = Annotated[
    str, typer.Option("--value", metavar="COLUMN", help="Column of the measurements.")
]
Period: TypeAlias = Annotated[
    float, typer.Option(help="Period of the measurements; 0: they do not wrap.")
]
Origin: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="LAT,LON",
        help="Where east and north are zero, in degrees; by default as for the sensors.",
    ),
]
Flat: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--flat", help="Radars with latitudes are in a plane that touches the earth at the origin."
    ),
]
ClockPeriod: TypeAlias = Annotated[
    float | None, typer.Option(help="Seconds after which the times begin again, as 86400.")
]
UpdateInterval: TypeAlias = Annotated[
    float | None,
    typer.Option(help="Required seconds between updates; by default those of the fastest sensor."),
]
MaxDistance: TypeAlias = Annotated[
    float, typer.Option(help="A track farther from a target is not its track, in metres.")
]
Threads: TypeAlias = Annotated[
    int | None, typer.Option(min=1, help="Threads to use; by default all cores.")
]
Output: TypeAlias = Annotated[
    Path | None, typer.Option("--output", metavar="FILE", help=f"Write the result as {_WRITTEN}.")
]
MapOutput: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--output",
        metavar="FILE",
        help=f"Write the result as {_WRITTEN.replace(' or', ',')}, .geojson or .kml.",
    ),
]
MeasurementOutput: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Write one row per measurement: its residual, if an outlier."
    ),
]
PlotFile: TypeAlias = Annotated[
    Path | None,
    typer.Option("--plot", metavar="FILE", help="Draw the result (.png, .svg, .pdf, ...)."),
]


def pair(
    text: str | None, option: str, kind: Callable[[str], Number]
) -> tuple[Number, Number] | None:
    """Parse two numbers separated by a comma."""
    if text is None:
        return None
    try:
        first, second = map(kind, text.split(","))
    except ValueError:
        fail(f"{option} is {text!r}; it must be two numbers with a comma between them", WRONG_USAGE)
    return first, second


def column_names(options: Sequence[str] | None) -> dict[str, str]:
    """Return the columns given by options NAME=COLUMN, by name."""
    columns: dict[str, str] = {}
    for option in options or ():
        name, _, column = option.partition("=")
        if not name or not column:
            fail(f"--column is {option!r}; it must be NAME=COLUMN", WRONG_USAGE)
        if name in columns:
            fail(f"--column gives {name} twice", WRONG_USAGE)
        columns[name] = column
    return columns
