"""Fusion of the tracks of several radars, (1) to (13) and the dynamic weights, one series at a
time."""

from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from reference.kalman import predict

NAN = float("nan")
COMPONENTWISE = ["equal", "static", "paper", "ewma", "posterior", "adaptive"]
MATRICES = ["adaptive-matrix", "matrix"]
METHODS = [*COMPONENTWISE, *MATRICES, "covariance-intersection", "central", "robust"]
LEVELS = [0.25, 1, 4, 16, 64]
AT_FIRST = np.array([0.125, 0.5, 0.125, 0.125, 0.125])
OUTLIERS = [256, 65536]
OF_OUTLIERS = np.array([0.875, 0.125])
ALIKE = 5.0
MANOEUVRES = [1, 64]
MOSTLY_NONE = np.array([0.999, 0.001])
MANOEUVRE_ENDS = 0.1
FOLLOWED, NEGLIGIBLE = 12, 1e-5
LEAST_GAIN = 1e-3
DISAGREEMENT, LEAST_SHARE, CLUSTERS = 1.0, 0.02, 5
COMPONENTS, AGREEMENT = 3, 0.01


def wrap(difference, period):
    if period is None:
        return difference
    return difference - period * np.floor(difference / period + 0.5)


def printed(t, alpha, variance):
    """(14)."""
    left = 1 - alpha * t
    f = np.array([[1, t, t**2 / 2], [0, 1, t], [0, 0, left]])
    return f, np.diag([0, 0, variance * (1 - left**2)])


def update(x, p, z, r, period=None):
    """(15) to (18), in Joseph's form: state, covariance, gain, innovation and its variance."""
    s = p[0, 0] + r
    gain = p[:, 0] / s
    innovation = wrap(z - x[0], period)
    kept = np.eye(3) - np.outer(gain, [1, 0, 0])
    p = kept @ p @ kept.T + r * np.outer(gain, gain)
    return x + gain * innovation, (p + p.T) / 2, gain, innovation, s


def pseudo_inverse(a):
    """In units of its own diagonal."""
    scale = np.sqrt(np.maximum(np.diag(a), 0))
    scale[scale == 0] = 1
    return np.linalg.pinv(a / np.outer(scale, scale), rcond=1e-9, hermitian=True) / np.outer(
        scale, scale
    )


class Track:
    """The filter of one radar. Before its second plot angle and rate are unknown."""

    def __init__(self, initial, acceleration_variance, period):
        self.period, self.known, self.first = period, initial is not None, None
        if self.known:
            self.x, self.p = (np.array(part, dtype=float) for part in initial)
        else:
            # of the error of "no acceleration, no noise" since the first plot
            self.x, self.p = np.zeros(3), np.diag([0, 0, acceleration_variance])

    def predict(self, t, f, q):
        self.x, self.p = predict(self.x, self.p, f, q)
        if self.first is not None:
            self.first[2] += t

    def update(self, z, r):
        """Gain and innovation with its variance; or the matrix that turns the errors of motion
        since the first plot into those of the state."""
        if self.known:
            self.x, self.p, *found = update(self.x, self.p, z, r, self.period)
            return found, None
        if self.first is None:
            # nothing has been predicted for angle and rate
            self.first = [z, r, 0.0]
            keep = np.diag([0.0, 0.0, 1.0])
            self.p = keep @ self.p @ keep
            return None, keep
        z0, r0, t = self.first
        if t == 0:
            share = r0 / (r0 + r)
            self.first = [z0 + share * wrap(z - z0, self.period), r * share, 0.0]
            return None, None
        turned = np.array([[0, 0, 0], [-1 / t, 1, 0], [0, 0, 1]])
        of_first, of_second = np.array([0, -1 / t, 0]), np.array([1, 1 / t, 0])
        self.x = np.array([z, wrap(z - z0, self.period) / t, 0])
        self.p = turned @ self.p @ turned.T
        self.p += r0 * np.outer(of_first, of_first) + r * np.outer(of_second, of_second)
        self.known = True
        return None, turned


def common_prior(a, b):
    """What two given states share: the prior of rate and acceleration."""
    common = np.diag([0, min(a[1, 1], b[1, 1]), min(a[2, 2], b[2, 2])])
    if a[1, 2] == b[1, 2]:
        common[1, 2] = common[2, 1] = a[1, 2]
    return common


