"""Outliers in groups of measurements, marked in the table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
import polars as pl

from tertia import screening
from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.screening import Screening
from tertia.tables._frames import Table, extended
from tertia.tables._groups import as_names, by_length, known, layout
from tertia.tables._parts import source_of
from tertia.tables._records import number, read

Rule: TypeAlias = Literal["bursts", "leave-one-out", "k-sigma"]

_RULES: dict[str, Callable[..., Screening]] = {
    "bursts": screening.bursts,
    "leave-one-out": screening.leave_one_out,
    "k-sigma": screening.k_sigma,
}


def screen(
    table: Table,
    *,
    columns: Mapping[str, str] | None = None,
    values: str = "azimuth_deg",
    by: str | Sequence[str] = (),
    rule: Rule = "bursts",
    period: float | None = None,
    name: str = "outlier",
    **options: Any,
) -> Table:
    """Mark the measurements that are outliers.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per measurement; within a group, rows are in the order of measurement.
    columns : mapping of str to str, optional
        The names that columns have in this table, keyed by their standard names.
    values : str
        Column of the measurements; null and nan are missing.
    by : str or sequence of str
        Columns whose values identify the samples; by default all rows are one sample.
    rule : {"bursts", "leave-one-out", "k-sigma"}
        Name of the function of `tertia.screening`, with hyphens instead of underscores.
    period : float, optional
        Period of angles: 360.0 for degrees, 2*pi for radians. Angles are unwrapped before they are
        screened. By default the measurements do not wrap.
    name : str
        Name of the new column.
    **options
        Parameters of the function, except `nan_policy`.

    Returns
    -------
    table of the same kind
        The same rows with one more column: whether each measurement is an outlier. It is null if
        the measurement is missing, or if its group is too small for the rule.

    Raises
    ------
    RecordError
        If a column is missing or does not hold numbers, or a measurement is infinite.
    ValueError
        If the table already has a column called `name`, the rule is unknown, or an option is
        outside its domain.
    TypeError
        If the table is of an unsupported kind, or an option has the wrong type.

    Examples
    --------
    >>> import polars as pl
    >>> from tertia.tables import screen
    >>> table = pl.DataFrame({"m": [9.8, 10.1, None, 10.0, 25.0, 10.2, 9.9]})
    >>> screen(table, values="m", rule="leave-one-out")["outlier"].to_list()
    [False, False, None, False, True, False, False]
    """
    if rule not in _RULES:
        raise ValueError(f"rule is {rule!r}; it must be one of {', '.join(_RULES)}")
    _RULES[rule](np.empty((0, 5)), **options)
    schema = {"value": number(values, required=True, standard=False)}
    records = read(source_of(table), schema, columns=columns, by=as_names(by))
    groups = layout(records.by, records.rows.height)
    ordered = groups.arranged(records.rows["value"].to_numpy())
    count, rows = groups.lengths, groups.order
    absent = np.isnan(ordered)
    if absent.any():
        count = np.bincount(groups.group[~absent], minlength=len(count))
        ordered, rows = ordered[~absent], rows[~absent]
    outlier, judged = np.zeros((2, len(groups.order)), dtype=bool)

    def mask(sample: FloatArray, places: IntArray) -> tuple[IntArray, BoolArray]:
        if period is not None:
            sample = screening.unwrap_about_median(sample, period)
        return places, _RULES[rule](sample, **options).outlier

    for _, found in by_length(count, (ordered, rows), mask):
        if not isinstance(found, ValueError):
            outlier[found[0]], judged[found[0]] = found[1], True
    column_of_masks = known(outlier, judged)
    return extended(table, pl.DataFrame({name: column_of_masks}))
