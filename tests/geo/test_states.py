"""States between frames, with their covariances by derivatives along complex steps."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tertia.geo import cartesian_to_polar, polar_to_cartesian

STEP = 1e-30


def cartesian(state):
    """Position, velocity and acceleration by range and azimuth with their rates."""
    r, r1, r2, a, a1, a2 = state
    e, f = np.array([np.sin(a), np.cos(a)]), np.array([np.cos(a), -np.sin(a)])
    p, v = r * e, r1 * e + r * a1 * f
    return np.concatenate([p, v, (r2 - r * a1**2) * e + (r * a2 + 2 * r1 * a1) * f])


def polar(state):
    """The same backwards."""
    x, y = state[0], state[1]
    r = np.sqrt(x * x + y * y)
    # of complex numbers NumPy has no arctan2
    a = np.arctan2(x.real, y.real) + 1j * ((x.imag * y.real - y.imag * x.real) / abs(r.real) ** 2)
    e, f = np.array([x, y]) / r, np.array([y, -x]) / r
    r1, a1 = state[2:4] @ e, state[2:4] @ f / r
    r2 = state[4:] @ e + r * a1**2
    return np.array([r, r1, r2, a, a1, (state[4:] @ f - 2 * r1 * a1) / r])


def derivatives(function, state):
    steps = state[:, np.newaxis] + 1j * STEP * np.eye(len(state))
    return np.stack([function(step).imag / STEP for step in steps.T], axis=1)


@pytest.mark.parametrize("seed", range(20))
def test_covariances_are_those_of_complex_steps(seed):
    random = np.random.default_rng(seed)
    state = np.array([8e4, -150.0, 1.2, 0.0, 2e-3, 5e-5]) * random.uniform(0.2, 2.0, 6)
    state[3] = random.uniform(0.0, 2 * np.pi)
    root = random.standard_normal((6, 6)) * np.array([60, 3, 0.5, 1.4e-3, 1.7e-4, 3.5e-5])[:, None]
    covariance = root @ root.T
    found, spread = polar_to_cartesian(state, covariance)
    assert_allclose(found, cartesian(state), rtol=1e-12)
    jacobian = derivatives(cartesian, state)
    expected = jacobian @ covariance @ jacobian.T
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert_allclose(spread / scale, expected / scale, rtol=0, atol=1e-11)
    back, again = cartesian_to_polar(found, spread)
    jacobian = derivatives(polar, found.astype(complex))
    expected = jacobian @ spread @ jacobian.T
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert_allclose(again / scale, expected / scale, rtol=0, atol=1e-9)
    assert_allclose(np.angle(np.exp(1j * (back[3] - state[3]))), 0.0, atol=1e-12)
