"""Cost of the screening functions from Python, and how it grows with N."""

import numpy as np
import pytest

from tertia import screening

FUNCTIONS = {
    "leave_one_out_mask": lambda y: screening.leave_one_out_mask(y, n_threads=1),
    "leave_one_out_statistics": lambda y: screening.leave_one_out_statistics(y, n_threads=1),
    "leave_one_out": lambda y: screening.leave_one_out(y, n_threads=1),
    "k_sigma": lambda y: screening.k_sigma(y, n_threads=1),
    "bursts": lambda y: screening.bursts(y, n_threads=1),
    "unwrap_about_median": lambda y: screening.unwrap_about_median(y, n_threads=1),
}


@pytest.mark.parametrize("shape", [(100,), (10_000,), (1_000_000,), (10_000, 100)], ids=str)
@pytest.mark.parametrize("name", FUNCTIONS)
def test_cost(benchmark, name, shape):
    y = np.random.default_rng(1).standard_normal(shape)
    benchmark.extra_info["measurements"] = y.size
    benchmark(FUNCTIONS[name], y)
