"""Paths from ranges of which many are too long, because signals came by detours."""

import numpy as np
import pytest
from checks import in_region
from trajectory.test_one_wrong import SIGMA, TIME, ranging

from tertia.location import Station
from tertia.trajectory import reconstruct


def run(seed, share, count, sign=1.0):
    """Return a path and its errors, with this share of late ranges, and which are late."""
    rng = np.random.default_rng([31, seed])
    places, path, ranges = ranging(rng, count)
    late = rng.random(ranges.shape) < share
    ranges += sign * late * rng.exponential(20 * SIGMA, ranges.shape)
    track = reconstruct([Station(p, range_sigma=SIGMA) for p in places], TIME, range=ranges)
    return track, track.position - path, late


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("count", [5, 8])
def test_regions_hold_where_half_of_the_ranges_are_late(count, sign):
    inside, errors = [], []
    for seed in range(10):
        track, error, _ = run(seed, 0.5, count, sign)
        inside.append(np.mean(in_region(error, track.covariance[:, :2, :2])))
        errors.append(error)
    # with outliers of either side 64 % and 66 %, and 19 m and 8 m
    assert np.mean(inside) > 0.85
    assert np.sqrt(np.mean(np.sum(np.square(errors), axis=-1))) < 6.0


def test_late_ranges_are_left_out():
    for seed in range(4):
        track, _, late = run(seed, 0.3, 6)
        assert np.mean(track.outlier.range[late]) > 0.8
        assert np.mean(track.outlier.range[~late]) < 0.03