def median_of_others(values, i):
    others = [value for j, value in enumerate(values) if j != i and value is not None]
    return max(1.0, np.median(others)) if others else 1.0


def believed_noise(i, r, q, d, nis, innovation, threshold, gate):
    """Steps 2 and 3: the noise, and whether the plot is an outlier."""
    if q[i] is None:
        return r, False
    reference = median_of_others(q, i)
    noise = r
    if q[i] > threshold * reference:
        noise = max(r, (r + d[i]) / reference)
    of_step = [n if n is not None else m for n, m in zip(nis, q, strict=True)]
    outlier = nis[i] is not None and nis[i] > gate * median_of_others(of_step, i)
    return (max(noise, innovation**2) if outlier else noise), outlier


def shares(precisions):
    """Shares of the sum; 0/0 is the same for all."""
    precisions = np.array(precisions, dtype=float)
    if np.isinf(precisions).any():
        precisions = np.isinf(precisions).astype(float)
    elif not precisions.any():
        precisions = np.ones_like(precisions)
    return precisions / precisions.sum()


def precision(method, r, variances, square):
    """What the weights are proportional to, from the covariance that the rule goes by."""
    if method == "equal":
        return 1.0
    if method == "static":
        return 1 / r
    if method == "ewma":
        return 1 / (variances[0] + r if np.isnan(square) else square)
    return 1 / variances


def paper_weights(corrections):
    """(1) to (13): by the inverse squares, component by component; shape (K, 3)."""
    with np.errstate(divide="ignore"):
        squares = 1 / np.asarray(corrections, dtype=float) ** 2
    return np.stack([shares(column) for column in squares.T], axis=1)


def campo(pa, pb, cross):
    """Of two estimates, as printed: `x1 + W (x2 - x1)`."""
    w = (pa - cross) @ pseudo_inverse(pa + pb - cross - cross.T)
    return [np.eye(3) - w, w]


def best_linear(joint):
    """`(E' PP^-1 E)^-1 E' PP^-1` for a regular PP of shape (K, K, 3, 3)."""
    k = len(joint)
    full = np.block([[joint[i][j] for j in range(k)] for i in range(k)])
    scale = np.tile(np.sqrt(np.diag(joint[0][0])), k)
    inverse = np.linalg.inv(full / np.outer(scale, scale)) / np.outer(scale, scale)
    e = np.tile(np.eye(3), (k, 1))
    w = np.linalg.inv(e.T @ inverse @ e) @ e.T @ inverse
    return [w[:, 3 * i : 3 * i + 3] for i in range(k)]


def matrix_weights(joint):
    if len(joint) == 1:
        return [np.eye(3)]
    if len(joint) == 2:
        return campo(joint[0][0], joint[1][1], joint[0][1])
    return best_linear(joint)


def best_split(first, second, others, total):
    """The part of `total` that `first` gets, for the largest determinant of all together; by
    bisection of the derivative of its logarithm. Half of it where it does not matter."""

    def slope(part):
        information = others + part * first + (total - part) * second
        return np.trace(np.linalg.solve(information, first - second))

    low, high = 0.0, total
    ends = slope(0.0), slope(total)
    if max(np.abs(ends)) < 1e-12:
        return total / 2
    if ends[0] <= 0 or ends[1] >= 0:
        return 0.0 if ends[0] <= 0 else total
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if slope(middle) > 0 else (low, middle)
    return (low + high) / 2


def intersection(covariances, cycles=200):
    """Weights and bound with the least determinant: shares are exchanged between two of the
    estimates at a time, until nothing changes."""
    k = len(covariances)
    information = np.linalg.inv(np.asarray(covariances))
    share = np.full(k, 1 / k)
    for _ in range(cycles):
        before = share.copy()
        for i in range(k):
            for j in range(i):
                total = share[i] + share[j]
                others = np.tensordot(share, information, 1)
                others = others - share[i] * information[i] - share[j] * information[j]
                if total > 0:
                    share[i] = best_split(information[i], information[j], others, total)
                    share[j] = total - share[i]
        if np.abs(share - before).max() < 1e-11:
            break
    bound = np.linalg.inv(np.tensordot(share, information, 1))
    return [part * bound @ own for part, own in zip(share, information, strict=True)], bound


