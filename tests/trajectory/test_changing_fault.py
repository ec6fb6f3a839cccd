"""Paths of which one station is wrong by an error that changes, and repeated measurements."""

import numpy as np
import pytest
from checks import in_region
from numpy.testing import assert_allclose, assert_array_equal

from tertia.location import Station
from tertia.sensors import Bias
from tertia.trajectory import reconstruct

SIGMA = 10.0
LIGHT = 299792458.0
TIME = 2.0 * np.arange(100)
LONG = 2.0 * np.arange(400)
PLACES = np.array(
    [[0, 0], [8e3, 0], [0, 8e3], [8e3, 8e3], [4e3, -3e3], [-3e3, 4e3], [11e3, 4e3], [4e3, 11e3]]
)


def scene(seed, count, time=TIME):
    """Return places of stations, a path between them, and ranges with noise."""
    rng = np.random.default_rng([31, seed])
    course = rng.uniform(0, 2 * np.pi) + np.cumsum(0.03 * rng.standard_normal(time.size))
    path = 4e3 + np.cumsum(30.0 * np.column_stack([np.sin(course), np.cos(course)]), axis=0)
    places = PLACES[:count]
    ranges = np.linalg.norm(path[:, np.newaxis] - places, axis=-1)
    return places, path, ranges + SIGMA * rng.standard_normal(ranges.shape)


def wrong(ranges, path, fault):
    """Return the ranges of which those of the third station have a fault."""
    ranges = ranges.copy()
    if fault == "stuck at noise":
        ranges[:, 2] = np.random.default_rng(5).normal(3e3, SIGMA, TIME.size)
    elif fault == "position":
        ranges[:, 2] = np.linalg.norm(path - PLACES[2] - [3e3, 0], axis=-1)
    else:
        ranges[:, 2] *= fault
    return ranges


def quality(track, path):
    """Return the RMSE and the share of positions inside the 95 % region."""
    error = track.position - path
    inside = in_region(error, track.covariance[:, :2, :2])
    return np.sqrt(np.mean(np.sum(error**2, axis=-1))), np.mean(inside)


def stations(places, **options):
    return [Station(place, range_sigma=SIGMA, **options) for place in places]


# kilometres or feet read as metres, metres read as feet, a wrong scale
@pytest.mark.parametrize("fault", [1e-3, 1 / 0.3048, 0.3048, 1.5, "position", "stuck at noise"])
@pytest.mark.parametrize("count", [5, 8])
def test_a_station_that_contradicts_all_others_is_left_out(fault, count):
    figures = []
    for seed in range(4):
        places, path, ranges = scene(seed, count)
        ranges = wrong(ranges, path, fault)
        track = reconstruct(stations(places), TIME, range=ranges)
        assert track.outlier.range[:, 2].all()
        assert np.isfinite(track.residual.range).all()
        others = np.delete(track.outlier.range, 2, axis=1)
        assert np.mean(others) < 0.05
        # the error that the station has on average
        error = ranges[:, 2] - np.linalg.norm(path - places[2], axis=-1)
        assert abs(track.bias.range[2] - np.median(error)) < 20.0
        assert track.bias.range_sigma[2] > 5 * SIGMA
        figures.append(quality(track, path))
    rmse, share = np.transpose(figures)
    # the path was wrong by up to kilometres, and its regions by many sigmas
    assert np.max(rmse) < 8.0
    assert np.mean(share) > 0.85


@pytest.mark.parametrize("fault", [1e-3, 1 / 0.3048])
def test_four_stations_of_which_one_is_grossly_wrong(fault):
    for seed in range(4):
        places, path, ranges = scene(seed, 4)
        track = reconstruct(stations(places), TIME, range=wrong(ranges, path, fault))
        assert track.outlier.range[:, 2].all()
        # the path was wrong by kilometres, or no instant was located
        assert quality(track, path)[0] < 15.0


