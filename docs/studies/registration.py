"""Figures of docs/registration.md."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from studies.pages import markdown, repetitions
from tertia import simulate
from tertia._arrays import FloatArray
from tertia.registration import Registration, register
from tertia.sensors import Radar

SEED = 31
SCENES, RADARS, FLIGHTS, DURATION = repetitions(6), 3, 20, 900.0
SET_UPS: tuple[simulate.SetUpName, ...] = ("tma", "middle", "en-route")
KINDS = ("range", "azimuth")


@dataclass(frozen=True)
class Errors:
    """Errors of noise factors and biases over their standard deviations, by kind.

    `relative` are the errors of noise factors in parts of the true ones.
    """

    noise: dict[str, FloatArray]
    bias: dict[str, FloatArray]
    relative: dict[str, FloatArray]


def scene(name: simulate.SetUpName, seed: int) -> tuple[Registration, FloatArray, FloatArray]:
    """Return what is found, the true noise factors (K, 2) and the true biases (K, 2).

    Noise is 0.7 to 1.8 times as stated; biases are up to three times the stated noise of ranges
    and up to that of azimuths.
    """
    random = np.random.default_rng([SEED, seed])
    setting = simulate.set_up(name)
    usual = setting.radar
    stated: list[Radar] = []
    real: list[Radar] = []
    factor, bias = np.zeros((RADARS, 2)), np.zeros((RADARS, 2))
    for k in range(RADARS):
        angle = 2 * np.pi * k / RADARS + random.uniform(0.0, 1.0)
        place = 0.35 * setting.distance[1] * np.array([np.sin(angle), np.cos(angle)])
        factor[k] = random.uniform(0.7, 1.8, 2)
        for radars, scale in ((stated, np.ones(2)), (real, factor[k])):
            radars.append(
                Radar(
                    place,
                    range_sigma=usual.range_sigma * scale[0],
                    azimuth_sigma=usual.azimuth_sigma * scale[1],
                    scan_period=usual.scan_period * (1.0 + 0.25 * k),
                    max_range=usual.max_range,
                    detection_probability=usual.detection_probability,
                )
            )
        limits = np.array([3 * usual.range_sigma, usual.azimuth_sigma])
        bias[k] = random.uniform(-limits, limits)
    plans = simulate.routes(name, FLIGHTS, rng=random)
    traffic = simulate.flights(plans, wind=setting.wind, rng=random)
    record = simulate.radar_plots(
        traffic, real, clutter=2, bias=bias, outlier_probability=0.02, rng=random
    )
    plots = record.plots[record.plots.time < DURATION]
    return register(plots, stated, plans=plans), factor, bias


@cache
def errors(name: simulate.SetUpName) -> Errors:
    """Return the errors in all scenes of a set-up; unknown ones are left out."""
    lists: list[dict[str, list[FloatArray]]] = [{kind: [] for kind in KINDS} for _ in range(3)]
    for seed in range(SCENES):
        found, factor, bias = scene(name, seed)
        for i, kind in enumerate(KINDS):
            off = getattr(found.noise_factor, kind) - factor[:, i]
            lists[0][kind].append(off / getattr(found.noise_factor_sigma, kind))
            sigma = getattr(found.bias, f"{kind}_sigma")
            off_bias = (getattr(found.bias, kind) - bias[:, i]) / sigma
            lists[1][kind].append(off_bias[np.isfinite(sigma)])
            lists[2][kind].append(off / factor[:, i])
    return Errors(*({kind: np.concatenate(x) for kind, x in one.items()} for one in lists))


def coverage() -> str:
    """Return how often errors of noise and biases are within two standard deviations."""
    rows = []
    for name in SET_UPS:
        found = errors(name)
        cells = [f"{np.mean(found.relative[kind]):+.1%}" for kind in KINDS]
        several = [*found.noise.values(), *found.bias.values()]
        cells += [f"{np.mean(np.abs(values) < 2):.0%}" for values in several]
        counts = {len(values) for values in several}
        rows.append([name, "/".join(map(str, sorted(counts))), *cells])
    head = ["", "radars", "range noise, mean error", "azimuth noise, mean error"]
    head += [f"{kind} noise within 2σ" for kind in KINDS]
    head += [f"{kind} bias within 2σ" for kind in KINDS]
    return markdown(head, rows)
