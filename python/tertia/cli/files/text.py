"""Delimited text with various separators, decimal commas and encodings."""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import json
import re
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import polars as pl

from tertia.tables._doubts import doubt
from tertia.tables._text import encoding_of

_BEGIN = 1 << 16
_COMMENT = "#"
# separators; if several give the same number of columns, the first is used
_SEPARATORS = ",;\t|"
# first line by which spreadsheets are told the separator
_SEPARATOR_LINE = re.compile(r"sep=.", re.IGNORECASE)
_NUMBER = r"\s*[+-]?\d+([.,]\d*)?([eE][+-]?\d+)?\s*"
_GZIP = b"\x1f\x8b"
_DAMAGED = (EOFError, zlib.error, gzip.BadGzipFile)
# first bytes of files that are not text
_OTHERS = {
    b"PK": "a workbook or an archive",
    b"\xd0\xcf\x11\xe0": "a workbook",
    b"%PDF": "a PDF",
    b"PAR1": "Parquet, whose names end in .parquet",
    b"<!DOCTYPE": "a web page",
    b"<html": "a page of a website",
    b"<?xml": "XML",
    b"[{": "JSON",
    b'{"': "JSON",
}
# bytes that do not occur in text, and largest share of them in a text file
_CONTROL = bytes(sorted({*range(32)} - {*b"\t\n\v\f\r\x1a\x1b"}))
_STRANGE = 0.02
# what Polars puts into names of columns for bytes that are not UTF-8
_UNDECODED = "\ufffd"
_DECIMAL_COMMA = r"^(\s*[+-]?\d*),(\d+(?:[eE][+-]?\d+)?\s*)$"


@dataclass(frozen=True, slots=True)
class Dialect:
    """Format of a text file."""

    separator: str = ","
    encoding: str = "utf-8"
    # lines before the header
    comments: int = 0
    # whether carriage returns alone end the lines, as on old Macs
    returns: bool = False

    @property
    def is_plain(self) -> bool:
        """Whether the file is CSV in the format that the library writes."""
        return self == Dialect()

    @classmethod
    def of(cls, path: Path) -> Dialect:
        """Return the dialect of a file, recognised from its beginning."""
        packed = path.suffix.lower()
        # a pipe can be read only once
        if packed == ".zst" or not path.is_file():
            return cls()
        try:
            with _opened(path) as file:
                begin = file.read(_BEGIN)
        except _DAMAGED:
            return cls()
        encoding = encoding_of(begin)
        text = begin.decode(encoding, "ignore").lstrip("\ufeff")
        lines, returns = text.splitlines(), "\r" in text and "\n" not in text
        comments = _comments(lines)
        header, first = [*filter(str.strip, lines[comments:]), "", ""][:2]
        separator = " " if _is_spaced(header, first) else separator_of(header)
        return cls(separator, encoding, comments, returns)


def _comments(lines: list[str]) -> int:
    """Return the number of lines before the header, which may also begin with `#`."""
    if lines and _SEPARATOR_LINE.fullmatch(lines[0]):
        return 1
    count = next((k for k, line in enumerate(lines) if not line.startswith(_COMMENT)), len(lines))
    if not 0 < count < len(lines):
        return 0
    first = cells_of(lines[count], separator_of(lines[count]))
    return count - 1 if any(map(_is_number, first)) else count


def separator_of(header: str) -> str:
    """Return the separator that gives most columns in a header."""
    return max(_SEPARATORS, key=lambda one: len(cells_of(header, one)))


def cells_of(line: str, separator: str) -> list[str]:
    """Return the cells of a line; a line that is not CSV is one cell."""
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error:
        # a cell is too long, or there is a carriage return in it
        return [line]


def _is_spaced(header: str, first: str) -> bool:
    """Return whether spaces separate the columns: as many words in the first row as names."""
    words, names = first.split(), header.split()
    has_others = any(one in header for one in _SEPARATORS)
    return len(words) == len(names) > 1 and not has_others and any(map(_is_number, words))


def has_strange_names(names: Iterable[str]) -> bool:
    """Return whether names of columns have characters that Polars could not decode as UTF-8."""
    return any(_UNDECODED in name for name in names)


def json_of(text: str) -> Any:
    """Return the value of a text in JSON; None if there is none that tables can hold."""
    try:
        value = json.loads(text)
        if "\\u" in text:
            # halves of characters cannot be written
            json.dumps(value, ensure_ascii=False).encode()
    except (ValueError, RecursionError):
        return None
    return value


def with_point(cell: str) -> str:
    """Return a number with a decimal point instead of a comma, and other text unchanged."""
    return re.sub(_DECIMAL_COMMA, r"\1.\2", cell)


