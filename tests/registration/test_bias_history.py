"""Biases that drift or change suddenly in a recording."""

import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from checks import assert_refused, assert_result, in_region, rng

from tertia import simulate
from tertia.registration import BiasHistory, register
from tertia.sensors import RADAR_LIMITS, Bias, Radar
from tertia.tracker import Plots, Tracker, smooth_tracks, track

KINDS = ("range", "range_gain", "azimuth", "time")
LIMITS = np.array([getattr(RADAR_LIMITS, f"{kind}_sigma") for kind in KINDS])
PLACES = ((-4e4, 0.0), (4e4, 0.0), (0.0, 5e4))
STEP, DURATION = 4.0, 900.0


def radars(count=3):
    return [
        Radar(place, range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
        for place in PLACES[:count]
    ]


def recording(seed, course, count=3):
    """Plots of radars with the errors `course` (T, K, 4), and the plots without these errors."""
    traffic = simulate.dense_traffic(20, area=(1e5, 1e5), duration=DURATION, rng=seed)
    plots = simulate.radar_plots(traffic, radars(count), rng=seed + 1).plots
    step = np.clip((plots.time / STEP).astype(int), 0, len(course) - 1)
    own = course[step, plots.sensor]
    wrong = replace(
        plots,
        time=plots.time + own[:, 3],
        range=plots.range * (1.0 + own[:, 1]) + own[:, 0],
        azimuth=plots.azimuth + own[:, 2],
    )
    return wrong, plots


@cache
def registered(seed):
    """The registration of a recording with errors that do not change."""
    return register(recording(seed, constant(seed))[0], radars())


def constant(seed, count=3):
    random = rng(seed).uniform(-1.0, 1.0, (count, 4)) * LIMITS
    return np.tile(random, (int(DURATION / STEP) + 2, 1, 1))


def drifting(seed, seconds, count=3):
    """Gauss-Markov errors with the limits as standard deviations and this correlation time."""
    random = rng(seed).normal(size=(int(DURATION / STEP) + 2, count, 4))
    rest = np.exp(-STEP / seconds)
    course = [random[0]]
    for one in random[1:]:
        course.append(rest * course[-1] + np.sqrt(1.0 - rest**2) * one)
    return np.array(course) * LIMITS


def columns(history, suffix=""):
    """The biases or sigmas of a history, (T, K, 4)."""
    return np.stack(
        [[getattr(bias, kind + suffix) for kind in KINDS] for bias in history.bias]
    ).swapaxes(1, 2)


def normalised(history, course):
    """Errors of the biases in the middle of each period over their sigmas, (T, K, 4)."""
    middle = (history.edges[:-1] + history.edges[1:]) / 2
    true = course[np.clip((middle / STEP).astype(int), 0, len(course) - 1)]
    return (columns(history) - true) / columns(history, "_sigma")


@pytest.mark.parametrize("seconds", [30_000.0, 120_000.0])
def test_biases_that_drift_are_within_their_sigmas(seconds):
    found = []
    for seed in range(8):
        course = drifting(seed, seconds)
        history = register(recording(seed, course)[0], radars()).bias_history
        found.append(normalised(history, course))
    inside = np.mean(np.abs(found) < 2.0, axis=(0, 1, 2))
    # without drift 36, 57 and 26 % of the first three
    assert np.all(inside > 0.85), inside
    assert np.mean(np.square(found)) < 1.5


@pytest.mark.parametrize(("kind", "size"), [(2, np.radians(0.2)), (2, np.radians(0.8)), (0, 300.0)])
def test_a_sudden_change_is_found(kind, size):
    course = constant(3)
    change = int(0.55 * DURATION / STEP)
    course[change:, 1, kind] += size
    found = register(recording(3, course)[0], radars())
    ((time, sensor),) = found.changes
    assert sensor == 1
    assert abs(time - STEP * change) <= 20.0
    middle = (found.bias_history.edges[:-1] + found.bias_history.edges[1:]) / 2
    far = np.abs(middle - STEP * change) > 20.0
    off = normalised(found.bias_history, course)[far]
    assert np.mean(np.abs(off) < 2.5) > 0.95
    assert found.bias.azimuth[1] == found.bias_history.bias[-1].azimuth[1]


def test_constant_biases_do_not_change():
    assert all(registered(seed).changes == () for seed in range(4))


def test_tracks_are_smoothed_with_the_bias_of_their_time():
    course = constant(5, 2)
    course[int(0.5 * DURATION / STEP) :, 1, 2] += np.radians(0.4)
    plots, exact = recording(5, course, 2)
    trusted = [replace(one, bias=Bias()) for one in radars(2)]
    best = smooth_tracks(exact, trusted)
    found = register(plots, radars(2))
    rmse = {}
    for name, smoothed in (
        ("by itself", smooth_tracks(plots, radars(2))),
        ("with tracks", smooth_tracks(plots, radars(2), track(plots, radars(2)))),
        ("registered", smooth_tracks(plots, radars(2), registration=found)),
        ("as at the end", smooth_tracks(plots, found.sensors, registration=False)),
    ):
        _, here, there = np.intersect1d(smoothed.plot, best.plot, return_indices=True)
        off = smoothed.position[here] - best.position[there]
        first = smoothed.time[here] < 0.45 * DURATION
        rmse[name] = np.sqrt(np.mean(off[first] ** 2))
    assert rmse["by itself"] < 30.0, rmse
    assert rmse["with tracks"] < 30.0, rmse
    assert rmse["registered"] < 30.0, rmse
    assert rmse["as at the end"] > 60.0, rmse


def test_plots_are_corrected_by_the_bias_of_their_period():
    edges = [0.0, 60.0, 120.0]
    bias = (Bias(range=[10.0, -20.0]), Bias(range=[30.0, 40.0], time=[0.0, 1.0]))
    history = BiasHistory(np.array(edges), bias)
    plots = Plots([-5.0, 10.0, 59.0, 60.0, 500.0], 1000.0, 0.5, sensor=[0, 1, 0, 1, 0])
    corrected = history.correct(plots)
    np.testing.assert_allclose(corrected.range, [990.0, 1020.0, 990.0, 960.0, 970.0])
    np.testing.assert_allclose(corrected.time, [-5.0, 10.0, 59.0, 59.0, 500.0])
    assert np.all(plots.range == 1000.0)
    with pytest.raises(ValueError, match="sensor 2"):
        history.correct(Plots([70.0], 1000.0, 0.5, sensor=2))


def test_positions_of_the_caller_stay_as_they_are():
    bias = (Bias(east=[0.0, 0.0]), Bias(east=[0.0, 25.0]))
    history = BiasHistory(np.array([0.0, 60.0, 120.0]), bias)
    given = np.array([[100.0, 5.0], [200.0, 6.0]])
    plots = Plots([10.0, 90.0], sensor=[1, 1], position=given)
    corrected = history.correct(plots)
    np.testing.assert_allclose(corrected.position, [[100.0, 5.0], [175.0, 6.0]])
    np.testing.assert_array_equal(plots.position, [[100.0, 5.0], [200.0, 6.0]])
    np.testing.assert_array_equal(given, [[100.0, 5.0], [200.0, 6.0]])


def test_result():
    assert_result(registered(1).bias_history)


def test_a_tracker_goes_on_from_a_registration():
    course = constant(7)
    course[:, 1, 2] += np.radians(0.3)
    plots, exact = recording(7, course)
    first = plots.time < 450.0
    found = register(plots[first], radars())
    later = plots[~first]
    tracker = Tracker(radars(), registration=found)
    for name in KINDS:
        np.testing.assert_allclose(getattr(tracker.bias, name), getattr(found.bias, name))
        sigma = getattr(found.bias, f"{name}_sigma")
        np.testing.assert_allclose(getattr(tracker.bias, f"{name}_sigma"), sigma, rtol=1e-9)
    again = pickle.loads(pickle.dumps(tracker))
    known = track(later, radars(), registration=found)
    unknown = track(later, radars())
    best = track(exact[~first], [replace(one, bias=Bias()) for one in radars()])

    def rmse(table):
        table = table[(table.plot >= 0) & (table.time < 500.0)]
        _, here, there = np.intersect1d(table.plot, best.plot, return_indices=True)
        return np.sqrt(np.mean((table.position[here] - best.position[there]) ** 2))

    assert rmse(known) < 0.7 * rmse(unknown)
    same = [one.update(later[:500]) for one in (tracker, again)]
    np.testing.assert_array_equal(same[0].position, same[1].position)
    # large errors are not sought, so no rows wait for that
    assert len(same[0]) > 0


def test_registrations_that_a_tracker_cannot_take():
    found = registered(1)
    assert_refused(lambda: Tracker(radars(2), registration=found), ValueError, "registration")
    assert_refused(lambda: Tracker(radars(), registration="on"), TypeError, "registration")
    with pytest.raises(ValueError, match="lag"):
        Tracker(radars(), registration=found, lag=5.0)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_step_of_the_clock_is_in_the_covariance_whichever_radar_has_it(seed):
    course = np.zeros((int(DURATION / STEP) + 2, 2, 4))
    course[int(0.5 * DURATION / STEP) :, seed, 3] = 1.0
    plots, exact = recording(seed, course, 2)
    best = track(exact, [replace(one, bias=Bias()) for one in radars(2)])
    for kind, found in (
        ("live", track(plots, radars(2))),
        ("smoothed", smooth_tracks(plots, radars(2))),
    ):
        late = found[(found.time > 0.65 * DURATION) & (found.plot >= 0)]
        _, here, there = np.intersect1d(late.plot, best.plot, return_indices=True)
        off = late.position[here] - best.position[there]
        sigma = late.covariance[here, :2, :2] + best.covariance[there, :2, :2]
        assert np.mean(in_region(off, sigma)) > 0.85, kind
    # the difference between the clocks is known, their mean is not
    bias = register(plots, radars(2)).bias
    assert abs(abs(bias.time[1] - bias.time[0]) - 1.0) < 0.05
    assert np.all(np.asarray(bias.time_sigma) > 0.3)
