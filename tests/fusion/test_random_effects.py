"""Systematic errors of estimates against plain formulas."""

import numpy as np
import pytest
from fusion.cases import problem
from reference import fusion as reference
from tolerances import INVERSES

from tertia.fusion import fuse


@pytest.mark.parametrize(("k", "m"), [(2, 1), (3, 1), (2, 2), (4, 2), (3, 3), (2, 6), (5, 11)])
@pytest.mark.parametrize("spread", [0.5, 5.0, 1e4])
def test_parity(k, m, spread):
    x, s = problem(k, m, 10 * k + m, spread)
    found = fuse(x, s, bias_sigma=None)
    mean, covariance, bias = reference.random_effects(x, s)
    sigma = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((found.mean - mean) / sigma, 0, atol=INVERSES)
    np.testing.assert_allclose(
        found.covariance / np.outer(sigma, sigma), covariance / np.outer(sigma, sigma), atol=1e-9
    )
    np.testing.assert_allclose(found.bias_sigma, bias, rtol=1e-9)
    np.testing.assert_allclose(
        np.einsum("kij,kj->i", found.weights, x), found.mean, rtol=1e-9, atol=1e-9 * spread
    )
