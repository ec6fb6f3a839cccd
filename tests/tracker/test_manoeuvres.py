"""Targets that manoeuvre more than airliners do: the tracker learns it."""

import numpy as np
from checks import in_region
from tracker.flights import RADAR, noisy

from tertia.tracker import Plots, PositionSensor, track

STEP = 0.1
# 95 % of a chi-square of two degrees of freedom


def flown(seed, speed, sideways, manoeuvre, between, duration=600.0):
    """Positions and velocities each `STEP` of a target that turns at times."""
    rng = np.random.default_rng([88, seed])
    rate, k = np.zeros(int(duration / STEP)), 0
    while k < len(rate):
        k += int(between * rng.uniform(0.5, 1.5) / STEP)
        end = k + int(manoeuvre * rng.uniform(0.5, 1.5) / STEP)
        rate[k:end] = rng.choice([-1.0, 1.0]) * sideways * rng.uniform(0.3, 1.0) / speed
        k = end
    course = rng.uniform(0.0, 2 * np.pi) + np.cumsum(rate) * STEP
    velocity = speed * np.stack([np.sin(course), np.cos(course)], axis=-1)
    return np.array([20e3, 30e3]) + np.cumsum(velocity, axis=0) * STEP, velocity


def velocities(several, period=4.0):
    """Errors of velocities and whether they are in their regions, half a minute after the start."""
    errors, inside = [], []
    for seed, (position, velocity) in enumerate(several):
        time = np.arange(0.0, len(position) * STEP - STEP, period)
        at = (time / STEP).astype(int)
        plots = Plots(time, *noisy(position[at], RADAR, np.random.default_rng([89, seed])))
        found = track(plots, [RADAR])
        found = found[(found.plot >= 0) & (found.time > 30.0)]
        off = found.velocity - velocity[at][found.plot]
        spread = found.covariance[:, 2:, 2:]
        errors.append(off)
        inside.append(in_region(off, spread))
    return np.concatenate(errors), np.mean(np.concatenate(inside))


def test_velocities_of_a_helicopter_are_in_their_regions():
    """With the models of airliners alone, 73 %, and errors of 12.1 m/s."""
    error, inside = velocities([flown(k, 50.0, 4.0, 12.0, 30.0) for k in range(30)])
    assert 0.88 < inside < 0.98
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 11.7


def test_straight_flight_does_not_pay_for_it():
    """Errors of 1.76 m/s: as with the models of airliners alone."""
    error, inside = velocities([flown(k, 150.0, 1.0, 1.0, 1e4) for k in range(30)])
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 1.8
    assert inside > 0.98


def test_targets_that_appear_in_a_turn_may_have_turned_for_long():
    """As all targets of a recording that begins near an airport."""
    inside, errors = [], []
    for seed in range(40):
        rng = np.random.default_rng([31, seed])
        # 200 m/s, 1.4 to 3 degrees a second
        rate = rng.choice([-1.0, 1.0]) * np.radians(rng.uniform(1.4, 3.0))
        time = 4.0 * np.arange(10) + rng.uniform(0.0, 4.0)
        course, radius = rng.uniform(0.0, 2.0 * np.pi) + rate * time, 200.0 / rate
        position = radius * np.column_stack([-np.cos(course), np.sin(course)])
        position += rng.uniform(20e3, 60e3, 2)
        table = track(Plots(time, *noisy(position, RADAR, rng)), [RADAR])
        rows = table[(table.plot >= 3) & (table.plot < 9)]
        velocity = 200.0 * np.column_stack([np.sin(course), np.cos(course)])[rows.plot]
        off = rows.velocity - velocity
        inside.extend(in_region(off, rows.covariance[:, 2:, 2:]))
        errors.extend(np.hypot(*off.T))
    # .68 and 37 m/s if all targets have flown straight when they appear
    assert np.mean(inside) > 0.78
    assert np.sqrt(np.mean(np.square(errors))) < 28.0


def test_a_target_that_stands_does_not_brake():
    """As drones that hover and cars that wait: an acceleration must not explain the noise."""
    time, random = np.arange(0.0, 120.0, 0.1), np.random.default_rng(3)
    sensor = PositionSensor(position_sigma=0.15, update_interval=0.1)
    for profile in ("drone", "road"):
        place = random.normal([300.0, 50.0], 0.15, (len(time), 2))
        found = track(Plots(time, position=place), [sensor], profile=profile)
        found = found[found.time > 20.0]
        assert np.mean(in_region(found.velocity, found.covariance[:, 2:, 2:])) > 0.95
        assert np.sqrt(np.mean(np.sum(found.velocity**2, axis=1))) < 0.6
