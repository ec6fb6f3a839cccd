"""The bearing estimators in plain NumPy: one record of unwrapped angles."""

import numpy as np
from scipy import optimize, stats

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


def effects(x, s, scale):
    """Random effects: mean, sigma and tau by quadrature over tau."""
    x, s = np.asarray(x, dtype=float), np.asarray(s, dtype=float)
    top = max(300.0, 10 * np.ptp(x) / scale)
    tau = np.r_[0.0, scale * np.geomspace(0.01, top, 160)]
    v = s[:, None] ** 2 + tau**2
    total = (1 / v).sum(axis=0)
    mu = (x[:, None] / v).sum(axis=0) / total
    log = -0.5 * (np.log(v).sum(axis=0) + np.log(total) + ((x[:, None] - mu) ** 2 / v).sum(axis=0))
    log += np.log(np.gradient(tau)) - np.log1p((tau / scale) ** 2)
    w = np.exp(log - log.max())
    w /= w.sum()
    mean, sd = w @ mu, np.sqrt(1 / total)

    def outside(h):
        return w @ (stats.norm.sf((h - mu + mean) / sd) + stats.norm.sf((h + mu - mean) / sd))

    h = optimize.brentq(lambda h: outside(h) - 0.0455, 0, 100 * top * scale, xtol=1e-13 * scale)
    return mean, h / 2, w @ tau


def correlated(y, place, phi=None):
    """Gain in log evidence over white noise, variance over that with white noise, and phi."""
    if len(y) < 3 or np.ptp(y) == 0:
        return 0.0, 1.0, 0.0
    gap, y = np.diff(place), y - y[0]
    phis = np.tanh(np.linspace(-0.55, 2.65, 48))
    prior = (1 - phis**2) / (1 - phis**2).sum() / 2
    prior[np.abs(phis).argmin()] += 0.5
    if phi is not None:
        phis, prior = np.array([phi]), np.ones(1)

    def given(phi):
        f = phi[:, None] ** gap
        v = 1 - f**2
        a, e = 1 + ((1 - f) ** 2 / v).sum(axis=1), y[1:] - f * y[:-1]
        m = (y[0] + ((1 - f) * e / v).sum(axis=1)) / a
        rss = (y[0] - m) ** 2 + ((e - (1 - f) * m[:, None]) ** 2 / v).sum(axis=1)
        evidence = -0.5 * (np.log(v).sum(axis=1) + np.log(a) + (len(y) - 1) * np.log(rss))
        return m, rss / ((len(y) - 1) * a), evidence

    m, v, evidence = given(phis)
    _, white, base = (one[0] for one in given(np.zeros(1)))
    log = np.log(prior) + evidence - base
    w = np.exp(log - log.max())
    gain, w = log.max() + np.log(w.sum()), w / w.sum()
    return gain, w @ (v + (m - w @ m) ** 2) / white, w @ phis


