"""Paths from azimuths of stations with heights: they are in the plane."""

import itertools

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from tertia.geo import LocalFrame
from tertia.location import locate
from tertia.sensors import Bias, Station
from tertia.trajectory import reconstruct

PLACES = np.array([[0.0, 0.0, 0.0], [4200, 2700, 60], [3600, -3300, 20], [7200, -1100, 150]])
SIGMA = 0.03
TIME = np.arange(60) * 10.0
PATH = np.column_stack([1000 + 2 * TIME, 500 + 3 * TIME, np.full(60, 90.0)])
WAYS = list(
    itertools.product(
        ["spatial-first", "temporal-first"],
        ["robust", "least-squares"],
        ["rts", "local-polynomial"],
    )
)


def on_the_earth(places=PLACES, **sigmas):
    """Return stations whose verticals meet in the centre of the earth."""
    frame = LocalFrame(62.48, 9.62, 400.0)
    sites = [frame.station(*frame.to_geodetic(place)) for place in places]
    every = {"azimuth_sigma": SIGMA, **sigmas}
    return [Station(site.position, axes=site.axes, **every) for site in sites]


def angles(stations, path=PATH):
    """Return azimuths and elevations without errors."""
    local = np.stack([(path - s.position) @ np.asarray(s.axes).T for s in stations], axis=1)
    level = np.hypot(local[..., 0], local[..., 1])
    return np.arctan2(local[..., 0], local[..., 1]), np.arctan2(local[..., 2], level)


def noisy(seed, stations):
    rng = np.random.default_rng(seed)
    return angles(stations)[0] + SIGMA * rng.standard_normal((len(TIME), len(PLACES)))


def in_turn(azimuth):
    """Return azimuths of which each instant has one."""
    one = np.arange(azimuth.shape[0])[:, np.newaxis] % azimuth.shape[1] == np.arange(4)
    return np.where(one, azimuth, np.nan)


def assert_no_height(track):
    assert np.isnan(track.position[:, 2]).all()
    assert np.isnan(track.velocity[:, 2]).all()
    assert np.isnan(track.acceleration[:, 2]).all()
    up = [2, 5, 8]
    assert np.isinf(track.covariance[:, up, up]).all()
    assert not track.covariance[:, up][:, :, [0, 1, 3, 4, 6, 7]].any()
    assert np.isnan(track.fixes.position[:, 2]).all()


@pytest.mark.parametrize(("order", "spatial", "smoother"), WAYS)
@pytest.mark.parametrize("moves", [False, True])
def test_the_path_is_that_of_stations_without_heights(order, spatial, smoother, moves):
    places = PLACES + np.multiply.outer(TIME * moves, [1.0, -0.5, 0.2])[:, np.newaxis]
    if not moves:
        places = places[0]
    offset = PATH[:, np.newaxis] - places
    azimuth = np.arctan2(offset[..., 0], offset[..., 1])
    azimuth += SIGMA * np.random.default_rng(3).standard_normal(azimuth.shape)
    space, plane = (
        reconstruct(
            [Station(places[..., k, :d], azimuth_sigma=SIGMA) for k in range(4)],
            TIME,
            azimuth=azimuth,
            order=order,
            spatial=spatial,
            smoother=smoother,
        )
        for d in (3, 2)
    )
    assert_no_height(space)
    np.testing.assert_array_equal(space.position[:, :2], plane.position)
    np.testing.assert_array_equal(space.velocity[:, :2], plane.velocity)
    own = np.ix_(range(60), [0, 1, 3, 4, 6, 7], [0, 1, 3, 4, 6, 7])
    np.testing.assert_array_equal(space.covariance[own], plane.covariance)
    np.testing.assert_array_equal(space.residual.azimuth, plane.residual.azimuth)
    np.testing.assert_array_equal(space.fixes.position[:, :2], plane.fixes.position)
    assert repr(space) == repr(plane)
    if space.smoothed is not None:
        np.testing.assert_array_equal(space.smoothed.position[:, :2], plane.smoothed.position)
        np.testing.assert_array_equal(space.smoothed.nis, plane.smoothed.nis)
        assert np.isinf(space.smoothed.sigma[:, 2]).all()


@pytest.mark.parametrize("turns", [False, True])
def test_errors_are_as_large_as_claimed_on_the_earth(turns):
    """Before, most paths with one azimuth at a time ended near the centre of the earth."""
    stations, squares = on_the_earth(), []
    for seed in range(40):
        azimuth = noisy(100 + seed, stations)
        track = reconstruct(
            stations, TIME, azimuth=in_turn(azimuth) if turns else azimuth, jerk=0.0, bias=Bias()
        )
        assert_no_height(track)
        error = track.position[30, :2] - PATH[30, :2]
        squares.append(error @ np.linalg.solve(track.covariance[30, :2, :2], error))
    low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], 80) / 40
    assert low < np.mean(squares) < high


