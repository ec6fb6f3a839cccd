"""Weight matrices and fused covariances: against formulas, exact fractions and 60 digits."""

import mpmath
import numpy as np
import pytest
from checks import assert_near, close, diagonal, rng, transposed
from reference import weights as reference
from tolerances import UNITS
from weights.cases import (
    ORDERS,
    TWO,
    assert_is_covariance,
    assert_same_covariance,
    covariances,
    vec,
)

from tertia import fusion, weights

# the specification's test vectors, for TWO
WEIGHT = np.array([[78, 12], [16, 38]]) / 99
G = np.array([[20, -2], [-2, 20]]) / 99
P1 = [
    [0.0428527701254974, -0.0244872972145699, -0.00428527701254974, 0.00244872972145699],
    [-0.0326497296194266, 0.124477094174064, 0.00326497296194266, -0.0124477094174064],
    [-0.00428527701254974, 0.00244872972145699, 0.0428527701254974, -0.0244872972145699],
    [0.00326497296194266, -0.0124477094174064, -0.0326497296194266, 0.124477094174064],
]
P2 = [
    [-0.159167431894705, -0.0244872972145699, 0.0159167431894705, 0.00244872972145699],
    [-0.0326497296194266, -0.0775431078461381, 0.00326497296194266, 0.00775431078461382],
    [0.0159167431894705, 0.00244872972145699, -0.159167431894705, -0.0244872972145699],
    [0.00326497296194266, 0.00775431078461382, -0.0326497296194266, -0.0775431078461381],
]
# rows from the diagonal on
C_W = [
    [0.0104904037650542, -0.00272669603669636, -0.00272522472792699, -0.000559513740502281],
    [0.0137649726212977, 0.00642390065031952, -0.00176858716889505],
    [0.00944330385049174, -0.000646237676266564],
    [0.0217286117790327],
]
AS_PRINTED = [0.0116560041833935, 0.0152944140236641, 0.0104925598338797, 0.024142901976703]
LOSS = 0.151638326798165
BIAS = [
    [-0.014320671600541, -0.00371706728200963],
    [-0.00495608970934618, -0.00193044732717555],
]


class TestVectors:
    """The specification's, by exact fractions where they are short."""

    def test_weights_and_fused_covariance(self):
        found = weights.weight_matrices(TWO)
        assert found[1] == close(WEIGHT)
        assert found[0] == close(np.array([[21, -12], [-16, 61]]) / 99)
        assert weights.fused_covariance(TWO) == close(np.array([[72, -3], [-3, 106]]) / 99)

    def test_jacobian(self):
        p1, p2 = weights.jacobian(TWO)
        assert p1 == close(np.array(P1))
        assert p2 == close(np.array(P2))
        assert p1 == close(np.kron(G, np.eye(2) - WEIGHT))
        assert p2 == close(-np.kron(G, WEIGHT))

    def test_covariance_of_the_weight(self):
        found = weights.weight_covariance(TWO, 10)
        assert found[np.triu_indices(4)] == close(np.concatenate(C_W))
        as_printed = weights.weight_covariance(TWO, 10, convention="paper")
        assert np.diag(as_printed) == close(np.array(AS_PRINTED))

    def test_loss_and_bias(self):
        assert weights.fusion_loss(TWO, 10, method="first-order").loss == close(LOSS)
        assert weights.weight_bias(TWO, 10) == close(np.array(BIAS))

    def test_the_reference_gives_them_too(self):
        c = [1 / 9, 1 / 9]
        assert reference.jacobian_of_two(TWO) == close(np.array([P1, P2]))
        found = reference.weight_covariance_of_two(TWO, c)
        assert found[np.triu_indices(4)] == close(np.concatenate(C_W))
        error = reference.mean_squared_error_of_two(TWO, c)
        fused = reference.fused_covariance(TWO)
        assert np.trace(error) / np.trace(fused) - 1 == close(LOSS)
        assert reference.bias_of_two(TWO, c) == close(np.array(BIAS))


