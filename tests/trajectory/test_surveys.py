"""Stations whose surveyed positions are wrong, and which have other systematic errors as well."""

import numpy as np
import pytest
from scipy import stats

from tertia.sensors import Bias, Station
from tertia.trajectory import reconstruct

TIME = np.arange(80.0)
PATH = np.column_stack(
    [
        -150e3 + 3750 * TIME,
        20e3 + 500 * TIME,
        100e3 + 1500 * TIME - 4.5 * TIME**2 + 20 * np.sin(TIME / 5),
    ]
)
NOISE, SURVEY, BIAS = 5.0, 10.0, 30.0


def run(seed):
    """Return the squared error in units of the covariance (N,), and the squared error in m²."""
    rng = np.random.default_rng(seed)
    places = np.column_stack([rng.uniform(-100e3, 100e3, (6, 2)), rng.uniform(0, 1500, 6)])
    true = places + SURVEY * rng.standard_normal(places.shape)
    ranges = np.linalg.norm(PATH[:, np.newaxis] - true, axis=-1)
    ranges += BIAS * rng.standard_normal(6) + NOISE * rng.standard_normal(ranges.shape)
    stations = [Station(place, range_sigma=NOISE, position_sigma=SURVEY) for place in places]
    track = reconstruct(stations, TIME, range=ranges, bias=Bias(range_sigma=BIAS))
    error, own = track.position - PATH, track.covariance[:, :3, :3]
    solved = np.linalg.solve(own, error[..., np.newaxis])[..., 0]
    assert np.all(track.bias.range_sigma <= 1.01 * BIAS)  # without the survey error
    return np.sum(error * solved, axis=1), np.sum(error**2, axis=1)


def test_survey_errors_are_not_taken_for_large_biases():
    squares, errors = zip(*[run(seed) for seed in range(8)], strict=True)
    inside = np.mean(np.array(squares) < stats.chi2.ppf(0.95, 3))
    assert inside >= 0.85
    assert np.sqrt(np.median(errors)) < 90.0


def test_errors_of_which_nothing_is_known_take_survey_errors_in():
    """Without them in the estimated biases, .64 of the positions were inside."""
    inside = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        time = np.arange(120.0)
        path = np.column_stack([1800 * np.sin(time / 130), 1500 * np.cos(time / 100)])
        places = rng.uniform(-3e3, 3e3, (5, 2))
        apart = path[:, np.newaxis] - places - SURVEY * rng.standard_normal(places.shape)
        ranges = np.linalg.norm(apart, axis=-1) + BIAS * rng.standard_normal(5)
        ranges += NOISE * rng.standard_normal(ranges.shape)
        stations = [Station(place, range_sigma=NOISE, position_sigma=SURVEY) for place in places]
        track = reconstruct(stations, time, range=ranges, bias=Bias(range_sigma=np.inf))
        error, own = track.position - path, track.covariance[:, :2, :2]
        solved = np.linalg.solve(own, error[..., np.newaxis])[..., 0]
        inside.append(np.sum(error * solved, axis=1) < stats.chi2.ppf(0.95, 2))
    assert np.mean(inside) >= 0.9


@pytest.mark.filterwarnings("ignore:two paths explain")  # of the second
@pytest.mark.parametrize("seed", [9011, 9015, 9012])
def test_survey_errors_do_not_choose_the_side_of_nearly_level_stations(seed):
    """Otherwise the first two paths were below the stations, by 30 of their sigmas."""
    rng = np.random.default_rng(seed)
    time = np.arange(150.0)
    places = np.column_stack([rng.uniform(-3e3, 3e3, (6, 2)), rng.uniform(0.0, 150.0, 6)])
    east, north = rng.uniform(0.0, 6.3, 2)
    path = np.column_stack(
        [
            1800 * np.sin(time / 133.3 + east),
            1500 * np.cos(time / 105.26 + north),
            900 + 150 * np.sin(time / 30),
        ]
    )
    away = path[:, np.newaxis] - places - SURVEY * rng.standard_normal(places.shape)
    rng.standard_normal(7)
    ranges = np.linalg.norm(away, axis=-1) + 3.0 * rng.standard_normal((150, 6))
    stations = [Station(place, range_sigma=3.0, position_sigma=SURVEY) for place in places]
    track = reconstruct(stations, time, range=ranges, bias=Bias())
    assert np.median(np.abs(track.position[:, 2] - path[:, 2])) < 60.0
