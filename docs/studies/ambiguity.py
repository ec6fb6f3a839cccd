"""Figures of docs/association.md: targets so close to one another that plots are not certain."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from studies.montecarlo import generator
from studies.pages import markdown, repetitions
from tertia import metrics
from tertia._arrays import FloatArray, IntArray
from tertia.tracker import Plots, Radar, TrackTable, track

PERIOD, SPEED, DETECTION = 4.0, 200.0, 0.9
RADAR = Radar(
    range_sigma=50.0, azimuth_sigma=0.08, scan_period=PERIOD, detection_probability=DETECTION,
    degrees=True,
)  # fmt: skip
# scans alone, in which they come together, and in which they part
ALONE, CHANGE = 12, 25
FAR = 5000.0
CUTOFF = 1000.0


@dataclass(frozen=True)
class Cell:
    """An encounter: what the aircraft fly, how far from the radar, and what the radar sees."""

    name: str
    kind: str
    # metres between the aircraft, or radians between their courses
    apart: float
    scans: int = 30
    distance: float = 100e3
    clutter: float = 0.0
    targets: int = 2


@dataclass(frozen=True)
class Encounter:
    """True positions (scan, target, axis), and the scans in which the targets are close."""

    position: FloatArray
    close: slice


def encounter(cell: Cell, rng: np.random.Generator) -> Encounter:
    """Return the flights of a cell, in a random direction at its distance."""
    if cell.kind == "crossing":
        scans = 2 * int(np.ceil(FAR / (SPEED * PERIOD * 2 * np.sin(cell.apart / 2))) + ALONE)
        scans = max(scans, 2 * (ALONE + CHANGE))
        along = SPEED * PERIOD * (np.arange(scans) - (scans - 1) / 2)
        course = cell.apart * (np.arange(cell.targets) - (cell.targets - 1) / 2)
        place = along[:, None, None] * np.stack([np.cos(course), np.sin(course)], axis=-1)
        gap = np.abs(along) * 2 * np.sin(cell.apart / 2)
        near = np.flatnonzero(gap < 1500.0)
        near = near if len(near) else np.array([scans // 2])
        close = slice(near[0], near[-1] + 1)
    else:
        change = 0.5 - 0.5 * np.cos(np.pi * (np.arange(CHANGE) + 0.5) / CHANGE)
        steps = [np.zeros(ALONE), change, np.ones(cell.scans), change[::-1], np.zeros(ALONE)]
        if cell.kind == "apart":
            steps = [np.zeros(2 * (ALONE + CHANGE) + cell.scans)]
        weight = np.concatenate(steps)
        row = np.arange(cell.targets) - (cell.targets - 1) / 2
        side = row * (FAR + (cell.apart - FAR) * weight)[:, None]
        along = SPEED * PERIOD * (np.arange(len(weight)) - (len(weight) - 1) / 2)
        place = np.stack([np.broadcast_to(along[:, None], side.shape), side], axis=-1)
        if cell.kind == "trail":
            place[..., 0] += row * cell.apart
            place[..., 1] *= (1.0 - weight)[:, None]
        close = slice(ALONE + CHANGE, ALONE + CHANGE + cell.scans)
    turn, azimuth = rng.uniform(0.0, 2 * np.pi, 2)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    centre = cell.distance * np.array([np.sin(azimuth), np.cos(azimuth)])
    return Encounter(place @ rotation.T + centre, close)


def plots_of(cell: Cell, flown: Encounter, radar: Radar, rng: np.random.Generator) -> Plots:
    """Return what a radar in the origin sees, at the same instant in each scan."""
    return seen_of(cell, flown, radar, rng)[0]


def seen_of(
    cell: Cell, flown: Encounter, radar: Radar, rng: np.random.Generator
) -> tuple[Plots, IntArray]:
    """Return the same, and the target of each plot; -1 of false and merged ones."""
    columns: list[FloatArray] = []
    reach = 1.3 * cell.distance
    for scan, place in enumerate(flown.position):
        distance = np.hypot(*place.T) + radar.range_sigma * rng.normal(size=len(place))
        azimuth = np.arctan2(*place.T) + radar.azimuth_sigma * rng.normal(size=len(place))
        seen = rng.uniform(size=len(place)) < radar.detection_probability
        polar = np.stack([distance, azimuth], axis=-1)[seen]
        target = np.flatnonzero(seen)
        if radar.range_resolution is not None:
            polar = merged(polar, radar, rng)
            target = target if len(polar) == len(target) else np.array([-1])
        count = rng.poisson(cell.clutter)
        false = np.stack(
            [reach * np.sqrt(rng.uniform(size=count)), rng.uniform(0, 2 * np.pi, count)], axis=-1
        )
        found = np.concatenate([polar, false])
        target = np.concatenate([target, np.full(count, -1)])
        columns.append(np.column_stack([np.full(len(found), PERIOD * scan), found, target]))
    time, distance, azimuth, target = np.concatenate(columns).T
    return Plots(time, distance, azimuth), target.astype(np.int64)


def merged(polar: FloatArray, radar: Radar, rng: np.random.Generator) -> FloatArray:
    """Return the plots of targets, some of them merged in pairs (Koch, van Keuk 1997)."""
    if len(polar) != 2:
        return polar
    cell = radar.range_resolution, radar.azimuth_resolution
    squares = np.sum(((polar[0] - polar[1]) / cell) ** 2)
    if rng.uniform() > np.exp(-np.log(2) * squares):
        return polar
    share = 0.5 + 0.12 * rng.normal()
    noise = rng.normal(size=2) * [radar.range_sigma, radar.azimuth_sigma]
    plot: FloatArray = share * polar[0] + (1 - share) * polar[1] + noise / np.sqrt(2)
    return plot[np.newaxis]


@dataclass(frozen=True)
class Outcome:
    """What became of an encounter."""

    gospa: float
    swapped: bool
    lost: bool
    nees: float


def outcome(flown: Encounter, found: TrackTable) -> Outcome:
    """Compare tracks with the flights: while they are close, and who is who afterwards."""
    scan = np.round(found.time / PERIOD).astype(int)
    shown = found.confirmed
    errors, squares = [], []
    for at in range(flown.close.start, flown.close.stop):
        rows = np.flatnonzero(shown & (scan == at))
        estimates, truth = found.position[rows], flown.position[at]
        value = metrics.gospa(estimates, truth, cutoff=CUTOFF).distance
        errors.append(float(value))
        squares.extend(normalised(found, rows, truth))
    before = owners(found, flown, flown.close.start - CHANGE // 2, scan)
    after = owners(found, flown, len(flown.position) - 3, scan)
    both = (before >= 0) & (after >= 0)
    swapped = bool(np.any(before[both] != after[both]) and set(before[both]) == set(after[both]))
    lost = bool(np.any(after < 0) or (np.any(before[both] != after[both]) and not swapped))
    return Outcome(float(np.mean(errors)), swapped, lost, float(np.mean(squares or [np.nan])))


def normalised(found: TrackTable, rows: IntArray, truth: FloatArray) -> list[float]:
    """Return squared errors over their variances, of the nearest targets, per axis."""
    squares = []
    for row in rows:
        error = found.position[row] - truth
        error = error[np.argmin(np.sum(error**2, axis=1))]
        if np.hypot(*error) < CUTOFF:
            covariance = found.covariance[row, :2, :2]
            squares.append(float(error @ np.linalg.solve(covariance, error)) / 2)
    return squares


def owners(found: TrackTable, flown: Encounter, at: int, scan: IntArray) -> IntArray:
    """Return the track of each target in a scan; -1 where there is none."""
    rows = np.flatnonzero(found.confirmed & (scan == at))
    owner = np.full(flown.position.shape[1], -1)
    if len(rows):
        gap = np.linalg.norm(found.position[rows] - flown.position[at][:, None], axis=-1)
        best = np.argmin(gap, axis=1)
        near = gap[np.arange(len(owner)), best] < 1.5 * CUTOFF
        owner[near] = found.track[rows[best[near]]]
    return owner


def runs(cell: Cell, count: int, options: list[dict[str, Any]], *study: int) -> list[list[Outcome]]:
    """Return the outcomes of some trackers with the same plots."""
    found: list[list[Outcome]] = [[] for _ in options]
    for run in range(count):
        rng = generator(57, *study, run)
        flown = encounter(cell, rng)
        plots = plots_of(cell, flown, RADAR, rng)
        for outcomes, option in zip(found, options, strict=True):
            outcomes.append(outcome(flown, track(plots, [RADAR], **option)))
    return found


def abreast(apart: float, scans: int = 30, distance: float = 100e3) -> Cell:
    """Return a flight side by side."""
    return Cell(f"{apart:g} m abreast, {scans} scans", "abreast", apart, scans, distance)


CELLS = (
    abreast(300.0, 10),
    abreast(300.0),
    abreast(500.0),
    abreast(600.0, 10),
    abreast(600.0),
    abreast(1000.0),
    abreast(2000.0),
    abreast(300.0, distance=60e3),
    abreast(600.0, distance=60e3),
    abreast(600.0, distance=150e3),
    abreast(1000.0, distance=150e3),
    *(Cell(f"crossing at {angle:g}°", "crossing", np.radians(angle)) for angle in (3, 5, 10, 20)),
    Cell("in trail, 1000 m", "trail", 1000.0),
    Cell("formation of 4, 500 m", "abreast", 500.0, targets=4),
    Cell("600 m abreast, 200 false plots", "abreast", 600.0, 30, 60e3, 200.0),
    Cell("crossing at 10°, 200 false plots", "crossing", np.radians(10), 30, 60e3, 200.0),
    Cell("apart, 200 false plots", "apart", 0.0, 30, 60e3, 200.0),
)
RUNS, CLUTTERED = repetitions(300), repetitions(80)


def hypotheses() -> str:
    """Compare one assignment for each scan with several hypotheses, on the same plots."""
    rows = []
    for at, cell in enumerate(CELLS):
        count = CLUTTERED if cell.clutter else RUNS
        one, several = runs(cell, count, [{}, {"association": "mht"}], 1, at)
        pairs = zip(one, several, strict=True)
        rise = np.array([b.gospa - a.gospa for a, b in pairs])
        error = np.std(rise) / np.sqrt(len(rise))
        swaps = [100 * np.mean([each.swapped for each in found]) for found in (one, several)]
        lost = [100 * np.mean([each.lost for each in found]) for found in (one, several)]
        nees = np.nanmean([each.nees for each in several])
        rows.append(
            [cell.name, f"{cell.distance / 1e3:g}", *(f"{share:.1f}" for share in swaps),
             f"{np.mean([each.gospa for each in one]):.1f}",
             f"{np.mean(rise):+.1f} ± {error:.1f}", f"{np.max(rise):.0f}",
             f"{lost[0]:.1f}, {lost[1]:.1f}", f"{nees:.2f}"]
        )  # fmt: skip
    head = [
        "encounter", "range, km", "swaps, %: gnn", "mht", "GOSPA, m: gnn", "mht less gnn",
        "worst run", "lost, %: gnn, mht", "NEES, mht",
    ]  # fmt: skip
    return markdown(head, rows)


# plots of one target that say whose track it is
SETTLED = 5
DOUBTFUL = tuple(cell for cell in CELLS if cell.kind == "abreast" and cell.targets == 2)
EDGES = (0.0, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5)


def calibration() -> str:
    """Compare how likely what is shown is wrong with how often it is."""
    pairs = [
        pair
        for at, cell in enumerate(DOUBTFUL)
        for run in range(CLUTTERED if cell.clutter else RUNS)
        for pair in doubts(cell, generator(57, 3, at, run))
    ]
    stated, wrong = np.array(pairs).reshape(-1, 2).T
    rows = []
    for low, high in pairwise(EDGES):
        own = (stated > low) & (stated <= high)
        count = max(int(np.sum(own)), 1)
        mean, share = np.sum(stated[own]) / count, np.sum(wrong[own]) / count
        error = np.sqrt(max(mean * (1 - mean), 1e-6) / count)
        rows.append(
            [f"{low:g} to {high:g}", f"{np.sum(own)}", f"{mean:.3f}", f"{share:.3f} ± {error:.3f}"]
        )
    return markdown(["1 − `association_probability`", "scans", "mean", "wrong"], rows)


def doubts(cell: Cell, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Return how likely what is shown is wrong, and whether it is, scan by scan.

    It is wrong where a track has another plot than that of its target: in the first scan of a
    doubt, after plots of one target in several scans, so that it is known whose track it is. Later
    the choices before belong to what is shown as well, and may be others than were shown then.
    """
    flown = encounter(cell, rng)
    plots, target = seen_of(cell, flown, RADAR, rng)
    found = track(plots, [RADAR], association="mht")
    scan = np.round(found.time / PERIOD).astype(int)
    long = [n for n in np.unique(found.track) if np.sum(found.track == n) > 0.9 * scan.max()]
    # the target of the plot of each track in each scan; of missed ones -1, of false ones -2
    taken = np.full((len(long), scan.max() + 1), -1)
    stated = np.ones(taken.shape)
    for k, number in enumerate(long):
        rows = found.track == number
        origin = np.where(target[found.plot] >= 0, target[found.plot], -2)
        taken[k, scan[rows]] = np.where(found.plot >= 0, origin, -1)[rows]
        stated[k, scan[rows]] = found.association_probability[rows]
    there = np.zeros((flown.position.shape[1], taken.shape[1]), dtype=bool)
    known = target >= 0
    there[target[known], np.round(plots.time[known] / PERIOD).astype(int)] = True
    result = []
    for k in range(len(taken)):
        own: IntArray = taken[k]
        of_track: FloatArray = stated[k]
        for at in np.flatnonzero(of_track < 1.0):
            before = own[max(at - SETTLED, 0) : at]
            if len(before) == SETTLED and of_track[at - 1] == 1.0 and np.all(before == before[0]):
                expected = before[0] if there[before[0], at] else -1
                result.append((1.0 - of_track[at], float(own[at] != expected)))
    return result


