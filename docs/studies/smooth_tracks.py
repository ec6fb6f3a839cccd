"""Figures of docs/smooth-tracks.md."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial

import numpy as np
import polars as pl

from studies.montecarlo import generator, in_region
from studies.pages import DATA, markdown, repetitions, table_of
from tertia import metrics, smoothing
from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.geo import SystemPlane
from tertia.sensors import Bias
from tertia.tracker import (
    CvModel,
    ImmModel,
    Plots,
    Radar,
    SmoothedTracks,
    TrackTable,
    smooth_tracks,
    track,
)

FLIGHTS = repetitions(80)
# seconds: of a flight, of its first part, which is left out, and from flight to flight
LENGTH, BEGINNING, APART = 680.0, 60.0, 20_000.0
# rates of turn, rad/s, and accelerations along the course, m/s2
RATES = np.radians([1.0, 1.5, 3.0])
ACCELERATIONS = (-0.5, 0.4)
STEP = 0.1
STRAIGHT, TURN, SPEED = range(3)
PARTS = ("straight", "turn", "speed change")
KINDS: dict[str, tuple[int, ...]] = {
    "straight flights": (),
    "turns": (TURN,),
    "turns and speed changes": (TURN, SPEED),
}
# without systematic errors
_RADAR = partial(Radar, max_range=300e3, bias=Bias())
_ONE = _RADAR(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0)
RADARS = {
    "one radar": [_ONE],
    "three radars": [
        _ONE,
        _RADAR(
            position=(60e3, 20e3),
            range_sigma=75.0,
            azimuth_sigma=np.radians(0.1),
            scan_period=6.0,
        ),
        _RADAR(
            position=(-20e3, 70e3),
            range_sigma=100.0,
            azimuth_sigma=np.radians(0.12),
            scan_period=10.0,
        ),
    ],
}
DETECTION = 0.9


@dataclass(frozen=True)
class Flown:
    """Flights, sampled every `STEP`: position and velocity (F, S, 2), and what they do (F, S)."""

    position: FloatArray
    velocity: FloatArray
    part: IntArray

    def at(self, flight: IntArray, time: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return positions and velocities between the samples, and the part of the flight."""
        place = time / STEP
        low = np.clip(place.astype(int), 0, self.part.shape[1] - 2)
        share = (place - low)[:, np.newaxis]
        position, velocity = (
            (1 - share) * values[flight, low] + share * values[flight, low + 1]
            for values in (self.position, self.velocity)
        )
        return position, velocity, self.part[flight, np.round(place).astype(int)]


