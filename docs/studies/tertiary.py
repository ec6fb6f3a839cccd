"""Figures of docs/tertiary.md."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Literal

import numpy as np

from studies import smooth_tracks
from studies.pages import markdown, repetitions
from tertia import simulate
from tertia._arrays import FloatArray, IntArray
from tertia.sensors import Bias, Radar
from tertia.simulate import Traffic
from tertia.tertiary import FusionCentre, SensorTracks, SystemTracks, fuse_tracks
from tertia.tracker import CvModel, ImmModel, Plots, Tracker, track

SEED = 21
SCENES = repetitions(10, 1)
# scenes of each kind in which a centre is told more or less
TOLD = repetitions(3, 1)
# aircraft of each kind of scene
ROUTES, DENSE, PAIRS = repetitions(40, 8), repetitions(150, 20), repetitions(30, 10)
CYCLE, WARM, ASTRAY = 5.0, 60.0, 2000.0
METHODS = ("tracklets", "matrix", "covariance-intersection", "static", "equal", "paper")
SHIFT = (150.0, 0.15)
WHOLE = ("routes", "dense")
KINDS = ("routes", "dense", "pairs", "dense, biased", "pairs, biased")
# what a centre is told of tracks
NOTHING, AIRCRAFT, PLOTS = "nothing", "the aircraft of each track", "which rows are of false plots"
LESS = "not the covariances of these rows"
PLACES = ((0.0, 0.0), (60e3, 20e3), (-20e3, 90e3))
# what the tracker expects of traffic: by default, and where nobody turns or accelerates
MODELS = {
    "the default: turns, and .1 m/s² on straight legs": ImmModel(),
    "no turns, .01 m/s²": CvModel(straight_sigma=0.01),
    "no turns, .0001 m/s²": CvModel(straight_sigma=1e-4),
}
STEADY = 300.0
ACCURACY = ((75.0, 0.10, 6.0), (50.0, 0.08, 4.0), (100.0, 0.12, 10.0))


def sensors(*, biased: bool = False) -> list[Radar]:
    """Return three radars, whose systematic errors are unknown or known to be none."""
    prior = Bias(range_sigma=SHIFT[0], azimuth_sigma=SHIFT[1], degrees=True) if biased else Bias()
    return [
        Radar(
            place,
            range_sigma=range_sigma,
            azimuth_sigma=azimuth_sigma,
            scan_period=period,
            max_range=250e3,
            detection_probability=0.95,
            bias=prior,
            degrees=True,
        )
        for place, (range_sigma, azimuth_sigma, period) in zip(PLACES, ACCURACY, strict=True)
    ]


def joined(one: Traffic, other: Traffic) -> Traffic:
    """Return the flights of both, which have the same samples."""
    columns = (name for name in Traffic.__slots__ if name not in ("step", "plans"))
    both: dict[str, Any] = {
        name: np.concatenate([getattr(one, name), getattr(other, name)]) for name in columns
    }
    return replace(one, plans=(), **both)


def traffic(kind: str, random: np.random.Generator) -> Traffic:
    """Return the aircraft of a scene."""
    if kind.startswith("routes"):
        setting = simulate.set_up("middle")
        routes = simulate.routes("middle", ROUTES, rng=random)
        return simulate.flights(routes, wind=setting.wind, rng=random)
    if kind.startswith("dense"):
        return simulate.dense_traffic(DENSE, area=(160e3, 160e3), rng=random)
    leaders = simulate.dense_traffic(PAIRS, area=(160e3, 160e3), rng=random)
    angle, distance = random.uniform(0, 2 * np.pi, PAIRS), random.uniform(400.0, 1500.0, PAIRS)
    off = distance[:, np.newaxis] * np.column_stack([np.sin(angle), np.cos(angle)])
    return joined(leaders, replace(leaders, position=leaders.position + off[:, np.newaxis]))


@dataclass(frozen=True, slots=True)
class Scene:
    """Tracks of each radar, with the aircraft that they are of, and the central tracker's plots."""

    flights: Traffic
    tracks: SensorTracks
    truth: IntArray
    # the aircraft of the plot of each row
    target: IntArray
    plots: simulate.RadarPlots
    radars: list[Radar]
    bias: Bias


def majority(track: IntArray, target: IntArray) -> IntArray:
    """Return which aircraft most of the last five plots of the track are of, at each row."""
    recent: dict[int, list[int]] = defaultdict(list)
    found = np.empty(len(track), dtype=np.int64)
    for row, (number, aircraft) in enumerate(zip(track.tolist(), target.tolist(), strict=True)):
        last = recent[number]
        last.append(aircraft)
        del last[:-5]
        found[row] = max(set(last), key=last.count)
    return found


