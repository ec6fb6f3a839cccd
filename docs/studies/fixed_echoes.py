"""Wind turbines that a radar sees again and again: docs/tracker-false-tracks.md."""

from __future__ import annotations

from typing import Any

import numpy as np

from studies.montecarlo import generator
from studies.pages import markdown, repetitions
from tertia._arrays import FloatArray, IntArray
from tertia.tracker import Plots, Radar, Tracker, TrackTable, track

SCENES = repetitions(10, 1)
SCANS, PERIOD = 150, 4.0
RADAR = Radar(
    range_sigma=80.0,
    azimuth_sigma=0.0026,
    scan_period=PERIOD,
    max_range=100e3,
    detection_probability=0.7,
)
# shares of the scans in which turbines are seen, lowest and highest
FARMS = {
    "none": None,
    "in 5 to 30 % of the scans": (0.05, 0.3),
    "in 20 to 70 %": (0.2, 0.7),
    "in 50 to 95 %": (0.5, 0.95),
}
# turbines in a row, and metres between them
ROW, PITCH, FARM = 8, 700.0, np.array([25e3, 15e3])
AIRCRAFT, ACROSS, HOVERING, CLUTTER = 6, 4, 3, 20
SPEED, APPROACH = 150.0, 60.0


def seen(place: FloatArray, scan: IntArray, random: np.random.Generator) -> FloatArray:
    """Return times, ranges and azimuths of plots of these places, (N, 3)."""
    azimuth = np.arctan2(place[:, 0], place[:, 1]) % (2 * np.pi)
    noise = random.standard_normal((len(place), 2)) * [RADAR.range_sigma, RADAR.azimuth_sigma]
    time = PERIOD * (scan + azimuth / (2 * np.pi))
    measured = np.column_stack([np.linalg.norm(place, axis=1), azimuth]) + noise
    return np.column_stack([time, measured])


def targets(random: np.random.Generator) -> list[FloatArray]:
    """Return the plots of aircraft, some across the farm, and of helicopters that hover."""
    found = []
    for number in range(AIRCRAFT + ACROSS + HOVERING):
        scan = np.flatnonzero(random.random(SCANS) < RADAR.detection_probability)
        middle, course = random.uniform(-25e3, 25e3, 2), random.uniform(0, 2 * np.pi)
        if AIRCRAFT <= number < AIRCRAFT + ACROSS:
            middle = FARM + random.uniform(-1500.0, 1500.0, 2)
        along = SPEED * PERIOD * (scan - SCANS / 2)
        if number >= AIRCRAFT + ACROSS:
            # in, a third of the time at one place, and out again
            third = SCANS / 3
            along = (
                APPROACH * PERIOD * (np.minimum(scan - third, 0) + np.maximum(scan - 2 * third, 0))
            )
        way = middle + along[:, np.newaxis] * [np.sin(course), np.cos(course)]
        found.append(seen(way, scan, random))
    return found


def turbines(share: tuple[float, float], random: np.random.Generator) -> FloatArray:
    """Return the plots of turbines, each of which is seen with a probability of its own."""
    side = (np.arange(ROW) - (ROW - 1) / 2) * PITCH
    places = FARM + np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    often = random.uniform(*share, len(places))
    scan, turbine = np.nonzero(random.random((SCANS, len(places))) < often)
    return seen(places[turbine], scan, random)


def clutter(random: np.random.Generator) -> FloatArray:
    """Return false plots at all places alike."""
    scan = np.repeat(np.arange(SCANS), CLUTTER)
    distance = RADAR.max_range * np.sqrt(random.random(len(scan)))
    azimuth = random.uniform(0, 2 * np.pi, len(scan))
    return seen(
        distance[:, np.newaxis] * np.column_stack([np.sin(azimuth), np.cos(azimuth)]), scan, random
    )


def live(plots: Plots, radar: Radar = RADAR, scans: int = SCANS, **options: Any) -> TrackTable:
    """Track scan by scan."""
    tracker, ends = Tracker([radar], **options), radar.scan_period * np.arange(1, scans + 1)
    at = np.searchsorted(plots.time, ends)
    parts = zip(np.concatenate([[0], at[:-1]]), at, ends, strict=True)
    return TrackTable.join(
        [tracker.update(plots[begin:end], time=time) for begin, end, time in parts]
    )


def judged(table: TrackTable, target: IntArray) -> tuple[int, float, float]:
    """Return the number of false tracks, their share of rows, and that of plots in tracks."""
    own = table[table.confirmed & (table.plot >= 0)]
    whose = target[own.plot]
    tracks, number = np.unique(own.track, return_inverse=True)
    is_false = 2 * np.bincount(number, whose >= 0) < np.bincount(number)
    rows = np.isin(table.track[table.confirmed], tracks[is_false])
    return (
        int(np.sum(is_false)),
        float(np.mean(rows)),
        float(np.mean(np.isin(np.flatnonzero(target >= 0), own.plot))),
    )


def table() -> str:
    """Tabulate false tracks of a farm, and what becomes of aircraft."""
    rows = []
    for name, share in FARMS.items():
        cells = []
        for way in (lambda plots: track(plots, [RADAR]), live):
            false, held = [], []
            for run in range(SCENES):
                random = generator(4400, run)
                parts = [*targets(random), clutter(random)]
                count = len(parts) - 1
                if share is not None:
                    parts.append(turbines(share, random))
                number = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
                measured = np.concatenate(parts)
                order = np.argsort(measured[:, 0], kind="stable")
                of = np.where(number < count, number, -1)[order]
                found = judged(way(Plots(*measured[order].T)), of)
                false.append(found[0])
                held.append(found[2])
            cells += [
                f"{np.mean(false):.1f}",
                f"{min(false)} to {max(false)}",
                f"{np.mean(held):.0%}",
            ]
        rows.append([name, *cells])
    head = ["64 turbines, seen"]
    for called in ("recorded", "live"):
        head += [f"false tracks, {called}", "least, most", "plots of targets in tracks"]
    return markdown(head, rows)
