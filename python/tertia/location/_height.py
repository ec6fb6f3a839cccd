"""The height of a target, which is given or remains undetermined."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from tertia._arrays import FloatArray, finite, positive
from tertia.location._result import Location

# in metres; what stations with verticals of their own see of a height is small
_ANYWHERE = 10_000.0


def read_height(
    height: npt.ArrayLike | None, sigma: npt.ArrayLike | None, d: int
) -> FloatArray | None:
    """Return heights and their standard deviations, (..., 2); None if they are not given."""
    if height is None and sigma is None:
        return None
    if height is None or sigma is None:
        missing = "height" if height is None else "height_sigma"
        raise ValueError(f"{missing} is missing; height and height_sigma belong together")
    if d == 2:
        raise ValueError("height needs stations with three coordinates")
    value, spread = finite(height, "height"), positive(sigma, "height_sigma")
    if not np.all(np.isfinite(spread)):
        raise ValueError("height_sigma must be finite")
    try:
        return np.stack(np.broadcast_arrays(value, spread), axis=-1)
    except ValueError:
        raise ValueError(
            f"height has shape {value.shape}, height_sigma {spread.shape}; they do not fit"
        ) from None


def anywhere(places: FloatArray) -> FloatArray:
    """Return a height with a very large sigma, near the heights of the stations (..., K, 3)."""
    level = np.mean(places[..., 2], axis=-1)
    return np.stack([level, np.full_like(level, _ANYWHERE)], axis=-1)


def without_height(location: Location) -> Location:
    """Return the location with its height marked as undetermined."""
    position, covariance = location.position.copy(), location.covariance.copy()
    found = np.asarray(location.success)
    position[..., 2] = np.nan
    covariance[..., 2, :] = np.where(found, 0.0, np.nan)[..., np.newaxis]
    covariance[..., :, 2] = covariance[..., 2, :]
    covariance[..., 2, 2] = np.where(found, np.inf, np.nan)
    return replace(location, position=position, covariance=covariance)
