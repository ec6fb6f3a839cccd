"""Measurements that repeat the one before: of a stuck instrument, or logged several times."""

from __future__ import annotations

import numpy as np

from tertia._arrays import BoolArray, FloatArray, IntArray

# repetitions that may always be chance; standard deviations by which others must exceed it
_FEW, _SURE = 2, 4.0
# median step, in roundings, from which on equal measurements are copies; steps below this share of
# the numbers are errors of arithmetic
_COARSE, _NO_STEP = 4.0, 1e-12
# runs of equal measurements that show how often each is logged; share of runs that may consist of
# one measurement if each is logged at least twice; neighbourhood of a run, in mean lengths of runs
_RUNS, _SINGLE, _NEAR = 8, 0.02, 3.0
# EM steps for the share of copies
_ROUNDS = 50


def repeated(
    theta: FloatArray, period: float | None, rounding: float, fewest: int
) -> BoolArray | None:
    """Return which measurements repeat the one before them, if rounding does not explain it.

    None: there are none. `fewest` different measurements must be left.
    """
    if theta.ndim == 0 or theta.shape[-1] <= _FEW:
        return None
    rows = theta.reshape(-1, theta.shape[-1])
    equal = rows[:, 1:] == rows[:, :-1]
    if np.count_nonzero(equal) <= _FEW:
        return None
    count = np.count_nonzero(equal, axis=-1)
    found = np.zeros(rows.shape, dtype=bool)
    for row in np.flatnonzero(count > _FEW):
        y, none = rows[row], _least(rows[row])
        if len(_moves(y, period)) + 1 < max(fewest, 2):
            continue
        gaps = np.diff(np.unique(y))
        step = max(rounding, float(np.min(gaps, where=gaps > none, initial=np.inf)))
        found[row, 1:] = _copies(y, equal[row], step, period)
    return found.reshape(theta.shape) if found.any() else None


def _moves(y: FloatArray, period: float | None) -> FloatArray:
    """Return the sizes of the differences between successive numbers that differ."""
    steps = np.abs(np.diff(y))
    steps = steps[np.isfinite(steps)]
    if period is not None and period > 0:
        steps = np.minimum(steps % period, -steps % period)
    return steps[steps > _least(y)]


def _least(y: FloatArray) -> float:
    """Return the difference below which two numbers are equal but for errors of arithmetic."""
    return float(_NO_STEP * np.nanmax(np.abs(y)))


def _exceeds(count: int, cases: int, chance: float) -> bool:
    """Return whether there are more repetitions than this chance explains."""
    expected = cases * chance
    return bool(count > expected + _SURE * np.sqrt(expected) + _FEW)


def _copies(y: FloatArray, equal: BoolArray, step: float, period: float | None) -> BoolArray:
    """Return which measurements after the first are copies of the one before.

    `equal` tells which measurements equal the one before; the others differ by steps.
    """
    times = _times(equal)
    if times > 1:
        phase = int(np.flatnonzero(~equal)[0])
        copies: BoolArray = (np.arange(equal.size) - phase) % times != 0
        return copies
    moves = _moves(y, period)
    fine = np.median(moves) >= _COARSE * step
    chance = 0.5 * step / np.median(moves) if fine else _chance(y, step, period)
    many = _exceeds(int(np.count_nonzero(equal)), equal.size, chance)
    if not many or not _last(y, equal, chance):
        return np.zeros_like(equal)
    return equal if fine else _thinned(y, equal)


def _times(equal: BoolArray) -> int:
    """Return how often each measurement is logged if it is the same for all, otherwise 1."""
    lengths = np.diff(np.flatnonzero(~equal))
    return int(np.gcd.reduce(lengths)) if lengths.size >= _RUNS else 1


