"""The bearing estimators in plain NumPy: one record of unwrapped angles."""

import numpy as np
from scipy import optimize, special, stats

from reference import screening


def groups_of(n, size):
    """Slices of consecutive values, the last one with the remainder."""
    count = max(1, n // size)
    return [slice(j * size, (j + 1) * size if j + 1 < count else n) for j in range(count)]


def mean(y):
    return y.mean(), y.std(ddof=1) / np.sqrt(len(y))


def k_sigma(y, k):
    outlier, _ = screening.k_sigma(y, k, None)
    value, sigma = mean(y[~outlier])
    return value, sigma, outlier


def paper(y, k, size, k2):
    """Stages 1 to 3.2, (M5) to (M7), D recomputed; k2 a number or the level of Cochran's test."""
    outlier, y = screening.leave_one_out(y, k)
    groups = groups_of(len(y), size)
    m = np.array([y[g].mean() for g in groups])
    d = np.array([y[g].var(ddof=1) for g in groups])
    bad = np.zeros(len(m), dtype=bool)
    if len(m) >= 3:
        bad, m = screening.leave_one_out(m, k)
    if isinstance(k2, dict):
        extreme = variances_above_f(d, [g.stop - g.start - 1 for g in groups], k2["level"])
    else:
        extreme = d > k2 / (1 / d).sum()
    donor = np.argmin(d)
    m[extreme], d[extreme] = m[donor], d[donor]
    total = 1 / (1 / d).sum()
    for j in np.flatnonzero(bad | extreme):
        outlier[groups[j]] = True
    return (total / d * m).sum(), np.sqrt(total), outlier, (m, d, total / d)


def variances_above_f(d, nu, level):
    """Each variance against the pooled others, Bonferroni."""
    d, nu = np.asarray(d), np.asarray(nu, dtype=float)
    if len(d) < 2:
        return np.zeros(len(d), dtype=bool)
    pooled = [np.delete(nu * d, j).sum() / np.delete(nu, j).sum() for j in range(len(d))]
    p = [stats.f.sf(d[j] / pooled[j], nu[j], np.delete(nu, j).sum()) for j in range(len(d))]
    return np.array(p) * len(d) < level


def corrected(y, k, size, level):
    """Exclusion, Grubbs on the means, F on the variances, sigma^2 = s^2 sum p^2/r."""
    outlier, y = screening.leave_one_out(y, k, replace=False)
    groups = groups_of(len(y), size)
    kept = [y[g][~np.isnan(y[g])] for g in groups]
    r = np.array([len(v) for v in kept])
    used = np.flatnonzero(r > 1)
    if len(used) >= 3:
        means = np.array([kept[j].mean() for j in used])
        _, p = screening.thompson_tau(means)
        used = used[p * len(means) >= level]
    d = np.array([kept[j].var(ddof=1) for j in used])
    used_after = used[~variances_above_f(d, r[used] - 1, level)]
    m = np.array([kept[j].mean() for j in used_after])
    d = np.array([kept[j].var(ddof=1) for j in used_after])
    r_used = r[used_after]
    p = r_used / d / (r_used / d).sum()
    pooled = ((r_used - 1) * d).sum() / (r_used - 1).sum()
    for j in set(range(len(groups))) - set(used_after):
        outlier[groups[j]] = True
    return (p * m).sum(), np.sqrt(pooled * (p**2 / r_used).sum()), outlier


def robust(y, size, **options):
    outlier, _, _ = screening.bursts(y, **options)
    blocks = [y[g][~outlier[g]] for g in groups_of(len(y), size)]
    blocks = [v for v in blocks if len(v)]
    r = np.array([len(v) for v in blocks])
    m = np.array([v.mean() for v in blocks])
    d = np.array([v.var(ddof=1) if len(v) > 1 else np.nan for v in blocks])
    w = r / moderated(d, r - 1)
    value = (w * m).sum() / w.sum()
    q = (w * (m - value) ** 2).sum()
    ratio = q / (len(blocks) - 1) if len(blocks) > 1 else 0.0
    rho = options.get("correlation", 0.0)
    sigma = max(1.0, np.sqrt(ratio)) / np.sqrt(w.sum()) * np.sqrt((1 + rho) / (1 - rho))
    return value, sigma, outlier


def moderated(d, nu):
    """Variances shrunk towards their common value."""
    known = nu > 0
    pooled = (nu[known] * d[known]).sum() / nu[known].sum()
    if np.count_nonzero(known) < 2:
        return np.full(len(d), pooled)
    half = nu[known] / 2
    e = np.log(d[known]) - special.digamma(half) + np.log(half)
    v = e.var(ddof=1) - special.polygamma(1, half).mean()
    if v <= 0:
        return np.full(len(d), pooled)
    ln_half = optimize.brentq(
        lambda s: np.log(special.polygamma(1, np.exp(s))) - np.log(v), -40, 40, xtol=1e-15
    )
    half0 = np.exp(ln_half)
    s02 = np.exp(e.mean() + special.digamma(half0) - np.log(half0))
    nu0 = 2 * half0
    return np.where(known, (nu0 * s02 + nu * np.where(known, d, 0)) / (nu0 + nu), s02)
