"""Errors of radars that are found, against the smallest that are possible (Cramer, Rao)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from studies.pages import markdown, repetitions
from studies.registration import ERRORS, RADARS, SET_UPS, columns, pieces, places, recorded
from tertia import simulate
from tertia._arrays import BoolArray, FloatArray, IntArray
from tertia.registration import register
from tertia.sensors import RADAR_LIMITS, Bias, Radar
from tertia.tracker import Plots, Tracker

SEED, DURATION = 47, 600.0
SCENES, LIVE_SCENES = repetitions(40, 1), repetitions(10, 1)
# accelerations of a flight between its plots, straight on and in turns that are known, m/s2
STRAIGHT, TURN = 0.05, 3.0
# errors that drift as trackers assume it, by steps of so many seconds
STEP, DRIFT_TIME = 30.0, float(RADAR_LIMITS.drift_time or np.inf)
STEPS, REST = int(DURATION / STEP), np.exp(-STEP / DRIFT_TIME)
DRAWS = ("normal", "uniform", "drifting")
CONSTANT = replace(RADAR_LIMITS, drift_share=0.0)
LIMITS = columns(RADAR_LIMITS, "_sigma")
PLOTS = ("time", "range", "azimuth", "sensor", "height", "identity")


@dataclass(frozen=True)
class Scene:
    """Plots of radars with errors, (steps, K, 4), and what is true of them."""

    plots: Plots
    target: IntArray
    used: BoolArray
    traffic: simulate.Traffic
    stated: list[Radar]
    real: list[Radar]
    errors: FloatArray


def scene(name: simulate.SetUpName, draw: str, seed: int) -> Scene:
    """Return plots with errors that are drawn in this way."""
    random = np.random.default_rng([SEED, SET_UPS.index(name), DRAWS.index(draw), seed])
    setting = simulate.set_up(name)
    stated = [
        replace(setting.radar, position=place, scan_period=period)
        for place, period in places(setting, random)
    ]
    factor = random.uniform(0.7, 1.8, (RADARS, 2))
    real = [
        replace(
            one, range_sigma=one.range_sigma * range_, azimuth_sigma=one.azimuth_sigma * azimuth
        )
        for one, (range_, azimuth) in zip(stated, factor, strict=True)
    ]
    first = random.standard_normal((RADARS, len(ERRORS)))
    if draw == "uniform":
        first = random.uniform(-1.0, 1.0, first.shape)
    errors = np.empty((STEPS, *first.shape))
    new = np.asarray(random.standard_normal(errors.shape))
    for i in range(STEPS):
        errors[i] = LIMITS * first
        if draw == "drifting":
            first = REST * first + np.sqrt(1.0 - REST**2) * new[i]
    traffic, record = recorded(name, real, random)
    record = record[record.plots.time < DURATION]
    given = {column: getattr(record.plots, column) for column in PLOTS}
    own = errors[step_of(given["time"]), given["sensor"]]
    own = np.where(record.target[:, np.newaxis] >= 0, own, 0.0)
    given["range"] = given["range"] * (1.0 + own[:, 1]) + own[:, 0]
    given["azimuth"] = given["azimuth"] + own[:, 2]
    moved = given["time"] + own[:, 3]
    used = (record.target >= 0) & ~record.outlier
    order = np.argsort(moved, kind="stable")
    shown = Plots(**{**given, "time": moved})[order]
    return Scene(shown, record.target[order], used[order], traffic, stated, real, errors)


def step_of(time: FloatArray) -> IntArray:
    """Return in which step of the drift times are."""
    return (time / STEP).astype(int).clip(0, STEPS - 1)


@cache
def bound(name: simulate.SetUpName, draw: str, seed: int, steps: int) -> FloatArray:
    """Return the smallest standard deviations at the end, in limits, (K, 4).

    Whole flights whose turns are known, without outliers, and with the true noise; of errors that
    are constant, in one step, or of those that drift. The latter is the bound of a Kalman filter
    that knows the flights.
    """
    case, order = scene(name, draw, seed), RADARS * len(ERRORS)
    path = np.eye(steps)
    if steps > 1:
        # a drift is normal and independent from step to step
        path = (path - np.eye(steps, k=-1) * REST) / np.sqrt(1.0 - REST**2)
        path[0] = np.eye(steps)[0]
    information = np.kron(path.T @ path, np.eye(order))
    for flight in np.unique(case.target[case.used]):
        rows = np.flatnonzero(case.used & (case.target == flight))
        if len(rows) > 3:
            information += _of_flight(case, rows, int(flight), steps)
    variance = np.diagonal(np.linalg.inv(information))[-order:]
    return np.sqrt(variance).reshape(RADARS, -1)


def _of_flight(case: Scene, rows: IntArray, flight: int, steps: int) -> FloatArray:
    """Return what the plots of a flight tell of the errors."""
    time, sensor = case.plots.time[rows], case.plots.sensor[rows]
    position, velocity, height = case.traffic._state(np.full(len(rows), flight), time)
    off = position - np.array([one.position[:2] for one in case.real])[sensor]
    ground = np.hypot(*off.T)
    slant = np.hypot(ground, np.nan_to_num(height))
    along = off / ground[:, np.newaxis]
    axes = np.stack([along, np.stack([along[:, 1], -along[:, 0]], axis=-1)], axis=1)
    noise = np.array([[one.range_sigma, one.azimuth_sigma] for one in case.real])[sensor]
    sigma = noise * np.stack([slant / ground, ground], axis=-1)
    # by each error, along and across
    late = -np.einsum("nai,ni->na", axes, velocity)
    zero = np.zeros(len(rows))
    rows_of = [
        np.stack([slant / ground, slant**2 / ground, zero, late[:, 0]], axis=-1),
        np.stack([zero, zero, ground, late[:, 1]], axis=-1),
    ]
    own = np.stack(rows_of, axis=1) * LIMITS
    design = np.zeros((len(rows), 2, steps, RADARS, len(ERRORS)))
    design[np.arange(len(rows)), :, np.minimum(step_of(time), steps - 1), sensor] = own
    # where random accelerations between plots take the target
    gap = np.diff(time)
    sample = ((time[:-1] - case.traffic.start[flight]) / case.traffic.step).astype(int)
    turns = case.traffic.turning[flight, sample.clip(0, case.traffic.count[flight] - 1)]
    after = time[:, np.newaxis] - time[np.newaxis, 1:]
    push = np.where(after >= 0.0, gap**2 / 2 + gap * after, 0.0) * np.where(turns, TURN, STRAIGHT)
    motion = np.kron(push @ push.T, np.eye(2))
    turned = np.zeros((2 * len(rows), 2 * len(rows)))
    for i, (axis, own_sigma) in enumerate(zip(axes, sigma, strict=True)):
        turned[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = axis / own_sigma[:, np.newaxis]
    middle = time - np.mean(time)
    free = turned @ np.kron(np.stack([np.ones_like(middle), middle], axis=-1), np.eye(2))
    known = design.reshape(2 * len(rows), -1) / sigma.reshape(-1, 1)
    both = np.hstack([free, known])
    spread = turned @ motion @ turned.T + np.eye(2 * len(rows))
    products = both.T @ np.linalg.solve(spread, both)
    seen, mixed = products[:4, :4], products[:4, 4:]
    return np.asarray(products[4:, 4:] - mixed.T @ np.linalg.solve(seen, mixed))


def online(case: Scene, sensors: Sequence[Radar]) -> Bias:
    """Return the errors that a tracker knows at the end."""
    tracker = Tracker(sensors, registration=True)
    for some, end in pieces(case.plots, DURATION):
        tracker.update(some, time=end)
    return tracker.bias


@cache
def run(name: simulate.SetUpName, draw: str, way: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return errors, what is claimed, and both bounds (2), in limits, (scenes, K, 4) each."""
    off, claimed, least = [], [], []
    for seed in range(SCENES if way == "batch" else LIVE_SCENES):
        case = scene(name, draw, seed)
        if way == "batch":
            found = register(case.plots, case.stated).bias
        elif way == "drifting":
            found = online(case, case.stated)
        else:
            found = online(case, [replace(one, bias=CONSTANT) for one in case.stated])
        off.append((columns(found) - case.errors[-1]) / LIMITS)
        claimed.append(columns(found, "_sigma") / LIMITS)
        # no bound of constants holds for errors that drift, and only a tracker may assume drift
        bounds = [draw != "drifting", way == "drifting"]
        least.append(
            [
                bound(name, draw, seed, steps) if holds else np.full((RADARS, len(ERRORS)), np.nan)
                for steps, holds in zip((1, STEPS), bounds, strict=True)
            ]
        )
    return np.array(off), np.array(claimed), np.array(least)


