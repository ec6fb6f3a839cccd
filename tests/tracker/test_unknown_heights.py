"""Targets near the ground whose heights are not reported, seen by radars with slant ranges."""

import numpy as np
import pytest
from checks import in_region

from tertia.geo import LocalFrame, SystemPlane
from tertia.registration import register
from tertia.sensors import PositionSensor, Radar
from tertia.tracker import Plots, Tracker, smooth_tracks, track
from tertia.tracker._models import ProfileName

FIRST, PERIOD, SCANS = 20.0, 2.5, 60
PLANE = SystemPlane(54.0, 8.0)
# 420 m above the ellipsoid: near the ground is not near sea level
SITE = 420.0


def _radar() -> Radar:
    return PLANE.radar(
        54.0,
        8.0,
        SITE,
        range_sigma=15.0,
        azimuth_sigma=0.005,
        scan_period=PERIOD,
        max_range=20e3,
    )


def _plots(below: float, seed: int) -> tuple[Plots, np.ndarray]:
    """Return plots of ten targets between 1 and 10 km, and their positions."""
    rng = np.random.default_rng(seed)
    time = np.repeat(FIRST + PERIOD * np.arange(SCANS), 10)
    number = np.tile(np.arange(10), SCANS)
    azimuth = 0.6 * number
    place = (1e3 * (1 + number) + 6.0 * (time - FIRST))[:, np.newaxis]
    place = place * np.column_stack([np.sin(azimuth), np.cos(azimuth)])
    time = time + PERIOD * azimuth / (2 * np.pi)
    distance = np.hypot(np.hypot(*place.T), below)
    return (
        Plots(
            time,
            distance + rng.normal(0.0, 15.0, len(time)),
            azimuth + rng.normal(0.0, 0.005, len(time)),
        ),
        place,
    )


@pytest.mark.parametrize(("profile", "below"), [("vessel", 20.0), ("road", 6.0), ("drone", -80.0)])
def test_targets_near_the_ground_are_where_they_are(profile: ProfileName, below: float) -> None:
    plots, place = _plots(below, 1)
    table = track(plots, [_radar()], profile=profile)
    rows = (table.plot >= 0) & (table.time > FIRST + 10 * PERIOD)
    error = table.position[rows] - place[table.plot[rows]]
    inside = in_region(error, table.covariance[rows][:, :2, :2])
    assert len(np.unique(table.track)) == 10
    # 15 m along and up to 50 m across the beam; thousands of metres as aircraft at 6 km
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 40.0
    assert np.mean(inside) > 0.9


def test_ships_do_not_show_errors_of_a_radar_that_has_none() -> None:
    plots, place = _plots(20.0, 2)
    rng = np.random.default_rng(3)
    every = slice(None, None, 2)
    reported = place[every] + rng.normal(0.0, 10.0, place[every].shape)
    size = len(plots), len(reported)
    both = Plots(
        np.append(plots.time, plots.time[every]),
        np.append(plots.range, np.full(size[1], np.nan)),
        np.append(plots.azimuth, np.full(size[1], np.nan)),
        sensor=np.repeat([0, 1], size),
        position=np.vstack([np.full((size[0], 2), np.nan), reported]),
    )
    sensors = [_radar(), PositionSensor(position_sigma=10.0, update_interval=5.0)]
    tracker = Tracker(sensors, profile="vessel")
    for begin in FIRST + PERIOD * np.arange(SCANS):
        now = (both.time >= begin) & (both.time < begin + PERIOD)
        tracker.update(both[now], time=begin + PERIOD)
    found = register(both, sensors, profile="vessel")
    for bias in (tracker.bias, found.bias):
        assert abs(bias.range[0]) < 3.0 * bias.range_sigma[0] + 5.0
        assert bias.range_sigma[0] < 40.0


def _aircraft(silent: int, lost: float, seed: int) -> tuple[Plots, list[Radar], np.ndarray]:
    """Return plots of twenty aircraft by two radars 100 km apart, and their positions.

    `silent` aircraft report no heights, and the others none in so large a share of their plots.
    """
    rng = np.random.default_rng(seed)
    kind = {"range_sigma": 50.0, "azimuth_sigma": 0.0014}
    radars = [
        PLANE.radar(54.0, longitude, 100.0, scan_period=period, **kind)
        for longitude, period in ((7.24, 5.0), (8.76, 6.0))
    ]
    parts = []
    for number in range(20):
        start, course = rng.uniform(-60e3, 60e3, 2), rng.uniform(0.0, 2.0 * np.pi)
        high = rng.uniform(2e3, 11e3)
        for k, radar in enumerate(radars):
            time = np.arange(rng.uniform(0.0, radar.scan_period), 400.0, radar.scan_period)
            way = 180.0 * time[:, np.newaxis] * [np.sin(course), np.cos(course)]
            place = start + way
            east, north, up = _seen(place, high, radar)
            told = (number >= silent) & (rng.random(len(time)) >= lost)
            parts.append(
                [
                    time,
                    np.sqrt(east**2 + north**2 + up**2) + rng.normal(0.0, 50.0, len(time)),
                    np.arctan2(east, north) + rng.normal(0.0, 0.0014, len(time)),
                    np.full(len(time), k),
                    np.where(told, high, np.nan),
                    np.full(len(time), 0x400000 + number),
                    *place.T,
                ]
            )
    time, distance, azimuth, sensor, height, address, *place = np.hstack(parts)
    plots = Plots(
        time,
        distance,
        azimuth,
        sensor=sensor.astype(int),
        height=height,
        icao_address=address.astype(int),
    )
    return plots, radars, np.column_stack(place)


