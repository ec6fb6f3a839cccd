"""One target without clutter: every model of motion, in plain NumPy.

Singer 1970; Mehra 1970 (correlated innovations); Bar-Shalom, Li, Kirubarajan 2001: sections 11.6
(mixing) and 11.7 (coordinated turn); Friedland 1969 (the acceleration along the course);
Glagovskii, Lavina, Rudelson 2014 (least squares over a window, arcs of a flight plan).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from reference import flightplan, kalman

GATES = {p: -2 * np.log(1 - p) for p in (0.65, 0.95, 0.998)}
# of six degrees of freedom
SUM = 20.790738


def noise(position, radar):
    """Covariance of a plot: J diag(sigma_r^2, sigma_a^2) J'."""
    r, a = np.hypot(*position), np.arctan2(*position)
    jacobian = np.array([[np.sin(a), r * np.cos(a)], [np.cos(a), -r * np.sin(a)]])
    return jacobian @ np.diag([radar.range_sigma**2, radar.azimuth_sigma**2]) @ jacobian.T


def per_axis(block):
    """The same for east and north, states ordered by derivative."""
    return np.kron(block, np.eye(2))


def straight(t):
    """Transition of straight and uniform flight."""
    return per_axis(np.array([[1.0, t], [0.0, 1.0]]))


def white(q, t):
    """Covariance of white acceleration of the density q."""
    return per_axis(q * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]]))


def unnoticed(sigma, gap):
    """Covariance of an acceleration that nobody noticed."""
    gain = np.array([gap**2 / 2, gap])
    return per_axis(sigma**2 * np.outer(gain, gain))


def arc(w, t):
    """Transition of position and velocity at a known rate of turn."""
    s, c = np.sin(w * t), np.cos(w * t)
    # 1 - cos without cancellation
    versed = 2 * np.sin(w * t / 2) ** 2
    along, across = (s / w, versed / w) if w else (t, 0.0)
    turning = np.array([[c, -s], [s, c]])
    return np.block(
        [
            [np.eye(2), np.array([[along, -across], [across, along]])],
            [np.zeros((2, 2)), turning],
        ]
    )


def arc_by_rate(w, t):
    """Derivative of that by the rate: of `integral exp(J w u) du` and of `exp(J w t)`, 0 to t."""
    j = np.array([[0.0, -1.0], [1.0, 0.0]])
    a = w * t
    turning = np.cos(a) * np.eye(2) + np.sin(a) * j
    if abs(a) < 1e-2:
        # sum of (J a)^k / ((k + 2) k!), times J t^2
        total, term = np.zeros((2, 2)), np.eye(2)
        for k in range(12):
            total = total + term / (k + 2)
            term = term @ j * a / (k + 1)
        by_integral = t**2 * j @ total
    else:
        integral = arc(w, t)[:2, 2:]
        by_integral = (t * turning - integral) / w
    return np.concatenate([by_integral, t * j @ turning])


def corrected(x, p, z, r):
    """Kalman's correction in Joseph's form, and the density of the plot."""
    h = np.eye(2, len(x))
    s = h @ p @ h.T + r
    gain = np.linalg.solve(s, h @ p).T
    y = z - h @ x
    density = np.exp(-0.5 * y @ np.linalg.solve(s, y)) / (2 * np.pi * np.sqrt(np.linalg.det(s)))
    kept = np.eye(len(x)) - gain @ h
    return x + gain @ y, kept @ p @ kept.T + gain @ r @ gain.T, density


def moments(weights, means, covariances):
    """Moments of a mixture."""
    mean = sum(w * x for w, x in zip(weights, means, strict=True))
    parts = zip(weights, means, covariances, strict=True)
    return mean, sum(w * (p + np.outer(x - mean, x - mean)) for w, x, p in parts)


