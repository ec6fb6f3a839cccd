"""Paths of which one station is wrong from half-way on, for trajectory-systematic-errors.md."""

from __future__ import annotations

from typing import Any

import numpy as np

from studies.montecarlo import in_region
from studies.pages import markdown, repetitions
from tertia._arrays import FloatArray
from tertia.location import Station
from tertia.trajectory import reconstruct

RUNS = repetitions(20, 4)
COUNT, INTERVAL = 100, 2.0
# metres of range, and radians
SIGMA, AZIMUTH_SIGMA = 10.0, np.radians(2.0)
LIGHT = 299_792_458.0
# errors of the wrong station, in sigmas
JUMP = {"range": 20.0, "arrival_time": 20.0, "azimuth": 15.0}
PLACES = np.array([[0.0, 0.0], [8e3, 0.0], [0.0, 8e3], [8e3, 8e3], [4e3, -3e3]])
SEED = 97


def record(
    seed: int, kind: str, count: int, jump: float
) -> tuple[list[Station], dict[str, Any], FloatArray]:
    """Return stations, measurements of which the second are wrong half-way, and the path."""
    rng = np.random.default_rng([SEED, seed])
    course = rng.uniform(0, 2 * np.pi) + np.cumsum(0.03 * rng.standard_normal(COUNT))
    path = 4e3 + np.cumsum(20.0 * np.column_stack([np.sin(course), np.cos(course)]), axis=0)
    away = path[:, np.newaxis] - PLACES[:count]
    noise = rng.standard_normal(away.shape[:2])
    noise[COUNT // 2 :, 1] += jump
    distance = np.linalg.norm(away, axis=-1)
    time = INTERVAL * np.arange(COUNT)
    options: dict[str, Any]
    if kind == "range":
        options, values = {"range_sigma": SIGMA}, distance + SIGMA * noise
    elif kind == "azimuth":
        options = {"azimuth_sigma": AZIMUTH_SIGMA}
        values = np.arctan2(away[..., 0], away[..., 1]) + AZIMUTH_SIGMA * noise
    else:
        options = {"arrival_time_sigma": SIGMA / LIGHT}
        values = time[:, np.newaxis] + (distance + SIGMA * noise) / LIGHT
    stations = [Station(place, **options) for place in PLACES[:count]]
    return stations, {kind: values}, path


def figures(kind: str, count: int, jump: float) -> tuple[str, str, str]:
    """Return the median RMSE of the records, the largest, and the share inside the 95 % regions."""
    errors, inside = [], []
    for seed in range(RUNS):
        stations, measured, path = record(seed, kind, count, jump)
        track = reconstruct(stations, INTERVAL * np.arange(COUNT), **measured)
        error = track.position - path
        errors.append(np.sqrt(np.mean(np.sum(error**2, axis=1))))
        inside.append(np.mean(in_region(error, track.covariance[:, :2, :2])))
    median, largest = np.median(errors), np.max(errors)
    return f"{median:.1f} m", f"{largest:.1f} m", f"{100 * np.mean(inside):.0f}%"


def changed_station() -> str:
    """Return the accuracy of paths with and without a station that changes."""
    rows = []
    for name, kind, count in (
        ("3, ranges", "range", 3),
        ("4, ranges", "range", 4),
        ("4, times of arrival", "arrival_time", 4),
        ("5, times of arrival", "arrival_time", 5),
        ("3, bearings", "azimuth", 3),
        ("4, bearings", "azimuth", 4),
    ):
        right, wrong = (figures(kind, count, jump) for jump in (0.0, JUMP[kind]))
        rows.append([name, right[0], right[2], *wrong])
    head = ["stations", "RMSE, all are right", "inside the 95% region"]
    return markdown([*head, "RMSE, one changes", "largest", "inside"], rows)
