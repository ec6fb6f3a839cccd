"""Trajectory: measured series smoothed first, and positions smoothed by local polynomials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from tertia._arrays import BoolArray, FloatArray
from tertia.location import Location, LocationStatus, locate
from tertia.sensors import ANGLES, Kind, Station, to_station_axes
from tertia.smoothing import local_polynomial, smooth

_Measured: TypeAlias = dict[Kind, FloatArray]
# states and their derivatives (N, D), covariance (N, 3 D, 3 D), positions of the instants
Solution: TypeAlias = tuple[tuple[FloatArray, FloatArray, FloatArray], FloatArray, Location]
# of a position, in units of what each coordinate alone is known to
_SINGULAR = 1e-12
# of an interval, over which measurements are differenced
_STEP = 0.1
# instants and degree that determine the motion of a station
_STATION_WINDOW, _STATION_DEGREE = 5, 2
# of adaptive polynomials
_MAX_DEGREE = 3


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """Everything that was measured: (N, K) for each kind, (N, K - 1) for range differences."""

    stations: Sequence[Station]
    # (K, D) or (N, K, D), and the axes of angles, (K, D, D) or (N, K, D, D)
    places: FloatArray
    axes: FloatArray | None
    sigmas: dict[Kind, FloatArray]
    time: FloatArray
    measured: _Measured
    spatial: Literal["robust", "least-squares"]
    n_threads: int | None

    def located(self, measured: _Measured, sigmas: dict[Kind, FloatArray]) -> Location:
        """Locate all instants."""
        options: dict[str, Any] = {str(kind): values for kind, values in measured.items()}
        options |= {f"{kind}_sigma": sigmas[kind] for kind in measured}
        fixes = locate(self.stations, method=self.spatial, n_threads=self.n_threads, **options)
        if not np.any(fixes.success):
            found = np.unique(np.asarray(fixes.status))
            reasons = "; ".join(LocationStatus(int(reason)).message for reason in found)
            raise ValueError(f"no instant can be located: {reasons}")
        return fixes

    def sigma(self, kind: Kind) -> FloatArray:
        """Return standard deviations that fit (N, K)."""
        return np.broadcast_to(self.sigmas[kind], self.measured[kind].shape)

    def jacobian(self, position: FloatArray) -> FloatArray:
        """Return derivatives of all measurements, side by side, (N, M, D)."""
        offset = position[:, np.newaxis] - self.places
        return np.concatenate(
            [_jacobian(kind, offset, self.axes) for kind in self.measured], axis=1
        )

    def residuals(self, measured: _Measured, position: FloatArray) -> dict[Kind, FloatArray]:
        """Return measurements less those of a trajectory, angles within half a turn."""
        offset = position[:, np.newaxis] - self.places
        return {
            kind: _difference(kind, values, _predicted(kind, offset, self.axes))
            for kind, values in measured.items()
        }


def by_polynomials(record: Record, window: int, degree: int | Literal["adaptive"]) -> Solution:
    """Locate every instant, then smooth each coordinate."""
    fixes = record.located(record.measured, record.sigmas)
    variances = fixes.sigma.T**2
    known = np.isfinite(variances)
    y = np.where(known, fixes.position.T, np.nan)
    states, sigmas = _polynomials(record, y, np.where(known, variances, 1.0), window, degree)
    values = tuple(state.T for state in states)
    return values, _diagonal(np.concatenate(sigmas).T ** 2), fixes


def _polynomials(
    record: Record,
    y: FloatArray,
    variances: FloatArray,
    window: int,
    degree: int | Literal["adaptive"],
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return values and two derivatives of rows, and their standard errors."""
    states, sigmas = [], []
    # a short record has few degrees to choose from
    fewest = int(np.min(np.sum(~np.isnan(y), axis=-1)))
    top = degree if isinstance(degree, int) else min(_MAX_DEGREE, max(fewest - 1, 0))
    for derivative in (0, 1, 2):
        if derivative > top:
            states.append(np.full(y.shape, np.nan))
            sigmas.append(np.full(y.shape, np.inf))
            continue
        fit = local_polynomial(
            y,
            window,
            degree,
            time=record.time,
            variance=variances,
            derivative=derivative,
            max_degree=top,
            n_threads=record.n_threads,
        )
        states.append(fit.value)
        sigmas.append(fit.sigma)
    return states, sigmas


_Series: TypeAlias = dict[Kind, tuple[list[FloatArray], list[FloatArray]]]


