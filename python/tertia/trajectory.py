"""Trajectory: from what stations measured, some of it wrong, to positions along time.

Redundancy is in space (several stations at an instant) and in time (many instants). The source
combines them in either order: positions first, then smoothing along time, or each measured series
first. A fault is removed in space, where other stations contradict it; along time a run of faults
looks like motion.

Positions are local east, north and up in metres; azimuths and elevations are radians, azimuths
clockwise from north.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from tertia._arrays import BoolArray, FloatArray, IntArray, finite, positive, radians, samples
from tertia.location import Location, LocationStatus, locate
from tertia.sensors import (
    ANGLES,
    KINDS,
    STATION_KINDS,
    Bias,
    ByKind,
    Kind,
    Station,
    stack_stations,
    to_station_axes,
)
from tertia.smoothing import SmoothedPositions, local_polynomial, smooth

__all__ = ["Bias", "ByKind", "Order", "Smoother", "Spatial", "Station", "Trajectory", "reconstruct"]

Order: TypeAlias = Literal["spatial-first", "temporal-first"]
Spatial: TypeAlias = Literal["robust", "least-squares"]
Smoother: TypeAlias = Literal["rts", "local-polynomial"]

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
# rounds of looking for measurements that the track contradicts
_PASSES = 5
# change of a weight that needs no other round, and a weight that is none
_UNCHANGED, _FAINT = 0.05, 0.01
# rounds with the same jerk
_RELINEARISED = 2
# size of what is not by chance, in its standard errors
_CHANCE = NormalDist().inv_cdf(0.95)
# relative standard error of a median size of normal errors, times the root of their number
_MEDIAN_ERROR = 1.17
# degrees of freedom with which an instant is located robustly
_REDUNDANCY = 3
_TUKEY = 4.685
# means of Tukey's weight, slope and squared score with normal errors, what is beyond left out
_Q = _TUKEY**-2
_MEAN_WEIGHT, _MEAN_SLOPE = 1 - 2 * _Q + 3 * _Q**2, 1 - 6 * _Q + 15 * _Q**2
_MEAN_SQUARE = 1 - 12 * _Q + 90 * _Q**2 - 420 * _Q**3 + 945 * _Q**4
# of the estimate: variance times the sum of its weights
_EFFICIENCY = _MEAN_WEIGHT * _MEAN_SQUARE / _MEAN_SLOPE**2
# mean squared score over mean squared weight
_TAPERED = _MEAN_SQUARE / (1 - 4 * _Q + 18 * _Q**2 - 60 * _Q**3 + 105 * _Q**4)
# chance that any measurement is left out that is none, and size from which an instant agrees
_FALSE_ALARM = 0.01
_DOUBTED = NormalDist().inv_cdf(0.995)
# share of a measurement that the others must tell
_REDUNDANT = 0.1
# errors of the logarithm of the jerk with which its likelihood is a parabola, almost
_JERK_TOLD = 1.0
_JERK_STEPS = (-2.0, -1.0, 1.0, 2.0)
# between a flat prior of the root, which is too careful where no jerk is seen, and one of the
# logarithm, which is not careful enough where it is
_JERK_PRIOR = 0.25
_JERK_MARGIN, _JERK_FALL, _MOST_JERKS = 2.0, 8.0, 80
# instants that determine a state, and the power of the time with which jerk moves a position
_STATE, _STATE_POWER = 3, 5
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
    time : ndarray of shape (N,)
        As given.
    position, velocity, acceleration : ndarray of shape (N, D)
        In metres, metres per unit of time, and so on; nan where unknown.
    covariance : ndarray of shape (N, 3 D, 3 D)
        Of positions, velocities and accelerations, in this order; the uncertainty of estimated
        biases is in it. inf where unknown. Between the three it is 0 unless the smoother is "rts"
        and positions come first.
    fixes : Location
        The positions of the single instants: from measurements as they are, or smoothed ones. With
        "rts", robust and positions first, without what the track contradicts; where an instant has
        one or two degrees of freedom, its standard deviations are divided by the roots of Tukey's
        weights about the track.
    outlier : ByKind
        Measurements that were left out, because other stations or the track contradict them.
    residual : ByKind
        Measurements less those of the trajectory, over their standard deviations.
    bias : Bias or None
        Estimated biases of the stations and their standard deviations, of shape (K,); None if none
        were estimated. 0 with the sigma inf for a station that did not measure the kind.
    smoothed : SmoothedPositions or None
        What the smoother tells besides: likelihood, jerk, innovations. None for local polynomials
        and where measurements were smoothed.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    covariance: FloatArray
    fixes: Location
    outlier: ByKind
    residual: ByKind
    bias: Bias | None
    smoothed: SmoothedPositions | None

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
            kind: _statistics(residual, getattr(self.outlier, kind))
            for kind in KINDS
            if (residual := getattr(self.residual, kind)) is not None
        }

    def __repr__(self) -> str:
        """Tell what was found."""
        n, d = self.position.shape
        known = np.count_nonzero(~np.isnan(self.position).any(axis=-1))
        left = int(np.sum(self.outlier.count))
        sigma = float(np.median(np.sqrt(np.sum(self.sigma**2, axis=-1))))
        return (
            f"Trajectory({known} of {n} instants in {d} axes, {left} measurements left out, "
            f"median sigma {sigma:.3g})"
        )


_Measured: TypeAlias = dict[Kind, FloatArray]


def reconstruct(
    stations: Sequence[Station],
    time: npt.ArrayLike,
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
    bias: Bias | None = None,
    degrees: bool = False,
    n_threads: int | None = None,
) -> Trajectory:
    """Reconstruct a trajectory from the measurements of several stations at common times.

    Parameters
    ----------
    stations : sequence of K Station
        Where they are, and how well they measure; positions of shape (D,) or, if they move, (N, D).
        Axes that change need positions first.
    time : array_like of shape (N,)
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
    bias : Bias, optional
        Constant biases of the stations. A sigma of None, as in `Bias(azimuth_sigma=None)`: each
        station's is estimated and removed, which needs positions first and "rts". Where it is 0
        there is none.
    degrees : bool
        Whether the angles given here are in degrees.
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
    With "rts" and "robust" a measurement is also left out where the rest of the track contradicts
    it (1 % for the whole record) and the other measurements of its instant do (1 %). Instants with
    one or two degrees of freedom have Tukey's weights about the track. Positions are linearised
    about the track. The uncertainty of the fitted jerk is in the covariance: the mean over
    intensities q by likelihood, with a prior on log q proportional to q^(1/4).

    Biases: at first order biases b add A_t b to the position of an instant, with A_t its
    least-squares solution, and (I - H_t) b to its residuals, with H_t = J_t A_t. What b is follows
    from the residuals alone, by Tukey's weights about the track, for positions about which nothing
    is assumed. Smoothness would tell of the biases, too, but a curve of the target is then taken
    for one. Their covariance is A^-1 B A^-1, with A the slope of the scores, and B their variance
    by the standard deviations or the residuals, whichever are larger. It grows by autocorrelations
    of the scores where these are more than chance (Geyer 1992). Errors of positions at different
    instants are taken as independent.

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
    >>> np.flatnonzero(track.outlier.range[:, 0]).tolist()
    [30, 31, 32, 33]
    """
    _require_choices(order, spatial, smoother)
    instants = _instants(time)
    places, axes, sigmas = _places(stations, len(instants))
    k = places.shape[-2]
    if range_difference_sigma is not None:
        sigma = positive(range_difference_sigma, "range_difference_sigma")
        sigmas["range_difference"] = np.broadcast_to(sigma, max(k - 1, sigma.size))
    given = zip(KINDS, (range, azimuth, elevation, range_difference), strict=True)
    measured = {
        kind: _checked(values, sigmas.get(kind), kind, (len(instants), k), degrees=degrees)
        for kind, values in given
        if values is not None
    }
    record = _Record(stations, places, axes, sigmas, instants, measured, spatial, n_threads)
    wanted = _estimated(bias, measured, order, smoother)
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
        if not np.any(fixes.success):
            reasons = np.unique(np.asarray(fixes.status))
            told = "; ".join(LocationStatus(int(reason)).message for reason in reasons)
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

    def deviations(self) -> FloatArray:
        """Return standard deviations, side by side, (N, M); 1 where nothing was measured."""
        sigmas = np.concatenate([self.sigma(kind) for kind in self.measured], axis=1)
        return np.where(np.isnan(sigmas), 1.0, sigmas)

    def whitened(self, measured: _Measured, position: FloatArray) -> FloatArray:
        """Return the residuals over their standard deviations, side by side, (N, M)."""
        residuals = self.residuals(measured, position).values()
        return np.concatenate(list(residuals), axis=1) / self.deviations()


def _by_rts(record: _Record, jerk: float | None, wanted: tuple[Kind, ...]) -> Trajectory:
    """Locate every instant, then smooth the positions."""
    total = None
    found = _Smoothed.first(record, jerk).without_faults(record.measured, jerk)
    for _ in range(_ROUNDS if wanted else 0):
        change = _Biases.estimate(record, found, wanted)
        total = change.added_to(total)
        found = found.without_faults(total.removed_from(record.measured), jerk)
        if change.is_small():
            break
    found = found.relinearised(jerk)
    track = found.track
    covariance = track.covariance if jerk is not None else found.covariance_with_jerk()
    if total is not None:
        covariance = covariance + total.effect(track)
    d = record.places.shape[-1]
    states = tuple(track.mean[:, i * d : (i + 1) * d] for i in (0, 1, 2))
    return _trajectory(
        record, states, covariance, found.fixes, outlier=found.outlier, biases=total, track=track
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Plots:
    """What is smoothed: positions with their covariances, (N, D) and (N, D, D)."""

    position: FloatArray
    covariance: FloatArray

    @classmethod
    def of_fixes(cls, fixes: Location) -> _Plots:
        """Return those of the single instants."""
        known = _is_finite(fixes.covariance)[:, np.newaxis]
        return cls(np.where(known, fixes.position, np.nan), fixes.covariance)

    def smoothed(self, record: _Record, jerk: float | None) -> SmoothedPositions:
        """Smooth them."""
        return smooth(
            self.position,
            self.covariance,
            time=record.times,
            jerk=jerk,
            n_threads=record.n_threads,
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Smoothed:
    """Positions of the instants, smoothed, and what the smooth track makes of the measurements."""

    record: _Record
    measured: _Measured
    # weights by the track, side by side, (N, M); 0 where it contradicts
    trust: FloatArray
    fixes: Location
    plots: _Plots
    track: SmoothedPositions

    @classmethod
    def made(
        cls, record: _Record, measured: _Measured, jerk: float | None, trust: FloatArray
    ) -> _Smoothed:
        """Locate every instant with these weights, and smooth."""
        kept, sigmas = {}, {}
        for (kind, values), weight in zip(measured.items(), _split(trust, measured), strict=True):
            contradicted = weight == 0
            kept[kind] = np.where(contradicted, np.nan, values)
            sigmas[kind] = record.sigma(kind) / np.sqrt(np.where(contradicted, 1.0, weight))
        fixes = record.located(kept, sigmas)
        plots = _Plots.of_fixes(fixes)
        found = cls(record, measured, trust, fixes, plots, plots.smoothed(record, jerk))
        for _ in range(_RELINEARISED):
            found = found.relinearised(float(found.track.jerk))
        return found

    def relinearised(self, jerk: float | None) -> _Smoothed:
        """Linearise about the track in place of each position, whose error is larger."""
        if np.sum(_is_finite(self.plots.covariance)) < 2:
            # a single position is its own track
            return self
        record, position = self.record, self.track.position
        residual = record.whitened(self.measured, position)
        weight = np.where(np.isnan(residual), 0.0, self._used()) / record.deviations() ** 2
        jacobian = record.jacobian(position)
        covariance = _inverse(jacobian, weight)
        good = np.asarray(self.fixes.success) & _is_finite(covariance)
        solution = _solution(jacobian, weight)
        left = np.where(weight > 0, residual * record.deviations(), 0.0)
        moved = position + np.einsum("nij,nj->ni", solution, left)
        # as of a robust position
        covariance *= np.where(self._robust(), _EFFICIENCY, 1.0)[:, np.newaxis, np.newaxis]
        plots = _Plots(
            np.where(good[:, np.newaxis], moved, self.plots.position),
            np.where(good[:, np.newaxis, np.newaxis], covariance, self.plots.covariance),
        )
        return replace(self, plots=plots, track=plots.smoothed(record, jerk))

    def _robust(self) -> BoolArray:
        """Whether each instant is located robustly, (N,)."""
        enough = np.asarray(self.fixes.degrees_of_freedom) >= _REDUNDANCY
        return enough & (self.record.spatial == "robust")

    def _used(self) -> FloatArray:
        """Return the weights with which the measurements are in the positions, (N, M)."""
        near = self.record.whitened(self.measured, self.fixes.position)
        inside = np.where(self._robust()[:, np.newaxis], _tukey(near), 1.0)
        return np.where(np.isnan(near), 0.0, self.trust * inside)

    @classmethod
    def first(cls, record: _Record, jerk: float | None) -> _Smoothed:
        """Locate and smooth what was measured, all of it."""
        trust = np.ones((len(record.times), sum(v.shape[1] for v in record.measured.values())))
        return cls.made(record, record.measured, jerk, trust)

    def without_faults(self, measured: _Measured, jerk: float | None) -> _Smoothed:
        """Leave out what the smooth track contradicts, until nothing else is."""
        found = self
        robust = self.record.spatial == "robust"
        for at in range(_PASSES if robust else 1):
            judged = robust and (at > 0 or measured is self.measured)
            trust = found.trusted() if judged else found.trust
            unchanged = np.max(np.abs(trust - found.trust), initial=0.0) < _UNCHANGED
            if unchanged and measured is found.measured:
                break
            known = float(found.track.jerk)
            found = self.made(self.record, measured, known, trust).relinearised(jerk)
        return found

    @property
    def outlier(self) -> ByKind:
        """What was left out in space, or is contradicted."""
        marked = dict(zip(self.measured, _split(self.trust == 0, self.measured), strict=True))
        space = self.fixes.outlier
        return ByKind(
            *(getattr(space, kind) | marked[kind] if kind in marked else None for kind in KINDS)
        )

    def trusted(self) -> FloatArray:
        """Return the weights of the measurements by what the rest of the track says.

        Where an instant is located robustly, one that both the track and the other measurements of
        the instant contradict is left out, the worst one first: motion that the smoother does not
        know contradicts the track alone. With fewer degrees of freedom the others cannot tell, and
        the weights are Tukey's about the track.
        """
        fixes, track = self.fixes, self.track
        missing = np.isnan(self.record.whitened(self.measured, fixes.position))
        used = self._used()
        of_instant = np.abs(self._deleted(fixes.position, fixes.covariance, used))
        of_track = np.abs(self._deleted(track.position, track.position_covariance, used))
        told = of_track[~np.isnan(of_track)]
        if told.size == 0:
            return self.trust
        scale = _scale(told)
        limit = -NormalDist().inv_cdf(_FALSE_ALARM / 2 / told.size)
        with np.errstate(invalid="ignore"):
            doubtful = (of_track > limit * scale) & (of_instant > _DOUBTED)
        worst = np.max(np.where(doubtful & (self.trust > 0), of_track, 0.0), axis=1, keepdims=True)
        contradicted = doubtful & ((self.trust == 0) | (of_track == worst))
        rest = np.count_nonzero(~missing, axis=1) - fixes.position.shape[-1]
        poor = ((rest > 0) & (rest < _REDUNDANCY))[:, np.newaxis]
        soft = _tukey(of_track / scale)
        return np.where(poor, np.where(soft < _FAINT, 0.0, soft), np.where(contradicted, 0.0, 1.0))

    def _deleted(
        self, position: FloatArray, covariance: FloatArray, used: FloatArray
    ) -> FloatArray:
        """Return residuals about what follows without the measurement, over their sigmas, (N, M).

        With the residual r, the weight w and g = J P J' / sigma²: the position without it predicts
        it with the error r / (1 - w g), of the variance sigma² (1 + g / (1 - w g)).
        """
        record = self.record
        residual = record.whitened(self.measured, position)
        jacobian = record.jacobian(position) / record.deviations()[..., np.newaxis]
        with np.errstate(invalid="ignore"):
            g = np.einsum("nmi,nij,nmj->nm", jacobian, covariance, jacobian)
            rest = 1.0 - used * g
            told = np.isfinite(g) & (rest > _REDUNDANT)
        rest, g = np.where(told, rest, 1.0), np.where(told, g, 0.0)
        return np.where(told, residual / rest / np.sqrt(1.0 + g / rest), np.nan)

    def covariance_with_jerk(self) -> FloatArray:
        """Return the covariance of the states with the uncertainty of the fitted jerk in it.

        The mean over intensities by their likelihood, with a prior on their logarithm that rises
        with the fourth root of the intensity.
        """
        best, tracks = self.track, self._with_jerks()
        if not tracks:
            return best.covariance
        known = _is_finite(best.covariance)
        told = [float(t.log_likelihood) + _JERK_PRIOR * np.log(float(t.jerk)) for t in tracks]
        share = np.exp(np.subtract(told, max(told)))
        share /= np.sum(share)
        covariance = np.zeros_like(best.covariance)
        for part, track in zip(share, tracks, strict=True):
            change = np.where(known[:, np.newaxis], track.mean - best.mean, 0.0)
            covariance += part * (
                np.where(known[:, np.newaxis, np.newaxis], track.covariance, 0.0)
                + change[:, :, np.newaxis] * change[:, np.newaxis]
            )
        return np.where(known[:, np.newaxis, np.newaxis], covariance, best.covariance)

    def _with_jerks(self) -> list[SmoothedPositions]:
        """Return the tracks with all intensities that are likely; none where it is not told.

        Around a fitted one that is well told; else from hardly any on, until they are unlikely.
        """
        best, jerk = self.track, float(self.track.jerk)
        error = float(best.jerk_sigma) / jerk if jerk > 0 else np.inf
        if error < _JERK_TOLD:
            near = (jerk * np.exp(step * error) for step in _JERK_STEPS)
            return [best, *(self.plots.smoothed(self.record, one) for one in near)]
        plots, times = self.plots, self.record.times
        known = _is_finite(plots.covariance)
        span = float(np.ptp(times[known]))
        if np.unique(times[known]).size <= _STATE or span == 0:
            return []
        least = np.min(np.linalg.eigvalsh(plots.covariance[known]))
        # below the first one the motion is that of none; the likelihood falls as a power
        first = np.log(least) - _STATE_POWER * np.log(span) - _JERK_MARGIN
        tracks: list[SmoothedPositions] = []
        top = -np.inf
        for log in first + np.arange(_MOST_JERKS):
            track = self.plots.smoothed(self.record, float(np.exp(log)))
            tracks.append(track)
            value = float(track.log_likelihood)
            top = max(top, value)
            if value < top - _JERK_FALL:
                break
        return tracks


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
            time=record.times,
            variance=variances,
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
        time=record.times,
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
            time=record.times,
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
    def estimate(cls, record: _Record, found: _Smoothed, kinds: tuple[Kind, ...]) -> _Biases:
        """Estimate them from the residuals about the smooth trajectory."""
        measured, position = found.measured, found.track.position
        located = np.asarray(found.fixes.success)[:, np.newaxis] & ~np.isnan(position)[:, :1]
        residual = record.whitened(measured, position)
        outlier = np.concatenate([getattr(found.outlier, kind) for kind in measured], axis=1)
        usable = located & ~np.isnan(residual) & ~outlier
        residual = np.where(usable, residual, 0.0)
        robust = record.spatial == "robust" and np.any(usable)
        scale = _scale(np.abs(residual[usable])) if robust else np.inf
        weight = np.where(usable, _tukey(residual / scale) / record.deviations() ** 2, 0.0)
        known = {kind: _is_seen(record.measured[kind]) for kind in kinds}
        at = _columns(measured, known)
        jacobian = record.jacobian(position)
        solution = _solution(jacobian, weight)
        kept = _kept(jacobian, solution, weight, at)
        # W r
        weighted = weight * residual * record.deviations()
        # (I - H)' W r: the position has no part in it
        scores = np.einsum("nip,ni->np", kept, weighted)
        information = _information(kept, weight)
        names = [f"{kind} of station {k}" for kind in kinds for k in np.flatnonzero(known[kind])]
        spurious = _spurious(record, found.track, weight, at)
        size = np.sqrt(np.sum(weight, axis=0)[at])
        # the derivative of the scores: less than their weights, which fall with the residuals
        inverse = _inverted(information, spurious, size, names) / _slope(residual[usable] / scale)
        values = inverse @ np.sum(scores, axis=0)
        left = residual * record.deviations()
        left = left - np.einsum("nij,nj->ni", jacobian @ solution, left) - kept @ values
        share = 1.0 - np.einsum("nmi,nim->nm", jacobian, solution)
        least = record.deviations() ** 2 * (_TAPERED if robust else 1.0)
        variance = np.maximum(least, _variances(left, share, weight**2))
        covariance = _spread(inverse, kept, weight, variance, left)
        columns = np.moveaxis(solution[:, :, at], -1, 0)
        spread = _inverse(jacobian, weight)
        missing = ~_is_finite(spread)
        columns = np.where(missing[:, np.newaxis], np.nan, columns)
        return cls(record, kinds, known, values, covariance, columns, spread)

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

    def as_bias(self) -> Bias:
        """Return them for all stations."""
        fields: dict[str, Any] = {str(k): v for k, v in self.split(self.values, 0.0).items()}
        sigmas = self.split(self.sigma, np.inf)
        return Bias(**fields | {f"{kind}_sigma": sigma for kind, sigma in sigmas.items()})

    def effect(self, track: SmoothedPositions) -> FloatArray:
        """Return what their uncertainty adds to the covariance of the states."""
        response = smooth(
            self.columns,
            self.spread,
            time=self.record.times,
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


def _spurious(
    record: _Record, track: SmoothedPositions, weight: FloatArray, at: IntArray
) -> FloatArray:
    """Return the information that errors of the positions alone make."""
    position = track.position
    information = np.zeros((len(at), len(at)))
    for shift in np.moveaxis(_root(track.position_covariance), -1, 0):
        ahead, behind = (
            _kept(moved, _solution(moved, weight), weight, at)
            for moved in (record.jacobian(position + shift), record.jacobian(position - shift))
        )
        information += _information((ahead - behind) / 2, weight)
    return information


def _spread(
    inverse: FloatArray,
    kept: FloatArray,
    weight: FloatArray,
    variance: FloatArray,
    residual: FloatArray,
) -> FloatArray:
    """Return the covariance of biases: that of the scores, between their inverse slopes.

    Errors that stay for a while make it larger.
    """
    noise = _information(kept, weight**2 * variance)
    # what each instant adds to each bias
    parts = np.einsum("pq,nip,ni->pn", inverse, kept, weight * residual)
    root = np.sqrt([_repeats(part) for part in parts])
    return np.asarray(inverse @ noise @ inverse * np.outer(root, root))


def _variances(residual: FloatArray, share: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the variance of each column's errors, of which residuals have that share, (M,)."""
    there = weight > 0
    variances: FloatArray = np.sum(np.where(there, weight * residual**2, 0.0), axis=0) / np.maximum(
        np.sum(np.where(there, weight * share, 0.0), axis=0), np.finfo(float).tiny
    )
    return variances


