"""Screening in plain NumPy: one sample, every value really left out, nothing updated."""

from fractions import Fraction

import numpy as np
from scipy import stats


def others(y, i):
    return np.delete(y, i)


def leave_one_out_statistics(y):
    """(M2), (M3)."""
    mean = np.array([others(y, i).mean() for i in range(len(y))])
    variance = np.array([others(y, i).var(ddof=1) for i in range(len(y))])
    return mean, variance


def is_anomalous(y, i, k):
    """(M4): the i-th value against those that are there."""
    rest = others(y, i)
    rest = rest[~np.isnan(rest)]
    return abs(rest.mean() - y[i]) > k * rest.std(ddof=1)


def mean_of_others(y, i):
    return np.nanmean(others(y, i))


def leave_one_out(y, k, statistics="sequential", direction="forward", replace=True, passes=1):
    """Outliers and cleaned sample."""
    cleaned, outlier = np.array(y, dtype=float), np.zeros(len(y), dtype=bool)
    for _ in range(passes):
        tested = cleaned.copy() if statistics == "frozen" else cleaned
        found = []
        for i in range(len(y))[:: 1 if direction == "forward" else -1]:
            if np.isnan(cleaned[i]) or np.count_nonzero(~np.isnan(tested)) < 3:
                continue
            if is_anomalous(tested, i, k):
                found.append(i)
                value = mean_of_others(tested, i) if replace else np.nan
                cleaned[i] = value
        outlier[found] = True
        if not found:
            break
    return outlier, cleaned


def k_sigma(y, k, replace):
    """(M1), with the mean of the nearest values that are not outliers as replacement."""
    outlier = np.abs(y - y.mean()) > k * y.std(ddof=1)
    cleaned = np.array(y, dtype=float)
    good = np.flatnonzero(~outlier)
    for i in np.flatnonzero(outlier):
        left, right = good[good < i][-1:], good[good > i][:1]
        cleaned[i] = {
            "neighbours": lambda near: np.mean(y[near]),
            "mean": lambda near: y.mean(),
            None: lambda near: np.nan,
        }[replace](np.concatenate([left, right]))
    return outlier, cleaned


def z_test(x, y, sigma):
    """(R1)."""
    n = len(y)
    t = abs(x - y.mean()) / (sigma * np.sqrt((n + 1) / n))
    return t, 2 * stats.norm.sf(t)


def t_test(x, y):
    """(R2), (R3)."""
    n = len(y)
    t = abs(x - y.mean()) / y.std(ddof=1)
    return t, 2 * stats.t.sf(t / np.sqrt((n + 1) / n), n - 1)


def thompson_tau(y):
    n = len(y)
    tau = np.abs(y - y.mean()) / y.std(ddof=1)
    t = tau * np.sqrt(n * (n - 2) / ((n - 1) ** 2 - n * tau**2))
    return tau, 2 * stats.t.sf(t, n - 2)


def grubbs(y):
    tau, p = thompson_tau(y)
    i = int(np.argmax(tau))
    return i, tau[i], min(1.0, len(y) * p[i])


def cochran(variances, nu):
    count = len(variances)
    i = int(np.argmax(variances))
    f = variances[i] / others(variances, i).mean()
    p = min(1.0, count * stats.f.sf(f, nu, (count - 1) * nu))
    return i, variances[i] / variances.sum(), p


def critical_value(n, significance, test, nu=None):
    if test == "z-test":
        return stats.norm.isf(significance / 2)
    if test == "t-test":
        return stats.t.isf(significance / 2, n - 1) * np.sqrt((n + 1) / n)
    if test == "leave-one-out":
        return stats.t.isf(significance / 2, n - 2) * np.sqrt(n / (n - 1))
    if test == "cochran":
        f = stats.f.isf(significance / n, nu, (n - 1) * nu)
        return f / (f + n - 1)
    t = stats.t.isf(significance / 2 / (n if test == "grubbs" else 1), n - 2)
    return t * (n - 1) / np.sqrt(n * (n - 2 + t**2))


def bursts(y, bp=2.5, bc=3.0, lmin=2, lmax=20, correlation=0.0, rounding=0.0):
    """Points and bursts: outliers, centre, scale."""
    n = len(y)
    c = np.median(y)
    deviation = np.abs(y - c)
    s = np.hypot(1.4826 * n / (n - 0.8) * np.median(deviation), rounding / np.sqrt(12))
    step = rounding
    if np.median(deviation) == 0:
        c, s, step = _start_of_ties(y, c, rounding)
    outlier = np.zeros(n, dtype=bool)
    for _ in range(3):
        if s == 0:
            break
        outlier = _points_and_segments((y - c) / s, bp, bc, lmin, lmax, correlation)
        if np.count_nonzero(~outlier) < max(5, n / 4):
            outlier[:] = False
        kept = y[~outlier]
        previous, c = c, kept.mean()
        s = np.hypot(kept.std(ddof=1), step / np.sqrt(12))
        if c == previous:
            break
    return outlier, c, s


