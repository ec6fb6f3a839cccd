"""One target without clutter: straight flight and turns, mixed, in plain NumPy.

Bar-Shalom, Li, Kirubarajan 2001: sections 11.6 (mixing) and 11.7 (coordinated turn).
"""

from __future__ import annotations

import numpy as np


def noise(position, radar):
    """Covariance of a plot: J diag(sigma_r^2, sigma_a^2) J'."""
    r, a = np.hypot(*position), np.arctan2(*position)
    jacobian = np.array([[np.sin(a), r * np.cos(a)], [np.cos(a), -r * np.sin(a)]])
    return jacobian @ np.diag([radar.range_sigma**2, radar.azimuth_sigma**2]) @ jacobian.T


def white(q, t, states):
    """Covariance of white acceleration of the density q."""
    result = np.zeros((states, states))
    for i in range(2):
        result[i, i] = q * t**3 / 3
        result[i, i + 2] = result[i + 2, i] = q * t**2 / 2
        result[i + 2, i + 2] = q * t
    return result


def straight(x, p, t, q):
    """Straight and uniform flight."""
    f = np.eye(4)
    f[0, 2] = f[1, 3] = t
    return f @ x, f @ p @ f.T + white(q, t, 4)


def turned(x, t):
    """A turn at the rate x[4]."""
    vx, vy, w = x[2:]
    s, c = np.sin(w * t), np.cos(w * t)
    if abs(w) < 1e-12:
        along, across = t, w * t**2 / 2
    else:
        along, across = s / w, (1 - c) / w
    return np.array(
        [
            x[0] + along * vx - across * vy,
            x[1] + across * vx + along * vy,
            c * vx - s * vy,
            s * vx + c * vy,
            w,
        ]
    )


def turn(x, p, t, q, walk):
    """A turn, linearised by differences."""
    jacobian = np.empty((5, 5))
    for j, step in enumerate([1.0, 1.0, 1e-2, 1e-2, 1e-6]):
        e = np.zeros(5)
        e[j] = step
        jacobian[:, j] = (turned(x + e, t) - turned(x - e, t)) / (2 * step)
    added = white(q, t, 5)
    added[4, 4] = walk**2 * t
    return turned(x, t), jacobian @ p @ jacobian.T + added


def corrected(x, p, z, r):
    """Kalman's correction, and the density of the plot."""
    h = np.eye(2, len(x))
    s = h @ p @ h.T + r
    gain = p @ h.T @ np.linalg.inv(s)
    y = z - h @ x
    density = np.exp(-0.5 * y @ np.linalg.inv(s) @ y) / (2 * np.pi * np.sqrt(np.linalg.det(s)))
    return x + gain @ y, p - gain @ s @ gain.T, density


def entering(x, p, variance):
    """Straight flight as a turn sees it."""
    covariance = np.zeros((5, 5))
    covariance[:4, :4] = p
    covariance[4, 4] = variance
    return np.append(x, 0.0), covariance


def moments(weights, means, covariances):
    """Moments of a mixture."""
    mean = sum(w * x for w, x in zip(weights, means, strict=True))
    parts = zip(weights, means, covariances, strict=True)
    return mean, sum(w * (p + np.outer(x - mean, x - mean)) for w, x, p in parts)


def imm(times, positions, radar, manoeuvres, speed_max, first_acceleration, confirmed_by):
    """Estimates after each plot: means, covariances, probabilities of a turn."""
    rate = manoeuvres.turn_rate_sigma**2
    x = np.array([*positions[0], 0.0, 0.0])
    p = np.zeros((4, 4))
    p[:2, :2] = noise(positions[0], radar)
    p[2, 2] = p[3, 3] = (speed_max / 2) ** 2
    found = [(x, p, 0.0)]
    for k in range(1, confirmed_by):
        t = times[k] - times[k - 1]
        x, p = straight(x, p, t, first_acceleration**2 * radar.period)
        x, p, _ = corrected(x, p, positions[k], noise(x[:2], radar))
        found.append((x, p, 0.0))
    mean = manoeuvres.turn_time / (manoeuvres.turn_time + manoeuvres.straight_time)
    probability = np.array([1 - mean, mean])
    found[-1] = (x, p, mean)
    x_turn, p_turn = entering(x, p, rate)
    for k in range(confirmed_by, len(times)):
        t = times[k] - times[k - 1]
        begins = 1 - np.exp(-t / manoeuvres.straight_time)
        ends = 1 - np.exp(-t / manoeuvres.turn_time)
        transition = np.array([[1 - begins, begins], [ends, 1 - ends]])
        predicted = probability @ transition
        mixing = transition * probability[:, np.newaxis] / predicted
        into = entering(x, p, rate)
        a = moments(mixing[:, 0], [x, x_turn[:4]], [p, p_turn[:4, :4]])
        b = moments(mixing[:, 1], [into[0], x_turn], [into[1], p_turn])
        x, p = straight(*a, t, manoeuvres.straight_sigma**2 * radar.period)
        q = manoeuvres.turn_sigma**2 * radar.period
        x_turn, p_turn = turn(*b, t, q, manoeuvres.turn_rate_walk)
        middle, _ = moments(predicted, [x, x_turn[:4]], [p, p_turn[:4, :4]])
        r = noise(middle[:2], radar)
        x, p, first = corrected(x, p, positions[k], r)
        x_turn, p_turn, second = corrected(x_turn, p_turn, positions[k], r)
        probability = predicted * [first, second]
        probability /= probability.sum()
        means, covariances = [x, x_turn[:4]], [p, p_turn[:4, :4]]
        found.append((*moments(probability, means, covariances), probability[1]))
    return tuple(np.array(column) for column in zip(*found, strict=True))
