"""Location by its formulas: predictions, whitened residuals, covariances."""

import numpy as np

KINDS = ("range", "azimuth", "elevation", "range_difference")
TUKEY = 4.685
# of the covariance: minus the logarithm of the odds of a fault, and the safety factor
EVIDENCE, SAFETY = 8.28, 6.0


def predict(p, stations, axes=None):
    """What a position predicts, (K,) each; azimuths clockwise from north.

    `axes` are each station's east, north and up, rows of (K, D, D), to which angles refer.
    """
    d = np.asarray(p, dtype=float) - np.asarray(stations, dtype=float)
    ranges = np.sqrt(np.sum(d**2, axis=-1))
    own = d if axes is None else np.einsum("...kij,...kj->...ki", axes, d)
    predicted = {
        "range": ranges,
        "azimuth": np.arctan2(own[..., 0], own[..., 1]),
        "range_difference": ranges[..., 1:] - ranges[..., :1],
    }
    if d.shape[-1] == 3:
        predicted["elevation"] = np.arctan2(own[..., 2], np.hypot(own[..., 0], own[..., 1]))
    return predicted


def residuals(p, stations, measured, sigmas, axes=None):
    """Whitened residuals of all measurements that are there, one after the other."""
    predicted = predict(p, stations, axes)
    rows = []
    for kind in KINDS:
        if kind in measured:
            r = np.asarray(measured[kind]) - predicted[kind]
            if kind in {"azimuth", "elevation"}:
                r = np.angle(np.exp(1j * r))
            r = r / sigmas[kind]
            rows.append(r[~np.isnan(r)])
    return np.concatenate(rows)


def jacobian(p, stations, measured, sigmas, axes=None):
    """Derivatives of the whitened residuals by differences of fourth order."""
    columns = []
    step = 1e-4
    for i in range(len(p)):
        e = np.zeros(len(p))
        e[i] = step
        near = [residuals(p + f * e, stations, measured, sigmas, axes) for f in (-2, -1, 1, 2)]
        columns.append((near[0] - 8 * near[1] + 8 * near[2] - near[3]) / (12 * step))
    return np.stack(columns, axis=-1)


def tukey_cost(u):
    """The cost of residuals: c²/6 (1 - (1 - (u/c)²)³) up to c, c²/6 beyond."""
    rest = np.maximum(0.0, 1.0 - (u / TUKEY) ** 2)
    return TUKEY**2 / 6 * np.sum(1 - rest**3)


def tukey_weight(u):
    """The weight of residuals."""
    return np.maximum(0.0, 1.0 - (u / TUKEY) ** 2) ** 2


def doubt(u, j):
    """What measurements that may be faults add to the covariance, by leaving each of them out.

    The position moves by the difference between leaving a measurement out and weight 1, with the
    others at their weights; the probability of a fault follows from its residual, left out, over
    the standard deviation of that.
    """
    w = tukey_weight(u)
    total = np.zeros((j.shape[1], j.shape[1]))
    for i in range(len(u)):
        others = np.arange(len(u)) != i
        information = (j[others].T * w[others]) @ j[others]
        without = np.linalg.inv(information)
        # one step from the estimate, where the weighted residuals cancel
        moved = without @ (j[others].T @ (w[others] * u[others]))
        residual = u[i] - j[i] @ moved
        variance = 1 + j[i] @ without @ j[i]
        odds = np.exp(residual**2 / variance / 2 - EVIDENCE)
        believed = np.linalg.inv(information + np.outer(j[i], j[i])) @ (
            j.T @ (np.where(others, w, 1.0) * u)
        )
        shift = believed - moved
        total += SAFETY * odds / (1 + odds) ** 2 * np.outer(shift, shift)
    return total
