"""Turns of several g, which gates do not follow."""

from dataclasses import replace

import numpy as np
import pytest

from tertia import metrics
from tertia.tracker import Plots, Radar, track

RADARS = (
    Radar((0.0, 0.0), range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0),
    Radar((40e3, -30e3), range_sigma=70.0, azimuth_sigma=np.radians(0.1), scan_period=5.0),
    Radar((-35e3, -25e3), range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0),
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
        squares.append(metrics.nees(off, shown.covariance[:, :2, :2]) / 2.0)
    assert several <= 2
    assert np.mean(np.concatenate(squares)) < 1.3


@pytest.mark.parametrize("count", [1, 2])
def test_a_fighter_with_an_address_keeps_its_number(count):
    """Of 24 that turn with 7 g, 5 and 9 have several tracks if only gaps are resumed; now none."""
    several = 0
    for seed in range(24):
        plots, _ = fighter(seed, count, 68.6)
        known = replace(plots, icao_address=np.full(len(plots), 0x3F7A21))
        found = track(known, RADARS[:count])
        several += len(np.unique(found.track)) > 1
    assert several <= 1


def test_two_targets_with_one_address_are_two_tracks():
    rng = np.random.default_rng(1)
    time = np.repeat(4.0 * np.arange(40), 2)
    number = np.tile([0, 1], 40)
    seen = (rng.random(80) < 0.85) & ((number == 0) | (time > 40.0))
    distance = 50e3 + 200.0 * time + 1500.0 * number + rng.normal(0.0, 50.0, 80)
    plots = Plots(time, distance, 0.5, icao_address=np.full(80, 0x3F7A21))
    with pytest.warns(UserWarning, match="have the same address, 3F7A21"):
        found = track(plots[seen], RADARS[:1])
    assert len(np.unique(found.track)) == 2
    for one in (0, 1):
        own = found.track_of_plot[number[seen] == one]
        assert len(np.unique(own[own > 0])) == 1
