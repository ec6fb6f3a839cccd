"""Figures of docs/registration.md."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from studies.pages import markdown, repetitions
from tertia import simulate
from tertia._arrays import BoolArray, FloatArray
from tertia.metrics import nees
from tertia.registration import Registration, register
from tertia.sensors import RADAR_LIMITS, Bias, Radar
from tertia.tracker import Plots, Tracker, track

SEED = 31
SCENES, RADARS, FLIGHTS, DURATION = repetitions(40), 3, repetitions(15, 6), 600.0
SET_UPS: tuple[simulate.SetUpName, ...] = ("tma", "middle", "en-route")
NOISE = ("range", "azimuth")
ERRORS = ("range", "range_gain", "azimuth", "time")
ALIGNED = repetitions(3, 1)
LIVE, AIRCRAFT = repetitions(10, 1), 20
PERIODS = ((0.0, 60.0), (60.0, 180.0), (180.0, 300.0), (300.0, 600.0), (600.0, 900.0))
# scans of the slowest radar before which a tracker that registers gives no rows
FIRST_SCANS = 3.0
# a row farther from its target is of another one, metres
ASTRAY = 2000.0
AZIMUTHS = (0.0, 0.1, 0.2, 0.3, 0.5, 1.0)


def columns(bias: Bias, suffix: str = "") -> FloatArray:
    """Return the systematic errors of radars, (K, 4)."""
    return np.stack([np.asarray(getattr(bias, kind + suffix)) for kind in ERRORS], axis=-1)


def drawn(random: np.random.Generator, count: int) -> Bias:
    """Return systematic errors within the limits, normally distributed."""
    value = columns(RADAR_LIMITS, "_sigma") * random.standard_normal((count, len(ERRORS)))
    return Bias(range=value[:, 0], range_gain=value[:, 1], azimuth=value[:, 2], time=value[:, 3])


def places(setting: simulate.SetUp, random: np.random.Generator) -> list[tuple[FloatArray, float]]:
    """Return where the radars are, and their scan periods."""
    found = []
    for k in range(RADARS):
        angle = 2 * np.pi * k / RADARS + random.uniform(0.0, 1.0)
        place = 0.35 * setting.distance[1] * np.array([np.sin(angle), np.cos(angle)])
        found.append((place, setting.radar.scan_period * (1.0 + 0.25 * k)))
    return found


def scene(name: simulate.SetUpName, seed: int) -> tuple[Registration, FloatArray, Bias]:
    """Return what is found, the true noise factors (K, 2) and the true errors."""
    random = np.random.default_rng([SEED, SET_UPS.index(name), seed])
    setting = simulate.set_up(name)
    factor = random.uniform(0.7, 1.8, (RADARS, 2))
    stated = [
        replace(setting.radar, position=place, scan_period=period)
        for place, period in places(setting, random)
    ]
    real = [
        replace(
            radar,
            range_sigma=radar.range_sigma * factor[k, 0],
            azimuth_sigma=radar.azimuth_sigma * factor[k, 1],
        )
        for k, radar in enumerate(stated)
    ]
    bias = drawn(random, RADARS)
    _, record = recorded(name, real, random, bias)
    plots = record.plots[record.plots.time < DURATION]
    return register(plots, stated), factor, bias


def recorded(
    name: simulate.SetUpName,
    real: Sequence[Radar],
    random: np.random.Generator,
    bias: Bias | None = None,
) -> tuple[simulate.Traffic, simulate.RadarPlots]:
    """Return flights, and what radars with these errors record of them."""
    routes = simulate.routes(name, FLIGHTS, rng=random)
    traffic = simulate.flights(routes, wind=simulate.set_up(name).wind, rng=random)
    record = simulate.radar_plots(
        traffic,
        real,
        clutter=2,
        bias=bias,
        outlier_probability=0.02,
        height_missing_probability=0.02,
        rng=random,
    )
    return traffic, record


@cache
def normalised(name: simulate.SetUpName) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return errors over their sigmas (N, 4), NEES, and errors of noise (N, 2), also relative."""
    off, squares, noise, relative = [], [], [], []
    for seed in range(SCENES):
        found, factor, bias = scene(name, seed)
        error = columns(found.bias) - columns(bias)
        off.append(error / columns(found.bias, "_sigma"))
        squares.append(nees(error.ravel(), found.covariance) / error.size)
        level, sigma = (
            np.stack([np.asarray(getattr(one, kind)) for kind in NOISE], axis=-1)
            for one in (found.noise_factor, found.noise_factor_sigma)
        )
        noise.append((level - factor) / sigma)
        relative.append(level / factor - 1)
    several = (np.concatenate(one) for one in (off, noise, relative))
    bias_errors, noise_errors, parts = several
    return bias_errors, np.array(squares), noise_errors, parts


