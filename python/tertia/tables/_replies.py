"""Transponder replies, except for the identity, which is used to associate plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
import polars as pl

from tertia._arrays import FloatArray, IntArray
from tertia.tables._records import Field, Schema, identity_texts

REPLIES: Schema = {
    "mode_3a": Field("identity", {"mode_3a": 8}),
    "callsign": Field("name", {"callsign": 1.0}),
}
# seconds after which the replies of a target are forgotten
_REMEMBERED = 3600.0


# replies by their columns
Columns: TypeAlias = Mapping[str, pl.Series]


def replies_of(rows: pl.DataFrame, names: Sequence[str]) -> Columns:
    """Return these replies of plots in the form of files; null where there is none."""
    found = {"callsign": rows["callsign"].cast(pl.String)}
    if "mode_3a" in names:
        found["mode_3a"] = identity_texts(rows["mode_3a"].to_numpy(), "mode_3a")
    return {name: found[name] for name in names}


def of_plots(replies: Columns, plot: IntArray) -> Columns:
    """Return the replies of some plots; null where the index is negative."""
    index = pl.Series(plot)
    index = index.set(index < 0, None)
    return {name: column.gather(index) for name, column in replies.items()}


class Replies:
    """The last replies of targets, for the rows of their tracks."""

    def __init__(self) -> None:
        self._last: pl.DataFrame | None = None

    def known(self, time: FloatArray, track: IntArray, own: Columns) -> Columns:
        """Return the replies of the target of each row that are known by the time of the row.

        `own` are the replies of the plots of the rows, null where there is none. The rows must be
        later than those of the previous call.
        """
        order = np.argsort(time, kind="stable")
        rows = pl.DataFrame({"_time": time, "_track": track, **own})[order]
        if self._last is not None:
            rows = pl.concat([self._last, rows], how="diagonal")
        rows = rows.with_columns(pl.col(list(own)).forward_fill().over("_track"))
        newest = float(np.max(time, initial=-np.inf))
        self._last = rows.filter(pl.col("_time") > newest - _REMEMBERED).unique(
            "_track", keep="last", maintain_order=True
        )
        found = rows[rows.height - len(time) :][np.argsort(order, kind="stable")]
        return {name: found[name] for name in own}