@pytest.mark.parametrize("bias", [None, Bias(azimuth_sigma=0.01), Bias(azimuth_sigma=np.inf)])
def test_biases_are_those_in_the_plane(bias):
    stations = on_the_earth()
    flat = [Station(s.position[:2], azimuth_sigma=SIGMA) for s in stations]
    azimuth = noisy(5, stations) + np.array([0.05, -0.03, 0.0, 0.02])
    # the convergence of the meridians, as north is that of the first station
    north = np.array([np.arctan2(s.axes[1, 0], s.axes[1, 1]) for s in stations])
    space = reconstruct(stations, TIME, azimuth=azimuth, bias=bias)
    plane = reconstruct(flat, TIME, azimuth=azimuth + north, bias=bias)
    assert_no_height(space)
    np.testing.assert_allclose(space.bias.azimuth, plane.bias.azimuth, atol=1e-6)
    np.testing.assert_allclose(space.bias.azimuth_sigma, plane.bias.azimuth_sigma, rtol=1e-5)


def test_kinds_of_which_all_values_are_missing_are_none():
    stations = on_the_earth(elevation_sigma=0.02, range_sigma=10.0)
    azimuth = noisy(6, stations)
    missing = np.full(azimuth.shape, np.nan)
    track = reconstruct(stations, TIME, azimuth=azimuth, elevation=missing, range=missing)
    assert_no_height(track)
    other = reconstruct(stations, TIME, azimuth=azimuth)
    np.testing.assert_array_equal(track.position, other.position)
    assert np.isnan(track.residual.elevation).all()


def test_single_positions_are_those_of_locate():
    stations = on_the_earth()
    azimuth = noisy(7, stations)
    track = reconstruct(stations, TIME, azimuth=azimuth, spatial="least-squares", bias=Bias())
    fix = locate(stations, azimuth=azimuth, method="least-squares", bias=Bias())
    np.testing.assert_allclose(track.fixes.position, fix.position, atol=1.0)
    np.testing.assert_allclose(track.fixes.sigma, fix.sigma, rtol=0.05)


@pytest.mark.parametrize("order", ["spatial-first", "temporal-first"])
def test_a_few_elevations_tell_the_height_of_the_path(order):
    stations = on_the_earth(elevation_sigma=0.02)
    azimuth, elevation = angles(stations)
    azimuth = noisy(8, stations)
    rare = np.full(azimuth.shape, np.nan)
    rare[5::10] = elevation[5::10] + 0.02 * np.random.default_rng(9).standard_normal((6, 4))
    track = reconstruct(stations, TIME, azimuth=azimuth, elevation=rare, order=order)
    error = np.abs(track.position - PATH) / track.sigma
    assert np.max(error[5:56]) < 5
    assert np.max(track.sigma[5:56, :2]) < 60
    alone = np.isnan(rare).all(axis=1) & np.asarray(track.fixes.success)
    if order == "spatial-first":
        assert np.isnan(track.fixes.position[alone, 2]).all()
        assert np.isfinite(track.fixes.position[5::10]).all()
        assert np.max(track.sigma[5:56, 2]) < 200


def test_too_few_elevations_for_a_height_are_an_error():
    stations = on_the_earth(elevation_sigma=0.02)
    _, elevation = angles(stations)
    rare = np.full(elevation.shape, np.nan)
    rare[30] = elevation[30]
    with pytest.raises(ValueError, match="height of the path is not determined: at 59 of 60"):
        reconstruct(stations, TIME, azimuth=noisy(10, stations), elevation=rare)


def test_azimuths_about_inclined_axes_tell_a_height():
    """Like those of aircraft that bank."""
    turns = Rotation.from_euler("xy", [[0.6, 0.0], [0.0, 0.7], [-0.6, 0.3], [0.4, -0.5]])
    stations = [
        Station(place, axes=axes, azimuth_sigma=SIGMA)
        for place, axes in zip(PLACES, turns.as_matrix(), strict=True)
    ]
    track = reconstruct(stations, TIME, azimuth=noisy(11, stations))
    error = np.abs(track.position - PATH) / track.sigma
    assert np.max(error) < 5
    assert np.max(track.sigma[10:50]) < 150