def _seen(place: np.ndarray, high: float, radar: Radar) -> np.ndarray:
    """Return east, north and up of places from a radar, by way of geocentric coordinates."""
    latitude, longitude, _ = PLANE.to_geodetic(np.column_stack([place, np.full(len(place), high)]))
    assert radar.site is not None
    here = LocalFrame(radar.site.latitude, radar.site.longitude, radar.site.height)
    return np.asarray(here.to_local(latitude, longitude, high)).T


def test_missing_heights_show_no_errors_of_radars_that_have_none() -> None:
    plots, radars, _ = _aircraft(4, 0.3, 4)
    found = register(plots, radars)
    for kind in ("range", "range_gain", "azimuth"):
        value, sigma = getattr(found.bias, kind), getattr(found.bias, f"{kind}_sigma")
        assert np.max(np.abs(value) / sigma) < 3.5
    assert np.max(found.noise_factor.range) < 1.15


def test_smoothed_tracks_without_heights_are_as_uncertain_as_their_height() -> None:
    plots, radars, place = _aircraft(4, 0.7, 5)
    smoothed = smooth_tracks(plots, radars, registration=False)
    error = smoothed.position - place[smoothed.plot]
    inside = in_region(error, smoothed.covariance[:, :2, :2])
    assert np.mean(inside) > 0.91
    # heights that single plots lack follow from the others
    known = smoothed.icao_address >= 0x400004
    assert np.sqrt(np.mean(np.sum(error[known] ** 2, axis=1))) < 28.0
    assert np.mean(inside[known]) > 0.93


def _in_a_plane(seed: int) -> tuple[Plots, list[Radar], np.ndarray, np.ndarray]:
    """Return plots of aircraft at 7 to 11 km, two thirds of which report no height.

    The radars are in a flat plane, and have no errors.
    """
    rng = np.random.default_rng(seed)
    noise = {"range_sigma": 40.0, "azimuth_sigma": 0.001, "scan_period": 4.0}
    radars = [Radar(place, **noise) for place in ((-40e3, 0.0), (50e3, 20e3), (0.0, 70e3))]
    number, scan, sensor = (one.ravel() for one in np.indices((12, 75, 3)))
    time = 4.0 * scan + rng.uniform(0.0, 4.0, (12, 3))[number, sensor]
    course = rng.uniform(0.0, 2.0 * np.pi, 12)[number]
    start, height = rng.uniform(-60e3, 60e3, (12, 2)), rng.uniform(7e3, 11e3, 12)
    way = 200.0 * time[:, np.newaxis] * np.column_stack([np.sin(course), np.cos(course)])
    place = start[number] + way
    away = place - np.array([one.position[:2] for one in radars])[sensor]
    plots = Plots(
        time,
        np.hypot(np.hypot(*away.T), height[number]) + rng.normal(0.0, 40.0, len(time)),
        np.arctan2(away[:, 0], away[:, 1]) + rng.normal(0.0, 0.001, len(time)),
        sensor=sensor,
        height=np.where(number < 4, height[number], np.nan),
    )
    return plots, radars, place, number


def test_tracks_without_heights_are_smoothed_at_the_height_that_several_radars_show() -> None:
    plots, radars, place, number = _in_a_plane(1)
    for sensors in (radars, radars[:1]):
        kept = plots.sensor < len(sensors)
        table = smooth_tracks(plots[kept], sensors, registration=False)
        error = table.position - place[kept][table.plot]
        inside = in_region(error, table.covariance[:, :2, :2])
        unknown = number[kept][table.plot] >= 4
        # with horizontal ranges, none are inside
        assert np.mean(inside[unknown]) > 0.9
        if len(sensors) == 3:
            assert np.sqrt(np.mean(np.sum(error[unknown] ** 2, axis=1))) < 40.0


def test_radars_are_registered_by_aircraft_most_of_which_have_no_heights() -> None:
    plots, radars, _, _ = _in_a_plane(2)
    found = register(plots, radars)
    assert np.all(np.abs(found.bias.range) < 3 * found.bias.range_sigma)
    # up to 98 m, at a claimed 49 m, with horizontal ranges
    assert np.all(np.abs(found.bias.range) < 40.0)
