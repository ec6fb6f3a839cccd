"""Detections of plots, converted from the names that files use."""

from __future__ import annotations

import numpy as np
import polars as pl

from tertia._arrays import IntArray
from tertia.sensors._channels import DETECTIONS, NO_DETECTION
from tertia.tables._records import Field, Records, Schema

DETECTION: Schema = {"detection": Field("name", {"detection": 1.0})}
# other names, from ASTERIX (I001/020, I048/020)
_OTHERS = {
    "ssr+psr": "psr+ssr",
    "mode-s-all-call": "mode-s",
    "mode-s-roll-call": "mode-s",
    "mode-s-all-call+psr": "psr+mode-s",
    "mode-s-roll-call+psr": "psr+mode-s",
}
# a report without a detection; the command leaves it out
_NONE = "none"
_CODES = {name: code for code, name in enumerate(DETECTIONS)}
_CODES |= {other: _CODES[name] for other, name in _OTHERS.items()}


def refuse_unknown(records: Records) -> None:
    """Raise an error for rows in which the name of the detection is unknown."""
    if "detection" in records.column:
        names = pl.col("detection").cast(pl.String).str.to_lowercase()
        records.refuse(
            ~names.is_in([*_CODES, _NONE]),
            f"detection is {{detection}}; it must be one of {', '.join(DETECTIONS)}",
            records.column["detection"],
        )


def detections_of(rows: pl.DataFrame) -> IntArray:
    """Return the detections of plots as indices; an unknown detection is -1."""
    if "detection" not in rows.columns:
        return np.full(rows.height, NO_DETECTION)
    names = rows["detection"].cast(pl.String).str.to_lowercase()
    codes = names.replace_strict(_CODES, default=NO_DETECTION, return_dtype=pl.Int64)
    found: IntArray = codes.fill_null(NO_DETECTION).to_numpy()
    return found
