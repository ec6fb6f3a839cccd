"""Maximum likelihood for the parameters of the Singer model and the noise of the plots."""

from __future__ import annotations

from typing import Any

import numpy as np

from tertia import _core
from tertia._arrays import FloatArray

# steps of the logarithms for differences: the likelihood is computed to about 1e-12
_DIFFERENCE = 1e-3
_ITERATIONS = 50
_SETTLED = 1e-7
# innovations of this share of the plots are their rounding
_ROUNDING = 1e-13


def fit_singer(
    batch: dict[str, Any], n_threads: int | None
) -> tuple[float, float, float, FloatArray, float, int]:
    """Return alpha, acceleration sigma, noise sigma, their relative errors, log L and n."""
    shortest, longest = _spans(batch)
    likelihood = _Likelihood(batch, n_threads, 1e-2 / shortest**2)
    alphas = np.geomspace(0.1 / longest, 3.0 / shortest, 7)
    # what an acceleration does within the shortest step, in units of the noise
    ratios = np.geomspace(1e-5, 1e2, 15) / shortest**2
    grid = np.array([np.log([alpha, ratio]) for alpha in alphas for ratio in ratios])
    start = grid[np.argmax([likelihood.profile(logs) for logs in grid])]
    logs = _climb(likelihood, start, grid[0], grid[-1])
    log_likelihood = likelihood.profile(logs)
    alpha, ratio = np.exp(logs).tolist()
    sigma = float(np.sqrt(likelihood.scale))
    at = np.log([alpha, ratio * sigma, sigma])
    errors = _relative_errors(_derivatives(likelihood.full, at)[1])
    return alpha, ratio * sigma, sigma, errors, log_likelihood, likelihood.count


def _spans(batch: dict[str, Any]) -> tuple[float, float]:
    """Return the shortest interval and the length of the longest series."""
    intervals = batch["dt"]
    shortest = float(np.min(intervals[intervals > 0], initial=np.inf))
    if not np.isfinite(shortest):
        raise ValueError("no time passes between the plots; dt must be positive, or times rise")
    if intervals.size == 1:
        return shortest, shortest * batch["z"].shape[-1]
    return shortest, float(np.max(np.sum(intervals, axis=-1)))


class _Likelihood:
    """The likelihood of a recording; `scale` and `count` are those of the last call."""

    def __init__(self, batch: dict[str, Any], n_threads: int | None, ratio: float) -> None:
        self.batch, self.n_threads = batch, n_threads
        self.unit, self.scale, self.count = 1.0, np.nan, 0
        # in the recording's own unit, the sums below are of the order of the number of plots
        self.unit = float(np.sqrt(self._run(0.1 * ratio**0.5, ratio)[1] / self.count))
        largest = float(np.nanmax(np.abs(batch["z"])))
        if not self.unit > _ROUNDING * largest:
            raise ValueError("z lies on straight lines; there is no noise to be fitted")

    def _run(self, alpha: float, ratio: float) -> tuple[float, float]:
        """Return log L for noise of one unit, and the sum of normalised squares."""
        variance = np.full_like(self.batch["variance"], self.unit**2)
        batch = self.batch | {"model": (alpha, ratio * self.unit, True), "variance": variance}
        arrays, count = _core.filter_series(batch, "all", self.n_threads)
        self.count = int(np.sum(count))
        if self.count == 0:
            raise ValueError("z has no series of three plots; two of each are needed to start")
        return float(np.sum(arrays[6])), float(np.nansum(arrays[2] ** 2 / arrays[3]))

    def profile(self, logs: FloatArray) -> float:
        """Return log L for the best scale; `logs` of alpha and of acceleration over noise."""
        unscaled, squares = self._run(*np.exp(logs).tolist())
        self.scale = squares / self.count * self.unit**2
        if not self.scale > 0:
            raise ValueError("z lies on straight lines; there is no noise to be fitted")
        constant = 0.5 * self.count * (1 + float(np.log(squares / self.count)))
        return unscaled + 0.5 * squares - constant

    def full(self, logs: FloatArray) -> float:
        """Return log L; `logs` of alpha, acceleration sigma and noise sigma."""
        alpha, acceleration, noise = np.exp(logs).tolist()
        unscaled, squares = self._run(alpha, acceleration / noise)
        size = noise / self.unit
        value: float = unscaled + 0.5 * squares * (1 - size**-2) - self.count * np.log(size)
        return value


def _derivatives(f: Any, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return gradient and second derivatives by central differences."""
    steps = _DIFFERENCE * np.eye(len(x))
    middle = f(x)
    up, down = ([f(x + sign * step) for step in steps] for sign in (1, -1))
    gradient = (np.array(up) - np.array(down)) / (2 * _DIFFERENCE)
    second = np.empty((len(x), len(x)))
    for i, a in enumerate(steps):
        second[i, i] = up[i] - 2 * middle + down[i]
        for j, b in enumerate(steps[:i]):
            mixed = f(x + a + b) - f(x + a - b) - f(x - a + b) + f(x - a - b)
            second[i, j] = second[j, i] = mixed / 4
    return gradient, second / _DIFFERENCE**2


def _climb(
    likelihood: _Likelihood, x: FloatArray, lowest: FloatArray, highest: FloatArray
) -> FloatArray:
    """Go to the maximum by Newton's method, kept uphill and within the box."""
    value = likelihood.profile(x)
    for _ in range(_ITERATIONS):
        gradient, second = _derivatives(likelihood.profile, x)
        curvature, axes = np.linalg.eigh(-second)
        # a direction that curves upwards is climbed by its gradient
        step = axes @ ((axes.T @ gradient) / np.maximum(np.abs(curvature), 0.1))
        step *= min(1.0, 2.0 / float(np.max(np.abs(step), initial=1e-300)))
        for _ in range(30):
            tried = np.clip(x + step, lowest, highest)
            found = likelihood.profile(tried)
            if found > value:
                break
            step /= 2
        else:
            break
        moved = float(np.max(np.abs(tried - x)))
        x, value = tried, found
        if moved < _SETTLED:
            break
    return x


def _relative_errors(second: FloatArray) -> FloatArray:
    """Return standard errors of the logarithms; inf where the likelihood does not bend down."""
    for known in ([0, 1, 2], [1, 2], [2]):
        information = -second[np.ix_(known, known)]
        if np.all(np.linalg.eigvalsh(information) > 1e-3):
            errors = np.full(len(second), np.inf)
            errors[known] = np.sqrt(np.diagonal(np.linalg.inv(information)))
            return errors
    return np.full(len(second), np.inf)
