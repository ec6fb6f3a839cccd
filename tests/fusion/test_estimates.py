"""Estimates of one instant, fused: against plain matrices, conditions of optimality, and truth."""

import numpy as np
import pytest
from checks import INF, NAN, assert_same, fields, rng, spoilt
from reference import fusion as reference
from scipy import stats
from tolerances import CHANCE, INVERSES, VECTOR

from tertia import metrics, weights
from tertia.fusion import fuse

METHODS = ["matrix", "posterior", "covariance-intersection", "static", "equal"]
EVERY_METHOD = pytest.mark.parametrize("method", METHODS)
SIZES = [(1, 1), (1, 3), (2, 1), (2, 3), (3, 2), (4, 6), (6, 3), (3, 11)]
# the reference exchanges shares until they change by 1e-11
PARITY_OF_INTERSECTION = 1e-9
# how far the logarithm of the determinant may be from its least value
OPTIMAL = 1e-10
TWO = np.array([[[4, 1], [1, 2]], [[1, -0.5], [-0.5, 3]]])


def joint_of(k, m, seed, *batch):
    """A covariance of all estimates, whose condition is about 100, in blocks (..., K, K, m, m)."""
    factor = rng(seed).standard_normal((*batch, k * m, k * m))
    joint = factor @ factor.swapaxes(-1, -2) / (k * m) + 0.1 * np.eye(k * m)
    return joint.reshape(*batch, k, m, k, m).swapaxes(-2, -3)


def own(blocks):
    return np.moveaxis(np.diagonal(blocks, axis1=-4, axis2=-3), -1, -3).copy()


def options_of(method, k):
    return {"method": method} | ({"weights": np.arange(1.0, k + 1)} if method == "static" else {})


def chosen(method, x, s, blocks, sensors, **options):
    """Fuse the estimates of some sensors; if there are blocks, estimates are correlated."""
    sensors = np.array(sensors)
    options |= {"method": method} | ({"weights": 1.0 + sensors} if method == "static" else {})
    cross = None if blocks is None else blocks[np.ix_(sensors, sensors)]
    return fuse(x[sensors], s[sensors], cross_covariances=cross, **options)


def problem(k, m, seed, *batch):
    blocks = joint_of(k, m, seed, *batch)
    return rng(seed + 1).normal(0, 3, (*batch, k, m)), own(blocks), blocks


def check(found, expected, tolerance):
    """Against mean, covariance and weights, in units of the expected standard deviations."""
    mean, covariance, matrices = expected
    sigma = np.sqrt(np.diagonal(covariance))
    np.testing.assert_allclose((found.mean - mean) / sigma, 0, atol=tolerance)
    scale = np.outer(sigma, sigma)
    np.testing.assert_allclose((found.covariance - covariance) / scale, 0, atol=tolerance)
    units = sigma / sigma[:, np.newaxis]
    np.testing.assert_allclose(found.weights * units, matrices * units, atol=tolerance)


def check_invariants(found):
    """Of every result with an estimate: weights sum to I, a covariance that is one."""
    m = found.mean.shape[-1]
    np.testing.assert_allclose(
        found.weights.sum(axis=-3), np.eye(m) + 0 * found.covariance, atol=1e-10
    )
    np.testing.assert_array_equal(found.covariance, found.covariance.swapaxes(-1, -2))
    scale = found.sigma[..., np.newaxis] * found.sigma[..., np.newaxis, :]
    assert np.linalg.eigvalsh(found.covariance / scale).min() > 0


def certify(found, covariances):
    """The conditions of Karush, Kuhn and Tucker, which only the best shares fulfil."""
    sigma = np.sqrt(np.diagonal(covariances[0]))
    scale = np.outer(sigma, sigma)
    information = np.linalg.inv(covariances / scale)
    bound = found.covariance / scale
    gradient = np.trace(information @ bound, axis1=-2, axis2=-1)
    share = np.trace(found.weights, axis1=-2, axis2=-1) / gradient
    assert share.min() >= 0
    assert share.sum() == pytest.approx(1, abs=1e-9)
    np.testing.assert_allclose(
        np.tensordot(share, information, 1) @ bound, np.eye(len(sigma)), atol=1e-8
    )
    assert gradient.max() <= len(sigma) + OPTIMAL
    return share


