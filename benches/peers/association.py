"""Gates and assignments, side by side with SciPy and lap, in one run.

CPU time, the least of several rounds on one thread, and the ratio to Tertia. Gates: plots within a
circle, which is all that `cKDTree` can find; Tertia also returns d² and ln |Σ| of each. Assignment:
all tracks against all plots, where `associate` begins with positions and covariances and the others
with the matrix of costs that they are given; the assignments must be equal.
"""

from functools import partial

from timing import least, optional, report

# isort: split
import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from tertia.association import associate, gate, gate_threshold

lap = optional("lap")

EXTENT, SIGMA = 6e5, 300.0
THRESHOLD = gate_threshold("guard")


def scene(count, extent):
    rng = np.random.default_rng(1)
    tracks = rng.uniform(0, extent, (count, 2))
    return tracks, SIGMA**2 * np.eye(2), tracks + rng.normal(0, SIGMA, tracks.shape)


def tree(tracks, covariance, plots):
    """Indices alone, of circles of one radius."""
    return cKDTree(plots).query_ball_point(tracks, SIGMA * THRESHOLD**0.5)


def costs(tracks, covariance, plots):
    """Squared distances, cut at the gate."""
    square = np.sum((tracks[:, np.newaxis] - plots) ** 2, axis=-1) / SIGMA**2
    return np.minimum(square, THRESHOLD)


def gates(count):
    found = scene(count, EXTENT)
    problems = {"Tertia": (partial(gate, *found), 1), "SciPy cKDTree": (partial(tree, *found), 1)}
    report(f"gate, {count:,} tracks and plots", least(problems), "µs")


def assignments(count, extent, what):
    found = scene(count, extent)
    own = partial(associate, *found, score="paper")
    problems = {
        "Tertia": (own, 1),
        "SciPy, matrix and assignment": (lambda: linear_sum_assignment(costs(*found)), 1),
    }
    matrix = costs(*found)
    problems["SciPy, assignment alone"] = (partial(linear_sum_assignment, matrix), 1)
    if lap:
        problems["lap, assignment alone"] = (partial(lap.lapjv, matrix), 1)
        rows, columns = linear_sum_assignment(matrix)
        total = matrix[rows, columns].sum()
        assert np.isclose(lap.lapjv(matrix)[0], total)
    report(f"associate, {count:,} tracks and plots, {what}", least(problems), "µs")


def main():
    for count in (1_000, 20_000):
        gates(count)
    for count in (100, 1_000):
        assignments(count, EXTENT, "far apart")
        assignments(count, 3 * SIGMA, "all within the gates of all")


if __name__ == "__main__":
    main()
