"""Warning of batches whose positions above and below the stations fit equally well."""

from __future__ import annotations

import warnings

import numpy as np

from tertia._arrays import FloatArray
from tertia.location._result import Location, LocationStatus

# least number of instants of a batch, and share of ambiguous ones, with which it is warned of
_BATCH, _MOST = 5, 0.6
# largest deviation of stations from their plane, relative to the smaller one within it; least
# vertical component of the normal of a plane that has an upper side
_THIN, _LEVEL = 0.3, 0.7


def warn_if_mirrored(location: Location, places: FloatArray) -> None:
    """Warn if most instants of a batch are ambiguous, and the stations are near a level plane.

    `places` are the stations, of shape (..., K, D). With angles, ambiguity has other reasons.
    """
    seen = location.outlier
    if seen.azimuth is not None or seen.elevation is not None:
        return
    status = np.asarray(location.status)
    if status.size < _BATCH or np.mean(status == LocationStatus.AMBIGUOUS) <= _MOST:
        return
    if _are_level(places.reshape(-1, *places.shape[-2:])[0]):
        warnings.warn(
            f"{np.count_nonzero(status == LocationStatus.AMBIGUOUS)} of {status.size} instants "
            "have no position, because positions above and below the stations fit equally well; "
            "give initial, a position on the side where the targets are, or height",
            UserWarning,
            stacklevel=4,
        )


def _are_level(places: FloatArray) -> bool:
    """Return whether the stations are near a plane with an upper side."""
    if places.shape[-1] < 3:
        return False
    offset = places - places.mean(axis=0)
    squares, axes = np.linalg.eigh(offset.T @ offset)
    across, width = np.sqrt(np.maximum(squares[:2], 0.0))
    return bool(across <= _THIN * width and width > 0 and abs(axes[2, 0]) >= _LEVEL)
