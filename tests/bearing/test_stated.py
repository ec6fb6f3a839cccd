"""Bearings whose noise is stated, from one measurement on."""

import numpy as np
import pytest
from checks import assert_refused
from reference import bearing as reference

import tertia
from tertia import estimate_bearing


def rng(*seed: int) -> np.random.Generator:
    return np.random.default_rng([20, *seed])


def record(n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a record with some outliers, and different sigmas."""
    random = rng(n, seed)
    sigma = random.uniform(1.0, 4.0, n)
    wrong = random.random(n) < 0.2
    y = 40.0 + sigma * (random.standard_normal(n) + wrong * random.uniform(-15.0, 15.0, n))
    return y, sigma


def test_one_measurement_has_the_sigma_that_is_stated() -> None:
    found = estimate_bearing([359.0], sigma=2.0)
    assert (found.value, found.sigma, found.noise_factor) == (359.0, 2.0, 1.0)
    assert not found.outlier.any()
    assert np.isnan(found.pvalue)
    assert estimate_bearing([359.0], sigma=3.0, bias_sigma=4.0).sigma == pytest.approx(5.0)
    with pytest.raises(ValueError, match="theta has 0 measurements; at least 1 are needed"):
        estimate_bearing([], sigma=2.0)
    with pytest.raises(ValueError, match="theta has 4 measurements; at least 5 are needed"):
        estimate_bearing([1.0, 2.0, 3.0, 4.0])


@pytest.mark.parametrize("n", [2, 3, 4])
def test_measurements_that_agree_have_their_weighted_mean(n: int) -> None:
    sigma = np.arange(1.0, n + 1)
    y = (358.0 + sigma * np.resize([0.3, -0.2], n)) % 360
    found = estimate_bearing(y, sigma=sigma)
    weight = sigma**-2 / np.sum(sigma**-2)
    assert found.value == pytest.approx(358.0 + weight @ (sigma * np.resize([0.3, -0.2], n)), 1e-4)
    # a little more, because an outlier may be among them
    exact = np.sum(sigma**-2) ** -0.5
    assert exact < found.sigma < 1.02 * exact


@pytest.mark.parametrize("correlation", [0.0, 0.6, -0.3])
@pytest.mark.parametrize("n", [2, 3, 5, 12, 40, 100])
@pytest.mark.parametrize("seed", range(4))
def test_agrees_with_the_formulas(n: int, seed: int, correlation: float) -> None:
    y, sigma = record(n, seed)
    found = estimate_bearing(y, sigma=sigma, period=None, correlation=correlation)
    value, width, outlier, factor = reference.stated(y, sigma, correlation)
    assert (found.value, found.sigma, found.noise_factor) == pytest.approx(
        (value, width, factor), rel=1e-9
    )
    np.testing.assert_array_equal(found.outlier, outlier)
    blocks = found.block_weights @ np.nan_to_num(found.block_means)
    assert blocks == pytest.approx(found.value, abs=1e-3 * found.sigma)


@pytest.mark.parametrize("y", [[0.0, 7.0], [0.0, 1.0, 5.0, 5.5], [0.0, 5.0], [0.0, 3.0]])
def test_agrees_with_the_posterior_of_all_subsets_that_may_be_good(y: list[float]) -> None:
    """Mean and standard deviation, integrated over the bearing with the factor that is found."""
    found = estimate_bearing(y, sigma=1.0, period=None)
    f = found.noise_factor
    theta = np.linspace(-30.0, 40.0, 20_001)
    z = (theta - np.array(y)[:, np.newaxis]) / f
    bad = 0.1 / 0.9 * np.sqrt(2 * np.pi) / 40
    # without the case that none is good
    density = np.prod(np.exp(-0.5 * z**2) + bad, axis=0) - bad ** len(y)
    density /= density.sum()
    mean = density @ theta
    assert found.value == pytest.approx(mean, abs=0.1)
    assert found.sigma == pytest.approx(np.sqrt(density @ (theta - mean) ** 2), rel=0.15)


def test_two_that_contradict_each_other_do_not_tell_which_is_bad() -> None:
    found = estimate_bearing([0.0, 30.0], sigma=1.0)
    assert (found.value, found.sigma) == (pytest.approx(15.0), pytest.approx(15.0, rel=0.01))
    assert not found.outlier.any()
    # a third decides
    found = estimate_bearing([0.0, 30.0, 29.0], sigma=1.0)
    assert found.outlier.tolist() == [True, False, False]
    assert (found.value, found.sigma) == (pytest.approx(29.5, abs=0.2), pytest.approx(0.7, abs=0.5))


@pytest.mark.parametrize("n", [1, 2, 3, 5, 20, 100])
def test_sigma_is_never_smaller_than_stated(n: int) -> None:
    for seed in range(40):
        y, sigma = record(n, seed)
        y = 40.0 + rng(seed).choice([0.0, 0.1, 1.0]) * (y - 40.0)
        found = estimate_bearing(y, sigma=sigma)
        assert found.sigma >= (1 - 1e-12) * np.sum(sigma**-2) ** -0.5
        assert found.noise_factor >= 1


@pytest.mark.parametrize("factor", [2.0, 4.0])
def test_noise_of_which_too_little_is_stated(factor: float) -> None:
    y = factor * rng(3).standard_normal((200, 60))
    found = estimate_bearing(y, sigma=1.0, period=None)
    assert np.median(found.noise_factor) == pytest.approx(factor, rel=0.08)
    assert np.mean(found.pvalue < 0.001) > 0.99
    # and clean noise is not taken for more
    found = estimate_bearing(y / factor, sigma=1.0, period=None)
    assert np.median(found.noise_factor) < 1.05
    assert np.mean(found.pvalue < 0.05) < 0.12
    assert np.isnan(estimate_bearing(y, period=None).noise_factor).all()


@pytest.mark.parametrize(
    ("n", "noise", "outliers", "least"),
    [
        (2, 1.0, 0.0, 0.93),
        (5, 1.0, 0.0, 0.93),
        (20, 1.0, 0.0, 0.93),
        (2, 1.0, 0.2, 0.91),
        (5, 1.0, 0.2, 0.90),
        (20, 1.0, 0.2, 0.93),
        (5, 2.0, 0.0, 0.79),
        (20, 2.0, 0.0, 0.88),
    ],
)
def test_the_error_bar_holds(n: int, noise: float, outliers: float, least: float) -> None:
    random = rng(4, n)
    y = noise * random.standard_normal((1500, n))
    y += np.where(random.random(y.shape) < outliers, random.choice([-1, 1], y.shape), 0) * 10
    found = estimate_bearing(y, sigma=1.0, period=None)
    assert np.mean(np.abs(found.value) < 2 * found.sigma) > least


def test_a_correlation_is_found_or_given() -> None:
    random = rng(5)
    y = random.standard_normal((300, 100))
    for step in range(1, 100):
        y[:, step] = 0.7 * y[:, step - 1] + np.sqrt(1 - 0.49) * y[:, step]
    found = estimate_bearing(y, sigma=1.0, period=None)
    assert np.median(found.correlation) == pytest.approx(0.7, abs=0.1)
    assert np.mean(np.abs(found.value) < 2 * found.sigma) > 0.91
    white = estimate_bearing(y, sigma=1.0, period=None, correlation=0.0)
    assert np.mean(np.abs(white.value) < 2 * white.sigma) < 0.75
    # exactly, of two
    pair = estimate_bearing([7.0, 7.0], sigma=1.0, correlation=0.5).sigma
    assert pair == pytest.approx(estimate_bearing([7.0, 7.0], sigma=1.0).sigma * np.sqrt(1.5))


def test_groups() -> None:
    random = rng(6)
    labels = np.repeat(np.arange(6), 4)
    y = 50.0 + np.repeat(random.normal(0, 5.0, (300, 6)), 4, axis=1)
    y += random.standard_normal(y.shape)
    found = estimate_bearing(y, sigma=1.0, groups=labels)
    assert found.systematic == "estimated"
    assert np.mean(np.abs(found.value - 50) < 2 * found.sigma) > 0.93
    assert np.median(found.bias_sigma) == pytest.approx(5.0, rel=0.3)
    given = estimate_bearing(y, sigma=1.0, groups=labels, bias_sigma=5.0)
    np.testing.assert_allclose(np.median(given.sigma), np.hypot(5.0, 0.5) / np.sqrt(6), rtol=0.1)
    # every label once: the errors of groups are told from random ones of the stated size
    once = estimate_bearing(y[:, ::4], sigma=1.0, groups=np.arange(6))
    assert once.systematic == "estimated"
    assert np.mean(np.abs(once.value - 50) < 2 * once.sigma) > 0.93
    assert np.median(once.bias_sigma) == pytest.approx(5.0, rel=0.3)
    # if no size is stated, they cannot be told apart
    assert estimate_bearing(y[0, ::4], groups=np.arange(6)).bias_sigma == 0.0
    # and a wrong measurement in a group is left out
    y[0, 5] += 40.0
    assert np.flatnonzero(estimate_bearing(y[0], sigma=1.0, groups=labels).outlier).tolist() == [5]


def test_rounding() -> None:
    stuck = estimate_bearing([7.0] * 20, sigma=0.1, rounding=1.0)
    assert stuck.sigma == pytest.approx(np.sqrt(1 / 12), rel=0.2)
    assert estimate_bearing([7.0] * 20, sigma=0.1).sigma == pytest.approx(0.1 / np.sqrt(20), 0.01)


@pytest.mark.parametrize(("step", "n"), [(1.0, 5), (1.0, 20), (0.1, 100)])
def test_rounding_that_equal_measurements_show(step: float, n: int) -> None:
    """10 % to 41 % of the intervals held the truth: all measurements, or nearly all, are equal."""
    random = rng(n)
    truth = random.uniform(0.0, 360.0, (200, 1))
    y = step * np.round((truth + 0.2 * step * random.standard_normal((200, n))) / step)
    found = estimate_bearing(y, sigma=0.2 * step)
    off = (found.value - truth[:, 0] + 180) % 360 - 180
    assert np.mean(np.abs(off) < 2 * found.sigma) > 0.9
    known = estimate_bearing(y, sigma=0.2 * step, rounding=step)
    assert np.mean(found.sigma == known.sigma) > 0.9


def test_batches_gaps_units_and_north() -> None:
    y, sigma = record(30, 1)
    rows = np.stack([y, y[::-1], np.where(np.arange(30) % 7 == 3, np.nan, y)])
    sigmas = np.stack([sigma, sigma[::-1], sigma])
    batch = estimate_bearing(rows, sigma=sigmas, nan_policy="omit", n_threads=2)
    for k in range(3):
        there = ~np.isnan(rows[k])
        alone = estimate_bearing(rows[k][there], sigma=sigmas[k][there])
        assert (batch.value[k], batch.sigma[k]) == (alone.value, alone.sigma)
        np.testing.assert_array_equal(batch.outlier[k][there], alone.outlier)
    # one row of sigmas for all, one number for all
    shared = estimate_bearing(rows[:2], sigma=sigma)
    assert shared.sigma[0] == batch.sigma[0]
    equal = estimate_bearing(rows[:2], sigma=2.0)
    assert equal.sigma[0] == estimate_bearing(y, sigma=np.full(30, 2.0)).sigma
    turned = estimate_bearing((y - 40.0) % 360, sigma=sigma)
    assert (turned.value + 180) % 360 - 180 == pytest.approx(batch.value[0] - 40.0, abs=1e-6)
    milliradians = estimate_bearing(y * 1e3, sigma=sigma * 1e3, period=360e3)
    assert milliradians.sigma == pytest.approx(1e3 * batch.sigma[0], rel=1e-9)


@pytest.mark.parametrize(
    ("sigma", "error", "message"),
    [
        (0.0, ValueError, "sigma is 0.0; it must be a positive number"),
        (np.nan, ValueError, "sigma is nan; it must be a positive number"),
        ([1.0, -1.0, 1.0], ValueError, "sigma[1] is -1; it must be a positive number, from 1e-100"),
        ([1.0, np.nan, 1.0], ValueError, "sigma[1] is nan; it must be a positive number"),
        ([1.0, 1.0], ValueError, "sigma has shape (2,); it must be a number, or have the shape of"),
        ("2", TypeError, "sigma has dtype"),
    ],
)
def test_bad_sigmas(sigma: object, error: type[Exception], message: str) -> None:
    assert_refused(lambda: estimate_bearing([1.0, 2.0, 3.0], sigma=sigma), error, message)


def test_only_the_robust_method_takes_it() -> None:
    with pytest.raises(ValueError, match="sigma needs method='robust'; method is 'mean'"):
        tertia.estimate_bearing([1.0, 2.0, 3.0], sigma=1.0, method="mean")


@pytest.mark.parametrize(("n", "step"), [(60, 10.0), (300, 10.0), (300, 5.0)])
def test_the_rounding_is_seen_beside_a_stated_sigma(n: int, step: float) -> None:
    """Noise of 3° on steps of 10°: what rounding leaves in the mean is more than sigma over √n."""
    held = []
    for seed in range(200):
        random = rng(n, int(step), seed)
        true = random.uniform(0.0, 360.0)
        y = np.round((true + 3.0 * random.standard_normal(n)) / step) * step % 360.0
        found = estimate_bearing(y, sigma=3.0)
        error = (found.value - true + 180.0) % 360.0 - 180.0
        held.append(abs(error) < 1.96 * found.sigma)
    assert np.mean(held) > 0.9


def test_a_gap_of_many_sigmas_is_no_rounding() -> None:
    """Two equal measurements and one elsewhere do not show steps of 30°."""
    found = estimate_bearing([10.0, 10.0, 40.0], sigma=3.0)
    assert found.outlier.tolist() == [False, False, True]
    assert found.sigma < 3.0


def test_distant_measurements_do_not_hide_the_others() -> None:
    found = estimate_bearing([102.7, 100.0, 100.0, 100.0, 100.0, 117.2, 100.0, 164.1], sigma=0.03)
    assert found.value == pytest.approx(100.0, abs=1e-9)
    np.testing.assert_array_equal(np.flatnonzero(found.outlier), [0, 5, 7])