# against the reference


@EVERY_METHOD
@pytest.mark.parametrize(("k", "m"), SIZES)
@pytest.mark.parametrize("correlated", [False, True])
@pytest.mark.parametrize("period", [None, 5.0])
def test_parity(method, k, m, correlated, period):
    x, s, blocks = problem(k, m, 10 * k + m)
    options = options_of(method, k)
    cross = blocks if correlated else None
    found = fuse(x, s, cross_covariances=cross, period=period, **options)
    expected = reference.instant(
        x, s, method, cross, weights=options.get("weights"), period=period
    )  # fmt: skip
    is_intersection = method == "covariance-intersection"
    check(found, expected, PARITY_OF_INTERSECTION if is_intersection else INVERSES)
    check_invariants(found)
    if period is not None:
        assert 0 <= found.mean[0] < period


@pytest.mark.parametrize(("k", "m"), SIZES[2:])
def test_weights_of_independent_estimates(k, m):
    x, s, _ = problem(k, m, 3, 20)
    found = fuse(x, s)
    np.testing.assert_array_equal(found.weights, weights.weight_matrices(s))
    np.testing.assert_array_equal(found.covariance, weights.fused_covariance(s))
    assert (found.degrees_of_freedom == (k - 1) * m).all()


@EVERY_METHOD
def test_zero_cross_covariances_are_none(method):
    x, s, blocks = problem(4, 3, 5)
    options = options_of(method, 4)
    plain = fuse(x, s, **options)
    check(
        fuse(x, s, cross_covariances=0 * blocks, **options),
        (plain.mean, plain.covariance, plain.weights),
        VECTOR,
    )


def test_diagonal_blocks_of_cross_covariances_are_not_read():
    x, s, blocks = problem(3, 2, 6)
    spoilt = blocks.copy()
    spoilt[range(3), range(3)] = NAN
    assert_same(fuse(x, s, cross_covariances=blocks), fuse(x, s, cross_covariances=spoilt))


def test_the_statistic_is_that_of_the_differences():
    x, s, blocks = problem(4, 3, 7)
    found = fuse(x, s, cross_covariances=blocks)
    differences = np.hstack([-np.ones((3, 1)), np.eye(3)])
    d = np.kron(differences, np.eye(3))
    joint = reference.joint_matrix(s, blocks)
    apart = d @ x.ravel()
    statistic = apart @ np.linalg.solve(d @ joint @ d.T, apart)
    assert found.statistic == pytest.approx(statistic, rel=INVERSES)
    assert found.degrees_of_freedom == 9
    assert found.pvalue == pytest.approx(stats.chi2.sf(statistic, 9), rel=1e-10)


@pytest.mark.parametrize("method", METHODS[1:])
def test_other_methods_have_no_statistic(method):
    x, s, _ = problem(3, 2, 8)
    found = fuse(x, s, **options_of(method, 3))
    assert np.isnan([found.statistic, found.pvalue]).all()


def test_known_results():
    """1/4 and 1 of equal variances; correlated by one half, 3/4 of the variance."""
    found = fuse([[1.0], [3.0]], [[[1.0]], [[1.0]]], cross_covariances=np.full((2, 2, 1, 1), 0.5))
    np.testing.assert_allclose(found.mean, [2.0], rtol=VECTOR)
    np.testing.assert_allclose(found.covariance, [[0.75]], rtol=VECTOR)
    # a correlation above the ratio of the sigmas makes a negative weight: 1 - .9 * 2 over 5 - 3.6
    cross = np.full((2, 2, 1, 1), 1.8)
    found = fuse([[0.0], [1.0]], [[[1.0]], [[4.0]]], cross_covariances=cross)
    np.testing.assert_allclose(found.weights.ravel(), [2.2 / 1.4, -0.8 / 1.4], rtol=VECTOR)


