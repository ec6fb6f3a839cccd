"""Targets that are larger than the resolution of a sensor and give several plots in a scan."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from checks import in_region

from tertia.sensors import Bias, PositionSensor, Radar
from tertia.tracker import Plots, Tracker, TrackTable, smooth_tracks, track

PERIOD, DURATION = 2.5, 400.0
POINT = Radar(
    range_sigma=7.0,
    azimuth_sigma=0.2,
    scan_period=PERIOD,
    max_range=16e3,
    detection_probability=0.95,
    bias=Bias(),
    degrees=True,
)
RADAR = replace(POINT, target_extent=300.0)
# length in metres of ships, their places at the start, and their velocities
SHIPS = (
    (280.0, (-2000.0, 3000.0), (6.0, 0.0)),
    (120.0, (1500.0, 3300.0), (-7.0, 0.0)),
    (60.0, (4000.0, -2500.0), (0.0, 5.0)),
    (300.0, (-5000.0, -3000.0), (2.0, 3.0)),
    (180.0, (0.0, 9000.0), (4.0, -4.0)),
)


def centres(ship, time):
    """Positions of the centres of ships, (N, 2)."""
    start = np.array([SHIPS[k][1] for k in ship])
    return start + np.array([SHIPS[k][2] for k in ship]) * time[:, np.newaxis]


def plots_of(seed, *, clutter=5, single=False):
    """Plots of random parts of ships, and their ships; -1 for false plots."""
    random = np.random.default_rng([71, seed])
    ship, scan = [], []
    for k, (length, _, _) in enumerate(SHIPS):
        for n in range(int(DURATION / PERIOD)):
            if random.uniform() < RADAR.detection_probability:
                count = 1 if single else min(1 + random.poisson(length / 60.0), 8)
                ship += [k] * count
                scan += [n] * count
    ship, scan = np.array(ship), np.array(scan)
    length = np.array([one[0] for one in SHIPS])[ship]
    along = np.array([np.array(SHIPS[k][2]) / np.hypot(*SHIPS[k][2]) for k in ship])
    across = along[:, ::-1] * [1.0, -1.0]
    part = random.uniform(-0.5, 0.5, (len(ship), 2)) * length[:, np.newaxis] * [1.0, 0.15]
    part = part[:, :1] * along + part[:, 1:] * across
    place = centres(ship, scan * PERIOD) + part
    beam = np.arctan2(*place.T) % (2 * np.pi) / (2 * np.pi) * PERIOD
    place = centres(ship, scan * PERIOD + beam) + part
    count = random.poisson(clutter, int(DURATION / PERIOD)).sum()
    radius, angle = 15e3 * np.sqrt(random.uniform(size=count)), random.uniform(0, 2 * np.pi, count)
    time = np.append(
        scan * PERIOD + beam,
        random.integers(0, int(DURATION / PERIOD), count) * PERIOD + angle / (2 * np.pi) * PERIOD,
    )
    distance = np.append(
        np.hypot(*place.T) + RADAR.range_sigma * random.normal(size=len(ship)), radius
    )
    azimuth = np.append(
        np.arctan2(*place.T) + RADAR.azimuth_sigma * random.normal(size=len(ship)), angle
    )
    owner = np.append(ship, np.full(count, -1))
    order = np.argsort(time)
    return Plots(time[order], distance[order], azimuth[order]), owner[order]


def owners(table, owner):
    """The ship of most plots of each track."""
    numbers = np.unique(table.track)
    of = [owner[table.plot[(table.track == n) & (table.plot >= 0)]] for n in numbers]
    return {
        n: int(np.bincount(one + 1).argmax() - 1)
        for n, one in zip(numbers.tolist(), of, strict=True)
    }


def judged(table, owner):
    """Ships of the tracks, the rms error in metres, and the share of rows within 95 %."""
    of = owners(table, owner)
    table = table[np.array([of[n] >= 0 for n in table.track.tolist()])]
    ship = np.array([of[n] for n in table.track.tolist()])
    error = table.position - centres(ship, table.time)
    inside = in_region(error, table.covariance[:, :2, :2])
    return sorted(of.values()), np.sqrt(np.mean(np.sum(error**2, axis=1))), np.mean(inside)


def live(plots, sensor, every=PERIOD):
    """Tracks of plots that come scan by scan."""
    tracker, tables = Tracker([sensor], profile="vessel"), []
    for begin in np.arange(0.0, DURATION, every):
        now = (plots.time >= begin) & (plots.time < begin + every)
        tables.append(tracker.update(plots[now], time=begin + every))
    return TrackTable.join(tables)


@pytest.mark.parametrize("recorded", [True, False])
def test_a_ship_has_one_track_with_a_region_that_contains_its_centre(recorded):
    for seed in range(3):
        plots, owner = plots_of(seed)
        table = track(plots, [RADAR], profile="vessel") if recorded else live(plots, RADAR)
        ships, rms, inside = judged(table, owner)
        assert ships == [0, 1, 2, 3, 4]
        assert rms < 40.0
        assert inside > 0.95
        # as points, ships have several tracks
        with pytest.warns(UserWarning, match="target_extent"):
            as_points = track(plots, [POINT], profile="vessel")
        assert len(owners(as_points, owner)) > 8


def test_ships_that_pass_each_other_keep_their_plots():
    # the first two pass each other 300 m apart
    plots, owner = plots_of(5)
    table = track(plots, [RADAR], profile="vessel")
    of = owners(table, owner)
    number = {ship: n for n, ship in of.items()}
    taken = table.track_of_plot
    for ship in (0, 1):
        own = taken[owner == ship]
        assert np.mean(own == number[ship]) > 0.97
        assert not np.any(own == number[1 - ship])


def test_combined_plots_have_the_track_of_their_target_and_one_row():
    plots, owner = plots_of(6)
    table = track(plots, [RADAR], profile="vessel")
    scan = np.floor(table.time / PERIOD + 0.5)
    with_plot = table[table.plot >= 0]
    pairs = set(zip(table.track.tolist(), scan.tolist(), strict=True))
    assert len(pairs) > 0.98 * len(table)
    assert len(with_plot) < 0.5 * np.count_nonzero(table.track_of_plot > 0)
    assert np.mean(table.track_of_plot[owner >= 0] > 0) > 0.97
    np.testing.assert_array_equal(table.track_of_plot[with_plot.plot], with_plot.track)


def test_single_plots_of_random_parts_make_the_region_larger():
    plots, owner = plots_of(7, single=True)
    ships, rms, inside = judged(track(plots, [RADAR], profile="vessel"), owner)
    assert ships == [0, 1, 2, 3, 4]
    assert rms < 60.0
    assert inside > 0.95


def test_small_boats_get_small_regions():
    random = np.random.default_rng(72)
    time = PERIOD * np.arange(200.0) + 0.5
    place = np.array([1000.0, 2000.0]) + np.outer(time, [4.0, 1.0])
    distance = np.hypot(*place.T) + POINT.range_sigma * random.normal(size=200)
    azimuth = np.arctan2(*place.T) + POINT.azimuth_sigma * random.normal(size=200)
    plots = Plots(time, distance, azimuth)
    table = track(plots, [RADAR], profile="vessel")
    assert len(np.unique(table.track)) == 1
    sigma = np.sqrt(np.trace(table.covariance[:, :2, :2], axis1=1, axis2=2))
    assert sigma[3] > 60.0
    assert np.all(sigma[150:] < 25.0)


def test_plots_of_vehicles_near_a_lidar_are_combined():
    random, interval = np.random.default_rng(73), 0.1
    car, frame = np.divmod(np.arange(6 * 150), 150)
    count = random.integers(1, 7, len(car))
    car, frame = np.repeat(car, count), np.repeat(frame, count)
    order = np.argsort(frame, kind="stable")
    car, time = car[order], frame[order] * interval
    # in two lanes, one of which is faster
    start, speed = -60.0 + 12.0 * np.arange(6), 10.0 + 2.0 * (np.arange(6) % 2)
    centre = np.column_stack([start[car] + speed[car] * time, 3.5 * (car % 2)])
    part = random.uniform(-0.5, 0.5, (len(car), 2)) * [4.5, 1.8]
    covariance = np.broadcast_to(0.04 * np.eye(2), (len(car), 2, 2))
    plots = Plots(
        time,
        position=centre + part + 0.2 * random.normal(size=(len(car), 2)),
        covariance=covariance,
    )
    lidar = PositionSensor(update_interval=interval, target_extent=5.0, bias=Bias())
    table = track(plots, [lidar], profile="road")
    of = owners(table, car)
    assert sorted(of.values()) == [0, 1, 2, 3, 4, 5]
    late = table[table.time > 2.0]
    own = np.array([of[n] for n in late.track.tolist()])
    true = np.column_stack([start[own] + speed[own] * late.time, 3.5 * (own % 2)])
    assert np.sqrt(np.mean(np.sum((late.position - true) ** 2, axis=1))) < 0.8


def test_late_plots_and_saved_trackers_change_nothing():
    plots, _ = plots_of(8)
    plots = plots[plots.time < 200.0]
    late = plots.time + np.random.default_rng(74).uniform(0.0, 4.0, len(plots))
    expected = track(plots, [RADAR], profile="vessel", lag=5.0)
    tracker = Tracker([RADAR], profile="vessel", lag=5.0)
    tables = []
    for begin in np.arange(0.0, 205.0, 1.0):
        now = np.flatnonzero((late >= begin) & (late < begin + 1.0))
        tables.append(tracker.update(plots[now]))
        if begin == 100.0:
            tracker = pickle.loads(pickle.dumps(tracker))
    tables.append(tracker.finish())
    found = TrackTable.join(tables)
    found = found[found.final & found.confirmed]
    expected = expected[expected.confirmed]
    assert len(found) == len(expected)
    for name in ("time", "track", "position", "covariance"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    # plots that were combined in a call have the track of the others
    whole = track(plots, [RADAR], profile="vessel", lag=5.0).track_of_plot
    assert np.count_nonzero(whole > 0) > 2 * np.count_nonzero(expected.plot >= 0)


@pytest.mark.parametrize("recorded", [True, False])
def test_extents_that_are_not_stated_are_said(recorded):
    plots, _ = plots_of(11)
    with pytest.warns(UserWarning, match=r"sensors\[0\]: many targets .* as target_extent"):
        track(plots, [POINT], profile="vessel") if recorded else live(plots, POINT)


def test_sensors_without_plots_have_no_extent():
    """Nor have the targets of a recording without any plots."""
    time = np.arange(0.0, 100.0, PERIOD)
    plots = Plots(time, 5e3 + 8.0 * time, np.full(len(time), 0.5))
    sensors = [POINT, PositionSensor(position_sigma=5.0, bias=Bias())]
    assert len(np.unique(track(plots, sensors, profile="vessel").track)) == 1
    assert len(track(Plots([], [], []), sensors)) == 0


def test_targets_that_fly_together_have_no_extent():
    """Each ship has a companion 60 m away, and a fifth of its plots come twice."""
    plots, owner = plots_of(11, single=True)
    random = np.random.default_rng(12)
    ship = np.flatnonzero(owner >= 0)
    other = ship[random.uniform(size=len(ship)) < 0.95]
    double = ship[random.uniform(size=len(ship)) < 0.2]
    own = np.concatenate([np.arange(len(plots)), other, double])
    away = np.concatenate(
        [np.zeros(len(plots)), np.full(len(other), 60.0), np.full(len(double), 3)]
    )
    order = np.argsort(plots.time[own], kind="stable")
    several = Plots(plots.time[own], plots.range[own] + away, plots.azimuth[own])[order]
    assert len(np.unique(track(several, [POINT], profile="vessel").track)) >= len(SHIPS)


@pytest.mark.parametrize("value", [-1.0, 2e5, np.nan, np.inf])
def test_extents_out_of_domain(value):
    with pytest.raises(ValueError, match=r"target_extent is .*; it must be 0 or positive"):
        replace(POINT, target_extent=value)
    with pytest.raises(ValueError, match=r"target_extent is .*; it must be 0 or positive"):
        PositionSensor(position_sigma=1.0, target_extent=value)


def test_smoothing_combines_no_plots():
    plots, _ = plots_of(9)
    with pytest.raises(ValueError, match=r"sensors\[0\].target_extent is 300; it must be 0"):
        smooth_tracks(plots, [RADAR])
