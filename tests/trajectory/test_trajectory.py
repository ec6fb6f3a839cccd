"""Trajectories against truth, the source's table, and what the measurements cannot tell."""

import re

import numpy as np
import pytest
from checks import assert_covariance, in_region
from places import DATA, difar
from scipy import stats
from scipy.spatial.transform import Rotation
from tolerances import CHANCE
from trajectory.scenes import (
    INSTANTS,
    KINDS,
    PLACES,
    SIGMA_A,
    SIGMA_R,
    SIGMAS,
    ideal,
    measure,
    network,
    turn,
)

from tertia import metrics
from tertia.sensors import Bias, Station
from tertia.trajectory import Trajectory, reconstruct

JERK = 1e-3
RUNS = 60
BIASES = {
    "range": np.array([20.0, -15.0, 5.0]),
    "azimuth": np.deg2rad([0.3, -0.5, 0.1]),
    "elevation": np.deg2rad([-0.2, 0.4, 0.3]),
}
# of station 0's ranges, in standard deviations, from instant 28 on
FAULTS = [(), (5,), (5, -5), (4, -6, 5), (5, 5, 5, 5)]
# the source's figure 2: the instants, and what the only station measured
SOURCE_I = np.arange(47, 57)
SOURCE_STATION = np.array([1.0, 1000.0, 2.0])
SOURCE_SIGMA = 50.0
IDEAL_R = [
    1174.0134, 1149.3656, 1131.257, 1121.334, 1120.7431,
    1131.1618, 1155.9935, 1201.6753, 1278.9189, 1403.3963,
]  # fmt: skip
REAL_R = [
    1188.856, 1141.1088, 1114.3564, 1335.2803, 778.8312,
    1379.6484, 1160.9711, 1162.57, 1236.0229, 1444.4121,
]  # fmt: skip
BOTH_ORDERS = pytest.mark.parametrize("order", ["spatial-first", "temporal-first"])
BOTH_SMOOTHERS = pytest.mark.parametrize("smoother", ["rts", "local-polynomial"])
BOTH_SPATIAL = pytest.mark.parametrize("spatial", ["robust", "least-squares"])


def estimated(*kinds):
    """Return constant biases of which nothing is known."""
    return Bias(**{f"{kind}_sigma": np.inf for kind in kinds})


ALL = estimated(*KINDS)


def restless(rng, times=INSTANTS, jerk=JERK):
    """Return positions, velocities and accelerations of a target with white jerk."""
    t = times[1] - times[0]
    transition = np.array([[1, t, t**2 / 2], [0, 1, t], [0, 0, 1]])
    noise = jerk * np.array(
        [
            [t**5 / 20, t**4 / 8, t**3 / 6],
            [t**4 / 8, t**3 / 3, t**2 / 2],
            [t**3 / 6, t**2 / 2, t],
        ]
    )
    root = np.linalg.cholesky(noise)
    states = np.zeros((len(times), 3, 3))
    states[0] = [[600, 1000, 600], [15, 8, 2], [0, 0.3, 0]]
    for i in np.arange(1, len(times)):
        states[i] = transition @ states[i - 1] + root @ rng.standard_normal((3, 3))
    return states[:, 0], states[:, 1], states[:, 2]


def nees(track, truth):
    """Return the mean normalised squared error of positions, velocities and accelerations."""
    d = track.position.shape[-1]
    told = []
    for i, (estimate, true) in enumerate(
        zip((track.position, track.velocity, track.acceleration), truth, strict=True)
    ):
        at = slice(i * d, (i + 1) * d)
        error = estimate - true
        told.append(np.mean(metrics.nees(error, track.covariance[:, at, at])) / d)
    return np.array(told)


def rmse(track, truth):
    return np.sqrt(np.mean(np.sum((track.position - truth[0]) ** 2, axis=-1)))


def check(track, truth, measured):
    """Check what holds for every trajectory."""
    n, d = truth[0].shape
    assert track.covariance.shape == (n, 3 * d, 3 * d)
    np.testing.assert_allclose(track.covariance, np.swapaxes(track.covariance, -1, -2), rtol=1e-9)
    for kind in KINDS:
        residual, outlier = getattr(track.residual, kind), getattr(track.outlier, kind)
        if kind not in measured:
            assert residual is None
            assert outlier is None
            continue
        assert residual.shape == outlier.shape == measured[kind].shape
        missing = np.isnan(measured[kind]) | np.isnan(track.position[:, :1])
        np.testing.assert_array_equal(np.isnan(residual), missing)
        assert track.statistics[kind].shape == (measured[kind].shape[1], 3)
    assert track.residual.range_difference is None


@BOTH_SPATIAL
def test_the_covariance_is_honest(spatial):
    stations = network()
    told = []
    for run in np.arange(RUNS):
        rng = np.random.default_rng([1, run])
        truth = restless(rng)
        measured = measure(truth[0], rng)
        told.append(
            nees(reconstruct(stations, INSTANTS, **measured, spatial=spatial, jerk=JERK), truth)
        )
    mean, error = np.mean(told, axis=0), np.std(told, axis=0) / np.sqrt(RUNS)
    assert np.all(np.abs(mean - 1) < stats.norm.isf(CHANCE / 6) * error)
    assert np.all(error < 0.05)


