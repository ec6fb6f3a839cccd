"""Arrays of places, in which nan means 'no place', and calls of the core with such arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    FloatArray,
    common_batch,
    finite,
    real,
    require_each,
    samples,
    scalar_or_array,
)

# components of a position
AXES = 3
_POLE = 90.0
_LARGEST = np.finfo(np.float64).max


def numbers(value: npt.ArrayLike, name: str) -> FloatArray:
    """Return numbers after checking that they are within their domain; nan means missing."""
    array = samples(value, name)
    most = _POLE if name == "latitude" else _LARGEST
    domain = "between -90 and 90 degrees" if name == "latitude" else "a finite number"
    require_each(array, ~(np.abs(array) > most), name, domain)
    return array


def stacked(**columns: FloatArray) -> FloatArray:
    """Return columns as one array, broadcast to each other and stacked on a new last axis."""
    batch = common_batch(**{name: array.shape for name, array in columns.items()})
    return np.stack([np.broadcast_to(array, batch) for array in columns.values()], axis=-1)


def positions(value: npt.ArrayLike, name: str) -> FloatArray:
    """Return positions in space, after checking them."""
    array = numbers(value, name)
    if array.shape[-1:] != (AXES,):
        raise ValueError(f"{name} has shape {array.shape}; it must be (..., {AXES})")
    return array


def geodetic(
    latitude: npt.ArrayLike, longitude: npt.ArrayLike, height: npt.ArrayLike
) -> FloatArray:
    """Return places with the coordinates on the last axis and the angles in radians."""
    return stacked(
        latitude=np.radians(numbers(latitude, "latitude")),
        longitude=np.radians(numbers(longitude, "longitude")),
        height=numbers(height, "height"),
    )


def rows(array: FloatArray) -> FloatArray:
    """Return a batch as rows, in the form that the core requires."""
    return np.ascontiguousarray(array).reshape(-1, array.shape[-1])


def set_origin(frame: Any, latitude: float, longitude: float, height: float) -> None:
    values = {"latitude": latitude, "longitude": longitude, "height": height}
    for name, value in values.items():
        object.__setattr__(frame, name, float(finite(real(value, name), name)))
    numbers(frame.latitude, "latitude")


def origin(frame: Any) -> list[float]:
    """Return the latitude and longitude of an origin in radians, and its height."""
    place: list[float] = geodetic(frame.latitude, frame.longitude, frame.height).tolist()
    return place


def batch(call: Any, array: FloatArray) -> FloatArray:
    """Call a function of the core on the rows of a batch, and return the results."""
    found: FloatArray = call(rows(array))
    return found.reshape(*array.shape[:-1], found.shape[-1])


def ecef_of(places: FloatArray) -> FloatArray:
    return batch(_core.geodetic_to_ecef, places)


def places_of(ecef: FloatArray) -> FloatArray:
    return degrees_of(batch(_core.ecef_to_geodetic, ecef))


def degrees_of(places: FloatArray) -> FloatArray:
    """Return places with latitude and longitude in degrees."""
    return np.concatenate([np.degrees(places[..., :2]), places[..., 2:]], axis=-1)


def columns(
    places: FloatArray,
) -> tuple[float | FloatArray, float | FloatArray, float | FloatArray]:
    first, second, third = (scalar_or_array(places[..., i].copy()) for i in (0, 1, 2))
    return first, second, third


def axes_of(latitude: npt.ArrayLike, longitude: npt.ArrayLike) -> FloatArray:
    """Return the unit vectors east, north and up at places, as rows, in geocentric coordinates."""
    phi, theta, _ = np.moveaxis(geodetic(latitude, longitude, 0.0), -1, 0)
    zero = np.zeros(phi.shape)
    rows = [
        [-np.sin(theta), np.cos(theta), zero],
        [-np.sin(phi) * np.cos(theta), -np.sin(phi) * np.sin(theta), np.cos(phi)],
        [np.cos(phi) * np.cos(theta), np.cos(phi) * np.sin(theta), np.sin(phi)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
