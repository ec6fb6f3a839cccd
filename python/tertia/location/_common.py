"""Systematic errors that one sensor has at several places, as a direction finder that moves."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray
from tertia.location._bias import ERRORS, Given
from tertia.location._result import Location
from tertia.location._several import TUKEY, several_errors
from tertia.sensors import Bias, Kind, Station
from tertia.sensors._kinds import KINDS

# fewest places of a sensor at which its error is looked for
_FEWEST = 3
# errors that are tried at first, in standard deviations of the prior, and their number
_SPAN, _POINTS = 30.0, 61
# and the largest error of an angle: beyond a half circle, errors are those of the other side
_WIDEST = np.pi / 2
# rounds in which the errors that are tried come closer, and the fall of ln of the density from its
# top beyond which an error is unlikely
_ROUNDS, _FALL = 4, 12.0
# prior probability that an error is 0
_NONE = 0.25
# least number of places along a path; mean and largest distance of successive ones, relative to the
# mean distance of all
_PLACES, _STEP, _LARGEST = 6, 0.5, 0.7
_ONE_SENSOR = (
    "the stations lie along a path in their order, and none has a name: if they are one sensor "
    "that moves, give all of them the same name (Station(..., name=)), and the error of its "
    "azimuths is estimated; otherwise, give each a name of its own"
)

# results of the core, as `location_of` takes them, for measurements (N, kinds, K), with or without
# their sigmas; and the rows that it takes
Core: TypeAlias = Callable[[FloatArray, FloatArray], Any]
Solve: TypeAlias = Callable[[FloatArray], Any]
Rows: TypeAlias = tuple[Any, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """Measurements of one kind by one sensor, of which the error is normal, or unknown: nan."""

    kind: Kind
    stations: npt.NDArray[np.intp]
    sigma: float

    def taken(self, measured: FloatArray, errors: FloatArray) -> FloatArray:
        """Return the measurements without each of these errors, (N, kinds, K)."""
        taken = np.repeat(measured[np.newaxis], len(errors), axis=0)
        taken[:, KINDS.index(self.kind), self.stations] -= errors[:, np.newaxis]
        return taken


@dataclass(frozen=True, slots=True, eq=False)
class Common:
    """Errors that several measurements have in common, with what follows from them.

    Attributes
    ----------
    errors, sigmas : mapping of ndarray of shape (K,)
        Errors, and what is not known of them, by kind of measurement.
    measured, deviations : ndarray of shape (kinds, K)
        Measurements without the errors, and their random standard deviations.
    covariance : ndarray of shape (D, D)
        Covariance of the position.
    widening : float
        Factor of the standard deviations with which regions are as large as the covariance.
    given : bool
        Whether the sizes of the errors were stated.
    """

    errors: Mapping[Kind, FloatArray]
    sigmas: Mapping[Kind, FloatArray]
    measured: FloatArray
    deviations: FloatArray
    covariance: FloatArray
    widening: float
    given: bool


def without_common(
    stations: Any,
    given: tuple[Mapping[Kind, tuple[FloatArray, FloatArray]], Given],
    rows: tuple[Rows, BoolArray],
    solver: Callable[[BoolArray], Core],
) -> tuple[Common | None, Rows, BoolArray]:
    """Return the errors of sensors that were at several places, and the rows without them.

    The rows are those of the core, with the sigmas that may grow: none may if there are errors.
    """
    groups = _groups_of(stations, *given)
    _doubt_path(stations, rows[0][0], *given)
    if groups:
        places, axes, measured, sigmas, *rest = rows[0]
        certain = np.zeros_like(rows[1])
        found = _common_errors(
            groups, measured.reshape(sigmas[0].shape), sigmas[0], solver(certain)
        )
        if found is not None:
            taken = found.measured.reshape(measured.shape), found.deviations[np.newaxis]
            return found, (places, axes, *taken, *rest), certain
    return None, *rows


def included(common: Common | None, own: Given, location: Location) -> Location:
    """Return a location with the errors that measurements have in common in its covariance."""
    if common is None:
        return location
    columns: dict[str, Any] = {}
    for value, sigma, (kind, name) in zip(own.value, own.sigma, ERRORS.items(), strict=True):
        columns[name] = value + common.errors.get(kind, 0.0)
        columns[f"{name}_sigma"] = common.sigmas.get(kind, np.nan_to_num(sigma))
    scene = location._scene
    return replace(
        location,
        covariance=np.broadcast_to(common.covariance, location.covariance.shape).copy(),
        systematic="given" if common.given else "estimated",
        bias=Bias._of(columns),
        _scene=scene and replace(scene, sigmas=scene.sigmas * common.widening),
    )


def _doubt_path(
    stations: Any, places: FloatArray, measured: Mapping[Kind, Any], own: Given
) -> None:
    """Warn if stations without names that measure azimuths are perhaps one sensor that moves."""
    if own.known or "azimuth" not in measured or len(stations) < _PLACES or places.ndim > 3:
        return
    if isinstance(stations, Sequence) and any(getattr(one, "name", None) for one in stations):
        return
    place = places.reshape(-1, *places.shape[-2:])[0]
    steps = np.linalg.norm(np.diff(place, axis=0), axis=-1)
    distances = np.linalg.norm(place[:, np.newaxis] - place, axis=-1)
    mean = np.sum(distances) / (len(place) * (len(place) - 1))
    if np.mean(steps) < _STEP * mean and np.max(steps) < _LARGEST * mean:
        warnings.warn(_ONE_SENSOR, UserWarning, stacklevel=4)


def _groups_of(
    stations: Any, measured: Mapping[Kind, tuple[FloatArray, FloatArray]], own: Given
) -> list[_Group]:
    """Return the measurements of sensors that were at several places: stations of one name."""
    if not isinstance(stations, Sequence) or own.deviating:
        return []
    names = [one.name if isinstance(one, Station) else None for one in stations]
    if not any(names):
        return []
    found = []
    for name, count in Counter(names).items():
        if not name or count < _FEWEST:
            continue
        at = np.flatnonzero([one == name for one in names])
        for row, kind in enumerate(ERRORS):
            if kind not in measured or kind == "arrival_time":
                continue
            sigma = own.sigma[row, at]
            alike = np.isnan(sigma).all() or (np.ptp(sigma) == 0 and 0 < sigma[0] < np.inf)
            if alike and np.isfinite(measured[kind][0][..., at]).sum() >= _FEWEST:
                found.append(_Group(kind, at, float(sigma[0])))
    return found


def _common_errors(
    groups: Sequence[_Group], values: FloatArray, deviations: FloatArray, core: Core
) -> Common | None:
    """Estimate the errors of sensors at several places, from measurements (kinds, K).

    None if they cannot be estimated. The position is averaged over the errors that the measurements
    leave possible. The prior of an error is normal if its size is stated. Otherwise a quarter of it
    is at 0, and the rest has Cauchy's distribution, as wide as the random error of a measurement.
    """
    sigmas = deviations.copy()
    for group in groups:
        row = KINDS.index(group.kind), group.stations
        known = np.nan_to_num(group.sigma)
        sigmas[row] = np.sqrt(np.maximum(sigmas[row] ** 2 - known**2, 0.0))
    if len(groups) > 1:
        return _errors_together(groups, values, sigmas, core)
    (group,) = groups
    found = _marginal(group, values, sigmas, lambda several: core(several, sigmas))
    if found is None:
        return None
    values = group.taken(values, np.array([found.error]))[0]
    own = core(values[np.newaxis], sigmas)[1][0]
    whole = found.factor * own + found.added
    errors = np.array([found.error]), np.array([found.variance])
    return _collected(groups, errors, (values, sigmas), (own, whole))


def _errors_together(
    groups: Sequence[_Group], values: FloatArray, sigmas: FloatArray, core: Core
) -> Common | None:
    """Estimate the errors of several groups."""

    def taken(errors: FloatArray) -> FloatArray:
        rows = np.repeat(values[np.newaxis], len(errors), axis=0)
        for group, each in zip(groups, errors.T, strict=True):
            rows[:, KINDS.index(group.kind), group.stations] -= each[:, np.newaxis]
        return rows

    def solve(errors: FloatArray, factor: float) -> Any:
        found = core(taken(errors), factor * sigmas)
        return found[:3] if np.isfinite(found[0]).all() else None

    units = np.array(
        [np.median(sigmas[KINDS.index(group.kind), group.stations]) for group in groups]
    )
    found = several_errors(units, np.array([group.sigma for group in groups]), solve)
    if found is None:
        return None
    errors, variances, whole = found
    without = taken(errors[np.newaxis])[0]
    own = core(without[np.newaxis], sigmas)[1][0]
    return _collected(groups, (errors, variances), (without, sigmas), (own, whole))


@dataclass(frozen=True, slots=True, eq=False)
class _Marginal:
    """Error of a group, its variance, and the covariance that it adds to that of the position."""

    error: float
    variance: float
    added: FloatArray
    factor: float


def _marginal(
    group: _Group, values: FloatArray, sigmas: FloatArray, solve: Solve
) -> _Marginal | None:
    """Average over the error of one group."""
    random = float(np.median(sigmas[KINDS.index(group.kind), group.stations]))
    is_stated = np.isfinite(group.sigma)
    wide = group.sigma if is_stated else random
    high = _SPAN * max(wide, random)
    high = high if group.kind == "range" else min(high, _WIDEST)
    low = -high
    factor = 1.0
    for turn in range(_ROUNDS):
        errors = np.linspace(low, high, _POINTS)
        errors = errors if is_stated else np.append(errors, 0.0)
        position, covariance, residual, *_ = solve(group.taken(values, errors))
        cost, excess = _costs(residual, position.shape[-1] + 1)
        if not np.isfinite(cost).any():
            return None
        if turn == 0:
            factor = max(1.0, float(excess[np.argmin(cost)]))
        density = -cost / factor - np.log1p((errors / wide) ** 2)
        if is_stated:
            density = -cost / factor - 0.5 * (errors / wide) ** 2
        tried = slice(None, _POINTS)
        likely = errors[tried][density[tried] > np.max(density[tried]) - _FALL]
        step = errors[1] - errors[0]
        low, high = likely.min() - step, likely.max() + step
    share = np.exp(density - density[np.isfinite(density)].max())
    if not is_stated:
        # the prior at 0, and that of the others times the step
        share[tried] *= (1 - _NONE) * step / (np.pi * wide)
        share[_POINTS] *= _NONE
    share /= share.sum()
    used = share > 0
    share, errors = share[used], errors[used]
    error = float(share @ errors)
    position, covariance = position[used], factor * covariance[used]
    away = position - share @ position
    best = covariance[np.argmin(np.abs(errors - error))]
    mixed = np.einsum("n,nij->ij", share, covariance + away[:, :, np.newaxis] * away[:, np.newaxis])
    return _Marginal(error, float(share @ (errors - error) ** 2), mixed - best, factor)


def _costs(residual: FloatArray, unknown: int) -> tuple[FloatArray, FloatArray]:
    """Return half of the robust sum of squares of whitened residuals, and the noise factor²."""
    squares = residual.reshape(len(residual), -1) ** 2
    missing = np.isnan(squares)
    near = np.minimum(squares / TUKEY**2, 1.0)
    cost = np.where(missing, 0.0, TUKEY**2 / 6 * (1 - (1 - near) ** 3)).sum(axis=1)
    cost[missing.all(axis=1)] = np.inf
    kept = ~missing & (squares < TUKEY**2)
    total = np.where(kept, squares, 0.0).sum(axis=1)
    return cost, total / np.maximum(kept.sum(axis=1) - unknown, 1)


def _collected(
    groups: Sequence[_Group],
    found: tuple[FloatArray, FloatArray],
    rows: tuple[FloatArray, FloatArray],
    covariances: tuple[FloatArray, FloatArray],
) -> Common | None:
    """Return what is found: errors with variances, measurements with sigmas, covariances.

    The first covariance of the position is that without the errors, the second the whole one.
    """
    (values, sigmas), (own, whole) = rows, covariances
    errors: dict[Kind, FloatArray] = {}
    variances: dict[Kind, FloatArray] = {}
    for group, *each in zip(groups, *found, strict=True):
        for columns, value in zip((errors, variances), each, strict=True):
            columns.setdefault(group.kind, np.zeros(values.shape[-1]))[group.stations] = value
    ratio = np.linalg.det(whole) / np.linalg.det(own)
    if not (np.isfinite(ratio) and np.all(np.linalg.eigvalsh(whole) > 0)):
        return None
    return Common(
        errors,
        {kind: np.sqrt(variance) for kind, variance in variances.items()},
        values,
        sigmas,
        whole,
        float(max(1.0, ratio ** (0.5 / len(own)))),
        given=all(np.isfinite(group.sigma) for group in groups),
    )
