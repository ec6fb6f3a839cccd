"""Records whose errors change slowly: drifts, 1/f noise, and outliers beside them."""

import numpy as np
import pytest
from checks import correlated
from reference import bearing as reference
from tolerances import PARITY

from tertia import estimate_bearing


def record(kind, n, count, seed=1):
    """Unit noise and something slow, about 0 over the record."""
    rng = np.random.default_rng([seed, n])
    time, noise = (np.arange(n) + 0.5) / n, rng.normal(size=(count, n))
    walk = np.cumsum(rng.normal(size=(count, n)), axis=1) * 2.5 / np.sqrt(n)
    slow = {
        "none": np.zeros((count, n)),
        "drift": np.broadcast_to(5 * (time - 0.5), (count, n)),
        "sine": 2.5 * np.sin(2 * np.pi * (time + rng.uniform(size=(count, 1)))),
        "walk": walk - walk.mean(axis=1, keepdims=True),
    }[kind]
    return noise + slow, rng


def pink(n, count):
    """1/f noise of unit variance with periods of up to eight records."""
    rng, f = np.random.default_rng(n), np.fft.rfftfreq(8 * n)[1:]
    z = (rng.normal(size=(count, len(f))) + 1j * rng.normal(size=(count, len(f)))) / np.sqrt(f)
    y = np.fft.irfft(np.c_[np.zeros(count), z], 8 * n)
    return y[:, :n] / np.sqrt(np.mean(y**2))


@pytest.mark.parametrize("kind", ["drift", "sine", "walk"])
@pytest.mark.parametrize("n", [100, 300])
@pytest.mark.parametrize("outliers", [False, True])
def test_what_changes_slowly_is_no_outlier(kind, n, outliers):
    y, rng = record(kind, n, 60)
    bad = rng.uniform(size=y.shape) < (0.15 if outliers else 0.0)
    estimate = estimate_bearing(y + 6.0 * bad, period=None)
    assert np.mean(np.abs(estimate.value) < 2 * estimate.sigma) > 0.9
    # the mean of the good measurements has 1/sqrt(n)
    assert np.sqrt(np.mean(estimate.value**2)) < 2.5 / np.sqrt(n)
    assert np.mean(estimate.outlier != bad) < 0.05


@pytest.mark.parametrize("n", [300, 1000])
def test_the_error_bar_allows_for_flicker(n):
    estimate = estimate_bearing(pink(n, 60), period=None)
    assert np.mean(np.abs(estimate.value) < 2 * estimate.sigma) > 0.85


def wandering(n, count, *, time, ratio, seed=1):
    """White noise of unit variance, and a Gauss-Markov process of this time in steps."""
    rng, phi = np.random.default_rng([seed, n]), np.exp(-1 / time)
    slow = correlated(rng.normal(size=(count, n)), phi)
    return ratio * slow + rng.normal(size=(count, n))


@pytest.mark.parametrize("time", [5.0, 15.0])
@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0])
def test_the_error_bar_of_a_finder_that_wanders_is_that_of_the_mean(time, ratio):
    estimate = estimate_bearing(wandering(1000, 60, time=time, ratio=ratio), period=None)
    assert np.mean(np.abs(estimate.value) < 2 * estimate.sigma) > 0.85
    error = np.sqrt(np.mean(estimate.value**2))
    assert 0.7 * error < np.median(estimate.sigma) < 2.5 * error


def test_the_error_bar_of_a_short_record_allows_for_a_finder_that_wanders():
    y = wandering(100, 300, time=15.0, ratio=1.0)
    estimate = estimate_bearing(y, period=None)
    assert np.mean(np.abs(estimate.value) < 2 * estimate.sigma) > 0.9


def assert_parity(y):
    """The bearing is that of the formulas; return it, and the weights of its blocks."""
    value, sigma, outlier, weight = reference.robust(y, 10)
    estimate = estimate_bearing(y, period=None)
    assert estimate.value == pytest.approx(value, rel=PARITY, abs=PARITY)
    assert estimate.sigma == pytest.approx(sigma, rel=PARITY)
    np.testing.assert_array_equal(estimate.outlier, outlier)
    return estimate, weight


def test_agrees_with_the_formulas_where_a_finder_wanders():
    y = wandering(90, 1, time=8.0, ratio=1.0, seed=5)[0]
    y[10] += 9.0
    assert_parity(y)


def test_the_result_says_that_values_drift():
    drifting = estimate_bearing(record("drift", 300, 1)[0][0], period=None)
    assert drifting.drifts
    assert "values drift" in repr(drifting)
    steady = estimate_bearing(record("none", 300, 20)[0], period=None)
    assert steady.drifts.shape == (20,)
    assert not steady.drifts.any()
    assert "values drift" not in repr(steady)


def test_a_correlation_that_is_given_leaves_no_room_for_a_drift():
    y = record("drift", 100, 1)[0][0]
    assert not estimate_bearing(y, period=None).outlier.any()
    assert estimate_bearing(y, period=None, correlation=0.0).outlier.sum() > 20


@pytest.mark.parametrize("kind", ["drift", "sine", "walk"])
@pytest.mark.parametrize("burst", [False, True])
def test_agrees_with_the_formulas(kind, burst):
    y = record(kind, 103, 1, seed=3)[0][0]
    y[40:52] += 8.0 * burst
    estimate, weight = assert_parity(y)
    np.testing.assert_allclose(estimate.block_weights, weight, rtol=PARITY, atol=1e-12)
