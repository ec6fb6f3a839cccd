"""The metrics against scipy.stats and formulas written out."""

import numpy as np
import pytest
from checks import INF, NAN, close, rng
from scipy import stats
from tolerances import DISTRIBUTION

from tertia import metrics


def covariances(*shape, m=3, seed=0):
    root = rng(seed).normal(size=(*shape, m, m + 2))
    return root @ np.swapaxes(root, -1, -2)


class TestNees:
    def test_vectors(self):
        assert metrics.nees([1.0, 2.0], np.diag([1.0, 4.0])) == 2.0
        assert metrics.nees([3.0], [[4.5]]) == close(2.0)
        # inverse of [[2, 1], [1, 2]] is [[2, -1], [-1, 2]]/3
        assert metrics.nees([1.0, 1.0], [[2.0, 1.0], [1.0, 2.0]]) == close(2 / 3)
        assert metrics.nees([1.0, -1.0], [[2.0, 1.0], [1.0, 2.0]]) == close(2.0)
        assert isinstance(metrics.nees([1.0], [[1.0]]), float)

    @pytest.mark.parametrize("m", [1, 2, 3, 6])
    def test_against_the_inverse(self, m):
        error, covariance = rng(1).normal(size=(4, 5, m)), covariances(4, 5, m=m)
        expected = np.einsum("abi,abij,abj->ab", error, np.linalg.inv(covariance), error)
        np.testing.assert_allclose(metrics.nees(error, covariance), expected, rtol=1e-10)

    @pytest.mark.parametrize(
        ("error", "covariance"), [((4, 3), ()), ((3,), (4,)), ((2, 1, 3), (4,)), ((2, 4, 3), (1,))]
    )
    def test_broadcasting(self, error, covariance):
        e, p = rng(2).normal(size=error), covariances(*covariance)
        found = metrics.nees(e, p)
        e, p = np.broadcast_arrays(e[..., np.newaxis], p)
        for place in np.ndindex(found.shape):
            one = e[place][:, 0]
            assert found[place] == close(one @ np.linalg.solve(p[place], one), 1e-10)

    def test_what_is_not_known_is_nan(self):
        error, covariance = rng(3).normal(size=(5, 3)), covariances(5)
        expected = metrics.nees(error, covariance)
        error[1, 2] = NAN
        covariance[3, 0, 0] = INF
        covariance[4] = NAN
        expected[[1, 3, 4]] = NAN
        np.testing.assert_array_equal(metrics.nees(error, covariance), expected)
        assert np.isnan(metrics.nees([NAN, 1.0], np.eye(2)))
        assert np.isnan(metrics.nees(np.full((2, 3), NAN), np.eye(3))).all()
        assert metrics.nees(np.empty((0, 3)), np.eye(3)).shape == (0,)

    def test_units_do_not_matter(self):
        error, covariance = rng(4).normal(size=3), covariances()
        unit = np.array([1e8, 1.0, 1e-8])
        scaled = metrics.nees(error * unit, covariance * np.outer(unit, unit))
        assert scaled == close(metrics.nees(error, covariance))

    def test_follows_chi_square(self):
        root = np.linalg.cholesky(covariances())
        error = rng(5).normal(size=(20_000, 3)) @ root.T
        squares = metrics.nees(error, root @ root.T)
        assert stats.kstest(squares, stats.chi2(3).cdf).pvalue > 0.01

    @pytest.mark.parametrize(
        ("error", "covariance", "kind", "message"),
        [
            (1.0, np.eye(1), ValueError, r"error has shape \(\) and covariance \(1, 1\)"),
            ([1.0, 2.0], np.eye(3), ValueError, r"error has shape \(2,\) and covariance \(3, 3\)"),
            ([1.0, 2.0], [1.0, 2.0], ValueError, r"covariance \(2,\)"),
            ([1.0, 2.0], np.ones((2, 3)), ValueError, r"covariance \(2, 3\)"),
            (np.ones((4, 2)), np.ones((3, 2, 2)), ValueError, "batches do not fit"),
            ([1.0, 2.0], np.diag([1.0, -1.0]), np.linalg.LinAlgError, "positive definite"),
            ([1.0, 2.0], np.zeros((2, 2)), np.linalg.LinAlgError, "positive definite"),
            (["x"], [[1.0]], TypeError, "error has dtype"),
            ([1.0], [["x"]], TypeError, "covariance has dtype"),
        ],
    )
    def test_errors(self, error, covariance, kind, message):
        with pytest.raises(kind, match=message):
            metrics.nees(error, covariance)


