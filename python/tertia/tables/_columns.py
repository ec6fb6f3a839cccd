"""Columns of numbers and times, and the rows of each group."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import polars as pl

from tertia._arrays import BoolArray, FloatArray, IntArray

PER_SECOND = {"ms": 1e3, "us": 1e6, "ns": 1e9}

Found = TypeVar("Found")


@dataclass(frozen=True, slots=True)
class Layout:
    """Which rows belong to which group: `order` has those of the first group, then the next."""

    keys: pl.DataFrame
    order: IntArray
    lengths: IntArray

    @property
    def group(self) -> IntArray:
        """Group of each element of `order`."""
        return np.repeat(np.arange(len(self.lengths)), self.lengths)


def as_names(by: str | Sequence[str]) -> list[str]:
    """Return the names of columns, each once."""
    return [by] if isinstance(by, str) else list(dict.fromkeys(by))


def layout(frame: pl.DataFrame, by: Sequence[str]) -> Layout:
    """Lay the rows out by the values of some columns, in the order in which these first appear."""
    if not by or frame.is_empty():
        count = np.array([frame.height] if frame.height else [], dtype=np.int64)
        return Layout(frame.select(by).head(len(count)), np.arange(frame.height), count)
    row = pl.int_range(pl.len(), dtype=pl.Int64).alias("")
    groups = frame.select(*by, row).group_by(by, maintain_order=True).agg("")
    rows = groups.get_column("")
    return Layout(
        groups.select(by),
        rows.explode().to_numpy(),
        rows.list.len().cast(pl.Int64).to_numpy(),
    )


def numbers(column: pl.Series) -> FloatArray:
    """Return numbers, nan where missing."""
    if not (column.dtype.is_numeric() or column.dtype == pl.Null):
        raise TypeError(f"{column.name} holds {column.dtype}; it must hold numbers")
    found = np.asarray(column.cast(pl.Float64).fill_null(math.nan).to_numpy())
    wrong = np.flatnonzero(np.isinf(found))
    if len(wrong):
        raise ValueError(
            f"{column.name}[{wrong[0]}] is {found[wrong[0]]}; it must be a finite number"
        )
    return found


def times(column: pl.Series) -> pl.Series:
    """Return times as numbers or as dates, all of them there."""
    kind = column.dtype
    if not (kind.is_numeric() or isinstance(kind, (pl.Date, pl.Datetime))):
        raise TypeError(f"{column.name} holds {kind}; it must hold numbers or dates")
    known = column.is_finite() if kind.is_numeric() else column.is_not_null()
    wrong = (~known.fill_null(False)).arg_true()
    if len(wrong):
        raise ValueError(f"{column.name}[{wrong[0]}] is {column[wrong[0]]}; it must be a time")
    return column.cast(pl.Datetime("us")) if kind == pl.Date else column


def seconds(moments: pl.Series) -> FloatArray:
    """Return times as numbers; dates as seconds from the earliest."""
    if not isinstance(moments.dtype, pl.Datetime):
        return np.asarray(moments.to_numpy(), dtype=np.float64)
    ticks = moments.to_physical().to_numpy()
    since: FloatArray = (ticks - ticks.min(initial=np.iinfo(np.int64).max)) / PER_SECOND[
        moments.dtype.time_unit
    ]
    return since


def beside(keys: pl.DataFrame, table: pl.DataFrame) -> pl.DataFrame:
    """Return the table with the keys of its group in every row."""
    return keys.join(table, how="cross") if keys.width else table


def known(values: FloatArray, known: BoolArray) -> pl.Series:
    """Return numbers, null where they are not known."""
    return pl.Series(values).set(pl.Series(~known), None)


def by_length(
    lengths: IntArray, call: Callable[[IntArray], Found]
) -> Iterator[tuple[IntArray, Found | ValueError]]:
    """Call with the elements of groups of the same length at once, `(groups, length)`.

    Where this fails, each group is called with alone, `(1, length)`: one bad group is no reason to
    do nothing for the others. Yields which groups, and the result or why there is none.
    """
    starts = np.cumsum(lengths) - lengths
    ranked = np.argsort(lengths, kind="stable")
    for groups in np.split(ranked, np.flatnonzero(np.diff(lengths[ranked])) + 1):
        if len(groups):
            elements = starts[groups, np.newaxis] + np.arange(lengths[groups[0]])
            yield from _each(groups, elements, call)


def _each(
    groups: IntArray, elements: IntArray, call: Callable[[IntArray], Found]
) -> Iterator[tuple[IntArray, Found | ValueError]]:
    try:
        yield groups, call(elements)
        return
    except ValueError as error:
        if len(groups) == 1:
            yield groups, error
            return
    for k in range(len(groups)):
        yield from _each(groups[k : k + 1], elements[k : k + 1], call)
