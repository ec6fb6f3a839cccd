"""Cost of gating and assignment from Python, beside SciPy's tree and its dense assignment."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from tertia import metrics
from tertia.association import associate, gate, gate_threshold

EXTENT, SIGMA = 6e5, 300.0
RADIUS = SIGMA * np.sqrt(gate_threshold("guard"))


def scene(count):
    rng = np.random.default_rng(1)
    tracks = rng.uniform(0, EXTENT, (count, 2))
    return tracks, SIGMA**2 * np.eye(2), tracks + rng.normal(0, SIGMA, tracks.shape)


def tree(tracks, covariance, plots):
    """Indices alone, of circles of one radius."""
    return cKDTree(plots).query_ball_point(tracks, RADIUS)


@pytest.mark.parametrize("count", [1_000, 20_000])
@pytest.mark.parametrize("find", [gate, tree], ids=["tertia", "cKDTree"])
def test_gate(benchmark, find, count):
    benchmark(find, *scene(count))


def dense(tracks, covariance, plots):
    """Least sum of d², cut at the gate."""
    square = np.sum((tracks[:, np.newaxis] - plots) ** 2, axis=-1) / SIGMA**2
    return linear_sum_assignment(np.minimum(square, gate_threshold("guard")))


def by_paper(tracks, covariance, plots):
    return associate(tracks, covariance, plots, score="paper")


@pytest.mark.parametrize(
    ("assign", "count"),
    [(by_paper, 1_000), (by_paper, 20_000), (dense, 1_000)],
    ids=["tertia 1000", "tertia 20000", "linear_sum_assignment 1000"],
)
def test_associate(benchmark, assign, count):
    benchmark(assign, *scene(count))


def test_gospa(benchmark):
    tracks, _, plots = scene(1_000)
    benchmark(metrics.gospa, tracks, plots, 2000.0)


def test_indicators(benchmark):
    time = np.repeat(np.arange(0, 400, 4.0), 100)
    track = np.tile(np.arange(100), 100)
    place = np.column_stack([200.0 * time, 1e4 * track])
    tracks = SimpleNamespace(time=time, track=track, position=place)
    truth = metrics.Truth(time, track, place)
    benchmark(metrics.indicators, tracks, truth, max_distance=500.0, update_interval=4.0)
