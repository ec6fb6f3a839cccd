"""Checks of measurements and standard deviations."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import (
    SMALLEST,
    BoolArray,
    FloatArray,
    array_of,
    lies_between,
    positive,
    radians,
    real,
    require_between,
    require_each,
    samples,
)
from tertia.sensors._kinds import ANGLES, angle_sigma

# sigmas by which noise makes the range of a target near its station negative at most
NOISE = 5.0
# so many ranges that are not positive are no noise if all are equal
_EQUAL = 5
_DOMAINS: dict[str, tuple[str, tuple[float, ...]]] = {
    "elevation": ("between -pi and pi (radians)", (-np.pi, np.pi)),
}


def checked(
    value: npt.ArrayLike,
    kind: str,
    k: int,
    *,
    sigma: FloatArray | float = np.inf,
    degrees: bool = False,
) -> FloatArray:
    """Return measurements, (..., K) or (..., K - 1), after checking whether they are possible."""
    array = radians(value, kind, degrees=degrees) if kind in ANGLES else samples(value, kind)
    require_length(array, kind, k)
    domain, limits = _DOMAINS.get(kind, ("a finite number", ()))
    require_between(array, kind, f"{domain}, or nan", *limits, missing=True)
    if kind == "range" and not lies_between(array, SMALLEST, missing=True):
        _require_ranges(array, sigma)
    return array


def near_enough(ranges: FloatArray, sigma: FloatArray) -> BoolArray:
    """Return which ranges are positive, or at most as far below 0 as noise makes them.

    Zeros count only beside other ranges of the same station, near to 0: alone, they more often mean
    that nothing was measured.
    """
    near = (np.abs(ranges) <= NOISE * sigma) & (ranges != 0.0)
    beside = near.any(axis=tuple(range(near.ndim - 1)))
    found: BoolArray = (ranges > 0.0) | ((ranges <= 0.0) & np.where(ranges < 0.0, near, beside))
    return found


def _require_ranges(ranges: FloatArray, sigma: FloatArray | float) -> None:
    """Raise an error if a range is negative by more than noise, or stands for no measurement."""
    low = ranges[ranges <= 0.0]
    ranges, sigma = np.broadcast_arrays(ranges, sigma)
    required = f"a positive number, one that is negative by at most {NOISE:g} sigmas, or nan"
    require_each(ranges, np.isnan(ranges) | near_enough(ranges, sigma), "range", required)
    if low.size >= _EQUAL and np.all(low == low[0]) and not _are_coarse(ranges, sigma):
        required = f"nan if nothing was measured: all {low.size} ranges that are not positive are"
        require_each(ranges, ~(ranges <= 0.0), "range", f"{required} the same")


def _are_coarse(ranges: FloatArray, sigma: FloatArray) -> bool:
    """Return whether ranges are 0 or more steps that exceed their sigmas."""
    known = ranges[np.isfinite(ranges)]
    step = np.min(known[known > 0.0], initial=np.inf)
    is_coarse = np.median(sigma) < step < np.inf and np.min(known) == 0.0
    return bool(is_coarse and np.allclose(known / step, np.round(known / step)))


def deviations(
    sigma: npt.ArrayLike | None,
    own: FloatArray | None,
    kind: str,
    k: int,
    measured: npt.ArrayLike | None = None,
    *,
    degrees: bool,
) -> FloatArray:
    """Return standard deviations, (..., K) or (..., K - 1); they are nan where they are unknown.

    A standard deviation may be nan where the measurement of the same index is missing.
    """
    count = k - int(kind == "range_difference")
    if sigma is None:
        return np.full(count, np.nan) if own is None else own
    name = f"{kind}_sigma"
    array = angle_sigma(sigma, name, degrees=degrees)
    if measured is not None:
        array = _where_measured(array, measured, kind)
    array = positive(array, name)
    if array.ndim == 0:
        return np.full(count, array)
    require_length(array, name, k)
    return array


def _where_measured(sigma: FloatArray, measured: npt.ArrayLike, kind: str) -> FloatArray:
    """Return standard deviations; those of missing measurements are the median of the others.

    If all are missing, they are 1, which has no effect.
    """
    unknown, values = np.isnan(sigma), array_of(measured, kind)
    if sigma.shape != values.shape or not unknown.any():
        return sigma
    absent = np.isnat(values) if values.dtype.kind in "mM" else np.isnan(samples(values, kind))
    other = 1.0 if unknown.all() else np.median(sigma[~unknown])
    return np.where(unknown & absent, other, sigma)


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