@pytest.mark.parametrize("fault", [1.3, "position", "stuck at noise"])
@pytest.mark.parametrize("contamination", [0.0, 0.05])
def test_four_stations_of_which_three_agree(fault, contamination):
    for seed in range(4):
        places, path, ranges = scene(seed, 4)
        ranges = wrong(ranges, path, fault)
        rng = np.random.default_rng([35, seed])
        is_outlier = rng.random(ranges.shape) < contamination * (np.arange(4) != 2)
        ranges[is_outlier] += 300.0 * rng.standard_normal(np.count_nonzero(is_outlier))
        track = reconstruct(stations(places), TIME, range=np.abs(ranges))
        assert track.outlier.range[:, 2].all()
        # the path was wrong by 100 m to kilometres
        rmse, share = quality(track, path)
        assert rmse < 10.0
        assert share > 0.7


def test_constant_errors_of_four_stations_are_no_changing_error_of_one():
    """Without the second station, the bearings of the others nearly agree by chance."""
    rng = np.random.default_rng([90, 0])
    course = rng.uniform(0, 6.3) + np.cumsum(0.03 * rng.standard_normal(150))
    path = 4e3 + np.cumsum(30.0 * np.column_stack([np.sin(course), np.cos(course)]), axis=0)
    offset = path[:, np.newaxis] - PLACES[:4]
    errors = np.array([1.8, -14.0, 0.1, -3.1]) + rng.standard_normal((150, 4))
    azimuth = np.arctan2(offset[..., 0], offset[..., 1]) + np.radians(errors)
    own = [Station(place, azimuth_sigma=np.radians(1.0)) for place in PLACES[:4]]
    track = reconstruct(own, 2.0 * np.arange(150), azimuth=azimuth)
    assert not track.outlier.azimuth.all(axis=0).any()
    rmse, share = quality(track, path)
    # without the second station, the path was wrong by 290 m, and no position was inside
    assert rmse < 100.0
    assert share > 0.9


ANCHORS = np.array(
    [[0, 0, 0], [80, 0, 5], [0, 80, 10], [80, 80, 0], [40, -30, 12], [-30, 40, 3], [110, 40, 8.0]]
)


def walk(seed, fault):
    """Return the way of a tag between anchors near a plane, and ranges; one anchor may be wrong."""
    rng = np.random.default_rng([77, seed])
    course = rng.uniform(0, 6.3) + np.cumsum(0.03 * rng.standard_normal(120))
    time = 2.0 * np.arange(120)
    way = 40.0 + np.cumsum(0.3 * np.column_stack([np.sin(course), np.cos(course)]), axis=0)
    way = np.column_stack([way, 1.0 + 0.5 * np.sin(time / 30)])
    ranges = np.linalg.norm(way[:, np.newaxis] - ANCHORS, axis=-1)
    ranges += 0.1 * rng.standard_normal(ranges.shape)
    ranges[:, 2] += {"none": 0.0, "drift": time / 40, "scale": 0.3 * ranges[:, 2]}[fault]
    return time, way, ranges


@pytest.mark.filterwarnings("ignore:no path above the stations fits")
@pytest.mark.parametrize("fault", ["none", "drift", "scale"])
def test_anchors_near_a_plane(fault):
    """Seed 1: above the plane, there is only one of the positions of single instants."""
    for seed in range(4):
        time, way, ranges = walk(seed, fault)
        track = reconstruct([Station(p, range_sigma=0.1) for p in ANCHORS], time, range=ranges)
        assert track.outlier.range[:, 2].all() == (fault != "none")
        error = track.position - way
        # the path was wrong by metres, or known at one instant
        assert np.sqrt(np.mean(np.sum(error**2, axis=-1))) < 0.5
        inside = in_region(error, track.covariance[:, :3, :3])
        assert np.mean(inside) > 0.7


@pytest.mark.parametrize("count", [5, 8])
@pytest.mark.parametrize("fault", ["drift", "position"])
def test_the_first_receiver_of_differences_is_one_of_several(count, fault):
    figures = []
    for seed in range(8):
        places, path, ranges = scene(seed, count)
        if fault == "drift":
            ranges[:, 0] += 3.0 * TIME
        else:
            places = places + np.array([2e3, 1e3]) * (np.arange(count) == 0)[:, np.newaxis]
        own = [Station(place) for place in places]
        differences = ranges[:, 1:] - ranges[:, :1]
        with pytest.warns(UserWarning, match="first station contradicts the others"):
            track = reconstruct(
                own, TIME, range_difference=differences, range_difference_sigma=SIGMA * np.sqrt(2)
            )
        assert track.outlier.range_difference.all()
        assert np.isfinite(track.residual.range_difference).all()
        figures.append(quality(track, path))
    rmse, share = np.transpose(figures)
    # the path was wrong by 80 to 380 m
    assert np.max(rmse) < 10.0
    # without errors, the shares are 0.88 and 0.92
    assert np.mean(share) > 0.8