class TestNis:
    def test_is_the_square_over_the_variance(self):
        assert metrics.nis(3.0, 4.5) == 2.0
        assert isinstance(metrics.nis(3, 4), float)
        v, s = rng(1).normal(size=(4, 1, 5)), rng(2).uniform(1, 2, (3, 5))
        np.testing.assert_array_equal(metrics.nis(v, s), v**2 / s)
        np.testing.assert_array_equal(metrics.nis(v.tolist(), 2.0), v**2 / 2)

    def test_where_there_is_no_plot_it_is_nan(self):
        np.testing.assert_array_equal(metrics.nis([1, NAN, 3], [2.0, NAN, 3.0]), [0.5, NAN, 3])
        np.testing.assert_array_equal(metrics.nis([1, 2, 3], [2.0, NAN, INF]), [0.5, NAN, 0])

    @pytest.mark.parametrize(
        ("innovation", "variance", "kind", "message"),
        [
            (1.0, 0.0, ValueError, "variance must be positive"),
            ([1.0, 2.0], [1.0, -1.0], ValueError, "variance must be positive"),
            ([1.0, 2.0], [1.0, 1.0, 1.0], ValueError, r"shape \(2,\) and variance \(3,\)"),
            ("x", 1.0, TypeError, "innovation has dtype"),
            (1.0, "x", TypeError, "variance has dtype"),
        ],
    )
    def test_errors(self, innovation, variance, kind, message):
        with pytest.raises(kind, match=message):
            metrics.nis(innovation, variance)


class TestConsistencyBounds:
    @pytest.mark.parametrize("probability", [0.5, 0.9, 0.99, 0.9999])
    @pytest.mark.parametrize("dimension", [1, 2, 3, 7])
    @pytest.mark.parametrize("count", [1, 2, 10, 100, 400, 1000, 3001, 10_000, 100_000])
    def test_against_scipy(self, count, dimension, probability):
        """`isf` above and `ppf` below: each has its digits there."""
        found = metrics.consistency_bounds(count, dimension, probability)
        outside, nu = (1 - probability) / 2, count * dimension
        expected = stats.chi2.ppf(outside, nu) / count, stats.chi2.isf(outside, nu) / count
        # below, the tail above is 1 - outside
        assert found[0] == close(expected[0], max(DISTRIBUTION, 1e-13 / outside))
        assert found[1] == close(expected[1], DISTRIBUTION)

    def test_very_many(self):
        """As of a normal distribution, with the cube root of Wilson and Hilferty."""
        count = 1_000_000
        low, high = metrics.consistency_bounds(count, 1, 0.99)
        spread = 2 / (9 * count)
        z = stats.norm.isf(0.005) * np.sqrt(spread)
        assert (low, high) == close(((1 - spread - z) ** 3, (1 - spread + z) ** 3), 1e-6)

    def test_defaults(self):
        assert metrics.consistency_bounds(50) == metrics.consistency_bounds(50, 1, 0.99)

    def test_cover_as_often_as_they_say(self):
        means = rng(1).chisquare(3, (5000, 40)).mean(axis=1)
        low, high = metrics.consistency_bounds(40, 3, 0.9)
        few, many = stats.binom.interval(0.99, 5000, 0.9)
        assert few <= np.count_nonzero((means > low) & (means < high)) <= many

    @pytest.mark.parametrize(
        ("arguments", "kind", "message"),
        [
            ((0,), ValueError, "count is 0"),
            ((-1,), ValueError, "count is -1"),
            ((1.5,), TypeError, "count is 1.5"),
            (("3",), TypeError, "count is '3'"),
            ((1, 0), ValueError, "dimension is 0"),
            ((1, 2.0), TypeError, "dimension is 2.0"),
            ((1, 1, 0.0), ValueError, "probability is 0"),
            ((1, 1, 1.0), ValueError, "probability is 1"),
            ((1, 1, 1.5), ValueError, "probability is 1.5"),
            ((1, 1, NAN), ValueError, "probability is nan"),
            ((1, 1, "0.9"), TypeError, "probability is '0.9'"),
            ((50_000_000, 3), ValueError, "count times dimension"),
        ],
    )
    def test_errors(self, arguments, kind, message):
        with pytest.raises(kind, match=message):
            metrics.consistency_bounds(*arguments)


