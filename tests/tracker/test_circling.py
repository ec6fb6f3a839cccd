"""Gliders that circle in thermals beside aircraft that fly straight."""

from functools import cache

import numpy as np
import pytest
from checks import in_region

from tertia.sensors import Bias, Radar
from tertia.tracker import Plots, Tracker, smooth_tracks, track

GLIDERS, STEP = 5, 0.05


def radar(period):
    return Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=period, bias=Bias())


@cache
def scene(seed, period, others):
    """Return plots, whose they are, and positions and velocities; gliders come first."""
    rng = np.random.default_rng([31, seed])
    count = GLIDERS + others
    time = STEP * np.arange(int(600.0 / STEP))
    rate = np.radians(rng.uniform(13.0, 20.0, (count, 1))) * rng.choice([-1.0, 1.0], (count, 1))
    rate[GLIDERS:] = 0.0
    speed = np.where(np.arange(count) < GLIDERS, 25.0, rng.uniform(60.0, 220.0, count))
    course = rng.uniform(0.0, 2.0 * np.pi, (count, 1)) + rate * time
    velocity = speed[:, None, None] * np.stack([np.sin(course), np.cos(course)], axis=-1)
    velocity += rng.normal(0.0, 3.0, 2)
    start = rng.uniform(10e3, 30e3, (count, 1, 2)) * rng.choice([-1.0, 1.0], (count, 1, 2))
    position = start + np.cumsum(velocity, axis=1) * STEP
    at = np.arange(0.0, 590.0, period) + rng.uniform(0.0, period, (count, 1))
    target, scan = np.nonzero(rng.random(at.shape) < 0.9)
    place = np.minimum((at[target, scan] / STEP).astype(int), len(time) - 1)
    truth = np.hstack([position[target, place], velocity[target, place]])
    one, error = radar(period), rng.standard_normal((2, len(target)))
    distance = np.hypot(*truth[:, :2].T) + one.range_sigma * error[0]
    azimuth = np.arctan2(*truth[:, :2].T) + one.azimuth_sigma * error[1]
    order = np.argsort(time[place], kind="stable")
    plots = Plots(time[place], distance, azimuth % (2.0 * np.pi))[order]
    return plots, target[order], truth[order]


def judged(rows, target, truth):
    """Return RMSE and share inside 95 % of positions and of velocities of the gliders."""
    own = rows[(rows.plot >= 0) & (rows.time > 100.0)]
    own = own[target[own.plot] < GLIDERS]
    error = np.hstack([own.position, own.velocity]) - truth[own.plot]
    found = []
    for part in (slice(0, 2), slice(2, 4)):
        off, spread = error[:, part], own.covariance[:, part, part]
        found += [np.sqrt(np.mean(np.sum(off**2, axis=1))), np.mean(in_region(off, spread))]
    return found


@pytest.mark.parametrize("others", [15, 0])
def test_circling_is_no_noise(others):
    """The noise factor was up to 10 if there are gliders alone."""
    plots, _, _ = scene(1, 4.0, others)
    tracker = Tracker([radar(4.0)])
    for begin in np.arange(0.0, 600.0, 20.0):
        tracker.update(plots[(plots.time >= begin) & (plots.time < begin + 20.0)])
    known = tracker.noise_factor[np.isfinite(tracker.noise_factor)]
    assert np.all(known < 1.3)


@pytest.mark.parametrize(
    ("estimate", "off", "wrong"), [(track, 60.0, 20.0), (smooth_tracks, 45.0, 13.0)]
)
def test_gliders_are_followed(estimate, off, wrong):
    """Before: 81 and 98 m, 27 and 25 m/s, and no velocity inside 95 %."""
    plots, target, truth = scene(3, 4.0, 15)
    position, inside, velocity, sure = judged(estimate(plots, [radar(4.0)]), target, truth)
    assert position < off
    assert inside > 0.85
    assert velocity < wrong
    assert sure > 0.85


def test_turns_too_sharp_for_the_interval_are_in_the_covariance():
    """Half a turn from plot to plot is not followed; before, no velocity was inside 95 %."""
    plots, target, truth = scene(3, 10.0, 15)
    for rows in (track(plots, [radar(10.0)]), smooth_tracks(plots, [radar(10.0)])):
        _, inside, _, sure = judged(rows, target, truth)
        assert inside > 0.85
        assert sure > 0.75
