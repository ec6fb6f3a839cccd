"""Constant errors of radars in a series: found, subtracted, and the rest of them claimed."""

import numpy as np
import pytest
from checks import INF, NAN, assert_same, fields, rng
from fusion.scenes import METHODS
from scipy.linalg import solve

from tertia.fusion import fuse_series
from tertia.kalman import SingerModel

MODEL = SingerModel(4.0, 0.05, 0.02, exact=True)
STEPS, RADARS, SIGMA = 60, 3, 0.1


def series(runs, seed, bias, wrong=0.0):
    """Angles (runs, steps) of the model, and plots (runs, K, steps)."""
    random = rng(seed)
    f, q = MODEL.transition(), MODEL.process_noise()
    root = np.linalg.cholesky(q)
    x = random.standard_normal((runs, 3)) * [90.0, 0.3, 0.02]
    angles = []
    for _ in range(STEPS):
        angles.append(x[:, 0])
        x = x @ f.T + random.standard_normal(x.shape) @ root.T
    truth = np.stack(angles, axis=-1)
    noise = SIGMA * random.standard_normal((runs, RADARS, STEPS))
    noise += (random.random(noise.shape) < wrong) * random.normal(0.0, 2.0, noise.shape)
    return truth, truth[:, np.newaxis] + bias[..., np.newaxis] + noise


def least_squares(z, prior):
    """Errors of radars and their sigmas, from the joint density of all plots."""
    f, q = MODEL.transition(), MODEL.process_noise()
    powers = [np.linalg.matrix_power(f, n) for n in range(STEPS)]
    process = np.zeros((STEPS, STEPS))
    for i in range(STEPS):
        for j in range(i, STEPS):
            parts = [powers[i - n] @ q @ powers[j - n].T for n in range(1, i + 1)]
            process[i, j] = process[j, i] = sum(part[0, 0] for part in parts)
    there = ~np.isnan(z)
    radar, step = np.nonzero(there)
    covariance = process[np.ix_(step, step)] + SIGMA**2 * np.eye(len(step))
    design = np.hstack([np.array([powers[n][0] for n in step]), np.eye(len(z))[radar]])
    known = np.zeros(3 + len(z))
    known[2], known[3:] = MODEL.acceleration_sigma**-2, prior**-2
    weighted = solve(covariance, design, assume_a="pos")
    spread = np.linalg.inv(design.T @ weighted + np.diag(known))
    found = spread @ (weighted.T @ z[there])
    return found[3:], np.sqrt(np.diag(spread)[3:])


@pytest.mark.parametrize("gaps", [False, True])
def test_parity_with_least_squares_of_all_plots(gaps):
    _, z = series(1, 3, np.array([[0.4, -0.2, 0.1]]))
    if gaps:
        step = np.arange(STEPS)
        z[:, step % 3 != np.arange(3)[:, np.newaxis]] = NAN
    prior = np.array([0.2, 0.3, 0.5])
    found = fuse_series(z[0], SIGMA**2, MODEL, bias_sigma=prior, method="central")
    value, sigma = least_squares(z[0], prior)
    np.testing.assert_allclose(found.bias / sigma, value / sigma, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.bias_sigma, sigma, rtol=1e-8)


@pytest.mark.parametrize("method", METHODS)
def test_honest(method):
    """Coverage of fused angles and errors of radars, drawn from the prior, one trusted or none."""
    random = rng(11)
    for prior in (np.full(3, 0.3), np.array([0.0, 0.3, 0.3]), np.array([0.0, INF, 0.3])):
        bias = random.standard_normal((400, 3)) * np.minimum(prior, 0.3)
        truth, z = series(400, 12, bias)
        found = fuse_series(
            z % 360.0, SIGMA**2, MODEL, bias_sigma=prior, method=method, period=360.0
        )
        assert found.systematic == "given"
        error = (found.mean[..., 0] - truth + 180.0) % 360.0 - 180.0
        inside = np.abs(error[:, 5:]) < 1.96 * found.sigma[:, 5:, 0]
        bounds = (0.9, 1.0) if method == "covariance-intersection" else (0.915, 0.975)
        assert bounds[0] < inside.mean() < bounds[1]
        free = prior > 0
        off = ((found.bias - bias) / np.where(free, found.bias_sigma, 1.0))[:, free]
        assert 0.8 < np.mean(off**2) < 1.25
        assert np.all(found.bias[:, ~free] == 0.0)


