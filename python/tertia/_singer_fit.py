"""Maximum likelihood for the parameters of the Singer model and the noise of the plots.

A point is `x = ln α` and `y = ln p`, where p is what the motion adds within some time, in units of
the noise. The likelihood has a finite limit at either end of both. It is climbed from the peaks of
a coarse grid and then compared with its limits. The unit of time is a usual interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from tertia import _core
from tertia._arrays import BoolArray, FloatArray

Limit: TypeAlias = Literal[
    "white acceleration", "constant acceleration", "constant rate", "no noise"
]

# intervals of this share of the mean are between plots of different radars, and not usual
_BRIEF = 1e-4
# of so short a time between its first two plots, a filter knows no more than rounding
_TOGETHER = 1e-10
# the grid: alpha from this over the length to that over an interval, p likewise, and their factors
_ALPHA = (0.3, 10.0, 8.0)
_MOTION = (0.1, 30.0, 20.0)
_STARTS = 3
# how far beyond the grid is climbed: alpha is tiny where the acceleration grows all the time
_BELOW, _ABOVE = np.log(1e4), np.log(10.0)
# α and p that count as infinite: there the likelihood is that of the limit to about 1e-6
_INFINITE_ALPHA, _INFINITE_MOTION = np.log(1e6), np.log(1e7)
# steps for differences: the likelihood is computed to about 1e-12
_DIFFERENCE = 5e-3
_ITERATIONS = 60
_LONGEST_STEP, _SHORTER_STEPS = 2.0, 15
# a step that gains so little is the last one: with the gain goes the square of what is left
_SETTLED, _ROUGHLY_SETTLED = 1e-6, 1.0
_BESIDE = 0.5
# a limit that is so much less likely at first is not climbed
_HOPELESS = 10.0
# a limit is taken if it is as likely as that
_AS_LIKELY = 1e-8
# a curvature below this tells nothing
_FLAT = 1e-3
# innovations of this share of the plots are their rounding
_ROUNDING = 1e-13


class _Peak(NamedTuple):
    """A point of the largest likelihood; `free` are the coordinates that are not at a limit."""

    value: float
    at: FloatArray
    free: BoolArray


def fit_singer(
    batch: dict[str, Any], n_threads: int | None
) -> tuple[float, float, float, FloatArray, float, int, float, tuple[Limit, ...]]:
    """Return alpha, acceleration sigma and noise sigma, and how well they are told.

    That is: their relative errors, log L, the number of innovations, the relative error of the
    density 2 σ_a² / α, and the limits.
    """
    interval = _usual_interval(batch["dt"])
    dt = batch["dt"] / interval
    likelihood = _Likelihood(batch | {"dt": np.where(dt < _TOGETHER, 0.0, dt)}, n_threads)
    peaks: list[_Peak] = []
    for start in _starts(likelihood):
        peaks.append(_climb(likelihood, start, np.array([True, True]), climbed=peaks))
    peak = _peak_or_limit(likelihood, max(peaks, key=lambda peak: peak.value))
    value, logs = likelihood(peak.at)
    likelihood.spread(value, "parabolas")
    alpha, acceleration_sigma, measurement_sigma = np.exp(logs).tolist()
    with np.errstate(invalid="ignore"):
        estimates = np.exp([*logs, 2 * logs[1] - logs[0]])
    estimates[3] *= 2 / interval**3
    estimates[:2] /= [interval, interval**2]
    errors = np.append(*_errors(likelihood, peak))
    sigma = np.full(4, np.inf)
    np.multiply(errors, estimates, out=sigma, where=np.isfinite(errors))
    return (
        alpha / interval,
        acceleration_sigma / interval**2,
        measurement_sigma,
        sigma[:3],
        value,
        likelihood.count,
        float(sigma[3]),
        likelihood.limits(peak.at),
    )


def _usual_interval(intervals: FloatArray) -> float:
    positive = intervals[intervals > 0]
    if positive.size == 0:
        raise ValueError("no time passes between the plots; dt must be positive, or time rise")
    return float(np.median(positive[positive > _BRIEF * np.mean(positive)]))


class _Likelihood:
    """The likelihood with the best scale, each value computed once."""

    def __init__(self, batch: dict[str, Any], n_threads: int | None) -> None:
        self.batch, self.n_threads = batch, n_threads
        shape, intervals = batch["z"].shape, batch["dt"]
        # mean, covariance, innovation and its variance, written over by every call
        self.steps = [np.empty(size) for size in ((*shape, 3), (*shape, 6), shape, shape)]
        per_series = np.broadcast_to(intervals, shape[-1] - 1) if intervals.size == 1 else intervals
        self.length = float(np.max(np.sum(per_series, axis=-1)))
        self.alphas = np.log([_ALPHA[0] / self.length, _ALPHA[1]])
        self.found: dict[tuple[float, float], tuple[float, FloatArray]] = {}
        self.count, self.unit, self.memory = 0, 1.0, 1.0
        # in the recording's own unit, sums of squares are of the order of the number of plots
        self.unit = self.spread(self(-np.log([10, 10]))[0], "straight lines")
        self.remember(1.0)

    def spread(self, value: float, curves: str) -> float:
        """Return what is claimed for the innovations, in the mean; it must not be rounding."""
        spread = float(np.exp(-value / self.count - 0.5 * np.log(2 * np.pi * np.e)))
        if not spread > _ROUNDING * float(np.nanmax(np.abs(self.batch["z"]))):
            raise ValueError(f"z lies on {curves}; there is no noise to be fitted")
        return spread

    def __call__(self, at: FloatArray) -> tuple[float, FloatArray]:
        """Return log L, and the logarithms of alpha, acceleration sigma and noise sigma."""
        x, y = at.tolist()
        if (x, y) not in self.found:
            # noise and motion together are one unit
            noise = np.log(self.unit) - np.logaddexp(0.0, y)
            logs = np.array([x, y + self.acceleration(x) + noise, noise])
            value, scale = self._run(*np.exp(logs).tolist())
            logs[1:] += 0.5 * scale
            self.found[x, y] = value, logs
        return self.found[x, y]

    def _run(self, alpha: float, acceleration: float, noise: float) -> tuple[float, float]:
        """Return log L for the best scale of the variances, and the logarithm of that scale."""
        variance = np.full_like(self.batch["variance"], noise**2)
        batch = self.batch | {"model": (alpha, acceleration, True), "variance": variance}
        _, counts = _core.filter_series(batch, "all", self.steps, self.n_threads)
        self.count = int(np.sum(counts))
        if self.count == 0:
            raise ValueError("z has no series of three plots; two of each are needed to start")
        innovation, expected = self.steps[2:]
        known = ~np.isnan(innovation)
        innovation, expected = innovation[known], expected[known]
        with np.errstate(divide="ignore"):
            scale = float(np.log(np.sum(innovation**2 / expected) / self.count))
        determinant = float(np.sum(np.log(expected)))
        value = -0.5 * (determinant + self.count * (np.log(2 * np.pi * np.e) + scale))
        return float(value), scale

    def remember(self, memory: float) -> None:
        """Let p be what the motion adds within this time."""
        self.memory = memory
        lowest = np.log(_MOTION[0]) - 2.5 * np.log(self.length / memory)
        beyond = 2.5 * np.log(memory)
        self.motions = np.array([lowest, np.log(_MOTION[1]) + beyond])
        self.infinite_motion = _INFINITE_MOTION + beyond
        self.found.clear()

    def acceleration(self, x: float) -> float:
        """Return ln (acceleration sigma / (p noise sigma))."""
        # p² is σ_a² τ⁴ / σ² times ατ for a slow manoeuvre, 1 / ατ for a fast one; for one slower
        # than the recording is long, σ_a itself is told
        reach, once = np.exp(x) * self.memory, self.memory / self.length
        return float(np.log1p(reach) - 0.5 * np.log(reach + once) - 2 * np.log(self.memory))

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the least and the largest coordinates to which is climbed."""
        least = np.array([self.alphas[0], self.motions[0]]) - _BELOW
        return least, np.array([self.alphas[1] + _ABOVE, self.infinite_motion])

    def limits(self, at: FloatArray) -> tuple[Limit, ...]:
        """Return the names of the limits at which a point is."""
        there: dict[Limit, bool] = {
            "white acceleration": at[0] == _INFINITE_ALPHA,
            "constant acceleration": at[0] == -np.inf < at[1],
            "constant rate": at[1] == -np.inf,
            "no noise": at[1] == self.infinite_motion,
        }
        return tuple(name for name, holds in there.items() if holds)