def _last(y: FloatArray, equal: BoolArray, chance: float) -> bool:
    """Return whether more measurements than by chance are equal to the one before.

    `equal` tells which measurements are. Copies make any value last, also where it is rare, or
    hardly any value occurs once only. Noise and motion that are small compared with the rounding
    make only the usual values last, and outliers occur once.
    """
    first, length = _runs(equal)
    if np.count_nonzero(length == 1) <= _SINGLE * length.size:
        return True
    rare = length[_rare(y, first, length)]
    return _exceeds(int(np.sum(rare - 1)), int(np.sum(rare)), chance)


def _runs(equal: BoolArray) -> tuple[IntArray, IntArray]:
    """Return where runs of equal measurements begin, and their lengths."""
    first = np.flatnonzero(np.concatenate([[True], ~equal]))
    return first, np.diff(np.append(first, equal.size + 1))


def _thinned(y: FloatArray, equal: BoolArray) -> BoolArray:
    """Return which measurements after the first are left out if rounding makes them equal, too.

    Of the equal measurements of each value, as many are kept as are measurements of their own.
    """
    first, length = _runs(equal)
    names, value = np.unique(y[first], return_inverse=True)
    of_value = np.repeat(value, length)[1:][equal]
    genuine = _genuine(np.bincount(value), np.bincount(of_value, minlength=names.size))[of_value]
    order = np.argsort(of_value, kind="stable")
    rank = np.empty(order.size)
    rank[order] = np.arange(order.size) - np.searchsorted(of_value[order], of_value[order])
    copies: BoolArray = equal.copy()
    copies[equal] = np.floor((rank + 1) * genuine + 0.5) == np.floor(rank * genuine + 0.5)
    return copies


def _chance(y: FloatArray, step: float, period: float | None) -> float:
    """Return an upper bound of the chance that measurements without copies equal the one before.

    Outliers between measurements of a slow target are not its motion, and occur once.
    """
    first, length = _runs(y[1:] == y[:-1])
    chances = [
        _chance_of_equal(np.rint(_moves(y[kept], period) / step))
        for kept in (first, first[length > 1])
        if kept.size
    ]
    return max(chances)


def _chance_of_equal(steps: FloatArray) -> float:
    """Return that bound for these differences in roundings.

    `log p` of normal differences of k roundings is quadratic in k: that of 0 follows from those of
    1 and 2. If the latter hardly occur, nothing follows.
    """
    one, two = (float(np.count_nonzero(steps == k)) for k in (1, 2))
    one, two = one + np.sqrt(one), two - np.sqrt(two)
    if two <= 0.0:
        return 1.0
    same = 0.5 * one * (one / two) ** (1 / 3)
    return float(same / (same + steps.size))


def _rare(y: FloatArray, first: IntArray, length: IntArray) -> BoolArray:
    """Return which runs have a value that occurs at most once shortly before or after them."""
    far = int(np.ceil(_NEAR * y.size / first.size))
    padded = np.concatenate([np.full(far, np.nan), y, np.full(far, np.nan)])
    others = np.zeros(first.shape)
    for lag in range(1, far + 1):
        others += padded[first + far - lag] == y[first]
        others += padded[first + length + far - 1 + lag] == y[first]
    rare: BoolArray = np.isfinite(y[first]) & (others <= 1)
    return rare


def _genuine(runs: IntArray, equal: IntArray) -> FloatArray:
    """Return the probability that a measurement equal to the one before is one of its own.

    `runs` and `equal` are the numbers, for each value, of runs and of measurements that equal the
    one before. A measurement is a copy with the probability h, and otherwise has the value v with
    the probability p; the EM algorithm finds h and p.
    """
    genuine: FloatArray = np.full(runs.shape, 0.5)
    for _ in range(_ROUNDS):
        own = runs + equal * genuine
        share = own / own.sum()
        copied = np.sum(equal * (1 - genuine)) / (np.sum(runs + equal) - 1)
        genuine = (1 - copied) * share / (copied + (1 - copied) * share)
    return genuine