def _start_of_ties(y, c, rounding):
    """More than half of the values are equal: those one step off are as good."""
    deviation = np.abs(y - c)
    step = step_of_ties(y, c, rounding)
    rounding = step / np.sqrt(12)
    floor = 0.0 if rounding else deviation.mean()
    near = y[deviation <= 1.5 * step]
    if np.count_nonzero(near != c) < 2:
        return c, max(rounding, floor), step
    return near.mean(), max(np.hypot(near.std(ddof=1), rounding), floor), step


def step_of_ties(y, c, rounding):
    """The rounding, or the distance of the nearest reading that differs, or zero."""
    off = np.abs(y - c)[y != c]
    return rounding or off.min(initial=np.inf) if off.size else rounding


def _points_and_segments(x, bp, bc, lmin, lmax, correlation):
    n = len(x)
    ln_n = np.log(max(n, 30))
    inflation = {
        length: 1 + 2 * sum((1 - j / length) * correlation**j for j in range(1, length))
        for length in range(1, lmax + 1)
    }
    # exact, because the savings of later values vanish beside that of an enormous one
    total, choice = [Fraction(0)] * (n + 1), np.zeros(n + 1, dtype=int)
    for t in range(1, n + 1):
        total[t], choice[t] = total[t - 1], 0
        point = total[t - 1] + Fraction(x[t - 1] ** 2 - bp * ln_n)
        if point > total[t]:
            total[t], choice[t] = point, 1
        for length in range(min(lmax, t), lmin - 1, -1):
            saving = x[t - length : t].sum() ** 2 / length / inflation[length]
            segment = total[t - length] + Fraction(saving - bc * ln_n)
            if segment > total[t]:
                total[t], choice[t] = segment, length
    outlier, t = np.zeros(n, dtype=bool), n
    while t > 0:
        outlier[t - choice[t] : t] = True
        t -= max(choice[t], 1)
    return outlier


def unwrap_about_median(theta, period=360.0):
    """About the circular mean, then about the median of the result; on the first value's turn."""
    phase = 2 * np.pi * theta / period
    r = np.angle(np.exp(1j * phase).sum()) / (2 * np.pi) * period
    r = theta[0] + _wrap(r - theta[0], period)
    u = r + _wrap(theta - r, period)
    r = np.median(u)
    return r + _wrap(theta - r, period)


def _wrap(angle, period):
    return angle - period * np.round(angle / period)


def moving_polynomial(y, window=13, degree=2, k=4.0, time=None, period=None):
    """Outliers, cleaned series and s: each value against the polynomial of the others."""
    n = len(y)
    t = np.arange(n, dtype=float) if time is None else np.asarray(time, dtype=float)
    kept, outlier = ~np.isnan(y), np.zeros(n, dtype=bool)
    for number in range(4):
        expected, z = np.full(n, np.nan), np.full(n, np.nan)
        for i in range(n):
            width = min(window, n)
            start = min(max(i - window // 2, 0), n - width)
            j = np.array([j for j in range(start, start + width) if j != i and kept[j]], dtype=int)
            if len(j) < degree + 3 or len(set(t[j])) <= degree:
                continue
            x = t[j] - t[i]
            value = y[j] if period is None else unwrap_about_median(y[j], period)
            columns = np.vander(x / np.abs(x).max(), degree + 1, increasing=True)
            weight = np.linalg.pinv(columns)[0]
            expected[i] = value[0] + weight @ (value - value[0])
            e = y[i] - expected[i]
            if period is not None:
                e -= period * np.round(e / period)
            z[i] = abs(e) / np.sqrt(1 + weight @ weight)
        judged = kept & ~np.isnan(z)
        if not judged.any():
            return outlier, np.array(y), np.nan
        s = 1.4826 * np.median(z[judged])
        large = np.where(judged & (z > k * s), z, 0.0)
        found = [
            i
            for i in np.flatnonzero(large)
            if large[i] > large[max(i - 2, 0) : i].max(initial=0.0)
            and large[i] >= large[i + 1 : i + 3].max(initial=0.0)
        ]
        back = np.flatnonzero(outlier & (z <= k * s))
        outlier[back], kept[back] = False, True
        if number == 3 or not (found or len(back)):
            break
        outlier[found], kept[found] = True, False
    cleaned = np.where(outlier, expected, y)
    if period is not None:
        cleaned = np.where(outlier, cleaned - period * np.round((cleaned - y) / period), y)
    return outlier, cleaned, s
