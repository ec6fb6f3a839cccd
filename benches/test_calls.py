"""Cost of small calls from Python, which are mostly the call itself."""

import numpy as np
import pytest

from tertia import estimate_bearing, simulate
from tertia.association import associate
from tertia.fusion import fuse_series
from tertia.kalman import SingerModel, filter_series
from tertia.location import Station, locate
from tertia.screening import leave_one_out_mask
from tertia.smoothing import smooth

MODEL = SingerModel(5.0, 1 / 20, 0.003)
RNG = np.random.default_rng(1)
STATIONS = [
    Station(place, range_sigma=10.0, azimuth_sigma=0.005)
    for place in ([0.0, 1000.0], [2000.0, 300.0], [400.0, 2600.0], [2500.0, 2500.0])
]
RECORD = simulate.stations(STATIONS, [1000.0, 1500.0], rng=1)
PLACES = 1e3 * RNG.standard_normal((4, 2))
THETA, PLOTS = simulate.direction_finder(100, rng=1).theta, RNG.standard_normal((2, 10))

CALLS = {
    "leave_one_out_mask, 100 values": lambda: leave_one_out_mask(THETA),
    "estimate_bearing, 100 values": lambda: estimate_bearing(THETA),
    "filter_series, 10 plots": lambda: filter_series(PLOTS[0], 1.0, MODEL),
    "fuse_series, 2 × 10 plots": lambda: fuse_series(PLOTS, 1.0, MODEL),
    "smooth, 10 × 2": lambda: smooth(PLOTS.T, 1.0),
    "associate, 4 × 4": lambda: associate(PLACES, 1e4 * np.eye(2), PLACES + 1.0, score="paper"),
    "locate, 4 stations": lambda: locate(STATIONS, **RECORD.measurements),
}


@pytest.mark.parametrize("name", CALLS)
def test_call(benchmark, name):
    benchmark.extra_info["work"] = f"one call: {name}"
    benchmark(CALLS[name])
