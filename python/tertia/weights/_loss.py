"""The loss due to estimated weights, and the number of measurements that keeps it below a bound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import (
    FloatArray,
    IntArray,
    choice,
    diagonal,
    generator,
    integer,
    real,
    samples,
    scalar_or_array,
    threads,
)
from tertia._result import Result
from tertia._wishart import standard_wishart
from tertia.weights._samples import Convention
from tertia.weights._spread import LARGEST_N, Count, counts

LossMethod: TypeAlias = Literal["auto", "first-order", "monte-carlo"]

# below this many degrees of freedom per (m + 1) the first-order loss may be off by more than a
# twentieth of itself: docs/weights-accuracy.md
_FIRST_ORDER_FROM = 100
_TRIALS = 10_000
# simulated losses must stay below the bound with so many of their sigmas
_SIGMAS = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class FusionLoss(Result):
    """The loss of a fused estimate whose weights are estimated.

    Attributes
    ----------
    loss : float or ndarray of shape (...)
        `trace(mean_squared_error) / trace(fused_covariance) - 1`.
    component_loss : ndarray of shape (..., m)
        The same quantity for each component alone; unlike `loss`, it does not depend on the units.
    mean_squared_error : ndarray of shape (..., m, m)
        Mean squared error of the estimate that is fused with estimated weights.
    fused_covariance : ndarray of shape (..., m, m)
        Covariance of the estimate that is fused with the true weights.
    loss_sigma : float, ndarray of shape (...) or None
        Standard error of `loss` if it was simulated; otherwise None.
    method : {"first-order", "monte-carlo"}
        Method by which the loss was computed.
    """

    _rows: ClassVar = "loss", 0

    loss: float | FloatArray
    component_loss: FloatArray
    mean_squared_error: FloatArray
    fused_covariance: FloatArray
    loss_sigma: float | FloatArray | None
    method: str

    def __repr__(self) -> str:
        """Show the loss."""
        if isinstance(self.loss, np.ndarray):
            return f"FusionLoss(batch {self.loss.shape}, {self.method})"
        error = "" if self.loss_sigma is None else f" ± {self.loss_sigma:.1%}"
        return f"FusionLoss({self.loss:.2%}{error}, {self.method})"


def fusion_loss(
    covariances: npt.ArrayLike,
    n: Count,
    *,
    method: LossMethod = "auto",
    convention: Convention = "sample-mean",
    trials: int = _TRIALS,
    rng: np.random.Generator | int = 0,
    n_threads: int | None = None,
) -> FusionLoss:
    """Return the increase of the mean squared error that estimated weights cause.

    Parameters
    ----------
    covariances : array_like of shape (..., K, m, m)
        The true covariances, or their estimates, as for `weight_matrices`.
    n : int, inf or array_like of shape (K,)
        Number of measurements from which each covariance is estimated; inf if the covariance is
        known.
    method : {"auto", "first-order", "monte-carlo"}
        "first-order": a closed form, whose result is too small if n is small or W is near 0 or I.
        "monte-carlo": the mean over simulated covariances, which is exact except for its standard
        error.
        "auto": the closed form is used if there are at least 100 (m + 1) degrees of freedom, so
        that its error is at most a twentieth of the loss; otherwise Monte Carlo is used.
    convention : {"sample-mean", "known-mean", "paper", "differences"}
        How the covariances are estimated (see `sample_covariance`).
    trials : int
        Number of simulated sets of covariances, at least 2. All elements of the batch use the same
        sets.
    rng : numpy.random.Generator or int
        Random generator or seed; by default a fixed seed, so that the result is always the same.
    n_threads : int, optional
        Number of threads; by default one for small tasks and all cores for large ones.

    Returns
    -------
    FusionLoss
        The loss, the matrix of the mean squared error, and the standard error of the loss.

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError, TypeError
        As for `weight_covariance` and `fused_covariance`.

    Notes
    -----
    To first order the mean squared error is
    `{I + sum over j of c_j [tr(I - W_j) W_j + W_j (I - W_j)]} S_p`, with c_j from
    `covariance_factor`; for equal sensors the loss is `(m + 1) / (2 (n - 1))`. If two sensors
    together have fewer than m + 4 degrees of freedom, the squared error has no variance, and the
    standard error of the loss is not reliable.

    Examples
    --------
    >>> from tertia import weights
    >>> S = [[[4, 1], [1, 2]], [[1, -0.5], [-0.5, 3]]]
    >>> weights.fusion_loss(S, 10, method="first-order")
    FusionLoss(15.16%, first-order)
    """
    s = samples(covariances, "covariances")
    choice(method, "method", ("auto", "first-order", "monte-carlo"))
    trials = integer(trials, "trials", 2)
    # also where it is not used, for it checks everything
    first = _core.weigh("excess", s, threads(n_threads), n=counts(n), convention=convention)
    sensors, m = s.shape[-3:-1]
    laws = _core.wishart_law(counts(n), convention, sensors)
    if method == "auto":
        enough = min(law[0] for law in laws) >= _FIRST_ORDER_FROM * (m + 1)
        method = "first-order" if enough else "monte-carlo"
    if method == "first-order":
        matrices, sigma = first, None
        loss = _trace(first[..., 1, :, :]) / _trace(first[..., 0, :, :])
    else:
        draws = _draws(laws, m, trials, generator(rng))
        matrices, loss, sigma = _simulated(s, draws, n_threads)
    fused, excess = (matrices[..., i, :, :].copy() for i in (0, 1))
    return FusionLoss(
        scalar_or_array(loss),
        diagonal(excess) / diagonal(fused),
        fused + excess,
        fused,
        None if sigma is None else scalar_or_array(sigma),
        method,
    )


def required_samples(
    covariances: npt.ArrayLike,
    loss: float = 0.05,
    *,
    method: Literal["first-order", "monte-carlo"] = "monte-carlo",
    convention: Convention = "sample-mean",
    trials: int = _TRIALS,
    rng: np.random.Generator | int = 0,
    n_threads: int | None = None,
) -> int | IntArray:
    """Return the number of measurements per sensor that keeps the fusion loss below a bound.

    Parameters
    ----------
    covariances : array_like of shape (..., K, m, m)
        The true covariances, or assumed ones, as for `weight_matrices`.
    loss : float
        Bound on the loss, as defined in `fusion_loss`.
    method : {"first-order", "monte-carlo"}
        "monte-carlo": the simulated loss plus two of its standard errors must be below the bound.
        "first-order": the loss in closed form must be below the bound; the resulting n is too small
        if W is near 0 or I.
    trials : int
        Number of simulated sets of covariances for each n, at least 2.
    convention, rng, n_threads
        As for `fusion_loss`.

    Returns
    -------
    int or ndarray of int, shape (...)
        The smallest sufficient n, the same for all sensors.

    Raises
    ------
    numpy.linalg.LinAlgError, ValueError, TypeError
        As for `fusion_loss`; also if the bound is not between 1e-6 and 1e6.

    Notes
    -----
    In all cases that were tried (docs/weights.md), the following numbers of measurements kept the
    loss below 5 % if all covariances were unknown. For two sensors, n >= 15 m + 6 if m <= 3, and `n
    >= 1 + 22 max((m + 3)² / 16 [m <= 5], m - 1)` for any m, where [m <= 5] is 1 if m <= 5 and 0
    otherwise. For more sensors, n >= 1 + 22 (m + 1).

    Examples
    --------
    >>> from tertia import weights
    >>> weights.required_samples([[[1.0]], [[1.0]]], 0.05, method="first-order")
    21
    """
    s = samples(covariances, "covariances")
    bound, trials = real(loss, "loss"), integer(trials, "trials", 2)
    if not 1e-6 <= bound <= 1e6:
        raise ValueError(f"loss is {bound}; it must be between 1e-6 and 1e6")
    choice(method, "method", ("first-order", "monte-carlo"))
    seed = int(generator(rng).integers(2**63))
    both = _core.weigh("excess", s, threads(n_threads), n=LARGEST_N, convention=convention)
    per_factor = _trace(both[..., 1, :, :]) / _trace(both[..., 0, :, :])
    per_factor = np.atleast_1d(per_factor / _relative_factor(LARGEST_N, convention)).ravel()
    sensors, m = s.shape[-3:-1]
    problems = s.reshape(-1, sensors, m, m)

    def first_order(problem: IntArray, n: int) -> npt.NDArray[np.bool_]:
        # a bound that is met exactly is kept, whatever rounding says
        return per_factor[problem] * _relative_factor(n, convention) <= bound * (1 + 1e-12)

    def simulated(problem: IntArray, n: int) -> npt.NDArray[np.bool_]:
        laws = _core.wishart_law(n, convention, sensors)
        draws = _draws(laws, m, trials, np.random.default_rng([seed, n]))
        _, mean, sigma = _simulated(problems[problem], draws, n_threads)
        return mean + _SIGMAS * sigma <= bound

    least = _core.least_count(convention, sensors, m)
    found = _smallest(first_order, len(problems), least)
    if method == "monte-carlo":
        found = _smallest(simulated, len(problems), least, found)
    result: int | IntArray = scalar_or_array(found.reshape(s.shape[:-3]))
    return result


def _smallest(
    holds: Callable[[IntArray, int], npt.NDArray[np.bool_]],
    count: int,
    least: int,
    guess: IntArray | None = None,
) -> IntArray:
    """Return the smallest n >= least for which `holds` is true, for each of `count` problems.

    The arguments of `holds` are indices of problems and an n for all of them. If `holds` is true
    for an n, it must be true for all larger n.
    """
    low = np.full(count, least - 1)
    high = np.full(count, least) if guess is None else guess.copy()
    open_ended = np.ones(count, dtype=bool)
    while np.any(active := open_ended | (high - low > 1)):
        tried = np.where(open_ended, high, (low + high) // 2)
        for n in np.unique(tried[active]):
            problem = np.flatnonzero(active & (tried == n))
            held = holds(problem, int(n))
            high[problem[held]] = n
            low[problem[~held]] = n
            open_ended[problem[held]] = False
        doubled = open_ended & (low == high)
        high[doubled] *= 2
    return high


def _simulated(
    s: FloatArray, draws: FloatArray, n_threads: int | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the fused covariance and the excess error, (..., 2, m, m), the loss and its sigma."""
    found = _core.weigh("excess", s, threads(n_threads), draws=draws)
    m = s.shape[-1]
    matrices = found[..., :-2].reshape(*found.shape[:-1], 2, m, m)
    return matrices, found[..., -2].copy(), found[..., -1].copy()


def _relative_factor(n: int, convention: Convention) -> float:
    """Return the factor c of a sample covariance, relative to the mean of that covariance."""
    [(degrees_of_freedom, _)] = _core.wishart_law(n, convention, 1)
    return 1 / degrees_of_freedom


def _draws(
    laws: list[tuple[float, float]], m: int, trials: int, rng: np.random.Generator
) -> FloatArray:
    """Draw Wishart matrices for every sensor, (trials, K, m, m), whose true covariance is I."""
    draws = []
    for degrees_of_freedom, mean in laws:
        whole = np.isinf(degrees_of_freedom) or degrees_of_freedom == int(degrees_of_freedom)
        if not (whole or degrees_of_freedom > m - 1):
            raise ValueError(
                f"n is too small: differences have {degrees_of_freedom:.2f} degrees of freedom, "
                f"and a simulation in {m} dimensions needs more than {m - 1}"
            )
        draws.append(mean * standard_wishart(m, degrees_of_freedom, (trials,), rng))
    return np.stack(draws, axis=1)


def _trace(matrix: FloatArray) -> FloatArray:
    trace: FloatArray = diagonal(matrix).sum(axis=-1)
    return trace
