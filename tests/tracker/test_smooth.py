"""Tracks by all their plots."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from checks import assert_covariance, assert_refused, assert_threads, in_region, rng
from numpy.testing import assert_allclose, assert_array_equal
from tracker.flights import RADAR, line, noisy, turning_flight

from tertia import metrics
from tertia.sensors import Bias
from tertia.sensors._sensors import own_biases
from tertia.tracker import (
    CvModel,
    Longitudinal,
    Plots,
    Radar,
    SmoothedTracks,
    Transversal,
    Vertical,
    smooth_tracks,
    track,
)
from tertia.tracker._errors import without_values

SECOND = Radar(
    position=(30e3, 10e3), range_sigma=75.0, azimuth_sigma=np.radians(0.1), scan_period=6.0
)
# without systematic errors
BOTH = [replace(one, bias=Bias()) for one in (RADAR, SECOND)]


def turning(seed=0, **options):
    """Times, positions and velocities of a flight with a turn, and its plots."""
    time, position, velocity = turning_flight(**options)
    plots = Plots(time, *noisy(position, RADAR, rng(1, seed)))
    return time, position, velocity, plots


def two_radars(seed=0):
    """Plots of two radars of one flight with a turn, its times and positions."""
    columns = []
    for k, radar in enumerate((RADAR, SECOND)):
        time, position, _ = turning_flight(int(240 / radar.scan_period), radar.scan_period)
        seen = noisy(position - radar.position[:2], radar, rng(2, seed, k))
        columns.append((time, *seen, np.full(len(time), k), position))
    time, distance, azimuth, sensor, position = (
        np.concatenate(one) for one in zip(*columns, strict=True)
    )
    order = np.argsort(time, kind="stable")
    plots = Plots(time[order], distance[order], azimuth[order], sensor=sensor[order])
    return plots, position[order]


def state(table):
    return np.hstack([table.position, table.velocity])


def squared(error, rows=slice(None)):
    return np.mean(np.sum(error[rows] ** 2, axis=-1))


def least_squares(plots, sigma, last=None):
    """Positions and velocities of all plots at once, of straight flight: dense.

    What nothing is known of has a sigma of 30 km and 300 m/s: at the first plot about it and the
    rates of those of half a minute, at the last one about `last`.
    """
    z, r = plots.to_cartesian([RADAR])
    early = plots.time - plots.time[0] <= 30.0
    since = (plots.time - plots.time[0])[early]
    rate = since @ (z[early] - z[0]) / (since @ since)
    weak = np.diag([30e3**-2, 30e3**-2, 300.0**-2, 300.0**-2])
    n, q = len(z), sigma**2 * 4.0
    information, h = np.zeros((4 * n, 4 * n)), np.zeros(4 * n)
    information[:4, :4] += weak
    h[:4] += weak @ np.r_[z[0], rate]
    if last is not None:
        information[-4:, -4:] += weak
        h[-4:] += weak @ last
    for k in range(n):
        own = slice(4 * k, 4 * k + 2)
        information[own, own] += np.linalg.inv(r[k])
        h[own] += np.linalg.solve(r[k], z[k])
    for k, t in enumerate(np.diff(plots.time)):
        noise = q * np.kron([[t**3 / 3, t**2 / 2], [t**2 / 2, t]], np.eye(2))
        step = np.hstack([-np.kron([[1, t], [0, 1]], np.eye(2)), np.eye(4)])
        both = slice(4 * k, 4 * k + 8)
        information[both, both] += step.T @ np.linalg.solve(noise, step)
    covariance = np.linalg.inv(information)
    blocks = [covariance[4 * k : 4 * k + 4, 4 * k : 4 * k + 4] for k in range(n)]
    return (covariance @ h).reshape(n, 4), np.array(blocks)


def test_one_model_is_least_squares_of_all_plots():
    plots = line(60)
    tracks = track(plots, [RADAR], motion="cv")
    found = smooth_tracks(plots, [RADAR], tracks, motion=CvModel(0.3))
    assert not np.any(found.outlier)
    filtered = least_squares(plots, 0.3)
    both = least_squares(plots, 0.3, filtered[0][-1])
    # the last state is that of the filter
    for expected, rows in ((filtered, slice(-1, None)), (both, slice(-1))):
        mean, covariance = (values[rows] for values in expected)
        assert_allclose(state(found)[rows], mean, rtol=1e-9)
        scale = np.sqrt(np.einsum("nii->ni", covariance))
        off = found.covariance[rows] - covariance
        assert np.max(np.abs(off / scale[:, :, np.newaxis] / scale[:, np.newaxis])) < 1e-9
    # one filter and the smoother of Rauch, Tung and Striebel know nothing of `last`
    assert_allclose(state(found), filtered[0], rtol=1e-9)


def test_times_change_nothing_at_plots():
    plots = two_radars()[0]
    few = smooth_tracks(plots, BOTH)
    many = smooth_tracks(plots, BOTH, time=plots.time, every=0.7)
    own = many[many.plot >= 0]
    for name in ("time", "position", "velocity", "covariance", "turn_probability", "innovation"):
        assert_array_equal(getattr(own, name), getattr(few, name))
    assert len(many) > 2 * len(few)
    assert np.all(np.diff(many.time) >= 0.0)
    assert_allclose(np.unique(np.round(many.time[many.plot < 0] / 0.7, 9) % 1.0), 0.0)
    between = many.plot < 0
    assert_array_equal(many.sensor[between], -1)
    assert np.all(np.isnan(many.innovation[between]))


def test_smoothing_is_the_same_backwards_in_time():
    plots = turning()[3]
    back = plots[::-1]
    object.__setattr__(back, "time", -back.time)
    one, two = (smooth_tracks(own, [RADAR]) for own in (plots, back))
    sigma = np.sqrt(np.einsum("nii->ni", one.covariance))
    turned = state(two[::-1]) * [1.0, 1.0, -1.0, -1.0]
    inner = slice(10, -10)
    # changes from turn to speed change and back are as frequent; turns and speed changes are not
    assert np.max(np.abs(state(one) - turned)[inner] / sigma[inner]) < 0.02
    one, two = (
        smooth_tracks(own, [RADAR], track(own, [RADAR]), motion=CvModel(1.0))
        for own in (plots, back)
    )
    turned = state(two[::-1]) * [1.0, 1.0, -1.0, -1.0]
    assert np.max(np.abs(state(one) - turned)[inner] / sigma[inner]) < 1e-3


def test_a_turn_is_known_afterwards():
    before, after, nees, right = [], [], [], []
    for seed in range(12):
        time, position, _, plots = turning(seed)
        tracks = track(plots, [RADAR])
        found = smooth_tracks(plots, [RADAR], tracks)
        rows = slice(10, None)
        error = found.position - position[found.plot]
        before.append(squared(tracks.position - position[tracks.plot], rows))
        after.append(squared(error, rows))
        nees.append(np.mean(metrics.nees(error, found.covariance[:, :2, :2])) / 2)
        turns = (time > 80.0) & (time < 160.0)
        right.append(np.mean((found.turn_probability > 0.5) == turns[found.plot]))
        middle = found[(found.time > 100) & (found.time < 140)]
        # the flight turns to the left
        assert_array_equal(middle.transversal, Transversal.LEFT_TURN)
        assert_allclose(middle.turn_rate, -0.035, atol=0.012)
    assert np.sqrt(np.mean(after) / np.mean(before)) < 0.6
    assert 0.6 < np.mean(nees) < 1.3
    assert np.mean(right) > 0.9


def test_a_change_of_speed_is_known_afterwards():
    time = np.arange(0.0, 400.0, 4.0)
    slower = np.clip(time - 150.0, 0.0, 80.0)
    way = 220.0 * time - 0.25 * slower**2 - 0.5 * slower * np.clip(time - 230.0, 0.0, None)
    position = np.array([20e3, 10e3]) + np.outer(way, [0.6, 0.8])
    plots = Plots(time, *noisy(position, RADAR, rng(3)))
    found = smooth_tracks(plots, [RADAR])
    middle = found[(found.time > 170) & (found.time < 210)]
    assert_array_equal(middle.longitudinal, Longitudinal.DECREASING_SPEED)
    assert_allclose(middle.acceleration, -0.5, atol=0.25)
    steady = found[(found.time > 60) & (found.time < 110)]
    assert_array_equal(steady.longitudinal, Longitudinal.CONSTANT_SPEED)


def test_heights():
    time = np.arange(0.0, 400.0, 4.0)
    squares = []
    for k, level in enumerate(rng(4).uniform(3000.0, 3300.0, 20)):
        height = level + 7.0 * np.clip(time - 120.0, 0.0, 160.0)
        reported = np.round(height / 30.48) * 30.48
        reported[40] += 2000.0
        reported[:3] = np.nan
        ground = np.hypot(20e3 + 200.0 * time, height)
        found = smooth_tracks(Plots(time, ground, 0.5, height=reported), [RADAR])
        known = found[3:]
        assert np.all(np.isnan(found.height[:3]))
        assert_array_equal(found.vertical[:3], Vertical.UNDETERMINED)
        squares.append(((known.height - height[3:]) / known.height_sigma) ** 2)
        if k == 0:
            climbing = known[(known.time > 140) & (known.time < 260)]
            assert_array_equal(climbing.vertical, Vertical.CLIMB)
            assert_allclose(climbing.vertical_rate, 7.0, atol=1.5)
            level_flight = known[(known.time > 20) & (known.time < 100)]
            assert_array_equal(level_flight.vertical, Vertical.LEVEL)
    assert 0.5 < np.mean(squares) < 1.2


def test_turns_of_three_g_keep_their_plots():
    """Sharper manoeuvres are assumed where usual ones leave out plots, not where outliers do."""
    inside, left_out = [], []
    for seed in range(6):
        _, position, _, plots = turning(seed, speed=220.0, rate=0.13)
        smoothed = smooth_tracks(plots, [RADAR])
        error = smoothed.position - position[smoothed.plot]
        inside.append(in_region(error, smoothed.covariance[:, :2, :2]))
        left_out.append(smoothed.outlier)
    assert np.mean(np.concatenate(inside)) > 0.88
    assert np.mean(np.concatenate(left_out)) < 0.03


def test_a_gap_is_bridged_with_a_covariance_that_grows():
    squares, growth = [], []
    for seed in range(20):
        time, position, _, plots = turning(seed, rate=0.0)
        kept = (time <= 88.0) | (time >= 148.0)
        own = plots[kept]
        tracks = track(own, [RADAR], coasting=30)
        found = smooth_tracks(own, [RADAR], tracks, every=4.0)
        gap = found[(found.time > 88.0) & (found.time < 148.0)]
        assert len(gap) == 14
        error = gap.position - position[(time > 88.0) & (time < 148.0)]
        squares.append(np.mean(metrics.nees(error, gap.covariance[:, :2, :2])) / 2)
        spread = np.trace(gap.covariance[:, :2, :2], axis1=1, axis2=2)
        growth.append(spread[7] / spread[0])
        assert_allclose(gap.gap, np.minimum(gap.time - 88.0, 148.0 - gap.time))
    assert np.mean(squares) < 1.3
    assert np.mean(growth) > 1.0


def test_an_excluded_sensor_has_rows_and_no_weight():
    plots, _ = two_radars()
    both = BOTH
    tracks = track(plots, both)
    found = smooth_tracks(plots, both, tracks, exclude=1)
    assert np.any(found.sensor == 1)
    alone = smooth_tracks(plots, both, tracks[tracks.sensor == 0], time=plots.time)
    by_time = dict(zip(alone.time.tolist(), alone.position.tolist(), strict=True))
    for time, place in zip(found.time.tolist(), found.position.tolist(), strict=True):
        assert_allclose(place, by_time[time], rtol=1e-12)
    rows = found[found.sensor == 1]
    nis = metrics.nees(rows.innovation, rows.innovation_covariance)
    assert 1.2 < np.mean(nis) < 2.8
    assert not np.any(rows.outlier)


def test_the_errors_of_an_excluded_sensor_are_not_those_of_the_states():
    plots, _ = two_radars()[:2]
    tracks = track(plots, BOTH)

    class Known(Registered):
        def __init__(self, sensors):
            super().__init__(sensors)
            # the azimuths of the second sensor are unknown by 10 degrees
            self.covariance[6, 6] = np.radians(10.0) ** 2

    found = [
        smooth_tracks(plots, BOTH, tracks, registration=Known(BOTH), exclude=one)
        for one in (None, 1)
    ]
    sigmas = [
        np.sqrt(np.median(one.covariance[:, 0, 0] + one.covariance[:, 1, 1])) for one in found
    ]
    assert sigmas[0] > 1000.0 > 10.0 * sigmas[1]


def test_an_outlier_is_left_out():
    plots = turning(5)[3]
    tracks = track(plots, [RADAR])
    clean = smooth_tracks(plots, [RADAR], tracks)
    far = plots[:]
    far.range[45] += 700.0
    found = smooth_tracks(far, [RADAR], tracks)
    assert 45 in found.plot[found.outlier]
    assert np.max(np.abs(found.position - clean.position)) < 60.0
    assert np.sum(clean.outlier) <= 1


def test_tracks_of_one_identity_are_joined():
    time = np.r_[np.arange(0.0, 100.0, 4.0), np.arange(200.0, 300.0, 4.0)]
    position = np.array([10e3, 30e3]) + np.outer(time, [120.0, -80.0])
    named = Plots(time, *noisy(position, RADAR, rng(6)), identity=4660)
    tracks = track(named, [RADAR])
    assert len(np.unique(tracks.track)) == 2
    found = smooth_tracks(named, [RADAR], tracks, every=10.0)
    assert_array_equal(np.unique(found.track), [1])
    between = found[(found.time > 100) & (found.time < 200)]
    assert len(between) > 8
    assert np.max(between.gap) >= 45.0
    # which many targets have
    visual = Plots(time, named.range, named.azimuth, mode_3a=0o7000)
    visual_tracks = track(visual, [RADAR])
    assert len(np.unique(smooth_tracks(visual, [RADAR], visual_tracks).track)) == 2
    nobody = Plots(time, named.range, named.azimuth)
    apart = smooth_tracks(nobody, [RADAR], track(nobody, [RADAR]))
    assert len(np.unique(apart.track)) == 2
    # two at once with one identity are two targets
    second = Plots(time, *noisy(position + np.array([15e3, 0.0]), RADAR, rng(7)), identity=4660)
    both = [np.concatenate([getattr(one, name) for one in (named, second)]) for name in POLAR]
    twice = Plots(*both, identity=4660)
    assert len(np.unique(smooth_tracks(twice, [RADAR]).track)) == 4


POLAR = ("time", "range", "azimuth")


def test_tracks_that_share_a_target_for_some_scans_are_joined():
    plots = two_radars(3)[0]
    named = replace(plots, identity=np.full(len(plots), 4660))
    whole = track(named, BOTH)
    whole = whole[whole.plot >= 0]
    at = np.arange(len(whole))
    number = np.where((at > 48) | ((at > 40) & (at % 2 == 1)), 2, 1)
    parts = replace(whole, track=number)
    expected = smooth_tracks(named, BOTH, whole)
    found = smooth_tracks(named, BOTH, parts)
    assert_array_equal(found.track, 1)
    for name in ("time", "position", "covariance"):
        assert_array_equal(getattr(found, name), getattr(expected, name))
    # not where plots are farther apart than aircraft fly
    far = replace(parts, position=parts.position + 40e3 * (number == 2)[:, np.newaxis])
    assert len(np.unique(smooth_tracks(named, BOTH, far).track)) == 2


def test_plots_that_waited_are_taken_at_their_own_times():
    plots = two_radars(4)[0]
    tracks = track(plots, BOTH)
    tracks = tracks[tracks.plot >= 0]
    expected = smooth_tracks(plots, BOTH, tracks)
    late = replace(tracks, time=tracks.time + 3.0 * (tracks.sensor == 1))
    found = smooth_tracks(plots, BOTH, late)
    assert_array_equal(found.time, plots.time[found.plot])
    assert_array_equal(found.position, expected.position)
    # clocks that began again are continuous in tracks
    after = smooth_tracks(plots, BOTH, replace(tracks, time=tracks.time + 86400.0))
    assert_allclose(after.time, expected.time + 86400.0)
    assert_allclose(after.position, expected.position)


def test_the_velocity_of_a_short_track_is_as_uncertain_as_its_plots():
    radar = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.5), scan_period=4.0)
    time, squares = 4.0 * np.arange(3), []
    for seed in range(40):
        random = rng(seed)
        azimuth = np.radians(0.5) * random.standard_normal(3)
        plots = Plots(time, 2e5 + 200.0 * time, azimuth % (2 * np.pi), icao_address=[1, 1, 1])
        row = smooth_tracks(plots, [radar], track(plots, [radar]), motion=CvModel(0.1))[-1:]
        squares.append(row.velocity[0, 0] ** 2 / row.covariance[0, 2, 2])
    # across the line of sight, plots of 1.7 km say more than any prior knowledge of the velocity
    assert 0.6 < np.mean(squares) < 1.5


def test_biases_are_subtracted():
    plots = turning(8)[3]
    biased = [replace(RADAR, bias=Bias(range=400.0, time=1.0))]
    moved = Plots(plots.time + 1.0, plots.range + 400.0, plots.azimuth)
    expected = smooth_tracks(plots, [RADAR])
    found = smooth_tracks(moved, biased)
    assert_allclose(found.time, expected.time)
    assert_allclose(found.position, expected.position, rtol=1e-8)
    # found after tracking
    later = smooth_tracks(moved, [RADAR], track(moved, [RADAR]), registration=Registered(biased))
    assert_allclose(later.time, expected.time)
    assert_allclose(later.position, expected.position, rtol=1e-8)


class Registered:
    """What is used of a registration."""

    def __init__(self, sensors):
        self.sensors = sensors
        self.covariance = np.zeros((4 * len(sensors), 4 * len(sensors)))
        self.deviation_covariance = None

    def _removed(self, plots):
        bias = own_biases(self.sensors)
        return bias.correct(plots), without_values(self.sensors, bias)


def test_plots_of_one_time_have_one_state():
    plots = two_radars()[0]
    found = smooth_tracks(plots, BOTH)
    same = np.flatnonzero(np.diff(found.time) == 0.0)
    assert len(same) > 10
    assert_array_equal(found.position[same], found.position[same + 1])
    assert_array_equal(found.covariance[same], found.covariance[same + 1])
    assert np.all(found.innovation[same] != found.innovation[same + 1])


def test_the_last_state_is_that_of_the_filter_and_not_final():
    _, _, _, plots = turning()
    found = smooth_tracks(plots, [RADAR])
    assert_array_equal(found.final, found.time <= found.time[-1] - 30.0)
    longer = Plots(
        *(np.append(getattr(plots, name), getattr(plots, name)[-1] + step) for name, step in STEPS)
    )
    again = smooth_tracks(longer, [RADAR])
    sigma = np.sqrt(np.einsum("nii->ni", found.covariance))
    change = np.abs(state(again)[: len(found)] - state(found)) / sigma
    assert np.max(change[found.final]) < 0.6


STEPS = (("time", 4.0), ("range", 0.0), ("azimuth", 0.0))


def test_threads_arguments_and_errors():
    plots = Plots(
        *(
            np.concatenate([getattr(line(seed=k, start=k), name) for k in range(3)])
            for name in POLAR
        )
    )
    plots = plots[np.argsort(plots.time)]
    plots.range[::3] += 20e3
    tracks = track(plots, [RADAR])
    assert_threads(partial(smooth_tracks, plots, [RADAR], tracks, every=1.0))
    assert isinstance(smooth_tracks(plots, [RADAR]), SmoothedTracks)
    empty = smooth_tracks(Plots([], [], []), [RADAR])
    assert len(empty) == 0
    assert empty.covariance.shape == (0, 4, 4)
    for options, error, text in (
        ({"motion": "singer"}, ValueError, "motion"),
        ({"motion": 3}, TypeError, "motion"),
        ({"exclude": 1}, ValueError, "exclude is 1"),
        ({"every": 0.0}, ValueError, "every"),
        ({"every": 1e-9}, ValueError, "every"),
        ({"time": [np.nan]}, ValueError, "time"),
        ({"registration": Registered([RADAR, RADAR])}, ValueError, "registration"),
        ({"registration": 3}, TypeError, "registration"),
        ({"tracks": 3}, TypeError, "tracks"),
    ):
        assert_refused(lambda o=options: smooth_tracks(plots, [RADAR], **o), error, text)
    with pytest.raises(ValueError, match="tracks has plot"):
        smooth_tracks(plots[:3], [RADAR], tracks)
    with pytest.raises(TypeError, match="plots"):
        smooth_tracks(tracks, [RADAR])


def test_covariances_are_symmetric_to_the_last_bit():
    plots, _ = two_radars()
    assert_covariance(smooth_tracks(plots, BOTH).covariance)