@cache
def scene(kind: str, seed: int) -> Scene:
    """Return a scene, its radars' tracks and the truth."""
    random = np.random.default_rng([SEED, KINDS.index(kind), seed])
    flown, biased = traffic(kind, random), kind.endswith("biased")
    radars = sensors(biased=biased)
    size = np.array([SHIFT[0], np.radians(SHIFT[1])]) * biased
    off = size * random.standard_normal((len(radars), 2))
    bias = Bias(range=off[:, 0], azimuth=off[:, 1])
    noise = int(random.integers(2**31))
    # the same noise with and without systematic errors
    record, clean = (
        simulate.radar_plots(
            flown, radars, clutter=20, bias=one, identity_missing_probability=1.0, rng=noise
        )
        for one in (bias, None)
    )
    several, truths, targets = [], [], []
    for k, radar in enumerate(radars):
        own = np.flatnonzero(record.plots.sensor == k)
        alone = replace_sensor(record.plots[own])
        table = track(alone, [replace(radar, bias=Bias())])
        target = np.where(table.plot >= 0, record.target[own][table.plot], -2)
        kept = (table.plot >= 0) & table.confirmed
        several.append(SensorTracks.of(table, sensor=k))
        truths.append(majority(table.track[kept], target[kept]))
        targets.append(target[kept])
    tracks, truth = SensorTracks.concatenate(several), np.concatenate(truths)
    order = np.argsort(tracks.time, kind="stable")
    own = np.concatenate(targets)[order]
    return Scene(flown, tracks[order], truth[order], own, clean, radars, bias)


def told(one: Scene, what: str) -> Scene:
    """Return the same with what a centre is told."""
    if what == AIRCRAFT:
        return replace(one, tracks=replace(one.tracks, identity=one.truth))
    if what == LESS:
        covariance = one.tracks.covariance.copy()
        covariance[one.target < 0] = np.nan
        return replace(one, tracks=replace(one.tracks, covariance=covariance))
    kept = np.flatnonzero((what == NOTHING) | (one.target >= 0))
    own = {name: getattr(one, name)[kept] for name in ("tracks", "truth", "target")}
    return replace(one, **own)


def replace_sensor(plots: Plots) -> Plots:
    """Return plots of the only sensor."""
    return Plots(plots.time, plots.range, plots.azimuth, height=plots.height)


@dataclass(frozen=True, slots=True)
class Error:
    """The error of a state, and its covariance."""

    cycle: int
    target: int
    error: FloatArray
    covariance: FloatArray
    turning: bool


