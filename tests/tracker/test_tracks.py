"""Tracks: confirmed, kept apart, continued and ended."""

import pickle

import numpy as np
import pytest
from tracker.flights import RADAR, line, noisy, polar, scene

from tertia import metrics
from tertia.tracker import Plots, Radar, Tracker, TrackTable, track


@pytest.mark.parametrize("motion", ["imm", "singer"])
def test_all_targets_are_tracked_and_nothing_else(motion):
    radar, traffic, seen = scene(11)
    found = track(seen.plots, [radar], motion=motion)
    used = found.plot >= 0
    target = np.where(used, seen.target[found.plot], -2)
    best = {}
    for number in np.unique(found.track):
        of = target[(found.track == number) & used]
        values, counts = np.unique(of, return_counts=True)
        assert counts.max() / counts.sum() > 0.9, f"track {number} changes its target"
        best.setdefault(values[counts.argmax()], []).append(number)
    scans = np.ptp(seen.plots.time) / radar.scan_period
    assert len(best.pop(-1, [])) < 0.02 * scans
    assert len(best) == len(traffic)
    assert sum(len(tracks) > 1 for tracks in best.values()) <= 2
    held = [np.sum(np.isin(target, f) & found.confirmed) / np.sum(seen.target == f) for f in best]
    assert np.mean(held) > 0.96


def test_two_radars_are_better_than_one():
    other = Radar(
        [60e3, 0.0],
        range_sigma=50.0,
        azimuth_sigma=np.radians(0.08),
        scan_period=5.3,
        max_range=200e3,
    )
    rms = {}
    for radars in ([RADAR], [RADAR, other]):
        errors, squares = [], []
        for seed in range(30):
            rng = np.random.default_rng([21, seed])
            columns = []
            for index, radar in enumerate(radars):
                time = 0.7 * index + radar.scan_period * np.arange(int(240 / radar.scan_period))
                position = np.array([10e3, 30e3]) + np.outer(time, [120.0, 80.0])
                distance, azimuth = noisy(position - radar.position, radar, rng)
                columns.append((time, distance, azimuth, np.full(len(time), index)))
            time, distance, azimuth, index = np.concatenate(columns, axis=1)
            plots = Plots(time, distance, azimuth, sensor=index.astype(int))
            found = track(plots, radars, registration=False)
            assert len(np.unique(found.track)) == 1
            error = found.position - np.outer(found.time, [120.0, 80.0]) - [10e3, 30e3]
            settled = found.time > 60
            errors.append(error[settled])
            squares.append(metrics.nees(errors[-1], found.covariance[settled][:, :2, :2]))
        rms[len(radars)] = np.sqrt(np.mean(np.concatenate(errors) ** 2))
        assert np.mean(np.concatenate(squares)) / 2 < 1.1
    assert rms[2] < 0.8 * rms[1]


@pytest.mark.parametrize("live", [False, True])
def test_plots_of_misaligned_radars_by_turns_hide_no_target(live):
    """Before, tracks went from the plots of one radar to those of the other: most had none."""
    rng, scans, count = np.random.default_rng(71), 40, 12
    radars = [
        Radar(range_sigma=60.0, azimuth_sigma=0.0012, scan_period=8.0, name=name)
        for name in ("even", "odd")
    ]
    time = np.tile(4.0 * np.arange(scans), (count, 1)) + rng.uniform(0.0, 4.0, (count, 1))
    course = rng.uniform(0.0, 2 * np.pi, (count, 1))
    start = np.linspace(20e3, 110e3, count)[:, np.newaxis]
    azimuth = rng.uniform(0.0, 2 * np.pi, (count, 1))
    east = start * np.sin(azimuth) + 180.0 * time * np.sin(course)
    north = start * np.cos(azimuth) + 180.0 * time * np.cos(course)
    sensor = np.tile(np.arange(scans) % 2, (count, 1))
    distance = np.hypot(east, north) + 60.0 * rng.standard_normal(time.shape) + 500.0 * sensor
    noise = 0.0012 * rng.standard_normal(time.shape) + np.radians(1.0) * sensor
    plots = Plots(
        time.ravel(),
        distance.ravel(),
        (np.arctan2(east, north) + noise).ravel(),
        sensor=sensor.ravel(),
    )
    aircraft = np.repeat(np.arange(count), scans)
    if live:
        order = np.argsort(plots.time, kind="stable")
        plots, aircraft = plots[order], aircraft[order]
        tracker = Tracker(radars, registration=False)
        ends = 4.0 * np.arange(1.0, scans + 2.0)
        parts = np.split(np.arange(len(plots)), np.searchsorted(plots.time, ends[:-1]))
        rows = [tracker.update(plots[own], time=end) for own, end in zip(parts, ends, strict=True)]
        table = TrackTable.join(rows)
    else:
        table = track(plots, radars, registration=False)
    seen = table.plot[table.confirmed & (table.plot >= 0)]
    shares = [np.mean(np.isin(np.flatnonzero(aircraft == own), seen)) for own in range(count)]
    assert np.min(shares) > 0.5
    assert np.mean(shares) > 0.7