class Modes:
    """A mixture of good and bad measurements, whose modes may persist."""

    def __init__(self, shape, d, t, share, kappa=0.0):
        self.shape, self.mu, self.s, self.kappa = shape, 0.0, 1.0, kappa
        self.d, self.t, self.share = (np.array(v, dtype=float) for v in (d, t, share))

    def copy(self, kappa):
        other = Modes(self.shape, self.d, self.t, self.share, kappa)
        other.mu, other.s = self.mu, self.s
        return other

    def mirrored(self):
        """Good and bad ones have changed places."""
        other = Modes(self.shape, -self.d, [self.s], [1 - self.share.sum()], self.kappa)
        other.mu, other.s = self.mu + self.d[0], self.t[0]
        other.share *= min(1.0, 0.5 / other.share.sum())
        return other

    def are_apart(self):
        """Whether each bad mode is a peak beside the good one, or far wider."""
        z = self.d[:, None] * np.arange(13) / 12

        def density(share, off, width):
            return share * np.exp(-0.5 * (off / width) ** 2) / width

        good = density(1 - self.share.sum(), z, self.s)
        share, d, t = (v[:, None] for v in (self.share, self.d, self.t))
        found = good + density(share, z - d, t)
        lowest = np.minimum.accumulate(found, axis=1)
        return np.any(found > 1.2 * lowest, axis=1) | (self.t > 5 * self.s)

    def point(self):
        first = [self.mu, np.log(self.s), self.kappa]
        return np.concatenate([first, self.d, np.log(self.t), self.share])

    def ahead(self, x):
        """Go to a point, within twice or half of what the parameters are."""

        def near(value, known):
            return np.clip(value, 0.5 * known, 2 * known)

        self.mu = np.clip(x[0], self.mu - self.s, self.mu + self.s)
        self.s = near(np.exp(x[1]), self.s)
        self.kappa = np.clip(x[2], 0.5 * self.kappa, 0.5 + 0.5 * self.kappa)
        d, t, share = np.split(x[3:], 3)
        self.d = np.copysign(near(np.abs(d), np.abs(self.d)), self.d)
        self.t, self.share = near(np.exp(t), self.t), near(share, self.share)
        self.share *= min(1.0, 0.5 / self.share.sum())

    def posterior(self, y):
        """Probabilities of all modes, log-likelihood, counts drawn by the shares, persisted."""
        centre = self.mu + np.r_[0.0, self.d]
        width = np.r_[self.s, self.t]
        log = -0.5 * ((y[:, None] - centre) / width) ** 2 - np.log(np.sqrt(2 * np.pi) * width)
        share = np.r_[1 - self.share.sum(), self.share]
        top = log.max(axis=1, keepdims=True)
        density = np.exp(log - top)
        if not self.kappa:
            joint = share * density
            g = joint / joint.sum(axis=1, keepdims=True)
            return g, (np.log(joint.sum(axis=1)) + top[:, 0]).sum(), g.sum(axis=0), 0.0
        # numbers of Python: arrays of two would take five times as long
        kappa, anew = self.kappa, ((1 - self.kappa) * share).tolist()
        rows, predicted, forward, scale = density.tolist(), share.tolist(), [], []
        for row in rows:
            joint = [p * d for p, d in zip(predicted, row, strict=True)]
            scale.append(sum(joint))
            forward.append([j / scale[-1] for j in joint])
            predicted = [kappa * f + a for f, a in zip(forward[-1], anew, strict=True)]
        backward = [[1.0] * len(share)]
        for row, total in zip(rows[:0:-1], scale[:0:-1], strict=True):
            ahead = [d * b / total for d, b in zip(row, backward[-1], strict=True)]
            fresh = sum(a * v for a, v in zip(anew, ahead, strict=True))
            backward.append([kappa * v + fresh for v in ahead])
        forward, backward, scale = (np.array(one) for one in (forward, backward[::-1], scale))
        g, ahead = forward * backward, (density * backward / scale[:, None])[1:]
        drawn = g[0] + anew * ahead.sum(axis=0)
        persisted = kappa * (forward[:-1] * ahead).sum()
        return g, (np.log(scale) + top[:, 0]).sum(), drawn, persisted

    def step(self, y, floor, least):
        """One step of EM; returns the largest change in standard errors."""
        before = (self.mu, np.log(self.s), self.share.sum(), self.kappa)
        g, _, drawn, persisted = self.posterior(y)
        n = np.maximum(g.sum(axis=0), 1e-9)
        first = g.T @ y
        if self.shape == "wide":
            w = np.r_[self.s, self.t] ** -2.0
            self.mu = (w @ first) / (w @ n)
        else:
            self.mu = first[0] / n[0]
        self.s = max(np.sqrt(g[:, 0] @ (y - self.mu) ** 2 / n[0]), floor)
        for j in range(len(self.d)):
            wide = 2.5
            if self.shape != "wide":
                side = np.sign(self.d[j])
                far = max((first[j + 1] / n[j + 1] - self.mu) * side, 2 * self.s)
                self.d[j], wide = side * far, 0.5
            square = g[:, j + 1] @ (y - self.mu - self.d[j]) ** 2 / n[j + 1]
            self.t[j] = max(np.sqrt(square), wide * self.s, least)
        self.share = np.maximum(drawn[1:] / drawn.sum(), 0.25 / len(y))
        self.share *= min(1.0, 0.5 / self.share.sum())
        if self.kappa:
            self.kappa = np.clip(persisted / (persisted + drawn.sum() - 1), 1e-4, 0.98)
        after = (self.mu, np.log(self.s), self.share.sum(), self.kappa)
        change = np.abs(np.subtract(after, before)) / (self.s, 1, 1, 1)
        return change.max() * np.sqrt(len(y))

    def run(self, y, floor, least):
        """EM, extrapolated after every second step (Varadhan, Roland 2008, S3)."""
        for _ in range(40):
            points = [self.point()]
            for _ in range(2):
                if self.step(y, floor, least) < 0.01:
                    return self
                points.append(self.point())
            r, after = np.diff(points, axis=0)
            v = after - r
            a = min(np.linalg.norm(r) / np.linalg.norm(v), 16.0)
            if a > 1:
                self.ahead(points[0] + 2 * a * r + a**2 * v)
        return self

    def variance(self, y, g, step):
        """Of the centre, from the outer products of all scores."""
        good, bad = g[:, 0], g[:, 1:]
        z = (y - self.mu) / self.s
        scores = [good * z / self.s, good * (z**2 - 1) / self.s]
        expected, squares = good.sum() / self.s**2, (good * z**2).sum() / self.s**2
        for j, (d, t, share) in enumerate(zip(self.d, self.t, self.share, strict=True)):
            u = (y - self.mu - d) / t
            of_centre = bad[:, j] * u / t
            if self.shape == "wide":
                scores[0] = scores[0] + of_centre
                expected += bad.sum() / t**2
                squares += (bad[:, 0] * u**2).sum() / t**2
            else:
                scores.append(of_centre)
            scores.append(bad[:, j] * (u**2 - 1) / t)
            scores.append(bad[:, j] / share - good / (1 - self.share.sum()))
        scores = np.array(scores)
        products = scores @ scores.T
        scale = np.maximum(np.sqrt(np.diag(products)), 1e-6)
        inverse = np.linalg.inv(products / np.outer(scale, scale) + 1e-6 * np.eye(len(scale)))
        least = 1e-6 * expected
        information = expected * (products[0, 0] + least) / (squares + least)
        largest = max(25 / (1 + 5 * (step / self.s) ** 2), 1.0)
        return np.clip(inverse[0, 0], 1, largest) / information