class Outcome:
    """What a centre makes of a scene."""

    def __init__(self, one: Scene) -> None:
        self.scene = one
        self.pairs = self.right = self.possible = self.cycles = self.excess = self.changes = 0
        self.bias: FloatArray = np.zeros((2, 0))
        self.errors: list[Error] = []
        # aircraft of each track, number of each aircraft
        self.seen: dict[tuple[int, int], int] = {}
        self.names: dict[int, int] = {}

    def judge(self, picture: SystemTracks, live: set[tuple[int, int]], cycle: int) -> None:
        """Count pairs and targets, and keep errors."""
        aircraft: dict[int, int] = defaultdict(int)
        for key in live:
            if self.seen[key] >= 0:
                aircraft[self.seen[key]] += 1
        self.possible += sum(n * (n - 1) // 2 for n in aircraft.values())
        self.excess += int(np.sum(picture.confirmed & ~picture.doubtful)) - len(aircraft)
        self.cycles += 1
        shown: dict[int, int] = {}
        # of two that show one aircraft, the one with more tracks counts
        for row in np.argsort(-np.sum(picture.members >= 0, axis=1), kind="stable").tolist():
            own = [self.seen[k, t] for k, t in enumerate(picture.members[row].tolist()) if t >= 0]
            pairs = [(a, b) for i, a in enumerate(own) for b in own[i + 1 :]]
            self.pairs += len(pairs)
            self.right += sum(a == b and a >= 0 for a, b in pairs)
            target = max(set(own), key=own.count)
            if target >= 0:
                shown.setdefault(target, row)
        if shown:
            self.compare(picture, shown, cycle)

    def compare(self, picture: SystemTracks, shown: dict[int, int], cycle: int) -> None:
        """Keep the errors of states: of each target that of its row."""
        flights, targets, rows = self.scene.flights, np.array(list(shown)), list(shown.values())
        time = picture.time[rows]
        truth = np.hstack(flights.at(targets, time))
        state = np.hstack([picture.position[rows], picture.velocity[rows]])
        step = ((time - flights.start[targets]) / flights.step).astype(int)
        for i in np.flatnonzero(np.isfinite(truth).all(axis=1)).tolist():
            row, target = rows[i], int(targets[i])
            number = int(picture.track[row])
            self.changes += self.names.get(target, number) != number
            self.names[target] = number
            turning = bool(flights.turning[target, step[i]])
            one = Error(cycle, target, state[i] - truth[i], picture.covariance[row], turning)
            self.errors.append(one)


def run(kind: str, seed: int, *, what: str = NOTHING, **options: object) -> Outcome:
    """Return how a centre does that is told this of its tracks."""
    one = told(scene(kind, seed), what)
    centre = FusionCentre(one.radars, **options)  # type: ignore[arg-type]
    outcome, last = Outcome(one), dict[tuple[int, int], float]()
    old = [2.5 * radar.scan_period for radar in one.radars]
    start, at, cycle = float(one.tracks.time[0]), 0, 0
    while at < len(one.tracks):
        cycle += 1
        time = start + CYCLE * cycle
        end = int(np.searchsorted(one.tracks.time, time, side="right"))
        for row in range(at, end):
            key = int(one.tracks.sensor[row]), int(one.tracks.track[row])
            last[key], outcome.seen[key] = float(one.tracks.time[row]), int(one.truth[row])
        picture = centre.update(one.tracks[at:end], time=time)
        at = end
        if time - start > WARM:
            live = {key for key, when in last.items() if time - when <= old[key[0]]}
            outcome.judge(picture, live, cycle)
    found = np.stack([np.asarray(centre.bias.range), np.asarray(centre.bias.azimuth)])
    outcome.bias = found - np.stack([np.asarray(one.bias.range), np.asarray(one.bias.azimuth)])
    return outcome


@dataclass(frozen=True, slots=True)
class Central:
    """What a tracker of all plots without biases does."""

    # errors of positions by cycle and aircraft
    error: dict[tuple[int, int], FloatArray]
    # times, states, covariances and aircraft of the rows with a plot
    time: FloatArray
    state: FloatArray
    covariance: FloatArray
    target: IntArray


@cache
def central(kind: str, seed: int) -> Central:
    """Return errors of a tracker of all plots without biases."""
    one = scene(kind, seed)
    tracker = Tracker([replace(radar, bias=Bias()) for radar in one.radars])
    start, at, cycle = one.tracks.time[0], 0, 0
    recent: dict[int, list[int]] = defaultdict(list)
    found: dict[tuple[int, int], FloatArray] = {}
    rows: list[tuple[FloatArray, FloatArray, FloatArray, IntArray]] = []
    while at < len(one.plots):
        cycle += 1
        time = start + CYCLE * cycle
        end = int(np.searchsorted(one.plots.plots.time, time, side="right"))
        table = tracker.update(one.plots.plots[at:end], time=time)
        own = table[table.confirmed & (table.plot >= 0) & (table.time - start > WARM)]
        state = np.hstack([own.position, own.velocity])
        rows.append((own.time, state, own.covariance, one.plots.target[own.plot]))
        at = end
        for number, plot in zip(table.track.tolist(), table.plot.tolist(), strict=True):
            if plot >= 0:
                recent[number] = [*recent[number][-4:], int(one.plots.target[plot])]
        numbers, places = tracker.extrapolate(0.0)
        flights = np.arange(len(one.flights))
        position, _ = one.flights.at(flights, np.full(len(flights), time))
        for number, place in zip(numbers.tolist(), places, strict=True):
            last = recent[number] or [-1]
            target = max(set(last), key=last.count)
            if target >= 0:
                error = place - position[target]
                known = found.get((cycle, target))
                if known is None or np.hypot(*error) < np.hypot(*known):
                    found[cycle, target] = error
    return Central(found, *map(np.concatenate, zip(*rows, strict=True)))


def honesty(kind: str, seed: int) -> dict[bool, list[tuple[FloatArray, FloatArray]]]:
    """Return errors and covariances of a tracker of all plots: in turns, and in straight flight."""
    best, flights = central(kind, seed), scene(kind, seed).flights
    parts: dict[bool, list[tuple[FloatArray, FloatArray]]] = {True: [], False: []}
    own = np.flatnonzero(best.target >= 0)
    target, time = best.target[own], best.time[own]
    error = best.state[own] - np.hstack(flights.at(target, time))
    step = ((time - flights.start[target]) / flights.step).astype(int)
    turning = flights.turning[target, np.minimum(step, flights.turning.shape[1] - 1)]
    for e, p, turns in zip(error, best.covariance[own], turning.tolist(), strict=True):
        if np.hypot(*e[:2]) <= ASTRAY:
            parts[turns].append((e, p))
    return parts


def association() -> str:
    """Return how many pairs are found and right, and how many targets too many are shown."""
    rows = []
    for kind in KINDS:
        several = [run(kind, seed) for seed in range(SCENES)]
        found = sum(o.right for o in several) / sum(o.possible for o in several)
        right = sum(o.right for o in several) / sum(o.pairs for o in several)
        count = sum(o.excess for o in several) / sum(o.cycles for o in several)
        changes = sum(o.changes for o in several) / len(several)
        off = np.mean(np.abs(np.concatenate([o.bias for o in several], axis=1)), axis=1)
        left = f"{off[0]:.1f} m, {np.degrees(off[1]):.4f}°" if kind.endswith("biased") else ""
        rows.append([kind, f"{found:.2%}", f"{right:.2%}", f"{count:+.2f}", f"{changes:.1f}", left])
    head = ["", "found", "right", "surplus targets", "changes of number", "remaining biases"]
    return markdown(head, rows)


def squares(errors: list[tuple[FloatArray, FloatArray]], size: int) -> float:
    """Return the mean of `e' P⁻¹ e` of the first components, over their number."""
    if not errors:
        return np.nan
    e, p = (np.array(one) for one in zip(*errors, strict=True))
    e, p = e[:, :size], p[:, :size, :size]
    return float(np.mean(e * np.linalg.solve(p, e[..., np.newaxis])[..., 0]))


def against_central(kind: str, method: str, what: str = NOTHING, scenes: int = SCENES) -> list[str]:
    """Return errors over those of the central tracker, and NEES: of all, in turns, straight on."""
    own, other = [], []
    parts: dict[bool, list[tuple[FloatArray, FloatArray]]] = {True: [], False: []}
    for seed in range(scenes):
        outcome, best = run(kind, seed, what=what, method=method), central(kind, seed)
        for one in outcome.errors:
            error = best.error.get((one.cycle, one.target))
            # farther away it is another target
            if error is None or max(np.hypot(*error), np.hypot(*one.error[:2])) > ASTRAY:
                continue
            own.append(one.error[:2])
            other.append(error)
            parts[one.turning].append((one.error, one.covariance))
    ratio = np.linalg.norm(own) / np.linalg.norm(other)
    median = np.median(np.linalg.norm(own, axis=1)) / np.median(np.linalg.norm(other, axis=1))
    return [f"{ratio:.3f}", f"{median:.3f}", *consistency(parts)]


def consistency(parts: dict[bool, list[tuple[FloatArray, FloatArray]]]) -> list[str]:
    """Return NEES of all, in turns, and straight on: of positions, and of velocities too."""
    groups = (parts[True] + parts[False], parts[True], parts[False])
    return [f"{squares(group, 2):.2f}, {squares(group, 4):.2f}" for group in groups]


def of_all_plots(kind: str) -> list[str]:
    """Return the same of the central tracker itself, at its plots."""
    parts: dict[bool, list[tuple[FloatArray, FloatArray]]] = {True: [], False: []}
    for seed in range(SCENES):
        for turning, some in honesty(kind, seed).items():
            parts[turning] += some
    return ["1", "1", *consistency(parts)]


def fusion() -> str:
    """Return position errors over those of the central tracker, and NEES, by scene and method."""
    rows = []
    for kind in KINDS:
        if kind in WHOLE:
            rows.append([kind, "tracker of all plots", *of_all_plots(kind)])
        methods = METHODS if kind in WHOLE else METHODS[:1]
        rows += [[kind, f"`{method}`", *against_central(kind, method)] for method in methods]
    head = ["", "method", "position rms, ratio", "median, ratio", "NEES", "NEES in turns"]
    return markdown([*head, "NEES in straight flight"], rows)


def links() -> str:
    """Return how much nearer `tracklets` comes if the centre knows more, or less."""
    rows = []
    for kind in ("routes", "dense", "dense, biased"):
        for what in (NOTHING, AIRCRAFT, PLOTS, LESS):
            rows.append([kind, what, *against_central(kind, METHODS[0], what, TOLD)[:3]])
    return markdown(["", "told", "position rms, ratio", "median, ratio", "NEES"], rows)


def expectations() -> str:
    """Return NEES of a tracker of all plots, without turns, by what its model expects."""
    squared: dict[str, list[FloatArray]] = defaultdict(list)
    radars = [replace(radar, bias=Bias()) for radar in sensors()]
    for seed in range(SCENES):
        random = np.random.default_rng([SEED, 99, seed])
        flown = simulate.dense_traffic(
            DENSE, area=(160e3, 160e3), duration=600.0, turning_share=0.0, rng=random
        )
        record = simulate.radar_plots(
            flown, radars, clutter=20, identity_missing_probability=1.0, rng=random
        )
        for name, model in MODELS.items():
            table = track(record.plots, radars, motion=model)
            target = np.where(table.plot >= 0, record.target[table.plot], -1)
            rows = np.flatnonzero(table.confirmed & (target >= 0) & (table.time > STEADY))
            truth = np.concatenate(flown.at(target[rows], table.time[rows]), axis=1)
            error = np.hstack([table.position, table.velocity])[rows] - truth
            near = np.hypot(*error[:, :2].T) < ASTRAY
            error, covariance = error[near], table.covariance[rows][near]
            sizes = []
            for size in (2, 4):
                e, p = error[:, :size], covariance[:, :size, :size]
                scaled = np.linalg.solve(p, e[..., np.newaxis])[..., 0]
                sizes.append(np.sum(e * scaled) / e.size)
            squared[name].append(np.array([np.mean(error[:, :2] ** 2), *sizes]))
    rows_ = []
    for name, each in squared.items():
        square, position, both = np.mean(each, axis=0)
        rows_.append([name, f"{np.sqrt(2 * square):.1f} m", f"{position:.2f}", f"{both:.2f}"])
    head = ["model", "position rms", "NEES, position", "NEES, position and velocity"]
    return markdown(head, rows_)


# flights of no other table
CHANGES_SEED = 2
CHANGES, THREE = "turns and speed changes", "three radars"


def speed_changes() -> str:
    """Return errors of fused tracks, by what the targets do, where speeds change, too."""
    radars = smooth_tracks.RADARS[THREE]
    plots = smooth_tracks.plots_of(CHANGES, THREE, CHANGES_SEED)
    several = []
    for k, radar in enumerate(radars):
        own = plots[plots.sensor == k]
        alone = replace(own, sensor=np.zeros(len(own), dtype=np.int64))
        several.append(SensorTracks.of(track(alone, [radar]), sensor=k))
    tracks, rows = SensorTracks.concatenate(several), []
    methods: tuple[Literal["tracklets"], Literal["matrix"]] = ("tracklets", "matrix")
    for method in methods:
        found = flight_by_flight(tracks, radars, method)
        state = np.hstack([found.position, found.velocity])
        of = smooth_tracks.errors(CHANGES, found.time, state, found.covariance, CHANGES_SEED)
        for part in smooth_tracks.parts(CHANGES):
            names = of.rms(part), of.rms(part, "velocity"), of.nees(part)
            position, velocity, nees = names
            both = f"{nees:.2f}, {of.nees(part, 'velocity_nees'):.2f}"
            name = smooth_tracks.PARTS[part]
            rows.append([f"`{method}`", name, f"{position:.1f}", f"{velocity:.1f}", both])
    head = ["method", "part", "position, m", "velocity, m/s"]
    return markdown([*head, "NEES of position, of velocity"], rows)


def flight_by_flight(
    tracks: SensorTracks, radars: list[Radar], method: Literal["tracklets", "matrix"]
) -> SystemTracks:
    """Return the pictures of flights, between which hours pass, as long as all radars see them."""
    flight = np.round(tracks.time / smooth_tracks.APART - 0.01).astype(int)
    pictures = []
    for one in np.unique(flight):
        found = fuse_tracks(tracks[flight == one], radars, method=method)
        inside = found.time - smooth_tracks.APART * one < smooth_tracks.LENGTH
        pictures.append(found[inside & np.all(found.members >= 0, axis=1)])
    columns = {
        name: np.concatenate([getattr(picture, name) for picture in pictures])
        for name in SystemTracks.__slots__
    }
    return SystemTracks(**columns)
