"""Cost of a bearing from Python, one record and a batch."""

import pytest

from tertia import estimate_bearing
from tertia.simulate import direction_finder


@pytest.mark.parametrize("batch", [(), (1000,)], ids=["one", "batch of 1000"])
@pytest.mark.parametrize("method", ["mean", "k-sigma", "paper", "corrected", "robust"])
def test_cost(benchmark, method, batch):
    theta = direction_finder(100, batch=batch, rng=1).theta
    benchmark(estimate_bearing, theta, method=method, n_threads=1)
