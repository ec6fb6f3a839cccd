"""Identities of the weights for whatever covariances, and one clear error for what is none."""

import numpy as np
from checks import outcome, transposed
from hypothesis import given
from hypothesis import strategies as st
from weights.arbitrary import (
    ANY,
    COUNTS,
    COVARIANCES,
    MATRICES,
    NUMBERS,
    PROPERTY,
    SEEDS,
    SENSORS,
    WORDS,
    assert_near,
    assert_no_nan,
    assert_no_negative_variance,
    estimates_for,
    is_numeric,
    units_for,
)
from weights.cases import vec

from tertia import fusion, simulate, weights


@PROPERTY
@given(COVARIANCES)
def test_weights_sum_to_the_identity(s):
    w = weights.weight_matrices(s)
    assert_near(w.sum(axis=0), np.eye(s.shape[-1]), np.abs(w).max())
    fused = weights.fused_covariance(s)
    for k in range(len(s)):
        assert_near(w[k] @ s[k], fused, np.abs(w[k]).max() * np.abs(s[k]).max())


@PROPERTY
@given(COVARIANCES)
def test_derivatives_sum_to_zero(s):
    """Over the sensors that are weighed: their weights sum to the identity."""
    jacobians = np.array([weights.jacobian(s, k) for k in range(len(s))])
    assert_near(jacobians.sum(axis=0), 0.0, np.abs(jacobians).max())


@PROPERTY
@given(COVARIANCES)
def test_euler(s):
    """A common factor of all covariances changes no weight."""
    for k in range(len(s)):
        terms = weights.jacobian(s, k) @ vec(s)[..., None]
        assert_near(terms.sum(axis=0), 0.0, np.abs(terms).max())
        operator = weights.jacobian_operator(s, k)
        assert_near(operator.matvec(vec(s).ravel()), 0.0, np.abs(terms).max())


@PROPERTY
@given(COVARIANCES, SEEDS)
def test_units_do_not_matter(s, seed):
    """To the last bit, for powers of two."""
    d = units_for(s, seed)
    outer, ratio = d[:, None] * d, d[:, None] / d
    scaled, x = s * outer, estimates_for(s, seed)
    same = np.testing.assert_array_equal
    same(weights.weight_matrices(scaled), weights.weight_matrices(s) * ratio)
    same(weights.fused_covariance(scaled), weights.fused_covariance(s) * outer)
    same(
        weights.jacobian(scaled, 0),
        weights.jacobian(s, 0) * vec(ratio)[:, None] / vec(outer),
    )
    same(
        weights.weight_covariance(scaled, 30),
        weights.weight_covariance(s, 30) * vec(ratio)[:, None] * vec(ratio),
    )
    same(weights.weight_bias(scaled, 30), weights.weight_bias(s, 30) * ratio)
    for method in ("first-order", "monte-carlo"):
        new, old = (weights.fusion_loss(t, 30, method=method, trials=20) for t in (scaled, s))
        same(new.component_loss, old.component_loss)
    new, old = fusion.fuse(x * d, scaled), fusion.fuse(x, s)
    same(new.mean, old.mean * d)
    assert (new.statistic, new.pvalue) == (old.statistic, old.pvalue)


@PROPERTY
@given(COVARIANCES, SEEDS)
def test_order_of_sensors_does_not_matter(s, seed):
    order = np.random.default_rng(seed).permutation(len(s))
    x = estimates_for(s, seed)
    new, old = fusion.fuse(x[order], s[order]), fusion.fuse(x, s)
    assert_near(new.weights, old.weights[order])
    assert_near(new.covariance, old.covariance)
    assert_near(new.mean, old.mean, np.abs(old.weights).max())
    assert_near(new.statistic, old.statistic)
    n = np.arange(30, 30 + len(s))
    at = int(np.flatnonzero(order == 0)[0])
    permuted = weights.weight_covariance(s[order], n[order], at)
    assert_near(permuted, weights.weight_covariance(s, n, 0))
    assert_near(
        weights.fusion_loss(s[order], n[order], method="first-order").loss,
        weights.fusion_loss(s, n, method="first-order").loss,
    )


