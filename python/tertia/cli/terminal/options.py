"""Options of several commands, and their parsing."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

import typer

from tertia.cli.terminal.say import WRONG_USAGE, fail
from tertia.tracker import MotionName, ProfileName

Number = TypeVar("Number", int, float)
_TABLES = ".csv with a header, .parquet, .arrow, .jsonl"
_WRITTEN = ".csv, .parquet, .arrow, .jsonl or .json"


def input_files(metavar: str, text: str) -> Any:
    """Return an argument for input files; those that cannot be read are reported in one line."""
    return typer.Argument(metavar=metavar, readable=False, help=text)


def input_file(text: str, *names: str, **more: Any) -> Any:
    """Return an option for an input file; one that cannot be read is reported in one line."""
    return typer.Option(*names, metavar="FILE", readable=False, help=text, **more)


def output_file(text: str, *names: str) -> Any:
    """Return an option for an output file."""
    return typer.Option(*names, metavar="FILE", help=text)


Recording: TypeAlias = Annotated[Path, input_files("FILE", f"Measurements: {_TABLES}.")]
Recordings: TypeAlias = Annotated[
    list[Path], input_files("FILES...", f"Measurements: {_TABLES}; files are concatenated.")
]
PlotFiles: TypeAlias = Annotated[
    list[Path] | None, input_files("PLOTS...", f"Plots: {_TABLES}, or ASTERIX.")
]
SensorFile: TypeAlias = Annotated[
    Path, input_file("Sensors: .toml, or a table such as .csv.", "--sensors")
]
PlanFile: TypeAlias = Annotated[
    Path | None,
    input_file("Flight plans: .csv, .json, .geojson; ICAO messages: .fpl, .txt.", "--plans"),
]
FixFile: TypeAlias = Annotated[
    Path | None,
    input_file(
        "Aerodromes and fixes that flight plan messages name: a table of name, latitude_deg, "
        "longitude_deg; or GeoJSON.",
        "--fixes",
    ),
]
AirwayFile: TypeAlias = Annotated[
    Path | None,
    input_file(
        "Airways that flight plan messages name: a table of airway, sequence, fix.", "--airways"
    ),
]
LimitFile: TypeAlias = Annotated[
    Path | None,
    input_file("Limits of indicators, .toml; for example examples/limits_5nm.toml.", "--limits"),
]
TRUTH = "Truth: a table of time_s, target, east_m, north_m, or ASTERIX."
By: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(metavar="COLUMN", help="Column whose values group the rows; may be repeated."),
]
ColumnNames: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--column",
        metavar="NAME=COLUMN",
        help="Standard name of a column, and its name in the files; may be repeated.",
    ),
]
Value: TypeAlias = Annotated[
    str, typer.Option("--value", metavar="COLUMN", help="Column of the measurements.")
]
Period: TypeAlias = Annotated[float, typer.Option(help="Period of the measurements; 0: none.")]
Origin: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="LAT,LON",
        help="Origin of east and north in degrees; by default the origin of the sensors.",
    ),
]
Flat: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--flat",
        help="Place radars with latitudes in the plane tangent to the earth at the origin.",
    ),
]
Profile: TypeAlias = Annotated[
    ProfileName,
    typer.Option(help="Kind of targets: sets their motion, largest speed and unknown heights."),
]
ClockPeriod: TypeAlias = Annotated[
    float | None, typer.Option(help="Seconds after which times restart from 0, such as 86400.")
]
RegistrationSwitch: TypeAlias = Annotated[
    Literal["on", "off"] | None,
    typer.Option(
        help="Estimate and subtract the systematic errors of the radars; by default if there are "
        "two radars or more."
    ),
]
UpdateInterval: TypeAlias = Annotated[
    float | None,
    typer.Option(
        help="Required interval between updates in seconds; by default the interval of the fastest "
        "sensor."
    ),
]
MaxDistance: TypeAlias = Annotated[
    float, typer.Option(help="Largest distance in metres between a track and its target.")
]
PropagationSpeed: TypeAlias = Annotated[
    float, typer.Option(metavar="M_S", help="Speed of signals in m/s, for times of arrival.")
]
PropagationSpeedSigma: TypeAlias = Annotated[
    float | None,
    typer.Option(metavar="M_S", help="Sigma of the propagation speed, which is then estimated."),
]
WindSigma: TypeAlias = Annotated[
    float,
    typer.Option(
        metavar="M_S", help="Sigma of each component of the wind, for times of arrival of sound."
    ),
]
MotionModel: TypeAlias = Annotated[MotionName, typer.Option(help="Motion model of the targets.")]
Threads: TypeAlias = Annotated[
    int | None, typer.Option(min=1, help="Number of threads; by default all cores.")
]
Output: TypeAlias = Annotated[
    Path | None, output_file(f"Write the result as {_WRITTEN}.", "--output")
]
MapOutput: TypeAlias = Annotated[
    Path | None,
    output_file(
        f"Write the result as {_WRITTEN.replace(' or', ',')}, .geojson or .kml.", "--output"
    ),
]
MeasurementOutput: TypeAlias = Annotated[
    Path | None,
    output_file("Write one row per measurement: residual, and whether it is an outlier."),
]
PlotFile: TypeAlias = Annotated[
    Path | None, output_file("Draw the result (.png, .svg, .pdf, ...).", "--plot")
]


def pair(
    text: str | None, option: str, kind: Callable[[str], Number]
) -> tuple[Number, Number] | None:
    """Return two numbers from text in which a comma separates them."""
    if text is None:
        return None
    try:
        first, second = map(kind, text.split(","))
    except ValueError:
        fail(f"{option} is {text!r}; it must be two numbers with a comma between them", WRONG_USAGE)
    return first, second


def switched(option: Literal["on", "off"] | None) -> bool | None:
    """Return whether an option is on; None if it is not given."""
    return None if option is None else option == "on"


def column_names(options: Sequence[str] | None) -> dict[str, str]:
    """Return the columns given by options NAME=COLUMN, by name."""
    columns: dict[str, str] = {}
    for option in options or ():
        name, _, column = option.partition("=")
        if not name or not column:
            fail(f"--column is {option!r}; it must be NAME=COLUMN", WRONG_USAGE)
        if name in columns:
            way = "if its name differs between the files, rename the column in one of them"
            fail(f"--column gives {name} twice; {way}", WRONG_USAGE)
        columns[name] = column
    return columns