def started(y, shape, side=1.0):
    """The mixture from which the search begins, for scores."""
    n, far = len(y), 2.2 if shape == "two" else 2.5
    sides = {"one": [side], "wide": [0.0], "two": [1.0, -1.0]}[shape]
    d, t, share = [], [], []
    for sign in sides:
        hit = y[np.abs(y) > far] if shape == "wide" else y[y * sign > far]
        d.append(0.0 if shape == "wide" else hit.mean() if len(hit) else 4.0 * sign)
        wide = max(np.sqrt((hit**2).sum() / max(len(hit), 1)), 4.0)
        t.append({"one": 1.5, "wide": wide, "two": 1.2}[shape])
        low, high = (0.5, 0.4) if shape == "two" else (1.0, 0.45)
        share.append(np.clip(len(hit) / n, low / n, high))
    return Modes(shape, d, t, share)


def slow_noise(y, correlations):
    """Gain in log evidence of noise beside white noise, variance of the mean over that, phi.

    `correlations`: shares of the noise, its correlation of any two values, and of successive ones.
    """
    n, y, ones, found = len(y), y - y[0], np.ones(len(y)), []
    for share, slow, _ in [(0.0, np.eye(n), 0.0), *correlations]:
        r = share * slow + (1 - share) * np.eye(n)
        of_ones, of_y = np.linalg.solve(r, np.column_stack([ones, y])).T
        a = ones @ of_ones
        rss = y @ of_y - (ones @ of_y) ** 2 / a
        log = -0.5 * (np.linalg.slogdet(r)[1] + np.log(a) + (n - 1) * np.log(rss))
        found.append((log, rss / a))
    log, variance = np.transpose(found)
    w = np.exp(log[1:] - log[1:].max())
    gain = log[1:].max() - log[0] + np.log(w.mean())
    w /= w.sum()
    phi = [share * successive for share, _, successive in correlations]
    return gain, w @ variance[1:] / variance[0], w @ phi


def flicker(y, place):
    """1/f noise: AR(1) processes of equal variance, with times of 1, 4, 16 ... steps."""
    lag, length = np.abs(np.subtract.outer(place, place)), place[-1] - place[0] + 1
    time = 4.0 ** np.arange(16)
    decay = np.exp(-1 / time[time <= 4 * length])
    pink = (decay ** lag[..., None]).mean(axis=-1)
    return slow_noise(y, [(share, pink, decay.mean()) for share in (1 / 3, 2 / 3, 1.0)])


