"""Cost of a registration and of the tracks that it needs, by the number of radars."""

import numpy as np
import pytest

from tertia import simulate
from tertia.registration import register
from tertia.sensors import Radar
from tertia.tracker import track


def recording(count):
    angle = 2 * np.pi * np.arange(count) / count
    places = 5e4 * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    numbers = {"range_sigma": 50.0, "azimuth_sigma": 0.0014, "scan_period": 5.0}
    radars = [Radar(place, **numbers) for place in places]
    traffic = simulate.dense_traffic(100, area=(1.5e5, 1.5e5), rng=1)
    return simulate.radar_plots(traffic, radars, rng=2).plots, radars


@pytest.mark.parametrize("count", [2, 4, 8])
@pytest.mark.parametrize("task", [track, register])
def test_register(benchmark, task, count):
    plots, radars = recording(count)
    benchmark.pedantic(task, (plots, radars), rounds=3)