# covariance intersection


@pytest.mark.parametrize(("k", "m"), [*SIZES, (30, 3), (12, 9), (60, 12)])
def test_intersection_is_the_best(k, m):
    for seed in range(10):
        x, s, _ = problem(k, m, 100 * seed)
        s *= rng(seed).uniform(0.5, 4, (k, 1, 1))
        certify(fuse(x, s, method="covariance-intersection"), s)


def test_intersection_of_very_different_sensors():
    """One of them is good in each component; all shares are alike."""
    s = np.array([np.diag(np.where(np.arange(3) == k, 1e-9, 1.0)) for k in range(3)])
    found = fuse(np.zeros((3, 3)), s, method="covariance-intersection")
    np.testing.assert_allclose(certify(found, s), 1 / 3, rtol=1e-9)


def test_intersection_with_a_useless_sensor_leaves_it_out():
    x, s, _ = problem(3, 2, 4)
    s[1] = 100 * s[0]
    found = fuse(x, s, method="covariance-intersection")
    assert not found.weights[1].any()
    assert_same(
        found,
        fuse(spoilt(x, NAN, 1), s, method="covariance-intersection"),
        ["mean", "covariance", "weights"],
    )


@pytest.mark.parametrize("k", [2, 3, 7])
def test_intersection_of_equals_shares_alike(k):
    s = np.tile(TWO[0], (k, 1, 1))
    found = fuse(rng().normal(size=(k, 2)), s, method="covariance-intersection")
    np.testing.assert_allclose(found.weights, np.tile(np.eye(2) / k, (k, 1, 1)), atol=VECTOR)
    np.testing.assert_allclose(found.covariance, TWO[0], rtol=VECTOR)


def test_intersection_of_scalars_is_the_best_of_them():
    s = np.array([3.0, 1.0, 2.0, 1.0])[:, np.newaxis, np.newaxis]
    found = fuse([[1.0], [2.0], [3.0], [4.0]], s, method="covariance-intersection")
    np.testing.assert_allclose(found.weights.ravel(), [0, 0.5, 0, 0.5], atol=VECTOR)
    np.testing.assert_allclose(found.covariance, [[1.0]], rtol=VECTOR)


@pytest.mark.parametrize("k", [2, 3])
def test_intersection_is_conservative(k):
    """The bound less the covariance has no negative eigenvalue, whatever the correlation."""
    least = INF
    for seed in range(200):
        # of almost any correlation, full ones included
        factor = rng(seed).standard_normal((3 * k, 2 + seed % (3 * k)))
        joint = factor @ factor.T + 1e-6 * np.eye(3 * k)
        blocks = joint.reshape(k, 3, k, 3).swapaxes(1, 2)
        found = fuse(np.zeros((k, 3)), own(blocks), method="covariance-intersection")
        row = np.concatenate(list(found.weights), axis=1)
        real = row @ joint @ row.T
        scale = np.outer(found.sigma, found.sigma)
        least = min(least, np.linalg.eigvalsh((found.covariance - real) / scale).min())
    assert -1e-9 < least < 0.1


# invariances


@EVERY_METHOD
@pytest.mark.parametrize("correlated", [False, True])
def test_the_order_of_the_sensors_does_not_matter(method, correlated):
    x, s, blocks = problem(5, 3, 11)
    x[:, 0] = [10.0, 350.0, 2.0, 180.0, 175.0]
    order, cross = [3, 0, 4, 2, 1], blocks if correlated else None
    plain = chosen(method, x, s, cross, range(5), period=360.0)
    other = chosen(method, x, s, cross, order, period=360.0)
    check(other, (plain.mean, plain.covariance, plain.weights[order]), 1e-9)


