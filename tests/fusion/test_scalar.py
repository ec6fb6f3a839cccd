"""A scalar added to an estimate: against information, and truth."""

import numpy as np
import pytest
from checks import assert_near, close, rng
from reference import weights as reference
from scipy import stats
from tolerances import DISTRIBUTION
from weights.cases import ORDERS, TWO, assert_is_covariance, assert_same_covariance, covariances

from tertia import fusion, weights


class TestScalar:
    @pytest.mark.parametrize("m", ORDERS)
    @pytest.mark.parametrize("sigma", [0.01, 1.0, 100.0])
    def test_agrees_with_information(self, m, sigma):
        s = covariances(m, seed=m)[0]
        x, h = rng(m).normal(size=(2, m))
        found = fusion.fuse_scalar(x, s, h, 1.5, sigma)
        information = np.linalg.inv(s) + weights.scalar_information(h, sigma)
        # what is inverted has a condition number of up to 1e6
        assert_near(found.covariance, np.linalg.inv(information), 1e-10)
        value, _, statistic = reference.combine_scalar(x, s, h, 1.5, sigma)
        assert_near(found.mean, value, 1e-9)
        assert found.statistic == close(statistic)
        assert found.pvalue == close(stats.chi2.sf(statistic, 1), DISTRIBUTION)
        assert found.degrees_of_freedom == 1
        assert_near(found.weights, found.covariance @ h / sigma**2, 1e-10)
        np.testing.assert_array_equal(found.covariance, found.covariance.T)

    def test_a_scalar_is_an_estimate_in_one_dimension(self):
        """z = h x ± sigma says that x is z/h ± sigma/h."""
        scalar = fusion.fuse_scalar([2.0], [[3.0]], [4.0], 9.0, 0.8)
        estimate = fusion.fuse([[2.0], [9 / 4]], [[[3.0]], [[(0.8 / 4) ** 2]]])
        assert scalar.mean == close(estimate.mean)
        assert scalar.covariance == close(estimate.covariance)
        assert scalar.statistic == close(estimate.statistic)
        assert scalar.pvalue == close(estimate.pvalue, DISTRIBUTION)

    @pytest.mark.parametrize("order", [[0, 1, 2], [2, 0, 1]])
    def test_scalars_of_every_component_are_an_estimate(self, order):
        """One after the other, in any order."""
        s, x = covariances(3, seed=1)[0], np.array([1.0, -2.0, 0.5])
        other, sigma = np.array([1.3, -2.2, 0.1]), np.array([0.5, 2.0, 0.9])
        value, covariance, statistic = x, s, 0.0
        for i in order:
            step = fusion.fuse_scalar(value, covariance, np.eye(3)[i], other[i], sigma[i])
            value, covariance = step.mean, step.covariance
            statistic += step.statistic
        at_once = fusion.fuse([x, other], [s, np.diag(sigma**2)])
        assert_near(value, at_once.mean)
        assert_same_covariance(covariance, at_once.covariance)
        assert statistic == close(at_once.statistic)

    def test_a_scalar_that_tells_nothing_changes_nothing(self):
        s, x = TWO[0], [1.0, 2.0]
        useless = fusion.fuse_scalar(x, s, [1.0, -1.0], 50.0, 1e60)
        np.testing.assert_array_equal(useless.mean, x)
        np.testing.assert_array_equal(useless.covariance, s)
        blind = fusion.fuse_scalar(x, s, [0.0, 0.0], 3.0, 2.0)
        np.testing.assert_array_equal(blind.mean, x)
        np.testing.assert_array_equal(blind.covariance, s)
        assert blind.statistic == close(9 / 4)

    def test_broadcasting(self):
        s, x = covariances(2, seed=2, batch=(3,))[:, 0], rng(2).normal(size=(4, 1, 2))
        h, z, sigma = [1.0, 2.0], rng(3).normal(size=(4, 3)), np.array([0.1, 1.0, 3.0])
        found = fusion.fuse_scalar(x, s, h, z, sigma)
        assert found.mean.shape == found.weights.shape == (4, 3, 2)
        for i, j in np.ndindex(4, 3):
            one = fusion.fuse_scalar(x[i, 0], s[j], h, z[i, j], sigma[j])
            np.testing.assert_array_equal(found.mean[i, j], one.mean)
            np.testing.assert_array_equal(found.covariance[i, j], one.covariance)
            np.testing.assert_array_equal(found.weights[i, j], one.weights)
            assert found.pvalue[i, j] == one.pvalue

    def test_errors_are_as_large_as_claimed(self):
        trials = 20_000
        s, h, sigma = TWO[1], np.array([2.0, -1.0]), 0.8
        noise = rng(4).normal(size=(trials, 2)) @ np.linalg.cholesky(s).T
        z = 7.0 + sigma * rng(5).normal(size=trials)
        truth = np.array([4.0, 1.0])
        found = fusion.fuse_scalar(truth + noise, s, h, z, sigma)
        error = found.mean - truth
        nees = np.einsum("ti,ij,tj", error, np.linalg.inv(found.covariance[0]), error)
        low, high = stats.chi2.ppf([0.005, 0.995], 2 * trials)
        assert low < nees < high
        inside = (np.abs(error) < 1.96 * found.sigma).mean(axis=0)
        np.testing.assert_allclose(inside, 0.95, atol=4 * np.sqrt(0.05 / trials))
        assert stats.kstest(found.pvalue, "uniform").pvalue > 0.01

    @pytest.mark.parametrize("sigma", [1e-6, 1e-12, 1e-60])
    def test_a_scalar_without_error_leaves_a_covariance(self, sigma):
        for seed in range(50):
            s = covariances(4, seed=seed)[0]
            h = rng(seed).normal(size=4)
            found = fusion.fuse_scalar(np.zeros(4), s, h, 1.0, sigma)
            assert_is_covariance(found.covariance)
            assert (found.sigma > 0).all()
            assert h @ found.mean == close(1.0, 1e-10)

    @pytest.mark.parametrize("sigma", [1e-6, 1e-9, 1e-12])
    def test_no_variance_is_negative_where_the_covariance_is_singular(self, sigma):
        """A target on a known line, whose place there is then measured."""
        for direction, h in ([[9, 4], [3, 1]], [[-7, 3], [2, 5]], [[1, 6], [7, -2]]):
            s = np.outer(direction, direction)
            found = fusion.fuse_scalar([0, 0], s, h, 1.0, sigma)
            assert (np.diag(found.covariance) >= 0).all()
            # sigma over h times the direction
            expected = np.abs(direction) / abs(np.dot(h, direction)) * sigma
            np.testing.assert_allclose(found.sigma, expected, atol=1e-7)

    @pytest.mark.parametrize(
        ("s", "h"), [(np.eye(2), [0, 0]), (np.ones((2, 2)), [1, -1])], ids=["no h", "singular"]
    )
    def test_no_nan_where_scalar_and_covariance_have_no_error(self, s, h):
        found = fusion.fuse_scalar([1.0, 2.0], s, h, 0.0, 1e-70)
        np.testing.assert_array_equal(found.mean, [1.0, 2.0])
        np.testing.assert_array_equal(found.covariance, s)
        with pytest.raises(ValueError, match=r"sigma must be between 1e-70"):
            fusion.fuse_scalar([1.0, 2.0], s, h, 0.0, 1e-200)

    def test_information(self):
        assert weights.scalar_information([3, 4], 5) == close(np.array([[9, 12], [12, 16]]) / 25)
        h, sigma = rng(1).normal(size=(4, 3)), np.array([0.1, 1, 2, 3])
        found = weights.scalar_information(h, sigma)
        for i in range(4):
            assert found[i] == close(np.outer(h[i], h[i]) / sigma[i] ** 2)
