"""Inputs whose bearing used to be wrong with a small sigma: right, or flagged."""

import numpy as np
import pytest

from tertia.bearing import estimate_bearing


@pytest.mark.parametrize(("share", "size"), [(0.2, 5.0), (0.4, 8.0)])
@pytest.mark.parametrize("burst", [False, True], ids=["isolated", "burst"])
def test_a_thousand_of_which_many_are_off_to_one_side(share, size, burst):
    """Nothing was flagged; 182.83 ± .21, where the median has 180.9 and the truth is 180."""
    random = np.random.default_rng(16)
    errors, sigmas, middles = [], [], []
    for _ in range(40):
        x = 180.0 + random.standard_normal(1000)
        hit = int(share * 1000)
        first = random.integers(1000 - hit)
        at = np.arange(first, first + hit) if burst else random.permutation(1000)[:hit]
        x[at] += size
        found = estimate_bearing(x)
        assert abs(found.outlier.sum() / hit - 1) < 0.05
        errors.append(found.value - 180.0)
        sigmas.append(found.sigma)
        middles.append(np.median(x) - 180.0)
    # the mean of the good ones alone has a sigma of .035 or .041
    assert np.sqrt(np.mean(np.square(errors))) < 0.055
    assert np.sqrt(np.mean(np.square(middles))) > 0.25
    assert np.mean(np.abs(errors) < 2 * np.array(sigmas)) >= 0.88


@pytest.mark.parametrize("count", [30, 1000])
def test_noise_without_a_direction(count):
    """It was 203 ± 5.9 of 400 bearings all around: an arbitrary direction was within 2σ in 7 %."""
    found = estimate_bearing(np.random.default_rng(12).uniform(0.0, 360.0, (200, count)))
    off = (found.value - 100.0 + 180.0) % 360.0 - 180.0
    assert np.mean(np.abs(off) < 2 * found.sigma) > 0.9


def test_a_weak_direction_is_one():
    weak = (100.0 + 60.0 * np.random.default_rng(13).standard_normal((200, 50))) % 360.0
    sigma = estimate_bearing(weak).sigma
    assert np.median(sigma) < 15.0
    assert np.max(sigma) < 100.0


@pytest.mark.parametrize("count", [5, 1000])
def test_a_stuck_instrument(count):
    """It was 123 ± 0. What never changes does not tell how far it is off."""
    assert estimate_bearing(np.full(count, 123.0)).sigma == np.inf


@pytest.mark.parametrize("share", [0.3, 0.6])
def test_an_instrument_that_is_stuck_for_a_while(share):
    errors = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        theta = np.round(rng.standard_normal(40), 2)
        first = rng.integers(0, 40 - int(40 * share))
        theta[first : first + int(40 * share)] = theta[first]
        estimate = estimate_bearing(theta)
        errors.append(((estimate.value + 180) % 360 - 180) / estimate.sigma)
        assert estimate.outlier[first + 1 : first + int(40 * share)].all()
    assert np.mean(np.abs(errors) < 2) > 0.88


def test_rows_that_were_recorded_several_times():
    theta = 100 + np.round(2 * np.random.default_rng(3).standard_normal((5, 30)), 1)
    once, often = (estimate_bearing(np.repeat(theta, times, -1)) for times in (1, 10))
    assert np.all(np.abs(often.value - 100) < 3 * often.sigma)
    assert np.all(often.sigma > 0.8 * once.sigma)


@pytest.mark.parametrize(("noise", "step"), [(0.2, 1.0), (1.0, 1.0), (3.0, 1.0), (1.0, 0.1)])
def test_what_rounding_makes_equal_is_not_repeated(noise, step):
    rng = np.random.default_rng(4)
    theta = np.round(noise * rng.standard_normal((200, 100)) / step) * step % 360
    assert np.mean(estimate_bearing(theta, period=360.0).outlier) < 0.01


def test_whole_degrees_that_were_recorded_several_times():
    """Half of the record was called outliers; 38 % to 83 % of the intervals held the truth."""
    rng = np.random.default_rng(8)
    for noise, count, times in [(1.5, 300, 2), (0.7, 300, 4), (1.5, 1000, 2), (3.0, 160, 8)]:
        once = np.round(100.3 + noise * rng.standard_normal((60, count // times)))
        held = np.repeat(once, times, -1)[:, times // 2 :]
        found, expected = estimate_bearing(held), estimate_bearing(once)
        np.testing.assert_allclose(found.value, expected.value, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(found.sigma, expected.sigma, rtol=1e-9)
        assert np.mean(np.abs(found.value - 100.3) < 2 * found.sigma) > 0.93


def test_whole_degrees_that_are_recorded_again_at_random():
    rng = np.random.default_rng(9)
    once = np.round(100.3 + 1.5 * rng.standard_normal((60, 300)))
    place = np.cumsum(rng.random((60, 300)) < 0.5, axis=-1)
    found = estimate_bearing(np.take_along_axis(once, place, axis=-1))
    assert np.mean(np.abs(found.value - 100.3) < 2 * found.sigma) > 0.93
    # 0.12 is the standard deviation of the mean of 150
    assert np.median(found.sigma) < 0.17
    assert np.sqrt(np.mean((found.value - 100.3) ** 2)) < 0.2


def test_outliers_between_equal_measurements_are_not_what_differs():
    """Equal measurements were left out, because those that differ are outliers, far apart."""
    rng = np.random.default_rng(10)
    theta = np.round(100.1 + 0.2 * rng.standard_normal((40, 100)))
    wrong = rng.random(theta.shape) < 0.2
    theta[wrong] = np.round(rng.uniform(80.0, 120.0, wrong.sum()))
    assert np.mean(estimate_bearing(theta).outlier[~wrong]) < 0.01