@EVERY_METHOD
@pytest.mark.parametrize("powers", [[0, 7, -4], [100, -100, 60], [-97, 33, 100]])
@pytest.mark.parametrize("correlated", [False, True])
def test_units_of_powers_of_two_change_no_bit(method, powers, correlated):
    x, s, blocks = problem(4, 3, 12, 6)
    unit = 2.0 ** np.array(powers)
    both = np.outer(unit, unit)
    options = options_of(method, 4)
    plain = fuse(x, s, cross_covariances=blocks if correlated else None, **options)
    cross = blocks * both if correlated else None
    other = fuse(x * unit, s * both, cross_covariances=cross, **options)
    np.testing.assert_array_equal(other.mean, plain.mean * unit)
    np.testing.assert_array_equal(other.covariance, plain.covariance * both)
    np.testing.assert_array_equal(other.weights, plain.weights * unit[:, np.newaxis] / unit)
    assert_same(other, plain, ["statistic", "pvalue"])


@EVERY_METHOD
@pytest.mark.parametrize("correlated", [False, True])
def test_large_and_small_units(method, correlated):
    x, s, blocks = problem(3, 3, 13)
    unit = np.array([1e30, 1.0, 1e-30])
    both = np.outer(unit, unit)
    options = options_of(method, 3)
    plain = fuse(x, s, cross_covariances=blocks if correlated else None, **options)
    cross = blocks * both if correlated else None
    other = fuse(x * unit, s * both, cross_covariances=cross, **options)
    expected = plain.mean * unit, plain.covariance * both
    check(other, (*expected, plain.weights * unit[:, np.newaxis] / unit), INVERSES)


@pytest.mark.parametrize("method", ["matrix", "covariance-intersection"])
def test_any_linear_change_of_components(method):
    x, s, blocks = problem(3, 3, 14)
    turn = rng(1).standard_normal((3, 3))
    plain = fuse(x, s, cross_covariances=blocks, method=method)
    blocks = turn @ blocks @ turn.T
    other = fuse(x @ turn.T, own(blocks), cross_covariances=blocks, method=method)
    matrices = turn @ plain.weights @ np.linalg.inv(turn)
    check(other, (turn @ plain.mean, turn @ plain.covariance @ turn.T, matrices), 1e-10)


@EVERY_METHOD
def test_an_offset_costs_no_digits(method):
    x, s, _ = problem(3, 2, 15)
    x = np.round(x * 2**20) / 2**20
    plain, far = fuse(x, s, **options_of(method, 3)), fuse(x + 2**30, s, **options_of(method, 3))
    np.testing.assert_allclose(far.mean - 2**30, plain.mean, atol=1e-6)
    assert_same(far, plain, ["covariance", "weights", "statistic"])


# angles


@EVERY_METHOD
def test_angles_wrap(method):
    x = np.array([[359.0, 1.0], [2.0, 3.0], [358.0, 2.0]])
    s = np.tile(np.diag([1.0, 2.0]), (3, 1, 1))
    plain = x.copy()
    plain[1, 0] += 360
    found = fuse(x, s, period=360.0, **options_of(method, 3))
    expected = fuse(plain, s, **options_of(method, 3))
    np.testing.assert_allclose(found.mean, expected.mean % [360, 1e9], rtol=VECTOR)
    assert found.statistic == pytest.approx(expected.statistic, rel=VECTOR, nan_ok=True)


def test_an_angle_of_a_period_is_zero():
    found = fuse([[-1e-20]], [[[1.0]]], period=360.0)
    assert found.mean[0] == 0
    found = fuse([[719.0], [-2.0]], np.ones((2, 1, 1)), period=360.0)
    assert found.mean[0] == pytest.approx(358.5, rel=VECTOR)


# sensors without an estimate


