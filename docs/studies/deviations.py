"""Azimuth errors that change with the azimuth, for docs/registration.md."""

from __future__ import annotations

import numpy as np

from studies.pages import markdown, repetitions
from tertia import simulate
from tertia._arrays import FloatArray
from tertia.metrics import nees
from tertia.sensors import Bias, Radar
from tertia.tracker import Tracker, smooth_tracks

SCENES = repetitions(10, 1)
PLACES = [(-30e3, 0.0), (30e3, 0.0), (0.0, 40e3)]
RADARS = [
    Radar(place, range_sigma=50.0, azimuth_sigma=0.08, scan_period=5.0, degrees=True)
    for place in PLACES
]
# amplitudes in degrees and orders of the error of the first radar
ERRORS = [(0.0, 1), (0.05, 1), (0.1, 1), (0.2, 1), (0.1, 2), (0.2, 2)]
# seconds after which positions are compared
SETTLED = 120.0
# 95 % of chi-square with two degrees of freedom
INSIDE = 5.991


def scene(seed: int, radars: int, amplitude: float, order: int) -> list[tuple[FloatArray, ...]]:
    """Return errors and covariances of the positions of smoothed tracks and of a tracker."""
    random = np.random.default_rng([71, seed])
    traffic = simulate.dense_traffic(
        20, area=(120e3, 120e3), turning_share=0.3, duration=900.0, rng=random
    )
    curve = np.zeros((radars, 4))
    phase = random.uniform(0.0, 2.0 * np.pi)
    curve[0, 2 * order - 2 : 2 * order] = amplitude * np.array([np.sin(phase), np.cos(phase)])
    bias = Bias(range=np.zeros(radars), deviation_order=2, deviation=curve, degrees=True)
    record = simulate.radar_plots(traffic, RADARS[:radars], bias=bias, rng=random)
    results: list[tuple[FloatArray, ...]] = []
    for found in (
        smooth_tracks(record.plots, RADARS[:radars]),
        Tracker(RADARS[:radars]).update(record.plots),
    ):
        rows = np.flatnonzero((found.plot >= 0) & (found.time > SETTLED))
        own = record.target[found.plot[rows]]
        truth = traffic.at(np.maximum(own, 0), found.time[rows])[0]
        known = (own >= 0) & np.isfinite(truth).all(axis=1)
        off = (found.position[rows] - truth)[known]
        results.append((off, found.covariance[rows][known, :2, :2]))
    return results


def deviations() -> str:
    """Return coverage, errors and stated errors of smoothed tracks and of a tracker."""
    rows = []
    for radars in (2, 3):
        for amplitude, order in ERRORS:
            parts = [scene(seed, radars, amplitude, order) for seed in range(SCENES)]
            cells = []
            for at in range(2):
                off, spread = (np.concatenate([one[at][k] for one in parts]) for k in range(2))
                cells.append(f"{np.mean(2.0 * np.asarray(nees(off, spread)) < INSIDE):.0%}")
                cells.append(f"{np.sqrt(np.mean(np.sum(off**2, axis=1))):.0f} m")
                cells.append(f"{np.sqrt(np.mean(np.trace(spread, axis1=1, axis2=2))):.0f} m")
            times = ("", "once", "twice")[order] if amplitude else "-"
            error = f"{amplitude:g}°" if amplitude else "none"
            rows.append([f"{radars}", error, times, *cells])
    smoothed = ["inside 95 %", "RMSE", "stated RMSE"]
    tracked = [f"tracker, {name}" for name in smoothed]
    return markdown(["radars", "azimuth error", "times around", *smoothed, *tracked], rows)
