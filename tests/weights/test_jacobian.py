"""Jacobians and what follows from them, against complex steps and dense products."""

import numpy as np
import pytest
from checks import assert_near, close, rng
from reference import weights as reference
from scipy.sparse.linalg import aslinearoperator
from weights.cases import ORDERS, TWO, assert_is_covariance, assert_same_covariance, covariances

from tertia import weights


@pytest.mark.parametrize("sensors", [2, 3, 4])
class TestJacobian:
    @pytest.mark.parametrize("m", [1, 2, 3, 4, 5, 6])
    def test_agrees_with_complex_steps(self, sensors, m):
        """Every element of every covariance is moved by itself."""
        s = covariances(m, sensors, seed=m)
        expected = reference.jacobians_by_complex_steps(s)
        for k in range(sensors):
            assert_near(weights.jacobian(s, k), expected[k])
            assert_near(weights.jacobian(s, k - sensors), expected[k])

    @pytest.mark.parametrize("m", ORDERS)
    def test_agrees_with_the_kronecker_products(self, sensors, m):
        s = covariances(m, sensors, seed=m)
        for k in range(sensors):
            assert_near(weights.jacobian(s, k), reference.jacobian(s, k))

    def test_predicts_what_a_small_change_does(self, sensors):
        """Of both halves of the covariance, by the documented order of the elements."""
        s = covariances(3, sensors, seed=7)
        step = np.zeros_like(s)
        step[1, 0, 2] = step[1, 2, 0] = 1e-6
        change = (weights.weight_matrices(s + step) - weights.weight_matrices(s - step))[0]
        jacobian = weights.jacobian(s, 0)[1].reshape(3, 3, 3, 3)
        for a, b in np.ndindex(3, 3):
            predicted = 2e-6 * (jacobian[b, a, 2, 0] + jacobian[b, a, 0, 2])
            assert change[a, b] == pytest.approx(predicted, abs=1e-14)


class TestJacobianOfTwo:
    @pytest.mark.parametrize("m", ORDERS)
    def test_columns_of_the_paper(self, m):
        s = covariances(m, seed=m)
        assert_near(weights.jacobian(s), reference.jacobian_of_two(s))


@pytest.mark.parametrize("sensors", [2, 3, 4])
@pytest.mark.parametrize("m", ORDERS)
class TestClosedForms:
    N = (40, 45, 60, 52)

    def test_weight_covariance(self, sensors, m):
        """O(m⁴) against O(m⁶)."""
        s, n = covariances(m, sensors, seed=m), self.N[:sensors]
        c = [1 / (count - 1) for count in n]
        for k in range(sensors):
            found = weights.weight_covariance(s, n, k)
            assert_same_covariance(found, reference.weight_covariance(s, c, k))
            assert_is_covariance(found)

    def test_error_of_the_fused_estimate(self, sensors, m):
        s, n = covariances(m, sensors, seed=m), self.N[:sensors]
        c = [1 / (count - 1) for count in n]
        found = weights.fusion_loss(s, n, method="first-order")
        assert_same_covariance(found.mean_squared_error, reference.mean_squared_error(s, c))
        assert_same_covariance(found.fused_covariance, reference.fused_covariance(s))
        assert_is_covariance(found.mean_squared_error)
        assert_is_covariance(found.fused_covariance)

    def test_covariance_of_covariance(self, sensors, m):
        s = covariances(m, sensors, seed=m)
        found = weights.covariance_of_covariance(s, 0.07)
        for k in range(sensors):
            expected = reference.elements_of_covariance_of_covariance(s[k], 0.07)
            assert_same_covariance(found[k], expected)
        assert_is_covariance(found)


@pytest.mark.parametrize("sensors", [2, 3, 4])
@pytest.mark.parametrize("m", [1, 2, 3, 4, 5])
def test_bias(sensors, m):
    """Against m² Jacobians of order m²."""
    s, n = covariances(m, sensors, seed=m), (40, 45, 60, 52)[:sensors]
    c = [1 / (count - 1) for count in n]
    for k in range(sensors):
        assert_near(weights.weight_bias(s, n, k), reference.bias(s, c, k))


class TestOperator:
    @pytest.mark.parametrize("m", [1, 2, 3, 7])
    @pytest.mark.parametrize("sensors", [2, 3])
    def test_multiplies_as_the_matrix_does(self, m, sensors):
        s = covariances(m, sensors, seed=m)
        for k in range(sensors):
            operator = weights.jacobian_operator(s, k)
            dense = np.hstack(list(weights.jacobian(s, k)))
            assert operator.shape == dense.shape
            assert operator.dtype == np.float64
            x, y = rng(1).normal(size=dense.shape[1]), rng(2).normal(size=dense.shape[0])
            assert_near(operator.matvec(x), dense @ x)
            assert_near(operator.rmatvec(y), dense.T @ y)
            assert y @ operator.matvec(x) == close(operator.rmatvec(y) @ x)

    def test_batches(self):
        s = covariances(3, 2, seed=1, batch=(4, 5))
        operator = weights.jacobian_operator(s)
        dense = np.concatenate(np.moveaxis(weights.jacobian(s), 2, 0), axis=-1)
        x, y = rng(1).normal(size=(4, 5, 18)), rng(2).normal(size=(4, 5, 9))
        assert_near(operator.matvec(x), np.einsum("...ij,...j", dense, x))
        assert_near(operator.rmatvec(y), np.einsum("...ji,...j", dense, y))
        # one vector for all, and many for one
        assert_near(operator.matvec(x[0, 0]), np.einsum("...ij,j", dense, x[0, 0]))
        one = weights.jacobian_operator(s[0, 0])
        assert_near(one.matvec(x), np.einsum("ij,...j", dense[0, 0], x))

    def test_scipy_takes_it(self):
        s = covariances(3, 3, seed=2)
        operator = aslinearoperator(weights.jacobian_operator(s, 1))
        dense = np.hstack(list(weights.jacobian(s, 1)))
        x, y = rng(1).normal(size=(27, 4)), rng(2).normal(size=(9, 4))
        assert_near(operator.matmat(x), dense @ x)
        assert_near(operator.T @ y, dense.T @ y)
        assert_near(operator @ np.eye(27), dense)
        assert_near(operator.matvec(x[:, :1])[:, 0], dense @ x[:, 0])

    def test_bad_vectors(self):
        operator = weights.jacobian_operator(TWO)
        for call, size in ((operator.matvec, 8), (operator.rmatvec, 4)):
            with pytest.raises(
                ValueError, match=rf"x has shape \(7,\); it must be \(..., {size}\)"
            ):
                call(np.ones(7))
            with pytest.raises(ValueError, match=r"x\[2\] is nan"):
                call(np.where(np.arange(size) == 2, np.nan, 1.0))
            with pytest.raises(TypeError, match="x has dtype"):
                call("x")