@cache
def flown(kind: str, seed: int = 0) -> Flown:
    """Simulate flights with manoeuvres of these kinds, one after the other."""
    rng = generator(180, list(KINDS).index(kind), seed)
    steps = int(LENGTH / STEP) + 1
    rate, acceleration = np.zeros((2, FLIGHTS, steps))
    part = np.zeros((FLIGHTS, steps), dtype=np.int64)
    for k in range(FLIGHTS):
        begin = rng.uniform(80.0, 140.0)
        turn = int(rng.integers(len(KINDS[kind]))) if KINDS[kind] else 0
        while KINDS[kind] and begin < LENGTH - 100.0:
            what = KINDS[kind][turn % len(KINDS[kind])]
            turn += 1
            if what == TURN:
                size = rng.choice(RATES)
                duration = rng.uniform(np.radians(60.0), np.radians(120.0)) / size
                which, value = rate, size * rng.choice([-1.0, 1.0])
            else:
                duration = rng.uniform(50.0, 100.0)
                which, value = acceleration, rng.choice(ACCELERATIONS)
            own = slice(int(begin / STEP), int((begin + duration) / STEP))
            which[k, own], part[k, own] = value, what
            begin += duration + rng.uniform(100.0, 200.0)
    course = rng.uniform(0, 2 * np.pi, (FLIGHTS, 1)) + np.cumsum(rate, axis=1) * STEP
    speed = rng.uniform(160.0, 240.0, (FLIGHTS, 1)) + np.cumsum(acceleration, axis=1) * STEP
    velocity = speed[..., np.newaxis] * np.stack([np.sin(course), np.cos(course)], axis=-1)
    way = np.cumsum(velocity, axis=1) * STEP
    bearing, distance = rng.uniform(0, 2 * np.pi, FLIGHTS), rng.uniform(70e3, 120e3, FLIGHTS)
    middle = distance[:, np.newaxis] * np.stack([np.sin(bearing), np.cos(bearing)], axis=-1)
    position = middle[:, np.newaxis] + way - way[:, steps // 2, np.newaxis]
    return Flown(position, velocity, part)


@cache
def plots_of(kind: str, radars: str, seed: int = 0) -> Plots:
    """Return what radars see of the flights; the identity is the flight."""
    rng = generator(181, list(KINDS).index(kind), list(RADARS).index(radars), seed)
    of, columns = flown(kind, seed), []
    for k, radar in enumerate(RADARS[radars]):
        scans = np.arange(0.0, LENGTH - radar.scan_period, radar.scan_period)
        time = rng.uniform(0.0, radar.scan_period, FLIGHTS)[:, np.newaxis] + scans
        flight = np.repeat(np.arange(FLIGHTS), len(scans))
        kept = rng.uniform(size=time.size) < DETECTION
        time, flight = time.ravel()[kept], flight[kept]
        offset = of.at(flight, time)[0] - radar.position[:2]
        noise = rng.standard_normal((2, len(time)))
        distance = np.hypot(*offset.T) + radar.range_sigma * noise[0]
        azimuth = np.arctan2(*offset.T) + radar.azimuth_sigma * noise[1]
        columns.append((time + APART * flight, distance, azimuth, np.full(len(time), k), flight))
    time, distance, azimuth, sensor, flight = map(np.concatenate, zip(*columns, strict=True))
    order = np.argsort(time)
    return Plots(
        time[order],
        distance[order],
        azimuth[order],
        sensor=sensor[order],
        identity=flight[order],
    )


@cache
def tracked(kind: str, radars: str, seed: int = 0) -> TrackTable:
    """Return the tracks of the flights, as the tracker had them at the time."""
    return track(plots_of(kind, radars, seed), RADARS[radars])


@cache
def smoothed(kind: str, radars: str, every: float | None = None, seed: int = 0) -> SmoothedTracks:
    """Return the same by all plots."""
    found = tracked(kind, radars, seed)
    return smooth_tracks(plots_of(kind, radars, seed), RADARS[radars], found, every=every)


@dataclass(frozen=True)
class Errors:
    """Errors of rows, m and m/s, with their NEES per axis and what the target did."""

    position: FloatArray
    velocity: FloatArray
    position_nees: FloatArray
    velocity_nees: FloatArray
    part: IntArray
    counted: BoolArray

    def rms(self, part: int, name: str = "position") -> float:
        """Return the root mean square of the length of errors in a part."""
        errors = getattr(self, name)[self.counted & (self.part == part)]
        return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))

    def nees(self, part: int, name: str = "position_nees") -> float:
        """Return the mean NEES per axis in a part."""
        return float(np.mean(getattr(self, name)[self.counted & (self.part == part)]))


def errors(
    kind: str,
    time: FloatArray,
    state: FloatArray,
    covariance: FloatArray,
    seed: int = 0,
) -> Errors:
    """Compare states (N, 4) with the flights, without their first minute."""
    flight = np.round(time / APART - 0.01).astype(int)
    since = time - APART * flight
    position, velocity, part = flown(kind, seed).at(flight, since)
    found = state[:, :2] - position, state[:, 2:] - velocity
    of_position, of_velocity = (
        np.asarray(metrics.nees(error, covariance[:, own, own])) / 2
        for error, own in zip(found, (slice(2), slice(2, 4)), strict=True)
    )
    return Errors(*found, of_position, of_velocity, part, since >= BEGINNING)


def of_table(kind: str, table: TrackTable | SmoothedTracks, seed: int = 0) -> Errors:
    """Return the errors of the rows with a plot, or of all."""
    own = table[table.plot >= 0] if isinstance(table, TrackTable) else table
    state = np.hstack([own.position, own.velocity])
    return errors(kind, own.time, state, own.covariance, seed)


