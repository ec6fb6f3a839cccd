"""Paths with given heights of the target, as from a barometer."""

import warnings

import numpy as np
import pytest
from checks import WITHIN_95

from tertia import metrics
from tertia.location import LIGHT, locate
from tertia.sensors import Bias, Station
from tertia.trajectory import reconstruct

N = 60
TIME = 2.0 * np.arange(N)
PATH = np.column_stack([-9000 + 170 * TIME, 4000 + 60 * TIME, 5000 + 8 * np.clip(TIME - 40, 0, 40)])
PLACES = np.array([[0, 40e3, 0], [45e3, -20e3, 0], [-40e3, -25e3, 0], [-35e3, 30e3, 0.0]])
RANGE, HEIGHT = 60.0, 30.0


def stations(count, **sigmas):
    every = sigmas or {"range_sigma": RANGE}
    return [Station(place, **every) for place in PLACES[:count]]


def ranges(rng, count, path=PATH):
    true = np.linalg.norm(path[:, np.newaxis] - PLACES[:count], axis=-1)
    return true + RANGE * rng.standard_normal((len(path), count))


def squares(track, path=PATH):
    return metrics.nees(track.position - path, track.covariance[:, :3, :3])


@pytest.mark.parametrize("count", [3, 4])
@pytest.mark.parametrize("spatial", ["robust", "least-squares"])
def test_a_single_instant_is_located_as_by_locate(count, spatial):
    given = {
        "range": ranges(np.random.default_rng(count), count, PATH[:1]),
        "height": PATH[0, 2] + 20.0,
        "height_sigma": HEIGHT,
    }
    track = reconstruct(stations(count), [0.0], **given, spatial=spatial)
    fix = locate(stations(count), **given, method=spatial, bias=Bias())
    np.testing.assert_allclose(track.position[0], fix.position[0], atol=1e-3)
    np.testing.assert_allclose(track.covariance[0, :3, :3], fix.covariance[0], rtol=1e-6)
    assert track.height_residual[0] == pytest.approx(
        (given["height"] - track.position[0, 2]) / HEIGHT, abs=1e-4
    )


def test_single_positions_of_a_path_are_those_of_locate():
    rng = np.random.default_rng(1)
    given = {
        "range": ranges(rng, 3),
        "height": np.where(np.arange(N) % 3, PATH[:, 2] + HEIGHT * rng.standard_normal(N), np.nan),
    }
    track = reconstruct(stations(3), TIME, **given, height_sigma=HEIGHT, bias=Bias())
    known = ~np.isnan(given["height"])
    fix = locate(
        stations(3),
        range=given["range"][known],
        height=given["height"][known] - track.height_bias,
        height_sigma=HEIGHT,
        bias=Bias(),
    )
    same = ~(track.outlier.range.any(axis=1) | track.height_outlier)[known]
    assert np.count_nonzero(same) > 30
    ours = track.fixes.position[known][same]
    np.testing.assert_allclose(ours, fix.position[same], atol=1e-3)
    np.testing.assert_array_equal(np.isnan(track.height_residual), ~known)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_heights_tell_on_which_side_of_the_stations_the_path_is(side):
    rng = np.random.default_rng(2)
    path = PATH * [1.0, 1.0, side]
    given = {"range": ranges(rng, 3, path), "height_sigma": HEIGHT}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        track = reconstruct(stations(3), TIME, **given, height=path[:, 2] + 20.0)
        # one in ten is enough
        few = np.where(np.arange(N) % 10 == 5, path[:, 2] + 20.0, np.nan)
        rare = reconstruct(stations(3), TIME, **given, height=few)
    for one in (track, rare):
        assert one.mirror_image is None
        assert np.max(np.abs(one.position - path) / one.sigma) < 5


def test_two_ranges_and_a_height_are_a_path_on_the_given_side():
    rng = np.random.default_rng(3)
    given = {"range": ranges(rng, 2), "height": PATH[:, 2] - 20.0, "height_sigma": HEIGHT}
    track = reconstruct(stations(2), TIME, **given, initial=PATH[0])
    assert np.max(np.abs(track.position - PATH) / track.sigma) < 5
    assert np.max(track.sigma) < 5 * RANGE
    # the other side of the vertical plane through the stations
    normal = np.array([PLACES[1, 1] - PLACES[0, 1], PLACES[0, 0] - PLACES[1, 0], 0.0])
    normal /= np.linalg.norm(normal)
    image = PATH - 2 * ((PATH - PLACES[0]) @ normal)[:, np.newaxis] * normal
    other = reconstruct(stations(2), TIME, **given, initial=image[0])
    assert np.max(np.abs(other.position - image) / other.sigma) < 5
    with pytest.raises(ValueError, match="mirror image, neither of which is above"):
        reconstruct(stations(2), TIME, **given)