@EVERY_METHOD
@pytest.mark.parametrize("correlated", [False, True])
def test_a_sensor_without_an_estimate_is_left_out(method, correlated):
    x, s, blocks = problem(4, 3, 16)
    x[1], s[1], blocks[1], blocks[:, 1] = NAN, NAN, NAN, NAN
    rest, cross = [0, 2, 3], blocks if correlated else None
    found, without = chosen(method, x, s, cross, range(4)), chosen(method, x, s, cross, rest)
    assert_same(found, without, ["mean", "covariance", "statistic", "degrees_of_freedom", "pvalue"])
    np.testing.assert_array_equal(found.weights[rest], without.weights)
    assert not found.weights[1].any()


@EVERY_METHOD
def test_a_single_estimate_is_the_result(method):
    x, s, _ = problem(3, 2, 17)
    x[:2] = NAN
    found = fuse(x, s, **options_of(method, 3))
    np.testing.assert_array_equal(found.mean, x[2])
    np.testing.assert_array_equal(found.covariance, s[2])
    np.testing.assert_array_equal(found.weights[2], np.eye(2))
    assert found.degrees_of_freedom == 0
    assert found.pvalue == (1 if method == "matrix" else pytest.approx(NAN, nan_ok=True))


@EVERY_METHOD
def test_no_estimate_at_all(method):
    x, s, _ = problem(3, 2, 18, 2)
    x[1] = NAN
    found = fuse(x, s, **options_of(method, 3))
    assert np.isfinite(found.mean[0]).all()
    assert np.isnan(found.mean[1]).all()
    np.testing.assert_array_equal(found.covariance[1], [[INF, 0], [0, INF]])
    assert not found.weights[1].any()
    assert np.isnan(found.pvalue[1])
    np.testing.assert_array_equal(found.degrees_of_freedom, [4, 0])


def test_sensors_of_weight_zero_count_alike_alone():
    found = fuse([[NAN], [1.0], [3.0]], np.ones((3, 1, 1)), method="static", weights=[1, 0, 0])
    np.testing.assert_array_equal(found.mean, [2.0])


# singular covariances

LINE = np.array([[1.0, 1.0], [1.0, 1.0]])


@pytest.mark.parametrize("method", ["matrix", "covariance-intersection"])
@pytest.mark.parametrize("correlated", [False, True])
def test_a_singular_sensor_is_exact_in_its_direction(method, correlated):
    x = np.array([[1.0, 0.0], [5.0, 7.0], [2.0, 2.5]])
    s = np.array([LINE, [[2.0, 0.3], [0.3, 1.0]], [[1.0, -0.2], [-0.2, 3.0]]])
    cross = np.zeros((3, 3, 2, 2)) if correlated else None
    found = fuse(x, s, method=method, cross_covariances=cross)
    # sensor 1 knows the difference of the components
    assert found.mean[0] - found.mean[1] == pytest.approx(1, abs=1e-12)
    assert np.array([1, -1]) @ found.covariance @ [1, -1] == pytest.approx(0, abs=1e-12)


def test_the_limit_of_a_singular_intersection():
    """That of covariances that become singular."""
    s = np.array([LINE, [[2.0, 0.3], [0.3, 1.0]]])
    x = np.array([[1.0, 0.0], [5.0, 7.0]])
    found = fuse(x, s, method="covariance-intersection")
    near = fuse(x, s + np.diag([1e-9, 0]), method="covariance-intersection")
    np.testing.assert_allclose(found.weights, near.weights, atol=1e-7)


def test_almost_singular_sensors_keep_their_digits():
    """What is not common has nine digits left of sixteen."""
    x, s, _ = problem(3, 2, 19)
    s = LINE + 1e-9 * s
    blocks = np.broadcast_to(LINE * 0.25, (3, 3, 2, 2))
    found = fuse(x, s, cross_covariances=blocks)
    # the weights are those of what is not common
    expected = fuse(x, s - 0.25 * LINE)
    np.testing.assert_allclose(found.weights, expected.weights, atol=1e-5)
    np.testing.assert_allclose(found.covariance, expected.covariance + 0.25 * LINE, rtol=1e-12)


