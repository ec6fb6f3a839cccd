"""The density of positions of a few bearings, as the formulas stand (Gerber et al. 2018)."""

import numpy as np
from scipy import special

STATED = np.radians(5.0)
# λ = 1/f², f the factor between true and stated sigma: concentrations 1 to 40,000 for 5 degrees
LAMBDA = np.exp(np.linspace(0.0, np.log(40_000.0), 121)) * STATED**2
LN_FACTOR = -0.5 * np.log(LAMBDA)
SPREAD = 0.7
SMALLEST, SPACING = 1e-6, 0.05
TINY = np.finfo(float).tiny
ACROSS, LEVELS, SHARE, CHANGE, RADIUS = 16, 11, 0.003, 0.05, 0.71
# shares of instants whose sigma is not that of the others
OUTLYING = np.array([0.01, 0.05, 0.1, 0.2, 0.4])[:, np.newaxis]
SIGNS = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1.0]])


def normalised(ln):
    """Return logarithms of weights that sum to one."""
    return ln - special.logsumexp(ln)


PRIOR = normalised(-0.5 * (LN_FACTOR / SPREAD) ** 2)
LIKELY = np.where(np.abs(LN_FACTOR) <= 3 * SPREAD, 0.0, -np.inf)


def constants(sigma):
    """Return `Σ ln c(λ/σ²)` of each λ."""
    kappa = LAMBDA / np.asarray(sigma)[:, np.newaxis] ** 2
    return -np.sum(np.log(2 * np.pi * special.i0e(kappa)), axis=0)


def evidence(s, sigma, ln_weights=PRIOR):
    """Return `ln g(S)` without a table, S in the unit of 1/σ²."""
    terms = ln_weights + constants(sigma) - LAMBDA * np.asarray(s)[..., np.newaxis]
    return special.logsumexp(terms, axis=-1)