@pytest.mark.parametrize("count", [2, 3])
def test_regions_contain_the_path_if_the_error_of_the_heights_lasts(count):
    """Heights with errors that are new at each instant would give sigmas of 30 m / sqrt(60)."""
    inside, up = [], []
    for seed in range(40):
        rng = np.random.default_rng(100 + seed)
        height = PATH[:, 2] + HEIGHT * rng.standard_normal()
        track = reconstruct(
            stations(count),
            TIME,
            range=ranges(rng, count),
            height=height,
            height_sigma=HEIGHT,
            bias=Bias(),
            initial=PATH[0],
        )
        inside.append(np.mean(squares(track) < WITHIN_95[3]))
        up.append(np.mean(np.abs(track.position[:, 2] - PATH[:, 2]) < 1.96 * track.sigma[:, 2]))
    assert np.mean(inside) > 0.9
    assert np.mean(up) > 0.88


def test_wrong_heights_are_left_out():
    rng = np.random.default_rng(5)
    height = PATH[:, 2] + HEIGHT * rng.standard_normal(N)
    wrong = rng.permutation(N)[:8]
    height[wrong] += rng.choice([-1, 1], 8) * rng.uniform(400, 3000, 8)
    given = {"range": ranges(rng, 4), "height_sigma": HEIGHT}
    track = reconstruct(stations(4), TIME, **given, height=height)
    assert track.height_outlier[wrong].all()
    assert np.count_nonzero(track.height_outlier) <= 9
    assert np.min(np.abs(track.height_residual[wrong])) > 8
    assert np.max(np.abs(track.position - PATH) / track.sigma) < 5
    assert "measurements left out" in repr(track)
    right = np.ones(N, dtype=bool)
    right[wrong] = False
    np.testing.assert_allclose(
        track.height_residual[right],
        ((height - track.height_bias - track.position[:, 2]) / HEIGHT)[right],
        atol=1e-6,
    )


def test_heights_of_which_most_are_wrong_cause_a_warning():
    rng = np.random.default_rng(6)
    seen = ranges(rng, 4)
    height = PATH[:, 2] + HEIGHT * rng.standard_normal(N)
    wrong = rng.permutation(N)[:36]
    height[wrong] += rng.choice([-1, 1], 36) * rng.uniform(400, 3000, 36)
    with pytest.warns(UserWarning, match="36 of 60 heights contradict the path and are left out"):
        track = reconstruct(stations(4), TIME, range=seen, height=height, height_sigma=HEIGHT)
    assert np.flatnonzero(track.height_outlier).tolist() == sorted(wrong)
    assert np.max(np.abs(track.position - PATH) / track.sigma) < 5


def test_the_constant_error_of_heights_is_estimated():
    """Where the geometry tells heights, they are corrected."""
    rng = np.random.default_rng(7)
    path = np.column_stack([PATH[:, :2], np.full(N, 20e3)])
    places = PLACES * [0.3, 0.3, 1.0]
    true = np.linalg.norm(path[:, np.newaxis] - places, axis=-1)
    own = [Station(place, range_sigma=10.0) for place in places]
    seen = true + 10.0 * rng.standard_normal(true.shape)
    height = path[:, 2] + 140.0 + 5.0 * rng.standard_normal(N)
    track = reconstruct(own, TIME, range=seen, height=height, height_sigma=100.0, bias=Bias())
    # a part of it is taken for a drift
    assert 60.0 < track.height_bias < 160.0
    assert abs(track.height_bias - 140.0) < 2 * track.height_bias_sigma < 200.0
    assert np.max(np.abs(track.position - path) / track.sigma) < 5
    assert np.max(track.sigma[:, 2]) < 50.0


def test_heights_that_are_all_missing_are_none():
    seen = ranges(np.random.default_rng(8), 4)
    missing = {"height": np.full(N, np.nan), "height_sigma": np.full(N, np.nan)}
    with pytest.warns(UserWarning, match="mirror image below"):
        track = reconstruct(stations(4), TIME, range=seen, **missing)
    with pytest.warns(UserWarning, match="mirror image below"):
        other = reconstruct(stations(4), TIME, range=seen)
    np.testing.assert_array_equal(track.position, other.position)
    np.testing.assert_array_equal(track.covariance, other.covariance)
    assert track.height_residual is track.height_outlier is track.height_bias is None


def test_heights_belong_to_the_instants_whatever_the_clocks_are():
    rng = np.random.default_rng(9)
    late = np.array([3.1, -1.7, 0.0, 4.4])

    def at(times):
        return np.column_stack([np.interp(times, TIME, PATH[:, i]) for i in range(3)])

    shifted = np.stack([at(TIME - by) for by in late])
    seen = np.linalg.norm(shifted - PLACES[:, np.newaxis], axis=-1).T + RANGE * rng.standard_normal(
        (N, 4)
    )
    track = reconstruct(
        stations(4),
        TIME,
        range=seen,
        height=PATH[:, 2],
        height_sigma=3.0,
        bias=Bias(time=late),
    )
    inner = slice(4, N - 4)
    assert np.max(np.abs(track.height_residual[inner])) < 5
    assert np.max(np.abs(track.position - PATH)[inner] / track.sigma[inner]) < 5
    assert track.height_outlier.shape == (N,)