def parts(kind: str) -> tuple[int, ...]:
    """Return what these flights do."""
    return STRAIGHT, *KINDS[kind]


def right(table: SmoothedTracks, of: Errors, part: int) -> float:
    """Return the share of instants at which the right model is the most probable."""
    turn, speed = table.turn_probability, table.speed_change_probability
    likeliest = np.argmax(np.stack([1.0 - turn - speed, turn, speed]), axis=0)
    rows = of.counted & (of.part == part)
    return float(np.mean(likeliest[rows] == part))


def accuracy() -> str:
    """Return errors of the tracker and smoothed, by what the targets do."""
    rows = []
    for radars in RADARS:
        for kind in KINDS:
            table = smoothed(kind, radars)
            before, after = of_table(kind, tracked(kind, radars)), of_table(kind, table)
            for part in parts(kind):
                pair = before.rms(part), after.rms(part)
                speeds = before.rms(part, "velocity"), after.rms(part, "velocity")
                rows.append(
                    [
                        radars,
                        kind,
                        PARTS[part],
                        f"{pair[0]:.1f}",
                        f"{pair[1]:.1f}",
                        f"{pair[1] / pair[0]:.2f}",
                        f"{speeds[1] / speeds[0]:.2f}",
                        f"{after.nees(part):.2f}",
                        f"{after.nees(part, 'velocity_nees'):.2f}",
                        f"{right(table, after, part):.2f}",
                    ]
                )
    head = [
        "radars",
        "flights",
        "part",
        "tracker, m",
        "smoothed, m",
        "ratio",
        "ratio, velocity",
        "NEES",
        "NEES, velocity",
        "correct model",
    ]
    return markdown(head, rows)


# flights that are smoothed by other methods as well
BESIDE = 12


def beside() -> str:
    """Return errors beside those of other smoothers, on the same flights."""
    rows = []
    for radars, sensors in RADARS.items():
        for kind in ("straight flights", "turns and speed changes"):
            table, found = tracked(kind, radars), plots_of(kind, radars)
            table = table[(table.plot >= 0) & (table.time < BESIDE * APART)]
            ways = {"two filters, three models": smooth_tracks(found, sensors, table)}
            for sigma in (0.1, 1.0, 3.0):
                name = f"one model, {sigma:g} m/s²"
                ways[name] = smooth_tracks(found, sensors, table, motion=CvModel(sigma))
            measured = {
                name: of_table(kind, one[one.time < BESIDE * APART]) for name, one in ways.items()
            }
            measured["`smoothing.smooth`"] = jerk(kind, found, sensors, table)
            for name, of in measured.items():
                errors_of = [f"{of.rms(part):.1f}" for part in parts(kind)]
                rows.append([radars, kind, name, " / ".join(errors_of), f"{worst(kind, of):.1f}"])
    head = ["radars", "flights", "smoother", "straight / turn / speed change, m", "largest NEES"]
    return markdown(head, rows)


def worst(kind: str, of: Errors) -> float:
    """Return the largest NEES of the parts."""
    return max(of.nees(part) for part in parts(kind))


def jerk(kind: str, plots: Plots, sensors: list[Radar], table: TrackTable) -> Errors:
    """Return the errors of the smoother of one path, with a jerk that it fits."""
    position, covariance = plots.to_cartesian(sensors)
    states, spreads, times = [], [], []
    for number in np.unique(table.track):
        rows = np.sort(table.plot[table.track == number])
        found = smoothing.smooth(position[rows], covariance[rows], time=plots.time[rows])
        known = np.isfinite(found.covariance[:, :4, :4]).all(axis=(1, 2))
        states.append(found.mean[known, :4])
        spreads.append(found.covariance[known, :4, :4])
        times.append(plots.time[rows][known])
    return errors(kind, np.concatenate(times), np.vstack(states), np.concatenate(spreads))