def temporal_first(
    record: Record,
    smoother: Literal["rts", "local-polynomial"],
    window: int,
    degree: int | Literal["adaptive"],
) -> Solution:
    """Smooth what each station measured, then locate every instant."""
    series: _Series = {
        kind: _smoothed_series(record, kind, smoother, window=window, degree=degree)
        for kind in record.measured
    }
    measured = {kind: _in_domain(kind, states[0]) for kind, (states, _) in series.items()}
    fixes = record.located(measured, {kind: errors[0] for kind, (_, errors) in series.items()})
    position = fixes.position
    jacobian = record.jacobian(position)
    used = np.concatenate(
        [~getattr(fixes.outlier, kind) & ~np.isnan(measured[kind]) for kind in series], axis=1
    )
    errors = [np.concatenate([own[i] for _, own in series.values()], axis=1) for i in (0, 1, 2)]
    solution = _solution(jacobian, np.where(used, errors[0] ** -2.0, 0.0))
    velocity, acceleration = _derivatives(record, position, series, solution, used)
    variances = [
        np.sum(np.where(used[:, np.newaxis], solution * own[:, np.newaxis], 0.0) ** 2, axis=-1)
        for own in errors[1:]
    ]
    n, d = position.shape
    located = _is_finite(fixes.covariance)[:, np.newaxis]
    covariance = _diagonal(
        np.concatenate(
            [np.ones((n, d)), *(np.where(located, own, np.inf) for own in variances)], axis=-1
        )
    )
    covariance[:, :d, :d] = np.where(
        located[..., np.newaxis], fixes.covariance, np.diag(np.full(d, np.inf))
    )
    return (position, velocity, acceleration), covariance, fixes


def _derivatives(
    record: Record,
    position: FloatArray,
    series: _Series,
    solution: FloatArray,
    used: BoolArray,
) -> tuple[FloatArray, FloatArray]:
    """Return velocities and accelerations that fit the rates of the measured series.

    Along x(t) a measurement h(x - p) of a station at p(t) has the rate J (x' - p') and the second
    derivative J (x'' - p'') + u'H u, with u = x' - p' and H the second derivatives of h.
    """
    offset = position[:, np.newaxis] - record.places
    motion = [_station_motion(record, derivative) for derivative in (1, 2)]

    def solved(derivative: int, bend: dict[Kind, FloatArray] | None) -> FloatArray:
        rates = []
        for kind, (states, _) in series.items():
            moved = _moved(kind, offset, motion[derivative - 1], record.axes)
            rate = states[derivative] + moved
            rates.append(rate if bend is None else rate - bend[kind])
        rate = np.where(used, np.concatenate(rates, axis=1), 0.0)
        return np.where(np.isnan(position), np.nan, (solution @ rate[..., np.newaxis])[..., 0])

    velocity = solved(1, None)
    step = _STEP * _interval(record.time)
    path = step * (velocity[:, np.newaxis] - motion[0])
    bend = {}
    for kind in series:
        behind, here, ahead = (
            _predicted(kind, offset + shift, record.axes) for shift in (-path, 0.0, path)
        )
        bend[kind] = (_difference(kind, ahead, here) - _difference(kind, here, behind)) / step**2
    return velocity, solved(2, bend)


def _moved(
    kind: Kind, offset: FloatArray, motion: FloatArray, axes: FloatArray | None
) -> FloatArray:
    """Return what motion of the stations takes from their measurements."""
    if kind == "range_difference":
        moved = _moved("range", offset, motion, axes)
        return np.asarray(moved[:, 1:] - moved[:, :1])
    return np.asarray(np.sum(_jacobian(kind, offset, axes) * motion, axis=-1))


def _station_motion(record: Record, derivative: int) -> FloatArray:
    """Return velocities or accelerations of the stations, (N, K, D), or zeros, (1, K, D)."""
    if record.places.ndim == 2:
        return np.zeros((1, *record.places.shape))
    fit = local_polynomial(
        np.moveaxis(record.places, 0, -1),
        _STATION_WINDOW,
        _STATION_DEGREE,
        time=record.time,
        derivative=derivative,
        n_threads=record.n_threads,
    )
    return np.moveaxis(fit.value, -1, 0)


def _interval(times: FloatArray) -> float:
    """Return the median interval between different times."""
    steps = np.diff(times)
    steps = steps[steps > 0]
    return float(np.median(steps)) if steps.size else 1.0