def joint_matrix(covariances, cross=None):
    """All covariances as one matrix of order K m."""
    k, m = np.shape(covariances)[:2]
    blocks = np.zeros((k, k, m, m)) if cross is None else np.array(cross, dtype=float)
    blocks[range(k), range(k)] = covariances
    return blocks.swapaxes(1, 2).reshape(k * m, k * m)


def instant(x, covariances, method, cross=None, weights=None, period=None):
    """Mean, covariance and weights of estimates (K, m); nan for none."""
    x, covariances = np.asarray(x, dtype=float), np.asarray(covariances, dtype=float)
    present = np.flatnonzero(~np.isnan(x).all(axis=1))
    k, m = x.shape
    out = np.zeros((k, m, m))
    if not len(present):
        return np.full(m, NAN), np.where(np.eye(m), np.inf, 0), out
    own = covariances[present]
    joint = joint_matrix(
        own, None if cross is None else np.asarray(cross)[np.ix_(present, present)]
    )
    bound = None
    if method == "matrix":
        e = np.tile(np.eye(m), (len(present), 1))
        inverse = np.linalg.inv(joint)
        together = np.linalg.inv(e.T @ inverse @ e) @ e.T @ inverse
        found = together.reshape(m, len(present), m).swapaxes(0, 1)
    elif method == "covariance-intersection":
        found, bound = intersection(own)
    else:
        precision = {
            "equal": np.ones((k, m)),
            "posterior": 1 / np.diagonal(covariances, axis1=1, axis2=2),
            "static": np.repeat(np.asarray(weights, dtype=float)[:, np.newaxis], m, axis=1)
            if weights is not None
            else None,
        }[method][present]
        found = [np.diag(row) for row in precision / precision.sum(axis=0)]
    out[present] = found
    row = np.concatenate(list(found), axis=1)
    base = present[np.argmin(own[:, 0, 0])]
    away = x[present] - x[base]
    away[:, 0] = wrap(away[:, 0], period)
    mean = x[base] + sum(w @ a for w, a in zip(found, away, strict=True))
    if period is not None:
        mean[0] %= period
    return mean, row @ joint @ row.T if bound is None else bound, out


def combine(weights, states, joint, period):
    base = states[0]
    mean, covariance = base.copy(), np.zeros((3, 3))
    for i, w in enumerate(weights):
        away = states[i] - base
        away[0] = wrap(away[0], period)
        mean += w @ away
        for j, v in enumerate(weights):
            covariance += w @ joint[i][j] @ v.T
    return mean, (covariance + covariance.T) / 2


def central(z, r, t, f, q, initial, acceleration_variance, period=None):
    """One filter for all plots: the states after each step."""
    track = Track(initial, acceleration_variance, period)
    states = []
    for step in range(z.shape[1]):
        if step:
            track.predict(t[step - 1], f[step - 1], q[step - 1])
        for plot, noise in zip(z[:, step], r[:, step], strict=True):
            if not np.isnan(plot):
                track.update(plot, noise)
        states.append((track.x, track.p))
    return [np.array(part) for part in zip(*states, strict=True)]


@dataclass
class Component:
    """A normal distribution of the state, and what is believed under it."""

    weight: float
    x: np.ndarray
    p: np.ndarray
    noise: np.ndarray
    motion: np.ndarray


@dataclass
class Hypothesis:
    """A component, the levels of its prediction and of the plots so far, and e under them."""

    component: int
    levels: tuple
    weight: float
    mean: float
    variance: float

    def distance(self, other):
        return (self.mean - other.mean) ** 2 / (self.variance + other.variance)


def hypotheses(components, nu, r, seen, base, period, change_probability):
    """Every combination of the prediction's level and those of the plots, as far as followed, with
    its share of the largest probability; the most probable one first."""
    found = [
        Hypothesis(j, (c,), one.weight * p, wrap(one.x[0] - base, period), excess * one.p[0, 0])
        for j, one in enumerate(components)
        for c, (p, excess) in enumerate(zip(one.motion, MANOEUVRES, strict=True))
    ]
    for i, v, variance in zip(seen, nu, r, strict=True):
        grown, squares = [], []
        for h in found[:FOLLOWED]:
            chances = np.append(
                (1 - change_probability) * components[h.component].noise[i],
                change_probability * OF_OUTLIERS,
            )
            for level, chance in enumerate(chances):
                plot = variance * [*LEVELS, *OUTLIERS][level]
                s = h.variance + plot
                mean = h.mean + h.variance / s * (v - h.mean)
                weight = h.weight * chance / np.sqrt(s)
                new = (*h.levels, level), weight, mean, h.variance * plot / s
                grown.append(Hypothesis(h.component, *new))
                squares.append((v - h.mean) ** 2 / s)
        # the largest as 1, lest all vanish
        for h, square in zip(grown, squares, strict=True):
            h.weight *= np.exp(-(square - min(squares)) / 2)
        largest = max(h.weight for h in grown)
        for h in grown:
            h.weight /= largest
        found = sorted((h for h in grown if h.weight > NEGLIGIBLE), key=lambda h: -h.weight)
    return found


