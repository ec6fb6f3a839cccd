"""Positions from theodolites that are not well oriented: a table of docs/location-errors.md."""

from __future__ import annotations

from typing import Any

import numpy as np

from studies.location import directions
from studies.montecarlo import FloatArray, generator, in_region
from studies.pages import markdown, repetitions
from tertia.location import locate
from tertia.sensors import Bias

RUNS, INSTANTS = repetitions(100, 4), 20
# one arc second; errors of orientations and of elevations in sigmas
SIGMA = 5e-6
ERRORS = ((0.0, 0.0), (2.0, 0.0), (4.0, 0.0), (10.0, 0.0), (10.0, 3.0))
PLACES = np.array([[0.0, 0.0, 1.6], [80.0, 10.0, 1.5], [30.0, 90.0, 1.7]])


def theodolites() -> str:
    """Tabulate the errors and the coverage, by errors of orientations and of elevations."""
    rows = []
    for orientation, elevation in ERRORS:
        row = [f"{orientation:g} σ" if orientation else "none"]
        row.append(f"{elevation:g} σ" if elevation else "none")
        for count in (2, 3):
            sigmas: dict[str, Any] = {
                "azimuth_sigma": SIGMA * orientation,
                "elevation_sigma": SIGMA * elevation,
            }
            for bias in (None, Bias(**sigmas)):
                row.append(_cell(count, orientation, elevation, bias))
        rows.append(row)
    head = ["error of orientations", "of elevations", "2 theodolites", "2, stated"]
    return markdown([*head, "3 theodolites", "3, stated"], rows)


def _cell(count: int, orientation: float, elevation: float, bias: Bias | None) -> str:
    squares, held = [], []
    for run in range(RUNS):
        rng = generator(651, round(orientation), round(elevation), count, run)
        truth = rng.uniform([10, 30, 0], [90, 90, 15], (INSTANTS, 3))
        measured: dict[str, Any] = _angles(truth, count, orientation, elevation, rng)
        fix = locate(PLACES[:count], **measured, bias=bias)
        error = (fix.position - truth)[fix.success]
        squares.append(np.sum(error**2, axis=1))
        held.append(in_region(error, fix.covariance[fix.success]))
    rmse = 1e3 * np.sqrt(np.mean(np.concatenate(squares)))
    return f"{rmse:.1f} mm; {np.mean(np.concatenate(held)):.0%}"


def _angles(
    truth: FloatArray, count: int, orientation: float, elevation: float, rng: np.random.Generator
) -> dict[str, Any]:
    """Return measured angles, whose lasting errors are so many times their sigmas."""
    true = directions(truth, PLACES[:count])
    shape = true["azimuth"].shape
    measured: dict[str, Any] = {}
    for kind, size in (("azimuth", orientation), ("elevation", elevation)):
        lasting = size * rng.standard_normal(count)
        measured[kind] = true[kind] + SIGMA * (lasting + rng.standard_normal(shape))
        measured[f"{kind}_sigma"] = SIGMA
    return measured