def between() -> str:
    """Return errors at each second beside those at plots, and over a minute without plots."""
    rows = []
    kind = "turns and speed changes"
    for radars in RADARS:
        at_plots = of_table(kind, smoothed(kind, radars))
        table = smoothed(kind, radars, every=1.0)
        each = of_table(kind, table[table.plot < 0])
        for part in parts(kind):
            rows.append(
                [
                    radars,
                    PARTS[part],
                    *(f"{of.rms(part):.1f}" for of in (at_plots, each)),
                    *(f"{of.nees(part):.2f}" for of in (at_plots, each)),
                ]
            )
    head = ["radars", "part", "at plots, m", "each second, m", "NEES", "NEES, each second"]
    return markdown(head, rows)


# of what aircraft send down: m/s and radians
_SPEED_STEP, _COURSE_STEP = 2 * 1852.0 / 3600.0, np.radians(90 / 512)
_SITE = (41.300702333, 2.102058194, 27.0)


def recording() -> str:
    """Compare velocities with those that aircraft send down."""
    path = DATA / "lebl_radar" / "plots_0800_0830.csv.gz"
    if not path.exists():
        return table_of("smooth-tracks.md", "recording")
    rows = pl.read_csv(path, infer_schema_length=None).sort("tod_s", maintain_order=True)
    plane = SystemPlane(*_SITE[:2])
    radar = plane.radar(*_SITE, range_sigma=50.0, azimuth_sigma=0.08, scan_period=4.0, degrees=True)
    number = {name: rows[name].cast(pl.Float64, strict=False).to_numpy() for name in _SENT}
    plots = Plots(
        rows["tod_s"].to_numpy(),
        rows["rho_nm"].to_numpy() * 1852.0,
        rows["theta_deg"].to_numpy(),
        height=number["fl"] * 30.48,
        icao_address=rows["icao24"].str.to_integer(base=16, strict=False).fill_null(-1).to_numpy(),
        degrees=True,
    )
    found = track(plots, [radar])
    after = smooth_tracks(plots, [radar], found)
    steady = ImmModel(steady_time=1e12)
    without = track(plots, [radar], identity_error_probability=1e-9, motion=steady)
    speed, course = number["bds_GS"] * 1852.0 / 3600.0, np.radians(number["bds_TTA"])
    lines = []
    for name, table in (
        ("tracker", found[found.plot >= 0]),
        ("tracker without changes of speed", without[without.plot >= 0]),
        ("smoothed", after),
    ):
        lifted = np.column_stack([table.position, np.nan_to_num(table.height)])
        scale, convergence = plane.scale_and_convergence(lifted)
        velocity = table.velocity / np.asarray(scale)[:, np.newaxis]
        fast, towards = speed[table.plot], course[table.plot] + convergence
        along = np.column_stack([np.sin(towards), np.cos(towards)])
        across = np.column_stack([along[:, 1], -along[:, 0]])
        error = velocity - fast[:, np.newaxis] * along
        spread = table.covariance[:, 2:, 2:] + sum(
            variance[:, np.newaxis, np.newaxis] * axis[:, :, np.newaxis] * axis[:, np.newaxis]
            for variance, axis in (
                (np.full(len(fast), _SPEED_STEP**2 / 12), along),
                ((fast * _COURSE_STEP) ** 2 / 12, across),
            )
        )
        known = np.isfinite(error[:, 0]) & (fast > _SLOWEST)
        off = np.abs(np.hypot(*velocity.T) - fast)[known]
        turned = np.arctan2(*velocity.T) - towards
        aside = np.degrees(np.abs(np.angle(np.exp(1j * turned))))[known]
        inside = in_region(error[known], spread[known])
        lines.append(
            [
                name,
                f"{np.sum(known)}",
                *(f"{np.quantile(off, share):.2f}" for share in (0.5, 0.9)),
                *(f"{np.quantile(aside, share):.2f}" for share in (0.5, 0.9)),
                f"{np.mean(inside):.2f}",
            ]
        )
    head = ["", "plots", "speed p50, m/s", "speed p90, m/s", "course p50, °", "course p90, °"]
    return markdown([*head, "within the 95 % region"], lines)


_SENT = ("fl", "bds_GS", "bds_TTA")
# the course of what hardly moves is not compared, m/s
_SLOWEST = 50.0
