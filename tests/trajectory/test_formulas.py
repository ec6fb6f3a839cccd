"""Trajectories against plain formulas."""

import numpy as np
from reference import trajectory as reference
from trajectory.scenes import INSTANTS, PLACES, SIGMA_R, SIGMAS, measure, network, turn

from tertia.trajectory import reconstruct


def test_the_orders_of_the_source_are_those_of_the_reference():
    times = INSTANTS[:30]
    truth = turn(times)
    measured = measure(truth[0], np.random.default_rng(19))
    measured["range"][5:8, 0] += 5 * SIGMA_R
    sigmas = {kind: np.full(3, sigma) for kind, sigma in SIGMAS.items()}
    given = (truth[0], PLACES, times, measured, sigmas, 13, 3)
    options = {"spatial": "least-squares", "smoother": "local-polynomial"}
    a = reconstruct(network(), times, **measured, **options)
    position, velocity, error, rate_error = reference.space_first(*given)
    np.testing.assert_allclose(a.position, position, atol=1e-6)
    np.testing.assert_allclose(a.velocity, velocity, atol=1e-6)
    sigma = np.sqrt(np.diagonal(a.covariance, axis1=-2, axis2=-1))
    np.testing.assert_allclose(sigma[:, :3], error, rtol=1e-7)
    np.testing.assert_allclose(sigma[:, 3:6], rate_error, rtol=1e-7)
    b = reconstruct(network(), times, **measured, **options, order="temporal-first")
    position, velocity, covariance = reference.time_first(*given)
    np.testing.assert_allclose(b.position, position, atol=1e-6)
    np.testing.assert_allclose(b.velocity, velocity, atol=1e-6)
    np.testing.assert_allclose(b.covariance[:, :3, :3], covariance, rtol=1e-5)
