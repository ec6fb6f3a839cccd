"""Processing of groups that arrive in batches."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt
import polars as pl
import polars.selectors as cs

from tertia.tables._frames import Table, height, joined, part
from tertia.tables._groups import as_names, run_starts
from tertia.tables._parts import Part
from tertia.tables._records import Reader


def stream(
    function: Callable[..., Table],
    batches: Iterable[Table],
    *,
    by: str | Sequence[str] = (),
    **options: Any,
) -> Iterator[Table]:
    """Apply a function of this module to a table that arrives in batches.

    Two batches and the rows of one incomplete group are in memory at the same time. The function
    runs in a thread of its own while the next batch is read and the previous result is used;
    therefore each result is returned one batch later.

    Parameters
    ----------
    function : callable
        `bearing`, `screen`, `fuse_series` or `smooth`.
    batches : iterable of tables of one kind
        Batches of consecutive rows. The rows of a group must be consecutive, but may extend over
        several batches.
    by : str or sequence of str
        Columns whose values identify the groups; by default all rows are one group, which is
        complete at the end of the batches.
    **options
        Parameters of the function.

    Returns
    -------
    iterator of tables of the same kind
        The results of the function for complete groups.

    Raises
    ------
    ValueError
        If the rows of a group are not consecutive, or the function raises it.
    TypeError
        As for the function.

    Examples
    --------
    >>> import polars as pl
    >>> from tertia.tables import bearing, stream
    >>> rows = [("A", 10.0)] * 3 + [("A", 11.0)] * 3 + [("B", 50.0)] * 6
    >>> table = pl.DataFrame(rows, ["sensor", "azimuth_deg"], orient="row")
    >>> batches = [table[:5], table[5:7], table[7:]]
    >>> for found in stream(bearing, batches, by="sensor", method="mean"):
    ...     print(found["sensor"].to_list(), found["azimuth_deg"].round(1).to_list())
    ['A'] [10.5]
    ['B'] [50.0]
    """
    keys = as_names(by)
    complete = _complete(batches, keys, options.get("columns") or {})
    with ThreadPoolExecutor(1) as worker:
        under_way: Future[Table] | None = None
        for table in complete:
            started = worker.submit(function, table, by=keys, **options)
            if under_way is not None:
                yield under_way.result()
            under_way = started
        if under_way is not None:
            yield under_way.result()


def _complete(
    batches: Iterable[Table], keys: Sequence[str], columns: Mapping[str, str]
) -> Iterator[Table]:
    """Yield the rows of complete groups."""
    begun = _Begun()
    held: list[Table] = []
    last: pl.DataFrame | None = None
    for batch in batches:
        frame = Reader(Part(batch), {}, columns).groups(keys)
        if not height(batch):
            continue
        starts = run_starts(frame) if keys else np.zeros(1, dtype=np.int64)
        groups = frame[starts] if keys else frame
        goes_on = last is not None and groups[:1].equals(last)
        begun.add(groups[1:] if goes_on else groups)
        last = groups[-1:]
        if len(starts) == 1 and (goes_on or not held):
            held.append(batch)
            continue
        yield joined([*held, part(batch, 0, int(starts[-1]))])
        held = [part(batch, int(starts[-1]))]
    if held:
        yield joined(held)


class _Begun:
    """The groups seen so far: a hash of eight bytes for each, in sorted arrays."""

    def __init__(self) -> None:
        self.sorted: list[npt.NDArray[np.uint64]] = []

    def add(self, groups: pl.DataFrame) -> None:
        """Add groups; refuse one that has been added before."""
        if not groups.width or not groups.height:
            return
        hashes = groups.with_columns(cs.categorical().cast(pl.String)).hash_rows().to_numpy()
        own, first = np.unique(hashes, return_index=True)
        again = np.ones(len(hashes), dtype=bool)
        again[first] = False
        for those in self.sorted:
            place = np.minimum(np.searchsorted(those, hashes), len(those) - 1)
            again |= those[place] == hashes
        if again.any():
            group = groups.row(int(np.argmax(again)))
            raise ValueError(
                f"the rows of the group {group} are not consecutive: sort the rows by the columns "
                "of `by`"
            )
        self.sorted.append(own)
        # small arrays are merged, so that there are only a few arrays
        while len(self.sorted) > 1 and len(self.sorted[-2]) < 2 * len(self.sorted[-1]):
            self.sorted[-2:] = [np.sort(np.concatenate(self.sorted[-2:]))]
