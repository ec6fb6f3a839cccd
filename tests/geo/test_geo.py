"""Geo: against formulas with 50 digits, and against itself."""

import csv
from datetime import datetime

import mpmath
import numpy as np
import pytest
from places import DATA

from tertia import simulate
from tertia.geo import LocalFrame, cartesian_to_polar
from tertia.location import Station, locate
from tertia.sensors import Bias
from tertia.trajectory import reconstruct

NAN, INF = float("nan"), float("inf")
DIGITS = 50
FRAME = LocalFrame(-30.7, 135.1, 120.0)
PLACES = np.array(
    [
        [-30.7, 135.1, 120.0],
        [-30.66, 134.2, 150.0],
        [52.0, -0.5, 10e3],
        [89.9, 179.0, -50.0],
        [0.0, -180.0, 36e6],
        [-90.0, 20.0, 2800.0],
    ]
)


def geocentric(latitude, longitude, height):
    """x, y, z of WGS 84: equatorial radius 6378137 m, flattening 1/298.257223563."""
    flattening = 1 / mpmath.mpf("298.257223563")
    phi, theta = mpmath.radians(mpmath.mpf(latitude)), mpmath.radians(mpmath.mpf(longitude))
    square = flattening * (2 - flattening)
    normal = 6378137 / mpmath.sqrt(1 - square * mpmath.sin(phi) ** 2)
    level = (normal + height) * mpmath.cos(phi)
    return mpmath.matrix(
        [
            level * mpmath.cos(theta),
            level * mpmath.sin(theta),
            (normal * (1 - square) + height) * mpmath.sin(phi),
        ]
    )


def axes(latitude, longitude):
    """East, north and up: where x, y, z go with longitude, latitude and height."""
    rows = []
    for moved in (1, 0, 2):
        place = [mpmath.mpf(latitude), mpmath.mpf(longitude), mpmath.mpf(0)]
        step = mpmath.mpf(10) ** -15
        place[moved] += step
        ahead = geocentric(*place)
        place[moved] -= 2 * step
        row = ahead - geocentric(*place)
        rows.append(list(row / mpmath.norm(row)))
    return mpmath.matrix(rows)


@pytest.mark.parametrize("place", PLACES, ids=str)
def test_against_50_digits(place):
    with mpmath.workdps(DIGITS):
        origin = geocentric(FRAME.latitude, FRAME.longitude, FRAME.height)
        rotation = axes(FRAME.latitude, FRAME.longitude)
        expected = np.array(rotation * (geocentric(*place) - origin), dtype=float).ravel()
        ecef = np.array(geocentric(*place), dtype=float).ravel()
    np.testing.assert_allclose(FRAME.to_local(*place), expected, rtol=1e-15, atol=1e-8)
    np.testing.assert_allclose(FRAME.from_ecef(ecef), expected, rtol=1e-15, atol=1e-8)
    np.testing.assert_allclose(FRAME.to_ecef(expected), ecef, rtol=1e-15, atol=1e-8)


@pytest.mark.parametrize("place", PLACES[:4], ids=str)
def test_axes_against_50_digits(place):
    with mpmath.workdps(DIGITS):
        turn = axes(place[0], place[1]) * axes(FRAME.latitude, FRAME.longitude).T
    expected = np.array(turn.tolist(), dtype=float)
    np.testing.assert_allclose(FRAME.axes(*place[:2]), expected, rtol=0, atol=1e-15)


def test_there_and_back():
    rng = np.random.default_rng(1)
    heights = np.repeat([-1e3, 0.0, 10e3, 1e6, 36e6], 40)
    places = np.stack([rng.uniform(-90, 90, 200), rng.uniform(-180, 180, 200), heights])
    local = FRAME.to_local(*places)
    told = FRAME.to_geodetic(local)
    far = 1e-14 * np.maximum(np.linalg.norm(local, axis=-1), 1e6)
    assert np.all(np.linalg.norm(FRAME.to_local(*told) - local, axis=-1) < far)
    for value, expected in zip(told, places, strict=True):
        np.testing.assert_allclose(value, expected, rtol=0, atol=1e-7)
    assert FRAME.to_local(*places.reshape(3, 20, 10)).shape == (20, 10, 3)
    assert all(isinstance(value, float) for value in FRAME.to_geodetic([0, 0, 0]))


