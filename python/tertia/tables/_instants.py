"""Measurements of several sensors that belong to one instant although their times differ."""

from __future__ import annotations

import numpy as np
import polars as pl

from tertia import _arrays
from tertia._arrays import FloatArray, IntArray
from tertia.bearing import estimate_bearing
from tertia.screening import unwrap_about_median

# with fewer no scatter can be estimated
_FEWEST = 5
# of kinds that repeat
PERIODS = {"azimuth": 360.0}


def check_tolerance(tolerance: float) -> float:
    """Return the tolerance in seconds; raise an error if it is below 0."""
    seconds = _arrays.real(tolerance, "tolerance")
    if not seconds >= 0:
        raise ValueError(f"tolerance is {seconds:g}; it must be at least 0 seconds")
    return seconds


def instants(rows: pl.DataFrame, tolerance: float) -> tuple[IntArray, FloatArray]:
    """Return the instant of each row and the time of each instant; rows are sorted by time.

    An instant ends if the next measurement is later than its first one by more than `tolerance`, or
    if a sensor measures the same kind again.
    """
    time = rows["seconds"].to_numpy()
    keys = list(zip(rows["site"], rows["kind"], strict=True))
    step = np.empty(len(time), dtype=np.int64)
    seen: set[tuple[int, str]] = set()
    at, first = -1, -np.inf
    for row, (now, key) in enumerate(zip(time.tolist(), keys, strict=True)):
        if at < 0 or now - first > tolerance or key in seen:
            at, first, seen = at + 1, now, set()
        seen.add(key)
        step[row] = at
    return step, np.bincount(step, weights=time) / np.bincount(step)


def combined(rows: pl.DataFrame, name: str) -> pl.DataFrame:
    """Return one row per sensor and kind, with the estimate from all of its measurements.

    If there are fewer than five measurements, the estimate is their median, with the sigma of one
    measurement.
    """
    found = [rows.clear()]
    for one in rows.partition_by("site", "kind", maintain_order=True):
        value, sigma = _combined(one, name)
        middle = one[(one.height - 1) // 2]
        found.append(middle.with_columns(value=pl.lit(value), sigma=pl.lit(sigma)))
    return pl.concat(found).sort("seconds", maintain_order=True)


def _combined(rows: pl.DataFrame, name: str) -> tuple[float, float]:
    """Return an estimate and its sigma; the sigma is nan if the sigma of the sensor applies."""
    values, period = rows["value"].to_numpy(), PERIODS.get(rows["kind"][0])
    stated = float(np.median(rows["sigma"].to_numpy()))
    if len(values) < _FEWEST:
        near = values if period is None else unwrap_about_median(values, period)
        return float(np.median(near)), stated
    try:
        found = estimate_bearing(values, period=period)
    except ValueError as error:
        raise ValueError(f"{name}: {rows['kind'][0]}: {error}") from error
    sigma = float(found.sigma)
    return float(found.value), sigma if sigma > 0 else stated
