"""The filter (14) to (20) in plain matrices, of floats or of mpmath's numbers (dtype object)."""

from functools import lru_cache

import gmpy2
import mpmath
import numpy as np


def exactly(values):
    """These floats for mpmath to compute with."""
    flat = [mpmath.mpf(float(value)) for value in np.ravel(values)]
    return np.array(flat, dtype=object).reshape(np.shape(values))


def solve(a, b):
    """Gauss and Jordan, with pivots; the X with `a X = b`."""
    rows, n = np.concatenate([a, b], axis=1), len(a)
    for i in range(n):
        pivot = i + np.argmax(np.abs(rows[i:, i]))
        rows[[i, pivot]] = rows[[pivot, i]]
        rows[i] = rows[i] / rows[i, i]
        for j in range(n):
            if j != i:
                rows[j] = rows[j] - rows[j, i] * rows[i]
    return rows[:, n:]


def determinant(a):
    """By cofactors of the pivots."""
    rows, value = a.copy(), 1
    while len(rows):
        pivot = np.argmax(np.abs(rows[:, 0]))
        if pivot:
            rows[[0, pivot]] = rows[[pivot, 0]]
            value = -value
        value = value * rows[0, 0]
        rows = rows[1:, 1:] - np.outer(rows[1:, 0] / rows[0, 0], rows[0, 1:])
    return value


# models: F and Q over a time


def printed(t, alpha, sigma):
    """(14): alpha T < 1."""
    with mpmath.workdps(100):
        t, alpha, sigma = mpmath.mpf(t), mpmath.mpf(alpha), mpmath.mpf(sigma)
        left = 1 - alpha * t
        f, q = exactly(np.eye(3)), exactly(np.zeros((3, 3)))
        f[0, 1], f[0, 2], f[1, 2], f[2, 2] = t, t**2 / 2, t, left
        q[2, 2] = sigma**2 * (1 - left**2)
        return f, q


@lru_cache(maxsize=1000)
def _van_loan(x):
    """F and Q for T = 1, alpha = x, sigma = 1, by the exponential of [[-A, B], [0, A']]."""
    with gmpy2.context(precision=600):
        x = _from_mpmath(x)
        block = np.full((6, 6), gmpy2.mpfr(0))
        for i, j in [(0, 1), (1, 2)]:
            block[i, j], block[3 + j, 3 + i] = gmpy2.mpfr(-1), gmpy2.mpfr(1)
        block[2, 2], block[5, 5], block[2, 5] = x, -x, 2 * x
        power = exponential(block)
        f = power[3:, 3:].T
        return _to_mpmath(f), _to_mpmath(f.dot(power[:3, 3:]))


def exponential(a):
    """By the series of `a / 2^k`, squared k times."""
    halvings = 20 + max(0, int(gmpy2.ceil(gmpy2.log2(np.max(np.abs(a))))))
    small, term = a / gmpy2.mpfr(2) ** halvings, np.eye(len(a), dtype=int) * gmpy2.mpfr(1)
    total = term
    for k in range(1, 30):
        term = term.dot(small) / k
        total = total + term
    for _ in range(halvings):
        total = total.dot(total)
    return total


def _from_mpmath(value):
    mantissa, exponent = value.man_exp
    return gmpy2.mpfr(int(mantissa)) * gmpy2.mpfr(2) ** int(exponent)


def _to_mpmath(values):
    flat = [one.as_mantissa_exp() for one in values.ravel()]
    with mpmath.workdps(200):
        numbers = [mpmath.ldexp(int(mantissa), int(exponent)) for mantissa, exponent in flat]
    return np.array(numbers, dtype=object).reshape(values.shape)


def singer(t, alpha, sigma):
    """The same in continuous time, `a' = -alpha a + noise`, by Van Loan's method."""
    if t == 0:
        return exactly(np.eye(3)), exactly(np.zeros((3, 3)))
    with mpmath.workdps(100):
        t, alpha, sigma = mpmath.mpf(t), mpmath.mpf(alpha), mpmath.mpf(sigma)
        f, q = _van_loan(alpha * t)
        unit = np.array([t**2, t, mpmath.mpf(1)], dtype=object)
        return f * np.outer(unit, 1 / unit), sigma**2 * q * np.outer(unit, unit)


def transitions(model, dt):
    """F and Q of a `SingerModel` over each of these times."""
    rule = singer if model.exact else printed
    each = [rule(t, model.alpha, model.acceleration_sigma) for t in dt]
    return [f for f, _ in each], [q for _, q in each]


