"""Figures of docs/tracker-false-tracks.md: what begins, confirms and ends tracks."""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from studies.montecarlo import FloatArray, generator
from studies.pages import markdown, repetitions
from tertia._arrays import IntArray
from tertia.tracker import Plots, Radar, Tracker, track

PERIOD, RANGE = 4.0, 100e3
# a target comes in each scan; scans in which it is there, all so many or so many in the mean
STAY, MEAN_STAY = 40, 500
SCANS, CLUTTER_SCANS = repetitions(240, least=60), repetitions(5000, least=100)
CLUTTER = (5.0, 50.0, 200.0)
RULES: dict[str, Any] = {"3 of 4 and evidence": (3, 4), "existence": 0.999}
EDGES = (0.01, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.99, 1.0)
# plots of a track that decide what it follows
LATELY = 5


@dataclass(frozen=True)
class Scene:
    """Plots in the order of time, the target of each (-1: false), when targets come and leave."""

    radar: Radar
    plots: Plots
    target: IntArray
    scan: IntArray
    comes: IntArray
    leaves: IntArray


def scene(
    detection: float,
    clutter: float,
    scans: int,
    *study: int,
    targets: bool = True,
    long: bool = False,
) -> Scene:
    """Return a scene with a new target in each scan, or none, and false plots."""
    rng = generator(73, *study)
    radar = Radar(
        range_sigma=50.0, azimuth_sigma=0.08, scan_period=PERIOD, max_range=RANGE,
        detection_probability=detection, degrees=True,
    )  # fmt: skip
    comes = np.arange(max(scans - STAY, 1) if targets else 0)
    count = len(comes)
    leaves = comes + (rng.geometric(1.0 / MEAN_STAY, count) if long else STAY)
    begin = 0.7 * RANGE * np.sqrt(rng.uniform(size=(count, 1)))
    begin = begin * directions(rng, count)
    velocity = rng.uniform(120.0, 250.0, (count, 1)) * directions(rng, count)
    columns = []
    for scan in range(scans):
        there = np.flatnonzero((comes <= scan) & (scan < leaves))
        seen = there[rng.uniform(size=len(there)) < detection]
        place = begin[seen] + (scan - comes[seen, None]) * PERIOD * velocity[seen]
        far = seen[np.hypot(*place.T) > RANGE]
        leaves[far] = scan
        place, seen = place[~np.isin(seen, far)], seen[~np.isin(seen, far)]
        distance = np.hypot(*place.T) + 50.0 * rng.normal(size=len(seen))
        azimuth = np.arctan2(*place.T) + np.radians(0.08) * rng.normal(size=len(seen))
        false = rng.poisson(clutter)
        distance = np.concatenate([distance, RANGE * np.sqrt(rng.uniform(size=false))])
        azimuth = np.concatenate([azimuth, rng.uniform(0.0, 2 * np.pi, false)])
        target = np.concatenate([seen, np.full(false, -1)])
        columns.append(np.column_stack([np.full(len(target), scan), distance, azimuth, target]))
    number, distance, azimuth, target = np.concatenate(columns).T
    plots = Plots(PERIOD * number, distance, azimuth)
    return Scene(radar, plots, target.astype(np.int64), number.astype(np.int64), comes, leaves)


def directions(rng: np.random.Generator, count: int) -> FloatArray:
    """Return unit vectors."""
    angle = rng.uniform(0.0, 2 * np.pi, count)
    return np.stack([np.sin(angle), np.cos(angle)], axis=-1)


def delays(own: Scene, rule: Any) -> IntArray:
    """Return the scans from the first plot of each target to its confirmed track."""
    found = track(own.plots, [own.radar], confirmation=rule)
    shown = found.confirmed & (found.plot >= 0)
    target, scan = own.target[found.plot[shown]], own.scan[found.plot[shown]]
    never = own.scan.max()
    waits = []
    for number in range(len(own.comes)):
        plots = own.scan[own.target == number]
        if len(plots):
            confirmed = scan[target == number]
            waits.append(1 + np.min(confirmed, initial=never) - plots[0])
    return np.array(waits)


def false_tracks(own: Scene, rule: Any) -> int:
    """Return the number of confirmed tracks where there are no targets."""
    found = track(own.plots, [own.radar], confirmation=rule)
    return len(np.unique(found.track[found.confirmed]))


def life() -> str:
    """Compare the rules that confirm tracks: how soon, and how many false tracks."""
    rows = []
    hours = CLUTTER_SCANS * PERIOD / 3600
    for i, clutter in enumerate(CLUTTER):
        empty = scene(0.7, clutter, CLUTTER_SCANS, 1, i, targets=False)
        scenes = [scene(p, clutter, SCANS, 2, i, j) for j, p in enumerate((0.9, 0.7, 0.5))]
        for name, rule in RULES.items():
            cells = []
            for own in scenes:
                wait = delays(own, rule)
                cells.append(f"{np.mean(wait):.1f} / {np.quantile(wait, 0.9):.0f}")
            false = false_tracks(empty, rule)
            rows.append([f"{clutter:g}", name, *cells, f"{false} in {hours:.1f} h"])
    head = ["false plots per scan", "rule", "P_D .9", "P_D .7", "P_D .5", "false tracks"]
    return markdown(head, rows)


def stated(own: Scene) -> list[tuple[float, float]]:
    """Return the stated probability of each row, and whether the track follows a target.

    Tracks are shown from their third plot on. One follows a target when most of its last plots
    are of it, and it is still there.
    """
    tracker = Tracker([own.radar], confirmation=0.01)
    lately: dict[int, deque[int]] = defaultdict(lambda: deque(maxlen=LATELY))
    pairs = []
    for scan in range(int(own.scan.max()) + 1):
        found = tracker.update(own.plots[own.scan == scan], time=PERIOD * (scan + 0.5))
        for number, target in zip(found.track_of_plot, own.target[own.scan == scan], strict=True):
            lately[int(number)].append(int(target))
        for row in np.flatnonzero(found.confirmed):
            ((target, _),) = Counter(lately[int(found.track[row])]).most_common(1)
            there = target >= 0 and found.time[row] < PERIOD * own.leaves[target]
            pairs.append((found.existence_probability[row], float(there)))
    return pairs


def calibration() -> str:
    """Compare how likely tracks are of targets with how often they are; long stays, then short."""
    columns = []
    for long in (True, False):
        for i, clutter in enumerate((5.0, 200.0)):
            scenes = [
                scene(p, clutter, 2 * SCANS, 3, i, j, long=long) for j, p in enumerate((0.9, 0.7))
            ]
            parts = [stated(own) for own in scenes]
            columns.append(np.concatenate([np.reshape(part, (-1, 2)) for part in parts]))
    rows = []
    for low, high in pairwise(EDGES):
        cells = []
        for k, pairs in enumerate(columns):
            own = pairs[(pairs[:, 0] > low) & (pairs[:, 0] <= high)]
            mean, share = np.mean(own, axis=0) if len(own) else (np.nan, np.nan)
            known = [f"{len(own)}", *(f"{x:.3f}" if len(own) else "–" for x in (mean, share))]
            cells += known if k < 2 else known[::2]
        rows.append([f"{low:g} to {high:g}", *cells])
    head = ["stated"]
    for count in ("5", "200"):
        head += [f"rows, {count} false plots", "mean stated", "share of targets"]
    for count in ("5", "200"):
        head += [f"rows, {STAY} scans, {count} false plots", "share of targets"]
    return markdown(head, rows)
