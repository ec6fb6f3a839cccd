"""Independent estimates, fused: against information, and truth."""

import numpy as np
import pytest
from checks import assert_near, close, rng
from reference import weights as reference
from scipy import stats
from tolerances import DISTRIBUTION, INVERSES
from weights.cases import (
    ORDERS,
    TWO,
    assert_is_covariance,
    assert_same_covariance,
    covariances,
    trace,
)

from tertia import fusion, simulate, weights


class TestIndependent:
    @pytest.mark.parametrize("m", ORDERS)
    @pytest.mark.parametrize("sensors", [2, 3, 5])
    def test_agrees_with_information(self, m, sensors):
        s, x = covariances(m, sensors, seed=m), rng(m).normal(size=(sensors, m))
        found = fusion.fuse(x, s)
        value, covariance, statistic = reference.combine(x, s)
        assert_near(found.mean, value)
        assert_same_covariance(found.covariance, covariance)
        assert_is_covariance(found.covariance)
        assert found.statistic == close(statistic, INVERSES)
        assert found.degrees_of_freedom == (sensors - 1) * m
        assert found.pvalue == close(stats.chi2.sf(statistic, (sensors - 1) * m), DISTRIBUTION)
        np.testing.assert_array_equal(found.weights, weights.weight_matrices(s))
        np.testing.assert_array_equal(found.sigma, np.sqrt(np.diag(found.covariance)))

    @pytest.mark.parametrize("away", [0.1, 1.0, 10.0, 30.0])
    @pytest.mark.parametrize("sensors", [2, 3, 6])
    def test_p_values_far_into_the_tail(self, away, sensors):
        s, x = covariances(2, sensors, seed=1), np.zeros((sensors, 2))
        x[0] = away
        found = fusion.fuse(x, s)
        expected = stats.chi2.sf(found.statistic, 2 * (sensors - 1))
        assert found.pvalue == close(expected, DISTRIBUTION)

    def test_the_fused_estimate_of_two_is_that_of_the_paper(self):
        x = np.array([[10.0, 20.0], [13.0, 21.0]])
        w = np.array([[78, 12], [16, 38]]) / 99
        assert fusion.fuse(x, TWO).mean == close(x[0] + w @ (x[1] - x[0]))

    @pytest.mark.parametrize("sensors", [2, 4])
    def test_an_offset_costs_no_digits(self, sensors):
        """The estimates keep all their digits beside 1e9."""
        s = covariances(3, sensors, seed=3)
        x = rng(3).integers(-100, 100, size=(sensors, 3)) / 16
        near, far = fusion.fuse(x, s), fusion.fuse(x + 1e9, s)
        assert far.statistic == near.statistic
        assert far.pvalue == near.pvalue
        np.testing.assert_allclose(far.mean, 1e9 + near.mean, rtol=2.3e-16)

    def test_estimates_and_covariances_are_broadcast(self):
        s, x = covariances(2, 3, seed=4, batch=(4, 1)), rng(4).normal(size=(5, 3, 2))
        found = fusion.fuse(x, s)
        assert found.mean.shape == (4, 5, 2)
        assert found.weights.shape == (4, 5, 3, 2, 2)
        assert found.statistic.shape == found.pvalue.shape == (4, 5)
        for i, j in np.ndindex(4, 5):
            one = fusion.fuse(x[j], s[i, 0])
            np.testing.assert_array_equal(found.mean[i, j], one.mean)
            np.testing.assert_array_equal(found.covariance[i, j], one.covariance)
            assert found.statistic[i, j] == one.statistic
            assert found.pvalue[i, j] == one.pvalue

    def test_many_estimates_for_one_set_of_covariances(self):
        x = rng(5).normal(size=(1000, 2, 2))
        found = fusion.fuse(x, TWO)
        one = fusion.fuse(x[700], TWO)
        np.testing.assert_array_equal(found.mean[700], one.mean)
        assert isinstance(one.statistic, float)
        assert isinstance(one.pvalue, float)

    @pytest.mark.parametrize(("sensors", "m"), [(2, 1), (2, 3), (4, 2), (3, 11)])
    def test_honest_errors_agree(self, sensors, m):
        """P-values are uniform and normalised errors have their chi-square mean."""
        trials = 20_000
        s = covariances(m, sensors, seed=m)
        noise = rng(20 + m).normal(size=(trials, sensors, m, 1))
        truth = np.arange(m)
        found = fusion.fuse(truth + (np.linalg.cholesky(s) @ noise)[..., 0], s)
        assert stats.kstest(found.pvalue, "uniform").pvalue > 0.01
        error = found.mean - truth
        nees = np.einsum("ti,ij,tj", error, np.linalg.inv(found.covariance[0]), error)
        low, high = stats.chi2.ppf([0.005, 0.995], m * trials)
        assert low < nees < high

    def test_wrong_covariances_have_small_p_values(self):
        noise = rng(6).normal(size=(20_000, 2, 2, 1))
        x = (np.linalg.cholesky(TWO) @ noise)[..., 0]
        p = fusion.fuse(x, TWO / 2).pvalue
        # chi-square of twice the size
        expected = stats.chi2.sf(stats.chi2.isf(0.05, 2) / 2, 2)
        assert (p < 0.05).mean() == pytest.approx(expected, abs=4 * np.sqrt(0.25 / 20_000))

    def test_enormous_disagreement_is_no_nan(self):
        s = 1e-10 * np.array([[[1, 0.9], [0.9, 1]]] * 2)
        found = fusion.fuse([[1e150, 1e149], [0, 0]], s)
        assert not np.isnan(found.statistic)
        assert found.pvalue == 0


class TestSharedAzimuth:
    """Trap 7: the two estimates of the paper's example share a measurement."""

    POSITIONS = ((0, 40e3), (30e3, 30e3), (-50e3, 20e3), (10e3, 80e3), (55e3, 60e3))
    TRIALS = 20_000

    @pytest.fixture(scope="class")
    @classmethod
    def drawn(cls):
        target = simulate.passive_location(np.array(cls.POSITIONS))
        many = np.broadcast_to(target.position, (cls.TRIALS, *target.position.shape))
        return target, simulate.passive_location(many).estimates(rng=1)

    def normalised(self, target, found):
        """Mean squared error in units of what is claimed, for each position."""
        error = found.mean - target.position
        information = np.linalg.inv(found.covariance[0])
        return np.einsum("tpi,pij,tpj->p", error, information, error) / self.TRIALS

    def test_combining_them_claims_too_much(self, drawn):
        target, x = drawn
        found = fusion.fuse(x, target.covariances)
        assert (self.normalised(target, found) > 2.6).all()
        claimed = trace(found.covariance[0])
        optimism = np.sqrt(((found.mean - target.position) ** 2).sum(-1).mean(0) / claimed)
        assert np.median(optimism) == pytest.approx(1.2, abs=0.03)

    def test_adding_the_range_difference_is_honest(self, drawn):
        target, x = drawn
        h = target.jacobian[:, 2]
        # what the second estimate was made of, besides the azimuth
        measured = np.einsum("pi,tpi->tp", h, x[:, :, 1])
        found = fusion.fuse_scalar(
            x[:, :, 0], target.covariances[:, 0], h, measured, target.sigma[2]
        )
        low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], 2 * self.TRIALS) / self.TRIALS
        ratio = self.normalised(target, found)
        assert ((low < ratio) & (ratio < high)).all()
        for p in found.pvalue.T:
            assert stats.kstest(p, "uniform").pvalue > 0.001
