"""Tracks of the demo scene, of which one radar measures too far and becomes noisier."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from studies.pages import markdown, repetitions
from studies.registration import pieces, scored
from tertia import simulate
from tertia._arrays import FloatArray
from tertia.sensors import Bias, Radar
from tertia.tracker import Tracker

SEEDS = repetitions(10)
PERIODS = ((0.0, 60.0), (60.0, 450.0), (450.0, 540.0), (540.0, 900.0), (0.0, 900.0))
WAYS = ("not registered", "known", "registered")


def _followed(scene: simulate.Scene, way: str) -> tuple[FloatArray, int, int]:
    """Return mean squares and NEES (periods, 2), tracks of aircraft, and false ones."""
    radars: list[Radar] = scene.radars
    late = {}
    for k, radar in enumerate(radars):
        fault = scene.radar_faults.get(str(radar.name), {})
        if way == "known":
            bias = Bias(range=fault.get("range_bias_m", 0.0))
            radars = [*radars[:k], replace(radar, bias=bias), *radars[k + 1 :]]
        if fault:
            late[k] = np.radians(fault["azimuth_sigma_deg"])
    tracker = Tracker(radars, registration=way == "registered")
    plots, target, tables = scene.record.plots, scene.record.target, []
    for some, end in pieces(plots, PERIODS[-1][1]):
        if way == "known" and end > PERIODS[1][1]:
            noise = [
                [one.range_sigma, late.get(k, one.azimuth_sigma)] for k, one in enumerate(radars)
            ]
            tracker._core.set_noise(np.array(noise))
        tables.append(tracker.update(some, time=end))
    time, plot, number, confirmed, position, covariance = (
        np.concatenate([getattr(table, name) for table in tables])
        for name in ("time", "plot", "track", "confirmed", "position", "covariance")
    )
    of = np.where(plot >= 0, target[np.maximum(plot, 0)], -1)
    place, _, _ = scene.traffic._state(np.maximum(of, 0), time)
    of_rows = time, position - place, covariance
    cells = scored(of_rows, confirmed & (of >= 0), radars, np.min(plots.time), PERIODS)
    shown = confirmed & (plot >= 0)
    true = [np.mean(of[shown & (number == one)] >= 0) > 0.5 for one in np.unique(number[shown])]
    return cells, int(np.sum(true)), int(np.sum(np.logical_not(true)))


def table() -> str:
    """Return RMSE and NEES of tracks as they are, with errors that are known, and registered."""
    scenes = [simulate.scene(rng=1 + seed) for seed in range(SEEDS)]
    found = {way: [_followed(scene, way) for scene in scenes] for way in WAYS}
    best = np.nanmean([cells[:, 0] for cells, _, _ in found["known"]], axis=0)
    rows = []
    for way, runs in found.items():
        cells = np.nanmean([one for one, _, _ in runs], axis=0)
        ratio = np.sqrt(cells[:, 0] / best)
        of_periods = [f"{a:.3f}, {b:.2f}" for a, b in zip(ratio, cells[:, 1], strict=True)]
        tracks = f"{np.mean([one[1] for one in runs]):.1f}"
        false = str(sum(one[2] for one in runs))
        rows.append([way, *of_periods, f"{np.sqrt(cells[-1, 0]):.1f}", tracks, false])
    head = ["errors", *(f"{low:.0f} to {high:.0f} s" for low, high in PERIODS)]
    return markdown([*head, "RMSE, m", "tracks of 24 aircraft", "false tracks"], rows)
