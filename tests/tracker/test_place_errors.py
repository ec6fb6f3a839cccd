"""Constant errors of reported positions: stated, and estimated live and from recordings."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from tracker.flights import with_reports

from tertia import simulate
from tertia.metrics import nees
from tertia.registration import register
from tertia.sensors import Bias, PositionSensor, Radar, Station
from tertia.tracker import Plots, Tracker, smooth_tracks, track

ERROR = np.array([60.0, -35.0])
RADAR = Radar(
    [-5e4, 0.0], range_sigma=50.0, azimuth_sigma=0.0014, scan_period=4.0, bias=Bias(), name="radar"
)
UNKNOWN = PositionSensor(
    position_sigma=25.0, bias=Bias(east_sigma=100.0, north_sigma=100.0), name="adsb"
)
TARGETS = 12


def recording(seed, error=ERROR):
    """Plots of an exact radar and reports with a constant error, their targets and the truth."""
    random = np.random.default_rng([83, seed])
    traffic = simulate.dense_traffic(
        TARGETS, area=(8e4, 8e4), turning_share=0.0, duration=160.0, rng=random
    )
    record = simulate.radar_plots(traffic, [RADAR], rng=random)
    time = np.arange(0.3, 159.0, 1.0)
    target = np.repeat(np.arange(TARGETS), len(time))
    time = np.tile(time, TARGETS)
    place = traffic.at(target, time)[0] + error + random.normal(0.0, 25.0, (len(time), 2))
    return traffic, *with_reports(record, time, target, place)


def normalised(bias):
    """The errors that are left over their sigmas, east and north."""
    value, sigma = (
        np.array([np.atleast_1d(getattr(bias, kind + end))[-1] for kind in ("east", "north")])
        for end in ("", "_sigma")
    )
    assert np.all(sigma < 15.0)
    return (value - ERROR) / sigma


def test_stated_errors_are_taken_out():
    _, plots, _ = recording(0)
    stated = replace(UNKNOWN, bias=Bias(east=ERROR[0], north=ERROR[1]))
    exact = replace(UNKNOWN, bias=Bias())
    alone = plots[plots.sensor == 1]
    alone = alone._replaced(sensor=np.zeros(len(alone), np.int64))
    moved = alone._replaced(position=alone.position - ERROR)
    found, expected = track(alone, [stated]), track(moved, [exact])
    np.testing.assert_allclose(found.position, expected.position, atol=1e-8)
    late, before = smooth_tracks(alone, [stated], found), smooth_tracks(moved, [exact], expected)
    np.testing.assert_allclose(late.position, before.position, atol=1e-6)


def test_errors_are_found_while_tracking_and_the_rest_is_in_the_covariances():
    left, squares, counts = [], [], []
    for seed in range(8):
        traffic, plots, target = recording(seed)
        tracker = Tracker([RADAR, UNKNOWN])
        tables = []
        for k, start in enumerate(np.arange(0.0, 160.0, 4.0)):
            now = (plots.time >= start) & (plots.time < start + 4.0)
            tables.append(tracker.update(plots[now], time=start + 4.0))
            if seed == 0 and k == 20:
                tracker = pickle.loads(pickle.dumps(tracker))
        left.append(normalised(tracker.bias))
        assert tracker.bias.range[1] == tracker.bias.azimuth_sigma[1] == 0.0
        assert tracker.bias.east[0] == tracker.bias.north_sigma[0] == 0.0
        counts.append(len(np.unique(tables[-1].track)))
        for table in tables[25:]:
            own = target[table.plot]
            truth = np.hstack(traffic.at(np.maximum(own, 0), table.time))
            known = (table.plot >= 0) & (own >= 0) & np.isfinite(truth).all(axis=1)
            error = (np.hstack([table.position, table.velocity]) - truth)[known]
            squares.append(nees(error, table.covariance[known]) / 4.0)
    assert np.sqrt(np.mean(np.square(left))) < 1.5
    assert np.max(np.abs(left)) < 4.0
    # reports of one target within minutes count as one: what is left is less than its sigma
    assert 0.15 < np.mean(np.concatenate(squares)) < 1.1
    assert np.mean(counts) <= TARGETS + 1


def test_errors_are_found_in_a_recording():
    left = []
    for seed in range(20, 25):
        _, plots, _ = recording(seed)
        found = register(plots, [RADAR, UNKNOWN])
        left.append(normalised(found.bias))
        assert found.observable["east"].tolist() == [False, True]
        assert found.observable["north"].tolist() == [False, True]
        # ready to be that of the sensor
        assert found.sensors[1].bias.east == found.bias.east[1]
        assert found.sensors[0].bias.east == 0.0
    assert np.sqrt(np.mean(np.square(left))) < 1.6
    assert np.max(np.abs(left)) < 4.0


def test_exact_positions_stay_exact():
    _, plots, _ = recording(3, error=0.0)
    tracker = Tracker([RADAR, replace(UNKNOWN, bias=None)])
    tracker.update(plots)
    assert tracker.bias.east_sigma.tolist() == [0.0, 0.0]


def test_only_sensors_of_positions_have_them():
    numbers = {"range_sigma": 50.0, "azimuth_sigma": 0.001, "scan_period": 4.0}
    for bias in (Bias(east=1.0), Bias(north_sigma=1.0)):
        with pytest.raises(ValueError, match="only a PositionSensor has such errors"):
            Radar(**numbers, bias=bias)
        with pytest.raises(ValueError, match="only a PositionSensor has such errors"):
            Station([0.0, 0.0], azimuth_sigma=0.01, bias=bias)
    with pytest.raises(ValueError, match=r"^bias.range is 5; a PositionSensor has no range$"):
        PositionSensor(bias=Bias(range=5.0))
    assert repr(Bias(east=3.0, north_sigma=2.0)) == "Bias(east=3, north_sigma=2)"


def test_a_bias_is_subtracted_from_positions():
    plots = Plots([0.0, 1.0], position=[[10.0, 20.0], [30.0, 40.0]], sensor=[0, 1])
    found = Bias(east=[1.0, 2.0], north=[0.0, -4.0]).correct(plots)
    np.testing.assert_array_equal(found.position, [[9.0, 20.0], [28.0, 44.0]])
    one = Bias(east=1.0).correct(plots)
    np.testing.assert_array_equal(one.position, [[9.0, 20.0], [29.0, 40.0]])
