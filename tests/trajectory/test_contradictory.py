"""Paths from stations that contradict each other far more than their sigmas allow."""

import warnings

import numpy as np
import pytest

from tertia.location import Station
from tertia.trajectory import reconstruct
from tertia.trajectory._doubts import warn_of_path

PLACES = np.array([[-60e3, 30e3, 0.0], [60e3, -50e3, 0.0], [40e3, 80e3, 0.0], [-70e3, -40e3, 0.0]])
SIGMA = np.radians(0.02)
TIMES = 0.04 * np.arange(40)


def meteor(time):
    return np.array([0.0, 0.0, 95e3]) + 20e3 * time[:, np.newaxis] * [0.8, 0.3, -0.5]


@pytest.mark.parametrize("seed", [0, 2, 8, 10])
def test_cameras_whose_clocks_differ(seed):
    """Nothing agrees at single instants, so that hardly any has a position by the stated sigmas."""
    random = np.random.default_rng([9, seed])
    late = random.normal(0.0, 0.05, 4)
    away = np.stack([meteor(TIMES + late[k]) - PLACES[k] for k in range(4)], axis=1)
    azimuth = np.arctan2(away[..., 0], away[..., 1])
    elevation = np.arctan2(away[..., 2], np.hypot(away[..., 0], away[..., 1]))
    azimuth += SIGMA * random.normal(size=(40, 4))
    elevation += SIGMA * random.normal(size=(40, 4))
    stations = [Station(place, azimuth_sigma=SIGMA, elevation_sigma=SIGMA) for place in PLACES]
    path = reconstruct(stations, TIMES, azimuth=azimuth, elevation=elevation)
    error = np.linalg.norm(path.position - meteor(TIMES), axis=1)
    # a clock that is wrong by 0.05 s moves the meteor by a kilometre
    assert np.sqrt(np.mean(error**2)) < 3e3
    assert path.systematic == "estimated"


def test_most_measurements_are_left_out():
    number = np.arange(100.0).reshape(4, 5, 5)
    values = np.where(number % 5 == 1, np.nan, number)
    outlier = np.isfinite(values) & (np.arange(5) > 1)
    found = {
        "outlier": outlier,
        "image": None,
        "is_behind": False,
        "may_cross": False,
        "is_doubtful": False,
    }
    with pytest.warns(UserWarning, match="60 of 80 measurements contradict the path"):
        warn_of_path(found, values)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_path(found | {"outlier": outlier & (np.arange(5) > 2)}, values)
