"""Association by its formulas: distances of all pairs, regions by angles, scores."""

import numpy as np


def distances(predicted, covariance, plots, plot_covariance=None):
    """d² and ln |S| of every track with every plot, (T, N) each."""
    innovation = plots[np.newaxis] - predicted[:, np.newaxis]
    s = np.broadcast_to(
        covariance[:, np.newaxis], (len(predicted), len(plots), *covariance.shape[-2:])
    )
    if plot_covariance is not None:
        s = s + plot_covariance[np.newaxis]
    solved = np.linalg.solve(s, innovation[..., np.newaxis])[..., 0]
    return np.sum(innovation * solved, axis=-1), np.linalg.slogdet(s)[1]


def region(innovation, covariance, velocity, gates):
    """Name of the region, from the angle between the whitened vectors."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors @ np.diag(values**-0.5) @ vectors.T
    e, v = root @ innovation, root @ velocity
    d2 = e @ e
    if d2 <= gates[0]:
        return "INNER"
    if d2 > gates[2]:
        return "OUTSIDE"
    turn = np.degrees(np.arctan2(e[1], e[0]) - np.arctan2(v[1], v[0]))
    phi = (turn + 180) % 360 - 180
    if abs(phi) <= 45:
        where = "AHEAD"
    elif abs(phi) >= 135:
        where = "BEHIND"
    else:
        where = "LEFT" if phi > 0 else "RIGHT"
    return where if d2 <= gates[1] else f"GUARD_{where}"


def paper_score(d2, q, m):
    """S = 1/2 (1/Q - 1) d² + m/2 ln Q."""
    return 0.5 * (1 / q - 1) * d2 + m / 2 * np.log(q)
