"""Numbers of independent errors with the same information as a record, and intervals of figures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, TypeAlias

import numpy as np

from tertia import _core
from tertia._arrays import BoolArray, FloatArray, IntArray

# so many groups show by themselves how much their means vary
LEAST_GROUPS = 10
# the squares of errors: the second power of their correlation; of their ranks: the first
_OF_ERRORS, _OF_RANKS = np.eye(8)[1], np.eye(8)[0]
# of the correlation, to which the weights of the core belong
_POWERS = (1, 2, 3, 4, 6, 8, 12, 16)
_MOST_SHARE = 0.9
# of rows of several targets in turn: the fewest rows of each, the numbers of steps over which
# correlations are averaged, and the standard errors that they exceed those of the first steps by
_FEWEST_TURNS, _WIDTHS, _SIGNIFICANT = 4, (1, 4, 16), 4.0
_SIMILAR = 0.8

# probabilities of models, and the numbers of rows that are worth one value
_Models: TypeAlias = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True)
class Worth:
    """Possible effective numbers of independent values of a record, and their probabilities."""

    number: FloatArray
    probability: FloatArray
    degrees_of_freedom: float = np.inf

    @property
    def effective_number(self) -> float:
        """The effective number that corresponds to the mean variance over all possible numbers."""
        return float(1.0 / np.sum(self.probability / self.number))

    def _record(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in self.__slots__}

    def of_mean(self, values: FloatArray, axes: int, level: float) -> tuple[float, float]:
        """Return a confidence interval for the expected value of the squares."""
        mean = float(values.mean())
        if mean == 0.0:
            return 0.0, 0.0
        # the variance about the sample's mean lacks what the mean varies
        lacking = min(1.0 / self.effective_number, _MOST_SHARE) if len(values) > 1 else 0.0
        ratio = max(float(np.var(values / mean)) / (1.0 - lacking), 2.0 / axes)
        low, high = _core.mean_interval(mean, ratio, self._record(), level)
        return low, high

    def of_share(self, share: float, level: float) -> tuple[float, float]:
        """Return a confidence interval for a probability, given the observed proportion."""
        low, high = _core.share_interval(share, self._record(), level)
        # the search ends beside 0 and 1
        return min(low, share), max(high, share)

    def of_rank(self, probability: float, level: float) -> tuple[float, float]:
        """Return an interval for the proportion that is observed, given the probability."""
        low, high = _core.rank_interval(probability, self._record(), level)
        return low, high


@dataclass(frozen=True, slots=True)
class Record:
    """The variability of figures of a record, from its groups or the correlation of its errors.

    `errors` are whitened errors, (N, m), in order of group and time; `gaps` are the numbers of
    steps since the previous row, 0 where a group begins.
    """

    squares: FloatArray
    axes: int
    group: IntArray
    # models of the errors, one or two sets, and of the ranks; empty if groups are compared
    models: tuple[_Models, ...]
    # mean correlation of two errors of a group, and the mean number of other errors of the group
    common: tuple[float, float]

    @classmethod
    def of(cls, errors: FloatArray, gaps: FloatArray, group: IntArray) -> Record:
        """Return the record that these errors make up."""
        count, axes = errors.shape
        squares = np.sum(errors**2, axis=-1)
        common = _common(errors, group)
        if _balanced(group) >= LEAST_GROUPS:
            return cls(squares, axes, group, (), common)
        ranks = np.empty(count)
        ranks[np.argsort(squares, kind="stable")] = (np.arange(count) + 0.5) / count - 0.5
        of_errors = _core.lasting(np.ascontiguousarray(errors), gaps)
        turn = _turn(errors, *of_errors)
        models = _in_turn(errors, group, turn, *of_errors) if turn else (of_errors,)
        of_ranks = _core.lasting(ranks[:, np.newaxis], gaps)
        return cls(squares, axes, group, (*models, of_ranks), common)

    def of_mean(self) -> Worth:
        """Return the effective numbers of values for the mean square of the errors."""
        return self._worth(self.squares, (_OF_ERRORS, _OF_RANKS))

    def of_inside(self, inside: BoolArray, probability: float) -> Worth:
        """Return the effective numbers for the proportion inside a region of this probability."""
        least = 0.5 / len(inside)
        content = min(max(probability, least), 1.0 - least)
        weights = [np.array(_core.indicator_powers(m, content)) for m in (self.axes, 0)]
        if self.models:
            worth = self._worth(self.squares, (weights[0], weights[1]))
        elif inside.all() or not inside.any():
            worth = self.of_mean()
        else:
            worth = self._worth(inside.astype(np.float64), ())
        return self._grouped(worth, weights[0])

    def of_score(self, score: FloatArray) -> Worth:
        """Return the effective numbers for the mean of a quantity that is linear in the errors."""
        return self._worth(score, (_OF_RANKS, _OF_RANKS))

    def _grouped(self, worth: Worth, weights: FloatArray) -> Worth:
        """Return what a record is worth if its groups have errors in common.

        Few groups are outside a region of high probability, so that their number shows little of
        how much it varies. The errors show it: if normal errors of a group have this correlation,
        so many errors are worth one (Kish 1965).
        """
        correlation, others = self.common
        per_value = 1.0 + others * float(weights @ correlation ** np.array(_POWERS))
        most = max(len(self.squares) / per_value, 1.0)
        return replace(worth, number=np.minimum(worth.number, most))

    def _worth(self, values: FloatArray, weights: tuple[FloatArray, ...]) -> Worth:
        count = len(values)
        if not self.models:
            return _clustered(values, self.group)
        each = [weights[0]] * (len(self.models) - 1) + [weights[1]]
        rows = [(p, of @ weight) for (p, of), weight in zip(self.models, each, strict=True)]
        probability, per_value = reduce(_larger, rows)
        return Worth(np.maximum(count / per_value, 1.0), probability)


def _turn(errors: FloatArray, probability: FloatArray, per_value: FloatArray) -> int:
    """Return after how many rows errors are significantly more similar than in successive rows.

    The rows are then those of several targets in turn. If there is no such number, it is 0.
    """
    count, axes = errors.shape
    most = count // _FEWEST_TURNS
    spectrum = np.abs(np.fft.rfft(errors, 2 * count, axis=0)) ** 2
    products = np.fft.irfft(spectrum.sum(axis=1), 2 * count)[: most + 1]
    if not products[0] > 0.0:
        return 0
    correlation = products / products[0] / (1.0 - np.arange(most + 1) / count)
    sums = np.cumsum(correlation) - 1.0
    linear, square = (float(probability @ per_value[:, k]) for k in (0, 1))
    for width in (one for one in _WIDTHS if 2 * one <= most):
        means = (sums[width:] - sums[:-width]) / width
        # neighbouring correlations have errors in common (Bartlett 1946)
        variance = square * min(2.0 * linear / width, 1.0) / (axes * (count - most))
        excess = means[1:] - max(float(correlation[1]), 0.0)
        if np.max(excess) > _SIGNIFICANT * np.sqrt(variance):
            # later turns are as similar, if errors last
            return int(np.argmax(excess > _SIMILAR * np.max(excess))) + 2 + width // 2
    return 0


def _in_turn(
    errors: FloatArray, group: IntArray, turn: int, probability: FloatArray, per_value: FloatArray
) -> Iterator[_Models]:
    """Yield models of the errors of several targets in turn, given those of one target.

    Two rows belong to the same target with a probability p, and the correlation of their errors is
    p times that of the target, so that powers of it would be too small. If no rows are missing, the
    errors of each target can be separated.
    """
    yield probability, np.repeat(per_value[:, :1], len(_POWERS), axis=1)
    rows = np.arange(len(errors))
    order = np.lexsort((rows, rows % turn, group))
    gaps = np.where(np.diff(order, prepend=0) == turn, 1.0, 0.0)
    yield _core.lasting(errors[order], gaps)


def _common(errors: FloatArray, group: IntArray) -> tuple[float, float]:
    """Return the mean correlation of two errors of a group, and how many others there are."""
    sizes = np.bincount(group).astype(np.float64)
    others = float(sizes @ (sizes - 1.0)) / len(errors)
    total = float(np.sum(errors**2))
    if len(sizes) == 1 or others == 0.0 or total == 0.0:
        return 0.0, 0.0
    square = sum(float(np.sum(np.bincount(group, own) ** 2)) for own in errors.T)
    return min(max((square / total - 1.0) / others, 0.0), 1.0), others


def _balanced(group: IntArray) -> float:
    """Return the number of groups of equal size that would contain as much information."""
    sizes = np.bincount(group)
    return float(sizes.sum() ** 2 / np.sum(sizes.astype(np.float64) ** 2))


def _clustered(values: FloatArray, group: IntArray) -> Worth:
    """Return the effective number estimated by the variance between groups (Liang, Zeger 1986)."""
    count, groups = len(values), int(group.max()) + 1
    centred = values - values.mean()
    own = float(np.mean(centred**2))
    sums = np.bincount(group, centred)
    of_mean = float(np.sum(sums**2)) / count**2 * groups / (groups - 1)
    number = float(count) if of_mean == 0 else own / of_mean * count / (count - 1)
    number = min(max(number, 1.0), float(count))
    return Worth(np.array([number]), np.ones(1), _balanced(group) - 1.0)


def _larger(one: _Models, other: _Models) -> _Models:
    """Return the probabilities and the values of the larger of two independent variables."""
    values = np.union1d(one[1], other[1])

    def below(probability: FloatArray, value: FloatArray) -> FloatArray:
        order = np.argsort(value)
        sums = np.concatenate([[0.0], np.cumsum(probability[order])])
        return np.asarray(sums[np.searchsorted(value[order], values, side="right")])

    probability = np.diff(below(*one) * below(*other), prepend=0.0)
    return np.ascontiguousarray(probability), values
