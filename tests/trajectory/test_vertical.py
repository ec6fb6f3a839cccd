"""Paths in space whose vertical motion differs from the horizontal one."""

import numpy as np
import pytest
from trajectory.scenes import walk

from tertia._arrays import FloatArray
from tertia.sensors import Station
from tertia.trajectory import Trajectory, reconstruct

STEP, SIGMA = 0.2, 0.1
TIMES = STEP * np.arange(150)
ROOM = np.array([20.0, 20.0])


def found(seed: int, up: FloatArray, **options: float) -> tuple[FloatArray, Trajectory]:
    """Return a walk below six stations at heights of up to 8 m, and its path from their ranges."""
    rng = np.random.default_rng([353, seed])
    way = np.column_stack([walk(rng, len(TIMES), STEP, ROOM), up])
    places = np.column_stack([rng.uniform(0, ROOM, (6, 2)), rng.uniform(3, 8, 6)])
    ranges = np.linalg.norm(way[:, np.newaxis] - places, axis=-1)
    ranges += SIGMA * rng.standard_normal(ranges.shape)
    stations = [Station(place, range_sigma=SIGMA) for place in places]
    return way, reconstruct(stations, TIMES, range=ranges, **options)


@pytest.mark.parametrize(
    ("up", "most"),
    [(np.full(150, 1.2), 0.6), (1.2 + 0.5 * np.sin(2 * TIMES), 1.0)],
    ids=["constant", "up and down"],
)
def test_heights_are_smoothed_as_they_move(up: FloatArray, most: float) -> None:
    """Compared with paths whose intensity, that of the horizontal motion, is given for all axes."""
    errors, inside = [], []
    for seed in range(6):
        way, own = found(seed, up)
        assert own.smoothed is not None
        _, common = found(seed, up, jerk=max(own.smoothed.jerk, 0.05))
        errors.append([np.sqrt(np.mean((one.position - way)[:, 2] ** 2)) for one in (own, common)])
        error = (own.position - way)[:, 2]
        inside.append(np.mean(np.abs(error) < 1.96 * own.sigma[:, 2]))
    own_error, common_error = np.median(errors, axis=0)
    assert own_error < most * common_error
    assert np.mean(inside) > 0.88