RESOLUTION: dict[str, Any] = {"range_resolution": 150.0, "azimuth_resolution": 1.4}
MERGED = (
    abreast(300.0),
    abreast(600.0),
    abreast(1000.0),
    abreast(2000.0),
    Cell("crossing at 10°", "crossing", np.radians(10)),
    Cell("in trail, 1000 m", "trail", 1000.0),
)
MERGED_RUNS = repetitions(150)


def resolution() -> str:
    """Compare trackers that know of merged plots with those that do not."""
    numbers: dict[str, Any] = {
        "range_sigma": 50.0,
        "azimuth_sigma": 0.08,
        "scan_period": PERIOD,
        "degrees": True,
    }
    knows = Radar(detection_probability=DETECTION, **numbers, **RESOLUTION)
    rows = []
    for at, cell in enumerate(MERGED):
        cells = []
        for association in ("gnn", "mht"):
            for radar in (RADAR, knows):
                found = []
                for run in range(MERGED_RUNS):
                    rng = generator(57, 2, at, run)
                    flown = encounter(cell, rng)
                    plots = plots_of(cell, flown, knows, rng)
                    found.append(outcome(flown, track(plots, [radar], association=association)))
                shares = [
                    100 * np.mean([getattr(o, k) for o in found]) for k in ("swapped", "lost")
                ]
                gospa = np.array([each.gospa for each in found])
                cells.append(f"{shares[0]:.0f} / {np.mean(gospa):.0f} / {shares[1]:.1f}")
        rows.append([cell.name, *cells])
    return markdown(["encounter", "gnn", "gnn, resolution", "mht", "mht, resolution"], rows)
