"""Kinds of measurements, and their standard deviations."""

from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia._arrays import LARGEST, FloatArray, lies_between, radians, require_each, samples

Kind: TypeAlias = Literal["range", "azimuth", "elevation", "range_difference", "arrival_time"]

KINDS: tuple[Kind, ...] = ("range", "azimuth", "elevation", "range_difference", "arrival_time")
# what one station measures alone of the position
STATION_KINDS = KINDS[:3]
ANGLES: tuple[Kind, ...] = ("azimuth", "elevation")


def angle_sigma(value: npt.ArrayLike, name: str, *, degrees: bool) -> FloatArray:
    """Return standard deviations, after checking them; those of angles are returned in radians."""
    if name.startswith(ANGLES):
        array = radians(value, name, degrees=degrees, is_sigma=True)
    else:
        array = samples(value, name)
    if lies_between(array, 1 / LARGEST, LARGEST, missing=True):
        return array
    # of others the square is not a number, or zero
    fits = ~np.isfinite(array) | (array <= 0) | ((array >= 1 / LARGEST) & (array <= LARGEST))
    require_each(array, fits, name, f"between {1 / LARGEST:g} and {LARGEST:g}")
    return array
