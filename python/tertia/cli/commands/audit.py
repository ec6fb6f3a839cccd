"""`tertia audit`: comparison of the sigmas of estimates with the truth."""

from pathlib import Path
from typing import Annotated, Any

import typer

from tertia import plot
from tertia._result import counted
from tertia.cli.files import read, write
from tertia.cli.terminal import options as opt
from tertia.cli.terminal.options import input_file, input_files, option
from tertia.cli.terminal.say import note, print_table, working
from tertia.tables._audit import audit_of

EXAMPLES = (
    "tertia audit tracks.csv --truth truth.csv",
    "tertia audit positions.csv --truth gps.csv --truth-column time_s=ts --truth-sigma 2.5",
    "tertia audit bearings.csv --value azimuth_deg --by sensor --strata range_km --plot audit.png",
)


def audit(
    file: Annotated[
        Path,
        input_files(
            "FILE",
            "Estimates with sigmas: output of another command, a table, or ASTERIX CAT062.",
        ),
    ],
    *,
    truth: Annotated[
        Path | None, input_file(f"{opt.TRUTH} By default, columns true_* of FILE.")
    ] = None,
    value: Annotated[
        str | None,
        option("Column to audit, such as azimuth_deg; by default positions.", metavar="COLUMN"),
    ] = None,
    by: Annotated[
        list[str] | None,
        option(
            "Column whose values identify independent parts; by default track or target.",
            metavar="COLUMN",
        ),
    ] = None,
    strata: Annotated[
        list[str] | None,
        option(
            "Column whose values define parts that are audited separately; may be repeated.",
            metavar="COLUMN",
        ),
    ] = None,
    column: opt.ColumnNames = None,
    truth_column: Annotated[
        list[str] | None,
        option("As --column, for the truth; may be repeated.", metavar="NAME=COLUMN"),
    ] = None,
    truth_sigma: Annotated[
        float, option("Standard deviation of each axis of the truth, in metres.")
    ] = 0.0,
    origin: opt.Origin = None,
    max_distance: opt.MaxDistance = 1000.0,
    output: opt.Output = None,
    plot_file: opt.PlotFile = None,
) -> dict[str, Any]:
    """Check against the truth whether the sigmas of estimates are too small, too large or honest.

    All figures have confidence intervals that allow for time-correlated errors. The truth is
    interpolated linearly between its times.
    """
    write.check_suffixes(output, plot_file)
    with working("Auditing"):
        found = audit_of(
            read.estimates(file),
            None if truth is None else read.truth(truth),
            columns=opt.column_names(column),
            truth_columns=opt.column_names(truth_column),
            value=value,
            by=by or (),
            strata=strata or (),
            origin=opt.pair(origin, "--origin", float),
            truth_sigma=truth_sigma,
            max_distance=max_distance,
        )
    print_table(found.summary, text=["part", "sigmas"])
    write.write(found.rows, output)
    whole = found.audit
    if whole.missing:
        note(f"{counted(whole.missing, 'estimate')} left out: no true value, or no sigma")
    if whole.time_offset is not None:
        typer.echo(f"times of the truth: {whole.time_offset.verdict}")
    write.save(plot_file, (7.0, 5.0), lambda figure: plot.audit(whole, ax=figure.subplots()))
    return {
        "verdict": whole.verdict,
        "count": whole.count,
        "missing_count": whole.missing,
        "effective_number": whole.effective_number,
        "figures": found.rows.to_dicts(),
    }