@BOTH_SPATIAL
def test_biases_and_the_trajectory_are_as_close_as_they_say(spatial):
    stations = network()
    errors, told = [], []
    for run in np.arange(RUNS):
        rng = np.random.default_rng([2, run])
        truth = restless(rng)
        measured = measure(truth[0], rng, biases=BIASES)
        track = reconstruct(stations, INSTANTS, **measured, bias=ALL, spatial=spatial, jerk=JERK)
        errors.append(
            np.concatenate(
                [
                    (getattr(track.bias, kind) - BIASES[kind])
                    / getattr(track.bias, f"{kind}_sigma")
                    for kind in KINDS
                ]
            )
        )
        told.append(nees(track, truth)[0])
    squares = np.mean(np.square(errors), axis=0)
    bounds = stats.chi2.ppf([CHANCE / 18, 1 - CHANCE / 18], RUNS) / RUNS
    assert np.all((bounds[0] < squares) & (squares < bounds[1]))
    limit = stats.norm.isf(CHANCE / 18) / np.sqrt(RUNS)
    assert np.all(np.abs(np.mean(errors, axis=0)) < limit)
    assert abs(np.mean(told) - 1) < stats.norm.isf(CHANCE / 2) * np.std(told) / np.sqrt(RUNS)


def test_biases_that_are_not_removed_are_seen():
    rng = np.random.default_rng(3)
    truth = restless(rng)
    measured = measure(truth[0], rng, biases=BIASES)
    plain = reconstruct(network(), INSTANTS, **measured, bias=Bias())
    better = reconstruct(network(), INSTANTS, **measured, bias=ALL)
    assert plain.systematic == better.systematic == "given"
    np.testing.assert_array_equal(plain.bias.range_sigma, 0.0)
    assert nees(plain, truth)[0] > 3
    assert rmse(better, truth) < rmse(plain, truth)
    assert np.ptp(plain.statistics["range"][:, 1]) > 5 * np.ptp(better.statistics["range"][:, 1])
    np.testing.assert_array_equal(better.time, INSTANTS)
    assert better.bias[0].range == better.bias.range[0]


def test_faults_do_not_hide_biases():
    rng = np.random.default_rng(4)
    truth = restless(rng)
    measured = measure(truth[0], rng, biases=BIASES)
    measured["range"][20:26, 1] += 200
    track = reconstruct(network(), INSTANTS, **measured, bias=Bias(range_sigma=np.inf))
    assert track.outlier.range[20:26, 1].all()
    assert not np.any(track.bias.azimuth_sigma)


@pytest.mark.parametrize("kinds", [("azimuth",), KINDS])
def test_one_station_does_not_tell_its_biases(kinds):
    rng = np.random.default_rng(5)
    measured = measure(turn(INSTANTS)[0], rng, PLACES[:1])
    named = ", ".join(f"{kind} of station 0" for kind in kinds)
    with pytest.raises(ValueError, match=f"^biases of {named} are not observable"):
        reconstruct(network(PLACES[:1]), INSTANTS, **measured, bias=estimated(*kinds))


@pytest.mark.parametrize("n", [60, 1000])
def test_a_target_that_stands_still_does_not_tell_all_biases(n):
    # errors of the positions move the geometry, from which nothing may follow
    rng = np.random.default_rng(6)
    still = np.broadcast_to([600.0, 1000.0, 300.0], (n, 3))
    with pytest.raises(ValueError, match="are not observable"):
        reconstruct(network(), np.arange(n), **measure(still, rng), bias=ALL)
    one = reconstruct(network(), np.arange(n), **measure(still, rng), bias=Bias(range_sigma=np.inf))
    assert np.all(np.abs(one.bias.range) < 4 * one.bias.range_sigma)


def test_biases_of_stations_that_measured_nothing_are_unknown():
    rng = np.random.default_rng(7)
    truth = turn(INSTANTS)
    measured = measure(truth[0], rng)
    measured["elevation"][:, 2] = np.nan
    track = reconstruct(network(), INSTANTS, **measured, bias=Bias(elevation_sigma=np.inf))
    np.testing.assert_array_equal(track.bias.elevation == 0, [False, False, True])
    np.testing.assert_array_equal(np.isinf(track.bias.elevation_sigma), [False, False, True])
    check(track, truth, measured)


def test_temporal_first_is_honest_on_long_tracks():
    times = np.arange(300.0)
    told = []
    for run in np.arange(20):
        rng = np.random.default_rng([8, run])
        truth = restless(rng, times, 1e-4)
        measured = measure(truth[0], rng)
        told.append(nees(reconstruct(network(), times, **measured, order="temporal-first"), truth))
    mean, error = np.mean(told, axis=0), np.std(told, axis=0) / np.sqrt(20)
    assert abs(mean[0] - 1) < stats.norm.isf(CHANCE / 2) * error[0]
    # ranges and angles are not driven by white jerk: of derivatives it is an upper bound
    assert np.all(mean[1:] < 1.1)
    assert np.all(mean[1:] > 0.3)


@BOTH_ORDERS
@BOTH_SMOOTHERS
@pytest.mark.parametrize("moving", [False, True])
def test_without_noise_everything_comes_back(order, smoother, moving):
    times = np.arange(0.0, 30.0, 0.25)
    truth = turn(times)
    places = PLACES
    if moving:
        paths = [
            [5 * np.sin(0.1 * times), 0 * times, 0 * times],
            [-4 * times, 3 * times, 0 * times],
        ]
        paths.append([0 * times, -2 * times + 0.05 * times**2, 0.5 * times])
        places = PLACES + np.moveaxis(np.array(paths), -1, 0)
    measured = ideal(truth[0], places)
    sharp = [
        Station(places[..., k, :], range_sigma=1e-2, azimuth_sigma=1e-5, elevation_sigma=1e-5)
        for k in np.arange(3)
    ]
    track = reconstruct(
        sharp, times, **measured, order=order, smoother=smoother, degree=3, window=7
    )
    np.testing.assert_allclose(track.position, truth[0], atol=1e-2)
    inside = slice(10, -10)
    np.testing.assert_allclose(track.velocity[inside], truth[1][inside], atol=1e-2)
    np.testing.assert_allclose(track.acceleration[inside], truth[2][inside], atol=2e-2)
    check(track, truth, measured)
    assert isinstance(track, Trajectory)


