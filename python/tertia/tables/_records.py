"""Records of every kind: one reader for tables and files, controlled by a schema.

A schema lists the quantities of a record, the columns that may hold each, and their units.
`columns` maps standard column names to those of a table. All errors are `RecordError`.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import polars as pl

from tertia.sensors._identities import NO_IDENTITY
from tertia.tables._doubts import doubt, doubt_clock, doubt_summer_time, doubt_time, doubt_unit
from tertia.tables._frames import height, names, series
from tertia.tables._marks import names_without_marks, unmarked, without_marks
from tertia.tables._names import misspelt, own_names, states_other_unit
from tertia.tables._parts import ColumnError, Part, RecordError, Source
from tertia.tables._sexagesimal import degrees_of_text
from tertia.tables._times import (
    Unit,
    across_midnight,
    are_of_day,
    exact_seconds,
    in_format,
    kind_of_times,
    moments,
    seconds_of_day,
    seconds_of_text,
)

_LOG = logging.getLogger("tertia.tables")
# bases of identities: decimal numbers, mode 3/A codes in octal, 24-bit addresses in hexadecimal
IDENTITIES = {"icao_address": 16, "mode_3a": 8, "identity": 10}
# kinds of quantities that tell rows of several sensors or targets apart
_LABELS = {"name", "identity", "callsign"}
_HALF_DAY = 43_200.0
# in seconds; double precision resolves larger numbers less finely than by a nanosecond
_COARSE = 2.0**22
_SPELLING = {16: "hexadecimal digits", 8: "octal digits", 10: "a whole number, 0 or more"}
# bits of identities, by the base of their digits
_BITS = {16: 24, 8: 12, 10: 63}
# cells of columns of flags, in lower case
_TRUE, _FALSE = ("true", "t", "yes", "y", "1", "1.0"), ("false", "f", "no", "n", "0", "0.0")
_AS_OTHERS = "a number of seconds or a date with time, like the other times"
_SAY_FORMAT = "; or give --time-format, for example %d.%m.%Y %H:%M:%S"

# an arrival is a time with nanoseconds
Kind: TypeAlias = Literal["number", "time", "arrival", "name", "identity", "callsign", "flag"]


@dataclass(frozen=True, slots=True)
class Field:
    """A quantity, and the columns that may hold it; the first of them that is present is used.

    Each column has a factor to the unit of the library (for identities, the base). `required`: one
    of the columns must be present. `whole`: no cell may be missing. `positive`: numbers must be
    positive. `most`: largest absolute value, in the unit of the column. `standard`: the column has
    a standard name, not one that an option gives. `judged`: whether the size of the values may show
    that the unit is wrong. `unavailable`: the number that stands for a missing value, by column.
    """

    kind: Kind
    columns: Mapping[str, float]
    required: bool = False
    whole: bool = False
    positive: bool = False
    most: float = math.inf
    standard: bool = True
    judged: bool = True
    unavailable: Mapping[str, float] | None = None


Schema: TypeAlias = Mapping[str, Field]


def number(*columns: str, **options: Any) -> Field:
    """Return a field of numbers in the units of the library."""
    return Field("number", dict.fromkeys(columns, 1.0), **options)


def _available(found: pl.Series, field: Field, name: str) -> pl.Series:
    """Return numbers with nan in place of the number that stands for a missing value."""
    absent = (field.unavailable or {}).get(name)
    return found if absent is None else found.set(found == absent, math.nan)


TIME = Field("time", {"time_s": 1.0}, required=True, whole=True)
SENSOR = Field("name", {"sensor": 1.0}, whole=True)


@dataclass(frozen=True, slots=True)
class Records:
    """The rows of all parts by quantity, in the units of the library; missing numbers are nan.

    `rows` also has the columns `part` and `row`, the origin of each row. `column` is the column in
    the files that holds a quantity (in the first file that has it), `standard` are the standard
    names of such columns, one for each file, and `by` are the columns that group the rows.
    """

    rows: pl.DataFrame
    column: Mapping[str, str]
    standard: Mapping[str, Sequence[str]]
    source: Source
    by: pl.DataFrame

    def refuse(self, wrong: pl.Series | pl.Expr, reason: str, column: str | None = None) -> None:
        """Refuse the first wrong row; `reason` is formatted with its quantities."""
        at = self.rows.select(wrong).to_series().arg_true()
        if len(at):
            row = self.rows.row(at[0], named=True)
            said = reason.format(**row) + _such(len(at))
            raise self.source[row["part"]].error(said, row["row"], column)


def _such(count: int) -> str:
    """Return the end of a message about the first of so many wrong rows."""
    return f" ({count} such rows)" if count > 1 else ""


def read(
    source: Source,
    schema: Schema,
    *,
    columns: Mapping[str, str] | None = None,
    by: Sequence[str] = (),
    sensors: Sequence[str] | None = None,
    results: Sequence[str] = (),
) -> Records:
    """Read records by their schema; `columns` maps standard names to those of a table.

    If the names of `sensors` are given, the quantity `sensor` is an index into them. Columns of
    `by` must not have names that are in `results`.
    """
    called = _called(schema, columns, by, results)
    _doubt_both(source, called)
    readers = [Reader(part, schema, own_names(part, source, called), sensors) for part in source]
    frames = [reader.rows(number) for number, reader in enumerate(readers)]
    for reader, frame in zip(readers, frames, strict=True):
        taken = ", ".join(f"{what} from {name}" for what, name in reader.taken.items())
        _LOG.info("%d rows of %s: %s", frame.height, reader.part.called, taken)
    for reader in readers[1:]:
        _require_alike(readers[0], reader)
    rows = _after_midnight(pl.concat(frames, how="vertical_relaxed"), readers)
    keys = [reader.groups(by) for reader in readers]
    for reader, frame, own in zip(readers, frames, keys, strict=True):
        reader.doubt_clocks(frame, own)
    groups = pl.concat(_alike(keys), how="vertical_relaxed")
    # the first file that has a column takes precedence
    column = {what: name for one in reversed(readers) for what, name in one.taken.items()}
    standard = {
        what: [one.standard[what] for one in readers if what in one.standard] for what in column
    }
    return Records(rows, column, standard, source, groups)


def _called(
    schema: Schema,
    columns: Mapping[str, str] | None,
    by: Sequence[str],
    results: Sequence[str],
) -> dict[str, str]:
    """Return the names of columns; refuse a name that is given for two purposes."""
    called = dict(columns or {})
    known = list(dict.fromkeys([name for one in schema.values() for name in one.columns]))
    for name in called:
        if name not in known and name not in by:
            raise ColumnError(
                f"columns has {name!r}; it must be one of {', '.join([*known, *by])}", column=name
            )
    # a column may hold several quantities
    used = dict.fromkeys(
        name for one in schema.values() for name in one.columns if one.required or name in called
    )
    needed = [called.get(name, name) for name in [*used, *by]]
    for at, name in enumerate(needed):
        if name in needed[:at]:
            raise ColumnError(f"the column {name} is given for two purposes", column=name)
    for name in by:
        if name in results:
            raise ColumnError(
                f"cannot group by {name}: the results have a column of this name", column=name
            )
    for name, column in called.items():
        if states_other_unit(name, column):
            doubt(f"{column} is read as {name}, but its name states another unit")
    return called


def _doubt_both(source: Source, called: Mapping[str, str]) -> None:
    """Warn if a file has a column under two names, of which another file has only one."""
    for name, column in called.items():
        if all(part.has(column) for part in source):
            continue
        for part in source:
            if part.has(column) and part.column(name) != part.column(column) and part.has(name):
                doubt(f"{part.called} has {name} and {column}: {column} is used")


def _after_midnight(rows: pl.DataFrame, readers: Sequence[Reader]) -> pl.DataFrame:
    """Return the rows with times of day that are counted on after midnight, with a warning."""
    for quantity in {name for one in readers for name in one.of_day}:
        if not all(quantity in one.of_day for one in readers if quantity in one.taken):
            continue
        seconds = rows[quantity].cast(pl.Float64).fill_null(math.nan).to_numpy()
        if not np.any(np.diff(seconds[np.isfinite(seconds)]) < -_HALF_DAY):
            continue
        found = across_midnight(seconds, ordered=len(readers) == 1)
        called = readers[0].part.called if len(readers) == 1 else "the files"
        if found is None:
            doubt(
                f"{called}: the time of day decreases by more than 12 hours; if the recording "
                "passes midnight, give times with dates"
            )
            continue
        doubt(f"{called}: times of day after midnight are counted on from 86400 seconds")
        there = pl.Series(quantity, found).fill_nan(None)
        rows = rows.with_columns(there)
    return rows


def _require_alike(first: Reader, other: Reader) -> None:
    """Refuse files whose times, or identities, are of different kinds."""
    one, two = first.part.called, other.part.called
    for quantity in first.times_are | other.times_are:
        kinds = [each.times_are.get(quantity) for each in (first, other)]
        # times of arrival may be in one of the files only
        if kinds[0] != kinds[1] and (quantity == "time" or None not in kinds):
            name = first.taken.get(quantity, "time_s")
            found = " and ".join(
                f"{kind or 'no times'} in {file}"
                for kind, file in zip(kinds, (one, two), strict=True)
            )
            reason = f"{name} holds {found}; all must be of one kind"
            raise RecordError(reason, column=name)
    several = "identity" in first.schema and len(first.schema["identity"].columns) > 1
    kinds = [each.taken.get("identity") for each in (first, other)]
    if several and kinds[0] != kinds[1]:
        found = f"{one} has {kinds[0] or 'no identities'}, {two} {kinds[1] or 'none'}"
        raise RecordError(f"{found}; all must have the same kind")


def _alike(frames: list[pl.DataFrame]) -> list[pl.DataFrame]:
    """Return columns as text if files do not agree on their types."""
    for name in frames[0].columns:
        if len({frame[name].dtype for frame in frames}) > 1:
            frames = [frame.with_columns(pl.col(name).cast(pl.String)) for frame in frames]
    return frames


class Reader:
    """Reads the columns of one part.

    If `problems` is None, the first bad row is an error; otherwise the reason for each bad row is
    added to it. `like` is a column of times; the times of this part must be of the same kind.
    """

    def __init__(
        self,
        part: Part,
        schema: Schema,
        called: Mapping[str, str],
        sensors: Sequence[str] | None = None,
        *,
        like: pl.DataType | None = None,
        problems: dict[int, str] | None = None,
    ) -> None:
        self.part, self.schema, self.called, self.sensors = part, schema, called, sensors
        self.like, self.problems = like, problems
        self.taken: dict[str, str] = {}
        self.standard: dict[str, str] = {}
        # kinds of the times, by quantity, and the quantities that are times of day
        self.times_are: dict[str, str] = {}
        self.of_day: set[str] = set()

    def rows(self, number: int = 0) -> pl.DataFrame:
        """Return the quantities of all rows, with the numbers of the part and of the row."""
        count = height(self.part.table)
        missing = [tuple(f.columns) for name, f in self.schema.items() if self._is_missing(name, f)]
        if len(missing) > 1:
            raise self.part.lacks_all(missing)
        found = {name: self._column(name, one, count) for name, one in self.schema.items()}
        place = {
            "part": pl.repeat(number, count, dtype=pl.Int64, eager=True),
            "row": pl.int_range(count, dtype=pl.Int64, eager=True),
        }
        return pl.DataFrame(found | place)

    def groups(self, by: Sequence[str]) -> pl.DataFrame:
        """Return the columns that group the rows, unchanged."""
        for name in by:
            self.part.require(self.called.get(name, name))
        return pl.DataFrame({name: self.part.series(self.called.get(name, name)) for name in by})

    def doubt_clocks(self, rows: pl.DataFrame, groups: pl.DataFrame) -> None:
        """Warn if clocks were changed while the rows were recorded."""
        for quantity in self.times_are:
            name, times = self.standard[quantity], rows[quantity]
            if not doubt_summer_time(name, times) and quantity == "time":
                labels = [rows[what] for what, one in self.schema.items() if one.kind in _LABELS]
                doubt_clock(name, times, [*labels, *groups.get_columns()])

    def _is_missing(self, quantity: str, one: Field) -> bool:
        """Return whether a required column with a standard name is missing."""
        given = any(name in self.called for name in one.columns)
        is_of_several = quantity == "sensor" and self.sensors is not None and self._own is None
        return (
            (one.required or is_of_several)
            and one.standard
            and not given
            and not any(self.part.has(name) for name in one.columns)
        )

    def _column(self, quantity: str, one: Field, count: int) -> pl.Series:
        given = [name for name in one.columns if name in self.called]
        there = [name for name in one.columns if self.part.has(name)]
        if given or (one.required and not there):
            columns = (self.called.get(name, name) for name in given or one.columns)
            self.part.require(*columns, standard=one.standard and not given)
        name = next(iter(given or there), None)
        if quantity == "sensor" and self.sensors is not None:
            return self._sensors(name, count)
        if name is None and quantity == "sensor":
            # each file belongs to one sensor
            if self.part.name is None:
                self.part.require("sensor", standard=True)
            return pl.repeat(self.part.name, count, dtype=pl.String, eager=True)
        if name is None:
            known = [name for each in self.schema.values() for name in each.columns]
            known += self.called.values()
            said = misspelt(
                tuple(one.columns),
                known,
                names(self.part.table),
                self.part.option,
                shell=self.part.file is not None,
            )
            if said and self.problems is None:
                doubt(f"{self.part.called} {said}")
            return _absent(one.kind, count)
        column = self.part.column(self.called.get(name, name))
        self.taken[quantity] = name if one.kind == "identity" else column
        self.standard[quantity] = name
        values = series(self.part.table, column).alias(column)
        return self._values(quantity, values, one, name)

    def _values(self, quantity: str, values: pl.Series, one: Field, name: str) -> pl.Series:
        if one.kind in {"time", "arrival"}:
            found = self.times(values, "us" if one.kind == "time" else "ns")
            self.times_are[quantity] = kind_of_times(found)
            if self.problems is None:
                doubt_time(name, found)
                formatted = self.part.time_format is not None
                if found.dtype.is_numeric() and are_of_day(values, formatted=formatted):
                    self.of_day.add(quantity)
        elif one.kind == "name":
            found = names_without_marks(values.cast(pl.String))
        elif one.kind == "callsign":
            found = self.callsigns(values)
        elif one.kind == "flag":
            found = self.flags(values)
        elif one.kind == "identity":
            found = self.identities(values, name)
        else:
            found = self.numbers(values, positive=one.positive, degrees=name.endswith("_deg"))
            found = _available(found, one, name)
            if one.most < math.inf:
                self._refuse_beyond(found, one.most, name)
            if self.problems is None and one.judged:
                doubt_unit(name, found)
            if one.columns[name] != 1.0:
                found = found * one.columns[name]
        if one.whole:
            missing = found.is_nan() if one.kind == "number" else found.is_null()
            self.refuse(missing, f"{values.name} is missing", values.name)
        return found

    def _refuse_beyond(self, found: pl.Series, most: float, name: str) -> None:
        """Refuse numbers whose size is larger than `most`."""
        allowed = f"it must be between {-most:g} and {most:g}"
        if "latitude" in name:
            allowed += " (is it swapped with the longitude, or in degrees and minutes?)"
        beyond = (found.abs() > most) & found.is_finite()
        self.refuse(beyond, f"{found.name} is {{:g}}; {allowed}", found)

    @property
    def _own(self) -> int | None:
        """Index of the sensor to which all rows belong if there is no column of sensors."""
        known = list(self.sensors or ())
        own = [k for k, other in enumerate(known) if self.part.name == other or len(known) == 1]
        return next(iter(own), None)

    def _sensors(self, name: str | None, count: int) -> pl.Series:
        """Return the indices of sensors; one sensor, or a file of its name, needs no column."""
        known = list(self.sensors or ())
        if name is None:
            if self._own is None:
                self.part.require(*SENSOR.columns, standard=True)
            return pl.repeat(self._own, count, dtype=pl.Int64, eager=True)
        column = self.part.column(self.called.get(name, name))
        found = names_without_marks(series(self.part.table, column).cast(pl.String))
        numbers = dict(zip(known, range(len(known)), strict=True))
        known_numbers: pl.Series = found.replace_strict(
            numbers, default=None, return_dtype=pl.Int64
        )
        if known_numbers.null_count():
            self.refuse(found.is_null(), f"{column} is missing", column)
            unknown = known_numbers.is_null() & found.is_not_null()
            self.refuse(unknown, f"{column} is {{!r}}; the sensors are {', '.join(known)}", found)
        return known_numbers

    def refuse(self, wrong: pl.Series, reason: str, values: pl.Series | str) -> None:
        """Refuse the wrong rows; `reason` is formatted with the value."""
        if not wrong.any():
            return
        rows = wrong.fill_null(False).arg_true()
        column = values if isinstance(values, str) else values.name

        def said(row: int) -> str:
            return reason if isinstance(values, str) else reason.format(values[row])

        if self.problems is not None:
            for row in rows.to_list():
                self.problems.setdefault(row, said(row))
            return
        raise self.part.error(said(rows[0]) + _such(len(rows)), rows[0], column)

    def numbers(
        self, values: pl.Series, *, positive: bool = False, degrees: bool = False
    ) -> pl.Series:
        """Return numbers, or angles that may have minutes and seconds; nan where missing."""
        if values.dtype == pl.String:
            values = without_marks(values)
        elif not (values.dtype.is_numeric() or values.dtype == pl.Null):
            raise self.part.error(
                f"{values.name} holds {values.dtype}, not numbers", None, values.name
            )
        if values.dtype == pl.Float64:
            plain = values.to_numpy()  # nan where null
            if not (np.isinf(plain).any() or (positive and (plain <= 0).any())):
                return values.fill_null(math.nan) if values.null_count() else values
        found: pl.Series = values.cast(pl.Float64, strict=False)
        if values.dtype.is_float():
            values = values.fill_nan(None)
        bad = values.is_not_null() & ~found.is_finite().fill_null(False)
        if values.dtype == pl.String and bad.any():
            text = values.str.replace("−", "-", literal=True)
            others = text.cast(pl.Float64, strict=False)
            if degrees:
                others = others.fill_null(degrees_of_text(text))
            found = found.fill_null(others)
            bad &= ~found.is_finite().fill_null(False)
        self.refuse(bad, f"{values.name} is {{!r}}; it must be a finite number", values)
        if positive:
            self.refuse(found <= 0, f"{values.name} is {{:g}}; it must be positive", found)
        return found.fill_null(math.nan)

    def times(self, values: pl.Series, unit: Unit = "us") -> pl.Series:
        """Return times as numbers or as datetimes; null where missing.

        If the unit is ns, datetimes have this unit, and large numbers in text become durations.
        """
        name, fine = values.name, unit == "ns"
        if isinstance(values.dtype, (pl.Date, pl.Datetime)):
            dates = values
            if fine or values.dtype == pl.Date:
                dates = values.cast(pl.Datetime(unit, getattr(values.dtype, "time_zone", None)))
            # time zones of several files may differ
            if self.part.file is None or kind_of_times(dates) == "dates":
                return dates
            return dates.dt.convert_time_zone("UTC")
        if isinstance(values.dtype, (pl.Time, pl.Duration)):
            return seconds_of_day(values)
        if values.dtype != pl.String:
            if not (values.dtype.is_numeric() or values.dtype == pl.Null):
                raise self.part.error(
                    f"{name} holds {values.dtype}, neither numbers nor dates", None, name
                )
            # integers are kept as integers
            found = values.fill_nan(None) if values.dtype.is_float() else values
            bad = found.is_not_null() & ~found.is_finite()
            self.refuse(bad, f"{name} is {{!r}}; it must be a finite number", found)
            return found.cast(pl.Float64) if found.dtype == pl.Null else found
        values = without_marks(values)
        first = values.drop_nulls().head(1)
        numeric = not seconds_of_text(first).null_count()
        if self.part.time_format is not None and not (fine and numeric):
            return self._formatted(values, self.part.time_format, unit)
        if self.like is not None:
            numeric = not isinstance(self.like, pl.Datetime)
        if numeric:
            found = seconds_of_text(values)
            known = found.is_finite()
            if fine and (found.abs() > _COARSE).any():
                found = exact_seconds(values)
                known = found.is_not_null()
        else:
            zoned = self.like.time_zone is not None if isinstance(self.like, pl.Datetime) else None
            found = moments(values, first.item(), zoned, unit)
            known = found.is_not_null()
        bad = values.is_not_null() & ~known.fill_null(False)
        hint = "" if known.any() or self.part.file is None else _SAY_FORMAT
        self.refuse(bad, f"{name} is {{!r}}; it must be {_AS_OTHERS}{hint}", values)
        return found

    def _formatted(self, values: pl.Series, form: str, unit: Unit) -> pl.Series:
        """Return times that are in the format `form`."""
        try:
            found = in_format(values, form, unit)
        except pl.exceptions.PolarsError as error:
            said = str(error).partition("\n")[0]
            raise self.part.error(f"the time format {form!r}: {said}") from None
        bad = values.is_not_null() & found.is_null()
        self.refuse(bad, f"{values.name} is {{!r}}; it must be in the time format {form}", values)
        return found

    def identities(self, values: pl.Series, name: str) -> pl.Series:
        """Return identities as numbers; -1 where there is none."""
        if values.null_count() == len(values):
            return _absent("identity", len(values))
        if values.dtype.is_float():
            values = self.numbers(values).fill_nan(None).cast(pl.Int64, strict=False)
        base = IDENTITIES[name]
        text = unmarked(pl.first())
        # programs that store all columns as floats write 4204.0
        number = text.str.replace(r"\.0+$", "").str.to_integer(base=base, strict=False)
        found = values.cast(pl.String).to_frame().select(text=text, number=number)
        possible = pl.col("number").is_between(0, 2 ** _BITS[base] - 1)
        bad = pl.col("text").is_not_null() & ~possible.fill_null(False)
        checked = found.select(bad=bad, number=pl.when(~bad).then("number").fill_null(NO_IDENTITY))
        self.refuse(
            checked["bad"],
            f"{values.name} is {{!r}}; it must be {_SPELLING[base]}",
            found["text"].alias(values.name),
        )
        numbers: pl.Series = checked["number"]
        return numbers

    def flags(self, values: pl.Series) -> pl.Series:
        """Return truth values; null where missing."""
        if values.dtype == pl.Boolean:
            return values
        text = without_marks(values.cast(pl.String)).str.to_lowercase()
        found = text.is_in(_TRUE)
        bad = ~(found | text.is_in(_FALSE)).fill_null(True)
        self.refuse(bad, f"{values.name} is {{!r}}; it must be true or false", values)
        return found

    def callsigns(self, values: pl.Series) -> pl.Series:
        """Return callsigns in capital letters; null where there is none."""
        if values.null_count() == len(values):
            return _absent("callsign", len(values))
        found = names_without_marks(values.cast(pl.String)).str.to_uppercase()
        bad = ~found.str.contains("^[ -_]{1,8}$").fill_null(True)
        allowed = "it must have at most 8 letters and digits"
        self.refuse(bad, f"{values.name} is {{!r}}; {allowed}", found)
        return found.set(bad, None)


def _absent(kind: Kind, count: int) -> pl.Series:
    """Return the cells of a missing column."""
    if kind == "number":
        return pl.repeat(math.nan, count, dtype=pl.Float64, eager=True)
    if kind in {"time", "arrival"}:
        return pl.repeat(None, count, dtype=pl.Float64 if kind == "time" else pl.Null, eager=True)
    if kind == "identity":
        return pl.repeat(NO_IDENTITY, count, dtype=pl.Int64, eager=True)
    return pl.repeat(None, count, dtype=pl.Boolean if kind == "flag" else pl.String, eager=True)