def _starts(likelihood: _Likelihood) -> list[FloatArray]:
    """Return the peaks among the best points of a grid of alphas, the highest first."""
    ends = (likelihood.alphas, likelihood.motions)
    alphas, motions = (
        np.linspace(low, high, 2 + int((high - low) / np.log(factor)))
        for (low, high), factor in zip(ends, (_ALPHA[2], _MOTION[2]), strict=True)
    )
    ridge = []
    for x in alphas:
        row = np.array([[x, y] for y in motions])
        start = row[np.argmax([likelihood(at)[0] for at in row])]
        free = np.array([False, True])
        ridge.append(_climb(likelihood, start, free, settled=_ROUGHLY_SETTLED))
    values = np.pad([point.value for point in ridge], 1, constant_values=-np.inf)
    high = (values[1:-1] >= values[:-2]) & (values[1:-1] >= values[2:])
    peaks = [point for point, is_peak in zip(ridge, high, strict=True) if is_peak]
    peaks = sorted(peaks, key=lambda peak: -peak.value)[:_STARTS]
    return _straightened(likelihood, [peak.at for peak in peaks])


def _straightened(likelihood: _Likelihood, points: list[FloatArray]) -> list[FloatArray]:
    """Return the points where p is that of the time after which a filter forgets.

    Ridges are straight then. It is the time in which the first point's motion is as large as the
    error of a mean of plots.
    """
    ratios = [y + likelihood.acceleration(x) for x, y in points]
    for time in np.geomspace(1.0, likelihood.length, 20).tolist():
        likelihood.remember(time)
        y = ratios[0] - likelihood.acceleration(points[0][0])
        if 2 * y > -np.log(time):
            break
    return [
        np.array([x, ratio - likelihood.acceleration(x)])
        for (x, _), ratio in zip(points, ratios, strict=True)
    ]


