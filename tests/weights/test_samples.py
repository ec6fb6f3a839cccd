"""Sample covariances, and how well they are known."""

from fractions import Fraction

import numpy as np
import pytest
from checks import assert_near, close, diagonal, rng, transposed
from reference import weights as reference
from weights.cases import (
    CASES,
    CONVENTIONS,
    TWO,
    assert_same_covariance,
    covariances,
    from_measurements,
    losses,
    mean_and_error,
    sampled,
    vec,
)

from tertia import weights


class TestConventions:
    @pytest.mark.parametrize("convention", CONVENTIONS)
    @pytest.mark.parametrize("n", [2, 3, 10, 1000, 2**53])
    def test_factor(self, convention, n):
        exact = {
            "sample-mean": Fraction(1, n - 1),
            "known-mean": Fraction(1, n),
            "paper": Fraction(n, (n - 1) ** 2),
            "differences": Fraction(3 * n - 4, 2 * (n - 1) ** 2),
        }[convention]
        assert weights.covariance_factor(n, convention) == close(float(exact))
        assert weights.covariance_factor(np.inf, convention) == 0

    @pytest.mark.parametrize("convention", CONVENTIONS)
    @pytest.mark.parametrize("n", [12, (12, 30, 9), (np.inf, 12, 20), (15, np.inf, np.inf)])
    def test_of_every_result(self, convention, n):
        s = covariances(3, 3, seed=3)
        counts = np.broadcast_to(np.array(n, dtype=float), 3)
        c = [reference.covariance_factor(count, convention) for count in counts]
        mean = [
            count / (count - 1) if convention == "paper" and np.isfinite(count) else 1.0
            for count in counts
        ]
        # as printed, the covariance is about the true W; what else there is, about the biased mean
        relative = [factor / share**2 for factor, share in zip(c, mean, strict=True)]
        for k in range(3):
            found = weights.weight_covariance(s, n, k, convention=convention)
            assert_same_covariance(found, reference.weight_covariance(s, c, k))
            found = weights.weight_bias(s, n, k, convention=convention)
            assert_near(found, reference.bias(s, relative, k, mean))
        loss = weights.fusion_loss(s, n, method="first-order", convention=convention)
        assert_same_covariance(loss.mean_squared_error, reference.mean_squared_error(s, relative))

    def test_the_default_is_the_sample_mean(self):
        for function in (weights.weight_covariance, weights.weight_bias):
            named = function(TWO, 9, convention="sample-mean")
            np.testing.assert_array_equal(function(TWO, 9), named)
        assert weights.fusion_loss(TWO, 9).loss == weights.fusion_loss(TWO, 9, rng=0).loss
        assert weights.covariance_factor(9) == 1 / 8

    def test_covariances_that_are_known_have_known_weights(self):
        assert not weights.weight_covariance(TWO, np.inf).any()
        assert not weights.weight_bias(TWO, np.inf).any()
        assert weights.fusion_loss(TWO, np.inf).loss == 0
        assert weights.fusion_loss(TWO, np.inf, method="monte-carlo").loss < 1e-25

    def test_a_common_bias_of_the_covariances_cancels(self):
        """Trap 4: n/(n - 1) multiplies both covariances."""
        paper, known = (
            {
                "bias": weights.weight_bias(TWO, 20, convention=convention),
                "loss": weights.fusion_loss(TWO, 20, method="first-order", convention=convention),
                "simulated": weights.fusion_loss(TWO, 20, trials=200, convention=convention),
                "covariance": weights.weight_covariance(TWO, 20, convention=convention),
            }
            for convention in ("paper", "known-mean")
        )
        assert_near(paper["bias"], known["bias"])
        assert paper["loss"].loss == close(known["loss"].loss)
        assert paper["simulated"].loss == close(known["simulated"].loss, 1e-10)
        # but for this one, which is as printed
        assert_near(paper["covariance"], known["covariance"] * (20 / 19) ** 2)

    def test_unequal_biases_of_the_covariances_do_not_cancel(self):
        v, w = reference.weights(TWO)
        found = weights.weight_bias(TWO, [20, 10], convention="paper")
        second_order = reference.bias_of_two(TWO, [1 / 20, 1 / 10])
        assert_near(found, second_order + (20 / 19 - 10 / 9) * v @ w)


