"""Radars and recordings for the tests of registration."""

from dataclasses import replace

import numpy as np

from tertia import simulate
from tertia.sensors import RADAR_LIMITS, Radar

STATED = np.array([50.0, 0.0014])
PLACES = np.array([[-5e4, 0.0], [5e4, 1e4], [0.0, 6e4]])
KINDS = ("range", "azimuth")
ERRORS = ("range", "range_gain", "azimuth", "time")
LIMITS = np.array([100.0, 1 / 1852, np.radians(0.1), 0.1])
ONES = np.ones((3, 2))


def radars(factor=ONES, order=(0, 1, 2)):
    """Radars whose noise is so many times the stated one."""
    sigma = STATED * factor
    return [
        Radar(PLACES[k], range_sigma=sigma[k, 0], azimuth_sigma=sigma[k, 1], scan_period=4.0 + k)
        for k in order
    ]


def constant():
    """The same radars, whose errors do not drift."""
    bias = replace(RADAR_LIMITS, drift_share=0.0)
    return [replace(one, bias=bias) for one in radars()]


def recording(seed, factor=ONES, bias=None, **options):
    traffic = simulate.dense_traffic(30, area=(1.5e5, 1.5e5), turning_share=0.1, rng=seed)
    seen = {"outlier_probability": 0.01, "rng": seed + 1000} | options
    return simulate.radar_plots(traffic, radars(factor), bias=bias, **seen).plots


def columns(bias, suffix=""):
    return np.stack([getattr(bias, kind + suffix) for kind in ERRORS], axis=-1)