def test_bad_sensors_do_not_hide_the_good_ones():
    """The first two have variances 1e20 times as large: what they measure are their own errors,
    and these tell of those of the others."""
    x, s, blocks = problem(4, 2, 20)
    unit = np.array([1e10, 1e10, 1.0, 1.0])
    scale = unit[:, np.newaxis, np.newaxis, np.newaxis] * unit[:, np.newaxis, np.newaxis]
    found = fuse(x, own(blocks * scale), cross_covariances=blocks * scale)
    joint = reference.joint_matrix(s, blocks)
    left = joint[4:, 4:] - joint[4:, :4] @ np.linalg.solve(joint[:4, :4], joint[:4, 4:])
    left = left.reshape(2, 2, 2, 2).swapaxes(1, 2)
    good = fuse(x[2:], own(left), cross_covariances=left)
    # covariances are 1e10 times as large as those of the good ones
    np.testing.assert_allclose(found.weights[2:], good.weights, atol=1e-6)
    np.testing.assert_allclose(found.covariance, good.covariance, rtol=1e-6)


def test_bad_sensors_whose_errors_are_their_own_change_nothing():
    x, s, blocks = problem(4, 2, 20)
    blocks[:2, 2:] = 0
    blocks[2:, :2] = 0
    blocks[:2, :2] *= 1e20
    found = fuse(x, own(blocks), cross_covariances=blocks)
    good = fuse(x[2:], s[2:], cross_covariances=blocks[2:, 2:])
    np.testing.assert_allclose(found.weights[2:], good.weights, atol=VECTOR)
    np.testing.assert_allclose(found.covariance, good.covariance, rtol=VECTOR)


# shapes and threads


@EVERY_METHOD
@pytest.mark.parametrize("correlated", [False, True])
def test_a_batch_is_its_instants(method, correlated):
    x, s, blocks = problem(3, 2, 21, 2, 4)
    x[1, 2, 0] = NAN
    options = options_of(method, 3)
    cross = blocks if correlated else None
    found = fuse(x, s, cross_covariances=cross, period=4.0, **options)
    for place in np.ndindex(2, 4):
        part = None if cross is None else cross[place]
        one = fuse(x[place], s[place], cross_covariances=part, period=4.0, **options)
        for field in fields(one).keys() - {"bias_sigma", "systematic"}:
            np.testing.assert_array_equal(getattr(found, field)[place], getattr(one, field))


@EVERY_METHOD
def test_leading_axes_are_broadcast(method):
    x, s, blocks = problem(3, 2, 22, 4)
    options = options_of(method, 3)
    cross = np.tile(blocks[0], (5, 1, 1, 1, 1))
    found = fuse(x[:, np.newaxis], s[0], cross_covariances=cross, **options)
    assert found.weights.shape == (4, 5, 3, 2, 2)
    one = fuse(x[2], s[0], cross_covariances=blocks[0], **options)
    np.testing.assert_array_equal(found.mean[2, 3], one.mean)


@EVERY_METHOD
def test_threads_change_nothing(method):
    x, s, blocks = problem(3, 3, 23, 200)
    options = options_of(method, 3)
    one = fuse(x, s, cross_covariances=blocks, n_threads=1, **options)
    for n_threads in (2, 5, None):
        assert_same(one, fuse(x, s, cross_covariances=blocks, n_threads=n_threads, **options))


@EVERY_METHOD
def test_no_instants(method):
    found = fuse(np.empty((0, 3, 2)), np.empty((0, 3, 2, 2)), **options_of(method, 3))
    assert found.mean.shape == (0, 2)
    assert found.weights.shape == (0, 3, 2, 2)


