"""The source's two orders by their formulas: least squares in space, local polynomials along time.

A: every instant is located, its coordinates are smoothed. B: every measured series is smoothed, the
smoothed series are located.
"""

import numpy as np

from reference.location import KINDS, jacobian, residuals
from reference.smoothing import polynomial

STEPS = 20


def located(start, stations, measured, sigmas):
    """Position and covariance by Gauss and Newton: p + (J'J)^-1 J'r, (J'J)^-1."""
    p = np.array(start, dtype=float)
    for _ in range(STEPS):
        # of the residuals, whose sign is the other one
        j = -jacobian(p, stations, measured, sigmas)
        p = p + np.linalg.solve(j.T @ j, j.T @ residuals(p, stations, measured, sigmas))
    return p, np.linalg.inv(j.T @ j)


def smoothed(y, variances, times, window, highest, derivative=0):
    """Columns smoothed by polynomials of adaptive degree, their standard errors, (N, M) each."""
    fits = [
        polynomial(
            column, window, (0, highest), time=times, variance=variance, derivative=derivative
        )[:2]
        for column, variance in zip(y.T, variances.T, strict=True)
    ]
    return tuple(np.stack(part, axis=1) for part in zip(*fits, strict=True))


def space_first(start, stations, times, measured, sigmas, window, highest):
    """Order A: positions, velocities and their standard errors, (N, D) each."""
    fixes = [
        located(p, stations, {kind: v[i] for kind, v in measured.items()}, sigmas)
        for i, p in enumerate(start)
    ]
    y = np.array([p for p, _ in fixes])
    variances = np.array([np.diagonal(covariance) for _, covariance in fixes])
    position, error = smoothed(y, variances, times, window, highest)
    velocity, rate_error = smoothed(y, variances, times, window, highest, derivative=1)
    return position, velocity, error, rate_error


def time_first(start, stations, times, measured, sigmas, window, highest):
    """Order B: positions and velocities, (N, D), covariances of the positions, (N, D, D)."""
    series, rates = (
        {
            kind: smoothed(
                np.unwrap(v, axis=0) if kind == "azimuth" else v,
                np.broadcast_to(sigmas[kind] ** 2, v.shape),
                times,
                window,
                highest,
                derivative,
            )
            for kind, v in measured.items()
        }
        for derivative in (0, 1)
    )
    told = []
    for i, first in enumerate(start):
        values = {kind: value[i] for kind, (value, _) in series.items()}
        errors = {kind: error[i] for kind, (_, error) in series.items()}
        p, covariance = located(first, stations, values, errors)
        j = -jacobian(p, stations, values, errors)
        rate = np.concatenate([rates[k][0][i] / errors[k] for k in KINDS if k in values])
        told.append((p, np.linalg.solve(j.T @ j, j.T @ rate), covariance))
    return tuple(np.array(part) for part in zip(*told, strict=True))