def clusters_of(found):
    """Hypotheses of one component that agree with the most probable one that is left."""
    clusters, left = [], found
    while left and len(clusters) < CLUSTERS and (left[0].weight > LEAST_SHARE or not clusters):
        centre, others = left[0], left
        clusters.append([])
        left = []
        for h in others:
            agrees = h.component == centre.component and h.distance(centre) <= DISAGREEMENT
            (clusters[-1] if agrees else left).append(h)
    centres = [cluster[0] for cluster in clusters]
    for h in left:
        own = [n for n, centre in enumerate(centres) if centre.component == h.component]
        if own:
            clusters[min(own, key=lambda n: h.distance(centres[n]))].append(h)
    return clusters


def moments(weights, means, covariances):
    """Mean and covariance of a mixture."""
    shares = np.array(weights) / np.sum(weights)
    mean = np.tensordot(shares, means, 1)
    away = np.array(means) - mean
    spread = np.array(covariances) + away[..., np.newaxis] * away[:, np.newaxis]
    return mean, np.tensordot(shares, spread, 1)


def mixture(components, period):
    """State, covariance, levels and motion of several together."""
    base = components[0].x
    away = [one.x - base for one in components]
    for one in away:
        one[0] = wrap(one[0], period)
    weights = [one.weight for one in components]
    x, p = moments(weights, away, [one.p for one in components])
    noise, motion = (
        np.average([getattr(one, name) for one in components], axis=0, weights=weights)
        for name in ("noise", "motion")
    )
    return Component(sum(weights), base + x, p, noise, motion)


def reduced(components, period):
    """Runnalls 2007: pairs that cost the least become one."""
    while len(components) > 1:
        costs = {}
        for i, a in enumerate(components):
            for j, b in enumerate(components[:i]):
                logs = [np.linalg.slogdet(one.p)[1] for one in (mixture([a, b], period), a, b)]
                weights = a.weight + b.weight, -a.weight, -b.weight
                costs[i, j] = np.dot(weights, logs) / 2
        pair = min(costs, key=lambda pair: costs[pair])
        if costs[pair] > AGREEMENT and len(components) <= COMPONENTS:
            break
        one = mixture([components[n] for n in pair], period)
        components = [c for n, c in enumerate(components) if n not in pair] + [one]
    return sorted(components, key=lambda one: -one.weight)


def learnt(component, cluster, seen, base, total, period):
    """A component after the plots, if its cluster is right."""
    shares = np.array([h.weight for h in cluster])
    weight = shares.sum()
    shares /= weight
    levels = np.array([h.levels for h in cluster])
    offset = wrap(component.x[0] - base, period)
    e = shares @ [h.mean for h in cluster] - offset
    p = shares @ [h.variance + (h.mean - offset - e) ** 2 for h in cluster]
    motion = np.array([shares[levels[:, 0] == c].sum() for c in (0, 1)])
    noise = component.noise.copy()
    for at, i in enumerate(seen, start=1):
        of_levels = np.array([shares[levels[:, at] == level].sum() for level in range(7)])
        noise[i] = of_levels[:5] + of_levels[5:].sum() * noise[i]
    prior = component.p[0, 0]
    grown = max(motion @ MANOEUVRES, p / prior / (1 - LEAST_GAIN))
    # the error of the angle tells of the others what they have in common with it
    with_angle = component.p[:, 0] / prior
    both = np.outer(with_angle, with_angle)
    covariance = grown * (component.p - prior * both) + p * both
    return Component(weight / total, component.x + with_angle * e, covariance, noise, motion)


