"""Cost of weights, their Jacobian and their covariance from Python, one problem and a batch."""

import numpy as np
import pytest

from tertia import weights

FUNCTIONS = {
    "weight_matrices": lambda x, s: weights.weight_matrices(s, n_threads=1),
    "weight_covariance": lambda x, s: weights.weight_covariance(s, 30, n_threads=1),
    "jacobian": lambda x, s: weights.jacobian(s, n_threads=1),
}


@pytest.mark.parametrize("batch", [(), (10_000,)], ids=["one", "batch of 10000"])
@pytest.mark.parametrize("m", [2, 3, 6])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_cost(benchmark, name, m, batch):
    rng = np.random.default_rng(1)
    root = rng.standard_normal((*batch, 2, m, 2 * m))
    covariances = root @ np.swapaxes(root, -1, -2)
    estimates = rng.standard_normal((*batch, 2, m))
    benchmark(FUNCTIONS[name], estimates, covariances)
