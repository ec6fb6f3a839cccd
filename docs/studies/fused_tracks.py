"""How far the error bars of fused tracks hold, by the kind of the sensors' trackers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from studies.honesty import HIGH, LOW
from studies.montecarlo import WITHIN_95
from studies.pages import markdown, repetitions
from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.metrics import nees
from tertia.sensors import Bias, Radar
from tertia.tertiary import SensorTracks, SystemTracks, fuse_tracks
from tertia.tracker import Plots, Tracker, track

SEED = 2027
# of each kind, and of those with few aircraft
SCENES, MANY = 1, repetitions(12, 1)
FLIGHTS, LENGTH = repetitions(14, 3), float(repetitions(420, 180))
STEP, WARM = 0.1, 90.0
COUNTS, FEW = (2, 3, 4), (1, 2, 5, 14)
DETECTION = 0.95
# the distance from which on it is another target
ASTRAY = 2500.0
PLACES = ((0.0, 0.0), (60e3, 20e3), (-20e3, 90e3), (70e3, 90e3))
# m, degrees, s
ACCURACY = ((75.0, 0.10, 6.0), (50.0, 0.08, 4.0), (100.0, 0.12, 10.0), (60.0, 0.07, 12.0))
FLOWN = ("straight", "turns", "accelerations")
# of the white acceleration that foreign filters assume, (m/s²)² s
DENSITY = 1.0


@dataclass(frozen=True)
class Flown:
    """Positions and velocities of flights, every `STEP`: (F, S, 2)."""

    position: FloatArray
    velocity: FloatArray

    def __len__(self) -> int:
        """Return the number of flights."""
        return len(self.position)

    def at(self, flight: IntArray, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities between the samples."""
        place = time / STEP
        low = np.clip(place.astype(int), 0, self.position.shape[1] - 2)
        share = (place - low)[:, np.newaxis]
        position, velocity = (
            (1 - share) * values[flight, low] + share * values[flight, low + 1]
            for values in (self.position, self.velocity)
        )
        return position, velocity