def _is_number(cell: str) -> bool:
    return re.fullmatch(_NUMBER, cell) is not None


def _opened(path: Path) -> BinaryIO:
    """Open a file, decompressing it if necessary."""
    return gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb")  # type: ignore[return-value]


def foreign(path: Path) -> str | None:
    """Return a description of a file that is not text; None for text."""
    packed = path.suffix.lower()
    if packed == ".zst" or not path.is_file():
        return None
    with path.open("rb") as file:
        begin = file.read(_BEGIN)
    if packed == ".gz":
        return "it is not compressed by gzip" if begin and begin[:2] != _GZIP else None
    text = begin.lstrip(codecs.BOM_UTF8 + b" \t\r\n")
    kinds = (what for mark, what in _OTHERS.items() if text.startswith(mark))
    other = next((f"it is {what}: save it as CSV" for what in kinds), None)
    if other is not None or encoding_of(begin) != "utf-8":
        return other
    strange = len(begin) - len(begin.translate(None, _CONTROL))
    return "it is not a text file" if strange > _STRANGE * len(begin) else None


def damage(path: Path) -> str | None:
    """Return a description of the damage of a file compressed by gzip; None if there is none."""
    if path.suffix.lower() != ".gz":
        return None
    try:
        with _opened(path) as file:
            while file.read(_BEGIN):
                pass
    except _DAMAGED as error:
        return f"it is damaged: {error}"
    return None


def too_long(path: Path) -> str | None:
    """Return a message about the first line with more fields than the header."""
    dialect = Dialect.of(path)
    if dialect.separator == " ":
        # the reader has said so
        return None
    try:
        with _opened(path) as file:
            text = file.read().decode(dialect.encoding, "replace").lstrip("\ufeff")
    except (OSError, *_DAMAGED):
        return None
    rows = csv.reader(text.splitlines()[dialect.comments :], delimiter=dialect.separator)
    try:
        width = len(next((cells for cells in rows if cells), []))
        for cells in rows:
            if len(cells) > width:
                line = rows.line_num + dialect.comments
                return f"line {line} has {len(cells)} fields, the header has {width}"
    except csv.Error as error:
        return (
            f"up to line {rows.line_num + dialect.comments}: {error}; is a quotation mark missing?"
        )
    return None


def read_text(path: Path) -> pl.DataFrame:
    """Read a table in delimited text; its cells remain text.

    If the separator of columns is not a comma, commas in cells are decimal commas.
    """
    dialect = Dialect.of(path)
    frame = _read(path, dialect)
    if frame.width and all(map(_is_number, frame.columns)):
        raise pl.exceptions.ComputeError("its first line has numbers: it must name the columns")
    if dialect.separator == ",":
        return frame
    return frame.with_columns(pl.all().str.replace(_DECIMAL_COMMA, "${1}.${2}"))


def _read(path: Path, dialect: Dialect) -> pl.DataFrame:
    options: dict[str, Any] = {"separator": dialect.separator, "infer_schema": False}
    if replace(dialect, separator=",").is_plain and dialect.separator != " ":
        packed = path.suffix.lower() == ".zst"
        try:
            frame = pl.read_csv(path, glob=False, **options)
            if packed or not has_strange_names(frame.columns):
                return frame
        except pl.exceptions.ComputeError as error:
            if packed or "utf-8" not in str(error).lower():
                raise
    with _opened(path) as file:
        contents = file.read()
    text = _text(contents, dialect.encoding)
    if text is None:
        text = _text(contents, "cp1252") if dialect.encoding == "utf-8" else None
        if text is None:
            reason = f"it cannot be decoded as {dialect.encoding}"
            raise pl.exceptions.ComputeError(reason)
        doubt(f"{path} is not UTF-8; it is read as Windows-1252")
    if dialect.returns:
        text = text.replace("\r", "\n")
    for _ in range(dialect.comments):
        text = text.partition("\n")[2]
    if dialect.separator == " ":
        text = _spaced_once(text, dialect.comments)
    return pl.read_csv(io.StringIO(text.lstrip("\ufeff")), **options)


def _spaced_once(text: str, comments: int) -> str:
    """Return rows with one space between cells; a row without one of its cells cannot be read."""
    rows = [line.split() for line in text.splitlines()]
    width = len(next(filter(None, rows), []))
    for number, cells in enumerate(rows, start=comments + 1):
        if cells and len(cells) != width:
            reason = (
                f"line {number} has {len(cells)} fields, the header has {width}; between spaces, a "
                "missing value must be written as nan"
            )
            raise pl.exceptions.ComputeError(reason)
    return "\n".join(map(" ".join, rows))


def _text(contents: bytes, encoding: str) -> str | None:
    try:
        return contents.decode(encoding)
    except UnicodeDecodeError:
        return None
