"""Groups of rows, and columns of results."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt
import polars as pl

from tertia._arrays import BoolArray, FloatArray, IntArray

Found = TypeVar("Found")
Scalar = TypeVar("Scalar", bound=np.generic)
T = TypeVar("T")
# function that shows progress to the user while it returns the items of a sequence
Progress: TypeAlias = Callable[[Sequence[T]], Iterable[T]]
# units in which names of columns end, the longer ones first
_UNITS = ("m_s2", "deg_s2", "nm_s2", "deg_s", "nm_s", "m_s", "deg", "rad", "nm", "m", "s")


@dataclass(frozen=True, slots=True)
class Layout:
    """The rows of each group: `order` has the rows of the first group, then of the second, etc.

    `sorted` means that the rows are already in this order.
    """

    keys: pl.DataFrame
    order: IntArray
    lengths: IntArray
    sorted: bool = False

    @property
    def group(self) -> IntArray:
        """The number of the group of each element of `order`."""
        return np.repeat(np.arange(len(self.lengths)), self.lengths)

    def arranged(self, values: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
        """Return the values of rows, arranged in the order of the groups."""
        return values if self.sorted else values[self.order]

    def __iter__(self) -> Iterator[tuple[pl.DataFrame, IntArray]]:
        """Yield the keys of each group, as a table with one row, and the indices of its rows."""
        ends = np.cumsum(self.lengths)
        for k, end in enumerate(ends):
            yield self.keys[k : k + 1], self.order[end - self.lengths[k] : end]


def as_names(by: str | Sequence[str]) -> list[str]:
    """Return the names of columns; a name that is given twice is returned once."""
    return [by] if isinstance(by, str) else list(dict.fromkeys(by))


def layout(frame: pl.DataFrame, count: int) -> Layout:
    """Group rows by the values of columns; groups have the order of their first rows."""
    if not frame.width or not count:
        lengths = np.array([count] if count else [], dtype=np.int64)
        return Layout(frame.head(len(lengths)), np.arange(count), lengths, sorted=True)
    starts = run_starts(frame)
    # if most rows begin a new run, the rows of a group are not consecutive
    if 2 * len(starts) <= count or len(starts) == 1:
        keys = frame[starts]
        if keys.n_unique() == keys.height:
            return Layout(keys, np.arange(count), np.diff(starts, append=count), sorted=True)
    row = pl.int_range(pl.len(), dtype=pl.Int64).alias("")
    groups = frame.with_columns(row).group_by(frame.columns, maintain_order=True).agg("")
    rows = groups.get_column("")
    return Layout(
        groups.select(frame.columns),
        rows.explode().to_numpy(),
        rows.list.len().cast(pl.Int64).to_numpy(),
    )


def run_starts(frame: pl.DataFrame) -> IntArray:
    """Return the first row of each run of equal rows of a table that has rows and columns."""
    new = np.zeros(frame.height, dtype=bool)
    new[0] = True
    for column in frame.get_columns():
        new[1:] |= column[1:].ne_missing(column[:-1]).to_numpy()
    return np.flatnonzero(new)


def group_name(keys: pl.DataFrame) -> str:
    """Return the name of a group, which lists its key columns with their values."""
    cells = zip(keys.columns, keys.row(0), strict=True) if keys.width else ()
    return ", ".join(f"{column} {'' if v is None else v}" for column, v in cells)


def prefixed(name: str, error: object) -> str:
    """Return a message that begins with the name of a group, if it has one."""
    return ": ".join(filter(None, [name, str(error)]))


def beside(keys: pl.DataFrame, table: pl.DataFrame) -> pl.DataFrame:
    """Return the table with the key columns of its group added to every row."""
    return keys.join(table, how="cross") if keys.width else table


def known(values: npt.ArrayLike, there: BoolArray | None = None) -> pl.Series:
    """Return numbers, null where unknown; by default, numbers that are not finite are unknown."""
    array = np.asarray(values)
    absent = ~np.isfinite(array) if there is None else ~np.asarray(there)
    return pl.Series(array).set(pl.Series(absent), None)


def symmetric(sigmas: FloatArray, between: Mapping[tuple[int, int], FloatArray]) -> FloatArray:
    """Return covariances, (N, m, m), from sigmas, (N, m), and covariances of pairs, (N,) each."""
    count, width = sigmas.shape
    found = np.zeros((count, width, width))
    found[:, range(width), range(width)] = sigmas**2
    for (i, j), values in between.items():
        found[:, i, j] = found[:, j, i] = values
    return found


def named(numbers: IntArray, names: Sequence[str]) -> pl.Series:
    """Return the names that have these numbers; a number of -1 gives null."""
    # the last one is that of -1
    chosen = np.array([*names, None], dtype=object)[numbers]
    return pl.Series(chosen.tolist(), dtype=pl.String)


def column_name(column: str, *qualifiers: str, per: str = "") -> str:
    """Return the name of a column with qualifiers before its unit, as in azimuth_sigma_deg.

    `per` is added to the unit, for example `_s` for a rate.
    """
    stem, unit = split_unit(column)
    return "_".join([stem, *qualifiers, *([unit + per] if unit else [])])


def split_unit(column: str) -> tuple[str, str]:
    """Return the name of a column without its unit, and the unit, which may be empty."""
    unit = next((unit for unit in _UNITS if column.endswith(f"_{unit}")), "")
    return column.removesuffix(f"_{unit}") if unit else column, unit


def usual_period(column: str) -> float | None:
    """Return the period of angles in the unit of a column, or of degrees if it has no unit.

    None: the unit is not that of angles.
    """
    return {"": 360.0, "deg": 360.0, "rad": 2 * math.pi}.get(split_unit(column)[1])


def by_length(
    lengths: IntArray, arrays: Sequence[npt.NDArray[Any]], call: Callable[..., Found]
) -> Iterator[tuple[IntArray, Found | ValueError]]:
    """Call a function once for all groups of one length, with arrays (groups, length, ...).

    If the call fails, the function is called for each group separately, with arrays (1, length,
    ...), because one group with bad values must not affect the other groups. Yields the groups with
    their results or, for a group without a result, with the reason. If groups are adjacent, the
    arrays are views.
    """
    starts = np.cumsum(lengths) - lengths
    ranked = np.argsort(lengths, kind="stable")
    for groups in np.split(ranked, np.flatnonzero(np.diff(lengths[ranked])) + 1):
        if len(groups):
            length = lengths[groups[0]]
            blocks = [_block(array, starts[groups], length) for array in arrays]
            yield from _each(groups, blocks, call)


def _block(array: npt.NDArray[Any], starts: IntArray, length: int) -> npt.NDArray[Any]:
    """Return the parts of an array that have this length, (parts, length, ...)."""
    count = len(starts)
    if count * length and starts[-1] - starts[0] == (count - 1) * length:
        own = array[starts[0] : starts[0] + count * length]
    else:
        own = array[starts[:, np.newaxis] + np.arange(length)]
    found: npt.NDArray[Any] = own.reshape(count, length, *array.shape[1:])
    return found


def _each(
    groups: IntArray, blocks: Sequence[npt.NDArray[Any]], call: Callable[..., Found]
) -> Iterator[tuple[IntArray, Found | ValueError]]:
    try:
        yield groups, call(*blocks)
        return
    except ValueError as error:
        if len(groups) == 1:
            yield groups, error
            return
    for k in range(len(groups)):
        yield from _each(groups[k : k + 1], [block[k : k + 1] for block in blocks], call)
