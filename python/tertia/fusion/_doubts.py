"""Warnings of radars that contradict each other, or repeat each other."""

from __future__ import annotations

import itertools
import warnings

import numpy as np

from tertia._arrays import BoolArray, FloatArray, spread

# share of the plots of a radar from which on they are no single outliers, and least number of plots
_MOST, _FEWEST = 0.5, 10
# plots in a block, and least number of blocks in which two radars are compared
_BLOCK, _BLOCKS = 20, 3
# shares of plots that are the same as those of another radar, and as the one before in coarse steps
_SAME, _COARSE = 0.9, 0.1
_MOST_RADARS = 30  # of which all pairs are compared


def doubt_radars(outlier: BoolArray, there: BoolArray) -> None:
    """Warn if most plots of a radar, of those that are `there`, (..., K, steps), are outliers."""
    radars = there.shape[-2]
    count = there.sum(axis=-1)
    wrong = (count >= _FEWEST) & (outlier.sum(axis=-1) > _MOST * count)
    if radars == 1 or not np.any(wrong):
        return
    radar = np.argwhere(wrong)[0][-1]
    rest = (
        "the other radar may be the wrong one, and the track is then wrong by far more than its "
        "sigmas; "
        if radars == 2
        else ""
    )
    warnings.warn(
        f"most plots of radar {radar} contradict the other radars and are left out: {rest}check "
        "the unit, the north and the times of each radar",
        stacklevel=3,
    )


def doubt_copies(z: FloatArray) -> None:
    """Warn if two radars give the same plots, (..., K, steps)."""
    if z.shape[-1] < _FEWEST or z.shape[-2] > _MOST_RADARS:
        return
    for a, b in itertools.combinations(range(z.shape[-2]), 2):
        one, other = z[..., a, :], z[..., b, :]
        equal = one == other
        if not np.count_nonzero(equal):
            continue
        both = np.sum(~np.isnan(one) & ~np.isnan(other), axis=-1)
        same = np.sum(equal, axis=-1) > _SAME * both
        # in coarse steps, many plots are the same by chance
        is_coarse = np.sum(one[..., 1:] == one[..., :-1], axis=-1) > _COARSE * both
        if np.any((both >= _FEWEST) & same & ~is_coarse):
            warnings.warn(
                f"nearly all plots of radars {a} and {b} are the same, as if they were given "
                "twice: the covariance takes their errors for independent",
                stacklevel=3,
            )
            return


def doubt_errors(
    z: FloatArray,
    outlier: BoolArray,
    angle: FloatArray,
    variance: FloatArray,
    period: float | None,
) -> None:
    """Warn if errors last that are as large as the noise, and at most half of the radars agree.

    `z` are the plots, (..., K, steps), with their outliers, `angle` is the track, (..., steps), and
    `variance` the stated variance of the plots.
    """
    *_, radars, steps = z.shape
    blocks = steps // _BLOCK
    if not 1 < radars <= _MOST_RADARS or blocks < _BLOCKS:
        return
    away = np.where(outlier, np.nan, z - angle[..., np.newaxis, :])
    if period is not None:
        away = (away + 0.5 * period) % period - 0.5 * period
    rows = away.reshape(-1, radars, steps)[..., : blocks * _BLOCK]
    rows = rows.reshape(-1, radars, blocks, _BLOCK)
    count = np.sum(~np.isnan(rows), axis=-1)
    mean = np.nansum(rows, axis=-1) / np.maximum(count, 1)
    squares = np.nansum((rows - mean[..., np.newaxis]) ** 2, axis=-1)
    stated = np.mean(spread(variance, z.shape).reshape(-1, radars, steps), axis=-1)
    noise = np.maximum(squares / np.maximum(count - 1, 1), stated[..., np.newaxis])
    differ = np.zeros((len(rows), radars, radars), dtype=bool)
    for a, b in itertools.combinations(range(radars), 2):
        known = (2 * count[:, [a, b]] > _BLOCK).all(axis=1)
        expected = (noise / np.maximum(count, 1))[:, [a, b]].sum(axis=1)
        lasting = (mean[:, a] - mean[:, b]) ** 2 - expected
        larger = np.sum(known * (lasting - noise[:, [a, b]].mean(axis=1)), axis=-1) > 0
        differ[:, a, b] = differ[:, b, a] = larger & (known.sum(axis=-1) >= _BLOCKS)
    agree = radars - differ.sum(axis=-1)
    if np.any(2 * agree.max(axis=-1) <= radars):
        warnings.warn(
            "radars differ for long by more than their noise, and any of them may be wrong, as if "
            "it drifted, were stuck or had a bias; the covariance does not contain such errors: "
            "give a bias_sigma or a correlation_time",
            stacklevel=3,
        )