def test_north_is_0_and_not_a_full_circle():
    frame = LocalFrame(-20.0, 14.26, 380.0)
    _, azimuth, _ = frame.geodetic_to_polar(np.linspace(-19.9, -17.0, 500), 14.26, 1000.0)
    assert np.all((azimuth >= 0.0) & (azimuth < 2 * np.pi))
    assert np.isnan(frame.geodetic_to_polar(NAN, 14.26, 1000.0)).all()
    assert cartesian_to_polar([-1e-12, 80e3, 0.0, 0.0])[2] == 0.0


def test_no_place_stays_none():
    local = FRAME.to_local([1.0, NAN, 2.0], [3.0, 4.0, NAN], 0.0)
    np.testing.assert_array_equal(np.isnan(local).all(axis=-1), [False, True, True])
    np.testing.assert_array_equal(np.isnan(FRAME.to_geodetic(local)), [[False, True, True]] * 3)


def test_a_station_measures_about_its_own_vertical_and_north():
    """A target straight above it, and two on its own meridian."""
    station = FRAME.station(-30.0, 134.0, 100.0, azimuth_sigma=1e-3, elevation_sigma=1e-3)
    above = FRAME.to_local(-30.0, 134.0, 50e3) - station.position
    np.testing.assert_allclose(station.axes @ above, [0, 0, 49_900.0], rtol=0, atol=1e-8)
    for latitude, azimuth in ((-29.5, 0.0), (-30.5, np.pi)):
        target = FRAME.to_local(latitude, 134.0, 0.0)
        record = simulate.stations([station], target, batch=10_000, rng=2)
        error = np.angle(np.exp(1j * (record.measurements["azimuth"] - azimuth)))
        assert abs(np.mean(error)) < 5e-5


def test_the_frame_does_not_matter():
    """Three cameras, located in the frame of each and of a place far away."""
    places = np.array([[-30.66, 134.2, 149.0], [-30.9, 135.3, 120.0], [-31.6, 134.7, 90.0]])
    target = np.array([-31.0, 134.8, 40e3])
    sigmas = {"azimuth_sigma": 1e-4, "elevation_sigma": 1e-4}
    found = []
    for origin in (*places, np.array([-25.0, 140.0, 0.0])):
        frame = LocalFrame(*origin)
        cameras = [frame.station(*p, **sigmas) for p in places]
        record = simulate.stations(cameras, frame.to_local(*target), rng=4)
        fix = locate(cameras, **record.measurements)
        assert fix.pvalue > 1e-3
        found.append(frame.to_ecef(fix.position))
    np.testing.assert_allclose(found, np.broadcast_to(found[0], (4, 3)), rtol=0, atol=1e-3)
    upright = [Station(camera.position, **sigmas) for camera in cameras]
    wrong = locate(upright, **record.measurements, initial=fix.position, method="least-squares")
    assert np.linalg.norm(wrong.position - fix.position) > 1e3


def test_a_trajectory_seen_from_a_ship():
    times = np.arange(20.0)
    frame = LocalFrame(50.0, 14.0)
    ship = frame.station(
        50.5 + 1e-4 * times, 14.0, 0.0, range_sigma=10.0, azimuth_sigma=1e-3, elevation_sigma=1e-3
    )
    assert ship.position.shape == (20, 3)
    assert ship.axes.shape == (20, 3, 3)
    path = frame.to_local(50.6, 14.0 + 1e-3 * times, 5000.0)
    offset = path - ship.position
    own = np.einsum("nij,nj->ni", ship.axes, offset)
    rng = np.random.default_rng(5)
    measured = {
        "range": np.linalg.norm(offset, axis=-1) + 10 * rng.standard_normal(20),
        "azimuth": np.arctan2(own[:, 0], own[:, 1]) + 1e-3 * rng.standard_normal(20),
        "elevation": np.arcsin(own[:, 2] / np.linalg.norm(own, axis=-1))
        + 1e-3 * rng.standard_normal(20),
    }
    track = reconstruct(
        [ship], times, **{kind: values[:, np.newaxis] for kind, values in measured.items()}
    )
    assert np.sqrt(np.mean(np.sum((track.position - path) ** 2, axis=-1))) < 15
    assert abs(np.mean(frame.to_geodetic(track.position)[2]) - 5000.0) < 15


