"""Ships and vehicles that give several plots in a scan: docs/tracker.md."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from studies.montecarlo import generator, in_region
from studies.pages import markdown, repetitions
from tertia._arrays import FloatArray, IntArray
from tertia.sensors import Bias, PositionSensor, Radar
from tertia.tracker import Plots, TrackTable, track

SCENES = repetitions(10)
DETECTED, MOST, WIDTH = 0.95, 8, 0.15
HARBOUR = Radar(
    range_sigma=7.0,
    azimuth_sigma=0.2,
    scan_period=2.5,
    max_range=16e3,
    detection_probability=DETECTED,
    bias=Bias(),
    degrees=True,
)
LIDAR = PositionSensor(update_interval=0.1, detection_probability=DETECTED, bias=Bias())
LENGTH, SCANS, FALSE = 300.0, 200, 10
CAR, CAR_WIDTH, LANE, FRAMES, SIGMA = 4.5, 1.8, 3.5, 200, 0.2


@dataclass(frozen=True)
class Targets:
    """Targets on straight courses: their lengths and widths, places at first, and velocities."""

    length: FloatArray
    width: FloatArray
    start: FloatArray
    velocity: FloatArray

    def at(self, target: IntArray, time: FloatArray) -> FloatArray:
        """Return the centres of targets, (N, 2)."""
        return self.start[target] + self.velocity[target] * time[:, np.newaxis]

    def parts(
        self, target: IntArray, seen: tuple[float, float], random: np.random.Generator
    ) -> FloatArray:
        """Return random parts of targets, relative to their centres, (N, 2)."""
        along = self.velocity / np.linalg.norm(self.velocity, axis=1, keepdims=True)
        forward = random.uniform(*seen, len(target)) * self.length[target]
        aside = random.uniform(-0.5, 0.5, len(target)) * self.width[target]
        across = along[target, ::-1] * np.array([1.0, -1.0])
        part: FloatArray = forward[:, np.newaxis] * along[target] + aside[:, np.newaxis] * across
        return part


def ships(random: np.random.Generator) -> Targets:
    """Return ten ships in open water."""
    angle, distance = random.uniform(0, 2 * np.pi, 10), random.uniform(2e3, 12e3, 10)
    course, speed = random.uniform(0, 2 * np.pi, 10), random.uniform(2.0, 11.0, 10)
    length = random.uniform(40.0, LENGTH, 10)
    start, velocity = (
        size[:, np.newaxis] * np.column_stack([np.sin(way), np.cos(way)])
        for size, way in ((distance, angle), (speed, course))
    )
    return Targets(length, WIDTH * length, start, velocity)


def lanes(random: np.random.Generator) -> Targets:
    """Return twelve ships in two lanes 300 m apart, which pass each other."""
    number = np.arange(12)
    way = np.where(number % 2, -1.0, 1.0)
    east = -4500.0 + 1500.0 * (number // 2 + random.uniform(0.2, 0.8, 12))
    start = np.column_stack([east, 3000.0 + 300.0 * (number % 2)])
    velocity = np.column_stack([way * random.uniform(3.0, 8.0, 12), np.zeros(12)])
    length = random.uniform(20.0, 250.0, 12)
    return Targets(length, WIDTH * length, start, velocity)


def cars(random: np.random.Generator) -> Targets:
    """Return ten cars in four lanes, two in each direction."""
    number = np.arange(10)
    lane, way = number % 4, np.where(number % 4 < 2, 1.0, -1.0)
    east = way * (45.0 * (number // 4) - 150.0) + random.uniform(-8.0, 8.0, 10)
    speed = 9.0 + 2.0 * lane + random.uniform(-0.4, 0.4, 10)
    start = np.column_stack([east, 5.0 + LANE * lane])
    velocity = np.column_stack([way * speed, np.zeros(10)])
    return Targets(np.full(10, CAR), np.full(10, CAR_WIDTH), start, velocity)


def by_radar(
    targets: Targets, seen: tuple[float, float], random: np.random.Generator
) -> tuple[Plots, IntArray]:
    """Return the plots of the harbour radar and their targets; -1 for false plots."""
    target, scan = np.nonzero(random.random((len(targets.length), SCANS)) < DETECTED)
    count = np.minimum(1 + random.poisson(targets.length[target] / 60.0), MOST)
    target, scan = np.repeat(target, count), np.repeat(scan, count)
    period = HARBOUR.scan_period
    part, time = targets.parts(target, seen, random), period * scan.astype(np.float64)
    for _ in range(3):
        place = targets.at(target, time) + part
        azimuth = np.arctan2(*place.T) % (2 * np.pi)
        time = period * (scan + azimuth / (2 * np.pi))
    false = np.repeat(np.arange(SCANS), random.poisson(FALSE, SCANS))
    angle, free = random.uniform(0, 2 * np.pi, len(false)), random.uniform(size=len(false))
    errors = random.standard_normal((2, len(place)))
    plots = np.column_stack(
        [
            np.append(time, period * (false + angle / (2 * np.pi))),
            np.append(np.hypot(*place.T) + HARBOUR.range_sigma * errors[0], 15e3 * np.sqrt(free)),
            np.append(azimuth + HARBOUR.azimuth_sigma * errors[1], angle),
        ]
    )
    order = np.argsort(plots[:, 0], kind="stable")
    owner = np.append(target, np.full(len(false), -1))
    return Plots(*plots[order].T), owner[order]


def by_lidar(
    targets: Targets, seen: tuple[float, float], random: np.random.Generator
) -> tuple[Plots, IntArray]:
    """Return the positions that the lidar reports and their targets."""
    frame, target = np.nonzero(random.random((FRAMES, len(targets.length))) < DETECTED)
    count = random.integers(1, 7, len(frame))
    frame, target = np.repeat(frame, count), np.repeat(target, count)
    time = LIDAR.update_interval * frame.astype(np.float64)
    place = targets.at(target, time) + targets.parts(target, seen, random)
    place = place + SIGMA * random.standard_normal(place.shape)
    covariance = np.broadcast_to(SIGMA**2 * np.eye(2), (len(place), 2, 2))
    return Plots(time, position=place, covariance=covariance), target


def judged(table: TrackTable, owner: IntArray, targets: Targets) -> tuple[float, FloatArray]:
    """Return the number of tracks per target; errors squared and whether they are within 95 %."""
    results, count = [], 0
    for number in np.unique(table.track):
        rows = table[table.track == number]
        target = np.bincount(owner[rows.plot[rows.plot >= 0]] + 1).argmax() - 1
        count += 1
        if target >= 0:
            error = rows.position - targets.at(np.full(len(rows), target), rows.time)
            inside = in_region(error, rows.covariance[:, :2, :2])
            results.append(np.column_stack([np.sum(error**2, axis=1), inside]))
    return count / len(targets.length), np.concatenate(results)


ROWS: dict[str, tuple[Callable[[np.random.Generator], Targets], tuple[float, float]]] = {
    "ten ships of 40 to 300 m": (ships, (-0.5, 0.5)),
    "the same, only the aft parts reflect": (ships, (-0.5, -0.1)),
    "twelve ships of 20 to 250 m, in lanes 300 m apart": (lanes, (-0.5, 0.5)),
    "ten cars of 4.5 m": (cars, (-0.5, 0.5)),
}


def table() -> str:
    """Tabulate tracks of targets that give several plots in a scan."""
    rows = []
    for name, (scene, seen) in ROWS.items():
        is_road = scene is cars
        found: dict[float, list[tuple[float, FloatArray]]] = {}
        for run in range(SCENES):
            random = generator(7300, run)
            targets = scene(random)
            plots, owner = (by_lidar if is_road else by_radar)(targets, seen, random)
            for extent in (0.0, 5.0 if is_road else LENGTH):
                sensor = replace(LIDAR if is_road else HARBOUR, target_extent=extent)
                with warnings.catch_warnings():
                    # that extents should be stated
                    warnings.simplefilter("ignore", UserWarning)
                    tracks = track(plots, [sensor], profile="road" if is_road else "vessel")
                found.setdefault(extent, []).append(judged(tracks, owner, targets))
        for extent, results in found.items():
            squares, within = np.concatenate([one for _, one in results]).T
            count, rmse = np.mean([count for count, _ in results]), np.sqrt(np.mean(squares))
            stated = f"{extent:g} m" if extent else "not stated"
            rows.append([name, stated, f"{count:.2f}", f"{rmse:.1f} m", f"{np.mean(within):.0%}"])
    head = ["targets", "`target_extent`", "tracks per target", "RMSE of the centre"]
    return markdown([*head, "centres within 95 %"], rows)
