"""Emitters above receivers that are nearly in a plane, and pairs of receivers in turn."""

import numpy as np
import numpy.typing as npt
import pytest
from checks import in_region

from tertia.sensors import Station
from tertia.trajectory import Arrivals, reconstruct, reconstruct_arrivals

LIGHT = 299_792_458.0
# 95 % of a chi-square of three degrees of freedom

Floats = npt.NDArray[np.float64]


def aircraft(seed: int) -> tuple[Floats, Arrivals, dict[int, tuple[Floats, Floats]]]:
    """Simulate aircraft heard by eight receivers with clocks of their own."""
    rng = np.random.default_rng(seed)
    places = np.column_stack([rng.uniform(-60e3, 60e3, (8, 2)), rng.uniform(50.0, 600.0, 8)])
    offset, rate = rng.normal(0.0, 5.0, 8), rng.normal(0.0, 5e-6, 8)
    offset[0] = rate[0] = 0.0
    times, sensors, names, truth = [], [], [], {}
    for name in range(2):
        emitted = np.sort(rng.uniform(0.0, 400.0, 70))
        course, height = rng.uniform(0.0, 6.28), rng.uniform(6e3, 11e3)
        begin = np.append(rng.uniform(-30e3, 30e3, 2), height)
        velocity = 220.0 * np.array([np.sin(course), np.cos(course), 0.0])
        way = begin + (emitted[:, np.newaxis] - 200.0) * velocity
        truth[name] = emitted, way
        for k in range(8):
            time = emitted + np.linalg.norm(way - places[k], axis=1) / LIGHT
            time += offset[k] + rate[k] * time + 50e-9 * rng.standard_normal(70)
            heard = rng.random(70) < 0.85
            times.append(time[heard])
            sensors.append(np.full(np.count_nonzero(heard), k))
            names.append(np.full(np.count_nonzero(heard), name))
    return places, Arrivals(*map(np.concatenate, (times, sensors, names))), truth


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_path_stays_on_one_side_of_the_receivers(seed):
    places, arrivals, truth = aircraft(seed)
    stations = [Station(place) for place in places]
    track = reconstruct_arrivals(stations, arrivals, propagation_speed=LIGHT)
    assert np.all(track.position[:, 2] > 1000.0)
    inside = []
    for name, (emitted, way) in truth.items():
        own = track.target == name
        there = np.column_stack([np.interp(track.time[own], emitted, axis) for axis in way.T])
        error = track.position[own] - there
        covariance = track.covariance[own][:, :3, :3]
        inside.append(np.mean(in_region(error, covariance)))
    assert np.mean(inside) > 0.8


def pairs(seed: int) -> tuple[list[Station], Floats, Floats, Floats]:
    """Simulate differences of arrivals at pairs of anchors in a room, one pair after the other."""
    rng = np.random.default_rng(seed)
    corners = [
        [x, y, z] for z in (0.2, 2.9) for x, y in [(-3.5, -4), (3.5, -4), (3.5, 4), (-3.5, 4)]
    ]
    anchors = np.array(corners)[[0, 5, 2, 7, 4, 1, 6, 3]]
    time = np.cumsum(rng.uniform(0.02, 0.04, 400))
    way = np.column_stack(
        [2 * np.sin(0.4 * time), 2 * np.cos(0.5 * time), 1.4 + 0.5 * np.sin(time / 3)]
    )
    distance = np.linalg.norm(way[:, np.newaxis] - anchors, axis=-1)
    rows, first = np.arange(400), np.arange(400) % 8
    second = (first + 1) % 8
    difference = distance[rows, second] - distance[rows, first] + 0.1 * rng.standard_normal(400)
    wrong = rng.random(400) < 0.05
    difference[wrong] += rng.normal(0.0, 1.0, np.count_nonzero(wrong))
    arrival = np.full((400, 8), np.nan)
    arrival[rows, first], arrival[rows, second] = 0.0, difference / LIGHT
    sigma = 0.1 / np.sqrt(2.0) / LIGHT
    return [Station(place, arrival_time_sigma=sigma) for place in anchors], time, arrival, way


@pytest.mark.parametrize("seed", [0, 1])
def test_pairs_of_receivers_in_turn(seed):
    stations, time, arrival, way = pairs(seed)
    track = reconstruct(stations, time, arrival_time=arrival)
    # one wrong difference in twenty; both of its arrivals are marked, and hardly any others
    assert np.mean(np.any(track.outlier.arrival_time, axis=1)) < 0.1
    error = track.position - way
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 0.1
    covariance = track.covariance[:, :3, :3]
    assert np.mean(in_region(error, covariance)) > 0.8
