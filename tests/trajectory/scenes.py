"""Paths and measurements for the tests of trajectories."""

import numpy as np

from tertia.sensors import Station

PLACES = np.array([[1.0, 1000.0, 2.0], [2000.0, 300.0, 5.0], [400.0, 2600.0, 0.0]])
SIGMA_R, SIGMA_A = 10.0, np.deg2rad(0.3)
SIGMAS = {"range": SIGMA_R, "azimuth": SIGMA_A, "elevation": SIGMA_A}
KINDS = tuple(SIGMAS)
INSTANTS = np.arange(60.0)


def network(places=PLACES, range_sigma=SIGMA_R):
    """Return stations; places are (K, D) or, for moving ones, (N, K, D)."""
    return [
        Station(
            places[..., k, :],
            range_sigma=range_sigma,
            azimuth_sigma=SIGMA_A,
            elevation_sigma=SIGMA_A,
        )
        for k in np.arange(places.shape[-2])
    ]


def ring(rng, count, *, radius, speed, spread):
    """Return places of stations around a slow turn, and its positions at `INSTANTS`."""
    angle = 2 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    places = radius * np.column_stack([np.sin(angle), np.cos(angle)])
    course = rng.uniform(0, 2 * np.pi) + 0.01 * INSTANTS
    path = np.cumsum(speed * np.column_stack([np.sin(course), np.cos(course)]), axis=0)
    path += rng.uniform(-spread, spread, 2) - path.mean(axis=0)
    return places, path


def turn(times, rate=0.02, speed=15.0):
    """Return a smooth turn: positions, velocities and accelerations."""
    phase = rate * times
    radius = speed / rate
    east = radius * np.sin(phase), speed * np.cos(phase), -speed * rate * np.sin(phase)
    north = -radius * np.cos(phase), speed * np.sin(phase), speed * rate * np.cos(phase)
    up = 300 + 2 * times, 2 + 0 * times, 0 * times
    states = [np.column_stack(axes) for axes in zip(east, north, up, strict=True)]
    states[0] += [300, 1500 + radius, 0]
    return tuple(states)


def ideal(position, places=PLACES):
    offset = position[:, np.newaxis] - places
    return {
        "range": np.linalg.norm(offset, axis=-1),
        "azimuth": np.arctan2(offset[..., 0], offset[..., 1]),
        "elevation": np.arctan2(offset[..., 2], np.hypot(offset[..., 0], offset[..., 1])),
    }


def measure(position, rng, places=PLACES, biases=None, range_sigma=SIGMA_R):
    sigmas = {**SIGMAS, "range": range_sigma}
    return {
        kind: values
        + sigmas[kind] * rng.standard_normal(values.shape)
        + (0.0 if biases is None else biases[kind])
        for kind, values in ideal(position, places).items()
    }


def walk(rng, count, step, room):
    """Return a walk, from the middle of a room, that turns at the walls."""
    course, place, way = rng.uniform(0, 2 * np.pi), np.asarray(room) / 2, []
    for _ in range(count):
        course += 0.15 * rng.standard_normal()
        ahead = place + step * np.array([np.sin(course), np.cos(course)])
        if np.all((ahead > 0) & (ahead < room)):
            place = ahead
        else:
            course += np.pi / 2
        way.append(place)
    return np.array(way)