def test_results():
    x = [[10, 20], [13, 21]]
    found = fuse(x, TWO)
    assert repr(found) == "FusedEstimate([12.4848 ± 0.853, 20.8687 ± 1.03], p-value 0.387)"
    assert repr(fuse(x, TWO, method="equal")) == "FusedEstimate([11.5 ± 1.12, 20.5 ± 1.12])"
    assert repr(fuse([x] * 3, TWO)) == "FusedEstimate(batch (3,), 2 components)"
    assert isinstance(found.statistic, float)
    assert isinstance(found.degrees_of_freedom, int)
    np.testing.assert_array_equal(found.sigma, np.sqrt(np.diagonal(found.covariance)))
    with pytest.raises(AttributeError):
        found.mean = 0.0


# Monte Carlo

RUNS = 20_000


@pytest.mark.parametrize("k", [2, 4])
def test_normalised_errors(k):
    """With the true correlation the claimed covariance is the real one; without it, it is not."""
    m = 3
    blocks = joint_of(k, m, 30)
    joint = reference.joint_matrix(own(blocks), blocks)
    errors = rng(31).multivariate_normal(np.zeros(k * m), joint, RUNS).reshape(RUNS, k, m)
    low, high = stats.chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], m * RUNS) / RUNS

    def squared(**options):
        found = fuse(errors, own(blocks), **options)
        return np.mean(metrics.nees(found.mean, found.covariance))

    for method in ("matrix", "posterior", "static", "equal"):
        assert low < squared(cross_covariances=blocks, **options_of(method, k)) < high
        assert not low < squared(**options_of(method, k)) < high
    # a bound: equal to the covariance where one sensor gets all the weight
    assert squared(method="covariance-intersection") < (high if k == 2 else low)
    pvalues = fuse(errors, own(blocks), cross_covariances=blocks).pvalue
    assert stats.kstest(pvalues, "uniform").pvalue > CHANCE


# errors

