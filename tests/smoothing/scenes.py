"""Series for the tests of smoothing."""

import numpy as np
from checks import NAN, rng
from tolerances import TRACK


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


def assert_parity(found, mean, matrix, innovation, initial):
    """States, covariances and innovations are those of the reference."""
    sigma = np.sqrt(np.diagonal(matrix, axis1=1, axis2=2))
    known = np.isfinite(sigma)
    np.testing.assert_array_equal(np.isfinite(found.sigma), known)
    np.testing.assert_array_equal(np.isnan(found.mean), ~known)
    assert np.max(np.abs(found.mean - mean)[known] / sigma[known], initial=0) <= TRACK
    both = known[:, :, np.newaxis] & known[:, np.newaxis, :]
    unit = np.where(known, sigma, 1.0)
    difference = np.where(both, found.covariance, 0) - np.where(both, matrix, 0)
    scale = unit[:, :, np.newaxis] * unit[:, np.newaxis, :]
    assert np.max(np.abs(difference) / scale, initial=0) <= TRACK
    assert_close(found.innovation, innovation, TRACK, np.maximum(1, np.abs(innovation)))
    assert found.count == np.count_nonzero(~np.isnan(innovation)) or initial is None
