"""Models, plots and comparisons for the tests of the filter."""

import numpy as np
import pytest
from checks import INF, rng
from hypothesis import strategies as st
from reference import kalman as reference

from tertia.kalman import SingerModel

R = 0.01
PRINTED = SingerModel(5.0, 0.05, 0.003)
EXACT = SingerModel(5.0, 0.05, 0.003, exact=True)
BOTH = {"printed": PRINTED, "exact": EXACT}
MODELS = BOTH | {
    "constant acceleration": SingerModel(5.0, 0.0, 0.003, exact=True),
    "constant acceleration, printed": SingerModel(5.0, 0.0, 0.003),
    "constant rate": SingerModel(5.0, 0.05, 0.0),
    "constant rate, exact": SingerModel(5.0, 0.05, 0.0, exact=True),
    "restless": SingerModel(5.0, 0.15, 0.05),
    "short memory": SingerModel(5.0, 1.0, 0.01, exact=True),
}
GIVEN = (
    np.array([-20.0, 0.4, 0.001]),
    np.array([[0.5, 0.02, 0.001], [0.02, 0.04, -0.0002], [0.001, -0.0002, 0.0001]]),
)
MODEL = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
PRINTED_OR_EXACT = pytest.mark.parametrize("model", BOTH.values(), ids=BOTH)


def plots(*shape, seed=0):
    """Plots of something that moves."""
    random = rng(seed)
    start, rate, turn = random.normal(size=(3, *shape[:-1], 1))
    step = np.arange(shape[-1])
    noise = 0.1 * random.normal(size=shape)
    return 100 * start + 2 * rate * step + turn * np.sin(step / 5) + noise


def root_of(q):
    """A square root of a covariance that may be singular."""
    scale = np.sqrt(np.where(np.diagonal(q) > 0, np.diagonal(q), 1))
    values, axes = np.linalg.eigh(q / np.outer(scale, scale))
    return scale[:, np.newaxis] * axes * np.sqrt(np.maximum(values, 0))


def simulated(model, count, dt, r=R, *, start=None, seed=0):
    """States of targets that move as the model says, from anywhere or from a prior, and plots."""
    random = rng(seed)
    mean, covariance = (np.zeros(3), np.diag([50.0, 1, model.acceleration_sigma]) ** 2)
    x = random.multivariate_normal(*(start or (mean, covariance)), count, method="eigh")
    states = [x]
    for f, q in zip(*map(reference.as_floats, reference.transitions(model, dt)), strict=True):
        x = x @ f.T + random.normal(size=x.shape) @ root_of(q).T
        states.append(x)
    truth = np.stack(states, axis=1)
    return truth, truth[..., 0] + np.sqrt(r) * random.normal(size=truth.shape[:2])


def parts(states):
    return (states.mean, states.covariance) if hasattr(states, "covariance") else states


def assert_covariance(found, expected, tolerance):
    mean = np.zeros(found.shape[:-1])
    assert_states((mean, found), (mean, expected), tolerance)


def assert_states(found, expected, tolerance, period=None):
    """Means and covariances, in units of the standard deviations; inf where it must be."""
    (mean, covariance), (right_mean, right_covariance) = parts(found), parts(expected)
    assert mean.shape == right_mean.shape
    assert covariance.shape == right_covariance.shape
    np.testing.assert_array_equal(covariance, np.swapaxes(covariance, -1, -2))
    variance, right = (
        np.diagonal(p, axis1=-2, axis2=-1).astype(float) for p in (covariance, right_covariance)
    )
    known = np.isfinite(right)
    assert np.all(variance[~known] == np.inf)
    sigma = np.sqrt(np.where(known, right, 0))
    difference = np.where(known, mean, 0) - np.where(known, right_mean, 0)
    size = np.where(known, np.abs(right_mean), 0) + sigma + 1e-300
    if period is not None:
        turns = np.round((difference[..., 0] / period).astype(float))
        difference[..., 0] -= period * turns
        size[..., 0] += period
        angle = mean[..., 0][known[..., 0]]
        assert np.all((angle >= 0) & (angle < period))
    assert np.max(np.abs(difference) / size, initial=0) <= tolerance
    both = known[..., np.newaxis] & known[..., np.newaxis, :]
    difference = np.where(both, covariance, 0) - np.where(both, right_covariance, 0)
    size = sigma[..., np.newaxis] * sigma[..., np.newaxis, :] + 1e-300
    assert np.max(np.abs(difference) / size, initial=0) <= tolerance


GAPS = {
    "none": [],
    "one": [6],
    "the first": [0],
    "leading": [0, 1, 2],
    "the second": [1],
    "trailing": [11, 12, 13],
    "long": range(3, 11),
    "every other": range(1, 14, 2),
    "all but the first": range(1, 14),
    "all but one": [k for k in range(14) if k != 5],
    "all but the last": range(13),
    "all but two": [k for k in range(14) if k not in {4, 9}],
    "all": range(14),
}
STEPS = 14


def relative(fit):
    """Standard uncertainties over the estimates, that of the density last."""
    estimates = [fit.alpha, fit.acceleration_sigma, fit.measurement_sigma, fit.density]
    sigma = np.array([*fit.sigma, fit.density_sigma])
    return np.divide(sigma, estimates, out=np.full(4, INF), where=np.isfinite(sigma))


Z = plots(3, 6)


def decades(low, high):
    return st.integers(low, high).map(lambda exponent: float(f"1e{exponent}"))
