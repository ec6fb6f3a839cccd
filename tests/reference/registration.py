"""Systematic errors of radars from blocks of the plots of one target, in plain NumPy."""

import numpy as np
from scipy import stats

STRAIGHT, TURN, TURNING = 0.3, 4.0, 0.3
SIGNIFICANCE, OUTLIER, STATED, ROUNDS, HEIGHT, FIRST = 1e-3, 3.5, 10.0, 4, 15.0, 10.0


def sighting(place, sigma, range_, azimuth, height, factor=(1.0, 1.0)):
    """Position, axes, sigmas along them, and metres of each error but the clock."""
    up = 0.0 if np.isnan(height) else height - place[2]
    ground = np.sqrt(range_**2 - up**2)
    away = np.array([np.sin(azimuth), np.cos(azimuth)])
    axes = np.array([away, [away[1], -away[0]]])
    along = np.hypot(factor[0] * sigma[0] * range_ / ground, HEIGHT * up / ground)
    design = np.array([[range_ / ground, range_**2 / ground, 0, 0], [0, 0, ground, 0]])
    return place[:2] + ground * away, axes, np.array([along, factor[1] * sigma[1] * ground]), design


def block(time, radar, seen, prior, acceleration, velocity=None):
    """Normal equations (Y, eta, T), free, residuals, sensitivities and redundancies."""
    n, count = len(time), len(prior)
    position = np.array([one[0] for one in seen])
    t = time - (time[0] + time[-1]) / 2
    y, h, g = np.zeros(2 * n + 2), np.zeros((2 * n + 2, 6)), np.zeros((2 * n + 2, 4 * count))
    rows = np.concatenate([one[1] / one[2][:, np.newaxis] for one in seen])
    if velocity is None:
        line = np.concatenate([rows, rows * np.repeat(time - time[0], 2)[:, np.newaxis]], axis=1)
        off = np.sum(rows * np.repeat(position - position[0], 2, axis=0), axis=1)
        velocity = np.linalg.lstsq(line, off, rcond=None)[0][2:]
    y[:-2] = np.sum(rows * np.repeat(position - position.mean(axis=0), 2, axis=0), axis=1)
    powers = np.stack([np.ones(n), t, t**2 / 2], axis=-1)
    h[:-2] = (rows[:, :, np.newaxis] * np.repeat(powers, 2, axis=0)[:, np.newaxis]).reshape(-1, 6)
    h[-2, 2] = h[-1, 5] = 1 / acceleration
    for i, (_, axes, sigma, design) in enumerate(seen):
        late = np.outer(-axes @ velocity, [0, 0, 0, 1])
        own = (design + late) * prior[radar[i]] / sigma[:, np.newaxis]
        g[2 * i : 2 * i + 2, 4 * radar[i] : 4 * radar[i] + 4] = own
    q = np.linalg.qr(h / np.linalg.norm(h, axis=0))[0]
    my, mg = y - q @ (q.T @ y), g - q @ (q.T @ g)
    redundancy = 1 - np.sum(q**2, axis=1)
    return mg.T @ mg, mg.T @ my, my @ my, 2 * n - 4, my[:-2], mg[:-2], redundancy[:-2]


def step(information, score, covariance):
    """The errors that fit best, where their covariance was this."""
    solved = np.linalg.solve(np.eye(len(score)) + information @ covariance, score)
    return covariance @ solved


def windows(target, time, longest):
    """Rows of the plots of each block, in order of time."""
    order = np.lexsort((time, target))
    found = []
    for i in order:
        first = found[-1][0] if found else i
        if found and target[first] == target[i] and time[i] - time[first] <= longest:
            found[-1].append(i)
        else:
            found.append([i])
    return found


def errors(plots, places, sigmas, longest, prior):
    """Errors (K, 4), their covariance, and noise factors (K, 2), of plots by column."""
    count = len(places)
    b, factor, covariance = np.zeros((count, 4)), np.ones((count, 2)), FIRST**2 * np.eye(4 * count)
    blocks = windows(plots["target"], plots["time"], longest)
    for _ in range(ROUNDS):
        information, score = np.eye(4 * count), -(b / prior).ravel()
        square, free = np.zeros((count, 2)), np.zeros((count, 2))
        for rows in blocks:
            part = {name: column[rows] for name, column in plots.items()}
            k = part["sensor"]
            heights = part["height"][np.isfinite(part["height"])]
            mean = heights.mean() if len(heights) else np.nan
            heights = np.where(np.isnan(part["height"]), mean, part["height"])
            range_ = (part["range"] - b[k, 0]) / (1 + b[k, 1])
            # not overhead
            kept = range_**2 - np.nan_to_num(heights - places[k, 2]) ** 2 > 1e-6 * range_**2
            azimuth, time = part["azimuth"] - b[k, 2], part["time"] - b[k, 3]
            order = np.flatnonzero(kept)[np.argsort(time[kept], kind="stable")]
            seen = [
                sighting(places[j], sigmas[j], range_[i], azimuth[i], heights[i], factor[j])
                for i, j in zip(order, k[order], strict=True)
            ]
            time, k = time[order], k[order]
            turns = np.any(part["turn_probability"] > TURNING)
            for attempt in range(3):
                if len(time) < 3:
                    break
                found = block(time, k, seen, prior, TURN if turns else STRAIGHT)
                y, eta, t, degrees, my, mg, redundancy = found
                own = step(y, eta, covariance)
                rest = my - mg @ own
                if stats.chi2.sf(t - eta @ own, degrees) >= SIGNIFICANCE:
                    np.add.at(square, k, (rest**2).reshape(-1, 2))
                    np.add.at(free, k, redundancy.reshape(-1, 2))
                    if len(set(k)) > 1:
                        information += y
                        score += eta
                    break
                off = (rest**2 / redundancy).reshape(-1, 2).max(axis=1)
                worst = int(np.argmax(off))
                if attempt == 2 or off[worst] <= OUTLIER**2:
                    break
                time, k = np.delete(time, worst), np.delete(k, worst)
                seen.pop(worst)
        covariance = np.linalg.inv(information)
        b = b + (covariance @ score).reshape(-1, 4) * prior
        factor = factor * np.sqrt((square + STATED) / (free + STATED))
    scale = prior.ravel()
    return b, covariance * np.outer(scale, scale), factor
