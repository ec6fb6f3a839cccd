"""Cost of checking errors against what was claimed of them."""

import numpy as np
import pytest

from tertia import metrics

FUNCTIONS = {
    "nees": metrics.nees,
    "nis": lambda errors, p: metrics.nis(errors[..., 0], p[..., 0, 0]),
    "rmse": lambda errors, p: metrics.rmse(errors, axis=0),
    "autocorrelation": lambda errors, p: metrics.autocorrelation(errors[..., 0]),
}


@pytest.mark.parametrize("shape", [(10_000,), (1_000, 200)], ids=str)
@pytest.mark.parametrize("name", FUNCTIONS)
def test_cost(benchmark, name, shape):
    errors = np.random.default_rng(1).standard_normal((*shape, 3))
    covariances = np.broadcast_to(np.diag([1.0, 2.0, 3.0]), (*shape, 3, 3))
    benchmark(FUNCTIONS[name], errors, covariances)