class Straight:
    """Straight flight with white acceleration, constant for a scan."""

    def __init__(self, x, p, radar, sigma):
        self.x, self.p, self.q = x, p, sigma**2 * radar.scan_period

    def predict(self, t):
        f = straight(t)
        self.x, self.p = f @ self.x, f @ self.p @ f.T + white(self.q, t)

    def expected(self):
        return [(1.0, self.x, self.p)]

    def widen(self, extra, is_likely):
        self.p = self.p.copy()
        self.p[:4, :4] += extra

    def correct(self, z, r):
        self.x, self.p, _ = corrected(self.x, self.p, z, r)

    def watch(self):
        """Plans have no say."""

    def saw(self, y, s, left):
        """All targets are alike."""

    def estimate(self):
        return self.x[:4], self.p[:4, :4], 0.0

    def shown(self):
        return self.estimate()


class Singer(Straight):
    """Acceleration that fades."""

    def __init__(self, x, p, radar, alpha, sigma):
        super().__init__(np.append(x, [0.0, 0.0]), np.zeros((6, 6)), radar, sigma)
        self.p[:4, :4] = p
        self.p[4:, 4:] = sigma**2 * np.eye(2)
        self.model = alpha, sigma

    def predict(self, t):
        f, q = (per_axis(block) for block in kalman.as_floats(kalman.singer(t, *self.model)))
        self.x, self.p = f @ self.x, f @ self.p @ f.T + q