def as_floats(matrices):
    return [m.astype(float) for m in matrices]


# the filter


def wrap(difference, period):
    if period is None:
        return difference
    return difference - period * int(np.floor(float(difference / period) + 0.5))


def predict(x, p, f, q):
    return f @ x, f @ p @ f.T + q


def update(x, p, z, r, period=None):
    """Joseph's form, symmetrised; innovation, its variance and the gain as well."""
    innovation, s = wrap(z - x[0], period), p[0, 0] + r
    gain = p[:, 0] / s
    kept = np.eye(3, dtype=int) - np.outer(gain, [1, 0, 0])
    p = kept @ p @ kept.T + r * np.outer(gain, gain)
    return x + gain * innovation, (p + p.T) / 2, innovation, s, gain


def filter_series(z, r, f, q, x, p, period=None):
    """From the state before the first plot: means, covariances, innovations, their variances and
    gains."""
    steps = []
    for k, plot in enumerate(z):
        if k:
            x, p = predict(x, p, f[k - 1], q[k - 1])
        found = np.nan, np.nan, np.full(3, np.nan)
        if not np.isnan(float(plot)):
            x, p, *found = update(x, p, plot, r[k], period)
        steps.append((x, p, *found))
    return [np.array(part) for part in zip(*steps, strict=True)]


def smooth_series(means, covariances, f, q, last=None):
    """Rauch, Tung, Striebel; from the filtered state at the end, or another."""
    x, p = ([means[-1]], [covariances[-1]]) if last is None else ([last[0]], [last[1]])
    for k in range(len(means) - 2, -1, -1):
        predicted, prior = predict(means[k], covariances[k], f[k], q[k])
        gain = solve(prior, f[k] @ covariances[k]).T
        x.append(means[k] + gain @ (x[-1] - predicted))
        p.append(covariances[k] + gain @ (p[-1] - prior) @ gain.T)
    return np.array(x[::-1]), np.array(p[::-1])


def log_likelihood(innovations, variances):
    known = ~np.isnan(innovations)
    v, s = innovations[known], variances[known]
    return -0.5 * np.sum(v**2 / s + np.log(2 * np.pi * s))


# the start without a state: the limit of a wide one

WIDE = mpmath.mpf(10) ** 60
UNKNOWN = 1e40


def known_from(z, f):
    """The place of the second plot at another time than the first, or the number of steps."""
    elapsed = np.cumsum([0.0] + [float(one[0, 1]) for one in f])
    there = np.flatnonzero(~np.isnan(z))
    later = [k for k in there if elapsed[k] > elapsed[there[0]]]
    return later[0] if later else len(z)


def series(z, r, f, q, start, period=None):
    """Filter and smoother from a state, or from the variance of the acceleration alone.

    Returns the five parts of `filter_series`, and means and covariances of the smoother. What is
    unknown has the variance inf; before the first plot, all is. There is no smoother (None) for a
    target without acceleration, whose covariances have no inverse.
    """
    z, r = np.asarray(z, dtype=float), np.asarray(r, dtype=float)
    rough = as_floats(f), as_floats(q)
    if isinstance(start, tuple):
        filtered = filter_series(z, r, *rough, *start, period)
        return filtered, smooth_series(*filtered[:2], *rough)
    early, last = slice(known_from(z, f) + 1), None
    with mpmath.workdps(150):
        prior = np.diag([WIDE, WIDE, mpmath.mpf(start)])
        noise = exactly(r[early])
        head = filter_series(exactly(z[early]), noise, f, q, exactly(np.zeros(3)), prior, period)
        filtered, late = head, [part[:1] for part in head[:2]]
        if early.stop <= len(z):
            # from here on in floats
            k = early.stop - 1
            x, p = head[0][-1].astype(float), head[1][-1].astype(float)
            after = [part[k:] for part in rough]
            tail = filter_series([np.nan, *z[k + 1 :]], r[k:], *after, x, p, period)
            filtered = joined(head, [part[1:] for part in tail])
            if start > 0:
                late = smooth_series(*tail[:2], *after)
                last = exactly(late[0][0]), exactly(late[1][0])
        smoothed = None
        if start > 0:
            back = smooth_series(*head[:2], f[: len(head[0]) - 1], q, last)
            smoothed = joined(back, [part[1:] for part in late])
    filtered = joined(filtered, [part[:0] for part in filtered])
    there = ~np.isnan(z)
    nothing_before = np.argmax(there) if there.any() else len(z)
    for covariances in filtered[1], *([] if smoothed is None else smoothed[1:]):
        covariances[np.abs(covariances) > UNKNOWN] = np.inf
        covariances[:nothing_before] = np.inf
    unpredicted = ~(filtered[3] < UNKNOWN)
    for part in filtered[2:]:
        part[unpredicted] = np.nan
    return filtered, smoothed


