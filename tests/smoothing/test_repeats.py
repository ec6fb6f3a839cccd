"""Plots that repeat the one before."""

import numpy as np
import pytest
from checks import in_region, rng

from tertia.smoothing import smooth

SIGMA, N, RUNS = 10.0, 150, 12
LATE = slice(80, 120)


def scene(kind, speed=8.0):
    """Return plots to the centimetre, some of which come again, and the path."""
    random = rng(31)
    velocity = np.cumsum(random.normal(0, 0.3, (RUNS, N, 2)), axis=1)
    velocity += speed * np.array([1.0, 0.4])
    path = np.cumsum(velocity, axis=1)
    y = np.round(path + SIGMA * random.standard_normal(path.shape), 2)
    if kind == "stuck":
        y[:, LATE] = y[:, LATE.start - 1, np.newaxis]
    elif kind == "held":
        y = np.repeat(y[:, ::5], 5, axis=1)
    return y, path


def held(found, path, instants):
    error = (found.position - path)[:, instants]
    return np.mean(in_region(error, found.position_covariance[:, instants]))


@pytest.mark.parametrize("speed", [8.0, 200.0])
def test_a_sensor_that_is_stuck(speed):
    y, path = scene("stuck", speed)
    found = smooth(y, SIGMA**2)
    assert held(found, path, LATE) > 0.8
    assert found.outlier[:, LATE].all()
    assert found.outlier.mean() < 0.3


def test_plots_that_are_held():
    y, path = scene("held")
    found = smooth(y, SIGMA**2)
    assert held(found, path, slice(None)) > 0.8
    known = np.arange(N) % 5 == 0
    left_out = found.outlier[:, ~known].all(axis=-1)
    assert left_out.mean() > 0.9
    kept = np.where(known[:, np.newaxis], y, np.nan)
    alone = smooth(kept, SIGMA**2)
    np.testing.assert_array_equal(found.position[left_out], alone.position[left_out])


def test_coarse_plots_and_noise_as_stated_are_no_fault():
    y, _ = scene("healthy")
    coarse = smooth(20.0 * np.round(y / 20.0), SIGMA**2 + 20.0**2 / 12)
    assert coarse.outlier.mean() < 2e-3
    y, _ = scene("held")
    assert not smooth(y[0], SIGMA**2, robust=False, correlation_time=0.0).outlier.any()
