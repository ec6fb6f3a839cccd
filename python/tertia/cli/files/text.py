"""Delimited text as people have it: separators, decimal commas and encodings."""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import polars as pl

from tertia.tables._records import doubt

_BEGIN = 1 << 16
# of those of equal number the first
_SEPARATORS = ",;\t"
_BOMS = {codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_DECIMAL_COMMA = r"^(\s*[+-]?\d*),(\d+(?:[eE][+-]?\d+)?\s*)$"


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a text file is written."""

    separator: str = ","
    encoding: str = "utf-8"

    @property
    def is_plain(self) -> bool:
        """Whether it is CSV as the library writes it."""
        return self == Dialect()

    @classmethod
    def of(cls, path: Path) -> Dialect:
        """Return the dialect of a file, which its beginning shows."""
        packed = path.suffix.lower()
        # what is read once from a pipe is gone
        if packed == ".zst" or not path.is_file():
            return cls()
        opened = gzip.open if packed == ".gz" else open
        try:
            with opened(path, "rb") as file:
                begin = file.read(_BEGIN)
        except (EOFError, zlib.error, gzip.BadGzipFile):
            return cls()
        encoding = _BOMS.get(begin[:2]) or _without_mark(begin)
        lines = begin.decode(encoding, "ignore").lstrip("\ufeff").splitlines()
        header = next((line for line in lines if line.strip()), "")
        return cls(separator_of(header), encoding)


def separator_of(header: str) -> str:
    """Return what separates most columns of a header."""
    return max(_SEPARATORS, key=lambda one: len(next(csv.reader([header], delimiter=one), ())))


def with_point(cell: str) -> str:
    """Return a number with a decimal point in place of a comma, other text as it is."""
    return re.sub(_DECIMAL_COMMA, r"\1.\2", cell)


def _without_mark(begin: bytes) -> str:
    """Return the encoding of a text without a byte order mark."""
    for encoding, zeros in (("utf-16-le", begin[1::2]), ("utf-16-be", begin[::2])):
        if zeros and zeros.count(0) > len(zeros) // 2:
            return encoding
    return "utf-8"


def read_text(path: Path) -> pl.DataFrame:
    """Read a table in delimited text; its cells remain text.

    Where columns are not separated by commas, these are decimal commas.
    """
    dialect = Dialect.of(path)
    frame = _read(path, dialect)
    if dialect.separator == ",":
        return frame
    return frame.with_columns(pl.all().str.replace(_DECIMAL_COMMA, "${1}.${2}"))


def _read(path: Path, dialect: Dialect) -> pl.DataFrame:
    options: dict[str, Any] = {"separator": dialect.separator, "infer_schema": False}
    if dialect.encoding == "utf-8":
        try:
            return pl.read_csv(path, glob=False, **options)
        except pl.exceptions.ComputeError as error:
            if "utf-8" not in str(error).lower() or path.suffix.lower() in {".gz", ".zst"}:
                raise
    encoding = "cp1252" if dialect.encoding == "utf-8" else dialect.encoding
    try:
        text = path.read_bytes().decode(encoding).lstrip("\ufeff")
    except UnicodeDecodeError as error:
        raise pl.exceptions.ComputeError(f"it is no text: {error}") from None
    if encoding == "cp1252":
        doubt(f"{path} is not in UTF-8: it is read as Windows-1252")
    return pl.read_csv(io.StringIO(text), **options)
