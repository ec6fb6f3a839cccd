"""`tertia smooth`: smoothing of positions or other series over time."""

import math
from collections.abc import Sequence
from typing import Annotated, Any

import polars as pl
import typer

from tertia._result import counted
from tertia.cli.files import read, write
from tertia.cli.terminal import options as opt
from tertia.cli.terminal.options import option
from tertia.cli.terminal.say import note, print_table, working
from tertia.tables._smooth import smoothing_of

EXAMPLES = (
    "tertia smooth positions.csv --sigma 20 --by target --output smoothed.csv",
    "tertia smooth flights.csv --sigma 20 --velocity-sigma 2 --by icao_address",
    "tertia smooth heights.csv --value up_m --sigma up_sigma_m --column time_s=t",
)


def smooth(
    files: opt.Recordings,
    *,
    sigma: Annotated[
        list[str],
        option(
            "Standard deviation of the measurements, or a column with it; once for all "
            "axes, or repeated for each.",
            metavar="NUMBER|COLUMN",
        ),
    ],
    value: Annotated[
        list[str] | None,
        option(
            "Column of an axis; may be repeated. By default, east_m and north_m, or "
            "latitude_deg and longitude_deg.",
            metavar="COLUMN",
        ),
    ] = None,
    velocity: Annotated[
        list[str] | None,
        option(
            "Column of a measured velocity, repeated for each axis. By default, "
            "velocity_east_m_s and velocity_north_m_s, or speed_m_s and course_deg.",
            metavar="COLUMN",
        ),
    ] = None,
    velocity_sigma: Annotated[
        list[str] | None,
        option(
            "Standard deviation of the velocities, or a column with it. Velocities are used "
            "only if it is given.",
            metavar="NUMBER|COLUMN",
        ),
    ] = None,
    column: opt.ColumnNames = None,
    by: opt.By = None,
    correlation_time: Annotated[
        float | None, option("Correlation time of the noise in seconds; by default estimated.")
    ] = None,
    robust: Annotated[
        bool, option("Whether to allow for outliers, jumps and larger noise.")
    ] = True,
    jerk: Annotated[
        float | None,
        option("Intensity of the white jerk; by default, each track's motion is estimated."),
    ] = None,
    n_threads: opt.Threads = None,
    output: opt.Output = None,
) -> dict[str, Any]:
    """Smooth positions over time, allowing for outliers and jumps.

    One row per measurement, in any order: time_s, and the columns of the values. A row without
    values still defines a time at which the track is estimated. Several rows may have the same
    time.
    """
    write.check_suffixes(output)
    with working("Smoothing"):
        found = smoothing_of(
            read.tables(*files),
            columns=opt.column_names(column),
            values=list(dict.fromkeys(value or ("east_m", "north_m"))),
            sigma=_sigmas(sigma),
            velocities=velocity or None,
            velocity_sigma=_sigmas(velocity_sigma) if velocity_sigma else None,
            by=by or [],
            correlation_time=correlation_time,
            robust=robust,
            jerk=jerk,
            n_threads=n_threads,
        )
    rows = pl.concat([found.rows, found.added], how="horizontal")
    if output is None:
        print_table(rows, text=by or [], limited="rows are shown: --output writes all")
    else:
        write.write(rows, output)
    outliers = int(rows["smoothing_outlier"].sum())
    typer.echo(
        f"{counted(found.targets, 'track')} of {counted(rows.height, 'row')}, "
        f"{counted(outliers, 'outlier')} left out"
    )
    note("sigma does not include errors that are common to all rows of a track")
    return {"tracks": found.targets, "rows": rows.height, "outliers": outliers}


def _sigmas(options: Sequence[str]) -> float | str | list[float | str]:
    """Return options as numbers or as names of columns."""

    def parsed(text: str) -> float | str:
        try:
            number = float(text)
        except ValueError:
            return text
        return number if math.isfinite(number) else text

    return parsed(options[0]) if len(options) == 1 else [parsed(one) for one in options]
