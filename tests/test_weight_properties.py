"""Identities of the weights for whatever covariances, and one clear error for what is none."""

import inspect
import re

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from tolerances import IDENTITIES

from tertia import fusion, simulate, weights

PROPERTY = settings(
    deadline=None, derandomize=True, max_examples=60, suppress_health_check=[HealthCheck.too_slow]
)
MANY = settings(PROPERTY, max_examples=300)


def covariance_matrices(sensors=(2, 5), orders=(1, 8)):
    """Covariances (K, m, m), none almost singular, of sizes a thousand times apart."""

    def build(size):
        sensors, m = size
        roots = hnp.arrays(np.float64, (sensors, m, m), elements=st.floats(-1, 1, width=32))
        noise = hnp.arrays(np.float64, (sensors, 1, 1), elements=st.floats(0.03, 1))
        sizes = hnp.arrays(np.float64, (sensors, 1, 1), elements=st.floats(0.03, 30))
        return st.builds(assemble, roots, noise, sizes)

    def assemble(root, noise, size):
        s = root @ transposed(root) + noise * np.eye(root.shape[-1])
        return size * (s + transposed(s)) / 2

    return st.tuples(st.integers(*sensors), st.integers(*orders)).flatmap(build)


def transposed(matrix):
    return np.swapaxes(matrix, -1, -2)


def vec(matrix):
    return transposed(matrix).reshape(*matrix.shape[:-2], -1)


def units_for(s, seed):
    """Powers of two, from 2^-30 to 2^30."""
    return 2.0 ** np.random.default_rng(seed).integers(-30, 31, s.shape[-1])


def estimates_for(s, seed):
    return np.random.default_rng(seed).normal(size=s.shape[:2])


def assert_near(found, expected, scale=None):
    scale = np.abs(expected).max() if scale is None else scale
    np.testing.assert_allclose(found, expected, rtol=0, atol=IDENTITIES * scale)


def assert_no_negative_variance(matrix, scale):
    """In any direction, in units of the standard deviations of `scale`."""
    sigma = np.sqrt(np.diagonal(scale, axis1=-2, axis2=-1))
    matrix = matrix / (sigma[..., :, None] * sigma[..., None, :])
    assert np.linalg.eigvalsh((matrix + transposed(matrix)) / 2).min() > -1e-12


SEEDS = st.integers(0, 2**31)
COVARIANCES = covariance_matrices()


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


NASTY = [0.0, -0.0, 1.0, -1.0, 2.0, 1e-140, 1e140, 1e150, -1e300, 5e-324, np.inf, np.nan]
NUMBERS = st.one_of(
    st.floats(0.1, 30), st.sampled_from([*NASTY, 2**70, 10**400, "2", None, [1.0, 2.0], 1j])
)
COUNTS = st.one_of(
    st.integers(-2, 40),
    st.lists(st.one_of(st.integers(1, 40), st.just(np.inf)), max_size=4),
    st.sampled_from([np.inf, np.nan, 2.5, 2**53, 2**70, "9", None, [None, 9], np.ones((2, 2))]),
)
ANY = st.one_of(
    hnp.arrays(
        np.float64,
        hnp.array_shapes(min_dims=0, max_dims=5, min_side=0, max_side=3),
        elements=st.one_of(st.sampled_from(NASTY), st.floats(-9, 9)),
    ),
    st.sampled_from(["x", None, [["1"]], [[1, 2], [3]], {}, True]),
)
MATRICES = st.one_of(
    ANY,
    covariance_matrices(sensors=(1, 4), orders=(1, 4)),
    # of any definiteness
    st.integers(1, 3)
    .flatmap(lambda m: hnp.arrays(np.float64, (2, m, m), elements=st.sampled_from(NASTY[:5])))
    .map(lambda s: s + transposed(s)),
)
SENSORS = st.one_of(st.integers(-5, 5), st.sampled_from([2**70, 1.0, "1", None]))
WORDS = st.sampled_from(["sample-mean", "paper", "differences", "x", None, ["paper"], 3])


def outcome(function, *arguments, **options):
    """The result, or None after a clear error; a panic is neither."""
    try:
        return function(*arguments, **options)
    except (ValueError, TypeError) as error:
        message = "\n".join([str(error), *getattr(error, "__notes__", [])])
    names = inspect.signature(function).parameters
    assert any(re.search(rf"\b{name}\b", message) for name in names), message
    return None


def assert_no_nan(*arrays):
    for array in arrays:
        assert not np.isnan(array).any()


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


SIDES = st.sampled_from([0, 1, 2, 3, 5])


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


@PROPERTY
@given(ANY, ANY, st.one_of(COUNTS, ANY), NUMBERS)
def test_anything_for_the_others(a, b, n, number):
    outcome(weights.shrink_covariance, a, b, n, number)
    outcome(weights.covariance_of_covariance, a, number)
    outcome(weights.covariance_factor, n, number)
    outcome(weights.sample_covariance, np.clip(a, -1e9, 1e9) if is_numeric(a) else a)


def is_numeric(value):
    return isinstance(value, np.ndarray) and value.dtype.kind == "f"


@PROPERTY
@given(ANY, NUMBERS)
def test_anything_for_wishart_and_positions(a, number):
    result = outcome(simulate.wishart, a, number, batch=3, rng=1)
    if result is not None:
        np.testing.assert_array_equal(result, transposed(result))
