"""What estimated weights cost, against draws, quadrature and printed values."""

import functools

import numpy as np
import pytest
from checks import assert_near, close, diagonal
from weights.cases import (
    CASES,
    CONVENTIONS,
    TWO,
    assert_is_covariance,
    assert_same_covariance,
    covariances,
    exact_scalar_loss,
    losses,
    mean_and_error,
    sampled,
    vec,
)

from tertia import simulate, weights

# % of the fused variances: what the specification prints, with half a unit of the last digit
PRINTED_LOSSES = [
    ("equal", 5, 41, 0.5),
    ("equal", 10, 16.7, 0.05),
    ("equal", 30, 5.2, 0.05),
    ("equal", 100, 1.5, 0.05),
    # the specification's crossed ellipses are others, with 50 and 17.4 for these two; found with
    # 400 000 trials in NumPy: 44.55 ± .07 and 16.81 ± .02
    ("crossed", 5, 44.6, 0.1),
    ("crossed", 10, 16.8, 0.05),
    ("crossed", 30, 4.8, 0.05),
    ("crossed", 100, 1.35, 0.005),
    ("ten times", 5, 57, 0.5),
    ("ten times", 10, 12.1, 0.05),
    ("ten times", 30, 2.2, 0.05),
    ("ten times", 100, 0.54, 0.005),
    ("equal, m = 3", 5, 72, 0.5),
    ("equal, m = 3", 10, 24, 0.5),
    ("equal, m = 3", 30, 7.0, 0.05),
    ("equal, m = 3", 100, 2.0, 0.05),
]


def simulated(s, n, trials=100_000, seed=0, **options):
    return weights.fusion_loss(s, n, method="monte-carlo", trials=trials, rng=seed, **options)