class Multiple:
    """Straight flight, turns and changes of speed, mixed.

    A change of speed has its own filter of five states, of which the last is the acceleration along
    the course. While it is unlikely, this is straight flight plus what follows from an
    acceleration, and the other two do not know of it.
    """

    LIKELY, UNLIKELY, FADING, OTHER, MOVES = 0.2, 0.05, 5000.0, 1000.0, 3.0
    # levels from which manoeuvres are more frequent and sharper
    FREQUENT, SHARP = 1.0, 2.0

    def __init__(self, x, p, radar, manoeuvres):
        self.settings, self.radar = manoeuvres, radar
        # the target may have turned for long
        self.probability = np.array([0.75, 0.25, 0.0])
        self.straight, self.turn = (x, p), self._entering(x, p, 2.0 * manoeuvres.turn_rate_sigma)
        self.level, self.lag, self.scatter = 0.0, np.zeros(2), 1.0
        self.misfit, self.about, self.left = 1.0, 0.0, 1.0
        self.interval, self.since = 0.0, 0.0
        self._forget()

    def _adapted(self, t):
        """Return the settings for a target that manoeuvres so much more than usual."""
        settings = self.settings
        self.since += t
        often = np.exp(0.5 * max(self.level - self.FREQUENT, 0.0))
        shorter = (settings.straight_time / often, settings.steady_time / often)
        return replace(
            settings,
            straight_time=max(shorter[0], min(settings.straight_time, settings.turn_time)),
            steady_time=max(shorter[1], min(settings.steady_time, settings.speed_change_time)),
            turn_rate_sigma=settings.turn_rate_sigma * np.sqrt(often),
            turn_sigma=settings.turn_sigma * np.exp(0.5 * max(self.level - self.SHARP, 0.0)),
        )

    def saw(self, y, s, left):
        """Compare an innovation of covariance s, which has left this share, with those before."""
        share = min(self.since / self.radar.scan_period, 1.0)
        product = 0.5 * y @ np.linalg.solve(s, self.lag)
        self.level = np.clip(
            self.level + 0.6 * share * (np.clip(product, -4.0, 4.0) - 0.02), 0.0, 6.6
        )
        self.lag = 0.5 * (self.lag + y)
        square = min(0.5 * y @ np.linalg.solve(s, y), 8.0)
        self.scatter += 0.1 * (square - self.scatter)
        self.misfit += 0.04 * (square - self.misfit)
        self.about = (self.misfit - 1.0) * np.trace(s) / 2 if self.misfit > 1.4 else 0.0
        self.left = left
        self.interval = 0.5 * (self.interval + self.since)
        self.since = 0.0

    def shown(self):
        """Return the estimate, with manoeuvres not noticed yet and motion that no model has."""
        mean, covariance, turns = self.estimate()
        more = np.exp(max(self.level - self.SHARP, 0.0)) - 1.0
        square = self.interval * self.radar.scan_period * min(self.scatter, 1.0) ** 2
        variance = 1.3 * more * self.settings.turn_sigma**2 * square
        rate = min(0.35, np.pi / self.interval) if self.interval else 0.0
        covariance[:2, :2] += self.left * self.about * np.eye(2)
        covariance[2:, 2:] += (variance + self.about * rate**2) * np.eye(2)
        return mean, covariance, turns

    def _forget(self):
        """Nothing is known of the acceleration."""
        self.speed = self._entering(*self.straight, self.settings.acceleration_sigma)
        self.odds = self.settings.speed_change_time / self.settings.steady_time

    @staticmethod
    def _entering(x, p, sigma):
        covariance = np.zeros((5, 5))
        covariance[:4, :4] = p
        covariance[4, 4] = sigma**2
        return np.append(x, 0.0), covariance

    def _weights(self):
        """Probabilities of the three."""
        if self.probability[2] > 0:
            return self.probability
        odds = self.odds * self.probability[0]
        return np.append(self.probability[:2], odds) / (1 + odds)

    def predict(self, t):
        settings, period = self._adapted(t), self.radar.scan_period
        begins, ends, sped, steady, other = 1 - np.exp(
            -t
            / np.array(
                [
                    settings.straight_time,
                    settings.turn_time,
                    settings.steady_time,
                    settings.speed_change_time,
                    self.OTHER,
                ]
            )
        )
        transition = np.array([[1 - begins, begins, 0.0], [ends, 1 - ends, 0.0], [0.0, 0.0, 1.0]])
        is_model = self.probability[2] > 0
        if is_model:
            transition += [[-sped, 0.0, sped], [0.0, -other, other], [steady, other, 0.0]]
            transition[2, 2] -= steady + other
        predicted = self.probability @ transition
        with np.errstate(invalid="ignore"):
            mixing = transition * self.probability[:, np.newaxis] / predicted
        (x, p), (y, s), (z, r) = self.straight, self.turn, self.speed
        parts = [x, y[:4], z[:4]], [p, s[:4, :4], r[:4, :4]]
        kinds = slice(3 if is_model else 2)
        into = self._all_entering(parts, settings.turn_rate_sigma, 1, self.turn)
        a = moments(mixing[kinds, 0], parts[0][kinds], parts[1][kinds])
        b = moments(mixing[kinds, 1], into[0][kinds], into[1][kinds])
        if is_model:
            into = self._all_entering(parts, settings.acceleration_sigma, 2, self.speed)
            self.speed = moments(mixing[:, 2], *into)
        else:
            self._wait(a, mixing[0, 0], sped, steady)
        self.probability = predicted
        f = straight(t)
        q = white(settings.straight_sigma**2 * period, t)
        self.straight = f @ a[0], f @ a[1] @ f.T + q
        mean, covariance = self.speed if is_model else a
        course = mean[2:4] / np.hypot(*mean[2:4])
        # a target that may stand has no course
        course *= np.hypot(*mean[2:4]) > self.MOVES * np.sqrt(np.trace(covariance[2:4, 2:4]) / 2)
        f = np.eye(5)
        f[:4, :4] = straight(t)
        f[:4, 4] = np.append(0.5 * t**2 * course, t * course)
        f[4, 4] = np.exp(-t / self.FADING)
        noise = np.zeros((5, 5))
        noise[:4, :4] = q
        noise[4, 4] = settings.acceleration_sigma**2 * (1 - f[4, 4] ** 2)
        self.speed = f @ self.speed[0], f @ self.speed[1] @ f.T + noise
        if not is_model:
            self._relate()
        f = np.eye(5)
        f[:4, :4] = arc(b[0][4], t)
        f[:4, 4] = arc_by_rate(b[0][4], t) @ b[0][2:4]
        q = np.zeros((5, 5))
        q[:4, :4] = white(settings.turn_sigma**2 * period, t)
        q[4, 4] = settings.turn_rate_walk**2 * t
        moved = np.append(f[:4, :4] @ b[0][:4], b[0][4])
        self.turn = moved, f @ b[1] @ f.T + q

    def _all_entering(self, parts, sigma, own, model):
        """Estimates that enter a model, of which one is its own."""
        into = [self._entering(x, p, sigma) for x, p in zip(*parts, strict=True)]
        into[own] = model
        return list(zip(*into, strict=True))

    def _wait(self, mixed, stays, sped, steady):
        """Let a change of speed begin or end that is no model yet; `mixed` is straight flight."""
        odds = self.odds * (1 - steady) + sped
        fresh = sped / odds
        self.odds = stays * odds / (1 - sped + self.odds * steady)
        x, p = self.straight
        entering = self._entering(x, p, self.settings.acceleration_sigma)
        mean, covariance = moments(
            [fresh, 1 - fresh], [entering[0], self.speed[0]], [entering[1], self.speed[1]]
        )
        response = stays * covariance[:4, 4] / covariance[4, 4]
        self.speed = self._following(mixed, response, mean[4], covariance[4, 4])

    def _relate(self):
        """Keep of it only straight flight and what follows from the acceleration."""
        mean, covariance = self.speed
        response = covariance[:4, 4] / covariance[4, 4]
        self.speed = self._following(self.straight, response, mean[4], covariance[4, 4])

    @staticmethod
    def _following(estimate, response, acceleration, variance):
        x, p = estimate
        by = np.append(response, 1.0)
        wide = np.zeros((5, 5))
        wide[:4, :4] = p
        return np.append(x, 0.0) + acceleration * by, wide + variance * np.outer(by, by)

    def expected(self):
        models = [self.straight, self.turn]
        if self.probability[2] > 0:
            models.append(self.speed)
        return [(w, *model) for w, model in zip(self.probability, models, strict=False)]

    def widen(self, extra, is_likely):
        wide = np.zeros((5, 5))
        wide[:4, :4] = extra
        self.straight = self.straight[0], self.straight[1] + extra
        self.turn = self.turn[0], self.turn[1] + wide
        self.speed = self.speed[0], self.speed[1] + wide
        turning = max(self.probability[1], 0.5 if is_likely else 0.0)
        others = self.probability[[0, 2]]
        others = others * (1 - turning) / others.sum()
        self.probability = np.array([others[0], turning, others[1]])

    def correct(self, z, r):
        *self.straight, first = corrected(*self.straight, z, r)
        *self.turn, second = corrected(*self.turn, z, r)
        *self.speed, third = corrected(*self.speed, z, r)
        self.odds *= third / first
        self.probability = self.probability * [first, second, third]
        self.probability /= self.probability.sum()
        weights = self._weights()
        if self.probability[2] == 0.0:
            if weights[2] > self.LIKELY:
                self.probability = weights
        elif weights[2] < self.UNLIKELY:
            self.probability = np.append(weights[:2], 0.0) / (1 - weights[2])
            self._forget()

    def watch(self):
        """Plans have no say."""

    def estimate(self):
        means = [self.straight[0], self.turn[0][:4], self.speed[0][:4]]
        covariances = [self.straight[1], self.turn[1][:4, :4], self.speed[1][:4, :4]]
        mean, covariance = moments(self.probability, means, covariances)
        weights = self._weights()
        if self.probability[2] == 0.0 and weights[2] > 0.005:
            x, p = self.speed
            response = p[:4, 4] / p[4, 4]
            covariance += weights[2] * (p[4, 4] + x[4] ** 2) * np.outer(response, response)
        return mean, covariance, weights[1]


