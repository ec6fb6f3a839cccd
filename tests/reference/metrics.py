"""How long errors last, and the intervals of an audit, in plain NumPy and SciPy."""

import itertools

import numpy as np
from scipy import optimize, special, stats

SHARES = np.array([0.05, 0.12, 0.22, 0.35, 0.5, 0.7, 0.9, 1.0])
POWERS = (1, 2, 3, 4, 6, 8, 12, 16)
RATIO = 1.4


def series_of(gaps):
    """Rows of each series."""
    starts = [row for row, gap in enumerate(gaps) if row == 0 or gap <= 0]
    return [range(a, b) for a, b in itertools.pairwise([*starts, len(gaps)])]


def thinning(errors, gaps):
    """Every how many rows the correlation is moderate."""
    longest = max(map(len, series_of(gaps)))
    step = 1
    while step < longest // 10:
        pairs = [(i, i + step) for rows in series_of(gaps) for i in rows if i + step in rows]
        product = sum(errors[i] @ errors[j] for i, j in pairs)
        square = sum(0.5 * (errors[i] @ errors[i] + errors[j] @ errors[j]) for i, j in pairs)
        if product < 0.6 * square:
            break
        step += 1 + step // 4
    return step


def lasting(errors, gaps):
    """Posterior of the models, and sums of powers of the correlation, by dense covariances."""
    n, m = errors.shape
    step = thinning(errors, gaps)
    time = np.cumsum(np.maximum(gaps, 0.0))
    pieces = series_of(gaps)
    same = np.zeros((n, n), dtype=bool)
    for rows in pieces:
        same[rows.start : rows.stop, rows.start : rows.stop] = True
    apart = np.where(same, np.abs(time[:, None] - time), np.inf)
    phases = [list(rows)[phase::step] for rows in pieces for phase in range(step)]
    independent = 0.5 if step == 1 else 0.0
    with np.errstate(divide="ignore"):
        ln_weights = [np.log(independent) - n / 2 * np.log(np.sum(errors**2, axis=0)).sum()]
    sums = [np.ones(len(POWERS))]
    length = 0.3 * step
    edges = np.concatenate([[0.0], 0.5 * (SHARES[1:] + SHARES[:-1]), [1.0]])
    while length < 2 * n:
        mass = np.exp(-step / (length * RATIO**0.5)) - np.exp(-step * RATIO**0.5 / length)
        for k, share in enumerate(SHARES):
            rho = share * np.exp(-apart / length)
            np.fill_diagonal(rho, 1.0)
            ln_determinant, rss = 0.0, np.zeros(m)
            for phase in filter(None, phases):
                root = np.linalg.cholesky(rho[np.ix_(phase, phase)])
                ln_determinant += 2 * np.log(np.diag(root)).sum()
                rss += np.sum(np.linalg.solve(root, errors[phase]) ** 2, axis=0)
            prior = (1 - independent) * mass * (edges[k + 1] - edges[k])
            likelihood = -0.5 * m * ln_determinant - n / 2 * np.log(rss).sum()
            ln_weights.append(np.log(prior) + likelihood / step)
            off = rho - np.eye(n)
            sums.append(np.array([1 + np.sum(off**power) / n for power in POWERS]))
        length *= RATIO
    weights = np.exp(np.array(ln_weights) - max(ln_weights))
    return weights / weights.sum(), np.array(sums)


def mean_interval(mean, ratio, number, probability, level):
    """A variance's interval, mixed over the numbers."""
    nu = 2 * np.asarray(number) / ratio

    def excess(x, p):
        return np.sum(probability * stats.chi2.sf(nu * np.exp(-x), nu)) - p

    outside = (1 - level) / 2
    return [
        mean * np.exp(optimize.brentq(excess, -25, 25, args=(p,), xtol=1e-13))
        for p in (outside, 1 - outside)
    ]


def indicator_correlation(axes, probability, rho):
    """The correlation of what is inside, by the whole expansion."""
    total, alpha = 0.0, axes / 2
    t = stats.chi2.ppf(probability, axes) / 2
    for k in range(1, 400):
        coefficient = np.exp(alpha * np.log(t) - t - special.gammaln(alpha)) / k
        coefficient *= special.eval_genlaguerre(k - 1, alpha, t)
        norm = np.exp(special.gammaln(k + alpha) - special.gammaln(alpha) - special.gammaln(k + 1))
        total += rho ** (2 * k) * coefficient**2 / norm
    return total / (probability * (1 - probability))
