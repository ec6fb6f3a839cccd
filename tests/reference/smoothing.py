"""Local polynomials by least squares with powers; the smoother as one dense normal distribution."""

import gmpy2
import numpy as np
from scipy import stats

# of the first state: nothing is known, in 300 digits
WIDE = gmpy2.mpfr(10) ** 140
BITS = 1000


def exactly(values):
    """These floats for MPFR to compute with."""
    flat = [gmpy2.mpfr(float(value)) for value in np.ravel(values)]
    return np.array(flat, dtype=object).reshape(np.shape(values))


def polynomial(y, window, degree, *, time=None, variance=None, derivative=0, significance=0.05):
    """Value, standard error for unit variance, and degree, instant by instant; highest degree if a
    tuple (0, highest) is given."""
    y, n = np.asarray(y, dtype=float), len(y)
    t = np.arange(n) if time is None else np.asarray(time, dtype=float)
    v = np.ones(n) if variance is None else np.broadcast_to(variance, n)
    adaptive = isinstance(degree, tuple)
    top = degree[1] if adaptive else degree
    value, error, used = np.full(n, np.nan), np.full(n, np.inf), np.full(n, -1)
    residuals = np.full(n, np.nan)
    expected = np.full(n, np.nan)
    size = min(window, n)
    for i in range(n):
        start = min(max(i - window // 2, 0), n - size)
        own = np.arange(start, start + size)
        own = own[~np.isnan(y[own])]
        highest = min(top, len(set(t[own])) - 1)
        if highest < top or (adaptive and variance is None and len(own) < top + 2):
            continue
        fits = [_powers(t[own] - t[i], y[own], v[own], p) for p in range(highest + 1)]
        p = highest
        while adaptive and p > derivative:
            nu = len(own) - p - 1
            gain = fits[p - 1][2] - fits[p][2]
            if variance is not None:
                if gain > stats.chi2.isf(significance, 1):
                    break
            elif gain * nu > stats.f.isf(significance, 1, nu) * fits[p][2]:
                break
            p -= 1
        factorial = np.prod(np.arange(1, derivative + 1))
        coefficients, covariance, _ = fits[p]
        value[i] = factorial * coefficients[derivative]
        error[i] = factorial * np.sqrt(covariance[derivative, derivative])
        used[i] = p
        if not np.isnan(y[i]):
            coefficients, covariance, _ = fits[highest]
            residuals[i] = y[i] - coefficients[0]
            expected[i] = 1 - covariance[0, 0] / v[i]
    found = np.nansum(residuals**2) / np.nansum(expected)
    return value, error * (1 if variance is not None else np.sqrt(found)), used, found


def _powers(t, y, v, degree):
    """Coefficients of the powers of t, their covariance, and what is left."""
    scale = np.max(np.abs(t), initial=0.0) or 1.0
    origin = y[0]
    root = 1 / np.sqrt(v)
    a = np.vander(t / scale, degree + 1, increasing=True) * root[:, np.newaxis]
    coefficients, *_ = np.linalg.lstsq(a, (y - origin) * root, rcond=None)
    left = (y - origin) * root - a @ coefficients
    units = scale ** -np.arange(degree + 1.0)
    covariance = np.linalg.inv(a.T @ a) * np.outer(units, units)
    coefficients = coefficients * units
    coefficients[0] += origin
    return coefficients, covariance, left @ left


def transition(t):
    """F of one axis."""
    return np.array([[1, t, t**2 / 2], [0, 1, t], [0, 0, 1]], dtype=object)


def noise(t, q, a=0):
    """Q of one axis over the time t: white jerk and acceleration of the intensities q and a."""
    return np.array(
        [
            [q * t**5 / 20 + a * t**3 / 3, q * t**4 / 8 + a * t**2 / 2, q * t**3 / 6],
            [q * t**4 / 8 + a * t**2 / 2, q * t**3 / 3 + a * t, q * t**2 / 2],
            [q * t**3 / 6, q * t**2 / 2, q * t],
        ],
        dtype=object,
    )


def _cholesky(a):
    """Return the lower L with `L L' = a`."""
    a, n = a.copy(), len(a)
    for j in range(n):
        root = gmpy2.sqrt(a[j, j])
        a[j:, j] = a[j:, j] / root
        for i in range(j + 1, n):
            a[i:, i] = a[i:, i] - a[i:, j] * a[i, j]
        a[j, j + 1 :] = gmpy2.mpfr(0)
    return a


def _solve(lower, b):
    """Return `L^-1 b`."""
    b = b.copy()
    for j in range(len(lower)):
        b[j] = b[j] / lower[j, j]
        if j + 1 < len(lower):
            b[j + 1 :] = b[j + 1 :] - np.multiply.outer(lower[j + 1 :, j], b[j])
    return b


def smooth(y, covariance, times, q, initial=None, lasting=None, acceleration=0, axes=None):
    """Mean (N, 3D) and covariance (N, 3D, 3D), innovations (N, M) and log L but for a constant.

    The M numbers of `y` are the first of a state of so many axes, by default of M. `lasting` are
    the share of the noise that lasts and its correlation time, `acceleration` is the intensity of
    white acceleration.

    All states are normal, and so are all plots: the states given the plots are one formula. What is
    not determined has nan and inf.
    """
    with gmpy2.context(precision=BITS):
        n, m = np.shape(y)
        d = m if axes is None else axes
        t, states = exactly(times), 3 * d
        unit = exactly(np.eye(d))
        mean0, first = exactly(np.zeros(states)), exactly(np.eye(states)) * WIDE
        if initial is not None:
            mean0, first = exactly(initial[0]), exactly(initial[1])
        f = [np.kron(transition(s - t[0]), unit) for s in t]
        intensities = gmpy2.mpfr(q), gmpy2.mpfr(acceleration)
        deviations = [np.kron(noise(s - t[0], *intensities), unit) for s in t]
        joint = exactly(np.zeros((n * states, n * states)))
        for i in range(n):
            for j in range(i, n):
                later = np.kron(transition(t[j] - t[i]), unit)
                block = f[i].dot(first).dot(f[j].T) + deviations[i].dot(later.T)
                joint[i * states : (i + 1) * states, j * states : (j + 1) * states] = block
                joint[j * states : (j + 1) * states, i * states : (i + 1) * states] = block.T
        prior = np.concatenate([a.dot(mean0) for a in f])
        there = ~np.isnan(np.ravel(y))
        places = np.ravel(states * np.arange(n)[:, np.newaxis] + np.arange(m))[there]
        errors = exactly(np.zeros((n * m, n * m)))
        for i in range(n):
            own = slice(i * m, (i + 1) * m)
            errors[own, own] = exactly(covariance[i])
        if lasting is not None:
            errors = _with_lasting(errors, t, d, *lasting)
        v = joint[np.ix_(places, places)] + errors[np.ix_(there, there)]
        lower = _cholesky(v)
        difference = exactly(np.ravel(y)[there]) - prior[places]
        white = _solve(lower, difference)
        gain = _solve(lower, joint[places])
        mean = (prior + gain.T.dot(white)).reshape(n, states)
        blocks = [slice(i * states, (i + 1) * states) for i in range(n)]
        posterior = [joint[b, b] - gain[:, b].T.dot(gain[:, b]) for b in blocks]
        pivots = np.diagonal(lower)
        innovation = np.full(n * m, np.nan)
        wide = np.array([pivot**2 > gmpy2.sqrt(WIDE) for pivot in pivots], dtype=bool)
        innovation[there] = np.where(wide, np.nan, white.astype(float))
        likelihood = -sum(gmpy2.log(p) for p in pivots) - white.dot(white) / 2
        return (*_determined(mean, posterior), innovation.reshape(n, m), float(likelihood))


def _with_lasting(errors, t, d, share, time):
    """Covariances of plots with whitened noise that is correlated between instants."""
    errors, n = errors.copy(), len(t)
    blocks = [slice(i * d, (i + 1) * d) for i in range(n)]
    roots = [_cholesky(errors[b, b]) for b in blocks]
    for i in range(n):
        for j in range(n):
            if i != j:
                decay = gmpy2.mpfr(share) * gmpy2.exp(-abs(t[i] - t[j]) / gmpy2.mpfr(time))
                errors[blocks[i], blocks[j]] = decay * roots[i].dot(roots[j].T)
    return errors


def _determined(mean, posterior):
    found, covariances = np.full(mean.shape, np.nan), []
    for i, p in enumerate(posterior):
        known = np.array([v < gmpy2.sqrt(WIDE) for v in np.diagonal(p)], dtype=bool)
        found[i, known] = mean[i, known].astype(float)
        both = np.outer(known, known)
        covariance = np.where(both, p, 0.0).astype(float)
        covariance[~known, ~known] = np.inf
        covariances.append(covariance)
    return found, np.array(covariances)
