"""Stations in a file: where they are and how well they measure."""

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from tertia._arrays import FloatArray
from tertia.cli import _tables
from tertia.cli._terminal import WRONG_USAGE, fail
from tertia.location import Kind, Station

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

# what one unit of the files is in those of the library
UNITS: dict[Kind, tuple[str, float]] = {
    "range": ("m", 1.0),
    "azimuth": ("deg", math.pi / 180),
    "elevation": ("deg", math.pi / 180),
    "range_difference": ("m", 1.0),
}
_PLANE, _UP = ("east_m", "north_m"), "up_m"

Row: TypeAlias = Mapping[str, Any]


def value_column(kind: Kind) -> str:
    """Return the column of measurements of a kind."""
    return f"{kind}_{UNITS[kind][0]}"


def sigma_column(kind: Kind) -> str:
    """Return the column of their standard deviations."""
    return f"{kind}_sigma_{UNITS[kind][0]}"


@dataclass(frozen=True, slots=True)
class Sites:
    """The stations of a file, in metres and radians.

    Positions are (K, D); standard deviations (K,) for each kind, nan where none is stated.
    """

    path: Path
    names: list[str]
    places: FloatArray
    sigmas: dict[Kind, FloatArray]

    def stations(self, sigmas: dict[Kind, FloatArray] | None = None) -> list[Station]:
        """Return them with standard deviations, by default those of the file."""
        told = self.sigmas if sigmas is None else sigmas
        columns: tuple[Kind, ...] = ("range", "azimuth", "elevation")

        def stated(kind: Kind, k: int) -> float | None:
            sigma = float(told[kind][k]) if kind in told else math.nan
            return None if math.isnan(sigma) else sigma

        return [
            Station(place, name=name, **{f"{kind}_sigma": stated(kind, k) for kind in columns})
            for k, (name, place) in enumerate(zip(self.names, self.places, strict=True))
        ]


def read_stations(path: Path) -> Sites:
    """Read them from TOML with one table `[[station]]` each, or from CSV or Parquet."""
    named = named_rows(path, "station")
    sigmas = {
        kind: np.array([_sigma(row, name, kind, path) for name, row in named.items()])
        for kind in UNITS
    }
    return Sites(path, list(named), positions(named, path), sigmas)


def named_rows(path: Path, noun: str) -> dict[str, Row]:
    """Return the tables `[[noun]]` of TOML, or the rows of CSV or Parquet, by their names."""
    rows = _rows_of_toml(path, noun) if path.suffix.lower() == ".toml" else _rows_of_table(path)
    if not rows:
        fail(f"{path} has no {noun}s")
    names = [_name(row, f"{noun} {number}", path) for number, row in enumerate(rows, start=1)]
    for at, name in enumerate(names):
        if name in names[:at]:
            fail(f"{path} has two {noun}s {name}")
    return dict(zip(names, rows, strict=True))


def _rows_of_toml(path: Path, noun: str) -> list[Row]:
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        fail(f"there is no file {path}", WRONG_USAGE)
    except OSError as error:
        fail(f"cannot read {path}: {error.strerror}")
    except ValueError as error:
        # also what is no UTF-8
        fail(f"cannot read {path}: {error}")
    rows = document.get(noun, [])
    if not isinstance(rows, list) or not all(isinstance(row, Mapping) for row in rows):
        fail(f"{path}: {noun} is no list of tables; each must begin with [[{noun}]]")
    return rows


def _rows_of_table(path: Path) -> list[Row]:
    frame = _tables.read(path, ["name"])
    return list(frame.filter(_tables.is_row(frame, path)).iter_rows(named=True))


def _name(row: Row, which: str, path: Path) -> str:
    name = row.get("name")
    if name is None or not str(name).strip():
        fail(f"{path}: {which} has no name")
    return str(name).strip()


def positions(rows: Mapping[str, Row], path: Path) -> FloatArray:
    """Return where stations or radars are, (K, 2), or (K, 3) if any of them has a height."""
    in_space = any(number(row, _UP, name, path) is not None for name, row in rows.items())
    columns = (*_PLANE, _UP) if in_space else _PLANE
    return np.array(
        [[required(row, column, name, path) for column in columns] for name, row in rows.items()]
    )


def required(row: Row, column: str, name: str, path: Path) -> float:
    """Return a number that must be there."""
    found = number(row, column, name, path)
    if found is None:
        fail(f"{path}: {column} of {name} is missing")
    return found


def _sigma(row: Row, name: str, kind: Kind, path: Path) -> float:
    column = sigma_column(kind)
    sigma = number(row, column, name, path)
    if sigma is None:
        return math.nan
    if sigma <= 0:
        fail(f"{path}: {column} of {name} is {sigma:g}; it must be a positive number, or missing")
    return sigma * UNITS[kind][1]


def number(row: Row, column: str, name: str, path: Path) -> float | None:
    """Return a number of a row, None where it is missing."""
    value = row.get(column)
    if value is None or _tables.is_mark(str(value)):
        return None
    try:
        found = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        found = math.nan
    if not math.isfinite(found):
        fail(f"{path}: {column} of {name} is {value!r}; it must be a finite number")
    return found
