"""Reports of positions that are late by a constant which differs from target to target."""

import pickle

import numpy as np
import pytest
from checks import WITHIN_95
from tracker.flights import followed, with_reports

from tertia import simulate
from tertia.metrics import nees
from tertia.sensors import Bias, PositionSensor, Radar
from tertia.tracker import Tracker, track

RADARS = [
    Radar([-5e4, 0.0], range_sigma=50.0, azimuth_sigma=0.0014, scan_period=4.0),
    Radar([4e4, 3e4], range_sigma=60.0, azimuth_sigma=0.0017, scan_period=6.0),
]
ADSB = PositionSensor(position_sigma=25.0)
TARGETS, END = 15, 240.0


def recording(seed, delay, radars=2, turning=0.3):
    """Plots of radars and of ADS-B, their targets, the flights and the delays."""
    random = np.random.default_rng([181, seed])
    traffic = simulate.dense_traffic(
        TARGETS, area=(1e5, 1e5), turning_share=turning, duration=END, rng=random
    )
    record = simulate.radar_plots(traffic, RADARS[:radars], rng=random)
    time = random.uniform(0.0, 1.0, (TARGETS, 1)) + np.arange(END - 1.0)
    target = np.repeat(np.arange(TARGETS), time.shape[1])
    late = random.normal(0.0, delay, TARGETS)
    place = traffic.at(target, time.ravel())[0] + random.normal(0.0, 25.0, (len(target), 2))
    stamp = time.ravel() + late[target]
    there = np.isfinite(place).all(axis=1) & (stamp >= 0.0) & (stamp < END)
    reports = stamp[there], target[there], place[there]
    return *with_reports(record, *reports, sensor=radars), traffic, late


def compared(tables, target, traffic, after=100.0):
    """Errors, their normalised squares, and tracks per target."""
    errors, squares, pairs = [], [], set()
    for table in tables:
        own = target[table.plot]
        known = (table.time > after) & (table.plot >= 0) & (own >= 0)
        pairs |= set(zip(table.track[known].tolist(), own[known].tolist(), strict=True))
        error = table.position[known] - traffic.at(own[known], table.time[known])[0]
        there = np.isfinite(error).all(axis=1)
        errors.append(error[there])
        squares.append(nees(error[there], table.covariance[known][there, :2, :2]))
    tracks, targets = ({pair[i] for pair in pairs} for i in (0, 1))
    return np.concatenate(errors), np.concatenate(squares), len(tracks) / len(targets)


@pytest.mark.parametrize("live", [True, False], ids=["live", "recording"])
@pytest.mark.parametrize(("delay", "radars"), [(0.3, 2), (0.6, 2), (0.5, 1)])
def test_delays_that_differ(delay, radars, live):
    found = []
    for seed in range(4):
        plots, target, traffic, _ = recording(seed, delay, radars)
        sensors = [*RADARS[:radars], ADSB]
        tables = followed(Tracker(sensors), plots) if live else [track(plots, sensors)]
        found.append(compared(tables, target, traffic))
    error, square = (np.concatenate([one[i] for one in found]) for i in (0, 1))
    assert np.mean(square < WITHIN_95[2]) > 0.93
    assert 0.4 < np.mean(square) / 2.0 < 1.3
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 40.0
    assert np.mean([one[2] for one in found]) < 1.05


def test_no_differences_are_found_where_there_are_none():
    for seed in range(4):
        plots, *_ = recording(10 + seed, 0.0)
        tracker = Tracker([*RADARS, ADSB])
        followed(tracker, plots)
        assert tracker._core.delay_sigmas().tolist() == [0.0, 0.0, 0.0]


def test_the_spread_of_the_delays():
    for seed, delay in enumerate((0.3, 0.5, 1.0)):
        plots, _, _, late = recording(20 + seed, delay)
        tracker = Tracker([*RADARS, ADSB])
        followed(tracker, plots)
        *none, sigma = tracker._core.delay_sigmas()
        assert none == [0.0, 0.0]
        assert 0.6 < sigma / np.std(late) < 1.5


def test_reports_that_are_stated_to_be_on_time_have_no_delays():
    plots, *_ = recording(30, 0.5)
    tracker = Tracker([*RADARS, PositionSensor(position_sigma=25.0, bias=Bias())])
    followed(tracker, plots)
    assert tracker._core.delay_sigmas().tolist() == [0.0, 0.0, 0.0]


def test_a_saved_tracker_goes_on_and_threads_change_nothing():
    plots, *_ = recording(31, 0.5)
    tracker = Tracker([*RADARS, ADSB], n_threads=1)
    followed(tracker, plots, end=120.0)
    assert tracker._core.delay_sigmas()[2] > 0.0
    again = pickle.loads(pickle.dumps(tracker))
    again.n_threads = 2
    tables = [followed(one, plots, begin=120.0)[-1] for one in (tracker, again)]
    assert np.array_equal(tables[0].position, tables[1].position)
    assert np.array_equal(tables[0].covariance, tables[1].covariance)
