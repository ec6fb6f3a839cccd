"""The rows of an audit: their shapes and order, and the parts into which they are divided."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia._arrays import LARGEST, BoolArray, FloatArray, IntArray, array_of, samples

# numbers with more different values than this are divided at their quartiles
_LABELS = 8
# enough digits to distinguish any two numbers
_ALL_DIGITS = 17
# of the usual step: rows of one time are as good as one after the other
_SAME_TIME = 1e-6


@dataclass(frozen=True, slots=True)
class Rows:
    """Errors, their covariances and groups, times or row numbers, and velocities of targets."""

    errors: FloatArray
    covariance: FloatArray
    truth_covariance: FloatArray | None
    group: IntArray
    position: FloatArray
    velocity: FloatArray | None

    def known(self) -> BoolArray:
        """Return which rows contain only finite numbers."""
        parts = [self.errors, self.covariance, self.position]
        parts += [x for x in (self.truth_covariance, self.velocity) if x is not None]
        known = np.ones(len(self.errors), dtype=np.bool_)
        for part in parts:
            known &= np.isfinite(part).reshape(len(part), -1).all(axis=1)
        return known

    def at(self, rows: IntArray) -> Rows:
        """Return the selected rows."""
        columns: dict[str, Any] = {name: getattr(self, name) for name in self.__slots__}
        some: dict[str, Any] = {k: None if x is None else x[rows] for k, x in columns.items()}
        return Rows(**some)


def errors_of(value: npt.ArrayLike) -> FloatArray:
    errors = samples(value, "error")
    if errors.ndim == 1:
        errors = errors[:, np.newaxis]
    if errors.ndim != 2 or errors.size == 0:
        raise ValueError(f"error has shape {errors.shape}; it must be (N, m) or (N,)")
    return errors


def like(value: npt.ArrayLike, name: str, errors: FloatArray) -> FloatArray:
    found = samples(value, name)
    if found.ndim == 1:
        found = found[:, np.newaxis]
    if found.shape != errors.shape:
        raise ValueError(f"{name} has shape {found.shape}; it must be {errors.shape}")
    return found


def matrices_of(value: npt.ArrayLike, name: str, shape: tuple[int, ...]) -> FloatArray:
    """Return covariances as (N, m, m)."""
    given = samples(value, name)
    count, axes = shape
    each = (count, axes, axes)
    if given.shape in {(axes, axes), each}:
        return np.broadcast_to(given, each)
    if given.shape in {(), (count,)}:
        given = given[..., np.newaxis]
    if given.shape not in {(1,), (count, 1), (count, axes)}:
        raise ValueError(
            f"{name} has shape {given.shape}; it must be {each}, {(axes, axes)}, {(count, axes)}, "
            f"{(count,)} or ()"
        )
    matrices = np.zeros(each)
    matrices[:, range(axes), range(axes)] = given
    return matrices


def column(value: npt.ArrayLike | None, name: str, count: int) -> FloatArray | None:
    if value is None:
        return None
    column = samples(value, name)
    if column.shape != (count,):
        raise ValueError(f"{name} has shape {column.shape}; it must be ({count},)")
    return column


def require_squarable(errors: FloatArray, name: str) -> None:
    """Raise an error if the squares of errors overflow."""
    largest = float(np.max(np.abs(errors), initial=0.0))
    if not largest <= LARGEST:
        raise ValueError(f"{name} has {largest:g}; it must be at most {LARGEST:g}")


def labels_of(value: npt.ArrayLike | None, name: str, count: int) -> IntArray:
    """Return an integer for each label, the same for equal labels."""
    if value is None:
        return np.zeros(count, dtype=np.int64)
    labels = array_of(value, name)
    if labels.shape != (count,):
        raise ValueError(f"{name} has shape {labels.shape}; it must be ({count},)")
    _, numbers = np.unique(
        labels.astype(str) if labels.dtype == object else labels, return_inverse=True
    )
    return numbers.astype(np.int64)


def in_order(group: IntArray, time: FloatArray | None) -> tuple[IntArray, FloatArray]:
    """Return the rows sorted by group and time, and the time or the number of each row."""
    if time is not None:
        return np.lexsort((time, group)), time
    order = np.argsort(group, kind="stable")
    number = np.empty(len(group))
    number[order] = np.arange(len(group))
    return order, number


def gaps_of(position: FloatArray, group: IntArray) -> FloatArray:
    """Return the time since the previous row in units of the usual step; 0 where a group begins."""
    begins = np.diff(group, prepend=-1) != 0
    gaps = np.diff(position, prepend=0.0)
    steps = gaps[~begins]
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 1.0
    found: FloatArray = np.where(begins, 0.0, np.maximum(gaps / usual, _SAME_TIME))
    return found


def strata_of(
    given: npt.ArrayLike | Mapping[str, npt.ArrayLike] | None, known: BoolArray
) -> dict[str, BoolArray]:
    """Return the rows of each part of the record, by the name of the part."""
    if given is None:
        return {}
    several = given if isinstance(given, Mapping) else {"": given}
    parts = {}
    for title, values in several.items():
        labels = np.asarray(values)
        if labels.shape != known.shape:
            place = f"strata[{title!r}]" if title else "strata"
            raise ValueError(f"{place} has shape {labels.shape}; it must be {known.shape}")
        for name, own in _parts(labels):
            if np.any(own & known):
                parts[f"{title} {name}".strip()] = own
    return parts


def _parts(labels: npt.NDArray[Any]) -> list[tuple[str, BoolArray]]:
    if labels.dtype == object:
        labels = labels.astype(str)
    kinds = np.unique(labels)
    if labels.dtype.kind not in "iuf" or len(kinds) <= _LABELS:
        names = _names(kinds) if labels.dtype.kind == "f" else [str(kind) for kind in kinds]
        return [(name, labels == kind) for name, kind in zip(names, kinds, strict=True)]
    there = labels[np.isfinite(labels)]
    bounds = np.quantile(there, (0.0, 0.25, 0.5, 0.75, 1.0))
    where = np.clip(np.searchsorted(bounds[1:-1], labels, side="left"), 0, 3)
    where[~np.isfinite(labels)] = -1
    names = _names(bounds)
    return [(f"{names[k]} to {names[k + 1]}", where == k) for k in range(4)]


def _names(values: FloatArray) -> list[str]:
    """Return numbers as text, with three significant digits or as many as distinguish them."""
    names: list[str] = []
    for count in range(3, _ALL_DIGITS + 1):
        names = [_rounded(float(value), count) for value in values]
        if len(set(names)) == len(np.unique(values)):
            break
    return names


def _rounded(value: float, count: int) -> str:
    """Return a number with at least this number of significant digits, without trailing zeros."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    places = max(count - 1 - math.floor(math.log10(abs(value))), 0)
    return np.format_float_positional(value, precision=places, unique=False, trim="-")


def require_definite(matrices: FloatArray, known: BoolArray, name: str) -> None:
    """Raise an error that names the first covariance that is not positive definite."""
    try:
        np.linalg.cholesky(matrices[known])
    except np.linalg.LinAlgError:
        least = np.linalg.eigvalsh(matrices[known])[:, 0]
        # the first one without a root, or the one that is nearest to it
        worst = np.argmax(least <= 0) if np.any(least <= 0) else np.argmin(least)
        row = int(np.flatnonzero(known)[worst])
        raise np.linalg.LinAlgError(f"{name}[{row}] is not positive definite") from None