class TestLoss:
    @pytest.mark.parametrize(("case", "n", "percent", "rounding"), PRINTED_LOSSES)
    def test_printed(self, case, n, percent, rounding):
        found = simulated(CASES[case], n, seed=1)
        error = rounding / 100 + 4 * found.loss_sigma
        assert found.loss == pytest.approx(percent / 100, abs=error)

    @pytest.mark.parametrize("case", CASES)
    @pytest.mark.parametrize("n", [10, 30])
    def test_agrees_with_measurements(self, case, n):
        """Normal measurements, their sample covariances, weights by inversion."""
        s = np.array(CASES[case])
        mean, error = mean_and_error(losses(s, sampled(s, n, 25_000, n)))
        found = simulated(s, n)
        assert found.loss == pytest.approx(mean, abs=4 * np.hypot(error, found.loss_sigma))

    @pytest.mark.parametrize("s", [(1.0, 1.0), (1.0, 10.0), (300.0, 1.0)])
    @pytest.mark.parametrize("n", [(8, 8), (6, 20), (40, 12), (200, 200)])
    def test_of_scalars(self, s, n):
        exact = exact_scalar_loss(s, [count - 1 for count in n])
        found = simulated(np.reshape(s, (2, 1, 1)), n)
        assert found.loss == pytest.approx(exact, abs=4 * found.loss_sigma)

    def test_the_first_order_is_the_limit(self):
        """It is wrong by a share that goes as 1/n."""
        s = (1.0, 10.0)
        for n in (1001, 10_001):
            first = weights.fusion_loss(np.reshape(s, (2, 1, 1)), n, method="first-order").loss
            share = first / exact_scalar_loss(s, (n - 1, n - 1)) - 1
            assert 4 / n < -share < 10 / n

    @pytest.mark.parametrize("m", [1, 2, 3])
    def test_auto_is_right_to_a_twentieth(self, m):
        """Largest error seen: 4.4 %, of three sensors a thousand times apart."""
        cases = [
            [np.eye(m), np.eye(m)],
            [np.eye(m), 1e3 * np.eye(m)],
            [np.diag(10.0 ** np.arange(m)), np.diag(10.0 ** -np.arange(m))],
            [np.eye(m), 1e3 * np.eye(m), 1e-3 * np.eye(m)],
        ]
        least = 100 * (m + 1) + 1
        for s in cases:
            automatic = weights.fusion_loss(s, least)
            assert automatic.method == "first-order"
            assert automatic.loss_sigma is None
            assert weights.fusion_loss(s, least - 1, trials=10).method == "monte-carlo"
            exact = simulated(s, least, trials=40_000)
            room = 0.05 * exact.loss + 4 * exact.loss_sigma
            assert automatic.loss == pytest.approx(exact.loss, abs=room)

    def test_auto_looks_at_the_sensor_that_is_known_least(self):
        assert weights.fusion_loss(TWO, [10**6, 20], trials=10).method == "monte-carlo"
        assert weights.fusion_loss(TWO, [np.inf, 10**6]).method == "first-order"

    @pytest.mark.parametrize("convention", ["sample-mean", "known-mean", "paper"])
    def test_unequal_numbers_of_measurements(self, convention):
        """Exact in these conventions."""
        for case, n in (("ten times", (12, 25)), ("three", (15, 10, 30))):
            s = np.array(CASES[case])
            drawn = sampled(s, n, 25_000, 3, convention)
            mean, error = mean_and_error(losses(s, drawn))
            found = simulated(s, n, convention=convention)
            room = 4 * np.hypot(error, found.loss_sigma)
            assert found.loss == pytest.approx(mean, abs=room)

    def test_a_sensor_whose_covariance_is_known(self):
        s = np.array(CASES["crossed"])
        drawn = sampled(s, 10, 40_000, 4)
        drawn[:, 0] = s[0]
        mean, error = mean_and_error(losses(s, drawn))
        found = simulated(s, [np.inf, 10])
        assert found.loss == pytest.approx(mean, abs=4 * np.hypot(error, found.loss_sigma))

    @pytest.mark.parametrize(("n", "low", "high"), [(10, 1.05, 1.22), (30, 1.01, 1.045)])
    @pytest.mark.parametrize("case", list(CASES)[:4])
    def test_of_differences_is_too_large(self, case, n, low, high):
        """The law of their covariance is not Wishart, though it has the same second moments.

        Seen: 8 to 18 % too large at n = 10, 2 to 3.4 % at n = 30.
        """
        s = np.array(CASES[case])
        mean, error = mean_and_error(losses(s, sampled(s, n, 40_000, 5, "differences")))
        found = simulated(s, n, convention="differences")
        room = 3 * np.hypot(error / mean, found.loss_sigma / found.loss)
        assert low - room < found.loss / mean < high + room

    @pytest.mark.parametrize("method", ["first-order", "monte-carlo"])
    @pytest.mark.parametrize("case", CASES)
    def test_is_consistent(self, case, method):
        found = weights.fusion_loss(CASES[case], 20, method=method, trials=500)
        fused = weights.fused_covariance(CASES[case])
        np.testing.assert_array_equal(found.fused_covariance, fused)
        error = found.mean_squared_error
        assert found.loss == close(np.trace(error) / np.trace(fused) - 1, 1e-10)
        assert found.component_loss == close(np.diag(error) / np.diag(fused) - 1, 1e-10)
        assert found.method == method
        assert (found.loss_sigma is None) == (method == "first-order")
        assert_is_covariance(error)
        assert_is_covariance(error - fused)

    def test_the_loss_sigma_is_that(self):
        runs = [simulated(CASES["ten times"], 20, trials=2000, seed=seed) for seed in range(60)]
        spread = np.std([run.loss for run in runs], ddof=1)
        claimed = np.mean([run.loss_sigma for run in runs])
        # relative standard error of a standard deviation: 1/sqrt(2 (60 - 1))
        assert claimed / spread == pytest.approx(1.0, abs=4 / np.sqrt(118))

    def test_seeds(self):
        def loss(source):
            return weights.fusion_loss(TWO, 20, trials=100, rng=source).loss

        assert loss(3) == loss(3) == loss(np.random.default_rng(3))
        assert loss(3) != loss(4)
        generator = np.random.default_rng(3)
        assert loss(generator) != loss(generator)

    def test_more_sensors_than_their_degrees_of_freedom_can_tell_apart(self):
        """Each draw leaves one of four directions without error; five sensors contradict."""
        s = np.stack([np.eye(4)] * 5)
        with pytest.raises(ValueError, match=r"^n is"):
            weights.fusion_loss(s, 4)


@functools.cache
def drawn_weights(case, n, trials, convention):
    """Of the last sensor, (trials, m²), from normal measurements."""
    drawn = sampled(CASES[case], n, trials, np.sum(n), convention)
    return vec(weights.weight_matrices(drawn)[:, -1])


