"""Positions and clocks from arrival times, as one dense problem.

    t = T_e + |p_e - s_h| / c + o_h(t) + m_bh + error, error of Student's distribution, nu = 3

in metres of propagation at the given speed. Intensities are given; the scale of the errors is
estimated by expectation maximisation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
NU = 3.0


@dataclass
class Scene:
    """Arrivals (n,) and what is known; each emission is at a beacon's site or moves (-1)."""

    sites: Array
    site_sigma: Array
    time: Array
    sensor: npt.NDArray[np.int64]
    emission: npt.NDArray[np.int64]
    beacon: npt.NDArray[np.int64]
    node: Array
    speed: float
    speed_sigma: float
    path_sigma: float
    clock_drift: float
    jerk: float
    receivers: int


class Problem:
    """Columns: emissions, motion (3 D each), clocks (M, K - 1), slowness, sites, paths."""

    def __init__(self, scene: Scene, emitted: Array, position: Array, clock: Array) -> None:
        s = self.scene = scene
        self.d = s.sites.shape[1]
        self.moving = np.flatnonzero(s.beacon < 0)
        pairs = {(s.beacon[e], h) for e, h in zip(s.emission, s.sensor, strict=True)}
        self.pairs = sorted((int(b), int(h)) for b, h in pairs if b >= 0)
        self.known = s.site_sigma > 0
        sizes = [len(s.beacon), 3 * self.d * len(self.moving), len(s.node) * (s.receivers - 1), 1]
        sizes += [self.d * int(self.known.sum()), len(self.pairs)]
        self.at = np.concatenate([[0], np.cumsum(sizes)])
        self.x = np.zeros(self.at[-1])
        self.x[: self.at[1]] = emitted * s.speed
        motion = self.x[self.at[1] : self.at[2]].reshape(len(self.moving), 3, self.d)
        motion[:, 0] = position[self.moving]
        self.x[self.at[2] : self.at[3]] = np.tile(clock[1:] * s.speed, len(s.node))
        self.x[self.at[3]] = 1.0
        self.x[self.at[4] : self.at[5]] = s.sites[self.known].ravel()

    def rows(self) -> tuple[Array, Array]:
        """Residuals of the arrivals and derivatives of what is expected."""
        s, d, x, at = self.scene, self.d, self.x, self.at
        sites = s.sites.copy()
        sites[self.known] = x[at[4] : at[5]].reshape(-1, d)
        column = np.where(self.known, at[4] + d * (np.cumsum(self.known) - 1), -1)
        residual, derivative = np.zeros(len(s.time)), np.zeros((len(s.time), len(x)))
        rough = [self.rough(h) for h in range(s.receivers)]
        for i, (t, h, e) in enumerate(zip(s.time, s.sensor, s.emission, strict=True)):
            b, row = s.beacon[e], derivative[i]
            own = at[1] + 3 * d * int(np.searchsorted(self.moving, e))
            place = sites[b] if b >= 0 else x[own : own + d]
            source = column[b] if b >= 0 else own
            offset = place - sites[h]
            distance = float(np.linalg.norm(offset))
            row[e] = 1.0
            for first, sign in ((source, 1.0), (column[h], -1.0)):
                if first >= 0 and distance > 0:
                    row[first : first + d] += sign * x[at[3]] * offset / distance
            row[at[3]] = distance
            if h > 0:
                m = min(max(int(np.searchsorted(s.node, t - rough[h])) - 1, 0), len(s.node) - 2)
                share = (t - rough[h] - s.node[m]) / (s.node[m + 1] - s.node[m])
                for node, weight in ((m, 1 - share), (m + 1, share)):
                    row[at[2] + node * (s.receivers - 1) + h - 1] = weight
            if b >= 0:
                row[at[5] + self.pairs.index((int(b), int(h)))] = 1.0
            expected = x[e] + x[at[3]] * distance + row[at[2] : at[3]] @ x[at[2] : at[3]]
            residual[i] = t * s.speed - expected - row[at[5] :] @ x[at[5] :]
        return residual, derivative

    def rough(self, h: int) -> float:
        """Offset of a clock, to find the nodes about an arrival."""
        k = self.scene.receivers - 1
        return float(np.mean(self.x[self.at[2] + h - 1 : self.at[3] : k])) / self.scene.speed

    def priors(self) -> tuple[Array, Array]:
        """Residuals and derivatives of the priors, in standard deviations."""
        s, d, x, at = self.scene, self.d, self.x, self.at
        rows: list[Array] = []
        wanted: list[float] = []

        def add(columns: Any, values: Any, target: float) -> None:
            row = np.zeros(len(x))
            row[columns] = values
            rows.append(row)
            wanted.append(target)

        add(at[3], s.speed / s.speed_sigma, s.speed / s.speed_sigma)
        for i, (site, sigma) in enumerate(
            zip(s.sites[self.known], s.site_sigma[self.known], strict=True)
        ):
            for j in range(d):
                add(at[4] + d * i + j, 1 / sigma, site[j] / sigma)
        for i in range(len(self.pairs)):
            add(at[5] + i, 1 / (s.path_sigma * s.speed), 0.0)
        step = np.diff(s.node)
        for h in range(s.receivers - 1):
            for m in range(len(s.node) - 2):
                columns = at[2] + (m + np.arange(3)) * (s.receivers - 1) + h
                spread = s.clock_drift * s.speed * np.sqrt(0.5 * (step[m] + step[m + 1]))
                a, b = 1 / step[m], 1 / step[m + 1]
                add(columns, np.array([a, -a - b, b]) / spread, 0.0)
        for i in range(1, len(self.moving)):
            dt = (x[self.moving[i]] - x[self.moving[i - 1]]) / s.speed
            # white jerk: N Q N with N = diag(dt^5/2, dt^3/2, dt^1/2)
            unit = np.array([[1 / 20, 1 / 8, 1 / 6], [1 / 8, 1 / 3, 1 / 2], [1 / 6, 1 / 2, 1]])
            root = np.linalg.cholesky(np.linalg.inv(unit)).T / dt ** np.array([2.5, 1.5, 0.5])
            root /= np.sqrt(s.jerk)
            transition = np.array([[1, dt, dt * dt / 2], [0, 1, dt], [0, 0, 1]])
            for j in range(d):
                here = at[1] + 3 * d * i + j + d * np.arange(3)
                for row in root:
                    values = np.concatenate([row, -row @ transition])
                    add(np.concatenate([here, here - 3 * d]), values, 0.0)
        derivative = np.array(rows)
        return np.array(wanted) - derivative @ x, derivative

    def solve(self, iterations: int = 60) -> tuple[Array, Array, float]:
        """Return the unknowns, their covariance, and the standard deviation of an arrival."""
        scale, free = 10.0, 1.0
        residual, rows = self.rows()
        for _ in range(iterations):
            off, prior = self.priors()
            weight = (NU + 1) / (NU * scale**2 + residual**2)
            slope = weight * (NU * scale**2 - residual**2) / (NU * scale**2 + residual**2)
            information = max(np.mean(slope), 0) ** 2 / np.mean((weight * residual) ** 2) * free
            student = (NU + 1) / (NU + 3) / scale**2
            information = float(np.clip(information, 0.3 * student, 1.5 * student))
            scaled = rows * (weight * information / np.mean(weight))[:, np.newaxis]
            normal = rows.T @ scaled + prior.T @ prior
            covariance = np.linalg.inv(normal)
            self.x = self.x + 0.75 * covariance @ (rows.T @ (weight * residual) + prior.T @ off)
            residual, rows = self.rows()
            bound = len(self.x) - np.trace(prior.T @ prior @ covariance)
            free = 1 - bound / len(residual)
            square = (NU + 1) * scale**2 * residual**2 / (NU * scale**2 + residual**2)
            scale = float(np.sqrt(np.sum(square) / len(residual) / free))
        return self.x, covariance, float(information**-0.5)
