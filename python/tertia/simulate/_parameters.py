"""Checks of the parameters of simulations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tertia._arrays import FloatArray, integer, real

# keeps every product of two parameters finite
_LARGEST = 1e100


def _pair(value: Any, name: str) -> tuple[Any, Any]:
    try:
        first, second = value
    except (TypeError, ValueError):
        raise TypeError(f"{name} is {value!r}; it must be a pair of numbers") from None
    return first, second


def _shape(batch: int | tuple[int, ...]) -> tuple[int, ...]:
    sizes = batch if isinstance(batch, tuple) else (batch,)
    return tuple(integer(size, "batch", 0) for size in sizes)


def _number(value: Any, name: str, low: float = -_LARGEST, high: float = _LARGEST) -> float:
    """Return `value` as a float, after checking that it is between the limits."""
    number = real(value, name)
    _require(low <= number <= high, name, value, f"between {low:g} and {high:g}")
    return number


def _require(holds: bool, name: str, value: object, requirement: str) -> None:
    if not holds:
        raise ValueError(f"{name} is {value!r}; it must be {requirement}")


def _choice(value: object, name: str, known: Sequence[str]) -> None:
    _require(isinstance(value, str) and value in known, name, value, f"one of {', '.join(known)}")


def _period(period: float | None) -> float | None:
    """Return the period of angles, after checking that it is positive, or None."""
    if period is not None:
        period = _number(period, "period", 0)
        _require(period > 0, "period", period, "a positive number or None")
    return period


def _wrap(angle: FloatArray, period: float | None) -> None:
    """Wrap angles to [0, period), in place."""
    if period is not None:
        angle %= period
        angle[angle >= period] = 0.0


def _root(matrix: FloatArray) -> FloatArray:
    """Return a square root, computed from eigenvalues, of a matrix that may be singular."""
    values, vectors = np.linalg.eigh(matrix)
    root: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))
    return root
