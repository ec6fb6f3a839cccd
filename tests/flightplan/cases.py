"""Plans and tracks of several tests."""

import numpy as np

from tertia.flightplan import FlightPlan

# 60° to the right at (0, 50 km), coming north
OUTBOUND = np.array([np.sin(np.pi / 3), np.cos(np.pi / 3)])
CORNERED = [[0, 0], [0, 50_000], [0, 50_000] + 60_000 * OUTBOUND]
START = 43889.2922909226
WAY = np.array([[0, 0], [0, 6e4], [5e4, 9e4], [1.6e5, 6e4], [1.6e5, 0], [9e4, -2e4]])


def plan(speed=220.0, **options):
    return FlightPlan(CORNERED, speed, **options)


def tracked(one, times, rng, *, aside=0.0, position_sigma=0.0, velocity_sigma=0.0):
    """A track of a flight that follows a plan, and its covariance."""
    position, velocity = one.at(times)
    speed = np.linalg.norm(velocity, axis=-1, keepdims=True)
    right = np.stack([velocity[..., 1], -velocity[..., 0]], axis=-1) / speed
    noise = rng.normal(size=(2, *position.shape))
    covariance = np.diag([position_sigma**2] * 2 + [velocity_sigma**2] * 2)
    return (
        position + aside * right + position_sigma * noise[0],
        velocity + velocity_sigma * noise[1],
        np.broadcast_to(covariance, (*position.shape[:-1], 4, 4)),
    )
