"""Ranges, azimuths and times that are recorded in coarse steps."""

import numpy as np
import pytest
from checks import in_region

from tertia.tracker import Plots, Radar, Tracker, track

MILE, SIGMAS = 1852.0, (15.0, np.radians(0.03))


def scene(seed, speeds, *, period=4.0, sigmas=SIGMAS, count=12, steps=(0, 0, 0)):
    """Return plots, with steps of time, range and azimuth, the radar, and where targets are."""
    rng = np.random.default_rng(seed)
    start = rng.uniform(-40e3, 40e3, (count, 2))
    course, speed = rng.uniform(0, 2 * np.pi, count), rng.uniform(*speeds, count)
    velocity = speed[:, np.newaxis] * np.stack([np.sin(course), np.cos(course)], axis=-1)

    def place(target, at):
        return start[target] + at[:, np.newaxis] * velocity[target]

    target = np.repeat(np.arange(count), 120)
    time = np.tile(np.arange(120) * period, count)
    for _ in range(3):
        angle = np.arctan2(*place(target, time).T) % (2 * np.pi)
        time = np.tile(np.arange(120) * period, count) + angle / (2 * np.pi) * period
    seen = place(target, time)
    values = [
        time,
        np.hypot(*seen.T) + sigmas[0] * rng.standard_normal(len(time)),
        (np.arctan2(*seen.T) + sigmas[1] * rng.standard_normal(len(time))) % (2 * np.pi),
    ]
    pairs = zip(values, steps, strict=True)
    values = [np.round(own / step) * step if step else own for own, step in pairs]
    order = np.argsort(time, kind="stable")
    radar = Radar(range_sigma=sigmas[0], azimuth_sigma=sigmas[1], scan_period=period)
    return Plots(*values)[order], [radar], target[order], place


def inside(table, target, place):
    """Return the share of true positions within the 95 % ellipses."""
    rows = table[(table.plot >= 0) & (table.time > 60.0)]
    off = rows.position - place(target[rows.plot], rows.time)
    return np.mean(in_region(off, rows.covariance[:, :2, :2]))


SCENES = [
    ((120, 240), (0, 0, np.radians(0.1)), 12),
    ((120, 240), (0, MILE / 8, 0), 12),
    ((2, 12), (0, MILE / 16, np.radians(0.1)), 12),
    ((120, 240), (1.0, 0, 0), 2),
]


@pytest.mark.parametrize(("speeds", "steps", "count"), SCENES)
def test_ellipses_contain_targets_whose_values_are_rounded(speeds, steps, count):
    shares, tracks = [], 0
    for seed in range(4):
        plots, radars, target, place = scene(seed, speeds, steps=steps, count=count)
        table = track(plots, radars)
        shares.append(inside(table, target, place))
        tracks += len(np.unique(table.track)) - count
    assert np.mean(shares) > 0.9
    assert tracks <= 2


def test_steps_are_found_live():
    plots, radars, target, place = scene(1, (120, 240), steps=(0, MILE / 8, 0))
    tracker, scan, shares = Tracker(radars), plots.time // 4.0, []
    for one in np.unique(scan):
        found = tracker.update(plots[scan == one])
        if one > 25:
            shares.append(inside(found, target, place))
    assert np.mean(shares) > 0.9
