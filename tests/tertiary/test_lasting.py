"""Tracks whose errors last, as those of inertial navigation."""

import numpy as np
import pytest
from checks import in_region

from tertia.sensors import Radar
from tertia.tertiary import SensorTracks, fuse_tracks

SIGMA, WHITE, STEP, END = 30.0, 3.0, 5.0, 600.0
RADARS = [
    Radar(
        [3e4 * np.cos(2 * k), 3e4 * np.sin(2 * k)],
        range_sigma=SIGMA,
        azimuth_sigma=1e-3,
        scan_period=STEP,
        max_range=3e5,
    )
    for k in range(3)
]
TARGETS = 6


def scene(seed, duration):
    """Return tracks whose errors last for a duration, places at time 0, and velocities."""
    rng = np.random.default_rng([9, seed])
    place, velocity = rng.uniform(-2e4, 2e4, (TARGETS, 2)), rng.normal(0, 100, (TARGETS, 2))
    rest = np.exp(-STEP / duration)
    rows = []
    for k in range(3):
        error = rng.normal(0, SIGMA, (TARGETS, 2))
        for time in np.arange(k * STEP / 3, END, STEP):
            fresh = rng.normal(0, SIGMA * np.sqrt(1 - rest**2), error.shape)
            error = rest * error + fresh
            here = place + time * velocity + error + rng.normal(0, WHITE, error.shape)
            rates = velocity + rng.normal(0, 1, velocity.shape)
            rows += [(time, k, i, here[i], rates[i]) for i in range(TARGETS)]
    time, sensor, number, position, rates = (np.array(c) for c in zip(*rows, strict=True))
    variances = np.repeat([SIGMA**2 + WHITE**2, 4.0], 2)
    covariance = np.broadcast_to(np.diag(variances), (len(time), 4, 4))
    tracks = SensorTracks(time, sensor, number, position, rates, covariance=covariance)
    return tracks, place, velocity


@pytest.mark.parametrize("method", ["tracklets", "covariance-intersection"])
@pytest.mark.parametrize("duration", [60.0, 200.0])
def test_regions_hold_where_errors_last(method, duration):
    square, inside = [], []
    for seed in range(4):
        tracks, place, velocity = scene(seed, duration)
        found = fuse_tracks(tracks, RADARS, method=method)
        found = found[found.time > 60.0]
        truth = place + found.time[:, np.newaxis, np.newaxis] * velocity
        error = found.position[:, np.newaxis] - truth
        nearest = np.argmin(np.sum(error**2, axis=2), axis=1)
        error = error[np.arange(len(nearest)), nearest]
        square.append(np.sum(error**2, axis=1))
        inside.append(in_region(error, found.covariance[:, :2, :2]))
    # half were inside: what lasts was taken for noise, and for errors of the sensors
    assert np.mean(np.concatenate(inside)) > 0.8
    assert np.sqrt(np.mean(np.concatenate(square))) < 2 * SIGMA