def gauss_markov(y, place):
    """A single AR(1) process, with a time of 2, 4, 8 ... steps up to four records."""
    lag, length = np.abs(np.subtract.outer(place, place)), place[-1] - place[0] + 1
    time = 2.0 ** np.arange(1, 64)
    decay = np.exp(-1 / time[time <= 4 * length])
    shares = (0.2, 0.4, 0.6, 0.8)
    return slow_noise(y, [(share, d**lag, d) for d in decay for share in shares])


class Levels:
    """Levels of blocks, between whose middles the level runs in straight lines."""

    def __init__(self, y, size, good=None, fallback=None):
        self.blocks, n = blocks_of(len(y), size), len(y)
        self.middle = np.array([(b.start + b.stop - 1) / 2 for b in self.blocks])
        length = np.array([b.stop - b.start for b in self.blocks])
        if good is None:
            self.level = np.array([np.median(y[b]) for b in self.blocks])
            self.good, self.factor = n / len(length), np.ones(len(length))
        else:
            count = np.array([good[b].sum() for b in self.blocks])
            counts = count >= 1
            self.level = np.array([good[b] @ y[b] for b in self.blocks]) / np.maximum(count, 1)
            self.factor = np.where(counts, length / np.maximum(count, 1), 0)
            self.good = count.sum() / len(count)
            self.level[~counts] = np.nan
        self.filled = self.level if fallback is None else fallback.level.copy()
        self.filled[~np.isnan(self.level)] = self.level[~np.isnan(self.level)]

    def residuals(self, y):
        lines = np.interp(np.arange(len(y)), self.middle, self.filled)
        return (y - lines) / np.sqrt(1 - 5 / 6 / max(self.good, 2.0))

    def read(self, noise):
        """Number and variance of the levels, variance of their mean, what they add."""
        at = np.flatnonzero(~np.isnan(self.level))
        gain, inflation, _ = correlated(self.level[at], at)
        count = len(at)
        variance = self.level[at].var(ddof=1) if count >= 3 else 0.0
        gain -= 0.5 * (count - 1) * np.log(max(self.good * variance / noise, 1))
        t = stats.t.isf(0.0455 / 2, max(count - 1, 1)) / 2
        return count, variance, t**2 * variance / count * inflation, gain


def inflated(phi, n):
    """Variance of the mean of n values of an AR(1) process over that with white noise."""
    phi = max(phi, 0.0)
    return (1 + phi) / (1 - phi) - 2 * phi * (1 - phi**n) / (n * (1 - phi) ** 2)


