"""Kinds of measurements whose errors are far larger than stated."""

import numpy as np
import pytest
from checks import in_region

from tertia.sensors import Station
from tertia.trajectory import reconstruct

PLACES = np.array([[0.0, 0.0], [50.0, 0.0], [25.0, 40.0]])
TIME = 0.5 * np.arange(80)
WAY = np.column_stack([5 + TIME, 10 + 8 * np.sin(TIME / 6)])
SIGMAS = {"range_sigma": 0.1, "azimuth_sigma": np.radians(1.0)}
STATIONS = [Station(place, **SIGMAS) for place in PLACES]


def measured(seed, range_errors, azimuth_errors):
    """Return ranges and azimuths with errors of these sizes, in stated sigmas."""
    rng = np.random.default_rng([92, seed])
    away = WAY[:, np.newaxis] - PLACES
    errors = rng.standard_normal((2, *away.shape[:2]))
    ranges = np.linalg.norm(away, axis=-1) + 0.1 * range_errors * errors[0]
    azimuths = np.arctan2(*np.moveaxis(away, -1, 0))
    return {
        "range": ranges,
        "azimuth": azimuths + np.radians(azimuth_errors) * errors[1],
    }


def judged(track):
    error = track.position - WAY
    inside = in_region(error, track.covariance[:, :2, :2])
    return np.sqrt(np.mean(np.sum(error**2, axis=1))), np.mean(inside)


@pytest.mark.parametrize(("ranges", "azimuths"), [(4.0, 1.0), (15.0, 1.0), (1.0, 8.0), (4.0, 4.0)])
def test_the_kind_with_the_larger_errors_weighs_less(ranges, azimuths):
    found, known = [], []
    for seed in range(6):
        rows = measured(seed, ranges, azimuths)
        track = reconstruct(STATIONS, TIME, **rows)
        sigmas = {"range_sigma": 0.1 * ranges, "azimuth_sigma": np.radians(azimuths)}
        right = [Station(place, **sigmas) for place in PLACES]
        found.append(judged(track))
        known.append(judged(reconstruct(right, TIME, **rows))[0])
        assert track.outlier.range.mean() < 0.1
    rmse, inside = np.mean(found, axis=0)
    # with such ranges, it was three to five times as large, and .5 were inside
    assert rmse < 1.1 * np.mean(known)
    assert 0.9 < inside < 0.99


def test_residuals_are_in_stated_sigmas():
    residual = reconstruct(STATIONS, TIME, **measured(0, 15.0, 1.0)).residual
    assert np.std(residual.range) == pytest.approx(15.0, rel=0.2)
    assert np.std(residual.azimuth) == pytest.approx(1.0, rel=0.2)


def test_faults_of_a_third_are_no_larger_noise():
    rows = measured(1, 1.0, 1.0)
    rng = np.random.default_rng(93)
    wrong = rng.random(rows["range"].shape) < 0.33
    rows["range"][wrong] += rng.uniform(1.0, 3.0, np.count_nonzero(wrong))
    track = reconstruct(STATIONS, TIME, **rows)
    assert np.mean(track.outlier.range == wrong) > 0.9
    assert judged(track)[0] < 0.1
