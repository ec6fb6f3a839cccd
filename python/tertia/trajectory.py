"""Trajectory: from what stations measured, some of it wrong, to positions along time.

Redundancy is in space (several stations at an instant) and in time (many instants). The source
combines them in either order: positions first, then smoothing along time, or each measured series
first. A fault is removed in space, where other stations contradict it; along time a run of faults
looks like motion.

Positions are local east, north and up in metres; azimuths and elevations are radians, azimuths
clockwise from north.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, IntArray, finite, positive, samples
from tertia.location import (
    Kind,
    Location,
    Outliers,
    Problem,
    Residuals,
    Station,
    _stations,
    _turned,
    locate,
)
from tertia.smoothing import TrackSmooth, local_polynomial, smooth

__all__ = ["Order", "Smoother", "Spatial", "Trajectory", "reconstruct"]

Order: TypeAlias = Literal["spatial-first", "temporal-first"]
Spatial: TypeAlias = Literal["robust", "least-squares"]
Smoother: TypeAlias = Literal["rts", "local-polynomial"]

_KINDS: tuple[Kind, ...] = ("range", "azimuth", "elevation", "range_difference")
_BIASED = _KINDS[:3]
_ANGLES: tuple[Kind, ...] = ("azimuth", "elevation")
# each round starts from measurements without the biases of those before
_ROUNDS = 10
# change of a bias, in its standard errors, that ends the rounds
_SETTLED = 0.01
# share of what residuals would tell of a bias if positions were known: what is below is rounding
_UNOBSERVABLE = 1e-9
# share of the information that may come from errors of the positions
_SPURIOUS = 0.1
# of a position, in units of what each coordinate alone is known to
_SINGULAR = 1e-12
# of an interval, over which measurements are differenced
_STEP = 0.1
# instants and degree that tell the motion of a station
_STATION_WINDOW, _STATION_DEGREE = 5, 2
# of adaptive polynomials
_MAX_DEGREE = 3
# share of an unobservable direction from which a bias is named
_NAMED = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A trajectory and what its measurements have to do with it.

    Attributes
    ----------
    times : ndarray of shape (N,)
        As given.
    position, velocity, acceleration : ndarray of shape (N, D)
        In metres, metres per unit of time, and so on; nan where unknown.
    covariance : ndarray of shape (N, 3 D, 3 D)
        Of positions, velocities and accelerations, in this order; the uncertainty of estimated
        biases is in it. inf where unknown. Between the three it is 0 unless the smoother is "rts"
        and positions come first.
    fixes : Location
        The positions of the single instants: from measurements as they are, or smoothed ones.
    outliers : Outliers
        Measurements that were left out in space.
    residuals : Residuals
        Measurements less those of the trajectory, over their standard deviations.
    bias, bias_sigma : Residuals or None
        Estimated biases of the stations, of shape (K,) for each kind, and their standard errors;
        None if none were estimated.
    smoothed : TrackSmooth or None
        What the smoother tells besides: likelihood, jerk, innovations. None for local polynomials
        and where measurements were smoothed.
    """

    times: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    covariance: FloatArray
    fixes: Location
    outliers: Outliers
    residuals: Residuals
    bias: Residuals | None
    bias_sigma: Residuals | None
    smoothed: TrackSmooth | None

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations of the coordinates, of shape (N, D)."""
        d = self.position.shape[-1]
        return np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)[:, :d])

    @property
    def statistics(self) -> dict[Kind, FloatArray]:
        """Number, mean and root mean square of each station's residuals, of shape (K, 3).

        Without those that were left out; in units of their standard deviations.
        """
        return {
            kind: _statistics(residual, getattr(self.outliers, kind))
            for kind in _KINDS
            if (residual := getattr(self.residuals, kind)) is not None
        }

    def __repr__(self) -> str:
        """Tell what was found."""
        n, d = self.position.shape
        known = np.count_nonzero(~np.isnan(self.position).any(axis=-1))
        left = int(np.sum(self.outliers.count))
        sigma = float(np.median(np.sqrt(np.sum(self.sigma**2, axis=-1))))
        return (
            f"Trajectory({known} of {n} instants in {d} axes, {left} measurements left out, "
            f"median sigma {sigma:.3g})"
        )


_Measured: TypeAlias = dict[Kind, FloatArray]


def reconstruct(
    stations: Sequence[Station],
    times: npt.ArrayLike,
    *,
    range: npt.ArrayLike | None = None,  # noqa: A002  # that is what it is
    azimuth: npt.ArrayLike | None = None,
    elevation: npt.ArrayLike | None = None,
    range_difference: npt.ArrayLike | None = None,
    range_difference_sigma: npt.ArrayLike | None = None,
    order: Order = "spatial-first",
    spatial: Spatial = "robust",
    smoother: Smoother = "rts",
    window: int = 13,
    degree: int | Literal["adaptive"] = "adaptive",
    jerk: float | None = None,
    biases: Iterable[Kind] = (),
    n_threads: int | None = None,
) -> Trajectory:
    """Reconstruct a trajectory from the measurements of several stations at common times.

    Parameters
    ----------
    stations : sequence of K Station
        Where they are, and how well they measure; positions of shape (D,) or, if they move, (N, D).
        Axes that change need positions first.
    times : array_like of shape (N,)
        Times of the instants, not decreasing.
    range, azimuth, elevation : array_like of shape (N, K), optional
        Measurements in metres and radians, nan where there is none.
    range_difference : array_like of shape (N, K - 1), optional
        See `tertia.location.locate`.
    range_difference_sigma : array_like of shape (K - 1,), optional
        Their standard deviations.
    order : {"spatial-first", "temporal-first"}
        Positions of the instants, smoothed along time; or measured series smoothed along time,
        which then give positions. The second one does not need measurements at the same instants:
        nan between the first and the last measurement of a station is filled.
    spatial : {"robust", "least-squares"}
        How an instant is located.
    smoother : {"rts", "local-polynomial"}
        How it is smoothed along time: `tertia.smoothing.smooth` or `local_polynomial`.
    window, degree
        Of "local-polynomial".
    jerk : float, optional
        Intensity of the white jerk for "rts"; by default that which is most likely. For measured
        series it is always fitted.
    biases : iterable of {"range", "azimuth", "elevation"}
        Kinds of which each station's constant bias is estimated and removed. Needs positions first
        and "rts".
    n_threads : int, optional
        Threads to use; by default one for little work and all cores for much.

    Returns
    -------
    Trajectory
        Positions, velocities and accelerations with their covariance, faults, residuals, biases.

    Raises
    ------
    ValueError
        A wrong shape, a number outside its domain, times that decrease, no instant that can be
        located, or biases that the measurements do not tell.
    TypeError
        An argument of the wrong type.

    Notes
    -----
    Biases: at first order biases b add A_t b to the position of an instant, with A_t its
    least-squares solution, and (I - H_t) b to its residuals, with H_t = J_t A_t. What b is follows
    from the residuals alone: least squares for positions about which nothing is assumed. So the
    biases are independent of the errors of the positions. Smoothness would tell of the biases, too,
    but a curve of the target is then taken for one.

    With times first, velocities are A_t times the rates of the measured series.

    Cost O(N K).

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.location import Station
    >>> from tertia.trajectory import reconstruct
    >>> places = np.array([[1.0, 1000.0], [2000.0, 300.0], [400.0, 2600.0]])
    >>> stations = [Station(p, range_sigma=10.0, azimuth_sigma=0.005) for p in places]
    >>> t = np.arange(60.0)
    >>> truth = np.column_stack([20 * t, 1500 + 5 * t])
    >>> offset = truth[:, np.newaxis] - places
    >>> rng = np.random.default_rng(1)
    >>> distance = np.linalg.norm(offset, axis=-1) + 10 * rng.standard_normal((60, 3))
    >>> bearing = np.arctan2(offset[..., 0], offset[..., 1]) + 0.005 * rng.standard_normal((60, 3))
    >>> distance[30:34, 0] += 100
    >>> track = reconstruct(stations, t, range=distance, azimuth=bearing)
    >>> np.flatnonzero(track.outliers.range[:, 0]).tolist()
    [30, 31, 32, 33]
    """
    _require_choices(order, spatial, smoother)
    instants = _instants(times)
    places, axes, sigmas = _places(stations, len(instants))
    k = places.shape[-2]
    if range_difference_sigma is not None:
        sigma = positive(range_difference_sigma, "range_difference_sigma")
        sigmas["range_difference"] = np.broadcast_to(sigma, max(k - 1, sigma.size))
    given = zip(_KINDS, (range, azimuth, elevation, range_difference), strict=True)
    measured = {
        kind: _checked(values, sigmas.get(kind), kind, (len(instants), k))
        for kind, values in given
        if values is not None
    }
    record = _Record(stations, places, axes, sigmas, instants, measured, spatial, n_threads)
    wanted = _wanted(biases, record, order, smoother)
    if order == "temporal-first":
        if axes is not None and axes.ndim > 3:
            raise ValueError("axes of stations change along time; order must be 'spatial-first'")
        return _temporal_first(record, smoother, window, degree)
    if smoother == "local-polynomial":
        return _by_polynomials(record, window, degree)
    return _by_rts(record, jerk, wanted)


@dataclass(frozen=True, slots=True, eq=False)
class _Record:
    """Everything that was measured: (N, K) for each kind, (N, K - 1) for range differences."""

    stations: Sequence[Station]
    # (K, D) or (N, K, D), and the axes of angles, (K, D, D) or (N, K, D, D)
    places: FloatArray
    axes: FloatArray | None
    sigmas: dict[Kind, FloatArray]
    times: FloatArray
    measured: _Measured
    spatial: Spatial
    n_threads: int | None

    def located(self, measured: _Measured, sigmas: dict[Kind, FloatArray]) -> Location:
        """Locate all instants."""
        options: dict[str, Any] = {str(kind): values for kind, values in measured.items()}
        options |= {f"{kind}_sigma": sigmas[kind] for kind in measured}
        fixes = locate(self.stations, method=self.spatial, n_threads=self.n_threads, **options)
        if not np.any(fixes.located):
            reasons = np.unique(np.asarray(fixes.problem))
            told = "; ".join(Problem(int(reason)).reason for reason in reasons)
            raise ValueError(f"no instant can be located: {told}")
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


def _by_rts(record: _Record, jerk: float | None, wanted: tuple[Kind, ...]) -> Trajectory:
    """Locate every instant, then smooth the positions."""
    measured, total = record.measured, None
    fixes, track = _smoothed_fixes(record, measured, jerk)
    for _ in range(_ROUNDS if wanted else 0):
        change = _Biases.estimate(record, measured, wanted, fixes, track)
        total = change.added_to(total)
        measured = total.removed_from(record.measured)
        fixes, track = _smoothed_fixes(record, measured, jerk)
        if change.is_small():
            break
    covariance = track.covariance if total is None else track.covariance + total.effect(track)
    d = record.places.shape[-1]
    states = tuple(track.mean[:, i * d : (i + 1) * d] for i in (0, 1, 2))
    return _trajectory(record, states, covariance, fixes, biases=total, track=track)


def _smoothed_fixes(
    record: _Record, measured: _Measured, jerk: float | None
) -> tuple[Location, TrackSmooth]:
    fixes = record.located(measured, record.sigmas)
    known = _is_finite(fixes.covariance)
    position = np.where(known[:, np.newaxis], fixes.position, np.nan)
    track = smooth(
        position, fixes.covariance, times=record.times, jerk=jerk, n_threads=record.n_threads
    )
    return fixes, track


def _by_polynomials(record: _Record, window: int, degree: int | Literal["adaptive"]) -> Trajectory:
    """Locate every instant, then smooth each coordinate."""
    fixes = record.located(record.measured, record.sigmas)
    variances = fixes.sigma.T**2
    known = np.isfinite(variances)
    y = np.where(known, fixes.position.T, np.nan)
    states, sigmas = _polynomials(record, y, np.where(known, variances, 1.0), window, degree)
    values = tuple(state.T for state in states)
    return _trajectory(record, values, _diagonal(np.concatenate(sigmas).T ** 2), fixes)


def _polynomials(
    record: _Record,
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
            times=record.times,
            variances=variances,
            derivative=derivative,
            max_degree=top,
            n_threads=record.n_threads,
        )
        states.append(fit.value)
        sigmas.append(fit.sigma)
    return states, sigmas


_Series: TypeAlias = dict[Kind, tuple[list[FloatArray], list[FloatArray]]]


def _temporal_first(
    record: _Record, smoother: Smoother, window: int, degree: int | Literal["adaptive"]
) -> Trajectory:
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
        [~getattr(fixes.outliers, kind) & ~np.isnan(measured[kind]) for kind in series], axis=1
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
    return _trajectory(record, (position, velocity, acceleration), covariance, fixes)


def _derivatives(
    record: _Record,
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
    step = _STEP * _interval(record.times)
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


def _station_motion(record: _Record, derivative: int) -> FloatArray:
    """Return velocities or accelerations of the stations, (N, K, D), or zeros, (1, K, D)."""
    if record.places.ndim == 2:
        return np.zeros((1, *record.places.shape))
    fit = local_polynomial(
        np.moveaxis(record.places, 0, -1),
        _STATION_WINDOW,
        _STATION_DEGREE,
        times=record.times,
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
    record: _Record,
    kind: Kind,
    smoother: Smoother,
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
            times=record.times,
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


@dataclass(frozen=True, slots=True, eq=False)
class _Biases:
    """Constant biases of the stations, and what they do to the trajectory."""

    record: _Record
    # which: kinds and stations, of those that measured anything
    kinds: tuple[Kind, ...]
    known: dict[Kind, BoolArray]
    # (P,), (P, P), and positions that biases of 1 add, (P, N, D), with their covariance
    values: FloatArray
    covariance: FloatArray
    columns: FloatArray
    spread: FloatArray

    @classmethod
    def estimate(
        cls,
        record: _Record,
        measured: _Measured,
        kinds: tuple[Kind, ...],
        fixes: Location,
        track: TrackSmooth,
    ) -> _Biases:
        """Estimate them from the residuals about the smooth trajectory."""
        position = track.position
        located = np.asarray(fixes.located)[:, np.newaxis] & ~np.isnan(position)[:, :1]
        weight = np.concatenate(
            [
                np.where(
                    located & ~np.isnan(values) & ~getattr(fixes.outliers, kind),
                    record.sigma(kind) ** -2.0,
                    0.0,
                )
                for kind, values in measured.items()
            ],
            axis=1,
        )
        known = {kind: _is_seen(record.measured[kind]) for kind in kinds}
        at = _columns(measured, known)
        jacobian = record.jacobian(position)
        solution = _solution(jacobian, weight)
        kept = _kept(jacobian, solution, weight, at)
        residual = np.concatenate(list(record.residuals(measured, position).values()), axis=1)
        weighted = weight * np.where(weight > 0, residual, 0.0)
        # (I - H)' W r: the position has no part in it
        score = np.einsum("nip,ni->p", kept, weighted)
        information = _information(kept, weight)
        names = [f"{kind} of station {k}" for kind in kinds for k in np.flatnonzero(known[kind])]
        root = _root(track.position_covariance)
        spurious = np.zeros_like(information)
        for shift in np.moveaxis(root, -1, 0):
            ahead, behind = (
                _kept(moved, _solution(moved, weight), weight, at)
                for moved in (record.jacobian(position + shift), record.jacobian(position - shift))
            )
            spurious += _information((ahead - behind) / 2, weight)
        size = np.sqrt(np.sum(weight, axis=0)[at])
        covariance = _inverted(information, spurious, size, names)
        columns = np.moveaxis(solution[:, :, at], -1, 0)
        spread = _inverse(jacobian, weight)
        missing = ~_is_finite(spread)
        columns = np.where(missing[:, np.newaxis], np.nan, columns)
        return cls(record, kinds, known, covariance @ score, covariance, columns, spread)

    def added_to(self, before: _Biases | None) -> _Biases:
        """Return the sum with those of the round before, which were removed."""
        return self if before is None else replace(self, values=self.values + before.values)

    def is_small(self) -> bool:
        """Whether they are far below their standard errors."""
        return bool(np.all(np.abs(self.values) <= _SETTLED * self.sigma))

    @property
    def sigma(self) -> FloatArray:
        """Standard errors."""
        return np.sqrt(np.diagonal(self.covariance))

    def removed_from(self, measured: _Measured) -> _Measured:
        """Return measurements without them."""
        biases = self.split(self.values, 0.0)
        return {
            kind: _in_domain(kind, values - biases[kind]) if kind in biases else values
            for kind, values in measured.items()
        }

    def effect(self, track: TrackSmooth) -> FloatArray:
        """Return what their uncertainty adds to the covariance of the states."""
        response = smooth(
            self.columns,
            self.spread,
            times=self.record.times,
            jerk=float(track.jerk),
            n_threads=self.record.n_threads,
        ).mean
        response = np.where(np.isnan(response), 0.0, response)
        added: FloatArray = np.einsum("pni,pq,qnj->nij", response, self.covariance, response)
        return added

    def split(self, values: FloatArray, unknown: float) -> dict[Kind, FloatArray]:
        """Return one array for each kind."""
        told, first = {}, 0
        for kind in self.kinds:
            known = self.known[kind]
            count = int(np.count_nonzero(known))
            told[kind] = np.full(len(known), unknown)
            told[kind][known] = values[first : first + count]
            first += count
        return told


def _kept(
    jacobian: FloatArray, solution: FloatArray, weight: FloatArray, at: IntArray
) -> FloatArray:
    """Return columns of I - H, (N, M, P): what biases do to the residuals."""
    measures = np.where(weight > 0, 1.0, 0.0)
    whole = np.eye(jacobian.shape[1]) * measures[:, np.newaxis]
    kept = whole[:, :, at] - jacobian @ solution[:, :, at]
    return np.where(measures[..., np.newaxis] > 0, kept, 0.0)


def _information(kept: FloatArray, weight: FloatArray) -> FloatArray:
    """Return (I - H)' W (I - H), summed over the instants."""
    information: FloatArray = np.einsum("nip,ni,niq->pq", kept, weight, kept, optimize=True)
    return information


