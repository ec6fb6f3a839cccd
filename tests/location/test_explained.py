"""Contradictions that one number explains: told by locate and reconstruct, and only these."""

import warnings

import numpy as np
import pytest

from tertia.location import Station, locate
from tertia.sensors import Bias
from tertia.trajectory import reconstruct

RANGE, ANGLE = 50.0, 0.01


def flight(seed, *, stations=5, size=20_000.0, speed=150.0, instants=80):
    """Return places, times, positions and velocities of a target that turns between them."""
    rng = np.random.default_rng([45, seed])
    turn = 2 * np.pi * (np.arange(stations) + rng.uniform(-0.3, 0.3, stations)) / stations
    places = rng.uniform(0.5, 1.0, (stations, 1)) * size
    places = places * np.column_stack([np.sin(turn), np.cos(turn)])
    time = np.linspace(0.0, 1.2 * size / speed, instants)
    course = rng.uniform(0, 2 * np.pi) + rng.uniform(-1.5, 1.5) * time / time[-1]
    velocity = speed * np.column_stack([np.sin(course), np.cos(course)])
    path = np.cumsum(velocity, axis=0) * (time[1] - time[0])
    return rng, places, time, path - np.mean(path, axis=0), velocity


def ranges(path, places, height=0.0):
    return np.hypot(np.linalg.norm(path[:, np.newaxis] - places, axis=-1), height)


def azimuths(path, places):
    offset = path[:, np.newaxis] - places
    return np.arctan2(offset[..., 0], offset[..., 1])


def told(estimate):
    """Return the messages of an estimate about what explains contradictions."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        estimate()
    return [str(one.message) for one in caught if "agree" in str(one.message)]


def both(places, time, sigmas, measured):
    """Return the messages of `locate` and of `reconstruct`."""
    stations = [Station(place, **sigmas) for place in places]
    return (
        told(lambda: locate(stations, **measured)),
        told(lambda: reconstruct(stations, time, **measured)),
    )


@pytest.mark.parametrize("height", [4000.0, 7000.0])
def test_slant_ranges_are_told_with_the_height(height):
    """Before, there was no warning; the regions of a third of the paths did not hold."""
    heights = []
    for seed in range(6):
        rng, places, time, path, _ = flight(seed, stations=6)
        measured = ranges(path, places, height)
        measured = measured + RANGE * rng.standard_normal(measured.shape)
        for messages in both(places, time, {"range_sigma": RANGE}, {"range": measured}):
            assert all("slant ranges of a target about" in message for message in messages)
            heights += [float(one.split("about ")[1].split(" m")[0]) for one in messages]
    assert len(heights) >= 9
    errors = np.abs(np.array(heights) - height)
    assert np.median(errors) < 0.01 * height
    assert np.max(errors) < 0.15 * height


def test_a_common_error_of_compasses_is_told():
    for seed in range(4):
        rng, places, time, path, _ = flight(seed, stations=6)
        measured = azimuths(path, places) + 0.06
        measured += ANGLE * rng.standard_normal(measured.shape)
        for messages in both(places, time, {"azimuth_sigma": ANGLE}, {"azimuth": measured}):
            (message,) = messages
            assert "degrees" in message
            assert "too large" in message


def test_the_station_with_a_wrong_clock_is_told():
    """Before, there was no warning, and the regions of some paths held hardly any position."""
    errors = []
    for seed in range(8):
        rng, places, time, path, velocity = flight(seed, stations=3, size=300.0, speed=15.0)
        measured = azimuths(path, places)
        measured[:, 2] = azimuths(path - 0.6 * velocity, places)[:, 2]
        measured += 0.002 * rng.standard_normal(measured.shape)
        stations = [Station(place, azimuth_sigma=0.002) for place in places]
        messages = told(lambda s=stations, t=time, z=measured: reconstruct(s, t, azimuth=z))
        assert all("station 2" in message and " fast" in message for message in messages)
        errors += [float(one.split("clock is ")[1].split(" s")[0]) - 0.6 for one in messages]
    assert len(errors) >= 6
    assert np.max(np.abs(errors)) < 0.15


@pytest.mark.parametrize("kind", ["white", "constant", "lasting", "outliers", "double", "late"])
def test_nothing_is_told_of_other_errors(kind):
    for seed in range(6):
        rng, places, time, path, _ = flight(seed, stations=4 + seed % 3)
        noise = rng.standard_normal((2, *path.shape[:1], len(places)))
        if kind == "constant":
            noise += 4 * rng.standard_normal((2, 1, len(places)))
        if kind == "lasting":
            for i in range(1, len(path)):
                noise[:, i] = 0.9 * noise[:, i - 1] + np.sqrt(0.19) * noise[:, i]
        if kind == "outliers":
            sign = rng.choice([-1, 1], noise.shape)
            noise += sign * rng.uniform(5, 15, noise.shape) * (rng.random(noise.shape) < 0.2)
        if kind == "double":
            noise *= 2
        if kind == "late":
            noise += rng.exponential(5, noise.shape) * (rng.random(noise.shape) < 0.2)
        near, seen = ranges(path, places) + RANGE * noise[0], azimuths(path, places)
        seen = seen + ANGLE * noise[1]
        assert both(places, time, {"range_sigma": RANGE}, {"range": near}) == ([], [])
        assert both(places, time, {"azimuth_sigma": ANGLE}, {"azimuth": seen}) == ([], [])
        sigmas = {"range_sigma": RANGE, "azimuth_sigma": ANGLE}
        assert both(places, time, sigmas, {"range": near, "azimuth": seen}) == ([], [])


def test_a_stated_bias_is_not_explained():
    rng, places, time, path, _ = flight(0)
    measured = ranges(path, places, 5000.0)
    measured = measured + RANGE * rng.standard_normal(measured.shape)
    stations = [Station(place, range_sigma=RANGE, bias=Bias(range_sigma=500.0)) for place in places]
    assert told(lambda: reconstruct(stations, time, range=measured)) == []
