"""Measurements of several sensors that belong to one instant although their times differ."""

from __future__ import annotations

import numpy as np
import polars as pl

from tertia import _arrays
from tertia._arrays import FloatArray, IntArray


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