@BOTH_ORDERS
@BOTH_SMOOTHERS
def test_a_rotated_frame_changes_nothing(order, smoother):
    """The same measurements, all coordinates in another frame."""
    truth = turn(INSTANTS)
    measured = measure(truth[0], np.random.default_rng(30))
    rotation = Rotation.from_euler("xyz", [0.3, -0.8, 2.0]).as_matrix()
    rotated = [
        Station(
            rotation @ place,
            range_sigma=SIGMA_R,
            azimuth_sigma=SIGMA_A,
            elevation_sigma=SIGMA_A,
            axes=rotation.T,
        )
        for place in PLACES
    ]
    options = {"order": order, "smoother": smoother}
    if smoother == "local-polynomial":
        # adaptive degrees are chosen for each coordinate, and doubtful measurements widen each
        options |= {"degree": 2, "spatial": "least-squares"}
    elif order == "spatial-first":
        options["jerk"] = JERK
    a = reconstruct(network(), INSTANTS, **measured, **options)
    b = reconstruct(rotated, INSTANTS, **measured, **options)
    both = [(a.position, b.position), (a.velocity, b.velocity), (a.acceleration, b.acceleration)]
    for one, other in both:
        # polynomials weight each coordinate by its own variance
        far = 0.1 if (order, smoother) == ("spatial-first", "local-polynomial") else 1e-4
        np.testing.assert_allclose(one @ rotation.T, other, atol=far * np.abs(one).max(), rtol=0)
    np.testing.assert_allclose(
        a.residual.azimuth, b.residual.azimuth, atol=2e-3 if far < 0.1 else 1
    )


@pytest.mark.parametrize("moving", [False, True])
def test_biases_of_stations_with_axes(moving):
    truth = turn(INSTANTS)
    measured = measure(truth[0], np.random.default_rng(31), biases=BIASES)
    rotation = Rotation.from_euler("xyz", [0.3, -0.8, 2.0]).as_matrix()
    axes = np.broadcast_to(rotation.T, (60, 3, 3)) if moving else rotation.T
    rotated = [
        Station(
            np.broadcast_to(rotation @ place, (60, 3)) if moving else rotation @ place,
            range_sigma=SIGMA_R,
            azimuth_sigma=SIGMA_A,
            elevation_sigma=SIGMA_A,
            axes=axes,
        )
        for place in PLACES
    ]
    a = reconstruct(network(), INSTANTS, **measured, jerk=JERK, bias=ALL)
    b = reconstruct(rotated, INSTANTS, **measured, jerk=JERK, bias=ALL)
    for kind in KINDS:
        one, other = (getattr(told, kind) for told in (a.bias, b.bias))
        sigma = getattr(a.bias, f"{kind}_sigma")
        np.testing.assert_allclose(one, other, rtol=0, atol=0.02 * sigma.max())
    np.testing.assert_allclose(a.position @ rotation.T, b.position, rtol=0, atol=0.5)


def test_axes_that_change_need_positions_first():
    axes = np.broadcast_to(np.eye(3), (60, 3, 3))
    stations = [
        Station(np.broadcast_to(p, (60, 3)), range_sigma=1, azimuth_sigma=1, axes=axes)
        for p in PLACES
    ]
    measured = ideal(turn(INSTANTS)[0])
    with pytest.raises(ValueError, match="axes of stations change"):
        reconstruct(
            stations,
            INSTANTS,
            range=measured["range"],
            azimuth=measured["azimuth"],
            order="temporal-first",
        )


@BOTH_ORDERS
@BOTH_SMOOTHERS
def test_smoothing_is_better_than_single_instants(order, smoother):
    truth = turn(INSTANTS)
    measured = measure(truth[0], np.random.default_rng(9))
    track = reconstruct(network(), INSTANTS, **measured, order=order, smoother=smoother)
    single = reconstruct(network(), INSTANTS, **measured).fixes
    error = np.sqrt(np.mean(np.sum((single.position - truth[0]) ** 2, axis=-1)))
    assert rmse(track, truth) < 0.6 * error
    check(track, truth, measured)


def test_a_run_of_faults_is_removed_in_space():
    truth = turn(INSTANTS)
    measured = measure(truth[0], np.random.default_rng(10))
    faulty = {kind: values.copy() for kind, values in measured.items()}
    faulty["range"][28:32, 0] += 8 * SIGMA_R
    track = reconstruct(network(), INSTANTS, **faulty)
    marked = np.argwhere(track.outlier.range)
    np.testing.assert_array_equal(marked, [[28, 0], [29, 0], [30, 0], [31, 0]])
    near = slice(21, 39)
    plain = reconstruct(network(), INSTANTS, **faulty, spatial="least-squares")
    error, worse = (
        np.sqrt(np.mean(np.sum((one.position - truth[0])[near] ** 2, axis=-1)))
        for one in (track, plain)
    )
    assert error < 0.5 * worse
    assert repr(track).startswith("Trajectory(60 of 60 instants in 3 axes, 4 measurements left out")


def test_stations_that_take_turns_are_filled():
    times = np.arange(0.0, 60.0, 0.5)
    truth = turn(times)
    measured = measure(truth[0], np.random.default_rng(11))
    for values in measured.values():
        for k in np.arange(3):
            values[np.arange(120) % 3 != k, k] = np.nan
    track = reconstruct(network(), times, **measured, order="temporal-first")
    assert not np.isnan(track.position).any()
    assert rmse(track, truth) < 4
    assert np.all(track.fixes.degrees_of_freedom[2:-2] == 6)
    # before its first measurement a station is not continued
    assert track.fixes.degrees_of_freedom[0] == 0
    check(track, truth, measured)