def block_sizes(y, step, penalty, is_correlated):
    """Lengths of blocks with which a level that moves is more likely than a constant one."""

    def within(r):
        scale = max(1.4826 * np.median(np.abs(r)), step / np.sqrt(12))
        near = np.flatnonzero(np.abs(r) < 3 * scale)
        gain, _, phi = correlated(r[near], near)
        tails = 2 * np.log1p((r / scale) ** 2 / 3).sum()
        return gain - tails - len(r) * np.log(scale), scale, phi

    constant, found = within(y - np.median(y))[0] + penalty, {}
    size = 5
    while len(y) // size >= 6:
        levels = Levels(y, size)
        log, scale, phi = within(levels.residuals(y))
        noise = np.pi / 2 * scale**2 * inflated(phi, levels.good)
        found[size] = log + levels.read(noise)[3]
        size *= 2
    better = [size for size in found if found[size] > constant]
    if not better or not (is_correlated or any(len(y) // size <= 24 for size in better)):
        return []
    best = max(better, key=lambda size: (found[size], size))
    return [best, *({max(found)} - {best})]


def mixtures(y, step, bursts=True):
    """Log-likelihood, number of parameters, mixture, probabilities, width of each; doubtful?"""
    n, floor = len(y), max(0.3, 0.5 * step)
    v = max(y.var(), floor**2)
    log = -0.5 * n * (np.log(2 * np.pi * v) + y.var() / v)
    rows = [(log, 2, None, np.ones((n, 1)), np.sqrt(v), False)]
    for shape, size in (("one", 5), ("wide", 4), ("two", 8)):
        if shape == "one":
            sides = [started(y, "one", side) for side in (1.0, -1.0)]
            for modes in sides:
                for _ in range(6):
                    modes.step(y, floor, 0.5 * step)
            likelihood = [modes.posterior(y)[1] for modes in sides]
            modes = sides[1] if likelihood[1] > likelihood[0] else sides[0]
        else:
            modes = started(y, shape)
        found = [(modes.run(y, floor, 0.5 * step), size)]
        good = found[0][0].posterior(y)[0][:, 0]
        off = good - good.mean()
        persist = off @ off > 0 and off[1:] @ off[:-1] / (off @ off) * np.sqrt(n) >= 1.5
        if bursts and persist:
            found.append((found[0][0].copy(0.5).run(y, floor, 0.5 * step), size + 1))
        for modes, parameters in found:
            g, likelihood, _, _ = modes.posterior(y)
            rows.append((likelihood, parameters, modes, g, modes.s, False))
            if shape != "wide" and modes.kappa == 0 and not modes.are_apart().all():
                good = 1 - g[:, 1:] @ modes.are_apart()
                width = np.sqrt(np.average((y - np.average(y, weights=good)) ** 2, weights=good))
                rows.append((likelihood, parameters, None, good[:, None], width, True))
            if shape == "one" and g[:, 1].sum() > 0.45 * n:
                mirror = modes.mirrored()
                g, likelihood, _, _ = mirror.posterior(y)
                rows.append((likelihood, parameters, mirror, g, mirror.s, True))
    return rows


def weights(logs):
    w = np.exp(np.array(logs) - np.max(logs, axis=0))
    return w / w.sum(axis=0)


class Hypothesis:
    """A mixture about a level: value, variance, width, and what it adds to the likelihood."""

    def __init__(self, row, y, step, rho):
        self.log, self.parameters, self.modes, self.g, self.width, self.doubt = row
        self.gain, inflation, self.phi = 0.0, 1.0, 0.0
        if rho != 0.0:
            kept = np.flatnonzero(self.g[:, 0] > 0.5)
            self.gain, inflation, self.phi = correlated(y[kept], kept, rho)
        self.log, self.of_sigma, self.of_levels = self.log + self.gain, 0.0, 0
        self.influence = self.g[:, 0].copy()
        if self.modes is not None and self.modes.shape == "wide":
            self.influence += self.g[:, 1] * (self.modes.s / self.modes.t[0]) ** 2
        self.count = max(self.g[:, 0].sum(), 2.5)
        white = self.width**2 / self.count
        if self.modes is not None:
            white = self.modes.variance(y, self.g, step)
        self.white = white * self.count / (self.count - 1)
        self.variance = self.white * inflation

    def weight(self, penalty):
        return self.log - (penalty * self.parameters + 0.4 * self.of_levels) * np.log(len(self.g))

    def slow(self, y):
        kept = np.flatnonzero(self.g[:, 0] > 0.5)
        found = [flicker(y[kept], kept), gauss_markov(y[kept], kept)]
        gain, inflation, phi = np.transpose(found)
        odds = np.array([0.1, 0.2]) / 0.7 * np.exp(np.minimum(gain - self.gain, 500.0))
        total = 1 + odds.sum()
        self.variance = (self.variance + self.white * odds @ inflation) / total
        self.phi = (self.phi + odds @ phi) / total
        self.of_sigma = np.log(0.7 * total)

    def move(self, levels, n, unit):
        noise = (unit * self.width) ** 2
        of_levels = noise * inflated(self.phi, levels.good)
        count, variance, of_mean, gain = levels.read(of_levels)
        self.log += gain - n * np.log(unit) if count >= 4 else -np.inf
        moved = max(variance - of_levels / levels.good, 0.0)
        self.phi = (moved + self.phi * noise) / (moved + noise)
        self.width, self.variance = np.sqrt(moved + noise), unit**2 * self.white + of_mean
        self.of_levels = 3
        for block, factor in zip(levels.blocks, levels.factor, strict=True):
            self.influence[block] *= factor


def moving(y, step, size):
    """The hypotheses about a level that moves."""
    medians = levels = Levels(y, size)
    for last in (False, True):
        r = levels.residuals(y)
        centre, unit, _ = start(r, step)
        r = np.clip((r - centre) / unit, -1e3, 1e3)
        rows = mixtures(r, step / unit, last)
        if not last:
            w = weights([row[0] - 0.4 * row[1] * np.log(len(y)) for row in rows])
            good = sum(a * row[3][:, 0] for a, row in zip(w, rows, strict=True))
            levels = Levels(y, size, good, medians)
    found = [Hypothesis(row, r, step / unit, None) for row in rows]
    for h in found:
        h.move(Levels(y, size, h.g[:, 0], medians), len(y), unit)
    return found


def hypotheses(y, step, rho):
    """Weights in the value and in its variance, and the hypotheses."""
    found = [Hypothesis(row, y, step, rho) for row in mixtures(y, step)]
    if rho is None and any(h.gain > 0 for h in found):
        best = max(found, key=lambda h: h.weight(0.4))
        for size in block_sizes(y, step, 1.2 * np.log(len(y)), best.gain > 0):
            found += moving(y, step, size)
        for h in found:
            ahead = max(other.weight(0.2) + other.of_sigma for other in found) - h.weight(0.2)
            if not h.of_levels and h.gain > 0 and (h.modes is None or ahead < 7):
                h.slow(y)
    logs = [[-np.inf if h.doubt else h.weight(0.4), h.weight(0.2) + h.of_sigma] for h in found]
    w = weights(logs)
    w = np.where(w.max(axis=1, keepdims=True) > 1e-5, w, 0.0)
    for h in found:
        h.influence /= h.influence.sum()
    return *(w / w.sum(axis=0)).T, found


def start(y, rounding):
    """Centre, scale and rounding step of a record."""
    z = np.sort(y)
    gaps = np.diff(z)
    n = len(y)
    same = gaps <= 1e-13 * (abs(z[n // 2]) + z[3 * n // 4] - z[n // 4])
    step = rounding or (gaps[~same].min() if same.any() else 0.0)
    half = len(y) // 2 + 1
    lengths = z[half - 1 :] - z[: len(y) - half + 1]
    first = np.flatnonzero(lengths <= lengths.min() * (1 + 1e-9))[0]
    centre = z[first : first + half].mean()
    mad = 1.4826 * np.median(np.abs(y - np.median(y)))
    successive = 1.4826 * np.median(np.abs(np.diff(y))) / np.sqrt(2)
    scale = min(max(min(lengths[first] / 1.349, successive), 0.3 * mad), mad)
    scale = np.hypot(scale, step / np.sqrt(12)) or 0.1 * np.ptp(y) / len(y)
    return centre, scale, step


def mixed(y, rounding=0.0, correlation=None):
    """What the default finds before it looks at blocks."""
    centre, scale, step = start(y, rounding)
    z = np.clip((y - centre) / scale, -1e3, 1e3)
    w, v, found = hypotheses(z, step / scale, correlation)
    counts = w @ [h.count for h in found]
    each = np.array([h.influence @ z for h in found])
    value = w @ each
    student = stats.t.isf(0.0455 / 2, counts - 1) / 2
    within = scale**2 * student**2 * (v @ [h.variance for h in found])
    between = scale**2 * (v @ (each - value) ** 2)
    good, influence = w @ [h.g[:, 0] for h in found], w @ [h.influence for h in found]
    width = scale * np.sqrt(good @ (z - value) ** 2 / counts)
    value = centre + scale * value
    y = np.where(np.abs(z) < 1e3, y, centre + scale * z)
    return y, value, within, between, counts.sum(), good, influence, width, step


def in_blocks(found, size):
    """The default of what `mixed` found: value, sigma, outliers and weights of blocks."""
    y, value, within, between, count, good, influence, width, step = found
    variance = within + between
    blocks = blocks_of(len(y), size)
    weight = np.array([influence[g].sum() for g in blocks])
    mean = np.array([influence[g] @ y[g] for g in blocks]) / weight
    used = weight > 0.1 / len(weight)
    if (nu := used.sum() - 1) > 0:
        f = (weight * (mean - value) ** 2)[used].sum() / within / nu
        limit = stats.f.isf(0.05, nu, count - 1)
        variance *= max(1.0, f / limit)
    if step:
        excess = max((width / step) ** 2 - 1 / 12, 0.0)
        variance += step**2 / 12 * np.exp(-4 * np.pi**2 * excess)
    return value, np.sqrt(variance), good < 0.5, weight


def robust(y, size, rounding=0.0, correlation=None):
    """The default: value, sigma, outliers and weights of blocks."""
    return in_blocks(mixed(y, rounding, correlation), size)


def noise_factor(q, n):
    """Return the noise factor of a sum of squares with so many degrees of freedom."""
    return np.sqrt(max(1.0, (5 + q) / (5 + n)))


def stated(y, s, correlation):
    """Bearing, sigma, outliers and noise factor with stated sigmas, of two measurements or more."""
    ratio = 0.1 / 0.9 * np.sqrt(2 * np.pi) / 40 * s / np.median(s)

    def good(centre, f):
        z = np.clip((y - centre) / (f * s), -1e3, 1e3)
        density = np.exp(-0.5 * z**2)
        return density / (density + ratio), z, np.sum(np.log(density + ratio))

    def maximum(centre, f):
        for _ in range(10_000):
            weight = good(centre, f)[0] / s**2
            step = weight @ (y - centre) / weight.sum()
            centre += step
            weight = good(centre, f)[0] / (f * s) ** 2
            if abs(step) * np.sqrt(weight.sum()) < 1e-13:
                break
        g, z, log = good(centre, f)
        all_of = np.sum(g / (f * s) ** 2)
        information = all_of - np.sum(g * (1 - g) * (z / (f * s)) ** 2)
        variance = 1 / max(information, 0.1 * all_of)
        return centre, variance, log + 0.5 * np.log(variance), g

    def fit(f):
        starts = np.unique(y)
        if len(starts) > 32:
            starts = starts[np.arange(32) * (len(starts) - 1) // 31]
        log = np.array([good(c, f)[2] for c in starts])
        slope = np.array([good(c, f)[0] / s**2 @ (y - c) for c in starts])
        found, after, before = [], np.r_[slope[1:], -np.inf], np.r_[np.inf, slope[:-1]]
        leads = (slope >= 0) & (after <= 0) | (slope <= 0) & (before >= 0)
        leads |= np.abs(slope) <= 0.1 * f * np.sqrt(
            [
                max(np.sum(g * (1 - (1 - g) * z**2) / s**2), 0.0)
                for g, z, _ in (good(c, f) for c in starts)
            ]
        )
        likely = np.flatnonzero(leads & (log >= log.max() - 15))
        for k in (*likely, *np.flatnonzero(log == log.max())):
            mode = maximum(starts[k], f)
            if all(abs(mode[0] - other[0]) > 0.3 * np.sqrt(mode[1]) for other in found):
                found.append(mode)
        weight = np.exp([mode[2] - max(one[2] for one in found) for mode in found])
        found = [mode for mode, w in zip(found, weight, strict=True) if w >= 0.05]
        weight = weight[weight >= 0.05]
        return found, weight / weight.sum()

    n, f = len(y), 1.0
    if n > 4:
        middle = 1.4826 * np.median(np.abs(y - np.median(y)) / s)
        f = noise_factor((n - 1) * middle**2, n - 1)
    modes, weight = fit(f)
    for _ in range(3):
        centre, _, _, g = modes[int(np.argmax(weight))]
        following = noise_factor(np.sum(g * ((y - centre) / s) ** 2), max(g.sum() - 1, 0))
        if abs(following / f - 1) < 0.01:
            break
        f = following
        modes, weight = fit(f)
    value = sum(w * mode[0] for w, mode in zip(weight, modes, strict=True))
    one_good = [mode[3] / (1 - np.prod(1 - mode[3])) for mode in modes]
    g = weight @ np.array(one_good)
    a, lag = g / s, np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    inflation = a @ correlation**lag @ a / (a @ a)
    within = inflation * sum(w * mode[1] for w, mode in zip(weight, modes, strict=True))
    between = sum(w * (mode[0] - value) ** 2 for w, mode in zip(weight, modes, strict=True))
    return value, np.sqrt(within + between), g < 0.45, f


def on_the_circle(estimate, theta, period):
    """An estimator of plain numbers applied to angles: value in [0, period), polarity."""
    u = screening.unwrap_about_median(theta, period)
    value, sigma, outlier = estimate(u)[:3]
    polarity = (np.sign(u - value) * outlier).mean()
    return value % period, sigma, outlier, polarity