class Posterior:
    """The bearings of an instant; nodes of a quadrature of their density."""

    def __init__(self, stations, azimuth, sigma, max_range, ln_weights=PRIOR):
        """Grow the tree, and find mean, covariance and the factor of sigma."""
        azimuth = np.asarray(azimuth)
        there = ~np.isnan(azimuth)
        # those of the nearest station are the same with or without a bearing in these tests
        self.stations = np.asarray(stations, dtype=float)[there]
        self.azimuth, self.max_range = azimuth[there], max_range
        self.sigma = np.broadcast_to(sigma, azimuth.shape)[there]
        largest = 2 * len(azimuth) / np.min(np.broadcast_to(sigma, azimuth.shape)) ** 2
        count = int(np.ceil(np.log(largest / SMALLEST) / SPACING)) + 2
        self.ln_s = np.log(SMALLEST) + SPACING * np.arange(count)
        self.table = evidence(np.exp(self.ln_s), self.sigma, ln_weights)
        self.nodes, self.areas = self.quadrature()
        self.misfits = self.misfit(self.nodes)
        self.ln = self.ln_density(self.misfits)
        mass = self.areas * np.exp(self.ln - self.ln.max())
        self.shares = mass / mass.sum()
        self.ln_total = self.ln.max() + np.log(mass.sum())
        self.mean = self.shares @ self.nodes
        centred = self.nodes - self.mean
        self.covariance = (centred.T * self.shares) @ centred
        law = ln_weights + (self.ln_likelihood() if len(self.azimuth) > 2 else 0.0)
        self.factor = float(np.exp(normalised(law)) @ np.exp(LN_FACTOR))

    def ln_density(self, s):
        """Return `ln g(S)`, linear in ln S."""
        return np.interp(np.log(np.maximum(s, SMALLEST)), self.ln_s, self.table)

    def cosines(self, p):
        """Return cosines between bearings and directions, and ranges."""
        d = p[:, np.newaxis] - self.stations
        r = np.hypot(d[..., 0], d[..., 1])
        along = d[..., 0] * np.sin(self.azimuth) + d[..., 1] * np.cos(self.azimuth)
        return np.clip(along / r, -1, 1), r

    def misfit(self, p):
        """Return S."""
        return np.sum((1 - self.cosines(p)[0]) / self.sigma**2, axis=-1)

    def least_misfit(self, p, radius):
        """Return the least S within a radius: each bearing is turned by asin(radius / range)."""
        cosine, r = self.cosines(p)
        share = radius[:, np.newaxis] / r
        turn = np.where(share < 1, np.arcsin(np.minimum(share, 1)), np.pi)
        angle = np.maximum(np.arccos(cosine) - turn, 0.0)
        return np.sum((1 - np.cos(angle)) / self.sigma**2, axis=-1)

    def within(self, p, slack):
        """Return which points are within range of any station."""
        return self.cosines(p)[1].min(axis=-1) <= self.max_range + slack

    def quadrature(self):
        """Return two Gauss points a side of every leaf, with their areas."""
        low, high = self.stations.min(axis=0), self.stations.max(axis=0)
        side = (high - low).max() + 2 * self.max_range
        steps = (np.arange(ACROSS) + 0.5) * side / ACROSS - side / 2
        centres = (low + high) / 2 + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        sides = np.full(len(centres), side / ACROSS)
        keep = self.within(centres, RADIUS * sides)
        centres, sides = centres[keep], sides[keep]
        for _ in range(LEVELS):
            ln = self.ln_density(self.misfit(centres))
            bound = self.ln_density(self.least_misfit(centres, RADIUS * sides))
            mass, most = (np.exp(v - ln.max()) * sides**2 for v in (ln, bound))
            split = (most > SHARE * mass.sum()) & (bound - ln > CHANGE)
            if not split.any():
                break
            half = sides[split] / 2
            parts = [centres[split] + sign * half[:, np.newaxis] / 2 for sign in SIGNS]
            children, halves = np.concatenate(parts), np.tile(half, 4)
            keep = self.within(children, RADIUS * halves)
            centres = np.concatenate([centres[~split], children[keep]])
            sides = np.concatenate([sides[~split], halves[keep]])
        gauss = [centres + sign * sides[:, np.newaxis] / np.sqrt(12) for sign in SIGNS]
        nodes, areas = np.concatenate(gauss), np.tile(sides**2 / 4, 4)
        keep = self.within(nodes, 0.0)
        return nodes[keep], areas[keep]

    def ln_likelihood(self):
        """Return the likelihood of each λ, from a histogram of area over S."""
        at = (np.log(np.maximum(self.misfits, SMALLEST)) - np.log(SMALLEST)) / SPACING
        node = np.minimum(at.astype(int), len(self.ln_s) - 2)
        histogram = np.zeros(len(self.ln_s))
        np.add.at(histogram, node, self.areas * (1 - (at - node)))
        np.add.at(histogram, node + 1, self.areas * (at - node))
        decay = np.exp(-LAMBDA * np.exp(self.ln_s)[:, np.newaxis])
        return constants(self.sigma) + np.log(np.maximum(histogram @ decay, TINY))

    def ln_level(self, probability):
        """Return ln of the density on the contour that holds so much."""
        order = np.argsort(-self.ln)
        count = np.searchsorted(np.cumsum(self.shares[order]), probability)
        return self.ln[order][count] - self.ln_total

    def radius(self, probability):
        """Return the radius about the mean that holds so much."""
        distance = np.hypot(*(self.nodes - self.mean).T)
        order = np.argsort(distance)
        return distance[order][np.searchsorted(np.cumsum(self.shares[order]), probability)]


def pooled(stations, azimuths, sigma, max_range):
    """Return the posteriors of a record, each with what all others say of f."""
    likelihoods = np.zeros((len(stations), len(OUTLYING), len(LAMBDA)))
    for i, (at, azimuth) in enumerate(zip(stations, azimuths, strict=True)):
        if np.sum(~np.isnan(azimuth)) > 2:
            own = Posterior(at, azimuth, sigma, max_range, LIKELY).ln_likelihood()
            mean = special.logsumexp(own) - np.log(len(own))
            likelihoods[i] = np.logaddexp(np.log(1 - OUTLYING) + own, np.log(OUTLYING) + mean)
    total = PRIOR + np.sum(likelihoods, axis=0)
    found = []
    for at, azimuth, own in zip(stations, azimuths, likelihoods, strict=True):
        law = np.exp(normalised(total - own))
        every = OUTLYING * np.sum(law, axis=-1, keepdims=True) / len(LAMBDA)
        others = np.sum((1 - OUTLYING) * law + every, axis=0)
        found.append(Posterior(at, azimuth, sigma, max_range, np.log(others)))
    return found
