"""Cost of positions from Python, one instant and a batch."""

import numpy as np
import pytest

from tertia import simulate
from tertia.location import Station, accuracy_map, locate

PLACES = [[1, 1000, 2], [2000, 300, 5], [400, 2600, 0], [2500, 2500, 30]]
RADARS = [Station(p, range_sigma=10.0, azimuth_sigma=0.005, elevation_sigma=0.005) for p in PLACES]


@pytest.mark.parametrize("batch", [(), (10_000,)], ids=["one", "batch of 10000"])
@pytest.mark.parametrize("faults", [0.0, 0.05])
@pytest.mark.parametrize("method", ["robust", "least-squares"])
def test_locate(benchmark, method, faults, batch):
    target = [1000.0, 1500.0, 500.0]
    record = simulate.stations(RADARS, target, outlier_probability=faults, batch=batch, rng=1)
    benchmark(locate, RADARS, **record.measurements, method=method, n_threads=1)


def test_accuracy_map(benchmark):
    grid = np.random.default_rng(1).uniform(0, 3000, (10_000, 3))
    benchmark(accuracy_map, RADARS, grid, n_threads=1)
