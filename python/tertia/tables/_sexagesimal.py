"""Angles as text in degrees, minutes and seconds."""

from __future__ import annotations

import math

import polars as pl

_SIGN = r"^(?<sign>[+-]?)(?<before>[NSEW]?)\s*"
_WHOLE, _DECIMAL = r"[0-5]?\d", r"[0-5]?\d(?:[.,]\d+)?"
_AFTER = r"\s*(?<after>[NSEW]?)$"
# with marks, as 50°05'12.3"N or 14.26°; and without, as 123-27-10.2 or 123 27 10.2
_MARKED = (
    rf"{_SIGN}(?<d>\d{{1,3}}(?:[.,]\d+)?)\s*[°ºd](?:\s*(?<m>{_DECIMAL})\s*['′’m]"
    rf"(?:\s*(?<s>{_DECIMAL})\s*(?:[\"″”s]|''))?)?{_AFTER}"
)
_PLAIN = rf"{_SIGN}(?<d>\d{{1,3}})[ :-](?<m>{_WHOLE})[ :-](?<s>{_DECIMAL}){_AFTER}"
# packed as in NMEA 0183 and in flight plans, 5005.205N or 500512N
_PACKED = (
    r"^(?<sign>)(?<before>)(?<d>\d{2,3})(?<m>[0-5]\d(?:[.,]\d+)?)(?<s>[0-5]\d(?:[.,]\d+)?)?"
    r"(?<after>[NSEW])$"
)
_NEGATIVE = ("-", "S", "W")


def degrees_of_text(column: pl.Series) -> pl.Series:
    """Return the angles of texts such as 123°27'10.2" in degrees; null for any other text.

    South and west are negative. Bearings of a quadrant, such as N45°E, are not accepted.
    """
    part = pl.col("text").str.extract_groups(_PACKED)
    for form in (_PLAIN, _MARKED):
        found = pl.col("text").str.extract_groups(form)
        part = pl.when(found.struct.field("d").is_null()).then(part).otherwise(found)
    d, m, s = (
        part.struct.field(name).str.replace(",", ".", literal=True).cast(pl.Float64)
        for name in "dms"
    )
    letters = [part.struct.field(name) for name in ("sign", "before", "after")]
    sizes = d + m.fill_null(0.0) / 60 + s.fill_null(0.0) / 3600
    negative = pl.any_horizontal(one.is_in(_NEGATIVE) for one in letters)
    # a sign and a letter, or two letters, contradict each other
    several = pl.sum_horizontal((one != "").cast(pl.Int8) for one in letters) > 1
    angle = pl.when(~several).then(pl.when(negative).then(-sizes).otherwise(sizes))
    return column.alias("text").to_frame().select(angle).to_series()


def angle_of_text(text: str) -> float:
    """Return the angle of one text in degrees; nan if it is none."""
    found = degrees_of_text(pl.Series([text.strip()], dtype=pl.String)).item()
    return math.nan if found is None else float(found)
