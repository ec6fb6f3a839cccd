"""Turns of several g, which gates do not follow."""

import numpy as np
import pytest

from tertia.tracker import Plots, Radar, track

RADARS = (
    Radar((0.0, 0.0), range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0),
    Radar((40e3, -30e3), range_sigma=70.0, azimuth_sigma=np.radians(0.1), scan_period=5.0),
)


def fighter(seed, count, acceleration=29.4):
    """Plots of an aircraft that turns for 20 s after one minute, and where it was."""
    rng = np.random.default_rng(seed)
    step = 0.05
    fine = np.arange(0.0, 140.0, step)
    rate = np.where((fine > 60.0) & (fine < 80.0), acceleration / 200.0, 0.0)
    course = rng.uniform(0.0, 2.0 * np.pi) + rng.choice([-1.0, 1.0]) * np.cumsum(rate) * step
    velocity = 200.0 * np.stack([np.sin(course), np.cos(course)], axis=-1)
    flown = np.array([35e3, 40e3]) + np.cumsum(velocity, axis=0) * step
    parts = []
    for k, radar in enumerate(RADARS[:count]):
        time = np.arange(rng.uniform(0.0, radar.scan_period), 139.0, radar.scan_period)
        time = time[rng.random(len(time)) < 0.95]
        truth = flown[(time / step).astype(int)]
        east, north = (truth - radar.position[:2]).T
        distance = np.hypot(east, north) + radar.range_sigma * rng.standard_normal(len(time))
        azimuth = np.arctan2(east, north) + radar.azimuth_sigma * rng.standard_normal(len(time))
        parts.append((time, distance, azimuth % (2.0 * np.pi), np.full(len(time), k), truth))
    time, distance, azimuth, sensor, truth = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    order = np.argsort(time, kind="stable")
    return Plots(time, distance, azimuth, sensor=sensor)[order], truth[order]


@pytest.mark.parametrize("count", [1, 2])
def test_a_fighter_is_one_track(count):
    """Of 24 that turn with 3 g; by the guard gate alone 9 and 6 are two tracks."""
    several, squares = 0, []
    for seed in range(24):
        plots, truth = fighter(seed, count)
        found = track(plots, RADARS[:count])
        shown = found[found.confirmed & (found.plot >= 0)]
        several += len(np.unique(shown.track)) > 1
        off = shown.position - truth[shown.plot]
        inverse = np.linalg.inv(shown.covariance[:, :2, :2])
        squares.append(np.einsum("ni,nij,nj->n", off, inverse, off) / 2.0)
    assert several <= 2
    assert np.mean(np.concatenate(squares)) < 1.3