def first_variances(z, r, period):
    """Variances with which the plots of a step begin a state.

    Infinite where a plot contradicts one with which more than half of them agree; if there is no
    such plot, those of their largest difference.
    """
    away = np.abs(wrap(z[:, np.newaxis] - z, period))
    agree = away <= ALIKE * np.sqrt(r[:, np.newaxis] + r)
    centre = np.argmax(agree.sum(axis=1))
    if 2 * agree[centre].sum() <= np.sum(~np.isnan(z)):
        return r + np.nanmax(away, initial=0.0) ** 2 / 2
    return np.where(agree[centre], r, np.inf)


def robust(z, r, t, f, q, initial, acceleration_variance, period=None, change_probability=0.005):
    """One filter for all plots with the noise as believed: states, weights, noise, outliers."""
    k, steps = z.shape
    track = Track(initial, acceleration_variance, period)
    nothing = Component(1.0, np.zeros(3), np.zeros((3, 3)), np.tile(AT_FIRST, (k, 1)), MOSTLY_NONE)
    components = [nothing]
    states, weights = [], np.full((k, steps), NAN)
    believed, outlier = np.empty((k, steps)), np.zeros((k, steps), dtype=bool)
    for step in range(steps):
        if step:
            track.predict(t[step - 1], f[step - 1], q[step - 1])
            for one in components:
                one.x, one.p = predict(one.x, one.p, f[step - 1], q[step - 1])
        seen = [i for i in range(k) if not np.isnan(z[i, step])]
        if not track.known:
            first = first_variances(z[:, step], r[:, step], period)
            outlier[seen, step] = np.isinf(first[seen])
            for i in seen:
                if np.isfinite(first[i]):
                    track.update(z[i, step], first[i])
            components[0].x, components[0].p = track.x, track.p
        else:
            if step == 0:
                components[0].x, components[0].p = track.x, track.p
            weights[~np.isnan(z[:, : step + 1]).all(axis=1) | (initial is not None), step] = 0
            if seen:
                base = components[0].x[0]
                nu = {i: wrap(z[i, step] - base, period) for i in seen}
                seen.sort(key=lambda i: abs(nu[i]))
                first = seen[0]
                nu = [nu[first] + wrap(z[i, step] - z[first, step], period) for i in seen]
                for one in components:
                    one.motion = one.motion + MANOEUVRE_ENDS * (MOSTLY_NONE - one.motion)
                    one.noise[seen] += change_probability * (AT_FIRST - one.noise[seen])
                found = hypotheses(
                    components, nu, r[seen, step], seen, base, period, change_probability
                )
                clusters = clusters_of(found)
                kept = [h for cluster in clusters for h in cluster]
                total = sum(h.weight for h in kept)
                pulls = []
                for at, i in enumerate(seen, start=1):
                    excess = [[*LEVELS, *OUTLIERS][h.levels[at]] for h in kept]
                    effect = [h.weight * h.variance for h in kept]
                    pulls.append(np.sum(np.divide(effect, excess)) / r[i, step])
                    of_outlier = sum(h.weight for h in kept if h.levels[at] >= 5)
                    outlier[i, step] = of_outlier / total > 0.5
                weights[seen, step] = pulls / np.sum(pulls)
                components = [
                    learnt(components[cluster[0].component], cluster, seen, base, total, period)
                    for cluster in clusters
                ]
                components = reduced(components, period)
        levels = sum(one.weight * one.noise @ np.log(LEVELS) for one in components)
        believed[:, step] = r[:, step] * np.exp(levels)
        whole = mixture(components, period)
        states.append((whole.x, whole.p))
    states = [np.array(part) for part in zip(*states, strict=True)]
    return states, weights, believed, outlier


