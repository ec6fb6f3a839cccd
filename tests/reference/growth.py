"""By how much a covariance grows for residuals that are too large: with NumPy and SciPy."""

import numpy as np
from scipy import optimize, stats

# √(φ − 1) besides zero, its half-Cauchy prior, and P(φ = 1)
ROOTS = np.geomspace(0.1, 100.0, 40)
SCALE, RIGHT = 2.0, 0.8


def growth(statistic, freedom, dimension):
    """Return the factor of the ellipse of 95 % of the mixture over φ, relative to that at 10 %."""
    agreeing = freedom * (1 - 2 / (9 * freedom) + QUANTILE * np.sqrt(2 / (9 * freedom))) ** 3
    if statistic <= agreeing:
        return 1.0
    of = quantile(statistic, freedom, dimension) / quantile(agreeing, freedom, dimension)
    return max(of, 1.0)


def quantile(statistic, freedom, dimension):
    density = ROOTS / (1 + (ROOTS / SCALE) ** 2)
    prior = np.concatenate([[RIGHT], (1 - RIGHT) * density / density.sum()])
    factor = np.concatenate([[1.0], 1 + ROOTS**2])
    log_weight = np.log(prior) - 0.5 * (freedom * np.log(factor) + statistic / factor)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    limit = stats.chi2.isf(0.05, dimension)

    def outside(m):
        return weight @ stats.chi2.sf(limit * np.exp(m) / factor, dimension) - 0.05

    return np.exp(optimize.brentq(outside, -1e-9, np.log(1 + ROOTS[-1] ** 2), xtol=1e-13))


QUANTILE = stats.norm.isf(0.1)
