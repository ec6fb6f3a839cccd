"""Identities of fused estimates for whatever covariances, and clear errors."""

import numpy as np
from checks import outcome, transposed
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from weights.arbitrary import (
    ANY,
    COVARIANCES,
    MANY,
    MATRICES,
    NASTY,
    NUMBERS,
    PROPERTY,
    SEEDS,
    SIDES,
    assert_near,
    assert_no_nan,
    assert_no_negative_variance,
    covariance_matrices,
    estimates_for,
)

from tertia import fusion


@PROPERTY
@given(COVARIANCES, SEEDS)
def test_coordinates_do_not_matter(s, seed):
    """Turned and sheared by any regular matrix."""
    m = s.shape[-1]
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(m, m)))[0]
    t = np.linspace(0.5, 2, m)[:, None] * turn
    back = np.linalg.inv(t)
    new = t @ s @ t.T
    new = (new + transposed(new)) / 2
    x = estimates_for(s, seed)
    found, old = fusion.fuse(x @ t.T, new), fusion.fuse(x, s)
    assert_near(found.weights, t @ old.weights @ back)
    assert_near(found.covariance, t @ old.covariance @ t.T)
    assert_near(found.mean, t @ old.mean, np.abs(found.weights).max())
    assert_near(found.statistic, old.statistic)


@PROPERTY
@given(COVARIANCES, SEEDS)
def test_sensors_may_be_fused_one_after_the_other(s, seed):
    x = estimates_for(s, seed)
    at_once = fusion.fuse(x, s)
    value, covariance, statistic, degrees = x[0], s[0], 0.0, 0
    for x_k, s_k in zip(x[1:], s[1:], strict=True):
        step = fusion.fuse([value, x_k], [covariance, s_k])
        value, covariance = step.mean, step.covariance
        statistic += step.statistic
        degrees += step.degrees_of_freedom
    assert_near(at_once.mean, value, np.abs(at_once.weights).max())
    assert_near(at_once.covariance, covariance)
    assert_near(at_once.statistic, statistic)
    assert at_once.degrees_of_freedom == degrees


@PROPERTY
@given(COVARIANCES, SEEDS)
def test_estimates_that_agree_are_their_fusion(s, seed):
    x = estimates_for(s, seed)[0]
    found = fusion.fuse(np.tile(x, (len(s), 1)), s)
    np.testing.assert_array_equal(found.mean, x)
    assert (found.statistic, found.pvalue) == (0, 1)


@PROPERTY
@given(COVARIANCES, SEEDS)
def test_shifted_estimates_are_a_shifted_fusion(s, seed):
    """And the statistic knows the differences only."""
    x = np.round(256 * estimates_for(s, seed)) / 256
    shift = np.arange(s.shape[-1]) * 1024.0
    found, old = fusion.fuse(x + shift, s), fusion.fuse(x, s)
    assert_near(found.mean, old.mean + shift, np.abs(old.weights).max())
    assert found.statistic == old.statistic


@PROPERTY
@given(covariance_matrices(sensors=(2, 2)), st.floats(1e-3, 1e3), SEEDS)
def test_a_scalar_tells_something(s, sigma, seed):
    x, h = np.random.default_rng(seed).normal(size=(2, s.shape[-1]))
    found = fusion.fuse_scalar(x, s[0], h, 0.5, sigma)
    np.testing.assert_array_equal(found.covariance, found.covariance.T)
    assert_no_negative_variance(found.covariance, found.covariance)
    assert_no_negative_variance(s[0] - found.covariance, s[0])
    # the scalar's own residual, from both sides
    before, after = 0.5 - h @ x, 0.5 - h @ found.mean
    variance = h @ s[0] @ h
    assert_near(after, before * sigma**2 / (variance + sigma**2), abs(before) + abs(h) @ abs(x))
    assert_near(h @ found.covariance @ h, variance * sigma**2 / (variance + sigma**2), variance)


@PROPERTY
@given(ANY, MATRICES)
def test_anything_for_estimates(x, s):
    result = outcome(fusion.fuse, x, s)
    if result is not None:
        assert_no_nan(result.mean, result.covariance, result.statistic, result.pvalue)
        assert ((np.asarray(result.pvalue) >= 0) & (np.asarray(result.pvalue) <= 1)).all()


@PROPERTY
@given(ANY, MATRICES, ANY, NUMBERS, NUMBERS)
def test_anything_for_a_scalar(x, s, h, measured, sigma):
    result = outcome(fusion.fuse_scalar, x, s, h, measured, sigma)
    if result is not None:
        assert_no_nan(result.mean, result.covariance, result.statistic, result.pvalue)


@MANY
@given(st.lists(SIDES, max_size=3), st.lists(SIDES, max_size=3), st.integers(1, 3))
def test_any_shapes_of_estimates_and_covariances(of_estimates, of_covariances, m):
    s = np.broadcast_to(np.eye(m), (*of_covariances, m, m))
    outcome(fusion.fuse, np.zeros((*of_estimates, m)), s)
    outcome(fusion.fuse_scalar, np.zeros((*of_estimates, m)), s, np.ones(m), 1.0, 1.0)


@MANY
@given(covariance_matrices(sensors=(1, 1), orders=(1, 2)), st.data())
def test_any_numbers_for_a_scalar(s, data):
    m = s.shape[-1]
    vectors = hnp.arrays(np.float64, m, elements=st.sampled_from([*NASTY[:8], 1e60, 1e-200]))
    x, h = data.draw(vectors), data.draw(vectors)
    measured = data.draw(st.sampled_from([0.0, 1.0, -1e69, 5e-324]))
    sigma = data.draw(st.sampled_from([1.0, 1e-60, 1e-100, 1e-160, 1e-200, 5e-324, 1e69]))
    result = outcome(fusion.fuse_scalar, x, s[0], h, measured, sigma)
    if result is not None:
        assert_no_nan(result.mean, result.covariance, result.statistic, result.pvalue)


@MANY
@given(covariance_matrices(sensors=(2, 3), orders=(1, 3)), st.data())
def test_any_numbers_for_estimates(s, data):
    numbers = st.sampled_from([0.0, 1.0, 1e140, 1e150, -1e150, 5e-324])
    x = data.draw(hnp.arrays(np.float64, s.shape[:2], elements=numbers))
    size = data.draw(st.sampled_from([1.0, 1e-130, 1e130]))
    result = outcome(fusion.fuse, x, size * s)
    if result is not None:
        assert_no_nan(result.mean, result.covariance, result.statistic, result.pvalue)
