"""The tracker uses the noise that it finds; outliers are taken within the guard gate."""

from dataclasses import replace

import numpy as np
import pytest
from checks import correlated
from tracker.flights import RADAR, noisy, polar

from tertia import metrics, simulate
from tertia.sensors import Bias, Radar
from tertia.tracker import Plots, Tracker, smooth_tracks, track

SCANS, TARGETS = 150, 12


def scene(noise=1.0, correlation=0.0, seed=1, targets=TARGETS):
    """Return plots of aircraft that fly straight, and where they are."""
    rng = np.random.default_rng(seed)
    parts = []
    for k in range(targets):
        time = 4.0 * np.arange(SCANS) + 4.0 * k / targets
        course = rng.uniform(0, 2 * np.pi)
        start = np.array([15e3 + 12e3 * (k % 4), 20e3 + 15e3 * (k // 4)])
        position = start + np.outer(time, 60.0 * np.array([np.sin(course), np.cos(course)]))
        distance, azimuth = polar(position)
        error = correlated(rng.standard_normal((2, SCANS)), correlation)
        distance = distance + noise * RADAR.range_sigma * error[0]
        azimuth = azimuth + noise * RADAR.azimuth_sigma * error[1]
        parts.append((time, distance, azimuth, np.full(SCANS, k), position))
    time, distance, azimuth, target, position = (
        np.concatenate(one) for one in zip(*parts, strict=True)
    )
    return Plots(time, distance, azimuth), target, position


def normalised(table, position):
    rows = table[table.confirmed & (table.plot >= 0)]
    off = rows.position - position[rows.plot]
    return metrics.nees(off, rows.covariance[:, :2, :2]) / 2


@pytest.mark.parametrize(
    ("options", "before", "most"),
    [({"noise": 2.0}, 3.5, 1.5), ({"correlation": 0.7}, 1.9, 1.3), ({}, 1.1, 1.1)],
)
def test_a_recording_is_tracked_with_the_noise_that_it_has(options, before, most):
    # `before` is what was reached with the noise that is stated
    plots, _, position = scene(**options)
    table = track(plots, [RADAR])
    assert np.mean(normalised(table, position)) < most < before + 0.2
    assert len(np.unique(table.track[table.confirmed])) == TARGETS


@pytest.mark.parametrize("seed", range(1, 6))
def test_noise_of_a_few_targets_is_no_motion(seed):
    # with a sigma of 24 to 32 m/s where it was known late, and then used in part
    plots, _, position = scene(noise=2.0, seed=seed, targets=3)
    rows = Tracker([RADAR]).update(plots)
    rows = rows[rows.confirmed & (rows.plot >= 0) & (rows.time > 400.0)]
    assert np.sqrt(np.median(rows.covariance[:, 2, 2])) < 6.0
    assert np.mean(normalised(rows, position)) < 1.2


def turning_scene(period, seed):
    """Return plots and paths of airliners that turn for an eighth of the time."""
    rng = np.random.default_rng(seed)
    radar = replace(RADAR, scan_period=period)
    fine = np.arange(0.0, 900.0 + period)
    parts = []
    for k in range(20):
        rate = np.zeros(len(fine))
        for begin in rng.uniform(0.0, 900.0, 3).astype(int):
            size, rate_of_one = np.radians(rng.uniform(30, 120)), np.radians(rng.uniform(1, 3))
            rate[begin : begin + int(size / rate_of_one)] = rng.choice([-1, 1]) * rate_of_one
        course = rng.uniform(0, 2 * np.pi) + np.cumsum(rate)
        path = rng.uniform(-80e3, 80e3, 2) + 200.0 * np.cumsum(
            np.stack([np.sin(course), np.cos(course)], axis=1), axis=0
        )
        time = np.arange(rng.uniform(0, period), 900.0, period)
        position = np.stack([np.interp(time, fine, path[:, i]) for i in range(2)], axis=1)
        distance, azimuth = noisy(position, radar, rng)
        parts.append((time, distance, azimuth, np.full(len(time), 1 + k), position))
    time, distance, azimuth, target, position = (
        np.concatenate(one) for one in zip(*parts, strict=True)
    )
    return radar, Plots(time, distance, azimuth, icao_address=target), position


def test_turns_of_a_few_scans_are_no_correlated_noise():
    errors = []
    for seed in range(3):
        radar, plots, position = turning_scene(12.0, seed)
        tracker = Tracker([radar])
        rows = tracker.update(plots)
        assert tracker.noise_factor == pytest.approx(1.0, abs=0.2)
        rows = rows[rows.confirmed & (rows.plot >= 0)]
        errors.append(np.mean(np.sum((rows.position - position[rows.plot]) ** 2, axis=1)))
    # 200 m where the noise was taken for five to nine times as large as it is
    assert np.sqrt(np.mean(errors)) < 130.0


def test_live_tracks_use_the_noise_as_soon_as_it_is_known():
    plots, _, position = scene(noise=2.0)
    tracker = Tracker([RADAR])
    late = []
    for begin in range(0, 4 * SCANS, 4):
        now = np.flatnonzero((plots.time >= begin) & (plots.time < begin + 4))
        rows = tracker.update(plots[now], time=begin + 4.0)
        if begin >= 2 * SCANS:
            late.append((rows, now))
    assert tracker.noise_factor == pytest.approx(2.0, abs=0.3)
    # plots are numbered in the order in which they were given
    given = np.concatenate(
        [np.flatnonzero((plots.time >= t) & (plots.time < t + 4)) for t in range(0, 4 * SCANS, 4)]
    )
    values = [normalised(rows, position[given]) for rows, _ in late]
    assert np.mean(np.concatenate(values)) < 1.5


def test_noise_as_stated_or_less_changes_nothing():
    for noise in (1.0, 0.5):
        plots, _, _ = scene(noise=noise)
        live = Tracker([RADAR])
        rows = live.update(plots)
        alike = track(plots, [RADAR])
        same = alike[alike.confirmed]
        np.testing.assert_array_equal(rows.position[-50:], same.position[-50:])
        assert live.noise_factor == pytest.approx(noise, rel=0.15)


def test_a_small_guard_acceleration_takes_few_outliers():
    count = error = 0
    for seed in (1, 2):
        plots, _, position = scene(seed=seed)
        rng = np.random.default_rng(seed + 10)
        far = rng.random(len(plots)) < 0.2
        push = 20.0 * far * rng.standard_normal((2, len(plots)))
        seen = rng.random(len(plots)) < 0.9
        plots = replace(
            plots,
            range=np.abs(plots.range + push[0] * RADAR.range_sigma),
            azimuth=plots.azimuth + push[1] * RADAR.azimuth_sigma,
        )
        table = track(plots[seen], [RADAR], guard_acceleration=2.0)
        count += len(np.unique(table.track[table.confirmed]))
        error += np.mean(normalised(table, position[seen]))
    assert count <= 2 * TARGETS + 4
    assert error / 2 < 2.0


def test_plots_that_now_and_then_lack_a_height_are_no_noise():
    radars = [
        Radar([east, 0.0], range_sigma=50.0, azimuth_sigma=0.0014, scan_period=4.0, bias=Bias())
        for east in (-15e3, 15e3)
    ]
    factors = []
    for seed in range(4):
        # near the radars the height counts
        traffic = simulate.dense_traffic(
            120, area=(5e4, 5e4), duration=120.0, turning_share=0.0, rng=seed
        )
        record = simulate.radar_plots(traffic, radars, height_missing_probability=0.15, rng=seed)
        tracker = Tracker(radars)
        tracker.update(record.plots)
        factors.append(tracker.noise_factor)
    # with both kinds in one chain of plots: 1.5
    assert np.mean(factors) < 1.1


@pytest.mark.parametrize("options", [{"noise": 2.0}, {"correlation": 0.7}, {}])
def test_a_recording_is_smoothed_with_the_noise_that_it_has(options):
    plots, _, position = scene(**options)
    table = smooth_tracks(plots, [RADAR], track(plots, [RADAR]))
    off = table.position - position[table.plot]
    square = metrics.nees(off, table.covariance[:, :2, :2]) / 2
    # 3.1 and 3.5 with the noise that is stated
    assert np.mean(square) < 1.25
