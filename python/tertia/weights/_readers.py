"""Checks of the size of the numbers, and of shapes, in the arguments of `weights` and `fusion`."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, common_batch, finite, positive

# squares of smaller sigmas, or of larger ones than its reciprocal, leave the range of doubles
_SMALLEST_SIGMA = 1e-70
LARGEST = 1 / _SMALLEST_SIGMA


def moderate(value: npt.ArrayLike, name: str) -> FloatArray:
    """Return numbers, after checking that they and their squares are finite."""
    array = finite(value, name)
    if np.any(np.abs(array) > LARGEST):
        raise ValueError(f"{name} has a number above {LARGEST}; change the unit")
    return array


def deviation(value: npt.ArrayLike, name: str) -> FloatArray:
    """Return standard deviations, after checking that they can be squared."""
    array = positive(value, name)
    if np.any((array < _SMALLEST_SIGMA) | (array > LARGEST)):
        limits = f"between {_SMALLEST_SIGMA} and {LARGEST}"
        raise ValueError(f"{name} must be {limits} everywhere; change the unit")
    return array


def squares(value: npt.ArrayLike, name: str) -> FloatArray:
    """Return square matrices, after checking their shape and that they are finite."""
    array = finite(value, name)
    if array.ndim < 2 or array.shape[-1] != array.shape[-2]:
        raise ValueError(f"{name} has shape {array.shape}; it must be (..., m, m)")
    return array


def of_one_batch(
    **arrays: tuple[FloatArray, tuple[int, ...]],
) -> dict[str, FloatArray]:
    """Broadcast arrays to common leading axes; the shape of one element is given for each."""
    first, (given, _) = next(iter(arrays.items()))
    batches = {}
    for name, (array, tail) in arrays.items():
        length = array.ndim - len(tail)
        if length < 0 or array.shape[length:] != tail:
            expected = ", ".join(["...", *map(str, tail)])
            raise ValueError(
                f"{name} has shape {array.shape}; for {first} of shape {given.shape} it must be "
                f"({expected})"
            )
        batches[name] = array.shape[:length]
    batch = common_batch(**batches)
    return {name: np.broadcast_to(array, batch + tail) for name, (array, tail) in arrays.items()}
