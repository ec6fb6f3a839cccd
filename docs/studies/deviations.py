"""Azimuth errors that change with the azimuth, for docs/registration.md."""

from __future__ import annotations

import numpy as np

from studies.pages import markdown, repetitions
from tertia import simulate
from tertia._arrays import FloatArray
from tertia.metrics import nees
from tertia.sensors import Bias, Radar
from tertia.tracker import smooth_tracks

SCENES = repetitions(10, 1)
PLACES = [(-30e3, 0.0), (30e3, 0.0), (0.0, 40e3)]
RADARS = [
    Radar(place, range_sigma=50.0, azimuth_sigma=0.08, scan_period=5.0, degrees=True)
    for place in PLACES
]
# amplitudes in degrees and orders of the error of the first radar
ERRORS = [(0.0, 1), (0.05, 1), (0.1, 1), (0.2, 1), (0.1, 2), (0.2, 2)]
# 95 % of chi-square with two degrees of freedom
INSIDE = 5.991


def scene(seed: int, radars: int, amplitude: float, order: int) -> tuple[FloatArray, ...]:
    """Return errors of smoothed positions, their normalised squares, and the stated variances."""
    random = np.random.default_rng([71, seed])
    traffic = simulate.dense_traffic(
        20, area=(120e3, 120e3), turning_share=0.3, duration=900.0, rng=random
    )
    curve = np.zeros((radars, 4))
    phase = random.uniform(0.0, 2.0 * np.pi)
    curve[0, 2 * order - 2 : 2 * order] = amplitude * np.array([np.sin(phase), np.cos(phase)])
    bias = Bias(range=np.zeros(radars), deviation_order=2, deviation=curve, degrees=True)
    record = simulate.radar_plots(traffic, RADARS[:radars], bias=bias, rng=random)
    found = smooth_tracks(record.plots, RADARS[:radars])
    found = found[found.plot >= 0]
    own = record.target[found.plot]
    truth = traffic.at(np.maximum(own, 0), found.time)[0]
    known = (own >= 0) & np.isfinite(truth).all(axis=1)
    off, spread = (found.position - truth)[known], found.covariance[known, :2, :2]
    square = 2.0 * np.asarray(nees(off, spread))
    return np.sum(off**2, axis=1), square, np.trace(spread, axis1=1, axis2=2)


def deviations() -> str:
    """Return coverage, errors and stated sigmas of smoothed tracks."""
    rows = []
    for radars in (2, 3):
        for amplitude, order in ERRORS:
            parts = [scene(seed, radars, amplitude, order) for seed in range(SCENES)]
            errors, squares, stated = (np.concatenate(one) for one in zip(*parts, strict=True))
            times = ("", "once", "twice")[order] if amplitude else "-"
            rows.append(
                [
                    f"{radars}",
                    f"{amplitude:g}°" if amplitude else "none",
                    times,
                    f"{np.mean(squares < INSIDE):.0%}",
                    f"{np.sqrt(np.mean(errors)):.0f} m",
                    f"{np.sqrt(np.mean(stated)):.0f} m",
                ]
            )
    return markdown(["radars", "error", "around", "inside 95 %", "error", "stated"], rows)
