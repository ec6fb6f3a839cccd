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


def option(text: str, *names: str, metavar: str | None = None, **more: Any) -> Any:
    """Return an option with this help; by default it has the name of the parameter."""
    return typer.Option(*names, metavar=metavar, help=text, **more)


def input_file(text: str, *names: str, **more: Any) -> Any:
    """Return an option for an input file; one that cannot be read is reported in one line."""
    return option(text, *names, metavar="FILE", readable=False, **more)


def output_file(text: str, *names: str) -> Any:
    """Return an option for an output file."""
    return option(text, *names, metavar="FILE")


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
    option("Column whose values group the rows; may be repeated.", metavar="COLUMN"),
]
ColumnNames: TypeAlias = Annotated[
    list[str] | None,
    option(
        "Standard name of a column, and its name in the files; may be repeated.",
        "--column",
        metavar="NAME=COLUMN",
    ),
]
Value: TypeAlias = Annotated[
    str, option("Column of the measurements.", "--value", metavar="COLUMN")
]
Period: TypeAlias = Annotated[float, option("Period of the measurements; 0: none.")]
Origin: TypeAlias = Annotated[
    str | None,
    option(
        "Origin of east and north in degrees; by default the origin of the sensors.",
        metavar="LAT,LON",
    ),
]
Flat: TypeAlias = Annotated[
    bool,
    option(
        "Place radars with latitudes in the plane tangent to the earth at the origin.", "--flat"
    ),
]
Profile: TypeAlias = Annotated[
    ProfileName,
    option("Kind of targets: sets their motion, largest speed and unknown heights."),
]
ClockPeriod: TypeAlias = Annotated[
    float | None, option("Seconds after which times restart from 0, such as 86400.")
]
RegistrationSwitch: TypeAlias = Annotated[
    Literal["on", "off"] | None,
    option(
        "Estimate and subtract the systematic errors of the radars; by default if there are "
        "two radars or more."
    ),
]
UpdateInterval: TypeAlias = Annotated[
    float | None,
    option(
        "Required interval between updates in seconds; by default the interval of the fastest "
        "sensor."
    ),
]
MaxDistance: TypeAlias = Annotated[
    float, option("Largest distance in metres between a track and its target.")
]
PropagationSpeed: TypeAlias = Annotated[
    float, option("Speed of signals in m/s, for times of arrival.", metavar="M_S")
]
PropagationSpeedSigma: TypeAlias = Annotated[
    float | None,
    option("Sigma of the propagation speed, which is then estimated.", metavar="M_S"),
]
WindSigma: TypeAlias = Annotated[
    float | None,
    option("Sigma of each component of the wind, for times of arrival of sound.", metavar="M_S"),
]
MotionModel: TypeAlias = Annotated[MotionName, option("Motion model of the targets.")]
Threads: TypeAlias = Annotated[
    int | None, option("Number of threads; by default all cores.", min=1)
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
    text: str | None, flag: str, kind: Callable[[str], Number]
) -> tuple[Number, Number] | None:
    """Return two numbers from text in which a comma separates them."""
    if text is None:
        return None
    try:
        first, second = map(kind, text.split(","))
    except ValueError:
        fail(f"{flag} is {text!r}; it must be two numbers with a comma between them", WRONG_USAGE)
    return first, second


def switched(state: Literal["on", "off"] | None) -> bool | None:
    """Return whether an option is on; None if it is not given."""
    return None if state is None else state == "on"


def column_names(options: Sequence[str] | None) -> dict[str, str]:
    """Return the columns given by options NAME=COLUMN, by name."""
    columns: dict[str, str] = {}
    for given in options or ():
        name, _, column = given.partition("=")
        if not name or not column:
            fail(f"--column is {given!r}; it must be NAME=COLUMN", WRONG_USAGE)
        if name in columns:
            way = "if its name differs between the files, rename the column in one of them"
            fail(f"--column gives {name} twice; {way}", WRONG_USAGE)
        columns[name] = column
    return columns