@PROPERTY
@given(COVARIANCES, st.floats(1e-100, 1e100))
def test_a_common_factor_scales_what_has_a_unit(s, factor):
    w = weights.weight_matrices(s)
    assert_near(weights.weight_matrices(factor * s), w)
    assert_near(weights.fused_covariance(factor * s), factor * weights.fused_covariance(s))
    assert_near(weights.jacobian(factor * s), weights.jacobian(s) / factor)
    assert_near(weights.weight_covariance(factor * s, 30), weights.weight_covariance(s, 30))
    bias = weights.weight_bias(s, 30)
    assert_near(weights.weight_bias(factor * s, 30), bias, np.abs(w).max() ** 3)


@PROPERTY
@given(COVARIANCES)
def test_the_fused_covariance_is_below_that_of_every_sensor(s):
    fused = weights.fused_covariance(s)
    np.testing.assert_array_equal(fused, fused.T)
    for covariance in s:
        assert_no_negative_variance(covariance - fused, covariance)


@PROPERTY
@given(COVARIANCES, st.integers(0, 4))
def test_what_estimated_weights_cost(s, sensor):
    """More measurements cost less; covariances of errors have no negative variance."""
    m, k = s.shape[-1], sensor % len(s)
    few, many = (weights.fusion_loss(s, n, method="first-order") for n in (3 * m, 30 * m))
    assert few.loss > many.loss > 0
    assert_near(few.loss / many.loss, (30 * m - 1) / (3 * m - 1))
    assert (few.component_loss > 0).all()
    assert_no_negative_variance(few.mean_squared_error - few.fused_covariance, few.fused_covariance)
    covariance = weights.weight_covariance(s, 30, k)
    np.testing.assert_array_equal(covariance, covariance.T)
    assert_no_negative_variance(covariance, covariance)


@PROPERTY
@given(MATRICES, SENSORS)
def test_anything_for_covariances(s, sensor):
    for function in (weights.weight_matrices, weights.fused_covariance):
        result = outcome(function, s)
        if result is not None:
            assert np.isfinite(result).all()
    result = outcome(weights.jacobian, s, sensor)
    if result is not None:
        assert np.isfinite(result).all()


@PROPERTY
@given(MATRICES, COUNTS, SENSORS, WORDS)
def test_anything_for_covariance_and_bias(s, n, sensor, convention):
    for function in (weights.weight_covariance, weights.weight_bias):
        result = outcome(function, s, n, sensor, convention=convention)
        if result is not None:
            assert np.isfinite(result).all()


@PROPERTY
@given(MATRICES, COUNTS, WORDS, st.sampled_from(["auto", "first-order", "monte-carlo", None]))
def test_anything_for_the_loss(s, n, convention, method):
    result = outcome(
        weights.fusion_loss, s, n, convention=convention, method=method, trials=4, rng=1
    )
    if result is not None:
        assert_no_nan(result.loss, result.component_loss, result.mean_squared_error)


@PROPERTY
@given(ANY, ANY, st.one_of(COUNTS, ANY), NUMBERS)
def test_anything_for_the_others(a, b, n, number):
    outcome(weights.shrink_covariance, a, b, n, number)
    outcome(weights.covariance_of_covariance, a, number)
    outcome(weights.covariance_factor, n, number)
    outcome(weights.sample_covariance, np.clip(a, -1e9, 1e9) if is_numeric(a) else a)


@PROPERTY
@given(ANY, NUMBERS)
def test_anything_for_wishart_and_positions(a, number):
    result = outcome(simulate.wishart, a, number, batch=3, rng=1)
    if result is not None:
        np.testing.assert_array_equal(result, transposed(result))
