"""Stations in a file: where they are and how well they measure."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tertia._arrays import FloatArray
from tertia.cli._places import Places, Row, named_rows, number, places
from tertia.cli._terminal import fail
from tertia.sensors import Kind, Station

# what one unit of the files is in those of the library
UNITS: dict[Kind, tuple[str, float]] = {
    "range": ("m", 1.0),
    "azimuth": ("deg", math.pi / 180),
    "elevation": ("deg", math.pi / 180),
    "range_difference": ("m", 1.0),
}


def value_column(kind: Kind) -> str:
    """Return the column of measurements of a kind."""
    return f"{kind}_{UNITS[kind][0]}"


def sigma_column(kind: Kind) -> str:
    """Return the column of their standard deviations."""
    return f"{kind}_sigma_{UNITS[kind][0]}"


@dataclass(frozen=True, slots=True)
class Sites:
    """The stations of a file, in metres and radians.

    Standard deviations are (K,) for each kind, nan where none is stated.
    """

    path: Path
    names: list[str]
    places: Places
    sigmas: dict[Kind, FloatArray]

    def stations(self, sigmas: dict[Kind, FloatArray] | None = None) -> list[Station]:
        """Return them with standard deviations, by default those of the file."""
        told = self.sigmas if sigmas is None else sigmas
        columns: tuple[Kind, ...] = ("range", "azimuth", "elevation")

        def stated(kind: Kind, k: int) -> Any:
            sigma = float(told[kind][k]) if kind in told else math.nan
            return None if math.isnan(sigma) else sigma

        return [
            Station(
                place,
                name=name,
                axes=None if self.places.axes is None else self.places.axes[k],
                **{f"{kind}_sigma": stated(kind, k) for kind in columns},
            )
            for k, (name, place) in enumerate(zip(self.names, self.places.positions, strict=True))
        ]


def read_stations(path: Path) -> Sites:
    """Read them from TOML with one table `[[station]]` each, or from a table."""
    rows, origin = named_rows(path, "station")
    sigmas = {
        kind: np.array([_sigma(row, name, kind, path) for name, row in rows.items()])
        for kind in UNITS
    }
    return Sites(path, list(rows), places(rows, origin, path), sigmas)


def _sigma(row: Row, name: str, kind: Kind, path: Path) -> float:
    column = sigma_column(kind)
    sigma = number(row, column, name, path)
    if sigma is None:
        return math.nan
    if sigma <= 0:
        fail(f"{path}: {column} of {name} is {sigma:g}; it must be a positive number, or missing")
    return sigma * UNITS[kind][1]