def _smoothed_series(
    record: Record,
    kind: Kind,
    smoother: Literal["rts", "local-polynomial"],
    *,
    window: int,
    degree: int | Literal["adaptive"],
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return values and two derivatives, of shape (N, K), between first and last measurement."""
    values = record.measured[kind]
    seen = ~np.isnan(values)
    y = _continuous(values) if kind == "azimuth" else values
    variances = np.where(seen, record.sigma(kind) ** 2, 1.0)
    if smoother == "rts":
        track = smooth(
            y.T[..., np.newaxis],
            variances.T[..., np.newaxis],
            time=record.time,
            n_threads=record.n_threads,
        )
        states = [track.mean[..., i] for i in (0, 1, 2)]
        errors = [track.sigma[..., i] for i in (0, 1, 2)]
    else:
        states, errors = _polynomials(record, y.T, variances.T, window, degree)
    inside = np.maximum.accumulate(seen) & np.maximum.accumulate(seen[::-1])[::-1]
    known = inside & np.isfinite(errors[0].T)
    return (
        [np.where(known, state.T, np.nan) for state in states],
        [np.where(known, error.T, 1.0) for error in errors],
    )


def _continuous(angles: FloatArray) -> FloatArray:
    """Return series without jumps by whole turns, nan where nothing was measured."""
    continuous: FloatArray = angles.copy()
    for column in continuous.T:
        seen = ~np.isnan(column)
        column[seen] = np.unwrap(column[seen])
    return continuous


def _in_domain(kind: Kind, values: FloatArray) -> FloatArray:
    """Leave out what smoothing has led to where nothing can be measured."""
    if kind == "range":
        return np.where(values > 0, values, np.nan)
    if kind == "elevation":
        return np.where(np.abs(values) <= np.pi / 2, values, np.nan)
    return values


def _predicted(kind: Kind, offset: FloatArray, axes: FloatArray | None) -> FloatArray:
    """Return what stations measure of a target that is off by `offset`, of shape (N, K, D)."""
    if kind in ANGLES:
        offset = to_station_axes(offset, axes)
    if kind == "azimuth":
        return np.asarray(np.arctan2(offset[..., 0], offset[..., 1]))
    if kind == "elevation":
        return np.asarray(np.arctan2(offset[..., 2], np.hypot(offset[..., 0], offset[..., 1])))
    distance: FloatArray = np.sqrt(np.sum(offset**2, axis=-1))
    return distance if kind == "range" else distance[:, 1:] - distance[:, :1]


def _difference(kind: Kind, values: FloatArray, predicted: FloatArray) -> FloatArray:
    difference = values - predicted
    if kind != "azimuth":
        return difference
    return difference - 2 * np.pi * np.round(difference / (2 * np.pi))


def _jacobian(kind: Kind, offset: FloatArray, axes: FloatArray | None) -> FloatArray:
    """Return derivatives of `_predicted` with respect to the position, (N, K, D)."""
    if kind in ANGLES and axes is not None:
        own = _jacobian(kind, to_station_axes(offset, axes), None)
        return np.asarray((own[..., np.newaxis, :] @ axes)[..., 0, :])
    if kind == "azimuth":
        flat = np.sum(offset[..., :2] ** 2, axis=-1, keepdims=True)
        turned = np.zeros_like(offset)
        turned[..., 0], turned[..., 1] = offset[..., 1], -offset[..., 0]
        return np.asarray(turned / flat)
    square = np.sum(offset**2, axis=-1, keepdims=True)
    if kind == "elevation":
        flat = np.hypot(offset[..., :1], offset[..., 1:2])
        raised = -offset * offset[..., 2:] / flat
        raised[..., 2:] = flat
        return np.asarray(raised / square)
    toward = offset / np.sqrt(square)
    return np.asarray(toward if kind == "range" else toward[:, 1:] - toward[:, :1])


def _inverse(jacobian: FloatArray, weight: FloatArray) -> FloatArray:
    """Return `(J' W J)^-1`, nan where there is none."""
    normal = np.swapaxes(jacobian, -1, -2) @ (weight[..., np.newaxis] * jacobian)
    size = np.sqrt(np.diagonal(normal, axis1=-2, axis2=-1))
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = normal / (size[:, :, np.newaxis] * size[:, np.newaxis])
        good = _is_finite(scaled)
        good[good] = np.linalg.eigvalsh(scaled[good])[:, 0] > _SINGULAR
    inverse = np.full(normal.shape, np.nan)
    inverse[good] = np.linalg.inv(scaled[good])
    return inverse / np.where(
        good[:, np.newaxis, np.newaxis], size[:, :, np.newaxis] * size[:, np.newaxis], 1.0
    )


def _solution(jacobian: FloatArray, weight: FloatArray) -> FloatArray:
    """Return `A = (J' W J)^-1 J' W`, (N, D, M); 0 where there is none."""
    inverse = _inverse(jacobian, weight)
    inverse = np.where(np.isnan(inverse), 0.0, inverse)
    tall = np.where(weight[..., np.newaxis] > 0, jacobian, 0.0)
    return inverse @ np.swapaxes(weight[..., np.newaxis] * tall, -1, -2)


def _is_finite(matrices: FloatArray) -> BoolArray:
    """Whether each matrix is, of shape (N,)."""
    return np.asarray(np.isfinite(matrices).all(axis=(-2, -1)))


def _diagonal(variances: FloatArray) -> FloatArray:
    matrices = np.zeros((*variances.shape, variances.shape[-1]))
    at = np.arange(variances.shape[-1])
    matrices[..., at, at] = np.where(np.isnan(variances), np.inf, variances)
    return matrices