def test_the_papers_area():
    """120 by 84 km, 30 measurements: small losses, though W is hardly known in places."""
    east, north = np.meshgrid(np.linspace(-60e3, 60e3, 9), np.linspace(4e3, 88e3, 8))
    s = simulate.passive_location(np.stack([east, north], axis=-1)).covariances
    loss = weights.fusion_loss(s, 30, trials=2000).loss
    assert loss.min() > 0.02
    assert loss.max() < 0.054
    sigma = np.sqrt(diagonal(weights.weight_covariance(s, 30)))
    assert sigma.min() < 0.03
    assert sigma.max() > 5
    n = weights.required_samples(s, 0.05, trials=2000)
    assert n.min() > 12
    assert n.max() < 36


class TestWeightCovarianceAndBias:
    """Predicted and actual, from normal measurements."""

    TRIALS = 20_000

    def actual(self, case, n, convention="sample-mean"):
        return drawn_weights(case, n, self.TRIALS, convention)

    @pytest.mark.parametrize(
        ("case", "n", "low", "high"),
        [
            ("equal", 30, 0.97, 1.02),
            ("equal", 100, 0.985, 1.015),
            ("crossed", 30, 0.96, 0.995),
            ("crossed", 100, 0.98, 1.005),
            ("vector", 30, 0.96, 1.015),
            ("vector", 100, 0.98, 1.01),
            ("three", 30, 0.92, 0.99),
            ("three", 100, 0.97, 1.005),
            # W near 0: the linear form is too small
            ("ten times", 5, 0.42, 0.55),
            ("ten times", 30, 0.87, 0.91),
            ("ten times", 100, 0.955, 0.98),
        ],
    )
    def test_standard_deviations(self, case, n, low, high):
        s = np.array(CASES[case])
        sigma = self.actual(case, n).std(axis=0)
        ratio = np.sqrt(np.diag(weights.weight_covariance(s, n))) / sigma
        room = 2 / np.sqrt(self.TRIALS)
        assert low - room < ratio.min()
        assert ratio.max() < high + room

    @pytest.mark.parametrize("case", ["equal", "vector", "three"])
    def test_correlations(self, case):
        s = np.array(CASES[case])
        found = np.corrcoef(self.actual(case, 100), rowvar=False)
        predicted = weights.weight_covariance(s, 100)
        sigma = np.sqrt(np.diag(predicted))
        np.testing.assert_allclose(predicted / np.outer(sigma, sigma), found, atol=0.04)

    @pytest.mark.parametrize("case", CASES)
    @pytest.mark.parametrize(("n", "share"), [(30, 0.15), (100, 0.05)])
    def test_bias(self, case, n, share):
        """To second order: what is left is a share that goes as 1/n."""
        s = np.array(CASES[case])
        mean, error = mean_and_error(self.actual(case, n))
        predicted = vec(weights.weight_bias(s, n))
        found = mean - vec(weights.weight_matrices(s)[-1])
        room = 4 * error + share * np.abs(predicted).max()
        assert (np.abs(found - predicted) < room).all()
        if case in {"crossed", "ten times"}:
            assert np.abs(predicted).max() > 3 * error.max()

    @pytest.mark.parametrize("convention", CONVENTIONS)
    def test_conventions_with_unequal_numbers(self, convention):
        s, n = np.array(CASES["vector"]), (40, 90)
        drawn = self.actual("vector", n, convention)
        predicted = weights.weight_covariance(s, n, convention=convention)
        ratio = np.sqrt(np.diag(predicted)) / drawn.std(axis=0)
        np.testing.assert_allclose(ratio, 0.99, atol=0.035)
        mean, error = mean_and_error(drawn)
        bias = vec(weights.weight_bias(s, n, convention=convention))
        found = mean - vec(weights.weight_matrices(s)[-1])
        room = 4 * error + 0.1 * np.abs(bias).max()
        assert (np.abs(found - bias) < room).all()

    def test_of_scalars(self):
        """2 (c_1 + c_2) W² (1 - W)², and its limit by quadrature."""
        s, n = np.array([1.0, 3.0]).reshape(2, 1, 1), (2001, 5001)
        variance = weights.weight_covariance(s, n).item()
        assert variance == close(2 * (1 / 2000 + 1 / 5000) * (3 / 16) ** 2)
        exact = exact_scalar_loss((1.0, 3.0), (2000, 5000)) * 3 / 16
        assert variance == pytest.approx(exact, rel=3e-3)

    def test_weights_of_two_have_one_covariance(self):
        """They sum to the identity."""
        s = covariances(3, seed=3)
        first, second = (weights.weight_covariance(s, 20, k) for k in (0, 1))
        assert_same_covariance(first, second)
        assert_near(weights.weight_bias(s, 20, 0), -weights.weight_bias(s, 20, 1))
