"""Bearings of groups of measurements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl

from tertia._arrays import FloatArray
from tertia.bearing import BearingEstimate, estimate_bearing
from tertia.tables._columns import Layout, as_names, by_length, layout, numbers
from tertia.tables._kinds import Table, take

RESULTS = {
    "count": pl.Int64,
    "missing": pl.Int64,
    "value": pl.Float64,
    "sigma": pl.Float64,
    "anomalous": pl.Int64,
    "polarity": pl.Float64,
    "note": pl.String,
}


def bearings(
    table: Table, column: str = "bearing_deg", *, by: str | Sequence[str] = (), **options: Any
) -> Table:
    """Estimate a bearing and its sigma per group, as the command `tertia bearing`.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per measurement, those of a group in the order in which they came.
    column : str
        Column of the measurements; missing ones (null, nan) are left out and counted.
    by : str or sequence of str
        Columns whose values tell the groups; by default all rows are one.
    **options
        As of `tertia.bearing.estimate_bearing`, but `nan_policy`.

    Returns
    -------
    table of the same kind
        A row per group, in the order of their first measurements: `by`, then `count` and `missing`
        measurements, `value`, `sigma`, how many were `anomalous`, `polarity`, and a `note` why
        there is no estimate, if there is none. Without rows where there were none.

    Raises
    ------
    ValueError
        A column that is not there or has the name of a result, a measurement that is infinite, or
        an option outside its domain.
    TypeError
        A table of another kind, a column without numbers, or an option of the wrong type.

    Examples
    --------
    >>> import polars as pl
    >>> from tertia.simulate import direction_finder
    >>> from tertia.tables import bearings
    >>> table = pl.concat(
    ...     pl.DataFrame({"station": name, "bearing_deg": record.theta})
    ...     for name, angle in [("A", 359.0), ("B", 80.0)]
    ...     for record in [direction_finder(60, bearing=angle, rng=1)]
    ... )
    >>> bearings(table, by="station").select("station", "count", "anomalous", "note").rows()
    [('A', 60, 4, None), ('B', 60, 4, None)]
    """
    keys = as_names(by)
    require_options(keys, column, options)
    taken = take(table, [*keys, column], keys)
    groups = layout(taken.frame, keys)
    theta = numbers(taken.frame[column])[groups.order]
    return taken.result(_estimates(groups, theta, column, options))  # type: ignore[no-any-return]


def require_options(by: Sequence[str], column: str, options: dict[str, Any]) -> None:
    """Judge the options before the work, on a sample that suits every method."""
    for name in by:
        if name in {column, *RESULTS}:
            raise ValueError(f"cannot group by {name}: the results have a column of this name")
    estimate_bearing([0.0] * 5, **options)


def _estimates(
    groups: Layout, theta: FloatArray, column: str, options: dict[str, Any]
) -> pl.DataFrame:
    present = ~np.isnan(theta)
    count = np.bincount(groups.group[present], minlength=len(groups.lengths))
    values, sigmas, polarities = np.full((3, len(count)), np.nan)
    anomalous = np.zeros(len(count), dtype=np.int64)
    notes: list[str | None] = [None] * len(count)
    there = theta[present]

    def estimate(elements: Any) -> BearingEstimate:
        sample = there[elements]
        # errors name the place in a sample, not in a batch of one
        return estimate_bearing(sample[0] if len(sample) == 1 else sample, **options)

    for which, found in by_length(count, estimate):
        if isinstance(found, ValueError):
            notes[which[0]] = str(found).replace("theta", column)
            continue
        values[which], sigmas[which] = found.value, found.sigma
        polarities[which] = found.polarity
        anomalous[which] = np.count_nonzero(found.outlier, axis=-1)
    told = dict(
        zip(
            RESULTS,
            (count, groups.lengths - count, values, sigmas, anomalous, polarities, notes),
            strict=True,
        )
    )
    results = pl.DataFrame(told, RESULTS)
    estimated = [pl.when(pl.col("note").is_null()).then(name).alias(name) for name in _ESTIMATED]
    return pl.concat([groups.keys, results.with_columns(estimated)], how="horizontal")


_ESTIMATED = ("value", "sigma", "anomalous", "polarity")
