"""Heights of targets in tables: as columns, and above the ellipsoid."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import polars as pl

from tertia._arrays import FloatArray
from tertia.geo import LocalFrame
from tertia.sensors import Station
from tertia.tables._earth import up_at
from tertia.tables._records import Schema, number
from tertia.tables._sensors import Sensors
from tertia.trajectory import Trajectory

_COLUMNS = "target_height_m", "target_height_sigma_m"
SCHEMA: Schema = {
    "height": number(_COLUMNS[0]),
    "height_sigma": number(_COLUMNS[1], positive=True),
}
# in metres, of a sphere
_RADIUS = 6_371_000.0
# the first path is rough; each of the others reduces the error to about a hundredth
_ROUNDS = 2


def heights_of(rows: pl.DataFrame, count: int) -> FloatArray | None:
    """Return the mean height and sigma of the rows of each instant, (N, 2); None if none is known.

    Both are nan where they are unknown.
    """
    if "height" not in rows.columns:
        return None
    known = rows.filter(pl.col("height").is_not_nan())
    if known.is_empty():
        return None
    each = known.group_by("step").agg(pl.col("height", "height_sigma").mean())
    found = np.full((count, 2), np.nan)
    found[each["step"].to_numpy()] = each.select("height", "height_sigma").to_numpy()
    return found


def given_heights(
    rows: FloatArray | None, height: float | None, sigma: float | None
) -> tuple[Any, Any]:
    """Return heights and sigmas, (N,) or one for all; a sigma is that of rows without their own."""
    if rows is None:
        # the sigma may be for other targets
        return height, None if height is None else sigma
    if height is not None:
        raise ValueError(f"height is given, and {_COLUMNS[0]} as well; give one of them")
    missing = ~np.isnan(rows[:, 0]) & np.isnan(rows[:, 1])
    if sigma is None and missing.any():
        raise ValueError(f"{_COLUMNS[1]} is missing; give it, or height_sigma")
    return rows[:, 0], np.where(missing, np.nan if sigma is None else sigma, rows[:, 1])


def at_heights(
    solve: Callable[..., Trajectory], height: Any, sigma: Any, sensors: Sensors[Station]
) -> Trajectory:
    """Return the path that `solve` estimates with heights, on the earth above the ellipsoid."""
    frame = sensors.frame
    if height is None or sigma is None or not isinstance(frame, LocalFrame):
        return solve(height=height, height_sigma=sigma)
    # the horizontal plane of the origin is above the ellipsoid by the square of the distance
    away = max(np.max(np.linalg.norm(one.position[..., :2], axis=-1)) for one in sensors.items)

    def path(up: Any, sigma: Any, *, is_last: bool) -> Trajectory:
        with warnings.catch_warnings():
            if not is_last:
                warnings.simplefilter("ignore")
            return solve(height=up, height_sigma=sigma)

    wide = np.hypot(sigma, away**2 / (2.0 * _RADIUS))
    found = path(height - frame.height, wide, is_last=False)
    for step in range(_ROUNDS):
        level = np.broadcast_to(height, len(found.time))
        up = up_at(frame, found.position, level)
        up = np.where(np.isfinite(up) | np.isnan(level), up, level - frame.height)
        found = path(np.where(np.isnan(level), np.nan, up), sigma, is_last=step == _ROUNDS - 1)
    return found
