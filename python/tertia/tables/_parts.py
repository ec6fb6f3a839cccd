"""Tables and rows of files from which records are read, and errors about them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, TypeAlias

import polars as pl

from tertia._arrays import IntArray
from tertia.tables._frames import names, series
from tertia.tables._names import assignment, hint, joined, plain_name

# if a column is missing, at most this many columns of the table are listed
_LISTED = 16
# suffix that Polars adds to a name that occurs twice in a header
AGAIN = "_duplicated_0"


class RecordError(ValueError):
    """An error in a record or in a table.

    Attributes
    ----------
    reason : str
        Description of the error.
    file : str or None
        Name of the file; None for a table in memory.
    row : int or None
        Index of the row, from 0; None if the error concerns the file or table as a whole.
    line : int or None
        Line of a text file, from 1.
    column : str or None
        Name of the column in the file or table.
    """

    def __init__(
        self,
        reason: str,
        *,
        file: str | None = None,
        row: int | None = None,
        line: int | None = None,
        column: str | None = None,
    ) -> None:
        super().__init__(reason)
        self.reason, self.file, self.row, self.line, self.column = reason, file, row, line, column

    def __str__(self) -> str:
        """Return the message, which begins with the place of the error."""
        where = None
        if self.line is not None:
            where = f"line {self.line}"
        elif self.row is not None:
            # rows of files are counted from 1
            where = f"row {self.row if self.file is None else self.row + 1}"
        place = ", ".join(filter(None, [self.file, where]))
        return f"{place}: {self.reason}" if place else self.reason


class ColumnError(RecordError):
    """An error about a column that is missing, or that is given for two purposes."""


@dataclass(frozen=True, slots=True)
class Part:
    """A table, or the rows of one file.

    `line` is the line of the first row if a file has lines. `rows` are the positions of the rows in
    the file if some were left out. `sensors` is the information in the file about its sensors, by
    name. `time_format` is the format of times if it is not one of the usual formats. `option` is
    the option that gives the names of columns, in the singular; None if there is none.
    """

    table: Any
    file: str | None = None
    name: str | None = None
    line: int | None = None
    rows: IntArray | None = None
    sensors: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: MappingProxyType({}))
    time_format: str | None = None
    option: str | None = "column"

    @property
    def called(self) -> str:
        """Name of the file, or 'the table'."""
        return self.file or "the table"

    def error(self, reason: str, row: int | None = None, column: str | None = None) -> RecordError:
        """Return an error with the place of a row."""
        place = row if row is None or self.rows is None else int(self.rows[row])
        line = None if place is None or self.line is None else place + self.line
        return RecordError(reason, file=self.file, row=place, line=line, column=column)

    def column(self, name: str) -> str:
        """Return the column with this name, or one that differs in case, spaces or brackets."""
        there = names(self.table)
        alike = [one for one in there if plain_name(one) == plain_name(name)]
        if name not in there and len(alike) > 1:
            listed = " and ".join(map(str, alike))
            raise ColumnError(f"{self.called} has the columns {listed} for {name}", column=name)
        found = name if name in there or not alike else str(alike[0])
        if f"{found}{AGAIN}" in there:
            raise ColumnError(f"{self.called} has two columns {found}", column=name)
        return found

    def has(self, name: str) -> bool:
        """Return whether there is a column with this name, or nearly this name."""
        return self.column(name) in names(self.table)

    def series(self, name: str) -> pl.Series:
        """Return the column with this name, or nearly this name."""
        return series(self.table, self.column(name))

    def require(self, *columns: str, standard: bool = False) -> None:
        """Refuse a table that has none of the columns, which may have `standard` names."""
        if not any(self.has(column) for column in columns):
            raise self.lacks(f"column {' or '.join(columns)}", columns, standard=standard)

    def lacks(self, what: str, columns: Sequence[str], *, standard: bool = True) -> ColumnError:
        """Return an error about missing columns."""
        there = names(self.table)
        said = f"{self.called} has no {what}{hint(columns, there)}; {self.listed()}"
        if standard:
            said += assignment(columns, there, self.option, shell=self.file is not None)
        return ColumnError(said, column=columns[0])

    def lacks_all(self, fields: Sequence[Sequence[str]]) -> ColumnError:
        """Return an error about missing columns, each of which has one of some names."""
        there = names(self.table)
        how = [assignment(one, there, self.option, shell=self.file is not None) for one in fields]
        missing = ", ".join(" or ".join(one) for one in fields)
        said = f"{self.called} has no column{'s' if fields[1:] else ''} {missing}"
        said += "".join(other for one in fields if (other := hint(one, there)).startswith(";"))
        said += f"; {self.listed()}"
        return ColumnError(said + joined(how), column=fields[0][0])

    def listed(self) -> str:
        """Return a list of the available columns, as text."""
        there = [str(name) for name in names(self.table)]
        more = f" and {len(there) - _LISTED} more" if len(there) > _LISTED + 1 else ""
        return f"it has {', '.join(there[:_LISTED] if more else there)}{more}"


Source: TypeAlias = Sequence[Part]


def source_of(table: Any) -> Source:
    """Return the parts of a table, or those of files that were read."""
    if isinstance(table, list) and all(isinstance(one, Part) for one in table):
        return table
    names(table)  # raises TypeError for anything other than a table
    return [Part(table)]