class Window:
    """Least squares over the last plots, along the arcs of a plan with one turn."""

    LONG, SHORT, TURN = 20, 3, 5

    def __init__(self, x, p, radar, guard_acceleration, plan=None, plan_speed=None):
        self.radar, self.sigma = radar, guard_acceleration
        self.plan, self.plan_speed = plan, plan_speed
        self.x, self.p, self.extra = x, p, np.zeros((4, 4))
        # the start, then the plots, each with the transition since
        self.start = [[x, p, np.eye(4)]]
        self.plots = []
        self.length, self.distances, self.sides = 0, [], []
        self.manoeuvre = self.near = self.on_arc = self.guarded = self.deviates = False
        self.gap, self.time = 0.0, 0.0
        self.speeds, self.zone = [], False

    def predict(self, t):
        self.on_arc = self.on_arc and self.gap > 0
        self.gap, self.time = self.gap + t, self.time + t
        self.deviates = self.deviates and self.zone
        self.near = self.zone and not self.deviates
        f = self._along_plan(t) if self.near else straight(t)
        self.x, self.p = f @ self.x, f @ self.p @ f.T
        for past in [*self.start, *self.plots]:
            past[2] = f @ past[2]
        for past in self.plots:
            past[3] += t
        self.extra = unnoticed(self.sigma, self.gap) if self.zone else np.zeros((4, 4))

    def _along_plan(self, t):
        """Straight to the start of the turn, along the capture arc, and straight on."""
        times, speeds = np.array(self.speeds).T
        turn = flightplan.turn(*self.plan, flightplan.mean_speed(times, speeds))
        position, velocity = self.x[:2], self.x[2:]
        speed = np.hypot(*velocity)
        before = np.clip(-flightplan.project(turn, position)[0] / speed, 0.0, t)
        position = position + before * velocity
        left = flightplan.wrap(flightplan.course(turn["u2"]) - flightplan.course(velocity))
        ahead = flightplan.cross(turn["b"] - position, turn["u2"])
        ahead /= flightplan.cross(velocity / speed, turn["u2"])
        radius = np.clip(ahead / np.tan(abs(left) / 2), *(turn["radius"] * np.array([0.8, 1.6])))
        if abs(left) < 0.01 or left * turn["th"] <= 0:
            return straight(t)
        rate = np.sign(left) * speed / radius
        turning = min(t - before, abs(left / rate))
        self.on_arc = self.on_arc or turning > 0
        return straight(t - before - turning) @ arc(rate, turning) @ straight(before)

    def expected(self):
        return [(1.0, self.x, self.p + self.extra)]

    def widen(self, extra, is_likely):
        self.extra = self.extra + extra
        self.guarded = True

    def correct(self, z, r):
        if self._detects(z, r):
            if self.near:
                self._straighten()
                self.deviates = True
            self.near, self.manoeuvre, self.start = False, True, []
            self.length, self.distances, self.sides = self.SHORT, [], []
        elif self.near:
            self.length, self.manoeuvre = self.TURN, False
            if len(self.plots) >= self.SHORT:
                self.start = []
        else:
            self.length = min(self.length + 1, self.LONG)
            self.manoeuvre = self.manoeuvre and self.length <= 2 * self.SHORT
            self.deviates = self.deviates and self.manoeuvre
        self.plots.append([z, r, np.eye(4), 0.0, self.near])
        while len(self.plots) > self.length or (
            len(self.plots) > self.SHORT and self.plots[0][4] and not self.near
        ):
            del self.plots[0]
            self.start = []
        self._fit()
        self.gap, self.guarded = 0.0, False

    def _straighten(self):
        self.on_arc = False
        for past in self.plots:
            past[2], past[4] = straight(past[3]), False

    def _detects(self, z, r):
        expected = self.p + (0.25 * self.extra if self.near else 0.0)
        y = z - self.x[:2]
        d = y @ np.linalg.solve(expected[:2, :2] + r, y)
        ahead, left = self.x[2:] @ y, flightplan.cross(self.x[2:], y)
        aside = d > GATES[0.65] and abs(left) > abs(ahead)
        self.distances = [*self.distances, d][-3:]
        self.sides = [*self.sides, np.sign(left) if aside else 0.0][-4:]
        return (
            self.guarded
            or d > GATES[0.998]
            or sum(past > GATES[0.95] for past in self.distances) >= 2
            or (len(self.distances) == 3 and sum(self.distances) > SUM)
            or abs(sum(self.sides)) == 4
        )

    def _fit(self):
        """Whitened equations for the state now, about the last plot."""
        origin = np.append(self.plots[-1][0], [0.0, 0.0])
        matrices, values = [], []
        for z, r, since, *_ in self.plots:
            white_root = np.linalg.inv(np.linalg.cholesky(r))
            matrices.append(white_root @ np.linalg.inv(since)[:2])
            values.append(white_root @ (z - origin[:2]))
        for x, p, since in self.start:
            white_root = np.linalg.inv(np.linalg.cholesky(p))
            matrices.append(white_root @ np.linalg.inv(since))
            values.append(white_root @ (x - origin))
        q, root = np.linalg.qr(np.concatenate(matrices))
        inverse = np.linalg.inv(root)
        self.x = origin + inverse @ (q.T @ np.concatenate(values))
        self.p, self.extra = inverse @ inverse.T, np.zeros((4, 4))

    def watch(self):
        """Where along the plan it is; a plan that is followed is never blocked."""
        if self.plan is None:
            return
        speed = np.hypot(*self.x[2:])
        self.speeds.append((self.time, speed))
        planned = flightplan.turn(*self.plan, self.plan_speed)
        s, offset = flightplan.project(planned, self.x[:2])
        room = 2 * speed * self.radar.scan_period
        end = planned["arc"] + 0.4 * planned["lead"] + room
        left = flightplan.wrap(flightplan.course(planned["u2"]) - flightplan.course(self.x[2:]))
        if s > end or (s > planned["arc"] and abs(left) < np.radians(4) and offset < 1500):
            self.plan = None
        self.zone = self.plan is not None and -(0.7 * planned["lead"] + room) < s < end

    def saw(self, y, s, left):
        """All targets are alike."""

    def shown(self):
        return self.estimate()

    def estimate(self):
        return self.x, self.p + self.extra, float(self.manoeuvre or self.on_arc)


