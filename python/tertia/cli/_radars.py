"""Radars in a file: where they are, how they measure, how fast they turn."""

import math
from pathlib import Path

from tertia._arrays import FloatArray
from tertia.cli._stations import Row, named_rows, number, positions, required
from tertia.cli._terminal import fail, note
from tertia.tracker import Radar

# what is known of a radar, by column, and what its unit is in those of the library
_MEASURES = {
    "range_sigma": ("range_sigma_m", 1.0),
    "azimuth_sigma": ("azimuth_sigma_deg", math.pi / 180),
    "period": ("period_s", 1.0),
}
_OPTIONAL = {
    "range_max": "range_max_m",
    "detection_probability": "detection_probability",
}
# no radar that watches aircraft is as good, in degrees
_DOUBTFUL_SIGMA = 0.005


def read_radars(path: Path) -> list[Radar]:
    """Read them from TOML with one table `[[radar]]` each, or from CSV or Parquet."""
    rows = named_rows(path, "radar")
    places = positions(rows, path)
    radars = [
        _radar(row, name, place, path)
        for (name, row), place in zip(rows.items(), places, strict=True)
    ]
    for radar in radars:
        sigma = math.degrees(radar.azimuth_sigma)
        if sigma < _DOUBTFUL_SIGMA:
            note(
                f"azimuth_sigma_deg of {radar.name} is {sigma:.3g} degrees: is it in radians? "
                "Files hold degrees"
            )
    return radars


def _radar(row: Row, name: str, place: FloatArray, path: Path) -> Radar:
    told = {}
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
