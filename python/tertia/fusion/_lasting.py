"""Covariances of fused series whose noise is correlated in time."""

from __future__ import annotations

import numpy as np

from tertia._arrays import BoolArray, FloatArray
from tertia.smoothing import smooth


def correlation_times(
    z: FloatArray, variance: FloatArray, time: FloatArray, period: float | None
) -> FloatArray:
    """Return the correlation time of each radar's noise (..., K), estimated as in `smooth`."""
    batch = z.shape[:-1]
    found = np.zeros(batch)
    variances = np.broadcast_to(variance, z.shape)
    times = np.broadcast_to(time[..., np.newaxis, :], z.shape)
    for place in np.ndindex(*batch):
        there = ~np.isnan(z[place])
        y = z[place][there]
        if period is not None:
            y = np.unwrap(y, period=period)
        one = smooth(
            y[:, np.newaxis], variances[place][there][:, np.newaxis], time=times[place][there]
        )
        found[place] = one.correlation_time
    return found


def growth(
    variance: FloatArray,
    stated: FloatArray,
    used: FloatArray,
    there: BoolArray,
    phi: FloatArray,
    *,
    is_bound: bool,
) -> FloatArray:
    """Return the factors by which correlated noise increases the covariances (..., steps).

    `variance` is the variance of the fused angle; with `is_bound`, it is that of covariance
    intersection, which is as large as if there were only one radar. `stated` and `used` (..., K,
    steps) are the variances of the plots as stated and as used by the method. `there` tells which
    plots exist, and `phi` (..., K) are the correlations of successive plots of each radar.

    A filter with the gain K averages plots with the weights K (1 - K)^j, where j counts the plots
    back from the last one. Its variance consists of a part K / (2 - K) from white noise and a part
    (1 - K) K / (2 - K) from the motion. Time-correlated noise multiplies the first part by (1 + φ
    (1 - K)) / (1 - φ (1 - K)).
    """
    information = there / used
    total = np.maximum(np.sum(information, axis=-2).mean(axis=-1), np.finfo(float).tiny)
    radars = np.maximum(np.any(there, axis=-1).sum(axis=-1), 1) if is_bound else 1
    gain = np.clip(variance * (total / radars)[..., np.newaxis], 0.0, 1.0)
    shares = information.sum(axis=-1)
    shares /= np.maximum(shares.sum(axis=-1, keepdims=True), np.finfo(float).tiny)
    lasting = (1 - gain) * np.sum(shares * phi, axis=-1)[..., np.newaxis]
    factor: FloatArray = ((1 + lasting) / (1 - lasting) + 1 - gain) / (2 - gain)
    # where noise is correlated, small differences are no evidence that it is small
    believed = np.sum(there / np.maximum(used, stated), axis=-2).mean(axis=-1)
    less = total / np.maximum(believed, np.finfo(float).tiny)
    return factor * np.where(np.any(phi > 0, axis=-1), less, 1.0)[..., np.newaxis]
