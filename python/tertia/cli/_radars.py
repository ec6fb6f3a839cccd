"""Radars in a file: where they are, how they measure, how fast they turn."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tertia._arrays import FloatArray
from tertia.cli._asterix import Told
from tertia.cli._places import GEODETIC, LOCAL, Places, Row, named_rows, number, places, required
from tertia.cli._terminal import fail, note
from tertia.sensors import Radar

# what is known of a radar, by column, and what its unit is in those of the library
_MEASURES = {
    "range_sigma": ("range_sigma_m", 1.0),
    "azimuth_sigma": ("azimuth_sigma_deg", math.pi / 180),
    "scan_period": ("scan_period_s", 1.0),
}
_OPTIONAL = {
    "max_range": "max_range_m",
    "detection_probability": "detection_probability",
}
# no radar that watches aircraft is as good, in degrees
_DOUBTFUL_SIGMA = 0.005


@dataclass(frozen=True, slots=True)
class RadarSites:
    """The radars of a file, where they are, and which way each calls north.

    `norths` are radians to add to its azimuths: not 0 where it is on the earth, away from the
    origin of the plane.
    """

    path: Path
    radars: list[Radar]
    places: Places
    norths: FloatArray

    @property
    def names(self) -> list[str]:
        """Their names."""
        return [str(radar.name) for radar in self.radars]


def read_radars(path: Path, told: Told | None = None) -> RadarSites:
    """Read them from TOML with one table `[[radar]]` each, or from a table.

    What recordings have `told` of positions and periods counts where the file says nothing.
    """
    rows, origin = named_rows(path, "radar")
    if told:
        rows = {name: _completed(row, name, told.get(name, {}), path) for name, row in rows.items()}
    where = places(rows, origin, path)
    norths = np.zeros(len(rows))
    positions = where.positions.copy()
    if where.axes is not None:
        norths = np.arctan2(where.axes[:, 1, 0], where.axes[:, 1, 1])
        # heights are those above the sea, as plots tell them, not above the plane
        for k, (name, row) in enumerate(rows.items()):
            positions[k, 2:] = number(row, GEODETIC[2], name, path) or 0.0
    pairs = zip(rows.items(), positions, strict=True)
    radars = [_radar(row, name, place, path) for (name, row), place in pairs]
    for radar in radars:
        sigma = math.degrees(radar.azimuth_sigma)
        if sigma < _DOUBTFUL_SIGMA:
            note(
                f"azimuth_sigma_deg of {radar.name} is {sigma:.3g} degrees: is it in radians? "
                "Files hold degrees"
            )
    return RadarSites(path, radars, where, norths)


def _completed(row: Row, name: str, told: Row, path: Path) -> Row:
    """Return what is known of a radar: what the file says, and what a recording tells."""

    def has(columns: Iterable[str]) -> bool:
        return any(number(row, column, name, path) is not None for column in columns)

    added = (
        {}
        if has(["scan_period_s"]) or "scan_period_s" not in told
        else {"scan_period_s": told["scan_period_s"]}
    )
    if not has((*LOCAL, *GEODETIC)):
        if GEODETIC[0] not in told:
            fail(
                f"{path}: {name} has no position, and its recording does not tell it (I034/120): "
                f"give {GEODETIC[0]} and {GEODETIC[1]}, or {LOCAL[0]} and {LOCAL[1]}"
            )
        added |= {column: told[column] for column in GEODETIC if column in told}
    if "scan_period_s" not in {*row, *added}:
        fail(f"{path}: give scan_period_s of {name}: its recording does not tell it (I034/041)")
    return {**row, **added}


def _radar(row: Row, name: str, place: FloatArray, path: Path) -> Radar:
    told: dict[str, Any] = {}
    for key, (column, unit) in _MEASURES.items():
        value = required(row, column, name, path)
        if value <= 0:
            fail(f"{path}: {column} of {name} is {value:g}; it must be positive")
        told[key] = value * unit
    for key, column in _OPTIONAL.items():
        known = number(row, column, name, path)
        if known is not None:
            told[key] = known
    try:
        return Radar(place, name=name, **told)
    except ValueError as error:
        fail(f"{path}: {name}: {error}")
