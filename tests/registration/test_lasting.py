"""Errors of targets that last from plot to plot, as those of transponders and reflections."""

import numpy as np
from checks import rng

from tertia.registration import register
from tertia.sensors import Radar
from tertia.tracker import Plots

PLACES = np.array([[0.0, 0.0], [60e3, 20e3], [-20e3, 70e3]])
SIGMAS = np.array([60.0, 1.2e-3])
DURATION, LASTING, END, TARGETS = 60.0, 0.9, 600.0, 12


def scene(seed):
    """Return radars, plots with errors of which a share of the variance lasts, and biases."""
    random = rng([4, seed])
    radars = [
        Radar(
            place,
            range_sigma=SIGMAS[0],
            azimuth_sigma=SIGMAS[1],
            scan_period=4.0 + 2 * k,
            max_range=3e5,
        )
        for k, place in enumerate(PLACES)
    ]
    start, velocity = random.uniform(-5e4, 6e4, (TARGETS, 2)), random.normal(0, 120, (TARGETS, 2))
    bias = random.normal(0, 1, (3, 2)) * [80.0, 2e-3]
    rows = []
    for k, radar in enumerate(radars):
        rest = np.exp(-radar.scan_period / DURATION)
        lasting, first = random.normal(0, 1, (TARGETS, 2)), random.uniform(0, 4, TARGETS)
        for scan in np.arange(0.0, END, radar.scan_period):
            time = first + scan
            fresh, white = random.normal(0, 1, (2, TARGETS, 2))
            lasting = rest * lasting + np.sqrt(1 - rest**2) * fresh
            error = np.sqrt(LASTING) * lasting + np.sqrt(1 - LASTING) * white
            way = start + velocity * time[:, np.newaxis] - PLACES[k]
            polar = np.column_stack([np.hypot(*way.T), np.arctan2(*way.T)])
            polar += bias[k] + SIGMAS * error
            rows += [(t, *own, k) for t, own in zip(time, polar, strict=True)]
    time, distance, azimuth, sensor = np.array(sorted(rows)).T
    return radars, Plots(time, distance, azimuth, sensor=sensor.astype(int)), bias


def test_biases_are_within_their_sigmas_where_errors_of_targets_last():
    scores = []
    for seed in range(6):
        radars, plots, bias = scene(seed)
        found = register(plots, radars).bias
        scores.append((found.range - bias[:, 0]) / found.range_sigma)
        scores.append((found.azimuth - bias[:, 1]) / found.azimuth_sigma)
    # a quarter were within two sigmas when blocks of a target counted as independent
    assert np.mean(np.abs(scores) < 2) > 0.65
    assert np.sqrt(np.mean(np.square(scores))) < 2.5