def test_a_target_may_be_seen_by_many_radars():
    rng = np.random.default_rng(5)
    places = rng.uniform(-20e3, 20e3, (7, 2))
    radars = [
        Radar(place, range_sigma=50.0, azimuth_sigma=0.0014, scan_period=4.0) for place in places
    ]
    time = np.arange(0.0, 60.0, 0.5)
    radar = np.arange(len(time)) % 8
    time, radar = time[radar < 7], radar[radar < 7]
    position = np.array([10e3, 30e3]) + np.outer(time, [120.0, -80.0])
    plots = Plots(time, *noisy(position - places[radar], radars[0], rng), sensor=radar)
    tracker = Tracker(radars, registration=False)
    # each plot of the first stretch begins a track, one of which goes on
    before = tracker.update(plots[:50])
    copied = pickle.loads(pickle.dumps(tracker))
    table = tracker.update(plots[50:])
    assert set(before.track_of_plot[10:]) == set(table.track_of_plot)
    assert len(set(table.track_of_plot)) == 1
    assert set(table.sensor) == set(range(7))
    assert np.all(np.hypot(*(table.position - position[table.plot]).T) < 200.0)
    np.testing.assert_array_equal(copied.update(plots[50:]).covariance, table.covariance)


def test_scans_without_plots_end_tracks():
    tracker = Tracker([RADAR], coasting=3)
    plots = line(10)
    tracker.update(plots)
    alive = [len(tracker.update(plots[:0], time=36.0 + 4.0 * k).track) for k in range(1, 8)]
    # a scan is missed a quarter of it late
    assert alive == [0, 1, 1, 1, 1, 0, 0]
    assert len(tracker.extrapolate(0.0)[0]) == 0
    assert len(Tracker([RADAR]).update(plots[:0])) == 0


def test_a_missed_scan_is_a_row_without_plot():
    plots = line(20)
    found = track(plots[np.arange(20) != 12], [RADAR])
    assert len(np.unique(found.track)) == 1
    assert np.sum(found.plot < 0) == 1
    missed = np.flatnonzero(found.plot < 0)[0]
    trace = np.trace(found.covariance, axis1=1, axis2=2)
    assert trace[missed] > trace[missed - 1]


def test_targets_that_a_beam_passes_at_once_are_no_clutter():
    # four plots in a fortieth of a scan, three in the next
    radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0, max_range=80e3)
    time = 4.0 * np.arange(3)
    at = np.array([[-15e3, 60e3], [-5e3, 60e3], [5e3, 60e3], [15e3, 60e3]])
    position = at[:, np.newaxis] + np.multiply.outer(time, [0.0, 230.0])
    rows = np.ones((4, 3), dtype=bool)
    rows[3, 1] = False
    when = np.broadcast_to(time + 0.025 * np.arange(4)[:, np.newaxis], (4, 3))[rows]
    confirmed = 0
    for seed in range(20):
        distance, azimuth = noisy(position[rows], radar, np.random.default_rng(seed))
        plots = Plots(when, distance, azimuth)
        tracker = Tracker([radar])
        tables = [tracker.update(plots[(when > t - 1) & (when < t + 1)]) for t in time]
        confirmed += np.unique(tables[-1].track[tables[-1].confirmed]).size
    # of three in each run; were they taken for clutter, a third would not be
    assert confirmed >= 58


def test_crossing_targets_keep_their_tracks():
    swapped = 0
    for seed in range(20):
        rng = np.random.default_rng([51, seed])
        time = 4.0 * np.arange(50)
        first = np.array([-15e3, 40e3]) + np.outer(time, [150.0, 10.0])
        second = np.array([-15e3, 42e3]) + np.outer(time, [150.0, -10.0])
        columns = [noisy(first, RADAR, rng), noisy(second, RADAR, rng)]
        distance, azimuth = np.concatenate(columns, axis=1)
        found = track(Plots(np.tile(time, 2), distance, azimuth), [RADAR])
        target = found.plot >= 50
        for number in np.unique(found.track):
            of = target[(found.track == number) & (found.plot >= 0)]
            swapped += of[0] != of[-1]
    assert swapped <= 1


def test_identities_keep_targets_apart():
    time = 4.0 * np.arange(50)
    rng = np.random.default_rng(61)
    first = np.array([-15e3, 40e3]) + np.outer(time, [150.0, 2.0])
    second = np.array([-15e3, 40.4e3]) + np.outer(time, [150.0, -2.0])
    columns = [noisy(first, RADAR, rng), noisy(second, RADAR, rng)]
    distance, azimuth = np.concatenate(columns, axis=1)
    identity = np.repeat([0o1234, 0o4321], 50)
    found = track(Plots(np.tile(time, 2), distance, azimuth, identity=identity), [RADAR])
    for number in np.unique(found.track):
        of = identity[found.plot[(found.track == number) & (found.plot >= 0)]]
        assert len(np.unique(of)) == 1
    assert set(found.identity[found.confirmed]) == {0o1234, 0o4321}


