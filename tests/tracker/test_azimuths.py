"""Stations that measure azimuths without ranges: what they add to tracks of other sensors."""

import pickle

import numpy as np
import pytest
from checks import assert_refused, in_region
from tracker.flights import predicted

from tertia.geo import LocalFrame, SystemPlane
from tertia.metrics import nees
from tertia.sensors import Bias, PositionSensor, Radar, Station
from tertia.tracker import CvModel, Plots, PlotStatus, Tracker, WindowModel, track

SIGMA, PACE = 0.3, 4.0
GPS = PositionSensor(position_sigma=30.0, update_interval=2.0)
CAMERA = Station([2e3, -1e3], azimuth_sigma=0.001)


def seen_from(place, position):
    east, north = np.moveaxis(np.asarray(position) - place, -1, 0)
    return np.arctan2(east, north)


def scene(seed, targets=4, frame=1.0, station=CAMERA, duration=120.0, place=None):
    """Return straight flights, their positions every two seconds, and azimuths of a camera."""
    random = np.random.default_rng([61, seed])
    start = random.uniform(-2e4, 2e4, (targets, 2))
    course = random.uniform(0.0, 2.0 * np.pi, targets)
    velocity = 150.0 * np.column_stack([np.sin(course), np.cos(course)])

    def truth(target, time):
        return start[target] + time[:, np.newaxis] * velocity[target]

    time = np.repeat(np.arange(0.3, duration, 2.0), targets)
    target = np.tile(np.arange(targets), len(time) // targets)
    reports = truth(target, time) + random.normal(0.0, 30.0, (len(time), 2))
    when = np.repeat(np.arange(0.6, duration, frame), targets)
    which = np.tile(np.arange(targets), len(when) // targets)
    places = np.tile(station.position[:2], (len(when), 1)) if place is None else place(when)
    azimuth = seen_from(places, truth(which, when))
    azimuth += random.normal(0.0, station.azimuth_sigma, len(when))
    nothing = np.full(len(time), np.nan)
    plots = Plots(
        np.append(time, when),
        azimuth=np.append(nothing, azimuth),
        sensor=np.repeat([0, 1], [len(time), len(when)]),
        position=np.vstack([reports, np.full((len(when), 2), np.nan)]),
        sensor_position=None
        if place is None
        else np.vstack([np.full((len(time), 2), np.nan), places]),
    )
    return plots, np.append(target, which), truth


def in_order(plots, tracker):
    """Return the rows of plots that come one after the other in time."""
    times = np.unique(plots.time)
    return [tracker.update(plots[plots.time == time]) for time in times]


def test_azimuths_update_a_track_as_an_extended_kalman_filter():
    plots, _, _ = scene(0, targets=1)
    rows = in_order(plots, Tracker([GPS, CAMERA], motion=CvModel(SIGMA)))
    rows = [(row, at) for row, at in zip(rows, np.unique(plots.time), strict=True) if len(row)]
    first, last = rows[0]
    mean = np.append(first.position[0], first.velocity[0])
    covariance = first.covariance[0]
    compared = 0
    for row, time in rows[1:]:
        t, last = time - last, time
        mean, covariance = predicted(mean, covariance, t, SIGMA**2 * PACE)
        now = plots[plots.time == time]
        if now.sensor[0] == 1:
            d = mean[:2] - CAMERA.position
            h = np.array([[d[1], -d[0], 0.0, 0.0]]) / (d @ d)
            y = np.angle(np.exp(1j * (now.azimuth - np.arctan2(*d))))
            noise = np.array([[CAMERA.azimuth_sigma**2]])
            assert np.isnan(row.innovation).all()
        else:
            h, y, noise = np.eye(2, 4), now.position[0] - mean[:2], 30.0**2 * np.eye(2)
        gain = covariance @ h.T @ np.linalg.inv(h @ covariance @ h.T + noise)
        mean, covariance = mean + gain @ y, covariance - gain @ h @ covariance
        sigma = np.sqrt(np.diag(covariance))
        found = np.append(row.position[-1], row.velocity[-1])
        np.testing.assert_allclose((found - mean) / sigma, 0.0, atol=1e-9)
        scaled = (row.covariance[-1] - covariance) / np.outer(sigma, sigma)
        np.testing.assert_allclose(scaled, 0.0, atol=1e-9)
        compared += now.sensor[0] == 1
    assert compared > 100


@pytest.mark.parametrize("motion", ["imm", "singer", CvModel(0.05)])
@pytest.mark.parametrize("frame", [1.0, 0.2])
def test_a_camera_makes_tracks_better_and_their_covariances_hold(motion, frame):
    errors, squares = {True: [], False: []}, []
    for seed in range(4):
        plots, target, truth = scene(seed, frame=frame)
        for camera in (True, False):
            kept = plots if camera else plots[plots.sensor == 0]
            table = track(kept, [GPS, CAMERA], motion=motion)
            assert len(np.unique(table.track)) == 4
            table = table[(table.plot >= 0) & (table.time > 40.0)]
            own = target[table.plot]
            error = table.position - truth(own, table.time)
            errors[camera].append(error)
            if camera:
                squares.append(nees(error, table.covariance[:, :2, :2]))
    with_camera, without = (np.sqrt(np.mean(np.concatenate(errors[k]) ** 2)) for k in (True, False))
    assert with_camera < 0.9 * without
    # flights are straighter than the models assume
    assert np.mean(np.concatenate(squares)) < 2.2


def test_azimuths_begin_no_tracks_and_keep_none_alive():
    plots, _, _ = scene(1)
    alone = plots[plots.sensor == 1]
    table = Tracker([GPS, CAMERA]).update(alone)
    assert len(table) == 0
    assert np.all(table.track_of_plot == PlotStatus.UNASSOCIATED)
    assert "azimuth" in PlotStatus.UNASSOCIATED.message
    some = plots[(plots.sensor == 1) | (plots.time < 40.0)]
    table = track(some, [GPS, CAMERA])
    assert np.max(table.time) < 40.0 + 6.0 * GPS.update_interval


def test_a_track_takes_one_azimuth_of_a_frame_and_no_false_ones():
    plots, _, truth = scene(2, targets=1)
    time = np.arange(0.6, 120.0, 1.0)
    wrong = seen_from(CAMERA.position, truth(np.zeros(len(time), int), time)) + 0.0045
    both = Plots(
        np.append(plots.time, time),
        azimuth=np.append(plots.azimuth, wrong),
        sensor=np.append(plots.sensor, np.ones(len(time), int)),
        position=np.vstack([plots.position, np.full((len(time), 2), np.nan)]),
    )
    status = track(both, [GPS, CAMERA]).track_of_plot
    own, other = status[: len(plots)][plots.sensor == 1], status[len(plots) :]
    late = time > 30.0
    assert np.mean(own[late] > 0) > 0.97
    assert np.mean(other[late] > 0) < 0.03


def test_tracks_in_nearly_the_same_direction_take_none():
    time = np.arange(0.0, 60.0, 2.0)
    near, far = (np.column_stack([0.0 * time, 1e4 * k + 0.0 * time]) for k in (1, 2))
    reports = np.vstack([near, far]) + np.random.default_rng(3).normal(0.0, 30.0, (60, 2))
    station = Station([0.0, 0.0], azimuth_sigma=0.002)
    azimuth = seen_from(station.position, near)
    plots = Plots(
        np.concatenate([time, time, time + 0.5]),
        azimuth=np.append(np.full(60, np.nan), azimuth),
        sensor=np.repeat([0, 1], [60, 30]),
        position=np.vstack([reports, np.full((30, 2), np.nan)]),
    )
    status = track(plots, [GPS, station]).track_of_plot
    assert np.all(status[:60] > 0)
    assert np.all(status[60:] == PlotStatus.UNASSOCIATED)


def test_a_station_may_move():
    def place(time):
        return np.column_stack([30.0 * time, -1e3 - 20.0 * time])

    plots, target, truth = scene(4, place=place)
    table = track(plots, [GPS, CAMERA], motion=CvModel(SIGMA))
    used = table.track_of_plot[plots.sensor == 1]
    assert np.mean(used > 0) > 0.75
    table = table[(table.plot >= 0) & (table.time > 40.0)]
    error = table.position - truth(target[table.plot], table.time)
    assert np.mean(nees(error, table.covariance[:, :2, :2])) < 2.2
    # without its places it is elsewhere
    stays = track(
        Plots(plots.time, azimuth=plots.azimuth, sensor=plots.sensor, position=plots.position),
        [GPS, CAMERA],
        motion=CvModel(SIGMA),
    )
    assert np.mean(stays.track_of_plot[plots.sensor == 1] > 0) < 0.5
    columns = plots.to_polars().columns
    assert {"sensor_east_m", "sensor_north_m", "azimuth"} <= set(columns)


def test_azimuths_relative_to_the_bow_of_a_ship():
    def place(time):
        return np.column_stack([12.0 * time, -1e3 + 0.0 * time])

    plots, _, _ = scene(5, place=place)
    straight = track(plots, [GPS, CAMERA])
    heading = np.where(plots.sensor == 1, 1.2 + 0.3 * np.sin(plots.time / 9.0), np.nan)
    columns = {
        name: getattr(plots, name) for name in ("sensor", "position", "sensor_position", "time")
    }
    azimuth = plots.azimuth - np.nan_to_num(heading)
    turned = Plots(**columns, azimuth=azimuth, sensor_heading=heading)
    found = track(turned, [GPS, CAMERA])
    np.testing.assert_allclose(found.position, straight.position, atol=1e-6)
    np.testing.assert_array_equal(found.plot, straight.plot)
    degrees = Plots(
        **columns, azimuth=np.degrees(azimuth), sensor_heading=np.degrees(heading), degrees=True
    )
    np.testing.assert_allclose(degrees.sensor_heading, heading, rtol=1e-14)
    # some azimuths may be relative to north
    mixed = plots.time > 60.0
    some = Plots(
        **columns,
        azimuth=np.where(mixed, plots.azimuth, azimuth),
        sensor_heading=np.where(mixed, np.nan, heading),
    )
    np.testing.assert_allclose(track(some, [GPS, CAMERA]).position, straight.position, atol=1e-6)
    # without the heading few of them fit
    lost = track(Plots(**columns, azimuth=azimuth), [GPS, CAMERA])
    assert np.sum(lost.sensor == 1) < 0.2 * np.sum(straight.sensor == 1)
    with pytest.raises(ValueError, match=r"^plots.sensor_heading\[0\] belongs to sensors\[0\]"):
        track(Plots([0.0], position=[[0.0, 0.0]], sensor_heading=[1.0]), [GPS, CAMERA])
    with pytest.raises(ValueError, match=r"^sensor_heading.*degrees\?"):
        Plots([0.0], azimuth=1.0, sensor_heading=[180.0])


def test_errors_of_azimuths_and_times_and_the_north_of_a_station():
    plots, _, _ = scene(5)
    expected = track(plots, [GPS, CAMERA])
    camera = plots.sensor == 1
    angle = 0.3
    axes = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    station = Station(
        CAMERA.position, azimuth_sigma=0.001, bias=Bias(azimuth=0.02, time=0.1), axes=axes
    )
    shifted = Plots(
        plots.time + 0.1 * camera,
        azimuth=plots.azimuth + 0.02 - angle,
        sensor=plots.sensor,
        position=plots.position,
    )
    found = track(shifted, [GPS, station])
    np.testing.assert_allclose(found.position, expected.position, atol=1e-6)
    np.testing.assert_array_equal(found.track_of_plot, expected.track_of_plot)
    frame = LocalFrame(60.0, 10.0)
    east = frame.station(60.0, 11.0, 0.0, azimuth_sigma=0.001)
    assert Tracker([GPS, east]).update(plots[:0]).time.size == 0


@pytest.mark.parametrize("association", ["gnn", "mht"])
def test_a_saved_tracker_goes_on_to_the_last_bit(association):
    plots, _, _ = scene(6)
    live = Tracker([GPS, CAMERA], association=association)
    live.update(plots[plots.time < 60.0])
    other = pickle.loads(pickle.dumps(live))
    now = plots[plots.time >= 60.0]
    one, two = live.update(now), other.update(now)
    assert np.mean(one.track_of_plot > 0) > 0.9
    np.testing.assert_array_equal(one.track_of_plot, two.track_of_plot)
    np.testing.assert_array_equal(one.covariance, two.covariance)


def test_late_azimuths_change_nothing_whatever_their_order():
    plots, _, _ = scene(7, duration=60.0)
    in_time = np.argsort(plots.time, kind="stable")
    random = np.random.default_rng(8)
    late = np.argsort(plots.time + random.uniform(0.0, 4.0, len(plots)))
    tables = []
    for order in (in_time, late):
        live = Tracker([GPS, CAMERA], lag=8.0)
        rows = [live.update(plots[order[k : k + 30]]) for k in range(0, len(order), 30)]
        rows = [one[one.final] for one in (*rows, live.finish())]
        tables.append(
            np.vstack([np.column_stack([one.position, one.velocity, one.sensor]) for one in rows])
        )
    np.testing.assert_array_equal(*tables)
    assert np.count_nonzero(tables[0][:, 4] == 1) > 150


def test_an_azimuth_a_little_late_counts_as_of_its_time():
    plots, _, truth = scene(9, targets=1)
    # azimuths come together with the report after them, in either order
    order = np.argsort(plots.time)
    ahead = np.concatenate([group[::-1] for group in np.array_split(order, len(order) // 3)])
    tables = [track(plots[one], [GPS, CAMERA]) for one in (order, ahead)]
    live = Tracker([GPS, CAMERA])
    parts = [live.update(plots[group]) for group in np.array_split(ahead, len(ahead) // 3)]
    error = [one.position[-1] - truth(np.zeros(1, int), one.time[-1:])[0] for one in parts[20:]]
    best = [
        row - truth(np.zeros(1, int), np.array([time]))[0]
        for row, time in zip(tables[0].position, tables[0].time, strict=True)
        if time > 40.0
    ]
    np.testing.assert_array_equal(tables[0].position, tables[1].position)
    assert np.sqrt(np.mean(np.square(error))) < 1.15 * np.sqrt(np.mean(np.square(best)))


def test_a_camera_on_the_earth_narrows_the_tracks_of_a_radar():
    plane = SystemPlane(50.0, 14.0)
    radar = plane.radar(
        50.0, 12.0, 0.0, range_sigma=50.0, azimuth_sigma=0.002, scan_period=4.0, bias=Bias()
    )
    # 200 km east of the centre true north is 2 degrees off the north of the plane
    camera = plane.station(50.05, 16.8, 200.0, azimuth_sigma=5e-4)
    time = np.arange(0.0, 120.0, 4.0)
    latitude, longitude = 50.4 + 0.0 * time, 16.5 + 0.0025 * time
    random = np.random.default_rng(3)
    columns = []
    for site in (radar.site, plane.site(camera.position)):
        seen = [
            site.geodetic_to_polar(*place, 9e3) for place in zip(latitude, longitude, strict=True)
        ]
        columns.append(np.transpose(seen))
    (distance, azimuth, _), (_, sight, _) = columns
    distance = distance + random.normal(0.0, 50.0, len(time))
    azimuth = azimuth + random.normal(0.0, 0.002, len(time))
    sight = sight + random.normal(0.0, 5e-4, len(time))
    alone = Plots(time, distance, azimuth, height=9e3)
    both = Plots(
        np.append(time, time),
        np.append(distance, np.full(len(time), np.nan)),
        np.append(azimuth, sight),
        sensor=np.repeat([0, 1], len(time)),
        height=np.append(np.full(len(time), 9e3), np.full(len(time), np.nan)),
    )
    errors = []
    for plots, sensors in ((alone, [radar]), (both, [radar, camera])):
        table = track(plots, sensors, motion=CvModel(0.01))
        assert len(np.unique(table.track)) == 1
        last = table[table.time > 80.0]
        place = plane.to_local(50.4, 16.5 + 0.0025 * last.time, 9e3)
        off = last.position - np.asarray(place)[:, :2]
        assert np.mean(nees(off, last.covariance[:, :2, :2])) / 2.0 < 2.0
        errors.append((np.sqrt(np.mean(off**2)), np.sqrt(np.mean(last.covariance[:, 0, 0]))))
    assert errors[1][1] < 0.6 * errors[0][1]
    assert errors[1][0] < errors[0][0]


def test_wrong_arguments():
    def refused(match, *sensors, **options):
        assert_refused(lambda: Tracker([*sensors], **options), ValueError, match)

    refused("start no tracks", CAMERA)
    refused("azimuth_sigma is None", GPS, Station([0.0, 0.0]))
    refused("range_sigma", GPS, Station([0.0, 0.0], azimuth_sigma=0.1, range_sigma=5.0))
    refused("elevation_sigma", GPS, Station([0.0] * 3, azimuth_sigma=0.1, elevation_sigma=0.1))
    refused("sensor_position", GPS, Station(np.zeros((5, 2)), azimuth_sigma=0.1))
    refused("position_sigma", GPS, Station([0.0, 0.0], azimuth_sigma=0.1, position_sigma=5.0))
    refused("motion", GPS, CAMERA, motion="window")
    refused("motion", GPS, CAMERA, motion=WindowModel())
    for bias in (Bias(azimuth_sigma=0.1), Bias(time_sigma=None), Bias(deviation_order=1)):
        refused("bias", GPS, Station([0.0, 0.0], azimuth_sigma=0.1, bias=bias))
    refused("needs a Radar", GPS, CAMERA, registration=True)
    tracker = Tracker([GPS, CAMERA])
    assert_refused(
        lambda: tracker.update(Plots([0.0], 5.0, 0.1, sensor=1)), ValueError, "plots.range[0]"
    )
    moved = Plots([0.0], position=[[0.0, 0.0]], sensor_position=[[1.0, 1.0]])
    assert_refused(lambda: tracker.update(moved), ValueError, "plots.sensor_position[0]")
    flat = Radar(range_sigma=50.0, azimuth_sigma=0.001, scan_period=4.0)
    moved = Plots([0.0], 1e4, 0.1, sensor_position=[[1.0, 1.0]])
    assert_refused(lambda: Tracker([flat]).update(moved), ValueError, "sensor_position")
    assert_refused(lambda: Plots([0.0], sensor_position=[0.0]), ValueError, "sensor_position")
    bad = Plots([np.nan, 0.0], azimuth=[0.1, np.nan], sensor=1)
    assert np.all(tracker.update(bad).track_of_plot == PlotStatus.INVALID)


def test_cameras_beside_radars_that_are_registered():
    """Errors of radars have little influence on tracks that precise azimuths hold."""
    random = np.random.default_rng(74)
    places = np.array([[-3e4, 0.0], [3e4, 0.0], [0.0, -2e4], [2e4, 1.5e4]])
    start = np.array([[-8e3, 6e3], [5e3, -3e3], [1e3, 9e3]])
    velocity = np.array([[80.0, 20.0], [-60.0, 70.0], [30.0, -90.0]])
    columns = []
    for k in range(3):
        for s, place in enumerate(places):
            time = np.arange(0.1 + 0.3 * k + 0.5 * s, 200.0, 4.0 if s < 2 else 1.0)
            away, noise = (
                start[k] + time[:, np.newaxis] * velocity[k],
                random.normal(size=len(time)),
            )
            azimuth = seen_from(place, away) + (0.0015 if s < 2 else 0.0002) * noise
            distance, number = np.full(len(time), np.nan), -1
            if s < 2:
                distance = np.linalg.norm(away - place, axis=1) + random.normal(
                    0.0, 30.0, len(time)
                )
                distance, azimuth, number = distance + [60, -80][s], azimuth + [1e-3, -1e-3][s], k
            rest = [np.full(len(time), value) for value in (s, number)]
            columns.append((time, distance, azimuth, *rest))
    time, distance, azimuth, sensor, number = map(np.concatenate, zip(*columns, strict=True))
    order = np.argsort(time)
    plots = Plots(time, distance, azimuth, sensor=sensor, identity=number)[order]
    radars = [Radar(place, range_sigma=30.0, azimuth_sigma=0.0015, scan_period=4.0)
              for place in places[:2]]  # fmt: skip
    cameras = [Station(place, azimuth_sigma=0.0002) for place in places[2:]]
    rows = track(plots, [*radars, *cameras])
    rows = rows[rows.time > 60.0]
    assert len(np.unique(rows.track)) == 3
    truth = start[rows.identity] + rows.time[:, np.newaxis] * velocity[rows.identity]
    error, spread = rows.position - truth, rows.covariance[:, :2, :2]
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 9.0
    assert np.sqrt(np.median(np.trace(spread, axis1=1, axis2=2))) < 9.0
    assert np.mean(in_region(error, spread)) > 0.85