def _root(covariance: FloatArray) -> FloatArray:
    """Return square roots of covariances, 0 where they are not finite."""
    good = _is_finite(covariance)
    root = np.zeros_like(covariance)
    values, vectors = np.linalg.eigh(covariance[good])
    root[good] = vectors * np.sqrt(np.maximum(values, 0.0))[:, np.newaxis]
    return root


def _inverted(
    information: FloatArray, spurious: FloatArray, size: FloatArray, names: list[str]
) -> FloatArray:
    """Return the covariance of the biases, or tell which are not determined.

    `spurious` is the information that errors of the positions alone make.
    """
    if np.any(size == 0):
        told = ", ".join(name for name, one in zip(names, size, strict=True) if one == 0)
        raise ValueError(f"biases of {told} cannot be estimated: nothing usable was measured")
    scale = np.outer(size, size)
    doubtful = information / scale - spurious / scale / _SPURIOUS
    least, vectors = np.linalg.eigh(doubtful)
    blind = least <= _UNOBSERVABLE
    if np.any(blind):
        share = np.sqrt(np.sum(vectors[:, blind] ** 2, axis=1))
        told = ", ".join(name for name, one in zip(names, share, strict=True) if one > _NAMED)
        raise ValueError(
            f"biases of {told} are not observable: together they move the positions and change no "
            "residual"
        )
    covariance: FloatArray = np.linalg.inv(information / scale) / scale
    return covariance


