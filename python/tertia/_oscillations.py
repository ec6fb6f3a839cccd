"""Deviations from a smoothed path that oscillate, as motion does and errors seldom do."""

from __future__ import annotations

import warnings

import numpy as np

from tertia._arrays import BoolArray, FloatArray

# noise factor from which on deviations are examined, and number of periods that they must contain
_LARGER, _PERIODS = 1.2, 5
# correlations after half a period and a whole one, and least one after a step: below, it is that of
# two sensors in turn
_OPPOSITE, _AGAIN, _STEP = -0.45, 0.25, -0.2


def warn_of_oscillations(
    plots: FloatArray, mean: FloatArray, outlier: BoolArray, factor: FloatArray, time: FloatArray
) -> None:
    """Warn if deviations of plots, (..., N, D), that are larger than stated oscillate.

    The states `mean` begin with positions. `outlier` is (..., N, 1), and `factor`,
    (...), is the ratio of the estimated noise to the stated one; `time` is (..., N).
    """
    if not np.any(factor > _LARGER):
        return
    deviation = np.where(outlier, np.nan, plots - mean[..., : plots.shape[-1]])
    rows = deviation.reshape(-1, *plots.shape[-2:])
    times = np.broadcast_to(time, plots.shape[:-1]).reshape(len(rows), -1)
    for k in np.flatnonzero(np.ravel(factor) > _LARGER):
        steps = max(map(_period, rows[k].T))
        if steps > 0:
            period = steps * float(np.median(np.diff(times[k])))
            warnings.warn(
                f"the deviations from the smoothed path oscillate with a period of about "
                f"{period:.3g}, as errors seldom do, and are larger than stated: if they are "
                "motion, as of waves, the path is only its mean, and the covariance does not "
                "contain it; then give a jerk, the larger the less is smoothed",
                UserWarning,
                stacklevel=3,
            )
            return


def _period(deviation: FloatArray) -> int:
    """Return the period of an oscillation, in steps; 0 if there is none."""
    n = len(deviation)
    most = n // (2 * _PERIODS)
    known = np.isfinite(deviation)
    if most < 1 or np.count_nonzero(known) < n / 2:
        return 0
    own = np.where(known, deviation - np.mean(deviation[known]), 0.0)
    largest = np.max(np.abs(own))
    if not largest > 0:
        return 0
    products = np.fft.irfft(np.abs(np.fft.rfft(own / largest, 2 * n)) ** 2)
    correlation = products[: 2 * most + 1] / products[0]
    below = np.flatnonzero(correlation[: most + 1] < _OPPOSITE)
    if below.size == 0 or correlation[1] < _STEP:
        return 0
    # the middle of the first lags that are opposite
    period = int(below[0] + below[below == below[0] + np.arange(below.size)][-1])
    return period if correlation[period] > _AGAIN else 0
