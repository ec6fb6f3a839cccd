"""Identities of plots and tracks in tables: a column for each kind."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl

from tertia._arrays import IntArray
from tertia.sensors._identities import NO_CALLSIGN, NO_IDENTITY, is_known
from tertia.tables._records import IDENTITIES, Field, Records, Schema

# as many kinds as a target has
IDENTIFIED: Schema = {
    "icao_address": Field("identity", {"icao_address": 16}),
    "mode_3a": Field("identity", {"mode_3a": 8}),
    "callsign": Field("callsign", {"callsign": 1.0}),
    "identity": Field("identity", {"identity": 10}),
}
_DIGITS = {16: "{:06X}", 8: "{:04o}"}


def identities_in(records: Records) -> list[str]:
    """Return the kinds of identities that records have; `identity` if they have none."""
    known = identities_of(records.rows)
    return [name for name in IDENTIFIED if name in records.column or name in known] or ["identity"]


def identities_of(rows: pl.DataFrame) -> dict[str, Any]:
    """Return the kinds of identities that rows have, as `Plots` and `SensorTracks` take them."""
    columns: dict[str, Any] = {name: rows[name].to_numpy() for name in IDENTIFIED}
    # faster than fill_null, above all for the few rows of a stream
    columns["callsign"] = np.array(
        [text or NO_CALLSIGN for text in rows["callsign"].to_list()], np.str_
    )
    return {name: column for name, column in columns.items() if np.any(is_known(column))}


def identity_columns(table: Any, names: Sequence[str]) -> dict[str, pl.Series]:
    """Return these kinds of identities of tracks as columns of files."""
    return {
        name: _callsigns(table.callsign)
        if name == "callsign"
        else identity_texts(getattr(table, name), name)
        for name in names
    }


def identity_texts(numbers: IntArray, name: str) -> pl.Series:
    """Return identities in the spelling of a column; null where there is none."""
    digits = _DIGITS.get(IDENTITIES[name])
    if digits is None:
        return pl.Series(numbers).set(pl.Series(numbers == NO_IDENTITY), None)
    texts = [None if n == NO_IDENTITY else digits.format(n) for n in numbers.tolist()]
    return pl.Series(texts, dtype=pl.String)


def _callsigns(texts: Any) -> pl.Series:
    column = pl.Series(texts.tolist(), dtype=pl.String)
    return column.set(column == NO_CALLSIGN, None)