@pytest.mark.parametrize("count", [4, 6, 8])
def test_differences_that_contradict_ranges_are_left_out(count):
    """Of the wrong sign: whatever the emission is, one or two arrivals agree with it."""
    for seed in range(2, 6):
        places, _, ranges = scene(seed, count)
        own = stations(places)
        # another warning, that the first station is wrong, would be an error
        with (
            pytest.warns(UserWarning, match="would agree if they were the range of the first"),
            pytest.warns(UserWarning, match="all measurements of range_difference contradict"),
        ):
            track = reconstruct(
                own,
                TIME,
                range=ranges,
                range_difference=ranges[:, :1] - ranges[:, 1:],
                range_difference_sigma=SIGMA * np.sqrt(2),
            )
        assert track.outlier.range_difference.all()
        alone = reconstruct(own, TIME, range=ranges)
        assert_allclose(track.position, alone.position, rtol=0, atol=1e-6)
        assert_allclose(track.covariance, alone.covariance, rtol=1e-6)


def test_sigmas_of_single_differences():
    """Every third instant is ten times as accurate: below the usual error of the first receiver."""
    figures = []
    for seed in range(4):
        places, path, ranges = scene(seed, 6)
        exact = np.linalg.norm(path[:, np.newaxis] - places, axis=-1)
        factor = np.where(np.arange(TIME.size) % 3 == 0, 0.1, 1.0)[:, np.newaxis]
        received = exact + factor * (ranges - exact)
        track = reconstruct(
            [Station(place) for place in places],
            TIME,
            range_difference=received[:, 1:] - received[:, :1],
            range_difference_sigma=SIGMA * np.sqrt(2) * np.repeat(factor, 5, axis=1),
        )
        assert np.mean(track.outlier.range_difference[::3]) < 0.2
        figures.append(quality(track, path))
    rmse, share = np.transpose(figures)
    assert np.mean(rmse) < 3.0
    assert np.mean(share) > 0.85


@pytest.mark.parametrize("fault", ["drift", "position"])
def test_five_receivers_that_nearly_agree_without_either_of_two(fault):
    """Of seed 0, without the first or the second receiver; of seed 3, nearly without the first."""
    for seed, wrong_one in ((0, 0), (0, 2), (3, 0), (3, 2)):
        rng = np.random.default_rng(seed)
        places = rng.uniform(-2e4, 2e4, (5, 2))
        course = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.normal(0, 0.03, 60))
        steps = 150.0 * np.column_stack([np.cos(course), np.sin(course)])
        path = rng.uniform(-1.2e4, 1.2e4, 2) + np.cumsum(steps, axis=0)
        arrivals = np.linalg.norm(path[:, np.newaxis] - places, axis=-1)
        arrivals += rng.normal(0, SIGMA, arrivals.shape)
        if fault == "drift":
            arrivals[:, wrong_one] += np.linspace(0, 600, 60)
        else:
            places[wrong_one] += [600, 800]
        track = reconstruct(
            [Station(place) for place in places],
            4.0 * np.arange(60),
            arrival_time=arrivals / LIGHT,
            arrival_time_sigma=SIGMA / LIGHT,
        )
        assert track.outlier.arrival_time[:, wrong_one].all()
        # five of these eight paths were wrong by 90 to 910 m
        assert quality(track, path)[0] < 40.0


