"""Positions and their mirror images, from stations near a plane: docs/location.md."""

from collections.abc import Callable
from typing import Any

import numpy as np

from studies.montecarlo import FloatArray, generator, in_region
from studies.pages import markdown, repetitions
from tertia.location import Location, locate
from tertia.sensors import Bias

RUNS = repetitions(20)
INSTANTS = 200
LIGHT = 299_792_458.0

Scene = tuple[FloatArray, FloatArray, Callable[..., Location]]


def measured(
    places: FloatArray, targets: FloatArray, errors: tuple[float, float], rng: np.random.Generator
) -> FloatArray:
    """Return distances with random and constant errors of these standard deviations."""
    distance = np.linalg.norm(targets[:, np.newaxis] - places, axis=-1)
    noise = errors[0] * rng.standard_normal(distance.shape)
    return np.asarray(distance + noise + errors[1] * rng.standard_normal(len(places)))


def room(rng: np.random.Generator, *, constant: float = 0.0, late: float = 0.0) -> Scene:
    """Return anchors below a ceiling, positions of a tag, and what locates it."""
    places = np.column_stack([rng.uniform([0, 0, 1.8], [10, 8, 2.6], (6, 3))])
    targets = rng.uniform([1, 1, 0.9], [9, 7, 1.5], (INSTANTS, 3))
    ranges = measured(places, targets, (0.1, constant), rng)
    ranges += np.where(rng.random(ranges.shape) < late, rng.exponential(1.0, ranges.shape), 0.0)

    def solve(**options: Any) -> Location:
        return locate(places, range=np.maximum(ranges, 0.0), range_sigma=0.1, **options)

    return places, targets, solve


def far(
    rng: np.random.Generator,
    sizes: tuple[float, float],
    heights: tuple[float, float],
    errors: tuple[float, float],
    speed: float,
) -> Scene:
    """Return receivers on hilly ground, sources above or below it, and what locates them.

    `sizes` are half the width of the area and the largest height of a receiver.
    """
    places = rng.uniform([-sizes[0], -sizes[0], 0], [sizes[0], sizes[0], sizes[1]], (10, 3))
    low, high = (np.array([side * 1.5 * sizes[0]] * 2 + [heights[side > 0]]) for side in (-1, 1))
    targets = rng.uniform(low, high, (INSTANTS, 3))
    arrivals = measured(places, targets, errors, rng) + rng.uniform(0, 1e6, (INSTANTS, 1))

    def solve(**options: Any) -> Location:
        return locate(
            places,
            arrival_time=arrivals / speed,
            arrival_time_sigma=errors[0] / speed,
            propagation_speed=speed,
            propagation_speed_sigma=0.0,
            **options,
        )

    return places, targets, solve


def lightning(rng: np.random.Generator, constant: float = 0.0) -> Scene:
    """Return receivers with clocks of 50 ns, and sources at 3 to 12 km."""
    errors = (50e-9 * LIGHT, constant * LIGHT)
    return far(rng, (30e3, 300.0), (3e3, 12e3), errors, LIGHT)


def earthquakes(rng: np.random.Generator, constant: float = 0.0) -> Scene:
    """Return seismometers whose times have errors of .1 s, and sources at depths of 3 to 15 km."""
    errors = (0.1 * 6000.0, constant * 6000.0)
    return far(rng, (50e3, 1000.0), (-15e3, -3e3), errors, 6000.0)


def drones(rng: np.random.Generator) -> Scene:
    """Return stations with heights of 0 to 20 m, and targets above and below them."""
    places = rng.uniform([-500, -500, 0], [500, 500, 20], (6, 3))
    targets = rng.uniform([-500, -500, 30], [500, 500, 150], (INSTANTS, 3))
    targets[:, 2] *= rng.choice([-1.0, 1.0], INSTANTS)
    ranges = measured(places, targets, (2.0, 0.0), rng)

    def solve(**options: Any) -> Location:
        return locate(places, range=ranges, range_sigma=2.0, **options)

    return places, targets, solve


SCENES: dict[str, Callable[[np.random.Generator], Scene]] = {
    "tag below 6 anchors": room,
    "the same, 10 % of the ranges too long": lambda rng: room(rng, late=0.1),
    "the same, constant errors of 0.1 m": lambda rng: room(rng, constant=0.1),
    "lightning, 10 receivers": lightning,
    "the same, constant errors of 40 ns": lambda rng: lightning(rng, 40e-9),
    "earthquakes, 10 seismometers": earthquakes,
    "the same, constant errors of 0.1 s": lambda rng: earthquakes(rng, 0.1),
    "targets above and below 6 stations": drones,
}


def sides() -> str:
    """Tabulate positions on the right side, alone and in a batch, and coverage."""
    rows = []
    for number, (title, scene) in enumerate(SCENES.items()):
        row = [title]
        found = {"alone": np.zeros(3), "batch": np.zeros(3)}
        for seed in range(RUNS):
            places, targets, solve = scene(generator(288, number, seed))
            for name, options in (("alone", {"bias": Bias()}), ("batch", {})):
                fix = solve(**options)
                located = np.asarray(fix.success)
                error = (fix.position - targets)[located]
                inside = in_region(error, fix.covariance[located])
                middle = places[:, 2].mean()
                over = (fix.position[located, 2] > middle) == (targets[located, 2] > middle)
                found[name] += [located.sum(), over.sum(), np.sum(inside)]
        total = INSTANTS * RUNS
        for count, right, held in found.values():
            row += [f"{count / total:.0%}", f"{(count - right) / total:.1%}", f"{held / count:.0%}"]
        rows.append(row)
    each = ("located", "wrong side", "inside 95 %")
    header = ["scene", *(f"alone: {name}" for name in each), *(f"batch: {name}" for name in each)]
    return markdown(header, rows)