def test_heights_keep_targets_apart_and_are_filtered():
    time = 4.0 * np.arange(60)
    rng = np.random.default_rng(62)
    position = np.array([-15e3, 40e3]) + np.outer(time, [150.0, 0.0])
    height = np.stack([np.full(60, 8000.0), 9000.0 + 10.0 * time])
    ground = np.hypot(*position.T)
    slant = np.sqrt(ground**2 + height**2) + 50 * rng.standard_normal((2, 60))
    azimuth = polar(position)[1] + RADAR.azimuth_sigma * rng.standard_normal((2, 60))
    rounded = np.round(height / 30.48) * 30.48
    plots = Plots(np.tile(time, 2), slant.ravel(), azimuth.ravel(), height=rounded.ravel())
    found = track(plots, [RADAR])
    assert len(np.unique(found.track)) == 2
    climbing = (found.plot >= 60) & (found.time > 100)
    assert np.abs(found.vertical_rate[climbing] - 10.0).max() < 3.0
    for number in np.unique(found.track):
        of = found.plot[(found.track == number) & (found.plot >= 0)] >= 60
        assert np.all(of == of[0])


CLOSE = Radar(range_sigma=15.0, azimuth_sigma=5e-4, scan_period=4.0, max_range=113e3)


def beamed(places, scans, identity, rng):
    """Plots of targets at the times at which the beam points at them."""
    distance, azimuth = np.hypot(*places.T), np.arctan2(*places.T) % (2 * np.pi)
    time = 4.0 * (scans + azimuth / (2 * np.pi))
    n = len(places)
    distance, azimuth = (
        distance + 10 * rng.standard_normal(n),
        azimuth + 5e-4 * rng.standard_normal(n),
    )
    return Plots(time, distance, azimuth, identity=identity)


@pytest.mark.parametrize("coasting", [5, 30])
def test_a_track_without_plots_takes_none_from_others(coasting):
    angle = 2 * np.pi * (np.arange(8) + 0.5) / 8
    parked = 1200 * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    vanishing = np.stack([np.full(20, 500.0), -400.0 + 40 * np.arange(20)], axis=-1)
    places = np.concatenate([np.tile(parked, (60, 1)), vanishing])
    scans = np.concatenate([np.repeat(np.arange(60), 8), np.arange(20)])
    identity = np.concatenate([np.tile(np.arange(8), 60), np.full(20, 90)])
    plots = beamed(places, scans, identity, np.random.default_rng(1))
    found = track(plots, [CLOSE], coasting=coasting, identity_error_probability=1e-9)
    assert len(np.unique(found.track)) == 9
    assert np.all(found.track_of_plot > 0)
    for target in np.unique(identity):
        assert len(np.unique(found.track_of_plot[identity == target])) == 1


@pytest.mark.parametrize("aside", [300.0, -300.0])
@pytest.mark.parametrize("silent", [0.0, 1500.0, 8000.0])
def test_a_target_that_passes_the_radar_keeps_its_track(aside, silent):
    places, scans = [], []
    for scan in range(80):
        time = 4.0 * scan
        for _ in range(30):
            place = np.array([aside, 220 * (time - 160)])
            time = 4.0 * (scan + (np.arctan2(*place) % (2 * np.pi)) / (2 * np.pi))
        if np.hypot(*place) > silent:
            places.append(place)
            scans.append(scan)
    plots = beamed(np.array(places), np.array(scans), 5, np.random.default_rng(2))
    found = track(plots, [CLOSE], coasting=30)
    assert np.all(found.track_of_plot == 1)


@pytest.mark.parametrize("lag", [0.0, 5.0])
def test_few_targets_of_a_recording_are_tracked_through_missed_scans(lag):
    """Before, plots that wait for the next part of a recording were counted as missed."""
    scan = np.arange(200)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        parts = []
        for azimuth in np.radians(rng.uniform(10.0, 350.0, 2)):
            seen = scan[rng.random(200) < 0.9]
            noise = rng.standard_normal((2, len(seen))) * [[30.0], [1e-3]]
            time = 2.5 * (seen + azimuth / (2 * np.pi))
            parts.append(np.c_[time, 1e4 + 150.0 * time + noise[0], azimuth + noise[1]])
        time, distance, azimuth = np.concatenate(parts).T
        order = np.argsort(time)
        plots = Plots(time=time[order], range=distance[order], azimuth=azimuth[order])
        radar = Radar(range_sigma=30.0, azimuth_sigma=1e-3, scan_period=2.5)
        found = track(plots, [radar], lag=lag)
        own = np.unique(found.track[found.confirmed])
        assert len(own) == 2
        assert np.mean(np.isin(found.track_of_plot, own)) > 0.98