def test_the_ranges_of_the_source_follow_from_its_track():
    np.testing.assert_array_equal(
        np.round(ideal(source_track(), SOURCE_STATION[np.newaxis])["range"][:, 0], 4), IDEAL_R
    )


def source_track():
    j = SOURCE_I - 49.0
    north = 0.1 * j**4 + 1.6 * j**2 + 100.4 * j + 791.2
    return np.column_stack([np.full(10, 1000.0), north, 10.0 * SOURCE_I])


@pytest.mark.parametrize("seed", np.arange(12, 22))
def test_the_faults_of_the_source_are_found_by_more_stations(seed):
    # the first one, of 4.3 standard deviations, is less than what an instant alone tells
    truth = source_track()
    places = np.vstack([SOURCE_STATION, [[2000, 300, 5], [400, 2600, 0], [-500, 200, 20]]])
    measured = measure(truth, np.random.default_rng(seed), places, range_sigma=SOURCE_SIGMA)
    measured["range"][:, 0] = REAL_R
    track = reconstruct(network(places, SOURCE_SIGMA), SOURCE_I, **measured)
    np.testing.assert_array_equal(np.flatnonzero(track.outlier.range[:, 0]), [3, 4, 5])
    assert np.all(np.abs(np.delete(track.residual.range[:, 0], [3, 4, 5])) < 3)
    squares = metrics.nees(track.position - truth, track.covariance[:, :3, :3])
    # ten seeds of ten instants
    assert np.all(squares < stats.chi2.isf(CHANCE / 100, 3))


@pytest.mark.parametrize("sizes", FAULTS)
def test_positions_are_as_close_as_they_say_with_faults(sizes):
    told = []
    for run in np.arange(RUNS):
        rng = np.random.default_rng([20, run])
        truth = restless(rng)
        measured = measure(truth[0], rng)
        measured["range"][28 : 28 + len(sizes), 0] += SIGMA_R * np.array(sizes)
        told.append(nees(reconstruct(network(), INSTANTS, **measured), truth))
    mean, error = np.mean(told, axis=0), np.std(told, axis=0) / np.sqrt(RUNS)
    assert abs(mean[0] - 1) < stats.norm.isf(CHANCE / 2) * error[0]
    assert error[0] < 0.1
    # the fitted jerk is uncertain, most of all for derivatives
    assert np.all(mean[1:] - 1 < stats.norm.isf(CHANCE / 4) * error[1:])
    assert np.all((mean[1:] > 0.6) & (mean[1:] < 1.5))


def one_after_another(rng, gross, count=240):
    """Return times, positions, stations and azimuths of which each has a time of its own."""
    times = np.sort(rng.uniform(0.0, 7200.0, count))
    truth = np.column_stack([900 * np.sin(times / 1300), 700 * np.cos(times / 1900)])
    places = np.array([[-1500.0, 900.0], [1400.0, 1000.0], [200.0, -1600.0]])
    offset = truth[:, np.newaxis] - places
    azimuth = np.arctan2(offset[..., 0], offset[..., 1])
    azimuth += np.deg2rad(3.0) * rng.standard_normal(azimuth.shape)
    wrong = rng.random(azimuth.shape) < gross
    azimuth = np.where(wrong, rng.uniform(-np.pi, np.pi, azimuth.shape), azimuth)
    azimuth[rng.integers(0, 3, count)[:, np.newaxis] != np.arange(3)] = np.nan
    stations = [Station(place, azimuth_sigma=np.deg2rad(3.0), bias=Bias()) for place in places]
    return times, truth, stations, azimuth, wrong & ~np.isnan(azimuth)


@pytest.mark.parametrize("gross", [0.0, 0.25])
def test_bearings_that_each_have_a_time_of_their_own(gross):
    """No instant has a position; the path fits all bearings together."""
    squares, sizes, said, missed = [], [], [], []
    for run in range(12):
        rng = np.random.default_rng([25, run])
        times, truth, stations, azimuth, wrong = one_after_another(rng, gross)
        track = reconstruct(stations, times, azimuth=azimuth)
        assert not track.fixes.success.any()
        assert not track.outlier.azimuth[np.isnan(azimuth)].any()
        best = reconstruct(stations, times, azimuth=np.where(wrong, np.nan, azimuth))
        error = track.position - truth
        sizes.append([np.mean(error**2), np.mean((best.position - truth) ** 2)])
        squares.append(np.mean(metrics.nees(error, track.covariance[:, :2, :2])) / 2)
        said.append(np.mean(in_region(error, track.covariance[:, :2, :2])))
        missed.append(np.mean(track.outlier.azimuth[wrong]) if wrong.any() else 1.0)
    found, possible = np.sqrt(np.mean(sizes, axis=0))
    assert found < 1.15 * possible
    assert np.mean(said) > 0.88
    assert 0.6 < np.mean(squares) < 1.4
    # few of those that point anywhere point at the target
    assert np.mean(missed) > 0.9


