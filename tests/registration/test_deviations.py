"""Azimuth errors that change with the azimuth: found, removed, and in the covariances."""

import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from checks import in_region
from scipy import signal

from tertia import simulate
from tertia.registration import register
from tertia.sensors import Bias, Radar
from tertia.tracker import Plots, Tracker, smooth_tracks, track

NUMBERS = {"range_sigma": 50.0, "azimuth_sigma": 0.08, "scan_period": 5.0, "degrees": True}
RADARS = [Radar(place, **NUMBERS) for place in ([-30e3, 0.0], [30e3, 0.0], [0.0, 40e3])]
# degrees, of sin a, cos a, sin 2a and cos 2a
ONCE, TWICE = [0.1, -0.05, 0.0, 0.0], [0.0, 0.0, 0.08, 0.08]


def scene(seed, *curves):
    """Return aircraft and the plots of radars whose azimuth errors change along these curves."""
    traffic = simulate.dense_traffic(
        20, area=(120e3, 120e3), turning_share=0.3, duration=600.0, rng=[1, seed]
    )
    bias = Bias(range=np.zeros(len(curves)), deviation_order=2, deviation=curves, degrees=True)
    record = simulate.radar_plots(traffic, RADARS[: len(curves)], bias=bias, rng=[2, seed])
    return traffic, record


@pytest.mark.parametrize("curve", [ONCE, TWICE])
@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("seed", [4, 5])
def test_smoothed_tracks_are_where_they_say(curve, count, seed):
    # with .29 to .64 inside, and errors of 27 to 52 m, where they were taken as constant
    curves = [curve, *[[0.0] * 4] * (count - 1)]
    traffic, record = scene(seed, *curves)
    found = smooth_tracks(record.plots, RADARS[:count])
    found = found[found.plot >= 0]
    own = record.target[found.plot]
    truth = traffic.at(np.maximum(own, 0), found.time)[0]
    known = (own >= 0) & np.isfinite(truth).all(axis=1)
    off, spread = (found.position - truth)[known], found.covariance[known, :2, :2]
    assert np.mean(in_region(off, spread)) > 0.9
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 26.0


def test_deviations_are_those_of_the_radars():
    curves = np.radians([ONCE, TWICE, [0.0] * 4])
    _, record = scene(6, ONCE, TWICE, [0.0] * 4)
    found = register(record.plots, RADARS)
    assert found.bias.deviation_order == 2
    assert found.covariance.shape == (12, 12)
    shown = re.findall(r"azimuth deviation ([0-9.]+)° rms", repr(found))
    assert [float(one) for one in shown] == pytest.approx([0.079, 0.08, 0.0], abs=0.015)
    sigma = np.sqrt(np.diag(found.deviation_covariance)).reshape(3, 8)
    assert sigma[:, :4] == pytest.approx(np.sqrt(np.diag(found.covariance)).reshape(3, 4))
    off = (found.bias.deviation - curves) / sigma[:, 4:]
    assert np.max(np.abs(off)) < 3.5
    assert np.max(sigma[:, 4:]) < np.radians(0.03)
    # corrected plots have none
    assert register(found.bias_history.correct(record.plots), RADARS).bias.deviation_order == 0


def test_without_deviations_nothing_changes():
    for seed in range(4):
        _, record = scene(seed, *[[0.0] * 4] * 2)
        found = register(record.plots, RADARS[:2])
        assert found.bias.deviation_order == 0
        assert found.deviation_covariance is None


def inside(table, record, traffic):
    """Share of the positions after 120 s that are in their regions, and their RMSE."""
    rows = np.flatnonzero((table.plot >= 0) & (table.time > 120.0))
    own = record.target[table.plot[rows]]
    truth = traffic.at(np.maximum(own, 0), table.time[rows])[0]
    known = (own >= 0) & np.isfinite(truth).all(axis=1)
    off, spread = (table.position[rows] - truth)[known], table.covariance[rows][known, :2, :2]
    return np.mean(in_region(off, spread)), np.sqrt(np.mean(np.sum(off**2, axis=1)))


@pytest.mark.parametrize(("curve", "count"), [(ONCE, 2), (TWICE, 2), (ONCE, 3)])
def test_a_tracker_finds_deviations(curve, count):
    # with .64 to .75 inside, and errors of 46 to 66 m, where they were taken as constant
    traffic, record = scene(8, curve, *[[0.0] * 4] * (count - 1))
    tracker = Tracker(RADARS[:count])
    assert tracker.bias.deviation_order == 0
    share, rmse = inside(tracker.update(record.plots), record, traffic)
    assert share > 0.87
    assert rmse < 43.0
    assert tracker.bias.deviation_order == 2
    off = tracker.bias.deviation[0] - np.radians(curve)
    assert np.degrees(np.abs(off)).max() < 0.06


