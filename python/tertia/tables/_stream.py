"""Processing of groups that arrive in batches."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import polars as pl

from tertia.tables._frames import Table, height, joined, part
from tertia.tables._groups import as_names
from tertia.tables._records import Part, Reader


def stream(
    function: Callable[..., Table],
    batches: Iterable[Table],
    *,
    by: str | Sequence[str] = (),
    **options: Any,
) -> Iterator[Table]:
    """Apply a function of this module to a table that arrives in batches.

    Memory holds one batch and the rows of one incomplete group.

    Parameters
    ----------
    function : callable
        `bearing`, `screen`, `fuse_series` or `smooth`.
    batches : iterable of tables of one kind
        Consecutive rows. The rows of a group must be consecutive, but may extend over several
        batches.
    by : str or sequence of str
        Columns whose values group the rows; by default all rows are one group, which is complete
        when the batches end.
    **options
        Parameters of the function.

    Returns
    -------
    iterator of tables of the same kind
        The results of the function for complete groups.

    Raises
    ------
    ValueError
        A group whose rows are not consecutive, or an error of the function.
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
    keys, begun = as_names(by), set[int]()
    held: list[Table] = []
    last: str | None = None
    for batch in batches:
        frame = Reader(Part(batch), {}, options.get("columns") or {}).groups(keys)
        if not height(batch):
            continue
        starts, groups = _runs(frame, keys)
        goes_on = groups[0] == last
        _begin(groups[1:] if goes_on else groups, begun)
        last = groups[-1]
        if len(groups) == 1 and (goes_on or not held):
            held.append(batch)
            continue
        complete = part(batch, 0, starts[-1])
        yield function(joined([*held, complete]), by=keys, **options)
        held = [part(batch, starts[-1])]
    if held:
        yield function(joined(held), by=keys, **options)


def _runs(frame: pl.DataFrame, by: Sequence[str]) -> tuple[list[int], list[str]]:
    """Return the start of each group in a batch, and its name."""
    if not by:
        return [0], [""]
    run = frame.select(pl.struct(by).rle_id().alias("")).get_column("")
    starts = run.search_sorted(pl.arange(0, int(run[-1]) + 1, eager=True)).to_list()
    named = list(map(str, frame[starts].rows()))
    return starts, named


def _begin(groups: Sequence[str], begun: set[int]) -> None:
    """Refuse a group that has ended; only hashes of groups are kept, to save memory."""
    for group in groups:
        if hash(group) in begun:
            raise ValueError(
                f"the rows of the group {group} do not come one after the other: sort them by it"
            )
        begun.add(hash(group))