def _climb(
    likelihood: _Likelihood,
    at: FloatArray,
    free: BoolArray,
    *,
    settled: float = _SETTLED,
    climbed: Sequence[_Peak] = (),
) -> _Peak:
    """Go uphill by Newton's method in the coordinates that are free, within the bounds.

    Stop beside a higher peak that has been climbed before.
    """
    value = likelihood(at)[0]
    lowest, highest = likelihood.bounds()
    for _ in range(_ITERATIONS):
        gradient, second = _slope(likelihood, at, free)
        outward = np.where(gradient > 0, at >= highest, at <= lowest)
        step = _newton(gradient, second, free & ~outward)
        gain = gradient @ step
        for _ in range(_SHORTER_STEPS):
            tried = np.where(free, np.clip(at + step, lowest, highest), at)
            found = likelihood(tried)[0]
            if found > value:
                break
            step /= 3
        else:
            break
        at, value = tried, found
        if gain < settled or any(_is_beside(at, value, peak) for peak in climbed):
            break
    return _Peak(value, at, free)


def _is_beside(at: FloatArray, value: float, peak: _Peak) -> bool:
    return value < peak.value and bool(np.all(np.abs(at - peak.at) < _BESIDE))


def _slope(
    likelihood: _Likelihood, at: FloatArray, free: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return gradient and second derivatives by central differences, 0 for what is not free."""
    h, middle = _DIFFERENCE, likelihood(at)[0]
    gradient, second = np.zeros(2), np.zeros((2, 2))
    for i in np.flatnonzero(free):
        step = h * (np.arange(2) == i)
        up, down = likelihood(at + step)[0], likelihood(at - step)[0]
        gradient[i] = (up - down) / (2 * h)
        second[i, i] = (up - 2 * middle + down) / h**2
    if free.all():
        diagonal = (likelihood(at + h)[0] - 2 * middle + likelihood(at - h)[0]) / h**2
        second[0, 1] = second[1, 0] = 0.5 * (diagonal - np.trace(second))
    return gradient, second


def _newton(gradient: FloatArray, second: FloatArray, free: BoolArray) -> FloatArray:
    """Return Newton's step in the free coordinates, uphill, and not too long."""
    step = np.zeros(2)
    curvature, axes = np.linalg.eigh(-second[np.ix_(free, free)])
    # a direction that curves upwards is climbed as if it curved down
    step[free] = axes @ ((axes.T @ gradient[free]) / np.maximum(np.abs(curvature), _FLAT))
    return step / max(1.0, float(np.max(np.abs(step))) / _LONGEST_STEP)


def _peak_or_limit(likelihood: _Likelihood, peak: _Peak) -> _Peak:
    """Return the peak, or a limit that is as likely; limits of limits included."""
    best = peak
    for start, free in _limits_beside(likelihood, peak):
        if likelihood(start)[0] > peak.value - _HOPELESS:
            limit = _climb(likelihood, start, free)
            if limit.value > best.value - _AS_LIKELY:
                best = limit
    return best if best is peak else _peak_or_limit(likelihood, best)


def _limits_beside(likelihood: _Likelihood, peak: _Peak) -> list[tuple[FloatArray, BoolArray]]:
    """Return points at limits, each with the coordinates that are free there."""
    (x, y), free = peak.at, peak.free
    limits = []
    if free[0]:
        limits += [(np.array([end, y]), free & [False, True]) for end in (-np.inf, _INFINITE_ALPHA)]
    if free[1]:
        limits += [
            (np.array([x, likelihood.infinite_motion]), free & [True, False]),
            (np.array([-np.inf, -np.inf]), np.array([False, False])),
        ]
    return limits


def _errors(likelihood: _Likelihood, peak: _Peak) -> tuple[FloatArray, float]:
    """Return standard errors of the logarithms, and that of the density 2 σ_a² / α."""
    (x, y), free = peak.at, peak.free
    information = -_slope(likelihood, peak.at, free)[1]
    lowest, highest = likelihood.bounds()
    inside = free & (lowest < peak.at) & (peak.at < highest)
    for told in (inside, inside & [False, True]):
        block = information[np.ix_(told, told)]
        if np.all(np.linalg.eigvalsh(block) > _FLAT):
            break
    else:
        return np.full(3, np.inf), np.inf
    slopes = _slopes(likelihood, peak.at, told)
    variances = np.diagonal(slopes @ np.linalg.inv(block) @ slopes.T)
    # the scale has an error of its own, that of the standard deviation of so many values
    variances = variances + np.array([0, 1, 1, 2]) ** 2 / (2 * likelihood.count)
    alpha = told[0]
    known = [alpha, alpha, y < likelihood.infinite_motion, alpha or x == _INFINITE_ALPHA]
    errors = np.sqrt(np.where(known, variances, np.inf))
    return errors[:3], float(errors[3])


def _slopes(likelihood: _Likelihood, at: FloatArray, free: BoolArray) -> FloatArray:
    """Return the derivatives of the logarithms of alpha, both sigmas, and the density."""

    def logs(at: FloatArray) -> FloatArray:
        alpha, acceleration, noise = np.nan_to_num(likelihood(at)[1], neginf=0.0)
        return np.array([alpha, acceleration, noise, 2 * acceleration - alpha])

    steps = _DIFFERENCE * np.eye(2)[free]
    columns = [(logs(at + step) - logs(at - step)) / (2 * _DIFFERENCE) for step in steps]
    slopes: FloatArray = np.reshape(columns, (len(steps), 4)).T
    return slopes
