"""Figures of docs/position-sensors.md."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from studies.pages import markdown, repetitions
from tertia._arrays import FloatArray, IntArray
from tertia.metrics import nees
from tertia.sensors import Bias, PositionSensor, Radar, Station
from tertia.tracker import CvModel, Motion, Plots, track

SCENES = repetitions(20, 1)
FLIGHTS, CLUTTER = repetitions(20, 8), 20
# seconds: of a scene, and of its beginning, which is left out
DURATION, SETTLED = 240.0, 60.0
STEP = 0.25
STEPS = int((DURATION + 5.0) / STEP)
# where flights begin, m, and how fast
AREA, SPEED, FASTEST = 60e3, 200.0, 350.0
# acceleration, m/s2, for scans of so many seconds
SIGMA, PACE = 0.3, 4.0
RADAR = Radar(
    (-70e3, 0.0),
    range_sigma=50.0,
    azimuth_sigma=0.0014,
    scan_period=4.0,
    max_range=300e3,
    bias=Bias(),
)
MULTILATERATION = PositionSensor(update_interval=1.0, detection_probability=0.9, bias=Bias())
ADSB = PositionSensor(update_interval=2.0, detection_probability=0.95, bias=Bias())
# a camera looks round once a second
CAMERA = Station((10e3, -20e3), azimuth_sigma=0.02, degrees=True)
FRAME, SEEN, FALSE = 1.0, 0.9, 3
SENSORS: dict[str, Radar | PositionSensor | Station] = {
    "radar": RADAR,
    "multilateration": MULTILATERATION,
    "ADS-B": ADSB,
    "camera": CAMERA,
}
REPORTING = {1: MULTILATERATION, 2: ADSB}
# least and largest standard deviation of a report in m, one for each
SPREADS = {1: (20.0, 60.0), 2: (15.0, 40.0)}
CORRELATION = 0.5


@dataclass(frozen=True)
class Scene:
    """States of the targets at each step, plots of all sensors, and whose they are; -1: none."""

    states: FloatArray
    plots: Plots
    target: IntArray

    def truth(self, target: IntArray, time: FloatArray) -> FloatArray:
        """Return positions and velocities, (N, 4)."""
        at = np.minimum((time / STEP).astype(np.int64), self.states.shape[1] - 2)
        share = (time / STEP - at)[:, np.newaxis]
        before, after = self.states[target, at], self.states[target, at + 1]
        return np.asarray((1.0 - share) * before + share * after)


def flights(random: np.random.Generator) -> FloatArray:
    """Return states of targets whose accelerations are those of the model, (flights, steps, 4)."""
    course = random.uniform(0.0, 2.0 * np.pi, FLIGHTS)
    start = SPEED * np.column_stack([np.sin(course), np.cos(course)])
    steps = random.normal(0.0, SIGMA * np.sqrt(PACE * STEP), (FLIGHTS, STEPS, 2))
    velocity = start[:, np.newaxis] + np.cumsum(steps, axis=1)
    position = random.uniform(-AREA, AREA, (FLIGHTS, 1, 2)) + STEP * np.cumsum(velocity, axis=1)
    return np.concatenate([position, velocity], axis=2)


def _times(
    interval: float, detected: float, random: np.random.Generator
) -> tuple[FloatArray, IntArray]:
    """Return when a sensor sees which targets."""
    count = int(DURATION / interval)
    time = random.uniform(0.0, interval, (FLIGHTS, 1)) + interval * np.arange(count)
    seen = np.asarray(random.random(time.shape) < detected)
    return time[seen], np.nonzero(seen)[0]


def scene(seed: int) -> Scene:
    """Simulate a radar and a camera with false plots, multilateration and ADS-B."""
    random = np.random.default_rng([41, seed])
    empty = Scene(flights(random), Plots([]), np.empty(0, np.int64))
    time, target = _times(RADAR.scan_period, RADAR.detection_probability, random)
    east, north = (empty.truth(target, time)[:, :2] - RADAR.position).T
    false = int(CLUTTER * DURATION / RADAR.scan_period)
    random_range = RADAR.max_range * np.sqrt(random.random(false))
    distance = np.append(
        np.hypot(east, north) + random.normal(0.0, RADAR.range_sigma, len(time)), random_range
    )
    azimuth = np.append(
        np.arctan2(east, north) + random.normal(0.0, RADAR.azimuth_sigma, len(time)),
        random.uniform(-np.pi, np.pi, false),
    )
    times, targets = (
        [np.append(time, random.uniform(0.0, DURATION, false))],
        [np.append(target, np.full(false, -1))],
    )
    positions = [np.full((len(distance), 2), np.nan)]
    covariances = [np.full((len(distance), 2, 2), np.nan)]
    for k, spread in SPREADS.items():
        one = REPORTING[k]
        time, target = _times(one.update_interval, one.detection_probability, random)
        sigma = random.uniform(*spread, (len(time), 2))
        covariance = sigma[:, :, np.newaxis] * sigma[:, np.newaxis]
        covariance[:, [0, 1], [1, 0]] *= CORRELATION
        noise = np.linalg.cholesky(covariance) @ random.normal(size=(len(time), 2, 1))
        times.append(time)
        targets.append(target)
        positions.append(empty.truth(target, time)[:, :2] + noise[..., 0])
        covariances.append(covariance)
    time, target, seen = _seen_by_camera(empty, random)
    times, targets = [*times, time], [*targets, target]
    nothing = np.full(sum(map(len, times[1:])), np.nan)
    azimuth = np.append(azimuth, nothing)
    azimuth[len(azimuth) - len(seen) :] = seen
    nowhere = np.full((len(seen), 2), np.nan)
    plots = Plots(
        np.concatenate(times),
        np.append(distance, nothing),
        azimuth,
        sensor=np.repeat(np.arange(len(SENSORS)), list(map(len, times))),
        position=np.concatenate([*positions, nowhere]),
        covariance=np.concatenate([*covariances, np.full((len(seen), 2, 2), np.nan)]),
    )
    return Scene(empty.states, plots, np.concatenate(targets))


def _seen_by_camera(
    one: Scene, random: np.random.Generator
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return times, targets and azimuths of a camera."""
    frames = np.arange(0.5 * FRAME, DURATION, FRAME)
    time = np.repeat(frames, FLIGHTS + FALSE)
    target = np.tile(np.append(np.arange(FLIGHTS), np.full(FALSE, -1)), len(frames))
    east, north = (one.truth(target, time)[:, :2] - CAMERA.position).T
    azimuth = np.arctan2(east, north) + random.normal(0.0, CAMERA.azimuth_sigma or 0.0, len(time))
    azimuth = np.where(target < 0, random.uniform(-np.pi, np.pi, len(time)), azimuth)
    seen = (target < 0) | (random.random(len(time)) < SEEN)
    return time[seen], target[seen], azimuth[seen]


