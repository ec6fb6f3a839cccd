"""Covariances to try, and samples of them."""

import itertools

import checks
import numpy as np
from checks import diagonal, rng, transposed
from reference import weights as reference
from scipy import integrate, special, stats
from tolerances import INVERSES

from tertia import weights

TWO = np.array([[[4, 1], [1, 2]], [[1, -0.5], [-0.5, 3]]])
CONVENTIONS = ["sample-mean", "known-mean", "paper", "differences"]
# the last order that is known when compiling is 9
ORDERS = [1, 2, 3, 4, 5, 6, 7, 9, 11]
CASES = {
    "equal": [np.eye(2), np.eye(2)],
    "crossed": [np.diag([1.0, 4.0]), np.diag([4.0, 1.0])],
    "ten times": [np.eye(2), 10 * np.eye(2)],
    "equal, m = 3": [np.eye(3), np.eye(3)],
    "vector": list(TWO),
    "three": [np.eye(2), 2 * np.eye(2), np.array([[3, 1], [1, 1.0]])],
}


def covariances(m, sensors=2, seed=0, batch=()):
    return checks.covariances(m, *batch, sensors, seed=seed)


def trace(matrix):
    return np.trace(matrix, axis1=-2, axis2=-1)


def vec(matrix):
    """Stacks columns, of every matrix of a batch."""
    return transposed(matrix).reshape(*matrix.shape[:-2], -1)


def mean_and_error(values):
    return values.mean(axis=0), values.std(axis=0) / np.sqrt(len(values))


def assert_same_covariance(found, expected):
    """Relative to the standard deviations."""
    sigma = np.sqrt(diagonal(expected))
    checks.assert_near(found, expected, INVERSES, sigma[..., :, None] * sigma[..., None, :])


def assert_is_covariance(matrix):
    """Whatever its order, with so little rounding."""
    checks.assert_covariance(matrix, 1e-14 / matrix.shape[-1])


def from_measurements(convention):
    """The estimate of a covariance of normal measurements about 0, as a convention has it."""
    return {
        "sample-mean": weights.sample_covariance,
        "known-mean": lambda x: weights.sample_covariance(x, mean=np.zeros(x.shape[-1])),
        "paper": lambda x: (
            weights.sample_covariance(x, mean=np.zeros(x.shape[-1]))
            * (x.shape[-2] / (x.shape[-2] - 1))
        ),
        "differences": lambda x: weights.sample_covariance(x, differences=True),
    }[convention]


def sampled(s, n, trials, seed, convention="sample-mean"):
    """Sample covariances of every sensor, (trials, K, m, m), from normal measurements."""
    random, estimate = rng(seed), from_measurements(convention)
    counts = np.broadcast_to(n, len(s))
    drawn = []
    for covariance, count in zip(s, counts, strict=True):
        noise = random.normal(size=(trials, count, len(covariance)))
        drawn.append(estimate(noise @ np.linalg.cholesky(covariance).T))
    return np.stack(drawn, axis=1)


def losses(s, estimated):
    """Loss of the estimate that is fused with the weights of each set of estimated covariances."""
    information = np.linalg.inv(estimated)
    w = np.linalg.inv(information.sum(axis=1, keepdims=True)) @ information
    error = np.einsum("tkij,kjl,tkil->t", w, np.asarray(s), w)
    return error / np.trace(reference.fused_covariance(s)) - 1


def exact_scalar_loss(s, nu):
    """Of two sensors that measure a number: the first's share of both variances is Beta."""
    scale = [variance / degrees for variance, degrees in zip(s, nu, strict=True)]
    law = stats.beta(nu[0] / 2, nu[1] / 2)
    normalise = special.betaln(nu[0] / 2, nu[1] / 2)
    true = s[0] / sum(s)

    def squared_error(angle):
        """The share is the square of its sine, which keeps the density finite."""
        sine, cosine = np.sin(angle), np.cos(angle)
        first, second = scale[0] * sine**2, scale[1] * cosine**2
        density = np.log(sine) * (nu[0] - 1) + np.log(cosine) * (nu[1] - 1) - normalise
        return (first / (first + second) - true) ** 2 * 2 * np.exp(density)

    pieces = np.arcsin(np.sqrt(law.ppf([1e-9, 1e-6, 0.01, 0.5, 0.99, 1 - 1e-6, 1 - 1e-9])))
    pieces = np.concatenate([[0], pieces, [np.pi / 2]])
    integral = sum(
        integrate.quad(squared_error, low, high, epsabs=0, epsrel=1e-9, limit=200)[0]
        for low, high in itertools.pairwise(pieces)
    )
    return integral * sum(s) ** 2 / np.prod(s)
