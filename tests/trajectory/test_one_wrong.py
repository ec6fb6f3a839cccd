"""Paths of which one station is wrong for long."""

import numpy as np
import pytest
from checks import in_region
from trajectory.scenes import INSTANTS as TIME
from trajectory.scenes import ring

from tertia.location import Station
from tertia.trajectory import reconstruct

SIGMA, COUNT = 10.0, 6


def ranging(rng, count):
    """Return places of stations around a path, the path, and ranges with noise."""
    places, path = ring(rng, count, radius=2500.0, speed=20.0, spread=600.0)
    ranges = np.linalg.norm(path[:, np.newaxis] - places, axis=-1)
    return places, path, ranges + SIGMA * rng.standard_normal(ranges.shape)


def run(seed, error=0.0, begin=0, count=COUNT):
    """Return a path, and its errors, of which one station is wrong from an instant on."""
    places, path, ranges = ranging(np.random.default_rng([12, seed]), count)
    ranges[begin:, 0] += error
    track = reconstruct([Station(p, range_sigma=SIGMA) for p in places], TIME, range=ranges)
    return track, track.position - path


def inside(track, error):
    return np.mean(in_region(error, track.covariance[:, :2, :2]))


@pytest.mark.parametrize("error", [50.0, 200.0])
def test_a_station_that_is_always_wrong_is_left_out(error):
    errors, share = [], []
    for seed in range(8):
        track, own = run(seed, error)
        assert track.outlier.range[:, 0].all()
        assert not track.outlier.range[:, 1:].any()
        assert track.bias.range[0] > 2 * SIGMA
        assert np.isfinite(track.residual.range).all()
        errors.append(own)
        share.append(inside(track, own))
    # with the error spread over all stations it was 13 m and 45 m
    assert np.sqrt(np.mean(np.sum(np.square(errors), axis=-1))) < 4.0
    assert np.mean(share) > 0.85


def test_regions_hold_where_a_station_is_wrong_from_some_time_on():
    share, errors = [], []
    for seed in range(8):
        track, error = run(seed, 50.0, 30)
        share.append(inside(track, error))
        errors.append(error)
    assert np.mean(share) > 0.85
    assert np.sqrt(np.mean(np.sum(np.square(errors), axis=-1))) < 9.0


@pytest.mark.parametrize("count", [5, 6, 8])
@pytest.mark.parametrize("begin", [18, 30])
def test_regions_hold_where_a_large_error_begins_in_the_record(begin, count):
    share, errors, left = [], [], []
    for seed in range(8):
        track, error = run(seed, 200.0, begin, count)
        share.append(inside(track, error))
        errors.append(error)
        left.append(track.outlier.range[begin:, 0].all())
    # the error was taken for a motion: half of the positions inside, and 50 m
    assert np.mean(share) > 0.9
    assert np.mean(left) >= 0.75
    assert np.sqrt(np.median(np.sum(np.square(errors), axis=-1))) < 4.0


def test_nothing_is_left_out_where_all_are_right():
    for seed in range(8):
        track, error = run(seed)
        assert not track.outlier.range.all(axis=0).any()
        assert np.sqrt(np.mean(np.sum(error**2, axis=-1))) < 5.0
