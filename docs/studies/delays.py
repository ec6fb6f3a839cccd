"""Radars beside ADS-B with delays that differ by aircraft, for docs/position-sensors.md."""

from __future__ import annotations

import numpy as np

from studies.misaligned import ADSB, RADARS, SIGMA, Scene, with_reports
from studies.montecarlo import WITHIN_95
from studies.pages import markdown, repetitions
from tertia import simulate
from tertia._arrays import FloatArray
from tertia.metrics import nees
from tertia.tracker import Tracker, TrackTable, track

SCENES = repetitions(20, 1)
DURATION = float(repetitions(300, 180))
# seconds after which tracks are compared with the truth
SETTLED = 100.0
# standard deviations of the delays, in seconds
DELAYS = (0.0, 0.1, 0.3, 0.5, 1.0)
SET_UPS = {
    "two radars": (2, 20, 0.3),
    "one radar": (1, 20, 0.3),
    "two radars, all turn": (2, 20, 1.0),
    "two radars, 60 aircraft": (2, 60, 0.3),
}


def scene(seed: int, radars: int, targets: int, turning: float, delay: float) -> Scene:
    """Simulate so many radars, and ADS-B that is late by a constant of each aircraft."""
    random = np.random.default_rng([83, seed])
    traffic = simulate.dense_traffic(
        targets, area=(120e3, 120e3), turning_share=turning, duration=DURATION, rng=random
    )
    record = simulate.radar_plots(traffic, RADARS[:radars], rng=random)
    time = random.uniform(0.0, 1.0, (targets, 1)) + np.arange(DURATION - 1.0)
    target = np.broadcast_to(np.arange(targets)[:, np.newaxis], time.shape).ravel()
    position = traffic.at(target, time.ravel())[0]
    position += random.normal(0.0, SIGMA, position.shape)
    late = time.ravel() + random.normal(0.0, delay, targets)[target]
    here = np.isfinite(position).all(axis=1) & (late >= 0.0) & (late < DURATION)
    return with_reports(traffic, record, (late[here], target[here], position[here]), radars)


def live(one: Scene, radars: int) -> list[TrackTable]:
    """Track in steps of four seconds."""
    tracker, tables = Tracker([*RADARS[:radars], ADSB]), []
    for begin in np.arange(0.0, DURATION, 4.0):
        now = (one.plots.time >= begin) & (one.plots.time < begin + 4.0)
        tables.append(tracker.update(one.plots[now], time=begin + 4.0))
    return tables


def whole(one: Scene, radars: int) -> list[TrackTable]:
    """Track as a recording."""
    return [track(one.plots, [*RADARS[:radars], ADSB])]


def compared(one: Scene, tables: list[TrackTable]) -> tuple[FloatArray, FloatArray, float]:
    """Return errors, their normalised squares, and tracks per aircraft."""
    errors, squares, tracks, targets = [], [], set(), set()
    for table in tables:
        own = one.target[table.plot]
        known = (table.time > SETTLED) & (table.plot >= 0) & (own >= 0)
        late, own = table[known], own[known]
        tracks |= set(late.track.tolist())
        targets |= set(own.tolist())
        error = late.position - one.traffic.at(own, late.time)[0]
        # that of a flight may end before its last plot
        there = np.isfinite(error).all(axis=1)
        errors.append(error[there])
        squares.append(np.asarray(nees(error[there], late.covariance[there, :2, :2])))
    return np.concatenate(errors), np.concatenate(squares), len(tracks) / len(targets)


def delays() -> str:
    """Return how good tracks are, and how many, for delays that differ more and more."""
    rows = []
    cases = [(name, *numbers, True) for name, numbers in SET_UPS.items()]
    cases.append(("two radars, recording", *SET_UPS["two radars"], False))
    for name, radars, targets, turning, is_live in cases:
        cells = []
        for delay in DELAYS:
            found = []
            for seed in range(max(1, round(SCENES * 20 / targets))):
                one = scene(seed, radars, targets, turning, delay)
                tables = live(one, radars) if is_live else whole(one, radars)
                found.append(compared(one, tables))
            error, square = (np.concatenate([one[i] for one in found]) for i in (0, 1))
            rmse = np.sqrt(np.mean(np.sum(error**2, axis=1)))
            count = np.mean([one[2] for one in found])
            cells.append(f"{rmse:.3g} m, {np.mean(square < WITHIN_95[2]):.1%}, {count:.2f}")
        rows.append([name, *cells])
    return markdown(["sensors beside ADS-B", *(f"σ = {delay:g} s" for delay in DELAYS)], rows)