X = np.zeros((2, 2))
CROSS = np.zeros((2, 2, 2, 2))


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"estimates": 1.0}, ValueError, r"estimates has shape \(\); it must be"),
        ({"estimates": np.empty((0, 2))}, ValueError, r"estimates has shape \(0, 2\)"),
        ({"estimates": np.empty((2, 0))}, ValueError, r"estimates has shape \(2, 0\)"),
        ({"estimates": [["a"]]}, TypeError, "estimates has dtype"),
        ({"estimates": spoilt(X, INF, 1, 0)}, ValueError, r"^estimates\[1, 0\] is inf"),
        ({"estimates": spoilt(X, NAN, 1, 0)}, ValueError, r"^estimates\[1, 0\] is nan"),
        (
            {"estimates": spoilt(np.zeros((3, 2, 2)), -1e200, 2, 0, 1)},
            ValueError,
            r"^estimates\[2, 0, 1\] is -1e200",
        ),
        ({"covariances": TWO[0]}, ValueError, r"covariances has shape \(2, 2\)"),
        ({"covariances": np.ones((3, 2, 2))}, ValueError, r"it must be \(\.\.\., 2, 2, 2\)"),
        ({"covariances": spoilt(TWO, NAN, 1, 0, 1)}, ValueError, r"covariances\[1, 0, 1\] is nan"),
        ({"covariances": spoilt(TWO, 0.0, 1, 0, 0)}, ValueError, r"covariances\[1, 0, 0\] is 0"),
        ({"covariances": spoilt(TWO, 0.9, 0, 0, 1)}, ValueError, r"covariances\[0, 0, 1\] is 0.9"),
        (
            {"covariances": [TWO[0], [[1, 2], [2, 1]]]},
            np.linalg.LinAlgError,
            r"^covariances\[1\] is indefinite",
        ),
        (
            {"estimates": np.zeros((3, 2, 2)), "covariances": [TWO, [LINE, LINE], TWO]},
            np.linalg.LinAlgError,
            r"^covariances\[1, 1\] and the covariances fused",
        ),
        (
            {
                "estimates": spoilt(np.zeros((3, 2)), NAN, 0),
                "covariances": [LINE, LINE, LINE],
                "method": "covariance-intersection",
            },
            np.linalg.LinAlgError,
            r"^covariances\[2\] and the covariances fused",
        ),
        ({"cross_covariances": CROSS[0]}, ValueError, r"cross_covariances has shape \(2, 2, 2\)"),
        (
            {"cross_covariances": spoilt(CROSS, NAN, 0, 1, 1, 0)},
            ValueError,
            r"^cross_covariances\[0, 1, 1, 0\] is nan",
        ),
        (
            {"cross_covariances": spoilt(CROSS, INF, 1, 0, 1, 0)},
            ValueError,
            r"^cross_covariances\[1, 0, 1, 0\] is inf",
        ),
        (
            {"cross_covariances": spoilt(CROSS, 0.1, 0, 1, 1, 0)},
            ValueError,
            r"^cross_covariances\[0, 1, 1, 0\] is 0.1 and its mirror image is 0",
        ),
        (
            {"cross_covariances": np.full((2, 2, 2, 2), 1.5)},
            np.linalg.LinAlgError,
            "joint covariance that is indefinite",
        ),
        (
            {"cross_covariances": np.full((2, 2, 2, 2), 1.5), "method": "equal"},
            np.linalg.LinAlgError,
            "joint covariance that is indefinite",
        ),
        (
            {
                "estimates": np.zeros((3, 2, 2)),
                "cross_covariances": spoilt(np.zeros((3, 2, 2, 2, 2)), 1.5, 1),
            },
            np.linalg.LinAlgError,
            r"joint covariance that is indefinite.*\(in covariances\[1\]\)",
        ),
        # the same estimate twice
        (
            {"covariances": TWO[[0, 0]], "cross_covariances": np.full((2, 2, 2, 2), TWO[0])},
            np.linalg.LinAlgError,
            "joint covariance that is singular",
        ),
        # errors whose sum is zero
        (
            {
                "estimates": np.zeros((4, 2, 1)),
                "covariances": np.ones((2, 1, 1)),
                "cross_covariances": np.full((2, 2, 1, 1), -1.0),
            },
            np.linalg.LinAlgError,
            r"joint covariance that is singular.*\(in covariances\[0\]\)",
        ),
        ({"estimates": np.zeros((3, 2, 2)), "covariances": [TWO] * 2}, ValueError, "batches"),
        ({"method": "best"}, ValueError, "method is 'best'; it must be 'matrix'"),
        ({"method": None}, ValueError, "method is 'None'"),
        ({"method": "static"}, ValueError, "method 'static' needs weights"),
        ({"weights": [1, 2]}, ValueError, "method 'matrix' takes no weights"),
        ({"method": "equal", "weights": [1, 2]}, ValueError, "'equal' takes no weights"),
        ({"method": "static", "weights": [1]}, ValueError, r"weights has shape \(1,\)"),
        ({"method": "static", "weights": [1, -1]}, ValueError, "must not be negative"),
        ({"method": "static", "weights": [0, 0]}, ValueError, "not all zero"),
        ({"method": "static", "weights": [1, NAN]}, ValueError, r"weights\[1\] is nan"),
        ({"method": "static", "weights": "x"}, TypeError, "weights has dtype"),
        ({"period": 0.0}, ValueError, "period is 0"),
        ({"period": INF}, ValueError, "period is inf"),
        ({"period": "x"}, TypeError, "period is 'x'"),
        ({"n_threads": 0}, ValueError, "n_threads is 0"),
    ],
)
def test_errors(changes, error, message):
    arguments = {"estimates": X, "covariances": TWO} | changes
    with pytest.raises(error, match=message):
        fuse(arguments.pop("estimates"), arguments.pop("covariances"), **arguments)


def test_a_singular_joint_covariance_of_consistent_weights_is_an_error_of_matrices_alone():
    """Of estimates that are one and the same any weights give it again."""
    cross = np.full((2, 2, 2, 2), TWO[0])
    found = fuse(X, TWO[[0, 0]], method="equal", cross_covariances=cross)
    np.testing.assert_allclose(found.covariance, TWO[0], rtol=VECTOR)