def _repeats(series: FloatArray) -> float:
    """Return how many instants tell as much as one would, if errors were independent, at least 1.

    One plus twice the sum of the autocorrelations, as long as pairs of them are positive (Geyer
    1992); the first pair has to be more than chance.
    """
    whole = float(np.sum(series**2))
    total = 0.0
    for lag in range(1, len(series) // 2, 2):
        products = [series[one:] * series[:-one] for one in (lag, lag + 1)]
        pair = sum(float(np.sum(product)) for product in products)
        chance = np.sqrt(sum(float(np.sum(product**2)) for product in products))
        if not pair > (_CHANCE * chance if lag == 1 else 0.0):
            break
        total += pair / whole
    return 1.0 + 2.0 * total


def _tukey(residual: FloatArray) -> FloatArray:
    """Return Tukey's weights, 1 where there is no residual."""
    share = np.minimum(np.abs(np.nan_to_num(residual)) / _TUKEY, 1.0)
    weight: FloatArray = (1.0 - share**2) ** 2
    return weight


def _slope(residual: FloatArray) -> float:
    """Return the mean slope of Tukey's scores, u w(u), over their mean weight."""
    square = np.minimum((residual / _TUKEY) ** 2, 1.0)
    return float(np.sum((1 - square) * (1 - 5 * square)) / np.sum((1 - square) ** 2))


def _scale(size: FloatArray) -> float:
    """Return by how much residuals are larger than their standard deviations say, at least 1.

    From their median, less what it may be off by chance.
    """
    chance = 1.0 + _CHANCE * _MEDIAN_ERROR / np.sqrt(size.size)
    return max(1.0, float(np.median(size) / NormalDist().inv_cdf(0.75) / chance))


def _split(together: npt.NDArray[Any], measured: _Measured) -> list[npt.NDArray[Any]]:
    """Return the columns of each kind."""
    if not measured:
        return []
    counts = [values.shape[1] for values in measured.values()]
    return np.split(together, np.cumsum(counts)[:-1], axis=1)


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
    outlier: ByKind | None = None,
    biases: _Biases | None = None,
    track: SmoothedPositions | None = None,
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
        fixes.outlier if outlier is None else outlier,
        _by_kind(residuals),
        None if biases is None else biases.as_bias(),
        track,
    )


