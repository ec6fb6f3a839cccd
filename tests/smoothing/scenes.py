"""Series for the tests of smoothing."""

import numpy as np
from checks import NAN, rng


def series(n, seed=0):
    return np.cumsum(rng(seed).normal(size=n)) + rng(seed + 1).normal(size=n)


def gaps(y, share, seed=2):
    return np.where(rng(seed).random(np.shape(y)) < share, NAN, y)


def covariances(n, d, seed=0):
    a = rng(seed).normal(size=(n, d, d))
    return a @ np.swapaxes(a, 1, 2) + 0.1 * np.eye(d)


def assert_close(found, expected, tolerance, scale):
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    assert np.nanmax(np.abs(found - expected) / scale, initial=0) <= tolerance
