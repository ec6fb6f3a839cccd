"""The bearing estimators in plain NumPy: one record of unwrapped angles."""

import numpy as np
from scipy import optimize, special, stats

from reference import screening


def blocks_of(n, size):
    """Slices of consecutive values, the last one with the remainder."""
    count = max(1, n // size)
    return [slice(j * size, (j + 1) * size if j + 1 < count else n) for j in range(count)]


def mean(y):
    return y.mean(), y.std(ddof=1) / np.sqrt(len(y))


def k_sigma(y, k):
    outlier, _ = screening.k_sigma(y, k, None)
    value, sigma = mean(y[~outlier])
    return value, sigma, outlier


def extreme_variances(d, nu, k2):
    """3.2 (M5): k2 a number, None for no test, or a dict for the exact test."""
    if k2 is None:
        return np.zeros(len(d), dtype=bool)
    if isinstance(k2, dict):
        return variances_above_f(d, nu, k2["significance"])
    return d > k2 / (1 / d).sum()


def student_factor(size, significance):
    """The k2 'from Student's distribution' of the paper."""
    return stats.t.isf(significance / 2, size - 1)


def paper(y, k, size, k2):
    """Stages 1 to 3.2, (M5) to (M7), D recomputed."""
    outlier, y = screening.leave_one_out(y, k)
    blocks = blocks_of(len(y), size)
    m = np.array([y[g].mean() for g in blocks])
    d = np.array([y[g].var(ddof=1) for g in blocks])
    bad = np.zeros(len(m), dtype=bool)
    if len(m) >= 3:
        bad, m = screening.leave_one_out(m, k)
    extreme = extreme_variances(d, [g.stop - g.start - 1 for g in blocks], k2)
    donor = np.argmin(d)
    m[extreme], d[extreme] = m[donor], d[donor]
    total = 1 / (1 / d).sum()
    for j in np.flatnonzero(bad | extreme):
        outlier[blocks[j]] = True
    return (total / d * m).sum(), np.sqrt(total), outlier, (m, d, total / d)


def variances_above_f(d, nu, significance):
    """Each variance against the pooled others, Bonferroni."""
    d, nu = np.asarray(d), np.asarray(nu, dtype=float)
    if len(d) < 2:
        return np.zeros(len(d), dtype=bool)
    pooled = [np.delete(nu * d, j).sum() / np.delete(nu, j).sum() for j in range(len(d))]
    p = [stats.f.sf(d[j] / pooled[j], nu[j], np.delete(nu, j).sum()) for j in range(len(d))]
    return np.array(p) * len(d) < significance


def corrected(y, k, size, significance, k2="significance"):
    """Exclusion, Grubbs on the means, F (or k2) on the variances, sigma^2 = s^2 sum p^2/r."""
    k2 = {"significance": significance} if k2 == "significance" else k2
    outlier, y = screening.leave_one_out(y, k, replace=False)
    blocks = blocks_of(len(y), size)
    kept = [y[g][~np.isnan(y[g])] for g in blocks]
    r = np.array([len(v) for v in kept])
    used = np.flatnonzero(r > 1)
    if len(used) >= 3:
        means = np.array([kept[j].mean() for j in used])
        _, p = screening.thompson_tau(means)
        used = used[p * len(means) >= significance]
    d = np.array([kept[j].var(ddof=1) for j in used])
    used_after = used[~extreme_variances(d, r[used] - 1, k2)]
    m = np.array([kept[j].mean() for j in used_after])
    d = np.array([kept[j].var(ddof=1) for j in used_after])
    r_used = r[used_after]
    p = r_used / d / (r_used / d).sum()
    pooled = ((r_used - 1) * d).sum() / (r_used - 1).sum()
    for j in set(range(len(blocks))) - set(used_after):
        outlier[blocks[j]] = True
    weight = np.zeros(len(blocks))
    weight[used_after] = p
    return (p * m).sum(), np.sqrt(pooled * (p**2 / r_used).sum()), outlier, weight


def robust(y, size, **options):
    outlier, _, _ = screening.bursts(y, **options)
    kept = y[~outlier]
    step = options.get("rounding", 0.0)
    if np.median(np.abs(y - np.median(y))) == 0:
        step = screening.step_of_ties(y, np.median(y), step)
    if np.ptp(kept) == 0:
        count = np.array([np.count_nonzero(~outlier[g]) for g in blocks_of(len(y), size)])
        step = max(step, screening.step_of_ties(y, kept[0], 0.0))
        return kept[0], step / np.sqrt(12), outlier, count / count.sum()
    every = [y[g][~outlier[g]] for g in blocks_of(len(y), size)]
    blocks = [v for v in every if len(v)]
    r = np.array([len(v) for v in blocks])
    m = np.array([v.mean() for v in blocks])
    d = np.array([v.var(ddof=1) if len(v) > 1 else np.nan for v in blocks])
    floor = step**2 / 12
    overall = max(kept.var(ddof=1), floor)
    coarse = step**2 > kept.var(ddof=1)
    w = r / (overall if coarse else np.maximum(moderated(d, r - 1, overall), floor))
    value = (w * m).sum() / w.sum()
    q = (w * (m - value) ** 2).sum()
    ratio = q / (len(blocks) - 1) if len(blocks) > 1 else 0.0
    rho = options.get("correlation", 0.0)
    sigma = max(1.0, np.sqrt(ratio)) / np.sqrt(w.sum()) * np.sqrt((1 + rho) / (1 - rho))
    weight = np.zeros(len(every))
    weight[[len(v) > 0 for v in every]] = w / w.sum()
    return value, sigma, outlier, weight


def moderated(d, nu, overall):
    """Variances shrunk towards their common value; `overall` if each block is constant."""
    measured = nu > 0
    pooled = (nu[measured] * d[measured]).sum() / nu[measured].sum()
    known = measured & (d > 0)  # equal readings have no logarithm
    if not known.any():
        return np.full(len(d), overall)
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
    d = np.where(measured, d, 0.0)
    return np.where(measured, (nu0 * s02 + nu * d) / (nu0 + nu), s02)


def on_the_circle(estimate, theta, period):
    """An estimator of plain numbers applied to angles: value in [0, period), polarity."""
    u = screening.unwrap_about_median(theta, period)
    value, sigma, outlier = estimate(u)[:3]
    polarity = (np.sign(u - value) * outlier).mean()
    return value % period, sigma, outlier, polarity