def coverage() -> str:
    """Return how often errors are within two standard deviations."""
    rows = []
    for name in SET_UPS:
        off, squares, noise, relative = normalised(name)
        cells = [f"{np.mean(np.abs(off[:, j]) < 2):.0%}" for j in range(len(ERRORS))]
        cells.append(f"{np.mean(squares):.2f}")
        cells += [f"{np.mean(np.abs(noise[:, j]) < 2):.0%}" for j in range(2)]
        rows.append([name, str(len(off)), *cells, f"{np.mean(relative):+.1%}"])
    head = ["", "radars", "range", "gain", "azimuth", "time", "NEES"]
    head += ["range noise", "azimuth noise", "noise, mean error"]
    return markdown(head, rows)


def aligned() -> str:
    """Return the tracks of 20 aircraft where one of two radars has an azimuth error."""
    counts: dict[str, list[list[int]]] = {
        "not registered": [],
        "registered while tracking": [],
        "registered beforehand": [],
    }
    errors: list[list[float]] = []
    radars = [
        Radar([east, 0.0], range_sigma=50.0, azimuth_sigma=0.0014, scan_period=period)
        for east, period in ((-5e4, 4.0), (5e4, 5.0))
    ]
    for azimuth in AZIMUTHS:
        both: dict[str, list[int]] = {name: [] for name in counts}
        errors.append([])
        for seed in range(ALIGNED):
            traffic = simulate.dense_traffic(20, area=(1e5, 1e5), rng=seed)
            bias = Bias(azimuth=[0.0, azimuth], range=[0.0, 100.0], degrees=True)
            plots = simulate.radar_plots(traffic, radars, bias=bias, rng=seed + 100).plots
            found = register(plots, radars)
            ways = ((radars, False), (radars, True), (found.sensors, False))
            for name, (sensors, registers) in zip(counts, ways, strict=True):
                tracks = track(plots, sensors, registration=registers)
                both[name].append(len(np.unique(tracks.track[tracks.confirmed])))
            errors[-1].append(float(np.degrees(found.bias.azimuth)[1]) - azimuth)
        for name, one in both.items():
            counts[name].append(one)
    rows = [[name, *(f"{np.mean(one):.1f}" for one in several)] for name, several in counts.items()]
    rows.append(
        ["largest error of the estimated azimuth", *(f"{np.max(np.abs(e)):.3f}°" for e in errors)]
    )
    return markdown(["tracks of 20 aircraft", *(f"{azimuth}°" for azimuth in AZIMUTHS)], rows)


def pieces(plots: Plots, duration: float) -> Iterator[tuple[Plots, float]]:
    """Return the plots of each four seconds, and when these end."""
    ends = np.arange(4.0, duration + 4.0, 4.0)
    edges = np.concatenate([[0], np.searchsorted(plots.time, ends)])
    for a, b, end in zip(edges, edges[1:], ends, strict=False):
        yield plots[a:b], float(end)