def without(one: Scene, sensor: int) -> Scene:
    """Return what the other sensors see."""
    kept = one.plots.sensor != sensor
    return Scene(one.states, one.plots[kept], one.target[kept])


def tracked(one: Scene, motion: Motion) -> tuple[FloatArray, FloatArray, int]:
    """Return errors and normalised squares of the tracks, and their number."""
    table = track(one.plots, list(SENSORS.values()), motion=motion)
    count = len(np.unique(table.track))
    table = table[(table.plot >= 0) & (table.time > SETTLED)]
    own = one.target[table.plot]
    known = own >= 0
    truth = one.truth(own[known], table.time[known])
    error = np.hstack([table.position, table.velocity])[known] - truth
    return error, np.asarray(nees(error, table.covariance[known])), count


def central(one: Scene) -> tuple[FloatArray, FloatArray]:
    """Return errors and normalised squares of a Kalman filter for each target, of its own plots."""
    z, r = np.array(one.plots.position), np.array(one.plots.covariance)
    polar = np.flatnonzero(one.plots.sensor == 0)
    if len(polar):
        z[polar], r[polar] = one.plots[polar].to_cartesian([RADAR])
    errors, squares = [], []
    for own in range(FLIGHTS):
        rows = np.flatnonzero(one.target == own)
        rows = rows[np.argsort(one.plots.time[rows])]
        # an azimuth is no beginning
        rows = rows[np.argmax(np.isfinite(z[rows, 0])) :]
        times = one.plots.time[rows]
        speed = (0.5 * FASTEST) ** 2
        mean, covariance = np.append(z[rows[0]], [0.0, 0.0]), np.diag([0.0, 0.0, speed, speed])
        covariance[:2, :2] = r[rows[0]]
        states, matrices = [mean], [covariance]
        for row, t in zip(rows[1:], np.diff(times), strict=True):
            f = np.eye(4) + t * np.eye(4, k=2)
            q = np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]]) * SIGMA**2 * PACE
            mean, covariance = f @ mean, f @ covariance @ f.T + np.kron(q, np.eye(2))
            if one.plots.sensor[row] == len(SENSORS) - 1:
                h, y, noise = _seen(mean, float(one.plots.azimuth[row]))
            else:
                h, y, noise = np.eye(2, 4), z[row] - mean[:2], r[row]
            gain = covariance @ h.T @ np.linalg.inv(h @ covariance @ h.T + noise)
            mean = mean + gain @ y
            covariance = covariance - gain @ h @ covariance
            states.append(mean)
            matrices.append(covariance)
        late = times > SETTLED
        error = (np.array(states) - one.truth(np.full(len(times), own), times))[late]
        errors.append(error)
        squares.append(np.asarray(nees(error, np.array(matrices)[late])))
    return np.concatenate(errors), np.concatenate(squares)