def test_outliers_are_no_errors_of_a_radar():
    random = rng(21)
    bias = random.standard_normal((300, 3)) * [0.0, 0.3, 0.3]
    truth, z = series(300, 22, bias, wrong=0.05)
    found = fuse_series(z, SIGMA**2, MODEL, bias_sigma=[0.0, 0.3, 0.3])
    off = (found.bias - bias)[:, 1:] / found.bias_sigma[:, 1:]
    assert np.mean(off**2) < 1.5
    assert 0.9 < np.mean(np.abs(found.mean[..., 0] - truth) < 1.96 * found.sigma[..., 0]) < 0.98


def test_noise_that_lasts_counts_less():
    _, z = series(1, 5, np.zeros((1, 3)))
    options = {"bias_sigma": [0.0, 0.3, 0.3], "method": "central"}
    white = fuse_series(z[0], SIGMA**2, MODEL, **options)
    lasting = fuse_series(z[0], SIGMA**2, MODEL, correlation_time=8.0, **options)
    assert np.all(lasting.bias_sigma[1:] > 1.3 * white.bias_sigma[1:])


def test_without_errors_nothing_changes():
    _, z = series(2, 7, np.zeros((2, 3)))
    plain = fuse_series(z, SIGMA**2, MODEL)
    assert plain.systematic == "not included"
    assert "not included" in repr(plain)
    assert np.all(plain.bias == 0.0)
    assert np.all(plain.bias_sigma == 0.0)
    assert "not included" not in repr(fuse_series(z, SIGMA**2, MODEL, bias_sigma=0.3))


def test_one_radar_alone_says_nothing_of_its_error():
    _, z = series(1, 8, np.zeros((1, 3)))
    alone = fuse_series(z[:, :1], SIGMA**2, MODEL, bias_sigma=0.3)
    plain = fuse_series(z[:, :1], SIGMA**2, MODEL)
    np.testing.assert_allclose(alone.bias, 0.0, atol=1e-9)
    np.testing.assert_allclose(
        alone.covariance[..., 0, 0], plain.covariance[..., 0, 0] + 0.09, rtol=1e-6
    )


def test_batches_and_threads():
    _, z = series(4, 9, np.full((4, 3), 0.2))
    prior = [0.0, 0.3, INF]
    one = fuse_series(z, SIGMA**2, MODEL, bias_sigma=prior, n_threads=1)
    two = fuse_series(z, SIGMA**2, MODEL, bias_sigma=prior, n_threads=3)
    for name in fields(one):
        assert_same(getattr(one, name), getattr(two, name))
    for i, row in enumerate(z):
        single = fuse_series(row, SIGMA**2, MODEL, bias_sigma=prior)
        assert_same(single.bias, one.bias[i])
        assert_same(single.upper, one.upper[i])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bias_sigma": -0.1}, "bias_sigma is -0.1"),
        ({"bias_sigma": [0.1, NAN, 0.1]}, r"bias_sigma\[1\] is nan"),
        ({"bias_sigma": [0.1, 0.1]}, r"bias_sigma has shape \(2,\); it must be \(\) or \(3,\)"),
        ({"bias_sigma": INF}, "bias_sigma is infinite for every radar"),
        (
            {"bias_sigma": 0.1, "initial": (np.zeros((3, 3)), np.array([np.eye(3)] * 3))},
            "leave it out with a bias_sigma",
        ),
    ],
)
def test_mistakes(options, message):
    with pytest.raises(ValueError, match=message):
        fuse_series(np.zeros((3, 5)), SIGMA**2, MODEL, **options)