def _trajectory(
    record: _Record,
    states: tuple[FloatArray, ...],
    covariance: FloatArray,
    fixes: Location,
    *,
    biases: _Biases | None = None,
    track: TrackSmooth | None = None,
) -> Trajectory:
    position, velocity, acceleration = states
    measured = record.measured if biases is None else biases.removed_from(record.measured)
    residuals = {
        kind: residual / record.sigma(kind)
        for kind, residual in record.residuals(measured, position).items()
    }
    return Trajectory(
        record.times,
        position,
        velocity,
        acceleration,
        covariance,
        fixes,
        fixes.outliers,
        _by_kind(residuals),
        None if biases is None else _by_kind(biases.split(biases.values, np.nan)),
        None if biases is None else _by_kind(biases.split(biases.sigma, np.inf)),
        track,
    )


def _instants(times: npt.ArrayLike) -> FloatArray:
    instants = finite(times, "times")
    if instants.ndim != 1 or instants.size == 0:
        raise ValueError(f"times has shape {instants.shape}; it must be (N,)")
    back = np.flatnonzero(np.diff(instants) < 0)
    if back.size:
        raise ValueError(f"times[{back[0] + 1}] is before the time before it; times must rise")
    return instants


def _places(
    stations: Sequence[Station], n: int
) -> tuple[FloatArray, FloatArray | None, dict[Kind, FloatArray]]:
    """Return positions, (K, D) or (N, K, D), axes, and standard deviations, (K,)."""
    if not isinstance(stations, Sequence) or not all(isinstance(s, Station) for s in stations):
        raise TypeError("stations must be a sequence of Station")
    if not stations:
        raise ValueError("stations is empty; it must have at least one")
    places, axes, sigmas = _stations(stations)
    if places.ndim > 3 or (places.ndim == 3 and len(places) != n):
        raise ValueError(
            f"stations have positions of shape {places.shape[:-2]}; there are {n} times"
        )
    return places, axes, {kind: sigmas[kind] for kind in _BIASED}