def _seen(state: FloatArray, azimuth: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return derivative, innovation and noise of an azimuth of the camera."""
    east, north = state[:2] - CAMERA.position
    y = np.angle(np.exp(1j * (azimuth - np.arctan2(east, north))))
    h = np.array([[north, -east, 0.0, 0.0]]) / (east**2 + north**2)
    return h, np.array([y]), np.array([[(CAMERA.azimuth_sigma or 0.0) ** 2]])


def _rmse(errors: list[FloatArray]) -> float:
    position = np.concatenate(errors)[:, :2]
    return float(np.sqrt(np.mean(np.sum(position**2, axis=1))))


def mixed() -> str:
    """Return how good tracks of all sensors are, and of all but one."""
    scenes = [scene(seed) for seed in range(SCENES)]
    rows = []
    for name, left_out in {"none": -1, **{name: k for k, name in enumerate(SENSORS)}}.items():
        cases = [without(one, left_out) for one in scenes]
        best = [central(one) for one in cases]
        found = [tracked(one, CvModel(SIGMA)) for one in cases]
        free = [tracked(one, "imm") for one in cases]
        least, own = (_rmse([errors for errors, *_ in each]) for each in (best, found))
        squares = (np.concatenate([one[1] for one in each]) for each in (best, found, free))
        known, square, freely = (np.mean(one) / 4.0 for one in squares)
        rows.append(
            [
                name,
                f"{least:.1f} m",
                f"{own:.1f} m",
                f"{own / least:.3f}",
                f"{known:.2f}",
                f"{square:.2f}",
                f"{np.mean([count for *_, count in found]):.1f}",
                f"{_rmse([errors for errors, *_ in free]):.1f} m, {freely:.2f}",
            ]
        )
    head = ["sensor left out", "filter with known association", "tracker", "ratio"]
    head += ["NEES of the filter"]
    return markdown([*head, "NEES", f"tracks of {FLIGHTS}", 'motion "imm": RMSE, NEES'], rows)