@pytest.mark.parametrize("m", [1, 2, 3, 5])
class TestReference:
    """Its forms agree with each other, so that either may stand for the paper."""

    def test_two_sensors_are_a_case_of_many(self, m):
        s, c = covariances(m, seed=m), [0.1, 0.03]
        two, many = reference.jacobian_of_two(s), reference.jacobian(s, 1)
        assert_near(two, many)
        assert_same_covariance(
            reference.weight_covariance_of_two(s, c), reference.weight_covariance(s, c, 1)
        )
        assert_near(reference.mean_squared_error_of_two(s, c), reference.mean_squared_error(s, c))
        assert_near(reference.bias_of_two(s, c), reference.bias(s, c, 1))

    def test_elements_and_products(self, m):
        s = covariances(m, seed=m)[0]
        elements = reference.elements_of_covariance_of_covariance(s, 0.1)
        assert_same_covariance(reference.covariance_of_covariance(s, 0.1), elements)

    @pytest.mark.parametrize("sensors", [2, 3, 4])
    def test_error_of_the_fused_estimate_is_made_of_those_of_the_weights(self, m, sensors):
        s, c = covariances(m, sensors, seed=m), [0.1, 0.03, 0.2, 0.05][:sensors]
        error = reference.mean_squared_error_from_weights(s, c)
        assert_same_covariance(error, reference.mean_squared_error(s, c))


class TestWeights:
    @pytest.mark.parametrize("m", ORDERS)
    @pytest.mark.parametrize("sensors", [2, 3, 4, 7])
    def test_agree_with_the_formula(self, m, sensors):
        s = covariances(m, sensors, seed=m)
        assert_near(weights.weight_matrices(s), reference.weights(s))
        fused = weights.fused_covariance(s)
        assert_same_covariance(fused, reference.fused_covariance(s))
        assert_is_covariance(fused)

    def test_a_sensor_without_error_in_one_direction(self):
        """By exact fractions: the formula would have to invert it."""
        s = np.array([[[1, 1], [1, 1]], [[1, 0], [0, 1]]])
        found = weights.weight_matrices(s)
        assert found[0] == close(np.array([[2, -1], [-1, 2]]) / 3)
        assert found[1] == close(np.array([[1, 1], [1, 1]]) / 3)
        # as the limit of sensors that have a little error
        s = s + np.array([1e-9, 0])[:, None, None] * np.eye(2)
        assert_near(weights.jacobian(s), reference.jacobian(s, 1), 1e-6)

    def test_crossed_sensors_without_error_leave_weights_only(self):
        s = [[[1, 1], [1, 1]], [[1, -1], [-1, 1]]]
        found = weights.weight_matrices(s)
        assert found[0] == close(np.array([[1, -1], [-1, 1]]) / 2)
        assert found[1] == close(np.array([[1, 1], [1, 1]]) / 2)

    def test_halves_that_differ_by_rounding_are_averaged(self):
        s = TWO.copy()
        s[0, 0, 1] += 4e-11
        assert_near(weights.weight_matrices(s), weights.weight_matrices(TWO), 1e-10)
        mean = (s + transposed(s)) / 2
        np.testing.assert_array_equal(weights.weight_matrices(s), weights.weight_matrices(mean))


def high_precision(matrix):
    return mpmath.matrix(np.asarray(matrix).tolist())


def exact(s):
    """Weights and fused covariance, and the smallest share, all with 60 digits.

    The share of a component's variance that the others leave unexplained, in the covariance of a
    sensor added to that of all others.
    """
    with mpmath.workdps(60):
        c = [high_precision(covariance) ** -1 for covariance in s]
        total = sum(c[1:], c[0])
        fused = total**-1
        share = mpmath.mpf(1)
        for k, information in enumerate(c):
            added = (total - information) ** -1 + high_precision(s[k])
            inverse = added**-1
            share = min(share, *(1 / (added[i, i] * inverse[i, i]) for i in range(added.rows)))
        return [fused * information for information in c], fused, float(share)


def error_of_weights(found, expected, s):
    """Largest, relative to the largest element, in units of the sensors' standard deviations."""
    sigma = np.sqrt(diagonal(np.asarray(s)).max(axis=0))
    units = sigma / sigma[:, None]
    errors, sizes = [], [1.0]
    with mpmath.workdps(60):
        for w, true in zip(found, expected, strict=True):
            difference = high_precision(w) - true
            errors.append(np.abs(np.array(difference.tolist(), dtype=float) * units).max())
            sizes.append(np.abs(np.array(true.tolist(), dtype=float) * units).max())
    return max(errors) / max(sizes)


