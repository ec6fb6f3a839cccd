"""Systematic errors of estimates, and covariances that are estimated from few measurements."""

import numpy as np
import pytest
from checks import INF, NAN, assert_same, rng
from fusion.cases import problem
from scipy import stats

from tertia.fusion import fuse, fuse_scalar

FOUR = np.array([[10.0], [14], [9], [20]])
OF_FOUR = np.square([1, 1.5, 1.2, 2])[:, np.newaxis, np.newaxis]


def test_vector():
    found = fuse(FOUR, OF_FOUR, bias_sigma=None)
    np.testing.assert_allclose(found.mean, 12.959393660027319, rtol=1e-14)
    np.testing.assert_allclose(found.sigma, 2.90383216907131, rtol=1e-13)
    np.testing.assert_allclose(found.bias_sigma, 4.755114338013392, rtol=1e-13)
    assert found.systematic == "estimated"
    assert found.pvalue == fuse(FOUR, OF_FOUR).pvalue


def test_units_and_axes_do_not_matter():
    x, s = problem(3, 2, 5)
    turn = np.array([[3.0, 1.0], [-0.5, 2.0]])
    plain = fuse(x, s, bias_sigma=None)
    turned = fuse(x @ turn.T, turn @ s @ turn.T, bias_sigma=None)
    np.testing.assert_allclose(turned.mean, turn @ plain.mean, rtol=1e-9)


def test_given():
    x, s = problem(3, 2, 7)
    found = fuse(x, s, bias_sigma=[0.0, 2.0, INF])
    s = s.copy()
    s[1] += 4 * np.eye(2)
    expected = fuse([x[0], x[1], [NAN, NAN]], s)
    np.testing.assert_array_equal(found.mean, expected.mean)
    np.testing.assert_array_equal(found.covariance, expected.covariance)
    assert found.systematic == "given"
    np.testing.assert_array_equal(found.bias_sigma, [0, 2, INF])
    one = fuse(x, s, bias_sigma=2, method="covariance-intersection")
    assert_same(
        one.covariance,
        fuse(x, s + 4 * np.eye(2), method="covariance-intersection").covariance,
    )


def test_where_nothing_can_tell():
    found = fuse([[3.0, 4.0]], [np.eye(2)], bias_sigma=None)
    np.testing.assert_array_equal(found.covariance, np.eye(2))
    assert found.systematic == "not included"
    assert repr(found).endswith("systematic error not included)")
    batch = fuse([[[1.0], [2]], [[1.0], [NAN]]], [[[1.0]], [[1.0]]], bias_sigma=None)
    assert batch.systematic == "not included"
    assert batch.bias_sigma[1, 0] == 0
    assert fuse([[NAN]], [[[1.0]]], bias_sigma=None).sigma[0] == INF
    assert fuse_scalar([1.0], [[1.0]], [1.0], 2.0, 1.0).systematic == "given"


def test_angles_and_threads():
    x, s = [[[359.0], [3.0], [10.0]]] * 40, [[[1.0]], [[1.0]], [[2.0]]]
    found = fuse(x, s, bias_sigma=None, period=360.0, n_threads=1)
    assert_same(found, fuse(x, s, bias_sigma=None, period=360.0, n_threads=2))
    straight = fuse([[-1.0], [3.0], [10.0]], s, bias_sigma=None)
    np.testing.assert_allclose(found.mean[0], straight.mean, rtol=1e-12)
    np.testing.assert_allclose(found.sigma[0], straight.sigma, rtol=1e-12)


@pytest.mark.parametrize(("k", "m"), [(2, 1), (3, 1), (5, 2), (10, 2)])
@pytest.mark.parametrize("size", [0.0, 1.0, 3.0, 9.0])
def test_coverage(k, m, size):
    random, trials = rng(k, m, int(size)), 600
    x = random.normal(0, 1, (trials, k, m)) + random.normal(0, size, (trials, k, m))
    found = fuse(x, np.broadcast_to(np.eye(m), (k, m, m)), bias_sigma=None)
    inside = np.mean(np.abs(found.mean) < 2 * found.sigma)
    least = 0.75 if k == 2 else 0.86 if k == 3 else 0.91
    assert inside > least, inside


# few measurements


def test_one_sensor_is_student():
    found = fuse([[3.0, 4.0]], [np.diag([1.0, 4.0])], n=5)
    factor = stats.t.isf(0.0455 / 2, 4) / 2
    np.testing.assert_allclose(found.sigma, [factor, 2 * factor], rtol=1e-12)
    assert_same(fuse(FOUR, OF_FOUR, n=INF), fuse(FOUR, OF_FOUR))


@pytest.mark.parametrize("n", [3, 5, 10])
@pytest.mark.parametrize(("k", "m", "ratio"), [(2, 1, 1), (2, 2, 2)])
def test_coverage_of_few(n, k, m, ratio):
    random, trials = rng(n, k, m, ratio), 250
    sigma = np.geomspace(1, ratio, k)[:, np.newaxis, np.newaxis]
    x = sigma * random.standard_normal((trials, k, n, m))
    away = x - x.mean(axis=-2, keepdims=True)
    s = np.swapaxes(away, -1, -2) @ away / (n * (n - 1))
    found = fuse(x.mean(axis=-2), s, n=n)
    inside = np.mean(np.abs(found.mean) < 2 * found.sigma)
    # nominal .9545, standard error .013
    assert 0.915 < inside < 0.985, inside


def test_almost_singular_covariances_of_few():
    """Some simulated covariances are lost to rounding, but not the estimated ones."""
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    flat = np.diag([1.0, 1e-10])
    turned = turn @ flat @ turn.T
    found = fuse([[1.0, 2.0], [1.5, 2.5]], [flat, (turned + turned.T) / 2], n=3)
    assert np.all(np.isfinite(found.sigma))
    assert np.all(found.sigma > 1e-5)


def test_too_few_for_two_sensors():
    message = "n is 2; of estimates with 2 components, only one may have fewer than 3 measurements"
    with pytest.raises(ValueError, match=message):
        fuse(np.zeros((2, 2)), [np.eye(2)] * 2, n=2)
    assert np.all(np.isfinite(fuse(np.zeros((2, 2)), [np.eye(2)] * 2, n=[2, 4]).sigma))


def test_pvalue_of_few():
    random, n = rng(3), 4
    x = random.standard_normal((300, 3, n, 1))
    s = x.var(axis=2, ddof=1)[..., np.newaxis] / n
    honest, plain = (fuse(x.mean(axis=2), s, **o).pvalue for o in ({"n": n}, {}))
    assert np.mean(plain < 0.05) > 0.12
    assert np.mean(honest < 0.05) < 0.09


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"bias_sigma": -1},
            "bias_sigma is -1.0; it must be a number that is not negative, or inf",
        ),
        ({"bias_sigma": [0, NAN, 0, 0]}, r"bias_sigma\[1\] is nan"),
        ({"bias_sigma": [1, 2]}, r"bias_sigma has shape \(2,\); it must be \(\) or \(4,\)"),
        ({"bias_sigma": None, "method": "equal"}, "bias_sigma=None is for method 'matrix'"),
        ({"bias_sigma": None, "cross_covariances": np.zeros((4, 4, 1, 1))}, "is for method"),
        ({"n": 5, "method": "posterior"}, "n is for method 'matrix'"),
        ({"n": 1}, "n is 1"),
        ({"n": [3, 3]}, "n has 2 numbers"),
    ],
)
def test_mistakes(options, message):
    with pytest.raises(ValueError, match=message):
        fuse(FOUR, OF_FOUR, **options)
