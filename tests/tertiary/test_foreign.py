"""Tracks of α-β filters of any damping and noise, with jumps of clocks, or with missing rows."""

from dataclasses import replace

import numpy as np
import pytest

from tertia import simulate
from tertia.metrics import nees
from tertia.sensors import Bias, Radar
from tertia.tertiary import SensorTracks, fuse_tracks

ACCURACY = ((75.0, 0.10, 6.0), (50.0, 0.08, 4.0), (100.0, 0.12, 10.0))
PLACES = ((-4e4, 0.0), (3.5e4, -2e4), (0.0, 4.5e4))
END, JUMP = 500.0, 200.0
RADARS = [
    Radar(
        place,
        range_sigma=range_sigma,
        azimuth_sigma=azimuth_sigma,
        scan_period=period,
        max_range=3e5,
        bias=Bias(),
        degrees=True,
    )
    for place, (range_sigma, azimuth_sigma, period) in zip(PLACES, ACCURACY, strict=True)
]


def fused(alpha, beta, seed, every=1, noise=1.0, step=0.0):
    """Return errors of positions, whether the regions hold them, and targets per flight.

    The noise of plots is that of the sensors times a factor. The clock of the most accurate sensor
    jumps.
    """
    sensors = [replace(radar, bias=None if step else radar.bias) for radar in RADARS]
    flights = simulate.dense_traffic(
        14, area=(8e4, 8e4), turning_share=0.7, duration=END, rng=[seed, 1]
    )
    several = []
    for k, radar in enumerate(RADARS):
        actual = replace(
            radar,
            range_sigma=noise * radar.range_sigma,
            azimuth_sigma=noise * radar.azimuth_sigma,
        )
        record = simulate.radar_plots(flights, [actual], clutter=0, rng=[seed, 2, k])
        plots = record.plots
        ground = np.sqrt(np.maximum(plots.range**2 - np.nan_to_num(plots.height) ** 2, 0.0))
        place = np.column_stack([np.sin(plots.azimuth), np.cos(plots.azimuth)])
        place = ground[:, np.newaxis] * place + np.asarray(radar.position)[:2]
        rows, states = [], []
        for number in np.unique(record.target):
            first, second, *others = np.flatnonzero(record.target == number)
            x, last = place[second], plots.time[second]
            v = (x - place[first]) / (last - plots.time[first])
            for count, i in enumerate(others):
                t, last = plots.time[i] - last, plots.time[i]
                off = place[i] - x - t * v
                x, v = x + t * v + alpha * off, v + beta / t * off
                if count % every == 0:
                    rows.append(i)
                    states.append([*x, *v])
        state, target = np.array(states), record.target[rows]
        time = plots.time[rows]
        if k == 1:
            time = time + np.where(time > JUMP, step, 0.0)
        own = SensorTracks(time, k, target, state[:, :2], state[:, 2:], identity=target)
        several.append(own)
    found = fuse_tracks(SensorTracks.concatenate(several), sensors)
    found = found[(found.time > 150.0) & (found.time < END - 5.0)]
    error = found.position - flights.at(found.identity, found.time)[0]
    known = np.isfinite(error[:, 0])
    error, covariance = error[known], found.covariance[known][:, :2, :2]
    count = len(error) / len(np.unique(found.time)) / 14
    return error, np.asarray(nees(error, covariance)) < 5.991, count


# with the relation of white acceleration, 452, 138, 128 and 220 m, and at most 96 % were inside
@pytest.mark.parametrize(
    ("alpha", "beta", "every", "inside", "size"),
    [
        (0.51, 0.09, 1, 0.96, 320.0),
        (0.75, 0.25, 1, 0.96, 70.0),
        (0.5, 0.5, 1, 0.95, 90.0),
        (0.5, 0.1716, 2, 0.95, 250.0),
    ],
)
def test_filters_of_any_damping(alpha, beta, every, inside, size):
    several = [fused(alpha, beta, seed, every) for seed in range(3)]
    assert np.mean(np.concatenate([held for _, held, _ in several])) > inside
    error = np.concatenate([error for error, _, _ in several])
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < size


# 1012 m: the wrong damping was found, and the noise seemed to be seven times what is stated
def test_noise_that_is_three_times_what_is_stated():
    several = [fused(0.5, 0.1716, seed, noise=3.0) for seed in range(3)]
    assert np.mean(np.concatenate([held for _, held, _ in several])) > 0.94
    error = np.concatenate([error for error, _, _ in several])
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 160.0


# a third of the aircraft were shown as two targets until the end, and .52 or .70 were inside
@pytest.mark.parametrize("step", [-3.0, 3.0])
def test_a_clock_that_jumps(step):
    several = [fused(0.5, 0.1716, seed, step=step) for seed in range(2)]
    assert np.mean([count for *_, count in several]) < 1.1
    assert np.mean(np.concatenate([held for _, held, _ in several])) > 0.9