def test_measurements_of_different_sigmas():
    """Each counts by its own; one that is missing has none."""
    truth = turn(INSTANTS)
    rng = np.random.default_rng(27)
    factor = np.where(rng.random((60, 3)) < 0.5, 1.0, 5.0)
    noise = {kind: SIGMAS[kind] * rng.standard_normal((60, 3)) for kind in SIGMAS}
    measured = {kind: values + factor * noise[kind] for kind, values in ideal(truth[0]).items()}
    measured["range"][3, 1] = np.nan
    sigmas = {f"{kind}_sigma": factor * SIGMAS[kind] for kind in SIGMAS}
    both = [
        reconstruct(network(), INSTANTS, bias=Bias(), **measured, **one) for one in (sigmas, {})
    ]
    better, worse = (rmse(track, truth) for track in both)
    assert better < 0.8 * worse
    assert 0.5 < nees(both[0], truth)[0] < 1.5
    sigmas["range_sigma"][3, 1] = 1e3
    again = reconstruct(network(), INSTANTS, bias=Bias(), **measured, **sigmas)
    np.testing.assert_array_equal(again.position, both[0].position)
    with pytest.raises(
        ValueError, match=r"range_sigma has shape \(2, 3\); it must be \(3,\) or \(60, 3\)"
    ):
        reconstruct(network(), INSTANTS, range=measured["range"], range_sigma=np.ones((2, 3)))


def test_with_many_faults_the_path_is_as_good_as_without_them():
    """Three bearings an instant, three of ten wrong: the path tells what an instant cannot."""
    sizes = []
    for run in range(10):
        rng = np.random.default_rng([26, run])
        times = 5.0 * np.arange(120)
        truth = np.column_stack([800 * np.sin(times / 110), 600 * np.cos(times / 150)])
        places = np.array([[-1500.0, 1000.0], [1500.0, 900.0], [0.0, -1800.0]])
        offset = truth[:, np.newaxis] - places
        noise = rng.standard_normal((120, 3))
        wrong = rng.random((120, 3)) < 0.3
        size = rng.uniform(5.0, 15.0, (120, 3)) * rng.choice([-1.0, 1.0], (120, 3))
        sigma = np.deg2rad(2.0)
        azimuth = np.arctan2(offset[..., 0], offset[..., 1]) + sigma * (noise + wrong * size)
        stations = [Station(place, azimuth_sigma=sigma, bias=Bias()) for place in places]
        track = reconstruct(stations, times, azimuth=azimuth)
        best = reconstruct(stations, times, azimuth=np.where(wrong, np.nan, azimuth))
        sizes.append([np.mean((one.position - truth) ** 2) for one in (track, best)])
    found, possible = np.sqrt(np.mean(sizes, axis=0))
    assert found < 1.15 * possible


def test_the_track_contradicts_nothing_without_faults():
    count = 0
    for run in np.arange(RUNS):
        rng = np.random.default_rng([21, run])
        measured = measure(restless(rng)[0], rng)
        track = reconstruct(network(), INSTANTS, **measured)
        count += np.any(track.outlier.count > track.fixes.outlier.count)
    assert count <= stats.binom.isf(CHANCE, RUNS, 0.01)


def test_a_turn_that_the_smoother_does_not_know_is_no_fault():
    # with hardly any jerk the smooth track contradicts everything
    truth = turn(INSTANTS, rate=0.2)
    measured = measure(truth[0], np.random.default_rng(22))
    track = reconstruct(network(), INSTANTS, **measured, jerk=1e-9)
    assert rmse(track, truth) > 20
    # 1 % of the measurements contradict the others of their instant by as much
    assert np.sum(track.outlier.count) < stats.binom.isf(CHANCE, 540, 0.01)


@BOTH_ORDERS
@BOTH_SMOOTHERS
def test_one_instant_alone(order, smoother):
    measured = measure(turn(INSTANTS[:1])[0], np.random.default_rng(13))
    track = reconstruct(network(), [0.0], **measured, order=order, smoother=smoother)
    np.testing.assert_allclose(track.position, track.fixes.position, rtol=1e-9)
    np.testing.assert_allclose(track.sigma, track.fixes.sigma, rtol=1e-9)
    assert np.isnan(track.velocity).all()
    assert np.isinf(np.diagonal(track.covariance[0])[3:]).all()
    check(track, turn(INSTANTS[:1]), measured)


def test_one_instant_with_biases():
    measured = measure(turn(INSTANTS[:1])[0], np.random.default_rng(13))
    track = reconstruct(network(), [0.0], **measured, bias=Bias(range_sigma=np.inf))
    assert np.all(np.isfinite(track.bias.range_sigma))
    assert np.all(track.sigma > track.fixes.sigma)


def test_a_gap_of_hours():
    times = np.concatenate([INSTANTS, INSTANTS + 4 * 3600])
    truth = turn(times, rate=1e-4, speed=0.1)
    track = reconstruct(network(), times, **measure(truth[0], np.random.default_rng(14)))
    assert np.isfinite(track.position).all()
    assert rmse(track, truth) < 4
    assert np.all(np.linalg.eigvalsh(track.covariance[:, :3, :3]) > 0)


def test_instants_without_measurements():
    truth = turn(INSTANTS)
    measured = measure(truth[0], np.random.default_rng(15))
    for values in measured.values():
        values[25:30] = np.nan
    track = reconstruct(network(), INSTANTS, **measured)
    assert not np.asarray(track.fixes.success)[25:30].any()
    assert np.isfinite(track.position).all()
    assert track.sigma[27, 0] > track.sigma[20, 0]
    check(track, truth, measured)


@BOTH_ORDERS
def test_measurements_that_are_all_wrong_are_told(order):
    rng = np.random.default_rng(16)
    measured = measure(turn(INSTANTS)[0], rng)
    wrong = {
        kind: values + 30 * SIGMAS[kind] * rng.standard_normal(values.shape)
        for kind, values in measured.items()
    }
    track = reconstruct(network(), INSTANTS, **wrong, order=order)
    unnoticed = np.asarray(track.fixes.success) & (np.asarray(track.fixes.pvalue) > 1e-3)
    assert np.mean(unnoticed) < 0.05


