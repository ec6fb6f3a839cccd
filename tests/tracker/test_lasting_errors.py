"""Errors of reported positions that last, and those that are stated of sensors without a radar."""

import numpy as np
import pytest
from checks import assert_refused, in_region

from tertia.sensors import Bias, PositionSensor
from tertia.tracker import Plots, Tracker, smooth_tracks, track

TIME = np.arange(0.0, 200.0)


def lasting(time, sigma, duration, random):
    """Return errors of two coordinates that are alike within about this duration."""
    errors = sigma * random.standard_normal((len(time), 2))
    for k in range(1, len(time)):
        kept = np.exp((time[k - 1] - time[k]) / duration)
        errors[k] = kept * errors[k - 1] + np.sqrt(1.0 - kept**2) * errors[k]
    return errors


def reports(seed, sigma, duration, late=0.0, noise=0.5):
    """Return reports of ten targets on straight paths, once a second, and their true positions."""
    random = np.random.default_rng([41, seed])
    parts = []
    for target in range(10):
        time, course = TIME + random.random(), random.uniform(0.0, 2.0 * np.pi)
        start = random.uniform(-30e3, 30e3, 2)
        velocity = random.uniform(100.0, 220.0) * np.array([np.sin(course), np.cos(course)])
        place = start + velocity * time[:, np.newaxis]
        errors = lasting(time, sigma, duration, random) + noise * random.standard_normal((200, 2))
        parts.append((time + late, place + errors, np.full(200, target), start, velocity))
    starts, velocities = (np.array([one[k] for one in parts]) for k in (3, 4))
    time, position, target = (np.concatenate([one[k] for one in parts]) for k in range(3))
    order = np.argsort(time)
    plots = Plots(time[order], position=position[order], identity=target[order])

    def errors_of(rows):
        place = starts[rows.identity] + velocities[rows.identity] * rows.time[:, np.newaxis]
        return rows.position - place

    return plots, errors_of


def coverage(rows, errors_of):
    own = rows[(rows.time > 40.0) & (rows.plot >= 0)]
    return np.mean(in_region(errors_of(own), own.covariance[:, :2, :2]))


@pytest.mark.parametrize("seed", range(3))
def test_regions_contain_errors_that_last_for_minutes(seed):
    plots, errors_of = reports(seed, 10.0, 90.0)
    sensor = PositionSensor(position_sigma=10.0)
    found = track(plots, [sensor])
    assert coverage(found, errors_of) > 0.9
    assert coverage(smooth_tracks(plots, [sensor], found), errors_of) > 0.9


def test_independent_errors_are_averaged():
    plots, errors_of = reports(5, 10.0, 1e-3, noise=0.0)
    sensor = PositionSensor(position_sigma=10.0)
    found = track(plots, [sensor])
    late = found[found.time > 60.0]
    assert np.median(late.covariance[:, 0, 0]) < 5.0**2
    smoothed = smooth_tracks(plots, [sensor], found)
    assert np.median(smoothed.covariance[:, 0, 0]) < 3.5**2
    assert 0.9 < coverage(smoothed, errors_of) < 0.995


@pytest.mark.parametrize("bias", [Bias(time_sigma=0.5), Bias(east_sigma=60.0, north_sigma=60.0)])
def test_stated_systematic_errors_of_a_single_sensor_are_in_the_covariances(bias):
    plots, _ = reports(1, 10.0, 1e-3)
    sensor = PositionSensor(position_sigma=10.0, bias=bias)
    found = track(plots, [sensor])
    for rows in (found, smooth_tracks(plots, [sensor], found)):
        speed = np.hypot(*rows.velocity[-1])
        along = rows.velocity[-1] / speed
        sigma = np.sqrt(along @ rows.covariance[-1, :2, :2] @ along)
        least = max(bias.time_sigma * speed, bias.east_sigma)
        assert 0.95 * least < sigma < 1.1 * least + 5.0


def test_a_sensor_that_may_be_late_is_compared_with_another_one():
    first, errors_of = reports(2, 20.0, 1e-3)
    second, _ = reports(2, 5.0, 60.0, late=0.1)
    plots = Plots(
        np.append(first.time, second.time),
        position=np.vstack([first.position, second.position]),
        identity=np.append(first.identity, second.identity),
        sensor=np.repeat([0, 1], len(first)),
    )
    sensors = [PositionSensor(position_sigma=20.0), PositionSensor(position_sigma=5.0)]
    found = track(plots, sensors)
    assert len(np.unique(found.track)) == 10
    assert coverage(found, errors_of) > 0.9
    apart = track(plots, sensors, registration=False)
    assert coverage(apart, errors_of) < 0.5


def test_an_unknown_size_of_errors_is_refused():
    sensor = PositionSensor(position_sigma=1.0, bias=Bias(time_sigma=np.inf))
    assert_refused(lambda: Tracker([sensor]), ValueError, "sensors[0].bias has a sigma of inf")
