"""Vessels in the sea clutter of a marine radar: docs/tracker-false-tracks.md."""

from __future__ import annotations

import numpy as np

from studies.fixed_echoes import judged, live
from studies.montecarlo import generator
from studies.pages import markdown, repetitions
from tertia._arrays import FloatArray
from tertia.tracker import Plots, Radar, TrackTable, track

SCENES = repetitions(10, 1)
SCANS, PERIOD = 360, 2.5
RADAR = Radar(range_sigma=8.0, azimuth_sigma=np.radians(0.25), scan_period=PERIOD, max_range=9000.0)
CLUTTER = (0, 20, 60, 200)
# the density of clutter at range r is exp(-r / DECAY) / r, and largest upwind
NEAREST, DECAY, WIND, UPWIND = 60.0, 1200.0, 1.0, 0.5
VESSELS, AREA, SPEEDS = 10, 6000.0, (2.0, 12.0)


def vessels(random: np.random.Generator) -> FloatArray:
    """Return times, ranges, azimuths and numbers of plots of vessels, (N, 4)."""
    place, course = random.uniform(-AREA, AREA, (VESSELS, 2)), random.uniform(0, 2 * np.pi, VESSELS)
    speed = random.uniform(*SPEEDS, VESSELS)
    velocity = speed[:, np.newaxis] * np.stack([np.sin(course), np.cos(course)], axis=1)
    scan, number = np.nonzero(random.random((SCANS, VESSELS)) < RADAR.detection_probability)
    time = PERIOD * scan
    for _ in range(3):
        at = place[number] + velocity[number] * time[:, np.newaxis]
        azimuth = np.arctan2(at[:, 0], at[:, 1]) % (2 * np.pi)
        time = PERIOD * (scan + azimuth / (2 * np.pi))
    distance = np.linalg.norm(at, axis=1) + RADAR.range_sigma * random.standard_normal(len(at))
    azimuth = azimuth + RADAR.azimuth_sigma * random.standard_normal(len(at))
    seen = distance < RADAR.max_range
    return np.column_stack([time[seen], distance[seen], azimuth[seen], number[seen]])


def clutter(count: int, random: np.random.Generator) -> FloatArray:
    """Return the same of so many false plots in a scan on average; their number is -1."""
    scan = np.repeat(np.arange(SCANS), random.poisson(count, SCANS))
    distance = NEAREST + random.exponential(DECAY, len(scan))
    azimuth = random.vonmises(WIND, UPWIND, len(scan)) % (2 * np.pi)
    time = PERIOD * (scan + azimuth / (2 * np.pi))
    found = np.column_stack([time, distance, azimuth, np.full(len(scan), -1.0)])
    return found[distance < RADAR.max_range]


def table() -> str:
    """Tabulate false tracks of sea clutter, and what becomes of vessels."""
    rows = []
    for count in CLUTTER:
        cells = []
        for way in (lambda plots: track(plots, [RADAR], profile="vessel"), _live):
            results = []
            for run in range(SCENES):
                random = generator(4500, run)
                plots = np.concatenate([vessels(random), clutter(count, random)])
                *measured, number = plots[np.argsort(plots[:, 0], kind="stable")].T
                results.append(judged(way(Plots(*measured)), number))
            false, share, held = np.mean(results, axis=0)
            cells += [f"{false:.1f}", f"{share:.1%}", f"{held:.0%}"]
        rows.append([str(count), *cells])
    head = ["false plots in a scan"]
    for called in ("recorded", "live"):
        head += [f"false tracks, {called}", "share of all rows", "plots of vessels in tracks"]
    return markdown(head, rows)


def _live(plots: Plots) -> TrackTable:
    return live(plots, RADAR, SCANS, profile="vessel")
