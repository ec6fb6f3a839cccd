"""Times as text and as datetimes: seconds of the day, ISO 8601, and the clock of records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import polars as pl

from tertia._arrays import FloatArray
from tertia.tables._marks import without_marks
from tertia.tables._parts import RecordError

Unit: TypeAlias = Literal["us", "ns"]

PER_SECOND = {"ms": 1e3, "us": 1e6, "ns": 1e9}
_DAY = 86_400
# largest time by which rows of a long recording may be late
_LATE = 3600.0
# %.f is an optional fraction of a second, %#z an offset or Z; the last formats are compact
_LOCAL_TIMES = (
    "%Y-%m-%dT%H:%M:%S%.f",
    "%Y-%m-%dT%H:%M",
    "%Y-%m-%d",
    "%Y%m%dT%H%M%S%.f",
)
_ZONED_TIMES = ("%Y-%m-%dT%H:%M:%S%.f%#z", "%Y-%m-%dT%H:%M%#z", "%Y%m%dT%H%M%S%.f%#z")
_OFFSET = r"T.*(Z|[+-]\d\d(:?\d\d)?)$"
_OF_DAY = r"^(?<h>\d{1,2}):(?<m>[0-5]\d)(?::(?<s>[0-5]\d(?:[.,]\d+)?))?$"
# directives of strftime that are, or are part of, a date
_DATES = ("%Y", "%y", "%D", "%F", "%s", "%c", "%j", "%x", "%v", "%+", "%G")
# a fraction of a second after a decimal comma, which ISO 8601 prefers
_COMMA = r"(\d\d),(\d+)"


def kind_of_times(times: pl.Series) -> str:
    """Return the kind of times, as text."""
    if not isinstance(times.dtype, pl.Datetime):
        return "numbers"
    return "dates" if times.dtype.time_zone is None else "dates with a time zone"


def seconds_of_text(column: pl.Series) -> pl.Series:
    """Return numbers of seconds; cells like 12:34:56.7 become seconds of the day."""
    part = column.str.extract_groups(_OF_DAY).struct
    hours, minutes, rest = (
        part.field(name).str.replace(",", ".", literal=True).cast(pl.Float64) for name in "hms"
    )
    of_day = 3600 * hours + 60 * minutes + rest.fill_null(0.0)
    seconds: pl.Series = column.cast(pl.Float64, strict=False).fill_null(of_day)
    return seconds


def are_of_day(column: pl.Series, *, formatted: bool) -> bool:
    """Return whether times that are seconds were times of day, such as 12:34:56.7.

    Text is `formatted` if it has a format of strftime.
    """
    if column.dtype != pl.String:
        return column.dtype == pl.Time
    first = without_marks(column).drop_nulls().head(1)
    return formatted or first.cast(pl.Float64, strict=False).null_count() > 0


def seconds_of_day(column: pl.Series) -> pl.Series:
    """Return times of day or durations as seconds."""
    ticks = column.cast(pl.Duration("ns")) if column.dtype == pl.Time else column
    seconds = ticks.dt.total_nanoseconds().to_numpy() / PER_SECOND["ns"]
    return pl.Series(column.name, seconds).fill_nan(None)


def exact_seconds(column: pl.Series) -> pl.Series:
    """Return numbers of seconds as text, with up to nine decimals, as exact durations."""
    ticks = column.cast(pl.Decimal(38, 9), strict=False).to_physical()
    exact: pl.Series = ticks.cast(pl.Int64, strict=False).cast(pl.Duration("ns"))
    return exact


def moments(
    column: pl.Series, first: str | None, zoned: bool | None, unit: Unit = "us"
) -> pl.Series:
    """Return ISO 8601 datetimes of the same kind as the first one; null elsewhere."""
    column, begin = (
        one.str.replace(r"\s*(UTC|GMT|Z)$", "Z")
        .str.replace(r"\s+([+-]\d\d)", "$1")
        .str.replace(" ", "T", literal=True)
        .str.replace(_COMMA, "$1.$2")
        for one in (column, pl.Series([first or ""]))
    )
    if zoned is None:
        zoned = begin.str.contains(_OFFSET)[0]
    column = column.set((column.str.contains(_OFFSET) != zoned).fill_null(False), None)
    tried = [
        column.str.to_datetime(form, time_unit=unit, strict=False)
        for form in (_ZONED_TIMES if zoned else _LOCAL_TIMES)
    ]
    return pl.select(pl.coalesce(tried)).to_series().rename(column.name)


def across_midnight(seconds: FloatArray, *, ordered: bool) -> FloatArray | None:
    """Return times of day that are counted on after midnight; None if it is not clear which.

    The seconds are in the order of the rows. It is clear if all times are then within half a day,
    or if the rows of the recording are almost `ordered` by time.
    """
    known = np.isfinite(seconds)
    day = np.round(np.diff(seconds[known], prepend=seconds[known][:1]) / _DAY)
    days = -np.cumsum(day)
    found = np.array(seconds)
    found[known] += _DAY * (days - days.min())
    near = float(np.ptp(found[known])) < _DAY / 2
    steady = ordered and float(np.diff(found[known]).min()) > -_LATE
    return found if near or steady else None


def in_format(column: pl.Series, form: str, unit: Unit) -> pl.Series:
    """Return times in a format of strftime; without a date, as seconds of the day.

    Null if a text does not have this format.
    """
    form = form.replace(".%f", "%.f")
    # Polars counts %f in nanoseconds unless the number of digits is stated
    forms = [form.replace("%f", digits) for digits in ("%3f", "%6f", "%9f")]
    is_of_day = not any(mark in form for mark in _DATES)
    tried = [
        column.str.to_time(one, strict=False)
        if is_of_day
        else column.str.to_datetime(one, time_unit=unit, strict=False)
        for one in dict.fromkeys(forms)
    ]
    found = pl.select(pl.coalesce(tried)).to_series().rename(column.name)
    return seconds_of_day(found) if is_of_day else found


@dataclass(frozen=True, slots=True)
class Clock:
    """Conversion of the times of records to seconds; since `origin`, unless they are numbers."""

    dtype: Any
    origin: int = 0
    ticks: float = 1.0

    @property
    def dated(self) -> bool:
        """Whether the times are datetimes."""
        return isinstance(self.dtype, pl.Datetime)

    @classmethod
    def of(cls, moments: pl.Series, *, midnight: bool = False) -> Clock:
        """Return the clock that starts at the first of some datetimes, or at midnight before it.

        Times may also be durations; null is not a time.
        """
        known = moments.drop_nulls()
        if not isinstance(moments.dtype, (pl.Datetime, pl.Duration)) or known.is_empty():
            return cls(moments.dtype)
        ticks = PER_SECOND[moments.dtype.time_unit]
        first, day = int(known.to_physical().to_numpy().min()), int(_DAY * ticks)
        return cls(moments.dtype, first // day * day if midnight else first, ticks)

    def seconds(self, moments: pl.Series) -> FloatArray:
        """Return times as seconds; nan where null."""
        if not isinstance(self.dtype, (pl.Datetime, pl.Duration)):
            return np.asarray(moments.to_numpy(), dtype=np.float64)
        same = moments if moments.dtype == self.dtype else moments.cast(self.dtype)
        since: FloatArray = (same.to_physical() - self.origin).to_numpy() / self.ticks
        return since

    def moments(self, seconds: FloatArray) -> pl.Series:
        """Return seconds as times; dates are null where the seconds are nan."""
        if not self.dated:
            return pl.Series(self.origin / self.ticks + seconds)
        there = np.isfinite(seconds)
        after = np.rint(np.where(there, seconds, 0.0) * self.ticks).astype(np.int64)
        moments: pl.Series = pl.Series(self.origin + after).cast(self.dtype)
        return moments if there.all() else moments.set(pl.Series(~there), None)


def common_clock(times: Sequence[tuple[str, pl.Series]]) -> Clock:
    """Return the clock of two columns `time_s` with the names of their tables, of one kind."""
    (one, first), (two, second) = times
    kinds = kind_of_times(first), kind_of_times(second)
    if kinds[0] != kinds[1]:
        raise RecordError(
            f"time_s holds {kinds[0]} in {one} and {kinds[1]} in {two}; both must be of one kind",
            column="time_s",
        )
    both = [each.to_frame("time") for each in (first, second)]
    return Clock.of(pl.concat(both, how="vertical_relaxed")["time"])
