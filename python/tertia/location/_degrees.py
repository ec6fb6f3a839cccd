"""Detection of angles in degrees that were passed as radians, and are not too large for radians."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray
from tertia.sensors._kinds import ANGLES, KINDS

# radians do not fit where fewer instants agree; degrees do where more agree
_SHARES = 0.5, 0.9
# an instant agrees unless its p-value is smaller
_CHANCES = 1e-3, 0.02
# degrees of freedom that must agree; whether two bearings meet or diverge is worth half of one
_EVIDENCE = 4.0
# share of outliers with which an instant still fits, and the mean square of what is left
_FEW, _SQUARE = 0.25, 2.0
# nobody measures radians so badly; it may be a sigma in degrees as well, and if angles are degrees,
# their residuals are larger
_DIFFUSE = 0.2

Columns = Sequence[npt.NDArray[Any]]
# positions, covariances, residuals and outliers (..., 5, K), and columns
Found = Sequence[Any]


def warn_if_degrees(
    found: Found,
    values: FloatArray,
    sigmas: FloatArray,
    solve: Callable[[FloatArray, FloatArray], Found | None],
) -> None:
    """Warn if the angles do not fit as radians, but would fit as degrees.

    `found` is the solution for `values` of shape (..., 5, K) and `sigmas`, with angles in radians;
    `solve` computes the solution for other values, None if it needs much larger sigmas. Because
    this is slow, a record is solved again only if the angles of most instants do not fit as
    radians. An instant still fits if a few of its measurements are outliers.
    """
    if found[-1][0].ndim == 0 and _is_usual(found[-1]):
        return
    tried, agrees = _agreement(found[-1], _CHANCES[0])
    if not tried or agrees >= _SHARES[0] * tried:
        return
    fits = _agrees(found[-1], _CHANCES[0]) | _fits_without_few(found) | _is_near(found, sigmas)
    if np.count_nonzero(fits) >= _SHARES[0] * tried:
        return
    angles = [KINDS.index(kind) for kind in KINDS if kind in ANGLES]
    turned, small = values.copy(), sigmas.copy()
    turned[..., angles, :] = np.radians(values[..., angles, :])
    small[..., angles, :] = np.radians(sigmas[..., angles, :])
    diffuse = bool((sigmas[..., angles, :] > _DIFFUSE).any())
    for scale in (sigmas, small) if diffuse else (sigmas,):
        other = solve(turned, scale)
        if other is None:
            continue
        columns = other[-1]
        tried, agrees = _agreement(columns, _CHANCES[1])
        if agrees >= _SHARES[1] * tried and _evidence(columns, _CHANCES[1]) >= _EVIDENCE:
            warnings.warn(
                "most angles contradict each other as radians, and fit as degrees; if they are "
                "degrees, pass degrees=True",
                stacklevel=3,
            )
            return


def _is_near(found: Found, sigmas: FloatArray) -> BoolArray:
    """Return at which instants nearly all angles are near those of the position.

    They are if their errors are large, as those that several measurements have in common.
    """
    angles = [KINDS.index(kind) for kind in KINDS if kind in ANGLES]
    residual = np.abs(found[2] * sigmas)[..., angles, :]
    far = np.count_nonzero(residual > _DIFFUSE, axis=(-2, -1))
    known = np.count_nonzero(np.isfinite(residual), axis=(-2, -1))
    near: BoolArray = (found[-1][0] == 0) & (far <= _FEW * known)
    return near


def _is_usual(columns: Columns) -> bool:
    """Return whether a single instant agrees, or nothing can tell; the same in plain numbers."""
    status, freedom, _, pvalue = (column.item() for column in columns[:4])
    return freedom < 0 or (status == 0 and not pvalue < _CHANCES[0])


def _agreement(columns: Columns, chance: float) -> tuple[int, int]:
    """Return the number of instants that were tested, and how many have measurements that agree."""
    tried = int(np.count_nonzero(columns[1] >= 0))
    return tried, int(np.count_nonzero(_agrees(columns, chance)))


def _evidence(columns: Columns, chance: float) -> float:
    """Return the amount of evidence from those instants whose measurements agree."""
    worth = np.maximum(columns[1], 0.5)
    return float(np.sum(np.where(_agrees(columns, chance), worth, 0.0)))


def _agrees(columns: Columns, chance: float) -> BoolArray:
    status, freedom, _, pvalue = columns[:4]
    agrees: BoolArray = (freedom >= 0) & (status == 0) & ~(pvalue < chance)
    return agrees


def _fits_without_few(found: Found) -> BoolArray:
    """Return which instants fit after a few of their measurements were left out as outliers."""
    _, _, residual, outlier, columns = found
    status, freedom = columns[:2]
    axes = (-2, -1)
    few = np.count_nonzero(outlier, axis=axes)
    squares = np.sum(np.where(outlier | np.isnan(residual), 0.0, residual) ** 2, axis=axes)
    fits: BoolArray = (
        (status == 0)
        & (few <= _FEW * np.count_nonzero(~np.isnan(residual), axis=axes))
        & (few > 0)
        & (squares <= _SQUARE * (freedom - few))
    )
    return fits