def test_differences_are_arrivals():
    """The same path, whichever receiver is the first; each difference has the error of its two."""
    places, _, ranges = scene(3, 6)
    ranges[10, 0] += 500.0
    ranges[20, 3] += 500.0
    tracks = []
    for first in (0, 4):
        order = [first, *(k for k in range(6) if k != first)]
        own = [Station(place) for place in places[order]]
        differences = ranges[:, order[1:]] - ranges[:, [first]]
        tracks.append(
            reconstruct(
                own, TIME, range_difference=differences, range_difference_sigma=SIGMA * np.sqrt(2)
            )
        )
    arrivals = (ranges - ranges[:, :1]) / LIGHT
    track = reconstruct(
        [Station(place) for place in places],
        TIME,
        arrival_time=arrivals,
        arrival_time_sigma=SIGMA / LIGHT,
    )
    for one in tracks:
        assert_allclose(one.position, track.position, rtol=0, atol=1e-6)
        assert_allclose(one.covariance, track.covariance, rtol=1e-6, atol=1e-9)
    outlier = track.outlier.arrival_time
    assert_array_equal(tracks[0].outlier.range_difference, outlier[:, 1:] | outlier[:, :1])
    residual = SIGMA * track.residual.arrival_time
    expected = (residual[:, 1:] - residual[:, :1]) / (SIGMA * np.sqrt(2))
    assert_allclose(tracks[0].residual.range_difference, expected, atol=1e-6)


def test_stations_without_systematic_errors():
    places, path, ranges = scene(1, 6)
    track = reconstruct(stations(places), TIME, range=wrong(ranges, path, 0.3048), bias=Bias())
    assert track.outlier.range[:, 2].all()
    assert quality(track, path)[0] < 8.0


def test_an_error_within_the_stated_size_is_not_left_out():
    places, _, ranges = scene(1, 6)
    ranges[:, 2] += 100.0 * np.sin(TIME / 15)
    bias = Bias(range_sigma=100.0, drift_share=1.0, drift_time=20.0)
    assert (
        not reconstruct(stations(places), TIME, range=ranges, bias=bias).outlier.range.all(0).any()
    )


def test_a_constant_error_is_estimated():
    places, _, ranges = scene(2, 6)
    ranges[:, 2] += 30.0
    track = reconstruct(stations(places), TIME, range=ranges)
    assert abs(track.bias.range[2] - 30.0) < 4 * track.bias.range_sigma[2]
    assert track.bias.range_sigma[2] < SIGMA


