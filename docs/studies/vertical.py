"""Paths in space whose vertical motion differs from the horizontal one."""

from contextlib import suppress

import numpy as np

from studies.montecarlo import WITHIN_95, FloatArray, generator, in_region
from studies.pages import markdown, repetitions
from studies.walkers import walk
from tertia.sensors import Station
from tertia.trajectory import reconstruct

RUNS = repetitions(40)
COUNT, STEP = 150, 0.2
SIGMA = 0.1
ROOM = np.array([20.0, 20.0])
# amplitude in metres and period in seconds of the height
HEIGHTS = {"constant": (0.0, 1.0), "20 cm in 31 s": (0.2, 31.4), "50 cm in 3 s": (0.5, 3.1)}
# height of the room, and speed of the tag
SCENES = {"room of 4 m, 1 m/s": (4.0, 1.0), "hall of 8 m, 3 m/s": (8.0, 3.0)}


def walked(speed: float, height: tuple[float, float], rng: np.random.Generator) -> FloatArray:
    """Return a walk that turns at the walls."""
    way = walk(rng, COUNT, speed * STEP, ROOM, bend=0.3 * np.sqrt(STEP))
    amplitude, period = height
    up = 1.2 + amplitude * np.sin(2 * np.pi * STEP * np.arange(COUNT) / period)
    return np.column_stack([way, up])


def vertical() -> str:
    """Tabulate errors and coverage of the horizontal position and of the height."""
    rows = []
    for at, (title, (top, speed)) in enumerate(SCENES.items()):
        for number, (name, height) in enumerate(HEIGHTS.items()):
            cells = []
            for run in range(RUNS):
                rng = generator(353, at, number, run)
                way = walked(speed, height, rng)
                places = np.column_stack([rng.uniform(0, ROOM, (6, 2)), rng.uniform(0, top, 6)])
                # two paths may explain all ranges equally well
                with suppress(ValueError):
                    cells.append(_one(way, places, rng))
            horizontal, _, up, _ = np.median(cells, axis=0)
            _, inside, _, above = np.mean(cells, axis=0)
            rows.append(
                [
                    title,
                    name,
                    f"{100 * horizontal:.1f}; {inside:.0%}",
                    f"{100 * up:.1f}; {above:.0%}",
                ]
            )
    return markdown(["scene", "height", "horizontal", "vertical"], rows)


def _one(way: FloatArray, places: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the RMSE and the share inside, of the horizontal position and of the height."""
    ranges = np.linalg.norm(way[:, np.newaxis] - places, axis=-1)
    ranges += SIGMA * rng.standard_normal(ranges.shape)
    stations = [Station(place, range_sigma=SIGMA) for place in places]
    track = reconstruct(stations, STEP * np.arange(COUNT), range=np.maximum(ranges, SIGMA))
    error, covariance = track.position - way, track.covariance
    inside = in_region(error[:, :2], covariance[:, :2, :2])
    above = error[:, 2] ** 2 < WITHIN_95[1] * covariance[:, 2, 2]
    squares = np.mean(error**2, axis=0)
    return np.array([np.sqrt(squares[:2].sum()), inside.mean(), np.sqrt(squares[2]), above.mean()])