class TestSampleCovariance:
    @pytest.mark.parametrize(("n", "m"), [(2, 1), (2, 3), (5, 2), (40, 4)])
    def test_agrees_with_numpy(self, n, m):
        x = rng(n).normal(size=(3, n, m))
        found = weights.sample_covariance(x)
        np.testing.assert_array_equal(found, transposed(found))
        for i in range(3):
            assert_near(found[i], np.cov(x[i], rowvar=False).reshape(m, m))
            np.testing.assert_array_equal(found[i], weights.sample_covariance(x[i]))

    @pytest.mark.parametrize("convention", CONVENTIONS)
    def test_agrees_with_the_formula(self, convention):
        x = rng(1).normal(size=(12, 3))
        found = from_measurements(convention)(x)
        assert_near(found, reference.sample_covariance(x, convention))

    def test_the_divisor_of_the_paper_on_association(self):
        x = [(100, 50), (130, 20), (90, 80), (120, 70)]
        found = weights.sample_covariance(x, ddof=0)
        np.testing.assert_allclose(found, [[250, -250], [-250, 525]], rtol=1e-14)

    @pytest.mark.parametrize("ddof", [0, 1, 5])
    def test_the_divisor(self, ddof):
        x = rng(4).normal(size=(12, 3)) + 1e3
        expected = np.cov(x, rowvar=False, ddof=ddof)
        assert_near(weights.sample_covariance(x, ddof=ddof), expected, 1e-9)

    def test_a_known_mean(self):
        x, mean = rng(2).normal(size=(4, 9, 2)), np.array([0.3, -1.0])
        found = weights.sample_covariance(x, mean=mean)
        for i in range(4):
            expected = reference.sample_covariance(x[i] - mean, "known-mean")
            assert_near(found[i], expected)
        each = x.mean(axis=1)
        assert_near(weights.sample_covariance(x, mean=each), weights.sample_covariance(x) * 8 / 9)

    @pytest.mark.parametrize("options", [{}, {"differences": True}], ids=str)
    def test_an_offset_costs_no_digits(self, options):
        """The measurements keep all their digits beside 1e9."""
        x = rng(3).integers(-1000, 1000, size=(50, 2)) / 16
        near = weights.sample_covariance(x, **options)
        np.testing.assert_array_equal(weights.sample_covariance(x + 1e9, **options), near)
        mean = np.array([0.5, -0.25])
        far = weights.sample_covariance(x + 1e9, mean=mean + 1e9)
        np.testing.assert_array_equal(far, weights.sample_covariance(x, mean=mean))

    def test_differences_do_not_mind_a_drift(self):
        x = rng(4).normal(size=(400, 2)) + np.arange(400)[:, None] * [0.02, -0.01]
        still = weights.sample_covariance(x, differences=True)
        assert diagonal(still) == pytest.approx(1.0, abs=0.25)
        assert diagonal(weights.sample_covariance(x)).min() > 2

    @pytest.mark.parametrize("convention", CONVENTIONS)
    @pytest.mark.parametrize("n", [5, 12])
    def test_mean_and_factor_of_every_convention(self, convention, n):
        """Largest errors seen: 1 % of the standard deviations, with twice as many trials."""
        trials = 2**16
        s = np.array([[4, 1.2], [1.2, 2]])
        drawn = vec(sampled([s], n, trials, n, convention)[:, 0])
        mean, error = mean_and_error(drawn)
        bias = n / (n - 1) if convention == "paper" else 1.0
        assert (np.abs(mean - bias * vec(s)) < 4 * error).all()
        c = weights.covariance_factor(n, convention)
        predicted = weights.covariance_of_covariance(s, c)
        sigma = np.sqrt(np.diag(predicted))
        difference = np.abs(np.cov(drawn, rowvar=False) - predicted)
        assert (difference / np.outer(sigma, sigma)).max() < 0.03


class TestShrinkage:
    def test_formula(self):
        model, sample = covariances(3, seed=1)
        for n in (1, 5, 40):
            expected = (12 * model + (n - 1) * sample) / (12 + n - 1)
            assert_near(weights.shrink_covariance(model, sample, n), expected, 1e-15)
            expected = (3.5 * model + (n - 1) * sample) / (3.5 + n - 1)
            assert_near(weights.shrink_covariance(model, sample, n, 3.5), expected, 1e-15)

    def test_ends(self):
        model, sample = covariances(2, seed=2)
        np.testing.assert_array_equal(weights.shrink_covariance(model, sample, 1), model)
        np.testing.assert_array_equal(weights.shrink_covariance(model, sample, np.inf), sample)
        assert_near(weights.shrink_covariance(model, sample, 5, 1e12), model, 1e-11)

    def test_broadcasting(self):
        model, sample = covariances(2, seed=3)[0], covariances(2, 4, seed=4)
        n = np.array([2, 9, 30, np.inf])
        found = weights.shrink_covariance(model, sample, n)
        for i in range(4):
            np.testing.assert_array_equal(
                found[i], weights.shrink_covariance(model, sample[i], n[i])
            )

    @pytest.mark.parametrize("case", ["vector", "crossed"])
    def test_it_beats_either_with_few_samples(self, case):
        """A model that is wrong by a factor of two, in a direction unlike that of the truth."""
        s = np.array(CASES[case])
        model = s * np.array([1.5, 0.75])[:, None, None]
        drawn = sampled(s, 6, 20_000, 5)
        blended, alone = losses(s, weights.shrink_covariance(model, drawn, 6)), losses(s, drawn)
        assert blended.mean() < 0.5 * alone.mean()