def test_azimuths_and_heights_are_a_path_in_space():
    rng = np.random.default_rng(10)
    away = PATH[:, np.newaxis] - PLACES
    azimuth = np.arctan2(away[..., 0], away[..., 1]) + 0.005 * rng.standard_normal((N, 4))
    own = stations(4, azimuth_sigma=0.005)
    track = reconstruct(own, TIME, azimuth=azimuth, height=PATH[:, 2] + 10.0, height_sigma=HEIGHT)
    assert np.max(np.abs(track.position - PATH) / track.sigma) < 5
    assert np.isfinite(track.fixes.position).all()
    assert np.max(track.sigma[:, 2]) < 60.0


@pytest.mark.parametrize(
    ("given", "error", "match"),
    [
        ({"height": 1.0}, ValueError, "height_sigma is missing"),
        ({"height_sigma": 1.0}, ValueError, "height is missing"),
        ({"height": np.ones(3), "height_sigma": 1.0}, ValueError, r"shape \(3,\); it must be \(\)"),
        ({"height": 1.0, "height_sigma": np.ones(3)}, ValueError, r"height_sigma has shape \(3,\)"),
        ({"height": np.inf, "height_sigma": 1.0}, ValueError, "height is inf; it must be a finite"),
        ({"height": 1.0, "height_sigma": 0.0}, ValueError, "height_sigma is 0.0; it must be a pos"),
        (
            {"height": 1.0, "height_sigma": np.where(np.arange(N) == 4, np.nan, 1.0)},
            ValueError,
            r"height_sigma\[4\] is nan",
        ),
        ({"height": "high", "height_sigma": 1.0}, TypeError, "height has dtype"),
        (
            {"height": 1.0, "height_sigma": 1.0, "order": "temporal-first"},
            ValueError,
            "height needs order 'spatial-first' and smoother 'rts'",
        ),
        (
            {"height": 1.0, "height_sigma": 1.0, "smoother": "local-polynomial"},
            ValueError,
            "height needs order 'spatial-first' and smoother 'rts'",
        ),
        (
            {"height": 1.0, "height_sigma": 1.0, "bias": Bias(range_sigma=np.inf)},
            ValueError,
            "bias has a sigma of inf, which excludes height",
        ),
    ],
)
def test_wrong_input_is_an_error(given, error, match):
    with pytest.raises(error, match=match):
        reconstruct(stations(4), TIME, range=ranges(np.random.default_rng(11), 4), **given)


def test_heights_need_three_dimensions():
    flat = [Station(place[:2], range_sigma=RANGE) for place in PLACES]
    seen = ranges(np.random.default_rng(12), 4)
    with pytest.raises(ValueError, match="height needs stations with three coordinates"):
        reconstruct(flat, TIME, range=seen, height=1.0, height_sigma=1.0)


def late_arrivals(seed, share):
    """Return receivers, times, positions and arrivals (s), of which this share is late."""
    rng, n = np.random.default_rng(seed), 100
    places = np.column_stack([rng.uniform(-30e3, 30e3, (6, 2)), rng.uniform(0, 800, 6)])
    time = np.sort(rng.uniform(0, n, n))
    speed, course = rng.uniform(100, 240), rng.uniform(0, 6.28)
    velocity = speed * np.column_stack([np.sin(course), np.cos(course)])
    way = rng.uniform(-15e3, 15e3, 2) + (time - time[0])[:, np.newaxis] * velocity
    up = 3000 + 8 * time * rng.choice([0, 1]) + rng.uniform(0, 6000)
    path = np.column_stack([way, up])
    # draws of clocks that are right
    rng.standard_normal(12)
    arrival = time[:, np.newaxis] + np.linalg.norm(path[:, np.newaxis] - places, axis=-1) / LIGHT
    arrival += 30e-9 * rng.standard_normal(arrival.shape)
    arrival += (rng.random(arrival.shape) < share) * rng.exponential(1e-6, arrival.shape)
    arrival[rng.random(arrival.shape) < 0.1] = np.nan
    return [Station(place, arrival_time_sigma=30e-9) for place in places], time, path, arrival


def test_a_location_far_from_those_before_and_after_is_not_followed():
    receivers, time, path, arrival = late_arrivals(2, 0.1)
    track = reconstruct(receivers, time, arrival_time=arrival, height=path[:, 2], height_sigma=10.0)
    assert np.max(np.abs(track.position - path)) < 50.0
    assert not np.any(track.height_outlier)


def test_a_lasting_error_of_heights_does_not_shrink_with_the_noise_of_ranges():
    rng = np.random.default_rng(8)
    given = {"range": ranges(rng, 4), "height": PATH[:, 2], "height_sigma": 3 * HEIGHT}
    right, large = (
        reconstruct(stations(4, range_sigma=factor * RANGE), TIME, **given) for factor in (1, 3)
    )
    sigmas = [np.median(np.sqrt(track.covariance[:, 2, 2])) for track in (right, large)]
    assert sigmas[1] > 0.95 * sigmas[0]