def test_azimuths_in_the_plane_with_moving_stations():
    times = np.arange(100.0)
    truth = np.column_stack([2000 - 10 * times, 3000 + 5 * times])
    places = np.array([[0.0, 0.0], [3000.0, 0.0], [0.0, 4000.0], [4000.0, 5000.0]])
    drift = places + times[:, np.newaxis, np.newaxis] * np.array([0.5, -0.3])
    offset = truth[:, np.newaxis] - drift
    rng = np.random.default_rng(17)
    bias = np.deg2rad([3.0, -2.0, 1.0, 4.0])
    azimuth = np.arctan2(offset[..., 0], offset[..., 1]) + bias
    azimuth += np.deg2rad(1.0) * rng.standard_normal(azimuth.shape)
    stations = [Station(drift[:, k], azimuth_sigma=np.deg2rad(1.0)) for k in np.arange(4)]
    # whole turns do not matter
    azimuth[::3] += 2 * np.pi
    track = reconstruct(stations, times, azimuth=azimuth, bias=Bias(azimuth_sigma=np.inf))
    assert np.all(np.abs(track.bias.azimuth - bias) < 3.5 * track.bias.azimuth_sigma)
    assert np.all(track.bias.azimuth_sigma < 0.1)


def bearings(rng, gross):
    """Return times, a boat's positions, four drifting direction finders, biases and azimuths."""
    times = 2.5 * np.arange(200)
    truth = np.column_stack(
        [900 * np.sin(times / 200) + 0.5 * times - 100, 800 * np.cos(times / 150)]
    )
    places = np.array([[-1000.0, 1000.0], [1000.0, 900.0], [-900.0, -1000.0], [1000.0, -900.0]])
    drift = places + times[:, np.newaxis, np.newaxis] * np.array([0.2, -0.15])
    offset = truth[:, np.newaxis] - drift
    bias = np.deg2rad([-1.0, -7.0, -4.0, -6.0])
    azimuth = np.arctan2(offset[..., 0], offset[..., 1]) + bias
    azimuth += np.deg2rad(5.0) * rng.standard_normal(azimuth.shape)
    wrong = rng.random(azimuth.shape) < gross
    sign = rng.choice([-1.0, 1.0], azimuth.shape)
    azimuth += np.where(wrong, sign * rng.uniform(np.pi / 6, np.pi, azimuth.shape), 0.0)
    stations = [Station(drift[:, k], azimuth_sigma=np.deg2rad(5.0)) for k in np.arange(4)]
    return times, truth, stations, bias, azimuth


@pytest.mark.parametrize("gross", [0.0, 0.05])
def test_biases_of_bearings_are_as_close_as_they_say_with_gross_errors(gross):
    # two degrees of freedom an instant, errors of a tenth of the distances
    runs, errors, told = 20, [], []
    for run in np.arange(runs):
        times, truth, stations, bias, azimuth = bearings(np.random.default_rng([23, run]), gross)
        track = reconstruct(stations, times, azimuth=azimuth, bias=Bias(azimuth_sigma=np.inf))
        errors.append((track.bias.azimuth - bias) / track.bias.azimuth_sigma)
        error = track.position - truth
        told.append(np.mean(metrics.nees(error, track.covariance[:, :2, :2])) / 2)
        assert np.all(track.bias.azimuth_sigma < np.deg2rad(3.0))
    squares = np.mean(np.square(errors), axis=0)
    assert np.all(squares < stats.chi2.isf(CHANCE / 8, runs) / runs)
    assert np.all(squares > stats.chi2.ppf(CHANCE / 8, runs) / runs)
    assert np.all(np.abs(np.mean(errors, axis=0)) < stats.norm.isf(CHANCE / 16) / np.sqrt(runs))
    assert np.mean(told) < 1.3


def test_errors_that_stay_for_a_while_make_biases_uncertain():
    rng = np.random.default_rng(24)
    times, _, stations, _, azimuth = bearings(rng, 0.0)
    white = reconstruct(stations, times, azimuth=azimuth, bias=Bias(azimuth_sigma=np.inf))
    slow = np.repeat(np.deg2rad(8.0) * rng.standard_normal((10, 4)), 20, axis=0)
    track = reconstruct(stations, times, azimuth=azimuth + slow, bias=Bias(azimuth_sigma=np.inf))
    assert np.all(track.bias.azimuth_sigma > 1.5 * white.bias.azimuth_sigma)


@pytest.mark.skipif(not (DATA / "difar").is_dir(), reason="the recording is not there")
def test_a_boat_among_drifting_direction_finders():
    """Recorded bearings: biases make the track better than its instants."""
    times, places, azimuth, truth = difar()
    stations = [Station(places[:, k], azimuth_sigma=np.deg2rad(5.0)) for k in np.arange(4)]
    track = reconstruct(stations, times, azimuth=azimuth, bias=Bias(azimuth_sigma=np.inf))
    enough = np.sum(~np.isnan(azimuth), axis=-1) >= 3
    error = np.linalg.norm(track.position - truth, axis=-1)[enough]
    assert np.all(np.percentile(error, [50, 90, 99]) < [240, 400, 500])


def test_range_differences_alone():
    times = np.arange(60.0)
    truth = np.column_stack([500 + 10 * times, 800 + 0 * times])
    places = np.array([[0.0, 0.0], [3000.0, 0.0], [0.0, 4000.0], [4000.0, 5000.0], [-1000, 3000]])
    distance = np.linalg.norm(truth[:, np.newaxis] - places, axis=-1)
    differences = distance[:, 1:] - distance[:, :1]
    stations = [Station(place) for place in places]
    for order in ("spatial-first", "temporal-first"):
        track = reconstruct(
            stations, times, range_difference=differences, range_difference_sigma=1.0, order=order
        )
        np.testing.assert_allclose(track.position, truth, atol=0.5)
        np.testing.assert_allclose(track.velocity[5:-5], np.tile([10.0, 0.0], (50, 1)), atol=0.2)


