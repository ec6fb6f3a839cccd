"""Detection of numbers that follow another convention, such as small angles in degrees."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray
from tertia.location._conventions import CONVENTIONS, Convention
from tertia.sensors._kinds import ANGLES, KINDS

# radians do not fit where fewer instants agree; degrees do where more agree
_SHARES = 0.5, 0.9
# an instant agrees unless its p-value is smaller
_CHANCES = 1e-3, 0.02
# degrees of freedom that must agree; whether two bearings meet or diverge is worth half of one
_EVIDENCE = 4.0
# most instants that are tried under other conventions
_MOST = 200
# share of outliers with which an instant still fits, and the mean square of what is left
_FEW, _SQUARE = 0.25, 2.0
# nobody measures radians so badly; it may be a sigma in degrees as well, and if angles are degrees,
# their residuals are larger
_DIFFUSE = 0.2
_DEGREES = (
    "most angles contradict each other as radians, and fit as degrees; if they are degrees, pass "
    "degrees=True"
)

Columns = Sequence[npt.NDArray[Any]]
# positions, covariances, residuals and outliers (..., 5, K), and columns
Found = Sequence[Any]


def doubt_numbers(
    found: Found,
    values: FloatArray,
    sigmas: FloatArray,
    solve: Callable[[FloatArray, FloatArray], Found | None],
    *,
    degrees: bool,
) -> bool:
    """Warn if measurements contradict each other, and would agree under another convention.

    Return whether this is so.

    `found` is the solution for `values` of shape (..., 5, K) and `sigmas`, with angles in radians,
    which were passed in `degrees`; `solve` computes the solution for other values, None if it needs
    much larger sigmas. Because this is slow, a record is solved again only if the measurements of
    most instants contradict each other. An instant still fits if a few of its measurements are
    outliers.
    """
    if found[-1][0].ndim == 0 and _is_usual(found[-1]):
        return False
    tried, agrees = _agreement(found[-1], _CHANCES[0])
    if not tried or agrees >= _SHARES[0] * tried:
        return False
    fits = _agrees(found[-1], _CHANCES[0]) | _fits_without_few(found)
    if np.count_nonzero(fits) >= _SHARES[0] * tried:
        return False
    kinds = [kind for row, kind in enumerate(KINDS) if np.isfinite(values[..., row, :]).any()]
    if np.count_nonzero(fits | _is_near(found, sigmas)) >= _SHARES[0] * tried:
        # the angles have another meaning only if they are far off
        kinds = [kind for kind in kinds if kind not in ANGLES]
    angles = [KINDS.index(kind) for kind in kinds if kind in ANGLES]
    if angles and not degrees and _are_degrees(values, sigmas, solve, angles):
        warnings.warn(_DEGREES, stacklevel=3)
        return True
    for meant in CONVENTIONS:
        if meant.kind in kinds and _agree(solve(_meant(values, meant), sigmas)):
            warnings.warn(meant.message, stacklevel=3)
            return True
    return False


def _are_degrees(
    values: FloatArray,
    sigmas: FloatArray,
    solve: Callable[[FloatArray, FloatArray], Found | None],
    angles: Sequence[int],
) -> bool:
    """Return whether the measurements agree if the angles, or also their sigmas, are degrees."""
    turned, small = values.copy(), sigmas.copy()
    turned[..., angles, :] = np.radians(values[..., angles, :])
    small[..., angles, :] = np.radians(sigmas[..., angles, :])
    diffuse = bool((sigmas[..., angles, :] > _DIFFUSE).any())
    return any(_agree(solve(turned, scale)) for scale in (sigmas, small)[: 1 + diffuse])


def _meant(values: FloatArray, meant: Convention) -> FloatArray:
    """Return some of the measurements under a convention, the others as missing."""
    row = KINDS.index(meant.kind)
    few = np.full_like(values, np.nan)
    count = values.shape[0] if values.ndim > 2 else 1
    some = slice(None, None, max(1, count // _MOST)) if values.ndim > 2 else ...
    few[some] = values[some]
    few[..., row, :] = meant.usual(few[..., row, :])
    return few


def _agree(found: Found | None) -> bool:
    """Return whether nearly all instants agree, and enough of them."""
    if found is None:
        return False
    tried, agrees = _agreement(found[-1], _CHANCES[1])
    return agrees >= _SHARES[1] * tried and _evidence(found[-1], _CHANCES[1]) >= _EVIDENCE


def _is_near(found: Found, sigmas: FloatArray) -> BoolArray:
    """Return at which instants nearly all angles are near those of the position.

    They are if their errors are large, as those that several measurements have in common.
    """
    angles = [KINDS.index(kind) for kind in KINDS if kind in ANGLES]
    residual = np.abs(found[2] * sigmas)[..., angles, :]
    far = np.count_nonzero(residual > _DIFFUSE, axis=(-2, -1))
    known = np.count_nonzero(np.isfinite(residual), axis=(-2, -1))
    near: BoolArray = (found[-1][0] == 0) & (known > 0) & (far <= _FEW * known)
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
