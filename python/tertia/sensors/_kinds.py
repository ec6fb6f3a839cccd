"""Kinds of measurements, and their standard deviations."""

from typing import Literal, TypeAlias

import numpy.typing as npt

from tertia._arrays import FloatArray, radians, samples

Kind: TypeAlias = Literal["range", "azimuth", "elevation", "range_difference", "arrival_time"]

KINDS: tuple[Kind, ...] = ("range", "azimuth", "elevation", "range_difference", "arrival_time")
# what one station measures alone of the position
STATION_KINDS = KINDS[:3]
ANGLES: tuple[Kind, ...] = ("azimuth", "elevation")


def angle_sigma(value: npt.ArrayLike, name: str, *, degrees: bool) -> FloatArray:
    """Return standard deviations; those of angles are in radians."""
    if not name.startswith(ANGLES):
        return samples(value, name)
    return radians(value, name, degrees=degrees, is_sigma=True)
