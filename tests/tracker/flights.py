"""Flights and their plots, for the tests of the tracker."""

import numpy as np

from tertia import simulate
from tertia.tracker import Plots, Radar

RADAR = Radar(range_sigma=50.0, azimuth_sigma=np.radians(0.08), scan_period=4.0, max_range=120e3)


def polar(position):
    """Range and azimuth of positions."""
    return np.hypot(*position.T), np.arctan2(*position.T)


def predicted(mean, covariance, t, density):
    """A state of nearly constant velocity, and its covariance, after a time."""
    f = np.eye(4) + t * np.eye(4, k=2)
    noise = np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]]) * density
    return f @ mean, f @ covariance @ f.T + np.kron(noise, np.eye(2))


def turning_flight(steps=60, period=4.0, speed=150.0, rate=0.035):
    """A flight that turns in the middle third: times, positions, velocities."""
    fine = 100
    dt = period / fine
    w = np.zeros(steps * fine)
    w[steps * fine // 3 : 2 * steps * fine // 3] = rate
    course = np.cumsum(w) * dt
    velocity = speed * np.stack([np.cos(course), np.sin(course)], axis=-1)
    position = np.array([-20e3, 40e3]) + np.cumsum(velocity, axis=0) * dt
    return np.arange(steps) * period, position[::fine], velocity[::fine]


def braking_flight(period=4.0):
    """A flight that brakes by 0.5 m/s² from 180 to 240 s: times, positions, velocities."""
    time = period * np.arange(90)
    since = np.clip(time - 180.0, 0.0, 60.0)
    speed = 220.0 - 0.5 * since
    way = 220.0 * time - 0.25 * since**2 - 30.0 * np.clip(time - 240.0, 0.0, None)
    course = np.array([np.sin(0.6), np.cos(0.6)])
    return time, np.array([-15e3, 30e3]) + np.outer(way, course), np.outer(speed, course)


def noisy(position, radar, rng):
    """Plots of positions."""
    distance, azimuth = polar(position)
    n = len(position)
    return (
        distance + radar.range_sigma * rng.standard_normal(n),
        azimuth + radar.azimuth_sigma * rng.standard_normal(n),
    )


def line(n=20, period=4.0, start=0.0, seed=0):
    """Plots of one target that flies straight."""
    time = start + period * np.arange(n)
    position = np.array([10e3, 30e3]) + np.outer(time - start, [120.0, -80.0])
    rng = np.random.default_rng(seed)
    return Plots(time, *noisy(position, RADAR, rng))


def scene(seed, n=40, clutter=50.0):
    """Traffic of the middle set-up, and its plots."""
    set_up = simulate.set_up("middle")
    plans = simulate.routes("middle", n, rng=seed)
    traffic = simulate.flights(plans, wind=15.0, rng=seed + 1)
    seen = simulate.radar_plots(traffic, [set_up.radar], clutter=clutter, rng=seed + 2)
    return set_up.radar, traffic, seen


def squared_errors(found, traffic, flight):
    """Squared errors of position of all rows, and whether the target turns there."""
    count = traffic.count[flight]
    span = traffic.start[flight] + traffic.step * np.arange(count)
    turning = np.interp(found.time, span, traffic.turning[flight, :count]) > 0.5
    columns = [traffic.position[flight, :count, axis] for axis in (0, 1)]
    true = np.stack([np.interp(found.time, span, column) for column in columns], axis=-1)
    return np.sum((found.position - true) ** 2, axis=1), turning


def with_reports(record, time, target, position, sensor=1):
    """The plots of radars and the reports of a sensor in order of time, and their targets."""
    seen, none = record.plots, np.full(len(time), np.nan)
    plots = Plots(
        np.append(seen.time, time),
        np.append(seen.range, none),
        np.append(seen.azimuth, none),
        sensor=np.append(seen.sensor, np.full(len(time), sensor)),
        height=np.append(seen.height, none),
        position=np.concatenate([np.full((len(seen), 2), np.nan), position]),
    )
    order = np.argsort(plots.time)
    return plots[order], np.append(record.target, target)[order]


def followed(tracker, plots, begin=0.0, end=240.0):
    """The tables of scans of four seconds."""
    tables = []
    for start in np.arange(begin, end, 4.0):
        now = (plots.time >= start) & (plots.time < start + 4.0)
        tables.append(tracker.update(plots[now], time=start + 4.0))
    return tables
