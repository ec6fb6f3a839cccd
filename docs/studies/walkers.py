"""Velocities of walkers who turn and stop: tables of docs/trajectory.md and docs/smoothing.md."""

from dataclasses import dataclass

import numpy as np

from studies.montecarlo import FloatArray, generator, in_region
from studies.pages import markdown, repetitions
from tertia.location import Station
from tertia.smoothing import smooth
from tertia.trajectory import reconstruct

RUNS, INSTANTS = repetitions(20, 1), repetitions(150, 20)
# of smoothed paths, which take far less time
PATHS = repetitions(60, 10)
STEP, SPEED, TURN_RATE, STARTING = 0.1, 1.3, 0.9, 0.6
# mean seconds until a walker stops, and of a rest
WALK, REST = 40.0, 15.0
SIGMA = 3.0


@dataclass(frozen=True)
class Walker:
    """How often a walker takes a corner in seconds, and how the rate of the course wanders."""

    corner: float = 25.0
    stops: bool = False
    wander: float = 0.1
    kept: float = 4.0

    def walk(self, interval: float, count: int, runs: int, rng: np.random.Generator) -> FloatArray:
        """Return positions and velocities at instants, (instants, runs, 2, 2)."""
        every = round(interval / STEP)
        course, rate = rng.uniform(0, 2 * np.pi, runs), np.zeros(runs)
        speed, wanted = np.full(runs, SPEED), np.full(runs, SPEED)
        left, side, position = np.zeros(runs), np.ones(runs), np.zeros((runs, 2))
        states = []
        for at in range(every * count):
            velocity = speed[:, np.newaxis] * np.column_stack([np.sin(course), np.cos(course)])
            if at % every == 0:
                states.append(np.stack([position, velocity], axis=1))
            position = position + STEP * velocity
            push = np.sqrt(2 * STEP / self.kept) * rng.standard_normal(runs)
            rate += -rate * STEP / self.kept + self.wander * push
            begins = (left <= 0) & (rng.random(runs) < STEP / self.corner)
            left = np.where(begins, np.radians(rng.uniform(30, 120, runs)), left)
            side = np.where(begins, rng.choice([-1.0, 1.0], runs), side)
            course = course + STEP * (rate + TURN_RATE * side * (left > 0))
            left = left - STEP * TURN_RATE
            if self.stops:
                changes = rng.random(runs) < STEP / np.where(wanted > 0, WALK, REST)
                wanted = np.where(changes, SPEED - wanted, wanted)
            speed = speed + STEP / STARTING * (wanted - speed)
        return np.array(states)


def walk(
    rng: np.random.Generator, count: int, step: float, room: FloatArray, bend: float = 0.15
) -> FloatArray:
    """Return a walk, (count, 2), from the middle of a room, that turns at the walls."""
    course, place, way = rng.uniform(0, 2 * np.pi), room / 2, []
    for _ in range(count):
        course += bend * rng.standard_normal()
        ahead = place + step * np.array([np.sin(course), np.cos(course)])
        if np.all((ahead > 0) & (ahead < room)):
            place = ahead
        else:
            course += np.pi / 2
        way.append(place)
    return np.array(way)


def reconstructed() -> str:
    """Tabulate errors and coverage of paths from ranges, by interval and sigma."""
    rows = []
    for interval in (2.0, 5.0, 10.0, 30.0, 60.0):
        row = [f"{interval:g} s"]
        for sigma in (SIGMA, 10.0):
            rng = generator(631, round(interval), round(sigma))
            states = Walker(stops=True).walk(interval, INSTANTS, RUNS, rng)
            cells = np.array([_path(one, interval, sigma, rng) for one in states.swapaxes(0, 1)])
            rmse = np.sqrt(np.mean(cells[:, 0], axis=0))
            share = np.mean(cells[:, 1], axis=0)
            row += [f"{rmse[0]:.1f} m; {share[0]:.0%}", f"{rmse[1]:.2f} m/s; {share[1]:.0%}"]
        rows.append(row)
    head = [f"{kind}, σ = {s:g} m" for s in (SIGMA, 10.0) for kind in ("positions", "velocities")]
    return markdown(["interval", *head], rows)


def _path(
    states: FloatArray, interval: float, sigma: float, rng: np.random.Generator
) -> tuple[list[float], list[float]]:
    """Return mean squared errors and shares inside, of positions and velocities from 5 ranges."""
    way, turn = states[:, 0], 2 * np.pi * np.arange(5) / 5
    reach = 50.0 + 0.7 * np.max(np.ptp(way, axis=0))
    places = way.mean(axis=0) + reach * np.column_stack([np.sin(turn), np.cos(turn)])
    ranges = np.linalg.norm(way[:, np.newaxis] - places, axis=-1)
    ranges += sigma * rng.standard_normal(ranges.shape)
    stations = [Station(place, range_sigma=sigma) for place in places]
    track = reconstruct(stations, interval * np.arange(len(way)), range=np.abs(ranges))
    square, share = [], []
    for at, found in enumerate((track.position, track.velocity)):
        error, part = found - states[:, at], slice(2 * at, 2 * at + 2)
        square.append(float(np.mean(np.sum(error**2, axis=1))))
        share.append(float(np.mean(in_region(error, track.covariance[:, part, part]))))
    return square, share


WALKERS = {
    "stops": Walker(stops=True),
    "turns every 10 s": Walker(corner=10.0),
    "wanders": Walker(wander=0.3, kept=3.0),
}


def smoothed() -> str:
    """Tabulate the coverage of smoothed paths, by whether they are taken for random positions."""
    rows = []
    for number, (name, walker) in enumerate(WALKERS.items()):
        for interval in (1.0, 5.0, 10.0, 30.0):
            rng = generator(632, number, round(interval))
            states = walker.walk(interval, INSTANTS, PATHS, rng).swapaxes(0, 1)
            way, velocity = states[:, :, 0], states[:, :, 1]
            y = way + SIGMA * rng.standard_normal(way.shape)
            found = smooth(y, SIGMA**2, dt=interval)
            held = in_region(found.velocity - velocity, found.velocity_covariance)
            is_random = np.asarray(found.diffusion) > 0
            places = in_region(found.position - way, found.position_covariance)
            parts = [held[mask].mean() if mask.any() else None for mask in (~is_random, is_random)]
            shares = (places.mean(), is_random.mean(), *parts)
            cells = ["–" if one is None else f"{one:.0%}" for one in shares]
            rows.append([name, f"{interval:g} s", *cells])
    head = ["walker", "interval", "positions inside", "random position", "velocities inside, else"]
    return markdown([*head, "random position: velocities inside"], rows)
