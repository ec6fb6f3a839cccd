"""Figures of docs/report.md."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from studies.pages import markdown
from tertia import report, simulate
from tertia._arrays import FloatArray
from tertia.tracker import Radar

SEED = 31
SCENES, RADARS, FLIGHTS, DURATION = 6, 3, 20, 900.0
SET_UPS: tuple[simulate.SetUpName, ...] = ("tma", "middle", "en-route")
DEGREES = 180.0 / np.pi


@dataclass(frozen=True)
class Found:
    """Errors of what was found of radars in units of their standard errors, by what it is.

    `off` are errors of standard deviations in shares of them.
    """

    normalised: dict[str, FloatArray]
    off: dict[str, FloatArray]


def scene(name: simulate.SetUpName, seed: int) -> tuple[report.Report, FloatArray, FloatArray]:
    """Return a page, the true noise (K, 2) and the true biases (K, 2), in metres and degrees.

    Noise is 0.7 to 1.8 times what radars state; biases are up to three times the noise of ranges
    and up to that of azimuths.
    """
    random = np.random.default_rng([SEED, seed])
    setting = simulate.set_up(name)
    usual = setting.radar
    stated: list[Radar] = []
    real: list[Radar] = []
    bias = np.zeros((RADARS, 2))
    for k in range(RADARS):
        angle = 2 * np.pi * k / RADARS + random.uniform(0.0, 1.0)
        place = 0.35 * setting.distance[1] * np.array([np.sin(angle), np.cos(angle)])
        factor = random.uniform(0.7, 1.8, 2)
        for radars, scale in ((stated, np.ones(2)), (real, factor)):
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
    sigma = np.array([[radar.range_sigma, radar.azimuth_sigma] for radar in real])
    unit = np.array([1.0, DEGREES])
    return report.make(plots, stated, plans=plans), sigma * unit, bias * unit


@cache
def found(name: simulate.SetUpName) -> Found:
    """Return what is found in scenes of a set-up."""
    kinds = ("range_sigma_m", "azimuth_sigma_deg", "range_bias_m", "azimuth_bias_deg")
    normalised: dict[str, list[float]] = {kind: [] for kind in kinds}
    off: dict[str, list[float]] = {kind: [] for kind in kinds[:2]}
    for seed in range(SCENES):
        page, sigma, bias = scene(name, seed)
        for k, row in enumerate(page.summary["radars"]):
            for kind, true in zip(kinds, [*sigma[k], *bias[k]], strict=True):
                stem, unit = kind.rsplit("_", 1)
                if row[kind] is None:
                    continue
                normalised[kind].append((row[kind] - true) / row[f"{stem}_error_{unit}"])
                if kind in off:
                    off[kind].append(row[kind] / true - 1.0)
    return Found(
        {kind: np.array(values) for kind, values in normalised.items()},
        {kind: np.array(values) for kind, values in off.items()},
    )


def coverage() -> str:
    """Return how often errors of noise and biases are within two of their standard errors."""
    rows = []
    for name in SET_UPS:
        told = found(name)
        cells = [f"{np.mean(told.off[kind]):+.1%}" for kind in told.off]
        cells += [f"{np.mean(np.abs(values) < 2):.0%}" for values in told.normalised.values()]
        counts = {len(values) for values in told.normalised.values()}
        rows.append([name, "/".join(map(str, sorted(counts))), *cells])
    head = ["", "radars", "range sigma off", "azimuth sigma off"]
    head += [f"{kind} within 2" for kind in ("range sigma", "azimuth sigma")]
    head += [f"{kind} within 2" for kind in ("range bias", "azimuth bias")]
    return markdown(head, rows)