class TestRepeats:
    """Stations whose last measurement is reported again and again."""

    def held(self, seed, chance):
        """Return places, a path, and ranges that are often not renewed."""
        places, path, ranges = scene(seed, 4, LONG)
        again = np.random.default_rng([32, seed]).random(ranges.shape) < chance
        for t in range(1, LONG.size):
            ranges[t] = np.where(again[t], ranges[t - 1], ranges[t])
        again[0] = False
        return places, path, ranges, again

    @pytest.mark.parametrize(
        ("chance", "left_out", "error"),
        [
            # with the repeated ranges, no position was inside, and the path lagged by 40 m
            (0.6, 0.7, 20.0),
            # few are distinct: the differences of any two are large, but have no common step; the
            # path was wrong by 100 m
            (0.85, 0.9, 30.0),
        ],
    )
    def test_repeated_ranges_are_left_out(self, chance, left_out, error):
        figures = []
        for seed in range(6):
            places, path, ranges, again = self.held(seed, chance)
            track = reconstruct(stations(places), LONG, range=ranges)
            assert np.mean(track.outlier.range[again]) > left_out
            assert np.mean(track.outlier.range[~again]) < 0.05
            assert np.isfinite(track.residual.range).all()
            figures.append(quality(track, path))
        rmse, share = np.transpose(figures)
        assert np.max(rmse) < error
        assert np.mean(share) > 0.85

    def test_no_warning_that_most_are_left_out(self):
        places, _, ranges, again = self.held(3, 0.8)
        assert np.mean(again) > 0.7
        reconstruct(stations(places), LONG, range=ranges)  # warnings are errors

    def test_missing_rows_between(self):
        places, path, ranges, again = self.held(4, 0.3)
        ranges[::7] = np.nan
        track = reconstruct(stations(places), LONG, range=ranges)
        known = np.isfinite(ranges)
        assert np.mean(track.outlier.range[again & known]) > 0.8
        assert not track.outlier.range[~known].any()
        assert quality(track, path)[0] < 15.0

    def test_coarse_steps(self):
        places, _, ranges = scene(5, 4, LONG)
        coarse = 30.0 * np.round(ranges / 30.0)
        track = reconstruct(stations(places), LONG, range=coarse)
        assert np.mean(track.outlier.range) < 0.02

    @pytest.mark.parametrize("noise", [0.008, 0.012, 0.02])
    def test_a_tag_that_rests(self, noise):
        """At rest, ranges are equal by chance: their noise is much smaller than the stated one."""
        rng = np.random.default_rng(33)
        speed = np.where(np.arange(600) % 60 < 30, 0.08, 0.0)
        course = np.cumsum(0.1 * rng.standard_normal(600))
        path = np.cumsum(
            speed[:, np.newaxis] * np.column_stack([np.sin(course), np.cos(course)]), 0
        )
        places = 6.0 * np.array([[-1.0, -1], [1, -1], [-1, 1], [1, 1]])
        ranges = np.linalg.norm(path[:, np.newaxis] - places, axis=-1)
        count = np.round((ranges + noise * rng.standard_normal(ranges.shape)) / 0.00625345)
        # the last digit is not always rounded in the same way
        ranges = np.round(0.00625345 * count + 1e-5 * (rng.random(count.shape) < 0.05), 5)
        own = [Station(place, range_sigma=0.1) for place in places]
        track = reconstruct(own, 0.1 * np.arange(600.0), range=ranges)
        equal = np.concatenate([np.zeros((1, 4), bool), ranges[1:] == ranges[:-1]])
        assert np.mean(equal) > 0.05
        assert np.mean(track.outlier.range[equal]) < 0.2

    def test_equal_bearings_after_an_outlier(self):
        places, path, _ = scene(6, 5)
        rng = np.random.default_rng(34)
        offset = path[:, np.newaxis] - places
        azimuth = np.degrees(np.arctan2(offset[..., 0], offset[..., 1]))
        azimuth = 0.5 * np.round(2.0 * (azimuth + 5.0 * rng.standard_normal(azimuth.shape)))
        azimuth[::50, 1] += 60.0
        azimuth[2::50, 1] = azimuth[1::50, 1]
        own = [Station(place, azimuth_sigma=np.radians(5.0)) for place in places]
        track = reconstruct(own, TIME, azimuth=np.radians(azimuth))
        assert not track.outlier.azimuth[2::50, 1].any()


def changing(seed, part):
    """Return receivers, times of arrival of which the third are late by 20 sigmas there, a path."""
    places, path, ranges = scene(seed, 4)
    ranges[part, 2] += 20 * SIGMA
    receivers = [Station(place, arrival_time_sigma=SIGMA / LIGHT) for place in places]
    return receivers, TIME[:, np.newaxis] + ranges / LIGHT, path


def test_a_receiver_that_is_wrong_from_some_time_on_is_found_from_the_path():
    """One measurement is redundant, so any other receiver could be left out instead."""
    errors, shares, found = [], [], []
    for seed in range(6):
        receivers, arrival, path = changing(seed, slice(50, None))
        track = reconstruct(receivers, TIME, arrival_time=arrival)
        rmse, share = quality(track, path)
        errors.append(rmse)
        shares.append(share)
        left_out = track.outlier.arrival_time
        found.append(np.mean(left_out[50:, 2]) > 0.95 and np.mean(left_out[:50]) < 0.05)
    assert np.mean(found) > 0.8
    assert np.median(errors) < 10.0
    assert np.median(shares) > 0.85


def test_a_receiver_that_is_wrong_for_a_while_is_used_before_and_after():
    found = []
    for seed in range(4):
        receivers, arrival, _ = changing(20 + seed, slice(30, 70))
        track = reconstruct(receivers, TIME, arrival_time=arrival)
        left_out = track.outlier.arrival_time[:, 2]
        found.append(
            np.mean(left_out[30:70]) > 0.9
            and np.mean(left_out[[*range(28), *range(72, 100)]]) < 0.1
        )
    assert np.mean(found) > 0.7
