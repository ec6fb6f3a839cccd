"""Radars that are registered by sensors of positions, while tracking and from a recording."""

import pickle

import numpy as np
import pytest
from tracker.flights import followed, with_reports

from tertia import simulate
from tertia.geo import SystemPlane
from tertia.metrics import nees
from tertia.registration import register
from tertia.sensors import RADAR_LIMITS, Bias, PositionSensor, Radar, Station
from tertia.tracker import Plots, Tracker, track

ADSB = PositionSensor(position_sigma=25.0, bias=Bias())
BIAS = Bias(range=200.0, azimuth=0.3, degrees=True)
NUMBERS = {"range_sigma": 50.0, "azimuth_sigma": 0.0014, "scan_period": 4.0}
FLAT = Radar([-5e4, 0.0], **NUMBERS)
ROUND = SystemPlane(50.0, 14.0).radar(50.2, 13.6, 300.0, **NUMBERS)
TARGETS = 20


def recording(radar, seed=1, lasting=0.0):
    """Plots of a radar with errors and reports of three targets in four, their targets and truth.

    The share `lasting` of the variance of the reports is one error of a target.
    """
    random = np.random.default_rng([58, seed])
    traffic = simulate.dense_traffic(
        TARGETS, area=(1e5, 1e5), turning_share=0.0, duration=240.0, rng=seed
    )
    record = simulate.radar_plots(traffic, [radar], bias=BIAS, rng=seed + 50)
    time = np.arange(0.3, 239.0, 1.0)
    target = np.repeat(np.arange(15), len(time))
    time = np.tile(time, 15)
    constant = random.normal(0.0, 25.0 * np.sqrt(lasting), (TARGETS, 2))[target]
    noise = random.normal(0.0, 25.0 * np.sqrt(1.0 - lasting), (len(time), 2))
    place = traffic.at(target, time)[0] + constant + noise
    return traffic, *with_reports(record, time, target, place)


def merged(*parts):
    """Plots of several recordings in order of time."""
    names = ("time", "range", "azimuth", "sensor", "height")
    columns = {name: np.concatenate([getattr(each, name) for each in parts]) for name in names}
    positions = [
        np.full((len(each), 2), np.nan) if each.position is None else each.position
        for each in parts
    ]
    columns["position"] = np.concatenate(positions)
    order = np.argsort(columns["time"], kind="stable")
    return Plots(**{name: column[order] for name, column in columns.items()})


def off(bias):
    """Errors of range and azimuth over their sigmas, and these over the limits."""
    found = []
    for kind in ("range", "azimuth"):
        value, sigma = (np.atleast_1d(getattr(bias, kind + end))[0] for end in ("", "_sigma"))
        limit = getattr(RADAR_LIMITS, f"{kind}_sigma")
        found.append([(value - getattr(BIAS, kind)) / sigma, sigma / limit])
    return np.array(found).T


@pytest.mark.parametrize("radar", [FLAT, ROUND], ids=["flat", "round"])
def test_one_radar_is_registered(radar):
    traffic, plots, target = recording(radar)
    tracker = Tracker([radar, ADSB])
    tables = followed(tracker, plots)
    distance, sigma = off(tracker.bias)
    assert np.all(np.abs(distance) < 3.5)
    assert np.all(sigma < 0.25)
    assert tracker.bias.range[1] == tracker.bias.range_sigma[1] == 0.0
    late = tables[30:]
    assert len(np.unique(np.concatenate([table.track for table in late]))) == TARGETS
    squares = []
    for table in late:
        hit = (table.plot >= 0) & (target[table.plot] >= 0)
        truth = traffic.at(target[table.plot[hit]], table.time[hit])[0]
        squares.append(nees(table.position[hit] - truth, table.covariance[hit, :2, :2]))
    # straight flights and a tracker that expects turns
    assert 0.5 < np.mean(np.concatenate(squares)) / 2.0 < 1.1


def test_reports_that_are_late():
    traffic, plots, target = recording(FLAT, seed=3)
    late = plots._replaced(time=plots.time + 0.3 * (plots.sensor == 1))
    order = np.argsort(late.time)
    plots, target = late[order], target[order]
    off_by = {}
    for name, bias in (("found", None), ("trusted", Bias())):
        tracker = Tracker([FLAT, PositionSensor(position_sigma=25.0, bias=bias)])
        tables = followed(tracker, plots)[30:]
        errors, squares = [], []
        for table in tables:
            hit = (table.plot >= 0) & (target[table.plot] >= 0)
            error = table.position[hit] - traffic.at(target[table.plot[hit]], table.time[hit])[0]
            # that of a flight may end before its last report
            known = np.isfinite(error).all(axis=1)
            errors.append(error[known])
            squares.append(nees(error[known], table.covariance[hit, :2, :2][known]))
        off_by[name] = np.sqrt(np.mean(np.concatenate(errors) ** 2))
        if bias is None:
            assert abs(tracker.bias.time[1] - 0.3) < 3.0 * tracker.bias.time_sigma[1]
            assert np.mean(np.concatenate(squares)) / 2.0 < 1.5
    assert off_by["found"] < 0.5 * off_by["trusted"]


def test_without_registration_every_aircraft_has_two_tracks():
    _, plots, _ = recording(FLAT)
    tables = followed(Tracker([FLAT, ADSB], registration=False), plots)
    assert len(np.unique(np.concatenate([table.track for table in tables[30:]]))) > 30


