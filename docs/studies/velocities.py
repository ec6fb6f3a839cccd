"""What measured velocities add to a smoothed path, as stated and otherwise."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from studies.montecarlo import generator, in_region
from studies.pages import markdown, repetitions
from tertia.smoothing import smooth

FloatArray: TypeAlias = npt.NDArray[np.float64]
Measured: TypeAlias = tuple[FloatArray, FloatArray]

RUNS, STEPS, STEP, FINE = 60, 120, 4.0, 20
POSITION, VELOCITY = 50.0, 1.0
# a name of a case, which is part of its seed, and its label in the table
LABEL = (
    "velocities with AR(.9) noise besides",
    "velocities with additional AR(.9) noise",
)


def flight(runs: int, rng: np.random.Generator, late: float = 0.0) -> tuple[FloatArray, ...]:
    """Return positions, velocities, and velocities as they were a time before: (runs, steps, 2).

    A turn of 1.5 degrees a second, and 30 m/s more within a minute.
    """
    t = STEP / FINE * np.arange(FINE * STEPS)
    rate = np.where((t > 160) & (t < 240), np.radians(1.5), 0.0)
    speed = 150.0 + 0.5 * np.clip(t - 300.0, 0, 60)
    turned = np.cumsum(rate) * STEP / FINE
    course = rng.uniform(0, 2 * np.pi, (runs, 1)) + turned
    velocity = speed[:, np.newaxis] * np.stack([np.sin(course), np.cos(course)], axis=-1)
    middle = 0.5 * (velocity[:, 1:] + velocity[:, :-1])
    position = np.concatenate([0 * middle[:, :1], np.cumsum(middle, axis=1)], axis=1) * STEP / FINE
    before = np.maximum(np.arange(0, len(t), FINE) - round(late * FINE / STEP), 0)
    return position[:, ::FINE], velocity[:, ::FINE], velocity[:, before]


def lasting(shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
    """Return noise of unit variance whose successive values have the correlation 0.9."""
    x = rng.standard_normal(shape)
    for k in range(1, shape[1]):
        x[:, k] = 0.9 * x[:, k - 1] + np.sqrt(1 - 0.9**2) * x[:, k]
    return x


def cases() -> dict[str, Callable[[Measured, np.random.Generator], Measured]]:
    """Return what is done to measured positions and velocities."""

    def some(shape: tuple[int, ...], share: float, rng: np.random.Generator) -> FloatArray:
        return np.asarray(rng.random(shape[:2])[..., np.newaxis] < share)

    return {
        "as stated": lambda m, rng: m,
        "half of the velocities missing": lambda m, rng: (
            m[0],
            np.where(some(m[1].shape, 0.5, rng), np.nan, m[1]),
        ),
        "5 % of positions off by 3 km": lambda m, rng: (
            m[0] + 2_100.0 * some(m[0].shape, 0.05, rng),
            m[1],
        ),
        "5 % of velocities zero": lambda m, rng: (
            m[0],
            np.where(some(m[1].shape, 0.05, rng), 0.0, m[1]),
        ),
        "velocities 3 times as noisy": lambda m, rng: (
            m[0],
            m[1] + np.sqrt(8) * VELOCITY * rng.standard_normal(m[1].shape),
        ),
        "velocities with AR(.9) noise besides": lambda m, rng: (
            m[0],
            m[1] + VELOCITY * lasting(m[1].shape, rng),
        ),
        "velocities rounded to 5 m/s": lambda m, rng: (m[0], 5.0 * np.round(m[1] / 5.0)),
    }


def velocities() -> str:
    """Return errors and coverage of smoothed states without and with velocities."""
    rows = []
    altered = cases()
    late = {f"velocities {lag:.0f} s late": lag for lag in (1.0, 2.0)}
    for name in [*altered, *late]:
        rng = generator(98, sum(name.encode()))
        position, velocity, shown = flight(repetitions(RUNS), rng, late.get(name, 0.0))
        y = position + POSITION * rng.standard_normal(position.shape)
        v = shown + VELOCITY * rng.standard_normal(shown.shape)
        if name in altered:
            y, v = altered[name]((y, v), rng)
        cells = []
        for measured in ({}, {"velocity": v, "velocity_covariance": VELOCITY**2}):
            found = smooth(y, POSITION**2, dt=STEP, **measured)  # type: ignore[arg-type]
            for error, covariance in (
                (found.position - position, found.position_covariance),
                (found.velocity - velocity, found.velocity_covariance),
            ):
                rms = np.sqrt(np.mean(np.sum(error**2, axis=-1)))
                inside = np.mean(in_region(error, covariance))
                cells.append(f"{rms:.1f}; {inside:.0%}")
        rows.append([name.replace(*LABEL), *cells])
    head = ["RMSE; within 95 %", "position, m", "velocity, m/s"]
    return markdown([*head, "with velocities: position, m", "velocity, m/s"], rows)
