"""Anomalous measurements of groups, marked in the table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
import polars as pl

from tertia import screening
from tertia._arrays import BoolArray
from tertia.screening import Screening
from tertia.tables._columns import as_names, by_length, layout, numbers
from tertia.tables._kinds import Table, take

Rule: TypeAlias = Literal["bursts", "leave-one-out", "k-sigma"]

_RULES: dict[str, Callable[..., Screening]] = {
    "bursts": screening.bursts,
    "leave-one-out": screening.leave_one_out,
    "k-sigma": screening.k_sigma,
}


def screen(
    table: Table,
    column: str,
    *,
    by: str | Sequence[str] = (),
    rule: Rule = "bursts",
    period: float | None = None,
    name: str = "outlier",
    **options: Any,
) -> Table:
    """Tell which measurements are anomalous.

    Parameters
    ----------
    table : DataFrame of Polars or pandas, Table or RecordBatch of pyarrow
        One row per measurement, those of a group in the order in which they came.
    column : str
        Column of the measurements; null and nan are missing.
    by : str or sequence of str
        Columns whose values tell the groups, each of which is a sample; by default all rows are
        one.
    rule : {"bursts", "leave-one-out", "k-sigma"}
        The function of `tertia.screening`.
    period : float, optional
        360.0 for degrees, 2*pi for radians, whose angles are unwrapped before; by default the
        measurements do not wrap.
    name : str
        Name of the new column.
    **options
        As of the function, but `nan_policy`.

    Returns
    -------
    table of the same kind
        The same rows with one more column: whether each measurement is anomalous; null where it is
        missing, or where its group has too few to be judged.

    Raises
    ------
    ValueError
        A column that is not there, or there already, a measurement that is infinite, an unknown
        rule, or an option outside its domain.
    TypeError
        A table of another kind, a column without numbers, or an option of the wrong type.

    Examples
    --------
    >>> import polars as pl
    >>> from tertia.tables import screen
    >>> table = pl.DataFrame({"m": [9.8, 10.1, None, 10.0, 25.0, 10.2, 9.9]})
    >>> screen(table, "m", rule="leave-one-out")["outlier"].to_list()
    [False, False, None, False, True, False, False]
    """
    if rule not in _RULES:
        raise ValueError(f"rule is {rule!r}; it must be one of {', '.join(_RULES)}")
    _RULES[rule]([0.0, 1.0, 0.0, 1.0, 0.0], **options)
    keys = as_names(by)
    taken = take(table, [*keys, column])
    groups = layout(taken.frame, keys)
    values = numbers(taken.frame[column])[groups.order]
    present = ~np.isnan(values)
    count = np.bincount(groups.group[present], minlength=len(groups.lengths))
    rows, there = groups.order[present], values[present]
    outlier, judged = np.zeros((2, len(values)), dtype=bool)

    def mask(elements: Any) -> tuple[Any, BoolArray]:
        sample = there[elements]
        if period is not None:
            sample = screening.unwrap_about_median(sample, period)
        return rows[elements], _RULES[rule](sample, **options).outlier

    for _, found in by_length(count, mask):
        if not isinstance(found, ValueError):
            outlier[found[0]], judged[found[0]] = found[1], True
    column_of_masks = pl.Series(outlier).set(pl.Series(~judged), None)
    return taken.extended(pl.DataFrame({name: column_of_masks}))  # type: ignore[no-any-return]