def _checked(
    values: npt.ArrayLike, sigma: FloatArray | None, kind: Kind, shape: tuple[int, int]
) -> FloatArray:
    """Return measurements, of which each has a standard deviation."""
    n, k = shape
    count = k - int(kind == "range_difference")
    array = samples(values, kind)
    if array.shape != (n, count):
        raise ValueError(
            f"{kind} has shape {array.shape}; for {n} times and {k} stations it must be "
            f"({n}, {count})"
        )
    if sigma is None:
        raise ValueError(f"{kind}_sigma is missing")
    if sigma.shape != (count,):
        raise ValueError(f"{kind}_sigma has shape {sigma.shape}; it must be ({count},)")
    missing = np.flatnonzero(np.isnan(sigma) & _is_seen(array))
    if missing.size:
        raise ValueError(f"{kind}_sigma of station {missing[0]} is missing")
    return array


def _require_choices(order: Order, spatial: Spatial, smoother: Smoother) -> None:
    chosen = {"order": (order, Order), "spatial": (spatial, Spatial)}
    for name, (value, allowed) in {**chosen, "smoother": (smoother, Smoother)}.items():
        if value not in get_args(allowed):
            told = " or ".join(map(repr, get_args(allowed)))
            raise ValueError(f"{name} is {value!r}; it must be {told}")


