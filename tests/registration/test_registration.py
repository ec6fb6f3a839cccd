"""Noise and biases of simulated radars: accuracy, coverage, what is unknown, invariants."""

import dataclasses
import pickle

import numpy as np
import pytest
from checks import INF, assert_refused, assert_result, assert_same, rng
from reference import registration as reference
from scipy import stats
from tolerances import CHANCE, PARITY

from tertia import simulate
from tertia.registration import register
from tertia.registration._states import alone, common
from tertia.sensors import Radar
from tertia.tracker import Plots, track

STATED = np.array([50.0, 0.0014])
PLACES = np.array([[-5e4, 0.0], [5e4, 1e4], [0.0, 6e4]])
KINDS = ("range", "azimuth")
ONES = np.ones((3, 2))


def radars(factor=ONES, order=(0, 1, 2)):
    """Radars whose noise is so many times the stated one."""
    sigma = STATED * factor
    return [
        Radar(PLACES[k], range_sigma=sigma[k, 0], azimuth_sigma=sigma[k, 1], scan_period=4.0 + k)
        for k in order
    ]


def recording(seed, factor=ONES, bias=0.0, **options):
    traffic = simulate.dense_traffic(30, area=(1.5e5, 1.5e5), turning_share=0.1, rng=seed)
    seen = {"outlier_probability": 0.01, "rng": seed + 1000} | options
    return simulate.radar_plots(traffic, radars(factor), bias=bias, **seen).plots


def test_coverage_of_noise_and_biases():
    """Errors over their standard deviations, of 20 recordings of three radars."""
    random, errors = rng(7), {"noise": [], "bias": []}
    for seed in range(20):
        factor = random.uniform(0.5, 2.5, (3, 2))
        bias = random.normal(0.0, [60.0, 0.001], (3, 2))
        found = register(recording(seed, factor, bias), radars())
        for i, kind in enumerate(KINDS):
            off = getattr(found.noise_factor, kind) - factor[:, i]
            errors["noise"].append(off / getattr(found.noise_factor_sigma, kind))
            off = getattr(found.bias, kind) - bias[:, i]
            errors["bias"].append(off / getattr(found.bias, f"{kind}_sigma"))
    for values in errors.values():
        within = np.count_nonzero(np.abs(np.concatenate(values)) < 2)
        assert within > stats.binom.ppf(CHANCE, 120, 0.9)


def test_the_same_by_plain_formulas():
    plots = recording(1, bias=[[0.0, 0.0], [200.0, 0.002], [-90.0, 0.0]])
    joint = track(plots, radars())
    single = [alone(plots, radars(), k, track) for k in range(3)]
    states = common(joint, single, radars())
    value, sigma = reference.biases(states.state, states.covariance, states.track, PLACES, STATED)
    found = register(plots, radars(), tracks=joint)
    for i, kind in enumerate(KINDS):
        np.testing.assert_allclose(getattr(found.bias, kind), value[:, i], rtol=PARITY)
        np.testing.assert_allclose(getattr(found.bias, f"{kind}_sigma"), sigma[:, i], rtol=PARITY)


def test_noise_that_changes_is_seen_in_its_time():
    before, after = recording(2), recording(2, np.array([[1, 1], [3, 1], [1, 2.0]]))
    early, late = before.time < 150.0, after.time >= 150.0
    columns = {
        name: np.concatenate([getattr(before, name)[early], getattr(after, name)[late]])
        for name in ("time", "range", "azimuth", "sensor", "height", "identity")
    }
    history = register(Plots(**columns), radars()).history
    middle = (history.edges[:-1] + history.edges[1:]) / 2
    away = np.abs(middle - 150.0) > 30.0
    for kind, k, level in (("range", 1, 3.0), ("azimuth", 2, 2.0), ("range", 0, 1.0)):
        expected = np.where(middle < 150.0, 1.0, level)
        off = getattr(history.factor, kind)[k] - expected
        assert np.all(np.abs(off / getattr(history.sigma, kind)[k])[away] < 4.5), (kind, k)


def test_what_differences_do_not_show_is_unknown():
    plots = recording(3)
    own = plots[plots.sensor == 0]
    lone = register(own, radars()[:1])
    assert lone.bias.range_sigma[0] == lone.bias.azimuth_sigma[0] == INF
    assert "unknown" in repr(lone)
    np.testing.assert_allclose(lone.noise_factor.range, 1.0, atol=0.1)
    empty = register(plots[:0], radars())
    assert np.all(np.isnan(empty.noise_factor.range))
    assert np.all(empty.bias.range_sigma == INF)


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
    assert_result(found.history)
    for again in (
        register(plots, radars(), tracks=track(plots, radars())),
        register(plots, radars(), n_threads=1),
        pickle.loads(pickle.dumps(found)),
    ):
        assert_same(again.bias, found.bias)
        assert_same(again.noise_factor, found.noise_factor)
        assert_same(again.history.factor, found.history.factor)


def test_radars_in_another_order():
    plots = recording(6, bias=[[0.0, 0.0], [200.0, 0.0], [0.0, 0.001]])
    found = register(plots, radars())
    order = np.array([2, 0, 1])
    columns = {
        name: getattr(plots, name) for name in ("time", "range", "azimuth", "height", "identity")
    }
    moved = Plots(**columns, sensor=np.argsort(order)[plots.sensor])
    other = register(moved, radars(order=order))
    for kind in KINDS:
        expected = getattr(found.bias, kind)[order]
        np.testing.assert_allclose(getattr(other.bias, kind), expected, rtol=1e-9, atol=1e-12)
        expected = getattr(found.noise_factor, kind)[order]
        np.testing.assert_allclose(getattr(other.noise_factor, kind), expected, rtol=1e-9)


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