def ellipsoid(axes, condition):
    matrix = axes * np.geomspace(1, 1 / condition, len(axes)) @ axes.T
    return (matrix + matrix.T) / 2


def ill_conditioned(kind, sensors, m, condition, seed):
    axes = np.linalg.qr(rng(seed).normal(size=(m, m)))[0]
    if kind == "aligned":
        return np.array([(k + 1) * ellipsoid(axes, condition) for k in range(sensors)])
    return np.array([ellipsoid(np.roll(axes, k, axis=1), condition) for k in range(sensors)])


@pytest.mark.parametrize("kind", ["aligned", "crossed"])
class TestIllConditioned:
    @pytest.mark.parametrize("condition", [1e4, 1e8, 1e12])
    @pytest.mark.parametrize("m", [2, 3, 4, 6, 7])
    def test_weights_of_two(self, kind, m, condition):
        """Largest error seen in 1100 cases: 5.5 roundings over the smallest share."""
        for seed in range(5):
            s = ill_conditioned(kind, 2, m, condition, seed)
            expected, _, share = exact(s)
            error = error_of_weights(weights.weight_matrices(s), expected, s)
            assert error < 10 * m * 2.2e-16 / share

    @pytest.mark.parametrize("condition", [1e4, 1e8, 1e12])
    @pytest.mark.parametrize("sensors", [3, 4])
    def test_weights_of_many(self, kind, sensors, condition):
        """The same bound, or an error."""
        for m, seed in np.ndindex(6, 3):
            s = ill_conditioned(kind, sensors, m + 1, condition, seed)
            try:
                found = weights.weight_matrices(s)
            except np.linalg.LinAlgError:
                continue
            expected, _, share = exact(s)
            assert error_of_weights(found, expected, s) < 10 * (m + 1) * 2.2e-16 / share

    @pytest.mark.parametrize("condition", [1e4, 1e8, 1e12])
    @pytest.mark.parametrize("sensors", [2, 3])
    def test_fused_variances_are_right_or_refused(self, kind, sensors, condition):
        """To 0.1 %, as is documented."""
        for m in (2, 3, 6):
            for seed in range(5):
                s = ill_conditioned(kind, sensors, m, condition, seed)
                try:
                    found = np.diag(weights.fused_covariance(s))
                except np.linalg.LinAlgError:
                    continue
                _, fused, _ = exact(s)
                expected = [float(fused[i, i]) for i in range(m)]
                np.testing.assert_allclose(found, expected, rtol=1e-3)

    def test_other_results(self, kind):
        """Two sensors: the Jacobian, and the covariance, which is a product of six matrices."""
        for seed in range(5):
            s = ill_conditioned(kind, 2, 3, 1e6, seed)
            w, _, share = exact(s)
            with mpmath.workdps(60):
                g = self.array((high_precision(s[0]) + high_precision(s[1])) ** -1)
                p = [np.kron(g, self.array(w[0])), -np.kron(g, self.array(w[1]))]
                one = np.eye(9, dtype=int) + reference.commutation(3).astype(int)
                c_w = 0
                for covariance, block in zip(s, p, strict=True):
                    wide = self.array(high_precision(covariance))
                    c_w += block @ np.kron(wide, wide) @ one @ block.T / 30
                p, c_w = np.array(p, dtype=float), c_w.astype(float)
            rounding = 2.2e-16 / share
            assert_near(weights.jacobian(s), p, 100 * rounding)
            assert_near(weights.weight_covariance(s, 31), c_w, 1000 * rounding)

    @staticmethod
    def array(matrix):
        return np.array(matrix.tolist(), dtype=object)


def test_equal_sensors_have_equal_weights():
    """However long and thin their ellipse."""
    axes = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    for condition in (1e4, 1e8, 1e10):
        s = np.stack([ellipsoid(axes, condition)] * 3)
        found = weights.weight_matrices(s)
        np.testing.assert_allclose(found[0], np.eye(2) / 3, atol=1e-14 * condition)


