"""Sample covariances have the moments of their distribution."""

import numpy as np
import pytest
from scipy import stats

from tertia.simulate import wishart
from tertia.weights import covariance_of_covariance, sample_covariance

COVARIANCE = np.array([[4.0, 1.2, -0.5], [1.2, 2.0, 0.3], [-0.5, 0.3, 1.0]])


class TestWishart:
    @pytest.mark.parametrize("nu", [1, 2, 2.5, 3, 7, 29.5, 1000])
    def test_mean_and_covariance(self, nu):
        """c is one over the degrees of freedom, also where they leave singular matrices."""
        trials = 60_000
        drawn = wishart(COVARIANCE, nu, batch=trials, rng=1).reshape(trials, 9)
        predicted = covariance_of_covariance(COVARIANCE, 1 / nu)
        sigma = np.sqrt(np.diag(predicted))
        error = np.abs(drawn.mean(axis=0) - COVARIANCE.ravel())
        assert (error < 4 * sigma / np.sqrt(trials)).all()
        difference = np.abs(np.cov(drawn, rowvar=False) - predicted) / np.outer(sigma, sigma)
        # the kurtosis of a chi-square with one degree of freedom is 15
        assert difference.max() < 4 * np.sqrt((2 + 12 / nu) / trials)

    @pytest.mark.parametrize("nu", [3, 5, 12])
    def test_is_the_law_of_sample_covariances(self, nu):
        """Volume, one variance and one correlation, which the two moments do not fix."""
        trials = 20_000
        x = np.random.default_rng(2).normal(size=(trials, nu + 1, 3))
        sampled = sample_covariance(x @ np.linalg.cholesky(COVARIANCE).T)
        drawn = wishart(COVARIANCE, nu, batch=trials, rng=3)
        for of in (
            np.linalg.det,
            lambda s: s[:, 2, 2],
            lambda s: s[:, 0, 1] / np.sqrt(s[:, 0, 0] * s[:, 1, 1]),
        ):
            assert stats.ks_2samp(of(sampled), of(drawn)).pvalue > 0.01

    @pytest.mark.parametrize("nu", [4.5, 30.25])
    def test_between_whole_degrees_of_freedom(self, nu):
        """A variance has a chi-square law there, too."""
        drawn = wishart(COVARIANCE, nu, batch=20_000, rng=4)
        for direction in np.eye(3), np.array([[1, -1, 2]]):
            for h in direction:
                ratio = nu * np.einsum("i,tij,j", h, drawn, h) / (h @ COVARIANCE @ h)
                assert stats.kstest(ratio, stats.chi2(nu).cdf).pvalue > 0.01

    @pytest.mark.parametrize(("nu", "rank"), [(1, 1), (2, 2), (9, 3)])
    def test_rank(self, nu, rank):
        for drawn in wishart(COVARIANCE, nu, batch=20, rng=5):
            np.testing.assert_array_equal(drawn, drawn.T)
            assert np.linalg.matrix_rank(drawn, tol=1e-10) == rank

    @pytest.mark.parametrize(("batch", "shape"), [((), ()), (4, (4,)), ((2, 0), (2, 0))])
    def test_shapes_and_seeds(self, batch, shape):
        first, second = (wishart(COVARIANCE, 5, batch=batch, rng=6) for _ in range(2))
        assert first.shape == (*shape, 3, 3)
        np.testing.assert_array_equal(first, second)
        generator = np.random.default_rng(6)
        np.testing.assert_array_equal(wishart(COVARIANCE, 5, batch=batch, rng=generator), first)
        if first.size:
            assert not np.array_equal(wishart(COVARIANCE, 5, batch=batch, rng=generator), first)

    @pytest.mark.parametrize(
        ("options", "error", "message"),
        [
            ({"covariance": np.ones((2, 3))}, ValueError, r"covariance is \(2, 3\); .* \(m, m\)"),
            ({"covariance": np.ones((2, 2, 2))}, ValueError, "covariance is"),
            ({"covariance": 1.0}, ValueError, r"covariance is \(\)"),
            ({"covariance": np.ones((0, 0))}, ValueError, r"covariance is \(0, 0\)"),
            ({"covariance": [[1, np.nan], [0, 1]]}, ValueError, r"covariance\[0, 1\] is nan"),
            ({"covariance": [["1"]]}, TypeError, "covariance has dtype"),
            ({"covariance": [[4.0, 1.0], [0.5, 2.0]]}, ValueError, "covariance"),
            ({"degrees_of_freedom": 0.5}, ValueError, "degrees_of_freedom is 0.5; .* between 1"),
            ({"degrees_of_freedom": 1.5}, ValueError, "degrees_of_freedom is 1.5; .* above 2"),
            ({"degrees_of_freedom": np.nan}, ValueError, "degrees_of_freedom is nan"),
            ({"degrees_of_freedom": np.inf}, ValueError, "degrees_of_freedom is inf"),
            ({"degrees_of_freedom": "3"}, TypeError, "degrees_of_freedom is '3'"),
            ({"batch": -1}, ValueError, "batch is -1"),
            ({"batch": 1.5}, TypeError, "batch is 1.5"),
            ({"rng": "x"}, TypeError, "rng is 'x'"),
        ],
    )
    def test_bad_parameters(self, options, error, message):
        with pytest.raises(error, match=message):
            wishart(**{"covariance": COVARIANCE, "degrees_of_freedom": 5, **options})

    @pytest.mark.parametrize("bad", [[[1.0, 2.0], [2.0, 1.0]], np.zeros((2, 2))])
    def test_a_covariance_that_is_none(self, bad):
        with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
            wishart(bad, 5)
