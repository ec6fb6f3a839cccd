"""Reported positions are less precise than stated, or their times are rounded."""

import numpy as np
import pytest
from checks import in_region

from tertia.sensors import Bias, PositionSensor, Radar
from tertia.tracker import Plots, Tracker, smooth_tracks, track

TARGETS, SIGMA = 15, 10.0


def flights(seed, interval, spread):
    """Return times, numbers, positions and velocities of aircraft that fly straight."""
    rng = np.random.default_rng(seed)
    parts = []
    for k in range(TARGETS):
        time = rng.uniform(0, 1) + np.cumsum(interval + spread * rng.uniform(-1, 1, 200))
        course = rng.uniform(0, 2 * np.pi)
        velocity = rng.uniform(120, 240) * np.array([np.sin(course), np.cos(course)])
        start = rng.uniform(-80e3, 80e3, 2)
        parts.append((time, np.full(200, k), start, velocity))
    time = np.concatenate([one[0] for one in parts])
    number = np.concatenate([one[1] for one in parts])
    start, velocity = (np.array([one[i] for one in parts]) for i in (2, 3))
    order = np.argsort(time)
    return rng, time[order], number[order], start, velocity


def reports(seed, stated, *, rounded=False, larger=1.0):
    """Return reports of a sensor that states this sigma, and a function for the true position.

    The errors of every third target are larger by a factor.
    """
    rng, time, number, start, velocity = flights(seed, 1.0, 0.2)

    def place(target, at):
        return start[target] + at[:, np.newaxis] * velocity[target]

    sigma = SIGMA * np.where(number % 3 == 0, larger, 1.0)
    position = place(number, time) + sigma[:, np.newaxis] * rng.standard_normal((len(time), 2))
    shown = np.round(time) if rounded else time
    plots = Plots(shown, position=position, icao_address=1 + number)
    sensor = PositionSensor(position_sigma=stated, update_interval=1.0, bias=Bias())
    return plots, [sensor], number, place


def inside(table, number, place):
    """Return the share of true positions, at the times of the rows, within the 95 % ellipses."""
    rows = table[(table.plot >= 0) & (table.time > 30.0)]
    off = rows.position - place(number[rows.plot], rows.time)
    return np.mean(in_region(off, rows.covariance[:, :2, :2]))


@pytest.mark.parametrize("estimate", [track, smooth_tracks])
@pytest.mark.parametrize(("stated", "rounded"), [(SIGMA, False), (SIGMA / 3, False), (SIGMA, True)])
def test_ellipses_contain_the_targets(estimate, stated, rounded):
    # before, a sixth to a third of them where the sensor states too little, or times are rounded
    plots, sensors, number, place = reports(1, stated, rounded=rounded)
    table = estimate(plots, sensors)
    assert len(np.unique(table.track)) == TARGETS
    assert inside(table, number, place) > 0.93


@pytest.mark.parametrize("estimate", [track, smooth_tracks])
def test_each_target_has_its_own_noise(estimate):
    plots, sensors, number, place = reports(1, SIGMA, larger=5.0)
    table = estimate(plots, sensors)
    assert len(np.unique(table.track)) == TARGETS
    # a sixth of the noisy ones before
    rows = table.plot >= 0
    noisy = np.zeros(len(rows), dtype=bool)
    noisy[rows] = number[table.plot[rows]] % 3 == 0
    for some in (noisy, rows & ~noisy):
        assert inside(table[some], number, place) > 0.9
    # those of the others do not grow
    variances = np.trace(table.covariance[:, :2, :2], axis1=1, axis2=2)
    assert np.median(variances[rows & ~noisy]) < 0.2 * np.median(variances[noisy])


def test_a_tracker_says_how_noisy_reports_are():
    plots, sensors, *_ = reports(2, SIGMA / 2)
    tracker = Tracker(sensors)
    tracker.update(plots)
    assert abs(tracker.noise_factor[0] - 2.0) < 0.1


@pytest.mark.parametrize("estimate", [track, smooth_tracks])
def test_whole_seconds_of_a_radar_are_allowed_for(estimate):
    _, _, _, start, velocity = flights(3, 1.0, 0.2)
    rng = np.random.default_rng(4)
    number, scan = (one.ravel() for one in np.indices((TARGETS, 60)))
    time = 4.0 * scan
    for _ in range(3):
        place = start[number] + time[:, np.newaxis] * velocity[number]
        azimuth = np.arctan2(place[:, 0], place[:, 1]) % (2 * np.pi)
        time = 4.0 * (scan + azimuth / (2 * np.pi))
    distance = np.hypot(*place.T) + 30.0 * rng.standard_normal(len(time))
    azimuth = azimuth + 0.0005 * rng.standard_normal(len(time))
    plots = Plots(np.round(time), distance, azimuth)
    radar = Radar(range_sigma=30.0, azimuth_sigma=0.0005, scan_period=4.0, bias=Bias())
    table = estimate(plots, [radar])
    # before, less than two thirds
    share = inside(table, number, lambda k, at: start[k] + at[:, np.newaxis] * velocity[k])
    assert share > 0.93