@pytest.mark.parametrize("tiny", [1e-6, 1e-9, 1e-12])
def test_sensors_that_are_exact_in_one_common_direction(tiny):
    """Fused variances are right to 0.1 %, or refused."""
    u, v = np.array([3.0, 0, -3]), np.array([-4.0, -7, 4])
    s = [np.outer(u, u) + tiny * np.eye(3), np.outer(v, v) + tiny * np.diag([1.0, 2, 3])]
    _, fused, _ = exact(s)
    try:
        found = np.diag(weights.fused_covariance(s))
    except np.linalg.LinAlgError:
        return
    np.testing.assert_allclose(found, [float(fused[i, i]) for i in range(3)], rtol=1e-3)


def results_in_units(s, units):
    """Every result in units of so many old ones, turned back into the old ones."""
    sensors, m = s.shape[:2]
    x, h = rng(1).normal(size=(sensors, m)), rng(2).normal(size=m)
    d = 1 / np.asarray(units)
    outer = d[:, None] * d
    weight_units = d[:, None] / d
    s, x, h = s * outer, x * d, h / d
    jacobian_units = vec(weight_units)[:, None] / vec(outer)
    w_units = vec(weight_units)[:, None] * vec(weight_units)
    combined, scalar = fusion.fuse(x, s), fusion.fuse_scalar(x[0], s[0], h, 0.4, 0.7)
    losses = [
        weights.fusion_loss(s, 20, method=method, trials=40)
        for method in ("first-order", "monte-carlo")
    ]
    return {
        "weights": weights.weight_matrices(s) / weight_units,
        "fused": weights.fused_covariance(s) / outer,
        "value": combined.mean / d,
        "combined": combined.covariance / outer,
        "statistic": np.array(combined.statistic),
        "with scalar": scalar.mean / d,
        "covariance with scalar": scalar.covariance / outer,
        "gain": scalar.weights / d,
        "innovation": np.array(scalar.statistic),
        "jacobian": weights.jacobian(s, 0) / jacobian_units,
        "weight_covariance": weights.weight_covariance(s, 20) / w_units,
        "weight_bias": weights.weight_bias(s, 20) / weight_units,
        "component_loss": np.array([loss.component_loss for loss in losses]),
        "error": np.array([loss.mean_squared_error for loss in losses]) / outer,
        "covariance_of_covariance": weights.covariance_of_covariance(s[0], 0.1)
        / (vec(outer)[:, None] * vec(outer)),
        "blend": weights.shrink_covariance(s[0], s[1], 9) / outer,
    }


@pytest.mark.parametrize("sensors", [2, 3])
@pytest.mark.parametrize("m", [1, 3, 6, 11])
class TestUnits:
    @pytest.mark.parametrize("power", [20, -33, 100])
    def test_powers_of_two_do_not_change_a_bit(self, m, sensors, power):
        s = covariances(m, sensors, seed=m)
        units = 2.0 ** (power * np.linspace(-1, 1, m).round())
        expected = results_in_units(s, np.ones(m))
        for name, found in results_in_units(s, units).items():
            np.testing.assert_array_equal(found, expected[name], err_msg=name)

    @pytest.mark.parametrize("power", [6, -6, 15, 30])
    def test_metres_and_radians(self, m, sensors, power):
        s = covariances(m, sensors, seed=m)
        units = 3.0 * 10.0 ** (power * np.linspace(1, -1, m))
        expected = results_in_units(s, np.ones(m))
        for name, found in results_in_units(s, units).items():
            np.testing.assert_allclose(
                found,
                expected[name],
                rtol=0,
                atol=UNITS * np.abs(expected[name]).max(),
                err_msg=name,
            )


@pytest.mark.parametrize("m", [1, 2, 3, 4])
@pytest.mark.parametrize("n", [8, 12, 40])
def test_loss_of_equal_sensors(m, n):
    s = [covariances(m, seed=m)[0]] * 2
    found = weights.fusion_loss(s, n, method="monte-carlo", trials=100_000)
    exact = reference.loss_of_equal_sensors(m, n - 1)
    assert found.loss == pytest.approx(exact, abs=4 * found.loss_sigma)
    first = weights.fusion_loss(s, n, method="first-order").loss
    assert first == close((m + 1) / (2 * (n - 1)))