def _instants(time: npt.ArrayLike) -> FloatArray:
    instants = finite(time, "time")
    if instants.ndim != 1 or instants.size == 0:
        raise ValueError(f"time has shape {instants.shape}; it must be (N,)")
    back = np.flatnonzero(np.diff(instants) < 0)
    if back.size:
        raise ValueError(
            f"time[{back[0] + 1}] is before the time before it; time must not decrease"
        )
    return instants


def _places(
    stations: Sequence[Station], n: int
) -> tuple[FloatArray, FloatArray | None, dict[Kind, FloatArray]]:
    """Return positions, (K, D) or (N, K, D), axes, and standard deviations, (K,)."""
    if not isinstance(stations, Sequence) or not all(isinstance(s, Station) for s in stations):
        raise TypeError("stations must be a sequence of Station")
    if not stations:
        raise ValueError("stations is empty; it must have at least one")
    places, axes, sigmas = stack_stations(stations)
    if places.ndim > 3 or (places.ndim == 3 and len(places) != n):
        raise ValueError(
            f"stations have positions of shape {places.shape[:-2]}; there are {n} instants"
        )
    return places, axes, {kind: sigmas[kind] for kind in STATION_KINDS}


def _checked(
    values: npt.ArrayLike,
    sigma: FloatArray | None,
    kind: Kind,
    shape: tuple[int, int],
    *,
    degrees: bool,
) -> FloatArray:
    """Return measurements, of which each has a standard deviation."""
    n, k = shape
    count = k - int(kind == "range_difference")
    array = radians(values, kind, degrees=degrees) if kind in ANGLES else samples(values, kind)
    if array.shape != (n, count):
        raise ValueError(
            f"{kind} has shape {array.shape}; for {n} instants and {k} stations it must be "
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


def _estimated(
    bias: Bias | None, measured: _Measured, order: Order, smoother: Smoother
) -> tuple[Kind, ...]:
    """Return the kinds of which biases are to be estimated."""
    if bias is None:
        return ()
    if not isinstance(bias, Bias):
        raise TypeError(f"bias is {bias!r}; it must be a Bias")
    kinds = []
    for kind in STATION_KINDS:
        sigma = getattr(bias, f"{kind}_sigma")
        if np.any(getattr(bias, kind)):
            raise ValueError(f"bias.{kind} is {getattr(bias, kind)}; it must be 0")
        if sigma is None:
            kinds.append(kind)
        elif np.any(sigma):
            raise ValueError(f"bias.{kind}_sigma is {sigma}; it must be 0, or None: estimated")
        if sigma is None and kind not in measured:
            raise ValueError(f"bias.{kind}_sigma is None, but {kind} was not measured")
    if kinds and (order, smoother) != ("spatial-first", "rts"):
        raise ValueError("bias needs order 'spatial-first' and smoother 'rts'")
    return tuple(kinds)


def _columns(measured: _Measured, known: dict[Kind, BoolArray]) -> IntArray:
    """Return where the biases' columns are, if all measurements are side by side."""
    counts = [values.shape[1] for values in measured.values()]
    first = dict(zip(measured, np.cumsum([0, *counts[:-1]]), strict=True))
    return np.concatenate([first[kind] + np.flatnonzero(own) for kind, own in known.items()])


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


def _is_seen(values: FloatArray) -> BoolArray:
    """Whether each column has a number."""
    return np.asarray(~np.isnan(values).all(axis=0))


def _diagonal(variances: FloatArray) -> FloatArray:
    matrices = np.zeros((*variances.shape, variances.shape[-1]))
    at = np.arange(variances.shape[-1])
    matrices[..., at, at] = np.where(np.isnan(variances), np.inf, variances)
    return matrices


def _by_kind(arrays: dict[Kind, FloatArray]) -> ByKind:
    return ByKind(*(arrays.get(kind) for kind in KINDS))


def _statistics(residual: FloatArray, outlier: BoolArray) -> FloatArray:
    kept = ~(np.isnan(residual) | outlier)
    count = np.sum(kept, axis=0)
    values = np.where(kept, residual, 0.0)
    with np.errstate(invalid="ignore"):
        mean = np.sum(values, axis=0) / count
        rms = np.sqrt(np.sum(values**2, axis=0) / count)
    return np.column_stack([count, mean, rms])
