"""Biases of radars by weighted least squares with Huber's weights and a sandwich covariance."""

import numpy as np

PRIOR, HUBER, ROUNDS = 10.0, 2.5, 10


def biases(state, covariance, track, places, stated):
    """Biases of range and azimuth (K, 2) and their standard deviations, from states (M, K, 4)."""
    count = len(places)
    rows, off, tracks = [], [], []
    for i in range(count):
        for j in range(i + 1, count):
            both = np.isfinite(state[:, i, 0]) & np.isfinite(state[:, j, 0])
            for m in np.flatnonzero(both):
                h = np.zeros((2, 2 * count))
                for k, sign in ((i, 1.0), (j, -1.0)):
                    east, north = state[m, k, :2] - places[k]
                    h[:, 2 * k] = sign * np.array([east, north]) / np.hypot(east, north)
                    h[:, 2 * k + 1] = sign * np.array([north, -east])
                spread = covariance[m, i, :2, :2] + covariance[m, j, :2, :2]
                root = np.linalg.inv(np.linalg.cholesky(spread))
                rows.append(root @ h)
                off.append(root @ (state[m, i, :2] - state[m, j, :2]))
                tracks.append(track[m])
    h, r, prior = np.array(rows), np.array(off), np.tile(PRIOR * stated, count)
    h = h * prior
    weight = np.ones(len(r))
    for _ in range(ROUNDS):
        information = np.eye(2 * count) + np.einsum("n,nai,naj->ij", weight, h, h)
        b = np.linalg.solve(information, np.einsum("n,nai,na->i", weight, h, r))
        rest = r - h @ b
        weight = np.minimum(1.0, HUBER / np.linalg.norm(rest, axis=1))
    score = np.einsum("n,nai,na->ni", weight, h, rest)
    sums = np.array([score[np.array(tracks) == one].sum(axis=0) for one in np.unique(tracks)])
    factor = len(sums) / max(len(sums) - 2 * count, 1)
    inverse = np.linalg.inv(information)
    sandwich = inverse @ (np.eye(2 * count) + factor * sums.T @ sums) @ inverse
    sigma = np.sqrt(np.maximum(np.diagonal(sandwich), np.diagonal(inverse)))
    return (b * prior).reshape(count, 2), (sigma * prior).reshape(count, 2)
