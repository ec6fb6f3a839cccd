"""Plots of several radars, with all that may be wrong with them."""

from functools import lru_cache

import numpy as np
import pytest
from checks import NAN, rng
from reference import fusion as reference
from scipy import stats
from tolerances import CHANCE

from tertia import metrics
from tertia.kalman import SingerModel
from tertia.simulate import radars

MODEL = SingerModel(5.0, 0.05, 0.003)
RESTLESS = SingerModel(5.0, 0.15, 0.05)
METHODS = reference.METHODS
EVERY_METHOD = pytest.mark.parametrize("method", METHODS)


def steps_of(model, times):
    t = np.diff(times)
    return t, [model.transition(dt) for dt in t], [model.process_noise(dt) for dt in t]


def nees(result, truth, at):
    """Normalised squared error, per dimension, of every run."""
    error = result.mean[..., at, :] - truth[..., at, :]
    return metrics.nees(error, result.covariance[..., at, :, :]) / 3


def bounds_of_nees(runs):
    """Those of the mean over independent runs."""
    return stats.chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], 3 * runs) / (3 * runs)


@lru_cache
def scene(k, seed, *, given):
    """Gaps, an outage, outliers, a faulty radar, irregular times, crossing north, and noise that
    changes from step to step."""
    random = rng(seed)
    n = 60
    times = np.cumsum(random.uniform(2, 7, n))
    times[20] = times[19]
    r = 0.01 * random.uniform(0.3, 3, (k, n))
    truth = 350 + 0.15 * (times - times[0]) + 2 * np.sin(times / 60)
    z = truth + np.sqrt(r) * random.standard_normal((k, n))
    z[0, 30:] += 0.5 * random.standard_normal(30)
    z[random.random((k, n)) < 0.1] = NAN
    z[k - 1, 25:33] = NAN
    z[:, 45:47] = NAN
    z[k - 1, 15] = truth[15] + 4
    z[0, 50] = truth[50] - 3
    initial = None
    if given:
        offset = random.normal(0, 0.1, (k, 3)) * [1, 0.1, 0.01]
        p = np.eye(3) * random.uniform(0.5, 1.5, (k, 1, 3)) * [0.5, 0.04, 0.0001]
        initial = np.array([350.0, 0.15, 0]) + offset, p
    return z % 360, r, times, initial


def batches(*shape, k=2, n=40, seed=0):
    return radars(MODEL, n, sigma=[0.1] * k, detection_probability=0.9, batch=shape, rng=seed).z
