"""Noise and biases of simulated radars: accuracy, coverage, what is unknown, invariants."""

import dataclasses
import pickle
import warnings
from dataclasses import replace

import numpy as np
import pytest
from checks import assert_refused, assert_result, assert_same, rng
from registration.scenes import (
    ERRORS,
    KINDS,
    LIMITS,
    PLACES,
    columns,
    constant,
    radars,
    recording,
)
from scipy import stats
from tolerances import CHANCE

from tertia import simulate
from tertia.registration import calibrate, register
from tertia.sensors import Bias, Station
from tertia.tracker import Plots, Tracker, track


def test_coverage_of_noise_and_errors():
    """Errors over their standard deviations, of 20 recordings of three radars."""
    random, noise, squares, within = rng(7), [], [], 0
    for seed in range(20):
        factor = random.uniform(0.5, 2.5, (3, 2))
        true = random.normal(size=(3, 4)) * LIMITS
        bias = Bias(**{kind: true[:, j] for j, kind in enumerate(ERRORS)})
        found = register(recording(seed, factor, bias), radars())
        for i, kind in enumerate(KINDS):
            off = getattr(found.noise_factor, kind) - factor[:, i]
            noise.append(off / getattr(found.noise_factor_sigma, kind))
        off = columns(found.bias) - true
        within += np.count_nonzero(np.abs(off / columns(found.bias, "_sigma")) < 2)
        squares.append(off.ravel() @ np.linalg.solve(found.covariance, off.ravel()))
    assert np.count_nonzero(np.abs(np.concatenate(noise)) < 2) > stats.binom.ppf(CHANCE, 120, 0.9)
    # errors of one recording are correlated
    assert within > 0.9 * 240
    low, high = stats.chi2.ppf([CHANCE, 1 - CHANCE], 240)
    assert 0.9 * low < np.sum(squares) < 1.1 * high


@pytest.mark.parametrize("azimuth", [0.0, 0.1, 0.2, 0.3, 0.5, 1.0])
@pytest.mark.parametrize("offset", [0.0, 300.0])
def test_errors_far_beyond_the_limits_are_found(azimuth, offset):
    """One aircraft has one track, whatever one of two radars is off."""
    bias = Bias(range=[0.0, offset], azimuth=[0.0, azimuth], degrees=True)
    plots = simulate.radar_plots(
        simulate.dense_traffic(20, area=(1e5, 1e5), rng=11), radars()[:2], bias=bias, rng=12
    ).plots
    found = register(plots, radars()[:2])
    off = np.degrees(found.bias.azimuth) - [0.0, azimuth]
    assert np.all(np.abs(off) < 0.015)
    assert np.all(np.abs(found.bias.range - [0.0, offset]) < 40.0)
    tracks = track(plots, found.sensors)
    assert len(np.unique(tracks.track[tracks.confirmed])) <= 21


def test_a_trusted_radar_has_no_errors():
    trusted = [replace(radars()[0], bias=Bias()), *constant()[1:]]
    found = register(recording(3, bias=Bias(range=[0.0, 120.0, 0.0])), trusted)
    assert found.bias.range[0] == found.bias.range_sigma[0] == 0.0
    assert abs(found.bias.range[1] - 120.0) < 3 * found.bias.range_sigma[1]
    free = register(recording(3, bias=Bias(range=[0.0, 120.0, 0.0])), constant())
    assert np.all(columns(found.bias, "_sigma")[1:] < columns(free.bias, "_sigma")[1:])


def test_what_is_known_of_a_radar_is_used():
    known = Bias(range=250.0, range_sigma=1.0, azimuth_sigma=1e-5)
    sensors = [replace(radars()[0], bias=known), *radars()[1:]]
    found = register(recording(4, bias=Bias(range=[250.0, 0.0, 0.0])), sensors)
    assert abs(found.bias.range[0] - 250.0) < 3.0
    assert found.bias.azimuth_sigma[0] < 1e-5


def test_noise_that_changes_is_seen_in_its_time():
    before, after = recording(2), recording(2, np.array([[1, 1], [3, 1], [1, 2.0]]))
    early, late = before.time < 150.0, after.time >= 150.0
    columns = {
        name: np.concatenate([getattr(before, name)[early], getattr(after, name)[late]])
        for name in ("time", "range", "azimuth", "sensor", "height", "identity")
    }
    history = register(Plots(**columns), radars()).noise_history
    middle = (history.edges[:-1] + history.edges[1:]) / 2
    away = np.abs(middle - 150.0) > 30.0
    for kind, k, level in (("range", 1, 3.0), ("azimuth", 2, 2.0), ("range", 0, 1.0)):
        expected = np.where(middle < 150.0, 1.0, level)
        off = getattr(history.factor, kind)[k] - expected
        assert np.all(np.abs(off / getattr(history.sigma, kind)[k])[away] < 4.5), (kind, k)


def test_one_target_shows_the_noise_of_the_whole_recording():
    traffic = simulate.dense_traffic(1, area=(1e5, 1e5), turning_share=0.0, rng=1)
    plots = simulate.radar_plots(traffic, radars(order=(0, 1)), rng=2).plots
    found = register(plots, radars(order=(0, 1)))
    for kind in KINDS:
        factor, sigma = getattr(found.noise_factor, kind), getattr(found.noise_factor_sigma, kind)
        assert np.all(np.abs(factor - 1.0) < 4 * sigma)
        assert np.isnan(getattr(found.noise_history.factor, kind)).all()


