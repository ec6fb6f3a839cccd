"""Comparison of the errors of estimates with their stated covariances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from tertia import _core
from tertia._arrays import BoolArray, FloatArray, listed
from tertia._arrays import probability as checked_probability
from tertia._result import Result
from tertia.metrics._indicator import (
    Indicator,
    digits,
    factor_verdict,
    honest_if,
    share_text,
    share_verdict,
)
from tertia.metrics._rows import (
    Rows,
    column,
    errors_of,
    gaps_of,
    in_order,
    labels_of,
    like,
    matrices_of,
    require_definite,
    require_squarable,
    strata_of,
)
from tertia.metrics._worth import Record

_NEWTON_STEPS, _ROUNDING = 30, 1e-14


@dataclass(frozen=True, slots=True, eq=False)
class Audit(Result):
    """Result of a comparison of the errors of estimates with their stated covariances.

    Attributes
    ----------
    nees : Indicator
        Mean normalised error squared per axis: 1 if the covariances are correct.
    coverage : dict of float to Indicator
        Proportion of the true values that are inside the region of each probability.
    scale : dict of float to Indicator
        Factor by which the covariances must be multiplied so that the region of each probability
        contains that proportion of the true values. Its square root is the factor for the sigmas.
    radius : dict of float to Indicator
        Distance from an estimate within which the next true value lies with each probability,
        whatever the distribution of the errors; inf if the record is too short. `low` and `high`
        are confidence bounds of the quantile of the errors.
    region_factor : dict of float to Indicator
        Factor by which the axes of a region, or the sigmas, must be multiplied so that the region
        of the next estimate contains the true value with at least this probability. Like `radius`,
        it is valid whatever the distribution of the errors.
    effective_number : float
        Number of independent errors from which the NEES could be estimated equally well.
    time_offset : Indicator or None
        Time in seconds that must be added to the times of the truth; None if no velocities were
        given.
    strata : dict of str to Audit
        Audits of the parts of the record, by the names of the parts.
    count, missing : int
        Number of rows that were audited, and number of rows that were left out because they contain
        numbers that are not finite.
    """

    nees: Indicator
    coverage: Mapping[float, Indicator]
    scale: Mapping[float, Indicator]
    radius: Mapping[float, Indicator]
    region_factor: Mapping[float, Indicator]
    effective_number: float
    time_offset: Indicator | None
    strata: Mapping[str, Audit]
    count: int
    missing: int

    @property
    def probability(self) -> float:
        """The probability nearest to 0.95, to which the verdict refers."""
        return min(self.scale, key=lambda one: abs(one - 0.95))

    @property
    def verdict(self) -> str:
        """Conclusion about the sigmas, such as "honest" or "too small by a factor of 2".

        It follows from the 95 % regions or, if the record is too short for their scale, from the
        NEES.
        """
        scale = self.scale[self.probability]
        unbounded = scale.low <= 1.0 and np.isinf(scale.high)
        return self.nees.verdict if unbounded else scale.verdict

    def __repr__(self) -> str:
        """Return the main figures as text."""
        p = self.probability
        return (
            f"Audit({self.verdict}; {100 * p:g} % regions hold {share_text(self.coverage[p])}, "
            f"NEES per axis {self.nees.value:.3g}, {self.count} errors worth "
            f"{self.effective_number:.0f})"
        )

    def __str__(self) -> str:
        """Return all figures as text, one per line."""
        lines = [f"sigmas: {self.verdict}"]
        missing = f", {self.missing} rows left out" if self.missing else ""
        lines.append(f"{self.count} errors worth {self.effective_number:.0f} independent{missing}")
        lines.append(f"NEES per axis {self.nees}")
        for p, share in self.coverage.items():
            line = f"{100 * p:g} % regions hold {share_text(share)}: {share.verdict}"
            radius = self.radius[p].value
            if np.isfinite(radius):
                line += f"; the truth is within {digits(radius)}"
            lines.append(line)
        if self.time_offset is not None:
            lines.append(f"time of the truth: {self.time_offset.verdict}")
        lines += [f"{name}: {one!r}" for name, one in self.strata.items()]
        return "\n".join(lines)


def audit(
    error: npt.ArrayLike,
    covariance: npt.ArrayLike,
    *,
    truth_covariance: npt.ArrayLike | None = None,
    time: npt.ArrayLike | None = None,
    groups: npt.ArrayLike | None = None,
    strata: npt.ArrayLike | Mapping[str, npt.ArrayLike] | None = None,
    velocity: npt.ArrayLike | None = None,
    probability: Sequence[float] = (0.5, 0.9, 0.95, 0.99),
    confidence_level: float = 0.95,
) -> Audit:
    """Compare errors with stated covariances; return NEES, coverage and corrections of sigmas.

    All figures have confidence intervals that allow for time-correlated errors.

    Parameters
    ----------
    error : array_like of shape (N, m), or (N,) for one axis
        Estimates minus true values, in time order; nan if an estimate or true value is missing.
        Differences of angles must be wrapped.
    covariance : array_like
        Stated covariances of the estimates, of shape (N, m, m), or (m, m) if all rows have the
        same. Variances may be given instead: of the axes in each row, (N, m), one for each row,
        (N,), or one for all rows, ().
    truth_covariance : array_like, optional
        Covariances of the errors of the true values, in any of the shapes of `covariance`; by
        default the true values are assumed to be exact.
    time : array_like of shape (N,), optional
        Times in seconds. By default rows are assumed to be equally spaced in time.
    groups : array_like of shape (N,), optional
        Labels of parts whose errors are independent of each other, such as flights, runs or
        targets. With ten or more groups of equal size, the intervals are computed only from the
        differences between groups.
    strata : array_like of shape (N,), or mapping of str to array_like, optional
        Labels of parts that are audited separately. If the labels are numbers with more than eight
        different values, the rows are divided into four parts at the quartiles.
    velocity : array_like of shape (N, m), optional
        Velocities of the targets in units per second, estimated or true. They are needed for
        `time_offset`.
    probability : sequence of float
        Probabilities of the regions for which coverage, scale and radius are computed.
    confidence_level : float
        Confidence level of the intervals.

    Returns
    -------
    Audit
        The figures, with intervals and verdicts.

    Raises
    ------
    ValueError
        If shapes do not fit, a number is outside its domain, or no row has only finite numbers.
    numpy.linalg.LinAlgError
        If a covariance is not positive definite; the message states its row.
    TypeError
        If an argument has the wrong type.

    Notes
    -----
    With fewer than ten groups, the effective number of errors follows from the posterior
    distribution of models in which one part of each error is a Gauss-Markov process and the rest is
    white noise. The models are fitted to the whitened errors and to the ranks of their squares,
    which also reveal changes of the variance; the smaller of the two effective numbers is used.
    Rows of several targets in turn are recognised if errors are more similar to those of later rows
    than to those of the next row; the errors of each target are then separated if no rows are
    missing. It is nevertheless better to give the groups. The
    interval of the NEES is the confidence interval of a variance, averaged over this posterior
    distribution. The interval of a proportion is Wilson's (1927). Its effective number follows from
    the correlation of normally distributed errors, which is converted to the correlation of the
    events that errors are inside a region. The bounds of the intervals of scale and radius are
    order statistics (Woodruff 1952). With ten groups or more, all intervals follow from the
    variance between groups (Liang, Zeger 1986) and Student's t distribution. The effective number
    for proportions is at most that of normal errors as similar within a group as those observed
    (Kish 1965).

    The verdict 'honest' requires at least ten independent errors; with fewer, the verdict is 'too
    short to tell'. If the whole interval shows that the sigmas are wrong, the verdict says so for a
    record of any length.

    The radius is a conformal prediction (Vovk, Gammerman, Shafer 2005). It is exact if the errors
    are exchangeable; it is therefore not exact if later estimates are made under other conditions.

    `time_offset` is a least-squares fit of the errors to the velocities. It is correct only if the
    errors do not depend on the velocity for other reasons. The errors of a filter that lags behind
    its target, for example, do depend on the velocity.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia import audit
    >>> error = np.random.default_rng(1).normal(0.0, 3.0, (500, 2))
    >>> audit(error, 1.0)
    Audit(too small by a factor of 2.9 (2.7 to 3.3); 95 % regions hold 27 % (23 to 31), NEES per \
axis 8.78, 500 errors worth 336)
    """
    errors = errors_of(error)
    stated = matrices_of(covariance, "covariance", errors.shape)
    true = None
    if truth_covariance is not None:
        true = matrices_of(truth_covariance, "truth_covariance", errors.shape)
    levels = [checked_probability(one, "probability") for one in listed(probability, "probability")]
    if not levels:
        raise ValueError("probability is empty; there must be one")
    level = checked_probability(confidence_level, "confidence_level")
    group = labels_of(groups, "groups", len(errors))
    order, position = in_order(group, column(time, "time", len(errors)))
    speeds = None if velocity is None else like(velocity, "velocity", errors)
    rows = Rows(errors, stated, true, group, position, speeds)
    known = rows.known()
    if not known.any():
        others = {"truth_covariance": true, "time": time, "velocity": velocity}
        given = ["error", "covariance", *(name for name, x in others.items() if x is not None)]
        raise ValueError(
            f"{', '.join(given[:-1])} and {given[-1]} have no row of finite numbers; there must be "
            "one"
        )
    require_squarable(errors[known], "error")
    require_definite(stated, known, "covariance")
    if true is not None:
        require_definite(stated + true, known, "covariance + truth_covariance")
    parts = {
        name: _figures(rows.at(order[own[order]]), levels, level, {})
        for name, own in strata_of(strata, known).items()
    }
    return _figures(rows.at(order), levels, level, parts)


def audit_split(
    first: npt.ArrayLike,
    first_covariance: npt.ArrayLike,
    second: npt.ArrayLike,
    second_covariance: npt.ArrayLike,
    **options: Any,
) -> Audit:
    """Audit two estimates of the same quantity from different sensors, without a truth.

    The difference of the estimates is compared with the sum of their covariances. Errors that are
    common to both estimates, such as those of a common map or clock, cannot be found.

    Parameters
    ----------
    first, second : array_like of shape (N, m), or (N,)
        Estimates from two sets of sensors that have no sensor in common; nan if an estimate is
        missing.
    first_covariance, second_covariance : array_like
        Covariances of the estimates, as for `audit`.
    **options
        The other arguments of `audit`.

    Returns
    -------
    Audit
        The audit of the difference; `scale` applies to the sum of the covariances.

    Raises
    ------
    ValueError, TypeError, numpy.linalg.LinAlgError
        As for `audit`.

    Examples
    --------
    >>> import numpy as np
    >>> from tertia.metrics import audit_split
    >>> rng = np.random.default_rng(1)
    >>> one, other = rng.normal(0.0, [[3.0], [4.0]], (2, 500))
    >>> audit_split(one, 9.0, other, 16.0).verdict
    'honest'
    """
    one, other = errors_of(first), like(second, "second", errors_of(first))
    sums = matrices_of(first_covariance, "first_covariance", one.shape) + matrices_of(
        second_covariance, "second_covariance", one.shape
    )
    return audit(one - other, sums, **options)


def _figures(
    rows: Rows, levels: Sequence[float], level: float, parts: Mapping[str, Audit]
) -> Audit:
    known = np.flatnonzero(rows.known())
    missing, rows = len(rows.errors) - len(known), rows.at(known)
    count, axes = rows.errors.shape
    both, of_truth = rows.covariance, None
    if rows.truth_covariance is not None:
        both, of_truth = both + rows.truth_covariance, _Axes.of(rows, rows.truth_covariance)
    root = np.linalg.cholesky(both)
    with np.errstate(over="ignore"):
        white = np.linalg.solve(root, rows.errors[..., np.newaxis])[..., 0]
    require_squarable(white, "error in standard deviations")
    _, group = np.unique(rows.group, return_inverse=True)
    record = Record.of(white, gaps_of(rows.position, group), group)
    worth = record.of_mean()
    nees = record.squares / axes
    low, high = worth.of_mean(nees, axes, level)
    mean, number = float(nees.mean()), worth.effective_number
    found = Indicator(mean, low, high, count, number, factor_verdict(mean, low, high, number))
    distance = np.linalg.norm(rows.errors, axis=-1)
    shares, scales, radii, region_factors = {}, {}, {}, {}
    for p in levels:
        quantile = _core.chi_square_quantile(p, axes)
        inside = record.squares <= quantile
        shares[p] = _share(record, inside, p, level)
        needed = record.squares / quantile if of_truth is None else of_truth.scale(quantile)
        scales[p] = _quantile(record, needed, p, level)
        radii[p] = _conformal(record, distance, p, level)
        region_factors[p] = _conformal(record, np.sqrt(needed), p, level)
    offset = None
    if rows.velocity is not None:
        speed = np.linalg.solve(root, rows.velocity[..., np.newaxis])[..., 0]
        offset = _time_offset(white, speed, record, level)
    return Audit(
        found,
        shares,
        scales,
        radii,
        region_factors,
        worth.effective_number,
        offset,
        dict(parts),
        count,
        missing,
    )


def _share(record: Record, inside: BoolArray, probability: float, level: float) -> Indicator:
    share = float(np.mean(inside))
    worth = record.of_inside(inside, share)
    low, high = worth.of_share(share, level)
    number = worth.effective_number
    verdict = share_verdict(low, high, probability, number)
    return Indicator(share, low, high, len(inside), number, verdict)


def _bounds(
    record: Record, values: FloatArray, probability: float, level: float
) -> tuple[float, float, float, float]:
    """Return the quantile, the order statistics that are its bounds, and the effective number."""
    quantile = float(np.quantile(values, probability))
    worth = record.of_inside(values <= quantile, probability)
    low, high = (share * len(values) for share in worth.of_rank(probability, level))
    ordered = np.sort(values)
    below, above = int(np.floor(low)), int(np.ceil(high))
    return (
        quantile,
        float(ordered[below - 1]) if below >= 1 else 0.0,
        float(ordered[above]) if above < len(values) else np.inf,
        worth.effective_number,
    )


def _quantile(record: Record, values: FloatArray, probability: float, level: float) -> Indicator:
    """Return the factor for the covariances, with its interval."""
    value, low, high, number = _bounds(record, values, probability, level)
    verdict = factor_verdict(value, low, high, number)
    return Indicator(value, low, high, len(values), number, verdict)


def _conformal(record: Record, values: FloatArray, probability: float, level: float) -> Indicator:
    """Return a bound for the next value, whose rank is random if values are exchangeable."""
    _, low, high, number = _bounds(record, values, probability, level)
    count = len(values)
    rank = int(np.ceil(probability * (1.0 + 1.0 / number) * count - 1e-9))
    bound = float(np.sort(values)[rank - 1]) if rank <= count else np.inf
    verdict = "" if np.isfinite(bound) else honest_if(0.0)
    return Indicator(bound, low, high, count, number, verdict)


@dataclass(frozen=True, slots=True)
class _Axes:
    """Squares of the errors along the common axes of C and C_truth, and the ratios of variances.

    With C = L L' and L^-1 C_truth L^-T = U diag(g) U', `e' (s C + C_truth)^-1 e` is
    `sum_k y_k^2 / (s + g_k)`, y = U' L^-1 e.
    """

    square: FloatArray
    ratio: FloatArray

    @classmethod
    def of(cls, rows: Rows, truth_covariance: FloatArray) -> _Axes:
        root = np.linalg.cholesky(rows.covariance)
        y = np.linalg.solve(root, rows.errors[..., np.newaxis])
        half = np.linalg.solve(root, truth_covariance)
        both = np.linalg.solve(root, np.swapaxes(half, -1, -2))
        ratio, turn = np.linalg.eigh(0.5 * (both + np.swapaxes(both, -1, -2)))
        square = (np.swapaxes(turn, -1, -2) @ y)[..., 0] ** 2
        return cls(np.asarray(square), np.maximum(ratio, np.finfo(np.float64).tiny))

    def scale(self, quantile: float) -> FloatArray:
        """Return for each row the s at which the form equals the quantile; 0 if there is no such s.

        The form is a decreasing and convex function of s. Newton's method, started below the root,
        therefore never overshoots it.
        """
        # the largest term alone
        scale: FloatArray = np.maximum(np.max(self.square / quantile - self.ratio, axis=-1), 0.0)
        for _ in range(_NEWTON_STEPS):
            part = self.square / (scale[:, np.newaxis] + self.ratio)
            slope = np.sum(part / (scale[:, np.newaxis] + self.ratio), axis=-1)
            excess = np.maximum(part.sum(axis=-1) - quantile, 0.0)
            step = np.divide(excess, slope, out=np.zeros_like(slope), where=slope > 0)
            scale = scale + step
            if np.all(step <= _ROUNDING * scale):
                break
        return scale


def _time_offset(error: FloatArray, speed: FloatArray, record: Record, level: float) -> Indicator:
    """Return the time to add to the times of the truth, from whitened errors and velocities."""
    information = float(np.sum(speed**2))
    count = len(error)
    if information == 0.0:
        return Indicator(np.nan, -np.inf, np.inf, count, 0.0, honest_if(0.0))
    offset = -float(np.sum(speed * error)) / information
    score = np.sum(speed * (error + speed * offset), axis=-1)
    worth = record.of_score(score)
    # quantiles of the standardised error: the interval of a share of one half
    steps = (np.array(worth.of_rank(0.5, level)) - 0.5) / 0.5
    spread = float(np.sqrt(np.mean(score**2))) * count / information
    low, high = (offset + step * spread for step in steps)
    number = worth.effective_number
    if low > 0.0 or high < 0.0:
        verdict = f"add {offset:.3g} s ({low:.3g} to {high:.3g})"
    else:
        verdict = honest_if(number)
    return Indicator(offset, low, high, count, number, verdict)
