"""Contradictions that one number explains: a height, an offset or a clock."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from tertia import _core
from tertia._arrays import BoolArray, FloatArray
from tertia.sensors._kinds import ANGLES, KINDS


def warn_if_explained(
    rows: Sequence[Any],
    found: tuple[FloatArray, FloatArray | None, BoolArray],
) -> None:
    """Warn if one number explains why the measurements of many instants contradict each other.

    `rows` are the stations, their axes, the measurements (N, 5, K) with their sigmas, survey errors
    and heights, as the core has them; `found` are positions, velocities (N, D) and outliers.
    """
    places, axes, values, sigmas, surveys, height = rows
    position, velocity, outlier = found
    kept = np.where(outlier, np.nan, values)
    told = _core.explanation(places, axes, kept, sigmas, surveys, height, position, velocity)
    if told is not None:
        warnings.warn(_said(*told), UserWarning, stacklevel=3)


def _said(cause: str, number: int, value: float, sigma: float) -> str:
    if cause == "slant":
        height = float(np.sqrt(value))
        high = f"{_short(height)} m (± {_short(0.5 * sigma / height, 1)} m)"
        return (
            f"the ranges contradict each other, and agree as slant ranges of a target about {high} "
            "above or below the stations: give the stations with heights (three coordinates), or "
            "convert the ranges"
        )
    if cause == "clock":
        late = f"{_short(abs(value))} s (± {_short(sigma, 1)} s) {'fast' if value > 0 else 'slow'}"
        return (
            f"the measurements of station {number} contradict the others, and agree if its clock "
            f"is {late}: correct it (time of Bias), or let it be estimated (time_sigma of Bias)"
        )
    kind, unit = KINDS[number], "m"
    if kind in ANGLES:
        value, sigma, unit = np.degrees(value), np.degrees(sigma), "degrees"
    error = f"{_short(abs(value))} {unit} (± {_short(sigma, 1)})"
    return (
        f"the {kind}s contradict each other, and agree if all of them are {error} too "
        f"{'large' if value > 0 else 'small'}: correct them ({kind} of Bias), as for a compass "
        "error, a delay or a wrong speed of signals that all stations share"
    )


def _short(value: float, digits: int = 3) -> str:
    """Return a number with so many digits, without an exponent if it is not very large."""
    return f"{float(f'{value:.{digits}g}'):g}"