def test_errors_of_reports_that_last_are_not_certain():
    distances = []
    for seed in range(6):
        _, plots, _ = recording(FLAT, seed=seed, lasting=1.0)
        tracker = Tracker([FLAT, ADSB])
        followed(tracker, plots)
        distances.append(off(tracker.bias)[0])
    assert np.sqrt(np.mean(np.square(distances))) < 1.5


def test_a_recording_is_registered():
    _, plots, _ = recording(FLAT)
    found = register(plots, [FLAT, ADSB])
    distance, sigma = off(found.bias)
    assert np.all(np.abs(distance) < 3.5)
    assert np.all(sigma < 0.25)
    assert found.observable["range"].tolist() == [True, False]
    factor = found.noise_factor.range
    assert 0.85 < factor[0] < 1.15
    assert np.isnan(factor[1])
    assert found.sensors[1] is ADSB
    assert "bias" in repr(found)


def test_a_camera_beside_changes_little():
    traffic, plots, target = recording(FLAT)
    reports = np.flatnonzero(plots.sensor == 1)
    place = traffic.at(target[reports], plots.time[reports])[0]
    noise = np.random.default_rng(59).normal(0.0, 0.002, len(reports))
    seen = Plots(
        plots.time[reports],
        np.full(len(reports), np.nan),
        np.arctan2(place[:, 0], place[:, 1]) + noise,
        sensor=np.full(len(reports), 2),
    )
    camera = Station([0.0, 0.0], azimuth_sigma=0.002)
    alone, both = Tracker([FLAT, ADSB]), Tracker([FLAT, ADSB, camera])
    followed(alone, plots)
    followed(both, merged(plots, seen))
    assert both.bias.azimuth_sigma[0] < 0.25 * RADAR_LIMITS.azimuth_sigma
    shift = both.bias.azimuth[0] - alone.bias.azimuth[0]
    assert abs(shift) < alone.bias.azimuth_sigma[0]


def test_one_camera_beside_a_radar_registers_nothing():
    tracker = Tracker([FLAT, Station([0.0, 0.0], azimuth_sigma=0.002)])
    assert tracker.bias.range_sigma[0] == RADAR_LIMITS.range_sigma
    assert tracker._registrar is None


def test_a_saved_tracker_goes_on():
    _, plots, _ = recording(FLAT)
    tracker = Tracker([FLAT, ADSB])
    followed(tracker, plots, end=60.0)
    again = pickle.loads(pickle.dumps(tracker))
    tables = [followed(one, plots, begin=60.0, end=120.0)[-1] for one in (tracker, again)]
    assert np.array_equal(tables[0].covariance, tables[1].covariance)
    assert np.array_equal(tracker.bias.range, again.bias.range)


def turning(seed, duration=300.0):
    """Three aircraft, each in a wide turn: a radar with errors, ADS-B, multilateration."""
    random, rate = np.random.default_rng([73, seed]), 0.004
    start = np.array([[2e4, -4e4], [-3e4, 3e4], [3e4, 2e4]])
    course, radius = np.array([-0.3, 2.2, 4.2]), np.array([200.0, 190.0, 180.0]) / rate
    columns = []
    for k in range(3):
        for sensor, time in enumerate((np.arange(0.1 + k, duration, 4.0),
                                       np.arange(0.3, duration, 0.8),
                                       np.arange(0.6, duration, 1.0))):  # fmt: skip
            now, count = course[k] + rate * time, len(time)
            place = start[k] + radius[k] * np.column_stack(
                [np.cos(course[k]) - np.cos(now), np.sin(now) - np.sin(course[k])]
            )
            speed = radius[k] * rate * np.column_stack([np.sin(now), np.cos(now)])
            none, noise = np.full(count, np.nan), random.normal(size=(count, 2))
            distance = np.hypot(*place.T) + 80.0 + 30.0 * noise[:, 0]
            azimuth = np.arctan2(*place.T) + 0.0015 + 0.0012 * noise[:, 1]
            wild = 600.0 * (random.random((count, 1)) < 0.02) * random.normal(size=(count, 2))
            columns.append([
                time,
                distance if sensor == 0 else none,
                azimuth if sensor == 0 else none,
                np.full(count, sensor),
                place + (25.0 * noise if sensor == 1 else 30.0 * noise + wild)
                if sensor else np.full((count, 2), np.nan),
                speed + random.normal(0.0, 0.7, (count, 2))
                if sensor == 1 else np.full((count, 2), np.nan),
                np.full(count, k),
            ])  # fmt: skip
    time, distance, azimuth, sensor, position, velocity, number = map(
        np.concatenate, zip(*columns, strict=True)
    )
    plots = Plots(
        time, distance, azimuth, sensor=sensor, position=position, velocity=velocity,
        identity=number,
    )  # fmt: skip
    return plots[np.argsort(time)]


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_velocities_leave_errors_of_the_radar_little_influence(seed):
    radar = Radar([0.0, 0.0], range_sigma=30.0, azimuth_sigma=0.0012, scan_period=4.0)
    adsb = PositionSensor(position_sigma=75.0, velocity_sigma=0.7)
    tracks = track(turning(seed), [radar, adsb, PositionSensor(position_sigma=30.0)])
    rows = tracks[tracks.time > 60.0]
    assert len(np.unique(rows.track)) == 3
    sigma = np.sqrt(np.trace(rows.covariance[:, :2, :2], axis1=1, axis2=2))
    assert sigma.max() < 36.0
