"""Cost of local polynomials and of the smoother from Python."""

import numpy as np
import pytest

from tertia.smoothing import local_polynomial, smooth

SHAPES = pytest.mark.parametrize("shape", [(100_000,), (1_000, 100)], ids=str)


def series(shape):
    rng = np.random.default_rng(1)
    return 10.0 * np.sin(np.arange(shape[-1]) / 50) + rng.standard_normal(shape)


@SHAPES
@pytest.mark.parametrize("degree", [2, "adaptive"])
@pytest.mark.parametrize("irregular", [False, True], ids=["equal steps", "irregular"])
def test_local_polynomial(benchmark, shape, degree, irregular):
    y = series(shape)
    times = np.arange(shape[-1]) + 0.3 * np.sin(np.arange(shape[-1])) if irregular else None
    benchmark.extra_info["instants"] = y.size
    benchmark(local_polynomial, y, 13, degree, time=times, n_threads=1)


@pytest.mark.parametrize("axes", [1, 2, 3])
@pytest.mark.parametrize("jerk", [1e-3, None], ids=["known", "fitted"])
def test_smooth(benchmark, axes, jerk):
    y = np.stack([series((2_000,))] * axes, axis=-1)
    benchmark.extra_info["instants"] = len(y)
    benchmark(smooth, y, 1.0, jerk=jerk, n_threads=1)