class TestRmse:
    def test_vectors(self):
        assert metrics.rmse([3.0, NAN, 4.0]) == close(np.sqrt(12.5))
        assert metrics.rmse(-2.0) == 2.0
        assert isinstance(metrics.rmse([[1, 2]]), float)

    @pytest.mark.parametrize("axis", [None, 0, -1, (0, 2), (0, 1, 2)])
    def test_against_nanmean(self, axis):
        error = rng(1).normal(size=(4, 5, 6))
        error[rng(2).random(error.shape) < 0.2] = NAN
        expected = np.sqrt(np.nanmean(error**2, axis=axis))
        np.testing.assert_allclose(metrics.rmse(error, axis=axis), expected, rtol=1e-14)

    def test_where_nothing_is_known_it_is_nan(self):
        found = metrics.rmse([[NAN, NAN], [1.0, NAN]], axis=1)
        np.testing.assert_array_equal(found, [NAN, 1.0])
        assert np.isnan(metrics.rmse([]))
        assert np.isnan(metrics.rmse(NAN))

    @pytest.mark.parametrize(
        ("error", "axis", "kind", "message"),
        [
            ([1.0], 1, ValueError, "axis 1 is out of bounds"),
            ([[1.0, 2.0]], (0, 2), ValueError, "axis 2 is out of bounds"),
            ([1.0], "x", TypeError, "integer"),
            (["x"], None, TypeError, "error has dtype"),
        ],
    )
    def test_errors(self, error, axis, kind, message):
        with pytest.raises(kind, match=message):
            metrics.rmse(error, axis=axis)


class TestAutocorrelation:
    def test_vectors(self):
        np.testing.assert_array_equal(metrics.autocorrelation([1, -1, 1, -1], nlags=1), [1, -1])
        # 1*2 + 2*3 over the roots of 1 + 4 and 4 + 9
        found = metrics.autocorrelation([1.0, 2.0, 3.0], nlags=2)
        assert found == close([1.0, 8 / np.sqrt(5 * 13), 1.0])

    def test_each_lag_by_itself(self):
        """Over the pairs of which both are known."""
        v = rng(1).normal(size=(3, 2, 50))
        v[rng(2).random(v.shape) < 0.3] = NAN
        found = metrics.autocorrelation(v, nlags=7)
        assert found.shape == (3, 2, 8)
        for place in np.ndindex(3, 2):
            for lag in range(8):
                early, late = v[place][: 50 - lag], v[place][lag:]
                both = ~np.isnan(early * late)
                norm = np.linalg.norm(early[both]) * np.linalg.norm(late[both])
                expected = early[both] @ late[both] / norm
                assert found[place][lag] == pytest.approx(expected, rel=1e-12, abs=1e-15)

    def test_of_white_noise(self):
        found = metrics.autocorrelation(rng(3).normal(size=(400, 500)))
        assert found.shape == (400, 21)
        np.testing.assert_allclose(found[:, 0], 1, rtol=1e-15)
        scaled = found[:, 1:] * np.sqrt(500 - np.arange(1, 21))
        assert np.std(scaled) == pytest.approx(1, abs=0.03)
        assert abs(np.mean(scaled)) < 3 / np.sqrt(scaled.size)

    def test_of_a_process_with_memory(self):
        noise = rng(4).normal(size=200_000)
        found = metrics.autocorrelation(noise[1:] + 0.5 * noise[:-1], nlags=3)
        # 1/2 over 1 + 1/4
        assert found == pytest.approx([1, 0.4, 0, 0], abs=0.01)

    def test_where_there_are_no_pairs_it_is_nan(self):
        found = metrics.autocorrelation([1.0, NAN, 2.0, NAN], nlags=3)
        np.testing.assert_array_equal(found, [1, NAN, 1, NAN])
        assert np.isnan(metrics.autocorrelation([NAN, NAN], nlags=1)).all()
        assert np.isnan(metrics.autocorrelation([0.0, 0.0], nlags=1)).all()
        np.testing.assert_array_equal(metrics.autocorrelation([5.0], nlags=0), [1.0])

    @pytest.mark.parametrize(
        ("innovation", "lags", "kind", "message"),
        [
            (1.0, 0, ValueError, r"innovation has shape \(\)"),
            ([1.0, 2.0], 2, ValueError, "it must have more than 2 steps"),
            (np.ones((3, 0)), 0, ValueError, r"innovation has shape \(3, 0\)"),
            ([1.0, 2.0], -1, ValueError, "lags is -1"),
            ([1.0, 2.0], 1.0, TypeError, "lags is 1.0"),
            (["x"], 0, TypeError, "innovation has dtype"),
        ],
    )
    def test_errors(self, innovation, lags, kind, message):
        with pytest.raises(kind, match=message):
            metrics.autocorrelation(innovation, lags)


@pytest.mark.parametrize(
    "call",
    [
        metrics.nees,
        lambda a, p: metrics.nis(a, p[..., 0]),
        lambda a, p: metrics.rmse(a, axis=0),
        lambda a, p: metrics.autocorrelation(a, nlags=1),
    ],
    ids=["nees", "nis", "rmse", "autocorrelation"],
)
def test_masked_elements_are_missing(call):
    a, p = rng(1).normal(size=(4, 3)), np.abs(covariances(4)) + 10 * np.eye(3)
    masked = np.ma.array(a, mask=[[False, True, False]] * 4)
    np.testing.assert_array_equal(call(masked, p), call(masked.filled(NAN), p))