def joined(head, tail):
    return [np.concatenate(pair).astype(float) for pair in zip(head, tail, strict=True)]


# a whole series at once


class LeastSquares:
    """`z = H b + M u + v`: angle and rate b at the first step unknown, u the first acceleration
    and the noise of every step, v that of the plots."""

    def __init__(self, z, r, f, q, acceleration_variance):
        n = len(z)
        size = 1 + 3 * (n - 1)
        zero = acceleration_variance * 0
        d = np.full((size, size), zero)
        d[0, 0] = acceleration_variance
        b = np.full((3, 2), zero)
        b[0, 0] = b[1, 1] = zero + 1
        g = np.full((3, size), zero)
        g[2, 0] = zero + 1
        self.b, self.g, self.d = [b], [g], d
        for k in range(n - 1):
            b, g = f[k] @ b, f[k] @ g
            noise = slice(1 + 3 * k, 4 + 3 * k)
            d[noise, noise] = q[k]
            g[:, noise] = np.eye(3, dtype=int) + zero
            self.b.append(b)
            self.g.append(g)
        there = [k for k in range(n) if not np.isnan(float(z[k]))]
        self.z = np.array([z[k] for k in there]).reshape(-1, 1)
        self.h = np.array([self.b[k][0] for k in there])
        self.m = np.array([self.g[k][0] for k in there])
        self.v = self.m @ d @ self.m.T
        for i, k in enumerate(there):
            self.v[i, i] = self.v[i, i] + r[k]

    def estimates(self):
        """Means and covariances of the states at all steps."""
        weights = solve(self.v, np.concatenate([self.h, self.z, self.m @ self.d], axis=1))
        vh, vz, vmd = weights[:, :2], weights[:, 2:3], weights[:, 3:]
        information = self.h.T @ vh
        found = solve(information, np.concatenate([self.h.T @ vz, np.eye(2, dtype=int)], axis=1))
        beta, c = found[:, :1], found[:, 1:]
        u = (self.m @ self.d).T @ (vz - vh @ beta)
        rest = self.d - (self.m @ self.d).T @ vmd
        means, covariances = [], []
        for b, g in zip(self.b, self.g, strict=True):
            means.append((b @ beta + g @ u)[:, 0])
            lever = b - g @ (self.m @ self.d).T @ vh
            covariances.append(g @ rest @ g.T + lever @ c @ lever.T)
        return np.array(means), np.array(covariances)

    def log_likelihood(self):
        """Of all plots but the two that b takes, up to a constant that those two determine."""
        weights = solve(self.v, np.concatenate([self.h, self.z], axis=1))
        information = self.h.T @ weights[:, :2]
        beta = solve(information, self.h.T @ weights[:, 2:])
        residual = self.z - self.h @ beta
        squares = (residual.T @ (weights[:, 2:] - weights[:, :2] @ beta))[0, 0]
        spread = mpmath.log(determinant(self.v)) + mpmath.log(determinant(information))
        count = len(self.z) - 2
        return -(squares + spread + count * mpmath.log(2 * mpmath.pi)) / 2


def riccati(f, q, r, doublings=30):
    """The steady covariance before a plot, by doubling."""
    one = np.eye(3, dtype=int)
    a, h = f.T, q
    g = np.outer([1, 0, 0], [1, 0, 0]) / r
    for _ in range(doublings):
        right = solve(one + g @ h, np.concatenate([a, g @ a.T], axis=1))
        a, g, h = a @ right[:, :3], g + a @ right[:, 3:], h + a.T @ h @ right[:, :3]
    return h


# the misprints


def misprinted_gains(f, q, r, p, count, misprint):
    """Gains of the recursion with one of the misprints of (18)."""
    gains = []
    for _ in range(count):
        prior, transposed = p.copy(), f.T
        if misprint == "index 022 for 012":
            prior[0, 1] = p[1, 1]
        elif misprint == "1 - alpha T in the first corner":
            transposed = f.T.copy()
            transposed[0, 0], transposed[2, 2] = f[2, 2], 1.0
        prior = f @ prior @ transposed + q
        gain = prior[:, 0] / (prior[0, 0] + r)
        p = prior - np.outer(gain, prior[0])
        gains.append(gain)
    return np.array(gains), p