def flown(kind: str, count: int, rng: np.random.Generator) -> Flown:
    """Simulate flights, all at the same time."""
    steps = int(LENGTH / STEP) + 200
    rate, acceleration = np.zeros((2, count, steps))
    for k in range(count):
        begin = rng.uniform(60.0, 140.0)
        while kind != "straight" and begin < LENGTH:
            if kind == "turns":
                size = np.radians(rng.choice([1.0, 1.5, 3.0]))
                duration = rng.uniform(np.radians(40.0), np.radians(120.0)) / size
                own = slice(int(begin / STEP), int((begin + duration) / STEP))
                rate[k, own] = size * rng.choice([-1.0, 1.0])
            else:
                duration = rng.uniform(40.0, 80.0)
                own = slice(int(begin / STEP), int((begin + duration) / STEP))
                acceleration[k, own] = rng.choice([-0.5, 0.4, 0.8])
            begin += duration + rng.uniform(60.0, 150.0)
    course = rng.uniform(0, 2 * np.pi, (count, 1)) + np.cumsum(rate, axis=1) * STEP
    speed = rng.uniform(140.0, 240.0, (count, 1)) + np.cumsum(acceleration, axis=1) * STEP
    velocity = speed[..., np.newaxis] * np.stack([np.sin(course), np.cos(course)], axis=-1)
    way = np.cumsum(velocity, axis=1) * STEP
    middle = rng.uniform(-60e3, 60e3, (count, 2)) + np.array([25e3, 50e3])
    position = middle[:, np.newaxis] + way - way[:, steps // 2, np.newaxis]
    return Flown(position, velocity)


def sensors(count: int, bias: Bias | None = None) -> list[Radar]:
    """Return radars, of whose systematic errors this is stated, or nothing."""
    return [
        Radar(
            place,
            range_sigma=range_sigma,
            azimuth_sigma=azimuth_sigma,
            scan_period=period,
            max_range=300e3,
            detection_probability=DETECTION,
            bias=bias,
            degrees=True,
        )
        for place, (range_sigma, azimuth_sigma, period) in zip(
            PLACES[:count], ACCURACY[:count], strict=True
        )
    ]


@dataclass(frozen=True, eq=False)
class Seen:
    """Plots of one radar, flight by flight in order of time, with and without systematic errors."""

    flown: Flown
    time: FloatArray
    flight: IntArray
    range: FloatArray
    azimuth: FloatArray
    off: tuple[float, float]

    @property
    def position(self) -> FloatArray:
        """Positions relative to the radar, (N, 2)."""
        rho, azimuth = self.range + self.off[0], self.azimuth + self.off[1]
        return np.column_stack([rho * np.sin(azimuth), rho * np.cos(azimuth)])


def seen(of: Flown, radar: Radar, off: tuple[float, float], rng: np.random.Generator) -> Seen:
    """Simulate the plots of a radar."""
    scans = np.arange(0.0, LENGTH, radar.scan_period)
    time = rng.uniform(0.0, radar.scan_period, len(of))[:, np.newaxis] + scans
    flight = np.repeat(np.arange(len(of)), len(scans))
    kept = (rng.uniform(size=time.size) < DETECTION) & (time.ravel() < LENGTH)
    time, flight = time.ravel()[kept], flight[kept]
    offset = of.at(flight, time)[0] - np.asarray(radar.position)[:2]
    noise = rng.standard_normal((2, len(time)))
    rho = np.hypot(*offset.T) + radar.range_sigma * noise[0]
    return Seen(of, time, flight, rho, np.arctan2(*offset.T) + radar.azimuth_sigma * noise[1], off)


# a source makes tracks from the plots of a radar
Source = Callable[[Seen, Radar, int], SensorTracks]


def own_tracker(plots: Seen, radar: Radar, sensor: int) -> SensorTracks:
    """Return tracks of Tertia's own tracker."""
    order = np.argsort(plots.time, kind="stable")
    rho, azimuth = plots.range + plots.off[0], plots.azimuth + plots.off[1]
    sorted_ = Plots(plots.time[order], rho[order], azimuth[order])
    table = track(sorted_, [replace(radar, bias=Bias())])
    return SensorTracks.of(table, sensor=sensor)


def noise_of(radar: Radar, position: FloatArray) -> FloatArray:
    """Return covariances of plots, (N, 2, 2)."""
    rho = np.hypot(*position.T)
    e = position / rho[:, np.newaxis]
    f = np.column_stack([e[:, 1], -e[:, 0]])
    along = radar.range_sigma**2 * e[:, :, np.newaxis] * e[:, np.newaxis]
    across = ((rho * radar.azimuth_sigma) ** 2)[:, np.newaxis, np.newaxis]
    noise: FloatArray = along + across * f[:, :, np.newaxis] * f[:, np.newaxis]
    return noise


# state, covariance, interval, position and its covariance -> state and covariance
Step = Callable[
    [FloatArray, FloatArray, float, FloatArray, FloatArray], tuple[FloatArray, FloatArray]
]


@cache
def states_of(
    plots: Seen, radar: Radar, step: Step
) -> tuple[list[int], list[FloatArray], list[FloatArray]]:
    """Return rows, states and covariances of a filter that runs along each flight."""
    rows: list[int] = []
    states, covariances = [], []
    position = plots.position
    noise = noise_of(radar, position)
    for k in np.unique(plots.flight):
        first, second, *others = np.flatnonzero(plots.flight == k)
        t = plots.time[second] - plots.time[first]
        x = np.concatenate([position[second], (position[second] - position[first]) / t])
        r = noise[second]
        p = np.block([[r, r / t], [r / t, 2 * r / t**2]])
        last = plots.time[second]
        for i in others:
            x, p = step(x, p, plots.time[i] - last, position[i], noise[i])
            last = plots.time[i]
            rows.append(int(i))
            states.append(x)
            covariances.append(p)
    return rows, states, covariances


def filtered(
    plots: Seen, radar: Radar, sensor: int, step: Step, scale: float | None = 1.0
) -> SensorTracks:
    """Return tracks of a filter, their covariances times `scale`."""
    rows, states, covariances = states_of(plots, radar, step)
    state = np.array(states)
    return SensorTracks(
        plots.time[rows],
        sensor,
        plots.flight[rows] + 1,
        state[:, :2] + np.asarray(radar.position)[:2],
        state[:, 2:],
        covariance=None if scale is None else scale * np.array(covariances),
    )


def ahead(t: float, density: float) -> tuple[FloatArray, FloatArray]:
    """Return the transition and the noise of nearly constant velocity."""
    f, q = np.eye(4), np.diag([t**3 / 3, t**3 / 3, t, t])
    f[[0, 1], [2, 3]] = t
    q[[0, 1, 2, 3], [2, 3, 0, 1]] = t**2 / 2
    return f, density * q


@cache
def nearly_constant(density: float) -> Step:
    """Return the step of a Kalman filter of nearly constant velocity."""

    def step(
        x: FloatArray, p: FloatArray, t: float, z: FloatArray, r: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        f, q = ahead(t, density)
        x, p = f @ x, f @ p @ f.T + q
        gain = np.linalg.solve(p[:2, :2] + r, p[:2]).T
        return x + gain @ (z - x[:2]), p - gain @ p[:2]

    return step


def kalman(scale: float = 1.0, density: float = DENSITY) -> Source:
    """Return a source with filters of nearly constant velocity, their covariances times `scale`."""
    step = nearly_constant(density)
    return lambda plots, radar, sensor: filtered(plots, radar, sensor, step, scale)


def alpha_beta(alpha: float = 0.5, beta: float = 0.2, *, stated: bool = True) -> Source:
    """Return a source of α-β filters, which state one sigma of positions and one of velocities."""
    rest = alpha * (4 - 2 * alpha - beta)
    place = (2 * alpha**2 + 2 * beta - 3 * alpha * beta) / rest
    rate = 2 * beta**2 / rest

    def step(
        x: FloatArray, p: FloatArray, t: float, z: FloatArray, r: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        predicted = x[:2] + t * x[2:]
        y = z - predicted
        level = np.trace(r) / 2
        variance = np.repeat([place * level, rate * level / t**2], 2)
        return np.concatenate([predicted + alpha * y, x[2:] + beta / t * y]), np.diag(variance)

    scale = 1.0 if stated else None
    return lambda plots, radar, sensor: filtered(plots, radar, sensor, step, scale)


def periodic(interval: float = 4.0) -> Source:
    """Return a source of system tracks: all tracks every `interval`, with sigmas alone."""
    inner = kalman()

    def source(plots: Seen, radar: Radar, sensor: int) -> SensorTracks:
        found = inner(plots, radar, sensor)
        out: list[tuple[float, int, FloatArray, FloatArray]] = []
        for number in np.unique(found.track):
            own = found[found.track == number]
            for time in np.arange(np.ceil(own.time[0] / interval) * interval, LENGTH, interval):
                i = int(np.searchsorted(own.time, time, side="right")) - 1
                t = time - own.time[i]
                if t > 3 * radar.scan_period:
                    continue
                f, q = ahead(t, DENSITY)
                x = f @ np.concatenate([own.position[i], own.velocity[i]])
                p = f @ own.covariance[i] @ f.T + q
                out.append((time, number, x, np.diag(np.diag(p))))
        time, number, x, p = (np.array(column) for column in zip(*out, strict=True))
        return SensorTracks(time, sensor, number, x[:, :2], x[:, 2:], covariance=p)

    return source


def navigation(duration: float) -> Source:
    """Return a source of positions as accurate as plots, whose errors last, and of velocities."""

    def source(plots: Seen, radar: Radar, sensor: int) -> SensorTracks:
        rng = np.random.default_rng([SEED, 1, sensor, len(plots.time)])
        place = np.asarray(radar.position)[:2]
        position, velocity = plots.flown.at(plots.flight, plots.time)
        offset = position - place
        rho, azimuth = np.hypot(*offset.T) + plots.off[0], np.arctan2(*offset.T) + plots.off[1]
        noise = noise_of(radar, offset)
        fresh = rng.standard_normal(offset.shape)
        error = fresh.copy()
        for i in np.flatnonzero(np.diff(plots.flight) == 0) + 1:
            rest = np.exp((plots.time[i - 1] - plots.time[i]) / duration)
            error[i] = rest * error[i - 1] + np.sqrt(1 - rest**2) * fresh[i]
        offset = np.column_stack([rho * np.sin(azimuth), rho * np.cos(azimuth)])
        covariance = np.zeros((len(error), 4, 4))
        covariance[:, :2, :2], covariance[:, 2:, 2:] = noise, np.eye(2)
        return SensorTracks(
            plots.time,
            sensor,
            plots.flight + 1,
            place + offset + np.einsum("nij,nj->ni", np.linalg.cholesky(noise), error),
            velocity + rng.standard_normal(velocity.shape),
            covariance=covariance,
        )

    return source


SOURCES: dict[str, Source] = {
    "Tertia's tracker": own_tracker,
    "Kalman filter, 1 m²/s³": kalman(),
    "Kalman filter, 0.05 m²/s³": kalman(density=0.05),
    "Kalman filter, covariances × ½": kalman(0.5),
    "Kalman filter, covariances × 2": kalman(2.0),
    "α-β filter, one σ stated": alpha_beta(),
    "α-β filter, nothing stated": alpha_beta(stated=False),
    "Kalman filter, system tracks every 4 s": periodic(),
    "navigation, errors last 60 s": navigation(60.0),
}


@dataclass(frozen=True)
class Scene:
    """Flights and what the radars have of them."""

    flown: Flown
    plots: list[Seen]
    radars: list[Radar]


@cache
def scene(
    kind: str, count: int, biased: bool, seed: int, *, flights: int = FLIGHTS, common: bool = False
) -> Scene:
    """Return a scene; the errors of all sensors are the same if they are `common`."""
    rng = np.random.default_rng([SEED, FLOWN.index(kind), count, seed])
    of, radars = flown(kind, flights, rng), sensors(count)
    plots: list[Seen] = []
    for radar in radars:
        sign = rng.choice([-1.0, 1.0], 2)
        size = rng.uniform(100.0, 200.0), np.radians(rng.uniform(0.2, 0.3))
        off = (sign[0] * size[0], sign[1] * size[1]) if biased else (0.0, 0.0)
        if common and plots:
            off = plots[0].off
        plots.append(seen(of, radar, off, rng))
    return Scene(of, plots, radars)


@dataclass(frozen=True)
class Result:
    """Squares of errors, normalised ones, and how many targets too many and too few."""

    square: FloatArray
    position: FloatArray
    velocity: FloatArray
    inside: BoolArray
    excess: float
    lost: float


def judged(found: SystemTracks, of: Flown) -> Result:
    """Compare a picture with the flights."""
    found = found[(found.time >= WARM) & (found.time < LENGTH - 5.0)]
    flights = np.arange(len(of))
    rows: list[int] = []
    targets: list[int] = []
    excess, lost, cycles = 0, 0, 0
    for time in np.unique(found.time):
        own = np.flatnonzero(found.time == time)
        place = of.at(flights, np.full(len(of), time))[0]
        distance = np.linalg.norm(found.position[own][:, np.newaxis] - place, axis=2)
        nearest, near = np.argmin(distance, axis=1), np.min(distance, axis=1) < ASTRAY
        counted = found.confirmed[own] & ~found.doubtful[own]
        excess += int(np.sum(counted)) - len(np.unique(nearest[near & counted]))
        lost += len(of) - len(np.unique(nearest[near]))
        cycles += 1
        for k in np.unique(nearest[near]).tolist():
            # of two that show one aircraft, the one with more tracks counts
            mine = own[near & (nearest == k)]
            rows.append(int(mine[np.argmax(np.sum(found.members[mine] >= 0, axis=1))]))
            targets.append(k)
    position, velocity = of.at(np.array(targets), found.time[rows])
    covariance = found.covariance[rows]
    off, rate = found.position[rows] - position, found.velocity[rows] - velocity
    square = np.asarray(nees(off, covariance[:, :2, :2]))
    return Result(
        np.sum(off**2, axis=1),
        square / 2,
        np.asarray(nees(rate, covariance[:, 2:, 2:])) / 2,
        square <= WITHIN_95[2],
        excess / cycles,
        lost / cycles,
    )


def fused(source: str, one: Scene, radars: list[Radar] | None = None) -> Result:
    """Judge the picture that is made from the tracks of a kind of source."""
    several = [
        SOURCES[source](plots, radar, k)
        for k, (plots, radar) in enumerate(zip(one.plots, one.radars, strict=True))
    ]
    picture = fuse_tracks(SensorTracks.concatenate(several), radars or one.radars)
    return judged(picture, one.flown)


@cache
def central(kind: str, count: int, seed: int) -> FloatArray:
    """Return squares of position errors of a tracker of all plots without systematic errors."""
    one = scene(kind, count, False, seed)
    columns = [
        (own.time, own.range, own.azimuth, np.full(len(own.time), k))
        for k, own in enumerate(one.plots)
    ]
    time, rho, azimuth, sensor = map(np.concatenate, zip(*columns, strict=True))
    order = np.argsort(time, kind="stable")
    plots = Plots(time[order], rho[order], azimuth[order], sensor=sensor[order])
    tracker, flights = Tracker(sensors(count, Bias())), np.arange(FLIGHTS)
    squares, at = [], 0
    for now in np.arange(5.0, LENGTH - 5.0, 5.0):
        end = int(np.searchsorted(plots.time, now, side="right"))
        tracker.update(plots[at:end], time=float(now))
        at = end
        if now >= WARM:
            _, places = tracker.extrapolate(0.0)
            truth = one.flown.at(flights, np.full(FLIGHTS, now))[0]
            distance = np.linalg.norm(places[:, np.newaxis] - truth, axis=2)
            nearest = np.min(distance, axis=0)
            squares.append(nearest[nearest < ASTRAY] ** 2)
    return np.concatenate(squares)


def cell(results: list[Result]) -> str:
    """Return how often the region holds the truth."""
    share = float(np.mean(np.concatenate([one.inside for one in results])))
    return f"{share:.0%}" if LOW <= share <= HIGH else f"**{share:.0%}**"


def sources() -> str:
    """Return coverage by kind of source, flights and errors, and what the picture is like."""
    rows = []
    for source in SOURCES:
        for count in COUNTS:
            cells, every, other = [], [], []
            for biased in (False, True):
                for kind in FLOWN:
                    some = [
                        fused(source, scene(kind, count, biased, seed)) for seed in range(SCENES)
                    ]
                    cells.append(cell(some))
                    every += some
                    other += [central(kind, count, seed) for seed in range(SCENES)]
            ratio = np.mean(np.concatenate([one.square for one in every]))
            ratio = np.sqrt(ratio / np.mean(np.concatenate(other)))
            of = (np.mean(np.concatenate([one.position for one in every])), ratio)
            counts = (np.mean([getattr(one, name) for one in every]) for name in ("excess", "lost"))
            numbers = [f"{value:.2f}" for value in (*of, *counts)]
            rows.append([source, f"{count}", *cells, *numbers])
    head = ["tracks of", "radars", *FLOWN, *(f"{kind}, biased" for kind in FLOWN)]
    return markdown([*head, "NEES", "position rms, ratio", "surplus", "lost"], rows)


def few() -> str:
    """Return coverage where few targets tell the errors of the sensors, by what is stated."""
    stated = Bias(range_sigma=150.0, azimuth_sigma=0.25, degrees=True)
    rows = []
    for common in (False, True):
        for count in COUNTS[:2]:
            for prior in (None, stated):
                cells = []
                for flights in FEW:
                    one = (
                        scene("straight", count, True, seed, flights=flights, common=common)
                        for seed in range(MANY)
                    )
                    name = "Kalman filter, 1 m²/s³"
                    cells.append(cell([fused(name, own, sensors(count, prior)) for own in one]))
                errors = "the same of all sensors" if common else "of each sensor its own"
                said = "nothing" if prior is None else "their sizes"
                rows.append([errors, f"{count}", said, *cells])
    head = ["systematic errors", "radars", "stated of them"]
    return markdown([*head, *(f"{n} aircraft" for n in FEW)], rows)