def scored(
    rows: tuple[FloatArray, FloatArray, FloatArray],
    used: BoolArray,
    radars: Sequence[Radar],
    begin: float,
    periods: Sequence[tuple[float, float]],
) -> FloatArray:
    """Return mean squares and NEES per axis of rows in each period, (periods, 2).

    `rows` has times, errors of positions and covariances. Rows far from their targets do not count,
    nor those of the first scans after `begin`.
    """
    time, error, covariance = rows
    slowest = max(radar.scan_period for radar in radars)
    used = used & (np.hypot(*error.T) < ASTRAY) & (time >= begin + FIRST_SCANS * slowest)
    cells = []
    for low, high in periods:
        now = used & (time >= low) & (time < high)
        squares = np.sum(error[now] ** 2, axis=1)
        cells.append([np.mean(squares), np.mean(nees(error[now], covariance[now][:, :2, :2])) / 2])
    return np.array(cells)


def followed(
    record: simulate.RadarPlots, radars: list[Radar], place: FloatArray, *, registers: bool
) -> tuple[FloatArray, int]:
    """Return squared errors and NEES of rows in each period, and the number of tracks."""
    plots = record.plots
    tracker = Tracker(radars, registration=registers)
    tables = [tracker.update(some, time=end) for some, end in pieces(plots, PERIODS[-1][1])]
    time, row, track_, confirmed = (
        np.concatenate([getattr(table, name) for table in tables])
        for name in ("time", "plot", "track", "confirmed")
    )
    position = np.concatenate([table.position for table in tables])
    covariance = np.concatenate([table.covariance for table in tables])
    used = confirmed & (row >= 0) & (record.target[row] >= 0)
    of_rows = time, position - place[row], covariance
    cells = scored(of_rows, used, radars, np.min(plots.time), PERIODS)
    return cells, len(np.unique(track_[confirmed]))


def live() -> str:
    """Return errors of tracks with registration over those of tracks that know the errors."""
    rows = []
    for name in SET_UPS:
        ratios: dict[str, list[FloatArray]] = {}
        counts: dict[str, list[int]] = {}
        for seed in range(LIVE):
            random = np.random.default_rng([SEED, 7, SET_UPS.index(name), seed])
            setting = simulate.set_up(name)
            stated = [
                replace(setting.radar, position=place, scan_period=period)
                for place, period in places(setting, random)
            ]
            limits = columns(RADAR_LIMITS, "_sigma")
            value = limits * random.uniform(-1.0, 1.0, (RADARS, len(ERRORS)))
            bias = Bias(
                range=value[:, 0], range_gain=value[:, 1], azimuth=value[:, 2], time=value[:, 3]
            )
            traffic = simulate.flights(
                simulate.routes(name, AIRCRAFT, rng=random), wind=setting.wind, rng=random
            )
            record = simulate.radar_plots(
                traffic, stated, clutter=5, bias=bias, outlier_probability=0.01, rng=random
            )
            record = record[record.plots.time < PERIODS[-1][1]]
            late = np.asarray(bias.time)[record.plots.sensor] * (record.target >= 0)
            place, _, _ = traffic._state(np.maximum(record.target, 0), record.plots.time - late)
            known = [replace(one, bias=bias[k]) for k, one in enumerate(stated)]
            ways = {"known": known, "not registered": stated, "registered": stated}
            for way, sensors in ways.items():
                registers = way == "registered"
                cells, count = followed(record, sensors, place, registers=registers)
                ratios.setdefault(way, []).append(cells)
                counts.setdefault(way, []).append(count)
        best = np.nanmean(np.array(ratios["known"])[..., 0], axis=0)
        for way in ("not registered", "registered"):
            mean = np.nanmean(np.array(ratios[way]), axis=0)
            ratio = np.sqrt(mean[:, 0] / best)
            cells_of = [f"{one:.3f}, {mean[i, 1]:.2f}" for i, one in enumerate(ratio)]
            tracks = f"{np.mean(counts[way]):.1f} ({np.mean(counts['known']):.1f})"
            rows.append([name, way, *cells_of, tracks])
    head = ["", "errors", *(f"{low:.0f} to {high:.0f} s" for low, high in PERIODS)]
    return markdown([*head, "tracks (errors known)"], rows)
