"""`tertia weights`: what each sensor's estimate of the same thing is worth."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import polars as pl
import typer

from tertia import fusion, plot, weights
from tertia._arrays import FloatArray
from tertia.cli import _tables
from tertia.cli._terminal import WRONG_USAGE, counted, fail, note, print_table, shown, working
from tertia.fusion import FusedEstimate
from tertia.weights import FusionLoss

EXAMPLES = (
    "tertia weights estimates.csv --column east_m --column north_m",
    "tertia weights ranges.csv --by station --column range_m --differences --loss 0.02",
)
_FUSED = "fused"


@dataclass(frozen=True, slots=True)
class _Weighed:
    """Sensors with their numbers of measurements, means and covariances, and what came of them."""

    names: list[str]
    counts: list[int]
    means: FloatArray
    covariances: FloatArray
    fused: FusedEstimate
    loss: FusionLoss
    required: int

    def rows(self, columns: list[str]) -> pl.DataFrame:
        """Return one row per sensor, and one of the fused estimate."""
        names, counts = [*self.names, _FUSED], [*self.counts, sum(self.counts)]
        means = np.vstack([self.means, self.fused.mean])
        spread = [*self.covariances, self.fused.covariance]
        sigmas = np.sqrt([np.diagonal(one) for one in spread])
        table: dict[str, Any] = {"sensor": names, "measurements": counts}
        for i, name in enumerate(columns):
            table[name], table[f"{name}_sigma"] = means[:, i], sigmas[:, i]
        for i, row in enumerate(columns):
            for j, column in enumerate(columns):
                of = f"_{row}_{column}" if len(columns) > 1 else ""
                table[f"weight{of}"] = [*self.fused.weights[:, i, j], None]
        return pl.DataFrame(table)


def weigh(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", readable=False, help="Measurements: .csv with a header, .parquet, ..."
        ),
    ],
    *,
    column: Annotated[
        list[str],
        typer.Option(help="Column of a component of what is measured; may be repeated."),
    ],
    by: Annotated[str, typer.Option(help="Column of the sensor's name.")] = "sensor",
    differences: Annotated[
        bool,
        typer.Option(
            "--differences", help="What is measured moves slowly: successive differences."
        ),
    ] = False,
    bound: Annotated[
        float, typer.Option("--loss", help="Loss for which the measurements are counted.")
    ] = 0.05,
    output: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write .csv, .parquet, .arrow, .jsonl or .json, not a table."
        ),
    ] = None,
) -> dict[str, Any]:
    """Weigh sensors that measured the same thing many times, by how much each of them scatters.

    One row per measurement, with the sensor and all components; incomplete rows are left out. The
    weights come from estimated covariances: told is what that costs.
    """
    columns = list(dict.fromkeys(column))
    if by in columns:
        fail(f"--by and --column are both {by}", WRONG_USAGE)
    if not 1e-6 <= bound <= 1e6:
        fail(f"--loss is {bound:g}; it must be between 1e-6 and 1e6", WRONG_USAGE)
    _tables.check_suffixes(output, None)
    samples = _read(file, by, columns)
    with working("Weighing"):
        weighed = _weigh(samples, columns, bound, differences=differences)
    table = weighed.rows(columns)
    if output is None:
        told = pl.DataFrame([_cells(row, columns) for row in table.to_dicts()])
        print_table(told, shown, text=["sensor"], limited="sensors are shown")
    else:
        _tables.write(table, output)
    _say(weighed, columns, bound)
    return {
        "sensors": table.to_dicts(),
        "pvalue": float(weighed.fused.pvalue),
        "loss": float(weighed.loss.loss),
        "required": weighed.required,
    }


def _read(path: Path, by: str, columns: list[str]) -> dict[str, FloatArray]:
    """Return the measurements of each sensor, (n, m), in the order of the file."""
    frame = _tables.read(path, [by, *columns])
    frame = frame.filter(_tables.is_row(frame, path))
    if frame.is_empty():
        fail(f"{path} is empty")
    values = [_tables.numbers(frame[name], path).fill_nan(None) for name in columns]
    names = _tables.without_marks(frame[by].cast(pl.String))
    whole = pl.DataFrame([names, *values]).drop_nulls()
    if left_out := frame.height - whole.height:
        note(f"{left_out} of {counted(frame.height, 'row')} incomplete")
    groups = whole.partition_by(by, maintain_order=True, as_dict=True)
    if len(groups) < 2:
        fail(f"{path} has {counted(len(groups), 'sensor')} in {by}; two at least are weighed")
    return {name: group.select(columns).to_numpy() for (name,), group in groups.items()}


def _weigh(
    samples: dict[str, FloatArray], columns: list[str], bound: float, *, differences: bool
) -> _Weighed:
    counts = [len(sample) for sample in samples.values()]
    for name, sample in samples.items():
        if len(sample) < 2:
            fail(f"sensor {name} has 1 measurement; two at least tell how it scatters")
        for column, same in zip(columns, np.ptp(sample, axis=0) == 0, strict=True):
            if same:
                fail(
                    f"sensor {name}: {column} is always the same; how it scatters tells its weight"
                )
    means = np.array([sample.mean(axis=0) for sample in samples.values()])
    # of the means
    covariances = np.array(
        [
            weights.sample_covariance(sample, differences=differences) / len(sample)
            for sample in samples.values()
        ]
    )
    convention: weights.Convention = "differences" if differences else "sample-mean"
    try:
        fused = fusion.fuse(means, covariances)
        loss = weights.fusion_loss(covariances, counts, convention=convention)
        required = int(weights.required_samples(covariances, bound, convention=convention))
    except (ValueError, np.linalg.LinAlgError) as error:
        fail(str(error))
    return _Weighed(list(samples), counts, means, covariances, fused, loss, required)


def _cells(row: dict[str, Any], columns: list[str]) -> dict[str, Any]:
    """Return a row with digits as far as they are known."""
    for name in columns:
        row[name], row[f"{name}_sigma"] = plot.rounded(row[name], row[f"{name}_sigma"])
    return row


def _say(weighed: _Weighed, columns: list[str], bound: float) -> None:
    sigmas = np.sqrt(np.diagonal(weighed.fused.covariance))
    pairs = [plot.rounded(*pair) for pair in zip(weighed.fused.mean, sigmas, strict=True)]
    told = [
        f"{name} {value} ± {sigma}" for name, (value, sigma) in zip(columns, pairs, strict=True)
    ]
    typer.echo(f"fused: {', '.join(told)}")
    typer.echo(
        f"  means that differ more have a probability of {weighed.fused.pvalue:.3g}, were the "
        "covariances known"
    )
    typer.echo(
        f"  estimating the weights costs {float(weighed.loss.loss):.2%} of the mean squared error; "
        f"{weighed.required} measurements per sensor would keep that below {bound:.3g}"
    )