def followed(times, positions, radar, begin, guard_acceleration, *, speed_max=350.0):
    """Estimates after each plot, and whether it was in the guard gate.

    The third plot confirms the track; `begin` then makes its model, or before, as soon as the
    velocity is known if the model has turns. Times are multiples of the period, from which plots
    may be missing.
    """
    x = np.array([*positions[0], 0.0, 0.0])
    p = np.zeros((4, 4))
    p[:2, :2] = noise(positions[0], radar)
    p[2, 2] = p[3, 3] = (speed_max / 2) ** 2
    model = Straight(x, p, radar, 1.0)
    found = [(*model.estimate(), False)]
    for k in range(1, len(times)):
        gap = times[k] - times[k - 1]
        missed = round(gap / radar.scan_period) - 1
        for _ in range(missed):
            model.predict(radar.scan_period)
            model.watch()
        model.predict(gap - missed * radar.scan_period)
        is_beyond = distance(model, positions[k], radar) > GATES[0.998]
        extra = unnoticed(guard_acceleration, gap)
        _, before, _ = model.estimate()
        if is_beyond:
            probability = accelerated(model, positions[k], radar, extra)
            model.widen(probability * extra, probability >= 0.5)
        mean, wide, _ = model.estimate()
        r = noise(mean[:2], radar)
        model.correct(positions[k], r)
        if k > 2:
            left = np.trace(model.estimate()[1][:2, :2]) / np.trace(wide[:2, :2])
            model.saw(positions[k] - mean[:2], before[:2, :2] + r, min(left, 1.0))
        model.watch()
        if isinstance(model, Straight) and k <= 2:
            own = begin(model.x, model.p, radar)
            is_known = np.trace(model.p[2:, 2:]) / 2 < (0.25 * speed_max) ** 2
            if k == 2 or (is_known and isinstance(own, Multiple)):
                model = own
        found.append((*model.shown(), is_beyond))
    return tuple(np.array(column) for column in zip(*found, strict=True))


def accelerated(model, z, radar, extra):
    """Probability of an acceleration, one scan in twenty, and not of a large error of the plot."""
    if isinstance(model, Window):
        return 1.0
    x, p, _ = model.estimate()
    r = noise(x[:2], radar)
    usual = sum(
        share * density(z - y[:2], q[:2, :2] + r)
        for share, y, q in model.expected()
        if share > 0.005
    )
    wide = 0.05 * density(z - x[:2], (p + extra)[:2, :2] + r)
    return wide / (wide + usual)


def density(y, s):
    """Of a normal distribution in the plane."""
    return np.exp(-0.5 * y @ np.linalg.solve(s, y)) / (2 * np.pi * np.sqrt(np.linalg.det(s)))


def distance(model, z, radar):
    """Distance squared of a plot from the nearest model that counts."""
    r = noise(model.estimate()[0][:2], radar)
    counting = [(x, p) for share, x, p in model.expected() if share > 0.005]
    return min((z - x[:2]) @ np.linalg.solve(p[:2, :2] + r, z - x[:2]) for x, p in counting)