def arguments(**changes):
    measured = measure(turn(INSTANTS)[0], np.random.default_rng(18))
    return {"stations": network(), "time": INSTANTS, **measured, **changes}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": INSTANTS[::-1]}, "time[1] is before the previous time"),
        ({"time": INSTANTS[:5]}, "range has shape (60, 3); for 5 instants and 3 stations"),
        ({"time": 1.0}, "time has shape ()"),
        ({"range": np.ones((60, 2))}, "range has shape (60, 2)"),
        ({"range_difference": np.ones((60, 2))}, "range_difference_sigma is missing"),
        ({"stations": []}, "stations is empty"),
        ({"stations": network(PLACES + np.zeros((5, 1, 1)))},
         "stations have positions of shape (5,)"),
        ({"stations": [Station(p, range_sigma=1.0) for p in PLACES]}, "azimuth_sigma of station 0"),
        ({"range": None, "azimuth": None, "elevation": None}, "nothing was measured"),
        ({"azimuth": np.full((60, 3), np.nan), "elevation": np.full((60, 3), np.nan),
          "range": np.full((60, 3), np.nan)}, "no instant can be located: there are fewer"),
        ({"order": "both"}, "order is 'both'; it must be 'spatial-first' or 'temporal-first'"),
        ({"smoother": "none"}, "smoother is 'none'"),
        ({"spatial": "mean"}, "spatial is 'mean'"),
        ({"bias": Bias(range_sigma=[3.0, np.inf, 3.0])}, "bias.range_sigma is inf for some"),
        ({"bias": Bias(range_sigma=3.0, azimuth_sigma=np.inf)}, "bias has a sigma of inf"),
        ({"bias": ALL, "elevation": None}, "bias.elevation_sigma is inf, but elevation was not"),
        ({"bias": Bias(elevation_sigma=None), "elevation": None},
         "bias.elevation_sigma is None, but elevation was not"),
        ({"bias": Bias(range_sigma=np.ones(2))}, "bias is that of 2 sensors; there are 3"),
        ({"bias": ALL, "order": "temporal-first"}, "bias needs order 'spatial-first'"),
        ({"bias": ALL, "smoother": "local-polynomial"}, "bias needs order"),
        ({"range": -np.ones((60, 3))}, "range[0, 0] is -1.0"),
    ],
)  # fmt: skip
def test_errors_tell_what_is_wrong(changes, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        reconstruct(**arguments(**changes))


def test_bearings_from_a_single_ship():
    """Whatever it does: a target may move in the same way."""
    place = np.column_stack([50.0 * np.arange(20), np.abs(500.0 - 50.0 * np.arange(20))])
    with pytest.raises(ValueError, match="from one station, `locate` finds targets that rest"):
        reconstruct(
            [Station(place, azimuth_sigma=0.02)],
            20.0 * np.arange(20),
            azimuth=np.linspace(0.1, 0.3, 20)[:, None],
        )


def test_stations_must_be_stations():
    with pytest.raises(TypeError, match="stations must be a sequence of Station"):
        reconstruct(**arguments(stations=PLACES))


def test_threads_change_nothing():
    one, four = (reconstruct(**arguments(), n_threads=count) for count in (1, 4))
    np.testing.assert_array_equal(one.position, four.position)
    np.testing.assert_array_equal(one.covariance, four.covariance)


def test_degrees_are_told():
    stations = [Station(place, azimuth_sigma=1.0) for place in ([0.0, 0.0], [-1000.0, 0.0])]
    azimuth = np.tile([315.0, -0.3], (5, 1))
    with pytest.raises(ValueError, match=r"azimuth\[0, 0\] is 315.*degrees\?"):
        reconstruct(stations, np.arange(5.0), azimuth=azimuth)


@pytest.mark.parametrize("order", ["spatial-first", "temporal-first"])
def test_a_short_window_limits_the_adaptive_degree(order):
    time = np.arange(20.0)
    truth = 1e3 + np.outer(time, [10.0, 5.0])
    measured = np.linalg.norm(truth[:, np.newaxis] - PLACES[:, :2], axis=-1)
    stations = [Station(place, range_sigma=1.0) for place in PLACES[:, :2]]
    options = {"order": order, "smoother": "local-polynomial", "window": 3}
    track = reconstruct(stations, time, range=measured, **options)
    np.testing.assert_allclose(track.position, truth, atol=10.0)


def test_the_jerk_is_weighted_by_its_likelihood_and_the_fourth_root_of_itself():
    """The covariance of a short path is the mean over jerks, here by a fine sum over known ones."""
    random, time = np.random.default_rng(3), 5.0 * np.arange(12)
    places = np.array([[0.0, 0.0], [4e3, 0.0], [0.0, 3e3], [5e3, 5e3]])
    stations = [Station(place, range_sigma=20.0, bias=Bias()) for place in places]
    path = 2e3 + np.outer(time, [10.0, 5.0]) + np.outer(time**2, [0.01, -0.025])
    measured = np.linalg.norm(path[:, np.newaxis] - places, axis=-1)
    measured += random.normal(0.0, 20.0, measured.shape)
    # a noise that is fitted would depend on the jerk
    options = {"range": measured, "spatial": "least-squares"}
    found = reconstruct(stations, time, **options)
    jerks = np.geomspace(1e-10, 10.0, 80)
    known = [reconstruct(stations, time, jerk=jerk, **options) for jerk in jerks]
    likelihood = np.array([one.smoothed.log_likelihood for one in known])

    def spread(power):
        weight = np.exp(likelihood - likelihood.max()) * jerks**power
        each = [
            np.trace(one.covariance[:, :2, :2], axis1=1, axis2=2)
            + np.sum((one.position - found.position) ** 2, axis=-1)
            for one in known
        ]
        return weight @ each / weight.sum()

    own = np.trace(found.covariance[:, :2, :2], axis1=1, axis2=2)
    np.testing.assert_allclose(own / spread(0.25), 1.0, atol=0.05)
    assert np.max(np.abs(own / spread(0.0) - 1.0)) > 0.2


def test_covariances_are_symmetric_to_the_last_bit():
    """Where the height is known badly, and the stations are nearly in its plane."""
    rng = np.random.default_rng(0)
    places = rng.normal(size=(3, 3)) * 1e3
    truth = np.column_stack([20 * INSTANTS, 1500 + 5 * INSTANTS, np.full(60, 900.0)])
    distance = np.linalg.norm(truth[:, np.newaxis] - places, axis=-1)
    stations = [Station(place, range_sigma=10.0) for place in places]
    noisy = distance + rng.normal(size=distance.shape) * 10.0
    found = reconstruct(stations, INSTANTS, range=noisy, bias=Bias(), initial=truth[0])
    assert_covariance(found.covariance, 1e-9)
    assert_covariance(found.fixes.covariance, 1e-9)


def test_ranges_that_stations_measure_in_turn():
    """No instant determines a position, and running medians are of different times."""
    rng = np.random.default_rng(21)
    places = rng.normal(size=(5, 2)) * 1e3
    ways = [rng.normal() * 1e3 + rng.normal() * 30 * INSTANTS for _ in range(2)]
    truth = np.column_stack(ways)
    distance = np.linalg.norm(truth[:, np.newaxis] - places, axis=-1)
    noisy = distance + rng.normal(size=distance.shape) * 5.0
    noisy[np.arange(5) != np.arange(60)[:, np.newaxis] % 5] = np.nan
    stations = [Station(place, range_sigma=5.0) for place in places]
    found = reconstruct(stations, INSTANTS, range=noisy, bias=Bias())
    error = found.position - truth
    assert np.median(np.linalg.norm(error, axis=1)) < 20.0
    d2 = metrics.nees(error, found.covariance[:, :2, :2])
    assert np.mean(d2) < stats.chi2.ppf(0.9999, 2)


def ranges_in_turn(seed, share=0.0):
    """Return stations in space, ranges of which a share is off by 100 sigma, and the path."""
    rng = np.random.default_rng(seed)
    places = rng.normal(size=(5, 3)) * 1e3
    places[:, 2] = 0.3 * np.abs(places[:, 2])
    ways = [rng.normal() * 1e3 + rng.normal() * 30 * INSTANTS for _ in range(2)]
    truth = np.column_stack([*ways, np.full(60, 500.0)])
    distance = np.linalg.norm(truth[:, np.newaxis] - places, axis=-1)
    noisy = distance + rng.normal(size=distance.shape) * 5.0
    noisy[rng.random(noisy.shape) < share] += 500.0
    noisy[np.arange(5) != np.arange(60)[:, np.newaxis] % 5] = np.nan
    return [Station(place, range_sigma=5.0) for place in places], noisy, truth


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("seed", [0, 1, 7])
def test_a_path_that_diverges_is_sought_with_an_agile_motion(seed):
    """Ranges in turn, in space: the motion is estimated about a path far from the target."""
    stations, noisy, truth = ranges_in_turn(seed)
    found = reconstruct(stations, INSTANTS, range=noisy, bias=Bias())
    error = np.linalg.norm(found.position - truth, axis=1)
    spread = np.sqrt(np.trace(found.covariance[:, :3, :3], axis1=1, axis2=2))
    assert np.median(error / spread) < 2.5
    assert np.median(error) < 100.0


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("seed", range(12))
def test_a_path_that_contradicts_its_measurements_is_refused(seed):
    """With outliers in turn, the search may find no path; one that it finds agrees with them."""
    stations, noisy, _ = ranges_in_turn(seed, share=0.1)
    try:
        found = reconstruct(stations, INSTANTS, range=noisy, bias=Bias())
    except ValueError as error:
        refused = str(error)
    else:
        refused = ""
        assert np.nanmedian(np.abs(found.residual.range[~found.outlier.range])) < 3.0
    assert not refused or "no path was found that agrees with the measurements" in refused


def test_the_sigma_of_a_missing_measurement_may_be_missing():
    """As in the columns of a data frame."""
    rng = np.random.default_rng(12)
    path = np.column_stack([20 * INSTANTS, 900 + 5 * INSTANTS, 300 + 0 * INSTANTS])
    ranges = np.linalg.norm(path[:, np.newaxis] - PLACES, axis=-1)
    ranges += SIGMA_R * rng.standard_normal(ranges.shape)
    ranges[rng.random(ranges.shape) < 0.1] = np.nan
    stated = {"range": ranges, "initial": path[0]}
    sigma = np.where(np.isnan(ranges), np.nan, SIGMA_R)
    with_gaps = reconstruct(network(), INSTANTS, range_sigma=sigma, **stated)
    whole = reconstruct(network(), INSTANTS, range_sigma=np.full((60, 3), SIGMA_R), **stated)
    np.testing.assert_array_equal(with_gaps.position, whole.position)
    np.testing.assert_array_equal(with_gaps.covariance, whole.covariance)
