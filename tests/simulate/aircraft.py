"""Plans, flights and radars of several tests."""

from typing import get_args

import numpy as np
from scipy import spatial

from tertia.flightplan import FlightPlan
from tertia.sensors import Radar
from tertia.simulate import (
    FlightScenario,
)

GRAVITY = 9.80665
BANK = np.radians(23.0)
# nothing differs between flights but what a test lets
STILL = {"bank_sigma": 0.0, "navigation_sigma": 0.0, "speed_error": 0.0}
LEAVING = [name for name in get_args(FlightScenario) if name not in {"conforming", "speed"}]


def corner(degrees, speed=220.0, leg=50e3, **options):
    """A plan that comes from the south and turns once."""
    angle = np.radians(degrees)
    end = [leg * np.sin(angle), leg * (1 + np.cos(angle))]
    return FlightPlan([[0.0, 0.0], [0.0, leg], end], speed, **options)


def zigzag(speed=200.0, **options):
    """A plan with turns by 60 and 70 degrees to both sides, and legs of 60 km."""
    courses = np.radians([0.0, 60.0, -10.0, 50.0])
    ways = 60e3 * np.stack([np.sin(courses), np.cos(courses)], axis=-1)
    return FlightPlan(np.concatenate([[[0.0, 0.0]], np.cumsum(ways, axis=0)]), speed, **options)


def path(plan, bank):
    """Points every few metres on the legs and arcs of a plan: the geometry of fly-by turns."""
    points, speed = plan.waypoints, plan.speeds[0]
    radius = speed**2 / (GRAVITY * np.tan(bank))
    pieces, begin = [], points[0]
    for a, b, c in zip(points[:-2], points[1:-1], points[2:], strict=True):
        u, v = (b - a) / np.hypot(*(b - a)), (c - b) / np.hypot(*(c - b))
        angle = np.arctan2(u[1] * v[0] - u[0] * v[1], u @ v)
        lead = radius * np.tan(abs(angle) / 2)
        first, side = b - lead * u, np.sign(angle) * np.array([u[1], -u[0]])
        pieces.append(np.linspace(begin, first, 4000))
        phi = np.linspace(0.0, abs(angle), 1000)[:, np.newaxis]
        pieces.append(first + radius * (np.sin(phi) * u + (1 - np.cos(phi)) * side))
        begin = b + lead * v
    return np.concatenate([*pieces, np.linspace(begin, points[-1], 4000)])


def off(positions, line):
    """Distances of positions from the nearest point of a line."""
    return spatial.cKDTree(line).query(positions)[0]


def course(velocity):
    return np.degrees(np.arctan2(velocity[..., 0], velocity[..., 1]))


def wrapped(degrees):
    return (np.asarray(degrees) + 180) % 360 - 180


def valid(traffic, flight):
    return slice(0, traffic.count[flight])


def radar(position=(0.0, 0.0), **options):
    settings = {
        "range_sigma": 1e-6,
        "azimuth_sigma": 1e-12,
        "scan_period": 10.0,
        "detection_probability": 1 - 1e-15,
    }
    return Radar(position, **settings | options)
