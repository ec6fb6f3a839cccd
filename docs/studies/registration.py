"""Figures of docs/registration.md."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from studies.pages import markdown, repetitions
from tertia import simulate
from tertia._arrays import FloatArray
from tertia.metrics import nees
from tertia.registration import Registration, register
from tertia.sensors import RADAR_LIMITS, Bias, Radar
from tertia.tracker import track

SEED = 31
SCENES, RADARS, FLIGHTS, DURATION = repetitions(40), 3, 15, 600.0
SET_UPS: tuple[simulate.SetUpName, ...] = ("tma", "middle", "en-route")
NOISE = ("range", "azimuth")
ERRORS = ("range", "range_gain", "azimuth", "time")
ALIGNED = repetitions(3)
AZIMUTHS = (0.0, 0.1, 0.2, 0.3, 0.5, 1.0)


def columns(bias: Bias, suffix: str = "") -> FloatArray:
    """Return the systematic errors of radars, (K, 4)."""
    return np.stack([np.asarray(getattr(bias, kind + suffix)) for kind in ERRORS], axis=-1)


def drawn(random: np.random.Generator, count: int) -> Bias:
    """Return systematic errors within the limits, normally distributed."""
    value = columns(RADAR_LIMITS, "_sigma") * random.standard_normal((count, len(ERRORS)))
    return Bias(range=value[:, 0], range_gain=value[:, 1], azimuth=value[:, 2], time=value[:, 3])


def scene(name: simulate.SetUpName, seed: int) -> tuple[Registration, FloatArray, Bias]:
    """Return what is found, the true noise factors (K, 2) and the true errors."""
    random = np.random.default_rng([SEED, SET_UPS.index(name), seed])
    setting = simulate.set_up(name)
    factor = random.uniform(0.7, 1.8, (RADARS, 2))
    stated: list[Radar] = []
    for k in range(RADARS):
        angle = 2 * np.pi * k / RADARS + random.uniform(0.0, 1.0)
        place = 0.35 * setting.distance[1] * np.array([np.sin(angle), np.cos(angle)])
        period = setting.radar.scan_period * (1.0 + 0.25 * k)
        stated.append(replace(setting.radar, position=place, scan_period=period))
    real = [
        replace(
            radar,
            range_sigma=radar.range_sigma * factor[k, 0],
            azimuth_sigma=radar.azimuth_sigma * factor[k, 1],
        )
        for k, radar in enumerate(stated)
    ]
    bias = drawn(random, RADARS)
    traffic = simulate.flights(
        simulate.routes(name, FLIGHTS, rng=random), wind=setting.wind, rng=random
    )
    record = simulate.radar_plots(
        traffic,
        real,
        clutter=2,
        bias=bias,
        outlier_probability=0.02,
        height_missing_probability=0.02,
        rng=random,
    )
    plots = record.plots[record.plots.time < DURATION]
    return register(plots, stated), factor, bias


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
    counts: dict[str, list[list[int]]] = {"as they are": [], "registered": []}
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
            for name, sensors in zip(counts, (radars, found.sensors), strict=True):
                tracks = track(plots, sensors)
                both[name].append(len(np.unique(tracks.track[tracks.confirmed])))
            errors[-1].append(float(np.degrees(found.bias.azimuth)[1]) - azimuth)
        for name, one in both.items():
            counts[name].append(one)
    rows = [[name, *(f"{np.mean(one):.1f}" for one in several)] for name, several in counts.items()]
    rows.append(
        ["largest error of the azimuth found", *(f"{np.max(np.abs(e)):.3f}°" for e in errors)]
    )
    return markdown(["tracks of 20 aircraft", *(f"{azimuth}°" for azimuth in AZIMUTHS)], rows)