def camera(path):
    """Place of a camera, seconds, angles and their sigmas in radians, published x, y, z."""
    lines = path.read_text().splitlines()
    told = dict(line[5:-1].split(": ", 1) for line in lines if line.startswith("# - {obs_"))
    place = [float(told[f"obs_{key}"]) for key in ("latitude", "longitude", "elevation")]
    rows = sorted(
        csv.DictReader(line for line in lines if not line.startswith("#")),
        key=lambda row: row["datetime"],
    )
    seconds = [datetime.fromisoformat(row["datetime"]).timestamp() for row in rows]
    angles = [[float(row[key]) for key in ("azimuth", "altitude")] for row in rows]
    sigmas = [[float(row[f"err_plus_{key}"]) for key in ("azimuth", "altitude")] for row in rows]
    ecef = [[float(row[f"{axis}_geo"]) for axis in "XYZ"] for row in rows]
    sigma = np.radians(np.median(sigmas, axis=0))
    return place, np.array(seconds), np.radians(angles), sigma, np.array(ecef)


@pytest.mark.skipif(not (DATA / "dfn_fireball").is_dir(), reason="the recording is not there")
def test_a_fireball_seen_by_three_cameras():
    """The published solution is a straight line, from which the sightings are 70 to 260 m off."""
    cameras = [camera(path) for path in sorted((DATA / "dfn_fireball").glob("*.ecsv"))]
    times = np.unique(np.concatenate([seconds for _, seconds, *_ in cameras]))
    azimuth, elevation = np.full((2, times.size, 3), NAN)
    frame = LocalFrame(-31.2, 135.0)
    stations, upright = [], []
    for k, (place, seconds, angles, sigma, _) in enumerate(cameras):
        sigmas = {"azimuth_sigma": sigma[0], "elevation_sigma": sigma[1]}
        stations.append(frame.station(*place, **sigmas))
        upright.append(Station(stations[k].position, **sigmas))
        azimuth[np.searchsorted(times, seconds), k] = angles[:, 0]
        elevation[np.searchsorted(times, seconds), k] = angles[:, 1]
    track = reconstruct(stations, times, azimuth=azimuth, elevation=elevation)
    for _, seconds, *_, ecef in cameras:
        at = np.searchsorted(times, seconds)
        distance = np.linalg.norm(track.position[at] - frame.from_ecef(ecef), axis=-1)
        assert np.median(distance) < 200
        assert np.max(distance) < 500
    wrong = reconstruct(upright, times, azimuth=azimuth, elevation=elevation)
    assert np.median(np.linalg.norm(wrong.position - track.position, axis=-1)) > 500


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: LocalFrame(90.5, 0.0), "latitude is 90.5; it must be between -90 and 90 degrees"),
        (lambda: LocalFrame(0.0, INF), "longitude is inf"),
        (lambda: LocalFrame(0.0, 0.0, NAN), "height is nan"),
        (lambda: FRAME.to_local([0.0, -91.0], 0.0), r"latitude\[1\] is -91.0"),
        (lambda: FRAME.to_local([0.0, 1.0], [1.0, 2.0, 3.0]), r"latitude \(2,\), longitude \(3,\)"),
        (lambda: FRAME.to_geodetic([1.0, 2.0]), r"position has shape \(2,\)"),
        (lambda: FRAME.from_ecef([1.0, 2.0, INF]), r"ecef\[2\] is inf"),
        (lambda: FRAME.axes(100.0, 0.0), "latitude is 100.0"),
        (lambda: FRAME.station(NAN, 0.0), "position"),
        (lambda: FRAME.station(0.0, 0.0, range_sigma=-1.0), "range_sigma is -1.0"),
    ],
)
def test_errors(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_a_string_is_no_latitude():
    with pytest.raises(TypeError, match="latitude is '50 N'"):
        LocalFrame("50 N", 14.0)


def test_a_station_has_what_stations_have():
    frame = LocalFrame(48.0, 7.0)
    bias = Bias(time_sigma=1e-7)
    options = {"arrival_time_sigma": 3e-7, "position_sigma": 2.0, "bias": bias}
    station = frame.station(49.0, 9.0, 300.0, **options)
    assert {name: getattr(station, name) for name in options} == options