def _wanted(
    biases: Iterable[Kind], record: _Record, order: Order, smoother: Smoother
) -> tuple[Kind, ...]:
    wanted = (biases,) if isinstance(biases, str) else tuple(dict.fromkeys(biases))
    for kind in wanted:
        if kind not in _BIASED:
            raise ValueError(f"biases has {kind!r}; it must be 'range', 'azimuth' or 'elevation'")
        if kind not in record.measured:
            raise ValueError(f"biases has {kind!r}, of which nothing was measured")
    if wanted and (order, smoother) != ("spatial-first", "rts"):
        raise ValueError("biases need order 'spatial-first' and smoother 'rts'")
    return wanted  # type: ignore[return-value]


def _columns(measured: _Measured, known: dict[Kind, BoolArray]) -> IntArray:
    """Return where the biases' columns are, if all measurements are side by side."""
    counts = [values.shape[1] for values in measured.values()]
    first = dict(zip(measured, np.cumsum([0, *counts[:-1]]), strict=True))
    return np.concatenate([first[kind] + np.flatnonzero(own) for kind, own in known.items()])


def _predicted(kind: Kind, offset: FloatArray, axes: FloatArray | None) -> FloatArray:
    """Return what stations measure of a target that is off by `offset`, of shape (N, K, D)."""
    if kind in _ANGLES:
        offset = _turned(offset, axes)
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
    if kind in _ANGLES and axes is not None:
        own = _jacobian(kind, _turned(offset, axes), None)
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


def _is_seen(values: FloatArray) -> BoolArray:
    """Whether each column has a number."""
    return np.asarray(~np.isnan(values).all(axis=0))


def _diagonal(variances: FloatArray) -> FloatArray:
    matrices = np.zeros((*variances.shape, variances.shape[-1]))
    at = np.arange(variances.shape[-1])
    matrices[..., at, at] = np.where(np.isnan(variances), np.inf, variances)
    return matrices


def _by_kind(arrays: dict[Kind, FloatArray]) -> Residuals:
    return Residuals(*(arrays.get(kind) for kind in _KINDS))


def _statistics(residual: FloatArray, outlier: BoolArray) -> FloatArray:
    kept = ~(np.isnan(residual) | outlier)
    count = np.sum(kept, axis=0)
    values = np.where(kept, residual, 0.0)
    with np.errstate(invalid="ignore"):
        mean = np.sum(values, axis=0) / count
        rms = np.sqrt(np.sum(values**2, axis=0) / count)
    return np.column_stack([count, mean, rms])
