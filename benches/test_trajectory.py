"""Cost of a trajectory from Python, by order and smoother."""

import numpy as np
import pytest

from tertia.location import Station
from tertia.trajectory import reconstruct

PLACES = np.array([[1.0, 1000.0, 2.0], [2000.0, 300.0, 5.0], [400.0, 2600.0, 0.0]])


@pytest.mark.parametrize("steps", [60, 1000])
@pytest.mark.parametrize("smoother", ["rts", "local-polynomial"])
@pytest.mark.parametrize("order", ["spatial-first", "temporal-first"])
def test_cost(benchmark, order, smoother, steps):
    stations = [Station(p, range_sigma=10.0, azimuth_sigma=0.005) for p in PLACES[:, :2]]
    t = np.arange(float(steps))
    offset = np.column_stack([20 * t, 1500 + 5 * t])[:, np.newaxis] - PLACES[:, :2]
    rng = np.random.default_rng(1)
    measured = {
        "range": np.linalg.norm(offset, axis=-1) + 10 * rng.standard_normal((steps, 3)),
        "azimuth": np.arctan2(offset[..., 0], offset[..., 1])
        + 0.005 * rng.standard_normal((steps, 3)),
    }
    options = {"order": order, "smoother": smoother, "n_threads": 1}
    benchmark(reconstruct, stations, t, **measured, **options)