def _rows(cases: Iterable[tuple[str, Sequence[str]]], bounds: int) -> Iterator[list[str]]:
    """Return errors over their bounds, and how often they are within two standard deviations."""
    for way, draws in cases:
        for name in SET_UPS:
            for draw in draws:
                off, claimed, least = run(name, draw, way)
                smallest = np.sqrt(np.mean(least**2, axis=(0, 2)))
                ratio = (np.sqrt(np.mean(off**2, axis=(0, 1))) / smallest)[:bounds, :3]
                cells = ["-" if np.isnan(one) else f"{one:.2f}" for one in ratio.ravel()]
                inside = np.abs(off) < 2 * claimed
                each = [f"{one:.0%}" for one in np.mean(inside, axis=(0, 1))]
                yield [way, name, draw, *cells, *each, f"{np.mean(inside):.1%}"]


KNOWN = ("range", "gain", "azimuth")
WITHIN = [*(f"within 2σ: {one}" for one in (*KNOWN, "time")), "all"]


def table() -> str:
    """Return the errors of recordings over the bound."""
    rows = [row[1:] for row in _rows([("batch", DRAWS[:2])], 1)]
    return markdown(["", "errors", *KNOWN, *WITHIN], rows)


def drift() -> str:
    """Return the errors of trackers over the bounds, without drift and with it."""
    rows = list(_rows([("constant", DRAWS[:2]), ("drifting", DRAWS)], 2))
    head = ["assumed", "set-up", "errors", *KNOWN, *(f"with drift: {one}" for one in KNOWN)]
    return markdown([*head, *WITHIN], rows)
