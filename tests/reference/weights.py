"""Weights in plain NumPy: every covariance inverted, every product of order m² carried out.

`s` holds the covariances (K, m, m), `c` one factor for each; vec stacks columns. Complex matrices
are allowed where a formula is to be differentiated by complex steps.
"""

import numpy as np

STEP = 1e-200


def vec(a):
    return a.flatten(order="F")


def commutation(m):
    """K, for which K vec A = vec A'."""
    k = np.zeros((m * m, m * m))
    for i, j in np.ndindex(m, m):
        k[i * m + j, j * m + i] = 1
    return k


def inverses(s):
    return [np.linalg.inv(covariance) for covariance in s]


def fused_covariance(s):
    """(2)."""
    return np.linalg.inv(sum(inverses(s)))


def weights(s):
    """(6), for every sensor."""
    s_p = fused_covariance(s)
    return np.array([s_p @ c for c in inverses(s)])


def combine(x, s):
    """(1), for any number of estimates: value, covariance, sum of squared residuals."""
    c, s_p = inverses(s), fused_covariance(s)
    value = s_p @ sum(c_k @ x_k for c_k, x_k in zip(c, x, strict=True))
    residuals = [x_k - value for x_k in x]
    statistic = sum(d @ c_k @ d for c_k, d in zip(c, residuals, strict=True))
    return value, s_p, statistic


def combine_scalar(x, s, h, z, sigma):
    """Information of rank one added: value, covariance, squared innovation over its variance."""
    after = np.linalg.inv(np.linalg.inv(s) + np.outer(h, h) / sigma**2)
    value = after @ (np.linalg.inv(s) @ x + h * z / sigma**2)
    return value, after, (z - h @ x) ** 2 / (h @ s @ h + sigma**2)


def sample_covariance(x, convention):
    """(3) and its variants; the true mean is 0 where it is known."""
    n = len(x)
    mean = sum(x) / n
    rows, divisor = {
        "sample-mean": ([row - mean for row in x], n - 1),
        "known-mean": (x, n),
        "paper": (x, n - 1),
        "differences": ([x[i + 1] - x[i] for i in range(n - 1)], 2 * (n - 1)),
    }[convention]
    return sum(np.outer(row, row) for row in rows) / divisor


def covariance_factor(n, convention):
    """(4): c, where the measurements are normal; a covariance that is known has none."""
    if np.isinf(n):
        return 0.0
    return {
        "sample-mean": 1 / (n - 1),
        "known-mean": 1 / n,
        "paper": n / (n - 1) ** 2,
        "differences": (3 * n - 4) / (2 * (n - 1) ** 2),
    }[convention]


def elements_of_covariance_of_covariance(s, c):
    """(4), (5), element by element: between s_ij and s_qp."""
    m = len(s)
    out = np.empty((m * m, m * m))
    for i, j, q, p in np.ndindex(m, m, m, m):
        out[j * m + i, p * m + q] = c * (s[i, q] * s[j, p] + s[i, p] * s[j, q])
    return out


def covariance_of_covariance(s, c):
    """(4), (5) as one product."""
    m = len(s)
    return c * np.kron(s, s) @ (np.eye(m * m) + commutation(m))


def jacobian_of_two(s):
    """P1 and P2 of the second weight, one column after the other, (12) to (14)."""
    c1, c2 = inverses(s)
    w, m = weights(s)[1], len(c1)
    p1, p2 = [], []
    for j, i in np.ndindex(m, m):
        e = np.zeros((m, m))
        e[i, j] = 1
        p1.append(vec((np.eye(m) - w) @ e @ c1 @ w))
        p2.append(vec(-w @ e @ c2 @ (np.eye(m) - w)))
    return np.array([np.transpose(p1), np.transpose(p2)])


def jacobian(s, k):
    """The same for any number of sensors, as a Kronecker product."""
    c, w = inverses(s), weights(s)
    own = [np.eye(len(c[0])) * (j == k) for j in range(len(s))]
    return np.array([np.kron((c[j] @ (w[k] - own[j])).T, w[j]) for j in range(len(s))])


def jacobians_by_complex_steps(s):
    """That of every weight, (K, K, m², m²), with nothing differentiated by hand."""
    sensors, m = np.shape(s)[:2]
    out = np.empty((sensors, sensors, m * m, m * m))
    for j, p, q in np.ndindex(sensors, m, m):
        moved = np.array(s, dtype=complex)
        moved[j, p, q] += 1j * STEP
        for k, weight in enumerate(weights(moved)):
            out[k, j, :, q * m + p] = vec(weight.imag) / STEP
    return out


def weight_covariance_of_two(s, c):
    """(10)."""
    p1, p2 = jacobian_of_two(s)
    c_s1, c_s2 = (covariance_of_covariance(s[j], c[j]) for j in range(2))
    return p1 @ c_s1 @ p1.T + p2 @ c_s2 @ p2.T


def weight_covariance(s, c, k):
    """(10), for any number of sensors."""
    p = jacobian(s, k)
    return sum(p[j] @ covariance_of_covariance(s[j], c[j]) @ p[j].T for j in range(len(s)))


def bias_of_two(s, c):
    """Of the second weight."""
    w, one = weights(s)[1], np.eye(len(s[0]))
    v = one - w
    return w @ v @ (c[1] * (v + np.trace(v) * one) - c[0] * (w + np.trace(w) * one))


def bias(s, c, k, mean=None):
    """Half the second derivatives times the covariances, plus the first times a mean's error.

    The second derivatives are those of the Jacobian by complex steps.
    """
    m = len(s[0])
    out = np.zeros(m * m)
    for j, covariance in enumerate(s):
        c_s = covariance_of_covariance(covariance, c[j])
        for p, q in np.ndindex(m, m):
            moved = np.array(s, dtype=complex)
            moved[j, p, q] += 1j * STEP
            second = jacobian(moved, k)[j].imag / STEP
            out += second @ c_s[:, q * m + p] / 2
        if mean is not None:
            out += jacobian(s, k)[j] @ vec((mean[j] - 1) * np.asarray(covariance))
    return out.reshape(m, m).T


def mean_squared_error_of_two(s, c):
    w, s_p, one = weights(s)[1], fused_covariance(s), np.eye(len(s[0]))
    v = one - w
    added = c[0] * np.trace(w) * v + c[1] * np.trace(v) * w + (c[0] + c[1]) * w @ v
    return (one + added) @ s_p


def mean_squared_error(s, c):
    w, s_p, one = weights(s), fused_covariance(s), np.eye(len(s[0]))
    added = (c[j] * (np.trace(one - w[j]) * w[j] + w[j] @ (one - w[j])) for j in range(len(s)))
    return (one + sum(added)) @ s_p


def mean_squared_error_from_weights(s, c):
    """S_p plus the sum of all E dW_k S_k dW_k', from the covariance of every weight."""
    m, out = len(s[0]), fused_covariance(s)
    for k in range(len(s)):
        c_w = weight_covariance(s, c, k).reshape(m, m, m, m)
        out = out + np.einsum("baqp,bq->ap", c_w, s[k])
    return out


def loss_of_equal_sensors(m, nu):
    """Exact, of two sensors with the same covariance and degrees of freedom."""
    return ((nu - 1) + nu * (2 * nu * m - 2) / (2 * nu - m - 1)) / ((2 * nu - 1) * (nu + 1))