def pooled(z, r, period=None):
    """The plots of every step as one, weighted by 1/R."""
    there = ~np.isnan(z)
    information = np.where(there, 1 / r, 0.0)
    total = information.sum(axis=0)
    first = z[np.argmax(there, axis=0), np.arange(z.shape[1])]
    away = np.where(there, wrap(z - first, period), 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return first + (information * away).sum(axis=0) / total, 1 / total


def hierarchical(z, r, f, q, initial, period=None):
    """Information fusion: each radar sends `P^-1 - P-^-1` and `P^-1 x - P-^-1 x-`, all of them
    starting from the centre's last state."""
    x, p = initial
    states = []
    for step in range(z.shape[1]):
        if step:
            x, p = predict(x, p, f[step - 1], q[step - 1])
        before = np.linalg.inv(p)
        information, vector = before.copy(), np.zeros(3)
        for plot, noise in zip(z[:, step], r[:, step], strict=True):
            if not np.isnan(plot):
                own_x, own_p, *_ = update(x, p, plot, noise, period)
                inverse = np.linalg.inv(own_p)
                information = information + inverse - before
                # measured from the predicted state, lest the angle lose digits
                vector += inverse @ (own_x - x)
        p = np.linalg.inv(information)
        x = x + p @ vector
        states.append((x, p))
    return [np.array(part) for part in zip(*states, strict=True)]


def third_filter(angles, r, f, q, x, p, period=None):
    """(14) to (20) on fused angles."""
    for angle in angles:
        x, p = predict(x, p, f, q)
        x, p, *_ = update(x, p, angle, r, period)
    return x, p


def fuse(  # noqa: PLR0912, PLR0915
    z,
    r,
    t,
    f,
    q,
    *,
    method,
    initial=None,
    acceleration_variance=0.0,
    period=None,
    forgetting_factor=0.9,
    threshold=1.6,
    gate=16.0,
    change_probability=0.005,
):
    """Plots and variances (K, steps), times and matrices between the steps, states for all radars
    or none; returns arrays by name."""
    k, steps = z.shape
    tracks = [
        Track(
            None if initial is None else (initial[0][i], initial[1][i]),
            acceleration_variance,
            period,
        )
        for i in range(k)
    ]
    actual = [track.p for track in tracks]
    quality = [1.0 if track.known else None for track in tracks]
    excess, squares = [0.0] * k, [NAN] * k
    if initial is None:
        # all errors before the first plot are those of one acceleration
        cross = [[tracks[0].p.copy() for _ in range(k)] for _ in range(k)]
        pool = None
    else:
        cross = [[common_prior(a.p, b.p) for b in tracks] for a in tracks]
        joint = [[a.p if i == j else cross[i][j] for j in range(k)] for i, a in enumerate(tracks)]
        pool = combine(matrix_weights(joint), [track.x for track in tracks], joint, period)
    together = central(z, r, t, f, q, pool, acceleration_variance, period)
    out = {
        "mean": np.full((steps, 3), NAN),
        "covariance": np.full((steps, 3, 3), NAN),
        "weights": np.full((k, steps, 3), NAN),
        "noise_variance": r.astype(float),
        "outlier": np.zeros((k, steps), dtype=bool),
        "innovation": np.full((k, steps), NAN),
        "innovation_variance": np.full((k, steps), NAN),
        "known": np.zeros((k, steps), dtype=bool),
    }
    for step in range(steps):
        if step:
            fk, qk = f[step - 1], q[step - 1]
            for track in tracks:
                track.predict(t[step - 1], fk, qk)
            actual = [fk @ p @ fk.T + qk for p in actual]
            cross = [[fk @ c @ fk.T + qk for c in row] for row in cross]
        nis = [None] * k
        gains, kept, starting = np.zeros((k, 3)), [np.eye(3)] * k, []
        for i, track in enumerate(tracks):
            if np.isnan(z[i, step]):
                continue
            found, turned = track.update(z[i, step], r[i, step])
            if turned is not None:
                kept[i] = turned
                starting.append(i)
            if found is None:
                continue
            gains[i], v, s = found
            kept[i] = np.eye(3) - np.outer(gains[i], [1, 0, 0])
            out["innovation"][i, step], out["innovation_variance"][i, step] = v, s
            nis[i] = v**2 / s
            quality[i] += (1 - forgetting_factor) * (min(nis[i], 100) - quality[i])
            excess[i] += (1 - forgetting_factor) * (min(v**2 - s, 99 * s) - excess[i])
            before = s if np.isnan(squares[i]) else squares[i]
            squares[i] = before + (1 - forgetting_factor) * (v**2 - before)
        for i in range(k):
            v = out["innovation"][i, step]
            noise, outlier = believed_noise(i, r[i, step], quality, excess, nis, v, threshold, gate)
            out["noise_variance"][i, step], out["outlier"][i, step] = noise, outlier
            if i not in starting:
                actual[i] = kept[i] @ actual[i] @ kept[i].T + noise * np.outer(gains[i], gains[i])
        cross = [[kept[i] @ cross[i][j] @ kept[j].T for j in range(k)] for i in range(k)]
        for i in starting:
            actual[i] = tracks[i].p
            if tracks[i].known:
                quality[i] = 1.0
        known = [i for i in range(k) if tracks[i].known]
        out["known"][known, step] = True
        if not known:
            continue
        if method == "central":
            out["mean"][step], out["covariance"][step] = together[0][step], together[1][step]
            continue
        own = actual if method in {"adaptive", "adaptive-matrix"} else [track.p for track in tracks]
        joint = [[own[i] if i == j else cross[i][j] for j in known] for i in known]
        states = [tracks[i].x for i in known]
        bound = None
        if method in MATRICES:
            weights = matrix_weights(joint)
        elif method == "covariance-intersection":
            weights, bound = intersection([joint[at][at] for at in range(len(known))])
        else:
            if method == "paper":
                share = paper_weights(
                    [
                        gains[i] * out["innovation"][i, step]
                        if nis[i] is not None
                        else [np.inf] * 3
                        for i in known
                    ]
                )
            else:
                each = [
                    np.ones(3) * precision(method, r[i, step], np.diag(own[i]), squares[i])
                    for i in known
                ]
                share = np.stack([shares(column) for column in np.transpose(each)], axis=1)
            weights = [np.diag(row) for row in share]
        mean, covariance = combine(weights, states, joint, period)
        out["mean"][step] = mean
        out["covariance"][step] = covariance if bound is None else bound
        for i, w in zip(known, weights, strict=True):
            out["weights"][i, step] = np.diag(w)
    if method == "robust":
        states, weights, out["noise_variance"], out["outlier"] = robust(
            z, r, t, f, q, pool, acceleration_variance, period, change_probability
        )
        known = out["known"].any(axis=0)
        out["mean"][known], out["covariance"][known] = (part[known] for part in states)
        out["weights"] = np.repeat(weights[..., np.newaxis], 3, axis=-1)
    if period is not None:
        out["mean"][:, 0] %= period
    return out


def random_effects(x, s):
    """Mean, covariance, and mean τ, of estimates (K, m) with systematic errors N(0, τ² M)."""
    x, s = np.asarray(x, dtype=float), np.asarray(s, dtype=float)
    m = x.shape[1]
    shape = np.linalg.inv(np.linalg.inv(s).sum(0))
    size = np.median(np.sqrt(np.trace(np.linalg.inv(shape) @ s, axis1=1, axis2=2) / m))
    shape = shape * size**2
    away = x - x[0]
    reach = np.sqrt(np.einsum("ki,ij,kj->k", away, np.linalg.inv(shape), away).max())
    tau = np.append(0, np.geomspace(0.01, max(300.0, 10 * reach), 160))
    terms = []
    for t, step in zip(tau, np.gradient(tau), strict=True):
        v = s + t**2 * shape
        c = np.linalg.inv(v)
        p = np.linalg.inv(c.sum(0))
        mean = p @ np.einsum("kij,kj->i", c, x)
        misfit = np.einsum("ki,kij,kj->", x - mean, c, x - mean)
        logs = np.linalg.slogdet(v)[1].sum() - np.linalg.slogdet(p)[1]
        terms.append((np.log(step / (1 + t**2)) - (logs + misfit) / 2, mean, p))
    share = np.exp(np.array([log for log, _, _ in terms]) - max(log for log, _, _ in terms))
    share /= share.sum()
    means, spreads = np.array([a for _, a, _ in terms]), np.array([p for _, _, p in terms])
    mean = share @ means
    covariance = np.einsum("t,tij->ij", share, spreads)
    covariance += np.einsum("t,ti,tj->ij", share, means - mean, means - mean)
    scale = np.empty(m)
    for i in range(m):
        sigma = np.sqrt(spreads[:, i, i])

        def outside(h, i=i, sigma=sigma):
            low, high = ((end - means[:, i]) / sigma for end in (mean[i] - h, mean[i] + h))
            return share @ (stats.norm.cdf(low) + stats.norm.sf(high)) - 0.0455

        top = 1e3 * np.sqrt(covariance[i, i])
        scale[i] = optimize.brentq(outside, 0, top, xtol=1e-13, rtol=1e-14) / 2
    scale /= np.sqrt(np.diag(covariance))
    bias = share @ tau * np.sqrt(np.diag(shape))
    return mean, covariance * np.outer(scale, scale), bias
