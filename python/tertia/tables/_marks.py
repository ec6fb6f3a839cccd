"""Cells whose text marks a missing value."""

from __future__ import annotations

import polars as pl

_MARKS = ("", "-", "na", "nan", "null", "none")


def is_mark(text: str) -> bool:
    """Return whether a text marks a missing value."""
    return text.strip().lower() in _MARKS


def unmarked(column: pl.Expr) -> pl.Expr:
    """Return a text without surrounding spaces; null if the text marks a missing value."""
    text = column.str.strip_chars()
    return pl.when(~text.str.to_lowercase().is_in(_MARKS)).then(text)


def without_marks(column: pl.Series) -> pl.Series:
    """Return a column of text without surrounding spaces and with null for missing values."""
    return column.to_frame().select(unmarked(pl.first())).to_series()


def names_without_marks(column: pl.Series) -> pl.Series:
    """Return the same as `without_marks`, but faster if there are few different names."""
    each = column.unique()
    return column if without_marks(each).equals(each) else without_marks(column)