def test_what_differences_do_not_show_is_unknown():
    plots = recording(3)
    own = plots[plots.sensor == 0]
    lone = register(own, radars()[:1])
    np.testing.assert_allclose(columns(lone.bias, "_sigma")[0], LIMITS, rtol=1e-12)
    assert not any(seen[0] for seen in lone.observable.values())
    assert "unknown" in repr(lone)
    np.testing.assert_allclose(lone.noise_factor.range, 1.0, atol=0.1)
    empty = register(plots[:0], radars())
    assert np.all(np.isnan(empty.noise_factor.range))
    np.testing.assert_allclose(empty.bias.range_sigma, LIMITS[0])


def test_radars_at_one_place_determine_differences_alone():
    """Turns of flights were taken for range errors: 40 m in common here, 2 km in a recording."""
    for seed in range(2):
        random = rng(60 + seed)
        routes = simulate.routes("tma", 15, rng=random)
        traffic = simulate.flights(routes, wind=15.0, rng=random)
        both = [replace(radars()[0], scan_period=4.0, max_range=150e3)] * 2
        bias = Bias(range=[0.0, 150.0])
        seen = simulate.radar_plots(traffic, both, bias=bias, rng=random).plots
        found = register(seen[seen.time < seen.time[0] + 600.0], both)
        first, second = found.bias.range
        assert abs(second - first - 150.0) < 40.0
        assert abs(first + second) < 15.0
        assert np.all(found.bias.range_sigma > 65.0)
        assert len(found.changes) == 0


def test_outliers_do_not_move_what_is_found():
    clean = register(recording(4, outlier_probability=0.0), radars())
    dirty = register(recording(4, outlier_probability=0.05), radars())
    for kind in KINDS:
        change = getattr(dirty.noise_factor, kind) / getattr(clean.noise_factor, kind)
        np.testing.assert_allclose(change, 1.0, atol=0.1)
        sigma = getattr(clean.bias, f"{kind}_sigma")
        assert np.all(np.abs(getattr(dirty.bias, kind) - getattr(clean.bias, kind)) < 4 * sigma)


def test_tracks_threads_and_pickle_change_nothing():
    plots = recording(5)
    found = register(plots, radars())
    assert_result(found.bias)
    assert_result(found.noise_history)
    given = register(plots, radars(), tracks=track(plots, radars()))
    off = columns(given.bias) - columns(found.bias)
    assert np.all(np.abs(off) < 0.3 * columns(found.bias, "_sigma"))
    for again in (
        register(plots, radars(), n_threads=1),
        pickle.loads(pickle.dumps(found)),
    ):
        assert_same(again.bias, found.bias)
        assert_same(again.noise_factor, found.noise_factor)
        assert_same(again.noise_history.factor, found.noise_history.factor)


def test_radars_in_another_order():
    plots = recording(6, bias=Bias(range=[0.0, 200.0, 0.0], azimuth=[0.0, 0.0, 0.001]))
    found = register(plots, radars())
    order = np.array([2, 0, 1])
    given = {
        name: getattr(plots, name) for name in ("time", "range", "azimuth", "height", "identity")
    }
    moved = Plots(**given, sensor=np.argsort(order)[plots.sensor])
    other = register(moved, radars(order=order))
    # what is left of the start, which goes radar by radar
    off = columns(other.bias) - columns(found.bias)[order]
    assert np.all(np.abs(off) < 1e-5 * columns(other.bias, "_sigma"))
    for kind in KINDS:
        expected = getattr(found.noise_factor, kind)[order]
        np.testing.assert_allclose(getattr(other.noise_factor, kind), expected, rtol=1e-5)


def test_sensors_have_the_noise_that_was_found():
    found = register(recording(8, np.full((3, 2), 2.0)), radars())
    for k, (before, after) in enumerate(zip(radars(), found.sensors, strict=True)):
        assert after.range_sigma == pytest.approx(before.range_sigma * found.noise_factor.range[k])
        assert after.scan_period == before.scan_period
    assert dataclasses.is_dataclass(found)


def test_bad_input():
    plots = recording(9)
    assert_refused(lambda: register(plots, []), ValueError, "sensors is empty")
    tracks = track(plots[:100], radars())
    assert_refused(lambda: register(plots, radars(), tracks=tracks), ValueError, "tracks is of 100")


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"range": [1e3, np.inf]}, "range[1] is inf"),
        ({"azimuth": [0.0, np.inf]}, "azimuth[1] is inf"),
        ({"azimuth": [0.0, 0.0], "deviation_order": 100_000}, "deviation_order is 100000"),
    ],
)
def test_calibrations_that_are_refused(given, text):
    finder = Station([0.0, 0.0], range_sigma=5.0, azimuth_sigma=0.02)
    place = [[0.0, 1e3], [0.0, 2e3]]
    assert_refused(lambda: calibrate(finder, [0.0, 1.0], place, **given), ValueError, text)


def test_a_position_that_is_wrong_is_told():
    """The tracks of two radars agree after a rotation and a change of scale."""
    stated = [replace(one, bias=None) for one in radars()[:2]]
    true = [stated[0], replace(stated[1], position=PLACES[1] + [450.0, -350.0])]
    traffic = simulate.dense_traffic(30, area=(1.5e5, 1.5e5), turning_share=0.1, rng=31)
    plots = simulate.radar_plots(traffic, true, rng=32).plots
    told = r"sensors\[0\], sensors\[1\]: all azimuths are .* as if one of .* 0\.5\d km from"
    with pytest.warns(UserWarning, match=told):
        register(plots, stated)
    with pytest.warns(UserWarning, match=told):
        track(plots, stated)
    tracker, live = Tracker(stated), []
    for begin in np.arange(0.0, plots.time.max(), 5.0):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            tracker.update(plots[(plots.time >= begin) & (plots.time < begin + 5.0)])
        live += said
    (one,) = live
    assert "km from its position" in str(one.message)
    track(plots, true)