def test_a_recording_is_tracked_with_its_deviations_from_the_first_plot_on():
    # with .77 inside, and 62 m, where they were taken as constant
    traffic, record = scene(12, ONCE, [0.0] * 4)
    early = record.plots.time < 300.0
    table = track(record.plots[early], RADARS[:2])
    rows = (table.plot >= 0) & (table.time > 30.0)
    truth = traffic.at(record.target[early][table.plot[rows]], table.time[rows])[0]
    off, spread = table.position[rows] - truth, table.covariance[rows, :2, :2]
    assert np.mean(in_region(off, spread)) > 0.95
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 45.0


def test_a_tracker_without_deviations_finds_none():
    for seed in range(4):
        _, record = scene(seed, *[[0.0] * 4] * 2)
        tracker = Tracker(RADARS[:2])
        tracker.update(record.plots)
        assert tracker.bias.deviation_order == 0


def test_errors_that_last_for_some_scans_are_no_deviations():
    traffic = simulate.dense_traffic(20, area=(120e3, 120e3), duration=600.0, rng=[1, 11])
    exact = [replace(one, range_sigma=1e-3, azimuth_sigma=1e-8) for one in RADARS[:2]]
    record = simulate.radar_plots(traffic, exact, rng=[2, 11])
    plots, random, noise = record.plots, np.random.default_rng(3), np.zeros((len(record.plots), 2))
    for target in range(20):
        for sensor in range(2):
            own = np.flatnonzero((record.target == target) & (plots.sensor == sensor))
            fresh = random.normal(size=(len(own), 2))
            noise[own] = signal.lfilter([np.sqrt(0.51)], [1.0, -0.7], fresh, axis=0)
    off = noise * [50.0, np.radians(0.08)]
    tracker = Tracker(RADARS[:2])
    tracker.update(replace(plots, range=plots.range + off[:, 0], azimuth=plots.azimuth + off[:, 1]))
    assert tracker.bias.deviation_order == 0


def test_a_tracker_with_deviations_is_saved_and_the_same_for_all_threads():
    _, record = scene(8, ONCE, TWICE)
    early = record.plots.time < 300.0
    tables = []
    for n_threads in (1, 2):
        tracker = Tracker(RADARS[:2], n_threads=n_threads)
        tracker.update(record.plots[early])
        assert tracker.bias.deviation_order == 2
        tracker = pickle.loads(pickle.dumps(tracker))
        tables.append(tracker.update(record.plots[~early]))
    np.testing.assert_array_equal(tables[0].position, tables[1].position)
    np.testing.assert_array_equal(tables[0].covariance, tables[1].covariance)


def test_a_tracker_begins_with_a_registration_that_has_deviations():
    traffic, record = scene(7, ONCE, TWICE)
    found = register(record.plots, RADARS[:2])
    # in the sensors, azimuths are as uncertain as the deviations are large
    azimuth = np.array([one.bias.azimuth_sigma for one in found.sensors])
    largest = np.sqrt(0.5 * np.sum(found.bias.deviation**2, axis=1))
    assert np.all(azimuth > largest)
    tracker = Tracker(RADARS[:2], registration=found)
    assert tracker.bias.deviation == pytest.approx(found.bias.deviation)
    sigma = np.sqrt(np.diag(found.deviation_covariance)).reshape(2, 8)
    assert tracker.bias.azimuth_sigma == pytest.approx(sigma[:, 2], rel=0.2)
    traffic, record = scene(9, ONCE, TWICE)
    share, rmse = inside(tracker.update(record.plots), record, traffic)
    assert share > 0.87
    assert rmse < 43.0


def test_biases_of_several_sensors_with_deviations(tmp_path):
    both = Bias(azimuth=[1.0, 2.0], deviation_order=1, deviation=[[1, 0], [0, 2]], degrees=True)
    assert both[1].deviation == pytest.approx(np.radians([0.0, 2.0]))
    assert np.degrees(both[1].at(0.0)[0]) == pytest.approx(4.0)
    plots = Plots([0.0, 1.0, 2.0], 1e4, np.radians([31.5, 4.0, 182.0]), sensor=[0, 1, 0])
    corrected = np.degrees(both.correct(plots).azimuth)
    single = [both[k].correct(plots[i : i + 1]).azimuth[0] for i, k in enumerate(plots.sensor)]
    assert corrected == pytest.approx(np.degrees(single))
    assert corrected[1] == pytest.approx(0.0, abs=1e-9)
    both.save(tmp_path / "bias.json")
    assert Bias.load(tmp_path / "bias.json").deviation == pytest.approx(both.deviation)
    assert replace(both, azimuth=[0.0, 0.0]).deviation == pytest.approx(both.deviation)
    for fields, message in (
        ({"deviation": [1.0, 0.0]}, "deviation has shape"),
        ({"deviation_covariance": np.eye(3)}, "deviation_covariance is for one"),
    ):
        with pytest.raises(ValueError, match=message):
            Bias(azimuth=[0.0, 1.0], deviation_order=1, **fields)
