"""Checks of measurements and standard deviations."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import (
    SMALLEST,
    FloatArray,
    positive,
    radians,
    real,
    require_between,
    samples,
)
from tertia.sensors._kinds import ANGLES, angle_sigma

_DOMAINS: dict[str, tuple[str, tuple[float, ...]]] = {
    "range": ("a positive number", (SMALLEST,)),
    "elevation": ("between -pi and pi (radians)", (-np.pi, np.pi)),
}


def checked(value: npt.ArrayLike, kind: str, k: int, *, degrees: bool = False) -> FloatArray:
    """Return measurements, (..., K) or (..., K - 1), after checking whether they are possible."""
    array = radians(value, kind, degrees=degrees) if kind in ANGLES else samples(value, kind)
    require_length(array, kind, k)
    domain, limits = _DOMAINS.get(kind, ("a finite number", ()))
    require_between(array, kind, f"{domain}, or nan", *limits, missing=True)
    return array


def deviations(
    sigma: npt.ArrayLike | None, own: FloatArray | None, kind: str, k: int, *, degrees: bool
) -> FloatArray:
    """Return standard deviations, (..., K) or (..., K - 1); they are nan where they are unknown."""
    count = k - int(kind == "range_difference")
    if sigma is None:
        return np.full(count, np.nan) if own is None else own
    name = f"{kind}_sigma"
    array = positive(angle_sigma(sigma, name, degrees=degrees), name)
    if array.ndim == 0:
        return np.full(count, array)
    require_length(array, name, k)
    return array


def require_length(array: npt.NDArray[Any], name: str, k: int) -> None:
    """Raise an error unless there is an element for each station, or for each except the first."""
    count = k - int(name.startswith("range_difference"))
    if array.ndim < 1 or array.shape[-1] != count:
        raise ValueError(
            f"{name} has shape {array.shape}; for {k} stations it must be (..., {count})"
        )


def require_kinds(measured: Collection[str], d: int, *, shared: bool) -> None:
    """Raise an error if nothing was measured, or if the measured kinds do not fit together."""
    if not measured:
        raise ValueError(
            "nothing was measured; give range, azimuth, elevation, range_difference or arrival_time"
        )
    if shared and "arrival_time" in measured:
        raise ValueError(
            "arrival_time and range_difference share the errors of their stations; give one of "
            "them, or range_difference_correlation=0"
        )
    if d == 2 and "elevation" in measured:
        raise ValueError("elevation needs stations with three coordinates")


def correlation_of(value: float) -> float:
    """Return the correlation of range differences, after checking it."""
    correlation = real(value, "range_difference_correlation")
    if not 0.0 <= correlation < 1.0:
        raise ValueError(
            f"range_difference_correlation is {correlation}; it must be at least 0 and below 1"
        )
    return correlation
