"""`tertia weights`: weights of several sensors for estimates of the same quantity."""

from typing import Annotated, Any

import numpy as np
import polars as pl
import typer

from tertia import plot
from tertia.cli.files import read, write
from tertia.cli.terminal.options import ColumnNames, Output, Recording, column_names, option
from tertia.cli.terminal.say import print_table, working
from tertia.tables._groups import column_name
from tertia.tables._weights import weights_of

EXAMPLES = (
    "tertia weights estimates.csv --value east_m --value north_m",
    "tertia weights ranges.csv --column sensor=station --value range_m --differences --loss 0.02",
)


def weights(
    file: Recording,
    *,
    value: Annotated[
        list[str],
        option(
            "Column of a component of the measured quantity; may be repeated.", metavar="COLUMN"
        ),
    ],
    column: ColumnNames = None,
    differences: Annotated[
        bool,
        option(
            "Estimate noise from successive differences, if the quantity drifts.", "--differences"
        ),
    ] = False,
    loss: Annotated[float, option("Loss for which to compute the number of measurements.")] = 0.05,
    bias_sigma: Annotated[
        float, option("Sigma of the systematic error of each sensor, in the unit of the values.")
    ] = 0.0,
    output: Output = None,
) -> dict[str, Any]:
    """Estimate the weights of sensors that measured the same quantity, from their scatter.

    One row per measurement, with the sensor and all components; incomplete rows are left out. The
    weights are computed from estimated covariances; the resulting loss of accuracy is printed.
    """
    write.check_suffixes(output)
    values = list(dict.fromkeys(value))
    with working("Weighing"):
        found = weights_of(
            read.tables(file),
            columns=column_names(column),
            values=values,
            differences=differences,
            loss=loss,
            bias_sigma=bias_sigma,
        )
    if output is None:
        rows = pl.DataFrame([_rounded(row, values) for row in found.rows.to_dicts()])
        print_table(rows, text=["sensor"])
    else:
        write.write(found.rows, output)
    fused = _rounded(found.rows.row(-1, named=True), values)
    listed = [f"{name} {fused[name]} ± {fused[column_name(name, 'sigma')]}" for name in values]
    cost = float(np.asarray(found.loss.loss))
    typer.echo(f"fused: {', '.join(listed)}")
    typer.echo(
        "  intervals of ± two sigmas hold 95 %, even with few measurements; p-value of the "
        f"differences between the means: {found.fused.pvalue:.3g}"
    )
    if not bias_sigma:
        typer.echo("  systematic errors are not included: see --bias-sigma")
    typer.echo(
        f"  because the weights are estimated, the mean squared error is {cost:.2%} larger; with "
        f"{found.required} measurements per sensor, the relative increase would be below "
        f"{loss:.3g}"
    )
    return {
        "sensors": found.rows.to_dicts(),
        "pvalue": float(found.fused.pvalue),
        "loss": cost,
        "required_count": found.required,
    }


def _rounded(row: dict[str, Any], values: list[str]) -> dict[str, Any]:
    """Return a row with as many digits as are significant."""
    row = dict(row)
    for name in values:
        sigma = column_name(name, "sigma")
        row[name], row[sigma] = plot.rounded(row[name], row[sigma])
    return row
